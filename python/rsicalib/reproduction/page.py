"""The page of a reproduction: every table beside the printed one, and how far they agree."""

from __future__ import annotations

import math
from html import escape

from rsicalib.report.figure import Figure
from rsicalib.report.page import document, section, table
from rsicalib.report.svg import Canvas, Chart
from rsicalib.reproduction.document import Cell, Paper, Table

LONG = 20
"""Longest label of a row that may be broken into words."""


def html(paper: Paper) -> str:
    """Write the reproduction as one HTML file that needs no network.

    Parameters
    ----------
    paper : Paper
        Tables and misprints.

    Returns
    -------
    str
        The document.
    """
    figure = agreement_figure(paper)
    parts = [
        "<h1>Hollerbach and Lokhorst, Closed-Loop Kinematic Calibration of the RSI 6-DOF Hand "
        "Controller</h1>",
        '<p class="verdict good">Every table of the paper, computed again beside the printed '
        "one.</p>",
        f"<p>Inches and radians; {paper.trials} trials in a simulated cell, seed {paper.seed}, "
        f"rsicalib {escape(paper.version)}.</p>",
        figure.html(),
        *(section(_title(one), _table(one), _notes(one)) for one in paper.tables),
        section("Misprints and gaps, each settled by a calculation", _misprints(paper)),
    ]
    return document("The paper's tables, computed again", parts)


def agreement_figure(paper: Paper) -> Figure:
    """Draw the ratio of every computed figure to the printed one, table by table."""
    found = []
    for number, one in enumerate(paper.tables):
        for row in one.rows:
            for cell in row.cells:
                ratio = _ratio(cell)
                if ratio is not None:
                    found.append((number, ratio, f"Table {one.id}, {row.label}: {cell.text()}"))
    names = [one.id for one in paper.tables]

    def draw(width: float) -> str:
        canvas = Canvas(width, 250.0)
        largest = min(max([0.35, *(abs(math.log10(r)) for _, r, _ in found)]), 1.0) * 1.1
        chart = Chart.on(
            canvas,
            (-0.6, len(names) - 0.4),
            (-largest, largest),
            ("", "log₁₀ (computed / printed)"),
            height=250.0,
            x_ticks=False,
        )
        for number, name in enumerate(names):
            short = name if name.isupper() else f"{name[:4]}."
            # Neighbours that are long stand on two lines.
            down = 30.0 if len(short) > 4 and number % 2 else 16.0
            canvas.text(chart.x(number), chart.y.start + down, short, anchor="middle")
        for place, (number, ratio, said) in enumerate(found):
            # Dots of one table side by side, so that none hides another.
            at = number + 0.5 * ((place * 0.618034) % 1.0 - 0.5)
            value = min(max(math.log10(ratio), -1.0), 1.0)
            canvas.dot(*chart.at((at, value)), 2.4, said=said)
        return canvas.svg("computed figures over printed ones, by table")

    return Figure(
        "agreement",
        draw,
        "Each dot is a figure of the paper: on the line of zero ours is the printed one, at 0.3 "
        "twice it, and what is beyond ten times it lies at the edge. Where dots scatter, the notes "
        "under the table say why.",
    )


def _ratio(cell: Cell) -> float | None:
    if not cell.computed or not cell.printed or cell.computed * cell.printed < 0.0:
        return None
    ratio = cell.computed / cell.printed
    return ratio if math.isfinite(ratio) else None


def _title(one: Table) -> str:
    name = f"Table {one.id}" if one.id.isupper() else one.id.capitalize()
    return f"{name}: {one.title} [{one.verdict}]"


def _table(one: Table) -> str:
    """Computed figures, printed ones in parentheses."""
    rows = [[row.label, *(cell.text() for cell in row.cells)] for row in one.rows]
    rows = [row + [""] * (len(one.columns) + 1 - len(row)) for row in rows]
    long = "" if any(len(row.label) > LONG for row in one.rows) else None
    return table(["", *one.columns], rows, words=_title(one), long=long)


def _notes(one: Table) -> str:
    return "".join(f'<p class="faint">{escape(note)}</p>' for note in one.notes)


def _misprints(paper: Paper) -> str:
    rows = [(m.where, m.printed, m.right, m.why) for m in paper.misprints]
    heads = ("where", "printed", "right", "why")
    return table(heads, rows, 4, "misprints", long="why") if rows else ""
