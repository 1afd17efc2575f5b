"""Results of one device against their dates: the verb `history`."""

from __future__ import annotations

import datetime
import os
from collections import Counter
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from rsicalib import _core, options
from rsicalib._core import Mechanism
from rsicalib.arrays import FloatArray
from rsicalib.errors import InputError, InputTypeError
from rsicalib.facts.verdicts import UNUSABLE
from rsicalib.io.readings import Readings
from rsicalib.plain_text import meant
from rsicalib.planning.measures import parameters_of
from rsicalib.report.past import Forecast, History, Jump, LeftOut, Past, Series
from rsicalib.results.result import Result
from rsicalib.work.applying import as_applied, as_table, covariance_of
from rsicalib.work.arguments import MechanismArg, earlier_result, open_mechanism

__all__ = ["history"]

DAY_S = 86_400.0
POSES = 40
"""Poses of the workspace over which the platform's error is averaged."""

DRAWS = 400
"""Draws of what is not known of the parameters and of their drift."""

HORIZON_DAYS = 3650
"""Beyond ten years nothing is said."""


@options.checked
def history(
    folder: str | os.PathLike[str],
    mechanism: MechanismArg = "rsi",
    *,
    device: str | None = None,
    target: float | None = None,
) -> History:
    """Put the results of one device in order of their dates.

    Parameters
    ----------
    folder : path
        Folder with results (`*.json`), in it or in its folders.
    mechanism : str, path or Mechanism
        What they are results of.
    device : str, optional
        Whose results; of several devices the one with most of them where not given.
    target : float, optional
        Error of the platform's position that is too much, in units of length.

    Returns
    -------
    History
        Parameters with their intervals and drift rates. Files that are damaged, have no date or
        are of another device are listed in `left_out`.

    Raises
    ------
    InputError
        There is no such folder, or no result in it that can be used.
    """
    if not isinstance(folder, str | os.PathLike):
        found = f"a value of type {type(folder).__name__}"
        raise InputTypeError(f"folder: found {found}, expected a path")
    place = Path(folder)
    if not os.path.isdir(place):
        raise InputError.at(str(folder), found="no such folder", expected="a folder of results")
    opened = open_mechanism(mechanism)
    read, left_out, opened = _read(place, opened)
    if not read:
        reasons = "; ".join(f"{one.file}: {one.reason}" for one in left_out[:3]) or "no *.json"
        raise InputError.at(str(folder), found=reasons, expected="a result with a date")
    chosen = _device(read) if device is None else device
    own = [(name, result) for name, result in read if result.device == chosen]
    left_out += [
        LeftOut(name, f"of another device, {_called(result.device)}")
        for name, result in read
        if result.device != chosen
    ]
    if not own:
        known = sorted({result.device or "" for _, result in read})
        found = f"no result of {_called(chosen)}{meant(chosen or '', known)}"
        expected = f"one of {', '.join(_called(name or None) for name in known)}"
        raise InputError(f"device: found {found}, expected {expected}")
    own.sort(key=lambda one: _day(one[1]))
    lasting, session_only = _lasting([result for _, result in own], opened)
    series = [_series(key, own, len(lasting)) for key in lasting]
    return History(
        device=chosen,
        mechanism=opened.name,
        length_unit=opened.length_unit,
        results=tuple(_past(name, result) for name, result in own),
        parameters=tuple(series),
        session_only=tuple(session_only),
        left_out=tuple(sorted(left_out, key=lambda one: one.file)),
        forecast=_forecast(opened, own[-1][1], series, target),
    )


