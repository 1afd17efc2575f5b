"""Poses from readings, and joint coordinates from poses: the verbs `forward` and `inverse`."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from rsicalib import _core
from rsicalib.arrays import FloatArray
from rsicalib.errors import InputError, InputTypeError
from rsicalib.poses.places import Places, places, readings_for
from rsicalib.work.arguments import (
    CalibrationArg,
    MechanismArg,
    ReadingsArg,
    earlier_result,
    open_mechanism,
)
from rsicalib.work.closing import warn_of_open_loops

__all__ = ["forward", "forward_sd", "inverse"]


def forward(
    readings: ReadingsArg,
    mechanism: MechanismArg = "rsi",
    calibration: CalibrationArg | None = None,
    *,
    skip_bad_rows: bool = False,
) -> FloatArray:
    """Find the platform's pose for every reading, or the points that chains carry, or that move.

    Parameters
    ----------
    readings : path or Readings
        `n` samples.
    mechanism : str, path or Mechanism
        With a platform, or with points on its chains.
    calibration : path, Calibration or Trace, optional
        An earlier result; without it the mechanism as it is declared. Terms that
        are bound to the time of their own session are left out.
    skip_bad_rows : bool, optional
        As in `calibrate`.

    Returns
    -------
    ndarray, shape (n, 6)
        `x y z` [length unit] and `rx ry rz` [rad], eq. (1). Of a mechanism without
        a platform, `x y z` of each point that a chain carries, shape (n, 3 points); where
        no chain carries one, of each that is somewhere else in each pose (a sled on belts).

    Raises
    ------
    InputError
        The mechanism has neither, or the result is not of this mechanism.

    Warns
    -----
    OpenLoopsWarning
        The loops of the readings do not close under the result: the poses are wrong.

    See Also
    --------
    forward_sd : how well they are known.

    Examples
    --------
    >>> from rsicalib import DEMO
    >>> forward(DEMO / "rest.csv").shape[1]
    6
    """
    return _placed(readings, mechanism, calibration, skip_bad_rows, sd=False).values


def forward_sd(
    readings: ReadingsArg,
    mechanism: MechanismArg,
    calibration: CalibrationArg,
    *,
    skip_bad_rows: bool = False,
) -> FloatArray:
    """Find how well a calibration knows what `forward` gives.

    Parameters
    ----------
    readings, mechanism, calibration, skip_bad_rows
        As for `forward`.

    Returns
    -------
    ndarray
        Standard deviations, in the shape of `forward`: of the calibration alone, the
        noise of the reading not counted. NaN where nothing is known of them.
    """
    found = _placed(readings, mechanism, calibration, skip_bad_rows, sd=True)
    return np.full_like(found.values, np.nan) if found.sd is None else found.sd


def _placed(
    readings: ReadingsArg,
    mechanism: MechanismArg,
    calibration: CalibrationArg | None,
    skip_bad_rows: bool,
    *,
    sd: bool,
) -> Places:
    loaded = open_mechanism(mechanism)
    one = readings_for(readings, loaded, skip_bad_rows)
    result = None
    if calibration is not None:
        result, loaded = earlier_result(calibration, loaded)
    if result is not None and not sd:
        warn_of_open_loops(one, loaded, result)
    return places(one, loaded, result, sd=sd)


def inverse(poses: npt.ArrayLike, mechanism: MechanismArg = "rsi") -> FloatArray:
    """Find the joint coordinates that hold the platform in given poses.

    Parameters
    ----------
    poses : array_like, shape (n, 6) or (6,)
        `x y z` [length unit] and `rx ry rz` [rad].
    mechanism : str, path or Mechanism
        With a platform; of the geometry of `"rsi"` by (6)-(8), within the joint limits.

    Returns
    -------
    ndarray, shape (n, C) or (C,)
        One joint coordinate per channel [rad].

    Raises
    ------
    InputError
        A pose is out of reach; the message says which arm and by how much.

    Examples
    --------
    >>> inverse([0, 0, -2.666, 0, 0, 0]).round(2)
    array([ 0.42, -1.97,  0.  ,  0.42, -1.97,  0.  ,  0.42, -1.97,  0.  ])
    """
    try:
        array = np.asarray(poses, dtype=np.float64)
    except (TypeError, ValueError):
        raise InputTypeError(f"poses: found {poses!r}, expected numbers") from None
    if not np.isfinite(array).all():
        raise InputError("poses: found NaN or infinity, expected finite numbers")
    if array.shape[-1:] != (6,) or array.ndim > 2:
        raise InputError(f"found poses of shape {array.shape}, expected (n, 6) or (6,)")
    found = _core.angles_at(open_mechanism(mechanism), np.ascontiguousarray(np.atleast_2d(array)))
    return np.asarray(found).reshape(*array.shape[:-1], -1)
