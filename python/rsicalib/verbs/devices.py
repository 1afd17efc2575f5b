"""A watch over many devices in one stream of rows, each under its own result: `watch_devices`."""

from __future__ import annotations

import contextlib
import dataclasses
import math
import os
import tempfile
from collections import OrderedDict
from collections.abc import Callable, Iterable, Iterator
from pathlib import Path
from urllib.parse import quote

import numpy as np

from rsicalib import options
from rsicalib._core import Mechanism
from rsicalib.errors import InputError
from rsicalib.facts.verdicts import UNUSABLE
from rsicalib.io.frames import TableArg
from rsicalib.io.stream import Rows, rows_in_memory, rows_of
from rsicalib.plain_text import counted
from rsicalib.results.result import Result
from rsicalib.verbs.lifetime import day_of
from rsicalib.verbs.monitor import Alarm, Kept, Monitor, Watch
from rsicalib.verbs.promise import Promise
from rsicalib.work.arguments import Bare, MechanismArg, PathLike, earlier_result, open_mechanism

AWAKE = 128
"""Monitors that are in memory at a time, where nothing else is said: some 250 MB."""

ROUND = 1 << 18
"""Rows of a file that are gathered, so that a device is fetched once for them."""

COUNTED = ("rows", "used", "unreadable", "repeated", "late", "missing", "outliers", "alarms")


@options.checked
def watch_devices(
    readings: PathLike | TableArg,
    calibrations: PathLike,
    mechanism: MechanismArg = "rsi",
    *,
    false_alarms: float | str | None = None,
    state: PathLike | None = None,
    follow: bool = False,
    awake: int = AWAKE,
) -> WatchingDevices:
    """Watch many devices that share a stream of rows.

    Parameters
    ----------
    readings : path, "-", data frame or mapping
        CSV or Parquet with a column per channel and a column `device`, `time_s` optional; `-` is
        standard input.
    calibrations : path
        Folder with results (`*.json`), in it or in its folders, that say which device they are of
        (`calibrate --device NAME`); of several of one device the latest counts.
    mechanism : str, path or Mechanism
        What is read.
    false_alarms : float or str, optional
        Expected number of false alarms per sample of a device. As in Rust where not given.
    state : path, optional
        Folder that keeps all that is known of each device, one file each.
    follow : bool
        Wait for more at the end of a file of lines, until the program is ended.
    awake : int
        Devices that are in memory at a time; what is known of the others waits in files.

    Returns
    -------
    WatchingDevices
        An iterator of alarms, which say whose they are; rows are counted device by device.

    Raises
    ------
    InputError
        The readings or the results cannot be used.
    """
    opened = open_mechanism(mechanism)
    paths = _results(Path(calibrations), opened)
    source = None
    if isinstance(readings, str | os.PathLike):
        rows = rows_of(readings, Bare(opened), follow=follow, device=True)
        source = None if readings == "-" else os.path.abspath(os.fspath(readings))
    else:
        rows = iter([rows_in_memory(readings, Bare(opened), device=True)])
    live = follow or (isinstance(readings, str) and readings == "-")
    promise = Promise.of(false_alarms, devices=True)
    return WatchingDevices(
        rows if live else _gathered(rows), paths, opened, promise, state, source, awake
    )


def _results(folder: Path, mechanism: Mechanism) -> dict[str, Path]:
    """The latest result of each device, usable ones before those that are not.

    One without a date is before all that have one.
    """
    latest: dict[str, tuple[bool, float, Path]] = {}
    for path in sorted(folder.rglob("*.json")):
        try:
            result, _ = earlier_result(path, mechanism)
        except InputError:
            continue  # another file; where none is left, that is said below
        if result.device is None:
            continue
        day = day_of(result)
        own = (result.verdict not in UNUSABLE, -math.inf if day is None else day, path)
        latest[result.device] = max(own, latest.get(result.device, own))
    if not latest:
        found, expected = "no result of a named device", "results of `calibrate --device NAME`"
        raise InputError.at(str(folder), found, expected)
    return {name: path for name, (_, _, path) in latest.items()}


def _gathered(rows: Iterable[Rows]) -> Iterator[Rows]:
    """More rows at a time."""
    some: list[Rows] = []
    for one in rows:
        some.append(one)
        if sum(len(part.values) for part in some) >= ROUND:
            yield _joined(some)
            some = []
    if some:
        yield _joined(some)


