"""One potentiometer that is not a straight line for ever: curves, time, temperature, direction."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, ClassVar

import numpy as np

from tests import oracle
from tests.blind.effects.base import CHANNELS, Effect, unit_counts
from tests.blind.scene import Scene
from tests.oracle import Array


@dataclass(frozen=True)
class Sensor(Effect):
    """An extra angle of one channel, `θ = k a + off + angle`."""

    kind: ClassVar[str] = "sensor"
    unit: ClassVar[str] = "rad"
    bends: ClassVar[bool] = True

    def angle(self, count: Array, scene: Scene) -> Array:
        """The extra angle for readings of shape (n,)."""
        raise NotImplementedError

    def law(self, counts: Array, scene: Scene) -> Array:
        """The extra angle, at the target."""
        return self.only(self.angle(counts[:, self.channel], scene), counts)


@dataclass(frozen=True)
class Curvature(Sensor):
    """`b u²`."""

    term: ClassVar[str] = "curvature"
    sizes: ClassVar[tuple[float, float]] = (0.008, 0.03)

    def angle(self, count: Array, scene: Scene) -> Array:
        """The parabola."""
        return self.size * unit_counts(count) ** 2


@dataclass(frozen=True)
class Cubic(Sensor):
    """`b u³`."""

    term: ClassVar[str] = "cubic"
    sizes: ClassVar[tuple[float, float]] = (0.02, 0.06)

    def angle(self, count: Array, scene: Scene) -> Array:
        """The cubic parabola."""
        return self.size * unit_counts(count) ** 3


@dataclass(frozen=True)
class Periodic(Sensor):
    """`b sin(m ψ + φ)` of the shaft's angle ψ, less its tangent at the middle of the range."""

    phase: float = 0.0
    cycles: ClassVar[int] = 1

    @classmethod
    def details(cls, rng: np.random.Generator) -> dict[str, Any]:
        """A phase."""
        return {"phase": float(rng.uniform(0, 2 * np.pi))}

    def angle(self, count: Array, scene: Scene) -> Array:
        """The wave."""
        shaft = oracle.GAIN * (count - 2048.0)
        out: Array = self.size * np.sin(self.cycles * shaft + self.phase)
        return out


@dataclass(frozen=True)
class OncePerTurn(Periodic):
    """An eccentric shaft."""

    term: ClassVar[str] = "once_per_turn"
    sizes: ClassVar[tuple[float, float]] = (0.02, 0.06)


@dataclass(frozen=True)
class TwicePerTurn(Periodic):
    """An oval track."""

    term: ClassVar[str] = "twice_per_turn"
    sizes: ClassVar[tuple[float, float]] = (0.004, 0.02)
    cycles: ClassVar[int] = 2


@dataclass(frozen=True)
class Drift(Sensor):
    """`b t`, t from 0 to 1 over the session."""

    term: ClassVar[str] = "drift"
    sizes: ClassVar[tuple[float, float]] = (0.005, 0.02)

    def angle(self, count: Array, scene: Scene) -> Array:
        """Linear in time."""
        return self.size * scene.turn


@dataclass(frozen=True)
class Slip(Sensor):
    """A clamp that lets go once: a step of `b` at the fraction `at` of the session."""

    at: float = 0.5
    term: ClassVar[str] = "slip"
    sizes: ClassVar[tuple[float, float]] = (0.004, 0.02)

    def told(self) -> str | None:
        """The library counts poses, not time."""
        return None

    @classmethod
    def details(cls, rng: np.random.Generator) -> dict[str, Any]:
        """A time."""
        return {"at": float(rng.uniform(0.15, 0.85))}

    def angle(self, count: Array, scene: Scene) -> Array:
        """The step."""
        return self.size * (scene.turn > self.at)


@dataclass(frozen=True)
class TemperatureOffset(Sensor):
    """`b (T - 21 °C)`."""

    term: ClassVar[str] = "temperature_offset"
    recorded: ClassVar[bool] = False
    unit: ClassVar[str] = "rad/K"
    sizes: ClassVar[tuple[float, float]] = (0.0008, 0.003)

    def angle(self, count: Array, scene: Scene) -> Array:
        """Linear in temperature."""
        return self.size * (scene.temperature_c - 21.0)


@dataclass(frozen=True)
class TemperatureGain(Sensor):
    """The gain grows by `b` per kelvin, about the middle of the range."""

    term: ClassVar[str] = "temperature_gain"
    recorded: ClassVar[bool] = False
    unit: ClassVar[str] = "1/K"
    sizes: ClassVar[tuple[float, float]] = (0.0015, 0.006)

    def angle(self, count: Array, scene: Scene) -> Array:
        """Linear in temperature and reading."""
        warm = scene.temperature_c - 21.0
        out: Array = self.size * warm * oracle.GAIN * (count - 2048.0)
        return out


@dataclass(frozen=True)
class Hysteresis(Effect):
    """`± b` counts by the direction from which the pose was reached."""

    term: ClassVar[str] = "hysteresis"
    kind: ClassVar[str] = "sensor"
    unit: ClassVar[str] = "count"
    sizes: ClassVar[tuple[float, float]] = (1.0, 4.0)

    def electronics(self, counts: Array, scene: Scene, change: Array) -> Array:
        """The reading stays behind."""
        return counts + self.only(self.size * np.sign(change[:, self.channel]), counts)


@dataclass(frozen=True)
class Crosstalk(Effect):
    """`b` times a neighbouring channel's reading, from mid-range, is added to the target's."""

    side: int = 1
    term: ClassVar[str] = "crosstalk"
    kind: ClassVar[str] = "sensor"
    unit: ClassVar[str] = "count/count"
    sizes: ClassVar[tuple[float, float]] = (0.003, 0.015)

    @classmethod
    def details(cls, rng: np.random.Generator) -> dict[str, Any]:
        """The channel sampled before, or the one after."""
        return {"side": int(rng.choice([-1, 1]))}

    @property
    def kinds(self) -> frozenset[str]:
        """Of the wiring, but at one channel: both words are fair."""
        return frozenset({"sensor", "electronics"})

    def told(self) -> str | None:
        """With the channel that disturbs."""
        return f"{self.term}@{self.target}:{CHANNELS[self.neighbour]}"

    @property
    def neighbour(self) -> int:
        """Column of the disturbing channel."""
        beside = self.channel + self.side
        return beside if 0 <= beside < len(CHANNELS) else self.channel - self.side

    def electronics(self, counts: Array, scene: Scene, change: Array) -> Array:
        """The neighbour leaks in."""
        leak = self.size * (counts[:, self.neighbour] - 2048.0)
        return counts + self.only(leak, counts)