def _read(
    place: Path, mechanism: Mechanism
) -> tuple[list[tuple[str, Result]], list[LeftOut], Mechanism]:
    """Results of the mechanism with a date, the other files, the mechanism with their laws."""
    read: list[tuple[str, Result]] = []
    left_out = []
    for path in sorted(place.rglob("*.json")):
        name = path.relative_to(place).as_posix()
        try:
            result, extended = earlier_result(path, mechanism)
        except InputError as error:
            left_out.append(LeftOut(name, error.said))
            continue
        if result.valid_from is None:
            left_out.append(LeftOut(name, "without a date (--date)"))
        elif result.verdict in UNUSABLE:
            left_out.append(LeftOut(name, f"{result.verdict}: no parameters to rely on"))
        else:
            read.append((name, result))
            mechanism = extended
    return read, left_out, mechanism


def _called(device: str | None) -> str:
    return "no name" if device is None else repr(device)


def _device(read: Sequence[tuple[str, Result]]) -> str | None:
    """The device with most results; the first by name of several."""
    counts = Counter(result.device for _, result in read)
    return min(counts, key=lambda name: (-counts[name], name or ""))


def _day(result: Result) -> float:
    """Date of a result, in days."""
    assert result.valid_from is not None
    when = datetime.datetime.fromisoformat(result.valid_from)
    if when.tzinfo is None:
        when = when.replace(tzinfo=datetime.UTC)
    return when.timestamp() / DAY_S


def _date(day: float) -> str:
    when = datetime.datetime.fromtimestamp(day * DAY_S, datetime.UTC)
    return when.date().isoformat()


def _past(name: str, result: Result) -> Past:
    steps = getattr(result, "steps", ())
    found = tuple(f"{step.term}@{step.target}" for step in steps)
    assert result.valid_from is not None
    return Past(name, result.valid_from, str(result.verdict), found, result.note)


Key = tuple[tuple[str, str | None, str | None], str]
"""Where a parameter acts, and its name."""


def _lasting(results: Sequence[Result], mechanism: Mechanism) -> tuple[list[Key], list[str]]:
    """Parameters of the device, in order of appearance, and effects of single sessions."""
    keys: dict[Key, None] = {}
    passing: dict[str, None] = {}
    for result in results:
        lasts = set(_core.lasting(mechanism, [p.at for p in result.parameters]))
        for p in result.parameters:
            if _core.spec(*p.at) not in lasts:
                passing[p.spec] = None
            elif p.value is not None and p.sd is not None:
                keys[p.at, p.name] = None
    return list(keys), list(passing)


def _series(key: Key, own: Sequence[tuple[str, Result]], tests: int) -> Series:
    """One parameter over time, with what it has done; `tests` parameters are looked at."""
    at, name = key
    told = set(_told(key, own))
    dates: list[str] = []
    values, sd, days, changed = [], [], [], []
    unit, since = "", False
    for i, (_, result) in enumerate(own):
        since |= i in told
        for p in result.parameters:
            if (p.at, p.name) == key and p.value is not None and p.sd is not None:
                assert result.valid_from is not None
                if since:
                    changed.append(len(dates))
                    since = False
                dates.append(result.valid_from)
                values.append(p.value)
                sd.append(p.sd)
                days.append(_day(result))
                unit = p.unit
    course = _core.course(list(zip(days, values, sd, strict=True)), changed, tests) or {}
    jumps = tuple(
        Jump(dates[j["from"]], j["value"], j["sd"], j["told"]) for j in course.get("jumps", ())
    )
    level, level_sd = course.get("level", (None, None))
    return Series(
        term=at[0],
        target=at[1] or "all",
        name=name,
        unit=unit,
        valid_from=tuple(dates),
        values=tuple(values),
        sd=tuple(sd),
        rate=course.get("rate"),
        rate_sd=course.get("rate_sd"),
        p_value=course.get("p_value"),
        place=at[2],
        kind=course.get("kind"),
        jumps=jumps,
        level=level,
        level_sd=level_sd,
        scatter=course.get("scatter"),
        wide=course.get("wide", 1.96),
    )


