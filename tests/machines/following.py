"""Recordings of a follower in motion, in plain numpy: `python -m tests.machines.following`.

A leader is led by hand: each joint goes from goal to goal, at rest between. The follower reads

    g L(t - τ) + o, through a servo T, h short of its goal while that moves, or to one side of a
    play, with a slip, noise, and the steps of both encoders

in steps of a millisecond, of which every thirtieth or so is a row. Counted are recordings in which
what is there is named, and in which something is named that is not there.
"""

from __future__ import annotations

import argparse
from collections.abc import Iterator
from dataclasses import dataclass, replace

import numpy as np

import rsicalib
from tests.oracle import Array

JOINTS = ("shoulder_pan", "shoulder_lift", "elbow_flex", "wrist_flex", "wrist_roll")
TICK = 200 / 2600
"""An encoder's step: 200 percent are some 2600 of them."""
FINE = 1e-3
"""Of the integration [s]."""
NAME = "+".join(f"follower_{joint}" for joint in JOINTS)
"""All followers together."""


@dataclass(frozen=True)
class Truth:
    """What a pair has beside offsets and gains."""

    delay: float = 0.0
    """Of all joints [s]."""
    alone: float = 0.0
    """Of the elbow, beside it [s]."""
    servo: float = 0.0
    """Time constant [s]."""
    short: float = 0.0
    """By what the elbow stands short of its goal while that moves [percent]."""
    play: float = 0.0
    """Half of the play of the elbow, which moves when its goal has come to the other side."""
    slip: float = 0.0
    """Of the wrist's horn, in the middle [percent]."""
    noise: float = 0.3
    """How well a follower holds [percent]."""


def led(rng: np.random.Generator, fine: Array) -> Array:
    """Where a hand leads one joint: from goal to goal, smoothly, with rests [percent]."""
    t, at = 0.0, rng.uniform(-60, 60)
    out = np.full_like(fine, at)
    while t < fine[-1]:
        goal, long = rng.uniform(-70, 70), rng.uniform(0.7, 2.0)
        s = np.clip((fine - t) / long, 0, 1)
        part = fine >= t
        out[part] = at + (goal - at) * (10 * s**3 - 15 * s**4 + 6 * s**5)[part]
        at, t = goal, t + long + rng.uniform(0.0, 0.6)
    return out


def in_play(goal: Array, half: float) -> Array:
    """What is dragged along from both sides of a play."""
    out, at = np.empty_like(goal), goal[0]
    for k, to in enumerate(goal):
        at = min(max(at, to - half), to + half)
        out[k] = at
    return out


def recording(
    seed: int, truth: Truth, seconds: float = 15.0, rate: float = 30.0
) -> dict[str, Array]:
    """Rows of both arms by their channels, with `time_s`."""
    rng = np.random.default_rng(seed)
    fine = np.arange(-1.0, seconds, FINE)
    rows = np.round((1.0 + np.arange(0, seconds - 0.05, 1 / rate)) / FINE).astype(int)
    out = {"time_s": fine[rows]}
    for joint in JOINTS:
        leader = led(rng, fine)
        delay = truth.delay + (truth.alone if joint == "elbow_flex" else 0.0)
        goal = np.interp(fine - delay, fine, leader)
        short = truth.short * (joint == "elbow_flex")
        goal = goal - short * np.sign(np.round(np.gradient(goal), 9))
        if truth.play and joint == "elbow_flex":
            goal = in_play(goal, truth.play)
        follower = goal.copy()
        if truth.servo:
            for k in range(1, len(goal)):
                follower[k] = follower[k - 1] + FINE / truth.servo * (goal[k] - follower[k - 1])
        follower = (follower[rows] - rng.normal(0, 2)) / (1 + rng.normal(0, 0.02))
        follower = follower + rng.normal(0, truth.noise, len(rows))
        if joint == "wrist_flex":
            follower = follower + truth.slip * (np.arange(len(rows)) > len(rows) // 2)
        out[f"leader_{joint}"] = np.round(leader[rows] / TICK) * TICK
        out[f"follower_{joint}"] = np.round(follower / TICK) * TICK
    return out


KINDS = {
    "nothing": Truth(),
    "a delay": Truth(delay=0.14),
    "a delay of a third of a row": Truth(delay=0.011),
    "a delay of the elbow": Truth(alone=0.05),
    "a delay and one more of the elbow": Truth(delay=0.1, alone=0.06),
    "a delay and a slip": Truth(delay=0.14, slip=4.0),
    "a delay and an elbow that stands short": Truth(delay=0.14, short=1.5),
    "a delay and an elbow with play": Truth(delay=0.14, play=1.5),
    "a delay and a servo": Truth(delay=0.08, servo=0.06),
}


def report(kind: str, seeds: range, noise: float) -> Iterator[str]:
    """A line for each recording, and one of the delays of all: errors, and what is told of them."""
    truth = replace(KINDS[kind], noise=noise)
    errors: list[tuple[float, float]] = []
    for seed in seeds:
        found = rsicalib.trace(recording(seed, truth), "so101")
        steps = ", ".join(
            f"{step.term}@{'followers' if step.target == NAME else step.target} "
            + " ".join(f"{p.value:.4f}±{1.96 * (p.sd or np.nan):.4f}" for p in step.parameters)
            for step in found.steps
        )
        yield (
            f"{kind} {seed}: {found.verdict}; {steps or 'nothing named'}; misclosure "
            f"{found.before.rms_misclosure:.2f} → {found.after.rms_misclosure:.2f}"
        )
        of_all = [s.parameters[0] for s in found.steps if (s.term, s.target) == ("lag", NAME)]
        errors += [((p.value or 0.0) - truth.delay - truth.servo, p.sd or np.nan) for p in of_all]
    if len(errors) > 1:
        off, sd = 1e3 * np.array(errors).T
        square = (off / sd) ** 2
        yield (
            f"{kind}, {len(off)} delays of all: error {off.mean():.3f} ± "
            f"{off.std(ddof=1) / len(off) ** 0.5:.3f} ms, its sd {off.std(ddof=1):.3f}, told "
            f"{np.mean(sd**2) ** 0.5:.3f}; mean square of error over told sd {square.mean():.2f} ± "
            f"{square.std(ddof=1) / len(off) ** 0.5:.2f}"
        )


def main() -> None:
    """Print what came of each recording."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--kind", choices=KINDS, action="append")
    parser.add_argument("--count", type=int, default=5)
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--noise", type=float, default=Truth.noise, help="of a follower, percent")
    args = parser.parse_args()
    for kind in args.kind or KINDS:
        for line in report(kind, range(args.seed, args.seed + args.count), args.noise):
            print(line, flush=True)


if __name__ == "__main__":
    main()
