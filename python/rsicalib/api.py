"""The verbs as functions with the names of the commands, and what loads their input.

Options that default to None mean "as in Rust": a default is written once, there.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any

from rsicalib import _core
from rsicalib._core import Mechanism
from rsicalib.calibration import calibrate
from rsicalib.io.readings import Readings
from rsicalib.io.readings import load_readings as read_readings
from rsicalib.kinematics import forward, forward_sd, inverse
from rsicalib.open_loop import fixture
from rsicalib.results import Trace
from rsicalib.tracing import trace
from rsicalib.work.arguments import MechanismArg, PathLike, open_mechanism

__all__ = [
    "DEMO",
    "calibrate",
    "demo",
    "fixture",
    "forward",
    "forward_sd",
    "inverse",
    "load_mechanism",
    "load_readings",
    "terms",
    "trace",
]

DEMO = Path(__file__).with_name("demo")
"""Folder of the session that comes with the package: readings.csv, rest.csv, check.csv."""


def load_mechanism(name_or_path: MechanismArg = "rsi") -> Mechanism:
    """Load a mechanism: a built-in one by its name, or a TOML file.

    Parameters
    ----------
    name_or_path : str, path or Mechanism
        `rsi`, or the path of a mechanism file; a mechanism is returned as it is.

    Returns
    -------
    Mechanism
        Channels, chains, points, closures, platform and rest pose.

    Raises
    ------
    InputError
        There is no such mechanism, or the file contradicts itself.

    Examples
    --------
    >>> load_mechanism("rsi").length_unit
    'in'
    """
    return open_mechanism(name_or_path)


def load_readings(
    path: PathLike, mechanism: MechanismArg = "rsi", *, skip_bad_rows: bool = False
) -> Readings:
    """Load a file of readings: one row per sample, one column per channel.

    Parameters
    ----------
    path : path
        CSV, or Parquet if it ends in `.parquet` or `.pq`.
    mechanism : str, path or Mechanism
        Mechanism whose channels are the columns.
    skip_bad_rows : bool, optional
        Drop rows that cannot be used and list them in `skipped`.

    Returns
    -------
    Readings
        Values exactly as they stand in the file.

    Raises
    ------
    InputError
        The file cannot be used; the message says where, and what was expected.
    """
    return read_readings(path, load_mechanism(mechanism), skip_bad_rows=skip_bad_rows)


def terms(mechanism: MechanismArg = "rsi") -> list[dict[str, Any]]:
    """List every term that can be identified.

    Parameters
    ----------
    mechanism : str, path or Mechanism
        Mechanism whose channels, chains and closures are the targets.

    Returns
    -------
    list of dict
        `id`, `class`, `doc`, `needs`, `parameters` (name, unit, typical size) and `targets`.
    """
    found: list[dict[str, Any]] = _core.terms(load_mechanism(mechanism))
    return found


def demo() -> Trace:
    """Trace the session that comes with the package, as the command `demo` does.

    Returns
    -------
    Trace
        Of `DEMO`.
    """
    return trace(DEMO / "readings.csv", rest=DEMO / "rest.csv", check=DEMO / "check.csv")
