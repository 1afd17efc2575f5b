"""Readings as they arrive: rows of a file or of a pipe, a few at a time, in constant memory.

`rsicalib.io.readings` refuses a file as a whole. Here nothing can be refused after the header: a
cell that cannot be used becomes NaN, and the row is counted by whoever takes it.
"""

from __future__ import annotations

import contextlib
import itertools
import math
import os
import sys
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import PurePath
from typing import Any

import numpy as np
import numpy.typing as npt

from rsicalib.arrays import FloatArray
from rsicalib.errors import InputError
from rsicalib.io.cells import MechanismLike
from rsicalib.io.extras import parquet_modules
from rsicalib.io.frames import SOURCE, Cells, TableArg, columns_of
from rsicalib.io.lines import EXPECTED, Marks, header_of, parts_of
from rsicalib.io.messages import documents, is_message, message_of, positions_of
from rsicalib.io.tables import PARQUET, is_dates, numbers
from rsicalib.io.times import TIME, date_of, first_of, seconds_of_dates
from rsicalib.io.units_row import HINT, is_units, wrong_units

BATCH = 4096
"""Rows of a Parquet file that are read at a time."""

DEVICE = "device"
"""Column with the name of the device of each row."""


@dataclass(frozen=True, eq=False)
class Rows:
    """Some rows: `values` (n, channels), NaN where unusable, and `time_s` (n,) or None.

    `device` has the name of each row's device where it was asked for.
    """

    values: FloatArray
    time_s: FloatArray | None
    device: tuple[str, ...] | None = None

    def of(self, chosen: Sequence[int]) -> Rows:
        """Some of them, in this order."""
        at = np.asarray(chosen, dtype=np.intp)
        times = None if self.time_s is None else self.time_s[at]
        return Rows(np.ascontiguousarray(self.values[at]), times)


def rows_of(
    source: str | os.PathLike[str],
    channels: Sequence[str] | Mapping[str, str],
    *,
    follow: bool = False,
    device: bool = False,
    mechanism: MechanismLike | None = None,
) -> Iterator[Rows]:
    """Rows of a file as they stand there, or of standard input (`-`) as they arrive.

    Parameters
    ----------
    source : path or "-"
        CSV or joint states as text (`rsicalib.io.messages`), also packed by gzip, or Parquet if it
        ends in `.parquet` or `.pq`. A message without any of the channels is another publisher's,
        and no row.
    channels : sequence of str, or mapping of str to str
        Names of the columns to take; a mapping has the joint of each, which messages may call it.
    follow : bool
        Wait for more at the end of a file, for ever.
    device : bool
        Take the column `device`, too: rows of several devices.
    mechanism : MechanismLike, optional
        Units of its channels: a row of units below the header is held against them, and is no row.

    Yields
    ------
    Rows
        One or more, in their order.

    Raises
    ------
    InputError
        There is no such file, its header has not each channel once, a column has another unit, or
        a file that is packed (gzip) is damaged.
    """
    name = os.fsdecode(source)
    if PurePath(name).suffix.lower() in PARQUET:
        if follow:
            found, expected = "a Parquet file, which does not grow", "a file of lines"
            raise InputError.at(name, found, expected)
        return _parquet(name, list(channels), device)
    joints = dict(channels) if isinstance(channels, Mapping) else {c: c for c in channels}
    return _text(name, joints, follow, device, mechanism)


def rows_in_memory(
    table: TableArg,
    channels: Sequence[str],
    *,
    device: bool = False,
    since: np.datetime64 | None = None,
) -> Rows:
    """Rows of a data frame or of columns; NaN where a cell cannot be used.

    Parameters
    ----------
    table : data frame, or mapping of str to array_like
        With the column `time_s` or without: numbers [s], or dates and durations of its library.
    channels : sequence of str
        Names of the columns to take.
    device : bool
        Take the column `device`, too.
    since : datetime64, optional
        From when dates are counted; from the first where not given.

    Raises
    ------
    InputError
        The table has not each channel once.
    """
    columns = columns_of(table)
    when = _places(list(columns), SOURCE, channels, device).time
    values = np.column_stack([_column(columns[name]) for name in channels])
    names = tuple(map(str, columns[DEVICE])) if device else None
    return Rows(values, None if when is None else _times(columns[TIME], since), names)


