"""Figures of the report, drawn by hand: SVG text, styled by the page."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

__all__ = ["band_curve", "residuals", "ticks"]

Numbers = Sequence[float]

WIDTH, HEIGHT = 720.0, 220.0
LEFT, RIGHT, TOP, BOTTOM = 64.0, 12.0, 22.0, 34.0


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


def _text(x: float, y: float, words: str, anchor: str = "middle", kind: str = "tick") -> str:
    return f'<text class="{kind}" x="{x:.1f}" y="{y:.1f}" text-anchor="{anchor}">{words}</text>'


def _line(x1: float, y1: float, x2: float, y2: float, kind: str) -> str:
    return f'<line class="{kind}" x1="{x1:.1f}" y1="{y1:.1f}" x2="{x2:.1f}" y2="{y2:.1f}"/>'


def _frame(x: Axis, y: Axis, x_words: str, y_words: str, title: str) -> list[str]:
    """Grid, ticks and labels."""
    out = [_text(LEFT, 13, title, "start", "title")]
    for value in ticks(y.low, y.high, 5):
        out.append(_line(x.start, y(value), x.end, y(value), "zero" if value == 0.0 else "grid"))
        out.append(_text(x.start - 6, y(value) + 4, f"{value:g}", "end"))
    for value in ticks(x.low, x.high, 8):
        out.append(_line(x(value), y.start, x(value), y.start + 4, "axis"))
        out.append(_text(x(value), y.start + 17, f"{value:g}"))
    out.append(_line(x.start, y.start, x.end, y.start, "axis"))
    out.append(_text((x.start + x.end) / 2, y.start + 31, x_words, kind="label"))
    middle = (y.start + y.end) / 2
    turn = f'transform="rotate(-90 14 {middle:.1f})"'
    out.append(
        f'<text class="label" x="14" y="{middle:.1f}" text-anchor="middle" {turn}>{y_words}</text>'
    )
    return out


def _svg(body: Sequence[str], height: float, words: str) -> str:
    inner = "\n".join(body)
    return (
        f'<svg viewBox="0 0 {WIDTH:g} {height:g}" role="img" aria-label="{words}" '
        f'xmlns="http://www.w3.org/2000/svg">\n{inner}\n</svg>'
    )


def residuals(panels: Sequence[tuple[str, Sequence[Numbers]]], x_words: str = "pose") -> str:
    """Draw residuals in units of noise, one panel below the other, on one scale.

    Parameters
    ----------
    panels : sequence of (str, sequence of sequence of float)
        Title, and for each pose its residuals.
    x_words : str
        What is counted along x.

    Returns
    -------
    str
        An `<svg>` element.
    """
    largest = max((abs(v) for _, rows in panels for row in rows for v in row), default=1.0)
    bound = max(3.5, 1.05 * largest)
    count = max(len(rows) for _, rows in panels)
    body = []
    for number, (title, rows) in enumerate(panels):
        shift = number * HEIGHT
        x = Axis(0.0, count + 1.0, LEFT, WIDTH - RIGHT)
        y = Axis(-bound, bound, HEIGHT - BOTTOM, TOP)
        size = f'width="{x.end - x.start:g}" height="{y(-2.0) - y(2.0):.1f}"'
        band = f'<rect class="noise" x="{x.start:g}" y="{y(2.0):.1f}" {size}/>'
        radius = 3.0 if count <= 120 else 1.6
        dots = [
            f'<circle class="dot" cx="{x(pose + 1):.1f}" cy="{y(v):.1f}" r="{radius:g}"/>'
            for pose, row in enumerate(rows)
            for v in row
        ]
        frame = _frame(x, y, x_words, "residual / noise", title)
        body.append(
            f'<g transform="translate(0 {shift:g})">{band}{"".join(frame)}{"".join(dots)}</g>'
        )
    return _svg(body, HEIGHT * len(panels), "residuals in units of noise, before and after")


def band_curve(
    rows: Sequence[Numbers],
    sd: Numbers,
    title: str,
    x_words: str,
    y_words: str = "correction [mrad]",
) -> str:
    """Draw a correction over its reading or over time, with its 95 % band.

    Parameters
    ----------
    rows : sequence of (float, float)
        Where, and correction.
    sd : sequence of float
        Standard deviation of each correction; may be empty.
    title, x_words, y_words : str
        Labels.

    Returns
    -------
    str
        An `<svg>` element; corrections in thousandths.
    """
    readings = [row[0] for row in rows]
    middle = [1e3 * row[1] for row in rows]
    half = [1.96e3 * s for s in sd] if len(sd) == len(rows) else [0.0] * len(rows)
    high = max(0.0, *(m + h for m, h in zip(middle, half, strict=True)))
    low = min(0.0, *(m - h for m, h in zip(middle, half, strict=True)))
    room = 0.06 * (high - low) or 1.0
    x = Axis(min(readings), max(readings), LEFT, WIDTH - RIGHT)
    y = Axis(low - room, high + room, HEIGHT - BOTTOM, TOP)
    up = [f"{x(r):.1f},{y(m + h):.1f}" for r, m, h in zip(readings, middle, half, strict=True)]
    down = [f"{x(r):.1f},{y(m - h):.1f}" for r, m, h in zip(readings, middle, half, strict=True)]
    line = " ".join(f"{x(r):.1f},{y(m):.1f}" for r, m in zip(readings, middle, strict=True))
    body = _frame(x, y, x_words, y_words, title)
    body.append(f'<polygon class="band" points="{" ".join(up + down[::-1])}"/>')
    body.append(f'<polyline class="curve" points="{line}"/>')
    return _svg(body, HEIGHT, title)
