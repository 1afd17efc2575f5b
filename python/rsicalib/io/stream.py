"""Readings as they arrive: rows of a file or of a pipe, a few at a time, in constant memory.

`rsicalib.io.readings` refuses a file as a whole. Here nothing can be refused after the header: a
cell that cannot be used becomes NaN, and so do all cells of a row that does not fit the header. The
row is counted by whoever takes it. What a header and a cell must be is the same for both.
"""

from __future__ import annotations

import contextlib
import itertools
import math
import os
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import PurePath
from typing import Any

import numpy as np
import numpy.typing as npt

from rsicalib import _core
from rsicalib.arrays import FloatArray
from rsicalib.errors import InputError
from rsicalib.io.cells import MechanismLike, read_header
from rsicalib.io.extras import parquet_modules, read_by
from rsicalib.io.frames import SOURCE, TableArg, columns_of
from rsicalib.io.lines import EXPECTED, Marks, header_of, parts_of
from rsicalib.io.messages import documents, is_message, message_of, positions_of
from rsicalib.io.sources import ON_STREAM, STANDARD_INPUT, refused_alike, standard_input
from rsicalib.io.tables import (
    PARQUET,
    Ragged,
    Table,
    columns_of_rows,
    is_dates,
    number,
    numbers,
    parquet_cells,
    text,
)
from rsicalib.io.times import TIME, date_of, first_of, seconds_of_dates
from rsicalib.io.units_row import without_units

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
    mechanism: MechanismLike,
    joints: Mapping[str, str] | None = None,
    *,
    follow: bool = False,
    device: bool = False,
) -> Iterator[Rows]:
    """Rows of a file as they stand there, or of standard input (`-`) as they arrive.

    Parameters
    ----------
    source : path or "-"
        CSV or joint states as text (`rsicalib.io.messages`), also packed by gzip, or Parquet if it
        ends in `.parquet` or `.pq`. A message without any of the channels is another publisher's,
        and no row.
    mechanism : MechanismLike
        Whose channels are taken. A row of units below the header is held against its units, and is
        no row.
    joints : mapping of str to str, optional
        The joint of each channel, which messages may call it.
    follow : bool
        Wait for more at the end of a file, for ever.
    device : bool
        Take the column `device`, too: rows of several devices.

    Yields
    ------
    Rows
        One or more, in their order.

    Raises
    ------
    InputError
        There is no such file, its header is refused (`rsicalib.io.cells.read_header`), a column
        has another unit, a file is damaged, or it ends without a row.
    """
    name = os.fsdecode(source)
    if PurePath(name).suffix.lower() in PARQUET:
        if follow:
            found, expected = "a Parquet file, which does not grow", "a file of lines"
            raise InputError.at(name, found, expected)
        return _some(_parquet(name, mechanism, device), name)
    named = joints or {channel.name: channel.name for channel in mechanism.channels}
    return _some(_text(name, mechanism, named, follow, device), name)


def _some(rows: Iterator[Rows], name: str) -> Iterator[Rows]:
    """The same rows; refused at their end where there are none."""
    first = next(rows, None)
    if first is None:
        source = ON_STREAM if name == STANDARD_INPUT else name
        raise InputError.at(source, "no readings", "at least one row below the header")
    yield first
    yield from rows


def rows_in_memory(
    table: TableArg,
    mechanism: MechanismLike,
    *,
    device: bool = False,
    since: np.datetime64 | None = None,
) -> Rows:
    """Rows of a data frame or of columns; NaN where a cell cannot be used.

    Parameters
    ----------
    table : data frame, or mapping of str to array_like
        With the column `time_s` or without: numbers [s], or dates and durations of its library.
    mechanism : MechanismLike
        Whose channels are taken.
    device : bool
        Take the column `device`, too.
    since : datetime64, optional
        From when dates are counted; from the first where not given.

    Raises
    ------
    InputError
        The header is refused (`rsicalib.io.cells.read_header`).
    """
    columns = columns_of(table)
    count = max(map(len, columns.values()), default=0)
    whole = Table([*columns], [*columns.values()], np.arange(1, count + 1), "row", SOURCE, "")
    return _Taken(whole, mechanism, device, since).rows(whole)


class _Taken:
    """What is taken of tables with one header: columns of the channels, the time, the device."""

    def __init__(
        self,
        table: Table,
        mechanism: MechanismLike,
        device: bool,
        since: np.datetime64 | None = None,
    ) -> None:
        self.index, _ = read_header(table, mechanism)
        names = [channel.name for channel in mechanism.channels]
        self._channels = [self.index[name] for name in names]
        # A channel may be called as it likes.
        self._time = None if TIME in names else self.index.get(TIME)
        self._device = _device_of(table) if device else None
        self._dated: bool | None = None
        self._first: Any = since

    @property
    def places(self) -> list[int]:
        """Places of the columns that are taken."""
        others = [place for place in (self._time, self._device) if place is not None]
        return [*self._channels, *others]

    def rows(self, table: Table) -> Rows:
        """Rows of a table."""
        values = np.empty((len(table.lines), len(self._channels)))
        for k, place in enumerate(self._channels):
            values[:, k] = table.numbers(place)
        if table.ragged:
            values[[*table.ragged]] = math.nan
        times = None if self._time is None else self._seconds(table, self._time)
        if self._device is None:
            return Rows(values, times)
        return Rows(values, times, tuple(map(text, table.columns[self._device])))

    def _seconds(self, table: Table, place: int) -> FloatArray:
        """Times as numbers [s]; or dates where the first of them is one, counted from that."""
        cells = table.columns[place]
        if is_dates(cells):
            dates = np.asarray(cells)
        elif table.line_word == "line" and self._is_dated(cells[0]):
            found = [date_of(text(cell)) for cell in cells]
            nothing = np.datetime64("NaT")
            dates = np.array([nothing if d is None else d for d in found], "datetime64[us]")
        else:
            return table.numbers(place)
        if self._first is None or np.isnat(self._first):
            self._first = first_of(dates)
        return seconds_of_dates(dates, self._first)

    def _is_dated(self, cell: Any) -> bool:
        """Whether times are written as dates: the first that is written says so."""
        if self._dated is None and (first := text(cell)):
            self._dated = math.isnan(number(first)) and date_of(first) is not None
        return bool(self._dated)


