"""A table with a row for each value of each series, as Foxglove writes what a plot shows."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from rsicalib.errors import InputError
from rsicalib.io.tables import Table, is_blank, quoted
from rsicalib.io.times import seconds

SERIES, VALUE = "topic", "value"
TIMES = ("header.stamp", "receive time", "elapsed time")
"""Of a row; that of the measurement first, where each row has it."""


def in_columns(table: Table) -> Table:
    """The table with a column for each series, and a row for each time; others as they are.

    Parameters
    ----------
    table : Table
        A plot of Foxglove has the columns `elapsed time`, `receive time`, `header.stamp`, `topic`
        and `value`, one series after another.

    Returns
    -------
    Table
        A cell is None where a series has no value at that time.

    Raises
    ------
    InputError
        A time is none, or a series has two values at one time.
    """
    if not {SERIES, VALUE, "receive time"} <= {*table.names}:
        return table
    columns = dict(zip(table.names, table.columns, strict=True))
    known = [n for n in TIMES if n in columns and not any(map(is_blank, columns[n]))]
    if not known:
        expected = f"a time in each row ({', '.join(TIMES)})"
        raise InputError.at(table.source, "rows without one", expected)
    cells: Sequence[Any] = list(columns[known[0]])
    found = seconds(cells, known[0])
    if isinstance(found, int):
        raise table.fault(found, known[0], quoted(cells[found]), "a time")
    rows: dict[str, dict[str, Any]] = {}
    first: dict[str, int] = {}
    for k, (cell, name) in enumerate(zip(cells, columns[SERIES], strict=True)):
        row = rows.setdefault(str(cell), {})
        first.setdefault(str(cell), k)
        if str(name) in row:
            raise table.fault(k, SERIES, f"{name} twice at {cell}", "one value at a time")
        row[str(name)] = columns[VALUE][k]
    order = sorted(rows, key=lambda cell: found[0][first[cell]])
    names = list(dict.fromkeys(map(str, columns[SERIES])))
    made: list[Any] = [order, *([rows[cell].get(name) for cell in order] for name in names)]
    lines = np.array([table.lines[first[cell]] for cell in order], dtype=np.int64)
    return replace(table, names=[known[0], *names], columns=made, lines=lines, ragged={})
