"""Verdicts, and what a command returns for each: as the core states them."""

from __future__ import annotations

from rsicalib import _core

__all__ = ["EXIT_CODES", "RESIDUAL_LEVEL", "WORSE"]

EXIT_CODES: dict[str, int] = dict(_core.VERDICTS)
"""By verdict: 0 usable, 3 undetermined, 4 a residual is left, or something is absurd."""

RESIDUAL_LEVEL: float = _core.RESIDUAL_LEVEL
"""A residual that chance would exceed less often than this is significant."""

WORSE: float = _core.WORSE
"""What was not fitted must not be off by more than this many times what it was before."""
