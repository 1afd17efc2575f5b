"""A fleet at one glance: devices by parameters, in standard deviations from the usual device."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from rsicalib.arrays import FloatArray
from rsicalib.fleets.standing_out import Spread
from rsicalib.report.figure import Figure
from rsicalib.report.svg import WIDE, Canvas

__all__ = ["MOST_DEVICES", "map_figure"]

MOST_DEVICES = 40
"""Devices that are drawn; those that are farthest from the others."""

LEVELS = (2.0, 3.0, 5.0)
"""Distances [sd] from which on a cell is darker."""

ROW, HEAD = 13.0, 92.0


def map_figure(
    spread: Sequence[Spread], rows: Mapping[str, Sequence[Any]], by: str
) -> Figure | None:
    """Draw the devices that are farthest from the usual one; None where nothing is compared."""
    if not spread:
        return None
    labels = rows[by]
    harm: FloatArray = np.zeros(len(labels))
    for one in spread:
        away = np.abs(one.distances(rows)[0])
        harm = np.maximum(harm, np.where(np.isfinite(away), away, 0.0))
    order = np.argsort(-harm, kind="stable")[:MOST_DEVICES].tolist()
    names = [str(labels[device]) for device in order]
    far: FloatArray = np.array([one.distances(rows)[0][order] for one in spread]).T

    def draw(width: float) -> str:
        left = 110.0 if width == WIDE else 74.0
        letters = int((left - 8.0) / 6.9)
        wide = (width - left - 4.0) / len(spread)
        canvas = Canvas(width, HEAD + ROW * len(order) + 34.0)
        step = max(1, math.ceil(11.0 / wide))
        for k, one in enumerate(spread[::step]):
            x = left + wide * (k * step + 0.5)
            canvas.parts.append(
                f'<g transform="rotate(-90 {x:.1f} {HEAD - 6:.1f})">'
                f"{_text(x, HEAD - 2.0, one.name)}</g>"
            )
        for r, name in enumerate(names):
            y = HEAD + ROW * r
            canvas.text(left - 6.0, y + 10.0, name[:letters], anchor="end")
            for k, one in enumerate(spread):
                sd = float(far[r, k])
                said = f"{name}, {one.name}: "
                said += f"{sd:+.1f} sd" if math.isfinite(sd) else "not known"
                kind = _kind(sd)
                canvas.rect(left + wide * k, y, wide - 0.5, ROW - 0.5, kind, said)
        _scale(canvas, left)
        return canvas.svg("devices by parameters, in standard deviations from the median")

    caption = (
        "Each cell is a parameter of a device: how far it is from the median of the fleet, in "
        "standard deviations of the usual device (of its own estimate, where that is larger). "
        "Those first that are farthest"
    )
    nearer = len(labels) - MOST_DEVICES
    caption += f"; {nearer} more are nearer." if nearer > 0 else "."
    return Figure("map", draw, caption)


def _text(x: float, y: float, words: str) -> str:
    part = Canvas(HEAD, HEAD)
    part.text(0.0, 0.0, words[:13])
    return f'<g transform="translate({x:.1f} {y:.1f})">{part.parts[0]}</g>'


def _kind(sd: float) -> str:
    """Shade of a cell; above and below the median have colours of their own."""
    if not math.isfinite(sd):
        return "unknown"
    level = sum(abs(sd) >= at for at in LEVELS)
    return "usual" if level == 0 else f"{'above' if sd > 0.0 else 'below'}{level}"


def _scale(canvas: Canvas, left: float) -> None:
    cells = [("below3", "< -5"), ("below2", ""), ("below1", "-2"), ("usual", "")]
    cells += [("above1", "2"), ("above2", ""), ("above3", "> 5 sd")]
    y = canvas.height - 30.0
    for k, (kind, words) in enumerate(cells):
        canvas.rect(left + 30.0 * k, y, 29.5, 11.0, kind)
        if words:
            canvas.text(left + 30.0 * k + 15.0, y + 24.0, words, anchor="middle")
