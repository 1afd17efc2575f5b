"""How well a mechanism repeats the points that it touched, placement by placement.

For each group of readings, the mean distance of the point that a chain carries from its own mean
at the unknown point it touches, all samples of the group counted alike; then a plain mean over
groups. Groups that a fit has not seen tell more than those that it has: closure is not accuracy,
but a model that only bends itself to its own readings does not close on others.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from typing import Any, TypeVar

import numpy as np

from rsicalib import _core
from rsicalib._core import Mechanism
from rsicalib.arrays import FloatArray
from rsicalib.io.readings import Readings
from rsicalib.results import Calibration, Result
from rsicalib.shapes import Groups
from rsicalib.work.applying import as_applied, as_table
from rsicalib.work.job import Work

__all__ = ["carried_points", "measured", "spread"]

AnyResult = TypeVar("AnyResult", bound=Result)


def carried_points(
    readings: Sequence[Readings], mechanism: Mechanism, applied: Mapping[str, Any]
) -> dict[str, FloatArray]:
    """Find where the chains carry their points.

    Parameters
    ----------
    readings : sequence of Readings
        `n` samples in all.
    mechanism : Mechanism
        Mechanism that the readings are from.
    applied : mapping
        A result as `as_applied` has it.

    Returns
    -------
    dict of str to ndarray, shape (n, 3)
        By the name of the point [length unit].
    """
    names = [p["name"] for p in mechanism.to_dict()["point"] if p.get("chain") is not None]
    found = _core.points(mechanism, applied, as_table(readings, mechanism))
    return {name: np.array(places) for name, places in zip(names, found, strict=True)}


def spread(
    readings: Sequence[Readings], mechanism: Mechanism, applied: Mapping[str, Any]
) -> dict[str, float]:
    """Measure how far the carried points are from their own means.

    Parameters
    ----------
    readings : sequence of Readings
        Readings of a mechanism whose chains touch unknown points.
    mechanism : Mechanism
        Mechanism that the readings are from.
    applied : mapping
        A result as `as_applied` has it.

    Returns
    -------
    dict of str to float
        By group, in the order of the readings [length unit]; empty for a mechanism whose chains
        touch no unknown points.
    """
    touches = list(_touches(mechanism.to_dict()))
    if not touches:
        return {}
    places = carried_points(readings, mechanism, applied)
    groups = _column(readings, _group_column(readings, touches))
    far: dict[str, list[FloatArray]] = {name: [] for name in dict.fromkeys(groups)}
    for point, columns in touches:
        keys = list(zip(*(_column(readings, c) for c in columns), strict=True))
        numbers = {key: i for i, key in enumerate(dict.fromkeys(keys))}
        own = np.array([numbers[key] for key in keys])
        means = np.stack([places[point][own == i].mean(axis=0) for i in range(len(numbers))])
        distance = np.linalg.norm(places[point] - means[own], axis=1)
        for name, rows in far.items():
            rows.append(distance[[g == name for g in groups]])
    return {name: float(np.concatenate(rows).mean()) for name, rows in far.items()}


def measured(job: Work, result: AnyResult, session: _core.Session | None = None) -> AnyResult:
    """Add the measure of the groups to a result, those included that it was not fitted on.

    Parameters
    ----------
    job : Work
        Call of the verb: all its readings, and those that were used.
    result : Result
        Result for a mechanism with or without unknown points.
    session : Session, optional
        What was traced: its fit is measured too, for the figures before.

    Returns
    -------
    Result
        The same, with `groups` where the mechanism touches unknown points.
    """
    if result.reference is None or result.noise is None:
        return result
    by_group = spread(job.whole, job.mechanism, as_applied(result, job.mechanism))
    if not by_group:
        return result
    nominal = spread(job.whole, job.mechanism, as_applied(None, job.mechanism))
    used, others = _sides(job, list(by_group))
    before: Mapping[str, float] = {}
    if session is not None:
        found = {**session.fit().to_dict(), "verdict": None}
        fitted = Calibration.from_dict(job.result(Calibration, found, session))
        before = spread(job.whole, job.mechanism, as_applied(fitted, job.mechanism))
    groups = Groups(
        fitted=_mean(by_group, used),
        others=_mean(by_group, others),
        by_group=by_group,
        unit=result.length_unit,
        nominal_fitted=_mean(nominal, used),
        nominal_others=_mean(nominal, others),
        before_fitted=_mean(before, used),
        before_others=_mean(before, others),
    )
    return result.with_groups(groups)


def _mean(by_group: Mapping[str, float], names: Iterable[str]) -> float | None:
    wanted = set(names)
    values = [value for name, value in by_group.items() if name in wanted]
    return float(np.mean(values)) if values else None


def _touches(mechanism: Mapping[str, Any]) -> Iterable[tuple[str, list[str]]]:
    """Points that chains carry to unknown ones, and the columns that tell those apart."""
    points = {p["name"]: p for p in mechanism["point"]}
    for closure in mechanism["closure"]:
        ends = [points.get(name, {}) for name in closure["between"]]
        for one, other in (ends, ends[::-1]):
            if closure["kind"] == "touch" and one.get("chain") and other.get("unknown"):
                yield one["name"], list(other["unknown"])


def _group_column(readings: Sequence[Readings], touches: list[tuple[str, list[str]]]) -> str:
    """The column `group`; without one, the first that tells unknown points apart."""
    return "group" if all("group" in r.keys for r in readings) else touches[0][1][0]


def _column(readings: Sequence[Readings], name: str) -> list[str]:
    return [text for r in readings for text in r.keys[name]]


def _sides(job: Work, names: list[str]) -> tuple[set[str], set[str]]:
    """The groups that the fit has seen, and those that it is measured on."""
    keep, leave = job.selected or (None, None)
    used = {n for n in names if (keep is None or n in keep) and (leave is None or n not in leave)}
    others = set(names) - used
    return used, others if keep is None or leave is None else others & set(leave)
