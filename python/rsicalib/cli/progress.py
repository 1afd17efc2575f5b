"""Progress on one line of standard error, with the time that is left.

By hand: `rich` would be four packages (with markdown-it-py, mdurl and pygments) for one line.
"""

from __future__ import annotations

import argparse
import math
import os
import sys
import time
from collections.abc import Callable
from types import TracebackType
from typing import TextIO

from rsicalib.cli.streams import columns_of

PATIENCE = 1.0
"""What takes less than this needs no progress [s]."""
PAUSE = 0.1
"""Least time between two lines [s]."""


class ProgressLine:
    """A line that is written again and again, and gone in the end.

    Parameters
    ----------
    stream : text file
        Where to: a terminal.
    what : str
        What is done, until a stage says it.
    clock : callable
        Seconds; the process's own clock where not given.
    """

    def __init__(
        self, stream: TextIO, what: str = "", clock: Callable[[], float] = time.monotonic
    ) -> None:
        self.stream = stream
        self.clock = clock
        self.began = self.told = clock()
        self.last = (what, 0.0)
        self.length = 0

    def __call__(self, what: str, share: float) -> None:
        """Show what is done, and the time that is left at the pace so far."""
        self.last = (what, share)
        self._show(PAUSE)

    def tick(self) -> None:
        """Show that time passes, in a stage that has nothing to tell."""
        self._show(1.0)

    def _show(self, pause: float) -> None:
        now = self.clock()
        spent = now - self.began
        if spent < PATIENCE or now - self.told < pause:
            return
        self.told = now
        what, share = self.last
        done = f"{100 * share:.0f} %, {duration(spent)}" if share > 0.0 else duration(spent)
        left = f", about {duration(spent * (1 - share) / share)} left" if share > 0.02 else ""
        words = f"{what}: {done}{left}"
        self._write(words[: max(20, (columns_of(self.stream) or 80) - 1)])

    def counted(self, what: str, done: int, total: int) -> None:
        """Show progress that is counted."""
        if done == 0:
            self.began = self.clock()
        self(what, done / max(total, 1))

    def rows(self, number: int) -> None:
        """Show how many rows have been read, of nobody knows how many."""
        self(f"{number} rows", 0.0)

    def clear(self) -> None:
        """Leave nothing on the line."""
        if self.length:
            self._write("")
            self.stream.write("\r")
            self.length = 0

    def __enter__(self) -> ProgressLine:
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        self.clear()

    def _write(self, words: str) -> None:
        """Write over what stands there."""
        self.stream.write(f"\r{words:{self.length}}")
        self.stream.flush()
        self.length = len(words)


def progress_of(args: argparse.Namespace, what: str = "") -> ProgressLine | None:
    """Return the line to show progress on: none with --quiet, or where nobody would see it."""
    seen = not args.quiet and sys.stderr.isatty() and os.environ.get("TERM") != "dumb"
    return ProgressLine(sys.stderr, what) if seen else None


def duration(seconds: float) -> str:
    """Seconds in a few characters.

    Examples
    --------
    >>> duration(7.2), duration(75), duration(4000)
    ('8 s', '1:15 min', '1:07 h')
    """
    whole = math.ceil(seconds)
    if whole < 60:
        return f"{whole} s"
    minutes, rest = divmod(whole, 60)
    if minutes < 60:
        return f"{minutes}:{rest:02d} min"
    minutes += rest > 0
    return f"{minutes // 60}:{minutes % 60:02d} h"
