"""The robot's program: `python -m tests.drive.robot --seed 3` is told poses, and answers.

It moves the arm of a seed in MuJoCo and knows nothing of rsicalib but the lines of JSON.
"""

from __future__ import annotations

import argparse
import json
import sys
from collections.abc import Iterable
from pathlib import Path
from typing import Any

import numpy as np

from tests.drive.arm import Arm, led
from tests.drive.body import Body
from tests.machines.arm import JOINTS, NEAR
from tests.oracle import Array

TRIES, TURNS = 10, 0.3
"""Postures in which a hand tries a place, and by how much each joint is turned for it [rad]."""


def main() -> None:
    """Answer until nothing more is asked."""
    parser = argparse.ArgumentParser()
    parser.add_argument("--seed", type=int, required=True)
    parser.add_argument("--kind")
    parser.add_argument("--touch")
    parser.add_argument("--told", help="file for how often a motor was beyond its limits")
    args = parser.parse_args()
    arm = Arm.drawn(args.seed, args.kind, args.touch)
    body = Body(arm, args.seed)
    for line in sys.stdin:
        asked = json.loads(line)
        answer = shown(arm, body, asked) if asked["go"] is None else gone(arm, body, asked)
        print(json.dumps(answer), flush=True)
        if args.told:
            Path(args.told).write_text(str(body.beyond), encoding="utf-8")


def shown(arm: Arm, body: Body, asked: dict[str, Any]) -> dict[str, Any]:
    """Poses to which a hand has led the arm."""
    rows: list[dict[str, Any]] = []
    for label, (name, spot) in enumerate(arm.spots, start=1):
        rng = np.random.default_rng(label)
        others = (NEAR + TURNS * rng.uniform(-1, 1, 6) for _ in range(TRIES))
        if not any(body.touch(led(arm, spot, near)) for near in (NEAR, *others)):
            raise RuntimeError(f"the ball does not sit in {name}")
        read = body.read(asked["samples"])
        rows += [{"pose": label, **row} for row in _rows(read, _key(arm), name)]
    return {"readings": rows}


def gone(arm: Arm, body: Body, asked: dict[str, Any]) -> dict[str, Any]:
    """The pose that is asked for."""
    name = asked["touch"][_key(arm)]
    if not body.touch(np.array([asked["go"][j] for j in JOINTS])):
        return {"cannot": f"the ball does not sit in {name}"}
    return {"readings": list(_rows(body.read(asked["samples"]), _key(arm), name))}


def _rows(read: Array, key: str, name: str) -> Iterable[dict[str, Any]]:
    return ({**dict(zip(JOINTS, row.tolist(), strict=True)), key: name} for row in read)


def _key(arm: Arm) -> str:
    return "at" if arm.touch == "cones" else "surface"


if __name__ == "__main__":
    main()
