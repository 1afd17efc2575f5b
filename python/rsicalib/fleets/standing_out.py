"""Devices that stand out of a fleet, and why: the core says which, and by what."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from rsicalib import _core
from rsicalib.arrays import FloatArray, IntArray
from rsicalib.facts.verdicts import EXIT_CODES
from rsicalib.fleets.frames import numbers_of


@dataclass(frozen=True)
class Remark:
    """A device that stands out: the more, the larger `size` (standard deviations).

    `parameter` is the column that stands out; empty where the verdict does.
    """

    device: Any
    size: float
    verdict: str
    why: str
    parameter: str = ""


@dataclass(frozen=True)
class Spread:
    """One parameter over a fleet.

    Attributes
    ----------
    name : str
        Its column.
    median : float
        Over the devices, in the parameter's unit, as are all of these.
    between : float
        Standard deviation between devices, robust: 1.4826 times the median distance from the
        median.
    within : float
        Median standard deviation of the estimate of one device.
    devices : int
        How many devices these are.
    furthest : tuple of int and float
        The device that is farthest from the median, and how far.
    """

    name: str
    median: float
    between: float
    within: float
    devices: int
    furthest: tuple[int, float]

    @property
    def usual(self) -> tuple[float, float, float, int]:
        """What the core compares devices with."""
        return self.median, self.between, self.within, self.devices

    def distances(self, rows: Mapping[str, Sequence[Any]]) -> FloatArray:
        """How far each device is from the median, shape (n,); NaN where unknown.

        In units of the larger of `between` and the device's own standard deviation. They are not
        kept: a fleet may have a million devices.
        """
        return _core.distances(_devices(rows, self.name), self.usual)


def spreads(rows: Mapping[str, Sequence[Any]]) -> list[Spread]:
    """Spread of each parameter over the devices whose calibration is usable."""
    verdicts, out = _verdicts(rows), []
    for name in [n for n in rows if f"{n}_sd" in rows]:
        devices = _devices(rows, name)
        # What no reading tells stays as drawn in all, but for rounding.
        told = bool(np.isfinite(devices[:, 1]).any())
        found = _core.usual(devices, verdicts) if told else None
        if found is not None:
            out.append(Spread(name, *found[0], found[1]))
    return out


def remarks(rows: Mapping[str, Sequence[Any]], by: str, spread: Sequence[Spread]) -> list[Remark]:
    """Devices that stand out, those first that need a decision."""
    fits = np.column_stack([numbers_of(rows, name) for name in ("chi2", "dof")])
    values = (_devices(rows, one.name) for one in spread)
    found = _core.standing_out(_verdicts(rows), fits, values, [one.usual for one in spread])
    numbers = {k: numbers_of(rows, spread[k].name) for k in {at[0] for _, _, at in found if at}}
    labels, verdicts, messages = rows[by], rows["verdict"], rows["message"]
    out = []
    for i, size, at in found:
        verdict = verdicts[i] or "refused"
        if at is None:
            out.append(Remark(labels[i], size, verdict, messages[i] or ""))
            continue
        (k, weak), one = at, spread[at[0]]
        why = (
            f"{one.name} = {numbers[k][i]:.6g}: {size:.1f} standard deviations from the "
            f"fleet's {one.median:.6g}"
            if weak is None
            else f"{one.name} is known {weak:.1f} times worse than usual"
        )
        out.append(Remark(labels[i], size, verdict, why, one.name))
    return out


def _devices(rows: Mapping[str, Sequence[Any]], name: str) -> FloatArray:
    """Value and standard deviation of a parameter of each device, shape (n, 2)."""
    return np.column_stack([numbers_of(rows, name), numbers_of(rows, f"{name}_sd")])


def _verdicts(rows: Mapping[str, Sequence[Any]]) -> IntArray:
    """The verdict of each device by its place among all, -1 where it was refused."""
    places = {name: k for k, name in enumerate(EXIT_CODES)}
    return np.array([places.get(verdict, -1) for verdict in rows["verdict"]], dtype=np.int64)
