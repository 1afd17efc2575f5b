"""What noise and averaging do to the paper's method: the cells of Table IX, simulated."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import numpy.typing as npt

from rsicalib import _core
from rsicalib.arrays import FloatArray
from rsicalib.facts.records import Record
from rsicalib.poses.devices import Device
from rsicalib.reproduction.placing import exact_readings, placed
from rsicalib.reproduction.trials import ITERATIONS, Draws, Estimate, rms, rms_of_rows


class NoiseCell(Record):
    """Errors of offsets and gains over trials, as in Table IX.

    Attributes
    ----------
    offset, gain : Estimate
        Root mean square over the channels of one trial, mean over trials: rad, rad/reading.
    failed : int
        Trials that did not converge near the truth, left out.
    """

    offset: Estimate
    gain: Estimate
    failed: int


def _cell(errors: Sequence[FloatArray]) -> NoiseCell:
    every = np.concatenate(errors)
    good = np.isfinite(every).all(axis=1)
    kept = every[good]
    return NoiseCell(Estimate.of(kept[:, 0]), Estimate.of(kept[:, 1]), int((~good).sum()))


def closed_loop_noise(
    device: Device,
    poses: npt.ArrayLike,
    draws: Draws,
    *,
    noise: float,
    average: int,
    placement: tuple[float, float] = (0.25, 0.25),
    round_average: bool = True,
) -> NoiseCell:
    """Errors of the closed-loop method under noise: a cell of Table IX.

    Parameters
    ----------
    device : Device
        The truth, from which the search also starts.
    poses : array_like, shape (n, 6)
        Poses that the hand aims at.
    draws : Draws
        Same seed, same placements, whatever the noise.
    noise : float
        Standard deviation of one sample, in readings, before it is rounded; 0 for truncation.
    average : int
        Number of samples of each pose.
    placement : (float, float)
        Standard deviation of where the hand puts the handle: length unit, rad.
    round_average : bool
        Round the average again, as an integer routine does; without it only samples are rounded.

    Returns
    -------
    NoiseCell
        Means with their standard errors.
    """
    aim = np.asarray(poses, dtype=np.float64)

    def job(rng: np.random.Generator, size: int) -> FloatArray:
        exact = placed(device, aim, placement, rng, size)
        read = averaged(device, exact, rng, noise, average, round_average)
        start = (device.offsets, device.gains)
        found = np.empty((size, *np.shape(start)))
        for k in range(size):
            offsets, gains, *_ = _core.minimize(
                device.mechanism, read[k], *start, max_iterations=ITERATIONS
            )
            found[k] = offsets, gains
        near = np.all(np.abs(found[:, 1] / device.gains - 1) < 0.5, axis=1)
        return np.where(near[:, None], rms_of_rows(found - start), np.nan)

    return _cell(draws.run(job))


def open_loop_noise(
    device: Device,
    poses: npt.ArrayLike,
    draws: Draws,
    *,
    noise: float,
    average: int,
    angle_noise: float = 0.005,
    average_angles: bool = True,
) -> NoiseCell:
    """Errors of the open-loop method (13) under noise: a cell of Table IX.

    Parameters
    ----------
    device : Device
        The truth.
    poses : array_like, shape (n, 6)
        Poses of the fixture.
    draws, noise, average
        As in `closed_loop_noise`.
    angle_noise : float
        Standard deviation of the presumed joint coordinates [rad].
    average_angles : bool
        A new error of the coordinates with every sample; else one for each pose.

    Returns
    -------
    NoiseCell
        Means with their standard errors.
    """
    exact = exact_readings(device, poses)
    angles = device.offsets + device.gains * exact

    def job(rng: np.random.Generator, size: int) -> FloatArray:
        every = np.broadcast_to(exact, (size, *exact.shape))
        read = averaged(device, every, rng, noise, average, True)
        scatter = angle_noise / (np.sqrt(average) if average_angles else 1.0)
        presumed = angles + scatter * rng.standard_normal(read.shape)
        errors = np.empty((size, 2))
        for k in range(size):
            offsets, gains = fixture_lines(read[k], presumed[k])
            errors[k] = rms(offsets - device.offsets), rms(gains - device.gains)
        return errors

    return _cell(draws.run(job))


def fixture_lines(readings: FloatArray, angles: FloatArray) -> tuple[FloatArray, FloatArray]:
    """The straight line of every channel by ordinary least squares, eq. (13).

    Parameters
    ----------
    readings, angles : ndarray, shape (n, C)
        Readings, and the joint coordinates they should give.

    Returns
    -------
    offsets, gains : ndarray, shape (C,)
        Joint coordinate at reading zero, and per reading.
    """
    middle, level = readings.mean(axis=0), angles.mean(axis=0)
    off = readings - middle
    gains: FloatArray = (off * (angles - level)).sum(axis=0) / (off**2).sum(axis=0)
    offsets: FloatArray = level - gains * middle
    return offsets, gains


def averaged(
    device: Device,
    exact: FloatArray,
    rng: np.random.Generator,
    noise: float,
    average: int,
    round_average: bool,
) -> FloatArray:
    """Averages of samples of many sets of poses.

    Parameters
    ----------
    device : Device
        Its mechanism says which channels count, and their ranges.
    exact : ndarray, shape (trials, n, C)
        Exact readings.
    rng : numpy.random.Generator
        Gives the seed of the noise.
    noise, average, round_average
        As in `closed_loop_noise`.

    Returns
    -------
    ndarray, shape (trials, n, C)
        Readings.
    """
    samples = average if noise > 0 else 1
    rows, seed = exact.reshape(-1, exact.shape[-1]), int(rng.integers(1 << 63))
    read: FloatArray = _core.means_of_samples(device.mechanism, rows, noise, samples, seed)
    if round_average:
        np.round(read, out=read)
    return read.reshape(exact.shape)
