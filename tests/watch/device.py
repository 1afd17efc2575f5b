"""A hand controller at work, calibrated before: the device of `tests.blind`, in motion for hours.

Everything that happens to it happens here, in plain numpy: the core sees readings only.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any

import numpy as np
from scipy.signal import lfilter

import rsicalib
from rsicalib.io.readings import Readings
from tests.blind import simulator
from tests.blind.geometry import A, D, Geometry, inverse
from tests.blind.simulator import CHANNELS, Device
from tests.oracle import Array

RATE_HZ = 400.0
"""Samples per second at work."""

NOISES = (
    "white",
    "tremor",
    "correlated",
    "correlated_3",
    "correlated_8",
    "creeping",
    "t5",
    "t3",
    "steps",
)
"""`creeping`: offsets go to and fro slowly; `t5`, `t3`: Student's t; `steps`: 4 counts each."""

CORRELATION = {"correlated": 0.6, "correlated_3": 0.3, "correlated_8": 0.8}
"""Of neighbouring samples where noise is correlated, before rounding."""

STEP = 4.0
"""Counts of a coarse converter."""

CREEP = (0.5, 3600.0)
"""Amplitude [counts] and period [s] of offsets that creep, each with a phase of its own."""

TREMOR = (0.01, 0.01)
"""Standard deviation of a trembling hand from sample to sample (in, rad)."""


def noise_of(kind: str, rng: np.random.Generator, rows: int, start: Array | None) -> Array:
    """Noise of unit variance, (rows, 9), following the last row `start` (9,) if correlated."""
    if kind in ("t5", "t3"):
        dof = float(kind[1])
        heavy: Array = rng.standard_t(dof, (rows, 9)) * np.sqrt((dof - 2.0) / dof)
        return heavy
    white = rng.standard_normal((rows, 9))
    if kind not in CORRELATION:
        return white
    neighbour = CORRELATION[kind]
    fresh = np.sqrt(1.0 - neighbour**2)
    before = rng.standard_normal(9) if start is None else start
    driven = fresh * white
    start = neighbour * before[None]
    out: Array = lfilter([1.0], [1.0, -neighbour], driven, axis=0, zi=start)[0]
    return out


def read(kind: str, counts: Array) -> Array:
    """What the converter makes of counts, (n, 9)."""
    step = STEP if kind == "steps" else 1.0
    return np.clip(step * np.rint(counts / step), 0, simulator.TOP)


@dataclass(frozen=True)
class Motion:
    """Sinusoids without a common period in each coordinate, within the workspace."""

    frequency: Array
    phase: Array
    weight: Array

    @classmethod
    def draw(cls, rng: np.random.Generator, device: Device) -> Motion:
        """A motion that stays within reach, limits and the converter's range."""
        while True:
            own = cls(
                rng.uniform(0.1, 0.8, (3, 6)),
                rng.uniform(0.0, 2 * np.pi, (3, 6)),
                rng.dirichlet(np.ones(3), 6).T,
            )
            if device.allows(own.pose(np.arange(20_000) / 20.0)).all():
                return own

    def pose(self, time: Array) -> Array:
        """Handle poses, (n, 6), at times [s]."""
        centre = np.array([0.0, 0.0, -2.9, 0.0, 0.0, 0.0])
        half = np.array([1.6, 1.6, 1.2, 0.36, 0.36, 0.36])
        angle = 2 * np.pi * self.frequency * time[:, None, None] + self.phase
        out: Array = centre + half * (self.weight * np.sin(angle)).sum(axis=1)
        return out


