"""Watches measured: `python -m tests.watch.run rate --noise white --promise 1e-5 --rows 10000000`.

`rate`: run length of sound devices against the promised one. `delay`: rows until a change raises an
alarm, and what is named. `speed`: rows per second on one thread. Devices are seeded one by one:
figures do not depend on the number of jobs.
"""

from __future__ import annotations

import argparse
import itertools
import multiprocessing
from collections.abc import Sequence
from functools import partial

import numpy as np

from tests.watch.device import NOISES
from tests.watch.trials import Found, Quiet, changed, one_by_one, quiet

SIZES = {
    "step": (0.5, 1.0, 2.0, 4.0, 8.0, 32.0),
    "drift": (0.5, 2.0, 8.0, 32.0),
    "forearm": (0.005, 0.01, 0.02, 0.05),
    "in_plane": (0.005, 0.01, 0.02, 0.05),
    "upper_arm": (0.005, 0.01, 0.02, 0.05),
}
"""Counts for a step, counts per 10000 rows for a drift, inches for a bent link."""


def rate(args: argparse.Namespace) -> None:
    """Print alarms of sound devices, and what was promised."""
    each = args.rows // args.devices
    for kind in args.noise:
        for promise in args.promise:
            job = partial(_quiet, args.seed, kind, promise, each, args.lost)
            found: list[Quiet] = args.map(job, range(args.devices))
            alarms = np.array([one.alarms for one in found])
            rows = sum(one.rows for one in found)
            # Devices are independent; alarms of one may follow each other.
            spread = max(float(alarms.std(ddof=1)) * len(alarms) ** 0.5, 1.0)
            print(
                f"{kind:10} promised {promise:.0e}: {alarms.sum():6d} alarms in {rows} rows, "
                f"{alarms.sum() / rows:.2e} ± {spread / rows:.0e}; one in "
                f"{rows / max(alarms.sum(), 1):.0f}; seed {args.seed}, {args.devices} devices",
                flush=True,
            )


def delay(args: argparse.Namespace) -> None:
    """Print rows until an alarm, by noise and size, and how often the right part is named."""
    for kind, what in itertools.product(args.noise, args.change):
        for size in SIZES[what]:
            job = partial(_changed, args.seed, kind, what, size, args.promise[0])
            found: list[Found] = args.map(job, range(args.devices))
            print(f"{kind:10} {what:9} {size:<6g} {_words(found)}; seed {args.seed}", flush=True)


def _words(found: Sequence[Found]) -> str:
    sound = [one for one in found if not one.early]
    late = [one.delay for one in sound if one.delay is not None]
    if not late:
        return f"missed by all of {len(sound)}"
    low, half, high = np.percentile(late, [25, 50, 75])
    seen = [one for one in sound if one.delay is not None]

    def share(values: list[bool]) -> str:
        p, n = float(np.mean(values)), len(values)
        error = np.sqrt(max(p * (1 - p), 0.5 / n) / n)
        return f"{100 * p:.0f} ± {100 * error:.0f} %"

    return (
        f"delay {half:.0f} rows ({low:.0f} … {high:.0f}), missed {len(sound) - len(late)} of "
        f"{len(sound)}; named at once {share([f.first for f in seen])}, or listed "
        f"{share([f.listed for f in seen])}; in the end {share([f.last for f in seen])}, or listed "
        f"{share([f.last_listed for f in seen])}; said to go on {share([f.drifts for f in seen])}; "
        f"{np.mean([f.more for f in seen]):.2f} more alarms"
    )


def speed(args: argparse.Namespace) -> None:
    """Print rows per second of processor time, and microseconds of a row by itself."""
    found = [quiet([args.seed, device], "white", 1e-5, 50_000) for device in range(3)]
    print(f"{sum(f.rows for f in found) / sum(f.seconds for f in found):.0f} rows per second")
    alone = [one_by_one([args.seed, device], 20_000) for device in range(3)]
    print(f"{1e6 * float(np.median(alone)):.1f} µs for a row by itself")


def _quiet(seed: int, kind: str, promise: float, rows: int, lost: float, device: int) -> Quiet:
    return quiet([seed, NOISES.index(kind), device], kind, promise, rows, lost)


def _changed(seed: int, kind: str, what: str, size: float, promise: float, device: int) -> Found:
    return changed([seed, 1000 + device], kind, what, size, promise)


def main(argv: Sequence[str] | None = None) -> None:
    """Run one measurement."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("what", choices=("rate", "delay", "speed"))
    parser.add_argument("--noise", nargs="+", choices=NOISES, default=list(NOISES))
    parser.add_argument("--change", nargs="+", choices=tuple(SIZES), default=list(SIZES))
    parser.add_argument("--promise", nargs="+", type=float, default=[1e-5])
    parser.add_argument("--rows", type=int, default=10_000_000, help="of all devices together")
    parser.add_argument("--lost", type=float, default=0.0, help="share of rows that do not come")
    parser.add_argument("--devices", type=int, default=100)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--jobs", type=int, default=1)
    args = parser.parse_args(argv)
    with multiprocessing.Pool(args.jobs) as pool:
        args.map = lambda job, numbers: pool.map(job, numbers, chunksize=1)
        {"rate": rate, "delay": delay, "speed": speed}[args.what](args)


if __name__ == "__main__":
    main()
