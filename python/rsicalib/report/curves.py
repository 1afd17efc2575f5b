"""The smooth curve that stands for a law that no term has, as a line of a picture."""

from __future__ import annotations

import math

from rsicalib.facts.shapes import Evidence, Hypothesis, Law, Step

ANY_CURVE = "free_curve"
"""Id of the term that has any shape."""

AnyCurve = list[tuple[float, float]]
"""Readings, and the correction of each."""


def any_curve(evidence: Evidence, step: Step, law: Law) -> AnyCurve:
    """The curve of any shape in the place of an effect, over the readings of its law.

    Like `Law.alternatives` it has the offset and gain of its own fit, against those of what was
    found. Empty where it was not fitted, or is drawn already.
    """
    drawn = {a.effect.term for a in law.alternatives} | {step.term}
    found = next((one for one in evidence.hypotheses if one.kind == "found"), None)
    own = next((one for one in evidence.hypotheses if _is_curve(one, step)), None)
    if ANY_CURVE in drawn or found is None or own is None or not law.of_reading:
        return []
    values, before = _sensor(own, step.target), _sensor(found, step.target)
    offset, gain = (values.get(p, 0.0) - before.get(p, 0.0) for p in ("offset", "gain"))
    waves = [value for name, value in values.items() if name not in ("offset", "gain")]
    readings = [x for x, _ in law.line]
    low, high = min(readings), max(readings)
    return [
        (x, offset + gain * x + _waves(waves, (x - low) / (high - low) if high > low else 0.0))
        for x in readings
    ]


def _is_curve(one: Hypothesis, step: Step) -> bool:
    """Whether it has the curve in the place of the effect."""
    return one.kind != "found" and any(
        (name.term, name.target) == (ANY_CURVE, step.target) for name in one.effects
    )


def _sensor(one: Hypothesis, target: str) -> dict[str, float]:
    """Estimates of offset, gain and curve of a channel, by name."""
    terms = ("offset", "gain", ANY_CURVE)
    pairs = zip(one.parameters, one.fit.values, strict=True)
    return {p.name: v for p, v in pairs if p.target == target and p.term in terms and v is not None}


def _waves(coefficients: list[float], along: float) -> float:
    """The curve as `rsicalib terms free_curve` writes it: `Σ_k c_k cos(k π s)`."""
    return sum(c * math.cos(k * math.pi * along) for k, c in enumerate(coefficients, 1))
