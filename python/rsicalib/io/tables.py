"""Tables as they stand in a file: names, cells and line numbers, nothing interpreted.

`rsicalib.io.readings` decides what the cells mean and which of them cannot be used.
"""

from __future__ import annotations

import hashlib
import io
import math
import os
import re
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field, replace
from pathlib import PurePath
from typing import Any

import numpy as np
import numpy.typing as npt

from rsicalib import _core
from rsicalib.arrays import FloatArray, IntArray
from rsicalib.errors import InputError
from rsicalib.io.csv_text import read_csv_text
from rsicalib.io.extras import parquet_modules, read_by
from rsicalib.io.sources import decoded, read_bytes, refuse_larger, unpacked
from rsicalib.io.times import dates_of, seconds_of_dates
from rsicalib.plain_text import counted

PARQUET = {".parquet", ".pq"}
CHUNK = 1 << 25
"""Bytes of a CSV file that are read at a time."""

BOM = b"\xef\xbb\xbf"
USED = "used"
"""The column that says which rows are used."""
HINT = "Save the file as CSV in UTF-8."


@dataclass(frozen=True)
class Ragged:
    """A row with too few or too many cells."""

    column: str
    found: str
    expected: str


@dataclass(frozen=True, eq=False)
class Lines:
    """Where rows stand.

    Attributes
    ----------
    source : str
        What messages call it.
    numbers : ndarray of int, shape (n,)
        Of each row.
    word : str
        What `numbers` count.
    """

    source: str
    numbers: IntArray
    word: str

    def fault(self, row: int, found: str, expected: str, **more: Any) -> InputError:
        """What is wrong with a row: ready to be raised; `more` is as for `InputError.at`."""
        line = int(self.numbers[row])
        return InputError.at(self.source, found, expected, line=line, line_word=self.word, **more)


@dataclass(frozen=True, eq=False)
class Table:
    """A table of `n` rows, column by column.

    Attributes
    ----------
    names : list of str
        The header, without surrounding spaces; names may be doubled.
    columns : list of sequences, each of length n
        Raw cells: text from a CSV file, numbers or objects from elsewhere
        (None where a cell is empty).
    lines : ndarray, shape (n,)
        Where each row stands, from 1.
    line_word : {"line", "row"}
        What `lines` counts.
    source, sha256 : str
        Path as given, and the digest of its bytes.
    ragged : dict of int to Ragged
        Rows whose cells do not fit the header; they are padded or cut in `columns`.
    header : int
        Line of the header.
    decimal : {".", ","}
        What stands before decimals in text.
    in_memory : bool
        Whether the caller had it in memory: there is no file that it stands in.
    """

    names: list[str]
    columns: list[Sequence[Any] | npt.NDArray[Any]]
    lines: IntArray
    line_word: str
    source: str
    sha256: str
    ragged: dict[int, Ragged] = field(default_factory=dict)
    header: int = 1
    decimal: str = "."
    in_memory: bool = False

    def fault(
        self, row: int, column: str | None, found: str, expected: str, hint: str = ""
    ) -> InputError:
        """What is wrong with a cell or, without `column`, with a row: ready to be raised."""
        return self.stands.fault(row, found, expected, column=column, hint=hint)

    @property
    def stands(self) -> Lines:
        """Where its rows stand."""
        return Lines(self.source, self.lines, self.line_word)

    def numbers(self, position: int) -> FloatArray:
        """A column as numbers, shape (n,); NaN where a cell is none."""
        cells = self.columns[position]
        if is_dates(cells):
            return np.full(len(cells), np.nan)
        if isinstance(cells, np.ndarray) and cells.dtype == np.float16:
            name = self.names[position]
            found = "float16, which has no number between 2048 and 2050"
            expected = "float32 or float64"
            raise InputError.at(self.source, found, expected, column=name)
        if self.decimal == ".":
            return numbers(cells)
        # With decimal commas, a point is no part of a number.
        return numbers([str(c).replace(".", "?").replace(",", ".") for c in cells])

    def times(self, position: int) -> FloatArray:
        """A column of times in seconds: numbers as they are, dates from the first on."""
        cells = self.columns[position]
        return seconds_of_dates(np.asarray(cells)) if is_dates(cells) else self.numbers(position)


