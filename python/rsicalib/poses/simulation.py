"""Sessions of a device with a known truth: joint readings with noise, averaging and rounding.

For the experiments of the paper and for a first try. A simulated device is exactly the model
`[offset, gain]`: with it a fit can only agree with itself, so effects that a model lacks are
simulated elsewhere, by code that shares nothing with this package (`tests/blind`).
"""

from __future__ import annotations

import hashlib
from dataclasses import dataclass
from typing import Any, ClassVar

import numpy as np

from rsicalib import _core, options
from rsicalib._core import Mechanism
from rsicalib.arrays import Alike, FloatArray
from rsicalib.errors import InputError
from rsicalib.facts.records import to_json
from rsicalib.io.folders import MARK, TRUTH, Sealed
from rsicalib.io.readings import Readings
from rsicalib.plain_text import counted
from rsicalib.poses.devices import Device, Within, draw_poses
from rsicalib.units import is_count
from rsicalib.work.arguments import MechanismArg, PathLike, open_mechanism

POSE_S, SAMPLE_S = 15.0, 0.02
"""Between two held poses, and between two samples of one [s]."""


@dataclass(frozen=True, eq=False, repr=False)
class Simulated(Alike, Sealed):
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

    SEAL: ClassVar[str] = TRUTH

    device: Device
    readings: Readings
    rest: Readings | None
    check: Readings
    truth: dict[str, Any]

    def __repr__(self) -> str:
        name, seed = self.device.mechanism.name, self.truth["seed"]
        return f"<Simulated {name!r}, seed {seed}: {counted(self.readings.n_poses, 'pose')}>"

    def _repr_html_(self) -> str | None:
        return self.readings._repr_html_()

    def files(self) -> dict[str, str]:
        """Texts of readings.csv, rest.csv, check.csv, mechanism.toml and truth.json."""
        tables = {
            f"{name}.csv": table.csv()
            for name in ("readings", "rest", "check")
            if (table := getattr(self, name)) is not None
        }
        version = _core.__version__
        digests = {name: hashlib.sha256(text.encode()).hexdigest() for name, text in tables.items()}
        truth = {"format": "rsicalib.truth/1", "version": version, "files": digests, **self.truth}
        mechanism = f"# {MARK} {version}\n{self.device.mechanism.to_toml()}"
        return {**tables, TRUTH: to_json(truth), "mechanism.toml": mechanism}


@options.checked
def simulate(
    out: PathLike | None = None,
    mechanism: MechanismArg = "rsi",
    *,
    poses: int = 48,
    samples: int = 8,
    noise: float | None = None,
    check: int = 20,
    within: Within | None = None,
    device: Device | None = None,
    seed: int = 0,
    force: bool = False,
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
        Number of samples of each pose.
    noise : float, optional
        Standard deviation of one sample, in readings, before it is rounded. Where not given what
        the mechanism declares of each channel; of a channel that counts 1.
    within : six pairs, optional
        Box that poses are drawn from; the hand controller's own workspace by default.
    device : Device, optional
        The truth; drawn from the seed by default.
    seed : int
        Same seed, same files.
    force : bool
        Replace files in `out` that this package did not write as well.

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
    options.rows(poses + check, samples)
    rng = np.random.default_rng(seed)
    device = device or Device.drawn(open_mechanism(mechanism), rng)
    sigma = _noise(noise, device.mechanism)
    _, exact = draw_poses(device, poses, rng, within=within)
    elsewhere, exact_check = draw_poses(device, check, rng, within=within)
    rest = None
    declared = device.mechanism.to_dict().get("rest")
    if declared is not None:
        at_rest = device.readings([declared["pose"]])
        rest = _session(device, at_rest, rng, sigma, samples, source="rest", start=-60.0)
    readings = _session(device, exact, rng, sigma, samples, source="readings")
    checked = _session(
        device, exact_check, rng, sigma, samples, source="check", known=elsewhere,
        start=60.0 + POSE_S * poses,
    )  # fmt: skip
    truth = {
        "simulator": f"rsicalib {_core.__version__}",
        "mechanism": device.mechanism.name,
        "seed": seed,
        "noise": _told(sigma, device.mechanism),
        "effect": None,
        **device.truth(),
    }
    made = Simulated(device, readings, rest, checked, truth)
    if out is not None:
        made.save(out, force=force)
    return made


def _noise(noise: float | None, mechanism: Mechanism) -> FloatArray:
    """Standard deviation of one sample of each channel, in its readings: (C,)."""
    channels = mechanism.channels
    if noise is not None:
        options.noise_of(noise, channels, "simulate.noise")
        return np.full(len(channels), float(noise))
    unknown = [c for c in channels if c.noise is None and not is_count(c.unit)]
    if unknown:
        found = f"none declared of {unknown[0].name}, which reads {unknown[0].unit}"
        raise InputError(f"noise: found {found}, expected one (--noise)")
    return np.array([1.0 if c.noise is None else c.noise for c in channels])


def _told(sigma: FloatArray, mechanism: Mechanism) -> float | dict[str, float]:
    """The noise as `truth.json` has it: one number, or one for each channel."""
    if len({*sigma.tolist()}) == 1:
        return float(sigma[0])
    return dict(zip((c.name for c in mechanism.channels), sigma.tolist(), strict=True))


def _session(
    device: Device,
    exact: FloatArray,
    rng: np.random.Generator,
    noise: FloatArray,
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
