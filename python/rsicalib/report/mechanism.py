"""The mechanism in space, in all its poses: where it errs before, and what is left after.

Drawn from one side here; `turn.js` draws the same again from any side.
"""

from __future__ import annotations

import math
from collections.abc import Iterable
from dataclasses import dataclass
from functools import cached_property
from html import escape
from typing import Any

import numpy as np

from rsicalib.arrays import FloatArray
from rsicalib.facts.shapes import Drawing, Evidence, ResultShape, TraceShape
from rsicalib.report.figure import Figure, data_element
from rsicalib.report.residuals import Dots
from rsicalib.report.svg import WIDE, Canvas
from rsicalib.report.words import number, subject, target_words

__all__ = ["Scene", "mechanism_figure", "scene_of"]

GHOSTS = 40
"""Most poses whose whole mechanism is drawn."""

ARROWS = 60
"""Most poses whose error is an arrow: more would hide one another."""

VIEW = math.radians(35.0), math.radians(20.0)
"""Azimuth and elevation from which it is seen at first."""

ABOVE = -math.pi / 2, math.pi / 2
"""From above, x to the right and y up: the first view of what lies in a plane."""

FLAT = 0.1
"""Height of what lies in a plane at most, of its width."""

LONGEST = 0.3
"""Length of the longest arrow at most, of the width of the mechanism."""

HEIGHT = {True: 500.0, False: 360.0}
"""Height of the drawing on a desk, and on a phone."""

RIGHT = 0.6
"""Share of the width from which on a name stands to the left of what it names."""

FOOT = 60.0
"""Of that, below the mechanism, for the legend."""


@dataclass(frozen=True)
class Faults:
    """What is at fault, in a drawing.

    Attributes
    ----------
    nodes : dict of int to str
        Numbers of nodes that are marked, and what stands beside them.
    edges : set of int
        Numbers of edges.
    words : str
        What is wrong with them.
    """

    nodes: dict[int, str]
    edges: set[int]
    words: str


