"""Libraries of formats, which are optional: imported where a file needs one."""

from __future__ import annotations

import importlib
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any

from rsicalib.errors import InputError

__all__ = ["EXTRAS", "needed", "read_by"]

EXTRAS = {"h5py": "hdf5", "pyarrow": "parquet", "rosbags": "ros"}
"""The extra of the package that brings a library."""


def needed(module: str, source: str, what: str) -> Any:
    """Import a library that a file needs.

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
    try:
        return importlib.import_module(module)
    except ImportError:
        name = module.split(".")[0]
        hint = f"Install it with: pip install 'rsicalib[{EXTRAS[name]}]'"
        found = f"{what}, and no {name} to read it"
        raise InputError.at(source, found=found, expected=name, hint=hint) from None


@contextmanager
def read_by(library: str, source: str, expected: str) -> Iterator[None]:
    """Refuse a file at which a library fails: of damaged bytes it may raise whatever it likes.

    Parameters
    ----------
    library : str
        That reads the file.
    source, expected : str
        The file, and what it should be, for the message.

    Raises
    ------
    InputError
        In place of what the library raised.
    """
    try:
        yield
    except (InputError, MemoryError):
        raise
    except Exception as error:
        lines = str(error).splitlines() or [type(error).__name__]
        found = f"what {library} cannot read ({lines[0][:200]})"
        raise InputError.at(source, found=found, expected=expected) from error
