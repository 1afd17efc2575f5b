"""Readings of a device: loaded, checked once on the way in, never repaired.

A file that cannot be used is refused whole, with the place of the first fault.
What is suspicious but usable becomes a warning (`rsicalib.io.suspicions`).
"""

from __future__ import annotations

import os
from collections.abc import Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from typing import Any, TextIO

import numpy as np
import numpy.typing as npt

from rsicalib.errors import InputError
from rsicalib.io.cells import (
    POSE,
    TEXTS,
    Fault,
    MechanismLike,
    meaning_of,
    needed_columns,
    read_cells,
    read_header,
)
from rsicalib.io.csv_text import csv_of
from rsicalib.io.files import write_text
from rsicalib.io.frames import SOURCE, TableArg, table_in_memory
from rsicalib.io.mechanisms import load_mechanism
from rsicalib.io.order import check_poses_are_together, time_goes_back
from rsicalib.io.repeats import numbered
from rsicalib.io.samples import Part, Samples, Skipped, frozen, picked
from rsicalib.io.suspicions import suspicions
from rsicalib.io.tables import (
    USED,
    Table,
    read_file,
    table_of_arrays,
    table_of_file,
    table_of_numbers,
    text,
)
from rsicalib.io.units_row import without_units
from rsicalib.plain_text import counted
from rsicalib.tabular import Tabular


