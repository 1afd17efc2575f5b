"""Many devices in one stream: `python -m tests.watch.fleet --devices 1000`.

Prints rows per second and the largest memory of a process that watches so many devices, whose rows
come in turn, some devices at a time in memory.
"""

from __future__ import annotations

import argparse
import dataclasses
import json
import subprocess
import sys
import tempfile
from collections.abc import Sequence
from pathlib import Path

import numpy as np

from tests.watch.device import Work, calibrated

WATCH = """
import json, resource, sys, time
import rsicalib
begun = time.process_time()
path, results, awake = sys.argv[1:]
watching = rsicalib.watch_devices(path, results, awake=int(awake))
alarms = sum(1 for _ in watching)
seconds = time.process_time() - begun
memory = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024
print(json.dumps([alarms, watching.summary().rows, seconds, memory]))
"""


def main(arguments: Sequence[str] | None = None) -> None:
    """Write a stream, watch it and print what it took."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--devices", type=int, default=1000)
    parser.add_argument("--rows", type=int, default=512, help="of each device")
    parser.add_argument("--awake", type=int, default=128)
    parser.add_argument("--seed", type=int, default=1)
    options = parser.parse_args(arguments)
    device, found, rng = calibrated(options.seed)
    values = Work(device, rng).rows(options.rows)
    with tempfile.TemporaryDirectory() as folder:
        place = Path(folder)
        names = [f"d{k}" for k in range(options.devices)]
        (place / "results").mkdir()
        for name in names:
            dataclasses.replace(found, device=name).save(place / "results" / f"{name}.json")
        with open(place / "rows.csv", "w", encoding="utf-8") as file:
            file.write(",".join(["device", *(f"a{i}{j}" for i in (1, 2, 3) for j in (1, 2, 3))]))
            for row in values:
                cells = ",".join(f"{v:.0f}" for v in np.asarray(row))
                file.write("".join(f"\n{name},{cells}" for name in names))
            file.write("\n")
        words = [sys.executable, "-c", WATCH, str(place / "rows.csv"), str(place / "results")]
        done = subprocess.run([*words, str(options.awake)], stdout=subprocess.PIPE, check=True)
    alarms, rows, seconds, memory = json.loads(done.stdout)
    print(
        f"{options.devices} devices, {options.awake} awake: {rows} rows in {seconds:.0f} s of "
        f"processor time, {rows / seconds:.0f} rows per second, {memory:.0f} MB, {alarms} alarms"
    )


if __name__ == "__main__":
    main()
