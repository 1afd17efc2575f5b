"""Where samples come from: standard input, a file that grows, or a command.

They are lines of CSV or JSON, or the messages of `ros2 topic echo`.
"""

from __future__ import annotations

import io
import os
import queue
import shlex
import subprocess
import sys
import threading
import time
from collections.abc import Iterator
from contextlib import suppress
from pathlib import Path
from typing import IO

from rsicalib.errors import InputError
from rsicalib.io.lines import POLL_S
from rsicalib.io.messages import as_json
from rsicalib.io.sources import LONGEST_LINE, STANDARD_INPUT, standard_input

ENDS_S = 0.5
"""In which a command ends that is asked to."""

WAITING = 100_000
"""Lines that wait to be taken, at most: a source that is faster waits itself."""


class Lines:
    """Lines of a source, read by a thread of their own so that nobody waits for them."""

    def __init__(
        self,
        lines: Iterator[str],
        stop: threading.Event,
        process: subprocess.Popen[str] | None = None,
    ) -> None:
        self._queue: queue.Queue[str | None] = queue.Queue(WAITING)
        self._stop = stop
        self._process = process
        self.ended = False
        threading.Thread(target=self._read, args=(lines,), daemon=True).start()

    def _read(self, lines: Iterator[str]) -> None:
        try:
            for line in lines:
                if self._stop.is_set():
                    break
                self._queue.put(line)
        finally:
            self._queue.put(None)
            if self._process is not None and self._process.stdout is not None:
                self._process.stdout.close()

    def take(self, timeout_s: float) -> list[str]:
        """All lines that have arrived; an empty list where none has within the time."""
        found: list[str] = []
        try:
            item = self._queue.get(timeout=timeout_s)
            while True:
                if item is None:
                    self.ended = True
                    break
                found.append(item)
                item = self._queue.get_nowait()
        except queue.Empty:
            pass
        return found

    def close(self) -> None:
        """Stop reading, and end the command that writes, which may have nothing to write."""
        self._stop.set()
        if self._process is not None:
            self._process.terminate()
            with suppress(subprocess.TimeoutExpired):
                self._process.wait(ENDS_S)


def open_source(source: str) -> Lines:
    """Open a source of lines.

    Parameters
    ----------
    source : str
        `-` for standard input, the path of a file that grows, or a command.

    Returns
    -------
    Lines
        Its lines, as they arrive; a message of several lines is one line of JSON.

    Raises
    ------
    InputError
        There is no such file, and no such command; or standard input is closed.
    """
    stop = threading.Event()
    if source == STANDARD_INPUT:
        standard_input("samples, one on each line")
        if isinstance(sys.stdin, io.TextIOWrapper):
            sys.stdin.reconfigure(encoding="utf-8", errors="replace")
        return Lines(as_json(_whole(sys.stdin)), stop)
    path = Path(source)
    if os.path.exists(path):
        return Lines(as_json(_growing(path, stop)), stop)
    try:
        process = started(source, subprocess.DEVNULL)
    except (OSError, ValueError) as error:
        found = f"{source!r}, which is no file and cannot be run ({error})"
        raise InputError(f"--source: found {found}, expected -, a file or a command") from None
    assert process.stdout is not None
    return Lines(as_json(_whole(process.stdout)), stop, process)


def started(command: str, stdin: int) -> subprocess.Popen[str]:
    """Start a command whose lines are read; `stdin` as `subprocess` takes it.

    An OSError or a ValueError says that it cannot be run.
    """
    return subprocess.Popen(
        shlex.split(command),
        stdin=stdin,
        stdout=subprocess.PIPE,
        encoding="utf-8",
        errors="replace",
    )


def _whole(file: IO[str]) -> Iterator[str]:
    """Lines until the end; a line that is too long comes in parts, none of which is a sample."""
    return iter(lambda: file.readline(LONGEST_LINE), "")


def _growing(path: Path, stop: threading.Event) -> Iterator[str]:
    """Whole lines of a file, for ever; a line that is half written is waited for."""
    half = ""
    with path.open(encoding="utf-8", errors="replace") as file:
        while not stop.is_set():
            text = file.readline(LONGEST_LINE)
            if not text:
                if path.exists() and os.stat(path).st_size < file.tell():
                    file.seek(0)  # begun anew
                time.sleep(POLL_S)
                continue
            half = (half + text)[-LONGEST_LINE:]  # a longer one is no line
            if half.endswith("\n"):
                yield half
                half = ""
