"""Arms on surfaces that are not what they are taken for, with a tracker beside that no fit sees.

    python -m tests.machines.surfaces --count 40

draws arms on one table: flat, bent (a saddle among them), moved once, or touched by a tool that is
off its axis. Joints of half of them start where the drawing says within half a milliradian, those
of the others within four. What is counted: whether the bend is named or in a tie, the verdict of
flat tables, and the error at points that a tracker knows, after a rigid motion: as drawn, with what
was asked for, and traced.
"""

from __future__ import annotations

import argparse
import csv
import sys
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import numpy as np

import rsicalib
from tests import oracle
from tests.machines import files
from tests.machines.arm import JOINTS, Body, Job
from tests.machines.kit import Rng
from tests.oracle import Array

KINDS = ("flat", "bent", "moved", "tool", "tool and bent")
SEEN = 0.02
"""Noise of a tracker's point [mm]."""
WORSE = 1.1
"""An error that is so much larger than that of the drawing, and by more than noise, is worse."""
TERMS = {"bent": {"plane_bend"}, "moved": {"plane_slip"}, "tool": {"point_position", "link_length"}}


@dataclass(frozen=True)
class Said:
    """What is said of one session, and its errors at the tracker's points [mm]."""

    kind: str
    verdict: str
    named: bool
    tied: bool
    drawn: float
    before: float
    after: float

    @property
    def worse(self) -> bool:
        """Whether the arm is farther from where it is than the drawing puts it."""
        return self.after > WORSE * self.drawn + SEEN


def draw(rng: Rng, kind: str, sure: bool) -> tuple[Job, Array]:
    """An arm on a table, and its readings; `sure`: its joints start where they are drawn."""
    job = Job(Body.random(rng), rng, int(rng.integers(25, 90)))
    job.values |= {f"offset@{j}": float(rng.normal(0, 5e-4 if sure else 4e-3)) for j in JOINTS}
    job.plane("table")
    if "bent" in kind:
        job.values["bend@table"] = float(rng.uniform(0.15, 0.5))
    if kind == "moved":
        job.values["step@table"] = float(rng.uniform(0.15, 0.6))
    read = job.machine("arm").observe(rng)
    if "tool" in kind:
        angle, off = rng.uniform(0, 2 * np.pi), rng.uniform(0.5, 1.5)
        at = job.body.tool + off * np.array([np.cos(angle), np.sin(angle), 0.0])
        job.points[0]["at"] = [float(x) for x in at]
    return job, read


def known(job: Job, read: Array, rng: Rng, path: Path) -> None:
    """The tracker's points in a frame of its own, with the readings of the touches."""
    roll, pitch, yaw = rng.uniform(-1, 1, 3) * [0.5, 0.5, 3.0]
    turn = oracle.roll_pitch_yaw(roll, pitch, yaw)[:3, :3]
    places = job.body.tip(read, job.values) @ turn.T + rng.uniform(-2000, 2000, 3)
    places += SEEN * rng.standard_normal(places.shape)
    with path.open("w", newline="", encoding="utf-8") as file:
        rows = csv.writer(file)
        rows.writerow(["pose", *JOINTS, "x", "y", "z"])
        for pose, (q, place) in enumerate(zip(read, places, strict=True), start=1):
            rows.writerow([pose, *(f"{x:.7f}" for x in q), *(f"{x:.5f}" for x in place)])


def said(rng: Rng, kind: str, sure: bool, folder: Path) -> Said:
    """One session, traced without the tracker and held against it."""
    job, read = draw(rng, kind, sure)
    readings, mechanism = files.write(job.machine("arm"), read, folder)
    known(job, read, rng, folder / "seen.csv")
    found = rsicalib.trace(readings, mechanism, check=folder / "seen.csv", align=True)
    answer = rsicalib.trace(readings, mechanism).to_dict()  # the verdict without the tracker
    whole = found.to_dict()
    error = [whole[fit]["aligned"]["position_rms"] for fit in FITS]
    steps = answer["steps"]
    wanted = set().union(*(TERMS[word] for word in TERMS if word in kind))
    if kind == "tool and bent":
        wanted = TERMS["bent"]
    ties = {t["term"] for s in steps for t in s["also_fits"] or []}
    ties |= {t["term"] for rival in answer.get("rivals") or [] for t in rival["terms"]}
    names = {s["term"] for s in steps}
    return Said(kind, answer["verdict"], bool(names & wanted), bool(ties & wanted), *error)


FITS = ("nominal", "before", "after")


def table(all_: Sequence[Said]) -> list[str]:
    """Lines of the table in Markdown."""
    error_words = "error as drawn, asked for, traced [mm]"
    heads = f"| table | adequate | named | or in a tie | {error_words} | worse |"
    lines = [heads, "|---|---|---|---|---|---|"]
    for kind in KINDS:
        own = [s for s in all_ if s.kind == kind]
        if not own:
            continue
        count = f"of {len(own)}"
        cells: list[Any] = [
            sum(s.verdict == "adequate" for s in own),
            sum(s.named for s in own),
            sum(s.named or s.tied for s in own),
        ]
        error = np.median([[s.drawn, s.before, s.after] for s in own], axis=0)
        shown = ", ".join(f"{e:.2f}" for e in error)
        before = sum(s.before > WORSE * s.drawn + SEEN for s in own)
        worse = f"{before} before, {sum(s.worse for s in own)} now"
        cells = [f"{c} {count}" for c in cells]
        lines.append(f"| {kind} | {' | '.join(cells)} | {shown} | {worse} |")
    return lines


def main(arguments: Sequence[str] | None = None) -> int:
    """The command."""
    parser = argparse.ArgumentParser("python -m tests.machines.surfaces", description=__doc__)
    parser.add_argument("--count", type=int, default=20, help="sessions of each kind")
    parser.add_argument("--first", type=int, default=0)
    parser.add_argument("--seed", type=int, default=0)
    options = parser.parse_args(arguments)
    out: list[Said] = []
    for number in range(options.first, options.first + options.count):
        for k, kind in enumerate(KINDS):
            rng = np.random.default_rng([options.seed, number, k])
            try:
                with TemporaryDirectory() as folder:
                    out.append(said(rng, kind, number % 2 == 0, Path(folder)))
            except ValueError:
                continue
            print(number, out[-1], file=sys.stderr, flush=True)
    print("\n".join(table(out)))
    return 0


if __name__ == "__main__":
    sys.exit(main())
