"""Devices that stand out of a fleet, and why."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from statistics import NormalDist
from typing import Any

import numpy as np

from rsicalib.arrays import FloatArray

__all__ = ["Remark", "Spread", "remarks", "spreads"]

FEWEST = 20
"""Devices from which on a spread tells what is usual."""

FALSE = 0.01
"""Probability of naming any parameter of a fleet of normal devices."""

WEAK = 4.0
"""A parameter is hardly determined where its standard deviation is so many times the usual."""

FINE = {"adequate", "explained", "unjudged"}


@dataclass(frozen=True)
class Remark:
    """A device that stands out: the more, the larger `size` (standard deviations)."""

    device: Any
    size: float
    verdict: str
    why: str


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
    far : ndarray, shape (n,)
        Distance of each device from the median in units of the larger of `between` and the
        device's own standard deviation; NaN where unknown.
    weak : ndarray, shape (n,)
        The device's standard deviation over `within`.
    """

    name: str
    median: float
    between: float
    within: float
    far: FloatArray
    weak: FloatArray


def spreads(rows: Mapping[str, Sequence[Any]]) -> list[Spread]:
    """Spread of each parameter over the devices whose calibration is usable."""
    usable = np.array([verdict in FINE for verdict in rows["verdict"]], dtype=np.bool_)
    out = []
    for name in [n for n in rows if f"{n}_sd" in rows]:
        value, sd = _numbers(rows[name]), _numbers(rows[f"{name}_sd"])
        known = usable & np.isfinite(value)
        if known.sum() < FEWEST:
            continue
        median = float(np.median(value[known]))
        between = 1.4826 * float(np.median(np.abs(value[known] - median)))
        finite = known & np.isfinite(sd)
        within = float(np.median(sd[finite])) if finite.any() else np.nan
        scale = np.fmax(np.fmax(between, sd), np.finfo(np.float64).tiny)
        out.append(Spread(name, median, between, within, (value - median) / scale, sd / within))
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
    for i, verdict in enumerate(rows["verdict"]):
        if verdict in ("adequate", "unjudged"):
            continue
        chi2, dof = rows["chi2"][i], rows["dof"][i]
        size = chi2 / dof if chi2 is not None and dof else 0.0
        why = rows["message"][i] or ""
        yield Remark(rows[by][i], float(size), verdict or "refused", why)


def _by_parameter(
    rows: Mapping[str, Sequence[Any]], by: str, spread: Sequence[Spread]
) -> Iterator[Remark]:
    count = len(rows[by])
    far = limit(count * len(spread))
    for one in spread:
        for i in np.flatnonzero((np.abs(one.far) > far) | (one.weak > WEAK)).tolist():
            verdict = rows["verdict"][i]
            if verdict is None:
                continue
            value = rows[one.name][i]
            if abs(one.far[i]) > far:
                why = (
                    f"{one.name} = {value:.6g}: {abs(one.far[i]):.1f} standard deviations from the "
                    f"fleet's {one.median:.6g}"
                )
            else:
                why = f"{one.name} is known {one.weak[i]:.1f} times worse than usual"
            yield Remark(rows[by][i], float(abs(one.far[i])), verdict, why)


def _numbers(cells: Sequence[Any]) -> FloatArray:
    return np.array([np.nan if c is None else c for c in cells], dtype=np.float64)
