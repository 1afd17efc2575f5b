"""Figures of the mechanism: its poses with their residuals, and how well it is known where."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

from rsicalib.arrays import FloatArray
from rsicalib.report.figure import Figure
from rsicalib.report.residuals import Dots
from rsicalib.report.svg import LETTER, WIDE, Axis, Canvas, Chart
from rsicalib.report.words import listed_words, number, parameter_name, subject
from rsicalib.shapes import Drawing, Evidence, ResultShape, Slice, TraceShape, Weakest

__all__ = ["mechanism_figure", "workspace_figure"]

GHOSTS = 40
"""Most poses whose whole mechanism is drawn."""

LEVELS = 5
"""Shades of a map."""

AZIMUTH, ELEVATION = math.radians(35.0), math.radians(20.0)

LONGEST = 0.07
"""Length of the longest line of uncertainty, of the width of the drawing."""


def _culprits(result: ResultShape, drawing: Drawing) -> tuple[set[str], set[str], str]:
    """Joints and chains at fault, and what is wrong with them."""
    found = {f"wrong reading of {e.channel}": e.channel for e in result.excluded if e.channel}
    if isinstance(result, TraceShape):
        found |= {subject(step): step.target for step in result.steps}
    joints = {node.name for node in drawing.nodes if node.joint}
    chains = {node.chain for node in drawing.nodes}
    part = {words: at.partition("/")[0] for words, at in found.items()}
    words = [words for words, at in part.items() if at in joints | chains]
    return joints & set(part.values()), chains & set(part.values()), ", ".join(words)


def mechanism_figure(result: ResultShape, evidence: Evidence, dots: Dots | None) -> Figure | None:
    """Draw the mechanism in its poses, coloured by the residual; None where nothing is carried."""
    drawing = evidence.drawing
    if drawing is None or not drawing.at:
        return None
    nodes = np.array(drawing.at, dtype=np.float64).reshape(len(drawing.at), -1, 3)
    places, weakest = np.array(drawing.places), np.array(drawing.weakest)
    if not (np.isfinite(nodes).all() and np.isfinite(places).all()):
        return None
    sizes = _rms_of_poses(result, drawing)
    longest = float(np.linalg.norm(weakest, axis=1).max())
    span = float(np.ptp(nodes.reshape(-1, 3), axis=0).max()) or 1.0
    times = LONGEST * span / longest if longest > 0.0 else 0.0
    joints, chains, wrong = _culprits(result, drawing)

    def draw(width: float) -> str:
        views = [("from the side", _side)] + [("from above", _above)] * (width == WIDE)
        canvas = Canvas(width, 330.0)
        for k, (title, view) in enumerate(views):
            room = width / len(views)
            flat, where = view(nodes), view(places)
            ends = view(places + times * weakest), view(places - times * weakest)
            x, y = _fit(flat.reshape(-1, 2), room * k, room)
            canvas.text(room * k + 4.0, 13.0, title, kind="title")
            at = [[(x(u), y(v)) for u, v in pose] for pose in flat]
            stride = -(-len(at) // GHOSTS)
            for ghost in at[::stride]:
                for a, b in drawing.edges:
                    canvas.line(*ghost[a], *ghost[b], "ghost")
            usual = int(np.argmin(np.linalg.norm(places - np.median(places, axis=0), axis=1)))
            for a, b in drawing.edges:
                own = {drawing.nodes[a].chain, drawing.nodes[b].chain}
                kind = "body culprit" if len(own) == 1 and own <= chains else "body"
                canvas.line(*at[usual][a], *at[usual][b], kind)
            for (u, v), (ahead, behind), pose, size in zip(
                where, zip(*ends, strict=True), drawing.poses, sizes, strict=True
            ):
                canvas.line(*(x(ahead[0]), y(ahead[1])), *(x(behind[0]), y(behind[1])), "weak")
                name = dots.labels[pose] if dots and pose < len(dots.labels) else f"pose {pose + 1}"
                said = f"{name}: residual {size:.1f} σ"
                canvas.dot(x(u), y(v), 3.4, f"heat{_heat(size)}", said, p=pose)
            nodes_at = list(zip(drawing.nodes, at[usual], strict=True))
            # Joints that meet in a point must not hide the one at fault.
            for node, place in sorted(nodes_at, key=lambda pair: pair[0].name in joints):
                culprit = node.name in joints and node.joint
                if node.joint:
                    canvas.dot(
                        *place, 5.0 if culprit else 2.6, "joint culprit" if culprit else "joint"
                    )
                if culprit:
                    canvas.text(place[0] + 8.0, place[1] + 4.0, node.name, kind="culprit")
        y0 = 322.0
        for k, (x0, words) in enumerate(
            ((12.0, "below 1.5 σ"), (108.0, "to 3 σ"), (172.0, "above"))
        ):
            canvas.dot(x0, y0 - 4.0, 3.4, f"heat{k}")
            canvas.text(x0 + 8.0, y0, words)
        return canvas.svg("the mechanism in its poses")

    caption = (
        "The mechanism in its poses; a dot is where the platform (or the carried point) was, "
        "coloured by the residual of the pose after the calibration. "
    )
    if times > 0.0:
        caption += (
            "The line through it is the direction in which the parameters leave it most uncertain, "
            f"one standard deviation drawn {number(times, 2)} times too long: the longest is "
            f"{number(longest, 2)} {result.length_unit}. "
        )
    if wrong:
        caption += f"What is marked is at fault: {wrong}."
    return Figure("mechanism", draw, caption.strip())


def _rms_of_poses(result: ResultShape, drawing: Drawing) -> list[float]:
    rows = result.after_residuals
    if rows is None or not len(rows):
        return [0.0] * len(drawing.poses)
    size = np.sqrt(np.nanmean(rows**2, axis=1))
    return [float(size[p]) if p < len(size) else 0.0 for p in drawing.poses]


def _heat(size: float) -> int:
    return int(size > 1.5) + int(size > 3.0)


def _side(points: FloatArray) -> FloatArray:
    """Axonometric view: coordinates to the right and up."""
    x, y, z = points[..., 0], points[..., 1], points[..., 2]
    right = -math.sin(AZIMUTH) * x + math.cos(AZIMUTH) * y
    depth = math.cos(AZIMUTH) * x + math.sin(AZIMUTH) * y
    up = math.cos(ELEVATION) * z - math.sin(ELEVATION) * depth
    return np.stack([right, up], axis=-1)


def _above(points: FloatArray) -> FloatArray:
    """View from above: x to the right, y up."""
    return np.stack([points[..., 0], points[..., 1]], axis=-1)


def _fit(points: FloatArray, left: float, room: float) -> tuple[Axis, Axis]:
    """Axes of one scale that fit all points."""
    low, high = points.min(axis=0), points.max(axis=0)
    middle = (low + high) / 2
    scale = min((room - 30.0) / ((high - low)[0] or 1.0), 270.0 / ((high - low)[1] or 1.0))
    cx, cy = left + room / 2, 162.0
    u, v = float(middle[0]), float(middle[1])
    return (
        Axis(u - 1.0, u + 1.0, cx - scale, cx + scale),
        Axis(v - 1.0, v + 1.0, cy + scale, cy - scale),
    )


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
