"""A fleet at one glance: devices by parameters, in standard deviations from the usual device."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from html import escape
from typing import Any

import numpy as np

from rsicalib.arrays import FloatArray
from rsicalib.fleets.standing_out import Spread
from rsicalib.report.figure import Figure
from rsicalib.report.svg import WIDE, Canvas, fitted, width_of

MOST_DEVICES = 40
"""Devices that are drawn; those that are farthest from the others."""

LEVELS = (2.0, 3.0, 5.0)
"""Distances [sd] from which on a cell is darker."""

ROW, HEAD = 13.0, 92.0


def map_figure(
    spread: Sequence[Spread],
    rows: Mapping[str, Sequence[Any]],
    by: str,
    out: Sequence[str] = (),
    links: Mapping[str, str] | None = None,
) -> Figure | None:
    """Draw the devices that stand `out`, in their order, then those that are farthest from the
    usual one, with a link where there is one; None where nothing is compared.
    """
    if not spread:
        return None
    labels = rows[by]
    harm: FloatArray = np.zeros(len(labels))
    for one in spread:
        away = np.abs(one.distances(rows))
        harm = np.maximum(harm, np.where(np.isfinite(away), away, 0.0))
    first = {device: k for k, device in enumerate(out)}
    named = [str(label) for label in labels]
    order = sorted(range(len(named)), key=lambda d: (first.get(named[d], len(out)), -harm[d]))
    order = order[:MOST_DEVICES]
    names = [named[device] for device in order]
    far: FloatArray = np.array([one.distances(rows)[order] for one in spread]).T

    def draw(width: float) -> str:
        parameters = [one.name for one in spread]
        # On a desk what there is more of goes along the longer side.
        across = width == WIDE and len(names) > len(parameters)
        rows, columns = (parameters, names) if across else (names, parameters)
        cells = far.T if across else far
        return _drawn(width, rows, columns, cells, links or {}, across=across)

    caption = (
        "Each cell is a parameter of a device: how far it is from the median of the fleet, in "
        "standard deviations of the usual device (of its own estimate, where that is larger). "
        f"Those first that {'stand out, then those that ' if out else ''}are farthest"
    )
    nearer = len(labels) - MOST_DEVICES
    caption += f"; {nearer} more are nearer." if nearer > 0 else "."
    return Figure("map", draw, caption)


def _drawn(
    width: float,
    rows: Sequence[str],
    columns: Sequence[str],
    far: FloatArray,
    links: Mapping[str, str],
    *,
    across: bool,
) -> str:
    """A cell for each of `far`, shape (rows, columns); `across`: devices are columns."""
    left = min(max(map(width_of, rows)) + 10.0, 0.4 * width)
    head = min(max(map(width_of, columns)) + 12.0, HEAD)
    wide = (width - left - 4.0) / len(columns)
    canvas = Canvas(width, head + ROW * len(rows) + 34.0)
    step = max(1, math.ceil(11.0 / wide))
    for k, name in enumerate(columns[::step]):
        x, shown = left + wide * (k * step + 0.5) + 4.0, fitted(name, head - 8.0)
        canvas.parts.append(
            f'<text class="tick" transform="translate({x:.1f} {head - 6:.1f}) rotate(-90)">'
            f"{escape(shown)}</text>"
        )
        if across and name in links:
            canvas.lead(links[name])
    for r, row in enumerate(rows):
        y = head + ROW * r
        canvas.text(left - 6.0, y + 10.0, fitted(row, left - 8.0), anchor="end")
        if not across and row in links:
            canvas.lead(links[row])
        for k, column in enumerate(columns):
            sd = float(far[r, k])
            said = f"{column}, {row}: " if across else f"{row}, {column}: "
            said += f"{sd:+.1f} sd" if math.isfinite(sd) else "not known"
            canvas.rect(left + wide * k, y, wide - 0.5, ROW - 0.5, _kind(sd), said)
    _scale(canvas, left)
    return canvas.svg("devices by parameters, in standard deviations from the median")


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
