"""The hand controller as it was really built: any dimension, any axis, any sag.

Arms are plain products of 4x4 matrices, rows as in the mechanism: 0 the fixed base row, 1 to 3 the
joints. Joint angles for a handle pose come from Newton's method on each arm, from the nominal
solution. Lengths in inches, angles in radians.
"""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np

from tests import oracle
from tests.oracle import Array

THETA, D, A, ALPHA = range(4)


def nominal_rows() -> Array:
    """Denavit-Hartenberg rows `(theta, d, a, alpha)` of the drawing: shape (3 arms, 4 rows, 4)."""
    half = np.pi / 2
    return np.array(
        [
            [[base, 0, oracle.L1, half], [0, 0, oracle.L2, 0], [0, 0, 0, half], [0, 0, 0, 0]]
            for base in oracle.BASE_ANGLES
        ]
    )


def nominal_wrists() -> Array:
    """Where the wrist sits in the last frame of each arm: shape (3, 3)."""
    return np.tile([oracle.L3, 0.0, 0.0], (3, 1))


@dataclass(frozen=True)
class Geometry:
    """What was built.

    `before[i, r]` is an extra rigid motion ahead of row `r` of arm `i`; `compliance[i]` bends every
    joint of arm `i` by so many radians per unit of gravity torque, an arm carrying a handle weight
    of one at its wrist (torque in inches).
    """

    rows: Array = field(default_factory=nominal_rows)
    before: Array = field(default_factory=lambda: np.tile(np.eye(4), (3, 4, 1, 1)))
    tips: Array = field(default_factory=nominal_wrists)
    platform: Array = field(default_factory=oracle.platform)
    compliance: Array = field(default_factory=lambda: np.zeros(3))

    def is_nominal(self) -> bool:
        """Whether nothing differs from the drawing."""
        drawn = Geometry()
        return all(
            np.array_equal(getattr(self, name), getattr(drawn, name))
            for name in self.__dataclass_fields__
        )

    def with_row(self, arm: int, row: int, column: int, change: float) -> Geometry:
        """One Denavit-Hartenberg number changed by `change`; arm and row count from 0."""
        rows = self.rows.copy()
        rows[arm, row, column] += change
        return replace(self, rows=rows)

    def with_motion(self, arm: int, row: int, motion: Array) -> Geometry:
        """An extra rigid motion, (4, 4), ahead of a row of an arm."""
        before = self.before.copy()
        before[arm, row] = motion @ before[arm, row]
        return replace(self, before=before)

    def with_values(self, **values: Any) -> Geometry:
        """A copy with other fields."""
        return replace(self, **values)


def forward_arm(geometry: Geometry, arm: int, angles: Array) -> tuple[Array, Array]:
    """Wrist of one rigid arm, (n, 3), and its derivative by the three angles, (n, 3, 3)."""
    frame: Array = np.eye(4)
    axes, origins = [], []
    for row, (theta, d, a, alpha) in enumerate(geometry.rows[arm]):
        frame = frame @ geometry.before[arm, row]
        if row > 0:
            axes.append(np.broadcast_to(frame[..., :3, 2], (len(angles), 3)))
            origins.append(np.broadcast_to(frame[..., :3, 3], (len(angles), 3)))
            frame = frame @ oracle.rotation("z", theta + angles[:, row - 1])
        else:
            frame = frame @ oracle.rotation("z", theta)
        frame = frame @ (oracle.translation(a, 0.0, d) @ oracle.rotation("x", alpha))
    wrist = frame[:, :3, :3] @ geometry.tips[arm] + frame[:, :3, 3]
    slope = [np.cross(z, wrist - o) for z, o in zip(axes, origins, strict=True)]
    return wrist, np.stack(slope, axis=-1)


def wrist_of_arm(geometry: Geometry, arm: int, angles: Array) -> tuple[Array, Array]:
    """Wrist of a loaded arm, whose joints bend under gravity, and the derivative as if rigid."""
    if geometry.compliance[arm] == 0.0:
        return forward_arm(geometry, arm, angles)
    _, slope = forward_arm(geometry, arm, angles)
    return forward_arm(geometry, arm, angles - geometry.compliance[arm] * slope[:, 2, :])


def inverse_wrists(geometry: Geometry, wrists: Array, start: Array) -> Array:
    """Joint angles that put the wrists where they are: (n, 3, 3) to (n, 3 arms, 3 joints).

    Raises `ValueError` where an arm as built cannot reach.
    """
    out = start.copy()
    for arm in range(3):
        for _ in range(50):
            wrist, slope = wrist_of_arm(geometry, arm, out[:, arm])
            step = np.linalg.solve(slope, (wrists[:, arm] - wrist)[..., None])[..., 0]
            out[:, arm] += step
            if np.abs(step).max(initial=0.0) < 1e-13:
                break
        else:
            raise ValueError(f"arm {arm + 1} as built does not reach every pose")
    return out


def inverse(geometry: Geometry, pose: Array, shift: Array | None = None) -> Array:
    """Joint angles of the real device for handle poses of shape (n, 6): shape (n, 3, 3).

    `shift`, shape (n, 3, 3), displaces the wrists from where a rigid handle has them (play).
    """
    start = oracle.rsi_inverse(pose)
    if geometry.is_nominal() and shift is None:
        return start
    wrists = oracle.rsi_wrists(pose, geometry.platform)
    return inverse_wrists(geometry, wrists if shift is None else wrists + shift, start)
