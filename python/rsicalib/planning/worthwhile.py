"""Which poses of a plan are worth a visit, and what would help where none is."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import Any

from rsicalib.facts.shapes import Name
from rsicalib.planning.purposes import Purpose, gain_of, share_of
from rsicalib.report.words import listed_words

__all__ = ["MOST_POSES", "how_many", "worthwhile"]

MOST_POSES = 64
"""Poses of a plan that is told a target and no number, at the most: more than that is no advice."""

SEEN = 1.0
"""What poses must bring together to `λ`, a growth of χ², to be more than its noise of one."""

BETTER = 0.01
"""Share by which poses must bring the platform's standard deviation down together."""

DECISION = 12.0
"""`λ` of a decision."""

LIKELY = 0.5
"""Probability of a decision below which more poses are spoken of."""


def worthwhile(
    found: Mapping[str, Any], rivals: Sequence[Sequence[Name]], asked: int
) -> tuple[list[bool], tuple[str, ...]]:
    """Judge the poses of a plan by what each brings.

    Poses that together bring next to nothing are copies of others, or of the session.

    Parameters
    ----------
    found : mapping
        What the core planned.
    rivals : sequence of sequence of Name
        The explanations that are open.
    asked : int
        Number of poses that were asked for.

    Returns
    -------
    list of bool
        Of each pose, whether it is worth a visit.
    tuple of str
        What was left out, and what would help: sentences.
    """
    gains, least = _gains(found["purposes"])
    worth = [True] * len(gains)
    left = 0.0
    for k in sorted(range(len(gains)), key=gains.__getitem__):
        left += gains[k]
        worth[k] = left >= least
    dropped, kept = worth.count(False), worth.count(True)
    out = []
    decides = found["forecast"]["decides"]
    if not kept:
        what = "decide between the explanations" if decides is not None else "make it more certain"
        them = "No pose within reach would" if asked == 1 else f"No {asked} poses within reach"
        out.append(f"{them} {what}: no plan.")
    elif dropped:
        out.append(f"{kept} of {asked} poses: any more would be copies, and bring next to nothing.")
    if decides is not None and decides < LIKELY:
        out += _undecided(found, kept, decides)
        out += _would(rivals)
    elif not kept:
        out.append(OTHERS)
    return worth, tuple(out)


OTHERS = (
    "What would: a wider range of the joints, more samples of each pose, a lower noise, a length "
    "measured."
)


def how_many(needed: float, planned: int) -> str:
    """The end of a sentence on a target that a plan misses: how many poses, or what else.

    What poses tell grows with their number, as long as they are few more than those planned.
    """
    if needed <= max(MOST_POSES, planned):
        return f"; it would take some {math.ceil(needed)}."
    return f": poses like these do not reach it. {OTHERS}"


def _gains(purposes: Sequence[Purpose]) -> tuple[list[float], float]:
    """What each pose brings, and the least that poses must bring together."""
    told = [gain_of(purpose) for purpose in purposes]
    if any(gain is not None for gain in told):
        return [max(0.0, gain or 0.0) for gain in told], SEEN
    return [share_of(purpose) for purpose in purposes], BETTER


def _undecided(found: Mapping[str, Any], kept: int, decides: float) -> list[str]:
    """How often these poses decide, and how many like them would."""
    least = found["forecast"]["least_lambda"]
    if not kept or least is None or least <= 0.0:
        return []
    text = f"These {kept} poses decide in {decides:.0%} of cases"
    if least < DECISION:
        needed = kept * DECISION / least
        few = f"; some {math.ceil(needed)} like them would be a decision"
        text += few if needed <= max(MOST_POSES, kept) else ": more like them do not decide it"
    return [f"{text}."]


def _would(rivals: Sequence[Sequence[Name]]) -> list[str]:
    """What would tell explanations apart that poses do not."""
    effects = [name for terms in rivals for name in terms]
    sensors = sorted({name.target for name in effects if name.klass == "sensor"})
    lengths = sorted({name.target for name in effects if name.klass in ("geometry", "closure")})
    ways = []
    if sensors:
        ways.append(f"move {listed_words(sensors)} over more of their range (limits, workspace)")
    if {"electronics", "load"} & {name.klass for name in effects} or any(n.place for n in effects):
        ways.append("visit the same poses again later, with a pause between, in another order")
    if lengths:
        ways.append(f"measure a length of {listed_words(lengths)}, and declare it")
    ways.append("average more samples of each pose")
    return ["What would: " + "; or ".join(ways) + "."]
