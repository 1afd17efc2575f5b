"""What the header and the cells of a table of readings must be.

Nothing is raised for a cell: faults are collected by row, and the caller refuses or skips.
"""

from __future__ import annotations

import math
from collections.abc import Container, Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Protocol

import numpy as np
import numpy.typing as npt

from rsicalib import _core
from rsicalib.arrays import FloatArray
from rsicalib.errors import InputError
from rsicalib.facts.warned import Warned
from rsicalib.io.builtin import DEFAULT, GIVE_YOURS
from rsicalib.io.tables import USED, Table, is_blank, is_dates, numbers, quoted, text
from rsicalib.io.times import TIME, time_column
from rsicalib.plain_text import meant

POSE = ("x", "y", "z", "rx", "ry", "rz")
TEXTS = ("group", "at")
COLUMNS = {
    "pose": "Label of a held pose, a whole number; its rows are neighbours. Without this column "
    "every row is a pose of its own: a recording, or poses that were read once each.",
    "sample": "Number of the sample within its pose, a whole number; for messages.",
    TIME: "Time [s]. Without it, drift and whatever else follows time is no candidate of a trace.",
    "temperature_c": "Temperature [°C]. Without it, effects of temperature are no candidates.",
    USED: "1, or 0 in a row that is not used. Such a row stays part of the session: from where the "
    "next pose was approached, what way was travelled, what time has passed. Without this column "
    "all rows are used. In memory True and False are 1 and 0.",
    "group": "Text: the placement (where what is touched stands while these rows are taken), or "
    "whatever `--fit-groups` chooses from.",
    "at": "Text: which unknown point is touched.",
    **{name: "Position of the platform where it is known [length unit]." for name in "xyz"},
    **{f"r{a}": "Orientation of the platform where it is known [rad], eq. (1)." for a in "xyz"},
}
"""Columns that a file may have beside those that its mechanism needs, and what they hold."""
EXACT = 2.0**53
"""Beyond this not every integer is a float64, and two labels could become one."""


ABSENT = "no such column"
"""What is found where a column is missing."""


class MechanismLike(Protocol):
    """What is asked of a mechanism."""

    @property
    def name(self) -> str:
        """What messages call it."""

    @property
    def channels(self) -> Sequence[_core.Channel]:
        """In the order of `Readings.values`."""

    @property
    def key_columns(self) -> Sequence[str]:
        """Text columns that its unknown points need."""

    @property
    def distance_columns(self) -> Sequence[str]:
        """Columns that its closures take their distance from."""

    @property
    def value_columns(self) -> Sequence[str]:
        """Columns of numbers that its closures, points and laws use."""

    @property
    def optional_columns(self) -> Sequence[str]:
        """Those of them that laws alone follow: without one of them these are no candidates."""


@dataclass(frozen=True)
class Fault:
    """A cell that cannot be used."""

    column: str
    found: str
    expected: str


def needed_columns(mechanism: MechanismLike) -> list[str]:
    """Names of the columns without which a mechanism cannot use a table."""
    channels = [channel.name for channel in mechanism.channels]
    return [*channels, *mechanism.key_columns, *mechanism.value_columns]


