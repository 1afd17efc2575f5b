"""Events planted in sessions of real arms: `python -m tests.planted FOLDER --seed S`.

FOLDER is the data of Mukca, which are not in the repository: a ball on the tool of a Panda rests
in two sockets. Into one placement of each arm, its rows ten seconds apart, either an encoder's jump
is planted, from one row on; or one of the sockets moves, so that the readings of its rows from one
on are those that reach the new place (by the derivative of plain products of the URDF's frames). An
event shows where a calibration that is told of it has χ² lower by `SHOWS` or more.
`docs/search-measured.md` has the counts.
"""

from __future__ import annotations

import argparse
import secrets
import shutil
import tempfile
import xml.etree.ElementTree as ElementTree
from collections import Counter
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
from scipy.spatial.transform import Rotation

import rsicalib
from tests.oracle import Array

PLACEMENTS = (
    ("panda_1_with_sensor", "front"),
    ("panda_2", "front_center"),
    ("panda_3", "frontcenter"),
    ("panda_3_bis", "front"),
    ("panda_4", "front"),
    ("panda_left", "world_frame"),
    ("panda_right", "world_frame"),
)
"""Arms, and the placement of each, in which next to nothing is found."""
PERIOD = 10.0
"""Time from row to row [s]."""
JUMP = (1e-3, 4e-3)
"""Sizes of jumps [rad]."""
MOVE = (0.5e-3, 2e-3)
"""Sizes of moves [m]."""
SHOWS = 60.0
NEAR = 2
"""Rows by which the named one may be another."""


def frame(origin: Any) -> Array:
    """The matrix, (4, 4), of an `<origin>`."""
    out = np.eye(4)
    turn = [float(x) for x in origin.get("rpy", "0 0 0").split()]
    out[:3, :3] = Rotation.from_euler("xyz", turn).as_matrix()
    out[:3, 3] = [float(x) for x in origin.get("xyz", "0 0 0").split()]
    return out


def slopes(urdf: Path, q: Array, tip: str = "ball_link") -> Array:
    """Derivatives of the tip by seven joint angles, (3, 7): axis × lever, at one pose."""
    joints = {j.find("child").get("link"): j for j in ElementTree.parse(urdf).iter("joint")}  # type: ignore[union-attr]
    path: list[Any] = []
    while tip in joints:
        path.insert(0, joints[tip])
        tip = joints[tip].find("parent").get("link")
    at, axes, origins, angles = np.eye(4), [], [], iter(q)
    for joint in path:
        at = at @ frame(joint.find("origin"))
        if joint.get("type") == "revolute":
            axis = np.array([float(x) for x in joint.find("axis").get("xyz").split()])
            axes.append(at[:3, :3] @ axis)
            origins.append(at[:3, 3].copy())
            at[:3, :3] = at[:3, :3] @ Rotation.from_rotvec(axis * next(angles)).as_matrix()
    return np.stack(
        [np.cross(a, at[:3, 3] - o) for a, o in zip(axes, origins, strict=True)], axis=1
    )


class Arm:
    """A placement of an arm."""

    def __init__(self, folder: Path, robot: str, group: str) -> None:
        self.urdf = folder / "panda.urdf"
        self.mechanism = rsicalib.load_mechanism(folder / "mukca_panda.toml")
        all_of_it = rsicalib.load_readings(folder / f"{robot}.csv", self.mechanism)
        own = all_of_it.select([g == group for g in all_of_it.keys["group"]])
        self.q = np.array(own.values, dtype=float)
        self.keys = {name: list(column) for name, column in own.keys.items()}

    def readings(self, q: Array) -> Any:
        times = PERIOD * np.arange(len(q))
        return rsicalib.Readings.from_arrays(self.mechanism, q, time_s=times, keys=self.keys)

    def lower(self, readings: Any, told: str) -> float:
        """By how much χ² is lower where the event is told."""
        terms = self.mechanism.to_dict()["model"]["terms"]
        fits = [
            rsicalib.calibrate(readings, self.mechanism, terms=t) for t in (terms, [*terms, told])
        ]
        return float(fits[0].fit.chi2 - fits[1].fit.chi2)


