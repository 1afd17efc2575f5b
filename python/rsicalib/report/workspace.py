"""Figure of the workspace: how well the calibration places what is carried, where."""

from __future__ import annotations

import math
from collections.abc import Sequence

from rsicalib.facts.shapes import Evidence, ResultShape, Slice, Weakest
from rsicalib.report.figure import Figure
from rsicalib.report.svg import LETTER, WIDE, Canvas, Chart
from rsicalib.report.words import listed_words, number, parameter_name

__all__ = ["workspace_figure"]

LEVELS = 5
"""Shades of a map."""


def workspace_figure(result: ResultShape, evidence: Evidence) -> Figure | None:
    """Draw where what is carried can be, coloured by how well the calibration places it there."""
    slices, unit = evidence.workspace, result.length_unit
    values = [cell[2] for one in slices for cell in one.cells if math.isfinite(cell[2])]
    if not values:
        return None
    low, high = min(values), max(values)

    def level(sd: float) -> int:
        return min(int(LEVELS * (sd - low) / (high - low or 1.0)), LEVELS - 1)

    def draw(width: float) -> str:
        across = min(len(slices), 2) if width == WIDE else 1
        room = width / across
        height = 250.0
        canvas = Canvas(width, height * -(-len(slices) // across) + 26.0)
        for k, one in enumerate(slices):
            part = Canvas(room, 0.0)
            x = _edges([c[0] for c in one.cells], one.step[0])
            y = _edges([c[1] for c in one.cells], one.step[1])
            words = f"{one.axes[0]} [{unit}]", f"{one.axes[1]} [{unit}]"
            chart = Chart.on(part, x, y, words, title=_side_words(one, unit), height=height)
            for u, v, sd in one.cells:
                if not math.isfinite(sd):
                    continue
                left, top = chart.at((u - one.step[0] / 2, v + one.step[1] / 2))
                right, bottom = chart.at((u + one.step[0] / 2, v - one.step[1] / 2))
                said = f"{one.axes[0]} {number(u)}, {one.axes[1]} {number(v)}: {number(sd)} {unit}"
                kind = f"level{level(sd)}"
                part.rect(left, top, right - left + 0.3, bottom - top + 0.3, kind, said)
            column, row = k % across, k // across
            move = f"translate({room * column:.1f} {height * row:.1f})"
            canvas.parts.append(f'<g transform="{move}">{"".join(part.parts)}</g>')
        # A scale of colours between the lowest and the highest.
        base, first = canvas.height - 18.0, 12.0 + LETTER * len(number(low, 2))
        canvas.text(first - 5.0, base + 10.0, number(low, 2), anchor="end")
        for k in range(LEVELS):
            canvas.rect(first + 30.0 * k, base, 30.3, 11.0, f"level{k}")
        canvas.text(first + 30.0 * LEVELS + 5.0, base + 10.0, f"{number(high, 2)} {unit}")
        return canvas.svg("standard deviation of what is carried, over the workspace")

    names = list(dict.fromkeys(one.of for one in slices if one.of is not None))
    what = listed_words(names) if names else "the platform"
    caption = (
        f"How well the calibration places {what}: standard deviation of a coordinate, noise of a "
        f"reading not counted, from {number(low, 2)} to {number(high, 2)} {unit}"
    )
    if slices[0].value is not None and not names:
        caption += " at orientation zero. "
    else:
        caption += (
            ", wherever the limits of the joints allow; a cell is the mean over all postures that "
            "reach it. "
        )
    caption += "Strong colours are where poses are lacking. "
    if evidence.weakest is not None:
        caption += _weakest_words(evidence.weakest, unit)
    if result.unobservable:
        caption += " What the readings do not determine at all is not in it."
    return Figure("workspace", draw, caption.strip())


def _side_words(one: Slice, unit: str) -> str:
    """What a panel shows: `z = 1.2 in`, `ball, all z`."""
    at = f"all {one.fixed}" if one.value is None else f"{one.fixed} = {number(one.value)} {unit}"
    return at if one.of is None else f"{one.of}, {at}"


def _weakest_words(weakest: Weakest, unit: str) -> str:
    """Where it is known least, in which direction, and what that goes with."""
    largest = max(map(abs, weakest.place)) or 1.0
    digits = max(0, 2 - math.floor(math.log10(largest)))
    place = ", ".join(f"{v:z.{digits}f}" for v in weakest.place)
    size = math.hypot(*weakest.along)
    along = ", ".join(f"{v / size:z.1f}" for v in weakest.along)
    p = weakest.parameter
    name = parameter_name(p.term, p.name)
    of = "" if weakest.of is None else f"{weakest.of} "
    return (
        f"Least known is {of}at ({place}), by {number(size, 2)} {unit} along ({along}): an error "
        f"there goes with {name} of {p.target} (correlation {weakest.correlation:.2f})."
    )


def _edges(values: Sequence[float], step: float) -> tuple[float, float]:
    return min(values) - step / 2, max(values) + step / 2