def is_dates(cells: Sequence[Any] | npt.NDArray[Any]) -> bool:
    """Whether a column holds dates or durations of a library, not text or numbers."""
    return isinstance(cells, np.ndarray) and cells.dtype.kind in "mM"


@dataclass(frozen=True)
class File:
    """The bytes of a file of readings, the digest of what stands on the disk, the path as given.

    A file that was compressed by gzip holds its bytes as they were before.
    """

    source: str
    data: bytes
    sha256: str

    @property
    def is_parquet(self) -> bool:
        """Whether its name says so; it is CSV otherwise."""
        return PurePath(self.source).suffix.lower() in PARQUET


def read_file(path: str | os.PathLike[str]) -> File:
    """Read the bytes of a file; `-` is standard input.

    Raises
    ------
    InputError
        There is no such file, or it cannot be read.
    """
    data, source = read_bytes(path, "a file of readings"), os.fsdecode(path)
    return File(source, unpacked(data, source), hashlib.sha256(data).hexdigest())


def read_table(path: str | os.PathLike[str]) -> Table:
    """Read a file: Parquet if its name ends so, else CSV; `-` is standard input.

    CSV may be compressed by gzip, and may have comment lines (`#`) above its header.

    Raises
    ------
    InputError
        There is no such file, or it is no such table.
    """
    return table_of_file(read_file(path))


def chunks(path: str | os.PathLike[str], size: int = CHUNK) -> Iterator[Table]:
    """Read a CSV file some rows at a time; there is at least one table.

    A file that is not plain (quotes, packed, comments, semicolons) is one table: where its rows
    end is told by all of it.

    Raises
    ------
    InputError
        There is no such file, or it is no such table.
    """
    source = os.fsdecode(path)
    try:
        large = os.path.getsize(path) > size
    except (OSError, ValueError):
        large = False
    if not large or not _is_plain(source):
        yield read_table(path)
        return
    with open(source, "rb") as file:
        header = file.readline()
        line = 1
        while data := file.read(size):
            data += file.readline()
            table = table_of_file(File(source, header + data, ""))
            yield replace(table, lines=table.lines + (line - 1))
            line += data.count(b"\n")


def _is_plain(source: str) -> bool:
    """Whether lines of a file are rows, with commas between cells."""
    with open(source, "rb") as file:
        header = file.readline()
        if b"," not in header or header.startswith((b"#", b"\x1f\x8b")) or not header.strip():
            return False
        file.seek(0)
        while data := file.read(CHUNK):
            if b'"' in data or (b"\r" in data and b"\r\n" not in data):
                return False
    return True


def table_of_file(file: File) -> Table:
    """The table in a file, cell by cell.

    Raises
    ------
    InputError
        It is no such table.
    """
    read = _read_parquet if file.is_parquet else _read_csv
    return read(file.data, file.source, file.sha256)


def table_of_numbers(file: File) -> Table | None:
    """The table in a CSV file that holds a header and numbers, and surely nothing else.

    None on any doubt: `table_of_file` then says what the file is. Where there is none, both give
    the same names, lines and numbers.
    """
    if file.is_parquet:
        return None
    data = file.data
    start = len(BOM) if data.startswith(BOM) else 0
    end = data.find(b"\n", start) + 1
    header = data[start:end].removesuffix(b"\n").removesuffix(b"\r")
    if not header.strip() or b'"' in header or b"\r" in header or header.startswith(b"#"):
        return None
    try:
        names = [name.strip() for name in header.decode("utf-8").split(",")]
    except UnicodeDecodeError:
        return None
    columns = _core.plain_numbers(data, end, len(names))
    if columns is None:
        return None
    lines = np.arange(2, len(columns[0]) + 2, dtype=np.int64)
    return Table(names, list(columns), lines, "line", file.source, file.sha256)


