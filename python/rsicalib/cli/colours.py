"""Colours of the summary on a terminal; none in a pipe, and none where `NO_COLOR` is set."""

from __future__ import annotations

import os
import re
from typing import TextIO

BOLD, GREEN, RED, BLUE, FAINT, PLAIN = (f"\x1b[{n}m" for n in (1, 32, 31, 34, 2, 0))


def wants_colour(stream: TextIO) -> bool:
    """Whether a stream shows colours: <https://no-color.org>, <https://force-color.org>."""
    if os.environ.get("NO_COLOR"):
        return False
    if os.environ.get("FORCE_COLOR"):
        return True
    able = os.name != "nt" or "WT_SESSION" in os.environ  # the old Windows console shows codes
    return able and stream.isatty() and os.environ.get("TERM") != "dumb"


def painted(summary: str, good: bool) -> str:
    """Colour a summary: its verdict, what to do next, and faint labels.

    Parameters
    ----------
    summary : str
        As `Result.summary` gives it.
    good : bool
        Whether the verdict is one to be glad of.

    Returns
    -------
    str
        The same text with codes for a terminal.
    """
    from rsicalib.report.terminal import LABELS

    colour = BOLD + (GREEN if good else RED)
    summary = re.sub(r"\A[^:\n]+", lambda m: f"{colour}{m[0]}{PLAIN}", summary)
    summary = re.sub(r"(?m)^→", f"{BLUE}→{PLAIN}", summary)
    labels = "|".join(LABELS)
    return re.sub(rf"(?m)^  ({labels})(?= )", lambda m: f"  {FAINT}{m[1]}{PLAIN}", summary)
