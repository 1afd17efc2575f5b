"""What each rule and prior of the search is worth: `python -m tests.ablation --devices 4`.

Draws devices of `tests/families`, of `tests/blind` and machines of `tests/machines`, traces each
with every rule on, and again with one rule, or a list of them joined by `+`, switched off. Prints,
for each rule, how many devices that rule alone puts right and how many it spoils, paired device by
device, with the probability of as uneven a split by chance (sign test). `--against FILE` compares
with the answers that another version of the library gave, written by `--out`.
"""

from __future__ import annotations

import argparse
import json
from collections.abc import Callable, Iterator, Sequence
from dataclasses import asdict, dataclass
from functools import partial
from pathlib import Path
from time import perf_counter
from typing import Any

from scipy import stats

import rsicalib
from rsicalib import Mechanism, _core
from rsicalib.errors import InputError
from tests.blind import grade as of_blind
from tests.blind import trials as blind
from tests.families import grade as of_family
from tests.families import trials as families
from tests.families.draw import FAMILIES
from tests.machines import trials as machines

KINDS = ("clean", "single", "pair", "wrong_readings", "outside", "faint_30")
BLIND = ("clean", "single", "pairs", "triples", "outside", "left_out", "moved", "recordings")
ALL = "as it is"
"""The search with every rule."""


@dataclass(frozen=True)
class Said:
    """What was said of one device: right with nothing else, and what counts beside that."""

    kind: str
    device: str
    right: bool
    extras: int
    misled: bool
    verdict: str
    said: str
    seconds: float


def switch_off(rules: Sequence[str]) -> None:
    """Switches rules of the search off, for all traces that follow."""
    session: Any = _core.Session
    if not hasattr(session, "traced"):
        session.traced = session.trace
    plain = session.traced
    if not rules:
        session.trace = plain
        del session.traced
        return

    def trace(self: Any, *arguments: Any, **named: Any) -> Any:
        return plain(self, *arguments, **named, off=list(rules))

    session.trace = trace


def of_families(case: families.Case) -> Said:
    """What is said of one device of a family."""
    family, suite, number = case.family, case.suite, case.number
    mechanism = Mechanism.from_toml(case.text)
    readings = families.readings_of(mechanism, case.session)
    start = perf_counter()
    result = rsicalib.trace(readings, mechanism)
    seconds = perf_counter() - start
    it = of_family.grade(result.to_dict(), result.exit_code, case.truths)
    right = not it.flagged if suite == "clean" else all(it.found) and not it.extras
    if suite == "outside":
        right = all(it.found) and not it.misled
    device = f"{family} {suite} {number}"
    said = " ".join(it.said)
    return Said(suite, device, right, it.extras, it.misled, it.verdict, said, seconds)


def of_controllers(case: blind.Case) -> Said:
    """What is said of one hand controller."""
    suite, number = case.suite, case.number
    given = blind.given(case)
    start = perf_counter()
    result = blind.traced(given, case.without)
    seconds = perf_counter() - start
    it = of_blind.grade(result, case.effects, left_out=suite == "left_out")
    right = not it.flagged if suite == "clean" else it.right
    if suite in ("outside", "left_out"):
        right = all(v.place != 0 for v in it.effects) and not it.misled
    steps = [f"{step['term']}@{step['target']}" for step in result["steps"]]
    bad = [f"bad@{entry['pose']}" for entry in result["excluded"]]
    device, said = f"rsi {suite} {number}", " ".join(steps + bad)
    return Said(f"rsi {suite}", device, right, it.extras, it.misled, it.verdict, said, seconds)


def of_machines(name: str, suite: str, number: int, seed: int) -> Said:
    """What is said of a machine with belts, planes, points, equal joints or forces in its loop."""
    it = machines.run(name, suite, number, seed)
    kind, device = f"machine {suite}", f"{name} {suite} {number}"
    said, verdict = " ".join(it.get("said", ())), it.get("verdict", "refused")
    named = bool(it.get("named") or it.get("among"))
    right = named if suite == "effect" else it.get("flagged") is False
    misled = verdict == "explained" and not named
    return Said(kind, device, right, it.get("extras", 0), misled, verdict, said, it["seconds"])


