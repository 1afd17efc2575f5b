"""What was measured, on disk before anybody sees it.

`samples.csv` holds every sample in the order of its arrival; `readings.csv` and `held_out.csv` the
poses that were taken, `passed.csv` where else the hand has been. Each write is forced to the disk.
After a crash, a line that is half written is dropped, and a pose of which rows are missing is taken
again from its samples.
"""

from __future__ import annotations

import csv
import json
import os
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import TextIO

from rsicalib.errors import InputError
from rsicalib.io.files import write_text
from rsicalib.io.messages import message_of, positions_of
from rsicalib.io.sources import read_json, read_text


@dataclass(frozen=True)
class Sample:
    """One sample: when [s], how warm [°C], the channels in order, and what it touches."""

    time_s: float
    temperature_c: float | None
    values: tuple[float, ...]
    keys: tuple[str, ...] = ()
    """Text columns that unknown points and planes need, in their order."""


@dataclass(frozen=True)
class Taken:
    """Poses of a session by label: those to fit, those that check the closure, and others where the
    hand has been, from which the next pose was approached as from any other.
    """

    fitted: dict[int, list[Sample]]
    kept_out: dict[int, list[Sample]] = field(default_factory=dict)
    passed: dict[int, list[Sample]] = field(default_factory=dict)

    def rows(self) -> list[tuple[int, Sample]]:
        """All poses, in the order in which they were taken."""
        poses = {**self.fitted, **self.kept_out, **self.passed}
        order = sorted(poses, key=lambda k: poses[k][0].time_s)
        return [(label, sample) for label in order for sample in poses[label]]


class Columns:
    """Lines as samples: CSV, the header first and columns in any order, or one JSON object each."""

    def __init__(
        self,
        channels: Sequence[str] | Mapping[str, str],
        keys: Sequence[str] = (),
        labels: Mapping[str, str] | None = None,
    ) -> None:
        """`channels` may map to joints, as messages may call them; `labels` are of every line."""
        self._labels = dict(labels or {})
        self.channels = tuple(channels)
        self._joints = dict(channels) if isinstance(channels, Mapping) else {}
        self.keys = tuple(keys)
        self._header: list[str] | None = None

    def sample(self, line: str, clock_s: float) -> Sample | str | None:
        """A sample; None for the header and for empty lines; else what is wrong, in words."""
        row = _message(line) if line.lstrip().startswith("{") else self._row(line)
        if not isinstance(row, dict):
            return row
        row |= {c: row[joint] for c, joint in self._joints.items() if joint in row}
        row |= self._labels
        missing = [c for c in (*self.channels, *self.keys) if c not in row]
        if missing:
            return f"found no {missing[0]}"
        try:
            values = tuple(float(row[name]) for name in self.channels)
            time_s = float(row["time_s"]) if row.get("time_s") else clock_s
            warm = float(row["temperature_c"]) if "temperature_c" in row else None
        except ValueError as error:
            return f"found no number ({error})"
        if not all(abs(v) < float("inf") for v in (*values, time_s, warm or 0.0)):
            return "found a reading that is not a number"
        keys = tuple(row[name] for name in self.keys)
        if not all(keys):
            return f"found no {self.keys[keys.index('')]}"
        return Sample(time_s, warm, values, keys)

    def _row(self, line: str) -> dict[str, str] | str | None:
        """Cells of a line of CSV by their columns."""
        cells = [cell.strip() for cell in line.strip().split(",")]
        if cells == [""]:
            return None
        needed = [c for c in (*self.channels, *self.keys) if c not in self._labels]
        if {*needed} <= set(cells):
            self._header = cells
            return None
        if self._header is None:
            missing = ", ".join(c for c in needed if c not in cells)
            return f"found no header with the channels ({missing} missing)"
        if len(cells) != len(self._header):
            return f"found {len(cells)} columns, expected {len(self._header)}"
        return dict(zip(self._header, cells, strict=True))


def _message(line: str) -> dict[str, str] | str:
    """Values of a message by their names: flat, or as `sensor_msgs/JointState` has them."""
    found = message_of(line)
    found = positions_of(found) if isinstance(found, dict) else found
    if isinstance(found, str):
        return found
    plain = {k: v for k, v in found.items() if isinstance(v, int | float | str)}
    return {k: str(v) for k, v in plain.items() if not isinstance(v, bool)}


WIRES = "wires.json"
"""Which channels were taken over as exchanged."""

FITTED = 3
"""Poses before the first that is kept out, where it is not known how many a trace needs."""


