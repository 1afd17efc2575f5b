"""Calibrations of many devices that stand in one table: `calibrate_devices`."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from rsicalib import _core
from rsicalib._core import Mechanism
from rsicalib.arrays import FloatArray
from rsicalib.errors import InputError
from rsicalib.facts.records import plain
from rsicalib.fleets.frames import TEXT, Frame, devices_in, frame_like, runs_of, select
from rsicalib.io.cells import Fault, MechanismLike, needed_columns, read_cells, read_header
from rsicalib.io.frames import Columns, columns_of
from rsicalib.io.tables import USED, Table, text
from rsicalib.options import number
from rsicalib.plain_text import counted
from rsicalib.work.arguments import Bare, MechanismArg, names_in, noise_of_channels, open_mechanism

NUMBERS = ("poses", "samples", "chi2", "dof", "p_value", "rms_misclosure")
"""Columns of the results that hold numbers, beside the parameters."""

REST = "rest"
"""What stands in the column `pose` of a row that reads the rest pose."""


def calibrate_devices(
    frame: Frame,
    mechanism: MechanismArg = "rsi",
    *,
    by: str = "device",
    rest: Frame | None = None,
    terms: Sequence[str] | None = None,
    closures: Sequence[str] | None = None,
    noise: float | Mapping[str, float] | None = None,
    trace: bool = True,
    held_out: bool = False,
    time_limit: float | None = None,
) -> Frame:
    """Calibrate every device in a table: rows of readings in, one row for each device out.

    Knows nothing of engines: a partition of a table goes in, its results come out, so Dask, Ray
    and Spark map it over partitions that hold devices whole. The interpreter's lock is released
    while the core computes. A device that cannot be calibrated is a row, too.

    Parameters
    ----------
    frame : DataFrame, pyarrow Table, or mapping of str to array
        `n` samples, columns as in a file of readings, and the column `by`. Rows of one device
        keep their order and need not be neighbours.
    mechanism : str, path or Mechanism
        What all devices are.
    by : str
        Column that says which device a row belongs to.
    rest : as `frame`, optional
        Readings of rest poses, with the columns `by` and the channels; rows of `frame` whose
        `pose` is `rest` are the same.
    terms, closures, noise : optional
        As in `calibrate`.
    trace : bool
        Trace the residual of devices where it is significant.
    held_out : bool
        Add the error on poses that are left out in turn, which takes as long again.
    time_limit : float, optional
        Longest time for one device [s]. A device that takes longer says so in `message` and has
        no `sha256`; where only its trace took longer, it has its calibration. Which devices these
        are depends on the machine.

    Returns
    -------
    as `frame`
        A row for each device, in the order of their first rows. Text: `verdict` (None where
        a device cannot be used), `message`, `steps` (what was traced, JSON), `sha256` of
        the device's rows. Numbers, NaN where unknown: `poses`, `samples`, `chi2`, `dof`,
        `p_value`, `rms_misclosure` [length unit], and for each parameter its value and `_sd` in
        its unit, such as `gain@a11` and `gain@a11_sd` [rad/count].

    Raises
    ------
    InputError
        The table as a whole cannot be used: a column is missing.

    Examples
    --------
    >>> import rsicalib
    >>> made = [rsicalib.simulate(poses=24, samples=4, seed=seed).readings for seed in (1, 2)]
    >>> frame = {"device": np.repeat(["a", "b"], 96), "pose": np.tile(made[0].pose, 2)}
    >>> for k, name in enumerate(made[0].channels):
    ...     frame[name] = np.concatenate([one.values[:, k] for one in made])
    >>> calibrate_devices(frame)["verdict"].tolist()
    ['adequate', 'adequate']
    """
    mechanism = open_mechanism(mechanism)
    time_limit = None if time_limit is None else number("time_limit", time_limit)
    check_names(mechanism, by)
    devices = devices_of(
        columns_of(frame), None if rest is None else columns_of(rest), mechanism, by
    )
    usable = [one for one in devices if one.refused is None]
    found = _core.calibrate_devices(
        mechanism,
        [one.table for one in usable],
        [one.rest for one in usable],
        terms=names_in("terms", terms, mechanism),
        closures=names_in("closures", closures, mechanism),
        noise=noise_of_channels(noise, mechanism),
        trace=trace,
        held_out=held_out,
        time_limit=time_limit,
    )
    ended = iter(found.pop("ended"))
    found["steps"] = [json.dumps(plain(steps), ensure_ascii=False) for steps in found["steps"]]
    rows = {
        by: [one.label for one in devices],
        "poses": [one.poses for one in devices],
        "samples": [one.samples for one in devices],
        **{name: _spread(cells, devices) for name, cells in found.items()},
        "sha256": [one.sha256 for one in devices],
    }
    rows["message"] = [
        found if one.refused is None else one.refused
        for one, found in zip(devices, rows["message"], strict=True)
    ]
    for k in [k for k, one in enumerate(devices) if one.refused is None and next(ended)]:
        rows["message"][k] = _ended(time_limit, rows["verdict"][k], rows["message"][k])
        rows["sha256"][k] = None  # calibrated again by a run that is resumed
    return frame_like(frame, rows, by)


def check_names(mechanism: Mechanism, by: str, levels: Sequence[str] = ()) -> None:
    """Refuse names of devices or of levels that are those of other columns.

    Raises
    ------
    InputError
        One is a column of readings or of results, or is given twice.
    """
    own = {*TEXT, *NUMBERS, *(channel.name for channel in mechanism.channels)}
    for k, (option, name) in enumerate([("by", by), *(("levels", level) for level in levels)]):
        # Results of parameters are columns such as `gain@a11`.
        if name in own or "@" in name or name in (by, *levels)[:k]:
            expected = "another column, once, than those of readings and results"
            raise InputError(f"{option}: found {name!r}, expected {expected}")


def _ended(limit: float | None, verdict: str | None, message: str) -> str:
    """What is said of a device that took too long."""
    over = f"took longer than the limit of {limit:g} s"
    return over if verdict is None else "; ".join(filter(None, [f"its trace {over}", message]))


def _spread(cells: list[Any], devices: Sequence[Device]) -> list[Any]:
    """Results of the usable devices, in rows of all devices."""
    of_usable = iter(cells)
    return [next(of_usable) if one.refused is None else None for one in devices]


def digests(frame: Columns, rest: Columns | None, mechanism: Mechanism, by: str) -> dict[Any, str]:
    """Digest of each device's rows, as `calibrate_devices` writes it."""
    return {one.label: one.sha256 for one in devices_of(frame, rest, mechanism, by)}


