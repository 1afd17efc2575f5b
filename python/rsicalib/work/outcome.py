"""What the core does not know of a result: which readings it is about, what changed since."""

from __future__ import annotations

import contextlib
import datetime
import hashlib
from collections.abc import Sequence
from dataclasses import replace
from typing import Any, TypeAlias

import numpy as np

from rsicalib import _core
from rsicalib._core import Mechanism
from rsicalib.errors import InputError, InputTypeError
from rsicalib.facts.records import plain
from rsicalib.facts.shapes import Before, Between, Data, Moved, Parameter, Skipped
from rsicalib.io.readings import Readings
from rsicalib.plain_text import quoted
from rsicalib.results.result import Result
from rsicalib.work.applying import deviations_of

DateArg: TypeAlias = str | datetime.date | np.datetime64

NOTHING: dict[str, Any] = {"chi2": None, "dof": None, "p_value": None, "rms_misclosure": None}
"""A fit of which nothing is known but its error on known poses."""


def about(device: str | None, note: str | None, date: DateArg | None) -> dict[str, str | None]:
    """What the user says of a session, by the keys of the result."""
    return {"device": device, "note": note, "valid_from": None if date is None else _iso(date)}


def _iso(date: DateArg) -> str:
    """A date, or a date and a time, as ISO 8601 has it."""
    if isinstance(date, np.datetime64) and not np.isnat(date):
        unit = "D" if np.datetime_data(date)[0] == "D" else "us"  # of others Python has no date
        return str(date.astype(f"datetime64[{unit}]").item().isoformat())
    if isinstance(date, datetime.date):
        return date.isoformat()
    expected = "an ISO 8601 date such as 2025-03-01 or 2025-03-01T14:30"
    if not isinstance(date, str):
        raise InputTypeError(f"date: found {quoted(date)}, expected {expected}")
    for kind in (datetime.date, datetime.datetime):
        with contextlib.suppress(ValueError):
            return kind.fromisoformat(date).isoformat()
    raise InputError(f"date: found {quoted(date)}, expected {expected}")


def described(readings: Sequence[Readings]) -> Data:
    """Where the data are from, and their digest."""
    digest = readings[0].sha256
    if len(readings) > 1:
        digest = hashlib.sha256("".join(r.sha256 for r in readings).encode()).hexdigest()
    skipped = [
        Skipped(file=r.source, line=s.line, column=s.column, reason=s.reason)
        for r in readings
        for s in r.skipped
    ]
    return Data(
        poses=sum(r.n_poses for r in readings),
        samples=sum(len(r) for r in readings),
        sha256=digest,
        files=tuple(r.source for r in readings if len(readings) > 1 or not r.in_memory),
        skipped=tuple(skipped),
    )


def reference_of(readings: Sequence[Readings]) -> dict[str, Any]:
    """Centre and span of the readings, to which the parameters of a result refer."""
    values = np.concatenate([r.values for r in readings])
    return {
        "centre": plain(values.mean(axis=0)),
        "span": plain(np.column_stack([values.min(axis=0), values.max(axis=0)])),
        "temperature": None,
    }


def labels_of(mechanism: Mechanism) -> dict[str, str]:
    """What people call channels and links, by target."""
    labels = {c.name: c.label for c in mechanism.channels if c.label}
    for chain in mechanism.to_dict().get("chain", []):
        for row, link in enumerate(chain["dh"], start=1):
            if link.get("name"):
                labels[f"{chain['name']}/{row}"] = link["name"]
    return labels


def digest_of(calibration: Any, earlier: Result) -> str:
    """SHA-256 of an earlier result: of its file, or of what `save` would write."""
    if isinstance(calibration, Result):
        return hashlib.sha256(earlier.to_json().encode()).hexdigest()
    with open(calibration, "rb") as file:
        return hashlib.sha256(file.read()).hexdigest()


def beside_earlier(
    mechanism: Mechanism,
    earlier: Result,
    parameters: Sequence[Parameter],
    between: Between | None,
) -> tuple[list[Parameter], list[Moved]]:
    """Parameters with what an earlier result says of them, and those that have moved.

    Chance alone would move any of them once in 100 results. `between` is what changes from group to
    group of the new result.
    """
    known = zip(earlier.parameters, deviations_of(earlier, beside=between), strict=True)
    before = [(p.at, p.name, p.value, sd) for p, sd in known]
    now = [(p.at, p.name, p.value, p.sd_between or p.sd) for p in parameters]
    out, moved = list(parameters), []
    for number, old, new, sd, beyond in _core.compared(mechanism, before, now):
        p = parameters[number]
        out[number] = replace(p, earlier=Before(old, sd))
        if beyond:
            moved.append(Moved(p.term, p.target, p.name, before=old, after=new, sd=sd, unit=p.unit))
    return out, moved
