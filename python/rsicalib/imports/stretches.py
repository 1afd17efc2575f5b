"""Recordings become sessions by one rule: still stretches are held poses, the rest is motion.

A stretch is still if each channel, in every window of the least length, stays within what its own
noise does to as many rows in all but one of 10 000 cases, or within two steps of its converter.
The noise is what neighbouring rows differ by (von Neumann 1941): motion, which goes on from row to
row, adds little to that and much to the range.
"""

from __future__ import annotations

from dataclasses import dataclass
from statistics import NormalDist

import numpy as np

from rsicalib._core import LARGEST
from rsicalib.arrays import FloatArray, IntArray
from rsicalib.errors import InputError
from rsicalib.imports.asked import HOLD, Asked
from rsicalib.imports.log import Column, Session

__all__ = ["Recording", "session_of", "step_of", "still_stretches"]

INSIDE = 0.9999
"""Probability with which noise alone keeps all rows of a window within the limits."""

QUIET = 0.1
"""The noise of a channel is that of the quietest tenth of the windows."""


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
    """

    names: tuple[str, ...]
    values: FloatArray
    time_s: FloatArray | None
    lines: IntArray
    inside: np.ndarray | None = None
    name: str = ""


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
    beyond = np.argwhere(~(np.abs(recording.values) <= LARGEST))
    if beyond.size:
        row, column = beyond[0].tolist()
        found = f"{recording.values[row, column]:g}"
        expected = f"a finite number, of {LARGEST:g} at the most"
        raise InputError.at(
            source,
            line=int(recording.lines[row]),
            column=recording.names[column],
            found=found,
            expected=expected,
            line_word="row",
        )
    time = recording.time_s
    if asked.rate is not None:
        time = np.arange(len(recording.lines)) / asked.rate
    inside = recording.inside
    notes = [] if time is None else _told(recording, time)
    if hold == 0.0:
        return _rows(recording, time, inside, None, asked), notes
    hint = "Say it by rsicalib import --rate HZ, or take all by --hold 0."
    if time is None:
        found, expected = "no times", "times, or how many rows there are in a second"
        raise InputError.at(source, found=found, expected=expected, hint=hint)
    apart = float(np.median(np.diff(time))) if len(time) > 1 else np.inf
    if apart == 0.0:
        found = "times that most rows share with the row before"
        expected = "a time for each row, or how many rows there are in a second"
        raise InputError.at(source, found=found, expected=expected, hint=hint)
    stretches = still_stretches(recording.values, time, hold, inside)
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
        columns["sample"] = np.arange(keep.sum()) - np.repeat(first, lengths)
    if time is not None:
        columns["time_s"] = time[keep]
    columns |= {name: [text] * int(keep.sum()) for name, text in asked.labels.items()}
    columns |= {name: recording.values[keep, k] for k, name in enumerate(recording.names)}
    return Session(columns, recording.lines[keep], recording.name)


def still_stretches(
    values: FloatArray, time: FloatArray, hold: float, inside: np.ndarray | None = None
) -> list[tuple[int, int]]:
    """First row, and row after the last, of each still stretch.

    Parameters
    ----------
    values : ndarray, shape (n, C)
        Readings.
    time : ndarray, shape (n,)
        Time [s]; a gap of more than `hold`, or a step back, ends a stretch.
    hold : float
        Least length [s].
    inside : ndarray of bool, shape (n,), optional
        Rows that may belong to a stretch.

    Returns
    -------
    list of (int, int)
        In order of time; stretches do not overlap.
    """
    n = len(values)
    steps = np.diff(time)
    going = steps[steps > 0.0]
    rows = max(2, int(np.ceil(hold / np.median(going) - 1e-9)) + 1) if going.size else n + 1
    if n < rows:
        return []
    ranges = _running(np.maximum, values, rows) - _running(np.minimum, values, rows)
    variance = np.cumsum(np.vstack([np.zeros(values.shape[1]), np.diff(values, axis=0) ** 2]), 0)
    noise = np.sqrt((variance[rows - 1 :] - variance[: n - rows + 1]) / (2 * (rows - 1)))
    sigma = np.quantile(noise, QUIET, axis=0)
    step = np.array([step_of(column) for column in values.T])
    quiet = (ranges <= _limit(rows, sigma, step)).all(axis=1)
    broken = np.flatnonzero((steps > hold) | (steps < 0.0)) + 1
    if inside is not None:
        broken = np.union1d(broken, np.flatnonzero(np.diff(inside.astype(int))) + 1)
        quiet &= inside[: n - rows + 1]
    ends = np.append(broken, n)
    ends = ends[np.searchsorted(ends, np.arange(n - rows + 1), side="right")]
    quiet &= np.arange(n - rows + 1) + rows <= ends
    edges = np.flatnonzero(np.diff(np.concatenate([[0], quiet.astype(int), [0]])))
    found: list[tuple[int, int]] = []
    for start, last in edges.reshape(-1, 2).tolist():  # windows start .. last - 1 are quiet
        begin = max(start, found[-1][1] if found else 0)
        if last - 1 + rows - begin >= rows:
            found.append((begin, last - 1 + rows))
    return found


def _running(pick: np.ufunc, values: FloatArray, rows: int) -> FloatArray:
    """Greatest or least of so many rows, from each row on: windows of twice the width in turn."""
    out, width = values, 1
    while 2 * width <= rows:
        out, width = pick(out[:-width], out[width:]), 2 * width
    found: FloatArray = pick(out[: len(values) - rows + 1], out[rows - width :])
    return found


def _limit(rows: int, sigma: FloatArray, step: FloatArray) -> FloatArray:
    """Range within which so many rows of noise stay, shape (C,)."""
    width = 2.0 * NormalDist().inv_cdf(1.0 - (1.0 - INSIDE) / (2.0 * rows))
    return np.maximum(width * sigma, 2.0 * step)


def step_of(values: FloatArray) -> float:
    """Smallest difference between values of a channel: the step of its converter; 0 for none.

    Differences that are nothing beside the values are rounding.
    """
    distinct = np.unique(values)
    gaps = np.diff(distinct)
    gaps = gaps[gaps > 1e-9 * max(float(np.abs(distinct).max(initial=0.0)), 1e-300)]
    return float(gaps.min(initial=np.inf)) if gaps.size else 0.0
