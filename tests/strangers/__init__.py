"""Files of strangers' shape, ten for each group, by other writers where a library writes them.

Each module has `FILES`: by name what makes the file, options of `import_log`, and what comes of
it: rows and a column that are read, or a text of the refusal.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

Made = tuple[Callable[[Path], Path], Mapping[str, Any], tuple[int, str] | str]
"""Maker of a file in a folder; options; rows and a column, or the refusal's words."""


def text(name: str, content: str | bytes) -> Callable[[Path], Path]:
    """A maker of a file with this content."""

    def make(folder: Path) -> Path:
        path = folder / name
        path.write_bytes(content.encode() if isinstance(content, str) else content)
        return path

    return make
