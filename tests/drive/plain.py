"""A robot without physics, in plain matrix products: `python -m tests.drive.plain`.

It puts its ball into a cone, where it stands still, and answers as a robot does.
"""

from __future__ import annotations

import argparse
import json
import sys

import numpy as np

from tests.cone import CONE, LIMITS, OFFSETS, tip, touching
from tests.oracle import Array

PLAY = 0.02
"""How well the ball sits in the cone [mm]."""


def main() -> None:
    """Answer until nothing more is asked; refuse so many poses, or answer something else."""
    parser = argparse.ArgumentParser()
    parser.add_argument("--refuse", type=int, default=0)
    parser.add_argument("--answer", help="to every line")
    args = parser.parse_args()
    rng = np.random.default_rng(4)
    for line in sys.stdin:
        asked = json.loads(line)
        if args.answer is not None:
            print(args.answer, flush=True)
            continue
        if asked["go"] is not None and args.refuse > 0:
            args.refuse -= 1
            print(json.dumps({"cannot": "something is in the way"}), flush=True)
            continue
        q = shown(rng) if asked["go"] is None else None
        if q is None:
            near = np.array([asked["go"][n] for n in NAMES]) + OFFSETS
            (q,) = touching(near[None], seat(rng))
        if not holds(q):
            print(json.dumps({"cannot": "the cone is out of reach"}), flush=True)
            continue
        read = q - OFFSETS + 2e-5 * rng.standard_normal((asked["samples"], 6))
        rows = [{**dict(zip(NAMES, row, strict=True)), "at": "cone"} for row in read.tolist()]
        print(json.dumps({"readings": rows}), flush=True)


def shown(rng: np.random.Generator) -> Array:
    """Joint angles to which a hand has led the arm."""
    while True:
        near = np.array([0.4, -1.4, -1.6, -1.5, 1.5, 0.0])
        drawn = near + rng.uniform(-1, 1, 6) * [1, 0.6, 0.8, 1.5, 1.5, 3]
        (q,) = touching(drawn[None], seat(rng))
        if holds(q):
            return q


def seat(rng: np.random.Generator) -> Array:
    """Where the ball sits this time, (1, 3)."""
    return np.asarray(CONE + PLAY * rng.standard_normal((1, 3)))


def holds(q: Array) -> bool:
    """Whether the ball is in the cone, as it sits there, and every joint within its limits."""
    inside = np.all((q > LIMITS[:, 0] + 0.02) & (q < LIMITS[:, 1] - 0.02))
    return bool(inside and np.allclose(tip(q), CONE, atol=10 * PLAY))


NAMES = tuple(f"q{k + 1}" for k in range(6))

if __name__ == "__main__":
    main()
