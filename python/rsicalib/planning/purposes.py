"""What each pose of a plan is visited for, as the core says it."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import Any, TypeAlias

Purpose: TypeAlias = Mapping[str, Any]
"""`kind`, and what that kind has: `tells` (`apart`, `gain`), `platform` (`before`, `after`), or
`falls` (`times`)."""


def gain_of(purpose: Purpose) -> float | None:
    """By how much a pose parts what is open [χ²]; None where it has another purpose."""
    return purpose["gain"] if purpose["kind"] == "tells" else None


def reason(purpose: Purpose, names: Sequence[str], unit: str) -> str:
    """What a pose is visited for, in words."""
    if purpose["kind"] == "tells":
        a, b = purpose["apart"]
        return f"tells {names[a]} from {names[b]} (λ +{purpose['gain']:.3g})"
    if purpose["kind"] == "platform":
        if not math.isfinite(purpose["before"]):
            return "shows what moves the platform and was not known"
        after, before = purpose["after"], purpose["before"]
        return f"platform known to {after:.2g} {unit} instead of {before:.2g}"
    return f"makes what is minimised {purpose['times']:.3g} times as large"
