"""Devices with a known truth: joint readings of poses, with noise, averaging and rounding.

For the experiments of the paper and for a first try. A simulated device is exactly the model
`[offset, gain]`: with it a fit can only agree with itself, so effects that a model lacks are
simulated elsewhere, by code that shares nothing with this package (`tests/blind`).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from rsicalib import _core
from rsicalib._core import Mechanism
from rsicalib.io.readings import Readings
from rsicalib.errors import InputError
from rsicalib.io.files import write_text
from rsicalib.records import to_json
from rsicalib.work.job import FloatArray, MechanismArg, PathLike, open_mechanism

__all__ = ["WITHIN", "Device", "Simulated", "Within", "draw_poses", "nominal", "simulate"]

Within = Sequence[tuple[float, float]]
"""Lowest and highest x, y, z [length unit], rx, ry, rz [rad]."""

ANGLE = float(np.pi / 6)
WITHIN: dict[str, Within] = {
    "rsi": (
        (-3.0, 3.0),
        (-3.0, 3.0),
        (-5.7, -0.3),
        (-ANGLE, ANGLE),
        (-ANGLE, ANGLE),
        (-ANGLE, ANGLE),
    )
}
"""The workspace of the mechanisms that come along."""

MARGIN = 20.0
"""Readings that a pose keeps from the ends of the range: offsets are not known beforehand."""

POSE_S, SAMPLE_S = 15.0, 0.02
"""Between two held poses, and between two samples of one [s]."""


@dataclass(frozen=True, eq=False)
class Device:
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

    @classmethod
    def drawn(
        cls,
        mechanism: Mechanism,
        rng: np.random.Generator,
        *,
        gain: float = 0.02,
        clamp: float = 20.0,
    ) -> Device:
        """Draw a device as an assembler would make it.

        Gains differ from nominal as potentiometers do, and each sensor is clamped at the rest
        pose to its nominal reading as well as a hand can; without a rest pose, at mid-range.

        Parameters
        ----------
        mechanism : Mechanism
            With nominal offsets and gains.
        rng : numpy.random.Generator
            Where chance comes from.
        gain : float
            Standard deviation of the gains, as a fraction.
        clamp : float
            Standard deviation of the clamping, in readings.

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
        true = gains * (1 + gain * rng.standard_normal(len(gains)))
        read = anchor + clamp * rng.standard_normal(len(gains))
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
        found: FloatArray = _core.readings_at(
            self.mechanism, poses, self.offsets, self.gains, margin
        )
        return found

    def sample(
        self,
        exact: FloatArray,
        rng: np.random.Generator,
        *,
        noise: float = 1.0,
        samples: int = 1,
    ) -> FloatArray:
        """Read exact readings as the electronics do: noise, rounding to counts, end of range.

        Parameters
        ----------
        exact : ndarray, shape (n, C)
            From `readings`.
        rng : numpy.random.Generator
            Where the noise comes from.
        noise : float
            Standard deviation of one sample, in readings, before it is rounded.
        samples : int
            Of each pose.

        Returns
        -------
        ndarray, shape (n, samples, C)
            Whole numbers where the channel counts.
        """
        shape = (len(exact), samples, exact.shape[1])
        read = np.broadcast_to(exact[:, None], shape)
        if noise > 0:
            read = read + noise * rng.standard_normal(shape)
        counted = np.array([c.unit == "count" for c in self.mechanism.channels])
        read = np.where(counted, np.round(read), read)
        return np.clip(read, *_ranges(self.mechanism))

    def truth(self) -> dict[str, Any]:
        """Offsets and gains by channel, as `truth.json` has them."""
        names = [c.name for c in self.mechanism.channels]
        return {
            "off": dict(zip(names, self.offsets.tolist(), strict=True)),
            "gain": dict(zip(names, self.gains.tolist(), strict=True)),
        }


@dataclass(frozen=True, eq=False)
class Simulated:
    """A session of a simulated device.

    Attributes
    ----------
    device : Device
        The truth.
    readings : Readings
        Held poses in the order in which they were visited; true poses are not among the columns.
    rest : Readings or None
        Samples of the rest pose, for a mechanism that has one.
    check : Readings
        Other poses, with the true pose of the platform.
    truth : dict
        What `truth.json` holds.
    """

    device: Device
    readings: Readings
    rest: Readings | None
    check: Readings
    truth: dict[str, Any]

    def save(self, folder: PathLike) -> list[Path]:
        """Write readings.csv, rest.csv, check.csv, truth.json and mechanism.toml.

        Parameters
        ----------
        folder : path
            Made if it is not there.

        Returns
        -------
        list of Path
            The files.

        Raises
        ------
        InputError
            One cannot write there.
        """
        folder = Path(folder)
        try:
            folder.mkdir(parents=True, exist_ok=True)
        except OSError as error:
            found = f"'{folder}', which cannot be a folder ({error.strerror})"
            raise InputError(f"found {found}, expected a place for files") from None
        files = []
        for name in ("readings", "rest", "check"):
            table: Readings | None = getattr(self, name)
            if table is not None:
                table.to_csv(folder / f"{name}.csv")
                files.append(folder / f"{name}.csv")
        files.append(write_text(folder / "truth.json", to_json(self.truth)))
        files.append(write_text(folder / "mechanism.toml", self.device.mechanism.to_toml()))
        return files