def read_header(table: Table, mechanism: MechanismLike) -> tuple[dict[str, int], list[Warned]]:
    """Which column is where, and warnings about those that are none of ours.

    Raises
    ------
    InputError
        A column that is needed is missing, or one that is used is doubled.
    """
    needed = needed_columns(mechanism)
    used = dict.fromkeys([*needed, *COLUMNS])
    line = table.header if table.line_word == "line" else None

    def refuse(column: str, found: str, expected: str, hint: str = "") -> InputError:
        return InputError.at(table.source, found, expected, line=line, column=column, hint=hint)

    index: dict[str, int] = {}
    for position, name in enumerate(table.names):
        if name in index and name in used:
            found = f"it twice, as columns {index[name] + 1} and {position + 1}"
            raise refuse(name, found, "one column of this name")
        index.setdefault(name, position)
    for name in needed:
        if name not in index and name not in mechanism.optional_columns:
            expected = f"a column '{name}' ({_role(name, mechanism)})"
            hint = _header_hint(name, table.names, used, mechanism, table.in_memory)
            hint += _by_import(name, table, mechanism)
            raise refuse(name, ABSENT, expected, hint)
    poses = [name for name in POSE if name in index and name not in needed]
    missing = [name for name in POSE if name not in index]
    places = poses == [*"xyz"] and len(missing) == len("xyz")  # without an orientation
    if poses and missing and not places and not set(POSE) & set(needed):
        found = f"'{poses[0]}' without '{missing[0]}'"
        expected = f"all six columns {' '.join(POSE)}, or none"
        raise refuse(missing[0], found, expected, _meaning(poses[0], mechanism))
    if (
        len(poses) < len(POSE) and not places
    ):  # the mechanism uses one of these names for something else
        used = {name: None for name in used if name in needed or name not in POSE}
    extra = [name or "(no name)" for name in table.names if name not in used]
    time = time_column(extra) if TIME not in index else None
    if time is not None and is_dates(table.columns[index[extra[time]]]):
        index[TIME] = index[extra.pop(time)]
        time = None
    listed = ", ".join(dict.fromkeys(extra))
    text = f"{table.source}: ignored columns: {listed}"
    if time is not None:
        text += (
            f". {extra[time]!r} looks like a time, which is called {TIME!r} here: rsicalib import "
            f"reads it, and without it nothing is known of motion or order"
        )
    warnings = [Warned("ignored_columns", None, text)] if extra else []
    return {name: position for name, position in index.items() if name in used}, warnings


def _meaning(name: str, mechanism: MechanismLike) -> str:
    """What a column of a name is here, and what to do where it holds something else."""
    channels = ", ".join(channel.name for channel in mechanism.channels)
    meant_by_it = COLUMNS[name].partition(". ")[0].removesuffix(".")
    return (
        f"Here '{name}' means: {meant_by_it}. Rename or drop columns that hold something "
        f"else; the channels of '{mechanism.name}' are {channels}."
    )


def meaning_of(name: str, cell: Any, mechanism: MechanismLike, in_memory: bool) -> str:
    """The same of a column in which no cell can be used; nothing of one that the mechanism has."""
    if name not in COLUMNS or name in needed_columns(mechanism):
        return ""
    if name == TIME and isinstance(cell, str) and any(map(str.isdecimal, cell)):
        if in_memory:
            return "Text of dates becomes dates by pandas.to_datetime: those are taken."
        return "Dates as ISO 8601 has them, 2026-03-01 12:00:07.25, are read by rsicalib import."
    return _meaning(name, mechanism)


def _role(name: str, mechanism: MechanismLike) -> str:
    if name in mechanism.key_columns:
        return f"text that the unknown points of '{mechanism.name}' need"
    if name in mechanism.value_columns:
        if name in mechanism.distance_columns:
            return f"a distance that the closures of '{mechanism.name}' need"
        return f"a number that the points or laws of '{mechanism.name}' need"
    return f"a channel of '{mechanism.name}'"


def _header_hint(
    name: str,
    names: list[str],
    known: Container[str],
    mechanism: MechanismLike,
    in_memory: bool,
) -> str:
    """Advice on what may be wrong with the header."""
    for other in names:
        if other.lower() == name.lower():
            return f"There is '{other}'; names must agree in case."
    if len(names) == 1 and name in names[0]:
        return "The header has one column only; separate columns by commas."
    if names and np.isfinite(numbers(names)).all():
        if in_memory:
            return "The names of the columns are numbers; name them as the channels."
        return "The first line holds numbers; put a header line above it."
    hint = meant(name, [other for other in names if other not in known])
    columns = f"The columns are: {', '.join(names)[:200]}{hint}."
    forgotten = mechanism.name == DEFAULT and not any(c.name in names for c in mechanism.channels)
    return f"{columns} {GIVE_YOURS}" if forgotten else columns


