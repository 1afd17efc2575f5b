"""Experiments on the paper's method: where it converges, and what noise and averaging do to it.

All of them run `_core.minimize`, the paper's own least squares in the paper's own parameters, on
simulated readings. Trials are drawn in chunks, each from a seed of its own, so that results
depend on neither the number of threads nor their order; the core releases the interpreter, so
threads share the work.
"""

from __future__ import annotations

import os
from collections.abc import Callable, Sequence
from concurrent.futures import FIRST_COMPLETED, Future, ThreadPoolExecutor, wait
from dataclasses import dataclass
from typing import TypeVar

import numpy as np
import numpy.typing as npt

from rsicalib import _core
from rsicalib.arrays import FloatArray
from rsicalib.devices import Device, readings_of
from rsicalib.errors import InputError
from rsicalib.records import Record

__all__ = [
    "Edge",
    "Estimate",
    "NoiseCell",
    "Progress",
    "Region",
    "Starts",
    "closed_loop_noise",
    "convergence_equal",
    "convergence_independent",
    "converges",
    "edge",
    "fixture_lines",
    "open_loop_noise",
    "placed",
    "run",
    "start_success",
]

Progress = Callable[[int, int], None]
"""Called with the trials that are done, and all of them."""

T = TypeVar("T")

CHUNK = 50
"""Trials that one job takes; part of what a seed means."""

ITERATIONS = 200
"""Linearisations before a trial counts as failed."""

CLOSE = 1e-3
"""A gain this near to the truth, as a fraction of it, is the right solution and no other."""


@dataclass(frozen=True)
class Estimate(Record):
    """A mean over trials.

    Attributes
    ----------
    value : float
        The mean.
    sd : float or None
        Its standard error.
    trials : int
        That it rests on.
    """

    value: float
    sd: float | None
    trials: int

    @classmethod
    def of(cls, values: npt.ArrayLike) -> Estimate:
        """The mean of independent trials, and its standard error."""
        values = np.asarray(values, dtype=np.float64)
        count = len(values)
        if count == 0:
            return cls(float("nan"), None, 0)
        sd = float(values.std(ddof=1) / np.sqrt(count)) if count > 1 else None
        return cls(float(values.mean()), sd, count)


def run(
    job: Callable[[np.random.Generator, int], T],
    trials: int,
    seed: int,
    *,
    progress: Progress | None = None,
    workers: int | None = None,
    chunk: int = CHUNK,
) -> list[T]:
    """Run trials in chunks on all cores, in an order that nothing depends on.

    Parameters
    ----------
    job : callable
        Takes a generator of its own and the number of trials in its chunk.
    trials, seed : int
        How many in all; same seed, same results.
    progress : callable, optional
        Called with trials done and trials in all, from the calling thread.
    workers : int, optional
        Threads; as many as there are cores by default.
    chunk : int
        Trials in one job.

    Returns
    -------
    list
        What the jobs return, in the order of the chunks.

    Notes
    -----
    Ctrl-C drops the chunks that have not begun and is raised again at once.
    """
    if trials < 1:
        raise InputError(f"trials: found {trials}, expected at least 1")
    sizes = [min(chunk, trials - first) for first in range(0, trials, chunk)]
    seeds = np.random.SeedSequence(seed).spawn(len(sizes))
    workers = workers or len(os.sched_getaffinity(0))
    results: dict[int, T] = {}
    with ThreadPoolExecutor(max_workers=workers) as pool:
        try:
            waiting: dict[Future[T], int] = {
                pool.submit(job, np.random.default_rng(own), size): k
                for k, (own, size) in enumerate(zip(seeds, sizes, strict=True))
            }
            while waiting:
                # With a timeout, since a wait without one cannot be interrupted everywhere.
                done, _ = wait(waiting, timeout=0.5, return_when=FIRST_COMPLETED)
                for future in done:
                    k = waiting.pop(future)
                    results[k] = future.result()
                if progress is not None and done:
                    progress(sum(sizes[k] for k in results), trials)
        except BaseException:
            pool.shutdown(wait=False, cancel_futures=True)
            raise
    return [results[k] for k in range(len(sizes))]


# ------------------------------------------------------------------ convergence


