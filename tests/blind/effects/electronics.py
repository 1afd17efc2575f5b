"""What all channels share: the reference and the multiplexer."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

import numpy as np
from scipy.interpolate import CubicSpline

from tests.blind.effects.base import Effect
from tests.blind.scene import Scene
from tests.oracle import Array


@dataclass(frozen=True)
class Shared(Effect):
    """All channels alike."""

    kind: ClassVar[str] = "electronics"
    targets: ClassVar[tuple[str, ...]] = ("all",)


@dataclass(frozen=True)
class ReferenceDrift(Shared):
    """The law sees all counts times `1 + b t`, t from 0 to 1: positive `b`, sinking codes."""

    term: ClassVar[str] = "reference_drift"
    unit: ClassVar[str] = "1"
    sizes: ClassVar[tuple[float, float]] = (0.001, 0.004)

    def electronics(self, counts: Array, scene: Scene, change: Array) -> Array:
        """The reference rises, the codes sink."""
        return counts / (1 + self.size * scene.turn)[:, None]


@dataclass(frozen=True)
class ReferenceTemperature(Shared):
    """The law sees all counts times `1 + b (T - 21 °C)`."""

    term: ClassVar[str] = "reference_temperature"
    recorded: ClassVar[bool] = False
    unit: ClassVar[str] = "1/K"
    sizes: ClassVar[tuple[float, float]] = (0.00015, 0.0006)

    def electronics(self, counts: Array, scene: Scene, change: Array) -> Array:
        """As the room warms."""
        return counts / (1 + self.size * (scene.temperature_c - 21.0))[:, None]


@dataclass(frozen=True)
class ChannelSkew(Shared):
    """Channel `c`, counted from 0, is read `c b` seconds after the first."""

    term: ClassVar[str] = "channel_skew"
    unit: ClassVar[str] = "s"
    sizes: ClassVar[tuple[float, float]] = (5e-5, 5e-4)
    signed: ClassVar[bool] = False
    moving: ClassVar[bool] = True

    def shafts(self, angles: Array, scene: Scene, rest: Array) -> Array:
        """Each joint a little later on its way."""
        if scene.held:
            return angles
        way = CubicSpline(scene.time_s, angles)
        later = [way(scene.time_s + c * self.size)[:, c] for c in range(angles.shape[1])]
        return np.stack(later, axis=1)
