"""Times of logs, which come as seconds, as integers since 1970 or as text."""

from __future__ import annotations

import datetime
from collections.abc import Sequence
from typing import Any

import numpy as np
import numpy.typing as npt

from rsicalib.arrays import FloatArray

TIME = "time_s"
"""The column of times."""

NAMES = (
    *(
        TIME,
        "__time",
        "time",
        "timestamp",
        "stamp",
        "receive_time",
        "log_time",
        "%time",
        "ts",
        "t",
    ),
    *("header.stamp", "receive time", "elapsed time"),
)
"""What a column of times is called, with the unit behind it or not."""

DECIMALS = {"ns": 9, "nsec": 9, "us": 6, "usec": 6, "ms": 3, "msec": 3, "s": 0, "sec": 0}
UNITS = {
    form.format(unit): decimals
    for form in ("_{}", "({})", "[{}]")
    for unit, decimals in DECIMALS.items()
}
"""Decimals of a second that the end of a name says."""

EPOCH = {9: "nanoseconds", 6: "microseconds", 3: "milliseconds", 0: "seconds"}
"""Decimals of a second in which times since 1970 are counted."""


def time_column(names: Sequence[str]) -> int | None:
    """Place of the column of times; None where no name says so."""
    for wanted in NAMES:
        for place, name in enumerate(names):
            if _stem(name) == wanted or name.lower() == wanted:
                return place
    return None


def _stem(name: str) -> str:
    """A name without its unit."""
    lower = name.strip().lower()
    for unit in UNITS:
        if lower.endswith(unit):
            return lower.removesuffix(unit).strip()
    return lower


def seconds(cells: Sequence[Any], name: str) -> tuple[FloatArray, str | None] | int:
    """Times in seconds from the first, and what was taken for granted.

    Integers since 1970 are subtracted before they become floating-point: a nanosecond of today
    is below what a double holds.

    Returns
    -------
    (ndarray, str or None), or int
        Or the place of the first cell that is no time.
    """
    dates = dates_of(cells) if len(cells) and not isinstance(cells[0], str) else None
    if dates is not None:
        unknown = np.flatnonzero(np.isnat(dates))
        return int(unknown[0]) if len(unknown) else (seconds_of_dates(dates), "times are dates")
    exact: list[Any] = []
    for place, cell in enumerate(cells):
        time = _exact(cell)
        if time is None:
            return place
        exact.append(time)
    if not exact:
        return np.zeros(0), None
    if isinstance(exact[0], datetime.datetime):
        if any((t.tzinfo is None) != (exact[0].tzinfo is None) for t in exact):
            return next(i for i, t in enumerate(exact) if t.tzinfo != exact[0].tzinfo)
        return np.array([(t - exact[0]).total_seconds() for t in exact]), "times are dates"
    lower = name.strip().lower()
    decimals = next((d for unit, d in UNITS.items() if lower.endswith(unit)), None)
    size = abs(exact[0])
    since = next((d for d in EPOCH if 1e9 <= size / 10**d < 4e9), None)  # 2001 to 2096
    note = None
    if decimals is None:
        decimals = since or 0
        if decimals:
            note = f"times of {name!r} are taken as {EPOCH[decimals]} since 1970"
    return np.array([float(t - exact[0]) for t in exact]) / 10**decimals, note


def dates_of(cells: Any) -> npt.NDArray[Any] | None:
    """Dates or durations of a library as an array of NumPy, NaT where nothing is known.

    None for other cells: numbers, text, or dates of which only some have a time zone.
    """
    array = np.asarray(cells)
    if array.dtype.kind in "mM":
        return array
    known = [cell for cell in array.flat if not is_none(cell)] if array.dtype == object else []
    for kind in (datetime.datetime, datetime.timedelta):
        if known and all(isinstance(cell, kind) for cell in known):
            break
    else:
        return None
    if len({getattr(cell, "tzinfo", None) is None for cell in known}) > 1:
        return None
    nothing = np.datetime64("NaT") if kind is datetime.datetime else np.timedelta64("NaT")
    return np.array([nothing if is_none(cell) else _of_numpy(cell) for cell in array.flat])


def is_none(cell: Any) -> bool:
    """Whether a cell is None, or what is not equal to itself: NaN, NaT, or NA of pandas."""
    if cell is None:
        return True
    differs = cell != cell
    # Of NA nobody can say whether it is equal to itself, pandas neither.
    return bool(differs) if isinstance(differs, bool | np.bool_) else True


def _of_numpy(cell: Any) -> Any:
    """A date or a duration as NumPy has it, to the nanosecond where pandas has one."""
    if isinstance(cell, datetime.datetime) and cell.tzinfo is not None:
        cell = cell.astimezone(datetime.UTC).replace(tzinfo=None)
    of_pandas = getattr(cell, "asm8", None)
    if of_pandas is not None:
        return of_pandas
    return np.datetime64(cell) if isinstance(cell, datetime.datetime) else np.timedelta64(cell)


def date_of(text: str) -> np.datetime64 | None:
    """A date as ISO 8601 has it, UTC where it says no zone; None for other text."""
    try:
        when = datetime.datetime.fromisoformat(text)
    except ValueError:
        return None
    return np.datetime64(_of_numpy(when), "us")


def seconds_of_dates(dates: npt.NDArray[Any], first: Any = None) -> FloatArray:
    """Dates as seconds from the first, or from `first`; durations in seconds. NaN for NaT."""
    if dates.dtype.kind == "M":
        first = first_of(dates) if first is None else first
        dates = dates - first
    found: FloatArray = dates / np.timedelta64(1, "s")
    return found


def first_of(dates: npt.NDArray[Any]) -> Any:
    """The first that is known; NaT where none is."""
    known = dates[~np.isnat(dates)]
    return known[0] if len(known) else np.datetime64("NaT")


def _exact(cell: Any) -> int | float | datetime.datetime | None:
    """A time without loss: an integer, a date, or a floating-point number."""
    if isinstance(cell, datetime.datetime):
        return cell
    if isinstance(cell, int | np.integer) and not isinstance(cell, bool):
        return int(cell)
    if isinstance(cell, float | np.floating):
        return float(cell) if np.isfinite(cell) else None
    text = str(cell).strip()
    try:
        return int(text)
    except ValueError:
        pass
    try:
        value = float(text)
        return value if np.isfinite(value) else None
    except ValueError:
        pass
    try:
        return datetime.datetime.fromisoformat(text)
    except ValueError:
        return None