def _read_csv(data: bytes, source: str, sha256: str) -> Table:
    text = read_csv_text(decoded(data, source, hint=HINT), source)
    rows, lines = text.rows, text.lines
    if not rows:
        found, expected = "an empty file", "a header line, then one line per sample"
        raise InputError.at(source, found, expected, line=1)
    names = [name.strip() for name in rows[0]]
    columns, ragged = columns_of_rows(rows[1:], names)
    return Table(
        names=names,
        columns=columns,
        lines=np.array(lines[1:], dtype=np.int64),
        line_word="line",
        source=source,
        sha256=sha256,
        ragged=ragged,
        header=lines[0],
        decimal=text.decimal,
    )


def columns_of_rows(
    rows: list[list[str]], names: list[str]
) -> tuple[list[Sequence[Any] | npt.NDArray[Any]], dict[int, Ragged]]:
    """Rows of text as a column for each name, and the rows whose cells do not fit the names.

    Those are padded or cut, in `rows` as well.
    """
    ragged = {i: _misfit(row, names) for i, row in enumerate(rows) if len(row) != len(names)}
    for i in ragged:
        rows[i] = (rows[i] + [""] * len(names))[: len(names)]
    columns: list[Sequence[Any] | npt.NDArray[Any]] = list(zip(*rows, strict=True))
    return columns or [() for _ in names], ragged


def _misfit(row: list[str], names: list[str]) -> Ragged:
    column = names[len(row)] if len(row) < len(names) else f"{len(names) + 1} (beyond the last)"
    found = "an empty line" if not row else counted(len(row), "cell")
    return Ragged(column, found, f"{len(names)} cells, as in the header")


def _read_parquet(data: bytes, source: str, sha256: str) -> Table:
    pyarrow, parquet = parquet_modules(source)
    with read_by("pyarrow", source, "a Parquet file"):
        file = parquet.ParquetFile(io.BytesIO(data))
        # A column that repeats one number takes no room in the file.
        refuse_larger(8.0 * file.metadata.num_rows * file.metadata.num_columns, source, " in cells")
        table = file.read()
        columns = [parquet_cells(column, pyarrow.types) for column in table.columns]
    return Table(
        names=[name.strip() for name in table.column_names],
        columns=columns,
        lines=np.arange(1, table.num_rows + 1, dtype=np.int64),
        line_word="row",
        source=source,
        sha256=sha256,
    )


def parquet_cells(column: Any, types: Any) -> Sequence[Any] | npt.NDArray[Any]:
    """Cells of a column of pyarrow, a chunked one; None where a cell is empty."""
    if types.is_timestamp(column.type) or types.is_duration(column.type):
        dates: npt.NDArray[Any] = column.to_numpy()
        return dates
    plain = types.is_integer(column.type) or types.is_floating(column.type)
    cells: Sequence[Any] | npt.NDArray[Any]
    cells = column.to_numpy() if plain and not column.null_count else column.to_pylist()
    return cells


def table_of_arrays(blocks: list[tuple[Sequence[str], object]], source: str) -> Table:
    """Arrays as a table of `n` rows.

    Parameters
    ----------
    blocks : list of (names, array_like)
        Names of the columns of one array: shape (n, len(names)), or (n,) for one name.
        The first array says what `n` is.
    source : str
        What messages call them.

    Returns
    -------
    Table
        `sha256` is the digest of names and arrays in the order given.
    """
    digest = hashlib.sha256()
    names: list[str] = []
    columns: list[Sequence[Any] | npt.NDArray[Any]] = []
    rows = -1
    for group, given in blocks:
        array = _array(given, group[0] if len(group) == 1 else None, source)
        rows = rows if rows >= 0 or not array.ndim else len(array)
        shape = (rows,) if len(group) == 1 and array.ndim == 1 else (rows, len(group))
        if array.shape != shape:
            name = group[0] if len(group) == 1 else None
            found = f"shape {array.shape}"
            expected = f"shape ({max(rows, 0)}, {len(group)})" if name is None else f"{rows} values"
            raise InputError.at(source, found, expected, column=name)
        for name, cells in zip(group, array.reshape(rows, len(group)).T, strict=True):
            names.append(name)
            plain = array.dtype.kind in "iufmM"
            columns.append(cells if plain else cells.tolist())
            digest.update(name.encode() + b"\0")
            digest.update(cells.tobytes() if plain else repr(cells.tolist()).encode())
    lines = np.arange(1, rows + 1, dtype=np.int64)
    return Table(names, columns, lines, "row", source, digest.hexdigest(), in_memory=True)


