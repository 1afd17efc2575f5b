"""A calibration at work: the verb `watch`, and `Monitor` for a loop of one's own."""

from __future__ import annotations

import hashlib
import json
import math
import os
import time
from collections.abc import Callable, Iterable, Iterator, Mapping
from dataclasses import field
from typing import Any, Literal

import numpy as np
import numpy.typing as npt

from rsicalib import _core, options
from rsicalib._core import Mechanism
from rsicalib.errors import InputError
from rsicalib.facts.records import IF_KNOWN, Record, to_json
from rsicalib.facts.shapes import Rms
from rsicalib.imports.kinds import KINDS, format_of
from rsicalib.imports.log import Log
from rsicalib.imports.opening import import_log, joints_of
from rsicalib.io.frames import TableArg, as_table, is_frame
from rsicalib.io.readings import Readings
from rsicalib.io.stream import Rows, rows_in_memory, rows_of
from rsicalib.io.times import TIME
from rsicalib.plain_text import counted, quoted
from rsicalib.results.result import Calibration, Result, Trace
from rsicalib.tabular import Told
from rsicalib.units import HALF_95, with_unit
from rsicalib.verbs.promise import PROMISED, Promise, another
from rsicalib.work.applying import as_applied, covariance_of
from rsicalib.work.arguments import (
    Bare,
    CalibrationArg,
    MechanismArg,
    PathLike,
    ReadingsArg,
    earlier_result,
    load,
    mechanism_beside,
    open_mechanism,
)
from rsicalib.work.state import read_state, write_state

ALARM = "rsicalib.alarm/1"

ACTIONS = {"go_on": "go on", "recalibrate": "calibrate again", "stop": "stop"}
"""Words for what an alarm asks for."""

WATCH = "rsicalib.watch/1"

RESULTS: dict[str, type[Result]] = {kind.FORMAT: kind for kind in (Calibration, Trace)}

SAVED_S = 1.0
"""A state on disk is no older, beside what the last rows have changed."""


EPOCH = np.datetime64(0, "s")
"""From here dates count where rows come frame by frame: each frame begins at another one."""


class Change(Record):
    """By how much one parameter has changed."""

    name: str
    """Name of the parameter."""
    value: float
    """By how much it has changed."""
    sd: float
    """Standard deviation of that."""
    unit: str
    """Unit of both."""


class Suspect(Record):
    """A change that fits as well."""

    term: str
    """Id of the term."""
    target: str
    """What the term belongs to."""


