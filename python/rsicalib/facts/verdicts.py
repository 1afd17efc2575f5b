"""Verdicts, and what a command returns for each: as the core states them."""

from __future__ import annotations

from rsicalib import _core

EXIT_CODES: dict[str, int] = dict(_core.VERDICTS)
"""By verdict: 0 usable, 3 undetermined, 4 a residual is left, or something is absurd."""

UNUSABLE = frozenset({"undetermined", "implausible"})
"""Verdicts under which there are no parameters to rely on."""
