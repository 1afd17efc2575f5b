"""Paths whose rows are no repeats, and how often they are taken for some: `python -m tests.paths`.

Readings of nine joints in counts, with noise of one count and rounded. On lines the step from row
to row is as many counts as the table says: from far below the noise to far above it.
"""

from __future__ import annotations

import argparse

import numpy as np

import rsicalib
from tests.oracle import Array

CHANNELS = [f"a{arm}{joint}" for arm in (1, 2, 3) for joint in (1, 2, 3)]
KINDS = ("waves", "walk", "lines", "stops")
STEPS = (0.1, 0.2, 0.5, 1.0, 2.0, 5.0, 20.0)
ROWS = (40, 120, 200, 400)


def groups(values: Array) -> int:
    """Held poses that are found in rows without a number; 0 where each row is a pose."""
    loaded = rsicalib.load_readings(dict(zip(CHANNELS, values.T, strict=True)), "rsi")
    return 0 if loaded.repeats is None else len(set(loaded.repeats))


def read(path: Array, rng: np.random.Generator) -> Array:
    """Whole counts of a path in counts, with noise of one count."""
    return np.clip(np.rint(path + rng.standard_normal(path.shape)), 0, 4095)


def drawn(rng: np.random.Generator, kind: str, rows: int, step: float = 20.0) -> Array:
    """Counts row by row, of which no two neighbours are one pose; `step` is that along lines."""
    if kind == "waves":
        t = np.linspace(0.0, 2 * np.pi, rows)[:, None]
        return np.asarray(2048 + 900 * np.sin(t * rng.integers(1, 5, 9) + rng.uniform(0.0, 6.0, 9)))
    if kind == "walk":
        return 2048 + 900 * np.cumsum(rng.standard_normal((rows, 9)), axis=0) / np.sqrt(rows)
    if kind == "lines":  # steps along a line, then a jump to the next
        length = int(rng.integers(3, 12))
        count = rows // length + 1
        along = rng.choice([-1.0, 1.0], (count, 1, 9)) * step
        starts = rng.uniform(1148, 2948, (count, 1, 9))
        return (starts + along * np.arange(length)[:, None]).reshape(-1, 9)[:rows]
    at = rng.uniform(1148, 2948, (rows // 12 + 1, 9))  # from stop to stop, read on the way as well
    s = np.clip(np.linspace(0.0, 1.5, 12), 0.0, 1.0)[:, None]
    way = at[:-1, None] + (at[1:] - at[:-1])[:, None] * (10 * s**3 - 15 * s**4 + 6 * s**5)
    return np.asarray(way.reshape(-1, 9)[:rows])


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--each", type=int, default=25)
    parser.add_argument("--seed", type=int, default=2026)
    args = parser.parse_args()
    rng = np.random.default_rng(args.seed)
    cases = [(kind, 20.0) for kind in KINDS if kind != "lines"]
    for kind, step in [*cases, *(("lines", step) for step in STEPS)]:
        taken = [
            groups(read(drawn(rng, kind, rows, step), rng)) > 0
            for rows in ROWS
            for _ in range(args.each)
        ]
        of = f" in steps of {step:g}" if kind == "lines" else ""
        print(f"{kind}{of}: {sum(taken)} of {len(taken)} taken for held poses")


if __name__ == "__main__":
    main()
