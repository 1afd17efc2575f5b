"""Columns of a plotting program (PlotJuggler, Foxglove) or of a data lake: CSV or Parquet.

A column becomes a channel by `--channels CHANNEL=COLUMN,…`. Where series of several rates share a
file, a row has cells of one series only: rows in which all channels are blank are of others.
"""

from __future__ import annotations

import hashlib
import os
from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from rsicalib.arrays import FloatArray
from rsicalib.errors import InputError
from rsicalib.imports.asked import Asked, chosen, short
from rsicalib.imports.beside import cells_beside, columns_beside, units_said
from rsicalib.imports.log import Column, Log
from rsicalib.imports.series import in_columns
from rsicalib.imports.stretches import Recording, session_of
from rsicalib.io.cells import POSE, closing_rows
from rsicalib.io.tables import PARQUET, Lines, Table, is_blank, numbers, quoted, read_table, text
from rsicalib.io.times import TIME, seconds, time_column
from rsicalib.plain_text import counted

MOST_SAID = 3
"""Groups of channels that a message names."""


def read(source: str, asked: Asked) -> Log:
    """Read a file, or all Parquet files of a folder by their names as one recording.

    Raises
    ------
    InputError
        A channel has no column, or a cell cannot be used.
    """
    tables = [in_columns(_whole(read_table(file), asked)) for file in _files(Path(source))]
    parts = [_recording(table, asked) for table in tables]
    _refuse_timeless(parts[0][0], tables[0], asked)
    findings = list(dict.fromkeys(note for _, notes in parts for note in notes))
    made = [
        session_of(part, asked, table.source)
        for (part, _), table in zip(parts, tables, strict=True)
    ]
    findings += [note for _, notes in made for note in notes]
    digest = hashlib.sha256("".join(t.sha256 for t in tables).encode()).hexdigest()
    word = tables[0].line_word
    sessions = tuple(session for session, _ in made)
    return Log(source, "table of columns", sessions, None, tuple(findings), word, sha256=digest)


def _files(path: Path) -> list[Path]:
    if not os.path.isdir(path):
        return [path]
    found = sorted(file for file in path.rglob("*") if file.suffix.lower() in PARQUET)
    if not found:
        raise InputError.at(str(path), "no Parquet file", "some")
    return found


def _whole(table: Table, asked: Asked) -> Table:
    """The table, refused where a row has not as many cells as the header, or without such rows."""
    if not table.ragged:
        return table
    row, fault = min(table.ragged.items())
    if not asked.skip_bad_rows:
        hint = f"{len(table.ragged)} such rows: leave them out by --skip-bad-rows."
        raise table.fault(row, fault.column, fault.found, fault.expected, hint)
    keep = [k for k in range(len(table.lines)) if k not in table.ragged]
    columns: list[Any] = [[column[k] for k in keep] for column in table.columns]
    return replace(table, columns=columns, lines=table.lines[keep], ragged={})


def _recording(table: Table, asked: Asked) -> tuple[Recording, list[str]]:
    """Rows of the channels, and what was found on the way."""
    notes: list[str] = []
    named = numbers(table.names)
    if np.isfinite(named).all() and not np.array_equal(named, np.arange(len(named))):
        raise InputError.at(
            table.source,
            "numbers",
            "names of columns",
            line=table.header,
            hint="Put a header line above them.",
            line_word=table.line_word,
        )
    beside = columns_beside(table, asked)
    place = beside.pop(TIME, time_column(table.names))
    channels = asked.channels
    if channels is None:
        apart = {place, *beside.values()}
        held = [k not in apart and _numeric(table, k) for k in range(len(table.names))]
        counts = [one and _counts_rows(table, k) for k, one in enumerate(held)]
        if counts == held:  # nothing else is there
            counts = [False] * len(held)
        taken = [one and not counter for one, counter in zip(held, counts, strict=True)]
        channels = {n: n for n, one in zip(table.names, taken, strict=True) if one}
        if not channels:  # joints that are called as coordinates of a known pose
            channels = {name: name for name in POSE if beside.pop(name, None) is not None}
    places = chosen(_by_own_names(channels, table, asked), table.names, table.source)
    read = {place, *beside.values(), *places.values()}
    left = [n or "(no name)" for k, n in enumerate(table.names) if k not in read]
    if left:
        notes.append(f"{counted(len(left), 'column')} not taken: {', '.join(left)[:200]}")
    notes += units_said(table, places, asked)
    if not places or not len(table.lines):
        said = "no rows" if places else "no column of numbers"
        raise InputError.at(table.source, said, "readings of at least one channel")
    blank = np.array([[is_blank(c) for c in table.columns[k]] for k in places.values()]).T
    keep, others = whole_rows(~blank, list(places), table.stands, asked.skip_bad_rows)
    if others:
        notes.append(f"{others} rows are of other series, or not whole: not used")
    values = np.column_stack([_cells(table, k, keep) for k in places.values()])
    time: FloatArray | None = None
    if place is not None:
        stamps = [table.columns[place][i] for i in keep.tolist()]
        points = [str(s).replace(",", ".") for s in stamps] if table.decimal == "," else stamps
        found = seconds(points, table.names[place])
        if isinstance(found, int):
            expected = "a time: seconds, an integer since 1970, or a date as ISO 8601 has it"
            row, name = int(keep[found]), table.names[place]
            raise table.fault(row, name, quoted(stamps[found]), expected)
        time, note = found
        notes += [note] if note else []
    cells = cells_beside(table, beside, keep, asked)
    touching = _touching(cells, asked)
    if touching is not None:
        notes.append(_left_out(touching, asked))
    return Recording(tuple(places), values, time, table.lines[keep], touching, "", cells), notes


