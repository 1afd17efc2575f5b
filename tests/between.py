"""Arms that differ from placement to placement, by the hundred: coverage between placements.

`python -m tests.between --arms 400` prints, for 3, 5 and 8 placements, how many 95 % intervals of
the parameters hold the mean arm, and how many of predicted positions hold an arm at a placement
that was not recorded; beside them what intervals within placements hold, the share of arms whose
interval of the component holds the truth, how often p is below 5 % and readings are left out as
damaged, and χ² of the halves. At each placement a ball on the tool rests in one cone in 30 poses;
offsets and the ball differ by `--sd` typical sizes from placement to placement.
"""

from __future__ import annotations

import argparse
import tomllib
from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np

import rsicalib
from tests import cone
from tests.oracle import Array, crossed

POSES = 30
PLAY = 0.05
"""How well the ball rests [mm]."""
BALL = np.array([40.0, 0.0, 120.0])
FREE = ("q2", "q3", "q4", "q5")
"""Channels whose offsets are estimated: the first turns with the cones, the last with the ball."""
SIZES = np.array([0.05] * 4 + [0.05 * 425.0] * 3)
"""Typical sizes of the offsets [rad] and of the ball, a twentieth of the longest link [mm]."""
TERMS = '["offset@q2", "offset@q3", "offset@q4", "offset@q5", "point_position"]'


def moving(
    q: Array, ball: Array = BALL, before: Sequence[Array] | None = None
) -> tuple[Array, Array]:
    """Places of the ball for joint angles, shape (m, 6), and their derivatives: axis × lever.

    `before` each joint stands a frame, (4, 4): where its drawing is wrong.
    """
    frames = np.broadcast_to(np.eye(4), (len(q), 4, 4))
    axes, origins = [], []
    each = before or [np.eye(4)] * len(cone.ROWS)
    for angle, own, (d, a, alpha) in zip(q.T, each, cone.ROWS, strict=True):
        frames = frames @ own
        axes.append(frames[:, :3, 2])
        origins.append(frames[:, :3, 3])
        c, s, ca, sa = np.cos(angle), np.sin(angle), np.cos(alpha), np.sin(alpha)
        row = np.zeros((len(q), 4, 4))
        row[:, 0] = np.stack([c, -s * ca, s * sa, a * c], axis=1)
        row[:, 1] = np.stack([s, c * ca, -c * sa, a * s], axis=1)
        row[:, 2], row[:, 3] = [0, sa, ca, d], [0, 0, 0, 1]
        frames = frames @ row
    places = (frames @ np.append(ball, 1.0))[:, :3]
    turns = [crossed(z, places - o) for z, o in zip(axes, origins, strict=True)]
    return places, np.stack(turns, axis=2)


def tips(q: Array, ball: Array = BALL) -> Array:
    """Places of the ball alone."""
    return moving(q, ball)[0]


def touching(q: Array, places: Array, ball: Array) -> Array:
    """Joint angles near `q` at which the ball is at its places, by Newton's method."""
    for _ in range(15):
        at, slopes = moving(q, ball)
        across = slopes @ slopes.transpose(0, 2, 1)
        pulled = np.linalg.solve(across, (at - places)[..., None])
        off = (slopes.transpose(0, 2, 1) @ pulled)[..., 0]
        q = q - off * np.minimum(1.0, 0.3 / np.abs(off).max(axis=1, keepdims=True).clip(1e-300))
        if np.abs(off).max() < 1e-12:
            break
    return q


def placement(rng: np.random.Generator, true: Array) -> Array:
    """Readings at one placement of an arm with four offsets and a ball's displacement."""
    offsets, ball = np.array([0.0, *true[:4], 0.0]), BALL + true[4:]
    centre = cone.CONE + rng.uniform(-150, 150, 3)
    found = np.zeros((0, 6))
    while len(found) < POSES:
        near = np.array([0.4, -1.4, -1.6, -1.5, 1.5, 0.0])
        near = near + rng.uniform(-1, 1, (POSES, 6)) * [1, 0.6, 0.8, 1.5, 1.5, 3]
        places = centre + PLAY * rng.standard_normal((POSES, 3))
        q = touching(near, places, ball)
        good = np.all((q > cone.LIMITS[:, 0]) & (q < cone.LIMITS[:, 1]), axis=1)
        good &= np.abs(tips(q, ball) - places).max(axis=1) < 1e-6
        found = np.concatenate([found, (q - offsets)[good]])
    return found[:POSES]


