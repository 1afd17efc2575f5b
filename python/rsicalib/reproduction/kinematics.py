"""The paper's kinematics in plain numpy, to evaluate formulas as they are printed.

It shares no code with the core: a formula in doubt is judged by something that does not rest on
it.
"""

from __future__ import annotations

import numpy as np

from rsicalib import _core
from rsicalib.arrays import FloatArray
from rsicalib.reproduction.printed import Printed


def turn(poses: FloatArray) -> FloatArray:
    """Rotation of each pose, eq. (1): shape (n, 3, 3)."""
    (cx, cy, cz), (sx, sy, sz) = np.cos(poses[:, 3:]).T, np.sin(poses[:, 3:]).T
    rows = [
        [cz * cy, cz * sy * sx - sz * cx, cz * sy * cx + sz * sx],
        [sz * cy, sz * sy * sx + cz * cx, sz * sy * cx - cz * sx],
        [-sy, cy * sx, cy * cx],
    ]
    return np.moveaxis(np.array(rows), 2, 0)


def wrists(paper: Printed, poses: FloatArray) -> FloatArray:
    """`r_i = r_H + R q_i`, wrists clockwise from above: shape (n, 3, 3)."""
    around = -2 * np.pi / 3 * np.arange(3)
    q = paper.numbers["geometry"]["l4"] * np.stack([np.cos(around), np.sin(around), 0 * around], 1)
    out: FloatArray = poses[:, None, :3] + np.einsum("nij,wj->nwi", turn(poses), q)
    return out


def in_arms(paper: Printed, wrists: FloatArray) -> FloatArray:
    """Wrists in the frames of the arms, `r_i0`: shape (n, 3, 3)."""
    g = paper.numbers["geometry"]
    cos, sin, zero = np.cos(g["theta_i0"]), np.sin(g["theta_i0"]), np.zeros(3)
    turn = np.array([[cos, zero, sin], [sin, zero, -cos], [zero, zero + 1, zero]])
    off = wrists - g["l1"] * np.stack([cos, sin, zero], axis=1)
    out: FloatArray = np.einsum("jiw,nwj->nwi", turn, off)
    return out


def plane(paper: Printed, angles: FloatArray) -> FloatArray:
    """Eq. (2): `r_i0` of joint angles of shape (n, 3, 3)."""
    g = paper.numbers["geometry"]
    t1, t2, t3 = np.moveaxis(angles, -1, 0)
    reach = g["l3"] * np.cos(t3)
    x = g["l2"] * np.cos(t1) + reach * np.cos(t1 + t2)
    y = g["l2"] * np.sin(t1) + reach * np.sin(t1 + t2)
    return np.stack([x, y, g["l3"] * np.sin(t3)], axis=-1)


def some_poses(paper: Printed) -> FloatArray:
    """The poses of Tables II and III, and others in between: all axes turn at once."""
    rng = np.random.default_rng(0)
    wide = [0.8, 0.8, 0.8, 0.4, 0.4, 0.4]
    more = np.array([0, 0, -2.5, 0, 0, 0]) + rng.uniform(-1, 1, (20, 6)) * wide
    return np.vstack([paper.fixture, paper.closed_loop, more])


def joint_angles(poses: FloatArray) -> FloatArray:
    """Joint coordinates of poses by the core: shape (n, 9)."""
    return _core.rsi_angles(np.ascontiguousarray(poses))