class Alarm(Told, Record, kw_only=True, repr=False):
    """A change of the device since its calibration: one line of `rsicalib watch`."""

    format: str = ALARM
    """Kind of the line and version of its shape."""
    device: str | None = None
    """Whose alarm it is, of several devices in one stream; None of one."""
    since: float
    """When it began: time of the row [s], or its number where rows have no time."""
    since_row: int
    """Number of that row, from 0, all rows counted."""
    row: int
    """Number of the row that raised the alarm."""
    time_s: float | None
    """Time of that row [s]."""
    term: str
    """What has changed: `offset`, `gain`, `reference`, `distance`, `link_frame`, `point_position`,
    `noise`, `stuck`, `loose` or `unnamed`, explained in a table of `docs/watch.md`."""
    target: str
    """Where: `a22`, `wrist1-wrist2`, `arm2/2`, `arm2`, `all`."""
    size: float
    """How large; what that is, the same table says."""
    sd: float
    """Standard deviation of the size."""
    unit: str
    """Unit of both."""
    rate: Change | None = None
    """What goes on: the rate at which the size grows, per hour where rows have a time, else per
    row. None for a change that stands still."""
    parameters: tuple[Change, ...]
    """All parameters of the change."""
    platform_rms: Rms | None
    """What it does to the platform, over poses seen; None without a platform."""
    p_value: float
    """Probability of such a deviation by chance, corrected for the tests of one sample."""
    also_fits: tuple[Suspect, ...] = ()
    """Changes that the readings cannot tell from it, or not yet."""
    revises: int | None = None
    """`row` of an earlier alarm whose name this one corrects; None for a new change."""
    action: Literal["go_on", "recalibrate", "stop"] = "recalibrate"
    """What to do: `go_on` where it moves the platform by less than the noise of one sample does;
    `recalibrate`; `stop` where the readings cannot be trusted and no calibration mends that."""
    unnamed: Literal["many_alarms", "far_off"] | None = field(default=None, metadata=IF_KNOWN)
    """Why a change has no name: alarms follow each other, and nothing is tested any more; or loops
    are far open, and nothing is tested until they close again. None of one that has a name."""

    def text(self) -> str:
        """The alarm as a sentence."""
        when = f"row {self.since_row}" if self.time_s is None else f"{self.since:.6g} s"
        unit = "" if self.unit == "1" else self.unit
        size = with_unit(_interval(self.size, self.sd), unit)
        if self.term == "unnamed":
            place = "" if self.target == "all" else f" at {self.target}"
            words = f"something has changed{place} since {when} that the watch has no name for"
            words += (
                f" ({self.size:.0f} alarms); it is silent from here on"
                if self.unnamed == "many_alarms"
                else f": loops are open by {with_unit(f'{self.size:.3g}', unit)}; "
                "nothing is tested until they close again"
            )
        elif self.term == "stuck":
            words = (
                f"{self.target} is stuck since {when}: it repeats {self.parameters[0].value:.6g}"
            )
        elif self.term == "noise":
            words = f"{self.target} scatters since {when} by {size}"
        elif self.term == "loose":
            words = f"{self.target} is loose since {when}: its end moves by {size} from row to row"
        else:
            what = "has changed" if self.rate is None else "drifts"
            words = f"{self.target} {what} since {when}: {self.term} by {size}"
        if self.rate is not None:
            rate = _interval(self.rate.value, self.rate.sd)
            words += f", now {with_unit(rate, self.rate.unit)}"
        if self.platform_rms is not None and self.platform_rms.position is not None:
            words += f", the platform by {self.platform_rms.position:.2g}"
        if self.also_fits:
            also = (
                f"its {s.term}" if s.target == self.target else s.target for s in self.also_fits
            )
            words += f"; or {', '.join(dict.fromkeys(also))}"
        if self.revises is not None:
            words += f" (this was named otherwise in row {self.revises})"
        words += f" - {ACTIONS[self.action]}"
        return words if self.device is None else f"{self.device}: {words}"

    def __repr__(self) -> str:
        size = with_unit(_interval(self.size, self.sd), self.unit)
        return f"<Alarm in row {self.row}: {self.term}@{self.target} by {size}>"


def _interval(value: float, sd: float) -> str:
    """A value and half of its interval of 95 %."""
    return f"{value:.3g} ± {HALF_95 * sd:.2g}"


class Watch(Told, Record, kw_only=True, repr=False):
    """Summary of a watch."""

    format: str = WATCH
    """Kind of the summary and version of its shape."""
    rows: int
    """Rows that came."""
    used: int
    """Rows that were tested."""
    unreadable: int
    """Rows with a reading that is no number in its channel's range."""
    repeated: int
    """Rows equal to the row before, or with its time."""
    late: int
    """Rows with a time before that of an earlier row."""
    missing: int
    """Rows that were not there when due, told by gaps in time."""
    outliers: int
    """Rows far outside that no later row confirmed."""
    silent: int = 0
    """Rows that were not tested: a channel was stuck, or the device has changed in a way that
    has no name."""
    alarms: int
    """Alarms that were raised."""
    false_alarms: float
    """Promised rate of false alarms, per sample."""
    false_alarms_per_hour: float | None
    """The same per hour, where rows have a time."""
    noise: float
    """Noise at work over that of the calibration."""
    correlation: float
    """Correlation of neighbouring samples."""
    devices: int | None = None
    """Devices of which rows came, of several in one stream: noise and correlation are their
    medians. None of one device."""
    strange: int = 0
    """Rows of devices without a result."""

    def text(self) -> str:
        """The summary as a few lines."""
        of_kind = {
            "unreadable": self.unreadable,
            "repeated": self.repeated,
            "late": self.late,
            "steps of time without a row": self.missing,
            "outliers": self.outliers,
            "while stuck, or after a change without a name": self.silent,
            "of devices without a result": self.strange,
        }
        left = ", ".join(f"{count} {word}" for word, count in of_kind.items() if count)
        rate = f"{self.false_alarms:.3g} per sample"
        if self.false_alarms_per_hour is not None:
            rate += f", {self.false_alarms_per_hour:.3g} per hour"
        of = "" if self.devices is None else f", {counted(self.devices, 'device')}"
        tested = f"{self.used} of {self.rows} rows tested{of}" + (f" ({left})" if left else "")
        if 2 * (self.unreadable + self.late) > self.rows:
            tested += (
                "\nmost rows cannot be tested: a watch reads numbers in the units of the mechanism "
                "file, within the ranges of its channels, in rows whose time_s goes on"
            )
        return "\n".join(
            [
                tested,
                f"alarms   {self.alarms} (false ones expected: {rate})",
                f"noise    {self.noise:.2f} of the calibration's, neighbours correlated by "
                f"{self.correlation:.2f}",
            ]
        )

    def __repr__(self) -> str:
        alarms = counted(self.alarms, "alarm")
        return f"<Watch: {self.used} of {self.rows} rows tested, {alarms}>"


