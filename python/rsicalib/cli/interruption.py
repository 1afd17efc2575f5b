"""What ends a command early: jobs that Ctrl-C can interrupt, and the signals that count as it."""

from __future__ import annotations

import signal
import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from types import FrameType
from typing import TypeVar

T = TypeVar("T")

ENDING = ("SIGTERM", "SIGHUP")
"""Signals that end a process: of whoever stops a service, or closes a terminal."""


class Ended(KeyboardInterrupt):
    """A signal other than that of Ctrl-C has asked the command to end."""

    def __init__(self, number: int) -> None:
        super().__init__(number)
        self.number = number


def exit_code(error: KeyboardInterrupt) -> int:
    """The exit code of a command that a signal ended, as shells count: 128 and its number."""
    return 128 + (error.number if isinstance(error, Ended) else signal.SIGINT)


@contextmanager
def ends_by_signals() -> Iterator[None]:
    """Let the signals that end a process end the command as Ctrl-C does.

    A signal that somebody handles or ignores already is left alone.
    """

    def end(number: int, frame: FrameType | None) -> None:
        raise Ended(number)

    heard: list[int] = []
    if threading.current_thread() is threading.main_thread():
        for number in (getattr(signal, name) for name in ENDING if hasattr(signal, name)):
            if signal.getsignal(number) is signal.SIG_DFL:
                signal.signal(number, end)
                heard.append(number)
    try:
        yield
    finally:
        for number in heard:
            signal.signal(number, signal.SIG_DFL)


def deaf_to_signals() -> None:
    """Ignore what would interrupt the last steps of a command that ends already."""
    for name in ("SIGINT", *ENDING):
        if hasattr(signal, name):
            signal.signal(getattr(signal, name), signal.SIG_IGN)


def interruptible(job: Callable[[], T], tick: Callable[[], None] | None = None) -> T:
    """Run a job so that Ctrl-C is heard meanwhile, and `tick` is called.

    The job runs in a thread of its own, which no signal reaches: libraries that are written in
    other languages lose an exception that a signal raises inside of them.
    """
    out: list[T] = []
    errors: list[BaseException] = []

    def run() -> None:
        try:
            out.append(job())
        except BaseException as error:
            errors.append(error)

    thread = threading.Thread(target=run, daemon=True)
    thread.start()
    while thread.is_alive():
        thread.join(0.2)
        if tick is not None:
            tick()
    if errors:
        raise errors[0]
    return out[0]
