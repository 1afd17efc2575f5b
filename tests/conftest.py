"""What the tests of a run share: who runs them, which of them were skipped, and why."""

from __future__ import annotations

import gc
import os
from collections import Counter
from importlib.util import find_spec
from pathlib import Path
from typing import Any

import pytest

# One process for each core is at work: threads of small products only wait for one another.
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

# Modules are imported for their doctests; these need the extra `physics`.
collect_ignore = [] if find_spec("mujoco") else ["drive/body.py", "drive/robot.py"]


def pytest_addoption(parser: pytest.Parser) -> None:
    """What a rule of the search is worth: `pytest --off RULE`, as `python -m tests.ablation`."""
    parser.addoption("--off", action="append", default=[], help="switch a rule of the search off")


def pytest_configure(config: pytest.Config) -> None:
    """Switch rules off, in this process; commands that tests start have them all."""
    off = config.getoption("off")
    if off:
        from tests.ablation import switch_off

        switch_off(off)


@pytest.hookimpl(optionalhook=True)
def pytest_xdist_make_scheduler(config: pytest.Config, log: Any) -> Any:
    """Tests of one file run in one process, so that what they share is computed once."""
    if config.getoption("dist") != "load":
        return None  # somebody asked for another order
    from xdist.scheduler import LoadFileScheduling

    return LoadFileScheduling(config, log)


def pytest_collection_finish() -> None:
    """What is imported stays: no collection of garbage looks through it again."""
    gc.freeze()


def pytest_terminal_summary(terminalreporter: Any) -> None:
    """Write what was skipped to the file that `check` asks for: its last line says it."""
    where = os.environ.get("RSICALIB_SKIPPED")
    if where is None:
        return
    reasons = [report.longrepr for report in terminalreporter.stats.get("skipped", [])]
    words = [str(r[2] if isinstance(r, tuple) else r).removeprefix("Skipped: ") for r in reasons]
    counted = [f"{count} because {why}" for why, count in Counter(words).most_common()]
    Path(where).write_text("; ".join(counted) or "none", encoding="utf-8")