class Monitor:
    """A calibrated mechanism that is watched at work, sample by sample.

    A closed chain closes its loops in every sample, unless something has changed: a sensor, a
    link, a closure. `update` takes a sample and returns the alarms that it raises. The error
    of the calibration itself is no alarm: it is estimated from the samples, beside every change
    that is tested, see `docs/watch.md`.

    Parameters
    ----------
    calibration : path, Calibration or Trace
        A result of the device.
    mechanism : str, path or Mechanism
        What is read.
    false_alarms : float, optional
        Expected number of false alarms per sample; 1e-5 where not given.

    Raises
    ------
    InputError
        The result cannot be used, or the mechanism has loops that are not closed in every sample
        (points that readings tell apart, distances in columns).

    Examples
    --------
    >>> import rsicalib
    >>> from rsicalib import DEMO
    >>> found = rsicalib.trace(DEMO / "readings.csv", rest=DEMO / "rest.csv")
    >>> monitor = rsicalib.Monitor(found)
    >>> for row in rsicalib.load_readings(DEMO / "check.csv").values:
    ...     assert monitor.update(row) == []
    """

    @options.checked
    def __init__(
        self,
        calibration: CalibrationArg,
        mechanism: MechanismArg = "rsi",
        *,
        false_alarms: float | None = None,
    ) -> None:
        result, self.mechanism = earlier_result(calibration, open_mechanism(mechanism, calibration))
        self.calibration = result
        applied = as_applied(result, self.mechanism)
        noise = result.noise
        assert noise is not None  # as_applied has refused it
        self.false_alarms = _core.FALSE_ALARMS if false_alarms is None else false_alarms
        covariance = covariance_of(result)
        if covariance is None:
            raise InputError("calibration: found no covariance, expected one of its parameters")
        self._core = _core.Monitor(
            self.mechanism,
            applied,
            covariance,
            false_alarms=self.false_alarms,
            dof=noise.dof,
            correlation=noise.correlation or 0.0,
        )
        self._names = [channel.name for channel in self.mechanism.channels]

    def __repr__(self) -> str:
        seen = self._core.counts()
        rows, alarms = (counted(seen[f"{what}s"], what) for what in ("row", "alarm"))
        return f"<Monitor of {self.mechanism.name!r}: {rows}, {alarms}>"

    def update(
        self,
        readings: npt.ArrayLike | Mapping[str, float] | Readings | TableArg,
        time_s: npt.ArrayLike | None = None,
    ) -> list[Alarm]:
        """Test one sample, or several one after the other.

        Parameters
        ----------
        readings : array_like, shape (channels,) or (n, channels), mapping, data frame or a row
            of one, or Readings
            In each channel's unit, in the mechanism's order or by name.
        time_s : float or array_like, shape (n,), optional
            Time of each sample [s]; that of `Readings`, or `time_s` of a frame or a mapping, where
            they have one. Dates in a frame are counted from 1970.

        Returns
        -------
        list of Alarm
            Nearly always empty. Samples that cannot be used, are late or repeated raise none;
            `summary` counts them.

        Raises
        ------
        InputError
            The readings are not of these channels.
        """
        given: Any = readings
        if getattr(given, "ndim", 2) == 1 and hasattr(given, "to_dict"):
            given = given.to_dict()  # a row of a frame, by name
        if isinstance(given, Mapping):
            missing = [name for name in self._names if name not in given]
            if missing:
                found = f"no reading of {missing[0]}"
                raise InputError(f"{found}; expected one of each of {', '.join(self._names)}")
            if all(np.ndim(given[name]) == 0 for name in self._names):
                time_s = given.get(TIME) if time_s is None else time_s
                given = [given[name] for name in self._names]
        if isinstance(given, Readings):
            time_s = given.time_s if time_s is None else time_s
            given = given.values
        elif is_frame(given) or isinstance(given, Mapping):
            table = rows_in_memory(given, Bare(self.mechanism), since=EPOCH)
            time_s = table.time_s if time_s is None else time_s
            given = table.values
        expected = f"numbers, of shape ({len(self._names)},) or (n, {len(self._names)})"
        try:
            values = np.ascontiguousarray(given, dtype=np.float64)
        except (TypeError, ValueError):
            raise InputError(f"found {quoted(str(given)[:40])}, expected {expected}") from None
        if values.ndim not in (1, 2):
            raise InputError(f"found readings of shape {np.shape(given)}, expected {expected}")
        if values.ndim == 1:
            one = None if time_s is None else float(np.asarray(time_s))
            return _alarms(self._core.update(values, one))
        times = None if time_s is None else np.ascontiguousarray(time_s, dtype=np.float64)
        return _alarms(self._core.update_all(values, times))

    def save(self, path: PathLike, **more: Any) -> None:
        """Write all that the watch knows to a file, whole or not at all.

        Parameters
        ----------
        path : path
            Where to; `Monitor.load` goes on from there.
        **more
            What is to be found in the head of the file, as JSON.
        """
        write_state(path, {**self._head(), **more}, self._core.state())

    @classmethod
    def load(cls, path: PathLike) -> Monitor:
        """A watch that goes on where another one ended, alarm by alarm as if it had not.

        Parameters
        ----------
        path : path
            What `save`, or `watch` with a state, has written.

        Raises
        ------
        InputError
            It is no such file, or a damaged one.
        """
        head, state = read_state(path)
        try:
            own = Mechanism.from_toml(head["mechanism"])
            result = RESULTS[head["calibration"]["format"]].from_dict(head["calibration"])
            monitor = cls(result, own, false_alarms=head["false_alarms"])
        except (KeyError, TypeError) as error:
            found, expected = f"a head without {error}", "what a watch has written"
            raise InputError.at(str(path), found, expected) from None
        monitor._core.restore(state)
        return monitor

    def restore(self, path: PathLike) -> dict[str, Any]:
        """Go on where the watch ended whose file this is; the head of the file.

        Raises
        ------
        InputError
            The file is damaged, or of a watch under another result or with another rate.
        """
        head, state = read_state(path)
        own = json.loads(to_json(self._head()))
        for key, words in (
            ("mechanism", "mechanism"),
            ("calibration", "calibration"),
            ("false_alarms", "rate of false alarms"),
            ("version", "version of rsicalib"),
        ):
            if head.get(key) != own[key]:
                raise another(path, words)
        self._core.restore(state)
        return head

    def _head(self) -> dict[str, Any]:
        """What a watch is made from."""
        return {
            "version": _core.__version__,
            "mechanism": self.mechanism.to_toml(),
            "calibration": self.calibration.to_dict(),
            "false_alarms": self.false_alarms,
        }

    def __reduce__(self) -> tuple[Any, ...]:
        made = (self.calibration, self.mechanism, self.false_alarms, self._core.state())
        return _again, made

    def summary(self) -> Watch:
        """What became of the samples so far.

        Returns
        -------
        Watch
            Counts, and the noise at work.
        """
        noise, correlation = self._core.noise
        interval = self._core.interval
        hourly = self.false_alarms * 3600.0 / interval if interval else None
        return Watch(
            **self._core.counts(),
            false_alarms=self.false_alarms,
            false_alarms_per_hour=hourly,
            noise=noise,
            correlation=correlation,
        )


