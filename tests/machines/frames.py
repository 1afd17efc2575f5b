"""Frames with belts as they are: short belts, a constant of all, a noise that is declared wrongly.

`python -m tests.machines.frames --count 60` draws frames of `tests/machines/belt.py`, whose anchors
stand 4 cm from where they are drawn. Lower belts read .28 to .65 % short; in half of the frames all
belts lack one constant of 10 to 200 mm; what all frames leave beside noise is a bow of each length.
The declared noise is 0.5 to 3 times the true one. Printed is how often the truth is named, alone or
in a tie, what is named beside it, and how many gains are larger than any belt's.
"""

from __future__ import annotations

import argparse
import sys
from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import numpy as np

import rsicalib
from tests.machines import files
from tests.machines.belt import ANCHORS, BELTS, PLAY, draw
from tests.machines.kit import Machine, Rng

ABSURD = 0.05
"""No belt is wrong by so much of its length."""
SHORT = frozenset({"gain@bl+br", "gain@tl+tr"})
"""Lower belts too short are upper ones too long: lengths alone tell no scale."""


@dataclass(frozen=True)
class Frame:
    """What is wrong with one frame, and the noise that is declared over the true one."""

    constant: float
    short: float
    bow: float
    """Largest error that is smooth over the frame [mm]: nobody declared it, no term has it."""
    declared: float
    machine: Machine


def frame(rng: Rng, constant: bool, declared: float, bow: float = 0.0, poses: int = 90) -> Frame:
    """A frame, with a constant of all belts or without."""
    one = float(rng.uniform(10, 200)) if constant else 0.0
    short = float(rng.uniform(2.8e-3, 6.5e-3))
    machine = draw(rng, poses)
    values = dict(machine.values) | {"offset@all": one, "gain@bl+br": short}
    for anchor in ANCHORS.values():
        for axis in ("x", "y"):
            if f"{axis}@{anchor}" in machine.fitted:
                values[f"{axis}@{anchor}"] += float(rng.normal(0, 40))
    values |= {f"curvature@{belt}": float(rng.uniform(-bow, bow)) for belt in BELTS}
    true = replace(
        machine, values=values, sigma=machine.sigma / declared, play=np.full(4, PLAY / declared)
    )
    return Frame(one, short, bow, declared, true)


def traced(rng: Rng, case: Frame) -> dict[str, Any]:
    """What is said of a session in a frame."""
    with TemporaryDirectory() as folder:
        csv, mechanism = files.write(case.machine, case.machine.observe(rng), Path(folder))
        return dict(rsicalib.trace(csv, mechanism).to_dict())


def graded(case: Frame, answer: dict[str, Any]) -> dict[str, Any]:
    """How far the answer is the truth: named, or in a tie; what is beside it; sizes."""
    names = [f"{s['term']}@{s['target']}" for s in answer["steps"]]
    ties = [{f"{t['term']}@{t['target']}" for t in s["also_fits"] or []} for s in answer["steps"]]
    among = set(names).union(*ties)
    constant = [
        p
        for s in answer["steps"]
        if s["term"] == "offset" and s["target"] == "each"
        for p in s["parameters"]
    ]
    off = [(p["value"] - case.constant) / p["sd"] for p in constant if p["sd"]]
    gains = [p["value"] for s in answer["steps"] if s["term"] == "gain" for p in s["parameters"]]
    true = {"offset@each"} if case.constant else set()
    return {
        "short": bool(SHORT & among),
        "constant": ("offset@each" in among) == bool(case.constant),
        "sd_off": off[0] if off else None,
        "extras": [n for n, t in zip(names, ties, strict=True) if not ({n} | t) & (SHORT | true)],
        "absurd": any(abs(g) > ABSURD for g in gains),
        "verdict": answer["verdict"],
        "said": names,
    }


def table(found: Sequence[dict[str, Any]]) -> list[str]:
    """Lines on all frames."""
    n = len(found)
    count = {k: sum(bool(f[k]) for f in found) for k in ("short", "constant", "extras", "absurd")}
    sds = [f["sd_off"] for f in found if f["sd_off"] is not None]
    return [
        f"lower belts short, named or in the tie: {count['short']} of {n}",
        f"constant of all belts named where it is, and only there: {count['constant']} of {n}",
        f"its value within two standard deviations: {sum(abs(s) < 2 for s in sds)} of {len(sds)}",
        f"frames with effects beside the truth: {count['extras']} of {n}",
        f"frames with a gain beyond {ABSURD:.0%}: {count['absurd']} of {n}",
        "verdicts: "
        + ", ".join(f"{k} {v}" for k, v in Counter(f["verdict"] for f in found).most_common()),
    ]


def main(arguments: Sequence[str] | None = None) -> int:
    """The command."""
    parser = argparse.ArgumentParser("python -m tests.machines.frames", description=__doc__)
    parser.add_argument("--count", type=int, default=60)
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--bow", type=float, default=0.0, help="of what no term has [mm]")
    parser.add_argument("--declared", type=float, help="noise declared over the true one")
    options = parser.parse_args(arguments)
    found = []
    for k in range(options.count):
        rng = np.random.default_rng((options.seed, k))
        declared = options.declared or float(np.exp(rng.uniform(np.log(0.5), np.log(3))))
        case = frame(rng, k % 2 == 0, declared, options.bow)
        found.append(graded(case, traced(rng, case)))
        if (
            found[-1]["extras"]
            or found[-1]["absurd"]
            or not (found[-1]["short"] and found[-1]["constant"])
        ):
            print(
                k,
                f"{case.constant:.1f} mm {1e3 * case.short:.2f} permil x{declared:.2f}",
                found[-1],
                file=sys.stderr,
            )
    print("\n".join(table(found)))
    return 0


if __name__ == "__main__":
    sys.exit(main())
