"""Files that are there whole, or not at all."""

from __future__ import annotations

import os
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import TextIO

from rsicalib.errors import InputError

__all__ = ["forget_parts", "whole_file", "write_bytes", "write_text"]

_parts: set[Path] = set()


@contextmanager
def whole_file(path: str | os.PathLike[str]) -> Iterator[TextIO]:
    """Open a text file that takes its place when everything is written.

    The text goes to a file beside `path`, which is then moved to `path`. If the writer fails,
    what stood at `path` before is still there.

    Parameters
    ----------
    path : path
        Place of the file; what stands there is replaced.

    Yields
    ------
    TextIO
        File in UTF-8; line ends are written as they are given.

    Raises
    ------
    InputError
        The file cannot be written there.
    """
    path = Path(path)
    part = path.with_name(f".{path.name}.{os.getpid()}.part")
    _parts.add(part)
    try:
        with part.open("w", encoding="utf-8", newline="") as file:
            yield file
        part.replace(path)
    except OSError as error:
        found = f"'{path}', where one cannot write ({error.strerror})"
        raise InputError(f"found {found}, expected a place for a file") from None
    finally:
        part.unlink(missing_ok=True)
        _parts.discard(part)


def write_text(path: str | os.PathLike[str], text: str) -> Path:
    """Write a text file, whole or not at all.

    Parameters
    ----------
    path : path
        Place of the file; what stands there is replaced.
    text : str
        Content of the file, written as UTF-8.

    Returns
    -------
    Path
        The path.

    Raises
    ------
    InputError
        The file cannot be written there.
    """
    with whole_file(path) as file:
        file.write(text)
    return Path(path)


def write_bytes(path: str | os.PathLike[str], data: bytes) -> Path:
    """Write a file of bytes, whole or not at all; see `write_text`."""
    with whole_file(path) as file:
        file.buffer.write(data)
    return Path(path)


def forget_parts() -> None:
    """Remove what an interrupted write has left."""
    for part in list(_parts):
        part.unlink(missing_ok=True)