def _column(cells: Cells) -> FloatArray:
    return np.full(len(cells), np.nan) if is_dates(cells) else numbers(cells)


def _times(cells: Cells, since: np.datetime64 | None) -> FloatArray:
    return seconds_of_dates(np.asarray(cells), since) if is_dates(cells) else numbers(cells)


def _text(
    name: str,
    joints: dict[str, str],
    follow: bool,
    device: bool,
    mechanism: MechanismLike | None,
) -> Iterator[Rows]:
    with contextlib.ExitStack() as stack:
        if name == "-":
            label, descriptor = "standard input", sys.stdin.fileno()
        else:
            label = name
            try:
                file = stack.enter_context(open(name, "rb", buffering=0))
            except (OSError, ValueError) as error:  # a NUL in the path
                found = getattr(error, "strerror", None) or str(error)
                raise InputError.at(name, found, "a file of readings") from None
            descriptor = file.fileno()
        parts = parts_of(descriptor, label, follow and name != "-")
        first = next(parts, None)
        if first is None:
            raise InputError.at(label, "an empty file", EXPECTED, line=1)
        rest = itertools.chain([first], parts)
        if is_message(first[0].decode("utf-8", "replace").removeprefix("\ufeff")):
            if device:
                found, expected = "joint states, of one device", "a table with a column device"
                raise InputError.at(label, found, expected)
            yield from _messages(rest, joints)
        else:
            yield from _table(rest, label, list(joints), device, mechanism)


@dataclass(frozen=True)
class _Places:
    """Places of the channels, of the time and of the device among the columns."""

    channels: tuple[int, ...]
    time: int | None
    device: int | None


def _table(
    parts: Iterator[list[bytes]],
    label: str,
    channels: Sequence[str],
    device: bool,
    mechanism: MechanismLike | None,
) -> Iterator[Rows]:
    """Rows of CSV."""
    header, at, below = header_of(parts, label)
    marks = Marks(header, label, at)
    places = _places(marks.names, label, channels, device, at)
    clock = _Clock()
    for number, part in enumerate(below):
        lines = marks.plain(part)
        if number == 0 and mechanism is not None:
            lines = lines[_rows_of_units(lines[0], marks.names, label, mechanism, at + 1) :]
        if lines:
            yield _parsed(lines, places, clock)


def _rows_of_units(
    line: bytes, names: Sequence[str], label: str, mechanism: MechanismLike, at: int
) -> int:
    """How many rows of units stand at the top: 0 or 1."""
    cells = line.decode("utf-8", "replace").rstrip("\r").split(",")
    first = dict(zip(names, [*cells, *[""] * (len(names) - len(cells))], strict=False))
    if not is_units(first, mechanism):
        return 0
    for name, found, unit in wrong_units(first, mechanism):
        raise InputError.at(label, found, unit, line=at, column=name, hint=HINT)
    return 1


@dataclass
class _Clock:
    """Times of lines: numbers [s], or dates where the first of them is one, counted from that."""

    dated: bool | None = None
    first: np.datetime64 | None = None

    def reads_dates(self, cell: str) -> bool:
        """Whether times are dates, as the first that is asked about says."""
        if self.dated is None and cell:
            self.dated = math.isnan(_number(cell)) and date_of(cell) is not None
        return bool(self.dated)

    def seconds(self, cells: Sequence[str]) -> FloatArray:
        """Seconds since the first date; NaN of what is none."""
        found = [date_of(cell) for cell in cells]
        nothing = np.datetime64("NaT")
        dates = np.array([nothing if date is None else date for date in found], "datetime64[us]")
        if self.first is None or np.isnat(self.first):
            self.first = first_of(dates)
        return seconds_of_dates(dates, self.first)


def _messages(parts: Iterator[list[bytes]], joints: dict[str, str]) -> Iterator[Rows]:
    """Rows of joint states; NaN where a message is not whole."""
    lines = (line.decode("utf-8", "replace") for part in parts for line in part)
    timed: bool | None = None
    for _, text in documents(lines):
        found = message_of(text)
        found = positions_of(found) if isinstance(found, dict) else found
        at: dict[str, Any] = {} if isinstance(found, str) else found
        cells = [at.get(joint, at.get(channel)) for channel, joint in joints.items()]
        if at and all(cell is None for cell in cells):
            continue
        timed = "time_s" in at if timed is None and at else timed
        values = np.array([[_number(cell) for cell in cells]])
        moment = np.array([_number(at.get("time_s"))])
        yield Rows(values, moment if timed else None)


