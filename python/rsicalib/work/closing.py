"""Whether the loops close under a result, in readings that it is applied to.

A result of another device gives poses like any other. But the loops of the readings do not close
under it as they did in its own session, which is told. `edited` has what a result alone tells.
"""

from __future__ import annotations

from typing import NamedTuple

from rsicalib import _core
from rsicalib._core import Mechanism
from rsicalib.errors import tell
from rsicalib.io.readings import Readings
from rsicalib.plain_text import printable
from rsicalib.results.result import Result
from rsicalib.work.applying import as_applied, as_table, covariance_of, tell_closures
from rsicalib.work.edited import own_misclosure


class OpenLoops(NamedTuple):
    """Loops that do not close under a result as those of its own session do."""

    misclosure: float
    """Root mean square, length units."""
    own: float | None
    """The same in the session of the result."""
    p_value: float
    """Probability of more by chance."""
    text: str
    """The same in words, with what to do."""


def open_loops(readings: Readings, mechanism: Mechanism, result: Result) -> OpenLoops | None:
    """Whether the loops of readings are open under a result.

    Parameters
    ----------
    readings : Readings
        What the result is applied to.
    mechanism : Mechanism
        What the readings are of.
    result : Result
        A calibration of it.

    Returns
    -------
    OpenLoops or None
        None where they close, or where these readings cannot tell it: of chains in the air, and of
        chains that touch only places which the result does not know.
    """
    noise, covariance = result.noise, covariance_of(result)
    if noise is None or (covariance is not None and not covariance.any()):
        return None  # no parameter was determined: there is nothing that could have changed
    if not tell_closures(readings, mechanism):
        return None
    fit = result.quality
    judged = fit.chi2 is not None and fit.dof
    found = _core.open_loops(
        mechanism,
        as_applied(result, mechanism),
        as_table([readings], mechanism),
        covariance,
        source=printable(readings.source),
        own=own_misclosure(result),
        edited=result.edited,
        scale=fit.chi2 / fit.dof if judged and fit.chi2 and fit.dof else 1.0,
        dof=noise.dof,
        correlation=noise.correlation or 0.0,
    )
    return None if found is None else OpenLoops(*found)


def warn_of_open_loops(readings: Readings, mechanism: Mechanism, result: Result) -> None:
    """Warn where they are, before a result is applied to readings that may not be its own."""
    found = open_loops(readings, mechanism, result)
    if found is not None:
        tell(found.text)
