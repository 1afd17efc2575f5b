"""Mechanism files: chains given as URDF become rows, and what that leaves out is filled in.

The core takes the expanded mechanism and checks it; here is only what needs files.
"""

from __future__ import annotations

import math
import os
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from rsicalib._core import Mechanism
from rsicalib.errors import InputError, Where
from rsicalib.io.builtin import BUILTIN
from rsicalib.io.cells import COLUMNS, POSE
from rsicalib.io.foreign import refuse_foreign
from rsicalib.io.mjcf import is_mjcf, mechanism_of_mjcf
from rsicalib.io.sources import read_text, refused_alike
from rsicalib.io.toml_text import parse_toml
from rsicalib.io.urdf import (
    UrdfChain,
    chain_from_urdf,
    masses_from_toml,
)
from rsicalib.io.urdf_tree import Robot, listed, refuse
from rsicalib.plain_text import meant
from rsicalib.tabular import html_table

MARK = "\ufeff"
"""What editors write before a text, to say that it is of Unicode."""

URDF_KEYS = {
    "name": "Name of the chain in reports.",
    "urdf": "Path of the description, relative to the mechanism file; its lengths are metres.",
    "base": "Link that the chain begins at.",
    "tip": "Link that the chain ends at; points of the chain are in its frame.",
    "channels": "Channel of each joint on the way, `{joint = channel}`.",
    "masses": "Path of a TOML file with masses: `link = {mass = 4.97, com = [0, 0, -0.05]}`.",
}
"""What a chain given as URDF may have."""


def load_mechanism(source: str | os.PathLike[str] | Mapping[str, Any]) -> Mechanism:
    """Load a mechanism: a built-in one by its name, a file, TOML text, or plain values.

    Parameters
    ----------
    source : str, path or mapping
        The name of a built-in mechanism, the path of a mechanism file or of a MuJoCo model (MJCF),
        TOML text of more than one line, or values as `tomllib` reads them. Paths in text and in
        values are relative to the working folder.

    Returns
    -------
    Mechanism
        With rows for every chain.

    Raises
    ------
    InputError
        A file cannot be read or contradicts itself, or a chain given as URDF cannot be
        expanded. Of text without URDF the message names line and column.

    See Also
    --------
    read_mechanism : the same as a dictionary.
    expansion_notes : what the rows could not take in.
    """
    if isinstance(source, Mapping):
        mechanism, file = Mechanism.from_dict(_expanded(dict(source), "mechanism")[0]), "mechanism"
    elif isinstance(source, str) and "\n" in source:
        mechanism, file = _of_text(source.removeprefix(MARK), "mechanism"), "mechanism"
    else:
        file = os.fspath(source)
        mechanism = BUILTIN[file]() if file in BUILTIN else _of_text(_read(file), file)
    _check_names(mechanism, file)
    return mechanism


def _check_names(mechanism: Mechanism, file: str) -> None:
    """Refuse a channel whose column means something else in every file of readings."""
    for channel in mechanism.channels:
        if channel.name in COLUMNS:
            if channel.name in POSE and not mechanism.to_dict().get("platform"):
                continue  # no file holds poses of a platform that there is not
            place, found = f"channel {channel.name!r}", "the name of a column with a meaning"
            hint = f"In readings a column of that name holds: {COLUMNS[channel.name]}"
            refuse(file, place, found=found, expected="another name", hint=hint)


def mechanism_document(
    source: str | os.PathLike[str] | Mapping[str, Any],
) -> tuple[Path, dict[str, Any]]:
    """The folder that the paths of a mechanism are relative to, and its values, not expanded.

    Parameters
    ----------
    source : str, path or mapping
        As for `load_mechanism`.

    Returns
    -------
    Path, dict
        Nothing in the dictionary for a built-in mechanism.
    """
    if isinstance(source, Mapping):
        return Path(), dict(source)
    if isinstance(source, str) and "\n" in source:
        return Path(), parse_toml(source.removeprefix(MARK), "mechanism")
    file = os.fspath(source)
    if file in BUILTIN:
        return Path(), {}
    text = _read(file)
    document = mechanism_of_mjcf(file)[0] if is_mjcf(text) else parse_toml(text, file)
    return Path(file).parent, document


