"""A hand controller with a known truth, read by its potentiometers and a 12-bit converter.

The order is that of the real thing: handle pose, joint angles of what was really built, sensor,
electronics, noise, rounding. Each step is open to the effects of `tests.blind.effects`.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from tests import oracle
from tests.blind.effects.base import Effect
from tests.blind.geometry import Geometry, inverse
from tests.blind.scene import SESSION_S, Scene, held, rest_scene, room, waved
from tests.oracle import Array

CHANNELS = tuple(f"a{i}{j}" for i in (1, 2, 3) for j in (1, 2, 3))
TOP = 4095
"""The largest code of the converter."""

LIMITS = np.deg2rad([[-90, 90], [-175, -20], [-90, 90]])
"""Joint limits. The elbow keeps clear of straight, where a shorter arm could not follow."""

Session = dict[str, Any]


@dataclass(frozen=True)
class Device:
    """True offsets [rad] and gains [rad/count], each (9,), and what was built."""

    offsets: Array
    gains: Array
    geometry: Geometry = field(default_factory=Geometry)

    @classmethod
    def random(cls, rng: np.random.Generator) -> Device:
        """Gains scattered by 2 %, offsets by 0.03 rad about nominal, as potentiometers clamp."""
        nominal_offsets, nominal_gains = oracle.nominal(oracle.rsi())
        gains = nominal_gains * (1 + 0.02 * np.clip(rng.standard_normal(9), -2.5, 2.5))
        return cls(nominal_offsets + 0.03 * np.clip(rng.standard_normal(9), -2.5, 2.5), gains)

    def built(self, effects: Sequence[Effect]) -> Geometry:
        """The geometry with every effect on it."""
        geometry = self.geometry
        for effect in effects:
            geometry = effect.geometry(geometry)
        return geometry

    def rest_angles(self) -> Array:
        """Joint angles of the rest pose, where every motion starts: shape (9,)."""
        return inverse(self.geometry, np.array([oracle.REST])).reshape(9)

    def angles(self, scene: Scene, effects: Sequence[Effect] = ()) -> Array:
        """True angles of the sensors' shafts: shape (n, 9)."""
        rows, back = scene.distinct()
        shift = [effect.play(scene)[rows] for effect in effects if effect.loose]
        loose = np.sum(shift, axis=0) if shift else None
        once = inverse(self.built(effects), scene.pose[rows], loose)
        angles = once.reshape(-1, 9)[back]
        for effect in effects:
            angles = effect.shafts(angles, scene, self.rest_angles())
        return angles

    def counts(self, angles: Array, scene: Scene, effects: Sequence[Effect] = ()) -> Array:
        """Readings whose law `θ = k a + off + corrections(a)` gives these angles: shape (n, 9)."""
        counts: Array = (angles - self.offsets) / self.gains
        bent = [effect for effect in effects if effect.bends]
        for _ in range(100 if bent else 0):
            correction = np.sum([effect.law(counts, scene) for effect in bent], axis=0)
            new = (angles - self.offsets - correction) / self.gains
            still = np.nanmax(np.abs(new - counts)) < 1e-11
            counts = new
            if still:
                break
        return counts

    def ideal(self, scene: Scene, effects: Sequence[Effect] = ()) -> Array:
        """Readings before noise and rounding, as real numbers: shape (n, 9)."""
        counts = self.counts(self.angles(scene, effects), scene, effects)
        for effect in effects:
            counts = effect.electronics(counts, scene, counts - self.past(counts, scene))
        return counts

    def past(self, counts: Array, scene: Scene) -> Array:
        """Readings of the pose before: shape (n, 9)."""
        return scene.previous(counts, (self.rest_angles() - self.offsets) / self.gains)

    def allows(self, pose: Array) -> Array:
        """Whether poses (n, 6) are in reach, within joint limits and the converter's range."""
        angles = oracle.rsi_inverse(pose)
        with np.errstate(invalid="ignore"):
            inside = (angles > LIMITS[:, 0]) & (angles < LIMITS[:, 1])
            counts = (angles.reshape(-1, 9) - self.offsets) / self.gains
            read = (counts > 5) & (counts < TOP - 5)
        out: Array = np.logical_and(inside.all(axis=(1, 2)), read.all(axis=1))
        return out


