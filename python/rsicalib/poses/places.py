"""Where a mechanism is under a calibration, and how well that is known.

A mechanism with a platform gives its pose; one without gives the points that its chains carry, or,
where no chain carries one, the points that are somewhere else in each pose: a sled on belts.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from rsicalib import _core
from rsicalib._core import Mechanism
from rsicalib.arrays import FloatArray
from rsicalib.errors import InputError
from rsicalib.io.cells import ABSENT, MechanismLike
from rsicalib.io.readings import Readings
from rsicalib.results.result import Result
from rsicalib.work.applying import as_applied, as_table, covariance_of
from rsicalib.work.arguments import Bare, ReadingsArg, load

WARMER = 1.0
"""Poses that nobody has visited may be so much warmer or colder than the session [K]."""


@dataclass(frozen=True, eq=False)
class Places:
    """Poses of a platform, or points that are carried or move: `n` samples, `k` columns.

    Attributes
    ----------
    names : tuple of str
        `x y z rx ry rz` [length unit, rad]; or `ball.x ball.y ball.z` for a point `ball`.
    values : ndarray, shape (n, k)
        Values, one row for each sample.
    sd : ndarray, shape (n, k), or None
        What the uncertainty of the calibration leaves open, noise of the reading not counted;
        None where nothing is known of it.
    beyond : tuple of bool
        Rows in which a shape of the result is held: beyond the readings at which it was seen.
    """

    names: tuple[str, ...]
    values: FloatArray
    sd: FloatArray | None
    beyond: tuple[bool, ...]


def readings_for(readings: ReadingsArg, mechanism: Mechanism, skip_bad_rows: bool) -> Readings:
    """Load readings to be applied: no instrument needs to see them.

    Carried points need no columns beside the channels, and laws theirs where they are there.
    """
    if _by_chains(mechanism):
        return load(readings, Bare(mechanism), skip_bad_rows)
    known = _without(readings, mechanism, mechanism.instrument_columns, skip_bad_rows)
    if known is not None:
        return known
    found = load(readings, Unseen(mechanism), skip_bad_rows)
    nothing = dict.fromkeys(mechanism.instrument_columns, np.full(len(found.taken), np.nan))
    return replace(found, columns={**found.columns, **nothing})


def _without(
    readings: ReadingsArg, mechanism: MechanismLike, spared: Sequence[str], skip_bad_rows: bool
) -> Readings | None:
    """Load readings; None where one of the columns is absent that may be spared."""
    try:
        return load(readings, mechanism, skip_bad_rows)
    except InputError as error:
        missing = None if error.where is None else error.where["column"]
        absent = error.where is not None and error.where["found"] == ABSENT
        if not absent or missing not in spared:
            raise
    return None


def held_at(result: Result, mechanism: Mechanism, exact: FloatArray) -> Readings:
    """Held poses with these readings, about as warm as the session where that is known."""
    mean = None if result.reference is None else result.reference.temperature
    number = np.arange(1, len(exact) + 1)
    warm = None if mean is None else mean + WARMER * (-1.0) ** number
    own = mechanism if mechanism.to_dict().get("platform") else Bare(mechanism)
    return Readings.from_arrays(own, exact, pose=number, temperature_c=warm)


class Unseen(Bare):
    """A mechanism that no instrument sees."""

    def __init__(self, mechanism: Mechanism) -> None:
        super().__init__(mechanism)
        seen = mechanism.instrument_columns
        self.key_columns = mechanism.key_columns
        self.distance_columns = mechanism.distance_columns
        self.value_columns = [name for name in mechanism.value_columns if name not in seen]
        self.optional_columns = mechanism.optional_columns
        self.own_columns = [own for own in mechanism.own_columns if not set(own) & set(seen)]


def _by_chains(mechanism: Mechanism) -> bool:
    """Whether the chains alone tell the places."""
    drawn = mechanism.to_dict()
    return not drawn.get("platform") and any("chain" in p for p in drawn.get("point", ()))


def places(
    readings: Readings, mechanism: Mechanism, result: Result | None, *, sd: bool = True
) -> Places:
    """Find where the mechanism is, and how well that is known.

    Parameters
    ----------
    readings : Readings
        `n` samples.
    mechanism : Mechanism
        Mechanism that the readings are from.
    result : Result or None
        A calibration; without it the mechanism as it is declared.
    sd : bool
        Whether the standard deviations are computed as well.

    Returns
    -------
    Places
        Places of all samples.
    """
    table = as_table([readings], mechanism, bare=_by_chains(mechanism))
    covariance = covariance_of(result) if result is not None and sd else None
    found = _core.places(mechanism, as_applied(result, mechanism), table, covariance)
    names, values, deviations, beyond = found
    return Places(tuple(names), values, deviations, tuple(beyond))
