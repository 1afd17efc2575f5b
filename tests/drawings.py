"""Arms that are built near their drawing, or not: what an estimated size of its errors is worth.

`python -m tests.drawings --arms 100` calibrates all frames of an arm of six joints from seatings in
two sockets of a plate at one place, and predicts seatings at three others. Frames, offsets and the
ball are off by so many typical sizes (`--size`), or all but one are right, and one is off by its
typical size (`alone`). It prints the median over arms of the distance of the ball from its own mean
in those sockets, with the size estimated and with typical sizes as they are, how often the first is
smaller, and how many predicted coordinates of the ball are within 1.96 standard deviations.
"""

from __future__ import annotations

import argparse
import tomllib
from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np

import rsicalib
from rsicalib.poses.places import places, readings_for
from tests import between, cone
from tests.oracle import Array

POSES = 80
PLAY = 0.05
"""How well the ball rests [mm]."""
APART = 50.0
"""Distance of the two sockets of a plate [mm]."""
BALL = np.array([40.0, 0.0, 120.0])
NEAR = np.array([0.4, -1.4, -1.6, -1.5, 1.5, 0.0])
SPAN = np.array([1.0, 0.6, 0.8, 1.5, 1.5, 3.0])
LENGTH, TURN, OFFSET, TOOL = 0.0025 * 425.0, 0.003, 0.05, 0.05 * 425.0
"""Typical sizes of the places [mm] and turns [rad] of frames, of offsets, and of the ball [mm]."""
TERMS = '["offset", "link_frame", "point_position"]'


