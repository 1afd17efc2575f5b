"""Files that are there whole, or not at all."""

from __future__ import annotations

import contextlib
import os
import secrets
import stat
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import TextIO

from rsicalib.errors import InputError
from rsicalib.plain_text import quoted

try:
    import fcntl
except ImportError:  # Windows
    fcntl = None  # type: ignore[assignment]

_parts: set[Path] = set()
_begins = threading.Lock()
"""Held by whoever begins a file, and by whoever leaves the process."""


@contextmanager
def whole_file(path: str | os.PathLike[str], shared: bool = False) -> Iterator[TextIO]:
    """Open a text file that takes its place when everything is written.

    The text goes to a file beside `path`, which is then moved to `path`. If the writer fails,
    what stood at `path` before is still there. A link stays one, to the new file; a device or a
    pipe is written to, and never replaced.

    Parameters
    ----------
    path : path
        Place of the file; what stands there is replaced.
    shared : bool
        Another process, also of another machine, may write the same file at the same time, and
        the folder may hold many files.

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
    if not path.name:
        raise InputError(f"found {quoted(str(path))}, expected the name of a file")
    with _writing(path):
        if _is_taken(path):
            with _opened(path) as file:
                yield file
        else:
            with _replacing(Path(os.path.realpath(path)), shared) as file:
                yield file


@contextmanager
def _writing(path: Path) -> Iterator[None]:
    """Refuse a place where one cannot write."""
    try:
        yield
    except OSError as error:
        found = f"'{path}', where one cannot write ({error.strerror})"
        raise InputError(f"found {found}, expected a place for a file") from None


def _is_taken(path: Path) -> bool:
    """Whether something stands there that no file can replace: a device, a pipe, a folder."""
    return path.exists() and not path.is_file()


@contextmanager
def _replacing(path: Path, shared: bool) -> Iterator[TextIO]:
    """Open a file beside `path` that takes its place, and its permissions, in the end."""
    if not shared:
        _remove_left(path.parent)
    own = f".{secrets.token_hex(4)}" if shared else ""
    part = path.with_name(f".{path.name}{own}.{os.getpid()}.part")
    try:
        with _begun(part) as file:
            _lock(file.fileno())
            with contextlib.suppress(FileNotFoundError):
                part.chmod(stat.S_IMODE(path.stat().st_mode))
            yield file
        part.replace(path)
    finally:
        with contextlib.suppress(OSError):  # of a name that is too long there is no part
            part.unlink(missing_ok=True)
        _parts.discard(part)


def _begun(part: Path) -> TextIO:
    """Open a file that is to be removed if the process leaves; wait while it leaves."""
    with _begins:
        _parts.add(part)
        return _opened(part)


def _opened(path: Path) -> TextIO:
    """Open a text file; bytes of a name that are no text are written out."""
    return path.open("w", encoding="utf-8", errors="backslashreplace", newline="")


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


@contextmanager
def without_parts() -> Iterator[None]:
    """Remove what is half written, and let no thread begin a file in the meantime.

    A process that leaves at once leaves within it.
    """
    with _begins:
        for part in list(_parts):
            with contextlib.suppress(OSError):
                part.unlink(missing_ok=True)
        yield
