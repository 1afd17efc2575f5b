"""Starts from which the paper's method converges.

All experiments run `_core.minimize`, the paper's own least squares in the paper's own parameters,
on simulated readings without noise.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from rsicalib import _core
from rsicalib.arrays import FloatArray
from rsicalib.errors import InputError
from rsicalib.facts.records import Record
from rsicalib.poses.devices import Device
from rsicalib.reproduction.edges import edge, intervals
from rsicalib.reproduction.placing import exact_readings
from rsicalib.reproduction.trials import ITERATIONS, Draws, Estimate

CLOSE = 1e-3
"""A gain this near to the truth, as a fraction of it, is the right solution and no other."""

STEP = 0.005
"""Distance between the factors that are tried where all gains are wrong alike."""


@dataclass(frozen=True)
class Searches:
    """Searches of the paper's method for the truth, from gains that are wrong.

    Attributes
    ----------
    device : Device
        Device with the true parameters.
    exact : ndarray, shape (n, C)
        Readings without noise.
    anchor : ndarray, shape (C,), optional
        Readings at which the joint coordinates are known, so that offsets start at
        `θ - k a`; without it the true offsets are kept, as in the paper.
    """

    device: Device
    exact: FloatArray
    anchor: FloatArray | None

    @classmethod
    def of(cls, device: Device, poses: npt.ArrayLike, anchored: bool) -> Searches:
        """Searches from readings of these poses, anchored at the rest pose or not."""
        return cls(device, exact_readings(device, poses), _anchor(device) if anchored else None)

    def succeed(self, factors: FloatArray | float) -> bool:
        """Whether every gain comes within 0.1 % of the truth from these factors on the gains."""
        gains, offsets = self.device.gains * factors, self.device.offsets
        if self.anchor is not None:
            offsets = offsets + (self.device.gains - gains) * self.anchor
        _, found, *_ = _core.minimize(
            self.device.mechanism, self.exact, offsets, gains, max_iterations=ITERATIONS
        )
        return bool(np.all(np.abs(found / self.device.gains - 1) < CLOSE))


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
    islands: bool = True,
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
    islands : bool
        Walk on beyond the ends, up to `low` and `high`.

    Returns
    -------
    Region
        Edges bisected to 1e-4 of the gain.
    """
    succeed = Searches.of(device, poses, anchored).succeed
    ends = [edge(succeed, limit, step=STEP) for limit in (low, high)]
    found: list[tuple[float, float]] = []
    for end, limit in zip(ends, (low, high), strict=True):
        if end.outside is None or not islands:
            continue
        beyond = np.arange(end.outside, limit, np.copysign(STEP, limit - end.outside)).tolist()
        found += intervals([factor for factor in beyond if succeed(factor)], 1.5 * STEP)
    return Region(ends[0].inside, ends[1].inside, tuple(sorted(found)))


def convergence_independent(
    device: Device, poses: npt.ArrayLike, draws: Draws, *, anchored: bool = False
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
    draws : Draws
        Of the directions. Errors up to 1 are tried: a gain of zero, or twice the truth.
    anchored : bool
        Start with offsets that hold at the rest pose, instead of the true offsets.

    Returns
    -------
    ndarray, shape (trials,)
        Largest relative gain error along each direction from which the method still converges;
        sorted.
    """
    searches = Searches.of(device, poses, anchored)

    def job(rng: np.random.Generator, size: int) -> list[float]:
        found = []
        for _ in range(size):
            way = rng.uniform(-1, 1, len(device.gains))
            way /= np.abs(way).max()

            def succeeds(t: float, way: FloatArray = way) -> bool:
                return searches.succeed(1 + (t - 1) * way)

            found.append(edge(succeeds, 2.0, step=0.02, width=1e-3).inside - 1)
        return found

    return np.sort(np.concatenate(draws.run(job, chunk=10)))


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
    draws: Draws,
    *,
    anchored: bool = False,
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
    draws, anchored
        As in `convergence_independent`.

    Returns
    -------
    list of Starts
        One for each half-width; the same draws, scaled.
    """
    searches = Searches.of(device, poses, anchored)

    def job(rng: np.random.Generator, size: int) -> FloatArray:
        ways = rng.uniform(-1, 1, (size, len(device.gains)))
        hits = [[searches.succeed(1 + e * w) for e in errors] for w in ways]
        return np.array(hits, dtype=np.float64)

    hits = np.concatenate(draws.run(job))
    return [Starts(e, Estimate.of(hits[:, k])) for k, e in enumerate(errors)]


def _anchor(device: Device) -> FloatArray:
    rest = device.mechanism.to_dict().get("rest")
    if rest is None:
        raise InputError("found no rest pose in the mechanism, expected one to anchor the start on")
    anchor: FloatArray = device.readings([rest["pose"]])[0]
    return anchor
