"""What the core does not know of a result: which readings it is about, what changed since."""

from __future__ import annotations

import hashlib
from collections.abc import Sequence
from typing import Any

import numpy as np

from rsicalib import _core
from rsicalib.io.readings import Readings
from rsicalib.records import plain
from rsicalib.results import Result
from rsicalib.shapes import Data, Moved, Parameter, Skipped

__all__ = ["NOTHING", "described", "moved_parameters", "reference_of"]

NOTHING: dict[str, Any] = {"chi2": None, "dof": None, "p_value": None, "rms_misclosure": None}
"""A fit of which nothing is known but its error on known poses."""


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
        files=tuple(r.source for r in readings) if len(readings) > 1 else (),
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


def moved_parameters(earlier: Result, parameters: Sequence[Parameter]) -> list[Moved]:
    """Parameters that differ by more than chance would make one of them differ once in 100."""
    before, now = (
        [(p.at, p.name, p.value, p.sd) for p in of] for of in (earlier.parameters, parameters)
    )
    moved = []
    for number, old, new, sd in _core.moved(before, now):
        p = parameters[number]
        moved.append(Moved(p.term, p.target, p.name, before=old, after=new, sd=sd, unit=p.unit))
    return moved
