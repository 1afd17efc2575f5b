"""Readings of many devices in files: partitions of whole devices, one after the other."""

from __future__ import annotations

import os
from collections.abc import Iterable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np

from rsicalib.errors import InputError
from rsicalib.fleets.frames import Runs, device_in, devices_in, joined, runs_of, select
from rsicalib.io.extras import parquet_modules
from rsicalib.io.frames import Columns, columns_of
from rsicalib.io.tables import PARQUET, Table, chunks, read_table, text
from rsicalib.plain_text import encodable

LEVELS = "levels.csv"
"""File beside the readings that says of each device in which groups it is."""

CUTS = 16
"""Pieces of a row group at most, as each of them reads all of it; of a dataset at least."""


@dataclass(frozen=True)
class Partition:
    """Devices that are calibrated together; no device is in two partitions."""

    frame: Columns
    """Rows of the devices."""
    rest: Columns | None
    """Readings of their rest poses, where these are in other files."""
    refused: dict[Any, str] = field(default_factory=dict)
    """Devices whose files cannot be read, and why."""
    apart: bool = False
    """True where each device has files of its own: a missing column is then its own fault."""
    by: str = "device"
    """The column that names the device."""
    place: str = ""
    """Where it is in the dataset: texts sort as the rows do."""
    files: dict[Any, str] = field(default_factory=dict)
    """The file of a device, where each has its own."""

    @property
    def labels(self) -> list[Any]:
        """The devices, in order."""
        found = [*_by_device(self.frame, self.by), *self.refused]
        return sorted(found, key=list(self.files).index) if self.files else found

    def read(self) -> Iterator[Partition]:
        """Itself: its rows are here."""
        yield self


@dataclass(frozen=True)
class Piece:
    """Devices whose rows whoever calibrates them reads, from row groups of Parquet files."""

    places: tuple[tuple[str, int], ...]
    """Files, and numbers of the row groups in them."""
    devices: int
    """Its devices, or about how many there are."""
    own: int
    """Row groups, the first ones, that are read; the others hold the rest of `ends`."""
    by: str
    size: int
    """Devices that are calibrated at a time."""
    known: tuple[Any, ...] | None = None
    """The devices; None for those that begin in `rows`."""
    rows: tuple[int, int] = (0, 0)
    """First row of those groups, and the one after the last, in which devices begin."""
    skip: Any = None
    """A device in these rows that began before them."""
    ends: Any = None
    """The device that goes on in the other row groups."""
    rest: Columns | None = None
    place: str = ""
    """Where it is in the dataset."""

    @property
    def labels(self) -> list[Any]:
        """The devices, in order."""
        return list(self._devices(_together(self.places[: self.own], [self.by])))

    def read(self) -> Iterator[Partition]:
        """Its rows, some devices at a time."""
        frame = _together(self.places[: self.own])
        devices = self._devices(frame)
        if self.ends in devices and self.own < len(self.places):
            frame = joined([frame, _together(self.places[self.own :])])
            runs = _by_device(frame, self.by)
            devices = {label: runs[label] for label in devices}
        rests = {} if self.rest is None else _by_device(self.rest, self.by)
        labels = list(devices)
        for start in range(0, len(labels), self.size):
            some = labels[start : start + self.size]
            at_rest = None
            if self.rest is not None:
                at_rest = select(self.rest, (run for own in some for run in rests.get(own, [])))
            own = select(frame, (run for label in some for run in devices[label]))
            yield Partition(own, at_rest, by=self.by, place=f"{self.place}.{start:09}")

    def _devices(self, frame: Columns) -> dict[Any, Runs]:
        """Rows of its devices in the row groups that are its own."""
        runs = _by_device(frame, self.by)
        if self.known is not None:
            return {label: runs[label] for label in self.known}
        first, end = self.rows
        begun = {label for label, own in runs.items() if first <= own[0].start < end}
        return {label: own for label, own in runs.items() if label in begun - {self.skip}}


def _together(places: Iterable[tuple[str, int]], columns: list[str] | None = None) -> Columns:
    """Rows of some row groups."""
    groups = []
    for file, group in places:
        _, parquet = parquet_modules(file)
        groups.append(parquet.ParquetFile(file).read_row_group(group, columns=columns))
    return joined([columns_of(group) for group in groups])


