"""Readings of the paper's poses: taken exactly, or as a hand places the handle."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from rsicalib.arrays import FloatArray
from rsicalib.errors import InputError
from rsicalib.poses.devices import Device


def exact_readings(device: Device, poses: npt.ArrayLike) -> FloatArray:
    """Readings without noise of poses that must all be within reach: shape (n, C)."""
    exact = device.readings(poses)
    bad = np.flatnonzero(~np.isfinite(exact).all(axis=1))
    if len(bad):
        raise InputError(f"poses: found number {bad[0] + 1} out of reach, expected reachable poses")
    return exact


def placed(
    device: Device,
    aim: FloatArray,
    placement: tuple[float, float],
    rng: np.random.Generator,
    trials: int,
) -> FloatArray:
    """Readings of poses placed by hand, those that cannot be taken placed again: (trials, n, C)."""
    sd = np.repeat(placement, 3)
    aims = np.tile(aim, (trials, 1))
    exact = np.full((len(aims), len(device.gains)), np.nan)
    for _ in range(100):
        again = np.flatnonzero(~np.isfinite(exact).all(axis=1))
        if len(again) == 0:
            return exact.reshape(trials, len(aim), -1)
        exact[again] = device.readings(aims[again] + sd * rng.standard_normal((len(again), 6)))
    raise InputError("poses: found one that cannot be taken wherever it is placed")
