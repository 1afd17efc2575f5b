"""Joint coordinates under a calibration: what its sensors say, each by itself."""

from __future__ import annotations

import math
from collections.abc import Collection, Mapping
from typing import Any

from rsicalib import _core
from rsicalib._core import Mechanism
from rsicalib.arrays import FloatArray
from rsicalib.io.readings import Readings
from rsicalib.results.result import Result
from rsicalib.verbs.export import Noted
from rsicalib.work.applying import as_applied, as_table

SENSORS = ("sensor", "electronics")
"""Classes of terms that act on readings; all others act on what joints carry."""


def coordinates(
    readings: Readings,
    mechanism: Mechanism,
    result: Result | None,
    *,
    own: bool = False,
    without: Collection[str] = (),
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
    without : collection of str
        Terms that are left out.

    Returns
    -------
    ndarray, shape (n, C)
        In rad, or the length unit of a slide.
    """
    applied = as_applied(result, mechanism, own=own)
    kinds = {
        term["id"]: term["class"] for term in _core.terms(mechanism) if term["id"] not in without
    }
    applied["parameters"] = [p for p in applied["parameters"] if kinds.get(p[0][0]) in SENSORS]
    carried = any("chain" in point for point in mechanism.to_dict().get("point", ()))
    table = as_table([readings], mechanism, bare=carried)
    return _core.joint_coordinates(mechanism, applied, table)


def not_told(readings: Readings, mechanism: Mechanism) -> set[str]:
    """Terms for which readings lack something: a time, a temperature, the pose before."""
    bare = _joints(mechanism)
    return {*_core.Session(bare, as_table([readings], bare, bare=True)).lacking()}


def _joints(mechanism: Mechanism) -> Mechanism:
    """The channels of a mechanism, each on a joint of its own."""
    document = mechanism.to_dict()
    turning = _turning(mechanism)
    kind = {True: "revolute", False: "prismatic"}
    joints = [
        {"name": n, "dh": [{"channel": n, "joint": kind[turns]}]} for n, turns in turning.items()
    ]
    points = [{"name": n, "chain": n, "at": [float(t), 0.0, 0.0]} for n, t in turning.items()]
    points.append({"name": "origin", "at": [0.0, 0.0, 0.0]})
    names = [*turning]
    closures = [{"name": n, "kind": "touch", "between": [n, "origin"]} for n in names]
    whole = {"name": document["name"], "length_unit": document["length_unit"]}
    whole |= {"channel": document["channel"], "chain": joints, "point": points, "closure": closures}
    whole |= {key: document[key] for key in ("column", "gravity") if key in document}
    return Mechanism.from_dict(whole).with_terms(mechanism.terms)


def _turning(mechanism: Mechanism) -> dict[str, bool]:
    """Whether each channel is of an angle, by its name: terms of a turn suit no others."""
    units = unit_of(mechanism)
    return {c.name: units[c.name] == "rad" for c in mechanism.channels}


def sensor_terms(mechanism: Mechanism, result: Result) -> set[str]:
    """Terms of a result that a correction of readings holds; a place that was touched is none."""
    kinds = {term["id"]: term["class"] for term in _core.terms(mechanism)}
    return {p.term for p in result.parameters if kinds.get(p.term) in SENSORS}


def without_place(mechanism: Mechanism, result: Result, notes: Collection[Noted] = ()) -> list[str]:
    """Effects that are not of sensors, and that no note names: what a correction leaves out.

    Where the things stand that a session touched is no effect.
    """
    effects = {term["id"] for term in _core.terms(mechanism)} - sensor_terms(mechanism, result)
    said = {(note.term, note.target) for note in notes}
    left = [p for p in result.parameters if p.term in effects]
    return list(dict.fromkeys(p.spec for p in left if (p.term, p.target) not in said))


def factor_of(channel: Mapping[str, Any]) -> float:
    """Factor from a coordinate of a channel, as its file has it, to that of its joint.

    In a file all of a channel that reads degrees is in degrees.
    """
    return math.pi / 180.0 if channel["unit"] == "deg" else 1.0


def unit_of(mechanism: Mechanism) -> dict[str, str]:
    """Unit of each channel's coordinate: `rad`, or the length unit where its joint slides.

    A channel of no joint has its own, or that of the channels which closures make equal to it;
    degrees are kept in radians.
    """
    names = [channel.name for channel in mechanism.channels]
    units = _core.units_of(mechanism, [(("offset", name, None), "offset") for name in names])
    return {name: own for name, (own,) in zip(names, units, strict=True)}