@dataclass
class Counts:
    """What held the truth, of how many arms."""

    mean: list[bool] = field(default_factory=list)
    elsewhere: list[bool] = field(default_factory=list)
    within: list[bool] = field(default_factory=list)
    interval: list[bool] = field(default_factory=list)
    small: list[bool] = field(default_factory=list)
    damaged: list[bool] = field(default_factory=list)
    """Where readings were left out, of which none is damaged."""
    halves: list[float] = field(default_factory=list)
    """χ² of the difference of the halves, per parameter."""


def one(mechanism: rsicalib.Mechanism, seed: int, placements: int, sd: float, into: Counts) -> None:
    """Simulate an arm, calibrate it, and count."""
    rng = np.random.default_rng([seed, placements])
    true = np.array([0.004, -0.006, 0.008, -0.010, 1.0, -2.0, 1.5])
    shifts = sd * SIZES * rng.standard_normal((placements + 1, 7))
    rows = np.concatenate([placement(rng, true + shift) for shift in shifts[1:]])
    table = {f"q{k + 1}": column for k, column in enumerate(rows.T)}
    at = [f"plate {k}" for k in range(placements) for _ in range(POSES)]
    found = rsicalib.calibrate({**table, "at": at}, mechanism)
    between = found.between
    assert between is not None, found.verdict
    estimates = [p for p in found.parameters if p.term in ("offset", "point_position")]
    value = np.array([p.value for p in estimates], dtype=float)
    sd_between = np.array([p.sd_between for p in estimates], dtype=float)
    off = value - true
    into.mean += list(np.abs(off) < 1.96 * sd_between)
    into.interval.append(between.interval[0] <= sd <= between.interval[1])
    into.small.append(between.p_value < 0.05)
    into.damaged.append(bool(found.excluded))
    if between.halves is not None:
        into.halves.append(between.halves.chi2_between)
    covariance = np.array(between.covariance, dtype=float)[:7, :7]
    elsewhere = covariance + np.diag([p.sd**2 for p in between.parameters])
    near = np.array([0.4, -1.4, -1.6, -1.5, 1.5, 0.0]) + rng.uniform(-0.6, 0.6, (4, 6))

    def at_poses(values: Array) -> Array:
        return tips(near + np.array([0.0, *values[:4], 0.0]), BALL + values[4:])

    error = at_poses(value) - at_poses(true + shifts[0])
    steps = np.diag(1e-6 * SIZES)
    slopes = np.stack([(at_poses(value + h) - at_poses(value - h)) / (2 * h.sum()) for h in steps])
    for chosen, spread in ((into.elsewhere, elsewhere), (into.within, _within(found))):
        variance = np.einsum("ipk,ij,jpk->pk", slopes, spread, slopes)
        chosen += list((np.abs(error) < 1.96 * np.sqrt(variance)).ravel())


def _within(found: rsicalib.Calibration) -> Array:
    return np.array(found.covariance, dtype=float)[:7, :7]


def mechanism() -> rsicalib.Mechanism:
    """The arm, its encoders and the seat of its ball declared."""
    return rsicalib.Mechanism.from_dict(tomllib.loads(cone.mechanism(1e-6, PLAY, TERMS)))


def counted(arms: int, placements: int, sd: float, seed: int = 1) -> Counts:
    """Coverage of so many arms."""
    own, counts = mechanism(), Counts()
    for k in range(arms):
        one(own, seed + k, placements, sd, counts)
    return counts


def main(arguments: Sequence[str] | None = None) -> None:
    """Print a line for each number of placements."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--arms", type=int, default=400)
    parser.add_argument("--sd", type=float, nargs="+", default=[0.005, 0.0])
    parser.add_argument("--placements", type=int, nargs="+", default=[3, 5, 8])
    parser.add_argument("--seed", type=int, default=1)
    options = parser.parse_args(arguments)
    for sd in options.sd:
        for placements in options.placements:
            found = counted(options.arms, placements, sd, options.seed)
            share = {name: 100.0 * float(np.mean(held)) for name, held in vars(found).items()}
            halves = np.array(found.halves)
            spread = halves.std() / np.sqrt(max(len(halves), 1))
            print(
                f"sd {sd}, {placements} placements: mean arm {share['mean']:.1f} %, elsewhere "
                f"{share['elsewhere']:.1f} % (within {share['within']:.1f} %), interval of the "
                f"component {share['interval']:.1f} %, p < .05 in {share['small']:.1f} %, readings "
                f"left out in {share['damaged']:.1f} %; halves "
                f"differ by χ² per parameter {halves.mean():.2f} ± {spread:.2f}, "
                f"{np.median(halves):.2f} in the median",
                flush=True,
            )


if __name__ == "__main__":
    main()
