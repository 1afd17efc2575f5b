"""Files that are there whole, or not at all."""

from __future__ import annotations

import contextlib
import os
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import TextIO

from rsicalib.errors import InputError

try:
    import fcntl
except ImportError:  # Windows
    fcntl = None  # type: ignore[assignment]

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
    _remove_left(path.parent)
    part = path.with_name(f".{path.name}.{os.getpid()}.part")
    _parts.add(part)
    try:
        # A name may have bytes that are no text: they are written out.
        with part.open("w", encoding="utf-8", errors="backslashreplace", newline="") as file:
            _lock(file.fileno())
            yield file
        part.replace(path)
    except OSError as error:
        found = f"'{path}', where one cannot write ({error.strerror})"
        raise InputError(f"found {found}, expected a place for a file") from None
    finally:
        with contextlib.suppress(OSError):  # of a name that is too long there is no part
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


def _lock(descriptor: int) -> bool:
    """Mark a file as being written, until its process ends; False where another one writes it."""
    if fcntl is None:  # Windows: nobody removes a file there that is open
        return True
    try:
        fcntl.flock(descriptor, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except BlockingIOError:
        return False
    except OSError:  # a file system without locks
        return True
    return True


def _remove_left(folder: Path) -> None:
    """Remove parts of processes that were killed: no process holds them any more."""
    with contextlib.suppress(OSError):
        for part in folder.glob(".*.*.part"):
            with contextlib.suppress(OSError):
                if part not in _parts and part.is_file() and _is_left(part):
                    part.unlink()


def _is_left(part: Path) -> bool:
    """Whether no process writes a part: none of its number here, and none elsewhere locks it."""
    number = part.name.split(".")[-2]
    if fcntl is not None and number.isdecimal() and Path(f"/proc/{number}").exists():
        return False
    with part.open("rb") as file:
        return _lock(file.fileno())


def forget_parts() -> None:
    """Remove what an interrupted write has left."""
    for part in list(_parts):
        part.unlink(missing_ok=True)