@dataclass(frozen=True, eq=False, repr=False)
class Readings(Samples, Tabular):
    """Samples of all channels, one row each: `n` samples of `C` channels.

    All arrays are read-only. Make one with `load_readings` or `from_arrays`.

    Attributes
    ----------
    channels : tuple of str
        Names, in the mechanism's order.
    values : ndarray, shape (n, C)
        Readings, each in its channel's unit; finite and within its range.
    pose : ndarray of int, shape (n,)
        Label of the pose each sample belongs to; rows of a pose are neighbours.
    held : bool
        Whether poses were given. If not, this is a recording: every row is a
        pose of its own, numbered by its row from 1.
    sample : ndarray of int, shape (n,), or None
        Number of the sample, as given.
    time_s, temperature_c : ndarray, shape (n,), or None
        Time [s] and temperature [°C].
    poses : ndarray, shape (n, 6), or None
        Known poses `x y z` [length unit] `rx ry rz` [rad]; NaN where unknown. Known places of a
        point have no `rx ry rz`.
    keys : dict of str to tuple of str
        Text columns (`group`, `at`, …), n entries each.
    columns : dict of str to ndarray, shape (n,)
        Distances that vary by row [length unit].
    lines : ndarray of int, shape (n,)
        Line of the file, or row from 1 where there are no lines.
    source, sha256 : str
        Where the readings are from, and the digest of its bytes.
    warnings : tuple of Warned
        Suspicious but usable.
    skipped : tuple of Skipped
        Rows that were dropped because the caller asked for it.
    line_word : {"line", "row"}
        What `lines` counts.
    in_memory : bool
        Whether the caller had them in memory: `source` is then no file.
    repeats : ndarray of int, shape (n,), or None
        Without poses: the first row of the held pose that each row plainly repeats, of which a
        warning tells. A fit takes such rows for samples of that pose.
    """

    @classmethod
    def from_arrays(
        cls,
        mechanism: MechanismLike | str | os.PathLike[str] | Mapping[str, Any],
        values: npt.ArrayLike,
        *,
        pose: npt.ArrayLike | None = None,
        sample: npt.ArrayLike | None = None,
        time_s: npt.ArrayLike | None = None,
        temperature_c: npt.ArrayLike | None = None,
        poses: npt.ArrayLike | None = None,
        keys: Mapping[str, Sequence[str]] | None = None,
        columns: Mapping[str, npt.ArrayLike] | None = None,
        used: npt.ArrayLike | None = None,
        source: str = "arrays",
        skip_bad_rows: bool = False,
    ) -> Readings:
        """Readings from memory, checked just as a file is.

        Parameters
        ----------
        mechanism : Mechanism, or what `load_mechanism` takes
            Names, units and ranges of its `C` channels.
        values : array_like, shape (n, C)
            Readings, in the order of the mechanism's channels and their units.
        pose, sample : array_like of int, shape (n,), optional
            Labels; without `pose` every row is a pose of its own.
        time_s, temperature_c : array_like, shape (n,), optional
            In s and °C.
        poses : array_like, shape (n, 6), optional
            Known poses [length unit, rad]; rows of NaN where unknown.
        keys : mapping of str to n strings, optional
            Text columns that unknown points need.
        columns : mapping of str to array_like, shape (n,), optional
            Distances that closures need [length unit].
        used : array_like of bool, shape (n,), optional
            Rows that are used; the others stay part of the session, as `select` leaves them.
        source : str, optional
            What messages call these data.
        skip_bad_rows : bool, optional
            Drop rows that cannot be used and list them in `skipped`.

        Returns
        -------
        Readings
            With copies of the arrays.

        Raises
        ------
        InputError
            Something cannot be used; the message names row (from 1) and column.
        """
        if isinstance(mechanism, str | os.PathLike | Mapping):
            mechanism = load_mechanism(mechanism)
        names = [channel.name for channel in mechanism.channels]
        blocks: list[tuple[Sequence[str], object]] = [(names, values)]
        single = {"pose": pose, "sample": sample, "time_s": time_s, "temperature_c": temperature_c}
        single["used"] = None if used is None else np.asarray(used, dtype=np.float64)
        given = {**single, **(columns or {}), **(keys or {})}
        blocks += [([name], cells) for name, cells in given.items() if cells is not None]
        if poses is not None:
            blocks.append((POSE, poses))
        return readings_of_table(table_of_arrays(blocks, source), mechanism, skip_bad_rows)

    @property
    def n_poses(self) -> int:
        """Number of different poses; rows that plainly repeat one are of it."""
        return super().n_poses if self.repeats is None else len(np.unique(self.repeats))

    def select(self, mask: npt.ArrayLike) -> Readings:
        """The rows where `mask` is true.

        Labels, lines, warnings and `sha256` stay those of the whole, and so does what a row has
        from others: from where its pose was approached, the way travelled until then, its time.

        Parameters
        ----------
        mask : array_like of bool, shape (n,)
            One truth value per row.

        Raises
        ------
        InputError
            The mask is not one truth value per row.
        """
        keep = np.asarray(mask)
        if keep.dtype != np.bool_ or keep.shape != (len(self),):
            found = f"a mask of shape {keep.shape} and type {keep.dtype}"
            raise InputError.at(self.source, found, f"{len(self)} truth values")

        def rows(arrays: Mapping[str, Any]) -> dict[str, Any]:
            own = {name: a for name, a in arrays.items() if isinstance(a, np.ndarray)}
            return {name: frozen(array[keep]) for name, array in own.items()}

        return replace(
            self,
            **rows(vars(self)),
            keys={name: picked(cells, keep) for name, cells in self.keys.items()},
            columns=rows(self.columns),
            part=Part(self.taken, frozen(self.own[keep])),
        )

    def to_csv(self, path_or_file: str | os.PathLike[str] | TextIO, *, whole: bool = False) -> None:
        """Write the readings as a file that `load_readings` reads back unchanged.

        The file takes its place when everything is written.

        Parameters
        ----------
        path_or_file : path or text file
            Path of the file, or an open file, which is left open.
        whole : bool
            Write the rows of the session that `select` has left out as well, with 0 in a column
            `used`: what these readings have from them is read back, too.
        """
        text = csv_of(self._whole_table() if whole else self._table())
        if isinstance(path_or_file, str | os.PathLike):
            write_text(path_or_file, text)
        else:
            path_or_file.write(text)

    def csv(self) -> str:
        """The text of the file that `to_csv` writes."""
        return csv_of(self._table())

    def _table(self) -> dict[str, Any]:
        """The columns of the file, in their order."""
        table: dict[str, Any] = {"pose": self.pose} if self.held else {}
        single = {"sample": self.sample, "time_s": self.time_s, "temperature_c": self.temperature_c}
        table |= {name: cells for name, cells in single.items() if cells is not None}
        table |= self.keys
        table |= self.columns
        if self.poses is not None:
            table |= {name: self.poses[:, k] for k, name in enumerate(POSE)}
        return table | {name: self.values[:, k] for k, name in enumerate(self.channels)}

    def _whole_table(self) -> dict[str, Any]:
        """The columns of the session as it was taken, and which of its rows these are."""
        taken = self.taken
        assert isinstance(taken, Readings)
        return {USED: np.isin(np.arange(len(taken)), self.own).astype(int), **taken._table()}

    def __repr__(self) -> str:
        poses = f" of {counted(self.n_poses, 'pose')}" if self.held else ", a recording"
        known = "" if self.poses is None else ", poses known"
        channels = counted(len(self.channels), "channel")
        return (
            f"<Readings {self.source!r}: {counted(len(self), 'sample')}{poses}, {channels}{known}>"
        )


