"""Devices whose offsets and gains are known, and poses that they can take."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt

from rsicalib import _core
from rsicalib._core import Mechanism
from rsicalib.arrays import Alike, FloatArray
from rsicalib.errors import InputError
from rsicalib.units import is_count

Within = Sequence[tuple[float, float]]
"""Lowest and highest x, y, z [length unit], rx, ry, rz [rad]."""

MARGIN = _core.MARGIN
"""Readings that a pose keeps from the ends of the range: offsets are not known beforehand."""

CLAMPED = 0.03
"""Within which a hand clamps a sensor [rad, or length units]: 20 counts of the hand controller."""


@dataclass(frozen=True, eq=False, repr=False)
class Device(Alike):
    """A mechanism whose offsets and gains are known.

    Attributes
    ----------
    mechanism : Mechanism
        Geometry, ranges and limits.
    offsets : ndarray, shape (C,)
        Joint coordinate at reading zero, `θ_off` of eq. (9) [rad].
    gains : ndarray, shape (C,)
        Joint coordinate per reading, `k` of eq. (9) [rad/reading].
    """

    mechanism: Mechanism
    offsets: FloatArray
    gains: FloatArray

    def __repr__(self) -> str:
        return f"<Device of {self.mechanism.name!r}: {len(self.gains)} offsets and gains>"

    @classmethod
    def drawn(
        cls,
        mechanism: Mechanism,
        rng: np.random.Generator,
        *,
        gain: float = 0.02,
        clamp: float | None = None,
    ) -> Device:
        """Draw a device as an assembler would make it.

        Gains differ from nominal as potentiometers do, and each sensor is clamped at the rest
        pose to its nominal reading as well as a hand can; without a rest pose, at mid-range.

        Parameters
        ----------
        mechanism : Mechanism
            With nominal offsets and gains.
        rng : numpy.random.Generator
            Source of the random draws.
        gain : float
            Standard deviation of the gains, as a fraction, of a mechanism that identifies them.
        clamp : float, optional
            Standard deviation of the clamping, in readings; where not given 20 of a channel that
            counts, and of another what moves its joint by 0.03.

        Returns
        -------
        Device
            Close to nominal, but not nominal.
        """
        offsets, gains = nominal(mechanism)
        anchor = np.array(
            [sum(c.range) / 2 if c.range is not None else 0.0 for c in mechanism.channels]
        )
        rest = mechanism.to_dict().get("rest")
        if rest is not None:
            anchor = (np.array(mechanism.inverse(rest["pose"])) - offsets) / gains
        angles = offsets + gains * anchor
        told = any(name.startswith("gain") for name in mechanism.to_dict()["model"]["terms"])
        true = gains * (1 + (gain if told else 0.0) * rng.standard_normal(len(gains)))
        by = [20.0 if is_count(c.unit) else CLAMPED / abs(c.gain) for c in mechanism.channels]
        read = anchor + (by if clamp is None else clamp) * rng.standard_normal(len(gains))
        return cls(mechanism, angles - true * read, true)

    def readings(self, poses: npt.ArrayLike, margin: float = 0.0) -> FloatArray:
        """Find the exact readings that hold the platform at poses.

        Parameters
        ----------
        poses : array_like, shape (n, 6)
            `x y z` [length unit], `rx ry rz` [rad].
        margin : float
            Readings to keep from the ends of the range.

        Returns
        -------
        ndarray, shape (n, C)
            Real numbers, neither noisy nor rounded; NaN where a pose is out of reach, beyond a
            joint limit or out of range.
        """
        poses = np.ascontiguousarray(poses, dtype=np.float64).reshape(-1, 6)
        return _core.readings_at(self.mechanism, poses, self.offsets, self.gains, margin)

    def sample(
        self,
        exact: FloatArray,
        rng: np.random.Generator,
        *,
        noise: float | FloatArray = 1.0,
        samples: int = 1,
    ) -> FloatArray:
        """Read exact readings as the electronics do: noise, rounding to counts, end of range.

        Parameters
        ----------
        exact : ndarray, shape (n, C)
            From `readings`.
        rng : numpy.random.Generator
            Source of the noise.
        noise : float or ndarray, shape (C,)
            Standard deviation of one sample, in readings, before it is rounded.
        samples : int
            Number of samples of each pose.

        Returns
        -------
        ndarray, shape (n, samples, C)
            Whole numbers where the channel counts.
        """
        shape = (len(exact), samples, exact.shape[1])
        if np.any(np.asarray(noise) > 0):
            read = rng.standard_normal(shape)
            read *= noise
            read += exact[:, None]
        else:
            read = np.repeat(exact[:, None], samples, axis=1)
        counted = [is_count(c.unit) for c in self.mechanism.channels]
        if all(counted):
            np.round(read, out=read)
        else:
            read[..., counted] = np.round(read[..., counted])
        low, high = _ranges(self.mechanism)
        if read.size and not (read.min() >= low.max() and read.max() <= high.min()):
            np.clip(read, low, high, out=read)
        return read

    def truth(self) -> dict[str, Any]:
        """Offsets and gains by channel, as `truth.json` has them."""
        names = [c.name for c in self.mechanism.channels]
        return {
            "off": dict(zip(names, self.offsets.tolist(), strict=True)),
            "gain": dict(zip(names, self.gains.tolist(), strict=True)),
        }


def nominal(mechanism: Mechanism) -> tuple[FloatArray, FloatArray]:
    """Offsets and gains as the mechanism declares them, each of shape (C,)."""
    channels = mechanism.channels
    return np.array([c.offset for c in channels]), np.array([c.gain for c in channels])


def workspace(mechanism: Mechanism, within: Within | None) -> FloatArray:
    """The bounds of a workspace, given or known: shape (6, 2)."""
    if within is not None and np.shape(within) != (6, 2):
        raise InputError(f"within: found {within}, expected six pairs, the lower end first")
    pairs = None if within is None else [(float(low), float(high)) for low, high in within]
    return np.array(_core.workspace(mechanism, pairs))


def nominal_device(mechanism: Mechanism) -> Device:
    """The device that is exactly as the mechanism declares it."""
    return Device(mechanism, *nominal(mechanism))


def draw_poses(
    device: Device,
    count: int,
    rng: np.random.Generator,
    *,
    within: Within | None = None,
    margin: float = MARGIN,
) -> tuple[FloatArray, FloatArray]:
    """Draw poses that the device can take, uniformly from a box.

    Parameters
    ----------
    device : Device
        Device whose reach, joint limits and ranges the poses must keep.
    count : int
        Number of poses.
    rng : numpy.random.Generator
        Source of the random draws.
    within : six pairs, optional
        The box; for the hand controller ±3 in, z -5.7 to -0.3, ±30°.
    margin : float
        Readings to keep from the ends of the range.

    Returns
    -------
    poses : ndarray, shape (count, 6)
        `x y z` [length unit], `rx ry rz` [rad].
    exact : ndarray, shape (count, C)
        Their readings.

    Raises
    ------
    InputError
        Hardly a pose of the box can be taken.
    """
    low, high = workspace(device.mechanism, within).T
    poses, exact = np.empty((0, 6)), np.empty((0, len(device.gains)))
    tried = 0
    while len(poses) < count:
        more = rng.uniform(low, high, (2 * (count - len(poses)) + 8, 6))
        tried += len(more)
        read = device.readings(more, margin)
        can = np.isfinite(read).all(axis=1)
        poses, exact = np.vstack([poses, more[can]]), np.vstack([exact, read[can]])
        if tried > 100 * (len(poses) + 10):
            found = f"{len(poses)} of {tried} poses within reach, joint limits and ranges"
            raise InputError(f"within: found {found}, expected a box that the mechanism can reach")
    return poses[:count], exact[:count]


def _ranges(mechanism: Mechanism) -> tuple[FloatArray, FloatArray]:
    ends = [c.range if c.range is not None else (-np.inf, np.inf) for c in mechanism.channels]
    low, high = np.array(ends, dtype=np.float64).T
    return low, high
