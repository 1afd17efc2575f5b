"""Poses that the chains cannot reach, told by the row in which they stand."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager

import numpy as np

from rsicalib import _core
from rsicalib._core import Mechanism
from rsicalib.arrays import FloatArray, IntArray
from rsicalib.errors import InputError


@contextmanager
def reach_told(
    mechanism: Mechanism,
    poses: FloatArray,
    source: str,
    lines: IntArray,
    *,
    line_word: str = "row",
    labels: IntArray | None = None,
) -> Iterator[None]:
    """Refuse a pose out of reach by its row, where a job of the core on poses fails for it.

    Parameters
    ----------
    mechanism : Mechanism
        With a platform.
    poses : ndarray, shape (n, 6)
        The poses of the job; rows with NaN are none.
    source : str
        Where they stand.
    lines : ndarray of int, shape (n,)
        Line or row of each, from 1.
    line_word : {"line", "row"}
        How the message calls `lines`.
    labels : ndarray of int, shape (n,), optional
        What the poses are called there.

    Raises
    ------
    InputError
        For the first pose out of reach; otherwise what the job raised.
    """
    try:
        yield
    except InputError:
        for row in np.flatnonzero(np.isfinite(poses).all(axis=1)):
            why = _out_of_reach(mechanism, poses[row : row + 1])
            if why is not None:
                found = f"{'a pose' if labels is None else f'pose {labels[row]}'} out of reach"
                line, expected = int(lines[row]), "one that the chains reach"
                raise InputError.at(
                    source, found, expected, line=line, line_word=line_word, hint=why
                ) from None
        raise


def _out_of_reach(mechanism: Mechanism, pose: FloatArray) -> str | None:
    """What the core says of a pose, shape (1, 6), that the chains do not reach; None of others.

    Where the mechanism has no poses at all, that is raised.
    """
    gains = np.ones(len(mechanism.channels))
    _core.readings_at(mechanism, pose, 0.0 * gains, gains, 0.0)  # of no reach it says NaN
    try:
        _core.angles_at(mechanism, pose)
    except InputError as error:
        return error.message
    return None
