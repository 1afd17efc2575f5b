"""Samples of all channels as read-only arrays."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt

from rsicalib.arrays import Alike, FloatArray, IntArray
from rsicalib.facts.warned import Warned


@dataclass(frozen=True)
class Skipped:
    """A row that was dropped: where, and its first fault."""

    line: int
    column: str | None
    reason: str


@dataclass(frozen=True, eq=False)
class Part(Alike):
    """Which rows of a session, as it was taken, some readings are.

    From where a pose was approached, how far a channel had travelled and how much time had passed
    is of the session: leaving rows out changes none of it.
    """

    whole: Samples
    rows: IntArray


@dataclass(frozen=True, eq=False)
class Samples(Alike):
    """Samples of all channels, one row each: `n` samples of `C` channels.

    The docstring of `Readings` says what each field holds.
    """

    channels: tuple[str, ...]
    values: FloatArray
    pose: IntArray
    held: bool
    sample: IntArray | None
    time_s: FloatArray | None
    temperature_c: FloatArray | None
    poses: FloatArray | None
    keys: dict[str, tuple[str, ...]]
    columns: dict[str, FloatArray]
    lines: IntArray
    source: str
    sha256: str
    warnings: tuple[Warned, ...] = ()
    skipped: tuple[Skipped, ...] = ()
    line_word: str = "line"
    in_memory: bool = False
    repeats: IntArray | None = None
    part: Part | None = None

    @property
    def labels(self) -> IntArray | None:
        """Pose of each row where rows repeat held poses; None where each is a pose of its own."""
        return self.pose if self.held else self.repeats

    @property
    def taken(self) -> Samples:
        """The session as it was taken: all its rows."""
        return self if self.part is None else self.part.whole

    @property
    def own(self) -> IntArray:
        """Which rows of it these are."""
        return np.arange(len(self)) if self.part is None else self.part.rows

    def __len__(self) -> int:
        return len(self.values)

    @property
    def n_poses(self) -> int:
        """Number of different poses."""
        if not self.held or not len(self):
            return len(self)
        return 1 + int(np.count_nonzero(self.pose[1:] != self.pose[:-1]))  # rows are neighbours


def frozen(array: npt.NDArray[Any]) -> Any:
    """Return the array in one block of memory, read-only."""
    array = np.ascontiguousarray(array)
    array.flags.writeable = False
    return array


def picked(cells: Iterable[str], keep: npt.NDArray[np.bool_]) -> tuple[str, ...]:
    """Return the cells of the rows to keep."""
    return tuple(cell for cell, kept in zip(cells, keep, strict=True) if kept)
