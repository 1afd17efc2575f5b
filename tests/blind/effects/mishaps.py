"""Single bad readings, and converters with faults."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, ClassVar

import numpy as np

from tests.blind.effects.base import Effect
from tests.blind.scene import Scene
from tests.oracle import Array


@dataclass(frozen=True)
class BadReading(Effect):
    """All samples of one channel at one pose off by `b` counts."""

    pose: int = 1
    term: ClassVar[str] = "bad_reading"
    kind: ClassVar[str] = "data"
    unit: ClassVar[str] = "count"
    sizes: ClassVar[tuple[float, float]] = (10.0, 80.0)
    mishap: ClassVar[bool] = True

    @classmethod
    def details(cls, rng: np.random.Generator) -> dict[str, Any]:
        """Which pose, of 48."""
        return {"pose": int(rng.integers(1, 49))}

    def electronics(self, counts: Array, scene: Scene, change: Array) -> Array:
        """A knock that lasts as long as the pose."""
        return counts + self.only(self.size * (scene.label == self.pose), counts)


@dataclass(frozen=True)
class GrossSample(BadReading):
    """One sample of one channel off by `b` counts."""

    sample: int = 1
    term: ClassVar[str] = "bad_sample"
    sizes: ClassVar[tuple[float, float]] = (40.0, 400.0)

    @classmethod
    def details(cls, rng: np.random.Generator) -> dict[str, Any]:
        """Which pose and sample, of 48 and 8."""
        return {"pose": int(rng.integers(1, 49)), "sample": int(rng.integers(1, 9))}

    def electronics(self, counts: Array, scene: Scene, change: Array) -> Array:
        """A spike on the line."""
        here = (scene.label == self.pose) & (scene.sample == self.sample)
        return counts + self.only(self.size * here, counts)


@dataclass(frozen=True)
class Fault(Effect):
    """A converter that spoils the codes of one channel; `size` 0 leaves them alone."""

    kind: ClassVar[str] = "sensor"
    signed: ClassVar[bool] = False
    outside: ClassVar[bool] = True
    sizes: ClassVar[tuple[float, float]] = (1.0, 1.0)

    def spoilt(self, code: Array) -> Array:
        """The codes of the target channel, (n,)."""
        raise NotImplementedError

    def codes(self, codes: Array) -> Array:
        """The target's column spoilt."""
        out = codes.copy()
        if self.size:
            out[:, self.channel] = self.spoilt(codes[:, self.channel])
        return out


@dataclass(frozen=True)
class StuckBit(Fault):
    """Bit `bit` always reads as `high`."""

    bit: int = 2
    high: bool = True
    term: ClassVar[str] = "stuck_bit"

    @classmethod
    def details(cls, rng: np.random.Generator) -> dict[str, Any]:
        """A bit of weight 2 to 16."""
        return {"bit": int(rng.integers(1, 5)), "high": bool(rng.integers(2))}

    def spoilt(self, code: Array) -> Array:
        """The bit forced."""
        out: Array = code | (1 << self.bit) if self.high else code & ~(1 << self.bit)
        return out


@dataclass(frozen=True)
class MissingCodes(Fault):
    """Codes whose lowest `bits` bits are all set never occur; the next ones do."""

    bits: int = 3
    term: ClassVar[str] = "missing_codes"

    @classmethod
    def details(cls, rng: np.random.Generator) -> dict[str, Any]:
        """Every 4th, 8th or 16th code."""
        return {"bits": int(rng.integers(2, 5))}

    def spoilt(self, code: Array) -> Array:
        """One count up where the code is missing."""
        mask = (1 << self.bits) - 1
        out: Array = code + ((code & mask) == mask)
        return out


@dataclass(frozen=True)
class Saturation(Fault):
    """An amplifier that clips: nothing reads more than `level`."""

    level: int = 2300
    term: ClassVar[str] = "saturation"

    @classmethod
    def details(cls, rng: np.random.Generator) -> dict[str, Any]:
        """Well inside the range of use."""
        return {"level": int(rng.integers(2150, 2400))}

    def spoilt(self, code: Array) -> Array:
        """Clipped."""
        return np.minimum(code, self.level)
