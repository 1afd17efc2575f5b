"""The mechanism in the room, in all its poses: where it errs before, and what is left after.

Drawn from one side here; `turn.js` draws the same again from any side.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable
from html import escape
from typing import TypeAlias

import numpy as np

from rsicalib.arrays import FloatArray
from rsicalib.facts.shapes import Evidence, ResultShape, TraceShape
from rsicalib.report.figure import Figure, data_element
from rsicalib.report.residuals import Dots
from rsicalib.report.scene import ABOVE, VIEW, Scene, rounded, scene_of, seen
from rsicalib.report.svg import WIDE, Canvas, width_of
from rsicalib.report.words import number

HEIGHT = {True: 500.0, False: 380.0}
"""Height of the drawing on a desk, and on a phone."""

FOOT = {True: 60.0, False: 84.0}
"""Of that, below the mechanism, for the legend."""

LINE = 14.0
"""Height of a name."""

BAR = 0.3
"""Length of a scale at most, of the width."""


Flat: TypeAlias = Callable[[FloatArray], FloatArray]
"""Points of the room as pixels."""


def mechanism_figure(result: ResultShape, evidence: Evidence, dots: Dots | None) -> Figure | None:
    """Draw the mechanism in its poses, its error before, and what is left after."""
    scene = scene_of(result, evidence)
    if scene is None:
        return None
    unit = result.length_unit
    labels = [
        dots.labels[pose] if dots and pose < len(dots.labels) else f"pose {pose + 1}"
        for pose in scene.drawing.poses
    ]

    def draw(width: float) -> str:
        return _draw(scene, labels, width, unit)

    return Figure("mechanism", draw, _caption(result, scene), _turning(scene))


def _turning(scene: Scene) -> str:
    """The data of the script, and the buttons, which it shows."""
    views = {"from the side": VIEW, "from above": ABOVE}
    buttons = "".join(
        f'<button type="button" data-azimuth="{a:.4f}" data-elevation="{e:.4f}">'
        f"{escape(name)}</button>"
        for name, (a, e) in views.items()
    )
    if scene.cells is not None:
        pressed = "false" if scene.found else "true"
        buttons += (
            f'<button type="button" data-layer="cells" aria-pressed="{pressed}">'
            "how well, over the workspace</button>"
        )
    return (
        f'<div class="views" hidden>{buttons}<span class="faint">Drag, or use the arrow keys, '
        f"to turn it.</span></div>{data_element('mechanism-data', scene.data())}"
    )


def _draw(scene: Scene, labels: list[str], width: float, unit: str) -> str:
    wide = width == WIDE
    height = HEIGHT[wide]
    room = height - FOOT[wide]
    canvas = Canvas(width, height)
    scale = scene.scale(width, room, scene.view[1])
    middle = (width / 2, room / 2)

    def flat(points: FloatArray) -> FloatArray:
        at = scale * seen(points - scene.centre, *scene.view)
        return np.stack([middle[0] + at[..., 0], middle[1] - at[..., 1]], axis=-1)

    canvas.parts.append(f'<g class="scene" data-x="{middle[0]:.1f}" data-y="{middle[1]:.1f}"></g>')
    _room(canvas, scene, flat)
    ghosts, body = flat(scene.nodes[:: scene.ghosts]), flat(scene.nodes[scene.usual])
    _path(canvas, "ghosts", [g[list(e)] for g in ghosts for e in scene.drawing.edges])
    _path(canvas, "body halo", [body[list(e)] for e in scene.drawing.edges])
    if scene.plate:
        corners = "L".join(f"{x:.1f} {y:.1f}" for x, y in body[scene.plate])
        canvas.parts.append(f'<path class="plate" data-is="plate" d="M{corners}Z"/>')
    _path(canvas, "body", [body[list(e)] for e in scene.edges(culprit=False)])
    _path(canvas, "body culprit", [body[list(e)] for e in scene.edges(culprit=True)])
    _errors(canvas, scene, labels, flat)
    _joints(canvas, scene, body)
    _legend(canvas, scene, scene.largest(width, room), scale, unit)
    return canvas.svg("the mechanism in its poses, with its error before and after")


def _room(canvas: Canvas, scene: Scene, flat: Flat) -> None:
    """The floor, its axes, and how well the calibration places what is carried."""
    _path(canvas, "floor", [flat(line) for line in scene.floor])
    for name, at in scene.axes.items():
        x, y = flat(at)
        canvas.parts.append(
            f'<text class="axis-name" data-axis="{name}" x="{x:.1f}" y="{y + 4:.1f}" '
            f'text-anchor="middle">{name}</text>'
        )
    if scene.cells is None:
        return
    corners = flat(scene.cells.corners(float(scene.centre[2]) - scene.tall))
    shades = sorted(set(scene.cells.shades))
    hidden = ' display="none"' if scene.found else ""
    canvas.parts.append(f'<g class="cells"{hidden}>')
    for shade in shades:
        own = [c for c, s in zip(corners, scene.cells.shades, strict=True) if s == shade]
        where = "".join("M" + "L".join(f"{x:.1f} {y:.1f}" for x, y in c) + "Z" for c in own)
        canvas.parts.append(f'<path class="sd{shade}" d="{where}"/>')
    canvas.parts.append("</g>")


def _errors(canvas: Canvas, scene: Scene, labels: list[str], flat: Flat) -> None:
    """A dot for each pose, its error before and after, and known poses with theirs."""
    where, times = flat(scene.places), scene.times
    for (x, y), pose, size, name in zip(
        where, scene.drawing.poses, scene.sizes, labels, strict=True
    ):
        heat = int(size > 1.5) + int(size > 3.0)
        canvas.dot(x, y, 2.8, f"heat{heat}", f"{name}: residual {size:.1f} σ", p=pose)
    few = slice(None, None, scene.stride)
    _arrows(canvas, "before", where[few], flat(scene.places + times * scene.before)[few])
    ends = (flat(scene.places + s * times * scene.sd)[few] for s in (1.0, -1.0))
    _arrows(canvas, "chosen", where[:0], where[:0])
    _path(canvas, "weak", [np.array(pair) for pair in zip(*ends, strict=True)])
    known, off = flat(scene.known[:, 0]), scene.known[:, :1] + times * scene.known[:, 1:]
    _arrows(canvas, "before known", known, flat(off[:, 0]))
    _arrows(canvas, "after known", known, flat(off[:, 1]))
    for k, (x, y) in enumerate(known):
        canvas.dot(x, y, 3.2, "check", f"check pose {k + 1}", c=k)


def _joints(canvas: Canvas, scene: Scene, body: FloatArray) -> None:
    """Joints, and what is at fault with its name."""
    nodes_at = list(zip(scene.drawing.nodes, body, range(len(body)), strict=True))
    faults = scene.faults.nodes
    # Joints that meet in a point must not hide the one at fault.
    for node, (x, y), k in sorted(nodes_at, key=lambda entry: entry[2] in faults):
        culprit = faults.get(k) == node.name
        if node.joint or culprit:
            kind = "joint culprit" if culprit else "joint"
            canvas.dot(x, y, 6.0 if culprit else 2.6, kind, n=k)
    taken: list[tuple[float, float, float]] = []
    for k in sorted(faults):
        x, y, right = _beside(canvas.width, body[k], width_of(faults[k], bold=True), taken)
        canvas.parts.append(
            f'<text class="culprit" data-n="{k}" x="{x:.1f}" y="{y:.1f}" '
            f'text-anchor="{"start" if right else "end"}">{escape(faults[k])}</text>'
        )


def _beside(
    width: float, at: FloatArray, long: float, taken: list[tuple[float, float, float]]
) -> tuple[float, float, bool]:
    """Where a name stands: on the outer side of what it names, where it has no room there above it
    on the inner side; below names that are there.
    """
    x, y = float(at[0]), float(at[1]) + 4.0
    fits = x + 10.0 + long < width if x > width / 2 else x - 10.0 - long >= 0.0
    right = fits == (x > width / 2)
    y -= 0.0 if fits else LINE
    low = x + 10.0 if right else x - 10.0 - long
    for start, end, other in sorted(taken, key=lambda box: box[2]):
        if low < end and start < low + long and abs(y - other) < LINE:
            y = other + LINE
    taken.append((low, low + long, y))
    return (low if right else low + long), y, right


def _path(canvas: Canvas, kind: str, lines: Iterable[FloatArray]) -> None:
    """Straight lines as one path, so that a script can turn them at once."""
    where = "".join(f"M{a[0]:.1f} {a[1]:.1f}L{b[0]:.1f} {b[1]:.1f}" for a, b in lines)
    canvas.parts.append(f'<path class="{kind}" data-is="{kind.split()[-1]}" d="{where}"/>')


HEAD = 5.0
"""Length of the head of an arrow [px]; a shorter arrow has none."""


def _arrows(canvas: Canvas, kind: str, starts: FloatArray, ends: FloatArray) -> None:
    parts = []
    for a, b in zip(starts, ends, strict=True):
        parts.append(f"M{a[0]:.1f} {a[1]:.1f}L{b[0]:.1f} {b[1]:.1f}")
        long = float(np.hypot(*(b - a)))
        if long > HEAD:
            along = HEAD * (b - a) / long
            side = 0.5 * np.array([-along[1], along[0]])
            left, right = b - along + side, b - along - side
            parts.append(
                f"M{left[0]:.1f} {left[1]:.1f}L{b[0]:.1f} {b[1]:.1f}L{right[0]:.1f} {right[1]:.1f}"
            )
    name = "-".join(reversed(kind.split()))
    canvas.parts.append(f'<path class="arrow {kind}" data-is="{name}" d="{"".join(parts)}"/>')


def _legend(canvas: Canvas, scene: Scene, largest: float, scale: float, unit: str) -> None:
    """What lines and dots are, and two scales: of the mechanism, and of its errors."""
    wide = canvas.width == WIDE
    entries = [("arrow before", "error before")] if scene.before.any() else []
    after = " after" * scene.found  # nothing has changed else
    entries += [("weak", f"1 sd{after}")] if scene.sd.any() else []
    entries += [("arrow after", f"error{after}"), ("check", "check pose")] * bool(len(scene.known))
    across = len(entries) if wide else 2
    step = (canvas.width - 12.0) / max(across, 1)
    base = canvas.height - 46.0 - (0.0 if wide or len(entries) < 3 else 18.0)
    for k, (kind, words) in enumerate(entries):
        x, y = 12.0 + step * (k % across), base + 18.0 * (k // across)
        if kind == "check":
            canvas.dot(x + 10.0, y - 4.0, 3.0, kind)
        else:
            canvas.line(x, y - 4.0, x + 20.0, y - 4.0, kind)
        canvas.text(x + 26.0, y, words)
    half, y = canvas.width / 2, canvas.height - 12.0
    for x, times in ((12.0, 1.0), (half, scene.times)):
        if not times > 0.0:
            continue
        length = rounded(BAR * canvas.width / largest / times)
        long = length * times
        canvas.parts.append(
            f'<path class="axis" data-bar="{long:.6g}" data-x="{x:.1f}" data-y="{y:.1f}" '
            f'd="M{x:.1f} {y - 3:.1f}v6m0 -3h{long * scale:.1f}m0 -3v6"/>'
        )
        canvas.text(x, y - 7.0, f"{length:g} {unit}" + (" of error" if x == half else ""))


def _caption(result: ResultShape, scene: Scene) -> str:
    unit, wrong = result.length_unit, scene.faults.words
    out = "Every pose is a ghost of the mechanism"
    out += f" on a floor of squares of {scene.square:g} {unit}. "
    if scene.times > 0.0:
        times = f"{scene.times:,.0f}" if scene.times >= 1.0 else number(scene.times)
        out += f"Errors are drawn {times} times too long. "
        out = out if scene.times != 1.0 else out.replace("1 times too long", "as long as they are")
    if scene.before.any():
        worst = number(float(np.linalg.norm(scene.before, axis=1).max()), 2)
        out += (
            "An arrow is how far the position is off without what was found, against the "
            f"calibration: up to {worst} {unit}. "
        )
        if scene.stride > 1:
            out += f"One pose of {scene.stride} has its arrow. "
    if scene.sd.any():
        worst = number(float(np.linalg.norm(scene.sd, axis=1).max()), 2)
        out += (
            "The line through a dot is what the calibration leaves open, one standard deviation "
            f"along the worst direction: up to {worst} {unit}. "
        )
    if len(scene.known):
        both = " before and after" * scene.found
        out += f"Rings are check poses, with their measured error{both}. "
    if scene.cells is not None:
        low, high = (number(end, 2) for end in scene.cells.ends)
        where = "is coloured" if not scene.found else "can be coloured"
        out += (
            f"A plane {where} by how well the position is known over the workspace: to between "
            f"{low} and {high} {unit}, one standard deviation. "
        )
    if isinstance(result, TraceShape) and not all(step.applied for step in result.steps):
        out += "After is with what was found, which is not applied to positions. "
    if not scene.found and scene.apart.any():
        worst = number(float(np.linalg.norm(scene.apart, axis=1).max()), 2)
        out += f"As it is declared, positions would be off by up to {worst} {unit}. "
    out += "A dot is coloured by the residual of its pose: blue to 1.5 σ, yellow to 3 σ, red above."
    return f"{out} What is marked is at fault: {wrong}." if wrong else out
