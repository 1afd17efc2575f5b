"""A fleet from files to files: calibrated partition by partition, resumed where it was left."""

from __future__ import annotations

import hashlib
from collections import Counter
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

from rsicalib import _core
from rsicalib._core import Mechanism
from rsicalib.cores import available_cores
from rsicalib.errors import InputError
from rsicalib.fleets.dataset import Dataset, Partition, Piece
from rsicalib.fleets.devices import check_names, digests, without
from rsicalib.fleets.engines import Job, Part, Task, over_dask, over_threads
from rsicalib.fleets.frames import Rows
from rsicalib.fleets.levels import Levels, beside
from rsicalib.fleets.page import page
from rsicalib.fleets.population import first_line, is_misfit, joint, sentences, tolerances_of
from rsicalib.fleets.reports import write_reports
from rsicalib.fleets.standing_out import remarks, spreads
from rsicalib.fleets.store import Store
from rsicalib.options import checked, names
from rsicalib.plain_text import counted
from rsicalib.tabular import Tabular
from rsicalib.work.arguments import MechanismArg, PathLike, names_in, open_mechanism

PARTITION = 100
"""Devices of a partition: a second of work or two, which is what a lost worker costs."""

REPORTS = 10
"""Reports of single devices: ten seconds of work."""

Progress = Callable[[str, int, int], None]


@dataclass(frozen=True, eq=False, repr=False)
class Fleet(Tabular):
    """Results of many devices.

    Attributes
    ----------
    rows : mapping of str to list
        Columns of `fleet.parquet`, a row for each device; each is read when it is asked for.
    by : str
        The column that names the device.
    files : tuple of Path
        What was written.
    first : dict
        The fleet as a whole: `summed`, the tests of fit of all devices together, and `shifts` of
        each parameter from the drawing.
    population : dict, optional
        What the devices share, as `population.json` has it.
    """

    rows: Mapping[str, list[Any]]
    by: str
    files: tuple[Path, ...]
    first: dict[str, Any]
    population: dict[str, Any] | None = None

    def __len__(self) -> int:
        return len(self.rows[self.by])

    def _table(self) -> dict[str, list[Any]]:
        return dict(self.rows)

    def __repr__(self) -> str:
        verdicts = ", ".join(f"{count} {words}" for words, count in self.verdicts.items())
        return f"<Fleet of {counted(len(self), 'device')}: {verdicts}>"

    @property
    def verdicts(self) -> dict[str, int]:
        """Number of devices by verdict; `refused` where there is none."""
        words = (verdict or "refused" for verdict in self.rows["verdict"])
        return dict(Counter(words).most_common())

    @property
    def exit_code(self) -> int:
        """What the command returns: 0 unless no device could be calibrated."""
        none = {"refused", "undetermined"} >= self.verdicts.keys()
        return 3 if none else 0

    def to_dict(self) -> dict[str, Any]:
        """Numbers of devices, and the files."""
        head = {"format": "rsicalib.fleet/1", "version": _core.__version__}
        return {
            **head,
            "devices": len(self),
            "verdicts": self.verdicts,
            **self.first,
            **({} if self.population is None else {"population": self.population}),
            "files": [str(path) for path in self.files],
        }

    def text(self) -> str:
        """A few lines for the terminal."""
        counts = ", ".join(f"{count} {word}" for word, count in self.verdicts.items())
        lines = [
            f"{counted(len(self), 'device')}: {counts}",
            *sentences(self.first, self.population),
        ]
        return "\n".join([*lines, *map(str, self.files)]) + "\n"


