"""A calibration as a mechanism: the TOML and the URDF that have its parameters in them.

Every parameter of geometry is a motion inserted somewhere between the rows of a chain; a row is

```text
Rz(theta) · joint(q) · Tz(d) Tx(a) Rx(alpha) · T(xyz) R(rpy)
          ^ slides of the row      ^ its turns, after the translation
```

so that a row with the motion in it is again a row, and no point moves by more than rounding. What a
mechanism file has no words for (a curvature, a compliance) is named, and not put in.
"""

from __future__ import annotations

import os
import tomllib
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from rsicalib._core import Mechanism
from rsicalib.errors import InputError
from rsicalib.io.mechanisms import BUILTIN, mechanism_toml
from rsicalib.io.rigid import Matrix, rigid, rotation, xyz_rpy
from rsicalib.io.urdf import write_urdf
from rsicalib.results import Result
from rsicalib.work.arguments import (
    CalibrationArg,
    MechanismArg,
    PathLike,
    earlier_result,
    open_mechanism,
)

__all__ = ["Calibrated", "calibrated", "calibrated_files", "export_toml", "export_urdf"]

SLIDES = {
    "link_frame": {"x": 0, "y": 1, "z": 2},
    "link_length": {"a": 0},
    "link_offset": {"d": 2},
    "base_position": {"x": 0, "y": 1, "z": 2},
    "point_position": {"x": 0, "y": 1, "z": 2},
}
"""The axis that a parameter of a term slides along."""

TURNS = {
    "link_frame": {"rx": 0, "ry": 1, "rz": 2},
    "joint_tilt": {"alpha": 0, "beta": 1},
    "base_tilt": {"rx": 0, "ry": 1},
    "base_bearing": {"rz": 2},
}
"""The axis that a parameter of a term turns about."""

NOT_OF_THE_DEVICE = ("unknown_point",)
"""Found beside the parameters of the device, and no part of it."""


@dataclass
class _Motion:
    """What is inserted at one place: slides, then turns in the order of the parameters."""

    slide: Any = field(default_factory=lambda: np.zeros(3))
    turn: Matrix = field(default_factory=lambda: np.eye(4))

    def __bool__(self) -> bool:
        return bool(self.slide.any()) or not np.array_equal(self.turn, np.eye(4))


@dataclass(frozen=True)
class Calibrated:
    """A mechanism with the parameters of a calibration in it.

    Attributes
    ----------
    mechanism : dict
        As `Mechanism.to_dict` has it.
    tips : dict of str to list of float
        How far the points of a chain moved in the frame at its end; in `mechanism`
        the points are moved, a URDF moves the frame.
    notes : tuple of str
        What could not be put in.
    """

    mechanism: dict[str, Any]
    tips: dict[str, list[float]]
    notes: tuple[str, ...]


def calibrated(mechanism: MechanismArg, calibration: CalibrationArg) -> Calibrated:
    """Put the parameters of a calibration into its mechanism.

    Parameters
    ----------
    mechanism : str, path or Mechanism
        That was calibrated.
    calibration : path, Calibration or Trace
        The result.

    Returns
    -------
    Calibrated
        Under which readings give the same points.

    Raises
    ------
    InputError
        The result is of another mechanism.
    """
    loaded = open_mechanism(mechanism)
    result = earlier_result(calibration, loaded)
    out = loaded.to_dict()
    notes: list[str] = []
    known = {(p.term, p.target, p.name): p.value for p in result.parameters if p.value is not None}
    _sensors(out, known, result)
    _noise(out, result)
    motions = _motions(known)
    for chain in out["chain"]:
        _chain(chain, motions, notes)
    tips: dict[str, list[float]] = {}
    for (kind, target), motion in motions.items():
        if kind == "point_position":
            tips[target] = [float(v) for v in motion.slide]
            for point in (p for p in out["point"] if p.get("chain") == target):
                point["at"] = [a + d for a, d in zip(point["at"], tips[target], strict=True)]
    _closures(out, known, notes)
    lost = dict.fromkeys(p.spec for p in result.parameters if not _has_place(p.term))
    notes += [f"{spec} has no place in a mechanism: apply it with --calibration" for spec in lost]
    return Calibrated(out, tips, tuple(notes))


def export_toml(mechanism: MechanismArg, calibration: CalibrationArg) -> str:
    """Write the calibrated mechanism as TOML text.

    Parameters
    ----------
    mechanism, calibration
        As for `calibrated`.

    Returns
    -------
    str
        A mechanism file; comments at its head say what could not be put in.
    """
    found = calibrated(mechanism, calibration)
    head = [f"{found.mechanism['name']}, calibrated: offsets, gains and geometry are in here."]
    comments = [f"# {' '.join(line.split())}\n" for line in [*head, *found.notes]]
    return "".join(comments) + mechanism_toml(found.mechanism)


