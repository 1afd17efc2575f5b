"""Figure of the workspace: how well the calibration places what is carried, where."""

from __future__ import annotations

import math
from bisect import bisect_right
from collections.abc import Sequence

from rsicalib.facts.shapes import Evidence, ResultShape, Slice, Weakest
from rsicalib.report.figure import Figure
from rsicalib.report.svg import WIDE, Canvas, Chart, width_of
from rsicalib.report.words import listed_words, number, parameter_name, percent, target_words

FINEST = 1e-5
"""Where the scale of colours begins, as a share of the workspace's width."""

ROUND = (1.0, 1.5, 2.0, 3.0, 5.0, 7.0)
"""Where a shade ends in each power of ten: steps of about a half."""

SHADES = 31
"""Five powers of ten, and what is beyond: as many as the style has colours."""


class Shades:
    """Colours of the maps: the same number has the same colour in every session of a mechanism.

    Parameters
    ----------
    slices : sequence of Slice
        The maps; their width is that of the workspace, which no session changes.
    """

    def __init__(self, slices: Sequence[Slice]) -> None:
        widths = [
            max(cell[axis] for cell in one.cells) - min(cell[axis] for cell in one.cells)
            for one in slices
            if one.cells
            for axis in (0, 1)
        ]
        first = 10.0 ** math.floor(math.log10(FINEST * (max(widths, default=0.0) or 1.0)))
        steps = (k for k in range(SHADES - 1))
        self.edges = [first * 10.0 ** (k // len(ROUND)) * ROUND[k % len(ROUND)] for k in steps]

    def of(self, sd: float) -> int:
        """The shade of a standard deviation."""
        return bisect_right(self.edges, sd)


def workspace_figure(
    result: ResultShape, evidence: Evidence, target: float | None = None
) -> Figure | None:
    """Draw where what is carried can be, coloured by how well the calibration places it there.

    A line bounds where it is within the target, if there is one [length unit].
    """
    slices, unit = evidence.workspace, result.length_unit
    values = [cell[2] for one in slices for cell in one.cells if math.isfinite(cell[2])]
    if not values:
        return None
    least, most, shades = min(values), max(values), Shades(slices)

    def draw(width: float) -> str:
        across = min(len(slices), 2) if width == WIDE else 1
        room = width / across
        height = 250.0
        canvas = Canvas(width, height * -(-len(slices) // across) + 36.0)
        number_of = 0
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
                kind = f"sd{shades.of(sd)}"
                wide, high = right - left + 0.3, bottom - top + 0.3
                part.rect(left, top, wide, high, kind, said, w=number_of)
                number_of += 1
            for start, end in _contour(one, target) if target is not None else ():
                part.line(*chart.at(start), *chart.at(end), "contour")
            column, row = k % across, k // across
            move = f"translate({room * column:.1f} {height * row:.1f})"
            canvas.parts.append(f'<g transform="{move}">{"".join(part.parts)}</g>')
        _scale(canvas, shades, shades.of(least), shades.of(most), unit)
        return canvas.svg("standard deviation of what is carried, over the workspace")

    names = list(dict.fromkeys(one.of for one in slices if one.of is not None))
    what = "the platform"
    if names:
        what = f"the point{'s' * (len(names) > 1)} {listed_words(names)}"
    caption = (
        f"How well the calibration places {what}: standard deviation of a coordinate, noise of a "
        f"reading not counted, from {number(least, 2)} to {number(most, 2)} {unit}"
    )
    if slices[0].value is not None and not names:
        caption += " at orientation zero. "
    else:
        caption += (
            ", wherever the limits of the joints allow; a cell is the mean over all postures that "
            "reach it. "
        )
    caption += (
        "The warmer a colour, the less well it is known; a colour stands for the same number in "
        "every report of this mechanism. "
    )
    if target is not None:
        share = sum(value <= target for value in values) / len(values)
        caption += _target_words(share, f"the target of {number(target)} {unit}")
    if evidence.weakest is not None:
        caption += _weakest_words(evidence.weakest, unit)
    if result.unobservable:
        caption += " What the readings do not determine at all is not in it."
    return Figure("workspace", draw, caption.strip())


def _target_words(share: float, target: str) -> str:
    """How much of what is drawn is within the target; a line is drawn where it is a part."""
    if share in (0.0, 1.0):
        return f"{'All' if share else 'Nothing'} of what is drawn is within {target}. "
    return f"The line bounds where it is within {target}: {percent(share)} of what is drawn. "


def _scale(canvas: Canvas, shades: Shades, first: int, last: int, unit: str) -> None:
    """The colours from the first to the last that occur, with the numbers between them."""
    edges, count = shades.edges, last - first + 1
    words = [f"{edge:.2g}" for edge in edges[max(first - 1, 0) : last + 1]]
    left = 12.0 + width_of(words[0]) / 2
    wide = min(44.0, (canvas.width - 2 * left - width_of(f"{unit} ")) / count)
    base = canvas.height - 30.0
    for k in range(count):
        canvas.rect(left + wide * k, base, wide + 0.3, 11.0, f"sd{first + k}")
    every = math.ceil((max(map(width_of, words)) + 7.0) / wide)
    # What is finer or coarser than the scale has no edge there.
    for k, text in enumerate(words[::every]):
        at = left + wide * (k * every + (first == 0))
        canvas.text(at, base + 24.0, text, anchor="middle")
    canvas.text(left + wide * count + 8.0, base + 10.0, unit)


def _contour(one: Slice, target: float) -> list[tuple[tuple[float, float], tuple[float, float]]]:
    """Sides of cells between what is within the target and what is not."""
    (wide, high), found = one.step, []
    first = min(c[0] for c in one.cells), min(c[1] for c in one.cells)
    at = {
        (round((u - first[0]) / wide), round((v - first[1]) / high)): (u, v, sd)
        for u, v, sd in one.cells
    }
    for (i, j), (u, v, sd) in at.items():
        x, y = u + wide / 2, v + high / 2
        sides = ((i + 1, j), (x, v - high / 2), (x, y)), ((i, j + 1), (u - wide / 2, y), (x, y))
        for beside, start, end in sides:
            if beside in at and (at[beside][2] <= target) != (sd <= target):
                found.append((start, end))
    return found


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
    what = f"{parameter_name(p.term, p.name)} of {target_words('', p.target)}"
    of = "" if weakest.of is None else f"{weakest.of} "
    return (
        f"Least known is {of}at ({place}), by {number(size, 2)} {unit} along ({along}): an error "
        f"there goes with {what} (correlation {weakest.correlation:.2f})."
    )


def _edges(values: Sequence[float], step: float) -> tuple[float, float]:
    return min(values) - step / 2, max(values) + step / 2
