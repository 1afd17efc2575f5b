"""Significance of a residual, and what a command returns for a verdict."""

from __future__ import annotations

__all__ = ["ALPHA", "exit_code"]

ALPHA = 0.01
"""A residual that chance would exceed less often than this is significant."""


def exit_code(verdict: str | None) -> int:
    """What the command returns: 0 usable, 3 undetermined, 4 residual left."""
    if verdict == "undetermined":
        return 3
    return 4 if verdict in ("unexplained", "partly_explained") else 0