def without(frame: Columns, by: str, labels: set[Any]) -> Columns:
    """A table without the rows of some devices."""
    devices = runs_of(devices_in(frame[by])).items()
    return select(frame, (run for label, runs in devices if label not in labels for run in runs))


def one_device(
    frame: Columns, rest: Columns | None, by: str, label: Any
) -> tuple[Columns, Columns | None]:
    """The readings of one device, and those of its rest pose, as tables of their own."""

    def own(rows: Columns | None) -> Columns | None:
        runs = runs_of(devices_in(rows[by])) if rows is not None and by in rows else {}
        if rows is None or label not in runs:
            return None
        return {n: cells for n, cells in select(rows, runs[label]).items() if n != by}

    poses, at_rest = _rest_rows(frame, by)
    resting = own(rest) or own(at_rest)  # as `devices_of` has them
    if resting is not None:
        resting = {name: cells for name, cells in resting.items() if name not in ("pose", USED)}
    return own(poses) or {}, resting


@dataclass(frozen=True)
class Device:
    """Readings of one device."""

    label: Any
    table: dict[str, Any]
    rest: FloatArray | None
    poses: int
    samples: int
    refused: str | None
    sha256: str


def devices_of(frame: Columns, rest: Columns | None, mechanism: Mechanism, by: str) -> list[Device]:
    """The devices of a table, in the order of their first rows."""
    frame, at_rest = _rest_rows(frame, by)
    rests = _rest_readings([r for r in (at_rest, rest) if r is not None], mechanism, by)
    read = _Read.of(frame, mechanism, by)
    return [read.device(label, rows, rests.get(label)) for label, rows in read.rows()]


def _rest_rows(frame: Columns, by: str) -> tuple[Columns, Columns | None]:
    """The rows of poses, and those of rest poses."""
    if by not in frame:
        found = ", ".join(frame)[:200]
        raise InputError(f"found no column {by!r} ({found}), expected one that names the device")
    pose = frame.get("pose")
    if pose is None or isinstance(pose, np.ndarray):
        return frame, None
    rows = runs_of([cell == REST or text(cell) == REST for cell in pose])
    if True not in rows:
        return frame, None
    return select(frame, rows.get(False, [])), select(frame, rows[True])


def _rest_readings(
    frames: Sequence[Columns], mechanism: Mechanism, by: str
) -> dict[Any, FloatArray | str]:
    """Readings of the rest pose of each device, shape (n, C); or what is wrong with them."""
    out: dict[Any, FloatArray | str] = {}
    for frame in frames:
        if by not in frame:
            found = ", ".join(frame)[:200]
            raise InputError(f"rest: found no column {by!r} ({found}), expected one")
        bare = {name: cells for name, cells in frame.items() if name != "pose"}
        read = _Read.of(bare, Bare(mechanism), by)
        for label, rows in read.rows():
            fault = read.fault(rows)
            out[label] = read.values[rows] if fault is None else f"rest pose, {fault}"
    return out


