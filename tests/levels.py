"""What levels of a fleet cost and how well they are told: `python -m tests.levels PART`.

`few` is what a few groups tell of their standard deviation; `intervals` draws fleets of groups of
units and counts the intervals that hold; `speed` is the time of many units; `crossed` that of
groups that cross.
"""

from __future__ import annotations

import argparse
import time
from collections.abc import Sequence
from typing import Any

import numpy as np

from rsicalib import _core
from tests.oracle import Array

SHAPES = ((4, 4), (6, 3))
"""Groups, and units in each."""
DEVIATIONS = ((0.0, 0.0), (0.0, 1.0), (1.0, 0.0), (1.0, 1.0), (0.3, 3.0), (3.0, 0.3))
"""Of units in a group, of groups; a unit is known to 0.5 to 1.5."""


def drawn(
    rng: np.random.Generator, levels: Sequence[Array], deviations: Sequence[float], lives: int
) -> Array:
    """Estimates and their standard deviations (lives, units, 2) about 0.7; units come first."""
    sd = rng.uniform(0.5, 1.5, (lives, len(levels[0])))
    x = 0.7 + np.hypot(sd, deviations[0]) * rng.standard_normal(sd.shape)
    for groups, deviation in zip(levels, deviations[1:], strict=True):
        x += deviation * rng.standard_normal((lives, int(groups.max()) + 1))[:, groups]
    return np.stack([x, sd], axis=-1)


def holds(
    found: Sequence[dict[str, Any] | None], deviations: Sequence[float]
) -> tuple[Array, float]:
    """Parts of the intervals of each level, and of the mean, that hold the truth."""
    inside, mean = np.zeros(len(deviations)), 0
    for one in found:
        assert one is not None
        mean += abs(one["value"] - 0.7) < one["half"]
        for k, true in enumerate(deviations):
            low, high = one["levels"][k]["interval"] or (0.0, 0.0)
            inside[k] += low <= true <= (np.inf if high is None else high)
    return inside / len(found), mean / len(found)


def few() -> None:
    """What a few groups tell whose means, known to a millionth, have a standard deviation of 1."""
    for groups in (2, 3, 4, 6, 10):
        means = np.arange(groups) - (groups - 1) / 2
        means /= means.std(ddof=1)
        units = np.repeat(np.arange(groups), 2)
        x = np.stack([means[units], np.full(2 * groups, 1e-6)], axis=-1)
        (one,) = _core.common_shifts(x[None], [units.tolist()])
        assert one is not None
        low, high = one["levels"][1]["interval"]
        print(f"{groups} groups: {low:.2f} to {high:.1f}", end="")
        print(f" ({high / np.ptp(means):.1f} times their difference)" if groups == 2 else "")


def intervals(lives: int, seed: int) -> None:
    """How many intervals hold."""
    rng = np.random.default_rng(seed)
    print(f"{lives} draws, standard error of 95 %: {100 * np.sqrt(0.95 * 0.05 / lives):.1f} %")
    print("groups  units  deviations  units hold  groups hold  mean holds")
    for groups, units in SHAPES:
        of = np.repeat(np.arange(groups), units)
        for deviations in DEVIATIONS:
            found = _core.common_shifts(drawn(rng, [of], deviations, lives), [of.tolist()])
            inside, mean = holds(found, deviations)
            words = f"{deviations[0]:g}, {deviations[1]:g}"
            parts = (100 * part for part in (*inside, mean))
            print(f"{groups:6} {units:6}  {words:>10}", *(f"{p:11.1f}" for p in parts), flush=True)


def speed(seed: int) -> None:
    """Processor time of a parameter, and of eighteen."""
    rng = np.random.default_rng(seed)
    for units in (400, 4000, 40_000):
        each = np.arange(units)
        levels = [each // 4, each // 40]
        for words, deviations in (
            ("all levels", (1.0, 1.0, 1.0)),
            ("units alone", (1.0, 0.0, 0.0)),
        ):
            x = drawn(rng, levels, deviations, 18)
            for count in (1, 18):
                begun = time.process_time()
                _core.common_shifts(x[:count], [groups.tolist() for groups in levels])
                spent = time.process_time() - begun
                print(
                    f"{units} units, {words} differ, {count} parameters: {spent:.2f} s", flush=True
                )


def crossed(seed: int) -> None:
    """Time of two levels that cross, a parameter."""
    rng = np.random.default_rng(seed)
    for groups in (250, 500, 1000, 2000):
        units = 2 * groups
        levels = [np.arange(units) % (groups // 2), rng.permutation(units) % (groups // 2)]
        x = drawn(rng, levels, (1.0, 1.0, 1.0), 1)
        begun = time.perf_counter()
        _core.common_shifts(x, [own.tolist() for own in levels])
        print(f"{groups} groups: {time.perf_counter() - begun:.1f} s", flush=True)


def main(arguments: Sequence[str] | None = None) -> None:
    """Print what is asked for."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("part", choices=("few", "intervals", "speed", "crossed"))
    parser.add_argument("--lives", type=int, default=2000)
    parser.add_argument("--seed", type=int, default=1)
    options = parser.parse_args(arguments)
    if options.part == "few":
        few()
    elif options.part == "intervals":
        intervals(options.lives, options.seed)
    elif options.part == "speed":
        speed(options.seed)
    else:
        crossed(options.seed)


if __name__ == "__main__":
    main()
