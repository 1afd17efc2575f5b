"""Effects that no catalogue has: all one can ask is which channel it is, and its curve."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, ClassVar

import numpy as np

from tests.blind.effects.base import ARMS, Effect, unit_counts
from tests.blind.effects.electronics import Shared
from tests.blind.effects.sensor import Sensor
from tests.blind.scene import Scene
from tests.oracle import Array


@dataclass(frozen=True)
class Strange(Sensor):
    """A sensor's law without a name."""

    outside: ClassVar[bool] = True


@dataclass(frozen=True)
class Ripple(Strange):
    """`b sin(2π a/λ + φ)`, a short wave of the winding; λ in counts."""

    wave: float = 200.0
    phase: float = 0.0
    term: ClassVar[str] = "ripple"
    sizes: ClassVar[tuple[float, float]] = (0.004, 0.012)

    @classmethod
    def details(cls, rng: np.random.Generator) -> dict[str, Any]:
        """A wavelength and a phase."""
        return {"wave": float(rng.uniform(120, 400)), "phase": float(rng.uniform(0, 2 * np.pi))}

    def angle(self, count: Array, scene: Scene) -> Array:
        """The wave."""
        return self.size * np.sin(2 * np.pi * count / self.wave + self.phase)


@dataclass(frozen=True)
class Kink(Strange):
    """Another slope beyond one reading: `b max(0, u - u0)`."""

    start: float = 0.0
    term: ClassVar[str] = "kink"
    sizes: ClassVar[tuple[float, float]] = (0.02, 0.06)

    @classmethod
    def details(cls, rng: np.random.Generator) -> dict[str, Any]:
        """Where the track was repaired."""
        return {"start": float(rng.uniform(-0.3, 0.3))}

    def angle(self, count: Array, scene: Scene) -> Array:
        """The bend."""
        return self.size * np.maximum(0.0, unit_counts(count) - self.start)


@dataclass(frozen=True)
class WornSpot(Strange):
    """A bump of height `b`, 80 counts wide, where the wiper rests most."""

    centre: float = 0.0
    term: ClassVar[str] = "worn_spot"
    sizes: ClassVar[tuple[float, float]] = (0.008, 0.03)

    @classmethod
    def details(cls, rng: np.random.Generator) -> dict[str, Any]:
        """Where."""
        return {"centre": float(rng.uniform(-0.25, 0.25))}

    def angle(self, count: Array, scene: Scene) -> Array:
        """The bump."""
        out: Array = self.size * np.exp(-0.5 * ((unit_counts(count) - self.centre) / 0.08) ** 2)
        return out


@dataclass(frozen=True)
class LogCurve(Strange):
    """A track that saturates: `b log(1 + u/2)` for `u` above -1.5."""

    term: ClassVar[str] = "log_curve"
    sizes: ClassVar[tuple[float, float]] = (0.05, 0.2)

    def angle(self, count: Array, scene: Scene) -> Array:
        """The logarithm."""
        return self.size * np.log1p(np.maximum(unit_counts(count), -1.5) / 2)


@dataclass(frozen=True)
class RandomWalk(Strange):
    """The offset wanders by `b √t` in the course of the session."""

    seed: int = 0
    term: ClassVar[str] = "random_walk"
    sizes: ClassVar[tuple[float, float]] = (0.006, 0.02)

    @classmethod
    def details(cls, rng: np.random.Generator) -> dict[str, Any]:
        """Which path."""
        return {"seed": int(rng.integers(2**31))}

    def angle(self, count: Array, scene: Scene) -> Array:
        """The same path whoever asks: 200 steps, joined by straight lines."""
        steps = np.random.default_rng(self.seed).standard_normal(200) / np.sqrt(200)
        path = np.concatenate([[0.0], np.cumsum(steps)])
        out: Array = self.size * np.interp(scene.turn, np.linspace(0, 1, 201), path)
        return out


