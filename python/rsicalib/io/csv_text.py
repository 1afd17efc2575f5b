"""CSV text as rows of cells: where the header is, what parts cells, how decimals are written.

What is written has a comma between cells, and is read back unchanged.

A comma parts cells and a point stands before decimals. A file whose header has no comma, but
semicolons or tabs, is read as such, with decimal commas where its numbers leave no doubt.
"""

from __future__ import annotations

import csv
import io
import math
import re
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from rsicalib.errors import InputError

COMMENT = "#"
"""Lines above the header that begin so are no part of the table."""

DECIMAL_COMMA = re.compile(r"\s*[+-]?\d*,\d+(?:[eE][+-]?\d+)?\s*")
DECIMAL_POINT = re.compile(r"\s*[+-]?\d*\.\d*(?:[eE][+-]?\d+)?\s*")
THOUSANDS = re.compile(r"\s*[+-]?[1-9]\d{0,2},\d{3}\s*")
"""A number with a comma that may stand before decimals or before thousands."""


MISTAKES = {
    "unexpected end of data": "a quotation mark that no other one closes",
    "expected after": "text behind a closing quotation mark",
    "field larger": f"a cell of more than {csv.field_size_limit():,} characters",
}
"""What was found, by what the module `csv` says of it."""


@dataclass(frozen=True)
class CsvText:
    """Rows of cells of a CSV file, the header first.

    Attributes
    ----------
    rows : list of list of str
        Cells as they stand in the file.
    lines : list of int
        Line at which each row begins, from 1.
    decimal : {".", ","}
        What stands before decimals.
    """

    rows: list[list[str]]
    lines: list[int]
    decimal: str


def csv_of(columns: Mapping[str, Sequence[Any] | np.ndarray[Any, Any]]) -> str:
    """A file with these columns, by their names: numbers in arrays, text elsewhere."""
    file = io.StringIO()
    writer = csv.writer(file, lineterminator="\n")
    writer.writerow(columns)
    writer.writerows(zip(*map(_written, columns.values()), strict=True))
    return file.getvalue()


def _written(cells: Sequence[Any] | np.ndarray[Any, Any]) -> Sequence[Any]:
    """Text as it is; shortest text that is read back as the same number; empty for NaN."""
    if not isinstance(cells, np.ndarray):
        return cells
    return ["" if math.isnan(v) else repr(v).removesuffix(".0") for v in cells.tolist()]


def read_csv_text(content: str, source: str) -> CsvText:
    """Rows of a CSV file, without comment lines above the header and empty lines at the end.

    Raises
    ------
    InputError
        Quotes are not in pairs, or a comma may stand before decimals or before thousands.
    """
    above, content = _comments(content)
    header = content.split("\n", 1)[0]
    delimiter = delimiter_of(header)
    rows, lines = rows_of_text(content, source, delimiter, above)
    while rows and not rows[-1]:  # empty lines at the end say nothing, and editors leave them
        rows.pop()
    decimal = "." if delimiter == "," else decimal_mark(rows, lines, source)
    return CsvText(rows, lines[: len(rows)], decimal)


def delimiter_of(header: str) -> str:
    """What stands between the cells of a file with this header."""
    return next((d for d in ",;\t" if d in header), ",")


def _comments(content: str) -> tuple[int, str]:
    """How many comment lines stand above the header, and the text below them."""
    above = at = 0
    while content.startswith(COMMENT, at):
        end = content.find("\n", at)
        at = len(content) if end < 0 else end + 1
        above += 1
    return above, content[at:]


def rows_of_text(
    content: str, source: str, delimiter: str, above: int
) -> tuple[list[list[str]], list[int]]:
    """Cells of every row, and the line where each row begins, behind `above` lines.

    Raises
    ------
    InputError
        Quotes are not in pairs.
    """
    reader = csv.reader(io.StringIO(content, newline=""), strict=True, delimiter=delimiter)
    rows: list[list[str]] = []
    lines = [above + 1]
    try:
        for row in reader:
            rows.append(row)
            lines.append(above + reader.line_num + 1)  # where the next one begins
    except csv.Error as error:
        expected = "comma-separated values, quotes in pairs"
        found = next((words for said, words in MISTAKES.items() if said in str(error)), str(error))
        raise InputError.at(source, found, expected, line=lines[-1]) from None
    return rows, lines


def decimal_mark(rows: list[list[str]], lines: Iterable[int], source: str) -> str:
    """What stands before decimals in a file whose cells no comma parts; its header comes first.

    Raises
    ------
    InputError
        A comma may stand before decimals or before thousands.
    """
    commas = [
        (line, column, cell)
        for line, row in zip(lines, rows, strict=False)
        for column, cell in enumerate(row)
        if "," in cell and DECIMAL_COMMA.fullmatch(cell)
    ]
    points = any("." in cell and DECIMAL_POINT.fullmatch(cell) for row in rows[1:] for cell in row)
    if not commas or points:  # with both, a cell with a comma is refused as text
        return "."
    if all(THOUSANDS.fullmatch(cell) for _, _, cell in commas):
        line, column, cell = commas[0]
        name = rows[0][column] if column < len(rows[0]) else None
        found = f"{cell.strip()!r}, which can be a decimal or thousands"
        hint = "Write numbers with a decimal point, and without marks between thousands."
        raise InputError.at(source, found, "a number", line=line, column=name, hint=hint)
    return ","