def _again(calibration: Result, mechanism: Mechanism, false_alarms: float, state: bytes) -> Monitor:
    """A watch out of a pickle."""
    monitor = Monitor(calibration, mechanism, false_alarms=false_alarms)
    monitor._core.restore(state)
    return monitor


def _alarms(found: list[dict[str, Any]]) -> list[Alarm]:
    return [Alarm.from_dict(one) for one in found]


def watch(
    readings: ReadingsArg,
    calibration: CalibrationArg,
    mechanism: MechanismArg = "rsi",
    *,
    false_alarms: float | str | None = None,
    state: PathLike | None = None,
    follow: bool = False,
) -> Watching:
    """Watch a device at work: alarms while its readings arrive.

    Parameters
    ----------
    readings : path, "-", Readings, data frame, array or mapping
        CSV or Parquet with a column per channel, `time_s` optional; `-` is standard input. Joint
        states as `ros2 topic echo` prints them are taken as they come, and a log of another
        program as `import_log` reads it.
        Memory does not grow with the number of rows.
    calibration : path, Calibration or Trace
        A result of the device.
    mechanism : str, path or Mechanism
        What is read.
    false_alarms : float or str, optional
        Expected number of false alarms per sample; or `"0.1/h"`, per hour, where rows have a
        time: the pace is the median of the first 32 steps between rows, which are read before the
        first is tested. As in Rust where not given.
    state : path, optional
        File that keeps all that the watch knows: written while it runs, and where there is one,
        gone on from, behind the rows of the same file that it has seen.
    follow : bool
        Wait for more at the end of a file of lines, until the program is ended.

    Returns
    -------
    Watching
        An iterator of alarms; its `summary` counts what became of the rows so far.

    Raises
    ------
    InputError
        The readings or the result cannot be used.
    """
    mechanism = mechanism_beside(mechanism, calibration)
    result, opened = earlier_result(calibration, open_mechanism(mechanism))
    source = None
    if isinstance(readings, str | os.PathLike):
        rows = _rows(readings, mechanism, opened, follow)
        source = None if readings == "-" else os.path.abspath(os.fspath(readings))
    else:
        rows = iter(_given(readings, opened))
    promise = Promise.of(false_alarms)
    rate, rows = promise.per_sample(rows, state)
    return Watching(Monitor(result, opened, false_alarms=rate), rows, promise, state, source)


