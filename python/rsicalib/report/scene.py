"""The mechanism in space, in numbers: its poses, its errors, and the room that it moves in."""

from __future__ import annotations

import math
from collections.abc import Iterable
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np

from rsicalib.arrays import FloatArray
from rsicalib.facts.shapes import Drawing, Evidence, ResultShape, Slice, TraceShape
from rsicalib.report.words import listed_words, subject, target_words
from rsicalib.report.workspace import Shades

GHOSTS = 60
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

SQUARE = 0.28
"""Side of a square of the floor at most, of its radius."""

MARGIN = 14.0
"""Room around all of it [px]."""


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
class Cells:
    """What is known of how well the calibration places what is carried, in a plane.

    Attributes
    ----------
    at : ndarray of shape (cells, 2)
        Middles of the cells: x and y.
    shades : list of int
        Shade of each.
    step : tuple of float
        Sides of a cell.
    z : float or None
        Height of the plane; None: the floor, for what stands for all heights.
    first : int
        Cells of the maps before this one.
    ends : tuple of float
        Smallest and largest standard deviation of a coordinate.
    """

    at: FloatArray
    shades: list[int]
    step: tuple[float, ...]
    z: float | None
    first: int
    ends: tuple[float, float]

    @classmethod
    def of(cls, slices: tuple[Slice, ...]) -> Cells | None:
        """The first map that is seen from above; None where there is none."""
        drawn = [[cell for cell in one.cells if math.isfinite(cell[2])] for one in slices]
        level = [k for k, one in enumerate(slices) if one.axes == ("x", "y") and drawn[k]]
        if not level:
            return None
        cells, shades = drawn[level[0]], Shades(slices)
        return cls(
            np.array([cell[:2] for cell in cells], dtype=np.float64).reshape(-1, 2),
            [shades.of(cell[2]) for cell in cells],
            slices[level[0]].step,
            slices[level[0]].value,
            sum(map(len, drawn[: level[0]])),
            (min(cell[2] for cell in cells), max(cell[2] for cell in cells)),
        )

    def corners(self, floor: float) -> FloatArray:
        """Corners of every cell: (cells, 4, 3)."""
        half = 0.5 * np.array([[-1, -1], [1, -1], [1, 1], [-1, 1]]) * np.array(self.step)
        flat = self.at[:, None, :] + half
        z = np.full((*flat.shape[:2], 1), floor if self.z is None else self.z)
        found: FloatArray = np.concatenate([flat, z], axis=2)
        return found


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
    found : bool
        Whether something was found: without it nothing was wrong before.
    cells : Cells or None
        What is known over the workspace.
    """

    drawing: Drawing
    faults: Faults
    sizes: list[float]
    found: bool
    cells: Cells | None

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
    def apart(self) -> FloatArray:
        """How far off they are before, or with the mechanism as it is declared: (poses, 3)."""
        found = np.array(self.drawing.before, dtype=np.float64).reshape(-1, 3)
        if found.shape != self.places.shape or not np.isfinite(found).all():
            return np.zeros_like(self.places)
        return found - self.places

    @cached_property
    def before(self) -> FloatArray:
        """How far off they are without what was found; zero where nothing was: (poses, 3)."""
        return self.apart if self.found else np.zeros_like(self.places)

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
        if not self.found:
            found[:, 1] = 0.0
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
        return rounded(LONGEST * self.span / self.longest)

    @cached_property
    def stride(self) -> int:
        """Of so many poses one has its arrow."""
        return -(-len(self.places) // ARROWS) or 1

    @cached_property
    def ghosts(self) -> int:
        """Of so many poses one is drawn as a ghost."""
        return -(-len(self.nodes) // GHOSTS) or 1

    @cached_property
    def usual(self) -> int:
        """The pose in the middle."""
        middle = np.median(self.places, axis=0)
        return int(np.argmin(np.linalg.norm(self.places - middle, axis=1)))

    def edges(self, *, culprit: bool) -> list[tuple[int, ...]]:
        """Pairs of nodes that are joined, by what is at fault or by others."""
        every = enumerate(self.drawing.edges)
        return [edge for k, edge in every if (k in self.faults.edges) == culprit]

    @cached_property
    def plate(self) -> list[int]:
        """Points that are joined to a triangle: what is carried, where it is a plate."""
        points = {k for k, node in enumerate(self.drawing.nodes) if not node.joint}
        sides = [edge for edge in self.drawing.edges if points.issuperset(edge)]
        corners = sorted({k for edge in sides for k in edge})
        return corners if len(corners) == len(sides) == 3 else []

    @cached_property
    def points(self) -> FloatArray:
        """All that has to be on the canvas: (points, 3)."""
        body, known, times = self.nodes.reshape(-1, 3), self.known[:, 0], self.times
        found = [body, self.places + times * self.before, known]
        found += [known + times * off for off in self.known[:, 1:].transpose(1, 0, 2)]
        if self.cells is not None:
            found.append(self.cells.corners(float(body[:, 2].min())).reshape(-1, 3))
        return np.concatenate(found)

    @cached_property
    def centre(self) -> FloatArray:
        """The middle of all of it."""
        middle: FloatArray = (self.points.min(axis=0) + self.points.max(axis=0)) / 2
        return middle

    @cached_property
    def radius(self) -> float:
        """Of the floor, which all of it stands above."""
        away = self.points - self.centre
        return float(np.hypot(away[:, 0], away[:, 1]).max()) or 0.5 * self.span

    @cached_property
    def tall(self) -> float:
        """Half the height of all of it."""
        return float(np.ptp(self.points[:, 2])) / 2

    @cached_property
    def floor(self) -> list[FloatArray]:
        """Lines of a round floor in squares of a round length, x first: (2, 3) each."""
        step, radius, found = self.square, self.radius, []
        low = self.centre[2] - self.tall
        for axis in (0, 1):
            middle = float(self.centre[axis])
            for k in range(math.ceil((middle - radius) / step), int((middle + radius) // step) + 1):
                away = k * step - middle
                half = math.sqrt(max(radius * radius - away * away, 0.0))
                line = np.empty((2, 3))
                line[:, axis] = k * step
                line[:, 1 - axis] = self.centre[1 - axis] + np.array([-half, half])
                line[:, 2] = low
                found.append(line)
        return found

    @cached_property
    def square(self) -> float:
        """Side of a square of the floor."""
        return rounded(SQUARE * self.radius)

    @cached_property
    def axes(self) -> dict[str, FloatArray]:
        """Where the names of the axes stand: at the edge of the floor."""
        x, y, z = self.centre
        low, out = z - self.tall, self.radius
        return {"x": np.array([x + out, y, low]), "y": np.array([x, y + out, low])}

    def scale(self, width: float, height: float, elevation: float) -> float:
        """Pixels of a unit of length: nothing leaves the canvas, however it is turned."""
        up = self.tall * abs(math.cos(elevation)) + self.radius * abs(math.sin(elevation))
        return min((width / 2 - MARGIN) / self.radius, (height / 2 - MARGIN) / (up or 1e-9))

    def largest(self, width: float, height: float) -> float:
        """The most that the scale can be."""
        return max(self.scale(width, height, math.radians(d)) for d in range(91))

    @cached_property
    def digits(self) -> int:
        """Decimals of a coordinate: far below a pixel."""
        return max(0, 4 - math.floor(math.log10(self.span)))

    def data(self) -> dict[str, Any]:
        """What the script needs to draw it from another side."""
        digits = self.digits

        def rows(values: FloatArray) -> list[Any]:
            found: list[Any] = np.round(values, digits).tolist()
            return found

        out = {
            "stride": self.stride,
            "margin": MARGIN,
            "radius": self.radius,
            "tall": self.tall,
            "azimuth": self.view[0],
            "elevation": self.view[1],
            "centre": rows(self.centre),
            "floor": [rows(line) for line in self.floor],
            "axes": {name: rows(at) for name, at in self.axes.items()},
            "every": self.ghosts,
            "ghosts": rows(self.nodes[:: self.ghosts]),
            "poses": self.drawing.poses[:: self.ghosts],
            "usual": rows(self.nodes[self.usual]),
            "edges": self.edges(culprit=False),
            "culprits": self.edges(culprit=True),
            "all": self.drawing.edges,
            "plate": self.plate,
            "places": rows(self.places),
            "before": rows(self.times * self.before),
            "sd": rows(self.times * self.sd),
            "known": rows(self.known[:, 0]),
            "known_before": rows(self.times * self.known[:, 1]),
            "known_after": rows(self.times * self.known[:, 2]),
        }
        if self.cells is not None:
            out["cells"] = {
                "at": rows(self.cells.at),
                "shades": self.cells.shades,
                "first": self.cells.first,
                "half": [side / 2 for side in self.cells.step],
                "z": self.centre[2] - self.tall if self.cells.z is None else self.cells.z,
            }
        return out


def rounded(value: float) -> float:
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
        # Closures have no names in the drawing: `each` of them is no joint.
        shown = [step for step in result.steps if step.klass != "closure" or step.target != "each"]
        found += [(subject(step), step.target) for step in shown]
        left = None if result.unexplained is None else result.unexplained.target
        found += [(f"what is left at {left}", left)] if left not in (None, "all") else []
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
    return Faults(nodes, edges, listed_words(words) if words else "")


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
    found = isinstance(result, TraceShape) and bool(result.steps)
    sizes, cells = _rms_of_poses(result, drawing), Cells.of(evidence.workspace)
    scene = Scene(drawing, _faults(result, drawing), sizes, found, cells)
    whole = np.isfinite(scene.nodes).all() and np.isfinite(scene.places).all()
    return scene if whole else None


def _rms_of_poses(result: ResultShape, drawing: Drawing) -> list[float]:
    rows = result.after_residuals
    if rows is None or not len(rows):
        return [0.0] * len(drawing.poses)
    size = np.sqrt(np.nanmean(rows**2, axis=1))
    return [float(size[p]) if p < len(size) else 0.0 for p in drawing.poses]