@checked
def fleet(
    dataset: PathLike,
    mechanism: MechanismArg = "rsi",
    *,
    out: PathLike,
    by: str = "device",
    levels: Sequence[str] | None = None,
    terms: Sequence[str] | None = None,
    closures: Sequence[str] | None = None,
    noise: float | Mapping[str, float] | None = None,
    trace: bool = True,
    held_out: bool = False,
    workers: int | None = None,
    dask: str | None = None,
    resume: bool = False,
    time_limit: float | None = None,
    population: bool = False,
    reports: int = REPORTS,
    progress: Progress | None = None,
) -> Fleet:
    """Calibrate the devices of a dataset: one row each.

    Parameters
    ----------
    dataset : path
        Parquet (a file, or a folder of parts) or CSV (a file, a folder of them, or a folder with
        a folder for each device); see `docs/fleet.md`.
    mechanism : str, path or Mechanism
        What all devices are.
    out : path
        Folder for `fleet.parquet`, `fleet.html`, `run.json` and `devices`.
    by : str
        Column that says which device a row belongs to.
    levels : sequence of str, optional
        Columns that say in which group each of these is: a device of sessions, a batch, a tool. A
        column of the dataset, or of `levels.csv` beside it, which has a row for each and is checked
        before anything is computed. How the groups of each differ is told in `first` and in
        `population.json`.
    terms, closures, noise, trace, held_out : optional
        As in `calibrate_devices`.
    workers : int, optional
        Threads of this process; as many as there are cores where not given.
    dask : str, optional
        Address of a Dask scheduler, whose workers compute instead.
    resume : bool
        Keep the rows in `out` of devices whose readings are the same, also those of a run that
        was interrupted. Devices that took longer than `time_limit` are calibrated again.
    time_limit : float, optional
        Longest time for one device [s], as in `calibrate_devices`.
    population : bool
        Estimate what the devices share, errors of the drawing and their spread, in
        `population.json`: a prior for each of them (`population.parquet`) and for the next
        (`calibrate`, `population`). The mechanism needs the tolerances, `[model] sd`, of all terms.
    reports : int
        Devices that have a report of their own in `devices`, to which the page leads: those that
        stand out most. Each is traced once more.
    progress : callable, optional
        Called with a word, the devices that are done, and how many there are: as far as that is
        known, or about.

    Returns
    -------
    Fleet
        The rows, in the order of the dataset, and the files.

    Raises
    ------
    InputError
        The dataset, the options or the folder cannot be used. A device that cannot be used
        is a row.
    """
    opened = open_mechanism(mechanism)
    wanted = names_in("terms", terms, opened)
    options = {
        "terms": wanted,
        "closures": names_in("closures", closures, opened),
        "noise": dict(noise) if isinstance(noise, Mapping) else noise,
        "trace": trace,
        "held_out": held_out,
    }
    above = tuple(names("levels", levels) or ())
    job = Job(opened, by, {**options, "time_limit": time_limit})
    check_names(job.mechanism, by, above)
    tolerances = tolerances_of(job.mechanism, wanted) if population else {}
    source = Dataset(Path(dataset), by)
    grouped = beside(source.levels, by, above) if above and source.levels is not None else None
    in_rows = above if grouped is None else ()
    kept = {**options, **({"levels": list(in_rows)} if in_rows else {})}
    store = Store(Path(out), by, _run(job.mechanism, by, kept))
    known = store.begin(resume)
    job = replace(job, parts=store.parts, levels=in_rows)
    # Where rows are kept, the digest of each device's readings decides, which is told here.
    pieces = None if store.resumed else source.pieces(PARTITION)
    order: dict[Any, int] = {}
    count = sum(piece.devices for piece in pieces or ())

    def all_parts() -> Iterator[Part]:
        return source.partitions(PARTITION) if pieces is None else iter(pieces)

    if grouped is not None:
        grouped.check(label for part in all_parts() for label in part.labels)

    def new() -> Iterator[Part]:
        nonlocal count
        for number, part in enumerate(all_parts()):
            place = f"{store.number + number:09}"
            if isinstance(part, Piece):
                yield replace(part, place=place)
                continue
            if store.resumed:
                for label in part.labels:
                    order.setdefault(label, len(order))
            unknown = _unknown(part, known, job)
            count += len(unknown.labels)
            if unknown.labels:
                yield replace(unknown, place=place)

    def over(task: Task, partitions: Iterator[Part]) -> Iterator[tuple[Part, Rows]]:
        if dask is None:
            return over_threads(task, partitions, workers or available_cores())
        return over_dask(task, partitions, dask)

    done = 0
    for part, rows in over(job, new()):
        store.keep(part.place, rows)
        done += len(rows.get(by, ()))
        if progress is not None:
            progress("devices", done, max(count, done))
    table = store.finish(order)
    if not table or (store.resumed and not order):
        raise InputError.at(str(dataset), "no device", "at least one")
    if above:
        grouped = (grouped or _in_rows(table, by, above)).of(list(table[by]))
    first, found = first_line(table, job.mechanism, grouped), None
    files: tuple[Path, ...] = ()
    if population:
        used = {name: options[name] for name in ("closures", "noise")}
        again = lambda task: over(task, iter(all_parts()))  # noqa: E731
        found, devices = joint(job.mechanism, by, tolerances, used, again, grouped)
        files = store.write_population(found, devices)
    said = sentences(first, found)
    spread = spreads(table)
    out_of = remarks(table, by, spread)
    usable = {name for name, verdict in zip(table[by], table["verdict"], strict=True) if verdict}
    standing = dict.fromkeys(remark.device for remark in out_of if remark.device in usable)
    wanted = list(standing)[:reports]

    def reported(number: int) -> None:
        if progress is not None:
            progress("reports", number, len(wanted))

    used = {name: options[name] for name in ("terms", "closures", "noise")}
    links = write_reports(
        source.partitions(PARTITION), wanted, store.folder, job.mechanism, used, reported
    )
    html = page(
        table, by, job.mechanism, spread, out_of, said, Path(out), first["shifts"], links,
        misfit=is_misfit(first, found),
    )  # fmt: skip
    written = (store.folder / link for link in links.values())
    return Fleet(table, by, (*store.write_page(html), *files, *written), first, found)


def _in_rows(table: Mapping[str, Sequence[Any]], by: str, names: tuple[str, ...]) -> Levels:
    """The groups of each row as the columns of the dataset had them; no row that has none."""
    cells = zip(*(list(table[name]) for name in names), strict=True)
    rows = zip(table[by], cells, strict=True)
    return Levels(by, names, {str(unit): own for unit, own in rows if all(own)})


def _unknown(partition: Partition, known: Mapping[Any, str], job: Job) -> Partition:
    """The devices of a partition that are to be calibrated."""
    if not known or not len(partition.frame[job.by]):
        return partition
    try:
        found = digests(partition.frame, partition.rest, job.mechanism, job.by)
    except InputError:  # a row will say so
        return partition
    same = {label for label, digest in found.items() if known.get(label) == digest}
    return replace(partition, frame=without(partition.frame, job.by, same))


def _run(mechanism: Mechanism, by: str, options: Mapping[str, Any]) -> dict[str, Any]:
    """What the rows of a run depend on, beside the readings."""
    toml = mechanism.to_toml()
    return {
        "format": "rsicalib.fleet/1",
        "version": _core.__version__,
        "mechanism": mechanism.name,
        "mechanism_sha256": hashlib.sha256(toml.encode()).hexdigest(),
        "by": by,
        **options,
    }
