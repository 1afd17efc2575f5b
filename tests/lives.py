"""Lives of devices by the hundred: what is named, and how often intervals hold the truth.

`python -m tests.lives` draws results of a parameter over three years, with a standard deviation of
one in each: jumps, drifts, both and none, with scatter between sessions beside it and without. A
line says how many lives were called what they are, and the coverage of rate and level (95 % asked).
"""

from __future__ import annotations

import argparse
from collections import Counter
from collections.abc import Sequence

import numpy as np

from rsicalib import _core

RESULTS = 24
SIZE = 12.0
"""Jumps, and drifts over the whole life, in standard deviations of a result with its scatter."""

RSI = _core.Mechanism.rsi()
OFFSET = (("offset", "a11", None), "offset")
"""The parameter, and the mechanism that has it: any would do."""

KINDS = {"still": (0, 0), "drift": (1, 0), "jump": (0, 1), "drift and jump": (1, 1)}


def life(
    rng: np.random.Generator, kind: str, scatter: float
) -> tuple[list[tuple[float, float, float]], float, float]:
    """Results of a life; the true rate and the level at the last date."""
    drifts, jumps = KINDS[kind]
    days = np.sort(rng.uniform(0.0, 1095.0, RESULTS))
    total = np.hypot(1.0, scatter)
    rate = drifts * rng.choice((-1.0, 1.0)) * SIZE * total / 1095.0
    level = rate * days
    if jumps:
        at = rng.integers(5, RESULTS - 4)
        level = level + rng.choice((-1.0, 1.0)) * SIZE * total * (np.arange(RESULTS) >= at)
    sd = rng.uniform(0.7, 1.3, RESULTS)
    values = level + np.hypot(sd, scatter) * rng.standard_normal(RESULTS)
    return list(zip(days, values, sd, strict=True)), float(rate), float(level[-1])


def trial(lives: int, seed: int, kind: str, scatter: float) -> tuple[Counter[str], int, int]:
    """What lives are called; how often the intervals of rate and level hold the truth."""
    rng = np.random.default_rng(seed)
    called: Counter[str] = Counter()
    rates = levels = 0
    for _ in range(lives):
        past, rate, level = life(rng, kind, scatter)
        dated = [(day, [(*OFFSET, value, sd)], None, []) for day, value, sd in past]
        found = _core.history(RSI, dated)[0][0]["course"]
        called[found["kind"]] += 1
        rates += abs(found["rate"] - rate) < found["wide"] * found["rate_sd"]
        levels += abs(found["level"][0] - level) < found["wide"] * found["level"][1]
    return called, rates, levels


def main(arguments: Sequence[str] | None = None) -> None:
    """Print a line for each kind of life."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--lives", type=int, default=400)
    parser.add_argument("--seed", type=int, default=1)
    options = parser.parse_args(arguments)
    for scatter in (0.0, 3.0):
        for kind in KINDS:
            called, rates, levels = trial(options.lives, options.seed, kind, scatter)
            right, rate, level = (100.0 * n / options.lives for n in (called[kind], rates, levels))
            print(
                f"{kind}, scatter {scatter:g}: named right {right:.1f} %, coverage of the rate "
                f"{rate:.1f} %, of the level {level:.1f} %; {dict(called)}",
                flush=True,
            )


if __name__ == "__main__":
    main()
