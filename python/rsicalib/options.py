"""Options of the verbs, checked once: a name, what was found, what was expected.

A value of the wrong type raises `InputTypeError`, which is a `TypeError` as well; other values that
cannot be used raise `InputError`, a `ValueError`.
"""

from __future__ import annotations

import math
import numbers
from collections.abc import Sequence
from typing import Any

import numpy as np

from rsicalib.errors import InputError, InputTypeError

__all__ = ["LARGEST_SEED", "MOST_ROWS", "names", "number", "rows", "seed", "solver", "whole"]

LARGEST_SEED = 2**63 - 1

MOST_ROWS = 10_000_000
"""A simulated session has at most so many samples: a GB of readings."""


def whole(name: str, value: Any, least: int, most: int) -> int:
    """An integer from `least` to `most`."""
    if isinstance(value, bool | np.bool_) or not isinstance(value, numbers.Integral):
        raise InputTypeError(f"{name}: found {value!r}, expected an integer")
    found = int(value)
    if not least <= found <= most:
        raise InputError(f"{name}: found {found}, expected {least} to {most}")
    return found


def number(name: str, value: Any, expected: str, *, least: float, open_end: bool = True) -> float:
    """A finite number above `least`, or from `least` on."""
    if isinstance(value, bool | np.bool_) or not isinstance(value, numbers.Real):
        raise InputTypeError(f"{name}: found {value!r}, expected {expected}")
    found = float(value)
    if not (math.isfinite(found) and (found > least if open_end else found >= least)):
        raise InputError(f"{name}: found {found:g}, expected {expected}")
    return found


def seed(value: Any) -> int:
    """A seed of random draws."""
    return whole("seed", value, 0, LARGEST_SEED)


def solver(starts: Any, max_iterations: Any, xtol: Any) -> dict[str, Any]:
    """Options of the solver; None where nothing was asked for."""
    if starts is not None:
        starts = whole("starts", starts, 1, 100_000)
    if max_iterations is not None:
        max_iterations = whole("max_iterations", max_iterations, 1, 1_000_000)
    if xtol is not None:
        xtol = number("xtol", xtol, "a number above 0 and below 1", least=0.0)
    return {"starts": starts, "max_iterations": max_iterations, "xtol": xtol}


def rows(poses: int, samples: int) -> None:
    """Refuse more samples than fit into memory."""
    if poses * samples > MOST_ROWS:
        found = f"{poses} poses of {samples} samples"
        raise InputError(f"found {found}, expected at most {MOST_ROWS:,} samples")


def names(name: str, given: Sequence[str] | None) -> list[str] | None:
    """Names as a list, None where none were asked for.

    A single text is refused, as its letters would pass for names; so is an empty list, which
    would ask for nothing.
    """
    if given is None:
        return None
    if isinstance(given, str):
        raise InputTypeError(f"{name}: found {given!r}, expected names such as [{given!r}]")
    try:
        found = list(given)
    except TypeError:
        raise InputTypeError(f"{name}: found {given!r}, expected a list of names") from None
    for one in found:
        if not isinstance(one, str):
            raise InputTypeError(f"{name}: found {one!r}, expected a name")
    if not found:
        raise InputError(f"{name}: found none, expected at least one name, or no such option")
    return found
