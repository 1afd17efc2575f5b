"""Whether the loops close under a result, in readings that it is applied to.

A result of another device gives poses like any other. But the loops of the readings do not close
under it as they did in its own session, which is told. `edited` has what a result alone tells.
"""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from rsicalib import _core
from rsicalib._core import Mechanism
from rsicalib.arrays import FloatArray
from rsicalib.errors import tell
from rsicalib.io.readings import Readings
from rsicalib.results.result import Result
from rsicalib.work.applying import as_applied, covariance_of
from rsicalib.work.edited import TIMES, own_misclosure

__all__ = ["first_rows", "open_loops", "warn_of_open_loops"]

LEVEL = 1e-6
"""Probability that the loops of a sound device are called open: of a million uses one."""

MOST_POSES = 200
"""Poses that are compared at the most: enough to tell, and soon done."""


def open_loops(readings: Readings, mechanism: Mechanism, result: Result) -> str | None:
    """Say that the loops do not close as in the result's own session.

    Parameters
    ----------
    readings : Readings
        What the result is applied to.
    mechanism : Mechanism
        What the readings are of.
    result : Result
        A calibration of it.

    Returns
    -------
    str or None
        None where they do, or where that cannot be told from readings alone: of chains whose
        points are free or touch unknown places, or of terms that need more than one row.
    """
    noise, covariance = result.noise, covariance_of(result)
    if noise is None or (covariance is not None and not covariance.any()):
        return None  # no parameter was determined: there is nothing that could have changed
    poses = _of_poses(readings)
    applied = as_applied(result, mechanism)
    # In the mean of `n` samples the part of the noise that all share stays whole, and an `n`-th of
    # the rest. How much is shared is not known here: the variance is taken to fall by √n.
    less = (len(poses) / len(readings)) ** 0.25
    applied["sigma"] = [less * sigma for sigma in applied["sigma"]]
    fit = result.quality
    judged = fit.chi2 is not None and fit.dof
    scale = fit.chi2 / fit.dof if judged and fit.chi2 and fit.dof else 1.0
    found = _core.closing(
        mechanism,
        applied,
        thinned(poses),
        covariance,
        scale=max(1.0, scale),
        dof=noise.dof,
    )
    if found is None:
        return None
    rms, _, p_value = found
    unit, own = mechanism.length_unit, own_misclosure(result)
    # What is not finite is not below anything.
    if p_value >= LEVEL and (own is None or rms < TIMES * own):
        return None
    as_own = "" if own is None else f", in the session of the result it was {own:.2g} {unit}"
    causes = ["Something has changed since", "the result is of another device"]
    causes += [] if result.edited is False else ["its numbers were edited"]
    return (
        f"the loops of {readings.source} do not close under this result: misclosure {rms:.2g} "
        f"{unit}{as_own}. {', '.join(causes[:-1])}, or {causes[-1]}: identify again with "
        "--calibration, which says what has changed"
    )


def warn_of_open_loops(readings: Readings, mechanism: Mechanism, result: Result) -> None:
    """Warn where they do not, before a result is applied to readings that may not be its own."""
    said = open_loops(readings, mechanism, result)
    if said is not None:
        tell(said)


def _of_poses(readings: Readings) -> FloatArray:
    """Mean reading of each pose: shape (n, C)."""
    values = readings.values
    if readings.labels is not None:
        starts = first_rows(readings.labels, len(readings))
        sizes = np.diff(np.append(starts, len(values)))
        values = np.add.reduceat(values, starts, axis=0) / sizes[:, None]
    return values


def thinned(values: FloatArray) -> FloatArray:
    """Not more rows than are compared."""
    if len(values) > MOST_POSES:
        values = values[np.linspace(0, len(values) - 1, MOST_POSES).astype(np.intp)]
    return np.ascontiguousarray(values)


def first_rows(pose: npt.NDArray[np.integer] | None, n: int) -> npt.NDArray[np.intp]:
    """First row of each pose; every row where there are none."""
    if pose is None:
        return np.arange(n)
    return np.flatnonzero(np.r_[True, pose[1:] != pose[:-1]])
