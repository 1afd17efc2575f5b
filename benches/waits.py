"""What people wait for: traces, plans, reports, large mechanisms, long recordings.

`python benches/waits.py` from the root of the repository prints a table; `--write` puts it into
`BENCHMARK.md`. The shortest of several runs counts, on as many threads as there are cores. The unit
beside milliseconds is a fit by SciPy of the paper's problem at 24 poses in the same run: a busy or
slow machine slows both.
"""

from __future__ import annotations

import argparse
import json
import os
import resource
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Iterator
from itertools import product
from pathlib import Path
from typing import Any

if __name__ == "__main__":
    sys.path[0] = str(Path(__file__).parent.parent)  # not benches: a file there may hide a module

import numpy as np

import rsicalib
from benches.peers import worker
from benches.speed import session
from rsicalib.reproduction.noise import closed_loop_noise
from rsicalib.reproduction.paper import printed_numbers
from rsicalib.reproduction.trials import Draws
from tests.blind import effects, simulator, trials
from tests.blind.simulator import Device

PAGE = Path(__file__).parents[1] / "BENCHMARK.md"
BEGIN, END = "<!-- waits -->", "<!-- end of waits -->"

ONE_BY_ONE = 384
"""Readings that are placed one by one: those of the session of the package."""

Line = tuple[str, float, str]
"""What, seconds, what was asked for."""


def shortest(job: Callable[[], object], rounds: int) -> float:
    """Shortest time of a job [s]; a long job runs once."""
    best = np.inf
    for _ in range(rounds):
        start = time.perf_counter()
        job()
        best = min(best, time.perf_counter() - start)
        if best > 1.0:
            break
    return best


def scipy_fit() -> float:
    """The yardstick [s]."""
    counts, start = session(24)
    return shortest(worker.scipy(counts, start), 300)


def laws(count: int) -> list[rsicalib.Term]:
    """So many laws of a sensor as a user writes them."""
    return [
        rsicalib.Term(
            f"lobes_{n}",
            klass="sensor",
            per="channel",
            correction=f"a*u*sin({n}*phi)",
            parameters={"a": 0.01},
        )
        for n in range(3, 3 + count)
    ]


def held_poses(rounds: int) -> Iterator[Line]:
    """Sessions of 48 poses of 8 samples."""
    clean = rsicalib.simulate(poses=48, samples=8, seed=1)
    three = trials.given(trials.make("triples", 0, 1))

    def traced() -> rsicalib.Trace:
        return rsicalib.trace(clean.readings, rest=clean.rest)

    def three_effects() -> object:
        return rsicalib.trace(three.readings, rest=three.rest)

    def calibrated() -> object:
        return rsicalib.calibrate(clean.readings, rest=clean.rest)

    def with_laws() -> object:
        return rsicalib.trace(three.readings, lawful, rest=three.rest)

    lawful = rsicalib.Mechanism.rsi().with_terms(laws(20))
    found = traced()
    yield "`calibrate` 48 × 8", shortest(calibrated, rounds), ""
    yield "`trace` 48 × 8, nothing to find", shortest(traced, rounds), "15 ms"
    yield "`trace` 48 × 8, three effects", shortest(three_effects, rounds), "60 ms"
    yield "the same with 20 laws of each sensor more", shortest(with_laws, rounds), "1.5 times that"
    yield "report of a trace", shortest(found.report, rounds), "0.3 s"


def placing(rounds: int) -> Iterator[Line]:
    """Poses of readings that come one by one, as in a control loop."""
    placer = rsicalib.Placer(calibration=rsicalib.demo())
    rows = list(rsicalib.load_readings(rsicalib.DEMO / "readings.csv").values)[:ONE_BY_ONE]
    whole = rsicalib.forward(np.array(rows), calibration=rsicalib.demo())
    np.testing.assert_allclose([placer(row) for row in rows], whole, rtol=0.0, atol=1e-9)

    def one_by_one() -> None:
        for row in rows:
            placer(row)

    seconds = shortest(one_by_one, rounds) * 1000 / len(rows)
    yield "`Placer`, 1,000 poses one by one", seconds, "50 ms (20,000 a second)"


def planning(rounds: int) -> Iterator[Line]:
    """Twelve poses of 2,000 candidates."""
    yield (
        "`plan`, 2,000 candidates",
        shortest(lambda: rsicalib.plan(candidates=2000), rounds),
        "0.3 s",
    )


def snake(joints: int) -> dict[str, Any]:
    """One chain of so many joints, whose end touches a point."""
    names = [f"q{k}" for k in range(joints)]
    turns = [0.5 * np.pi * (-1) ** k for k in range(joints)]
    rows = [
        {"channel": name, "a": 0.1, "alpha": turn} for name, turn in zip(names, turns, strict=True)
    ]
    return {
        "name": "snake",
        "length_unit": "m",
        "channel": [{"name": name, "unit": "rad", "gain": 1.0, "offset": 0.0} for name in names],
        "chain": [{"name": "snake", "dh": rows}],
        "point": [
            {"name": "tip", "chain": "snake", "at": [0.1, 0.0, 0.0]},
            {"name": "socket", "at": [0.05 * joints**0.5, 0.0, 0.0]},
        ],
        "closure": [{"name": "tip-socket", "kind": "touch", "between": ["tip", "socket"]}],
    }


def large_mechanisms() -> Iterator[Line]:
    """What poses could tell of mechanisms of many joints."""
    for joints, asked in ((100, "0.5 s"), (300, "5 s")):
        mechanism = rsicalib.Mechanism.from_dict(snake(joints))
        seconds = shortest(lambda it=mechanism: rsicalib.identifiable(it), 3)
        yield f"`mechanism` of {joints} joints", seconds, asked