def _by_import(name: str, table: Table, mechanism: MechanismLike) -> str:
    """How a file of another program gets the column."""
    if table.line_word == "row" or name in mechanism.value_columns:
        return ""
    if name in mechanism.key_columns:
        return (
            f" A column of another name: rsicalib import --channels {name}=COLUMN. Only where all "
            f"rows touch the same place, one text for all: rsicalib import --labels {name}=TEXT."
        )
    where = f"with --channels {name}=COLUMN where names differ"
    return f" A file of another program: rsicalib import, {where}."


def read_cells(
    table: Table, mechanism: MechanismLike, index: dict[str, int]
) -> tuple[dict[str, FloatArray], dict[int, Fault]]:
    """Numeric columns, shape (n,) each, and the first fault of every row that has one."""
    ranges = {channel.name: channel for channel in mechanism.channels}
    own = _own_columns(mechanism)
    optional = {name for columns in own for name in columns}
    blank: dict[str, npt.NDArray[np.bool_]] = {}
    wanted: dict[str, str] = {}
    faults = {i: Fault(r.column, r.found, r.expected) for i, r in table.ragged.items()}
    cells: dict[str, FloatArray] = {}
    poses = [name for name in POSE if name in index and name not in needed_columns(mechanism)]
    for name, position in sorted(index.items(), key=lambda item: item[1]):
        raw = table.columns[position]
        if name in ranges:
            cells[name], bad, expected = _channel(table.numbers(position), ranges[name])
        elif name in mechanism.key_columns or name in TEXTS:
            bad = np.array([name in mechanism.key_columns and not text(cell) for cell in raw])
            expected = "text"
            if name in optional:
                blank[name] = bad
        else:
            timed = name == TIME and name not in needed_columns(mechanism)
            cells[name] = table.times(position) if timed else table.numbers(position)
            bad, expected = _unusable(name, cells[name], mechanism)
            if name in poses:
                bad &= ~_unknown(raw, table)
            if name in optional:
                blank[name] = _unknown(raw, table)
        if name in blank:
            bad = bad & ~blank[name]
            wanted[name] = expected
        for i in np.flatnonzero(bad).tolist():
            faults.setdefault(i, Fault(name, quoted(raw[i]), expected))
    for i, name, together in _seen_in_part(mechanism, own, blank):
        found = quoted(table.columns[index[name]][i])
        expected = f"a finite number, or all of {' '.join(together)} empty"
        faults.setdefault(i, Fault(name, found, expected))
    for i, name in _closed_by_none(own, blank, len(table.lines)):
        found = quoted(table.columns[index[name]][i])
        faults.setdefault(i, Fault(name, found, _or_elsewhere(wanted[name], name, own)))
    if poses in ([*POSE], [*POSE[:3]]):
        known = np.column_stack([np.isfinite(cells[name]) for name in poses])
        for i in np.flatnonzero(known.any(axis=1) & ~known.all(axis=1)).tolist():
            name = poses[int(np.argmin(known[i]))]
            found = quoted(table.columns[index[name]][i])
            count = "six" if len(poses) == len(POSE) else "three"
            expected = f"a finite number, or all {count} of {' '.join(poses)} empty"
            faults.setdefault(i, Fault(name, found, expected))
    return cells, faults


def _own_columns(mechanism: MechanismLike) -> list[list[str]]:
    """For each closure its own columns; of what has no closures, all are needed in every row."""
    whole = [*mechanism.key_columns, *mechanism.value_columns]
    return getattr(mechanism, "own_columns", [whole])


def _seen_in_part(
    mechanism: MechanismLike, own: list[list[str]], blank: dict[str, npt.NDArray[np.bool_]]
) -> Iterator[tuple[int, str, list[str]]]:
    """Rows with a part of the coordinates of a point that is seen: one that is blank, and all."""
    seen = getattr(mechanism, "instrument_columns", [])
    for columns in own:
        together = [name for name in columns if name in seen]
        missing = np.array([blank[name] for name in together])
        if missing.size:
            for i in np.flatnonzero(missing.any(axis=0) & ~missing.all(axis=0)).tolist():
                yield i, together[int(np.argmax(missing[:, i]))], together