def _array(given: object, column: str | None, source: str) -> npt.NDArray[Any]:
    """An array of numbers, text or objects, or of dates."""
    try:
        array = uncast(given)
    except ValueError as error:
        raise InputError.at(source, str(error), "an array", column=column) from None
    if array.dtype.kind == "b" and column == USED:
        array = array.astype(np.int64)
    if array.dtype.kind not in "iufUOmM":
        found = f"type {array.dtype}"
        raise InputError.at(source, found, "numbers", column=column)
    dates = dates_of(array) if array.ndim == 1 else None
    return array if dates is None else dates


def uncast(given: object) -> npt.NDArray[Any]:
    """An array of what is given; of objects where NumPy would make 1 of a True among numbers, or
    'nan' of a NaN among texts.

    What is masked becomes None, which counts as blank.
    """
    if isinstance(given, np.ma.MaskedArray):
        array = given.data.astype(object)
        array[np.ma.getmaskarray(given)] = None
        return array
    array = np.asarray(given)
    if array is given or array.dtype.kind not in "iufU" or hasattr(given, "dtype"):
        return array
    cells = np.asarray(given, dtype=object)
    if array.dtype.kind == "U":
        return array if all(isinstance(c, str) for c in cells.flat) else cells
    return cells if any(isinstance(c, bool | np.bool_) for c in cells.flat) else array


def numbers(cells: Sequence[Any] | npt.NDArray[Any]) -> FloatArray:
    """Cells as numbers, shape (n,), an array of numbers as it is; NaN where a cell is none.

    What `float` accepts, but no underscores: `1_5` is more likely a slip than
    fifteen. Digits are 0 to 9, as everywhere else in files and commands. Spaces around a number
    are no part of it.
    """
    if isinstance(cells, np.ndarray):
        return cells.astype(np.float64, copy=False)
    try:
        together = "".join(cells)
        if "_" not in together and together.isascii():
            return np.fromiter(map(float, cells), np.float64, len(cells))
    except (TypeError, ValueError):
        pass  # some cell is no number: go one by one
    return np.fromiter(map(number, cells), np.float64, len(cells))


def number(cell: Any) -> float:
    """One cell as a number, as `numbers` reads it; NaN where it is none."""
    if isinstance(cell, bool | np.bool_) or (isinstance(cell, str) and not _plain(cell)):
        return math.nan
    try:
        return float(cell)
    except (TypeError, ValueError, OverflowError):
        return math.nan


def _plain(cell: str) -> bool:
    return "_" not in cell and cell.strip().isascii()


def text(cell: Any) -> str:
    """A cell as text, without surrounding spaces; empty where there is nothing."""
    empty = is_blank(cell) or (isinstance(cell, float) and math.isnan(cell))
    return "" if empty else str(cell).strip()


def is_blank(cell: Any) -> bool:
    """Whether nothing stands in a cell."""
    return cell is None or (isinstance(cell, str) and not cell.strip())


DECIMAL_COMMA = re.compile(r"[+-]?\d*,\d+([eE][+-]?\d+)?", re.ASCII)


def quoted(cell: Any) -> str:
    """A cell as a message shows it: `blank`, `NaN`, a bare number, or text in quotes."""
    if is_blank(cell):
        return "blank"
    value = number(cell)
    if math.isfinite(value):
        return str(value) if isinstance(cell, np.floating | float) else _cut(str(cell).strip())
    if isinstance(cell, np.floating | float):
        return "NaN" if math.isnan(value) else str(value)
    shown = str(cell).strip()
    other = " in digits other than 0 to 9" if any(map(str.isdecimal, shown)) else ""
    other = "" if shown.isascii() else other
    other = " with a decimal comma" if DECIMAL_COMMA.fullmatch(shown) else other
    return repr(_cut(shown)) + other


def _cut(shown: str) -> str:
    """A text, of which no more than a line is shown."""
    return shown if len(shown) <= 40 else f"{shown[:37]}..."