def _of_text(text: str, name: str) -> Mechanism:
    """The mechanism of a file's text; messages begin with the name."""
    if is_mjcf(text):
        path = name if Path(name).is_file() else text  # a file may include others
        return Mechanism.from_dict(mechanism_of_mjcf(path)[0])
    document = parse_toml(text, name)
    expanded, _ = _expanded(document, name)
    try:
        if expanded is document:
            return Mechanism.from_toml(text)
        return Mechanism.from_dict(expanded)
    except InputError as error:
        where = Where(file=name, line=None, column=None, found=None, expected=None)
        raise InputError(f"{name}: {error.message}", where) from None


def mechanism_html(mechanism: Mechanism) -> str:
    """What a notebook shows of a mechanism: its channels, and how they are closed."""
    channels = mechanism.channels
    names = ("name", "unit", "gain", "offset", "range", "limits", "noise")
    table = html_table(
        {name: [_short(getattr(c, name)) for c in channels] for name in names}, repr(mechanism)
    )
    closures = {
        c["name"]: f"{c['kind']} of {', '.join(c['between'])}" for c in _closures(mechanism)
    }
    closed = {"closure": list(closures), "": list(closures.values())}
    return f"<div>{table}{html_table(closed)}</div>"


def _closures(mechanism: Mechanism) -> list[dict[str, Any]]:
    closures: list[dict[str, Any]] = mechanism.to_dict()["closure"]
    return closures


def _short(value: Any) -> Any:
    return " … ".join(f"{v:.6g}" for v in value) if isinstance(value, tuple) else value


def expansion_notes(name_or_path: str | os.PathLike[str]) -> list[str]:
    """List what the rows of chains given as URDF could not take in.

    Parameters
    ----------
    name_or_path : str or path
        As for `load_mechanism`.

    Returns
    -------
    list of str
        One line each.

    Raises
    ------
    InputError
        As for `read_mechanism`.
    """
    file = os.fspath(name_or_path)
    if file not in BUILTIN and is_mjcf(_read(file)):
        return mechanism_of_mjcf(file)[1]
    _, document = mechanism_document(name_or_path)
    notes = _expanded(document, os.fspath(name_or_path))[1]
    return [" ".join(note.split()) for note in notes]


def read_mechanism(path: str | os.PathLike[str]) -> dict[str, Any]:
    """Read a mechanism file and expand its chains.

    A chain given as URDF, whose paths are relative to the mechanism file,
    becomes rows. Channels that its joints name and the file does not declare
    are filled in: readings in the joint's unit (rad, or m for a slide), gain 1,
    offset 0, limits from the URDF, noise unknown. What the file declares wins.

    Parameters
    ----------
    path : str or path
        A mechanism file.

    Returns
    -------
    dict
        As `tomllib` reads a mechanism file without URDF chains.

    Raises
    ------
    InputError
        A file cannot be read, or a chain given as URDF cannot be expanded.
    """
    file = os.fspath(path)
    return _expanded(parse_toml(_read(file), file), file)[0]


def _read(file: str) -> str:
    if not file or not os.path.exists(file):
        expected = f"a mechanism file, or a built-in mechanism: {listed(BUILTIN)}"
        refuse(file, "mechanism", found=f"no such file{meant(file, BUILTIN)}", expected=expected)
    with refused_alike(file, "a mechanism file"):
        refuse_foreign(file)
    return read_text(file, "a mechanism file")


def _tables(document: Mapping[str, Any], key: str) -> list[dict[str, Any]]:
    """The entries of an array of tables; what is not one is left for the core to refuse."""
    entries = document.get(key, [])
    return [e for e in entries if isinstance(e, dict)] if isinstance(entries, list) else []