def closing_rows(
    own: Sequence[Sequence[str]], told: Mapping[str, npt.NDArray[np.bool_]], rows: int
) -> npt.NDArray[np.bool_]:
    """Rows in which some closure holds: each of its own columns says something there.

    Parameters
    ----------
    own : sequence of sequence of str
        For each closure its own columns.
    told : mapping of str to ndarray of bool, shape (rows,)
        Where a column says something; one that is not here does so in every row.
    rows : int
        Number of rows.
    """
    closed = np.full(rows, not own)
    for columns in own:
        holds = np.ones(rows, dtype=np.bool_)
        for name in columns:
            holds &= told.get(name, True)
        closed |= holds
    return closed


def _closed_by_none(
    own: list[list[str]], blank: dict[str, npt.NDArray[np.bool_]], rows: int
) -> list[tuple[int, str]]:
    """Rows in which every closure has a blank of its own, and the first column that is blank."""
    if not any(cells.any() for cells in blank.values()):
        return []
    closed = closing_rows(own, {name: ~cells for name, cells in blank.items()}, rows)
    names = [name for name in blank if any(name in columns for columns in own)]
    return [
        (i, next(name for name in names if blank[name][i]))
        for i in np.flatnonzero(~closed).tolist()
    ]


def _or_elsewhere(expected: str, name: str, own: list[list[str]]) -> str:
    """What is expected in a column where no loop closes: that, or what closes another one."""
    others = list(dict.fromkeys(" ".join(columns) for columns in own if name not in columns))
    return f"{expected}, or what the row touches in {' or '.join(others)}" if others else expected


def _channel(
    values: FloatArray, channel: _core.Channel
) -> tuple[FloatArray, npt.NDArray[np.bool_], str]:
    if channel.range is None:
        bad, expected = _too_large(values)
        return values, bad, f"{expected} ({channel.unit})"
    low, high = channel.range
    expected = f"a number from {low:.10g} to {high:.10g} ({channel.unit})"
    return values, ~((values >= low) & (values <= high)) | ~np.isfinite(values), expected


def _unusable(
    name: str, values: FloatArray, mechanism: MechanismLike
) -> tuple[npt.NDArray[np.bool_], str]:
    bad, expected = _too_large(values)
    if name in mechanism.distance_columns:
        return bad | ~(values > 0.0), "a distance above zero"
    if name in ("pose", "sample"):
        whole, large = values == np.rint(values), np.abs(values) >= EXACT
        expected = f"an integer below {EXACT:.0f} (2^53) in size"
        return ~whole | large, expected if (whole & large).any() else "an integer"
    if name == USED and name not in needed_columns(mechanism):
        return ~((values == 0.0) | (values == 1.0)), "0 or 1"
    if name == TIME:
        return bad, f"{expected} (seconds)"
    return bad, expected


def _too_large(values: FloatArray) -> tuple[npt.NDArray[np.bool_], str]:
    """What cannot be computed with, and what is expected there."""
    if np.isfinite(values).all():
        expected = f"a number of at most {_core.LARGEST:g} in size"
        return np.abs(values) > _core.LARGEST, expected
    return ~(np.abs(values) <= _core.LARGEST), "a finite number"


def _unknown(raw: Sequence[Any] | npt.NDArray[Any], table: Table) -> npt.NDArray[np.bool_]:
    """Cells of a pose that is not known: empty in a CSV file, NaN too elsewhere."""
    if isinstance(raw, np.ndarray):
        return np.isnan(raw.astype(np.float64))
    nan = table.line_word == "row"
    return np.array([is_blank(c) or (nan and isinstance(c, float) and math.isnan(c)) for c in raw])