class Dataset:
    """A file or a folder with the readings of many devices.

    - Parquet, a file or a folder of parts, with the column `by`;
    - a CSV file, or a folder of them, with the column `by`;
    - a folder of CSV files without the column: a device each, named as the file;
    - a folder of folders with `readings.csv` and perhaps `rest.csv`: a device each, named as
      its folder.

    `levels.csv` beside any of them says for each device in which groups it is.

    Beside the first three, `rest.csv` or `rest.parquet` with the column `by` holds readings of
    the rest poses.

    Parameters
    ----------
    path : path
        The file or folder.
    by : str
        Column that says which device a row belongs to.

    Raises
    ------
    InputError
        There is no such file, or nothing in it that could be read.
    """

    def __init__(self, path: Path, by: str) -> None:
        self.path, self.by = path, by
        if not os.path.exists(path):
            raise InputError.at(str(path), "no such file", "a file or a folder")
        try:
            files = [path] if path.is_file() else sorted(p for p in path.rglob("*") if p.is_file())
        except OSError as error:
            found = f"what cannot be read ({error.strerror}: {error.filename})"
            raise InputError.at(str(path), found, "a file or a folder") from None
        tables = [p for p in files if path.is_file() or (p.stem != "rest" and p.name != LEVELS)]
        self.parquet = [p for p in tables if p.suffix.lower() in PARQUET]
        self.folders = sorted(p.parent for p in tables if p.name == "readings.csv")
        self.csv = [p for p in tables if p.suffix.lower() == ".csv"] if not self.folders else []
        self.empty: list[Path] = []
        if self.folders and not path.is_file():
            inside = {folder for own in self.folders for folder in (own, *own.parents)}
            tops = {own.parent for own in self.folders}
            subs = (sub for top in tops for sub in top.iterdir() if sub.is_dir())
            self.empty = sorted(sub for sub in subs if sub not in inside)
        kinds = [kind for kind in (self.parquet, self.folders, self.csv) if kind]
        if len(kinds) != 1:
            found = "Parquet and CSV files" if kinds else "no Parquet and no CSV file"
            raise InputError.at(str(path), found, "one kind of files of readings")
        folder = path.parent if path.is_file() else path
        self.levels = folder / LEVELS if (folder / LEVELS).is_file() else None
        beside = [folder / f"rest{suffix}" for suffix in (".csv", ".parquet")]
        found_rest = [p for p in beside if p.is_file() and p != path and not self.folders]
        self.rest = _of_devices(read_table(found_rest[0]), by) if found_rest else None

    def partitions(self, size: int) -> Iterator[Partition]:
        """Partitions of about `size` devices, in the order of the files."""
        if self.parquet:
            return self._cut(_row_groups(self.parquet, self.by), size)
        if self.folders:
            return self._of_folders(size)
        if self.by in next(chunks(self.csv[0])).names:
            return self._cut(self._csv_groups(), size)
        return self._of_files(((encodable(p.stem), p, None) for p in self.csv), size)

    def pieces(self, size: int) -> list[Piece] | None:
        """The devices by the rows in which they begin, about `size` together.

        Where row groups are sorted by the device, their statistics say so and no row is read; else
        the column of the device is. None where there are no row groups, or where devices are so
        scattered over them that they would be read more than twice.
        """
        if not self.parquet:
            return None
        if self.rest is None:
            groups = _bounds(self.parquet, self.by)
            if groups is not None:
                return self._in_order(groups, size)
        return self._by_ends(size)

    def _in_order(self, groups: Sequence[_Group], size: int) -> list[Piece]:
        """Pieces of row groups that are sorted by the device."""
        labels = _labels(_together([groups[0].place], [self.by]), self.by) if groups else []
        per = max(1, len(labels) // max(1, len(set(labels))))
        pieces: list[Piece] = []
        begin = 0
        while begin < len(groups):
            end, rows = begin + 1, groups[begin].rows
            while end < len(groups) and rows < size * per:
                rows += groups[end].rows
                end += 1
            ends = groups[end - 1].most
            last = end
            while last < len(groups) and groups[last].least == ends:
                last += 1
            before = begin > 0 and groups[begin - 1].most == groups[begin].least
            # Few for the workers, or as many in one as none should lose.
            cuts = max(CUTS // len(groups), rows // (10 * size * per))
            cuts = max(1, min(cuts, CUTS, rows // per))
            for k in range(cuts):
                own = (rows * k // cuts, rows * (k + 1) // cuts)
                piece = Piece(
                    places=tuple(group.place for group in groups[begin:last]),
                    devices=(own[1] - own[0]) // per,
                    own=end - begin,
                    by=self.by,
                    size=size,
                    rows=own,
                    skip=groups[begin].least if before else None,
                    ends=ends,
                )
                pieces.append(piece)
            begin = end
        return pieces

    def _by_ends(self, size: int) -> list[Piece] | None:
        """Pieces of row groups in which devices are in any order."""
        places, first, last = _ends(self.parquet, self.by)
        ending: list[list[Any]] = [[] for _ in places]
        for label, group in last.items():
            ending[group].append(label)
        pieces: list[Piece] = []
        read = 0
        labels: list[Any] = []
        for group, more in enumerate(ending):
            labels += more
            if (len(labels) < size and group + 1 < len(places)) or not labels:
                continue
            begin = min(first[label] for label in labels)
            read += group + 1 - begin
            # More devices at once than asked for, out of more than a row group and the one before.
            scattered = len(labels) > 2 * size and group - begin > 1
            if scattered or read > 2 * len(places):
                return None
            own = tuple(
                (os.path.abspath(file), number) for file, number in places[begin : group + 1]
            )
            rest = None
            if self.rest is not None:
                runs = _by_device(self.rest, self.by)
                rest = select(self.rest, (run for own in labels for run in runs.get(own, [])))
            known = tuple(labels)
            piece = Piece(own, len(known), len(own), self.by, size, known=known, rest=rest)
            pieces.append(piece)
            labels = []
        return pieces

    def _cut(
        self, groups: Iterable[tuple[Columns, dict[Any, int]]], size: int
    ) -> Iterator[Partition]:
        """Cut chunks of rows into partitions; a device waits for the chunk of its last row."""
        rest = None if self.rest is None else _by_device(self.rest, self.by)
        waiting: Columns | None = None
        for k, (chunk, last) in enumerate(groups):
            waiting = chunk if waiting is None else joined([waiting, chunk])
            devices = _by_device(waiting, self.by)
            final = k == max(last.values(), default=0)
            whole = [label for label in devices if last[label] <= k]
            count = len(whole) if final else len(whole) // size * size
            for start in range(0, count, size):
                labels = whole[start : min(start + size, count)]
                frame = select(waiting, (run for label in labels for run in devices[label]))
                at_rest = None
                if rest is not None and self.rest is not None:
                    of_rest = (run for label in labels for run in rest.get(label, []))
                    at_rest = select(self.rest, of_rest)
                yield Partition(frame, at_rest, by=self.by)
            for label in whole[:count]:
                del devices[label]
            waiting = select(waiting, (run for runs in devices.values() for run in runs))

    def _csv_groups(self) -> Iterator[tuple[Columns, dict[Any, int]]]:
        """Rows of CSV files, some at a time, and the number of the last part of every device."""
        last: dict[Any, int] = {}
        count = 0
        for path in self.csv:
            for table in chunks(path):
                last |= dict.fromkeys(_labels(_of_devices(table, self.by), self.by), count)
                count += 1
        names: list[str] | None = None
        for path in self.csv:
            for table in chunks(path):
                frame = _columns(table, self.by)
                names = names or list(frame)
                yield {name: frame[name] for name in names}, last

    def _of_folders(self, size: int) -> Iterator[Partition]:
        def rest(folder: Path) -> Path | None:
            return folder / "rest.csv" if (folder / "rest.csv").is_file() else None

        folders = sorted([*self.folders, *self.empty])
        return self._of_files(
            ((encodable(f.name), f / "readings.csv", rest(f)) for f in folders), size
        )

    def _of_files(
        self, devices: Iterable[tuple[str, Path, Path | None]], size: int
    ) -> Iterator[Partition]:
        """Files of a device each; those with the same columns are calibrated together."""
        frames: list[Columns] = []
        rests: list[Columns] = []
        refused: dict[Any, str] = {}
        files: dict[Any, str] = {}

        def made() -> Partition:
            of_rest = joined(rests) if rests else self._rest_of(frames)
            return Partition(
                joined(frames) if frames else {self.by: []},
                of_rest,
                dict(refused),
                apart=True,
                by=self.by,
                files=dict(files),
            )

        for label, file, at_rest in devices:
            try:
                frame = _labelled(read_table(file), self.by, label)
                resting = None
                if at_rest is not None:
                    resting = _labelled(read_table(at_rest), self.by, label)
            except InputError as error:
                refused[label], files[label] = error.message, str(file)
                continue
            unlike = any(list(frame) != list(f) for f in frames[:1])
            unlike |= any(resting is not None and list(resting) != list(r) for r in rests[:1])
            if unlike or len(frames) == size:
                yield made()
                frames, rests, refused, files = [], [], {}, {}
            files[label] = str(file)
            frames.append(frame)
            if resting is not None:
                rests.append(resting)
        if frames or refused:
            yield made()

    def _rest_of(self, frames: Sequence[Columns]) -> Columns | None:
        if self.rest is None:
            return None
        rows = _by_device(self.rest, self.by)
        labels = [frame[self.by][0] for frame in frames if len(frame[self.by])]
        return select(self.rest, (run for label in labels for run in rows.get(label, [])))


@dataclass(frozen=True)
class _Group:
    """A row group, and the least and the greatest label in it."""

    place: tuple[str, int]
    rows: int
    least: Any
    most: Any


def _bounds(files: Sequence[Path], by: str) -> list[_Group] | None:
    """The row groups, where their statistics say that they are sorted by the device."""
    groups: list[_Group] = []
    for file in files:
        with _opened(file, by) as opened:
            column = opened.schema.names.index(by)
            for number in range(opened.num_row_groups):
                group = opened.metadata.row_group(number)
                told = group.column(column).statistics
                if not group.num_rows:
                    continue
                # Labels that are missing are in no statistics.
                if told is None or not told.has_min_max or told.null_count:
                    return None
                if not isinstance(told.min, str | int) or device_in(told.min) is None:
                    return None
                groups.append(
                    _Group((os.path.abspath(file), number), group.num_rows, told.min, told.max)
                )
    kinds = {type(group.least) for group in groups}
    in_order = len(kinds) <= 1 and all(a.most <= b.least for a, b in pairwise(groups))
    return groups if in_order else None


@contextmanager
def _opened(file: Path, by: str) -> Iterator[Any]:
    """A Parquet file that has the column of the device."""
    pyarrow, parquet = parquet_modules(str(file))
    try:
        opened = parquet.ParquetFile(file)
        if by not in opened.schema_arrow.names:
            found = f"no column {by!r} ({', '.join(opened.schema_arrow.names)})"
            raise InputError.at(str(file), found, "one that names the device")
        yield opened
    except (pyarrow.ArrowException, OSError) as error:
        found = f"what pyarrow cannot read ({error})"
        raise InputError.at(str(file), found, "a Parquet file") from None


def _ends(
    files: Sequence[Path], by: str
) -> tuple[list[tuple[Path, int]], dict[Any, int], dict[Any, int]]:
    """All row groups, and the numbers of the first and the last one of every device."""
    first: dict[Any, int] = {}
    last: dict[Any, int] = {}
    places: list[tuple[Path, int]] = []
    for file in files:
        with _opened(file, by) as opened:
            for group in range(opened.num_row_groups):
                column = opened.read_row_group(group, columns=[by]).column(0)
                here = dict.fromkeys(devices_in(column.unique().to_pylist()), len(places))
                last |= here
                for label in here:
                    first.setdefault(label, len(places))
                places.append((file, group))
    return places, first, last


def _row_groups(files: Sequence[Path], by: str) -> Iterator[tuple[Columns, dict[Any, int]]]:
    """Rows of each row group, and the number of the last row group of every device."""
    _, parquet = parquet_modules(str(files[0]))
    places, _, last = _ends(files, by)
    for file, group in places:
        yield columns_of(parquet.ParquetFile(file).read_row_group(group)), last


def _columns(table: Table, by: str) -> Columns:
    """Columns of a file; labels of devices without surrounding spaces."""
    if table.ragged:
        row, misfit = min(table.ragged.items())
        raise table.fault(row, None, misfit.found, misfit.expected)
    columns: Columns = dict(zip(table.names, table.columns, strict=True))
    cells = columns.get(by)
    if cells is not None and not isinstance(cells, np.ndarray):
        columns[by] = _texts(cells)
    return columns


def _of_devices(table: Table, by: str) -> Columns:
    """Columns of a file with rows of several devices: one of them says which."""
    columns = _columns(table, by)
    if by not in columns:
        found, expected = f"no column {by!r}", "one that names the device of each row"
        raise InputError.at(table.source, found, expected)
    return columns


def _texts(cells: Sequence[Any]) -> list[Any]:
    return [text(cell) if isinstance(cell, str) else cell for cell in cells]


def _labelled(table: Table, by: str, label: str) -> Columns:
    return {**_columns(table, by), by: [label] * len(table.lines)}


def _labels(frame: Columns, by: str) -> list[Any]:
    if by not in frame:
        raise InputError(f"found no column {by!r}, expected one that names the device")
    return devices_in(frame[by])


def _by_device(frame: Columns, by: str) -> dict[Any, Runs]:
    """Rows of each device, in the order of their first rows."""
    return runs_of(_labels(frame, by))