@dataclass(frozen=True)
class Change:
    """What happens at work: an offset [rad] that a channel takes on, or a length of an arm [in].

    `since` is a row. With `per_row` it grows from there, by so much in each row, up to `size`. An
    arm changes along an `axis`: the length of its upper arm, the offset of its elbow, a forearm
    bent out of the plane in which it swings, or one bent within that plane. This last one turns
    the forearm about its joint, as a slip of the joint's sensor does: no reading tells the two.
    """

    target: str
    size: float
    since: int = 0
    per_row: float | None = None
    axis: str = "offset"

    @property
    def names(self) -> frozenset[str]:
        """The targets of an alarm that are right."""
        same = {f"a{self.target[3]}3"} if self.axis == "in_plane" else set()
        return frozenset({self.target} | same)

    def share(self, rows: Array) -> Array:
        """How much of it is there, 0 to 1, (n,)."""
        age = rows - self.since
        if self.per_row is None:
            return (age >= 0).astype(float)
        return np.clip(age * abs(self.per_row / self.size), 0.0, 1.0)

    def geometry(self, geometry: Geometry, share: float) -> Geometry:
        """The geometry with that share of the change."""
        arm, by = int(self.target[3]) - 1, share * self.size
        if self.axis in ("forearm", "in_plane"):
            tips = geometry.tips.copy()
            tips[arm, 2 if self.axis == "forearm" else 1] += by
            return geometry.with_values(tips=tips)
        return geometry.with_row(arm, 1, {"upper_arm": A, "elbow": D}[self.axis], by)


@dataclass
class Work:
    """A device at work; `rows` gives what a converter reads, row after row."""

    device: Device
    rng: np.random.Generator
    kind: str = "white"
    sigma: float = 1.0
    change: Change | None = None
    motion: Motion = field(init=False)
    row: int = 0
    last: Array | None = None

    def __post_init__(self) -> None:
        self.motion = Motion.draw(self.rng, self.device)

    def rows(self, count: int) -> Array:
        """The next rows, (count, 9)."""
        at = np.arange(self.row, self.row + count)
        pose = self.motion.pose(at / RATE_HZ)
        if self.kind == "tremor":
            pose = pose + self.rng.standard_normal(pose.shape) * np.repeat(TREMOR, 3)
        angles = self._angles(pose, at)
        noise = noise_of(self.kind, self.rng, count, self.last)
        self.row, self.last = self.row + count, noise[-1]
        counts = (angles - self.device.offsets) / self.device.gains + self.sigma * noise
        if self.kind == "creeping":
            size, period = CREEP
            turn = 2 * np.pi * (at[:, None] / (RATE_HZ * period) + np.arange(9) / 9.0)
            counts += size * (np.sin(turn) - np.sin(2 * np.pi * np.arange(9) / 9.0))
        return read(self.kind, counts)

    def _angles(self, pose: Array, at: Array) -> Array:
        angles = inverse(self.device.geometry, pose).reshape(-1, 9)
        if self.change is None:
            return angles
        share = self.change.share(at)
        if self.change.axis == "offset":
            # The sensor says less by what its offset has gained.
            angles[:, CHANNELS.index(self.change.target)] -= share * self.change.size
            return angles
        for part in np.unique(np.round(share[share > 0], 3)):
            rows = np.round(share, 3) == part
            built = self.change.geometry(self.device.geometry, part)
            angles[rows] = inverse(built, pose[rows]).reshape(-1, 9)
        return angles


def calibrated(
    seed: int | list[int], kind: str = "white", poses: int = 48, samples: int = 8
) -> tuple[Device, rsicalib.Calibration, np.random.Generator]:
    """A random device, its calibration from held poses, and the generator to go on with."""
    rng = np.random.default_rng(seed)
    device = Device.random(rng)
    session = simulator.session(
        device,
        rng,
        simulator.hand_poses(rng, poses, device),
        samples,
        sigma=1.0,
        tremor=TREMOR if kind == "tremor" else (0.0, 0.0),
    )
    if kind not in ("white", "tremor", "creeping"):
        ideal = device.ideal(session["scene"])
        noise = np.concatenate([noise_of(kind, rng, samples, None) for _ in range(poses)])
        session["values"] = read(kind, ideal + noise).astype(np.int64)
    rest = simulator.rest(device, rng)
    found = rsicalib.calibrate(readings_of(session), rest=readings_of(rest))
    return device, found, rng


def readings_of(session: dict[str, Any]) -> Readings:
    """A session as the package takes it."""
    return Readings.from_arrays(
        rsicalib.load_mechanism(),
        session["values"].astype(float),
        pose=session["pose"],
        time_s=session["time_s"],
    )
