"""Readings as they arrive: rows of a file or of a pipe, a few at a time, in constant memory.

`rsicalib.io.readings` refuses a file as a whole. Here nothing can be refused after the header: a
cell that cannot be used becomes NaN, and the row is counted by whoever takes it.
"""

from __future__ import annotations

import contextlib
import csv
import importlib
import os
import sys
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import PurePath
from typing import Any

import numpy as np

from rsicalib.arrays import FloatArray
from rsicalib.errors import InputError
from rsicalib.io.sources import LONGEST_LINE
from rsicalib.io.tables import PARQUET

__all__ = ["Rows", "rows_of"]

CHUNK = 1 << 16
"""Bytes that are read at a time, at most: what a pipe holds is taken as soon as it is there."""

BATCH = 4096
"""Rows of a Parquet file that are read at a time."""

EXPECTED = "a header with a column for each channel, then one line per sample"


@dataclass(frozen=True, eq=False)
class Rows:
    """Some rows: `values` (n, channels), NaN where unusable, and `time_s` (n,) or None."""

    values: FloatArray
    time_s: FloatArray | None


def rows_of(source: str | os.PathLike[str], channels: Sequence[str]) -> Iterator[Rows]:
    """Rows of a file as they stand there, or of standard input (`-`) as they arrive.

    Parameters
    ----------
    source : path or "-"
        CSV, or Parquet if it ends in `.parquet` or `.pq`.
    channels : sequence of str
        Names of the columns to take.

    Yields
    ------
    Rows
        One or more, in their order.

    Raises
    ------
    InputError
        There is no such file, or its header has not each channel once.
    """
    name = os.fsdecode(source)
    if PurePath(name).suffix.lower() in PARQUET:
        return _parquet(name, channels)
    return _csv(name, channels)


def _csv(name: str, channels: Sequence[str]) -> Iterator[Rows]:
    with contextlib.ExitStack() as stack:
        if name == "-":
            label, descriptor = "standard input", sys.stdin.fileno()
        else:
            label = name
            try:
                file = stack.enter_context(open(name, "rb", buffering=0))
            except OSError as error:
                found = error.strerror or str(error)
                raise InputError.at(name, found=found, expected="a file of readings") from None
            descriptor = file.fileno()
        yield from _lines(descriptor, label, channels)


def _lines(descriptor: int, label: str, channels: Sequence[str]) -> Iterator[Rows]:
    columns: list[int] | None = None
    time: int | None = None
    rest = b""
    while True:
        chunk = os.read(descriptor, CHUNK)
        *lines, rest = (rest + chunk).split(b"\n") if chunk else (rest, b"")
        if len(rest) > LONGEST_LINE:
            found = f"a line of more than {LONGEST_LINE:,} bytes"
            raise InputError.at(label, found=found, expected="one line per sample")
        if columns is None and lines:
            columns, time = _header(lines.pop(0), label, channels)
        lines = [line for line in lines if line.strip()]
        if lines and columns is not None:
            yield _parsed(lines, columns, time)
        if not chunk:
            if columns is None:
                raise InputError.at(label, line=1, found="an empty file", expected=EXPECTED)
            return


def _header(line: bytes, label: str, channels: Sequence[str]) -> tuple[list[int], int | None]:
    """Places of the channels, and of the time."""
    try:
        text = line.decode("utf-8-sig")
    except UnicodeDecodeError:
        found = "text that is not UTF-8"
        raise InputError.at(label, line=1, found=found, expected=EXPECTED) from None
    names = [cell.strip() for cell in next(csv.reader([text]), [])]
    return _places(names, label, channels)


def _places(
    names: Sequence[str], label: str, channels: Sequence[str]
) -> tuple[list[int], int | None]:
    for channel in channels:
        count = names.count(channel)
        if count != 1:
            found = "no such column" if count == 0 else f"{count} such columns"
            raise InputError.at(label, line=1, column=channel, found=found, expected="one column")
    time = names.index("time_s") if names.count("time_s") == 1 else None
    return [names.index(channel) for channel in channels], time


def _parsed(lines: list[bytes], columns: list[int], time: int | None) -> Rows:
    wanted = columns if time is None else [*columns, time]
    try:
        table = np.loadtxt(lines, delimiter=",", usecols=wanted, ndmin=2, comments=None)
    except ValueError:
        table = np.array([_cells(line, wanted) for line in lines])
    values = np.ascontiguousarray(table[:, : len(columns)])
    return Rows(values, None if time is None else np.ascontiguousarray(table[:, -1]))


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


def _parquet(name: str, channels: Sequence[str]) -> Iterator[Rows]:
    try:
        parquet = importlib.import_module("pyarrow.parquet")
    except ImportError:
        expected = "pyarrow, which `pip install 'rsicalib[parquet]'` brings"
        raise InputError.at(name, found="a Parquet file", expected=expected) from None
    try:
        file: Any = parquet.ParquetFile(name)
    except (OSError, ValueError) as error:
        found, expected = str(error).splitlines()[0], "a Parquet file of readings"
        raise InputError.at(name, found=found, expected=expected) from None
    names = list(file.schema_arrow.names)
    _, time = _places(names, name, channels)
    wanted = [*channels] if time is None else [*channels, "time_s"]
    for batch in file.iter_batches(batch_size=BATCH, columns=wanted):
        columns = [_floats(batch.column(batch.schema.get_field_index(c))) for c in wanted]
        values = np.column_stack(columns[: len(channels)])
        yield Rows(np.ascontiguousarray(values), None if time is None else columns[-1])


def _floats(column: Any) -> FloatArray:
    """A column as numbers; NaN where it is none."""
    try:
        return np.array(column.to_numpy(zero_copy_only=False), dtype=np.float64)
    except (ValueError, TypeError):
        return np.array([_number(cell) for cell in column.to_pylist()])


def _number(cell: Any) -> float:
    try:
        return float(cell)
    except (TypeError, ValueError):
        return float("nan")
