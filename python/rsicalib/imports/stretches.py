"""Recordings become sessions by one rule: still stretches are held poses, the rest is motion."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np

from rsicalib._core import LARGEST, still_stretches
from rsicalib.arrays import FloatArray, IntArray
from rsicalib.errors import InputError
from rsicalib.imports.asked import HOLD, Asked
from rsicalib.imports.log import Column, Session
from rsicalib.io.samples import picked
from rsicalib.io.tables import Lines


@dataclass(frozen=True, eq=False)
class Recording:
    """Rows of a log in order of time.

    Attributes
    ----------
    names : tuple of str
        Channels.
    values : ndarray, shape (n, C)
        Readings.
    time_s : ndarray, shape (n,), or None
        Time [s].
    lines : ndarray of int, shape (n,)
        Where each row stands in the log.
    inside : ndarray of bool, shape (n,), or None
        Rows at which there is contact, where that was asked for.
    name : str
        What the log calls it.
    beside : mapping of str to sequence
        Cells of columns that are no channels, by name, `n` each; with `pose`, its poses are known.
    """

    names: tuple[str, ...]
    values: FloatArray
    time_s: FloatArray | None
    lines: IntArray
    inside: np.ndarray | None = None
    name: str = ""
    beside: Mapping[str, Column] = field(default_factory=dict)

    def refuse_beyond(self, source: str, shown: str = "") -> None:
        """Refuse what is no number, and numbers that are too large; `shown` is how."""
        beyond = np.argwhere(~(np.abs(self.values) <= LARGEST))
        if beyond.size:
            row, column = beyond[0].tolist()
            found = format(self.values[row, column], shown)
            expected = f"a finite number, of {LARGEST:g} at the most"
            rows = Lines(source, self.lines, "row")
            raise rows.fault(row, found, expected, column=self.names[column])


FARTHER = 0.01
"""Part of what it reads by which no sensor is noisy: rows that differ by more are postures."""


def session_of(
    recording: Recording, asked: Asked, source: str, hold: float = HOLD
) -> tuple[Session, list[str]]:
    """Make a session of a recording, and say by what rule.

    Parameters
    ----------
    recording : Recording
        At least one row.
    asked : Asked
        `hold`, `rate` and `labels`.
    source : str
        What messages call it.
    hold : float
        For how long a pose is held where that was not asked [s]; 0 for a recording as it is.

    Returns
    -------
    Session, list of str
        Held poses with what is between them in `motion`, or the recording; and the rule in words.
    """
    hold = hold if asked.hold is None else asked.hold
    recording.refuse_beyond(source, "g")
    time = recording.time_s
    if asked.rate is not None:
        time = np.arange(len(recording.lines)) / asked.rate
    inside = recording.inside
    notes = [] if time is None else _told(recording, time)
    if hold == 0.0 or "pose" in recording.beside:
        return _rows(recording, time, inside, None, asked), notes
    hint = "Of a recording, say it by rsicalib import --rate HZ. Where each row is a pose of its "
    hint += "own: rsicalib import --hold 0."
    if time is None:
        found, expected = "no times", "times, or how many rows there are in a second"
        raise InputError.at(source, found, expected, hint=hint)
    apart = float(np.median(np.diff(time))) if len(time) > 1 else np.inf
    if apart == 0.0:
        found = "times that most rows share with the row before"
        expected = "a time for each row, or how many rows there are in a second"
        raise InputError.at(source, found, expected, hint=hint)
    stretches = still_stretches(recording.values, time, hold, inside)
    if asked.hold is None and asked.rate is not None and _postures(recording, stretches):
        said = (
            "no two neighbouring rows are alike, and all differ by more than a sensor is noisy: "
            "each row is a pose of its own, without a time; rsicalib import --hold SECONDS takes "
            "them as a recording"
        )
        each = np.arange(1, len(time) + 1)
        return _rows(recording, None, None, each, asked), [said]
    rule = f"still for {hold:g} s or more, each channel in its own noise"
    if not stretches:
        said = (
            f"no stretch is {rule}: taken as a recording (rsicalib import --hold says another time)"
        )
        if hold < apart < np.inf:
            said = f"rows are {apart:g} s apart, more than the {hold:g} s of a held pose: taken as "
            said += "a recording; where the time is not in seconds, let its name end with its unit "
            said += "(time_ms), or say rsicalib import --rate HZ"
        return _rows(recording, time, inside, None, asked), [*notes, said]
    pose = np.zeros(len(time), dtype=np.int64)
    for number, (start, end) in enumerate(stretches, 1):
        pose[start:end] = number
    session = _rows(recording, time, pose > 0, pose, asked)
    share = np.mean(pose > 0)
    said = f"{len(stretches)} stretches are {rule}: held poses, {share:.0%} of the rows"
    moving = (pose == 0) if inside is None else (pose == 0) & inside
    motion = _rows(recording, time, moving, None, asked) if moving.any() else None
    return Session(session.columns, session.lines, session.name, motion), [*notes, said]


def _postures(recording: Recording, stretches: Sequence[tuple[int, int]]) -> bool:
    """Whether what looks still is postures apart: they scatter as noise does, and far too much."""
    sizes = np.abs(recording.values).max(axis=0)
    steps = np.abs(np.diff(recording.values, axis=0)) / np.where(sizes > 0.0, sizes, 1.0)
    jumps = steps.max(axis=1) > FARTHER
    return bool(stretches) and all(jumps[start : end - 1].all() for start, end in stretches)


def _told(recording: Recording, time: FloatArray) -> list[str]:
    """What there is to say of the times of rows: where they go back, and which come twice."""
    steps, notes = np.diff(time), []
    back = np.flatnonzero(steps < 0.0)
    if back.size:
        first = int(recording.lines[back[0] + 1])
        count = "once" if back.size == 1 else f"{back.size} times, first"
        notes.append(f"the time goes back {count}, at row {first} of the log")
    same = steps == 0.0
    if same.any():
        alike = same & np.all(np.diff(recording.values, axis=0) == 0.0, axis=1)
        first = int(recording.lines[np.flatnonzero(same)[0] + 1])
        notes.append(
            f"{same.sum()} rows have the time of the row before, first row {first} of the log; "
            f"{alike.sum()} have its readings too: a reading that is written twice counts twice"
        )
    return notes


def _rows(
    recording: Recording,
    time: FloatArray | None,
    keep: np.ndarray | None,
    pose: IntArray | None,
    asked: Asked,
) -> Session:
    """Some rows of a recording as a session."""
    keep = np.ones(len(recording.lines), dtype=bool) if keep is None else keep
    columns: dict[str, Column] = {}
    if pose is not None:
        columns["pose"] = pose[keep]
        first = np.flatnonzero(np.diff(pose[keep], prepend=-1))
        lengths = np.diff(np.append(first, keep.sum()))
        columns["sample"] = 1 + np.arange(keep.sum()) - np.repeat(first, lengths)
    if time is not None:
        columns["time_s"] = time[keep]
    columns |= {
        name: cells[keep] if isinstance(cells, np.ndarray) else picked(cells, keep)
        for name, cells in recording.beside.items()
        if name not in columns
    }
    columns |= {name: [text] * int(keep.sum()) for name, text in asked.labels.items()}
    columns |= {name: recording.values[keep, k] for k, name in enumerate(recording.names)}
    return Session(columns, recording.lines[keep], recording.name)
