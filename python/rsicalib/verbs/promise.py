"""The rate of false alarms that a watch promises: per sample, or per hour at its pace of rows."""

from __future__ import annotations

import itertools
import math
import os
from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from rsicalib import _core
from rsicalib.errors import InputError
from rsicalib.io.stream import Rows
from rsicalib.io.tables import number
from rsicalib.work.state import read_state

PACE = 32
"""Steps between rows whose median is the pace. The first one alone is often another: a driver
starts, or a program that writes to a pipe does."""

PROMISED = "promised"
"""Where the head of a state has the promise as it was given."""


@dataclass(frozen=True)
class Promise:
    """A rate of false alarms as it was given."""

    rate: float
    hourly: bool

    @classmethod
    def of(cls, given: float | str | None, *, devices: bool = False) -> Promise:
        """What was given, as a number or as text: `1e-5`, `0.1/h`; as in Rust where nothing was.

        Rows of many devices have no common pace: there a rate is per sample.

        Raises
        ------
        InputError
            It is no rate.
        """
        if given is None:
            return cls(_core.FALSE_ALARMS, hourly=False)
        text = str(given).strip()
        rate, hourly = number(text.removesuffix("/h")), text.endswith("/h")
        if math.isnan(rate) or (hourly and devices):
            other = "for many devices" if devices else "or per hour such as 0.1/h"
            raise _refused(repr(given), f"a rate per sample such as 1e-5, {other}")
        return cls(rate, hourly)

    def __str__(self) -> str:
        return f"{self.rate!r}/h" if self.hourly else repr(self.rate)

    def per_sample(
        self, rows: Iterator[Rows], state: str | os.PathLike[str] | None
    ) -> tuple[float, Iterator[Rows]]:
        """The rate per sample, and all rows: those that were read for it stand before the others.

        A watch that goes on from a state has the pace that it had.

        Raises
        ------
        InputError
            Rows have no pace, or the state is that of another promise.
        """
        if not self.hourly:
            return self.rate, rows
        if state is not None and os.path.exists(state):
            head, _ = read_state(state)
            if head.get(PROMISED) != str(self):
                raise another(state, "rate of false alarms")
            return float(head["false_alarms"]), rows
        begun, pace = _paced(rows, repr(str(self)))
        return self.rate * pace / 3600.0, itertools.chain(begun, rows)


def another(state: str | os.PathLike[str], words: str) -> InputError:
    """That a state cannot be gone on from: ready to be raised."""
    found = f"the state of a watch with another {words}"
    return InputError.at(str(state), found, "the same, or another file for this watch")


def _paced(rows: Iterator[Rows], promise: str) -> tuple[list[Rows], float]:
    """The first rows, and the median of the steps between them [s]."""
    begun: list[Rows] = []
    times = steps = np.zeros(0)
    while len(steps) < PACE and (more := next(rows, None)) is not None:
        if more.time_s is None:
            raise _refused(f"{promise} and no column time_s", "times")
        begun.append(more)
        times = np.append(times, more.time_s[np.isfinite(more.time_s)])
        steps = np.diff(times)
        steps = steps[steps > 0.0]
    if not len(steps):
        found = "fewer than two rows" if len(times) < 2 else "no two times"
        raise _refused(f"{promise} and {found}", "times")
    return begun, float(np.median(steps[:PACE]))


def _refused(found: str, expected: str) -> InputError:
    return InputError(f"false alarms: found {found}, expected {expected}")
