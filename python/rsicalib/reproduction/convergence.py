"""Starts from which the paper's method converges.

All experiments run `_core.minimize`, the paper's own least squares in the paper's own parameters,
on simulated readings without noise.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import numpy.typing as npt

from rsicalib import _core
from rsicalib.arrays import FloatArray
from rsicalib.errors import InputError
from rsicalib.facts.records import Record
from rsicalib.poses.devices import Device
from rsicalib.reproduction.edges import edge, intervals
from rsicalib.reproduction.placing import exact_readings
from rsicalib.reproduction.trials import ITERATIONS, Estimate, Progress, run

CLOSE = 1e-3
"""A gain this near to the truth, as a fraction of it, is the right solution and no other."""


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
        Device with the true parameters.
    exact : ndarray, shape (n, C)
        Readings without noise.
    factors : float or ndarray, shape (C,)
        Starting gains over true gains.
    anchor : ndarray, shape (C,), optional
        Readings at which the joint coordinates are known, so that offsets start at
        `θ - k a`; without it the true offsets are kept, as in the paper.
    closures : sequence of str, optional
        Closures that are used; all by default.

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
    islands: bool = True,
    closures: Sequence[str] | None = None,
) -> Region:
    """Find the region of convergence when all gains are wrong by the same factor.

    Parameters
    ----------
    device : Device
        Device with the true parameters.
    poses : array_like, shape (n, 6)
        Poses that are visited without noise.
    anchored : bool
        Start with offsets that hold at the rest pose, instead of the true offsets.
    low, high : float
        Lowest and highest factor that is tried.
    step : float
        Distance between the factors that are tried.
    islands : bool
        Walk on beyond the ends, up to `low` and `high`.
    closures : sequence of str, optional
        Closures that are used; all by default.

    Returns
    -------
    Region
        Edges bisected to 1e-4 of the gain.
    """
    exact = exact_readings(device, poses)
    anchor = _anchor(device) if anchored else None

    def succeeds(factor: float) -> bool:
        return converges(device, exact, factor, anchor=anchor, closures=closures)

    ends = [edge(succeeds, limit, step=step) for limit in (low, high)]
    found: list[tuple[float, float]] = []
    for end, limit in zip(ends, (low, high), strict=True):
        if end.outside is None or not islands:
            continue
        beyond = np.arange(end.outside, limit, np.copysign(step, limit - end.outside)).tolist()
        good = [factor for factor in beyond if succeeds(factor)]
        found += intervals(good, 1.5 * step)
    return Region(ends[0].inside, ends[1].inside, tuple(sorted(found)))


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
        Device with the true parameters.
    poses : array_like, shape (n, 6)
        Poses that are visited without noise.
    anchored : bool
        Start with offsets that hold at the rest pose, instead of the true offsets.
    trials, seed : int
        Number of directions, and the seed they are drawn with.
    largest : float
        Largest error that is tried: 1 is a gain of zero, or twice the truth.
    progress, workers
        As in `run`.

    Returns
    -------
    ndarray, shape (trials,)
        Largest relative gain error along each direction from which the method still converges;
        sorted.
    """
    exact = exact_readings(device, poses)
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


class Starts(Record):
    """How often a start with independent gain errors succeeds.

    Attributes
    ----------
    error : float
        Gains are wrong by up to this fraction, each by its own.
    rate : Estimate
        Fraction of starts that succeed.
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
        Device with the true parameters.
    poses : array_like, shape (n, 6)
        Poses that are visited without noise.
    errors : sequence of float
        Half-widths of the uniform distribution, as fractions.
    anchored, trials, seed, closures, progress, workers
        As in `convergence_independent`.

    Returns
    -------
    list of Starts
        One for each half-width; the same draws, scaled.
    """
    exact = exact_readings(device, poses)
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


def _anchor(device: Device) -> FloatArray:
    rest = device.mechanism.to_dict().get("rest")
    if rest is None:
        raise InputError("found no rest pose in the mechanism, expected one to anchor the start on")
    anchor: FloatArray = device.readings([rest["pose"]])[0]
    return anchor