def _given(readings: Readings | Log | TableArg, mechanism: Mechanism) -> list[Rows]:
    """Rows that are in memory already; NaN where a cell of a table cannot be used."""
    if isinstance(readings, Log):
        sessions = readings.readings(Bare(mechanism))
        return [Rows(one.values, one.time_s) for one in sessions]
    if not isinstance(readings, Readings):
        table: Any = as_table(readings)
        if is_frame(table) or isinstance(table, Mapping):
            return [rows_in_memory(table, Bare(mechanism))]
        readings = load(table, Bare(mechanism), False)
    return [Rows(readings.values, readings.time_s)]


def _rows(
    readings: PathLike, given: MechanismArg, opened: Mechanism, follow: bool
) -> Iterator[Rows]:
    """Rows of a file of lines as they stand there, or of the log of another program."""
    kind = format_of(readings)
    if kind is None or kind == "echo" or follow:
        if kind not in (None, "echo"):
            found = f"a {KINDS[kind].words}, which is read when it is whole"
            expected = "lines that grow, such as ros2 topic echo /joint_states > FILE"
            raise InputError.at(os.fspath(readings), found, expected)
        return rows_of(readings, Bare(opened), joints_of(given), follow=follow)
    log = import_log(readings, mechanism=given, hold=0.0)
    return (Rows(one.values, one.time_s) for one in log.readings(Bare(opened)))