def hand_poses(
    rng: np.random.Generator, n: int, device: Device | None = None, corner: float = np.deg2rad(30)
) -> Array:
    """Where a hand may go: ±2.5 in sideways, z -5 … -0.8, ±30° of each angle. Shape (n, 6)."""
    device = Device(*oracle.nominal(oracle.rsi())) if device is None else device
    high = np.array([2.5, 2.5, -0.8, corner, corner, corner])
    low = np.array([-2.5, -2.5, -5.0, -corner, -corner, -corner])
    drawn = rng.uniform(low, high, (4 * n + 20, 6))
    kept = drawn[device.allows(drawn)]
    return kept[:n] if len(kept) >= n else hand_poses(rng, n, device, corner)


def digitise(
    counts: Array, rng: np.random.Generator, sigma: float, effects: Sequence[Effect] = ()
) -> Array:
    """Noise of `sigma` counts, rounding, the ends of the scale, and faults: int64, (n, 9)."""
    noisy = counts + sigma * rng.standard_normal(counts.shape)
    codes = np.clip(np.rint(noisy), 0, TOP).astype(np.int64)
    for effect in effects:
        codes = effect.codes(codes)
    return codes


def observe(
    device: Device,
    scene: Scene,
    rng: np.random.Generator,
    sigma: float = 1.0,
    effects: Sequence[Effect] = (),
) -> Session:
    """Reads a scene: the arrays of a readings file, and the scene itself."""
    return {
        "values": digitise(device.ideal(scene, effects), rng, sigma, effects),
        "pose": scene.label if scene.held else None,
        "sample": scene.sample,
        "time_s": scene.time_s,
        "temperature_c": scene.temperature_c if scene.held else None,
        "scene": scene,
        "sigma": sigma,
        "effects": tuple(effects),
    }


def session(
    device: Device,
    rng: np.random.Generator,
    poses: Array,
    samples: int = 8,
    sigma: float = 1.0,
    tremor: tuple[float, float] = (0.0, 0.0),
    effects: Sequence[Effect] = (),
) -> Session:
    """Held poses (p, 6), each read `samples` times with `sigma` counts of noise."""
    return observe(device, held(rng, poses, samples, tremor), rng, sigma, effects)


def recording(
    device: Device,
    rng: np.random.Generator,
    seconds: float = 20.0,
    rate_hz: float = 200.0,
    sigma: float = 1.0,
    effects: Sequence[Effect] = (),
) -> Session:
    """The handle waved about, every row a pose."""
    scene = waved(rng, device.allows, seconds, rate_hz)
    return observe(device, scene, rng, sigma, effects)


def rest(
    device: Device,
    rng: np.random.Generator,
    samples: int = 8,
    sigma: float = 1.0,
    effects: Sequence[Effect] = (),
) -> Session:
    """A reading of the rest pose before the session, with the pose of the fixture."""
    scene = rest_scene(samples)
    return observe(device, scene, rng, sigma, standing(effects)) | {"poses": scene.pose}


def check(
    device: Device,
    rng: np.random.Generator,
    n: int = 20,
    samples: int = 8,
    sigma: float = 1.0,
    effects: Sequence[Effect] = (),
    like: Scene | None = None,
) -> Session:
    """Other poses during the session, with the true pose of the handle in `poses`, (n, 6).

    `like` is the session's scene, whose temperature is followed.
    """
    poses = hand_poses(rng, n, device)
    follow = room(rng)
    if like is not None and like.held:
        first = like.firsts()

        def follow(turn: Array) -> Array:
            return np.interp(turn, like.turn[first], like.temperature_c[first])

    start, end = 0.05 * SESSION_S, 0.95 * SESSION_S
    scene = held(rng, poses, samples, (0.0, 0.0), start, end, follow)
    return observe(device, scene, rng, sigma, standing(effects)) | {"poses": scene.pose}


def standing(effects: Sequence[Effect]) -> tuple[Effect, ...]:
    """The effects of the device itself, without mishaps of one session such as a bad reading."""
    return tuple(effect for effect in effects if not effect.mishap)
