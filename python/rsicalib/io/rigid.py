"""Rigid transformations as 4x4 matrices: the few that URDF and mechanism rows need."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
import numpy.typing as npt

Matrix = npt.NDArray[np.float64]
"""`a_from_b`, shape (4, 4)."""


def rotation(axis: int, angle: float) -> Matrix:
    """Turn by an angle about one axis of the frame.

    Parameters
    ----------
    axis : {0, 1, 2}
        x, y or z.
    angle : float
        [rad]

    Returns
    -------
    ndarray, shape (4, 4)
        The rotation.
    """
    out = np.eye(4)
    i, j = (axis + 1) % 3, (axis + 2) % 3
    out[i, i] = out[j, j] = math.cos(angle)
    out[j, i] = math.sin(angle)
    out[i, j] = -out[j, i]
    return out


def rigid(xyz: Sequence[float], rpy: Sequence[float] = (0.0, 0.0, 0.0)) -> Matrix:
    """Build `T(xyz) Rz(yaw) Ry(pitch) Rx(roll)`, the order of URDF and of eq. (1).

    Parameters
    ----------
    xyz : sequence of 3 floats
        Translation.
    rpy : sequence of 3 floats
        Roll, pitch, yaw [rad].

    Returns
    -------
    ndarray, shape (4, 4)
        The transformation.
    """
    out: Matrix = rotation(2, rpy[2]) @ rotation(1, rpy[1]) @ rotation(0, rpy[0])
    out[:3, 3] = xyz
    return out


def xyz_rpy(matrix: Matrix) -> tuple[list[float], list[float]]:
    """Take a transformation apart: the inverse of `rigid`.

    Yaw is read first and taken off before pitch and roll are read, so that they
    put the matrix together again to rounding, also where pitch is near a right
    angle and yaw alone is badly determined.

    Parameters
    ----------
    matrix : ndarray, shape (4, 4)
        A rigid transformation.

    Returns
    -------
    xyz, rpy : list of float
        Translation, and roll, pitch, yaw [rad].
    """
    yaw = math.atan2(matrix[1, 0], matrix[0, 0])
    rest = rotation(2, -yaw) @ matrix
    pitch = math.atan2(-rest[2, 0], rest[0, 0])
    roll = math.atan2(-rest[1, 2], rest[1, 1])
    # Adding 0.0 turns -0.0, which says nothing, to 0.0.
    return [float(x) + 0.0 for x in matrix[:3, 3]], [roll + 0.0, pitch + 0.0, yaw + 0.0]


def inverse(matrix: Matrix) -> Matrix:
    """Invert a rigid transformation.

    Parameters
    ----------
    matrix : ndarray, shape (4, 4)
        `a_from_b`.

    Returns
    -------
    ndarray, shape (4, 4)
        `b_from_a`.
    """
    out = np.eye(4)
    out[:3, :3] = matrix[:3, :3].T
    out[:3, 3] = -(out[:3, :3] @ matrix[:3, 3])
    return out


def align_z(axis: Sequence[float]) -> Matrix:
    """Find a rotation that takes z to an axis; the identity for z itself.

    Parameters
    ----------
    axis : sequence of 3 floats
        A direction, of any length but zero.

    Returns
    -------
    ndarray, shape (4, 4)
        Its third column is the direction.
    """
    x, y, z = (float(c) for c in np.asarray(axis, dtype=float) / math.hypot(*axis))
    flip = np.diag([1.0, -1.0, -1.0, 1.0])
    if z < 0.0:  # the short way round is ill-conditioned near -z: half a turn about x first
        return flip @ align_z((x, -y, -z))
    out = np.eye(4)
    out[0, :3] = [1.0 - x * x / (1.0 + z), -x * y / (1.0 + z), x]
    out[1, :3] = [-x * y / (1.0 + z), 1.0 - y * y / (1.0 + z), y]
    out[2, :3] = [-x, -y, z]
    return out


def joint_motion(kind: str, coordinate: float) -> Matrix:
    """Move a joint about or along its z axis.

    Parameters
    ----------
    kind : {"revolute", "prismatic"}
        How it moves.
    coordinate : float
        Angle [rad] or length.

    Returns
    -------
    ndarray, shape (4, 4)
        The motion.
    """
    if kind == "prismatic":
        return rigid((0.0, 0.0, coordinate))
    return rotation(2, coordinate)


def row_motion(row: Mapping[str, Any]) -> Matrix:
    """Move along a row of a chain whose joint is at zero.

    Parameters
    ----------
    row : mapping
        As in a mechanism file: `theta, d, a, alpha`, then `xyz, rpy`.

    Returns
    -------
    ndarray, shape (4, 4)
        `Rz(theta) Tz(d) Tx(a) Rx(alpha) T(xyz) R(rpy)`.
    """
    theta, d, a, alpha = (float(row.get(name) or 0.0) for name in ("theta", "d", "a", "alpha"))
    body = rigid(row.get("xyz") or (0.0, 0.0, 0.0), row.get("rpy") or (0.0, 0.0, 0.0))
    return rotation(2, theta) @ rigid((a, 0.0, d)) @ rotation(0, alpha) @ body