@dataclass(frozen=True, eq=False)
class _Read:
    """A table after the same checks as a file of readings, all devices at once."""

    columns: Columns
    mechanism: MechanismLike
    labels: list[Any]
    values: FloatArray
    cells: dict[str, FloatArray]
    faults: dict[int, Fault]

    @classmethod
    def of(cls, frame: Columns, mechanism: MechanismLike, by: str) -> _Read:
        labels = devices_in(frame[by])
        lines = np.arange(1, len(labels) + 1, dtype=np.int64)
        columns = {name: cells for name, cells in frame.items() if name != by}
        table = Table(list(columns), list(columns.values()), lines, "row", "devices", "")
        index, _ = read_header(table, mechanism)
        cells, faults = read_cells(table, mechanism, index)
        channels = [channel.name for channel in mechanism.channels]
        values = np.column_stack([cells[name] for name in channels])
        return cls(columns, mechanism, labels, np.ascontiguousarray(values), cells, faults)

    def rows(self) -> Iterator[tuple[Any, Any]]:
        """Label and rows of each device: a slice where its rows are neighbours."""
        for label, runs in runs_of(self.labels).items():
            yield label, runs[0] if len(runs) == 1 else np.r_[tuple(runs)]

    def fault(self, rows: Any) -> str | None:
        """What is wrong with the rows of a device."""
        if not self.faults:
            return None
        of = np.arange(len(self.labels))[rows].tolist()
        for place, row in enumerate(of, start=1):
            if row in self.faults:
                f = self.faults[row]
                bad = sum(1 for r in of if r in self.faults)
                more = f" ({bad} rows cannot be used)" if bad > 1 else ""
                return (
                    f"row {place}, column {f.column}: found {f.found}, expected {f.expected}{more}"
                )
        return None

    def device(self, label: Any, rows: Any, rest: FloatArray | str | None) -> Device:
        """One device as the core takes it."""
        values = self.values[rows]
        pose = self._optional("pose", rows)
        used = None if USED in needed_columns(self.mechanism) else self._optional(USED, rows)
        own = slice(None) if used is None else np.flatnonzero(used)
        refused, runs = self.fault(rows), len(values[own])
        if label is None:
            refused = f"found {counted(len(values), 'row')} without a device, expected none"
        if refused is None and pose is not None:
            pose = pose.astype(np.int64)
            starts = np.flatnonzero(pose[1:] != pose[:-1])
            runs = len(set(pose[own].tolist()))
            if len(set(pose[starts].tolist()) | {int(pose[-1])}) <= len(starts):
                found = "a pose that begins again after another one"
                refused = (
                    f"column pose: found {found}, expected the rows of a pose next to each other"
                )
        if isinstance(rest, str):
            refused, rest = refused or rest, None
        table = {
            "values": values,
            "pose": pose if refused is None else None,
            "time": self._optional("time_s", rows),
            "temperature": self._optional("temperature_c", rows),
            "session": None,
            "keys": [self._texts(name, rows) for name in self.mechanism.key_columns],
            "columns": [self._numbers(name, rows) for name in self.mechanism.value_columns],
            "used": None if used is None else np.flatnonzero(used).tolist(),
        }
        if refused is None and not len(values[own]):
            refused = f"column {USED}: found 0 in every row, expected a 1"
        sha256 = _digest(label, table, rest)
        return Device(label, table, rest, runs, len(values[own]), refused, sha256)

    def _optional(self, name: str, rows: Any) -> FloatArray | None:
        return self.cells[name][rows] if name in self.cells else None

    def _numbers(self, name: str, rows: Any) -> list[float]:
        """Cells of a column; NaN where it was not read."""
        cells = self.cells.get(name)
        absent = np.full(len(self.labels), np.nan)
        found: list[float] = (absent if cells is None else cells)[rows].tolist()
        return found

    def _texts(self, name: str, rows: Any) -> list[str]:
        cells = self.columns[name]
        of = np.arange(len(self.labels))[rows].tolist()
        return [text(cells[i]) for i in of]


def _digest(label: Any, table: Mapping[str, Any], rest: FloatArray | None) -> str:
    """SHA-256 of what a device is calibrated from."""
    sha = hashlib.sha256(str(label).encode())
    for name in ("values", "pose", "time", "temperature"):
        array = table[name]
        sha.update(f"\0{name}\0".encode() + (b"" if array is None else array.tobytes()))
    sha.update(repr([table["keys"], table["columns"]]).encode())
    sha.update(b"" if table["used"] is None else repr(table["used"]).encode())
    sha.update(b"" if rest is None else rest.tobytes())
    return sha.hexdigest()
