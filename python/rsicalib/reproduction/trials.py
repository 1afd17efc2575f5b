"""Trials of a simulation: run on all cores, and averaged.

Trials are drawn in chunks, each from a seed of its own, so that results depend on neither the
number of threads nor their order. The core releases the interpreter, so threads share the work.
"""

from __future__ import annotations

from collections.abc import Callable
from concurrent.futures import FIRST_COMPLETED, Future, ThreadPoolExecutor, wait
from dataclasses import dataclass
from typing import TypeVar

import numpy as np
import numpy.typing as npt

from rsicalib.arrays import FloatArray
from rsicalib.cores import available_cores
from rsicalib.errors import InputError
from rsicalib.facts.records import Record

Progress = Callable[[int, int], None]
"""Called with the trials that are done, and all of them."""

T = TypeVar("T")

CHUNK = 50
"""Trials that one job takes; part of what a seed means."""

ITERATIONS = 200
"""Linearisations before a trial counts as failed."""


class Estimate(Record):
    """A mean over trials.

    Attributes
    ----------
    value : float
        The mean.
    sd : float or None
        Standard error of the mean.
    trials : int
        Number of trials.
    """

    value: float
    sd: float | None
    trials: int

    @classmethod
    def of(cls, values: npt.ArrayLike) -> Estimate:
        """The mean of independent trials, and its standard error."""
        values = np.asarray(values, dtype=np.float64)
        count = len(values)
        if count == 0:
            return cls(float("nan"), None, 0)
        sd = float(values.std(ddof=1) / np.sqrt(count)) if count > 1 else None
        return cls(float(values.mean()), sd, count)


@dataclass(frozen=True)
class Draws:
    """How trials of an experiment are drawn.

    Attributes
    ----------
    trials, seed : int
        How many in all; same seed, same results.
    progress : callable, optional
        Called with trials done and trials in all, from the calling thread.
    workers : int, optional
        Threads; as many as there are cores by default.
    """

    trials: int
    seed: int = 0
    progress: Progress | None = None
    workers: int | None = None

    def run(self, job: Callable[[np.random.Generator, int], T], chunk: int = CHUNK) -> list[T]:
        """Run the trials in chunks on all cores, in an order that nothing depends on.

        Parameters
        ----------
        job : callable
            Takes a generator of its own and the number of trials in its chunk.
        chunk : int
            Number of trials in one job.

        Returns
        -------
        list
            What the jobs return, in the order of the chunks.

        Notes
        -----
        Ctrl-C drops the chunks that have not begun and is raised again at once.
        """
        if self.trials < 1:
            raise InputError(f"trials: found {self.trials}, expected at least 1")
        sizes = [min(chunk, self.trials - first) for first in range(0, self.trials, chunk)]
        seeds = np.random.SeedSequence(self.seed).spawn(len(sizes))
        results: dict[int, T] = {}
        with ThreadPoolExecutor(max_workers=self.workers or available_cores()) as pool:
            try:
                waiting: dict[Future[T], int] = {
                    pool.submit(job, np.random.default_rng(own), size): k
                    for k, (own, size) in enumerate(zip(seeds, sizes, strict=True))
                }
                while waiting:
                    # With a timeout, since a wait without one cannot be interrupted everywhere.
                    done, _ = wait(waiting, timeout=0.5, return_when=FIRST_COMPLETED)
                    for future in done:
                        k = waiting.pop(future)
                        results[k] = future.result()
                    if self.progress is not None and done:
                        self.progress(sum(sizes[k] for k in results), self.trials)
            except BaseException:
                pool.shutdown(wait=False, cancel_futures=True)
                raise
        return [results[k] for k in range(len(sizes))]


def rms(values: FloatArray) -> float:
    """Root mean square."""
    return float(rms_of_rows(np.ravel(values)))


def rms_of_rows(values: FloatArray) -> FloatArray:
    """Root mean square along the last axis."""
    return np.asarray(np.sqrt(np.mean(np.square(values), axis=-1)))