def nominal(mechanism: Mechanism) -> tuple[FloatArray, FloatArray]:
    """Offsets and gains as the mechanism declares them, each of shape (C,)."""
    channels = mechanism.channels
    return np.array([c.offset for c in channels]), np.array([c.gain for c in channels])


def workspace(mechanism: Mechanism, within: Within | None) -> FloatArray:
    """The bounds of a workspace, given or known: shape (6, 2)."""
    if within is None:
        if mechanism.name not in WITHIN:
            raise InputError(
                f"found no workspace of {mechanism.name!r}, expected `within`: "
                "lowest and highest x, y, z, rx, ry, rz"
            )
        within = WITHIN[mechanism.name]
    bounds = np.array(within, dtype=np.float64)
    if bounds.shape != (6, 2) or not np.all(bounds[:, 0] <= bounds[:, 1]):
        found = f"{bounds.tolist()}"
        raise InputError(f"within: found {found}, expected six pairs, the lower end first")
    return bounds


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
        Whose reach, joint limits and ranges count.
    count : int
        How many.
    rng : numpy.random.Generator
        Where chance comes from.
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


def simulate(
    out: PathLike | None = None,
    mechanism: MechanismArg = "rsi",
    *,
    poses: int = 48,
    samples: int = 8,
    noise: float = 1.0,
    check: int = 20,
    within: Within | None = None,
    device: Device | None = None,
    seed: int = 0,
) -> Simulated:
    """Simulate a session of a device with a known truth.

    Parameters
    ----------
    out : path, optional
        Folder to write readings.csv, rest.csv, check.csv, truth.json and mechanism.toml to.
    mechanism : str, path or Mechanism
        With a platform, so that its poses can be drawn.
    poses, check : int
        Held poses, and other poses to check against.
    samples : int
        Of each pose.
    noise : float
        Standard deviation of one sample, in readings, before it is rounded.
    within : six pairs, optional
        Box that poses are drawn from; the hand controller's own workspace by default.
    device : Device, optional
        The truth; drawn from the seed by default.
    seed : int
        Same seed, same files.

    Returns
    -------
    Simulated
        Device, readings, rest, check and truth.

    Raises
    ------
    InputError
        A number cannot be used, or the box cannot be reached.

    Examples
    --------
    >>> made = simulate(poses=30, seed=1)
    >>> made.readings.n_poses, len(made.readings)
    (30, 240)
    """
    for name, value, least in (("poses", poses, 1), ("samples", samples, 1), ("check", check, 1)):
        if value < least:
            raise InputError(f"{name}: found {value}, expected at least {least}")
    if not (np.isfinite(noise) and noise >= 0):
        raise InputError(f"noise: found {noise}, expected a number of readings, 0 or more")
    rng = np.random.default_rng(seed)
    device = device or Device.drawn(open_mechanism(mechanism), rng)
    _, exact = draw_poses(device, poses, rng, within=within)
    elsewhere, exact_check = draw_poses(device, check, rng, within=within)
    rest = None
    declared = device.mechanism.to_dict().get("rest")
    if declared is not None:
        at_rest = device.readings([declared["pose"]])
        rest = _session(device, at_rest, rng, noise, samples, source="rest", start=-60.0)
    readings = _session(device, exact, rng, noise, samples, source="readings")
    checked = _session(
        device, exact_check, rng, noise, samples, source="check", known=elsewhere,
        start=60.0 + POSE_S * poses,
    )  # fmt: skip
    truth = {
        "simulator": f"rsicalib {_core.__version__}",
        "mechanism": device.mechanism.name,
        "seed": seed,
        "noise": noise,
        "effect": None,
        **device.truth(),
    }
    made = Simulated(device, readings, rest, checked, truth)
    if out is not None:
        made.save(out)
    return made


def _session(
    device: Device,
    exact: FloatArray,
    rng: np.random.Generator,
    noise: float,
    samples: int,
    *,
    source: str,
    known: FloatArray | None = None,
    start: float = 0.0,
) -> Readings:
    """Held poses as a table of readings."""
    count = len(exact)
    read = device.sample(exact, rng, noise=noise, samples=samples)
    pose, sample = np.divmod(np.arange(count * samples), samples)
    return Readings.from_arrays(
        device.mechanism,
        read.reshape(count * samples, -1),
        pose=pose + 1,
        sample=sample + 1,
        time_s=np.round(start + POSE_S * pose + SAMPLE_S * sample, 3),
        poses=None if known is None else np.repeat(known, samples, axis=0),
        source=source,
    )


def _ranges(mechanism: Mechanism) -> tuple[FloatArray, FloatArray]:
    ends = [c.range if c.range is not None else (-np.inf, np.inf) for c in mechanism.channels]
    low, high = np.array(ends, dtype=np.float64).T
    return low, high
