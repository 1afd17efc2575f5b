"""Where a mechanism is under a calibration, and how well that is known.

A mechanism with a platform gives its pose; one without gives the points that its chains carry.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from rsicalib import _core
from rsicalib._core import Mechanism
from rsicalib.arrays import FloatArray
from rsicalib.io.readings import Readings
from rsicalib.results import Result
from rsicalib.work.applying import as_applied, as_table
from rsicalib.work.arguments import Bare, ReadingsArg, load

__all__ = ["POSE", "Places", "places", "readings_for"]

POSE = ("x", "y", "z", "rx", "ry", "rz")

STEP = 1e-2
"""Step of the differences, in standard deviations: small for linearity, large against rounding."""


@dataclass(frozen=True, eq=False)
class Places:
    """Poses of a platform, or points that chains carry: `n` samples, `k` columns.

    Attributes
    ----------
    names : tuple of str
        `x y z rx ry rz` [length unit, rad]; or `ball.x ball.y ball.z` for a point `ball`.
    values : ndarray, shape (n, k)
        Values, one row for each sample.
    sd : ndarray, shape (n, k), or None
        What the uncertainty of the calibration leaves open, noise of the reading not counted;
        None where nothing is known of it.
    """

    names: tuple[str, ...]
    values: FloatArray
    sd: FloatArray | None


def readings_for(readings: ReadingsArg, mechanism: Mechanism, skip_bad_rows: bool) -> Readings:
    """Load readings to be applied: points need no columns beside the channels."""
    bare = mechanism if mechanism.to_dict().get("platform") else Bare(mechanism)
    return load(readings, bare, skip_bad_rows)


def places(
    readings: Readings, mechanism: Mechanism, result: Result | None, *, sd: bool = True
) -> Places:
    """Find where the mechanism is, and how well that is known.

    Parameters
    ----------
    readings : Readings
        `n` samples.
    mechanism : Mechanism
        Mechanism that the readings are from.
    result : Result or None
        A calibration; without it the mechanism as it is declared.
    sd : bool
        Whether the standard deviations are computed as well.

    Returns
    -------
    Places
        Places of all samples.
    """
    posed = bool(mechanism.to_dict().get("platform"))
    if posed:
        table = as_table([readings], mechanism)
        names: tuple[str, ...] = POSE
    else:
        table = as_table([readings], mechanism, bare=True)
        carried = [p["name"] for p in mechanism.to_dict()["point"] if p.get("chain") is not None]
        names = tuple(f"{name}.{axis}" for name in carried for axis in "xyz")
    applied = as_applied(result, mechanism)

    def at(parameters: list[tuple[str, str, float]]) -> FloatArray:
        changed = {**applied, "parameters": parameters}
        if posed:
            found: FloatArray = _core.forward(mechanism, changed, table)
            return found
        points = np.array(_core.points(mechanism, changed, table))
        return np.ascontiguousarray(points.transpose(1, 0, 2).reshape(len(readings), -1))

    values = at(applied["parameters"])
    known = None if result is None or not sd else _sd(result, applied["parameters"], at)
    return Places(names, values, known)


def _sd(result: Result, parameters: list[tuple[str, str, float]], at: Any) -> FloatArray | None:
    """Standard deviations by differences along the principal axes of the covariance."""
    index = {(p.spec, p.name): i for i, p in enumerate(result.parameters)}
    rows = [index[spec, name] for spec, name, _ in parameters]
    covariance = result.covariance
    if not rows or covariance.shape != (len(result.parameters),) * 2:
        return None
    part = covariance[np.ix_(rows, rows)]
    if not np.isfinite(part).all():
        return None
    # Unit variances first: parameters differ by many orders of magnitude.
    scale = np.sqrt(np.maximum(np.diag(part), 0.0))
    by = np.divide(1.0, scale, out=np.zeros_like(scale), where=scale > 0.0)
    variances, axes = np.linalg.eigh(part * by[:, None] * by)
    total: Any = 0.0
    for variance, axis in zip(variances, axes.T, strict=True):
        if variance <= 1e-14 * variances[-1]:
            continue
        step = STEP * np.sqrt(variance) * axis * scale
        ahead, behind = (
            [(*p[:2], p[2] + d) for p, d in zip(parameters, sign * step, strict=True)]
            for sign in (1.0, -1.0)
        )
        change = at(ahead) - at(behind)
        total = total + (change / (2.0 * STEP)) ** 2
    out: FloatArray = np.sqrt(total)
    return out
