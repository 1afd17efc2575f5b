"""A worker of `python benches/peers`: rsicalib, or SciPy, on standard input and output.

The protocol is that of `problem.h`: poses, start and counts; then, for every line with a number of
seconds, the shortest time of a fit, its number of linearisations and its x.
"""

from __future__ import annotations

import sys
import time
from collections.abc import Callable

import numpy as np

TOLERANCE = 1e-8
"""Relative length of the last step: the default of TinySolver and Ceres, and here for all."""

Fit = Callable[[], tuple[np.ndarray, int]]


def rsicalib(counts: np.ndarray, start: np.ndarray) -> Fit:
    """The paper's problem as `rsicalib` has it, from arrays to arrays."""
    from rsicalib import _core

    mechanism, offsets, gains = _core.Mechanism.rsi(), start[:9].copy(), start[9:].copy()

    def fit() -> tuple[np.ndarray, int]:
        found = _core.minimize(mechanism, counts, offsets, gains, xtol=TOLERANCE)
        return np.concatenate([found[0], found[1]]), found[3]

    return fit


def scipy(counts: np.ndarray, start: np.ndarray) -> Fit:
    """MINPACK's lmder by SciPy, Jacobian and residual vectorised over poses and arms."""
    from scipy.optimize import least_squares

    from benches.speed import Rival

    def fit() -> tuple[np.ndarray, int]:
        made = Rival(counts)
        found = least_squares(
            made.fun,
            start,
            made.jac,
            method="lm",
            x_scale="jac",
            xtol=TOLERANCE,
            ftol=1e-15,
            gtol=1e-15,
        )
        return found.x, found.njev or 0

    return fit


def main() -> None:
    """Serve one rival until the input ends."""
    words = iter(sys.stdin.readline, "")
    poses, *numbers = next(words).split()
    values = np.array(numbers, dtype=float)
    counts = values[18:].reshape(int(poses), 9)
    fit = {"rsicalib": rsicalib, "scipy": scipy}[sys.argv[1]](counts, values[:18].copy())
    for line in words:
        end, best = time.perf_counter() + float(line), np.inf
        while True:
            before = time.perf_counter()
            x, linearizations = fit()
            after = time.perf_counter()
            best = min(best, after - before)
            if after > end:
                break
        print(f"{best:.9e} {linearizations}", *map(repr, map(float, x)), flush=True)


if __name__ == "__main__":
    main()