def _device_of(table: Table) -> int:
    """Place of the column of devices."""
    count = table.names.count(DEVICE)
    if count != 1:
        found = "no such column" if count == 0 else f"{count} such columns"
        line = table.header if table.line_word == "line" else None
        raise InputError.at(table.source, found, "one column", line=line, column=DEVICE)
    return table.names.index(DEVICE)


def _text(
    name: str,
    mechanism: MechanismLike,
    joints: Mapping[str, str],
    follow: bool,
    device: bool,
) -> Iterator[Rows]:
    with contextlib.ExitStack() as stack:
        expected = "a file of readings"
        if name == STANDARD_INPUT:
            label, descriptor = ON_STREAM, standard_input(expected).fileno()
        else:
            with refused_alike(name, expected):
                file = stack.enter_context(open(name, "rb", buffering=0))
            label, descriptor = name, file.fileno()
        parts = parts_of(descriptor, label, follow and name != STANDARD_INPUT)
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
            yield from _table(rest, label, mechanism, device)


def _table(
    parts: Iterator[list[bytes]], label: str, mechanism: MechanismLike, device: bool
) -> Iterator[Rows]:
    """Rows of CSV."""
    header, at, below = header_of(parts, label)
    marks = Marks(header, label, at)
    taken = _Taken(_table_of_lines([], marks.names, label, at), mechanism, device)
    for count, part in enumerate(below):
        table = _table_of_lines(marks.plain(part), marks.names, label, at)
        if count == 0:
            table = without_units(table, mechanism, taken.index)
        if len(table.lines):
            yield taken.rows(table)


def _table_of_lines(lines: list[bytes], names: list[str], label: str, header: int) -> Table:
    """Some lines of CSV below a header."""
    # Lines of numbers alone are read at once; on any doubt cell by cell, as a whole file is.
    plain = _core.plain_numbers(b"\n".join(lines), 0, len(names)) if lines else None
    columns: list[Sequence[Any] | npt.NDArray[Any]]
    ragged: dict[int, Ragged] = {}
    if plain is not None and len(plain[0]) == len(lines):
        columns = [*plain]
    else:
        rows = b"\n".join(lines).decode("utf-8", "replace").split("\n") if lines else []
        columns, ragged = columns_of_rows([row.rstrip("\r").split(",") for row in rows], names)
    at = np.arange(header + 1, header + 1 + len(lines))
    return Table(names, columns, at, "line", label, "", ragged, header)


def _messages(parts: Iterator[list[bytes]], joints: Mapping[str, str]) -> Iterator[Rows]:
    """Rows of joint states; NaN where a message is not whole."""
    lines = (line.decode("utf-8", "replace") for part in parts for line in part)
    timed: bool | None = None
    for _, document in documents(lines):
        found = message_of(document)
        found = positions_of(found) if isinstance(found, dict) else found
        at: dict[str, Any] = {} if isinstance(found, str) else found
        cells = [at.get(joint, at.get(channel)) for channel, joint in joints.items()]
        if at and all(cell is None for cell in cells):
            continue
        timed = "time_s" in at if timed is None and at else timed
        moment = numbers([at.get("time_s")]) if timed else None
        yield Rows(numbers(cells)[np.newaxis], moment)


def _parquet(name: str, mechanism: MechanismLike, device: bool) -> Iterator[Rows]:
    pyarrow, parquet = parquet_modules(name)
    with refused_alike(name, "a file of readings"), open(name, "rb"):
        pass  # it is there
    with read_by("pyarrow", name, "a Parquet file"):
        file: Any = parquet.ParquetFile(name)
    called = list(file.schema_arrow.names)
    names = [one.strip() for one in called]

    def table_of(part: Any, places: Sequence[int]) -> Table:
        """Columns of a table of pyarrow in their places; the others are empty."""
        cells: list[Any] = [()] * len(names)
        for place, column in zip(places, part.columns, strict=True):
            cells[place] = parquet_cells(column, pyarrow.types)
        return Table(names, cells, np.arange(1, len(part) + 1), "row", name, "")

    none = file.schema_arrow.empty_table()
    taken = _Taken(table_of(none, range(len(names))), mechanism, device)
    wanted = [called[place] for place in taken.places]
    batches = file.iter_batches(batch_size=BATCH, columns=wanted)
    while True:
        with read_by("pyarrow", name, "a Parquet file"):
            batch = next(batches, None)
            if batch is None:
                return
            part = pyarrow.Table.from_batches([batch]).select(wanted)
        yield taken.rows(table_of(part, taken.places))
