"""Columns of a table that stand beside its channels: labels, temperatures, poses, distances."""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping

import numpy as np

from rsicalib.arrays import FloatArray
from rsicalib.imports.asked import Asked, chosen
from rsicalib.imports.log import Column
from rsicalib.io.cells import COLUMNS, POSE, TEXTS
from rsicalib.io.tables import USED, Table, quoted, text
from rsicalib.io.times import TIME
from rsicalib.io.units_row import same_unit

LABELS = ("pose", "sample")
UNIT = re.compile(r"[\[(]\s*([^\[\]()]+?)\s*[\])]\s*$")
"""A unit at the end of a header: `elbow [°]`."""


def columns_beside(table: Table, asked: Asked) -> dict[str, int]:
    """Place of each column that readings know, or that the mechanism needs, by its name.

    Parameters
    ----------
    table : Table
        As it stands in the file.
    asked : Asked
        `beside` are columns that bear another name in the log, `needed` those that a mechanism
        needs under their own; `labels` stand in place of a column.

    Returns
    -------
    dict of str to int
        An optional column that cannot be used is not among them.

    Raises
    ------
    InputError
        A column that was given by name is not there, or two have its name.
    """
    needed = asked.needs.columns
    own = [name for name in (*COLUMNS, *needed) if name in table.names and name != TIME]
    wanted = {name: name for name in own if name not in asked.labels} | dict(asked.beside)
    places = chosen(wanted, table.names, table.source)
    sure = {*needed, *asked.beside}
    out = {n for n in places if n not in sure and not _usable(table, n, places[n])}
    known = [name for name in POSE if name in places and name not in out]
    if known not in ([*POSE], [*POSE[:3]]):
        out |= {*known} - sure
    if "pose" not in places or "pose" in out or asked.hold:
        out |= {*LABELS} - sure
    return {name: place for name, place in places.items() if name not in out}


def _usable(table: Table, name: str, place: int) -> bool:
    """Whether an optional column is what its name says."""
    if name in TEXTS:
        return any(text(cell) for cell in table.columns[place])
    values = table.numbers(place)
    if name in LABELS:
        return bool(np.all(values == np.rint(values)))
    if name == USED:
        return bool(np.isin(values, (0.0, 1.0)).all())
    known = np.isfinite(values)
    return bool(known.any() if name in POSE else known.all())


def cells_beside(
    table: Table, places: Mapping[str, int], keep: np.ndarray, asked: Asked
) -> dict[str, Column]:
    """The cells of such columns: text of labels, else numbers, NaN where a cell is blank.

    Raises
    ------
    InputError
        A cell is neither a number nor blank.
    """
    made: dict[str, Column] = {}
    for name, place in places.items():
        if name in TEXTS or name in asked.needs.texts:
            made[name] = [text(table.columns[place][k]) for k in keep.tolist()]
            continue
        values: FloatArray = table.numbers(place)[keep]
        for k in np.flatnonzero(~np.isfinite(values)).tolist():
            cell = table.columns[place][keep[k]]
            if text(cell):  # NaN, of what is no text, is blank, too
                expected = "a finite number, or blank"
                raise table.fault(keep[k], table.names[place], quoted(cell), expected)
        whole = name in LABELS and np.array_equal(values, np.rint(values))
        made[name] = values.astype(np.int64) if whole else values
    return made


def units_said(table: Table, places: Mapping[str, int], asked: Asked) -> Iterator[str]:
    """Notes on units in the header that the mechanism does not declare, or that a new name hides.

    Of channels that keep their name, and no mechanism, nothing is said: the name goes on saying it.
    """
    hidden, against = [], []
    for channel, place in places.items():
        match, declared = UNIT.search(table.names[place]), asked.needs.units.get(channel)
        if match is None:
            continue
        if declared is None and channel != table.names[place]:
            hidden.append(f"{channel} in {match[1]}")
        elif declared is not None and not same_unit(match[1], declared):
            against.append(f"{channel} is in {match[1]} and declared in {declared or 'no unit'}")
    if hidden:
        yield f"units by the header, which a mechanism has to declare: {', '.join(hidden)}"
    if against:
        yield f"units by the header are others than in the mechanism: {', '.join(against)}"
