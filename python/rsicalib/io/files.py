"""Files that are there whole, or not at all."""

from __future__ import annotations

import os
from pathlib import Path

from rsicalib.errors import InputError

__all__ = ["forget_parts", "write_text"]

_parts: set[Path] = set()


def write_text(path: str | os.PathLike[str], text: str) -> Path:
    """Write a file beside its place and move it there.

    Parameters
    ----------
    path : path
        Where to; what stands there is replaced.
    text : str
        Its content, written as UTF-8.

    Returns
    -------
    Path
        The path.

    Raises
    ------
    InputError
        It cannot be written there.
    """
    path = Path(path)
    part = path.with_name(f".{path.name}.{os.getpid()}.part")
    _parts.add(part)
    try:
        part.write_text(text, encoding="utf-8")
        part.replace(path)
    except OSError as error:
        found = f"'{path}', where one cannot write ({error.strerror})"
        raise InputError(f"found {found}, expected a place for a file") from None
    finally:
        part.unlink(missing_ok=True)
        _parts.discard(part)
    return path


def forget_parts() -> None:
    """Remove what an interrupted write has left."""
    for part in list(_parts):
        part.unlink(missing_ok=True)
