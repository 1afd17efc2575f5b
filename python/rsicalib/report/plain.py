"""What a result says to people who do not calibrate: one or two sentences, and how sure."""

from __future__ import annotations

import math

from rsicalib.facts.shapes import Evidence, Name, ResultShape, Step, TraceShape
from rsicalib.report.words import (
    either_words,
    labelled,
    listed_words,
    longer_words,
    mistaken,
    moved_words,
    name_of,
    number,
    place_words,
    subject,
    target_words,
    value_words,
)

WRONG = {
    "sensor": "the {target} does not read true",
    "sensors": "the {target} read wrong, alike",
    "each sensor": "all sensors read wrong, alike",
    "electronics": "The electronics read all channels wrong",
    "geometry": "{target} is not as it is drawn",
    "closure": "What {target} says does not hold",
    "closures": "{target} are wrong, alike",
    "load": "{target} gives under load",
}
"""What is the matter, by the class of an effect."""

THIS = {
    "sensor": "this sensor",
    "sensors": "these sensors",
    "each sensor": "all sensors",
    "electronics": "the electronics",
}
"""What is called so, by the class of an effect; a part of the mechanism else."""

SHAPES = {
    "curvature": "a parabola",
    "cubic": "a cubic curve",
    "once_per_turn": "a sine once a turn",
    "twice_per_turn": "a sine twice a turn",
    "free_curve": "a curve of another shape",
}
"""What a sensor's law looks like, where it is no word of everyday."""

SURE = 0.95
"""Probability from which something is called certain."""


def plain_words(result: ResultShape, evidence: Evidence | None) -> str:
    """The result in one or two sentences without a term of statistics."""
    if result.verdict == "implausible":
        return "These readings do not fit this mechanism as it is declared. Do not use the result."
    if result.verdict == "undetermined":
        return "These poses are too few, or too much alike, to calibrate the mechanism."
    if isinstance(result, TraceShape) and result.steps:
        if result.verdict != "explained":
            return _in_part(result)
        return " ".join(_found(result, step) for step in _worst(result)[:2])
    right = _right(result, evidence)
    if result.verdict == "unexplained" and (mistake := mistaken(result)):
        return f"Something is wired or written otherwise than declared: {mistake}. Do not use it."
    if result.verdict == "unexplained":
        at = place_words(result) if isinstance(result, TraceShape) else ""
        used = f" Used as it is, the calibration is {right}." if right else ""
        return f"Something is wrong{at}, and no known effect explains it.{used}"
    sure = f" It is {right}." if right else ""
    if result.verdict == "adequate":
        return f"The mechanism is calibrated, and nothing is missing.{sure}"
    return f"The mechanism is calibrated.{sure}"


def _right(result: ResultShape, evidence: Evidence | None) -> str:
    """How right it is over the workspace, or at the poses where no more is known; empty where
    that is not known either.
    """
    cells = [c[2] for one in evidence.workspace for c in one.cells] if evidence else []
    known = [sd for sd in cells if math.isfinite(sd)]
    if known:
        size = math.sqrt(sum(sd * sd for sd in known) / len(known))
        return f"right to {number(size, 2)} {result.length_unit} over the workspace"
    if result.predicted is None:
        return ""
    size = result.predicted.position_sd
    return f"right to {number(size, 2)} {result.length_unit} at these poses"


def _worst(result: TraceShape) -> list[Step]:
    """The effects, those first that harm most."""
    harm = [s.platform_rms.position or 0.0 if s.platform_rms else 0.0 for s in result.steps]
    order = sorted(range(len(harm)), key=lambda k: -harm[k])
    return [result.steps[k] for k in order]


def _in_part(result: TraceShape) -> str:
    """What was found where it is not all, or does not hold elsewhere: nothing is certain then."""
    targets = [labelled(step.target, step.label) for step in _worst(result)]
    named = listed_words(list(dict.fromkeys(targets))[:3])
    return f"Something is wrong, at {named} most of all; what was found does not explain it all."


def _kind(step: Step) -> str:
    """The class of an effect, and of how many sensors or closures it is."""
    if step.klass == "closure" and step.target.startswith("each"):
        return "closures"
    if step.klass != "sensor":
        return step.klass
    several = "+" in step.target or step.target.startswith("each.")
    return "each sensor" if step.target == "each" else "sensors" if several else "sensor"


def _is_several(step: Step) -> bool:
    """Whether an effect is of several sensors or parts, alike."""
    return _kind(step) in ("sensors", "each sensor") or step.target.startswith("each")


def _where(of: Step | Name) -> tuple[bool, str]:
    """What an effect is of: `each` is of closures or of chains."""
    return of.klass == "closure", of.target


def _found(result: TraceShape, step: Step) -> str:
    target = labelled(target_words(step.klass, step.target), step.label)
    said = WRONG.get(_kind(step), "{target} is wrong").format(target=target)
    said = said[:1].upper() + said[1:]
    rms = step.platform_rms
    off = None if rms is None else rms.position
    if rms is not None and off:
        said += f": it puts {moved_words(rms)} {number(off, 2)} {result.length_unit} off"
    return f"{said}. {_sure(result, step)}"


def _sure(result: TraceShape, step: Step) -> str:
    """How sure it is that it is this target, and what it is."""
    rivals = result.rivals
    terms = [step.term, *(n.term for n in step.also_fits if _where(n) == _where(step))]
    weighed = 0.0
    for rival in sorted(rivals, key=lambda r: -r.probability):
        if weighed < SURE:  # the fewest that hold together are certain to have it among them
            terms += [n.term for n in rival.terms if _where(n) == _where(step)]
        weighed += rival.probability
    what = _what(step, list(dict.fromkeys(terms)))
    if not rivals:
        return what
    thing = THIS.get(_kind(step), "these parts" if _is_several(step) else "this part")
    here = sum(r.probability for r in rivals if any(_where(n) == _where(step) for n in r.terms))
    twins = [subject(n) for n in step.also_fits if _where(n) != _where(step)]
    if twins:
        return f"{what} These poses cannot tell it from {either_words(twins[:3])}."
    if here >= SURE:
        return f"It is certain that it is {thing}. {what}"
    others = {n.target for r in rivals for n in r.terms} - {s.target for s in result.steps}
    or_at = f"; it may be at {either_words(sorted(others)[:3])}" if others else ""
    return f"That it is {thing} has a probability of {100 * here:.0f} %{or_at}. {what}"


def _what(step: Step, terms: list[str]) -> str:
    """What the error is, by the terms that it may be: with its size where it is one number."""
    shapes = [SHAPES.get(term, name_of(term)) for term in terms]
    size = value_words(step.parameters[0]) if step.parameters else ""
    one = len(terms) == 1 and len(step.parameters) == 1
    if one and step.term == "distance":
        return f"{'Each' if _is_several(step) else 'It'} is {longer_words(step.parameters[0])}."
    if one and step.term not in SHAPES and step.klass in ("sensor", "geometry"):
        return f"{'Their' if _is_several(step) else 'Its'} {shapes[0]} is off by {size}."
    error = "It" if step.klass != "sensor" else "The error"
    if len(terms) > 1:
        return f"{error} may be {either_words(shapes[:4])}."
    return f"{error} is {shapes[0]}{f', {size}' if one else ''}."
