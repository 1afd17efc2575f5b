"""Mechanism files: chains given as URDF become rows, and what that leaves out is filled in.

The core reads fully expanded TOML text and checks it; here is only what needs files.
"""

from __future__ import annotations

import json
import os
import re
from collections.abc import Mapping
from datetime import date, time
from numbers import Integral, Real
from pathlib import Path
from typing import Any

from rsicalib.io.urdf import UrdfChain, chain_from_urdf, masses_from_toml, read_toml
from rsicalib.io.urdf_tree import listed, refuse

__all__ = ["BUILTIN", "load_mechanism_text", "mechanism_toml", "read_mechanism"]

BUILTIN = ("rsi",)
"""Mechanisms that the core brings along."""

URDF_KEYS = ("name", "urdf", "base", "tip", "channels", "masses")
"""What a chain given as URDF may have."""


def load_mechanism_text(name_or_path: str | os.PathLike[str]) -> str | None:
    """Read a mechanism as the TOML text that the core takes.

    Parameters
    ----------
    name_or_path : str or path
        The name of a built-in mechanism, or the path of a mechanism file.

    Returns
    -------
    str or None
        The file's own text if nothing in it is to be expanded, so that the
        core's messages name its lines; else with comments that say what the
        rows could not take in. None for a built-in mechanism.

    Raises
    ------
    InputError
        A file cannot be read, or a chain given as URDF cannot be expanded.

    See Also
    --------
    read_mechanism : the same as a dictionary.
    """
    file = os.fspath(name_or_path)
    if file in BUILTIN:
        return None
    document = _read(file)
    if not any("urdf" in chain for chain in _tables(document, "chain")):
        return Path(file).read_bytes().decode("utf-8-sig")
    expanded, notes = _expanded(document, file)
    comments = [f"# {' '.join(note.split())}\n" for note in notes]
    return "".join(comments) + mechanism_toml(expanded)


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
    return _expanded(_read(file), file)[0]


def mechanism_toml(mechanism: Mapping[str, Any]) -> str:
    """Write a mechanism as TOML text.

    Parameters
    ----------
    mechanism : mapping
        As `read_mechanism` returns it.

    Returns
    -------
    str
        Text that `tomllib` reads back to the same values.

    Examples
    --------
    >>> print(mechanism_toml({"name": "bar", "chain": [{"name": "arm", "dh": [{"a": 3.2}]}]}))
    name = "bar"
    <BLANKLINE>
    [[chain]]
    name = "arm"
    dh = [
      {a = 3.2},
    ]
    <BLANKLINE>
    """
    lines = []
    sections = []
    for key, value in mechanism.items():
        if isinstance(value, Mapping):
            sections += ["", f"[{_key(key)}]", *_lines(value)]
        elif isinstance(value, list) and value and all(isinstance(v, Mapping) for v in value):
            for table in value:
                sections += ["", f"[[{_key(key)}]]", *_lines(table)]
        else:
            lines.append(f"{_key(key)} = {_value(value)}")
    return "\n".join([*lines, *sections, ""])


# ------------------------------------------------------------------ expansion


def _read(file: str) -> dict[str, Any]:
    if not Path(file).is_file():
        expected = f"a mechanism file, or a built-in mechanism: {listed(BUILTIN)}"
        refuse(file, "mechanism", found="no such file", expected=expected)
    return read_toml(file)


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
        expected = 'the channel of each joint, { panda_joint1 = "q1" }'
        refuse(file, f"{place}, channels", found=repr(channels), expected=expected)
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
    limits = {"limits": urdf.limits[name]} if name in urdf.limits else {}
    return {"name": name, **scale, **limits, **declared}


# ------------------------------------------------------------------ TOML


def _lines(table: Mapping[str, Any]) -> list[str]:
    """One line for each key; lists of tables, such as rows, one table to a line."""
    out = []
    for key, value in table.items():
        if isinstance(value, list) and value and all(isinstance(v, Mapping) for v in value):
            out += [f"{_key(key)} = [", *(f"  {_value(v)}," for v in value), "]"]
        else:
            out.append(f"{_key(key)} = {_value(value)}")
    return out


def _key(key: str) -> str:
    return key if re.fullmatch(r"[A-Za-z0-9_-]+", key) else _value(key)


def _value(value: object) -> str:
    if isinstance(value, str):
        return json.dumps(value, ensure_ascii=False).replace("\x7f", "\\u007f")
    if isinstance(value, bool):
        return "true" if value else "false"
    if isinstance(value, Integral):
        return repr(int(value))
    if isinstance(value, Real):  # of numpy, too, whose repr is no TOML
        return repr(float(value))
    if isinstance(value, (date, time)):
        return value.isoformat()
    if isinstance(value, Mapping):
        return "{" + ", ".join(f"{_key(k)} = {_value(v)}" for k, v in value.items()) + "}"
    if isinstance(value, (list, tuple)):
        return "[" + ", ".join(map(_value, value)) + "]"
    raise TypeError(f"TOML has no {type(value).__name__}")
