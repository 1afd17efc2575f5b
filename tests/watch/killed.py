"""A watch killed at random, again and again: `python -m tests.watch.killed`.

Prints how many alarms an unbroken watch raises, and whether those of a watch that is killed with
SIGKILL and begun again with `--state`, up to thirty times, are the same.
"""

from __future__ import annotations

import argparse
import json
import signal
import subprocess
import sys
import tempfile
import time
from collections.abc import Sequence
from pathlib import Path

import numpy as np

from tests.watch.device import Change, Work, calibrated

NAMES = tuple(f"a{i}{j}" for i in (1, 2, 3) for j in (1, 2, 3))


def alarms_of(lines: Sequence[str]) -> list[str]:
    """Alarms in order, each once; a line that was cut off is none."""
    found: dict[str, None] = {}
    for line in lines:
        try:
            if json.loads(line)["format"] == "rsicalib.alarm/1":
                found[line] = None
        except (ValueError, KeyError):
            continue
    return list(found)


def main(arguments: Sequence[str] | None = None) -> None:
    """Kill and compare."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--kills", type=int, default=30)
    parser.add_argument("--rows", type=int, default=2_000_000)
    parser.add_argument("--seed", type=int, default=1)
    options = parser.parse_args(arguments)
    device, found, rng = calibrated(options.seed)
    change = Change("a22", 0.004, since=options.rows // 2)
    values = Work(device, rng, change=change).rows(options.rows)
    with tempfile.TemporaryDirectory() as folder:
        place = Path(folder)
        found.save(place / "result.json")
        with open(place / "rows.csv", "w", encoding="utf-8") as file:
            file.write(",".join(NAMES) + "\n")
            np.savetxt(file, values, fmt="%.0f", delimiter=",")
        words = [sys.executable, "-m", "rsicalib", "watch", str(place / "rows.csv")]
        words += ["--calibration", str(place / "result.json"), "--false-alarms", "1e-3"]
        begun = time.monotonic()
        subprocess.run([*words[:3], "--version"], capture_output=True, check=True)
        start = time.monotonic() - begun
        whole = subprocess.run([*words, "--quiet"], capture_output=True, text=True, check=False)
        took = time.monotonic() - begun - start
        lines: list[str] = []
        kills = 0
        while True:
            state = ["--quiet", "--state", str(place / "state")]
            run = subprocess.Popen([*words, *state], stdout=subprocess.PIPE, text=True)
            try:
                # Killed as often as asked before the end, wherever it is then.
                wait = start + float(rng.uniform(0.0, 2.0 * took / options.kills))
                out, _ = run.communicate(timeout=wait if kills < options.kills else None)
            except subprocess.TimeoutExpired:
                run.send_signal(signal.SIGKILL)
                out, _ = run.communicate()
                kills += 1
                lines += out.splitlines()
                continue
            lines += out.splitlines()
            break
        expected, told = alarms_of(whole.stdout.splitlines()), alarms_of(lines)
        same = "identical" if expected == told else "different"
        print(f"{len(expected)} alarms, {kills} kills: {same} ({len(told)} told)")


if __name__ == "__main__":
    main()
