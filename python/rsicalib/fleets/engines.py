"""Who computes the partitions: threads of this process, or the workers of a Dask cluster."""

from __future__ import annotations

import importlib
from collections.abc import Iterable, Iterator, Mapping
from concurrent.futures import FIRST_COMPLETED, CancelledError, Future, ThreadPoolExecutor, wait
from contextlib import contextmanager
from dataclasses import dataclass
from itertools import islice
from typing import Any, Protocol, TypeAlias

from rsicalib._core import Mechanism
from rsicalib.errors import InputError
from rsicalib.fleets.dataset import Partition
from rsicalib.fleets.devices import calibrate_devices
from rsicalib.fleets.frames import joined_rows

__all__ = ["Job", "Rows", "Task", "over_dask", "over_threads"]

Rows: TypeAlias = dict[str, Any]
"""Results by column, each of length n."""


class Task(Protocol):
    """What engines hand partitions to."""

    @property
    def by(self) -> str:
        """The column that names the device."""

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

    def __call__(self, partition: Partition) -> Rows:
        """Calibrate the devices of a partition."""
        rows: Rows = {}
        refused = dict(partition.refused)
        if len(partition.frame[self.by]):
            frame, rest = partition.frame, partition.rest
            try:
                rows = calibrate_devices(
                    frame, self.mechanism, by=self.by, rest=rest, **self.options
                )
            except InputError as error:
                if not partition.apart:
                    raise
                refused |= dict.fromkeys(frame[self.by], error.message)
        return joined_rows(rows, self.refuse(refused))

    def refuse(self, refused: Mapping[Any, str]) -> Rows:
        """Rows of devices that cannot be calibrated."""
        return {self.by: list(refused), "message": list(refused.values())} if refused else {}


AHEAD = 2
"""Partitions that wait for each thread: enough to keep it busy, few enough for the memory."""


def over_threads(
    job: Task, partitions: Iterable[Partition], workers: int
) -> Iterator[tuple[Partition, Rows]]:
    """Results as they are ready, computed by threads of this process."""
    source = iter(partitions)
    with ThreadPoolExecutor(workers) as pool:
        running: dict[Future[Rows], Partition] = {}
        try:
            while True:
                for partition in islice(source, AHEAD * workers - len(running)):
                    running[pool.submit(job, partition)] = partition
                if not running:
                    return
                for done in wait(running, return_when=FIRST_COMPLETED).done:
                    yield running.pop(done), done.result()
        finally:
            pool.shutdown(wait=False, cancel_futures=True)


def over_dask(
    job: Task, partitions: Iterable[Partition], address: str
) -> Iterator[tuple[Partition, Rows]]:
    """Results as they are ready, computed by the workers of a Dask cluster.

    A partition travels with its task, so the scheduler gives it to another worker where one
    dies. A partition that kills worker after worker becomes rows that say so.
    """
    try:
        distributed: Any = importlib.import_module("distributed")
    except ImportError:
        hint = "Install it with: pip install rsicalib[dask]"
        raise InputError(f"--dask: found no package 'distributed', expected it. {hint}") from None
    try:
        client = distributed.Client(address, timeout="10s")
    except (OSError, ValueError, TimeoutError) as error:
        found = f"{address!r}, where no scheduler answers ({error})"
        raise InputError(f"--dask: found {found}, expected the address of one") from None
    with client:
        source = iter(partitions)
        running: dict[str, Partition] = {}
        ready = distributed.as_completed()
        threads = sum(client.nthreads().values()) or 1

        def submit(count: int) -> None:
            for partition in islice(source, count):
                future = client.submit(job, partition, pure=False)
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
                labels = [*dict.fromkeys(partition.frame[job.by]), *partition.refused]
                yield partition, job.refuse({label: why for label in labels})
            elif failure is not None:
                raise failure
            else:
                yield partition, rows
            with _connected(address):
                submit(1)


@contextmanager
def _connected(address: str) -> Iterator[None]:
    """Say that the scheduler is gone, where it is."""
    try:
        yield
    except (CancelledError, OSError, TimeoutError) as error:
        found = f"the scheduler at {address} gone ({type(error).__name__})"
        hint = "The rows so far are kept: go on with --resume."
        raise InputError(f"--dask: found {found}, expected it until the end. {hint}") from None