def export_urdf(mechanism: MechanismArg, calibration: CalibrationArg) -> dict[str, str]:
    """Write the robot descriptions that the chains came from, calibrated.

    Offsets are in the origins: readings are joint values, and a mechanism file that
    refers to such a document declares none. A comment at its foot says what it lacks.

    Parameters
    ----------
    mechanism, calibration
        As for `calibrated`.

    Returns
    -------
    dict of str to str
        Name of a file and its text; none for a mechanism that is not from a URDF file.

    Raises
    ------
    InputError
        As for `calibrated`.
    """
    sources = _sources(mechanism)
    if not sources:
        return {}
    found = calibrated(mechanism, calibration)
    chains = {chain["name"]: chain for chain in found.mechanism["chain"]}
    sensors = {channel["name"]: channel for channel in found.mechanism["channel"]}
    texts: dict[Path, str] = {}
    notes: dict[Path, list[str]] = {}
    for path, source in sources:
        rows = list(chains[source["name"]]["dh"])
        rows.append({"xyz": found.tips.get(source["name"], [0.0] * 3)})
        text = texts[path] if path in texts else path.read_bytes().decode("utf-8-sig")
        own = source["channels"].values()
        export = write_urdf(
            text,
            source["base"],
            source["tip"],
            source["channels"],
            rows,
            offsets={name: sensors[name]["offset"] for name in own},
            gains={name: sensors[name]["gain"] for name in own},
        )
        texts[path] = export.text
        notes.setdefault(path, []).extend(export.notes)
        if (export.base, export.tip) != (source["base"], source["tip"]):
            notes[path].append(f'chain "{source["name"]}" is {export.base} to {export.tip}')
    stems = [path.stem for path in texts]
    out = {}
    for path, text in texts.items():
        name = "calibrated.urdf" if len(stems) == 1 else f"calibrated_{path.stem}.urdf"
        lines = [" ".join(n.split()).replace("--", "- -") for n in [*notes[path], *found.notes]]
        foot = "".join(f"<!-- rsicalib: {line} -->\n" for line in lines)
        out[name] = text + ("" if text.endswith("\n") or not foot else "\n") + foot
    return out


def _sources(mechanism: MechanismArg) -> list[tuple[Path, dict[str, Any]]]:
    """Chains that a mechanism file takes from URDF, with the path of the document."""
    if isinstance(mechanism, Mechanism) or os.fspath(mechanism) in BUILTIN:
        return []
    file = Path(mechanism)
    document = tomllib.loads(file.read_bytes().decode("utf-8-sig"))
    return [(file.parent / c["urdf"], c) for c in document["chain"] if "urdf" in c]


def _has_place(term: str) -> bool:
    own = {"offset", "gain", "distance", *NOT_OF_THE_DEVICE}
    return term in own or term in SLIDES or term in TURNS


def _sensors(
    out: dict[str, Any], known: Mapping[tuple[str, str, str], float], result: Result
) -> None:
    """Gains and offsets; a gain alone turns the line about the mean reading."""
    for c, channel in enumerate(out["channel"]):
        name = channel["name"]
        gain = known.get(("gain", name, "gain"), channel["gain"])
        offset = known.get(("offset", name, "offset"))
        if offset is None:
            centre = 0.0 if result.reference is None else result.reference.centre[c]
            offset = channel["offset"] + (channel["gain"] - gain) * centre
        channel["gain"], channel["offset"] = gain, offset


def _noise(out: dict[str, Any], result: Result) -> None:
    """Noise, where a platform's pose depends on it and the file would not tell it by itself."""
    if not out.get("platform") or result.noise is None:
        return
    for channel in out["channel"]:
        if channel["unit"] != "count" or result.noise.source == "declared":
            channel["noise"] = result.noise.sigma[channel["name"]]


def _motions(known: Mapping[tuple[str, str, str], float]) -> dict[tuple[str, str], _Motion]:
    """What geometry inserts, by kind of place and target."""
    kinds = {"base_position": "base", "base_bearing": "base", "base_tilt": "root"}
    kinds["point_position"] = "point_position"
    motions: dict[tuple[str, str], _Motion] = {}
    for (term, target, name), value in known.items():
        if term not in SLIDES and term not in TURNS:
            continue
        motion = motions.setdefault((kinds.get(term, "row"), target), _Motion())
        if name in SLIDES.get(term, {}):
            # Slides come first at a row; at the base, in the order of the terms.
            along = np.eye(3)[SLIDES[term][name]] * value
            motion.slide += motion.turn[:3, :3] @ along if term == "base_position" else along
        else:
            motion.turn = motion.turn @ rotation(TURNS[term][name], value)
    return motions


