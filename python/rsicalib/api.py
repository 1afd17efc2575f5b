"""What loads the input of the verbs, and the session that comes with the package.

Options of verbs that default to None mean "as in Rust": a default is written once, there.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any

from rsicalib import _core
from rsicalib._core import Mechanism
from rsicalib.io.frames import TableArg
from rsicalib.io.readings import Readings
from rsicalib.io.readings import load_readings as read_readings
from rsicalib.results.result import Trace
from rsicalib.verbs.tracing import trace
from rsicalib.work.arguments import MechanismArg, PathLike, open_mechanism
from rsicalib.work.listening import ProgressArg

DEMO = Path(__file__).with_name("demo")
"""Folder of the session that comes with the package: readings.csv, rest.csv, check.csv."""


def load_mechanism(source: MechanismArg = "rsi") -> Mechanism:
    """Load a mechanism; `Mechanism(source)` does the same with text, a path or a mapping.

    Parameters
    ----------
    source : str, path, mapping or Mechanism
        The name of a built-in mechanism (`rsi`), the path of a TOML file, TOML text (more than one
        line), or plain values with the keys of the TOML; a mechanism is returned as it is.

    Returns
    -------
    Mechanism
        Channels, chains, points, closures, platform and rest pose.

    Raises
    ------
    InputError
        There is no such mechanism, or what is given contradicts itself.

    Examples
    --------
    >>> load_mechanism("rsi").length_unit
    'in'
    """
    return open_mechanism(source)


def load_readings(
    readings: PathLike | TableArg, mechanism: MechanismArg = "rsi", *, skip_bad_rows: bool = False
) -> Readings:
    """Load readings from a file or from memory: one row per sample, one column per channel.

    Parameters
    ----------
    readings : path, data frame, mapping of str to array_like, or array_like of shape (n, C)
        A file is Parquet if its name ends in `.parquet` or `.pq`, else CSV, also compressed by
        gzip; `-` is standard input. A data frame is one of pandas, polars or pyarrow, or another
        that has `__arrow_c_stream__` or `__dataframe__`.
    mechanism : str, path or Mechanism
        Mechanism whose channels are the columns.
    skip_bad_rows : bool, optional
        Drop rows that cannot be used and list them in `skipped`.

    Returns
    -------
    Readings
        Values exactly as they are given.

    Raises
    ------
    InputError
        The readings cannot be used; the message says where, and what was expected.
    """
    return read_readings(readings, load_mechanism(mechanism), skip_bad_rows=skip_bad_rows)


def terms(mechanism: MechanismArg = "rsi") -> list[dict[str, Any]]:
    """List every term that can be identified.

    Parameters
    ----------
    mechanism : str, path or Mechanism
        Mechanism whose channels, chains and closures are the targets.

    Returns
    -------
    list of dict
        `id`, `class`, `doc`, `needs`, `place`, `parameters` (name, unit, typical size) and
        `targets`.
    """
    return _core.terms(load_mechanism(mechanism))


def demo(*, progress: ProgressArg | None = None) -> Trace:
    """Trace the session that comes with the package, as the command `demo` does.

    Parameters
    ----------
    progress : callable, optional
        As in `calibrate`.

    Returns
    -------
    Trace
        Of `DEMO`.
    """
    readings, rest, check = (DEMO / f"{name}.csv" for name in ("readings", "rest", "check"))
    return trace(readings, rest=rest, check=check, progress=progress)