def of_step(step: Any) -> list[tuple[str, str, int | None]]:
    """Term, target and place of an effect and of what fits as well."""
    return [(s.term, s.target, s.place) for s in (step, *step.also_fits)]


def jumped(arm: Arm, rng: np.random.Generator, joint: int) -> tuple[str, float]:
    """What is said of an encoder that jumped, and how much the jump shows."""
    row = int(rng.integers(len(arm.q) // 5, 4 * len(arm.q) // 5))
    q = arm.q.copy()
    q[row:, joint] += rng.choice([-1, 1]) * np.exp(rng.uniform(*np.log(JUMP)))
    readings = arm.readings(q)
    shows = arm.lower(readings, f"slip@q{joint + 1}:{row + 1}")
    found = rsicalib.trace(readings, arm.mechanism)
    own = [of_step(s) for s in found.steps]

    def is_it(term: str, target: str, place: Any) -> bool:
        return term == "slip" and target == f"q{joint + 1}" and abs(int(place) - row - 1) <= NEAR

    if any(is_it(*names[0]) for names in own):
        return "named", shows
    if any(is_it(*name) for names in own for name in names):
        return "in the tie", shows
    if any(term == "slip" for names in own for term, _, _ in names):
        return "another slip", shows
    return f"{found.verdict}: {', '.join(names[0][0] for names in own) or 'nothing'}", shows


def moved(arm: Arm, rng: np.random.Generator, socket: str) -> tuple[str, float]:
    """What is said of a socket that moved, and how much the move shows."""
    rows = [k for k, at in enumerate(arm.keys["at"]) if at == socket]
    first = rows[int(rng.integers(len(rows) // 4, 3 * len(rows) // 4))]
    by = rng.standard_normal(3)
    by *= np.exp(rng.uniform(*np.log(MOVE))) / np.linalg.norm(by)
    q = arm.q.copy()
    for row in (r for r in rows if r >= first):
        q[row] += np.linalg.pinv(slopes(arm.urdf, q[row])) @ by
    readings = arm.readings(q)
    group = arm.keys["group"][0]
    shows = arm.lower(readings, f"point_slip@socket[group={group},at={socket}]:{first + 1}")
    found = rsicalib.trace(readings, arm.mechanism)
    for step in found.steps:
        for k, (term, _, place) in enumerate(of_step(step)):
            if term == "point_slip" and abs(int(place or 0) - first - 1) <= NEAR:
                return "named" if k == 0 else "in the tie", shows
    names = ", ".join(step.term for step in found.steps) or "nothing"
    return f"{found.verdict}: {names}", shows


def counted(name: str, trials: Sequence[tuple[str, float]]) -> None:
    """Print what was said of events that show."""
    seen = [said for said, shows in trials if shows >= SHOWS]
    print(f"{name}: {len(seen)} of {len(trials)} show; of these")
    for said, times in Counter(seen).most_common():
        print(f"  {times:3d}  {said}")


def main(arguments: Sequence[str] | None = None) -> None:
    """Plant events in every placement, trace, and print counts."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("folder", type=Path)
    parser.add_argument("--seed", type=int, default=None, help="drawn where it is not given")
    options = parser.parse_args(arguments)
    seed = secrets.randbelow(2**31) if options.seed is None else options.seed
    print(f"seed {seed}")
    examples = Path(__file__).parents[1] / "examples"
    jumps: list[tuple[str, float]] = []
    moves: list[tuple[str, float]] = []
    with tempfile.TemporaryDirectory() as name:
        for file in [*options.folder.glob("*.*"), *examples.glob("mukca_*.toml")]:
            shutil.copy(file, name)
        for k, placement in enumerate(PLACEMENTS):
            arm = Arm(Path(name), *placement)
            for joint in range(1, 6):
                jumps.append(jumped(arm, np.random.default_rng([seed, k, joint]), joint))
                print(placement[0], f"q{joint + 1}", jumps[-1], flush=True)
            for j, socket in enumerate(("socket0", "socket1") * 2):
                moves.append(moved(arm, np.random.default_rng([seed, k, 10 + j]), socket))
                print(placement[0], socket, moves[-1], flush=True)
    counted("jumps", jumps)
    counted("moves", moves)


if __name__ == "__main__":
    main()
