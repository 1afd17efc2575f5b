"""What a result says to people who do not calibrate: one or two sentences, and how sure."""

from __future__ import annotations

import math
from collections.abc import Sequence
from html import escape

from rsicalib.facts.shapes import Evidence, Hypothesis, ResultShape, Rival, Step, TraceShape
from rsicalib.report.words import (
    UNKNOWN,
    labelled,
    listed_words,
    name_of,
    number,
    percent,
    subject,
    target_words,
    value_words,
)

__all__ = ["certainty_html", "is_same", "plain_words"]

WRONG = {
    "sensor": "the {target} does not read true",
    "sensors": "the {target} read wrong, alike",
    "each sensor": "all sensors read wrong, alike",
    "electronics": "The electronics read all channels wrong",
    "geometry": "{target} is not as it is drawn",
    "closure": "What {target} says does not hold",
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

SEGMENTS = 5
"""Explanations that have a part of the strip of their own."""


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
    if result.verdict == "unexplained":
        left = result.unexplained if isinstance(result, TraceShape) else None
        at = "" if left is None or left.target in (None, "all") else f" at {left.target}"
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
    """The class of an effect, and of how many sensors it is."""
    if step.klass != "sensor":
        return step.klass
    return "each sensor" if step.target == "each" else "sensors" if "+" in step.target else "sensor"


def _found(result: TraceShape, step: Step) -> str:
    target = labelled(target_words(step.klass, step.target), step.label)
    said = WRONG.get(_kind(step), "{target} is wrong").format(target=target)
    said = said[:1].upper() + said[1:]
    off = None if step.platform_rms is None else step.platform_rms.position
    if off:
        said += f": it puts the platform {number(off, 2)} {result.length_unit} off"
    return f"{said}. {_sure(result, step)}"


def _sure(result: TraceShape, step: Step) -> str:
    """How sure it is that it is this target, and what it is."""
    rivals = result.rivals
    terms = [step.term, *(n.term for n in step.also_fits if n.target == step.target)]
    for rival in rivals:
        terms += [n.term for n in rival.terms if n.target == step.target]
    what = _what(step, list(dict.fromkeys(terms)))
    if not rivals:
        return what
    thing = THIS.get(_kind(step), "this part")
    here = sum(r.probability for r in rivals if any(n.target == step.target for n in r.terms))
    twins = [subject(n) for n in step.also_fits if n.target != step.target]
    if twins:
        return f"{what} These poses cannot tell it from {_either(twins[:3])}."
    if here >= SURE:
        return f"It is certain that it is {thing}. {what}"
    others = {n.target for r in rivals for n in r.terms} - {s.target for s in result.steps}
    or_at = f"; it may be at {_either(sorted(others)[:3])}" if others else ""
    return f"That it is {thing} has a probability of {100 * here:.0f} %{or_at}. {what}"


def _what(step: Step, terms: list[str]) -> str:
    """What the error is, by the terms that it may be: with its size where it is one number."""
    shapes = [SHAPES.get(term, name_of(term)) for term in terms]
    size = value_words(step.parameters[0]) if step.parameters else ""
    one = len(terms) == 1 and len(step.parameters) == 1
    if one and step.term not in SHAPES and step.klass in ("sensor", "geometry"):
        several = _kind(step) in ("sensors", "each sensor") or step.target.startswith("each")
        return f"{'Their' if several else 'Its'} {shapes[0]} is off by {size}."
    error = "It" if step.klass != "sensor" else "The error"
    if len(terms) > 1:
        return f"{error} may be {_either(shapes[:4])}."
    return f"{error} is {shapes[0]}{f', {size}' if one else ''}."


def _either(items: list[str]) -> str:
    return items[0] if len(items) == 1 else f"{', '.join(items[:-1])} or {items[-1]}"


def certainty_html(result: ResultShape, evidence: Evidence | None) -> str:
    """The explanations with their probabilities, as one bar; nothing where there are none.

    `script.js` lets each be chosen where it was fitted.
    """
    rivals = result.rivals if isinstance(result, TraceShape) else ()
    if not rivals:
        return ""
    shown = sorted(rivals, key=lambda r: -r.probability)[:SEGMENTS]
    rest = 1.0 - sum(r.probability for r in shown)
    rows = [(_name(r), r.probability) for r in shown]
    rows += [("others", rest)] if rest > 0.005 else []
    bar = "".join(
        f'<span class="part{k}" style="flex:{max(p, 0.004):.4f}"></span>'
        for k, (_, p) in enumerate(rows)
    )
    known = evidence.hypotheses if evidence is not None else ()
    chosen = [_number(rival, known) for rival in shown] + [None] * (len(rows) - len(shown))
    keys = "".join(
        f"<li{_choice(at)}>"
        f'<span class="key part{k}"></span>{escape(words)} <strong>{percent(p)}</strong></li>'
        for k, ((words, p), at) in enumerate(zip(rows, chosen, strict=True))
    )
    if any(at is not None for at in chosen) and known[0].kind == "nothing":
        keys += f'<li{_choice(0)}><span class="key"></span>as if nothing were missing</li>'
    said = ", ".join(f"{words} {percent(p)}" for words, p in rows)
    return (
        f'<div class="certainty"><div class="strip" role="img" aria-label="How sure: '
        f'{escape(said)}">{bar}</div><ul>{keys}</ul></div>'
    )


def _choice(at: int | None) -> str:
    return "" if at is None else f' data-choose="{at}"'


def _number(rival: Rival, known: Sequence[Hypothesis]) -> int | None:
    """Number of the hypothesis that is this explanation; None where it was not fitted."""
    return next((k for k, one in enumerate(known) if is_same(one, rival)), None)


def is_same(one: Hypothesis, rival: Rival) -> bool:
    """True where both are the same effects; any curve stands for a law that no term has."""
    unknown = one.kind == "any_curve"
    own = {(UNKNOWN if unknown else n.term, n.target) for n in one.effects}
    return {(n.term, n.target) for n in rival.terms} == own


def _name(rival: Rival) -> str:
    return listed_words([subject(name) for name in rival.terms] or ["nothing"])