def load_readings(
    readings: str | os.PathLike[str] | TableArg,
    mechanism: MechanismLike,
    *,
    skip_bad_rows: bool = False,
) -> Readings:
    """Load readings from a file or from memory: one row per sample, one column per channel.

    Columns are found by name: the mechanism's channels, and where present
    `pose`, `sample`, `time_s`, `temperature_c`, the known pose `x y z rx ry rz`,
    and the columns its points and closures need. Others are ignored, with a warning.

    Parameters
    ----------
    readings : path, data frame, mapping of str to array_like, or ndarray of shape (n, C)
        A file is Parquet if its name ends in `.parquet` or `.pq`, else CSV in UTF-8 with a header
        line, also compressed by gzip; `-` is standard input. A data frame is one of pandas, polars,
        pyarrow or another library that offers its columns by `__arrow_c_stream__` or
        `__dataframe__`. The columns of an array are the channels, in their order.
    mechanism : Mechanism
        Names, units and ranges of its channels.
    skip_bad_rows : bool, optional
        Drop rows that cannot be used and list them in `skipped`, instead of refusing the file;
        those with a channel at an end of its range as well.

    Returns
    -------
    Readings
        Values exactly as they stand in the file.

    Raises
    ------
    InputError
        The file cannot be used; `where` says file, line, column, what was found and
        what was expected.
    """
    return load_as("", readings, mechanism, skip_bad_rows)


def load_as(
    called: str,
    readings: str | os.PathLike[str] | TableArg,
    mechanism: MechanismLike,
    skip_bad_rows: bool,
) -> Readings:
    """What `load_readings` gives; messages call what is in memory by its argument, if that is not
    blank.
    """
    if not isinstance(readings, str | os.PathLike):
        names = [channel.name for channel in mechanism.channels]
        source = f"{called} ({SOURCE})" if called else SOURCE
        table = table_in_memory(readings, names, source)
        return readings_of_table(table, mechanism, skip_bad_rows)
    file = read_file(readings)
    numbers = None if skip_bad_rows else table_of_numbers(file)
    if numbers is not None and not {*mechanism.key_columns, *TEXTS} & {*numbers.names}:
        with suppress(InputError):  # the table cell by cell says what was found
            return readings_of_table(numbers, mechanism, skip_bad_rows=False)
    return readings_of_table(table_of_file(file), mechanism, skip_bad_rows)


