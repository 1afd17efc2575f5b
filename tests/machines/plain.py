"""Kinematics in plain matrix products, and least squares with intervals. Nothing of the core."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from scipy.optimize import least_squares

from tests.oracle import Array

Row = dict[str, Any]
"""A row of Denavit and Hartenberg's table as a mechanism file has it: `theta d a alpha`."""


def frames(rows: Sequence[Row], angles: dict[str, Array], n: int) -> Array:
    """The frame at the end of a chain, (n, 4, 4), for coordinates by channel, each (n,).

    Axes and the place of the end, each (3, n), are moved one after the other: the products of
    matrices that a row stands for, without the zeros and ones that they are full of.
    """
    x, y, z = (np.repeat(axis[:, None], n, axis=1) for axis in np.eye(3))
    at = np.zeros((3, n))
    for row in rows:
        q = row.get("ratio", 1.0) * angles[row["channel"]] if "channel" in row else 0.0
        slides = row.get("joint") == "prismatic"
        theta = row.get("theta", 0.0) + (0.0 if slides else q)
        d, a = row.get("d", 0.0) + (q if slides else 0.0), row.get("a", 0.0)
        x, y = turned(x, y, theta)
        if not nothing(d):
            at = at + d * z
        if not nothing(a):
            at = at + a * x
        y, z = turned(y, z, row.get("alpha", 0.0))
        z, x = turned(z, x, row.get("beta", 0.0))
    end = np.zeros((n, 4, 4))
    for k, column in enumerate((x, y, z, at)):
        end[:, :3, k] = column.T
    end[:, 3, 3] = 1.0
    return end


def turned(one: Array, other: Array, by: Array | float) -> tuple[Array, Array]:
    """Two axes, the first turned towards the second, and the second away from the first."""
    if nothing(by):
        return one, other
    cos, sin = np.cos(by), np.sin(by)
    return cos * one + sin * other, cos * other - sin * one


def nothing(by: Array | float) -> bool:
    """Whether it is the number zero: to look through an array takes longer than to use it."""
    return not isinstance(by, np.ndarray) and by == 0.0


def tilted(row: Row, by: float) -> Row:
    """What of a row is another where the next axis is tilted: half-way between x and y."""
    if not by:
        return {}
    return {"alpha": row.get("alpha", 0.0) + by * 0.5**0.5, "beta": by * 0.5**0.5}


def place(end: Array, at: Sequence[float] | Array) -> Array:
    """A point of a frame in the base, (n, 3)."""
    return np.asarray((end @ np.array([*at, 1.0]))[:, :3])


def axes_of(points: Array) -> tuple[Array, Array]:
    """The middle of points, and their principal axes as rows: the last is the normal."""
    middle = points.mean(axis=0)
    return middle, np.linalg.svd(points - middle)[2]


def off_plane(points: Array) -> Array:
    """Distances of points from the plane that fits them best."""
    middle, axes = axes_of(points)
    return np.asarray((points - middle) @ axes[2])


def rigid_gap(points: Array, seen: Array) -> Array:
    """What is left between points and the same points seen elsewhere, after a rigid motion."""
    a, b = points - points.mean(axis=0), seen - seen.mean(axis=0)
    left, _, right = np.linalg.svd(a.T @ b)
    mirror = np.diag([1.0, 1.0, np.sign(np.linalg.det(right.T @ left.T))])
    return np.asarray(a @ left @ mirror @ right - b)


def three_spheres(centres: Array, radii: Array) -> Array:
    """The lower of two points at three distances of three centres: (n, 3, 3) and (3,)."""
    one, two, three = centres[:, 0], centres[:, 1], centres[:, 2]
    apart = np.linalg.norm(two - one, axis=1)
    ex = (two - one) / apart[:, None]
    i = np.sum(ex * (three - one), axis=1)
    ey = three - one - i[:, None] * ex
    j = np.linalg.norm(ey, axis=1)
    ey = ey / j[:, None]
    ez = np.cross(ex, ey)
    ez = -ez * np.sign(ez[:, 2:])
    x = (radii[0] ** 2 - radii[1] ** 2 + apart**2) / (2 * apart)
    y = (radii[0] ** 2 - radii[2] ** 2 + i**2 + j**2 - 2 * i * x) / (2 * j)
    z = np.sqrt(radii[0] ** 2 - x**2 - y**2)
    return np.asarray(one + x[:, None] * ex + y[:, None] * ey + z[:, None] * ez)


@dataclass(frozen=True)
class Quick:
    """A plain least-squares fit: values, their standard deviations, and what is left."""

    value: Array
    sd: Array
    left: Array

    @property
    def rms(self) -> float:
        """Root mean square of what is left."""
        return float(np.sqrt(np.mean(self.left**2)))

    @property
    def s(self) -> float:
        """Its standard deviation: parameters counted."""
        dof = self.left.size - self.value.size
        return float(np.sqrt(self.left @ self.left / dof))


def quick(residual: Callable[[Array], Array], start: Sequence[float] | Array) -> Quick:
    """Unweighted least squares by SciPy; standard deviations from what is left."""
    found = least_squares(residual, np.asarray(start, dtype=float), x_scale="jac", max_nfev=2000)
    dof = found.fun.size - found.x.size
    cover = np.linalg.pinv(found.jac.T @ found.jac) * (found.fun @ found.fun) / dof
    return Quick(found.x, np.sqrt(np.diag(cover)), found.fun)
