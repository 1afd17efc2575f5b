"""Which poses to visit: the Cramér-Rao bound, and poses chosen to make it small."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np
import numpy.typing as npt

from rsicalib import _core, options
from rsicalib.arrays import FloatArray
from rsicalib.devices import Within, workspace
from rsicalib.io.files import write_text
from rsicalib.measures import counts_of, known_sd, parameters_of
from rsicalib.plots import on_axes, scatter
from rsicalib.records import Record
from rsicalib.tabular import Tabular
from rsicalib.work.arguments import (
    CalibrationArg,
    MechanismArg,
    PathLike,
    ReadingsArg,
    open_mechanism,
)

if TYPE_CHECKING:
    from matplotlib.axes import Axes

__all__ = ["CRITERIA", "Bound", "Plan", "bound", "plan"]

CRITERIA = _core.CRITERIA
"""What is made small: variance of the offsets (A-optimal), of the joint coordinates averaged over
the workspace (I-optimal), or the volume of the confidence ellipsoid (D-optimal)."""

POSE = ("x", "y", "z", "rx", "ry", "rz")


@dataclass(frozen=True)
class Bound(Record):
    """The least uncertainty that any unbiased estimate from these poses can have.

    Attributes
    ----------
    noise : float
        Standard deviation of one reading that it is for; it grows in proportion.
    offset_sd : ndarray, shape (C,)
        Bound of the offsets, at reading zero [rad]; NaN where the poses do not determine it.
    gain_sd : ndarray, shape (C,)
        Bound of the gains [rad/reading].
    joint_sd : ndarray, shape (C,)
        Bound of the joint coordinates, root mean square over the poses [rad].
    """

    noise: float
    offset_sd: FloatArray
    gain_sd: FloatArray
    joint_sd: FloatArray

    @property
    def offset_rms(self) -> float:
        """Root mean square of `offset_sd` [rad]; infinite where one is not determined."""
        return _rms(self.offset_sd)

    @property
    def gain_rms(self) -> float:
        """Root mean square of `gain_sd` [rad/reading]."""
        return _rms(self.gain_sd)

    @property
    def joint_rms(self) -> float:
        """Root mean square of `joint_sd` [rad]."""
        return _rms(self.joint_sd)


@dataclass(frozen=True, repr=False)
class Plan(Tabular, Record):
    """Poses to visit.

    Attributes
    ----------
    mechanism, length_unit : str
        Name of the mechanism, and the unit of x, y, z.
    criterion : str
        Criterion that was minimised.
    seed : int
        Seed of the candidates.
    poses : ndarray, shape (n, 6)
        `x y z` [length unit], `rx ry rz` [rad], in an order of short ways.
    readings : ndarray, shape (n, C)
        What the channels should read there, about.
    bound : Bound
        Bound with these poses and those visited already.
    before : Bound or None
        Bound with only the poses visited already.
    """

    mechanism: str
    length_unit: str
    criterion: str
    seed: int
    poses: FloatArray
    readings: FloatArray
    bound: Bound
    before: Bound | None = None

    def plot(self, *, ax: Axes | None = None) -> Axes:
        """Draw where the poses are in x and z, coloured by their order; needs matplotlib.

        Parameters
        ----------
        ax : Axes, optional
            Where to; a new figure where not given.

        Returns
        -------
        Axes
            With a colour bar beside it.
        """
        order = np.arange(1.0, len(self.poses) + 1)
        names = (f"x [{self.length_unit}]", f"z [{self.length_unit}]", "pose")
        ax = on_axes(ax, figsize=(6, 5))
        ax.plot(self.poses[:, 0], self.poses[:, 2], color="0.8", lw=0.8, zorder=0)
        return scatter(ax, self.poses[:, 0], self.poses[:, 2], order, names)

    def _table(self) -> dict[str, Any]:
        columns: dict[str, Any] = {"pose": range(1, len(self.poses) + 1)}
        return columns | {name: self.poses[:, k] for k, name in enumerate(POSE)}

    def __repr__(self) -> str:
        return (
            f"<Plan of {self.mechanism!r}: {len(self.poses)} poses, offsets to "
            f"{self.bound.offset_rms:.2g} rad per {self.bound.noise:g} of noise>"
        )

    def csv(self) -> str:
        """The poses as CSV: pose, x, y, z, rx, ry, rz."""
        lines = [",".join(("pose", *POSE))]
        for k, pose in enumerate(self.poses, start=1):
            lines.append(",".join([str(k), *(f"{v:.4f}" for v in pose)]))
        return "\n".join(lines) + "\n"

    def save(self, path: PathLike) -> None:
        """Write the poses as CSV.

        Parameters
        ----------
        path : path
            Path of the file.
        """
        write_text(path, self.csv())

    def text(self) -> str:
        """The poses for people, in degrees, and the bound."""
        unit = self.length_unit
        lines = [
            f"pose {'x':>8s} {'y':>8s} {'z':>8s} [{unit}] {'rx':>7s} {'ry':>7s} {'rz':>7s} [°]"
        ]
        for k, pose in enumerate(self.poses, start=1):
            place = " ".join(f"{v:8.2f}" for v in pose[:3])
            turn = " ".join(f"{math.degrees(v):7.1f}" for v in pose[3:])
            lines.append(f"{k:4d} {place} {' ' * (len(unit) + 2)} {turn}")
        of = f"per {self.bound.noise:g} of noise in a reading, one reading of each pose"
        lines += ["", f"least standard deviation {of}:"]
        lines.append(f"  offsets {self.bound.offset_rms:.2g} rad")
        lines.append(f"  gains {self.bound.gain_rms:.2g} rad/reading")
        lines.append(f"  joint coordinates at these poses {self.bound.joint_rms:.2g} rad")
        if self.before is not None:
            lines.append(f"  offsets without these poses {self.before.offset_rms:.2g} rad")
        return "\n".join(lines) + "\n"


def bound(
    poses: npt.ArrayLike,
    mechanism: MechanismArg = "rsi",
    *,
    noise: float = 1.0,
    calibration: CalibrationArg | None = None,
) -> Bound:
    """Find the Cramér-Rao bound for poses that are to be visited.

    Parameters
    ----------
    poses : array_like, shape (n, 6)
        `x y z` [length unit], `rx ry rz` [rad].
    mechanism : str, path or Mechanism
        With a platform.
    noise : float
        Standard deviation of one reading, quantisation included; of an average of n, 1/√n of it.
    calibration : path, Calibration or Trace, optional
        Result that gives the offsets and gains; the mechanism's own by default.

    Returns
    -------
    Bound
        Bound for any unbiased estimator.

    Raises
    ------
    InputError
        A pose is out of reach.

    Examples
    --------
    >>> up = [[0, 0, -1.3, a, b, 0] for a in (-0.5, 0.5) for b in (-0.5, 0.5)]
    >>> down = [[x, y, -4.0, 0, 0, c] for x in (-1, 1) for y in (-1, 1) for c in (-0.5, 0.5)]
    >>> bound(up + down).offset_rms < 0.05
    True
    """
    opened = open_mechanism(mechanism)
    wanted = np.ascontiguousarray(poses, dtype=np.float64).reshape(-1, 6)
    return _bound(noise, _core.bound_at(opened, *parameters_of(calibration, opened), wanted, noise))


def plan(
    mechanism: MechanismArg = "rsi",
    poses: int = 12,
    *,
    beside: ReadingsArg | None = None,
    within: Within | None = None,
    noise: float = 1.0,
    criterion: str = "offsets",
    calibration: CalibrationArg | None = None,
    candidates: int = 3000,
    starts: int = 4,
    seed: int = 0,
) -> Plan:
    """Choose poses that tell most about offsets and gains.

    Candidates are drawn from a box, within reach, joint limits and ranges; from several starts,
    poses are exchanged for candidates until no exchange helps, and the best plan is kept.

    Parameters
    ----------
    mechanism : str, path or Mechanism
        With a platform.
    poses : int
        Number of poses to visit.
    beside : path, Readings or array_like of shape (n, C), optional
        Readings of poses that are visited already: the plan complements them.
    within : six pairs, optional
        Lowest and highest x, y, z [length unit], rx, ry, rz [rad]; for the hand controller
        ±3 in, z -5.7 to -0.3, ±30°.
    noise : float
        Standard deviation of one reading, quantisation included: scales the bound, not the plan.
    criterion : {"offsets", "joints", "volume"}
        What is made small: see `CRITERIA`.
    calibration : path, Calibration or Trace, optional
        Result that gives the offsets and gains; the mechanism's own by default.
    candidates, starts : int
        Number of candidate poses, and of searches from different starts.
    seed : int
        Same seed, same plan.

    Returns
    -------
    Plan
        Poses with the bound that they reach.

    Raises
    ------
    InputError
        The box is unknown or out of reach, or a number cannot be used.

    Examples
    --------
    >>> plan(poses=12).bound.offset_rms < 0.0056
    True
    """
    opened = open_mechanism(mechanism)
    found = _core.plan(
        opened,
        *parameters_of(calibration, opened),
        poses=poses,
        beside=None if beside is None else counts_of(beside, opened),
        within=workspace(opened, within).tolist(),
        noise=noise,
        criterion=criterion,
        candidates=candidates,
        starts=starts,
        seed=options.seed(seed),
    )
    return Plan(
        opened.name,
        opened.length_unit,
        criterion,
        seed,
        found["poses"],
        found["readings"],
        _bound(noise, found["bound"]),
        None if found["before"] is None else _bound(noise, found["before"]),
    )


def _bound(noise: float, found: Mapping[str, Sequence[float]]) -> Bound:
    return Bound(noise, *(known_sd(found[name]) for name in ("offset_sd", "gain_sd", "joint_sd")))


def _rms(values: FloatArray) -> float:
    if not np.isfinite(values).all():
        return math.inf
    return float(np.sqrt(np.mean(values**2)))
