"""Hypotheses that a reader chooses from: what each leaves, and where it puts the platform."""

from __future__ import annotations

import math
from collections.abc import Sequence
from html import escape
from typing import Any

import numpy as np

from rsicalib.arrays import FloatArray
from rsicalib.facts.shapes import Evidence, Hypothesis, ParameterName, Rival, Slice, SwitchFit
from rsicalib.report.certainty import is_same
from rsicalib.report.effects import effect_key
from rsicalib.report.residuals import Dots
from rsicalib.report.scene import Scene
from rsicalib.report.words import (
    count_words,
    listed_words,
    number,
    percent,
    plus_minus,
    probability,
    subject,
    target_words,
)
from rsicalib.units import HALF_95


def key_of(p: ParameterName) -> str:
    """What a parameter is called in the data of a page."""
    return f"{p.term}@{p.target}.{p.name}"


def residuals_of(fit: SwitchFit, equations: int) -> FloatArray:
    """Residuals of a fit: (poses, equations)."""
    rows: FloatArray = np.array(fit.residuals, dtype=np.float64).reshape(-1, equations)
    return rows


def fit_data(fit: SwitchFit, parameters: Sequence[ParameterName], dots: Dots) -> dict[str, Any]:
    """What the script of a page needs of a fit: every number as it is to be written."""
    rows = dots.blocks(residuals_of(fit, len(dots.equations)))
    return {
        "error": [
            f"{number(fit.chi2)} / {count_words(fit.dof)}",
            probability(fit.p_value),
            number(fit.rms_misclosure),
        ],
        "parameters": {
            key_of(p): list(plus_minus(v, None if s is None else HALF_95 * s))
            for p, v, s in zip(parameters, fit.values, fit.sd, strict=True)
        },
        "residuals": [round(float(v), 2) for v in rows.ravel()],
    }


def words_of(one: Hypothesis) -> str:
    """What a hypothesis says, in words."""
    if one.kind == "nothing":
        return "Nothing is missing"
    if one.kind == "any_curve":
        targets = [target_words("sensor", target) for target in _targets(one)]
        return f"A smooth curve of any shape, of {listed_words(targets)}"
    words = listed_words([subject(name) for name in one.effects])
    return words[:1].upper() + words[1:]


def named_of(known: Sequence[Hypothesis]) -> int:
    """Number of the hypothesis that the result is: what was found, or nothing."""
    return next((k for k, one in enumerate(known) if one.kind == "found"), 0)


def _targets(one: Hypothesis) -> list[str]:
    return list(dict.fromkeys(name.target for name in one.effects))


def hypothesis_data(
    one: Hypothesis, dots: Dots, scene: Scene | None, found: Hypothesis
) -> dict[str, Any]:
    """The same of a hypothesis, and how far it puts the platform from where what was found does."""
    data = fit_data(one.fit, one.parameters, dots)
    if one.check is not None:
        data["error"] += [number(one.check.position_rms), number(one.check.orientation_rms)]
    data |= {"words": words_of(one), "chi2": one.fit.chi2}
    data["laws"] = [effect_key(name) for name in one.effects]
    data["sd"] = None if one is found else deviations(one.workspace, found.workspace)
    if scene is None or len(one.places) != len(scene.places):
        return data
    digits = scene.digits
    apart = scene.times * (np.array(one.places) - np.array(found.places))
    if np.isfinite(apart).all():
        # Where what was found puts it, no arrow is drawn.
        data |= {} if one is found else {"places": apart.round(digits).tolist()}
        known = np.array(one.known).reshape(-1, 3)
        same = len(known) == len(scene.known)
        off = scene.times * (known - scene.known[:, 0]) if same else scene.known[:0, 0]
        data["known"] = off.round(digits).tolist()
    return data


def deviations(own: Sequence[Slice], drawn: Sequence[Slice]) -> list[float | None]:
    """Standard deviation in each cell that is drawn; None where the hypothesis has no such cell."""
    out: list[float | None] = []
    for one, other in zip(drawn, own, strict=False):
        first, step = one.cells[0] if one.cells else (0.0, 0.0), one.step

        def at(cell: Sequence[float], first: Sequence[float], step: Sequence[float]) -> Any:
            return tuple(round((cell[k] - first[k]) / step[k]) for k in (0, 1))

        there = {at(cell, first, step): cell[2] for cell in other.cells}
        for cell in one.cells:
            if math.isfinite(cell[2]):
                sd = there.get(at(cell, first, step))
                out.append(float(f"{sd:.2g}") if sd is not None and math.isfinite(sd) else None)
    return out


def _probability(one: Hypothesis, rivals: Sequence[Rival]) -> float | None:
    """Probability of a hypothesis among the explanations, a law that no term has included."""
    return next((r.probability for r in rivals if is_same(one, r)), None)


def choices_html(evidence: Evidence, rivals: Sequence[Rival]) -> str:
    """The hypotheses to choose from, with their probabilities; what was found is chosen."""
    rows = []
    chosen = named_of(evidence.hypotheses)
    for k, one in enumerate(evidence.hypotheses):
        p = _probability(one, rivals)
        share = "" if p is None else f'<span class="share" style="width:{100 * p:.1f}%"></span>'
        words = "" if p is None else percent(p)
        mark = " checked" * (k == chosen)
        rows.append(
            f'<label><input type="radio" name="hypothesis"{mark}> {escape(words_of(one))}'
            f'<span class="likely">{share}</span><span class="percent">{words}</span></label>'
        )
    if not rows:
        return ""
    others = [r for r in rivals if not any(is_same(one, r) for one in evidence.hypotheses)]
    named = [
        f"{listed_words([subject(name) for name in r.terms])} ({percent(r.probability)})"
        for r in others
        if r.terms
    ]
    note = f'<p class="faint">Not drawn: {escape("; ".join(named))}.</p>' if named else ""
    choices = f'<fieldset id="hypotheses"><legend>What is it?</legend>{"".join(rows)}</fieldset>'
    return choices + note


def fader_html(evidence: Evidence) -> str:
    """The size of what was found, between nothing and one and a half times as much, with χ²."""
    kinds = [one.kind for one in evidence.hypotheses]
    if "nothing" not in kinds or "found" not in kinds:
        return ""
    none, found = (evidence.hypotheses[kinds.index(k)].fit.chi2 for k in ("nothing", "found"))
    low, across, up = 10.0, 120.0, 60.0
    curve = " ".join(
        f"{low + across * s / 100:.1f},{72 - up * (1 - s / 100) ** 2:.1f}" for s in range(0, 151, 5)
    )
    return (
        '<div class="fader"><label for="fader">Size of what was found: '
        f'<output id="faded">100 %, χ² {number(found)}</output></label>'
        '<input id="fader" type="range" min="0" max="150" value="100">'
        f'<svg viewBox="0 0 200 80" role="img" aria-label="χ² from {number(none)} without it to '
        f'{number(found)} with it, over its size"><polyline class="law" points="{curve}"/>'
        f'<circle id="fader-dot" class="dot" r="4" cx="{low + across}" cy="72" data-x0="{low}" '
        f'data-x1="{across}" data-y0="72" data-y1="{up}"/></svg></div>'
    )
