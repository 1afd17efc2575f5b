"""A row of units below the header, as loggers write one."""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping
from dataclasses import replace

from rsicalib.io.cells import POSE, MechanismLike
from rsicalib.io.tables import Table, is_blank, quoted

UNIT = re.compile(r"[^\W\d][\w/^*·. -]{0,15}|[°%][\w/]{0,8}")
"""What a unit looks like; no number does."""

HINT = "Convert the column, or declare its unit in the mechanism."
"""What to do about another unit."""

NONE = ("", "-", "1", "#")
"""How loggers write that a column has no unit."""

SAME = {
    "count": ("counts", "lsb"),
    "rad": ("radian", "radians"),
    "deg": ("degree", "degrees", "°"),
    "s": ("sec", "second", "seconds"),
    "°C": ("degc", "c", "celsius"),
}
"""Other ways to write a unit."""


def without_units(table: Table, mechanism: MechanismLike, index: dict[str, int]) -> Table:
    """The table without a row of units at its top, where it has one.

    Parameters
    ----------
    table : Table
        As it stands in the file.
    mechanism : MechanismLike
        Units of its channels.
    index : dict of str to int
        Position of each column that is used.

    Returns
    -------
    Table
        Without its first row where every channel of that row has its own unit; otherwise as given.

    Raises
    ------
    InputError
        The first row is a row of units, and one of them is not that of its column.
    """
    if table.line_word != "line" or not len(table.lines):
        return table
    first = {name: str(table.columns[at][0]) for name, at in index.items()}
    if not is_units(first, mechanism):
        return table
    for name, found, unit in wrong_units(first, mechanism):
        raise table.fault(0, name, found, unit, HINT)
    ragged = {i - 1: fault for i, fault in table.ragged.items() if i}
    below = [column[1:] for column in table.columns]
    return replace(table, columns=below, lines=table.lines[1:], ragged=ragged)


def is_units(first: Mapping[str, str], mechanism: MechanismLike) -> bool:
    """Whether cells, by the names of their columns, are units: those of every channel are."""
    cells = [_bare(first[channel.name]) for channel in mechanism.channels]
    return all(UNIT.fullmatch(cell) and _is_text(cell) for cell in cells)


def wrong_units(
    first: Mapping[str, str], mechanism: MechanismLike
) -> Iterator[tuple[str, str, str]]:
    """Columns whose unit is not theirs: the name, what was found, what was expected."""
    units = _others(mechanism) | {channel.name: channel.unit for channel in mechanism.channels}
    for name, cell in first.items():
        expected, found = units.get(name, ""), _bare(cell)
        if found.lower() not in _written(expected) and not is_blank(found):
            yield name, f"unit {quoted(found)}", f"unit '{expected}'" if expected else "no unit"


def _bare(cell: str) -> str:
    return cell.strip(" []()\t")


def _others(mechanism: MechanismLike) -> dict[str, str]:
    """Units of the columns that are no channels."""
    length = getattr(mechanism, "length_unit", "")
    poses = {name: "rad" if name.startswith("r") else length for name in POSE}
    return {
        "time_s": "s",
        "temperature_c": "°C",
        **poses,
        **dict.fromkeys(mechanism.value_columns, length),
        **getattr(mechanism, "column_units", {}),
    }


def _written(unit: str) -> set[str]:
    """All ways in which a unit is written, in lower case."""
    return {unit.lower(), *SAME.get(unit, ())} if unit else set(NONE)


def same_unit(found: str, expected: str) -> bool:
    """Whether a text is one of the ways in which a unit is written."""
    return found.lower() in _written(expected)


def _is_text(cell: str) -> bool:
    """Whether a cell is no number: `inf` and `nan` look like units."""
    try:
        float(cell)
    except ValueError:
        return True
    return False