def devices(
    asked: Sequence[str], count: int, first: int, seed: int
) -> Iterator[Callable[[], Said]]:
    """Functions that trace one device each, a round of all kinds after the other; drawn once."""
    for number in range(first, first + count):
        for suite in KINDS if "families" in asked else ():
            for family in FAMILIES:
                yield partial(of_families, families.make(family, suite, number, seed))
        for suite in BLIND if "blind" in asked else ():
            yield partial(of_controllers, blind.make(suite, number, seed))
        for suite in machines.SUITES if "machines" in asked else ():
            for name in machines.MACHINES:
                yield partial(of_machines, name, suite, number, seed)


def compared(name: str, base: Sequence[Said], other: Sequence[Said], show: bool) -> None:
    """Prints what the base has right that the other has not, and the other way round."""
    there = {said.device: said for said in other}
    pairs = [(said, there[said.device]) for said in base if said.device in there]
    for kind in [*dict.fromkeys(said.kind for said in base), "all"]:
        own = [(a, b) for a, b in pairs if kind in (a.kind, "all")]
        lost = sum(a.right and not b.right for a, b in own)
        won = sum(b.right and not a.right for a, b in own)
        if not lost + won and kind != "all":
            continue
        p = stats.binomtest(lost, lost + won).pvalue if lost + won else 1.0
        print(f"  {name:28s} {kind:14s} of {len(own):4d}: lost {lost}, won {won}, p = {p:.3g}")
    for what in ("extras", "misled", "right"):
        both = [sum(getattr(pair[k], what) for pair in pairs) for k in (0, 1)]
        print(f"  {name:28s} {what}: {both[0]} -> {both[1]}")
    times = [sum(pair[k].seconds for pair in pairs) for k in (0, 1)]
    print(f"  {name:28s} seconds: {times[0]:.1f} -> {times[1]:.1f}")
    for a, b in pairs if show else []:
        if a.right != b.right:
            sign = "-" if a.right else "+"
            print(f"    {sign} {a.device}: {a.verdict} {a.said} -> {b.verdict} {b.said}")


def main(arguments: Sequence[str] | None = None) -> int:
    """The command."""
    parser = argparse.ArgumentParser(prog="python -m tests.ablation", description=__doc__)
    parser.add_argument("--suites", nargs="+", default=["families", "blind", "machines"])
    parser.add_argument("--rules", nargs="*", help="rules to switch off, `a+b` together; else all")
    parser.add_argument("--devices", type=int, default=2, help="of every suite of every family")
    parser.add_argument("--first", type=int, default=0, help="number of the first device")
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--minutes", type=float, default=1e9, help="begin no device after so long")
    parser.add_argument("--out", type=Path, help="write what is said with every rule")
    parser.add_argument("--against", type=Path, help="answers of another version")
    parser.add_argument("--show", action="store_true", help="list the devices that differ")
    options = parser.parse_args(arguments)
    rules = [ALL, *(options.rules if options.rules is not None else _core.rules())]
    answers: dict[str, list[Said]] = {rule: [] for rule in rules}
    start = perf_counter()
    for device in devices(options.suites, options.devices, options.first, options.seed):
        if perf_counter() - start > 60.0 * options.minutes:
            break
        for rule in rules:
            switch_off([] if rule == ALL else rule.split("+"))
            try:
                answers[rule].append(device())
            except (InputError, ValueError, RuntimeError) as error:
                print(f"  {rule}: {error}")
    base = answers[ALL]
    print(f"{len(base)} devices, {sum(said.right for said in base)} right")
    for rule in rules[1:]:
        compared(rule, base, answers[rule], options.show)
    if options.out:
        options.out.write_text(json.dumps({k: [asdict(s) for s in v] for k, v in answers.items()}))
    if options.against:
        other = json.loads(options.against.read_text(encoding="utf-8"))
        for rule in rules:
            compared(f"before -> {rule}", [Said(**s) for s in other[ALL]], answers[rule], True)
    return 0


if __name__ == "__main__":
    raise SystemExit(main())
