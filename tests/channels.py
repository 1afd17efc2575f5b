"""A mechanism of which nothing but the names of its channels is known, for tests of rows."""

from __future__ import annotations

from collections.abc import Sequence
from types import SimpleNamespace
from typing import Any, cast


class Named:
    """Channels of these names, without units and ranges."""

    def __init__(self, *names: str) -> None:
        self.name = "named"
        self.channels = cast(Any, [SimpleNamespace(name=n, unit="", range=None) for n in names])
        self.key_columns: Sequence[str] = ()
        self.distance_columns: Sequence[str] = ()
        self.value_columns: Sequence[str] = ()
        self.optional_columns: Sequence[str] = ()
