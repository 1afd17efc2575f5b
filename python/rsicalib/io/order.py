"""Order of the rows: the rows of a pose are neighbours, and time goes forward."""

from __future__ import annotations

import numpy as np

from rsicalib.errors import InputError
from rsicalib.facts.warned import Warned
from rsicalib.io.samples import Samples


def check_poses_are_together(readings: Samples) -> None:
    """Refuse a pose that begins again after another pose.

    Raises
    ------
    InputError
        The message names the row where the pose begins again, and where it had ended.
    """
    pose = readings.pose
    if not readings.held:
        return  # every row is a pose of its own
    starts = np.flatnonzero(np.r_[True, pose[1:] != pose[:-1]])
    _, first = np.unique(pose[starts], return_index=True)
    if len(first) == len(starts):
        return
    again = int(starts[np.setdiff1d(np.arange(len(starts)), first)[0]])
    before = int(np.flatnonzero(pose[:again] == pose[again])[-1])
    raise InputError.at(
        readings.source,
        f"pose {pose[again]} again, which ended at {readings.line_word} {readings.lines[before]}",
        "the rows of a pose next to each other",
        line=int(readings.lines[again]),
        column="pose",
        hint="Give each visit a number of its own; sessions go into files of their own.",
        line_word=readings.line_word,
    )


def time_goes_back(readings: Samples) -> list[Warned]:
    """Warn where the time of a row is before the time of the row above it."""
    if readings.time_s is None:
        return []
    back = np.flatnonzero(np.diff(readings.time_s) < 0.0) + 1
    if not len(back):
        return []
    i = int(back[0])
    times = f"from {readings.time_s[i - 1]:.6g} to {readings.time_s[i]:.6g} s"
    more = f", and {len(back) - 1} more times" if len(back) > 1 else ""
    place = f"{readings.source}, {readings.line_word} {readings.lines[i]}, column time_s"
    advice = (
        "terms of drift use it as it stands; check the clock, or give sessions files of their own"
    )
    text = f"{place}: time goes back {times}{more}; {advice}"
    return [Warned("time_goes_back", None, text)]
