"""How much of a statistic a test takes: a small form in `./check`, else the full one.

    RSICALIB_FULL=1 pytest -n 2 tests/test_damage.py tests/test_outside.py …

`grep -rn "sized(" tests` lists the tests that have two forms; `docs/decisions/0011-time.md` says
why.
"""

from __future__ import annotations

import os
from typing import TypeVar

T = TypeVar("T")

FULL = bool(os.environ.get("RSICALIB_FULL"))
"""Whether statistics are to be taken in full."""


def sized(small: T, full: T) -> T:
    """The size of a statistic."""
    return full if FULL else small
