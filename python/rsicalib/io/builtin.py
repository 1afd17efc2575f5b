"""Mechanisms that the core brings along."""

from __future__ import annotations

from collections.abc import Callable

from rsicalib._core import Mechanism

__all__ = ["BUILTIN"]

BUILTIN: dict[str, Callable[[], Mechanism]] = {"rsi": Mechanism.rsi}
"""By name. Apart from the files of mechanisms, which only those need who have one."""
