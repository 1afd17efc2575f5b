"""Was it right? A result of `rsicalib trace --json`, against the effects that were there."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

from tests.blind.effects.base import Effect
from tests.blind.effects.mishaps import BadReading, Fault, GrossSample

Result = dict[str, Any]


@dataclass(frozen=True)
class Verdict:
    """One effect judged: `credit` from 0 to 1, and the term under which it was found."""

    term: str
    target: str
    credit: float
    named: str | None
    arm: float = 0.0
    """Whether at least its arm was named: from 0 to 1."""
    place: float | None = None
    """Whether the one channel or arm at fault was named; None where it is not one."""


@dataclass(frozen=True)
class Grade:
    """One session judged.

    `effects` in the order given; `extras` counts what was named and is not there; `flagged` whether
    anything at all was raised; `position` and `orientation` are rms errors on the check poses,
    before and after, where known.
    """

    effects: tuple[Verdict, ...]
    extras: int
    flagged: bool
    verdict: str
    position: tuple[float | None, float | None]
    orientation: tuple[float | None, float | None]
    misled: bool = False
    """Said to be explained, by a class that no effect has."""

    @property
    def right(self) -> bool:
        """Every effect was named, and nothing else."""
        return all(v.credit > 0 for v in self.effects) and self.extras == 0


def names(step: Result) -> list[Result]:
    """The step's own name first, then what it says it cannot tell from it."""
    return [step, *step.get("also_fits", [])]


def is_named(effect: Effect, name: Result) -> bool:
    """Whether a name has the effect's class and target."""
    return name["class"] in effect.kinds and name["target"] in effect.equivalents


def share(effect: Effect, step: Result) -> float:
    """One over the number of distinct targets that a step lists, the effect's own counted once."""
    others = {name["target"] for name in names(step)} - effect.equivalents
    return 1.0 / (1 + len(others))


def judge_step(effect: Effect, step: Result) -> float:
    """Credit of an effect of the catalogue for one step."""
    return share(effect, step) if any(is_named(effect, n) for n in names(step)) else 0.0


def judge_excluded(effect: Effect, entry: Result) -> float:
    """Credit of a bad reading for one excluded entry: less where an arm or all channels are blamed.

    A fault of a converter is right to be left out wherever it spoils its channel.
    """
    if isinstance(effect, Fault):
        return float(entry.get("channel") == effect.target)
    if not isinstance(effect, BadReading) or entry["pose"] != effect.pose:
        return 0.0
    if isinstance(effect, GrossSample) and entry.get("sample") not in (None, effect.sample):
        return 0.0
    if entry.get("channel") is None:
        return 1.0 / 3.0 if entry.get("chain") == arm_of(effect.target) else 1.0 / 9.0
    return 1.0 if entry["channel"] == effect.target else 0.0


def same_target(effect: Effect, target: str | None) -> bool:
    """Whether a target is the effect's, or a side of the handle at its wrist for a loose wrist."""
    if target is None:
        return False
    wrist = f"wrist{effect.target[-1]}" if effect.kind == "closure" else "-none-"
    return target in effect.equivalents or wrist in target.split("-")


def arm_of(target: str | None) -> str | None:
    """The arm of a channel, a link or an arm; None for anything wider."""
    if target is None:
        return None
    if target.startswith("arm"):
        return target.split("/")[0]
    return f"arm{target[1]}" if len(target) == 3 and target[0] == "a" and target != "all" else None


def judge_outside(effect: Effect, result: Result) -> tuple[float, float]:
    """Credit for the target, and for the arm, of an effect that no catalogue has."""
    groups = [[name.get("target") for name in names(step)] for step in result["steps"]]
    groups += [[entry.get("channel") or entry.get("chain")] for entry in result["excluded"]]
    groups.append([(result.get("unexplained") or {}).get("target")])
    target = arm = 0.0
    for group in groups:
        distinct = {place for place in group if place is not None}
        if any(same_target(effect, place) for place in distinct):
            target = max(target, 1.0 / len(distinct))
        if arm_of(effect.target) in {arm_of(place) for place in distinct} - {None}:
            arm = max(arm, 1.0 / len({arm_of(place) for place in distinct}))
    return target, max(arm, target)


def judge_fault(effect: Effect, result: Result) -> float:
    """A fault of the converter may also be named in a warning that mentions its channel."""
    targets = (w["target"] or "" for w in result["warnings"])
    warned = any(effect.target in target.split("+") for target in targets)
    return 1.0 if warned else judge_outside(effect, result)[0]


def best(credits: Sequence[float], named: Sequence[str]) -> tuple[float, str | None]:
    """The best credit and its name."""
    if not credits or max(credits) == 0.0:
        return 0.0, None
    return max(credits), named[credits.index(max(credits))]


def place(effect: Effect, credit: float, arm: float) -> float | None:
    """Credit where one channel or arm is at fault: of a sensor its channel, of geometry its arm."""
    if arm_of(effect.target) is None:
        return None
    return arm if effect.kind == "geometry" else credit


def judge(effect: Effect, result: Result, left_out: bool = False) -> Verdict:
    """One effect."""
    steps, excluded = result["steps"], result["excluded"]
    if isinstance(effect, Fault):
        credit, named = judge_fault(effect, result), steps[0]["term"] if steps else None
        arm = max(credit, judge_outside(effect, result)[1])
    elif effect.outside or left_out:
        credit, arm = judge_outside(effect, result)
        named = steps[0]["term"] if steps else None
    else:
        credits = [judge_step(effect, step) for step in steps]
        credits += [judge_excluded(effect, entry) for entry in excluded]
        credit, named = best(credits, [s["term"] for s in steps] + ["excluded"] * len(excluded))
        if named is None and (steps or excluded):
            named = steps[0]["term"] if steps else "excluded"
        arm = judge_outside(effect, result)[1]
    return Verdict(effect.term, effect.target, credit, named, arm, place(effect, credit, arm))


def extras(result: Result, effects: Sequence[Effect]) -> int:
    """Steps and exclusions that match no true effect."""
    steps = sum(not any(judge_step(e, step) for e in effects) for step in result["steps"])
    entries = sum(not any(judge_excluded(e, x) for e in effects) for x in result["excluded"])
    return steps + entries


def misled(result: Result, effects: Sequence[Effect]) -> bool:
    """Whether it is said to be explained, by a class that no effect has."""
    kinds = {kind for effect in effects for kind in effect.kinds}
    named = {step["class"] for step in result["steps"]}
    return bool(effects) and result["verdict"] == "explained" and not named <= kinds


def handle_error(result: Result, stage: str, figure: str) -> float | None:
    """An rms error on the check poses, `before` or `after`; None where there is none."""
    value = ((result.get(stage) or {}).get("check") or {}).get(figure)
    return None if value is None else float(value)


def grade(result: Result, effects: Sequence[Effect], left_out: bool = False) -> Grade:
    """Judges a result; `left_out` if the effects' terms were kept from the catalogue."""
    pairs = {
        figure: (handle_error(result, "before", figure), handle_error(result, "after", figure))
        for figure in ("position_rms", "orientation_rms")
    }
    return Grade(
        effects=tuple(judge(effect, result, left_out) for effect in effects),
        extras=extras(result, effects),
        flagged=bool(result["steps"] or result["excluded"] or result["verdict"] != "adequate"),
        verdict=result["verdict"],
        position=pairs["position_rms"],
        orientation=pairs["orientation_rms"],
        misled=misled(result, effects),
    )
