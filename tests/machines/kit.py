"""A machine with a known truth: its loops closed, its readings, and what an effect leaves in them.

A machine is equations `gap(readings, places, values) = play` with one row per pose. `values` are
all that could be wrong with it, effects included, by name; `places` (ξ) are unknown in one pose
alone. From them alone follow readings, the noise of every equation, and the noncentrality of an
effect, by differences: no term and no kinematics of the core.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from functools import cached_property
from typing import Any

import numpy as np

from tests.oracle import Array

Rng = np.random.Generator
Values = dict[str, float]
Gap = Callable[[Array, Array, Values], Array]
Name = tuple[str, str]
"""Class and target."""

TWIN = 1.0
"""Where another effect leaves less noncentrality than this, no method can tell the two apart."""
FEW = 0.5
"""An effect of which two poses see so much is two bad readings."""
SMALL = 1e-9
"""Columns shorter than this, in parts of the longest, are rounding."""


WARM = "temperature_c"
"""The column of a session with a temperature that changes; where there is one, it is the last."""


def day(rng: Rng, n: int) -> Array:
    """Temperatures of a session [°C]: a machine that warms up in a hall that is aired, (n,)."""
    t = np.linspace(0, 1, n)
    up = rng.uniform(2, 8) * (1 - np.exp(-t * rng.uniform(2, 6)))
    aired = rng.uniform(1, 4) * np.sin(2 * np.pi * (t * rng.uniform(0.7, 2.5) + rng.random()))
    return np.asarray(20 + up + aired)


@dataclass(frozen=True)
class Effect:
    """Something that the mechanism file lacks: a value, its kind, and the names it may have."""

    value: str
    kind: str
    names: frozenset[Name]
    typical: float


def effect(
    value: str, kind: str, typical: float, *targets: str, also: tuple[str, ...] = ()
) -> Effect:
    """An effect whose class is its kind, at one of the targets, or of another class there."""
    classes = (kind, *also)
    return Effect(value, kind, frozenset((c, t) for c in classes for t in targets), typical)


@dataclass(frozen=True)
class Machine:
    """One machine and its session.

    `start` (n, columns + places) is where loops are closed from, `gives` (columns + places) by how
    much each of them gives way for that: 0 stays as it is. `play` is (equations,), 0 where an
    equation is not asked of a row: there `gap` is zero whatever moves.
    """

    name: str
    mechanism: dict[str, Any]
    columns: tuple[str, ...]
    sigma: Array
    play: Array
    gap: Gap
    start: Array
    gives: Array
    values: Values
    fitted: dict[str, float]
    """Names that the mechanism file identifies, each with a small step of its own."""
    effects: tuple[Effect, ...]
    text: dict[str, list[str]] = field(default_factory=dict)
    """Other columns of the readings: groups, surfaces."""
    empty: Array | None = None
    """Where a column says nothing: (n, columns)."""

    def parts(self, rows: Array) -> tuple[Array, Array]:
        """Readings and places."""
        return rows[:, : len(self.columns)], rows[:, len(self.columns) :]

    def closed(self, values: Values, play: Array | float = 0.0) -> Array:
        """Rows at which the equations are as far open as `play`; `ValueError` where none are."""
        rows, shut = self.settled(values, play)
        if not shut.all():
            raise ValueError(f"{self.name}: loops that do not close")
        return rows

    def settled(self, values: Values, play: Array | float = 0.0) -> tuple[Array, Array]:
        """The same by Newton's method, and which of the rows are so."""
        rows = self.start.copy()
        free = np.flatnonzero(self.gives > 0)
        shut = np.zeros(len(rows), dtype=bool)
        for _ in range(40):
            left = self.gap(*self.parts(rows), values) - play
            shut = np.abs(left).max(axis=1) < 1e-9 * max(1.0, np.abs(self.start).max())
            if shut.all():
                break
            slope = self.slope(rows, values, free) * self.gives[free]
            step = self.gives[free] * (np.linalg.pinv(slope, rcond=1e-9) @ left[..., None])[..., 0]
            longest = np.abs(step / self.gives[free]).max(axis=1, keepdims=True)
            rows[:, free] -= step * 0.3 / np.maximum(longest, 0.3)
        return rows, shut

    def slope(self, rows: Array, values: Values, which: Array) -> Array:
        """Derivative of the equations by columns and places: (n, equations, which)."""
        out = []
        for k in which:
            step = np.zeros(rows.shape[1])
            step[k] = 1e-5 * (self.gives[k] or 1.0)
            ends = [self.gap(*self.parts(rows + s * step), values) for s in (1, -1)]
            out.append((ends[0] - ends[1]) / (2 * step[k]))
        return (
            np.stack(out, axis=2)
            if out
            else np.zeros((*self.gap(*self.parts(rows), values).shape, 0))
        )

    def observe(self, rng: Rng, with_: Effect | None = None, size: float = 0.0) -> Array:
        """Readings of a session with play and noise: (n, columns)."""
        values = dict(self.values) | ({with_.value: size} if with_ else {})
        shape = (len(self.start), len(self.play))
        asked = self.gap(*self.parts(self.start + 1e-3), values) != 0
        rows = self.closed(values, asked * self.play * rng.standard_normal(shape))
        read = self.parts(rows)[0]
        return np.asarray(read + self.sigma * rng.standard_normal(read.shape))


