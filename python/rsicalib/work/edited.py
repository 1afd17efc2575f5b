"""Whether a result is as it was written, told by the result alone.

Every verb takes a result by `earlier_result`, which asks here. A result has the digest of its
numbers; where that was deleted, its own misclosure still speaks: what its parameters and its noise
expect of the loops is what its session had.
"""

from __future__ import annotations

import numpy as np

from rsicalib import _core
from rsicalib._core import Mechanism
from rsicalib.errors import InputError
from rsicalib.io.readings import Readings
from rsicalib.results.result import Result
from rsicalib.work.applying import as_applied, as_table, covariance_of

ROWS = 64
"""Readings within the span of the session at which the misclosure that is expected is taken: it is
a mean over them, and theirs differ by less than what the core calls more."""


def edits(result: Result, mechanism: Mechanism) -> str | None:
    """Say that numbers of a result were edited after it was written.

    Parameters
    ----------
    result : Result
        A calibration.
    mechanism : Mechanism
        What it is of.

    Returns
    -------
    str or None
        None where they were not, or where that cannot be told from the result alone.
    """
    where = result.called
    if result.edited:
        return (
            f"numbers of {where} were edited after it was written: identify again, or delete its "
            "`digest` if that was meant"
        )
    if result.edited is False or result.noise is None or not result.parameters:
        return None
    own = own_misclosure(result)
    if own is None:
        if result.misclosure is None:
            return (
                f"{where} has neither a `digest` nor the `misclosure` of its session: nothing "
                "tells whether its numbers are as they were written; identify again"
            )
        return None
    expected = _expected_more(result, mechanism, own)
    if expected is None:
        return None
    unit = mechanism.length_unit
    return (
        f"{where} expects a misclosure of {expected:.2g} {unit}, in its session it was {own:.2g} "
        f"{unit}: its numbers were edited; identify again"
    )


def own_misclosure(result: Result) -> float | None:
    """Misclosure of the session of a result, root mean square; None where it had none."""
    if result.misclosure is None or not result.misclosure.rms:
        return None
    return float(np.sqrt(np.mean(np.square(list(result.misclosure.rms.values())))))


def _expected_more(result: Result, mechanism: Mechanism, own: float) -> float | None:
    """What the noise makes of the misclosure under a result, over the span of its session.

    None where its session explains that, and where that depends on what is touched or measured:
    only readings say that.
    """
    if mechanism.key_columns or mechanism.value_columns:
        return None
    applied = as_applied(result, mechanism)
    span = np.array(applied["span"], dtype=np.float64)
    drawn = np.random.default_rng(0).uniform(0.0, 1.0, (ROWS, len(span)))
    rows = np.ascontiguousarray(span[:, 0] + drawn * (span[:, 1] - span[:, 0]))
    try:
        readings = Readings.from_arrays(mechanism, rows)
    except InputError:  # no session has readings beyond the range of a channel
        return np.inf
    table = as_table([readings], mechanism)
    return _core.expects_more(mechanism, applied, table, covariance_of(result, own=True), own=own)


def refuse_other_units(result: Result, mechanism: Mechanism, where: str) -> None:
    """Refuse a result whose parameters say other units than the mechanism has for them."""
    asked = [(p.at, p.name) for p in result.parameters]
    for number, units in enumerate(_core.units_of(mechanism, asked)):
        found = result.parameters[number].unit
        if found and units and found not in units:
            place = f"parameters[{number}].unit"
            expected = " or ".join(repr(unit) for unit in dict.fromkeys(units))
            raise InputError.at(where, repr(found), expected, place=place)
