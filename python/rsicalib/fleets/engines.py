"""Who computes the partitions: threads of this process, or the workers of a Dask cluster."""

from __future__ import annotations

import importlib
import logging
import os
from collections.abc import Iterable, Iterator, Mapping
from concurrent.futures import FIRST_COMPLETED, CancelledError, Future, ThreadPoolExecutor, wait
from contextlib import contextmanager
from dataclasses import dataclass
from itertools import islice
from typing import Any, Protocol, TypeAlias

from rsicalib._core import Mechanism
from rsicalib.errors import InputError
from rsicalib.fleets.dataset import Partition, Piece
from rsicalib.fleets.devices import calibrate_devices, without
from rsicalib.fleets.frames import Rows, devices_in, joined_rows
from rsicalib.fleets.levels import groups_of
from rsicalib.fleets.store import Parts
from rsicalib.plain_text import installed_by

Part: TypeAlias = Partition | Piece
"""What is handed out: rows, or where they are."""


def _work(job: Task, part: Part) -> Rows:
    """Rows of the devices of a part, which is read where this runs, and written if it can be."""
    rows = joined_rows(*(job(partition) for partition in part.read()))
    return rows if job.parts is None else job.parts.keep(part.place, rows)


def _reaches(paths: list[str]) -> bool:
    return all(os.path.exists(path) for path in paths)


class Task(Protocol):
    """What engines hand partitions to."""

    @property
    def by(self) -> str:
        """The column that names the device."""

    @property
    def parts(self) -> Parts | None:
        """Where rows are written; None where they come back."""

    def __call__(self, partition: Partition) -> Rows:
        """Rows of the devices of a partition."""

    def refuse(self, refused: Mapping[Any, str]) -> Rows:
        """Rows of devices without a result."""


@dataclass(frozen=True)
class Job:
    """What is done to each partition; travels to the workers of a cluster."""

    mechanism: Mechanism
    by: str
    options: Mapping[str, Any]
    """Keyword arguments of `calibrate_devices`."""
    parts: Parts | None = None
    levels: tuple[str, ...] = ()
    """Columns that say in which group of each level a device is."""

    def __call__(self, partition: Partition) -> Rows:
        """Calibrate the devices of a partition."""
        rows: Rows = {}
        refused = dict(partition.refused)
        groups: dict[Any, tuple[str, ...]] = {}
        if len(partition.frame[self.by]):
            frame, rest = partition.frame, partition.rest
            if self.levels:
                groups, mixed = groups_of(frame, self.by, self.levels)
                refused |= mixed
                frame = without(frame, self.by, set(mixed))
        if len(partition.frame[self.by]) and len(frame[self.by]):
            try:
                rows = calibrate_devices(
                    frame, self.mechanism, by=self.by, rest=rest, **self.options
                )
            except InputError as error:
                if not partition.apart:
                    raise
                refused |= dict.fromkeys(devices_in(frame[self.by]), error.message)
        made = joined_rows(rows, self.refuse(refused))
        place = {label: k for k, label in enumerate(partition.labels)}
        order = sorted(range(len(place)), key=lambda k: place[made[self.by][k]])
        made = {name: [cells[k] for k in order] for name, cells in made.items()}
        for k, level in enumerate(self.levels):
            none = ("",) * len(self.levels)
            made[level] = [groups.get(label, none)[k] for label in made[self.by]]
        if partition.files:
            made["file"] = [partition.files.get(label) for label in made[self.by]]
        return made

    def refuse(self, refused: Mapping[Any, str]) -> Rows:
        """Rows of devices that cannot be calibrated."""
        return {self.by: list(refused), "message": list(refused.values())} if refused else {}


AHEAD = 2
"""Partitions that wait for each thread: enough to keep it busy, few enough for the memory."""


