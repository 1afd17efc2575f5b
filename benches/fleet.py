"""Many devices, the way to a fit, and recordings as CSV: times as ratios of one run.

`python benches/fleet.py` from the root of the repository prints a table; `--write` puts it into
`docs/verbs-measured.md`. Contenders take turns and the shortest time of each counts, so that a busy
machine slows all of them alike. Before anything is timed, contenders must agree to the bit.
"""

from __future__ import annotations

import argparse
import os
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

if __name__ == "__main__":  # one thread where threads are not the question
    for _name in ("OMP", "OPENBLAS", "MKL", "RAYON"):
        os.environ[f"{_name}_NUM_THREADS"] = "1"
    sys.path[0] = str(Path(__file__).parent.parent)  # not benches: a file there may hide a module

import numpy as np

import rsicalib
from rsicalib import _core
from rsicalib.fleets.dataset import Partition
from rsicalib.fleets.engines import Job, over_threads
from rsicalib.io.tables import File, numbers, table_of_file, table_of_numbers

PAGE = Path(__file__).parents[1] / "docs" / "verbs-measured.md"
BEGIN, END = "<!-- written by benches/fleet.py -->", "<!-- end -->"
MECHANISM = rsicalib.load_mechanism("rsi")


def shortest(jobs: Mapping[str, Callable[[], object]], rounds: int) -> dict[str, float]:
    """Shortest time of each job [s]; the jobs take turns."""
    best = dict.fromkeys(jobs, np.inf)
    for _ in range(rounds):
        for name, job in jobs.items():
            start = time.perf_counter()
            job()
            best[name] = min(best[name], time.perf_counter() - start)
    return best


def sessions(count: int) -> list[Any]:
    """Sessions of 24 poses of 4 samples, each of a device of its own."""
    return [rsicalib.simulate(poses=24, samples=4, check=1, seed=seed) for seed in range(count)]


def table_of(made: list[Any]) -> tuple[dict[str, Any], dict[str, Any]]:
    """Readings and rest readings of devices, as `calibrate_devices` takes them."""
    frame: dict[str, Any] = {}
    rest: dict[str, Any] = {}
    for into, of in ((frame, [m.readings for m in made]), (rest, [m.rest for m in made])):
        into["device"] = np.repeat(np.arange(len(of)), [len(r) for r in of])
        for k, channel in enumerate(MECHANISM.channels):
            into[channel.name] = np.concatenate([r.values[:, k] for r in of])
    frame["pose"] = np.concatenate([m.readings.pose for m in made])
    return frame, rest


def devices(rounds: int) -> list[tuple[str, str]]:
    """One thread: a loop of `calibrate` beside `calibrate_devices`; then two threads."""
    made = sessions(100)
    frame, rest = table_of(made)
    job = Job(MECHANISM, "device", {"trace": False})
    parts = [Partition(*table_of(made[k : k + 10])) for k in range(0, len(made), 10)]

    def loop() -> list[float | None]:
        found = [rsicalib.calibrate(m.readings, MECHANISM, rest=m.rest) for m in made]
        return [one.fit.chi2 for one in found]

    def bulk(**options: bool) -> list[float]:
        rows = rsicalib.calibrate_devices(frame, rest=rest, trace=False, **options)
        return list(rows["chi2"])

    nominal = [(c.offset, c.gain) for c in MECHANISM.channels]
    offsets, gains = np.array(nominal).T.copy()

    def algebraic() -> None:
        for m in made:
            _core.minimize(MECHANISM, m.readings.values, offsets, gains)

    assert loop() == bulk()
    best = shortest(
        {
            "loop": loop,
            "bulk": bulk,
            "held out": lambda: bulk(held_out=True),
            "algebraic": algebraic,
            "one": lambda: list(over_threads(job, parts, 1)),
            "two": lambda: list(over_threads(job, parts, 2)),
        },
        rounds,
    )
    per, beside = len(made), best["bulk"] / best["algebraic"]
    return [
        ("devices of 24 × 4 a second and thread", f"{per / best['bulk']:.0f}"),
        ("beside the bare algebraic fit (11), times as long", f"{beside:.0f}"),
        ("a loop of `calibrate`, times as long", f"{best['loop'] / best['bulk']:.2f}"),
        ("with held-out figures, times as long", f"{best['held out'] / best['bulk']:.2f}"),
        ("two threads beside one, devices a second", f"{best['one'] / best['two']:.2f}"),
    ]


