"""Devices that stand out of a fleet, and why."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from statistics import NormalDist
from typing import Any

import numpy as np

from rsicalib.arrays import FloatArray
from rsicalib.fleets.frames import numbers_of

__all__ = ["Remark", "Spread", "remarks", "spreads"]

FEWEST = 20
"""Devices from which on a spread tells what is usual."""

FALSE = 0.01
"""Probability of naming any parameter of a fleet of normal devices."""

WEAK = 4.0
"""A parameter is hardly determined where its standard deviation is so many times the usual."""

UNDETERMINED = "undetermined"

FINE = {"adequate", "explained", "unjudged"}


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
    furthest : tuple of int and float
        The device that is farthest from the median, and how far.
    """

    name: str
    median: float
    between: float
    within: float
    furthest: tuple[int, float]

    def distances(self, rows: Mapping[str, Sequence[Any]]) -> tuple[FloatArray, FloatArray]:
        """Of each device: how far it is from the median, and how weakly it is known.

        The first in units of the larger of `between` and the device's own standard deviation, NaN
        where unknown; the second its standard deviation over `within`. Shape (n,). They are not
        kept: a fleet may have a million devices.
        """
        value, sd = numbers_of(rows, self.name), numbers_of(rows, f"{self.name}_sd")
        scale = np.fmax(np.fmax(self.between, sd), np.finfo(np.float64).tiny)
        return (value - self.median) / scale, sd / self.within


def spreads(rows: Mapping[str, Sequence[Any]]) -> list[Spread]:
    """Spread of each parameter over the devices whose calibration is usable."""
    usable = np.array([verdict in FINE for verdict in rows["verdict"]], dtype=np.bool_)
    out = []
    for name in [n for n in rows if f"{n}_sd" in rows]:
        value, sd = numbers_of(rows, name), numbers_of(rows, f"{name}_sd")
        known = usable & np.isfinite(value)
        if known.sum() < FEWEST:
            continue
        median = float(np.median(value[known]))
        between = 1.4826 * float(np.median(np.abs(value[known] - median)))
        finite = known & np.isfinite(sd)
        within = float(np.median(sd[finite])) if finite.any() else np.nan
        one = Spread(name, median, between, within, (0, 0.0))
        far = np.nan_to_num(np.abs(one.distances(rows)[0]))
        out.append(replace(one, furthest=(int(far.argmax()), float(far.max()))))
    return out


def remarks(rows: Mapping[str, Sequence[Any]], by: str, spread: Sequence[Spread]) -> list[Remark]:
    """Devices that stand out, those first that need a decision."""
    found = [*_by_verdict(rows, by), *_by_parameter(rows, by, spread)]
    rank = {"refused": 0, "undetermined": 1, "implausible": 2, "unexplained": 3}
    rank |= {"partly_explained": 4, "explained": 5}
    return sorted(found, key=lambda r: (rank.get(r.verdict, 6), -r.size))


def limit(tests: int) -> float:
    """Distance that one of so many normal numbers exceeds with the probability `FALSE`."""
    return NormalDist().inv_cdf(1.0 - FALSE / (2.0 * max(tests, 1)))


def _by_verdict(rows: Mapping[str, Sequence[Any]], by: str) -> Iterator[Remark]:
    labels, messages = rows[by], rows["message"]
    chi2, dof = numbers_of(rows, "chi2"), numbers_of(rows, "dof")
    for i, verdict in enumerate(rows["verdict"]):
        if verdict in ("adequate", "unjudged"):
            continue
        size = float(chi2[i] / dof[i]) if dof[i] > 0.0 else 0.0
        yield Remark(labels[i], np.nan_to_num(size), verdict or "refused", messages[i] or "")


def _by_parameter(
    rows: Mapping[str, Sequence[Any]], by: str, spread: Sequence[Spread]
) -> Iterator[Remark]:
    labels, verdicts = rows[by], rows["verdict"]
    most = limit(len(labels) * len(spread))
    for one in spread:
        far, weak = one.distances(rows)
        odd = np.flatnonzero((np.abs(far) > most) | (weak > WEAK)).tolist()
        values = numbers_of(rows, one.name)
        for i in odd:
            # Of an undetermined device its verdict says so, once for all of its parameters.
            if verdicts[i] is None or (verdicts[i] == UNDETERMINED and abs(far[i]) <= most):
                continue
            if abs(far[i]) > most:
                why = (
                    f"{one.name} = {values[i]:.6g}: {abs(far[i]):.1f} standard deviations from the "
                    f"fleet's {one.median:.6g}"
                )
            else:
                why = f"{one.name} is known {weak[i]:.1f} times worse than usual"
            yield Remark(labels[i], float(abs(far[i])), verdicts[i], why, one.name)