def converges(
    device: Device,
    exact: FloatArray,
    factors: FloatArray | float,
    *,
    anchor: FloatArray | None = None,
    closures: Sequence[str] | None = None,
) -> bool:
    """Whether the paper's method finds the truth from gains that are wrong by these factors.

    Parameters
    ----------
    device : Device
        The truth.
    exact : ndarray, shape (n, C)
        Readings without noise.
    factors : float or ndarray, shape (C,)
        Starting gains over true gains.
    anchor : ndarray, shape (C,), optional
        Readings at which the joint coordinates are known, so that offsets start at
        `θ - k a`; without it the true offsets are kept, as in the paper.
    closures : sequence of str, optional
        Only these.

    Returns
    -------
    bool
        Every gain within 0.1 % of the truth.
    """
    gains = device.gains * factors
    offsets = device.offsets
    if anchor is not None:
        offsets = device.offsets + (device.gains - gains) * anchor
    _, found, *_ = _core.minimize(
        device.mechanism, exact, offsets, gains, closures=closures, max_iterations=ITERATIONS
    )
    return bool(np.all(np.abs(found / device.gains - 1) < CLOSE))


@dataclass(frozen=True)
class Edge(Record):
    """Where convergence ends in one direction.

    Attributes
    ----------
    inside, outside : float
        The last start that succeeds and the first that fails, as factors on the gains.
    """

    inside: float
    outside: float | None


def edge(
    succeeds: Callable[[float], bool], limit: float, *, step: float = 0.01, width: float = 1e-4
) -> Edge:
    """Walk from 1 towards a limit until a start fails, and bisect the edge.

    Parameters
    ----------
    succeeds : callable
        Of a factor.
    limit : float
        As far as to walk.
    step : float
        Of the walk; a gap or an island that is narrower may be missed.
    width : float
        At which the bisection ends.

    Returns
    -------
    Edge
        `outside` is None where every start as far as the limit succeeds.
    """
    inside = 1.0
    grid = np.linspace(1.0, limit, int(np.ceil(abs(limit - 1.0) / step)) + 1)[1:]
    for factor in grid.tolist():
        if succeeds(factor):
            inside = factor
            continue
        outside = factor
        while abs(outside - inside) > width:
            middle = (inside + outside) / 2
            if succeeds(middle):
                inside = middle
            else:
                outside = middle
        return Edge(inside, outside)
    return Edge(inside, None)


@dataclass(frozen=True)
class Region(Record):
    """From which equal gains the paper's method converges.

    Attributes
    ----------
    low, high : float
        Ends of the interval about the truth, as factors on the gains; the factor at
        which the walk ended where no end was found.
    islands : tuple of (float, float)
        Intervals of the walk beyond the ends from which it converges all the same.
    """

    low: float
    high: float
    islands: tuple[tuple[float, float], ...] = ()


def convergence_equal(
    device: Device,
    poses: npt.ArrayLike,
    *,
    anchored: bool = False,
    low: float = 0.5,
    high: float = 1.5,
    step: float = 0.005,
    closures: Sequence[str] | None = None,
) -> Region:
    """Find the region of convergence when all gains are wrong by the same factor.

    Parameters
    ----------
    device : Device
        The truth.
    poses : array_like, shape (n, 6)
        Visited without noise.
    anchored : bool
        Start with offsets that hold at the rest pose, instead of the true offsets.
    low, high : float
        Factors as far as which is looked.
    step : float
        Between the factors that are tried.
    closures : sequence of str, optional
        Only these.

    Returns
    -------
    Region
        Edges bisected to 1e-4 of the gain.
    """
    exact = _exact(device, poses)
    anchor = _anchor(device) if anchored else None

    def succeeds(factor: float) -> bool:
        return converges(device, exact, factor, anchor=anchor, closures=closures)

    ends = [edge(succeeds, limit, step=step) for limit in (low, high)]
    islands: list[tuple[float, float]] = []
    for end, limit in zip(ends, (low, high), strict=True):
        if end.outside is None:
            continue
        beyond = np.arange(end.outside, limit, np.copysign(step, limit - end.outside)).tolist()
        good = [factor for factor in beyond if succeeds(factor)]
        islands += _runs(good, 1.5 * step)
    return Region(ends[0].inside, ends[1].inside, tuple(sorted(islands)))


def _runs(values: Sequence[float], gap: float) -> list[tuple[float, float]]:
    """Neighbouring values as intervals."""
    runs: list[list[float]] = []
    for value in sorted(values):
        if runs and value - runs[-1][1] <= gap:
            runs[-1][1] = value
        else:
            runs.append([value, value])
    return [(first, last) for first, last in runs]