def _told(key: Key, own: Sequence[tuple[str, Result]]) -> list[int]:
    """Results from which on a parameter has changed, as one of them says.

    A result that was compared with an earlier one says what changed since (`update`); a slip within
    a session is a new level from the next result on.
    """
    term, target, _ = key[0]
    told = []
    for i, (_, result) in enumerate(own):
        update = getattr(result, "update", None)
        for change in () if update is None else update.changes:
            if (change.term, change.target) == (term, target):
                told.append(i)
        for step in getattr(result, "steps", ()):
            if step.place is not None and step.target == target and step.term != term:
                told.append(i + 1)
    return told


def _forecast(
    mechanism: Mechanism, last: Result, series: Sequence[Series], target: float | None
) -> Forecast | None:
    """When the error of the platform exceeds the target, drawn from what is not known."""
    covariance = covariance_of(last)
    if target is None or covariance is None or not mechanism.to_dict().get("platform"):
        return None
    slopes = _slopes(mechanism, last)
    if slopes is None:
        return None
    rng = np.random.default_rng(0)
    known = [p for p in last.parameters if p.value is not None]
    rates = {(s.term, s.target, s.name): s for s in series}
    found = [rates.get((p.term, p.target, p.name)) for p in known]
    rate = np.array([0.0 if s is None or s.rate is None else s.rate for s in found])
    rate_sd = np.array([0.0 if s is None or s.rate_sd is None else s.rate_sd for s in found])
    now = rng.multivariate_normal(np.zeros(len(known)), covariance, DRAWS, method="svd")
    drift = rate + rate_sd * rng.standard_normal((DRAWS, len(known)))
    # What scatters from session to session is elsewhere now, as it was elsewhere then.
    scatter = np.array([0.0 if s is None or s.scatter is None else s.scatter for s in found])
    now = now + np.sqrt(2.0) * scatter * rng.standard_normal((DRAWS, len(known)))
    here, there = now @ slopes.T, drift @ slopes.T  # (draws, values): error, and error per day

    def error(days: float) -> FloatArray:
        out: FloatArray = np.sqrt(((here + days * there) ** 2).mean(axis=1))
        return out

    def day(share: float) -> str | None:
        span = np.arange(HORIZON_DAYS + 1)
        low, high = 0, HORIZON_DAYS
        if (error(high) > target).mean() < share:
            return None
        while low < high:
            middle = int(span[(low + high) // 2])
            if (error(middle) > target).mean() >= share:
                high = middle
            else:
                low = middle + 1
        return _date(_day(last) + low)

    return Forecast(
        target=float(target), now=float(np.median(error(0.0))), day=day(0.5), from_day=day(0.05)
    )


def _slopes(mechanism: Mechanism, result: Result) -> FloatArray | None:
    """Position of the platform by each known parameter, (3 poses, parameters)."""
    rng = np.random.default_rng(0)
    low, high = np.array(_core.workspace(mechanism)).T
    poses = np.ascontiguousarray(rng.uniform(low, high, (20 * POSES, 6)))
    offsets, gains = parameters_of(result, mechanism)
    rows = _core.readings_at(mechanism, poses, offsets, gains, _core.MARGIN)
    rows = rows[np.isfinite(rows).all(axis=1)][:POSES]
    if len(rows) == 0:
        return None
    table = as_table([Readings.from_arrays(mechanism, rows)], mechanism, bare=True)
    applied = as_applied(result, mechanism)

    def position(parameters: list[Any]) -> FloatArray:
        _, values, _, _ = _core.places(mechanism, {**applied, "parameters": parameters}, table)
        out: FloatArray = values[:, :3].ravel()
        return out

    columns = []
    sd = [p.sd for p in result.parameters if p.value is not None]
    for k, (at, name, value) in enumerate(applied["parameters"]):
        step = sd[k] or 1e-6 * abs(value) or 1e-6
        moved = list(applied["parameters"])
        ends = []
        for sign in (1.0, -1.0):
            moved[k] = (at, name, value + sign * step)
            ends.append(position(moved))
        columns.append((ends[0] - ends[1]) / (2.0 * step))
    return np.column_stack(columns)
