"""One device at a time: how often a sound one is accused, how soon a changed one is."""

from __future__ import annotations

import time
from dataclasses import dataclass

import numpy as np

import rsicalib
from rsicalib.verbs.monitor import Alarm, Suspect
from tests.blind.simulator import CHANNELS
from tests.watch.device import RATE_HZ, Change, Work, calibrated

CHUNK = 10_000
"""Rows that are simulated at a time."""

QUIET = (2_000, 8_000)
"""Row at which something happens: between these."""

PATIENCE = 60_000
"""Rows after which a change counts as missed."""

COUNT = 1.45e-3
"""Nominal size of a count [rad]: changes of sensors are drawn in counts, the noise being one."""


@dataclass(frozen=True)
class Quiet:
    """A sound device at work."""

    rows: int
    alarms: int
    seconds: float


@dataclass(frozen=True)
class Found:
    """A device that changed: `delay` in rows, None where missed or accused before.

    `first` and `last` say whether the first alarm, and the last word on it, name the right part;
    `listed` and `last_listed` whether they name it or list it among those that fit as well. `size`
    is the last word's, and so is `drifts`: it goes on.
    """

    early: bool
    delay: int | None
    first: bool = False
    listed: bool = False
    last: bool = False
    last_listed: bool = False
    drifts: bool = False
    more: int = 0
    size: float = float("nan")


def quiet(seed: list[int], kind: str, promise: float, rows: int, lost: float = 0.0) -> Quiet:
    """Watch a sound device for a number of rows, a share of which does not come."""
    device, found, rng = calibrated(seed, kind)
    work = Work(device, rng, kind)
    monitor = rsicalib.Monitor(found, false_alarms=promise)
    seconds = 0.0
    while work.row < rows:
        first = work.row
        values = work.rows(min(CHUNK, rows - work.row))
        times = np.arange(first, work.row) / RATE_HZ
        if lost:
            kept = rng.random(len(values)) >= lost
            values, times = values[kept], times[kept]
        begin = time.process_time()
        monitor.update(values, times)
        seconds += time.process_time() - begin
    summary = monitor.summary()
    return Quiet(summary.rows, summary.alarms, seconds)


def one_by_one(seed: list[int], rows: int) -> float:
    """Seconds of one `update` in the core, the conversion of a row to Python and back included."""
    device, found, rng = calibrated(seed)
    monitor = rsicalib.Monitor(found)
    values = Work(device, rng).rows(rows)
    update = monitor._core.update
    begin = time.process_time()
    for row in values:
        update(row)
    return (time.process_time() - begin) / rows


def drawn(rng: np.random.Generator, what: str, size: float) -> Change:
    """A change of a size, at a random part: counts for a sensor, inches for an arm."""
    since = int(rng.integers(*QUIET))
    sign = float(rng.choice([-1.0, 1.0]))
    if what in ("step", "drift"):
        per_row = sign * size * COUNT / 10_000 if what == "drift" else None
        target = str(rng.choice(CHANNELS))
        total = sign * COUNT * (size if what == "step" else 50 * size)
        return Change(target, total, since, per_row)
    return Change(str(rng.choice(["arm1", "arm2", "arm3"])), sign * size, since, axis=what)


def changed(seed: list[int], kind: str, what: str, size: float, promise: float) -> Found:
    """Watch a device that changes, in noise of a kind."""
    device, found, rng = calibrated(seed, kind)
    change = drawn(rng, what, size)
    work = Work(device, rng, kind, change=change)
    monitor = rsicalib.Monitor(found, false_alarms=promise)
    alarms: list[Alarm] = []
    while work.row < change.since + PATIENCE:
        alarms += monitor.update(work.rows(2_000))
        news = [a for a in alarms if a.row >= change.since]
        # As much again as it took, for the name to settle.
        if news and work.row > change.since + 4 * (news[0].row - change.since) + 10_000:
            break
    return judged(change, alarms)


def judged(change: Change, alarms: list[Alarm]) -> Found:
    """What the alarms say, against what happened."""
    early = any(a.row < change.since for a in alarms)
    news = [a for a in alarms if a.row >= change.since]
    if not news or early:
        return Found(early, None)

    def right(alarm: Alarm | Suspect) -> bool:
        return alarm.target.split("/")[0] in change.names

    def listed(alarm: Alarm) -> bool:
        return right(alarm) or any(map(right, alarm.also_fits))

    first = news[0]
    words = [a for a in news if a is first or a.revises == first.row]
    return Found(
        early=False,
        delay=first.row - change.since,
        first=right(first),
        listed=listed(first),
        last=right(words[-1]),
        last_listed=listed(words[-1]),
        drifts=words[-1].rate is not None,
        more=sum(a.revises is None for a in news) - 1,
        size=words[-1].size,
    )