@dataclass(frozen=True)
class Scene:
    """What is drawn, in base coordinates.

    Attributes
    ----------
    drawing : Drawing
        The mechanism in its poses.
    faults : Faults
        What is at fault.
    sizes : list of float
        Residual of each pose in units of noise.
    """

    drawing: Drawing
    faults: Faults
    sizes: list[float]

    @cached_property
    def nodes(self) -> FloatArray:
        """Joints and points: (poses, nodes, 3)."""
        found = np.array(self.drawing.at, dtype=np.float64)
        return found.reshape(len(found), -1, 3)

    @cached_property
    def places(self) -> FloatArray:
        """Positions of what is carried: (poses, 3)."""
        return np.array(self.drawing.places, dtype=np.float64).reshape(-1, 3)

    @cached_property
    def before(self) -> FloatArray:
        """How far off they are before: (poses, 3)."""
        found = np.array(self.drawing.before, dtype=np.float64).reshape(-1, 3)
        if found.shape != self.places.shape or not np.isfinite(found).all():
            return np.zeros_like(self.places)
        return found - self.places

    @cached_property
    def sd(self) -> FloatArray:
        """How uncertain they are after, along the worst direction: (poses, 3)."""
        return np.array(self.drawing.weakest, dtype=np.float64).reshape(-1, 3)

    @cached_property
    def known(self) -> FloatArray:
        """Known poses, and their error before and after: (known poses, 3, 3)."""
        rows = [(k.at, k.before, k.after) for k in self.drawing.known]
        found = np.array(rows, dtype=np.float64).reshape(-1, 3, 3)
        found[:, 1:] -= found[:, :1]
        return found[np.isfinite(found).all(axis=(1, 2))]

    @cached_property
    def span(self) -> float:
        """Width of all of it."""
        return float(np.ptp(self.nodes.reshape(-1, 3), axis=0).max()) or 1.0

    @cached_property
    def view(self) -> tuple[float, float]:
        """Azimuth and elevation from which it is seen at first."""
        flat = float(np.ptp(self.nodes[..., 2])) < FLAT * self.span
        return ABOVE if flat else VIEW

    @cached_property
    def longest(self) -> float:
        """The longest error."""
        rows = [self.before, self.sd, *self.known[:, 1:].transpose(1, 0, 2)]
        return max(float(np.linalg.norm(r, axis=-1).max(initial=0.0)) for r in rows)

    @cached_property
    def times(self) -> float:
        """By how much errors are magnified: 1, 2 or 5 times a power of ten."""
        if not self.longest > 0.0:
            return 0.0
        return _round(LONGEST * self.span / self.longest)

    @cached_property
    def stride(self) -> int:
        """Of so many poses one has its arrow."""
        return -(-len(self.places) // ARROWS) or 1

    @cached_property
    def usual(self) -> int:
        """The pose in the middle."""
        middle = np.median(self.places, axis=0)
        return int(np.argmin(np.linalg.norm(self.places - middle, axis=1)))

    def edges(self, *, culprit: bool) -> list[tuple[int, ...]]:
        """Pairs of nodes that are joined, by what is at fault or by others."""
        every = enumerate(self.drawing.edges)
        return [edge for k, edge in every if (k in self.faults.edges) == culprit]

    def data(self) -> dict[str, Any]:
        """What the script needs to draw it from another side."""
        digits = self.digits

        def rows(values: FloatArray) -> list[Any]:
            found: list[Any] = np.round(values, digits).tolist()
            return found

        stride = -(-len(self.nodes) // GHOSTS)
        return {
            "stride": self.stride,
            "right": RIGHT,
            "azimuth": self.view[0],
            "elevation": self.view[1],
            "centre": rows(self.centre),
            "ghosts": rows(self.nodes[::stride]),
            "usual": rows(self.nodes[self.usual]),
            "edges": self.edges(culprit=False),
            "culprits": self.edges(culprit=True),
            "all": self.drawing.edges,
            "joints": [k for k, node in enumerate(self.drawing.nodes) if node.joint],
            "places": rows(self.places),
            "before": (self.times * self.before).round(digits).tolist(),
            "sd": (self.times * self.sd).round(digits).tolist(),
            "known": rows(self.known[:, 0]),
            "known_before": (self.times * self.known[:, 1]).round(digits).tolist(),
            "known_after": (self.times * self.known[:, 2]).round(digits).tolist(),
        }

    @cached_property
    def digits(self) -> int:
        """Decimals of a coordinate: far below a pixel."""
        return max(0, 4 - math.floor(math.log10(self.span)))

    @cached_property
    def centre(self) -> FloatArray:
        """The middle of all of it."""
        points = self.nodes.reshape(-1, 3)
        middle: FloatArray = (points.min(axis=0) + points.max(axis=0)) / 2
        return middle

    def scale(self, width: float, height: float) -> float:
        """Pixels of a unit of length: nothing leaves the canvas, from wherever it is seen."""
        points = self.nodes.reshape(-1, 3) - self.centre
        flat = float(np.hypot(points[:, 0], points[:, 1]).max()) or 1e-9
        round_ = float(np.linalg.norm(points, axis=1).max()) or 1e-9
        return min((width - 16.0) / 2 / flat, (height - FOOT - 16.0) / 2 / round_)


def _round(value: float) -> float:
    """The nearest of 1, 2 and 5 times a power of ten below."""
    power = 10.0 ** math.floor(math.log10(value))
    return float(max(s for s in (1.0, 2.0, 5.0) if s * power <= value * (1.0 + 1e-9)) * power)


def seen(points: FloatArray, azimuth: float, elevation: float) -> FloatArray:
    """Coordinates to the right and up, seen from far away."""
    x, y, z = points[..., 0], points[..., 1], points[..., 2]
    right = -math.sin(azimuth) * x + math.cos(azimuth) * y
    depth = math.cos(azimuth) * x + math.sin(azimuth) * y
    up = math.cos(elevation) * z - math.sin(elevation) * depth
    return np.stack([right, up], axis=-1)


def _faults(result: ResultShape, drawing: Drawing) -> Faults:
    """Where what was found, and what was left out, sits in the drawing."""
    found = [(f"wrong reading of {e.channel}", e.channel) for e in result.excluded if e.channel]
    names = {channel: channel for _, channel in found}
    if isinstance(result, TraceShape):
        found += [(subject(step), step.target) for step in result.steps]
        left = None if result.unexplained is None else result.unexplained.target
        found += [(f"what is left, at {left}", left)] if left not in (None, "all") else []
        names |= {target: target_words("", target) for _, target in found}
    nodes: dict[int, str] = {}
    edges: set[int] = set()
    words = []
    for what, target in dict(found).items():
        at: set[int] = set()
        for part in target.split("+"):
            own = _nodes_of(part, drawing)
            nodes |= {k: drawing.nodes[k].name for k in own}
            joined = _edges_of(part, drawing)
            edges |= joined
            at |= own | joined
            if joined and not own:  # the highest of the bodies has its name at its first end
                first = (drawing.edges[k][0] for k in sorted(joined))
                nodes.setdefault(max(first, key=lambda k: drawing.at[0][3 * k + 2]), names[target])
        words += [what] * bool(at)
    return Faults(nodes, edges, ", ".join(words))


def _nodes_of(target: str, drawing: Drawing) -> set[int]:
    """Joints and points that a target names: by their name, or by their number in each chain."""
    nodes = list(enumerate(drawing.nodes))
    found = {k for k, node in nodes if node.name == target}
    if target == "each":
        found = {k for k, node in nodes if node.joint}
    elif target.startswith("each."):
        joints: dict[str, list[int]] = {}
        for k, node in nodes:
            joints.setdefault(node.chain, []).extend([k] * node.joint)
        number = int(target.removeprefix("each.")) - 1
        found = {own[number] for own in joints.values() if number < len(own)}
    return found


def _edges_of(target: str, drawing: Drawing) -> set[int]:
    """Bodies of a chain, or of each, that a target names: a row is marked with its chain."""
    chain, _, row = target.partition("/")

    def own(edge: Iterable[int]) -> bool:
        # A point that moves between closures is of no chain.
        chains = {drawing.nodes[k].chain for k in edge} - {""}
        return len(chains) == 1 and (chains == {chain} or (bool(row) and chain == "each"))

    return {k for k, edge in enumerate(drawing.edges) if own(edge)}


def scene_of(result: ResultShape, evidence: Evidence) -> Scene | None:
    """The scene of a result; None where nothing is carried."""
    drawing = evidence.drawing
    if drawing is None or not drawing.at:
        return None
    scene = Scene(drawing, _faults(result, drawing), _rms_of_poses(result, drawing))
    whole = np.isfinite(scene.nodes).all() and np.isfinite(scene.places).all()
    return scene if whole else None


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

    before = "error before" if _found(result) else "as drawn"

    def draw(width: float) -> str:
        return _draw(scene, labels, width, unit, before)

    return Figure("mechanism", draw, _caption(result, scene), _turning(scene))


def _turning(scene: Scene) -> str:
    """The data of the script, and the buttons, which it shows."""
    views = {"from the side": VIEW, "from above": ABOVE}
    buttons = "".join(
        f'<button type="button" data-azimuth="{a:.4f}" data-elevation="{e:.4f}">'
        f"{escape(name)}</button>"
        for name, (a, e) in views.items()
    )
    return (
        f'<div class="views" hidden>{buttons}<span class="faint">Drag, or use the arrow keys, '
        f"to turn it.</span></div>{data_element('mechanism-data', scene.data())}"
    )


def _draw(scene: Scene, labels: list[str], width: float, unit: str, before: str) -> str:
    height = HEIGHT[width == WIDE]
    canvas = Canvas(width, height)
    scale = scene.scale(width, height)
    middle = (width / 2, (height - FOOT) / 2)

    def flat(points: FloatArray) -> FloatArray:
        at = scale * seen(points - scene.centre, *scene.view)
        return np.stack([middle[0] + at[..., 0], middle[1] - at[..., 1]], axis=-1)

    canvas.parts.append(
        f'<g class="scene" data-scale="{scale:.4f}" data-x="{middle[0]:.1f}" '
        f'data-y="{middle[1]:.1f}"></g>'
    )
    stride = -(-len(scene.nodes) // GHOSTS)
    ghosts, body = flat(scene.nodes[::stride]), flat(scene.nodes[scene.usual])
    _path(canvas, "ghosts", [g[list(e)] for g in ghosts for e in scene.drawing.edges])
    _path(canvas, "body", [body[list(e)] for e in scene.edges(culprit=False)])
    _path(canvas, "body culprit", [body[list(e)] for e in scene.edges(culprit=True)])
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
    nodes_at = list(zip(scene.drawing.nodes, body, range(len(body)), strict=True))
    faults = scene.faults.nodes
    # Joints that meet in a point must not hide the one at fault.
    for node, (x, y), k in sorted(nodes_at, key=lambda entry: entry[2] in faults):
        culprit = faults.get(k) == node.name
        if node.joint or culprit:
            kind = "joint culprit" if culprit else "joint"
            canvas.dot(x, y, 6.0 if culprit else 2.6, kind, n=k)
        if k in faults:
            right = x > RIGHT * width
            canvas.parts.append(
                f'<text class="culprit" data-n="{k}" x="{x + (-10 if right else 10):.1f}" '
                f'y="{y + 4:.1f}" text-anchor="{"end" if right else "start"}">'
                f"{escape(faults[k])}</text>"
            )
    _legend(canvas, scene, scale, unit, before)
    return canvas.svg("the mechanism in its poses, with its error before and after")


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


def _legend(canvas: Canvas, scene: Scene, scale: float, unit: str, before: str) -> None:
    """What lines and dots are, and two scales: of the mechanism, and of its errors."""
    wide = canvas.width == WIDE
    entries = [("arrow before", before)] if scene.before.any() else []
    entries += [("weak", "1 sd after")] if scene.sd.any() else []
    entries += [("arrow after", "error after"), ("check", "check pose")] * bool(len(scene.known))
    step = (canvas.width - 12.0) / max(len(entries), 1) if wide else 0.0
    base = canvas.height - (46.0 if wide else 30.0 + 16.0 * len(entries))
    for k, (kind, words) in enumerate(entries):
        x, y = 12.0 + step * k, base + (0.0 if wide else 16.0 * k)
        if kind == "check":
            canvas.dot(x + 10.0, y - 4.0, 3.0, kind)
        else:
            canvas.line(x, y - 4.0, x + 20.0, y - 4.0, kind)
        canvas.text(x + 26.0, y, words)
    half, y = canvas.width / 2, canvas.height - 12.0
    for x, times in ((12.0, 1.0), (half, scene.times)):
        if not times > 0.0:
            continue
        length = _round(0.3 * canvas.width / scale / times)
        canvas.line(x, y, x + length * times * scale, y, "axis")
        for end in (x, x + length * times * scale):
            canvas.line(end, y - 3.0, end, y + 3.0, "axis")
        words = f"{length:g} {unit}" + (" of error" if x == half else "")
        canvas.text(x, y - 7.0, words)


def _found(result: ResultShape) -> bool:
    return isinstance(result, TraceShape) and bool(result.steps)


def _caption(result: ResultShape, scene: Scene) -> str:
    unit, wrong = result.length_unit, scene.faults.words
    before = "without what was found" if _found(result) else "as it is declared"
    out = "Every pose is a ghost of the mechanism. "
    if scene.times > 0.0:
        out += f"Errors are drawn {scene.times:,.0f} times" if scene.times >= 1.0 else ""
        out = out if scene.times >= 1.0 else f"{out}Errors are drawn {number(scene.times)} times"
        out += " too long. " if scene.times != 1.0 else " as long as they are. "
    if scene.before.any():
        worst = number(float(np.linalg.norm(scene.before, axis=1).max()), 2)
        out += (
            f"An arrow is how far the position is off {before}, against the calibration: up to "
            f"{worst} {unit}. "
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
        out += "Rings are check poses, with their measured error before and after. "
    out += "A dot is coloured by the residual of its pose: blue to 1.5 σ, yellow to 3 σ, red above."
    return f"{out} What is marked is at fault: {wrong}." if wrong else out


def _rms_of_poses(result: ResultShape, drawing: Drawing) -> list[float]:
    rows = result.after_residuals
    if rows is None or not len(rows):
        return [0.0] * len(drawing.poses)
    size = np.sqrt(np.nanmean(rows**2, axis=1))
    return [float(size[p]) if p < len(size) else 0.0 for p in drawing.poses]
