"""Rows without the column `pose` that repeat held poses: told by `sample`, or by the readings."""

from __future__ import annotations

import numpy as np

from rsicalib.arrays import FloatArray, IntArray
from rsicalib.facts.warned import Warned
from rsicalib.io.cells import MechanismLike
from rsicalib.io.samples import Samples
from rsicalib.io.suspicions import places, resolution

__all__ = ["numbered", "numbered_apart"]

APART = 30.0
"""Rows that repeat differ by so many times less than poses: in motion all sizes between occur."""
FEWEST = 5
"""Poses that must have repeats."""
WALKED = 1.5
"""Steps of rows that walk along a grid add up to how far they go; those of repeats to more than
this many times as much. Only a warning hangs on it."""


def numbered(readings: Samples, mechanism: MechanismLike) -> tuple[IntArray | None, list[Warned]]:
    """The pose of each row where rows repeat poses that nothing numbers, and what to say.

    A pose has the number of its first row.

    Parameters
    ----------
    readings : Samples
        Without the column `pose`.
    mechanism : MechanismLike
        Units of the channels.

    Returns
    -------
    ndarray of int, shape (n,), or None
        None where every row is a pose of its own.
    list of Warned
        At most one.
    """
    if len(readings) < 4:
        return None, []
    steps = _steps(readings.values)
    again = _again(readings.sample)
    if len(again):
        times = f"{len(again)} time{'s' * (len(again) > 1)}"
        why = f"sample begins again {times} ({places(readings, again)})"
        starts = again if _stands_between(steps, again) else None
    else:
        starts = _jumps(steps, readings.values, resolution(readings.values, mechanism))
        if not len(starts):
            return None, _gathered(readings, steps)
        begin = f"begin{'s' * (len(starts) == 1)} a new one"
        why = (
            f"the rows come in {len(starts) + 1} groups that repeat the same readings within noise "
            f"({places(readings, starts)} {begin})"
        )
    if starts is None:
        text = (
            f"there is no column pose, and {why}, but the readings move on in between: every row "
            "is taken for a pose of its own. Where rows repeat a held pose, number it in the "
            "column pose"
        )
        return None, [Warned("unlabelled_repeats", None, text)]
    first = np.zeros(len(readings), dtype=np.bool_)
    first[np.r_[0, starts]] = True
    for cells in readings.keys.values():  # what is touched changes with the pose
        first[1:] |= np.asarray(cells[1:]) != np.asarray(cells[:-1])
    rows = np.flatnonzero(first)
    pose = np.repeat(readings.pose[rows], np.diff(np.r_[rows, len(readings)]))
    text = (
        f"there is no column pose, and {why}: they are taken for repeats of {len(rows)} held "
        "poses, each called by its first row, and show the noise that everything is judged by; "
        "number the poses in the column pose, or the rows, if each is a pose of its own"
    )
    return pose, [Warned("unlabelled_repeats", None, text)]


def numbered_apart(readings: Samples) -> list[Warned]:
    """What to say where every row has a pose of its own, and `sample` counts held ones.

    Parameters
    ----------
    readings : Samples
        With the column `pose`.

    Returns
    -------
    list of Warned
        At most one.
    """
    apart = len(readings) >= 4 and bool((np.diff(readings.pose) != 0).all())
    again = _again(readings.sample)
    if not apart or not len(again) or not _stands_between(_steps(readings.values), again):
        return []
    text = (
        f"every row has a pose of its own, and sample begins again {len(again)} times, between "
        "which the readings stand still: rows of a held pose have one number in the column pose, "
        "and show the noise that everything is judged by"
    )
    return [Warned("unlabelled_repeats", None, text)]


def _steps(values: FloatArray) -> FloatArray:
    """Largest change of any channel from row to row, in parts of its span."""
    spans = np.ptp(values, axis=0)
    moving = spans > 0.0
    changes = np.abs(np.diff(values, axis=0))[:, moving] / spans[moving]
    return np.asarray(changes.max(axis=1, initial=0.0))


def _again(sample: IntArray | None) -> IntArray:
    """Rows at which the number of the sample does not go on."""
    if sample is None:
        return np.empty(0, dtype=np.int64)
    return np.asarray(np.flatnonzero(np.diff(sample) <= 0) + 1)


def _stands_between(steps: FloatArray, starts: IntArray) -> bool:
    """Whether readings stand between most of these rows, and change at them.

    They change at a row where they do so by more than within both runs of rows that meet there. Of
    a motion this holds of one row in three at the most.
    """
    inside = steps.copy()
    inside[starts - 1] = 0.0
    bounds = np.r_[0, starts]
    largest = np.maximum.reduceat(np.r_[inside, 0.0], bounds)
    jumps = steps[starts - 1] > np.maximum(largest[:-1], largest[1:])
    repeated = np.diff(np.r_[bounds, len(steps) + 1]) > 1
    return bool(2 * jumps.sum() > len(starts) and repeated.any())


def _jumps(steps: FloatArray, values: FloatArray, resolution: FloatArray) -> IntArray:
    """Rows at which groups of repeats begin, the first aside; empty where rows are no repeats."""
    none: IntArray = np.empty(0, dtype=np.int64)
    spans = np.ptp(values, axis=0)
    moving = spans > 0.0
    if not moving.any():
        return none
    sizes = np.sort(steps)
    floor = np.maximum(sizes, (resolution[moving] / spans[moving]).max())
    at = int(np.argmax(floor[1:] / floor[:-1])) + 1
    jumps = np.flatnonzero(steps >= sizes[at]) + 1
    several = int((np.diff(np.r_[0, jumps, len(values)]) > 1).sum())
    if floor[at] < APART * floor[at - 1] or several < FEWEST or 2 * several < len(jumps):
        return none
    return np.asarray(jumps)


def _gathered(readings: Samples, steps: FloatArray) -> list[Warned]:
    """What to say of rows in groups of one size that are nearer to each other than to other groups.

    They may repeat held poses in a small part of the range, or be poses beside one another.
    """
    size = _group_size(readings.values, steps)
    if size is None:
        return []
    text = (
        f"there is no column pose, and the rows come in {len(readings) // size} groups of {size} "
        "that differ less within than from group to group: every row is taken for a pose of its "
        "own. Where rows repeat a held pose, number it in the column pose: they show the noise "
        "that everything is judged by"
    )
    return [Warned("unlabelled_repeats", None, text)]


def _group_size(values: FloatArray, steps: FloatArray) -> int | None:
    """The size of groups of rows, if from each to the next more changes than within any of them.

    By chance the largest steps stand at equal distances once in as many sessions as there are ways
    to place them.
    """
    rows, spans = len(values), np.ptp(values, axis=0)
    moving = spans > 0.0
    for size in range(3, rows // FEWEST + 1):
        if rows % size:
            continue
        groups = values[:, moving].reshape(rows // size, size, -1) / spans[moving]
        reach = np.ptp(groups, axis=1).max(axis=0)
        widest = int(np.argmax(reach))
        step = np.abs(np.diff(groups[:, :, widest], axis=1)).max()
        # What walks on from row to row ends as far away as it has gone.
        to_and_fro = (size - 1) * step > WALKED * reach[widest]
        if to_and_fro and steps[size - 1 :: size].min() > reach[widest]:
            return size
    return None
