"""How sure a result is, at a glance: its explanations as one bar."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from html import escape

from rsicalib.facts.shapes import Evidence, Hypothesis, Name, ResultShape, Rival, TraceShape
from rsicalib.report.words import listed_words, percent, place_words, subject

SEGMENTS = 5
"""Explanations that have a part of the strip of their own."""


def certainty_html(result: ResultShape, evidence: Evidence | None) -> str:
    """The explanations with their probabilities, as one bar; hatched where none holds, and nothing
    where none is needed.

    `script.js` lets each be chosen where it was fitted.
    """
    rivals = result.rivals if isinstance(result, TraceShape) else ()
    if not rivals:
        words = _no_explanation(result, evidence)
        return _strip([Part("none", words)]) if words else ""
    shown = sorted(rivals, key=lambda r: -r.probability)[:SEGMENTS]
    rest = 1.0 - sum(r.probability for r in shown)
    known = evidence.hypotheses if evidence is not None else ()
    rows = [(_name(r), r.probability, _number(r, known)) for r in shown]
    rows += [("others", rest, None)] if rest > 0.005 else []
    parts = [
        Part(f"part{k}", words, percent(p), max(p, 0.004), at)
        for k, (words, p, at) in enumerate(rows)
    ]
    # Nothing stands below what can be chosen, unless it is one of the explanations.
    below = any(part.choice for part in parts) and all(part.choice != 0 for part in parts)
    return _strip(parts, "as if nothing were missing" if below else "")


@dataclass(frozen=True)
class Part:
    """A part of the strip: its colour, what it says, its share, and the hypothesis that it is."""

    kind: str
    words: str
    percent: str = ""
    share: float = 1.0
    choice: int | None = None


def _strip(parts: Sequence[Part], nothing: str = "") -> str:
    """The parts as one bar and as a list; `nothing` are the words of the first hypothesis."""
    bar = "".join(
        f'<span class="{part.kind}" style="flex:{part.share:.4f}"></span>' for part in parts
    )
    keys = "".join(
        f'<li{_choice(part.choice)}><span class="key {part.kind}"></span>{escape(part.words)}'
        f"{f' <strong>{part.percent}</strong>' if part.percent else ''}</li>"
        for part in parts
    )
    keys += f'<li{_choice(0)}><span class="key"></span>{nothing}</li>' if nothing else ""
    said = ", ".join(f"{part.words} {part.percent}".strip() for part in parts)
    return (
        f'<div class="certainty"><div class="strip" role="img" aria-label="How sure: '
        f'{escape(said)}">{bar}</div><ul>{keys}</ul></div>'
    )


def _no_explanation(result: ResultShape, evidence: Evidence | None) -> str:
    """Why no explanation has a probability, where something is to be explained; empty else."""
    if result.verdict == "undetermined":
        return "no explanation was weighed: these readings do not tell enough"
    if result.verdict != "unexplained":
        return ""
    if not isinstance(result, TraceShape):
        return "no explanation was looked for: rsicalib trace does"
    at = place_words(result)
    tried = f": none of the {len(evidence.left)} that were tried holds" if evidence else ""
    return f"an effect that is not known{',' * bool(at)}{at}{tried}"


def _choice(at: int | None) -> str:
    return "" if at is None else f' data-choose="{at}"'


def _number(rival: Rival, known: Sequence[Hypothesis]) -> int | None:
    """Number of the hypothesis that is this explanation; None where it was not fitted."""
    return next((k for k, one in enumerate(known) if is_same(one, rival)), None)


def is_same(one: Hypothesis, rival: Rival) -> bool:
    """True where both are the same effects."""
    return _effects(rival.terms) == _effects(one.effects)


def _effects(names: Sequence[Name]) -> set[tuple[str, str]]:
    return {(n.term, n.target) for n in names}


NO_EFFECT = "no effect, but noise or wrong readings"
"""An explanation without effects, in words."""


def _name(rival: Rival) -> str:
    return listed_words([subject(name) for name in rival.terms] or [NO_EFFECT])
