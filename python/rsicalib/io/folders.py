"""Folders of results: nothing of the user's is lost, and what is there is whole.

A file is replaced only if it was written by this package: a result says so by its `format`, a plan
by its column `why`, other files by a line, and those of a simulation, an import or an export by
their digest in `truth.json`, `import.json` or `export.json`. One file, the seal, is removed first
and written last: a folder that has its seal is whole.
"""

from __future__ import annotations

import hashlib
import json
import os
import re
from collections.abc import Iterable, Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path
from typing import ClassVar

from rsicalib.errors import InputError
from rsicalib.io.files import write_bytes, write_text

MARK = "Written by rsicalib"
"""A line with these words marks a text file that may be replaced."""

OF_LOG = "mechanism.toml"
"""The mechanism that the log of another program brought along."""

OURS = re.compile(rb'"format":\s*"rsicalib\.|\A[^\n]*,why\r?\n|' + MARK.encode())
ENDS = 4096
"""The mark stands within so many bytes of one end of a file."""

TRUTH = "truth.json"
"""The seal of a simulated session, with the digest of each of its files."""

IMPORT = "import.json"
"""The seal of a log that was imported, likewise."""

EXPORT = "export.json"
"""The seal of a result that was written for others, likewise."""


class Sealed:
    """Files of one folder; the last of them, `SEAL`, says that all are there."""

    SEAL: ClassVar[str]

    def files(self) -> Mapping[str, str | bytes]:
        """Content of each file, by its name."""
        raise NotImplementedError

    def save(self, folder: str | os.PathLike[str], *, force: bool = False) -> list[Path]:
        """Write the files into a folder.

        Parameters
        ----------
        folder : path
            Made if it is not there.
        force : bool
            Replace files that this package did not write as well.

        Returns
        -------
        list of Path
            The files.

        Raises
        ------
        InputError
            One cannot write there, or a file that is there was not written by this package.
        """
        return write_folder(folder, self.files(), seal=self.SEAL, force=force)


def write_folder(
    folder: str | os.PathLike[str],
    files: Mapping[str, str | bytes],
    *,
    seal: str | None = None,
    force: bool = False,
) -> list[Path]:
    """Write files into a folder, which is made if it is not there.

    Parameters
    ----------
    folder : path
        Where to.
    files : mapping of str to str or bytes
        Content of each file, by its name, which may stand in a folder below (`figures/a.svg`).
    seal : str, optional
        Name of the file that is removed first and written last.
    force : bool
        Replace files that this package did not write as well.

    Returns
    -------
    list of Path
        The files, in the order of `files`.

    Raises
    ------
    InputError
        One cannot write there, another process is writing there, or a file that is there was
        not written by this package. No file is changed then, save where the disk is full.
    """
    if not os.fspath(folder):
        raise InputError("found no name, expected that of a folder")
    folder = Path(folder)
    _make(folder)
    with _locked(folder):
        refuse_foreign(folder, files, force=force)
        order = sorted(files, key=lambda name: name == seal)  # stable: only the seal moves
        if seal is not None:
            _remove(folder / seal)
        for name in order:
            _make((folder / name).parent)
            content = files[name]
            if isinstance(content, str):
                write_text(folder / name, content)
            else:
                write_bytes(folder / name, content)
    return [folder / name for name in files]


def refuse_foreign(
    folder: str | os.PathLike[str], names: Iterable[str], *, force: bool = False
) -> None:
    """Refuse names of files that are there and that this package did not write.

    Raises
    ------
    InputError
        With the first such file, and what to do.
    """
    folder = Path(folder)
    for name in () if force else names:
        path = folder / name
        if path.is_dir():
            raise InputError.at(str(path), "a directory", "the name of a file")
        if os.path.exists(path) and not _is_ours(path):
            found = "a file that rsicalib did not write"
            hint = "Choose another folder, or replace the file with --force (force=True)."
            raise InputError.at(str(path), found, "no file", hint=hint)


def _is_ours(path: Path) -> bool:
    try:
        with path.open("rb") as file:
            head = file.read(ENDS)
            file.seek(max(0, path.stat().st_size - ENDS))
            ours = OURS.search(head) or OURS.search(file.read(ENDS))
            return bool(ours) or any(_is_sealed(path, seal) for seal in (TRUTH, IMPORT, EXPORT))
    except OSError:
        return False


def _is_sealed(path: Path, seal: str) -> bool:
    """Whether a seal beside a file has the file's digest."""
    try:
        digests = json.loads((path.parent / seal).read_bytes())["files"]
        return bool(digests[path.name] == hashlib.sha256(path.read_bytes()).hexdigest())
    except (OSError, ValueError, KeyError, TypeError, RecursionError):
        return False


def _make(folder: Path) -> None:
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except (OSError, ValueError) as error:  # a NUL is no OSError
        reason = getattr(error, "strerror", None) or error
        found = f"'{folder}', which cannot be a folder ({reason})"
        raise InputError(f"found {found}, expected a place for files") from None


def _remove(path: Path) -> None:
    try:
        Path(os.path.realpath(path)).unlink(missing_ok=True)
    except OSError as error:
        found = f"'{path}', where one cannot write ({error.strerror})"
        raise InputError(f"found {found}, expected a place for a file") from None


@contextmanager
def _locked(folder: Path) -> Iterator[None]:
    """Keep other processes from writing here meanwhile; a lock ends with its process."""
    try:
        import fcntl
    except ImportError:  # Windows has no locks of folders: each file is still whole
        yield
        return
    at = os.open(folder, os.O_RDONLY)
    try:
        try:
            fcntl.flock(at, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except BlockingIOError:
            found = "another rsicalib that writes there"
            raise InputError.at(str(folder), found, "one at a time") from None
        except OSError:
            pass  # a file system without locks
        yield
    finally:
        os.close(at)
