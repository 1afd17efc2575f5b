"""Libraries of formats, which are optional: imported where a file needs one."""

from __future__ import annotations

import importlib
import os
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from typing import Any

from rsicalib.errors import InputError
from rsicalib.io.sources import largest_file
from rsicalib.plain_text import installed_by

EXTRAS = {"h5py": "hdf5", "pyarrow": "parquet", "rosbags": "ros", "mcap": "ros"}
"""The extra of the package that brings a library."""


UNPACK = "unpack it first."
AS_CSV = "save it as CSV, a column for each channel under its name."
STANDS_FOR = {
    b"version https://git-lfs.": "It is a pointer of Git LFS: fetch the file with git lfs pull.",
    b"\x1f\x8b": f"It is packed (gzip): {UNPACK}",
    b"PK\x03\x04": f"It is packed (zip): {UNPACK} A spreadsheet or a .npz is a zip too: {AS_CSV}",
    b"BZh": f"It is packed (bzip2): {UNPACK}",
    b"\xfd7zXZ": f"It is packed (xz): {UNPACK}",
    b"\x28\xb5\x2f\xfd": f"It is packed (zstd): {UNPACK}",
    b"7z\xbc\xaf": f"It is packed (7z): {UNPACK}",
    b"\x93NUMPY": f"It is an array of NumPy, without names: {AS_CSV}",
    b"{": f"It is JSON, but no joint states, which have lists `name` and `position`: {AS_CSV}",
    b"MATLAB": f"It is of MATLAB: {AS_CSV}",
}
"""What to do with files that begin so: they hold another file, or no names."""


def wrapped(source: str) -> str:
    """What to do with a file that only stands for another; nothing for all others."""
    try:
        with open(source, "rb") as file:
            head = file.read(64)
    except OSError:
        return ""
    return next((text for magic, text in STANDS_FOR.items() if head.startswith(magic)), "")


def needed(module: str, source: str, what: str) -> Any:
    """Import a library that a file needs, to be read or written.

    Parameters
    ----------
    module : str
        What is imported.
    source, what : str
        The file, and what it is in words, for the message.

    Returns
    -------
    module
        By name: its typing differs between versions.

    Raises
    ------
    InputError
        It is not installed; the message says how to install it.
    """
    name = module.split(".")[0]
    if name == "pyarrow":
        # It imports pandas where it first needs it, and would lose a Ctrl-C meanwhile.
        with suppress(Exception):
            importlib.import_module("pandas")
    try:
        return importlib.import_module(module)
    except ImportError:
        hint = f"Install it with: {installed_by(EXTRAS[name])}"
        found = f"no library {name!r} for {what}"
        raise InputError.at(source, found, "it", hint=hint) from None


def parquet_modules(source: str, what: str = "a Parquet file") -> tuple[Any, Any]:
    """The modules `pyarrow` and `pyarrow.parquet`, as `needed` imports them."""
    return needed("pyarrow", source, what), needed("pyarrow.parquet", source, what)


@contextmanager
def read_by(library: str, source: str, expected: str, hint: str = "") -> Iterator[None]:
    """Refuse a file at which a library fails: of damaged bytes it may raise whatever it likes.

    Parameters
    ----------
    library : str
        That reads the file.
    source, expected, hint : str
        The file, what it should be, and what to do, for the message.

    Raises
    ------
    InputError
        In place of what the library raised.
    """
    try:
        yield
    except InputError:
        raise
    except MemoryError:
        # A damaged length asks for more than there is; a file that is too large does, too.
        if not os.path.isfile(source) or os.path.getsize(source) > largest_file():
            raise
        found = f"a length that no memory holds, where {library} expects one of the file"
        raise InputError.at(source, found, expected, hint=hint) from None
    except Exception as error:
        lines = str(error).splitlines() or [type(error).__name__]
        found = f"what {library} cannot read ({lines[0][:200]})"
        hint = wrapped(source) or hint
        raise InputError.at(source, found, expected, hint=hint) from error