def _chain(
    chain: dict[str, Any], motions: Mapping[tuple[str, str], _Motion], notes: list[str]
) -> None:
    """The rows of a chain with the motions in them."""
    name, rows = chain["name"], [dict(row) for row in chain["dh"]]
    new = []
    for number, row in enumerate(rows, start=1):
        motion = motions.get(("row", f"{name}/{number}"))
        new.append(_moved(row, motion.slide, motion.turn) if motion else row)
    base = motions.get(("base", name), _Motion())
    root = motions.get(("root", name), _Motion())
    first = next((i for i, row in enumerate(rows) if row.get("channel")), len(rows))
    if (base or root) and first == 0:
        xyz, rpy = xyz_rpy(_placed(base) @ root.turn)
        new.insert(0, {"xyz": xyz, "rpy": rpy})
        notes.append(f"chain {name}: row 1 is new and carries the place of its base")
    elif base or root:
        new[0] = _preceded(new[0], base)
        if root:
            new[first - 1] = _followed(new[first - 1], root.turn)
    chain["dh"] = new


def _body(row: Mapping[str, Any]) -> Matrix:
    zero = (0.0, 0.0, 0.0)
    dh = rigid((row.get("a", 0.0), 0.0, row.get("d", 0.0)), (row.get("alpha", 0.0), 0.0, 0.0))
    return dh @ rigid(row.get("xyz", zero), row.get("rpy", zero))


def _moved(row: Mapping[str, Any], slide: Any, turn: Matrix) -> dict[str, Any]:
    """A row with a slide before its body and a turn after the body's translation."""
    still = np.array_equal(turn, np.eye(4))
    if still and slide[1] == 0.0:  # still a row of Denavit and Hartenberg
        along = {"a": row.get("a", 0.0) + float(slide[0]), "d": row.get("d", 0.0) + float(slide[2])}
        changed = {key: value for key, value in along.items() if value != row.get(key, 0.0)}
        return {**row, **changed}
    body = _body(row)
    translation = body[:3, 3] + slide
    body[:3, 3] = 0.0
    body = turn @ body
    body[:3, 3] = translation
    return _with_body(row, body)


def _placed(motion: _Motion) -> Matrix:
    return rigid(motion.slide, (0.0, 0.0, 0.0)) @ motion.turn


def _preceded(row: Mapping[str, Any], motion: _Motion) -> dict[str, Any]:
    """A fixed row with a motion before it."""
    back, there = (rotation(2, sign * row.get("theta", 0.0)) for sign in (-1.0, 1.0))
    inside = back @ _placed(motion) @ there
    if np.array_equal(motion.turn, np.eye(4)):
        return _moved(row, inside[:3, 3], np.eye(4))
    return _with_body(row, inside @ _body(row))


def _followed(row: Mapping[str, Any], turn: Matrix) -> dict[str, Any]:
    """A row with a turn after its body."""
    return _with_body(row, _body(row) @ turn)


def _with_body(row: Mapping[str, Any], body: Matrix) -> dict[str, Any]:
    kept = {key: value for key, value in row.items() if key not in ("d", "a", "alpha")}
    xyz, rpy = xyz_rpy(body)
    return {**kept, "xyz": xyz, "rpy": rpy}


def _closures(
    out: dict[str, Any], known: Mapping[tuple[str, str, str], float], notes: list[str]
) -> None:
    for closure in out["closure"]:
        more = known.get(("distance", closure["name"], "d"))
        if more is None:
            continue
        if isinstance(closure["value"], str):
            notes.append(f"distance@{closure['name']}: add {more!r} to column {closure['value']!r}")
        else:
            closure["value"] += more


def calibrated_files(
    folder: PathLike, mechanism: MechanismArg, result: Result
) -> Sequence[tuple[Path, str]]:
    """Say what stands in `calibrated.toml` and, where the chain came from one, in the URDF.

    Parameters
    ----------
    folder : path
        Where they are to stand.
    mechanism, result
        As for `calibrated`.

    Returns
    -------
    sequence of (path, text)
        To be written; none where nothing was determined.
    """
    if not any(p.value is not None for p in result.parameters):
        return []
    files = {"calibrated.toml": export_toml(mechanism, result)}
    try:
        files |= export_urdf(mechanism, result)
    except InputError as error:  # a description that cannot take the correction
        files["calibrated.toml"] = f"# no URDF: {error.message}\n{files['calibrated.toml']}"
    return [(Path(folder) / name, text) for name, text in files.items()]
