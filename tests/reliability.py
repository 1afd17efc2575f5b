"""Are probabilities what they say? `python -m tests.reliability --devices 100 --seed 7`.

Draws devices with the mix that `MIX` states: clean, with one effect of the catalogue, and with a
law that no term has, as strong as was drawn for each. Traces each, and asks of every effect that is
named how likely it is said to be, what fits as well included, and whether it was there.
"""

from __future__ import annotations

import argparse
import json
from collections.abc import Iterator, Sequence
from dataclasses import asdict, dataclass
from functools import partial
from itertools import pairwise
from multiprocessing import get_context
from pathlib import Path
from time import perf_counter
from typing import Any

import numpy as np

from rsicalib import Mechanism, trace
from rsicalib.errors import InputError
from tests.blind import grade as of_blind
from tests.blind import trials as blind
from tests.families import effects as catalogue
from tests.families import trials
from tests.families.device import Device, Effect, observe, stage
from tests.families.draw import FAMILIES
from tests.families.grade import Truth, place, targets
from tests.families.power import Linear
from tests.laws.trials import built, taken
from tests.outside import LAW, law_of

Result = dict[str, Any]

MIX = {"clean": 0.25, "catalogue": 0.5, "outside": 0.25}
"""Share of each kind of device."""
SIZES = (10.0, 30.0, 60.0, 200.0)
"""Noncentrality: bounds of the sizes, each drawn as often, evenly in its logarithm."""
SAID = (0.0, 0.5, 0.75, 0.9, 1.0)
"""Bounds of what is said."""
PLACES = ("rsi", *FAMILIES)
"""Families, the hand controller first."""


@dataclass(frozen=True)
class Statement:
    """That one effect, or what fits as well, is there."""

    probability: float
    right: bool
    names: str


@dataclass(frozen=True)
class Row:
    """What was said of one device."""

    family: str
    number: int
    kind: str
    strength: float
    truth: str
    verdict: str
    said: tuple[Statement, ...]
    place: bool
    """Whether the place of what is wrong is blamed for anything."""
    seconds: float


def names(step: Result) -> list[Result]:
    """An effect, and what fits as well."""
    return [step, *(step.get("also_fits") or [])]


def key(name: Result) -> tuple[str, str, str | None]:
    """A term at its target and place."""
    return str(name["term"]), str(name["target"]), name.get("place")


def probability(result: Result, step: Result) -> float:
    """How likely an effect is said to be, what fits as well included."""
    rivals = result.get("rivals") or []
    own = {key(name) for name in names(step)}
    of = [r["probability"] for r in rivals if own & {key(e) for e in r["terms"]}]
    return float(sum(of)) if rivals else 1.0


def is_right(truth: Truth, step: Result) -> bool:
    """Whether an effect was named, or is among what fits as well."""
    if truth.outside:
        places = {target for _, target in truth.names}
        return any(n["term"] == LAW and n["target"] in places for n in names(step))
    return bool(truth.names & {place(name) for name in names(step)})


def drawn(family: str, number: int, seed: int) -> tuple[str, float, np.random.Generator]:
    """Kind and strength of a device."""
    rng = np.random.default_rng([seed, PLACES.index(family), number])
    kind = str(rng.choice(list(MIX), p=list(MIX.values())))
    size = int(rng.integers(len(SIZES) - 1))
    strength = float(np.exp(rng.uniform(*np.log(SIZES[size : size + 2]))))
    return kind, strength, rng


def made(
    family: str, number: int, kind: str, strength: float, rng: np.random.Generator
) -> tuple[Any, Any, tuple[Effect, ...], tuple[Truth, ...]]:
    """A mechanism and readings of a device, and what is wrong with it."""
    for _ in range(40):
        try:
            hand = family == "rsi"
            device = built(rng) if hand else Device.random(family, rng)
            scene = taken(device, rng, 48, 8) if hand else stage(device, rng)
            effects: tuple[Effect, ...] = ()
            truths: tuple[Truth, ...] = ()
            if kind == "catalogue":
                strengths = (strength, strength)
                effects, truths = trials.drawn(
                    device, scene, rng, catalogue.CATALOGUE, number, 1, strengths
                )
            elif kind == "outside":
                linear = Linear(device, scene)
                effect = linear.scaled(law_of(device, rng)[0], strength)
                if linear.is_of_few_poses(effect) or linear.twins(effect):
                    continue
                effects = (effect,)
                at = frozenset({(effect.klass, effect.target)})
                truths = (Truth(effect.term, at, outside=True, strength=strength),)
            session = observe(device, scene, rng, effects)
        except ValueError:
            continue
        mechanism = Mechanism.from_toml(trials.toml(device))
        return mechanism, trials.readings_of(mechanism, session), effects, truths
    raise RuntimeError(f"{family} {number}: no such device in forty drawings")


