"""Where the handle is and where it should be, and how a hand gets it there in six plain moves."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any

import numpy as np

from rsicalib import _core
from rsicalib._core import Mechanism
from rsicalib.arrays import FloatArray
from rsicalib.errors import RsicalibError
from rsicalib.io.rigid import rigid
from rsicalib.poses.devices import workspace
from rsicalib.results.result import Trace
from rsicalib.work.applying import as_applied

SIDES = (("right", "left"), ("away from you", "to you"), ("up", "down"))
"""Words for a shift along x, y, z: x is to the right, y away, z up."""

TURNS = (
    ("far side up", "far side down"),
    ("right side down", "right side up"),
    ("turn left", "turn right"),
)
"""Words for a turn about x, y, z by the right hand."""


AXES = (
    "left or right",
    "to you or away",
    "up or down",
    "tilt of the far side",
    "tilt of the right side",
    "turn",
)
"""What each of the six is about, where nothing is left to do."""


ALONE: dict[str, Any] = {
    "pose": None,
    "time": None,
    "temperature": None,
    "session": None,
    "keys": [],
    "columns": [],
    "used": None,
}
"""What a table of one reading has beside it."""


class Handle:
    """The handle by the forward kinematics of what is known of the sensors so far.

    A mechanism without a platform has no handle to be drawn.

    Parameters
    ----------
    mechanism : Mechanism
        With a platform or without.
    prior : Mechanism
        The same as it is known before anything is measured.
    """

    def __init__(self, mechanism: Mechanism, prior: Mechanism) -> None:
        self.mechanism = mechanism
        held = mechanism.to_dict().get("platform") or {}
        self.points: dict[str, list[float]] = {n: [float(v) for v in at] for n, at in held.items()}
        self.bounds: FloatArray = workspace(mechanism, None) if held else np.zeros((6, 2))
        self._prior = prior
        self._known = _applied(prior, None) if held else None

    def know(self, result: Trace | None) -> None:
        """Take what a trace found of the sensors; what is declared where it found nothing."""
        if not self.points:
            return
        known = None if result is None else _applied(self.mechanism, result)
        self._known = known or _applied(self._prior, None)

    def pose(self, readings: Sequence[float] | FloatArray | None) -> FloatArray | None:
        """Pose of the handle at a reading, `x y z rx ry rz`; None where it cannot be told."""
        if readings is None or self._known is None:
            return None
        mechanism, applied = self._known
        row = np.asarray(readings, dtype=np.float64)[None]
        try:
            _, values, _, _ = _core.places(mechanism, applied, {**ALONE, "values": row}, None)
        except RsicalibError:
            return None
        found: FloatArray = np.asarray(values)[0]
        return found if np.isfinite(found).all() else None

    def corners(self, pose: FloatArray) -> list[list[float]]:
        """Points of the platform in a pose, in base coordinates."""
        turn, at = turned(pose[3:]), pose[:3]
        return [(turn @ np.array(p) + at).round(4).tolist() for p in self.points.values()]

    def state(
        self, now: FloatArray | None, want: FloatArray | None, near: float
    ) -> dict[str, Any] | None:
        """What a page draws; None where the handle cannot be placed.

        Parameters
        ----------
        now, want : ndarray of shape (6,) or None
            Where it is, and where it should be.
        near : float
            Share of the workspace below which a move is none.
        """
        if now is None and want is None:
            return None
        return {
            "names": list(self.points),
            "now": None if now is None else self.corners(now),
            "want": None if want is None else self.corners(want),
            "bounds": self.bounds[:3].tolist(),
            "moves": None
            if now is None or want is None
            else moves(now, want, near * np.ptp(self.bounds, axis=1)),
        }


def _applied(mechanism: Mechanism, result: Trace | None) -> tuple[Mechanism, dict[str, Any]] | None:
    """A mechanism, and a result as the core applies it; None where it cannot be applied."""
    try:
        return mechanism, as_applied(result, mechanism)
    except RsicalibError:
        return None


def turned(angles: Sequence[float] | FloatArray) -> FloatArray:
    """Matrix of the turns `rx ry rz` of eq. (1): `Rz Ry Rx`."""
    return rigid((0.0, 0.0, 0.0), tuple(map(float, angles)))[:3, :3]


def moves(now: FloatArray, want: FloatArray, near: FloatArray) -> list[dict[str, Any]]:
    """Three shifts and three turns from one pose to another, in the base frame.

    Parameters
    ----------
    now, want : ndarray, shape (6,)
        `x y z` [length unit], `rx ry rz` [rad].
    near : ndarray, shape (6,)
        What is too small to be asked for.

    Returns
    -------
    list of dict
        `words`, `axis`, `amount` [length unit, degrees], `turn` and `done` of each of the six.
    """
    matrix = turned(want[3:]) @ turned(now[3:]).T
    # Rotation vector: axis by the skew part, angle by both.
    skew = 0.5 * np.array(
        [matrix[2, 1] - matrix[1, 2], matrix[0, 2] - matrix[2, 0], matrix[1, 0] - matrix[0, 1]]
    )
    sine = float(np.linalg.norm(skew))
    angle = math.atan2(sine, 0.5 * (float(np.trace(matrix)) - 1.0))
    by = [*(want[:3] - now[:3]), *(skew * (angle / sine if sine > 0.0 else 1.0))]
    return [
        {
            "words": (SIDES + TURNS)[k][0 if by[k] >= 0.0 else 1],
            "axis": AXES[k],
            "amount": abs(float(by[k])) if k < 3 else math.degrees(abs(float(by[k]))),
            "turn": k >= 3,
            "done": bool(abs(by[k]) < near[k]),
        }
        for k in range(6)
    ]
