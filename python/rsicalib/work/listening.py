"""Who hears how a job goes: a callback of the caller, and the logger `rsicalib`."""

from __future__ import annotations

import logging
import threading
from collections.abc import Callable
from typing import TypeAlias, TypeVar

from rsicalib.report.words import sentence
from rsicalib.results.result import Result

ProgressArg: TypeAlias = Callable[[str, float], object]
"""Called with the stage in words and the share of the job that is done, 0 to 1.

How much there is to do depends on what is found, so the share is an estimate; it never falls. An
exception of the callback ends the job, and is raised.
"""

log = logging.getLogger("rsicalib")
log.addHandler(logging.NullHandler())  # who wants to read it adds one

AnyResult = TypeVar("AnyResult", bound=Result)


def listener(progress: ProgressArg | None) -> ProgressArg | None:
    """Return what the core calls: the callback, with stages logged; None where nobody listens.

    In the main thread somebody always does: between two lines of Python Ctrl-C is heard, and ends
    the job.
    """
    if not log.isEnabledFor(logging.DEBUG):
        alone = threading.current_thread() is threading.main_thread()
        return progress or (_heard if alone else None)
    last = ""

    def tell(stage: str, share: float) -> None:
        nonlocal last
        if stage != last:
            log.debug("%3.0f %%  %s", 100 * share, stage)
            last = stage
        if progress is not None:
            progress(stage, share)

    return tell


def _heard(stage: str, share: float) -> None:
    """Nothing to do but to let a signal in."""


def finished(result: AnyResult) -> AnyResult:
    """Log warnings and the verdict of a result; it is returned as it is."""
    for warning in result.warnings:
        log.warning("%s", warning)
    data = result.readings
    log.info("%s, %d poses: %s", result.mechanism, data.poses, sentence(result))
    return result