def hand(number: int, strength: float, seed: int) -> Row:
    """A hand controller with an effect of the catalogue, by the simulator of `tests/blind`."""
    case = blind.make("single", number, seed, blind.Size(strength, exactly=True))
    given = blind.given(case)
    start = perf_counter()
    result = trace(given.readings, given.mechanism, rest=given.rest).to_dict()
    seconds = perf_counter() - start

    def right(step: Result) -> bool:
        return any(of_blind.is_named(e, n) for e in case.effects for n in names(step))

    said = tuple(
        Statement(probability(result, step), right(step), f"{step['term']}@{step['target']}")
        for step in result["steps"]
    )
    grade = of_blind.grade(result, case.effects)
    what = " ".join(f"{e.term}@{e.target}" for e in case.effects)
    found = all(e.credit > 0 for e in grade.effects)
    return Row("rsi", number, "catalogue", strength, what, result["verdict"], said, found, seconds)


def run(asked: tuple[str, int], seed: int) -> Row | None:
    """One device; None where it is refused."""
    family, number = asked
    kind, strength, rng = drawn(family, number, seed)
    if family == "rsi" and kind == "catalogue":
        return hand(number, strength, seed)
    mechanism, readings, effects, truths = made(family, number, kind, strength, rng)
    start = perf_counter()
    try:
        result = trace(readings, mechanism).to_dict()
    except (InputError, ValueError) as error:
        print(f"  {family} {number}: {error}")
        return None
    seconds = perf_counter() - start
    said = tuple(
        Statement(
            probability(result, step),
            any(is_right(truth, step) for truth in truths),
            f"{step['term']}@{step['target']}",
        )
        for step in result["steps"]
    )
    what = " ".join(f"{e.term}@{e.target}" for e in effects)
    found = all({t for _, t in truth.names} & targets(result) for truth in truths)
    verdict = str(result["verdict"])
    return Row(family, number, kind, strength, what, verdict, said, found, seconds)


def cell(right: Sequence[bool]) -> str:
    """A count, and its share."""
    return f"{sum(right)} of {len(right)}" + (f" ({np.mean(right):.0%})" if right else "")


def of_size(rows: Sequence[Row]) -> Iterator[tuple[str, Sequence[Row]]]:
    """The rows of each size, clean ones among all alone."""
    for low, high in pairwise(SIZES):
        sized = [r for r in rows if r.kind != "clean" and low <= r.strength < high]
        yield f"{low:.0f} to {high:.0f}", sized
    yield "all", rows


def table(rows: Sequence[Row]) -> list[str]:
    """The reliability table: what is said, and how often it is so."""
    bands = list(pairwise(SAID))
    heads = [f"{100 * low:.0f} to {100 * high:.0f} %" for low, high in bands]
    lines = [f"| noncentrality | devices | {' | '.join(heads)} |", "|---" * (2 + len(bands)) + "|"]
    for name, own in of_size(rows):
        said = [s for row in own for s in row.said]
        cells = []
        for low, high in bands:
            here = [s for s in said if low <= min(s.probability, 1 - 1e-9) < high]
            mean = f", {np.mean([s.probability for s in here]):.0%} said" if here else ""
            cells.append(cell([s.right for s in here]) + mean)
        lines.append(f"| {name} | {len(own)} | {' | '.join(cells)} |")
    sure = SAID[-2]
    for kind in MIX:
        own = [r for r in rows if r.kind == kind]
        named = [s.right for r in own for s in r.said if s.probability >= sure]
        explained = [r for r in own if r.verdict == "explained"]
        wrong = sum(not all(s.right for s in r.said) for r in explained)
        lines.append(
            f"{kind}: {len(own)} devices; named at {sure:.0%} or more {cell(named)} right; "
            f"explained {len(explained)}, of these wrongly {wrong}; "
            f"place right {cell([r.place for r in own])}"
        )
    lines.append(f"seconds of a trace {np.mean([r.seconds for r in rows] or [0.0]):.3f}")
    return lines


def main(arguments: Sequence[str] | None = None) -> int:
    """The command."""
    parser = argparse.ArgumentParser(prog="python -m tests.reliability", description=__doc__)
    parser.add_argument("--devices", type=int, default=10, help="of each family")
    parser.add_argument("--first", type=int, default=0, help="number of the first")
    parser.add_argument("--seed", type=int, help="drawn where it is not given")
    parser.add_argument("--minutes", type=float, default=1e9, help="begin no device after so long")
    parser.add_argument("--jobs", type=int, default=1)
    parser.add_argument("--off", nargs="*", default=[], help="rules of the search to switch off")
    parser.add_argument("--out", type=Path, help="write what was said, one JSON per line")
    options = parser.parse_args(arguments)
    fresh = int(np.random.default_rng().integers(10**6))
    seed = fresh if options.seed is None else options.seed
    numbers = range(options.first, options.first + options.devices)
    asked = [(family, number) for number in numbers for family in PLACES]
    print(f"seed {seed}", flush=True)
    rows: list[Row] = []
    start = perf_counter()
    with get_context("spawn").Pool(options.jobs, switched, (options.off,)) as pool:
        for row in pool.imap(partial(run, seed=seed), asked):
            rows += [row] if row else []
            if perf_counter() - start > 60 * options.minutes:
                pool.terminate()
                break
    print("\n".join(table(rows)))
    if options.out:
        options.out.write_text("".join(json.dumps(asdict(row)) + "\n" for row in rows))
    return 0


def switched(off: Sequence[str]) -> None:
    """Switches rules of the search off in a process of its own."""
    from tests.ablation import switch_off

    if off:
        switch_off(off)


if __name__ == "__main__":
    raise SystemExit(main())
