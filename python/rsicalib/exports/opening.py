"""The one way out: a result in the words of a controller or a robot."""

from __future__ import annotations

import hashlib
import importlib
from typing import Any

from rsicalib import options
from rsicalib._core import __version__
from rsicalib.errors import InputError
from rsicalib.exports.ask import Ask
from rsicalib.exports.kinds import EXPORTS
from rsicalib.facts.records import to_json
from rsicalib.io.folders import EXPORT
from rsicalib.io.readings import Readings
from rsicalib.plain_text import meant
from rsicalib.verbs.export import export_toml, export_urdf
from rsicalib.work.arguments import (
    CalibrationArg,
    MechanismArg,
    ReadingsArg,
    earlier_result,
    load,
    mechanism_beside,
    open_mechanism,
)


@options.checked
def export_result(
    calibration: CalibrationArg,
    to: str,
    mechanism: MechanismArg = "rsi",
    *,
    readings: ReadingsArg | None = None,
    base: str | None = None,
) -> dict[str, str | bytes]:
    """Write a result in the words of a controller or a robot.

    What the receiver has no place for is said in the file, as a comment. Read again, each file
    gives what the calibration gives, to the digits that it is written with.

    Parameters
    ----------
    calibration : path, Calibration or Trace
        A result.
    to : str
        A key of `rsicalib.exports.kinds.EXPORTS`.
    mechanism : str, path, mapping or Mechanism
        That was calibrated.
    readings : path or Readings, optional
        To be corrected, for `csv` and `mcap`.
    base : str, optional
        Path of a file of the receiver that the result is written into.

    Returns
    -------
    dict of str to str or bytes
        Content of each file, by its name.

    Raises
    ------
    InputError
        The mechanism is not of that kind, or something that is needed is missing.
    """
    if to not in EXPORTS:
        raise InputError(
            f"to: found {to!r}{meant(to, EXPORTS)}, expected one of {', '.join(EXPORTS)}"
        )
    mechanism = mechanism_beside(mechanism, calibration)
    result, loaded = earlier_result(calibration, open_mechanism(mechanism))
    if to == "toml":
        return {"calibrated.toml": export_toml(mechanism, result)}
    if to == "urdf":
        files = export_urdf(mechanism, result)
        if not files:
            expected = "a mechanism file with a chain from URDF"
            raise InputError(f"mechanism: found {loaded.name!r} without URDF, expected {expected}")
        return dict(files)
    module, function = EXPORTS[to][1].split(".")
    writer: Any = importlib.import_module(f"rsicalib.exports.{module}")
    taken: Readings | None = None if readings is None else load(readings, loaded, False)
    found: dict[str, str | bytes] = getattr(writer, function)(Ask(result, mechanism, taken, base))
    return found


def sealed(files: dict[str, str | bytes], to: str) -> dict[str, str | bytes]:
    """The files of an export with the one that says what they are."""

    def digest(content: str | bytes) -> str:
        data = content.encode() if isinstance(content, str) else content
        return hashlib.sha256(data).hexdigest()

    head = {"format": "rsicalib.export/1", "version": __version__, "to": to}
    digests = {name: digest(content) for name, content in files.items()}
    return {**files, EXPORT: to_json({**head, "files": digests})}
