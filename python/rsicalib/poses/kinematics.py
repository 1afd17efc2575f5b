"""Poses from readings, and joint coordinates from poses: the verbs `forward` and `inverse`."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, TypeVar, overload

import numpy as np
import numpy.typing as npt

from rsicalib import _core
from rsicalib.arrays import FloatArray
from rsicalib.errors import InputError, InputTypeError
from rsicalib.io.cells import POSE
from rsicalib.io.frames import SOURCE, FrameArg, columns_of, frame_of, is_frame
from rsicalib.plain_text import counted, quoted
from rsicalib.poses.places import Places, places, readings_for
from rsicalib.work.arguments import (
    CalibrationArg,
    FramelessArg,
    MechanismArg,
    ReadingsArg,
    earlier_result,
    open_mechanism,
)
from rsicalib.work.closing import warn_of_open_loops
from rsicalib.work.reach import reach_told

PlacesT = TypeVar("PlacesT", bound=FrameArg)
"""A data frame goes in and comes out."""


@overload
def forward(
    readings: PlacesT,
    mechanism: MechanismArg = "rsi",
    calibration: CalibrationArg | None = None,
    *,
    skip_bad_rows: bool = False,
) -> PlacesT: ...


@overload
def forward(
    readings: FramelessArg,
    mechanism: MechanismArg = "rsi",
    calibration: CalibrationArg | None = None,
    *,
    skip_bad_rows: bool = False,
) -> FloatArray: ...


def forward(
    readings: ReadingsArg,
    mechanism: MechanismArg = "rsi",
    calibration: CalibrationArg | None = None,
    *,
    skip_bad_rows: bool = False,
) -> Any:
    """Find the platform's pose for every reading, or the points that chains carry, or that move.

    Parameters
    ----------
    readings : path, Readings, data frame, array or mapping
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
        For a data frame of pandas, Polars or pyarrow, one of the same library with these
        columns, and with the index of a frame of pandas.

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
    found = _placed(readings, mechanism, calibration, skip_bad_rows, sd=False)
    return _as_given(readings, found.names, found.values)


@overload
def forward_sd(
    readings: PlacesT,
    mechanism: MechanismArg,
    calibration: CalibrationArg,
    *,
    skip_bad_rows: bool = False,
) -> PlacesT: ...


@overload
def forward_sd(
    readings: FramelessArg,
    mechanism: MechanismArg,
    calibration: CalibrationArg,
    *,
    skip_bad_rows: bool = False,
) -> FloatArray: ...


def forward_sd(
    readings: ReadingsArg,
    mechanism: MechanismArg,
    calibration: CalibrationArg,
    *,
    skip_bad_rows: bool = False,
) -> Any:
    """Find how well a calibration knows what `forward` gives.

    Parameters
    ----------
    readings, mechanism, calibration, skip_bad_rows
        As for `forward`.

    Returns
    -------
    ndarray, or data frame
        Standard deviations, in the shape and columns of `forward`: of the calibration alone, the
        noise of the reading not counted. NaN where nothing is known of them.
    """
    found = _placed(readings, mechanism, calibration, skip_bad_rows, sd=True)
    sd = np.full_like(found.values, np.nan) if found.sd is None else found.sd
    return _as_given(readings, found.names, sd)


def _as_given(given: object, names: Sequence[str], values: FloatArray) -> Any:
    """Values as an array; of a data frame as one of the same library, row by row."""
    if not is_frame(given):
        return values
    frame: Any = frame_of(given, {name: values[:, k] for k, name in enumerate(names)})
    if isinstance(frame, dict):  # of a library that makes no frames of columns
        return values
    index: Any = getattr(given, "index", None)  # of pandas
    if index is not None:
        if len(index) != len(values):
            bad = counted(len(index) - len(values), "bad row")
            raise InputError(
                f"skip_bad_rows: found a data frame with {bad}, expected none, "
                "since poses keep its index: drop them before, as by dropna()"
            )
        frame.index = index
    return frame


def _placed(
    readings: ReadingsArg,
    mechanism: MechanismArg,
    calibration: CalibrationArg | None,
    skip_bad_rows: bool,
    *,
    sd: bool,
) -> Places:
    loaded = open_mechanism(mechanism, calibration)
    drawn, result = loaded, None
    if calibration is not None:  # first: of another mechanism the readings are, too
        result, loaded = earlier_result(calibration, drawn)
    one = readings_for(readings, drawn, skip_bad_rows)
    if result is not None and not sd:
        warn_of_open_loops(one, loaded, result)
    return places(one, loaded, result, sd=sd)


@overload
def inverse(poses: PlacesT, mechanism: MechanismArg = "rsi") -> PlacesT: ...


@overload
def inverse(poses: npt.ArrayLike, mechanism: MechanismArg = "rsi") -> FloatArray: ...


def inverse(poses: Any, mechanism: MechanismArg = "rsi") -> Any:
    """Find the joint coordinates that hold the platform in given poses.

    Parameters
    ----------
    poses : array_like, shape (n, 6) or (6,), or data frame
        `x y z` [length unit] and `rx ry rz` [rad]; of a data frame the columns of these names.
    mechanism : str, path or Mechanism
        With a platform; of the geometry of `"rsi"` by (6)-(8), within the joint limits.

    Returns
    -------
    ndarray, shape (n, C) or (C,)
        One joint coordinate per channel [rad]; for a data frame one of the same library, with
        a column per channel.

    Raises
    ------
    InputError
        A pose is out of reach; the message says in which row, from 1, which arm and by how much.

    Examples
    --------
    >>> inverse([0, 0, -2.666, 0, 0, 0]).round(2)
    array([ 0.42, -1.97,  0.  ,  0.42, -1.97,  0.  ,  0.42, -1.97,  0.  ])
    """
    given = _pose_columns(poses) if is_frame(poses) else poses
    try:
        array = np.asarray(given, dtype=np.float64)
    except (TypeError, ValueError):
        raise InputTypeError(f"poses: found {quoted(given)}, expected numbers") from None
    if not np.isfinite(array).all():
        raise InputError("poses: found NaN or infinity, expected finite numbers")
    if array.shape[-1:] != (6,) or array.ndim > 2:
        raise InputError(f"found poses of shape {array.shape}, expected (n, 6) or (6,)")
    opened = open_mechanism(mechanism)
    rows = np.ascontiguousarray(np.atleast_2d(array))
    with reach_told(opened, rows, "poses", np.arange(1, len(rows) + 1)):
        found = np.asarray(_core.angles_at(opened, rows))
    if is_frame(poses):
        return _as_given(poses, [channel.name for channel in opened.channels], found)
    return found.reshape(*array.shape[:-1], -1)


def _pose_columns(frame: FrameArg) -> npt.NDArray[Any]:
    """The columns of a data frame that are poses, side by side."""
    columns = columns_of(frame)
    missing = [name for name in POSE if name not in columns]
    if missing:
        raise InputError.at(SOURCE, f"no column {' '.join(missing)}", " ".join(POSE))
    return np.stack([np.asarray(columns[name]) for name in POSE], axis=-1)
