"""How well a mechanism repeats the points that it touched, placement by placement.

For each group of readings, the mean distance of the point that a chain carries from its own mean
at the unknown point it touches, all samples of the group counted alike; then a plain mean over
groups. Groups that a fit has not seen tell more than those that it has: closure is not accuracy,
but a model that only bends itself to its own readings does not close on others.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

from rsicalib import _core
from rsicalib._core import Mechanism
from rsicalib.io.readings import Readings
from rsicalib.work.applying import as_table

__all__ = ["spread"]


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