@dataclass(frozen=True)
class Arm:
    """What is wrong with an arm: its frames, its offsets, its ball."""

    frames: Array
    """Shape (6, 6): places and turns, in front of each joint."""
    offsets: Array
    ball: Array

    @classmethod
    def drawn(cls, rng: np.random.Generator, size: float | None) -> Arm:
        """All are off by so many typical sizes; none: one alone is."""
        errors = np.concatenate([rng.standard_normal(36), rng.standard_normal(9)])
        if size is None:
            errors *= np.arange(45) == rng.choice(np.r_[6:36, 37:45])
            errors = np.sign(errors)
            size = 1.0
        # What turns or moves everything, nothing tells: places are of the base as it is.
        errors[:6] = errors[36] = 0.0
        frames = size * errors[:36].reshape(6, 6) * ([LENGTH] * 3 + [TURN] * 3)
        return cls(frames, size * OFFSET * errors[36:42], BALL + size * TOOL * errors[42:])

    def moving(self, read: Array) -> tuple[Array, Array]:
        """Places of the ball for readings, shape (m, 6), and their derivatives: axis × lever."""
        return between.moving(read + self.offsets, self.ball, [off(e) for e in self.frames])

    def placement(self, rng: np.random.Generator) -> Array:
        """Readings with the ball in the two sockets of a plate in turn."""
        plate, way = cone.CONE + rng.uniform(-150, 150, 3), rng.standard_normal(3)
        sockets = plate + np.outer([-0.5, 0.5], APART * way / np.linalg.norm(way))
        both = [self.seatings(rng, socket) for socket in sockets]
        return np.stack(both, axis=1).reshape(POSES, 6)

    def seatings(self, rng: np.random.Generator, socket: Array) -> Array:
        """Readings with the ball in one socket, by Newton's method."""
        found = np.zeros((0, 6))
        while len(found) < POSES // 2:
            q = NEAR + rng.uniform(-1, 1, (POSES, 6)) * SPAN
            wanted = socket + PLAY * rng.standard_normal((POSES, 3))
            for _ in range(15):
                at, slopes = self.moving(q)
                across = slopes @ slopes.transpose(0, 2, 1)
                pulled = np.linalg.solve(across, (at - wanted)[..., None])
                step = (slopes.transpose(0, 2, 1) @ pulled)[..., 0]
                most = np.abs(step).max(axis=1, keepdims=True).clip(1e-300)
                q = q - step * np.minimum(1.0, 0.3 / most)
            good = np.all((q > cone.LIMITS[:, 0]) & (q < cone.LIMITS[:, 1]), axis=1)
            good &= np.abs(self.moving(q)[0] - wanted).max(axis=1) < 1e-6
            found = np.concatenate([found, q[good]])
        return found[: POSES // 2]


def off(error: Array) -> Array:
    """A frame that is off by a place and a vector of rotation."""
    x, y, z = error[3:]
    angle = np.linalg.norm(error[3:])
    cross = np.array([[0, -z, y], [z, 0, -x], [-y, x, 0]])
    out = np.eye(4)
    if angle > 0:
        out[:3, :3] += np.sinc(angle / np.pi) * cross
        out[:3, :3] += 0.5 * np.sinc(angle / (2 * np.pi)) ** 2 * cross @ cross
    out[:3, 3] = error[:3]
    return out


@dataclass
class Counts:
    """Distances elsewhere [mm], and coordinates that hold: with the size estimated, and without."""

    others: list[tuple[float, float]] = field(default_factory=list)
    held: list[tuple[float, float]] = field(default_factory=list)


def session(arm: Arm, rng: np.random.Generator, plates: int) -> dict[str, Any]:
    """Readings at so many placements of the plate."""
    read = np.concatenate([arm.placement(rng) for _ in range(plates)])
    table: dict[str, Any] = {f"q{k + 1}": column for k, column in enumerate(read.T)}
    table["group"] = [f"plate {k}" for k in range(plates) for _ in range(POSES)]
    return {**table, "at": ["a", "b"] * (plates * POSES // 2)}


def as_typical(mechanism: rsicalib.Mechanism) -> dict[str, Any]:
    """A population of which nothing is known: errors of a drawing have their typical sizes."""
    return {
        "format": "rsicalib.population/1",
        "mechanism": mechanism.name,
        "centre": [0.0] * len(mechanism.channels),
        "terms": mechanism.to_dict()["model"]["terms"],
        "parameters": [],
    }


def one(mechanism: rsicalib.Mechanism, rng: np.random.Generator, size: float | None) -> Counts:
    """One arm, calibrated both ways."""
    arm = Arm.drawn(rng, size)
    table = session(arm, rng, 4)
    elsewhere = NEAR + rng.uniform(-0.8, 0.8, (8, 6)) * SPAN
    truth = arm.moving(elsewhere)[0]
    rows = {f"q{k + 1}": column for k, column in enumerate(elsewhere.T)}
    distances, held = [], []
    for population in (None, as_typical(mechanism)):
        found = rsicalib.calibrate(table, mechanism, fit_groups=["plate 0"], population=population)
        assert found.groups is not None and found.groups.others is not None
        distances.append(found.groups.others)
        seen = places(readings_for(rows, mechanism, False), mechanism, found)
        assert seen.sd is not None
        held.append(float(np.mean(np.abs(seen.values - truth) < 1.96 * seen.sd)))
    return Counts([(distances[0], distances[1])], [(held[0], held[1])])


def mechanism(play: float = PLAY) -> rsicalib.Mechanism:
    """The arm as drawn, its ball and two sockets."""
    declared = tomllib.loads(cone.mechanism(1e-6, play, TERMS))
    (socket,) = (point for point in declared["point"] if "unknown" in point)
    socket["unknown"] = ["group", "at"]
    between = [f"{socket['name']}[at={at}]" for at in "ab"]
    declared["closure"].append(
        {"name": "a-b", "kind": "distance", "between": between, "value": APART, "sd": play}
    )
    return rsicalib.Mechanism.from_dict(declared)


def counted(arms: int, size: float | None, seed: int) -> Counts:
    """So many arms."""
    own, counts = mechanism(), Counts()
    for k in range(arms):
        found = one(own, np.random.default_rng([seed, k]), size)
        counts.others += found.others
        counts.held += found.held
    return counts


def main(arguments: Sequence[str] | None = None) -> None:
    """Print a row for each size."""
    parser = argparse.ArgumentParser(prog="python -m tests.drawings", description=__doc__)
    parser.add_argument("--arms", type=int, default=100)
    parser.add_argument("--size", nargs="+", default=["0.1", "0.3", "1", "3", "alone"])
    parser.add_argument("--seed", type=int, default=1)
    options = parser.parse_args(arguments)
    print("| errors, typical sizes | elsewhere, mm | as typical | smaller | within 1.96 sd |")
    print("|---|---|---|---|---|")
    for size in options.size:
        found = counted(options.arms, None if size == "alone" else float(size), options.seed)
        others, held = np.array(found.others), 100 * np.array(found.held)
        sd = held.std(axis=0, ddof=1) / np.sqrt(len(held))
        median = np.median(others, axis=0)
        smaller = 100 * np.mean(others[:, 0] < others[:, 1])
        shares = [f"{m:.1f} ± {s:.1f}" for m, s in zip(held.mean(axis=0), sd, strict=True)]
        print(
            f"| {size} | {median[0]:.3f} | {median[1]:.3f} | {smaller:.0f} % | "
            f"{shares[0]} % (typical {shares[1]} %) |",
            flush=True,
        )


if __name__ == "__main__":
    main()