def starting(rounds: int) -> list[tuple[str, str]]:
    """Processes: how long they take beside one that does nothing."""

    def process(*words: str) -> Callable[[], object]:
        return lambda: subprocess.run([sys.executable, *words], check=True, capture_output=True)

    demo = Path(rsicalib.DEMO)
    readings, rest = demo / "readings.csv", demo / "rest.csv"
    words = ["calibrate", str(readings), "--rest", str(rest), "--quiet"]

    def command() -> object:  # exits with 4: the session of the package lacks an effect
        return subprocess.run([sys.executable, "-m", "rsicalib", *words], capture_output=True)

    def calibration() -> object:
        return rsicalib.calibrate(readings, rest=rest)

    best = shortest(
        {
            "nothing": process("-c", "pass"),
            "numpy": process("-c", "import numpy"),
            "rsicalib": process("-c", "import rsicalib"),
            "command": command,
            "work": calibration,
        },
        rounds,
    )
    numpy = best["numpy"] - best["nothing"]
    overhead = best["command"] - best["work"] - best["nothing"]
    return [
        ("`import numpy` [ms]", f"{1e3 * numpy:.0f}"),
        ("`import rsicalib` [ms]", f"{1e3 * (best['rsicalib'] - best['nothing']):.0f}"),
        ("the command's overhead beside `import numpy`, times", f"{overhead / numpy:.2f}"),
    ]


def recording(rows: int, rounds: int) -> list[tuple[str, str]]:
    """A recording as CSV: the fast path and the whole of `load_readings` beside `numpy.loadtxt`."""
    rng = np.random.default_rng(0)
    t = 0.01 * np.arange(rows)
    phase = np.outer(t, rng.uniform(0.1, 0.5, 9)) + rng.uniform(0, 6, 9)
    counts = np.rint(2048 + 900 * np.sin(phase) + rng.normal(0, 1, phase.shape)).astype(int)
    names = ",".join(channel.name for channel in MECHANISM.channels)
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "run.csv"
        with path.open("w", encoding="utf-8") as file:
            file.write(f"time_s,{names}\n")
            for time_s, row in zip(t.tolist(), counts.tolist(), strict=True):
                file.write(f"{time_s:.2f},{','.join(map(str, row))}\n")
        data = File(str(path), path.read_bytes(), "")
        fast, slow = table_of_numbers(data), table_of_file(data)
        assert fast is not None
        for a, b in zip(fast.columns, slow.columns, strict=True):
            assert np.array_equal(np.asarray(a), numbers(b))

        def with_numpy() -> object:
            return np.loadtxt(path, delimiter=",", skiprows=1, comments=None)

        best = shortest(
            {
                "parse": lambda: table_of_numbers(data),
                "load": lambda: rsicalib.load_readings(path),
                "loadtxt": with_numpy,
                "cells": lambda: table_of_file(data),
            },
            rounds,
        )
    parse, load, loadtxt = best["parse"], best["load"], best["loadtxt"]
    return [
        (f"`load_readings`, {rows:,} rows of CSV [s]", f"{load:.2f}"),
        ("the same beside `numpy.loadtxt`, times as long", f"{load / loadtxt:.1f}"),
        ("its parser beside `numpy.loadtxt`, times as fast", f"{loadtxt / parse:.1f}"),
        ("cell by cell beside the parser, times as long", f"{best['cells'] / parse:.0f}"),
    ]


def main() -> None:
    """Time everything, and print or write the table."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--rounds", type=int, default=7)
    parser.add_argument("--rows", type=int, default=1_000_000)
    parser.add_argument("--write", action="store_true", help="into docs/verbs-measured.md")
    options = parser.parse_args()
    found = [
        *devices(options.rounds),
        *starting(options.rounds),
        *recording(options.rows, max(2, options.rounds // 2)),
    ]
    lines = ["| one run, one machine | |", "|---|--:|", *(f"| {what} | {n} |" for what, n in found)]
    print("\n".join(lines))
    if options.write:
        text = PAGE.read_text(encoding="utf-8")
        head, _, rest = text.partition(BEGIN)
        _, _, tail = rest.partition(END)
        body = "\n".join([BEGIN, "", *lines, "", END])
        PAGE.write_text(head + body + tail, encoding="utf-8")


if __name__ == "__main__":
    main()
