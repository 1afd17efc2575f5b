"""Single bad readings, and converters with faults."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, ClassVar

import numpy as np

from tests import oracle
from tests.blind.effects.base import ARMS, Effect
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
class BaseSlip(Effect):
    """The base of an arm is pushed by `b` at the fraction `at` of the session, and turns by `b`/5
    rad/in about its shoulder, in directions of their own."""

    at: float = 0.5
    along: tuple[float, float, float] = (1.0, 0.0, 0.0)
    about: tuple[float, float, float] = (0.0, 0.0, 1.0)
    term: ClassVar[str] = "base_slip"
    kind: ClassVar[str] = "geometry"
    unit: ClassVar[str] = "in"
    sizes: ClassVar[tuple[float, float]] = (0.01, 0.1)
    targets: ClassVar[tuple[str, ...]] = ARMS
    signed: ClassVar[bool] = False
    loose: ClassVar[bool] = True

    @classmethod
    def details(cls, rng: np.random.Generator) -> dict[str, Any]:
        """A time and two directions."""
        ways = rng.standard_normal((2, 3))
        along, about = ways / np.linalg.norm(ways, axis=1, keepdims=True)
        return {"at": float(rng.uniform(0.2, 0.8)), "along": tuple(along), "about": tuple(about)}

    def told(self) -> str | None:
        """The library counts poses, not time."""
        return None

    def play(self, scene: Scene) -> Array:
        """An arm that has moved reaches the handle where one that has not would reach it elsewhere:
        `base_from_moved⁻¹ p`, and both agree before the slip."""
        wrists = oracle.rsi_wrists(scene.pose)[:, self.arm]
        base = oracle.BASE_ANGLES[self.arm]
        shoulder = oracle.L1 * np.array([np.cos(base), np.sin(base), 0.0])
        turn = oracle.roll_pitch_yaw(*(0.2 * self.size * np.array(self.about)))[:3, :3]
        back = (wrists - shoulder - self.size * np.array(self.along)) @ turn + shoulder
        out = np.zeros((len(wrists), 3, 3))
        out[:, self.arm] = np.where((scene.turn > self.at)[:, None], back - wrists, 0.0)
        return out


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
