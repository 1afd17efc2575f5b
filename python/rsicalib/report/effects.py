"""Figures of one effect: its law, what it explains, and how far it stands out."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from rsicalib.facts.shapes import Against, EffectEvidence, Evidence, Law, Name, Score, Step
from rsicalib.report.curves import ANY_CURVE, AnyCurve, any_curve
from rsicalib.report.figure import Figure
from rsicalib.report.svg import WIDE, Canvas, Chart, bounds, fitted
from rsicalib.report.words import name_of, number, subject
from rsicalib.units import HALF_95, axis_words, in_thousandths

HEIGHT = 240.0

BARS = 10
"""Candidates whose bar has a label; the others have thin bars."""


def effect_key(effect: Step | Name) -> str:
    """What an effect is called in the data of a page."""
    return f"{effect.term}@{effect.target}"


def effect_figures(step: Step, gathered: Evidence | None, number: int) -> list[Figure]:
    """The figures of an effect, the first of which has the number 0; from its result alone where
    no evidence was gathered.
    """
    name = f"effect{number + 1}"
    evidence = gathered.effects[number] if gathered and number < len(gathered.effects) else None
    if gathered is None or evidence is None:
        return [_curve_figure(step, name)] if step.curve else []
    figures = []
    if (law := evidence.law) is not None:
        figures.append(_law_figure(step, law, name, any_curve(gathered, step, law)))
    elif evidence.against is not None:
        figures.append(_against_figure(evidence.against, name))
    figures.append(_added_variable_figure(step, evidence, name))
    scores = scores_figure(evidence.scores, f"{name}-scores")
    return [*figures, *([scores] if scores else [])]


def of(pose: int | None) -> dict[str, Any]:
    """The data of a dot that is of one pose: it lights up with all of that pose."""
    return {} if pose is None else {"p": pose}


def _cloud(
    chart: Chart,
    points: Sequence[Sequence[float]],
    poses: Sequence[int | None],
    radius: float,
    kind: str = "dot",
) -> None:
    """Dots at points, each of its pose; those that are of none have nothing to light up."""
    if all(pose is None for pose in poses):
        chart.canvas.dots(map(chart.at, points), radius, kind)
        return
    for point, pose in zip(points, poses, strict=True):
        chart.canvas.dot(*chart.at(point), radius, kind, **of(pose))


def _per_dot(count: int, what: str) -> str:
    return f"one {what}" if count == 1 else f"the mean of {count} neighbouring {what}s"


def _band(step: Step, times: float) -> tuple[list[tuple[float, float]], list[tuple[float, float]]]:
    """The curve of a result with its 95 % band: both edges."""
    if len(step.curve_sd) != len(step.curve):
        return [], []
    rows = list(zip(step.curve, step.curve_sd, strict=True))
    upper = [(row[0], times * (row[1] + HALF_95 * sd)) for row, sd in rows]
    lower = [(row[0], times * (row[1] - HALF_95 * sd)) for row, sd in rows]
    return upper, lower


def _curve_figure(step: Step, name: str) -> Figure:
    """The correction with its band, without the readings behind it."""
    over = "time, 0 to 1 over the session" if step.curve_over == "time" else ""
    times, unit = in_thousandths(step.curve_unit)
    points = [(row[0], times * row[1]) for row in step.curve]
    upper, lower = _band(step, times)

    def draw(width: float) -> str:
        canvas = Canvas(width, HEIGHT)
        x = min(p[0] for p in points), max(p[0] for p in points)
        y = bounds([0.0, *(p[1] for p in [*points, *upper, *lower])])
        words = over or f"reading of {step.target}", axis_words("correction", unit)
        chart = Chart.on(canvas, x, y, words, height=HEIGHT)
        canvas.path([chart.at(p) for p in [*upper, *lower[::-1]]], "band", closed=True)
        chart.curve(points, "law")
        return canvas.svg(f"{subject(step)}: correction with its 95 % band")

    caption = "The line is the correction, the band its 95 % interval."
    return Figure(f"{name}-law", draw, caption)


def _law_figure(step: Step, law: Law, name: str, curve: AnyCurve) -> Figure:
    times, unit = in_thousandths(law.correction_unit)
    what = "correction of all readings" if law.correction_unit == "1" else "correction"
    dots = [(x, times * y, times * sd) for x, y, sd in law.dots]
    own = [law.line, *(a.line for a in law.alternatives), *([curve] if curve else [])]
    lines = [[(x, times * y) for x, y in line] for line in own]
    on_reading = step.curve_over != "time"
    upper, lower = _band(step, times) if step.curve and on_reading else ([], [])
    if step.curve and on_reading:
        lines[0] = [(row[0], times * row[1]) for row in step.curve]
    others = [subject(a.effect) for a in law.alternatives]
    keys = [effect_key(step), *(effect_key(a.effect) for a in law.alternatives)]
    if curve:
        others.append("a smooth curve of any shape")
        keys.append(f"{ANY_CURVE}@{step.target}")
    # Of each dot the correction, and the number of its pose where it is of one.
    of_pose = law.poses or (None,) * len(dots)

    def draw(width: float) -> str:
        canvas = Canvas(width, HEIGHT + 16.0 * (1 + len(others)))
        x = bounds(d[0] for d in dots)
        usual = sorted(d[2] for d in dots)[len(dots) // 2] if dots else 0.0
        shown = [d for d in dots if d[2] <= 3.0 * usual]
        poses = [p for d, p in zip(dots, of_pose, strict=True) if d[2] <= 3.0 * usual]
        y = bounds([0.0, *(d[1] for d in shown), *(p[1] for line in lines for p in line)])
        words = axis_words(law.over, law.unit), axis_words(what, unit)
        chart = Chart.on(canvas, x, y, words, height=HEIGHT)
        if upper:
            edge = [(u, min(max(v, y[0]), y[1])) for u, v in [*upper, *lower[::-1]]]
            canvas.path([chart.at(p) for p in edge], "band", closed=True)
        spans = [(chart.x(at), chart.y(v - sd), chart.y(v + sd)) for at, v, sd in shown]
        canvas.uprights(spans, "whisker")
        for weak, kind in ((False, "dot"), (True, "dot faint")):
            cloud = [
                (d, p) for d, p in zip(shown, poses, strict=True) if weak == (d[2] > 1.5 * usual)
            ]
            _cloud(chart, [d[:2] for d, _ in cloud], [p for _, p in cloud], 2.6, kind)
        for k, line in enumerate(lines[1:]):
            chart.curve(line, f"rival rival{k}", keys[k + 1])
        chart.curve(lines[0], "law", keys[0])
        _legend(canvas, HEIGHT, [subject(step), *others])
        return canvas.svg(f"{subject(step)}: law and residual over {law.over}")

    caption = (
        f"Each dot is the correction that {_per_dot(law.per_dot, 'pose')} asks for, with its "
        "standard deviation: what the law gives there and what is left. Dots that follow the line "
        "are evidence for the law."
    )
    if law.alternatives:
        caption += (
            " The broken lines are what these poses cannot tell from it: where they part, a "
            "reading would decide."
        )
    if curve:
        caption += " Any curve is smooth, and of the shape that the readings ask for."
    return Figure(f"{name}-law", draw, caption)


def _legend(canvas: Canvas, top: float, names: Sequence[str]) -> None:
    """A line for each name, below the frame."""
    for k, words in enumerate(names):
        y = top + 12.0 + 16.0 * k
        kind = "law" if k == 0 else f"rival rival{k - 1}"
        canvas.path([(20.0, y - 4.0), (52.0, y - 4.0)], kind)
        canvas.text(58.0, y, words)


def _against_figure(against: Against, name: str) -> Figure:
    def draw(width: float) -> str:
        canvas = Canvas(width, HEIGHT)
        x = bounds(d[0] for d in against.dots)
        y = bounds(v for d in against.dots for v in d[1:])
        words = axis_words(against.over, against.unit), "residual / noise"
        chart = Chart.on(canvas, x, y, words, height=HEIGHT)
        chart.band(-2.0, 2.0)
        canvas.dots((chart.at((at, residual)) for at, residual, _ in against.dots), 2.6)
        for at, _, explained in against.dots:
            canvas.dot(*chart.at((at, explained)), 2.6, "ring")
        return canvas.svg(f"residual over {against.over}, and what the effect explains")

    return Figure(
        f"{name}-law",
        draw,
        "Dots are the residual without the effect, rings what the effect makes of it: dots that "
        "follow the rings are evidence for the effect.",
    )


def _added_variable_figure(step: Step, evidence: EffectEvidence, name: str) -> Figure:
    dots = evidence.added_variable

    def draw(width: float) -> str:
        canvas = Canvas(width, HEIGHT)
        x, y = bounds(d[0] for d in dots), bounds(d[1] for d in dots)
        words = ("what it explains / noise", "residual without it / noise")
        chart = Chart.on(canvas, x, y, words, height=HEIGHT)
        low, high = max(x[0], y[0]), min(x[1], y[1])
        _cloud(chart, dots, evidence.of_pose or (None,) * len(dots), 2.4)
        chart.curve([(low, low), (high, high)], "law")
        return canvas.svg(f"added-variable plot of {subject(step)}")

    caption = (
        f"Added-variable plot, {_per_dot(evidence.per_dot, 'equation')} to a dot: the steeper the "
        "cloud along the line of slope one, the more the readings ask for the effect; a few dots "
        "far out that make the slope alone would be no evidence."
    )
    return Figure(f"{name}-added", draw, caption)


def scores_words(scores: Sequence[Score]) -> str:
    """The same in a sentence, where there is no more to see."""
    best = max(scores, key=lambda score: score.charged)
    tried = f"of {len(scores)} candidates that were tried"
    if best.charged > 0.0:
        one = f"{subject(best.effect)} alone lowers χ² by more than it is charged for"
        return f"{tried.capitalize()} {one}, by {number(best.charged)}; it was not named."
    return f"None {tried} lowers χ² by more than it is charged for."


def scores_figure(scores: Sequence[Score], name: str) -> Figure | None:
    """Draw the score of every candidate as a bar, the best first."""
    shown = [s for s in scores if s.charged > 0.0]
    few, rest = shown[:BARS], shown[BARS:]
    if len(few) < 2 and not any(score.chosen for score in few):
        return None  # a bar alone has nothing beside it
    largest = few[0].charged

    def draw(width: float) -> str:
        left = 210.0 if width == WIDE else 140.0
        room = width - left - 56.0
        canvas = Canvas(width, 20.0 * len(few) + min(2.0 * len(rest), 160.0) + 34.0)
        for k, score in enumerate(few):
            y = 8.0 + 20.0 * k
            words = fitted(f"{name_of(score.effect.term)} {score.effect.target}", left - 4.0)
            canvas.text(left - 4.0, y + 12.0, words, anchor="end", kind="tick")
            said = (
                f"{subject(score.effect)}: score {number(score.score)}, p {number(score.p_value)}"
            )
            kind = "bar chosen" if score.chosen else "bar"
            canvas.rect(left, y, room * score.charged / largest, 15.0, kind, said)
            end = left + room * score.charged / largest + 4.0
            canvas.text(end, y + 12.0, number(score.charged))
        step = min(2.0, 160.0 / max(len(rest), 1))
        for k, score in enumerate(rest):
            y = 8.0 + 20.0 * len(few) + step * k
            canvas.rect(left, y, room * score.charged / largest, 0.7 * step, "bar")
        y = canvas.height - 12.0
        others = len(scores) - len(few)
        canvas.text(left, y, f"{others} others score less", kind="label")
        return canvas.svg("scores of all candidates")

    caption = (
        "By how much χ² would fall with each candidate, to first order, less the charge for its "
        f"parameters and for the places looked at; {len(scores)} were tried. "
    )
    if any(score.chosen for score in scores):
        caption += (
            "Strong bars are what was named and what cannot be told from it. The best are fitted, "
            "and named is what then explains most: another bar may be longer, and how sure the "
            "name is stands with its probability, not here."
        )
    else:
        caption += "None was named."
    return Figure(name, draw, caption)
