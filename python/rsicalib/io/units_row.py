"""A row of units below the header, as loggers write one."""

from __future__ import annotations

import re
from dataclasses import replace

from rsicalib.io.cells import POSE, MechanismLike
from rsicalib.io.tables import Table, is_blank, quoted

UNIT = re.compile(r"[^\W\d][\w/^*·. -]{0,15}|[°%][\w/]{0,8}")
"""What a unit looks like; no number does."""

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
    first = {name: str(table.columns[at][0]).strip(" []()\t") for name, at in index.items()}
    units = {channel.name: channel.unit for channel in mechanism.channels}
    if not all(UNIT.fullmatch(first[name]) and _is_text(first[name]) for name in units):
        return table
    units |= {name: unit for name, unit in _others(mechanism).items() if name not in units}
    for name, found in first.items():
        expected = units.get(name, "")
        if found.lower() in _written(expected) or is_blank(found):
            continue
        unit = f"unit '{expected}'" if expected else "no unit"
        hint = "Convert the column, or declare its unit in the mechanism."
        raise table.fault(0, name, f"unit {quoted(found)}", unit, hint)
    ragged = {i - 1: fault for i, fault in table.ragged.items() if i}
    below = [column[1:] for column in table.columns]
    return replace(table, columns=below, lines=table.lines[1:], ragged=ragged)


def _others(mechanism: MechanismLike) -> dict[str, str]:
    """Units of the columns that are no channels."""
    length = getattr(mechanism, "length_unit", "")
    poses = {name: "rad" if name.startswith("r") else length for name in POSE}
    return {
        "time_s": "s",
        "temperature_c": "°C",
        **poses,
        **dict.fromkeys(mechanism.value_columns, length),
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