class Kept:
    """A monitor of one source of rows, with all that it knows in a file."""

    def __init__(
        self,
        monitor: Monitor,
        promise: Promise,
        state: PathLike | None,
        source: str | None,
        lasting: bool = True,
    ) -> None:
        self.monitor = monitor
        self._promise = promise
        self._state, self._source = state, source
        # A file that is for sleep alone is written then only.
        self._lasting = lasting
        self._digest = hashlib.sha256()
        self._known: dict[str, Any] = {}
        self._number = 0
        self._saved = -math.inf
        if state is not None and os.path.exists(state):
            self._known = monitor.restore(state)
        same = source is not None and self._known.get("source") == source
        self._seen = self._known.get("rows", 0) if same else 0

    def untold(self) -> list[Alarm]:
        """Alarms that the watch before may not have told.

        An alarm is in the file before it is told, so that none is lost; one that was being told
        when the watch was ended may be told twice.
        """
        return [Alarm.from_dict(one) for one in self._known.get("untold", ())]

    def take(self, rows: Rows) -> list[Alarm] | None:
        """Alarms of the next rows; None where the watch before has seen them all."""
        number = self._number
        known = min(max(self._seen - number, 0), len(rows.values))
        self._number += len(rows.values)
        self._digest.update(rows.values[:known].tobytes())
        if number < self._seen <= self._number:
            self._is_same(self._digest.hexdigest() == self._known.get("digest"))
        if known == len(rows.values):
            return None
        self._digest.update(rows.values[known:].tobytes())
        times = None if rows.time_s is None else rows.time_s[known:]
        alarms = self.monitor.update(rows.values[known:], times)
        if self._lasting and (alarms or time.monotonic() - self._saved > SAVED_S):
            self.save(alarms)
            self._saved = -math.inf if alarms else time.monotonic()
        return alarms

    def sleep(self) -> None:
        """Leave all that is known in the file, and the monitor to be forgotten."""
        self.save([])
        del self.monitor

    def wake(self, monitor: Monitor) -> None:
        """Go on from the file with a monitor of the same device."""
        assert self._state is not None
        monitor.restore(self._state)
        self.monitor = monitor

    def end(self) -> None:
        """No more rows come."""
        self._is_same(self._number >= self._seen)
        if self._lasting:
            self.save([])

    def _is_same(self, same: bool) -> None:
        """Refuse a file that has other rows than when the watch saw it."""
        if not same:
            found = f"the state of a watch that has seen other rows of {self._source}"
            expected = "the same file, grown; remove the state to begin anew"
            raise InputError.at(str(self._state), found, expected)

    def save(self, untold: list[Alarm]) -> None:
        """Write all that is known, and the alarms that are about to be told."""
        if self._state is not None:
            told = [alarm.to_dict() for alarm in untold]
            head = {PROMISED: str(self._promise), "source": self._source, "rows": self._number}
            self.monitor.save(self._state, **head, digest=self._digest.hexdigest(), untold=told)


class Watching:
    """A watch that is under way: iterate over it for its alarms.

    Attributes
    ----------
    monitor : Monitor
        What tests the rows.
    heard : callable or None
        Called with the number of rows so far, now and then.
    """

    def __init__(
        self,
        monitor: Monitor,
        rows: Iterable[Rows],
        promise: Promise,
        state: PathLike | None = None,
        source: str | None = None,
    ) -> None:
        self.monitor = monitor
        self.heard: Callable[[int], None] | None = None
        self._rows = rows
        self._kept = Kept(monitor, promise, state, source)

    def __iter__(self) -> Iterator[Alarm]:
        yield from self._kept.untold()
        number = 0
        for rows in self._rows:
            number += len(rows.values)
            alarms = self._kept.take(rows)
            if alarms is None:
                continue
            yield from alarms
            if self.heard is not None:
                self.heard(number)
        self._kept.end()

    def __repr__(self) -> str:
        return f"<Watching of {self.monitor.mechanism.name!r}: iterate for its alarms>"

    def summary(self) -> Watch:
        """What became of the rows so far."""
        return self.monitor.summary()
