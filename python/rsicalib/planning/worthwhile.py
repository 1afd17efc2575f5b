"""What is said of poses of a plan that are not worth a visit, and what would help instead."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import Any

from rsicalib.facts.shapes import Name
from rsicalib.report.words import MEASURED_LENGTH, listed_words

MOST_POSES = 64
"""Poses of a plan that is told a target and no number, at the most: more than that is no advice."""

LIKELY = 0.5
"""Probability of a decision below which more poses are spoken of."""


def worth_words(
    found: Mapping[str, Any], rivals: Sequence[Sequence[Name]], *, needs_length: bool = False
) -> tuple[str, ...]:
    """What was left out of a plan, and what would help, in sentences.

    Parameters
    ----------
    found : mapping
        What the core planned, and which of its poses are worth a visit.
    rivals : sequence of sequence of Name
        The explanations that are open.
    needs_length : bool
        True where two of them differ by the size of the whole.
    """
    worth, out = found["worth"], []
    kept, asked = sum(worth), len(worth)
    decides = found["forecast"]["decides"]
    if not kept:
        what = "decide between the explanations" if decides is not None else "make it more certain"
        them = "No pose within reach would" if asked == 1 else f"No {asked} poses within reach"
        out.append(f"{them} {what}: no plan.")
    elif kept < asked:
        out.append(f"{kept} of {asked} poses: any more would be copies, and bring next to nothing.")
    if decides is not None and decides < LIKELY:
        out += _undecided(kept, decides, found["needed"])
        out += _would(rivals, needs_length=needs_length)
    elif needs_length:
        out.append(f"No pose tells the size of the whole: {MEASURED_LENGTH}.")
    elif not kept:
        out.append(OTHERS)
    return tuple(out)


OTHERS = (
    "What would: a wider range of the channels, more samples of each pose, a lower noise, a length "
    "measured."
)


def how_many(needed: float, planned: int) -> str:
    """The end of a sentence on a target that a plan misses: how many poses, or what else.

    What poses tell grows with their number, as long as they are few more than those planned.
    """
    if needed <= max(MOST_POSES, planned):
        return f"; it would take some {math.ceil(needed)}."
    return f": poses like these do not reach it. {OTHERS}"


def _undecided(kept: int, decides: float, needed: float | None) -> list[str]:
    """How often these poses decide, and how many like them would."""
    if needed is None:
        return []
    text = f"These {kept} poses decide in {decides:.0%} of cases"
    if needed > kept:
        few = f"; some {math.ceil(needed)} like them would be a decision"
        text += few if needed <= max(MOST_POSES, kept) else ": more like them do not decide it"
    return [f"{text}."]


def _would(rivals: Sequence[Sequence[Name]], *, needs_length: bool) -> list[str]:
    """What would tell explanations apart that poses do not."""
    effects = [name for terms in rivals for name in terms]
    sensors = sorted({name.target for name in effects if name.klass == "sensor"})
    lengths = sorted({name.target for name in effects if name.klass in ("geometry", "closure")})
    ways = []
    if needs_length:
        ways.append(MEASURED_LENGTH)
    elif sensors:
        ways.append(f"move {listed_words(sensors)} over more of their range (limits, workspace)")
    if {"electronics", "load"} & {name.klass for name in effects} or any(n.place for n in effects):
        ways.append("visit the same poses again later, with a pause between, in another order")
    if lengths:
        ways.append(f"measure a length of {listed_words(lengths)}, and declare it")
    ways.append("average more samples of each pose")
    return ["What would: " + "; or ".join(ways) + "."]
