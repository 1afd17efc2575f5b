"""The number of threads that can run at once."""

from __future__ import annotations

import os


def available_cores() -> int:
    """Count the cores that this process may use, on any system.

    Returns
    -------
    int
        At least 1. Python 3.13 and later count only the cores that the process is allowed to
        use; earlier versions count all cores of the machine.
    """
    count = getattr(os, "process_cpu_count", os.cpu_count)
    return count() or 1
