"""Poses to visit: what they are, what they bring, and how they are written."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import field
from typing import TYPE_CHECKING, Any

import numpy as np

from rsicalib.arrays import Alike, FloatArray
from rsicalib.facts.records import IF_KNOWN, OMIT, Record
from rsicalib.facts.shapes import Rms
from rsicalib.io.cells import POSE
from rsicalib.io.csv_text import csv_of
from rsicalib.io.files import write_text
from rsicalib.plain_text import counted
from rsicalib.plots import on_axes, scatter
from rsicalib.tabular import Tabular
from rsicalib.work.arguments import PathLike

if TYPE_CHECKING:
    from matplotlib.axes import Axes


class Bound(Alike, Record, eq=False):
    """The least uncertainty that any unbiased estimate from these poses can have."""

    noise: float
    """Standard deviation of one reading that it is for; it grows in proportion."""
    offset_sd: FloatArray
    """Bound of the offsets, at reading zero [rad]; NaN where the poses do not determine it."""
    gain_sd: FloatArray
    """Bound of the gains [rad/reading]."""
    joint_sd: FloatArray
    """Bound of the joint coordinates, root mean square over the poses [rad]."""

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


class Spread(Record):
    """Standard deviation of the platform before and after a plan."""

    before: Rms
    """Now."""
    after: Rms
    """With the poses of the plan."""


class WorstHidden(Record):
    """An absent effect, and what it does to the platform at the size that just shows."""

    term: str
    """Id of the term."""
    target: str
    """What the term belongs to."""
    platform_rms: Rms
    """What it does to the platform [length unit, rad]."""


class Hidden(Record):
    """The worst effect that could be there unseen, before and after a plan."""

    before: WorstHidden | None
    """Now; None where nothing can hide."""
    after: WorstHidden | None
    """With the poses of the plan."""


class Forecast(Record):
    """What is to be expected of a plan."""

    decides: float | None
    """Probability that the right explanation is decided for; None where nothing is open."""
    least_lambda: float | None
    """By how much χ² of a wrong explanation is expected to grow beyond that of the right one, the
    least of all pairs."""
    platform_sd: Spread | None
    """Standard deviation of the platform over the workspace by the parameters, of the carried
    point without a platform. What no pose could show is held; None inside where the readings do
    not show something that matters there."""
    worst_hidden: Hidden
    """The worst effect that could be there unseen."""


class Plan(Alike, Tabular, Record, eq=False, repr=False):
    """Poses to visit."""

    mechanism: str
    """Name of the mechanism."""
    length_unit: str
    """Unit of every length."""
    criterion: str
    """Criterion that was minimised."""
    seed: int
    """Seed of the candidates."""
    channels: tuple[str, ...]
    """Names of the columns of `readings`."""
    poses: FloatArray
    """`x y z` [length unit], `rx ry rz` [rad], in the order of the visits; shape (0, 6) without a
    platform."""
    readings: FloatArray
    """What the channels should read there, about."""
    why: tuple[str, ...]
    """What each pose is visited for."""
    bound: Bound | None = field(default=None, metadata=IF_KNOWN)
    """Bound with these poses and those visited already, by the offsets and gains alone."""
    before: Bound | None = None
    """Bound with only the poses visited already."""
    keys: dict[str, tuple[str, ...]] = field(default_factory=dict, metadata=OMIT)
    """Columns that tell unknown points apart: `group`, `at`."""
    waits: tuple[float, ...] = field(default=(), metadata=OMIT)
    """Pause before each pose, as a share of the session; empty where none is planned."""
    first: int = 1
    """Label of the first pose."""
    merged: tuple[str, ...] = field(default=(), metadata=OMIT)
    """Explanations that no pose tells apart, in words."""
    forecast: Forecast | None = field(default=None, metadata=IF_KNOWN)
    """What is to be expected, beside a result."""
    advice: tuple[str, ...] = field(default=(), metadata=OMIT)
    """What poses cannot do, and what would: in sentences."""

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
        columns: dict[str, Any] = {"pose": range(self.first, self.first + len(self.readings))}
        if len(self.poses):
            return columns | {name: self.poses[:, k] for k, name in enumerate(POSE)}
        readings = {name: self.readings[:, k] for k, name in enumerate(self.channels)}
        return columns | self.keys | readings

    def __repr__(self) -> str:
        what = f"{counted(len(self.readings), 'pose')} for {self.criterion}"
        if self.bound is not None:
            what += (
                f", offsets to {self.bound.offset_rms:.2g} rad per {self.bound.noise:g} of noise"
            )
        return f"<Plan of {self.mechanism!r}: {what}>"

    def csv(self) -> str:
        """The poses as CSV: pose, x … rz (without a platform group, at), channels, why."""
        number = range(self.first, self.first + len(self.why))
        place = _cells(POSE, self.poses, ".4f") if len(self.poses) else self.keys
        cells = _cells(self.channels, self.readings, ".6g")
        return csv_of({"pose": number, **place, **cells, "why": self.why})

    def save(self, path: PathLike) -> None:
        """Write the poses as CSV.

        Parameters
        ----------
        path : path
            Path of the file.
        """
        write_text(path, self.csv())

    def text(self) -> str:
        """The poses for people, in degrees, and what is to be expected."""
        lines = [*self.advice, *[""] * bool(self.advice)]
        lines += [self._head()] if len(self.readings) else []
        for k, why in enumerate(self.why):
            reason = "" if self.forecast is None else f"  {why}"
            lines.append(f"{self.first + k:4d} {self._place(k)}{reason}".rstrip())
        for heading, below in self.brings():
            indent = "  " if heading else ""
            lines += ["", *([f"{heading}:"] if heading else []), *(indent + line for line in below)]
        return "\n".join(lines) + "\n"

    def brings(self) -> list[tuple[str, list[str]]]:
        """What the poses bring: lines, and the heading that they stand below, if they have one."""
        parts = [("", list(self.merged))] if self.merged else []
        if self.bound is not None:
            parts.append(_bound_lines(self.bound, self.before))
        if self.forecast is not None:
            parts.append(_forecast_lines(self.forecast, self.length_unit))
        return parts

    def _head(self) -> str:
        if len(self.poses):
            unit = self.length_unit
            place = f"{'x':>8s} {'y':>8s} {'z':>8s} [{unit}] {'rx':>7s} {'ry':>7s} {'rz':>7s} [°]"
            return f"pose {place}"
        return f"pose {', '.join(self.keys)}: {', '.join(self.channels)}"

    def _place(self, k: int) -> str:
        if len(self.poses):
            pose = self.poses[k]
            place = " ".join(f"{v:8.2f}" for v in pose[:3])
            turn = " ".join(f"{math.degrees(v):7.1f}" for v in pose[3:])
            return f"{place} {' ' * (len(self.length_unit) + 2)} {turn}   "
        keys = ", ".join(column[k] for column in self.keys.values())
        return f"{keys}: {' '.join(f'{v:.5g}' for v in self.readings[k])}"


def _cells(names: Sequence[str], values: FloatArray, digits: str) -> dict[str, list[str]]:
    """Columns of a table by name, written with so many digits."""
    columns = zip(names, np.reshape(values, (-1, len(names))).T, strict=True)
    return {name: [format(v, digits) for v in column] for name, column in columns}


def _bound_lines(bound: Bound, before: Bound | None) -> tuple[str, list[str]]:
    of = f"per {bound.noise:g} of noise in a reading, one reading of each pose"
    lines = [
        f"offsets {bound.offset_rms:.2g} rad",
        f"gains {bound.gain_rms:.2g} rad/reading",
        f"joint coordinates at these poses {bound.joint_rms:.2g} rad",
    ]
    if before is not None:
        lines.append(f"offsets without these poses {before.offset_rms:.2g} rad")
    return f"least standard deviation {of}", lines


def _forecast_lines(forecast: Forecast, unit: str) -> tuple[str, list[str]]:
    lines = []
    if forecast.decides is not None:
        lines.append(f"the right explanation is decided for in {forecast.decides:.0%}")
        lines.append(f"least λ {forecast.least_lambda:.3g} (12 is a decision, 25 a safe one)")
    if forecast.platform_sd is not None:
        sd = forecast.platform_sd
        before, after = _size(sd.before, unit), _size(sd.after, unit)
        lines.append(f"standard deviation of the platform {before} → {after}")
    hidden = forecast.worst_hidden
    if hidden.before is not None and hidden.after is not None:
        words = [
            f"{h.term} {h.target} ({_size(h.platform_rms, unit)})"
            for h in (hidden.before, hidden.after)
        ]
        lines.append(f"the worst that could hide: {words[0]} → {words[1]}")
    return "to be expected with these poses", lines


def _size(rms: Rms, unit: str) -> str:
    known = rms.position is not None and math.isfinite(rms.position)
    return f"{rms.position:.2g} {unit}" if known else "unknown"


def _rms(values: FloatArray) -> float:
    if not np.isfinite(values).all():
        return math.inf
    return float(np.sqrt(np.mean(values**2)))