def readings_of_table(table: Table, mechanism: MechanismLike, skip_bad_rows: bool) -> Readings:
    """The one way in: checks the header, then every cell, then the order of the rows."""
    index, ignored = read_header(table, mechanism)
    table = without_units(table, mechanism, index)
    if not len(table.lines):
        found, expected = "no readings", "at least one row below the header"
        raise InputError.at(table.source, found, expected)
    cells, faults = read_cells(table, mechanism, index)
    if skip_bad_rows:
        ends = _at_an_end(cells, mechanism) | faults
        faults = ends if len(ends) < len(table.lines) else faults
    skipped = _skipped(table, faults, skip_bad_rows, mechanism)
    keep = np.ones(len(table.lines), dtype=np.bool_)
    keep[[*faults]] = False

    free = cells.keys() - needed_columns(mechanism)  # a channel may be called as it likes

    def column(name: str) -> Any:
        return frozen(cells[name][keep])

    def beside(names: Sequence[str]) -> Any:
        """Columns beside each other, copied one by one: a recording may be large."""
        columns = np.empty((int(keep.sum()), len(names)))
        for k, name in enumerate(names):
            columns[:, k] = cells[name][keep]
        return frozen(columns)

    def poses() -> Any:
        """Known poses; places have no orientation."""
        whole = free.issuperset(POSE)
        return (
            beside(POSE)
            if whole
            else frozen(np.pad(beside(POSE[:3]), ((0, 0), (0, 3)), constant_values=np.nan))
        )

    def optional(name: str) -> Any:
        return column(name) if name in free else None

    def whole(name: str) -> Any:
        return frozen(column(name).astype(np.int64)) if name in free else None

    names = tuple(channel.name for channel in mechanism.channels)
    rows = np.arange(1, len(keep) + 1, dtype=np.int64)
    keys = {
        name: picked(map(text, table.columns[index[name]]), keep)
        for name in index
        if name in {*mechanism.key_columns, *TEXTS} and name not in cells
    }
    pose = _numbered(keys["pose"]) if "pose" in keys else whole("pose")
    held = pose is not None
    known = free.issuperset("xyz")
    readings = Readings(
        channels=names,
        values=beside(names),
        pose=frozen(rows[keep]) if pose is None else pose,
        held=held,
        sample=whole("sample"),
        time_s=optional("time_s"),
        temperature_c=optional("temperature_c"),
        poses=poses() if known else None,
        keys=keys,
        columns={name: column(name) for name in mechanism.value_columns if name in cells},
        lines=frozen(table.lines[keep]),
        source=table.source,
        sha256=table.sha256,
        skipped=skipped,
        line_word=table.line_word,
        in_memory=table.in_memory,
    )
    check_poses_are_together(readings)
    repeats, said = numbered(readings, mechanism)
    warnings = [*ignored, *time_goes_back(readings), *said]
    readings = replace(readings, repeats=None if repeats is None else frozen(repeats))
    if USED in free:
        readings = _used(readings, column(USED) == 1.0)
    return replace(readings, warnings=(*warnings, *suspicions(readings, mechanism)))


def _used(readings: Readings, used: npt.NDArray[np.bool_]) -> Readings:
    """The rows that are used, of the session that all are."""
    if not used.any():
        raise InputError.at(readings.source, "0 in every row", "a 1", column=USED)
    return readings if used.all() else readings.select(used)


def _at_an_end(cells: Mapping[str, Any], mechanism: MechanismLike) -> dict[int, Fault]:
    """Rows in which a channel is at an end of its range: its joint was there, or beyond."""
    faults: dict[int, Fault] = {}
    for channel in mechanism.channels:
        for end in channel.range or ():
            for row in np.flatnonzero(cells[channel.name] == end):
                expected = f"a reading within the range of {channel.name}, not at its end"
                faults.setdefault(int(row), Fault(channel.name, f"{end:g}", expected))
    return faults


def _numbered(labels: Sequence[str]) -> Any:
    """Poses whose labels tell unknown places apart: by number, or in order of their first rows."""
    try:
        return frozen(np.array([int(label) for label in labels], dtype=np.int64))
    except ValueError:
        order = {label: k for k, label in enumerate(dict.fromkeys(labels), 1)}
        return frozen(np.array([order[label] for label in labels], dtype=np.int64))


def _skipped(
    table: Table, faults: dict[int, Fault], skip_bad_rows: bool, mechanism: MechanismLike
) -> tuple[Skipped, ...]:
    """The bad rows, in order; refuses the file unless they may be skipped."""
    if not faults:
        return ()
    first = min(faults)
    if not skip_bad_rows or len(faults) == len(table.lines):
        fault, more = faults[first], len(faults) - 1
        others = f"{counted(more, 'more row')} cannot be used. " if more else ""
        advice = "Correct the data, or drop such rows with skip_bad_rows (--skip-bad-rows)."
        hint = others + advice
        if len(faults) == len(table.lines):
            hint = "No row can be used."
            if fault.column in table.names:
                cell = table.columns[table.names.index(fault.column)][first]
                said = meaning_of(fault.column, cell, mechanism, table.in_memory)
                hint = f"{hint} {said}".strip()
        raise table.fault(first, fault.column, fault.found, fault.expected, hint)
    return tuple(
        Skipped(
            int(table.lines[i]), fault.column, f"found {fault.found}, expected {fault.expected}"
        )
        for i, fault in sorted(faults.items())
    )
