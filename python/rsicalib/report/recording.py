"""The picture of a recording that became a session: what was held, and what was motion."""

from __future__ import annotations

import numpy as np

from rsicalib.imports.log import Log, Session
from rsicalib.report.figure import Figure
from rsicalib.report.svg import Axis, Canvas, bounds, ticks

MOST_ROWS = 800
"""Rows that are drawn of a channel; a pixel shows no more."""

ROW = 46.0
"""Height of a channel."""


def recording_figure(log: Log) -> Figure | None:
    """Draw the first session that has times: a line for each channel, held stretches marked.

    Parameters
    ----------
    log : Log
        What was imported.

    Returns
    -------
    Figure or None
        None where no session has times.
    """
    timed = [session for session in log.sessions if "time_s" in session.columns and len(session)]
    if not timed:
        return None
    session = timed[0]
    whole = [session] if session.motion is None else [session, session.motion]
    time = np.concatenate([np.asarray(part.columns["time_s"], dtype=float) for part in whole])
    order = np.argsort(time, kind="stable")
    names = [n for n in session.columns if n not in ("pose", "sample", "time_s")]
    values = {}
    for name in names:
        cells = np.concatenate([np.asarray(part.columns[name]) for part in whole])
        if cells.dtype.kind in "iuf":
            values[name] = cells[order].astype(float)
    held = _stretches(session)
    span = (float(time.min()), float(max(time.max(), time.min() + 1e-9)))

    shown = np.arange(0, len(order), max(1, len(order) // MOST_ROWS))

    def draw(width: float) -> str:
        bottom = 8.0 + ROW * len(values)
        canvas = Canvas(width, bottom + 40.0)
        across = Axis(*span, 8.0, width - 10.0)
        for low, high in held:
            canvas.rect(across(low), 8.0, across(high) - across(low), bottom - 8.0, "noise")
        for number, (name, cells) in enumerate(values.items(), 1):
            up = Axis(*bounds(cells, 0.0), 4.0 + ROW * number, 24.0 + ROW * (number - 1))
            points = zip(time[order][shown].tolist(), cells[shown].tolist(), strict=True)
            canvas.path([(across(x), up(y)) for x, y in points], "law")
            canvas.line(across.start, 8.0 + ROW * number, across.end, 8.0 + ROW * number, "grid")
            canvas.text(across.start + 2.0, 19.0 + ROW * (number - 1), name)
        for value in ticks(*span, 8):
            canvas.line(across(value), bottom, across(value), bottom + 4.0, "axis")
            canvas.text(across(value), bottom + 17.0, f"{value:g}", anchor="middle")
        middle = (across.start + across.end) / 2
        canvas.text(middle, bottom + 33.0, "time [s]", anchor="middle", kind="label")
        return canvas.svg(f"{len(held)} held poses of {len(values)} channels over time")

    caption = f"{len(held)} held poses are marked; the rest is motion." if held else "A recording."
    return Figure("recording", draw, caption)


def _stretches(session: Session) -> list[tuple[float, float]]:
    """First and last time of each held pose."""
    if "pose" not in session.columns:
        return []
    pose, time = np.asarray(session.columns["pose"]), np.asarray(session.columns["time_s"])
    first = np.flatnonzero(np.diff(pose, prepend=pose[0] - 1))
    last = np.append(first[1:], len(pose)) - 1
    return list(zip(time[first].tolist(), time[last].tolist(), strict=True))