def _touching(cells: Mapping[str, Column], asked: Asked) -> np.ndarray | None:
    """Rows in which some closure of the mechanism holds; None where that is in all, or none."""
    told = {
        name: np.isfinite(column) if isinstance(column, np.ndarray) else np.array(column) != ""
        for name, column in cells.items()
    }
    own = asked.needs.own
    if not {name for columns in own for name in columns} <= {*told, *asked.labels}:
        return None
    rows = len(next(iter(told.values()), ()))
    touching = closing_rows(own, told, rows)
    return None if touching.all() or not touching.any() else touching


def _left_out(touching: np.ndarray, asked: Asked) -> str:
    """What is said of rows in which no closure holds."""
    names = dict.fromkeys(name for columns in asked.needs.own for name in columns)
    rows = counted(int((~touching).sum()), "row")
    return f"{rows} without {' or '.join(names)}: nothing closes there, left out"


def _refuse_timeless(recording: Recording, table: Table, asked: Asked) -> None:
    """Held poses are found by the time; say how a column of times is called."""
    known = recording.time_s is not None or "pose" in recording.beside
    if known or asked.rate is not None or asked.hold == 0.0:
        return
    hint = f"Those of the log: {', '.join(table.names)[:300]}. Name one so, or say which it is: "
    hint += "rsicalib import --channels time_s=COLUMN. Where each row is a pose of its own: "
    hint += "rsicalib import --hold 0. Of a recording, say how many rows there are in a second: "
    hint += "rsicalib import --rate HZ."
    expected = "one called time, timestamp or t, with its unit or without (time_ms)"
    raise InputError.at(table.source, "no column of times", expected, hint=hint)


def _by_own_names(channels: Mapping[str, str], table: Table, asked: Asked) -> dict[str, str]:
    """The name of each channel's column: that of its joint, or else its own."""
    own = {n for n in asked.joints if n in table.names}
    near = {*table.names, *map(short, table.names)}
    return {c: c if c in own and name not in near else name for c, name in channels.items()}


def _numeric(table: Table, place: int) -> bool:
    """Whether a column holds numbers; blanks are no others."""
    cells: Sequence[Any] = [c for c in table.columns[place] if not is_blank(c)]
    return bool(len(cells)) and bool(np.isfinite(table.numbers(place)).any())


COUNTERS = ("", "unnamed: 0", "index", "idx", "row", "frame", "frame_index", "seq", "header.seq")
"""What a column that counts rows is called."""


def _counts_rows(table: Table, place: int) -> bool:
    """Whether a column is called as a counter of rows, and grows by one from row to row."""
    called = table.names[place].strip().lower() in COUNTERS
    return called and bool(np.all(np.diff(table.numbers(place)) == 1.0))


def _cells(table: Table, place: int, keep: np.ndarray) -> FloatArray:
    """Numbers of a column; refused where one is none."""
    values: FloatArray = table.numbers(place)[keep]
    bad = np.flatnonzero(~np.isfinite(values))
    if bad.size:
        row = int(keep[bad[0]])
        cell, name = table.columns[place][row], table.names[place]
        again = "The header stands here once more, or the first line is none."
        hint = again if text(cell) == name else ""
        raise table.fault(row, name, quoted(cell), "a finite number", hint)
    return values


def _together(there: np.ndarray, names: Sequence[str]) -> str:
    """Channels that have readings in the same rows, those of most rows first."""
    patterns, rows = np.unique(there, axis=0, return_counts=True)
    said = [
        ",".join(n for n, one in zip(names, patterns[k], strict=True) if one)
        + f" ({counted(int(rows[k]), 'row')})"
        for k in np.argsort(-rows, kind="stable")[:MOST_SAID].tolist()
    ]
    return "; ".join(said)[:300]


def whole_rows(
    there: np.ndarray, names: Sequence[str], rows: Lines, skip: bool
) -> tuple[np.ndarray, int]:
    """Rows in which every channel has a reading.

    Parameters
    ----------
    there : ndarray of bool, shape (n, C)
        Whether there is a reading.
    names : sequence of str
        Channels.
    rows : Lines
        Where each row stands.
    skip : bool
        Leave out rows with some of the channels, instead of refusing them.

    Returns
    -------
    ndarray of int, int
        The rows, and how many there are besides.

    Raises
    ------
    InputError
        A row has some channels and not others, or no row has all.
    """
    count = there.sum(axis=1)
    part = np.flatnonzero((count > 0) & (count < len(names)))
    if part.size and not skip:
        row = int(part[0])
        missing = [name for name, one in zip(names, there[row], strict=True) if not one]
        some = bool((count == len(names)).any())
        out = "leave them out by --skip-bad-rows, or " if some else "and none is whole: "
        hint = f"{part.size} such rows{': ' if some else ', '}{out}name the "
        hint += "channels that belong together by rsicalib import --channels: "
        hint += f"{_together(there[part], names)}."
        found = f"no reading of {', '.join(missing)}"
        expected = f"one of each of the {len(names)} channels, or of none"
        raise rows.fault(row, found, expected, hint=hint, place=missing[0])
    whole = np.flatnonzero(count == len(names))
    if not whole.size:
        expected = f"readings of {', '.join(names)} in one {rows.word}"
        raise InputError.at(rows.source, f"no {rows.word} with all of them", expected)
    return whole, len(there) - len(whole)
