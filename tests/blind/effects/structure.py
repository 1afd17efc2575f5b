"""What was built differently from the drawing, or bends: lengths, axes, bases, handle, load."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, ClassVar

import numpy as np

from tests import oracle
from tests.blind.effects.base import ARMS, SIDES, Effect
from tests.blind.geometry import A, D, Geometry


def rows_of(*rows: int) -> tuple[str, ...]:
    """Targets `arm1/r` … `arm3/r`."""
    return tuple(f"{arm}/{row}" for arm in ARMS for row in rows)


@dataclass(frozen=True)
class Structure(Effect):
    """One number of the drawing."""

    kind: ClassVar[str] = "geometry"
    unit: ClassVar[str] = "in"


@dataclass(frozen=True)
class LinkLength(Structure):
    """A link longer by `b`: base radius (row 1, negative in the drawing), upper arm, forearm."""

    term: ClassVar[str] = "link_length"
    sizes: ClassVar[tuple[float, float]] = (0.01, 0.05)
    targets: ClassVar[tuple[str, ...]] = rows_of(1, 2, 4)

    @property
    def equivalents(self) -> frozenset[str]:
        """The base radius is a shift of the base as well."""
        return frozenset({self.target, ARMS[self.arm]} if self.row == 0 else {self.target})

    def geometry(self, geometry: Geometry) -> Geometry:
        """The length along x after the joint; the forearm ends at the wrist."""
        if self.row < 3:
            return geometry.with_row(self.arm, self.row, A, self.size)
        tips = geometry.tips.copy()
        tips[self.arm, 0] += self.size
        return geometry.with_values(tips=tips)


@dataclass(frozen=True)
class LinkOffset(Structure):
    """A link displaced by `b` along the axis of its joint."""

    term: ClassVar[str] = "link_offset"
    sizes: ClassVar[tuple[float, float]] = (0.01, 0.05)
    targets: ClassVar[tuple[str, ...]] = rows_of(2, 4)

    @property
    def equivalents(self) -> frozenset[str]:
        """Shoulder and elbow are parallel, and the base can shift the same way."""
        arm = ARMS[self.arm]
        return frozenset({arm, f"{arm}/2", f"{arm}/3"} if self.row == 1 else {self.target})

    def geometry(self, geometry: Geometry) -> Geometry:
        """`d` of the row."""
        return geometry.with_row(self.arm, self.row, D, self.size)


@dataclass(frozen=True)
class Turned(Structure):
    """A small rotation or shift along one `axis` of a frame."""

    axis: str = "x"
    axes: ClassVar[str] = "xy"

    @classmethod
    def details(cls, rng: np.random.Generator) -> dict[str, Any]:
        """A direction."""
        return {"axis": str(rng.choice(list(cls.axes)))}


@dataclass(frozen=True)
class JointTilt(Turned):
    """The axis of joint 2 or 3 of an arm (its third or fourth row) leans by `b`.

    Joint 3 leans about x only: about y it would turn about the axis of joint 2, which is an offset.
    """

    term: ClassVar[str] = "joint_tilt"
    unit: ClassVar[str] = "rad"
    sizes: ClassVar[tuple[float, float]] = (0.003, 0.012)
    targets: ClassVar[tuple[str, ...]] = rows_of(3, 4)

    @property
    def equivalents(self) -> frozenset[str]:
        """A lean of this axis is a twist of the link before."""
        return frozenset({self.target, f"{ARMS[self.arm]}/{self.row}"})

    def geometry(self, geometry: Geometry) -> Geometry:
        """A rotation ahead of the joint, at its origin."""
        axis = "x" if self.row == 3 else self.axis
        return geometry.with_motion(self.arm, self.row, oracle.rotation(axis, self.size))


@dataclass(frozen=True)
class BaseTilt(Turned):
    """The base of an arm leans by `b` about its shoulder: x radial, y up."""

    term: ClassVar[str] = "base_tilt"
    unit: ClassVar[str] = "rad"
    sizes: ClassVar[tuple[float, float]] = (0.003, 0.015)
    targets: ClassVar[tuple[str, ...]] = ARMS

    @property
    def equivalents(self) -> frozenset[str]:
        """A lean of the first joint's axis, a twist of the base row."""
        return frozenset({self.target, f"{self.target}/1", f"{self.target}/2"})

    def geometry(self, geometry: Geometry) -> Geometry:
        """A rotation after the base row."""
        return geometry.with_motion(self.arm, 1, oracle.rotation(self.axis, self.size))


@dataclass(frozen=True)
class BasePosition(Turned):
    """The base of an arm is displaced by `b`: x radial, y up, z tangential."""

    term: ClassVar[str] = "base_position"
    sizes: ClassVar[tuple[float, float]] = (0.01, 0.05)
    targets: ClassVar[tuple[str, ...]] = ARMS
    axes: ClassVar[str] = "xyz"

    @property
    def equivalents(self) -> frozenset[str]:
        """Radial: a length of the base row; up: its offset; tangential: the offset of link 2."""
        near = {"x": (1,), "y": (1,), "z": (2, 3)}[self.axis]
        return frozenset({self.target, *(f"{self.target}/{row}" for row in near)})

    def geometry(self, geometry: Geometry) -> Geometry:
        """A translation after the base row."""
        shift = oracle.translation(**{self.axis: self.size})
        return geometry.with_motion(self.arm, 1, shift)


@dataclass(frozen=True)
class Distance(Structure):
    """One side of the handle's triangle longer by `b`; the other two as drawn."""

    term: ClassVar[str] = "distance"
    kind: ClassVar[str] = "closure"
    sizes: ClassVar[tuple[float, float]] = (0.01, 0.05)
    targets: ClassVar[tuple[str, ...]] = SIDES

    def geometry(self, geometry: Geometry) -> Geometry:
        """The new triangle, where it fits the handle best (which defines the handle's pose)."""
        a, b = (int(name[-1]) - 1 for name in self.target.split("-"))
        c = 3 - a - b
        drawn = geometry.platform
        side = np.linalg.norm(drawn[a] - drawn[b]) + self.size
        middle = (drawn[a] + drawn[b]) / 2
        along = (drawn[b] - drawn[a]) / np.linalg.norm(drawn[b] - drawn[a])
        up = (drawn[c] - middle) - along * np.dot(drawn[c] - middle, along)
        leg = np.linalg.norm(drawn[c] - drawn[a])
        wrists = np.zeros((3, 3))
        wrists[a], wrists[b] = -along * side / 2, along * side / 2
        wrists[c] = up / np.linalg.norm(up) * np.sqrt(leg**2 - side**2 / 4)
        wrists += drawn.mean(axis=0) - wrists.mean(axis=0)
        return geometry.with_values(platform=wrists)


@dataclass(frozen=True)
class Sag(Effect):
    """Every joint bends by `b` per inch of lever under a handle of weight one."""

    term: ClassVar[str] = "sag"
    kind: ClassVar[str] = "load"
    unit: ClassVar[str] = "rad/in"
    sizes: ClassVar[tuple[float, float]] = (0.001, 0.004)
    targets: ClassVar[tuple[str, ...]] = ("all",)
    signed: ClassVar[bool] = False

    def geometry(self, geometry: Geometry) -> Geometry:
        """All arms, or one."""
        soft = geometry.compliance + (self.size if self.target == "all" else 0.0)
        if self.target != "all":
            soft[self.arm] += self.size
        return geometry.with_values(compliance=soft)