def table_nine() -> Iterator[Line]:
    """10,000 fits of Table IX: its 8 cells of the closed loop, 1,250 trials each."""
    printed = printed_numbers()

    def cells() -> None:
        for average, noise in product((2, 100), (0, 1, 2, 4)):
            draws = Draws(1250, 1995, lambda _done, _of: None)
            poses = printed.closed_loop
            closed_loop_noise(printed.nominal, poses, draws, noise=noise, average=average)

    yield "Table IX, 10,000 fits of the closed loop", shortest(cells, 3), "0.4 s"


def write_recording(path: Path, rows: int, ripple: bool) -> Path:
    """A recording of so many rows as CSV, and a rest reading beside it."""
    rng = np.random.default_rng([rows, ripple])
    device = Device.random(rng)
    present = (effects.Ripple("a22", 0.004, wave=150.0),) if ripple else ()
    made = simulator.recording(device, rng, seconds=rows / 200.0, effects=present)
    rest = simulator.rest(device, rng, effects=present)
    names = [channel.name for channel in rsicalib.load_mechanism("rsi").channels]
    beside = path.with_name(f"rest-{path.name}")
    np.savetxt(beside, rest["values"], "%d", ",", header=",".join(names), comments="")
    table = np.column_stack([made["time_s"], made["values"]])
    form = ["%.6f", *["%d"] * len(names)]
    np.savetxt(path, table, form, ",", header=",".join(["time_s", *names]), comments="")
    return beside


def peak_memory() -> float:
    """Most memory that this process has had [B].

    By Linux's own account where there is one: what `getrusage` says begins with the memory of the
    process that began this one.
    """
    status = Path("/proc/self/status")
    if status.exists():
        lines = status.read_text(encoding="utf-8").splitlines()
        return 1024.0 * next(int(line.split()[1]) for line in lines if line.startswith("VmHWM:"))
    return 1024.0 * resource.getrusage(resource.RUSAGE_SELF).ru_maxrss


def recording(path: Path, rest: Path, verb: str) -> dict[str, float]:
    """Seconds to read and to work, in this process, and the memory that took: the peak above what
    stood before and above the array of readings, in sizes of that array."""
    before = peak_memory()
    start = time.perf_counter()
    readings = rsicalib.load_readings(path)
    read = time.perf_counter() - start
    start = time.perf_counter()
    getattr(rsicalib, verb)(readings, rest=rest)
    work = time.perf_counter() - start
    size = readings.values.nbytes
    return {"read": read, "work": work, "times": (peak_memory() - before - size) / size}


def recordings(rows: int) -> Iterator[tuple[str, float, str, float]]:
    """Long recordings, each in a process of its own; and how many times the readings they need."""
    jobs = (
        ("`calibrate`", "calibrate", False, "5 s, 8 times"),
        ("`trace`, nothing to find", "trace", False, "10 s, 8 times"),
        ("`trace`, a ripple", "trace", True, "40 s, 8 times"),
    )
    with tempfile.TemporaryDirectory() as folder:
        for number, (what, verb, ripple, asked) in enumerate(jobs):
            path = Path(folder) / f"{'ripple' if ripple else 'clean'}.csv"
            rest = path.with_name(f"rest-{path.name}")
            if not path.exists():
                write_recording(path, rows, ripple)
            command = [sys.executable, __file__, "--recording", str(path), str(rest), verb]
            done = subprocess.run(command, capture_output=True, text=True, check=True)
            found = json.loads(done.stdout)
            if number == 0:
                yield f"CSV of {rows:,} rows", found["read"], "1.5 s", np.nan
            yield f"{what}, {rows:,} rows", found["work"], asked, found["times"]


def table(rounds: int, rows: int) -> str:
    """Everything, as lines of Markdown."""
    unit = scipy_fit()
    out = [
        f"{os.cpu_count()} cores; one SciPy fit takes {1e3 * unit:.2f} ms.",
        "",
        "| wait | time | SciPy fits | asked for | memory above the readings |",
        "|---|--:|--:|--:|--:|",
    ]
    print("\n".join(out), flush=True)

    def add(what: str, seconds: float, asked: str, times: float = np.nan) -> None:
        took = f"{1e3 * seconds:.1f} ms" if seconds < 1.0 else f"{seconds:.1f} s"
        memory = "" if np.isnan(times) else f"{times:.1f} times"
        out.append(f"| {what} | {took} | {seconds / unit:,.0f} | {asked} | {memory} |")
        print(out[-1], flush=True)

    for lines in (
        held_poses(rounds),
        placing(rounds),
        planning(rounds),
        large_mechanisms(),
        table_nine(),
    ):
        for line in lines:
            add(*line)
    for long in recordings(rows):
        add(*long)
    return "\n".join(out)


def main() -> None:
    """Time everything, and print or write the table."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--rounds", type=int, default=30)
    parser.add_argument("--rows", type=int, default=1_000_000)
    parser.add_argument("--write", action="store_true", help="into BENCHMARK.md")
    parser.add_argument("--recording", nargs=3, help=argparse.SUPPRESS)
    options = parser.parse_args()
    if options.recording:
        path, rest, verb = options.recording
        print(json.dumps(recording(Path(path), Path(rest), verb)))
        return
    found = table(options.rounds, options.rows)
    if options.write:
        text = PAGE.read_text(encoding="utf-8")
        head, tail = text.split(BEGIN)[0], text.split(END)[1]
        PAGE.write_text(f"{head}{BEGIN}\n{found}\n{END}{tail}", encoding="utf-8")


if __name__ == "__main__":
    main()
