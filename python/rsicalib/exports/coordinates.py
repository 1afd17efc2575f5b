"""Joint coordinates under a calibration: what its sensors say, each by itself.

The core composes electronics and sensors; here every channel gets a slide of its own, so that the
point that it carries is where the coordinate is.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from rsicalib import _core
from rsicalib._core import Mechanism
from rsicalib.arrays import FloatArray
from rsicalib.io.readings import Readings
from rsicalib.results.result import Result
from rsicalib.work.applying import as_applied, as_table

__all__ = ["coordinates", "unit_of", "without_place"]

SENSORS = ("sensor", "electronics")
"""Classes of terms that act on readings; all others act on what joints carry."""


def coordinates(
    readings: Readings, mechanism: Mechanism, result: Result | None, *, own: bool = False
) -> FloatArray:
    """Find the coordinate of each channel's joint, shape (n, C).

    Parameters
    ----------
    readings : Readings
        `n` samples.
    mechanism : Mechanism
        Mechanism that they are from.
    result : Result or None
        A calibration; None: as declared.
    own : bool
        Whether these are the readings of the result's own session.

    Returns
    -------
    ndarray, shape (n, C)
        In rad, or the length unit of a slide.
    """
    document = mechanism.to_dict()
    names = [channel["name"] for channel in document["channel"]]
    slides = [{"name": n, "dh": [{"channel": n, "joint": "prismatic"}]} for n in names]
    points = [{"name": n, "chain": n, "at": [0.0, 0.0, 0.0]} for n in names]
    points.append({"name": "origin", "at": [0.0, 0.0, 0.0]})
    closures = [{"name": n, "kind": "touch", "between": [n, "origin"]} for n in names]
    whole = {"name": document["name"], "length_unit": document["length_unit"]}
    whole |= {"channel": document["channel"], "chain": slides, "point": points, "closure": closures}
    bare = Mechanism.from_dict(whole).with_terms(mechanism.terms)
    applied = as_applied(result, mechanism, own=own)
    kinds = {term["id"]: term["class"] for term in _core.terms(mechanism)}
    applied["parameters"] = [p for p in applied["parameters"] if kinds.get(p[0][0]) in SENSORS]
    _, values, _, _ = _core.places(bare, applied, as_table([readings], bare, bare=True), None)
    found: FloatArray = np.ascontiguousarray(values.reshape(len(readings), -1, 3)[:, :, 2])
    return found


def without_place(mechanism: Mechanism, result: Result) -> list[str]:
    """Effects that are not of sensors: what a correction of readings leaves out.

    Where the things stand that a session touched is no effect.
    """
    kinds = {term["id"]: term["class"] for term in _core.terms(mechanism)}
    left = [p.spec for p in result.parameters if kinds.get(p.term, SENSORS[0]) not in SENSORS]
    return list(dict.fromkeys(left))


def unit_of(mechanism: Mechanism) -> dict[str, str]:
    """Unit of each channel's coordinate: `rad`, or the length unit where its joint slides."""
    document: dict[str, Any] = mechanism.to_dict()
    rows = [row for chain in document.get("chain", []) for row in chain.get("dh", [])]
    slides = {row.get("channel") for row in rows if row.get("joint") == "prismatic"}
    on = {row.get("channel") for row in rows}
    length = str(document["length_unit"])
    return {
        c.name: length if c.name in slides else "rad" if c.name in on else c.unit
        for c in mechanism.channels
    }