def _expanded(document: dict[str, Any], file: str) -> tuple[dict[str, Any], list[str]]:
    """The mechanism with rows for every chain, and notes on what they could not take in."""
    chains = _tables(document, "chain")
    urdfs = {i: _urdf(chain, file) for i, chain in enumerate(chains) if "urdf" in chain}
    if not urdfs:
        return document, []
    unit = document.get("length_unit")
    if unit != "m":
        hint = "The lengths of a URDF are in metres."
        refuse(file, "length_unit", found=repr(unit), expected="'m'", hint=hint)
    rows = [
        {"name": chain["name"], "dh": urdfs[i].rows} if i in urdfs else chain
        for i, chain in enumerate(chains)
    ]
    filled = {"channel": _channels(document, rows, list(urdfs.values()), file), "chain": rows}
    notes = [f"{chains[i]['urdf']}: {note}" for i, urdf in urdfs.items() for note in urdf.notes]
    return {**document, **filled}, notes


def _urdf(chain: dict[str, Any], file: str) -> UrdfChain:
    place = f"chain {chain.get('name')!r}"
    for key in chain:
        if key not in URDF_KEYS:
            expected = f"beside `urdf` only {listed(URDF_KEYS)}"
            refuse(file, place, found=f"`{key}`", expected=expected)
    for key in ("name", "urdf", "base", "tip"):
        if not isinstance(chain.get(key), str):
            refuse(file, f"{place}, {key}", found=repr(chain.get(key)), expected="text")
    channels, masses = chain.get("channels"), chain.get("masses")
    if not isinstance(channels, dict) or not all(isinstance(c, str) for c in channels.values()):
        steps = Robot(Path(file).parent / chain["urdf"]).path(chain["base"], chain["tip"])
        moving = [step.joint.name for step in steps if step.joint.kind != "fixed"]
        joints = ", ".join(f'{name} = "q{k}"' for k, name in enumerate(moving, 1))
        expected = f"the channel of each joint, {{ {joints} }}"
        found = "none" if channels is None else repr(channels)
        refuse(file, f"{place}, channels", found=found, expected=expected)
    if masses is not None and not isinstance(masses, str):
        refuse(file, f"{place}, masses", found=repr(masses), expected="the path of a TOML file")
    folder = Path(file).parent
    weights = None if masses is None else masses_from_toml(folder / masses)
    return chain_from_urdf(folder / chain["urdf"], chain["base"], chain["tip"], channels, weights)


def _channels(
    document: Mapping[str, Any], chains: list[dict[str, Any]], urdfs: list[UrdfChain], file: str
) -> list[dict[str, Any]]:
    """The channels: in the order of the file, or of the chains if one is not declared."""
    declared: dict[str, dict[str, Any]] = {}
    for i, channel in enumerate(_tables(document, "channel"), start=1):
        name = channel.get("name")
        if not isinstance(name, str) or name in declared:
            refuse(file, f"channel {i}, name", found=repr(name), expected="a name of its own")
        declared[name] = channel
    filled = {c: _channel(c, urdf, declared.get(c, {})) for urdf in urdfs for c in urdf.joints}
    names = list(declared)
    if not filled.keys() <= declared.keys():
        sensed = (row.get("channel") for chain in chains for row in _tables(chain, "dh"))
        known = filled.keys() | declared.keys()
        names = list(dict.fromkeys([*(c for c in sensed if c in known), *declared]))
    return [filled.get(name) or declared[name] for name in names]


def _channel(name: str, urdf: UrdfChain, declared: Mapping[str, Any]) -> dict[str, Any]:
    """What the file declares, then what the URDF implies."""
    kind = next(row["joint"] for row in urdf.rows if row.get("channel") == name)
    scale = {"unit": "m" if kind == "prismatic" else "rad", "gain": 1.0, "offset": 0.0}
    if scale.keys() & declared.keys():  # a scale is declared whole, or not at all
        scale = {}
    limits = {"limits": _limits(name, urdf, declared)} if name in urdf.limits else {}
    return {"name": name, **scale, **limits, **declared}


def _limits(name: str, urdf: UrdfChain, declared: Mapping[str, Any]) -> list[float]:
    """Limits of a joint in the unit that its channel is declared in."""
    turns = all(row["joint"] != "prismatic" for row in urdf.rows if row.get("channel") == name)
    if turns and declared.get("unit") == "deg":
        return [math.degrees(end) for end in urdf.limits[name]]
    return urdf.limits[name]
