"""Results of one device against their dates: the verb `history`."""

from __future__ import annotations

import datetime
import os
from collections import Counter
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from rsicalib import _core, options
from rsicalib._core import Mechanism
from rsicalib.arrays import FloatArray
from rsicalib.errors import InputError, InputTypeError
from rsicalib.facts.verdicts import UNUSABLE
from rsicalib.plain_text import as_sentence, meant
from rsicalib.planning.platform_sd import readings_at_work
from rsicalib.poses.places import held_at
from rsicalib.report.past import DAY_S, Forecast, History, Jump, LeftOut, Past, Series, days_of
from rsicalib.results.result import Result
from rsicalib.work.applying import as_applied, as_table, covariance_of
from rsicalib.work.arguments import MechanismArg, earlier_result, open_mechanism

POSES = 40
"""Poses of the workspace over which the platform's error is averaged."""

Spec = tuple[str, str | None, str | None]
Estimate = tuple[Spec, str, float | None, float | None]
Course = Mapping[str, Any] | None
Last = tuple[dict[str, Any], dict[str, Any], float]
Dated = tuple[float, list[Estimate], FloatArray | None, list[Spec]]


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
        raise InputError.at(str(folder), "no such folder", "a folder of results")
    opened = open_mechanism(mechanism)
    read, left_out, opened = _read(place, opened)
    if not read:
        found = "no result that can be used" if left_out else "no *.json"
        why = " ".join(f"{one.file}: {as_sentence(one.reason)}" for one in left_out[:3])
        raise InputError.at(str(folder), found, "a result with a date", hint=why)
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
    results = [result for _, result in own]
    last = _last(opened, results[-1], target)
    series, session_only, forecast = _core.history(opened, [_dated(r) for r in results], last)
    rated = any(one["course"] for one in series)  # of one result nothing is known but the level
    return History(
        device=chosen,
        mechanism=opened.name,
        length_unit=opened.length_unit,
        results=tuple(_past(name, result) for name, result in own),
        parameters=tuple(_series(results, one["known"], one["course"]) for one in series),
        session_only=tuple(session_only),
        left_out=tuple(sorted(left_out, key=lambda one: one.file)),
        forecast=None if forecast is None or not rated else _forecast(results[-1], **forecast),
    )


def _read(
    place: Path, mechanism: Mechanism
) -> tuple[list[tuple[str, Result]], list[LeftOut], Mechanism]:
    """Results of the mechanism with a date, the other files, the mechanism with their laws."""
    read: list[tuple[str, Result]] = []
    left_out = []
    first: dict[tuple[object, ...], str] = {}
    for path in sorted(place.rglob("*.json")):
        name = path.relative_to(place).as_posix()
        try:
            result, extended = earlier_result(path, mechanism)
        except InputError as error:
            left_out.append(LeftOut(name, error.said))
            continue
        if result.valid_from is None:
            left_out.append(LeftOut(name, "without a date (--date)"))
        elif day_of(result) is None:
            found = f"found {result.valid_from!r} as its date, expected 2025-03-01, or with a time"
            left_out.append(LeftOut(name, found))
        elif (same := first.setdefault(_told(result), name)) != name:
            left_out.append(LeftOut(name, f"a copy of {same}"))
        elif result.verdict in UNUSABLE:
            left_out.append(LeftOut(name, f"{result.verdict}: no parameters to rely on"))
        else:
            read.append((name, result))
            mechanism = extended
    return read, left_out, mechanism


def day_of(result: Result) -> float | None:
    """Date of a result in days since 1970; None where it has none that can be read."""
    if result.valid_from is None:
        return None
    try:
        return days_of(result.valid_from)
    except ValueError:
        return None


def _told(result: Result) -> tuple[object, ...]:
    """What no two calibrations have alike: date, device and all digits of the parameters."""
    values = ((p.at, p.name, p.value, p.sd) for p in result.parameters)
    return (result.valid_from, result.device, *values)


def _called(device: str | None) -> str:
    return "no name" if device is None else repr(device)


def _device(read: Sequence[tuple[str, Result]]) -> str | None:
    """The device with most results; the first by name of several."""
    counts = Counter(result.device for _, result in read)
    return min(counts, key=lambda name: (-counts[name], name or ""))


def _day(result: Result) -> float:
    """Date of a result that has one, in days."""
    day = day_of(result)
    assert day is not None
    return day


def _date(day: float) -> str:
    when = datetime.datetime.fromtimestamp(day * DAY_S, datetime.UTC)
    return when.date().isoformat()


def _past(name: str, result: Result) -> Past:
    steps = getattr(result, "steps", ())
    found = tuple(f"{step.term}@{step.target}" for step in steps)
    assert result.valid_from is not None
    return Past(name, result.valid_from, str(result.verdict), found, result.note)


def _dated(result: Result) -> Dated:
    """A result as the core takes it: day, parameters, where it says that something changed."""
    update = getattr(result, "update", None)
    changes = () if update is None else update.changes
    estimates: list[Estimate] = [
        (p.at, p.name, p.value, p.sd_between or p.sd) for p in result.parameters
    ]
    changed: list[Spec] = [(change.term, change.target, None) for change in changes]
    means = covariance_of(result, beside=getattr(result, "between", None))
    return _day(result), estimates, means, changed


def _series(own: Sequence[Result], known: Sequence[tuple[int, int]], course: Course) -> Series:
    """One parameter over time, with what it has done."""
    of = [own[result].parameters[number] for result, number in known]
    dates = [str(own[result].valid_from) for result, _ in known]
    done = {"rate": None, "rate_sd": None, "p_value": None, **(course or {})}
    level, level_sd = done.pop("level", (None, None))
    jumps = done.pop("jumps", ())
    return Series(
        term=of[-1].term,
        target=of[-1].target,
        name=of[-1].name,
        unit=of[-1].unit,
        valid_from=tuple(dates),
        values=tuple(p.value for p in of if p.value is not None),
        sd=tuple(p.sd for p in of if p.sd is not None),
        place=of[-1].place,
        jumps=tuple(Jump(dates[j["from"]], j["value"], j["sd"], j["told"]) for j in jumps),
        level=level,
        level_sd=level_sd,
        **done,
    )


def _last(mechanism: Mechanism, last: Result, target: float | None) -> Last | None:
    """The last result as the core forecasts from it; None where it cannot."""
    covariance = covariance_of(last)
    if target is None or covariance is None or not mechanism.to_dict().get("platform"):
        return None
    if not np.isfinite(covariance).all():
        return None
    try:
        values, _ = readings_at_work(last, mechanism, POSES, seed=0)
    except InputError:  # no pose of the workspace is within reach; the history is known
        return None
    table = as_table([held_at(last, mechanism, values)], mechanism, bare=True)
    return as_applied(last, mechanism), table, float(target)


def _forecast(
    last: Result, target: float, now: float, day: int | None, from_day: int | None
) -> Forecast:
    """The forecast with dates in the place of days from the last result on."""
    dates = (None if days is None else _date(_day(last) + days) for days in (day, from_day))
    return Forecast(target, now, *dates)
