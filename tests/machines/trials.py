"""One trial: a machine, what is wrong with it, its files, and what the library says."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from tempfile import TemporaryDirectory
from time import perf_counter
from typing import Any

import numpy as np

import rsicalib
from rsicalib.errors import RsicalibError
from tests.families.grade import Truth, grade
from tests.machines import arm, belt, delta, files, leader, statics
from tests.machines.kit import Effect, Linear, Machine, Rng
from tests.oracle import Array

MACHINES: dict[str, Callable[[Rng], Machine]] = {
    "belts": belt.draw,
    "delta": delta.draw,
    "plane": arm.draw_plane,
    "sockets": arm.draw_sockets,
    "tracker": arm.draw_tracker,
    "seen": arm.draw_seen_plane,
    "line": arm.draw_line,
    "bar": arm.draw_bar,
    "leader": leader.draw,
    "fivebar": statics.draw_fivebar,
    "legs": statics.draw_legs,
    "warm": arm.draw_warm,
    "warm_legs": statics.draw_warm_legs,
    "redundant": statics.draw_redundant,
}
SUITES = ("clean", "effect")
STRENGTH = (30.0, 100.0)
"""Noncentrality of effects, drawn between."""
WITHIN = 1.959964
"""Half of a 95 % interval, in standard deviations of a normal."""
Record = dict[str, Any]


@dataclass(frozen=True)
class Case:
    """A machine, its readings, and what is wrong with it: `names` are right answers."""

    machine: Machine
    read: Array
    effect: Effect | None = None
    size: float = 0.0
    strength: float = 0.0
    names: frozenset[tuple[str, str]] = frozenset()


def make(name: str, suite: str, number: int, seed: int) -> Case:
    """Case `number` of a suite: the same for the same numbers, whoever makes it."""
    place = [seed, list(MACHINES).index(name), SUITES.index(suite), number]
    rng = np.random.default_rng(np.random.SeedSequence(place))
    for _ in range(20):
        try:
            machine = MACHINES[name](rng)
            if suite == "clean":
                return Case(machine, machine.observe(rng))
            return spoiled(machine, rng, number)
        except (ValueError, np.linalg.LinAlgError):
            continue
    raise RuntimeError(f"{name} {suite} {number}: no such machine in 20 drawings")


def spoiled(machine: Machine, rng: Rng, number: int) -> Case:
    """A machine with one effect: kinds by turns, one of the kind at random."""
    linear = Linear(machine)
    kinds = sorted({e.kind for e in machine.effects})
    of_kind = [e for e in machine.effects if e.kind == kinds[number % len(kinds)]]
    for one in rng.permutation(np.array(of_kind, dtype=object)):
        strength = rng.uniform(*STRENGTH)
        try:
            size = linear.sized(one, strength)
        except ValueError:
            continue
        if one.kind != "load" and rng.random() < 0.5:  # nothing gives against its load
            size = -size
        read = machine.observe(rng, one, size)
        return Case(machine, read, one, size, strength, linear.twins(one, size))
    raise ValueError("no effect of this kind shows")


def run(name: str, suite: str, number: int, seed: int, folder: Path | None = None) -> Record:
    """Makes, traces and grades one case; its files stay in `folder` where one is given."""
    case = make(name, suite, number, seed)
    record: Record = {"machine": name, "suite": suite, "number": number, "seed": seed}
    if case.effect is not None:
        record |= {"effect": case.effect.value, "kind": case.effect.kind}
        record |= {"size": float(case.size), "strength": round(case.strength, 1)}
    start = perf_counter()
    with TemporaryDirectory() as own:
        csv, mechanism = files.write(case.machine, case.read, folder or Path(own))
        try:
            record |= examined(case, csv, mechanism)
        except RsicalibError as error:
            record["refused"] = str(error)
        except KeyboardInterrupt:
            raise
        except BaseException as error:  # a defect, and a panic, is a figure and not the end
            record["crashed"] = f"{type(error).__name__}: {error}"
    return record | {"seconds": round(perf_counter() - start, 2)}


def examined(case: Case, csv: Path, mechanism: Path) -> Record:
    """What the library says, graded."""
    result = rsicalib.trace(csv, mechanism)
    answer = result.to_dict()
    truths = [] if case.effect is None else [Truth(case.effect.value, case.names)]
    judged = grade(answer, result.exit_code, truths)
    out: Record = {"verdict": judged.verdict, "said": list(judged.said), "extras": judged.extras}
    ties = [f"{t['term']}@{t['target']}" for s in answer["steps"] for t in s["also_fits"] or []]
    if case.effect is None:
        out["flagged"] = judged.flagged
        out["covered"] = coverage(case.machine, answer)
    else:
        out |= {"named": judged.found[0], "among": judged.among[0], "ties": ties}
    return out


def coverage(machine: Machine, answer: dict[str, Any]) -> list[int]:
    """How many of the parameters have the truth in their 95 % interval, and of how many.

    Leans of lines count from axes that the library chooses, and are not those of the simulator.
    """
    known = [
        (p, machine.values[f"{p['name']}@{p['target']}"])
        for p in answer["parameters"]
        if p["term"] != "unknown_line" and f"{p['name']}@{p['target']}" in machine.values
    ]
    inside = [
        abs(p["value"] - value) < WITHIN * p["sd"] for p, value in known if p["sd"] is not None
    ]
    return [sum(inside), len(inside)]


Asked = tuple[str, str, int, int]
"""Machine, suite, number, seed."""


def work(asked: Asked, kept: Path | None = None) -> Record:
    """One trial, for other processes too: they do not import what a command is."""
    name, suite, number, seed = asked
    return run(name, suite, number, seed, kept and kept / f"{name}_{suite}_{seed}_{number}")
