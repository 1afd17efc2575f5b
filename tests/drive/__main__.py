"""Arms of MuJoCo take their sessions alone: `python -m tests.drive --runs 100`.

Each arm has one defect in its body that nobody declares. Counted are the defects that are named,
the squares of error over told standard deviation, and limits that were passed.
"""

from __future__ import annotations

import argparse
import shlex
import sys
import time
from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import numpy as np

import rsicalib
from rsicalib import InputError
from rsicalib.guide.run import guide
from tests.drive.arm import KINDS, Arm
from tests.families.grade import TIE
from tests.machines.arm import JOINTS

TARGET = 0.03
"""Standard deviation of the ball to reach [mm]."""
TERMS = {
    "stiffness": {"joint_compliance"},
    "backlash": {"gear_play"},
    "eccentric": {"once_per_turn"},
    "bent": {"joint_tilt", "link_frame", "link_offset", "link_length", "base_tilt"},
}


@dataclass(frozen=True)
class Run:
    """One session, and what came of it."""

    arm: Arm
    verdict: str
    said: str
    named: bool
    alone: bool
    """Nothing else was named beside it."""
    squares: tuple[float, ...]
    """Squares of error over told standard deviation, of each parameter whose truth is known."""
    poses: int
    beyond: int
    seconds: float


def run(seed: int, folder: Path, kind: str | None = None, touch: str | None = None) -> Run:
    """Let the arm of a seed take its session."""
    arm = Arm.drawn(seed, kind, touch)
    mechanism, told = folder / "arm.toml", folder / "beyond"
    mechanism.write_text(arm.mechanism(), encoding="utf-8")
    given = ["--seed", str(seed), "--kind", arm.kind, "--touch", arm.touch, "--told", str(told)]
    command = shlex.join([sys.executable, "-m", "tests.drive.robot", *given])
    began = time.perf_counter()
    session = folder / "session"
    try:
        found = guide(session, mechanism, drive=command, target=TARGET, port=None, quiet=True)
    except InputError as error:  # the robot could not begin: a figure, not the end
        seconds = time.perf_counter() - began
        return Run(arm, f"refused: {error}", "", False, False, (), 0, 0, seconds)
    seconds = time.perf_counter() - began
    beyond = int(told.read_text()) + beyond_limits(arm, session)
    poses = len(np.unique(rsicalib.load_readings(session / "readings.csv", mechanism).pose))
    if found is None:
        return Run(arm, "none", "", False, False, (), poses, beyond, seconds)
    says = [names(step) for step in found.steps]
    right = [any(is_right(arm, *name) for name in of) for of in says]
    said = ", ".join(f"{s.term}@{s.target}" for s in found.steps)
    squares = tuple(squares_of(arm, found))
    alone = all(right)
    return Run(arm, found.verdict, said, any(right), alone, squares, poses, beyond, seconds)


def names(step: Any) -> list[tuple[str, str]]:
    """What a step names: its term, and those that fit as well, where they are few."""
    ties = [(a.term, a.target) for a in step.also_fits]
    return [(step.term, step.target), *(ties if len(ties) <= TIE else [])]


def is_right(arm: Arm, term: str, target: str) -> bool:
    """Whether a name is the defect: a bend may be said of the link, or of the one it carries."""
    places = {arm.target}
    if arm.kind == "bent":
        places.add(f"arm/{arm.joint + 2}")
    return term in TERMS[arm.kind] and target in places


def squares_of(arm: Arm, found: Any) -> list[float]:
    """Of the encoders' zeros, and of the defect where its term has its size for a parameter."""
    truth = {("offset", j): float(o) for j, o in zip(JOINTS, arm.offsets, strict=True)}
    if arm.kind == "stiffness":
        # The file has kg and mm: torque there is without g, here in N m.
        truth["joint_compliance", arm.target] = arm.size / arm.largest_torque * 9.81e-3
    if arm.kind == "backlash":
        truth["gear_play", arm.target] = arm.size
    return [
        ((p.value - truth[p.term, p.target]) / p.sd) ** 2
        for p in found.parameters
        if p.sd and (p.term, p.target) in truth
    ]


def beyond_limits(arm: Arm, session: Path) -> int:
    """Samples of a session that are beyond the limits of a joint."""
    mechanism = rsicalib.load_mechanism(session.parent / "arm.toml")
    rows = np.loadtxt(session / "samples.csv", delimiter=",", skiprows=1, usecols=range(1, 7))
    ends = np.array([c.limits for c in mechanism.channels])
    return int(np.sum((rows < ends[:, 0]) | (rows > ends[:, 1])))


def main() -> int:
    """Take so many sessions, and print what came of them."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--runs", type=int, default=8)
    parser.add_argument("--seed", type=int, default=0, help="of the first arm")
    parser.add_argument("--touch", choices=("cones", "plane"), help="by turns where not given")
    args = parser.parse_args()
    runs: list[Run] = []
    for seed in range(args.seed, args.seed + args.runs):
        with TemporaryDirectory() as folder:
            one = run(seed, Path(folder), touch=args.touch)
        runs.append(one)
        mean = np.mean(one.squares) if one.squares else np.nan
        print(
            f"{seed:4d} {one.arm.touch:6s} {one.arm.kind:10s} {one.arm.target:6s} "
            f"{'named' if one.named else 'MISSED'} {one.said!r} {one.verdict}, "
            f"{one.poses} poses fitted, z² {mean:.2f} of {len(one.squares)}, "
            f"beyond {one.beyond}, {one.seconds:.1f} s",
            flush=True,
        )
    told(runs)
    return 0


def told(runs: list[Run]) -> None:
    """The figures of all runs, as a table."""
    touches = [t for t in ("cones", "plane") if any(r.arm.touch == t for r in runs)]
    groups = {t: [r for r in runs if r.arm.touch == t] for t in touches}
    groups |= {"all": runs} if len(touches) > 1 else {}
    print(f"| | {' | '.join(groups)} |\n|---|{'---|' * len(groups)}")
    lines: dict[str, Callable[[list[Run]], str]]
    lines = {"defect named": _named, "nothing else beside it": _alone}
    for kind in KINDS:
        lines[kind] = partial(_named_of, kind)
    lines |= {"mean square of error over told sd": _square}
    lines |= {"poses fitted, median": lambda own: f"{np.median([r.poses for r in own]):.0f}"}
    lines |= {"limits passed": lambda own: str(sum(r.beyond for r in own))}
    for words, figure in lines.items():
        print(f"| {words} | {' | '.join(figure(own) for own in groups.values())} |")


def _named(own: list[Run]) -> str:
    return f"{sum(r.named for r in own)} of {len(own)}"


def _named_of(kind: str, own: list[Run]) -> str:
    return _named([r for r in own if r.arm.kind == kind])


def _alone(own: list[Run]) -> str:
    return f"{sum(r.named and r.alone for r in own)} of {len(own)}"


def _square(own: list[Run]) -> str:
    """Parameters of a run are correlated: the standard error is that of means of runs."""
    means = np.array([np.mean(r.squares) for r in own if r.squares])
    error = means.std(ddof=1) / np.sqrt(len(means)) if len(means) > 1 else np.nan
    return f"{means.mean():.2f} ± {error:.2f}" if len(means) else "–"


if __name__ == "__main__":
    sys.exit(main())
