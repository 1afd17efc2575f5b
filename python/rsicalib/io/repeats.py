"""Rows without the column `pose` that repeat held poses: what the core says of them, in words."""

from __future__ import annotations

import numpy as np

from rsicalib import _core
from rsicalib.arrays import IntArray
from rsicalib.facts.warned import Warned
from rsicalib.io.cells import MechanismLike
from rsicalib.io.samples import Samples
from rsicalib.io.suspicions import labels_of, places
from rsicalib.plain_text import counted


def numbered(readings: Samples, mechanism: MechanismLike) -> tuple[IntArray | None, list[Warned]]:
    """The pose of each row where rows repeat poses that nothing numbers, and what to say.

    A pose has the number of its first row. Where every row has a pose of its own and `sample`
    counts held ones, that is only said.

    Parameters
    ----------
    readings : Samples
        With the column `pose`, or without.
    mechanism : MechanismLike
        Units of the channels.

    Returns
    -------
    ndarray of int, shape (n,), or None
        None where every row is a pose of its own, or labelled.
    list of Warned
        At most one.
    """
    sample = readings.sample
    found = _core.unlabelled(mechanism.channels, readings.values, labels_of(readings), sample)
    if found is None:
        return None, []
    pose = None
    begins = found.get("begins", [])
    if found["kind"] == "gathered":
        size = found["size"]
        text = (
            f"there is no column pose, and the rows come in {len(readings) // size} groups of "
            f"{size} that differ less within than from group to group: every row is taken for a "
            "pose of its own. Where rows repeat a held pose, number it in the column pose: they "
            "show the noise that everything is judged by"
        )
    elif readings.held:
        text = (
            f"every row has a pose of its own, and sample begins again {len(begins)} times, "
            "between which the readings stand still: rows of a held pose have one number in the "
            "column pose, and show the noise that everything is judged by"
        )
    else:
        if found["by"] == "sample":
            times = counted(len(begins), "time")
            why = f"sample begins again {times} ({places(readings, begins)})"
        else:
            why = (
                f"the rows come in {len(begins) + 1} groups that repeat the same readings within "
                f"noise ({places(readings, begins)} begin{'s' * (len(begins) == 1)} a new one)"
            )
        if found["stand"]:
            pose, poses = _numbers(readings, begins)
            text = (
                f"there is no column pose, and {why}: they are taken for repeats of {poses} held "
                "poses, each called by its first row, and show the noise that everything is judged "
                "by; number the poses in the column pose, or the rows, if each is a pose of its own"
            )
        else:
            text = (
                f"there is no column pose, and {why}, but the readings move on in between: every "
                "row is taken for a pose of its own. Where rows repeat a held pose, number it in "
                "the column pose"
            )
    return pose, [Warned("unlabelled_repeats", None, text)]


def _numbers(readings: Samples, begins: list[int]) -> tuple[IntArray, int]:
    """The pose of each row, and how many there are.

    They begin at these rows, and where something else is touched.
    """
    first = np.zeros(len(readings), dtype=np.bool_)
    first[[0, *begins]] = True
    for cells in readings.keys.values():
        first[1:] |= np.asarray(cells[1:]) != np.asarray(cells[:-1])
    rows = np.flatnonzero(first)
    return np.repeat(readings.pose[rows], np.diff(np.r_[rows, len(readings)])), len(rows)
