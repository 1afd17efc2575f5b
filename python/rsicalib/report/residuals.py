"""Figures of the residual: pose by pose, before and after, and against what chance would give."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from statistics import NormalDist

import numpy as np

from rsicalib.arrays import FloatArray
from rsicalib.facts.shapes import Evidence, ResultShape, TraceShape
from rsicalib.report.figure import Figure
from rsicalib.report.svg import WIDE, Canvas, Chart, bounds, width_of

MOST_DOTS = 300
"""A longer recording is drawn in blocks."""

HEIGHT = 200.0

LABELLED = 3
"""Most dots of a panel that have a label."""

FAR = 3.3
"""Residuals beyond this many standard deviations have a label."""


@dataclass(frozen=True)
class Dots:
    """What the dots of a residual are.

    Attributes
    ----------
    size : int
        Poses whose dots are drawn as one.
    labels : tuple of str
        Name of each pose or block.
    equations : tuple of str
        Closure of each equation.
    out : dict of int to str
        What was left out: number of the pose, and what is said of it.
    """

    size: int
    labels: tuple[str, ...]
    equations: tuple[str, ...]
    out: dict[int, str]

    def blocks(self, rows: FloatArray) -> FloatArray:
        """Residuals of blocks of rows, still in units of noise."""
        if self.size == 1:
            return rows
        starts = np.arange(0, len(rows), self.size)
        sizes = np.diff(np.append(starts, len(rows)))
        sums: FloatArray = np.add.reduceat(rows, starts, axis=0)
        found: FloatArray = sums / np.sqrt(sizes)[:, None]
        return found

    @property
    def x_words(self) -> str:
        """What is counted along x."""
        if self.size == 1:
            return "pose, in the order of the readings"
        return f"block of {self.size} rows of the recording"


def dots_of(result: ResultShape, evidence: Evidence | None) -> Dots | None:
    """What the dots are; None where no residual is known."""
    rows = result.after_residuals
    if rows is None or not rows.size:
        return None
    n, k = rows.shape
    size = -(-n // MOST_DOTS)
    held = evidence is not None and len(evidence.poses) == n
    labels = [str(label) for label in evidence.poses] if evidence and held else []
    if not labels:
        labels = [str(first + 1) for first in range(0, n, size)]
    word = "pose" if held or size == 1 else "row"
    equations = evidence.equations if evidence and len(evidence.equations) == k else ()
    equations = equations or tuple(f"equation {e + 1}" for e in range(k))
    out = {}
    for entry in result.excluded:
        if size == 1 and entry.sample is None and entry.pose is not None:
            where = [i for i, label in enumerate(labels) if label == str(entry.pose)]
            if len(where) == 1:
                at = f", {entry.channel}" if entry.channel else ""
                out[where[0]] = f"{word} {entry.pose}{at}"
    return Dots(size, tuple(f"{word} {label}" for label in labels), tuple(equations), out)


def residual_figure(result: ResultShape, evidence: Evidence | None = None) -> Figure | None:
    """Draw the residual of every pose in units of noise, before and after; None if not known."""
    dots = dots_of(result, evidence)
    if dots is None or result.after_residuals is None:
        return None
    panels = [
        (title, dots.blocks(rows))
        for title, rows in (("before", result.before_residuals), ("after", result.after_residuals))
        if rows is not None and rows.size
    ]
    if isinstance(result, TraceShape) and not (result.steps or result.excluded):
        panels = panels[-1:]  # nothing has changed
    if len(panels) == 1:
        panels = [("every closure of every pose", panels[0][1])]
    what = "one closure of one pose" if dots.size == 1 else f"one closure over {dots.size} rows"
    caption = (
        f"Each dot is the residual of {what}. Inside the band of ± 2 σ lie 95 % of the dots if "
        "nothing is missing; structure outside it is what the model lacks."
    )
    if len(set(_scales([rows for _, rows in panels], dots))) > 1:
        caption += " The panels have scales of their own."
    if dots.out:
        caption += " Rings are readings that were left out."
    return Figure("residuals", lambda width: draw_residuals(panels, dots, width), caption)


def draw_residuals(
    panels: Sequence[tuple[str, FloatArray]],
    dots: Dots,
    width: float,
    *,
    numbered: bool = False,
    at_least: float = 3.5,
) -> str:
    """Draw residuals in units of noise, one panel below the other.

    Parameters
    ----------
    panels : sequence of (str, ndarray)
        Title, and residuals, shape (poses or blocks, equations).
    dots : Dots
        What the dots are.
    width : float
        Width of the view box.
    numbered : bool
        Whether dots carry their number, for a script that moves them.
    at_least : float
        Residual that every panel has room for.

    Returns
    -------
    str
        An `<svg>` element.
    """
    scales = [max(s, at_least) for s in _scales([rows for _, rows in panels], dots)]
    count = max(len(rows) for _, rows in panels)
    canvas = Canvas(width, HEIGHT * len(panels))
    for place, ((title, rows), bound) in enumerate(zip(panels, scales, strict=True)):
        chart = Chart.on(
            canvas,
            (0.0, count + 1.0),
            (-bound, bound),
            (dots.x_words if place + 1 == len(panels) else "", "residual / noise"),
            title=title,
            top=place * HEIGHT,
            height=HEIGHT,
        )
        if numbered:
            canvas.parts.append(
                f'<g class="scale" data-zero="{chart.y(0.0):.2f}" '
                f'data-unit="{chart.y(1.0) - chart.y(0.0):.4f}" data-bound="{bound:.3f}"></g>'
            )
        chart.band(-2.0, 2.0)
        radius = 3.0 if count <= 120 and width == WIDE else 2.0
        far = {} if numbered else _far(rows, dots)
        plain: list[tuple[float, float]] = []
        for pose, row in enumerate(rows):
            for e, value in enumerate(row):
                if not np.isfinite(value):
                    continue
                kind = "dot out" if pose in dots.out else "dot"
                said = f"{dots.labels[pose]}, {dots.equations[e]}: {value:.2f}"
                x, y = chart.at((pose + 1, min(max(value, -bound), bound)))
                kind = f"{kind} far" if abs(value) > FAR else kind
                number = {"p": pose} if dots.size == 1 else {}
                number |= {"k": pose * len(row) + e} if numbered else {}
                # No pointer rests on a phone.
                if kind == "dot" and not number and width != WIDE:
                    plain.append((x, y))
                else:
                    canvas.dot(x, y, radius, kind, said, **number)
        canvas.dots(plain, radius)
        _label(chart, rows, far, bound)
    return canvas.svg("residuals in units of noise, before and after")


def _label(chart: Chart, rows: FloatArray, far: dict[tuple[int, int], str], bound: float) -> None:
    """Write what the worst dots are, where fewest others lie: never over one another, nor below the
    axis; a thin line leads to a dot that its label does not stand beside.
    """
    taken: list[tuple[float, float, float]] = []
    width = chart.canvas.width
    clipped = np.clip(np.nan_to_num(rows), -bound, bound).tolist()
    dots = [chart.at((pose + 1, value)) for pose, row in enumerate(clipped) for value in row]
    across, up = np.array(dots).T
    named = [pose * rows.shape[1] + e for pose, e in far]
    for (pose, e), words in far.items():
        value = float(rows[pose][e])
        x, y = chart.at((pose + 1, min(max(value, -bound), bound)))
        words += f" ({value:.0f} σ)" if abs(value) > bound else ""
        long = width_of(words, bold=True)
        found = []
        for step in (0.0, -LINE, LINE, -2 * LINE, 2 * LINE):
            for low in (x + 6.0, x - 6.0 - long):
                at, high = y + step, low + long
                free = all(abs(at - v) >= LINE or high < a or low > b for a, b, v in taken)
                inside = chart.y.end - 8.0 <= at <= chart.y.start - 4.0
                if free and inside and low >= chart.x.start and high <= width:
                    under = (abs(up - at) < LINE / 2) & (across > low - 3.0) & (across < high + 3.0)
                    hides = bool(under[named].any())
                    found.append((hides, int(under.sum()) + abs(step) / LINE, low, at))
        if found:
            *_, low, at = min(found)
            taken.append((low, low + long, at))
            if at != y:
                chart.canvas.line(x, y, low if low > x else low + long, at, "leader")
            chart.canvas.text(low, at + 4.0, words, kind="culprit")


LINE = 13.0
"""Height of a line of labels."""

ONE_SCALE = 6.0
"""Panels whose largest residuals differ by more than this factor have scales of their own."""


def _scales(panels: Sequence[FloatArray], dots: Dots) -> list[float]:
    """Largest residual that each panel shows: of what was used, not of what was left out."""
    used = [np.delete(rows, list(dots.out), axis=0) for rows in panels]
    found = [max(3.5, 1.12 * float(np.nanmax(np.abs(rows)))) if rows.size else 3.5 for rows in used]
    if max(found) <= ONE_SCALE * min(found):
        return [max(found)] * len(found)
    return found


def _far(rows: FloatArray, dots: Dots) -> dict[tuple[int, int], str]:
    """The worst dots of a panel, one to a pose, and what was left out, with their labels."""
    worst = np.argmax(np.abs(np.nan_to_num(rows)), axis=1)
    sizes = np.abs(np.nan_to_num(rows))[np.arange(len(rows)), worst]
    found = {}
    # Beside a wrong reading the others are off for its sake.
    blamed = [pose for pose in dots.out if sizes[pose] > FAR]
    order = np.argsort(-sizes).tolist()
    for pose in sorted(order[:LABELLED] + list(dots.out)[:LABELLED], key=order.index):
        e = int(worst[pose])
        if pose in dots.out:
            found[pose, e] = f"{dots.out[pose]} · left out"
        elif sizes[pose] > FAR and not blamed:
            found[pose, e] = f"{dots.labels[pose]} · {dots.equations[e]}"
    return found


def normal_figure(result: ResultShape) -> Figure | None:
    """Draw the residuals in order of size against those of the normal distribution."""
    rows = result.after_residuals
    if rows is None or rows.size < 8:
        return None
    used = np.isfinite(rows) & (rows != 0.0)
    order = np.argsort(rows[used])
    values, own = rows[used][order], np.nonzero(used)[0][order]
    if len(values) < 8:
        return None
    single = len(rows) <= MOST_DOTS
    shares = (np.arange(len(values)) + 0.5) / len(values)
    some = np.unique(np.linspace(0, len(values) - 1, min(len(values), MOST_DOTS)).astype(int))
    quantile = NormalDist().inv_cdf
    points = [(quantile(float(shares[i])), float(values[i])) for i in some]
    poses = [int(own[i]) for i in some]

    def draw(width: float) -> str:
        canvas = Canvas(width, 240.0)
        x, y = bounds(p[0] for p in points), bounds(p[1] for p in points)
        words = ("expected of normal noise", "residual / noise")
        chart = Chart.on(canvas, x, y, words, height=240.0)
        low, high = max(x[0], y[0]), min(x[1], y[1])
        chart.curve([(low, low), (high, high)], "law")
        if single:
            for point, pose in zip(points, poses, strict=True):
                canvas.dot(*chart.at(point), 2.2, p=pose)
        else:
            canvas.dots(map(chart.at, points), 2.2)
        return canvas.svg("normal probability plot of the residuals")

    return Figure(
        "normal",
        draw,
        "Residuals in order of size. On the line they are normal noise of the size assumed; ends "
        "that bend away are outliers, another slope is another size of the noise.",
    )
