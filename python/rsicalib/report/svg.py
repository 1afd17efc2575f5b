"""Primitives of the figures: SVG text, drawn by hand and styled by the page.

A figure is drawn at two widths, so that its labels are readable on a phone and on a desk. All text
that is drawn is escaped here.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, field
from html import escape
from typing import TypeAlias
from unicodedata import east_asian_width

WIDE, NARROW = 560.0, 320.0
"""Widths at which figures are drawn, in units of their view box."""

SIZE = 12.0
"""Height of the font [px]."""

WIDTHS = {
    "'IJijl": 0.3,
    " ,./:;\\|·": 0.35,
    "()-[]ft": 0.4,
    "!r²": 0.45,
    '"*_`°–': 0.5,
    "?csz": 0.55,
    "FLkvxyχ": 0.6,
    "ABCKRVXZ": 0.7,
    "NU": 0.75,
    "&DGHOQ": 0.8,
    "#+<=>^w~±×": 0.85,
    "M": 0.9,
    "%@Wm—…": 1.0,
}
"""Widths of letters in DejaVu Sans, the widest usual font, rounded up [height of the font]."""

BOLD_WIDTHS = {
    " 'ijl": 0.35,
    ",./:;IJ\\|·": 0.4,
    "-f²": 0.45,
    "!()[]_`rt°–": 0.5,
    '"*': 0.55,
    "?csz": 0.6,
    "Lxχ": 0.65,
    "$0123456789EFTaekovy": 0.7,
    "ABKRVXσ": 0.8,
    "#+<=>DGHNU^~±×": 0.85,
    "&OQ": 0.9,
    "w": 0.95,
    "@M—…": 1.0,
    "%m": 1.05,
    "W": 1.15,
}

USUAL, BOLD_USUAL = 0.65, 0.75
"""Widths of all other letters."""

SAME = 0.61
"""Width of every letter of a font that has one width, which a browser may take as well."""

Draw: TypeAlias = Callable[[float], str]
"""A figure: an `<svg>` element for a width."""

Point: TypeAlias = Sequence[float]


@dataclass(frozen=True)
class Axis:
    """A straight map from numbers to pixels."""

    low: float
    high: float
    start: float
    end: float

    def __call__(self, value: float) -> float:
        """The pixel of a number."""
        share = (value - self.low) / (self.high - self.low)
        return self.start + share * (self.end - self.start)


def ticks(low: float, high: float, most: int = 6) -> list[float]:
    """Round numbers between two bounds, at most so many.

    Examples
    --------
    >>> ticks(0.0, 1.0)
    [0.0, 0.2, 0.4, 0.6, 0.8, 1.0]
    """
    if not high > low:
        return [low]
    power = 10.0 ** math.floor(math.log10((high - low) / most))
    step = next(
        s * power for s in (1.0, 2.0, 5.0, 10.0, 20.0) if (high - low) / (s * power) <= most
    )
    first = math.ceil(low / step - 1e-9)
    last = math.floor(high / step + 1e-9)
    return [round(k * step, 12) + 0.0 for k in range(first, last + 1)]


def bounds(values: Iterable[float], room: float = 0.05) -> tuple[float, float]:
    """Lowest and highest of the numbers with some room, never equal.

    Examples
    --------
    >>> bounds([0.0, 10.0], room=0.1)
    (-1.0, 11.0)
    """
    known = [v for v in values if math.isfinite(v)] or [0.0]
    low, high = min(known), max(known)
    more = room * (high - low) or 0.05 * abs(high) or 1.0
    return low - more, high + more


def width_of(words: str, *, bold: bool = False) -> float:
    """Width of words in a wide font [px]."""
    widths, usual = (BOLD_WIDTHS, BOLD_USUAL) if bold else (WIDTHS, USUAL)

    def one(letter: str) -> float:
        if east_asian_width(letter) in "WF":
            return 1.0
        return next((width for letters, width in widths.items() if letter in letters), usual)

    return SIZE * sum(map(one, words))


def fitted(words: str, room: float) -> str:
    """Words, cut at their end where they are wider than the room.

    Examples
    --------
    >>> fitted("reference temperature", 90.0)
    'reference t…'
    """
    if width_of(words) <= room:
        return words
    return next(
        (
            f"{words[:n]}…"
            for n in range(len(words) - 1, 0, -1)
            if width_of(f"{words[:n]}…") <= room
        ),
        "…",
    )


def _length(words: str, room: float, *, bold: bool = False) -> str:
    """The attribute that keeps words within so much room, where a font could take more."""
    width = width_of(words, bold=bold)
    if max(width, SIZE * SAME * len(words)) <= room:
        return ""
    # Letters are no wider than they are: what is to be as long as it is has other gaps.
    adjust = "spacing" if width <= room else "spacingAndGlyphs"
    return f' textLength="{max(min(room, width), 1.0):.1f}" lengthAdjust="{adjust}"'


@dataclass
class Canvas:
    """Room for one figure."""

    width: float
    height: float
    parts: list[str] = field(default_factory=list)
    links: list[str] = field(default_factory=list)
    """Where parts lead."""

    def text(
        self, x: float, y: float, words: str, *, anchor: str = "start", kind: str = "tick"
    ) -> None:
        """Write words, which may be anything, and stay on the canvas in any font."""
        ends = {"start": self.width - x, "end": x, "middle": 2 * min(x, self.width - x)}
        self.parts.append(
            f'<text class="{kind}" x="{x:.1f}" y="{y:.1f}" text-anchor="{anchor}"'
            f"{_length(words, ends[anchor], bold=kind == 'culprit')}>{escape(words)}</text>"
        )

    def line(self, x1: float, y1: float, x2: float, y2: float, kind: str) -> None:
        """Draw a straight line."""
        self.parts.append(
            f'<line class="{kind}" x1="{x1:.1f}" y1="{y1:.1f}" x2="{x2:.1f}" y2="{y2:.1f}"/>'
        )

    def dot(
        self,
        x: float,
        y: float,
        radius: float = 3.0,
        kind: str = "dot",
        said: str = "",
        **data: int,
    ) -> None:
        """Draw a dot; `said` is shown where the pointer rests."""
        more = "".join(f' data-{key}="{value}"' for key, value in data.items())
        head = f'<circle class="{kind}" cx="{x:.1f}" cy="{y:.1f}" r="{radius:g}"{more}'
        self.parts.append(f"{head}><title>{escape(said)}</title></circle>" if said else f"{head}/>")

    def dots(self, points: Iterable[Point], radius: float, kind: str = "dot") -> None:
        """Draw many dots that nobody points at, as one path: a quarter of the text."""
        where = "".join(f"M{x:.1f} {y:.1f}h0" for x, y in points)
        if where:
            self.parts.append(
                f'<path class="many {kind}" stroke-width="{2 * radius:g}" d="{where}"/>'
            )

    def uprights(self, spans: Iterable[tuple[float, float, float]], kind: str) -> None:
        """Draw many upright lines (x, from y, to y) as one path."""
        where = "".join(f"M{x:.1f} {low:.1f}V{high:.1f}" for x, low, high in spans)
        self.parts.append(f'<path class="{kind}" d="{where}"/>')

    def rect(
        self,
        x: float,
        y: float,
        width: float,
        height: float,
        kind: str,
        said: str = "",
        **data: int,
    ) -> None:
        """Draw a rectangle; `said` is shown where the pointer rests."""
        more = "".join(f' data-{key}="{value}"' for key, value in data.items())
        head = (
            f'<rect class="{kind}" x="{x:.1f}" y="{y:.1f}" width="{max(width, 0.0):.1f}" '
            f'height="{max(height, 0.0):.1f}"{more}'
        )
        self.parts.append(f"{head}><title>{escape(said)}</title></rect>" if said else f"{head}/>")

    def path(
        self, points: Iterable[Point], kind: str, *, closed: bool = False, law: str = ""
    ) -> None:
        """Draw a line through points, or the area that they bound; `law` is whose law it is."""
        where = " ".join(f"{x:.1f},{y:.1f}" for x, y in points)
        more = f' data-law="{escape(law)}"' if law else ""
        self.parts.append(
            f'<{"polygon" if closed else "polyline"} class="{kind}"{more} points="{where}"/>'
        )

    def lead(self, link: str) -> None:
        """Make what was drawn last lead somewhere."""
        self.parts[-1] = f'<a href="{escape(link)}">{self.parts[-1]}</a>'
        self.links.append(link)

    def svg(self, words: str) -> str:
        """The `<svg>` element; `words` describe it to who cannot see it."""
        inner = "\n".join(self.parts)
        # A picture is one thing; nothing in it could be reached.
        role = "group" if self.links else "img"
        return (
            f'<svg viewBox="0 0 {self.width:g} {self.height:g}" role="{role}" '
            f'aria-label="{escape(words)}" xmlns="http://www.w3.org/2000/svg">\n{inner}\n</svg>'
        )


@dataclass(frozen=True)
class Chart:
    """A frame with two axes on a canvas."""

    canvas: Canvas
    x: Axis
    y: Axis

    @classmethod
    def on(
        cls,
        canvas: Canvas,
        x: tuple[float, float],
        y: tuple[float, float],
        words: tuple[str, str],
        *,
        title: str = "",
        top: float = 0.0,
        height: float = 220.0,
        x_ticks: bool = True,
    ) -> Chart:
        """Draw grid, ticks and labels.

        Parameters
        ----------
        canvas : Canvas
            Where to.
        x, y : (float, float)
            Lowest and highest number of both axes.
        words : (str, str)
            Labels of both axes.
        title : str
            What stands above the frame.
        top, height : float
            Part of the canvas that the chart has.
        x_ticks : bool
            Whether the numbers along x are written.
        """
        narrow = canvas.width < WIDE
        longest = max(width_of(f"{value:g}") for value in ticks(*y, 5))
        left, bottom = max(46.0 if narrow else 64.0, 24.0 + longest), 36.0
        across = Axis(*x, left, canvas.width - 10.0)
        up = Axis(*y, top + height - bottom, top + 24.0)
        if title:
            # Letters of a title are of 13 px.
            shown = fitted(title, SIZE / 13.0 * (canvas.width - 4.0))
            canvas.text(2.0, top + 13.0, shown, kind="title")
        for value in ticks(*y, 5):
            kind = "zero" if value == 0.0 else "grid"
            canvas.line(across.start, up(value), across.end, up(value), kind)
            canvas.text(left - 6.0, up(value) + 4.0, f"{value:g}", anchor="end")
        canvas.line(across.start, up.start, across.end, up.start, "axis")
        for value in ticks(*x, 4 if narrow else 8) if x_ticks else ():
            canvas.line(across(value), up.start, across(value), up.start + 4.0, "axis")
            canvas.text(across(value), up.start + 17.0, f"{value:g}", anchor="middle")
        middle = (across.start + across.end) / 2
        canvas.text(middle, up.start + 32.0, words[0], anchor="middle", kind="label")
        half = (up.start + up.end) / 2
        canvas.parts.append(
            f'<text class="label" x="11" y="{half:.1f}" text-anchor="middle" '
            f'transform="rotate(-90 11 {half:.1f})"{_length(words[1], 2 * (half - top))}>'
            f"{escape(words[1])}</text>"
        )
        return cls(canvas, across, up)

    def at(self, point: Point) -> tuple[float, float]:
        """The pixels of a pair of numbers."""
        return self.x(point[0]), self.y(point[1])

    def band(self, low: float, high: float, kind: str = "noise") -> None:
        """Draw a band across the frame."""
        width = self.x.end - self.x.start
        self.canvas.rect(self.x.start, self.y(high), width, self.y(low) - self.y(high), kind)

    def curve(self, points: Iterable[Point], kind: str, law: str = "") -> None:
        """Draw a line through pairs of numbers."""
        self.canvas.path([self.at(point) for point in points], kind, law=law)