@dataclass(frozen=True)
class StepInGain(Strange):
    """The gain changes by the fraction `b` at the fraction `at` of the session."""

    at: float = 0.5
    term: ClassVar[str] = "step_in_gain"
    unit: ClassVar[str] = "1"
    sizes: ClassVar[tuple[float, float]] = (0.005, 0.03)

    @classmethod
    def details(cls, rng: np.random.Generator) -> dict[str, Any]:
        """When."""
        return {"at": float(rng.uniform(0.3, 0.7))}

    def angle(self, count: Array, scene: Scene) -> Array:
        """About the middle of the range, 1.45 rad per 1000 counts."""
        return self.size * -1.45 * unit_counts(count) * (scene.turn > self.at)


@dataclass(frozen=True)
class Backlash(Effect):
    """A coupling with play: the shaft follows the joint at a distance of at most `b`."""

    term: ClassVar[str] = "backlash"
    kind: ClassVar[str] = "sensor"
    unit: ClassVar[str] = "rad"
    sizes: ClassVar[tuple[float, float]] = (0.002, 0.01)
    signed: ClassVar[bool] = False
    outside: ClassVar[bool] = True

    def shafts(self, angles: Array, scene: Scene, rest: Array) -> Array:
        """Dragged along, row after row, from the rest pose."""
        out = angles.copy()
        shaft = rest[self.channel]
        for row, joint in enumerate(angles[:, self.channel]):
            shaft = min(max(shaft, joint - self.size), joint + self.size)
            out[row, self.channel] = shaft
        return out


@dataclass(frozen=True)
class Lag(Effect):
    """A channel that is late: by `b` s in motion; at rest `b` of the way, forgotten in 0.3 s."""

    term: ClassVar[str] = "lag"
    kind: ClassVar[str] = "sensor"
    unit: ClassVar[str] = "s"
    sizes: ClassVar[tuple[float, float]] = (0.005, 0.02)
    signed: ClassVar[bool] = False
    outside: ClassVar[bool] = True

    def shafts(self, angles: Array, scene: Scene, rest: Array) -> Array:
        """Where it was, in part."""
        if scene.held:
            late = scene.previous(angles, rest) - angles
            since = 0.02 * (scene.sample - 1)
            behind = late[:, self.channel] * np.exp(-since / 0.3)
        else:
            behind = -np.gradient(angles[:, self.channel], scene.time_s)
        return angles + self.only(self.size * behind, angles)


@dataclass(frozen=True)
class WarmUp(Shared):
    """The law sees all counts times `1 + b (1 - exp(-t/τ))`, τ as a fraction of the session."""

    constant: float = 0.15
    term: ClassVar[str] = "warm_up"
    unit: ClassVar[str] = "1"
    sizes: ClassVar[tuple[float, float]] = (0.001, 0.005)
    outside: ClassVar[bool] = True

    @classmethod
    def details(cls, rng: np.random.Generator) -> dict[str, Any]:
        """How slow."""
        return {"constant": float(rng.uniform(0.08, 0.25))}

    def electronics(self, counts: Array, scene: Scene, change: Array) -> Array:
        """The reference warms up."""
        return counts / (1 - self.size * np.expm1(-scene.turn / self.constant))[:, None]


@dataclass(frozen=True)
class HandlePlay(Effect):
    """A loose wrist that stays behind the motion of the handle by `b`."""

    term: ClassVar[str] = "handle_play"
    kind: ClassVar[str] = "closure"
    unit: ClassVar[str] = "in"
    sizes: ClassVar[tuple[float, float]] = (0.008, 0.03)
    targets: ClassVar[tuple[str, ...]] = ARMS
    signed: ClassVar[bool] = False
    loose: ClassVar[bool] = True
    outside: ClassVar[bool] = True

    def play(self, scene: Scene) -> Array:
        """Against the way from the pose before."""
        place = scene.pose[:, :3]
        moved = place - scene.previous(place, np.array([0.0, 0.0, -2.666]))
        length = np.linalg.norm(moved, axis=1, keepdims=True)
        out = np.zeros((len(place), 3, 3))
        out[:, self.arm] = -self.size * moved / np.maximum(length, 1e-9)
        return out