class Linear:
    """The equations about the true rows: whitened, places eliminated, and what is fitted."""

    def __init__(self, machine: Machine) -> None:
        self.machine = machine
        self.rows = machine.closed(machine.values)
        n = len(machine.columns)
        read = machine.slope(self.rows, machine.values, np.arange(n))
        by_place = machine.slope(self.rows, machine.values, np.arange(n, self.rows.shape[1]))
        cover = (read * machine.sigma**2) @ np.swapaxes(read, 1, 2) + np.diag(machine.play**2)
        root = np.linalg.inv(np.linalg.cholesky(cover))
        self.white = np.array([keep(b).T @ r for r, b in zip(root, root @ by_place, strict=True)])
        fitted = [self.column(name, step) for name, step in machine.fitted.items()]
        self.base = span(np.column_stack(fitted)) if fitted else np.zeros((self.size, 0))

    @property
    def size(self) -> int:
        """Number of equations that are left."""
        return int(np.prod(self.white.shape[:2]))

    def column(self, name: str, step: float) -> Array:
        """Derivative by a value, (equations left)."""
        ends = []
        for sign in (1, -1):
            moved = self.machine.values | {name: self.machine.values.get(name, 0.0) + sign * step}
            ends.append(self.machine.gap(*self.machine.parts(self.rows), moved))
        slope = (ends[0] - ends[1]) / (2 * step)
        return np.asarray(np.einsum("nij,nj->ni", self.white, slope).ravel())

    def left(self, column: Array) -> Array:
        """What is left beside all that is fitted."""
        return np.asarray(column - self.base @ (self.base.T @ column))

    @cached_property
    def seen(self) -> dict[str, Array]:
        """What each effect leaves, for one unit of its value."""
        return {
            e.value: self.left(self.column(e.value, 1e-3 * e.typical)) for e in self.machine.effects
        }

    def sized(self, one: Effect, noncentrality: float) -> float:
        """The size that has a noncentrality; `ValueError` where it is hidden, or in few poses."""
        left = self.seen[one.value] * one.typical
        each = np.sum(left.reshape(self.white.shape[0], -1) ** 2, axis=1)
        size = np.sqrt(noncentrality / max(each.sum(), 1e-30))
        if size > 30 or np.sort(each)[-2:].sum() > FEW * each.sum():
            raise ValueError(f"{one.value} does not show in these poses")
        return float(size * one.typical)

    def twins(self, one: Effect, size: float) -> frozenset[Name]:
        """Names of all effects that explain this one as well as itself."""
        left, out = self.seen[one.value] * size, set(one.names)
        for other in self.machine.effects:
            column = self.seen[other.value]
            if not column.any():
                continue
            along = column / np.linalg.norm(column)
            if np.sum((left - along * (along @ left)) ** 2) < TWIN:
                out |= other.names
        return frozenset(out)


def keep(by_place: Array) -> Array:
    """Directions of whitened equations that no place moves: orthonormal columns."""
    left, sizes, _ = np.linalg.svd(by_place)
    rank = int(np.sum(sizes > SMALL * sizes[:1])) if sizes.size else 0
    return np.asarray(left[:, rank:])


def span(columns: Array) -> Array:
    """An orthonormal base of columns, each of which may be in a unit of its own."""
    long = np.linalg.norm(columns, axis=0)
    seen = columns[:, long > 0] / long[long > 0]
    left, sizes, _ = np.linalg.svd(seen, full_matrices=False)
    return np.asarray(left[:, sizes > SMALL * sizes[:1]])