def convergence_independent(
    device: Device,
    poses: npt.ArrayLike,
    *,
    anchored: bool = False,
    trials: int = 200,
    largest: float = 1.0,
    seed: int = 0,
    progress: Progress | None = None,
    workers: int | None = None,
) -> FloatArray:
    """Find how far the gains may be wrong, each by an error of its own.

    Each trial draws a direction uniformly from the cube of gain errors, its largest entry scaled
    to one, and bisects how far along it the method still converges.

    Parameters
    ----------
    device : Device
        The truth.
    poses : array_like, shape (n, 6)
        Visited without noise.
    anchored : bool
        Start with offsets that hold at the rest pose, instead of the true offsets.
    trials, seed : int
        Directions.
    largest : float
        As far as to walk: 1 is a gain of zero, or twice the truth.
    progress, workers
        As in `run`.

    Returns
    -------
    ndarray, shape (trials,)
        Largest relative gain error along each direction from which the method still converges;
        sorted.
    """
    exact = _exact(device, poses)
    anchor = _anchor(device) if anchored else None

    def job(rng: np.random.Generator, size: int) -> list[float]:
        found = []
        for _ in range(size):
            way = rng.uniform(-1, 1, len(device.gains))
            way /= np.abs(way).max()

            def succeeds(t: float, way: FloatArray = way) -> bool:
                return converges(device, exact, 1 + (t - 1) * way, anchor=anchor)

            found.append(edge(succeeds, 1 + largest, step=0.02, width=1e-3).inside - 1)
        return found

    chunks = run(job, trials, seed, progress=progress, workers=workers, chunk=10)
    return np.sort(np.concatenate(chunks))


@dataclass(frozen=True)
class Starts(Record):
    """How often a start with independent gain errors succeeds.

    Attributes
    ----------
    error : float
        Gains are wrong by up to this fraction, each by its own.
    rate : Estimate
        Of success.
    """

    error: float
    rate: Estimate


def start_success(
    device: Device,
    poses: npt.ArrayLike,
    errors: Sequence[float],
    *,
    anchored: bool = False,
    trials: int = 200,
    seed: int = 0,
    closures: Sequence[str] | None = None,
    progress: Progress | None = None,
    workers: int | None = None,
) -> list[Starts]:
    """Count how often the method converges from gains drawn uniformly about the truth.

    Parameters
    ----------
    device : Device
        The truth.
    poses : array_like, shape (n, 6)
        Visited without noise.
    errors : sequence of float
        Half-widths of the uniform distribution, as fractions.
    anchored, trials, seed, closures, progress, workers
        As in `convergence_independent`.

    Returns
    -------
    list of Starts
        One for each half-width; the same draws, scaled.
    """
    exact = _exact(device, poses)
    anchor = _anchor(device) if anchored else None

    def job(rng: np.random.Generator, size: int) -> FloatArray:
        ways = rng.uniform(-1, 1, (size, len(device.gains)))
        return np.array(
            [
                [
                    converges(device, exact, 1 + e * w, anchor=anchor, closures=closures)
                    for e in errors
                ]
                for w in ways
            ],
            dtype=np.float64,
        )

    hits = np.concatenate(run(job, trials, seed, progress=progress, workers=workers))
    return [Starts(e, Estimate.of(hits[:, k])) for k, e in enumerate(errors)]


# ------------------------------------------------------------------ noise and averaging


@dataclass(frozen=True)
class NoiseCell(Record):
    """Errors of offsets and gains over trials, as in Table IX.

    Attributes
    ----------
    offset, gain : Estimate
        Root mean square over the channels of one trial, mean over trials: rad, rad/reading.
    offset_median, gain_median : float
        The same with the median over trials, which a few bad sets of poses do not move.
    failed : int
        Trials that did not converge near the truth, left out.
    """

    offset: Estimate
    gain: Estimate
    offset_median: float
    gain_median: float
    failed: int


def _cell(errors: Sequence[FloatArray]) -> NoiseCell:
    every = np.concatenate(errors)
    good = np.isfinite(every).all(axis=1)
    kept = every[good]
    return NoiseCell(
        Estimate.of(kept[:, 0]),
        Estimate.of(kept[:, 1]),
        float(np.median(kept[:, 0])) if len(kept) else float("nan"),
        float(np.median(kept[:, 1])) if len(kept) else float("nan"),
        int((~good).sum()),
    )


