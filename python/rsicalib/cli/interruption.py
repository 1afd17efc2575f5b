"""Jobs of the core that Ctrl-C can interrupt."""

from __future__ import annotations

import threading
from collections.abc import Callable
from typing import TypeVar

T = TypeVar("T")


def interruptible(job: Callable[[], T], tick: Callable[[], None] | None = None) -> T:
    """Run a job of the core so that Ctrl-C is heard meanwhile, and `tick` is called."""
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