class Log:
    """The files of a session in one folder; the first `fitted` poses are fitted in any case."""

    def __init__(
        self,
        folder: Path,
        channels: Sequence[str],
        resume: bool,
        keys: Sequence[str] = (),
        fitted: int = FITTED,
    ) -> None:
        self.folder = folder
        self.fitted = fitted
        self.channels = tuple(channels)
        self.keys = tuple(keys)
        try:
            folder.mkdir(parents=True, exist_ok=True)
        except OSError as error:
            found = f"'{folder}', which cannot be made ({error.strerror})"
            raise InputError(f"--out: found {found}, expected a folder") from None
        there = (folder / "samples.csv").exists()
        if there and not resume:
            found = f"a session in '{folder}'"
            raise InputError(f"--out: found {found}, expected an empty folder, or --resume")
        self.samples: list[Sample] = []
        self.poses: dict[int, list[Sample]] = {}
        self._files: dict[str, TextIO] = {}
        self.passed: dict[int, list[Sample]] = {}
        """Where the hand has been and no pose is: those that were measured again, and places where
        nothing was to be measured. Their labels are below 0.
        """
        self.exchanged: list[tuple[str, str]] = []
        """Channels whose wires are exchanged: what arrives as one is of the other."""
        if there:
            self._restore()

    def held_out(self, label: int) -> bool:
        """Whether a pose is kept out of the fit: the next after those that are fitted in any case,
        and every fourth from there on.
        """
        return label > self.fitted and (label - self.fitted) % 4 == 1

    @property
    def columns(self) -> list[str]:
        """Channels in the order in which their numbers arrive, and stand in the files."""
        names = list(self.channels)
        for pair in self.exchanged:
            one, other = map(names.index, pair)
            names[one], names[other] = names[other], names[one]
        return names

    def named(self, sample: Sample) -> Sample:
        """A sample as it arrives, by the channels that its numbers are of."""
        if not self.exchanged:
            return sample
        of = dict(zip(self.columns, sample.values, strict=True))
        return replace(sample, values=tuple(of[name] for name in self.channels))

    def exchange(self, one: str, other: str) -> None:
        """Take what arrived, and will arrive, as one channel for the other's.

        Numbers stay where they are in the files, and their columns change names: a file that was
        not reached before the program was killed is named when the session is resumed.
        """
        before = self.columns
        self.exchanged.append((one, other))
        write_text(self.folder / WIRES, json.dumps({"exchanged": self.exchanged}) + "\n")
        turned = dict(zip(self.columns, before, strict=True))
        place = [self.channels.index(turned[name]) for name in self.channels]

        def again(sample: Sample) -> Sample:
            return replace(sample, values=tuple(sample.values[k] for k in place))

        self.samples = [again(s) for s in self.samples]
        self.poses = {k: [again(s) for s in rows] for k, rows in self.poses.items()}
        self.passed = {k: [again(s) for s in rows] for k, rows in self.passed.items()}
        self._rewrite_all()

    @property
    def warm(self) -> bool:
        """Whether samples have a temperature: as the first has."""
        return bool(self.samples) and self.samples[0].temperature_c is not None

    def take(self, samples: Sequence[Sample]) -> None:
        """Write samples to the disk."""
        if samples:
            self.samples += samples
            _append(self._file("samples"), (self._cells(s) for s in samples))

    def pose(self, label: int, samples: Sequence[Sample]) -> None:
        """Write a pose that was taken to the disk, its rows in one go."""
        self.poses[label] = list(samples)
        self._append_pose(label, samples)

    def _append_pose(self, label: int, samples: Sequence[Sample]) -> None:
        rows = ([label, k, *self._cells(s)] for k, s in enumerate(samples, start=1))
        _append(self._file(self._name(label)), rows)

    def taken(self) -> Taken:
        """The session as it was taken."""
        fitted = {k: list(v) for k, v in self.poses.items() if not self.held_out(k)}
        kept_out = {k: list(v) for k, v in self.poses.items() if self.held_out(k)}
        return Taken(fitted, kept_out, {k: list(v) for k, v in self.passed.items()})

    def passes(self, samples: Sequence[Sample]) -> None:
        """Write to the disk where the hand has been and no pose is."""
        label = -len(self.passed) - 1
        self.passed[label] = list(samples)
        self._append_pose(label, samples)

    def withdraw(self, label: int) -> None:
        """Take a pose out of its file: it is measured again."""
        samples = self.poses.pop(label, None)
        if samples is not None:
            self.passes(samples)
        self._rewrite(self._name(label))

    def _name(self, label: int) -> str:
        if label < 0:
            return "passed"
        return "held_out" if self.held_out(label) else "readings"

    @property
    def _every(self) -> dict[int, list[Sample]]:
        return {**self.poses, **self.passed}

    def _header(self, name: str) -> list[str]:
        of_pose = [] if name == "samples" else ["pose", "sample"]
        warm = ["temperature_c"] if self.warm else []
        return [*of_pose, "time_s", *warm, *self.columns, *self.keys]

    def _file(self, name: str) -> TextIO:
        """A file to append to, with its header."""
        if name not in self._files:
            path = self.folder / f"{name}.csv"
            new = not path.exists() or path.stat().st_size == 0
            try:
                self._files[name] = path.open("a", encoding="utf-8", newline="")
            except OSError as error:
                found = f"'{path}', where one cannot write ({error.strerror})"
                raise InputError(f"--out: found {found}, expected a folder") from None
            if new:
                _append(self._files[name], [self._header(name)])
        return self._files[name]

    def _rewrite(self, name: str) -> None:
        """Write a file anew, whole or not at all."""
        if name in self._files:
            self._files.pop(name).close()
        rows: list[list[object]]
        if name == "samples":
            rows = [self._cells(s) for s in self.samples]
        else:
            poses = {k: v for k, v in self._every.items() if self._name(k) == name}
            rows = [
                [k, i, *self._cells(s)]
                for k in sorted(poses, key=lambda k: poses[k][0].time_s)
                for i, s in enumerate(poses[k], start=1)
            ]
        lines = [",".join(self._header(name)), *(",".join(map(str, row)) for row in rows)]
        write_text(self.folder / f"{name}.csv", "\n".join(lines) + "\n")

    def _restore(self) -> None:
        """Read back what is whole, and drop the rest."""
        self.exchanged = self._wires()
        self.samples = [self._sample(row) for row in self._rows("samples")]
        for name in ("readings", "held_out", "passed"):
            for row in self._rows(name):
                poses = self.passed if name == "passed" else self.poses
                poses.setdefault(int(row["pose"]), []).append(self._sample(row))
        if len(self.poses) > 1:
            # Rows of a pose are written together: the last pose alone may lack some.
            last = max(self.poses, key=lambda k: self.poses[k][-1].time_s)
            usual = max(len(rows) for rows in self.poses.values())
            if len(self.poses[last]) < usual:
                del self.poses[last]
        self._rewrite_all()

    def _rewrite_all(self) -> None:
        """Write every file that is there anew."""
        for name in ("samples", "readings", "held_out", "passed"):
            if (self.folder / f"{name}.csv").exists():
                self._rewrite(name)

    def _wires(self) -> list[tuple[str, str]]:
        """Channels that were taken over as exchanged."""
        path = self.folder / WIRES
        if not path.exists():
            return []
        expected = "pairs of channels in 'exchanged'"
        kept = read_json(path, expected)
        try:
            pairs = [(str(a), str(b)) for a, b in kept["exchanged"]]
            if {name for pair in pairs for name in pair} <= set(self.channels):
                return pairs
            error: Exception = ValueError("a name that is no channel")
        except (KeyError, TypeError, ValueError) as wrong:
            error = wrong
        raise InputError.at(str(path), str(error), expected)

    def _rows(self, name: str) -> list[dict[str, str]]:
        """Rows of a file that are whole: a last line without its end is dropped."""
        path = self.folder / f"{name}.csv"
        if not path.exists():
            return []
        text = read_text(path, "a session of this mechanism")
        lines = text[: text.rfind("\n") + 1].splitlines()
        if not lines:
            return []
        needed = (*self.channels, *self.keys)
        missing = [c for c in needed if c not in lines[0].split(",")]
        if missing:
            found = f"no column {missing[0]}"
            raise InputError.at(str(path), found, "a session of this mechanism")
        # Numbers stand as they arrived, whatever their columns were called before an exchange.
        names = iter(self.columns)
        header = [next(names) if c in self.channels else c for c in lines[0].split(",")]
        rows = list(csv.DictReader(lines[1:], header if self.exchanged else lines[0].split(",")))
        return [row for row in rows if all(row.get(c) not in (None, "") for c in needed)]

    def _cells(self, sample: Sample) -> list[object]:
        warm = [repr(sample.temperature_c)] if self.warm else []
        of = dict(zip(self.channels, sample.values, strict=True))
        values = (f"{of[name]:.10g}" for name in self.columns)
        return [repr(sample.time_s), *warm, *values, *sample.keys]

    def _sample(self, row: dict[str, str]) -> Sample:
        warm = row.get("temperature_c") or None
        values = tuple(float(row[name]) for name in self.channels)
        keys = tuple(row[name] for name in self.keys)
        return Sample(float(row["time_s"]), None if warm is None else float(warm), values, keys)

    def close(self) -> None:
        """Close the files."""
        for file in self._files.values():
            file.close()


def _append(file: TextIO, rows: Iterable[Sequence[object]]) -> None:
    """Write rows, and wait until they are on the disk."""
    file.write("".join(",".join(map(str, row)) + "\n" for row in rows))
    file.flush()
    os.fsync(file.fileno())