def closed_loop_noise(
    device: Device,
    poses: npt.ArrayLike,
    *,
    noise: float,
    average: int,
    placement: tuple[float, float] = (0.25, 0.25),
    round_average: bool = True,
    trials: int = 1000,
    seed: int = 0,
    progress: Progress | None = None,
    workers: int | None = None,
) -> NoiseCell:
    """Errors of the closed-loop method under noise: a cell of Table IX.

    Parameters
    ----------
    device : Device
        The truth, from which the search also starts.
    poses : array_like, shape (n, 6)
        Aimed at.
    noise : float
        Standard deviation of one sample, in readings, before it is rounded; 0 for truncation.
    average : int
        Samples of each pose.
    placement : (float, float)
        Standard deviation of where the hand puts the handle: length unit, rad.
    round_average : bool
        Round the average again, as an integer routine does; without it only samples are rounded.
    trials, seed : int
        Same seed, same placements, whatever the noise.
    progress, workers
        As in `run`.

    Returns
    -------
    NoiseCell
        With standard errors.
    """
    aim = np.asarray(poses, dtype=np.float64)

    def job(rng: np.random.Generator, size: int) -> FloatArray:
        exact = placed(device, aim, placement, rng, size)
        read = _averaged(device, exact, rng, noise, average, round_average)
        errors = np.full((size, 2), np.nan)
        for k in range(size):
            offsets, gains, *_ = _core.minimize(
                device.mechanism, read[k], device.offsets, device.gains, max_iterations=ITERATIONS
            )
            if np.all(np.abs(gains / device.gains - 1) < 0.5):
                errors[k] = _rms(offsets - device.offsets), _rms(gains - device.gains)
        return errors

    return _cell(run(job, trials, seed, progress=progress, workers=workers))


def open_loop_noise(
    device: Device,
    poses: npt.ArrayLike,
    *,
    noise: float,
    average: int,
    angle_noise: float = 0.005,
    average_angles: bool = True,
    trials: int = 1000,
    seed: int = 0,
    progress: Progress | None = None,
    workers: int | None = None,
) -> NoiseCell:
    """Errors of the open-loop method (13) under noise: a cell of Table IX.

    Parameters
    ----------
    device : Device
        The truth.
    poses : array_like, shape (n, 6)
        Of the fixture.
    noise, average, trials, seed, progress, workers
        As in `closed_loop_noise`.
    angle_noise : float
        Standard deviation of the presumed joint coordinates [rad].
    average_angles : bool
        A new error of the coordinates with every sample; else one for each pose.

    Returns
    -------
    NoiseCell
        With standard errors.
    """
    exact = _exact(device, poses)
    angles = device.offsets + device.gains * exact

    def job(rng: np.random.Generator, size: int) -> FloatArray:
        every = np.broadcast_to(exact, (size, *exact.shape))
        read = _averaged(device, every, rng, noise, average, True)
        scatter = angle_noise / (np.sqrt(average) if average_angles else 1.0)
        presumed = angles + scatter * rng.standard_normal(read.shape)
        errors = np.empty((size, 2))
        for k in range(size):
            offsets, gains = fixture_lines(read[k], presumed[k])
            errors[k] = _rms(offsets - device.offsets), _rms(gains - device.gains)
        return errors

    return _cell(run(job, trials, seed, progress=progress, workers=workers))


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


def _averaged(
    device: Device,
    exact: FloatArray,
    rng: np.random.Generator,
    noise: float,
    average: int,
    round_average: bool,
) -> FloatArray:
    """Averages of samples of many sets of poses: shape (trials, n, C)."""
    trials, poses, channels = exact.shape
    read = device.sample(
        exact.reshape(trials * poses, channels),
        rng,
        noise=noise,
        samples=average if noise > 0 else 1,
    ).mean(axis=1)
    if round_average:
        read = np.round(read)
    averaged: FloatArray = read.reshape(exact.shape)
    return averaged


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
        exact[again] = readings_of(device, aims[again] + sd * rng.standard_normal((len(again), 6)))
    raise InputError("poses: found one that cannot be taken wherever it is placed")


def _exact(device: Device, poses: npt.ArrayLike) -> FloatArray:
    exact = readings_of(device, np.asarray(poses, dtype=np.float64))
    bad = np.flatnonzero(~np.isfinite(exact).all(axis=1))
    if len(bad):
        raise InputError(f"poses: found number {bad[0] + 1} out of reach, expected reachable poses")
    return exact


def _anchor(device: Device) -> FloatArray:
    rest = device.mechanism.to_dict().get("rest")
    if rest is None:
        raise InputError("found no rest pose in the mechanism, expected one to anchor the start on")
    anchor: FloatArray = device.readings([rest["pose"]])[0]
    return anchor


def _rms(values: FloatArray) -> float:
    return float(np.sqrt(np.mean(values**2)))
