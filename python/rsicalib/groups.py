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
from rsicalib.io.readings import Readings
from rsicalib.results import Calibration, Result
from rsicalib.shapes import Groups
from rsicalib.work.applying import as_applied, as_table
from rsicalib.work.job import Work

__all__ = ["measured", "spread"]

AnyResult = TypeVar("AnyResult", bound=Result)


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
    if not mechanism.key_columns:
        return {}
    grouped = all("group" in r.keys for r in readings)
    groups = [text for r in readings for text in r.keys["group"]] if grouped else None
    return dict(_core.spread(mechanism, applied, as_table(readings, mechanism), groups))


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
    own = len(job.whole) == len(job.readings)  # else sessions have other numbers here
    by_group = spread(job.whole, job.mechanism, as_applied(result, job.mechanism, own=own))
    if not by_group:
        return result
    nominal = spread(job.whole, job.mechanism, as_applied(None, job.mechanism))
    used, others = _sides(job, list(by_group))
    before: Mapping[str, float] = {}
    if session is not None:
        found = {**session.fit().to_dict(), "verdict": None}
        fitted = Calibration.from_dict(job.result(Calibration, found, session))
        before = spread(job.whole, job.mechanism, as_applied(fitted, job.mechanism, own=own))
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


def _sides(job: Work, names: list[str]) -> tuple[set[str], set[str]]:
    """The groups that the fit has seen, and those that it is measured on."""
    keep, leave = job.selected or (None, None)
    used = {n for n in names if (keep is None or n in keep) and (leave is None or n not in leave)}
    others = set(names) - used
    return used, others if keep is None or leave is None else others & set(leave)