def over_threads(
    job: Task, partitions: Iterable[Part], workers: int
) -> Iterator[tuple[Part, Rows]]:
    """Results as they are ready, computed by threads of this process."""
    source = iter(partitions)
    with ThreadPoolExecutor(workers) as pool:
        running: dict[Future[Rows], Part] = {}
        try:
            while True:
                for partition in islice(source, AHEAD * workers - len(running)):
                    running[pool.submit(_work, job, partition)] = partition
                if not running:
                    return
                # With a timeout, since a wait without one cannot be interrupted everywhere.
                for done in wait(running, timeout=0.5, return_when=FIRST_COMPLETED).done:
                    yield running.pop(done), done.result()
        finally:
            pool.shutdown(wait=False, cancel_futures=True)


def over_dask(job: Task, partitions: Iterable[Part], address: str) -> Iterator[tuple[Part, Rows]]:
    """Results as they are ready, computed by the workers of a Dask cluster.

    Workers read row groups themselves where all of them reach the files; else rows travel with
    their task. Where a worker dies, the scheduler gives its task to another one. A partition that
    kills worker after worker becomes rows that say so.
    """
    try:
        distributed: Any = importlib.import_module("distributed")
    except ImportError:
        hint = f"Install it with: {installed_by('dask')}"
        raise InputError(f"--dask: found no package 'distributed', expected it. {hint}") from None
    try:
        client = distributed.Client(address, timeout="10s")
    except (OSError, ValueError, TimeoutError) as error:
        found = f"{address!r}, where no scheduler answers ({error})"
        raise InputError(f"--dask: found {found}, expected the address of one") from None
    with _alone_told(client):
        source = _sent(partitions, client)
        running: dict[str, Part] = {}
        ready = distributed.as_completed()
        threads = sum(client.nthreads().values()) or 1

        def submit(count: int) -> None:
            for partition in islice(source, count):
                future = client.submit(_work, job, partition, pure=False)
                running[future.key] = partition
                ready.add(future)

        with _connected(address):
            submit(AHEAD * threads)
        for future in ready:
            partition = running.pop(future.key)
            with _connected(address):
                failure = future.exception()
                if isinstance(failure, CancelledError):
                    raise failure
                rows = future.result() if failure is None else {}
            if isinstance(failure, distributed.KilledWorker):
                why = f"every worker that tried its partition died ({failure})"
                yield partition, job.refuse({label: why for label in partition.labels})
            elif failure is not None:
                raise failure
            else:
                yield partition, rows
            with _connected(address):
                submit(1)


def _sent(partitions: Iterable[Part], client: Any) -> Iterator[Part]:
    """What travels: where rows are, if every worker reaches them, else the rows."""
    reached: dict[str, bool] = {}
    for part in partitions:
        if isinstance(part, Piece):
            new = [path for path in dict.fromkeys(p for p, _ in part.places) if path not in reached]
            if new:
                there = all(client.run(_reaches, new).values())
                reached |= dict.fromkeys(new, there)
            if not all(reached[path] for path, _ in part.places):
                yield from part.read()
                continue
        yield part


@contextmanager
def _alone_told(client: Any) -> Iterator[None]:
    """Close a client at the end, without what it logs of a scheduler whose loss is told already."""
    loggers = [logging.getLogger(name) for name in ("asyncio", "distributed.client")]
    try:
        with client:
            try:
                yield
            except InputError:
                for logger in loggers:
                    logger.addFilter(_nothing)
                raise
    finally:
        for logger in loggers:
            logger.removeFilter(_nothing)


def _nothing(_: logging.LogRecord) -> bool:
    return False


@contextmanager
def _connected(address: str) -> Iterator[None]:
    """Say that the scheduler is gone, where it is."""
    try:
        yield
    except (CancelledError, OSError, TimeoutError) as error:
        found = f"the scheduler at {address} gone ({type(error).__name__})"
        hint = "The rows so far are kept: go on with --resume."
        raise InputError(f"--dask: found {found}, expected it until the end. {hint}") from None
