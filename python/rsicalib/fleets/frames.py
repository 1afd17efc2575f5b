"""Results of many devices as a table of the same kind as their readings."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from itertools import pairwise
from typing import Any, TypeAlias

import numpy as np
import numpy.typing as npt

from rsicalib.arrays import FloatArray
from rsicalib.io.frames import Cells, Columns, frame_of
from rsicalib.io.tables import is_blank
from rsicalib.io.times import is_none

Frame: TypeAlias = Any
"""A pandas or Polars DataFrame, a pyarrow Table or RecordBatch, or a mapping of names to arrays."""

Rows: TypeAlias = dict[str, Any]
"""Results by column, each of length n."""

TEXT = ("verdict", "message", "steps", "sha256", "file")
"""Columns of results that hold text; the other columns hold numbers, NaN where unknown."""


def devices_in(cells: Cells) -> list[Any]:
    """Labels of devices as values of Python; None in a row that has none."""
    labels: list[Any] = cells.tolist() if isinstance(cells, np.ndarray) else list(cells)
    whole = isinstance(cells, np.ndarray) and cells.dtype.kind in "iu"
    return labels if whole else [*map(device_in, labels)]


def device_in(cell: Any) -> Any:
    """The label of a device; None where the cell is empty, so that all such rows are alike."""
    return None if is_none(cell) or is_blank(cell) else cell


def frame_like(frame: Frame, rows: Mapping[str, Sequence[Any]], label: str) -> Frame:
    """Results as a table of the kind of `frame`.

    Columns have the same types whatever the devices are like, so that partitions fit together:
    text for `TEXT`, numbers for the others, and `label` as it was given.
    """
    made: dict[str, npt.NDArray[Any]] = {}
    for name, cells in rows.items():
        if name == label:
            kind = np.int64 if all(isinstance(c, int | np.integer) for c in cells) else object
            made[name] = np.array(cells, dtype=kind)
        else:
            made[name] = np.array(cells, dtype=object if name in TEXT else np.float64)
    return frame_of(frame, made)


Runs: TypeAlias = list[slice]
"""Rows, as runs of neighbours."""


def runs_of(labels: Cells) -> dict[Any, Runs]:
    """Rows of each label, in the order of their first rows."""
    ends = [i for i, (a, b) in enumerate(pairwise(labels), start=1) if a != b]
    found: dict[Any, Runs] = {}
    for start, end in pairwise([0, *ends, len(labels)] if len(labels) else []):
        found.setdefault(labels[start], []).append(slice(start, end))
    return found


def select(frame: Columns, runs: Iterable[slice]) -> Columns:
    """Some rows of a table, in the order of the runs."""
    merged: Runs = []
    for run in runs:
        if merged and merged[-1].stop == run.start:
            merged[-1] = slice(merged[-1].start, run.stop)
        else:
            merged.append(run)

    def of(cells: Cells) -> Cells:
        if len(merged) == 1:
            return cells[merged[0]]
        if isinstance(cells, np.ndarray):
            return np.concatenate([cells[run] for run in merged]) if merged else cells[:0]
        return [cell for run in merged for cell in cells[run]]

    return {name: of(cells) for name, cells in frame.items()}


def joined(frames: Sequence[Columns]) -> Columns:
    """Tables with the same columns, one after the other."""
    if len(frames) == 1:
        return frames[0]

    def together(parts: Sequence[Cells]) -> Cells:
        if all(isinstance(part, np.ndarray) for part in parts):
            return np.concatenate(parts)
        return [cell for part in parts for cell in part]

    return {name: together([frame[name] for frame in frames]) for name in frames[0]}


def joined_rows(*parts: Mapping[str, Any]) -> dict[str, list[Any]]:
    """Results one after the other; None where a part lacks a column."""
    out: dict[str, list[Any]] = {name: [] for part in parts for name in part}
    for part in parts:
        size = len(next(iter(part.values()))) if part else 0
        for name, cells in out.items():
            cells += list(part[name]) if name in part else [None] * size
    return out


def numbers_of(rows: Mapping[str, Sequence[Any]], name: str) -> FloatArray:
    """A column of numbers, NaN where there is none; rows on disk have it as an array at once."""
    own = getattr(rows, "numbers", None)
    if own is not None:
        found: FloatArray = own(name)
        return found
    return np.array([np.nan if c is None else c for c in rows[name]], dtype=np.float64)
