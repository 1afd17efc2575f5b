"""What the core does not know of a result: which readings it is about, what changed since."""

from __future__ import annotations

import hashlib
import math
from collections.abc import Sequence
from statistics import NormalDist
from typing import Any

import numpy as np

from rsicalib.io.readings import Readings
from rsicalib.records import plain
from rsicalib.results import Result
from rsicalib.shapes import Data, Moved, Parameter, Skipped
from rsicalib.verdicts import ALPHA

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
    before = {(p.spec, p.name): p for p in earlier.parameters}
    pairs = [(before[p.spec, p.name], p) for p in parameters if (p.spec, p.name) in before]
    limit = NormalDist().inv_cdf(1.0 - ALPHA / (2 * max(len(pairs), 1)))
    moved = []
    for old, new in pairs:
        if old.value is None or new.value is None:
            continue
        sd = float(np.hypot(_sd(old), _sd(new)))
        if abs(new.value - old.value) > limit * sd:
            same = (new.term, new.target, new.name)
            moved.append(Moved(*same, before=old.value, after=new.value, sd=sd, unit=new.unit))
    return moved


def _sd(parameter: Parameter) -> float:
    return math.inf if parameter.sd is None else parameter.sd
