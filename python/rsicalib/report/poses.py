"""The page of a plan: the poses, where they are, and what is to be expected of them."""

from __future__ import annotations

import csv
import io
from collections.abc import Sequence
from html import escape

import numpy as np

from rsicalib.arrays import FloatArray
from rsicalib.plain_text import counted
from rsicalib.report.figure import Figure
from rsicalib.report.page import document, listed, section, table
from rsicalib.report.svg import WIDE, Canvas, Chart, bounds, width_of


def poses_html(
    mechanism: str,
    unit: str,
    rows: str,
    brings: Sequence[tuple[str, Sequence[str]]],
    poses: FloatArray | None,
) -> str:
    """Write a plan as one HTML file that needs no network.

    Parameters
    ----------
    mechanism, unit : str
        Name of the mechanism, and unit of x, y, z.
    rows : str
        The plan as CSV.
    brings : sequence of (str, sequence of str)
        What the plan brings: headings, empty where there is none, and the lines below.
    poses : ndarray, shape (n, 6), or None
        The poses, in their order; None for a mechanism without a platform.

    Returns
    -------
    str
        The document.
    """
    heads, *lines = list(csv.reader(io.StringIO(rows)))
    whys = {line[heads.index("why")] for line in lines} if "why" in heads else set()
    text = ("pose", "group", "at", "why")
    order = [heads.index(head) for head in text if head in heads]
    words = len(order)
    order += [k for k, head in enumerate(heads) if head not in text]
    alike = len(whys) == 1 and len(lines) > 1
    if alike:
        order.remove(heads.index("why"))
        words -= 1
    shown = [[line[k] for k in order] for line in lines]
    labels = [line[heads.index("pose")] for line in lines]
    figure = poses_figure(poses, unit, labels) if poses is not None and len(poses) else None
    found = table([heads[k] for k in order], shown, words, "poses to visit", long="why")
    why = f"<p>Why: each is {escape(whys.pop())}.</p>" if alike else ""
    return document(
        f"{mechanism}: plan",
        [
            f"<h1>Plan for {escape(mechanism)}</h1>",
            f'<p class="verdict good">{counted(len(lines), "pose")} to visit, in this order.</p>',
            section("What they bring", _brought(brings)),
            section("Where they are", figure.html() if figure else ""),
            section("The poses", why, found),
        ],
    )


def _brought(brings: Sequence[tuple[str, Sequence[str]]]) -> str:
    parts = []
    for heading, below in (one for one in brings if one[1]):
        words = f"{heading[:1].upper()}{heading[1:]}:" if heading else ""
        parts.append(f"<p>{escape(words)}</p>{listed(below)}")
    return "\n".join(parts)


def poses_figure(poses: FloatArray, unit: str, labels: Sequence[str]) -> Figure:
    """Draw the positions of poses from above and from the side, with the way between them."""

    def draw(width: float) -> str:
        across = 2 if width == WIDE else 1
        room, height = width / across, 250.0
        canvas = Canvas(width, height * (2 // across))
        for k, (u, v, title) in enumerate(((0, 1, "from above"), (0, 2, "from the side"))):
            part = Canvas(room, 0.0)
            names = "xyz"
            x, y = bounds(poses[:, u], 0.12), bounds(poses[:, v], 0.12)
            words = (f"{names[u]} [{unit}]", f"{names[v]} [{unit}]")
            chart = Chart.on(part, x, y, words, title=title, height=height)
            chart.curve([(p[u], p[v]) for p in poses.tolist()], "whisker way")
            taken: list[tuple[float, float]] = []
            for label, pose in zip(labels, poses.tolist(), strict=True):
                place = chart.at((pose[u], pose[v]))
                angles = ", ".join(f"{value:.0f}°" for value in np.degrees(pose[3:]))
                part.dot(*place, 3.4, said=f"pose {label}: rx, ry, rz {angles}")
                part.text(*_beside(place, width_of(label), taken), label)
            column, row = k % across, k // across
            move = f"translate({room * column:.1f} {height * row:.1f})"
            canvas.parts.append(f'<g transform="{move}">{"".join(part.parts)}</g>')
        return canvas.svg("positions of the poses")

    return Figure(
        "poses",
        draw,
        "Each dot is a pose with its number, the line the way from one to the next; rest on a dot "
        "for its orientation.",
    )


def _beside(
    place: tuple[float, float], long: float, taken: list[tuple[float, float]]
) -> tuple[float, float]:
    """Where the label of a dot is written: not over another one, if that can be."""
    x, y = place
    ways = [(x + 5.0, y - 4.0), (x - 5.0 - long, y - 4.0), (x + 5.0, y + 13.0)]
    ways += [(x - 5.0 - long, y + 13.0), (x - long / 2, y - 15.0), (x - long / 2, y + 24.0)]
    free = [
        w for w in ways if all(abs(w[0] - u) > long + 2 or abs(w[1] - v) > 11 for u, v in taken)
    ]
    taken.append((free or ways)[0])
    return taken[-1]