def _places(
    names: Sequence[str],
    label: str,
    channels: Sequence[str],
    device: bool,
    line: int | None = None,
) -> _Places:
    for column in [*channels, *([DEVICE] if device else [])]:
        count = names.count(column)
        if count != 1:
            found = "no such column" if count == 0 else f"{count} such columns"
            raise InputError.at(label, found, "one column", line=line, column=column)
    when = names.index("time_s") if names.count("time_s") == 1 else None
    own = tuple(names.index(channel) for channel in channels)
    return _Places(own, when, names.index(DEVICE) if device else None)


def _parsed(lines: list[bytes], places: _Places, clock: _Clock) -> Rows:
    columns, when = places.channels, places.time
    if when is not None and clock.reads_dates(_cell(lines[0], when)):
        undated = _parsed(lines, replace(places, time=None), clock)
        return replace(undated, time_s=clock.seconds([_cell(line, when) for line in lines]))
    wanted = [*columns] if when is None else [*columns, when]
    try:
        table = np.loadtxt(lines, delimiter=",", usecols=wanted, ndmin=2, comments=None)
    except ValueError:
        table = np.array([_cells(line, wanted) for line in lines])
    values = np.ascontiguousarray(table[:, : len(columns)])
    times = None if when is None else np.ascontiguousarray(table[:, -1])
    return Rows(values, times, _devices(lines, places.device))


def _devices(lines: list[bytes], place: int | None) -> tuple[str, ...] | None:
    """The device of each line; no name where a line is too short."""
    return None if place is None else tuple(_cell(line, place) for line in lines)


def _cell(line: bytes, place: int) -> str:
    """A cell of text; empty where a line is too short."""
    cell = b"".join(line.split(b",", place + 1)[place : place + 1])
    return cell.strip(b' \t\r"').decode("utf-8", "replace")


def _cells(line: bytes, wanted: list[int]) -> list[float]:
    """Cells of one line, one by one; NaN where there is none or it is no number."""
    cells = line.split(b",")
    out = []
    for place in wanted:
        try:
            out.append(float(cells[place]))
        except (ValueError, IndexError):
            out.append(np.nan)
    return out


def _parquet(name: str, channels: Sequence[str], device: bool) -> Iterator[Rows]:
    _, parquet = parquet_modules(name)
    try:
        file: Any = parquet.ParquetFile(name)
    except (OSError, ValueError) as error:
        found, expected = str(error).splitlines()[0], "a Parquet file of readings"
        raise InputError.at(name, found, expected) from None
    names = list(file.schema_arrow.names)
    when = _places(names, name, channels, device).time
    wanted = [*channels] if when is None else [*channels, "time_s"]
    asked = [*wanted, DEVICE] if device else wanted
    first = None
    for batch in file.iter_batches(batch_size=BATCH, columns=asked):
        raw = [batch.column(batch.schema.get_field_index(c)) for c in wanted]
        columns = [_floats(column) for column in raw]
        dates = None if when is None else _dates(raw[-1])
        if dates is not None:
            first = first_of(dates) if first is None or np.isnat(first) else first
            columns[-1] = seconds_of_dates(dates, first)
        values = np.column_stack(columns[: len(channels)])
        named = batch.column(batch.schema.get_field_index(DEVICE)).to_pylist() if device else None
        own = None if named is None else tuple("" if one is None else str(one) for one in named)
        yield Rows(np.ascontiguousarray(values), None if when is None else columns[-1], own)


def _dates(column: Any) -> npt.NDArray[Any] | None:
    """A column of dates or durations; None of other cells."""
    array = column.to_numpy(zero_copy_only=False)
    return array if array.dtype.kind in "mM" else None


def _floats(column: Any) -> FloatArray:
    """A column as numbers; NaN where it is none."""
    try:
        array = column.to_numpy(zero_copy_only=False)
        if array.dtype.kind in "mM":
            return np.full(len(array), np.nan)
        return np.array(array, dtype=np.float64)
    except (ValueError, TypeError):
        return np.array([_number(cell) for cell in column.to_pylist()])


def _number(cell: Any) -> float:
    try:
        return float(cell)
    except (TypeError, ValueError):
        return float("nan")
