"""Readings and results as the core takes them, to apply a result to other readings."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, TypeAlias

import numpy as np

from rsicalib import _core
from rsicalib._core import Mechanism
from rsicalib.arrays import FloatArray
from rsicalib.errors import InputError
from rsicalib.facts.shapes import Between
from rsicalib.io.cells import closing_rows
from rsicalib.io.readings import Readings
from rsicalib.results.result import Result

Known: TypeAlias = tuple[dict[str, Any], FloatArray, tuple[float, float], str | None, bool]
"""Table of readings, the poses they were taken in, shape (n, 6), the point whose places they are (a
place has no orientation), and whether the table says what closures touch and measure."""


def as_table(
    readings: Sequence[Readings], mechanism: Mechanism, *, bare: bool = False
) -> dict[str, Any]:
    """Sessions one after the other, and which of their rows are used, as the core takes them.

    With `bare` the channels alone, and what laws use where it was read.
    """
    taken: list[Any] = [r.taken for r in readings]
    labels = [r.labels for r in taken]
    if len({own is None for own in labels}) > 1:
        held = next(r.source for r in readings if r.labels is not None)
        moving = next(r.source for r in readings if r.labels is None)
        raise InputError(
            f"found held poses in {held} and a recording in {moving}, expected sessions of one kind"
        )

    several = len(readings) > 1

    def together(columns: list[Any]) -> Any:
        if any(c is None for c in columns):
            return None
        return np.concatenate(columns) if several else columns[0]  # a recording may be large

    def column(read: Any, name: str) -> FloatArray:
        """Numbers of a column; NaN where it was not read."""
        found: FloatArray = read.columns.get(name, np.full(len(read), np.nan))
        return found

    sizes = [len(r) for r in taken]
    keys, columns = mechanism.key_columns, mechanism.value_columns
    if bare:
        laws = mechanism.law_columns
        read = all(name in own.columns for own in taken for name in laws)
        keys, columns = [], laws if read else []
    firsts = np.cumsum([0, *sizes])
    some = any(r.part is not None for r in readings)
    used = [first + r.own for first, r in zip(firsts, readings, strict=False)]
    return {
        "values": together([r.values for r in taken]),
        "pose": together(labels),
        "time": together([r.time_s for r in taken]),
        "temperature": together([r.temperature_c for r in taken]),
        "session": np.repeat(range(len(readings)), sizes).tolist() if several else None,
        "keys": [[t for r in taken for t in r.keys[name]] for name in keys],
        "columns": [together([column(r, name) for r in taken]).tolist() for name in columns],
        "used": np.concatenate(used).tolist() if some else None,
    }


def _of_open_chains(readings: Readings, mechanism: Mechanism) -> dict[str, Any]:
    """Readings of which only the channels count: what closures touch and measure is nothing."""
    n = len(readings.taken)
    keys = [["-"] * n for _ in mechanism.key_columns]  # a blank would say that nothing is touched
    laws = {*mechanism.law_columns}
    told = {**dict.fromkeys(laws, np.full(n, np.nan)), **readings.taken.columns}
    ones = np.ones(n)
    columns = [told[c].tolist() if c in laws else ones.tolist() for c in mechanism.value_columns]
    return as_table([readings], mechanism, bare=True) | {"keys": keys, "columns": columns}


def tell_closures(readings: Readings, mechanism: Mechanism) -> bool:
    """Whether readings say what closures touch and measure, in each row of one at least."""
    keys, columns = {*mechanism.key_columns}, {*mechanism.value_columns}
    if not ({*readings.keys} >= keys and {*readings.columns} >= columns):
        return False
    told = {name: np.array([*readings.keys[name]]) != "" for name in keys}
    told |= {name: ~np.isnan(readings.columns[name]) for name in columns}
    return bool(closing_rows(mechanism.own_columns, told, len(readings.pose)).all())


def posed(
    readings: Readings,
    mechanism: Mechanism,
    point: str | None = None,
    noise: tuple[float, float] = (0.0, 0.0),
) -> Known:
    """Readings with known poses, or with known places of a point, as the core takes them."""
    if readings.poses is None or not np.isfinite(readings.poses).any():
        found = "no known pose" if readings.poses is not None else "no columns x y z rx ry rz"
        expected = "known poses: x y z [length unit] and rx ry rz [rad]"
        raise InputError.at(readings.source, found, expected)
    whole = tell_closures(readings, mechanism)
    table = as_table([readings], mechanism) if whole else _of_open_chains(readings, mechanism)
    return table, np.ascontiguousarray(readings.poses), noise, point, whole


def as_applied(result: Result | None, mechanism: Mechanism, *, own: bool = False) -> dict[str, Any]:
    """A result as the core applies it to readings; None: the mechanism as declared.

    `own` says that these are the readings of the result's own sessions, where all of it acts;
    on others acts what outlasts those.
    """
    channels = mechanism.channels
    if result is None:
        return _core.declared(mechanism)
    if result.reference is None or result.noise is None:
        raise InputError("found a result without 'reference' and 'noise', expected both")
    return {
        **result.reference.to_dict(),
        "sigma": [result.noise.sigma[c.name] for c in channels],
        "declared": result.noise.kind in ("declared", "presumed"),
        "closures": list(result.noise.closures.items()),
        "own": own,
        "parameters": [(p.at, p.name, p.value) for p in result.parameters if p.value is not None],
    }


def covariance_of(
    result: Result, *, own: bool = False, beside: Between | None = None
) -> FloatArray | None:
    """Covariance of the parameters that `as_applied` passes on; None where there is none.

    Where parameters change from group to group, a placement or a session, another session has them
    as means over groups, by which they have the covariance of `between`, and as one other group:
    each differs from its mean by its `sd` beside.

    Parameters
    ----------
    result : Result
        What is applied.
    own : bool
        For the result's own readings: within its groups.
    beside : Between, optional
        What changes between the groups of another result, to compare them: means of both are
        compared then, and that of one group with means of the other where only one has groups.
    """
    known = [i for i, p in enumerate(result.parameters) if p.value is not None]
    between = None if own else getattr(result, "between", None)
    covariance = np.asarray(result.covariance if between is None else between.covariance)
    if covariance.shape != (len(result.parameters),) * 2:
        return None
    one = beside if between is None else between if beside is None else None
    if one is not None:
        changing = {(p.term, p.target, p.name): p.sd for p in one.parameters}
        sd = [changing.get((p.term, p.target, p.name), 0.0) for p in result.parameters]
        covariance = covariance + np.diag(np.square(sd))
    return np.ascontiguousarray(covariance[np.ix_(known, known)])


def deviations_of(result: Result, *, beside: Between | None = None) -> list[float | None]:
    """Standard deviations of all parameters as `covariance_of` has them; None where unknown."""
    covariance = covariance_of(result, beside=beside)
    if covariance is None:
        return [p.sd for p in result.parameters]
    sd = iter(np.sqrt(np.diagonal(covariance)).tolist())
    all_of = (None if p.value is None else next(sd) for p in result.parameters)
    return [None if p.sd is None else s for p, s in zip(result.parameters, all_of, strict=True)]