def _joined(some: list[Rows]) -> Rows:
    times = [one.time_s for one in some if one.time_s is not None]
    names = tuple(name for one in some for name in one.device or ())
    values = np.concatenate([one.values for one in some])
    return Rows(values, np.concatenate(times) if times else None, names)


class WatchingDevices:
    """A watch over many devices that is under way: iterate over it for its alarms.

    Attributes
    ----------
    heard : callable or None
        Called with the number of rows so far, now and then.
    """

    def __init__(
        self,
        rows: Iterable[Rows],
        results: dict[str, Path],
        mechanism: Mechanism,
        promise: Promise,
        state: PathLike | None,
        source: str | None,
        awake: int,
    ) -> None:
        self.heard: Callable[[int], None] | None = None
        self._rows, self._results, self._mechanism = rows, results, mechanism
        self._promise, self._source, self._most = promise, source, awake
        self._folder = None if state is None else Path(state)
        self._lasting = state is not None
        self._kept: dict[str, Kept] = {}
        self._awake: OrderedDict[str, Monitor] = OrderedDict()
        self._slept: dict[str, Watch] = {}
        self._strange = 0

    def __iter__(self) -> Iterator[Alarm]:
        with contextlib.ExitStack() as stack:
            if self._folder is None:
                made = tempfile.TemporaryDirectory(prefix="rsicalib-watch-")
                self._folder = Path(stack.enter_context(made))
            self._folder.mkdir(parents=True, exist_ok=True)
            number = 0
            for rows in self._rows:
                number += len(rows.values)
                for name, own in _by_device(rows):
                    if name not in self._results:
                        self._strange += len(own)
                        continue
                    kept, untold = self._fetched(name)
                    alarms = [*untold, *(kept.take(rows.of(own)) or ())]
                    yield from (dataclasses.replace(alarm, device=name) for alarm in alarms)
                if self.heard is not None:
                    self.heard(number)
            for name in self._awake:
                self._kept[name].end()

    def _fetched(self, name: str) -> tuple[Kept, list[Alarm]]:
        """What is known of a device, in memory, and what may not have been told of it."""
        untold: list[Alarm] = []
        if name in self._awake:
            self._awake.move_to_end(name)
            return self._kept[name], untold
        while len(self._awake) >= self._most:
            other, monitor = self._awake.popitem(last=False)
            self._slept[other] = monitor.summary()
            self._kept[other].sleep()
        assert self._folder is not None
        monitor = Monitor(self._result(name), self._mechanism, false_alarms=self._promise.rate)
        if name in self._kept:
            self._kept[name].wake(monitor)
        else:
            source = None if self._source is None else f"{self._source}, {name}"
            state = self._folder / f"{quote(name, safe='')}.state"
            self._kept[name] = Kept(monitor, self._promise, state, source, self._lasting)
            untold = self._kept[name].untold()
        self._awake[name] = monitor
        return self._kept[name], untold

    def _result(self, name: str) -> Result:
        return earlier_result(self._results[name], self._mechanism)[0]

    def __repr__(self) -> str:
        devices = counted(len(self._results), "device")
        return f"<WatchingDevices of {devices}: iterate for their alarms>"

    def summary(self) -> Watch:
        """What became of the rows of all devices so far."""
        now = {name: monitor.summary() for name, monitor in self._awake.items()}
        each = list({**self._slept, **now}.values())
        counted = {name: sum(getattr(one, name) for one in each) for name in COUNTED}
        counted["rows"] += self._strange
        return Watch(
            **counted,
            devices=len(each),
            strange=self._strange,
            false_alarms=self._promise.rate,
            false_alarms_per_hour=None,
            noise=float(np.median([one.noise for one in each])) if each else 1.0,
            correlation=float(np.median([one.correlation for one in each])) if each else 0.0,
        )


def _by_device(rows: Rows) -> Iterator[tuple[str, list[int]]]:
    """Places of the rows of each device, in the order in which devices come."""
    found: dict[str, list[int]] = {}
    for place, name in enumerate(rows.device or ()):
        found.setdefault(name, []).append(place)
    return iter(found.items())
