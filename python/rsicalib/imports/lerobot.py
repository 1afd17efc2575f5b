"""LeRobot data sets, versions 2 and 3: positions of a leader (`action`) and of its follower.

`meta/info.json` says the names and where the rows are; version 2 has a Parquet file for each
episode, version 3 many episodes in a file. `action` is a command: where the leader is.
"""

from __future__ import annotations

import hashlib
from pathlib import Path
from typing import Any

import numpy as np

from rsicalib.arrays import FloatArray
from rsicalib.errors import InputError
from rsicalib.imports.asked import Asked
from rsicalib.imports.lerobot_ranges import read_ranges
from rsicalib.imports.lerobot_rows import episodes, short_floats
from rsicalib.imports.log import Log
from rsicalib.imports.stretches import Recording
from rsicalib.imports.teleop import FOLLOWER, LEADER, POSITION, Teleop, short_names
from rsicalib.io.sources import read_json

SIDES = {"observation.state": FOLLOWER, "action": LEADER}
"""Columns of a data set, and what their joints are called here."""

LARGEST = 10**9
"""Episodes, and rows in a second, that no data set has."""

MOST_JOINTS = 1000
"""Joints that no robot has."""


def read(source: str, asked: Asked) -> Log:
    """Read a data set; a session for each episode.

    Raises
    ------
    InputError
        A file is missing, or does not hold what `meta/info.json` says.
    """
    root = Path(source)
    info = _checked(root / "meta" / "info.json")
    version = info["codebase_version"]
    features = {key: _names(info, key, root) for key in SIDES if key in info["features"]}
    taken = {key: _positions(names) for key, names in features.items()}
    names = {key: short_names([features[key][k] for k in at]) for key, at in taken.items()}
    if "observation.state" not in names:
        found, expected = "no such feature", "positions of the arm"
        where = str(root / "meta" / "info.json")
        raise InputError.at(where, found, expected, column="observation.state")
    rate = info["fps"]
    recordings, digest = [], hashlib.sha256()
    for episode, rows, lines in episodes(root, info, [*names], asked.episodes):
        place = f"{source}, episode {episode}"
        values = np.column_stack(
            [_matrix(rows[key], features[key], key, place)[:, taken[key]] for key in names]
        )
        digest.update(values.tobytes())
        time = short_floats(rows["timestamp"]) if "timestamp" in rows else None
        if time is None:
            time = np.arange(len(values)) / rate
        channels = tuple(SIDES[key] + name for key in names for name in names[key])
        recordings.append(Recording(channels, values, time, lines, None, f"episode {episode}"))
    both = [n for n in names["observation.state"] if n in names.get("action", [])]
    told = Teleop(source, tuple(both), recordings, rate, read_ranges(asked.ranges))
    sessions, mechanism, findings = told.sessions(asked)
    if not sessions:
        expected = "rows in which no joint is clamped at the end of its range"
        raise InputError.at(source, "none", expected)
    others = [n for key, at in taken.items() for k, n in enumerate(features[key]) if k not in at]
    if others:
        findings.append(f"no positions, and not taken: {', '.join(dict.fromkeys(others))}")
    if "action" not in names:
        findings.append("no action: there is no leader to compare with")
    words = f"LeRobot data set {version}"
    sha256 = digest.hexdigest()
    return Log(source, words, sessions, mechanism, tuple(findings), "row", sha256=sha256)


def _checked(path: Path) -> dict[str, Any]:
    """The description of a data set, with what is read of it in its place."""
    info = read_json(path, "JSON of LeRobot")

    def refuse(key: str, expected: str, hint: str = "") -> InputError:
        found = repr(info[key])[:80] if key in info else "nothing"
        return InputError.at(str(path), found, expected, hint=hint, place=key)

    if not str(info.get("codebase_version")).startswith(("v2.", "v3.")):
        hint = "LeRobot has a program that converts an earlier data set. A later one is not known."
        raise refuse("codebase_version", "v2.0, v2.1 or v3.0", hint)
    info = {"chunks_size": 1000, **info}
    for key in ("total_episodes", "chunks_size"):
        if not isinstance(info.get(key), int) or not 0 < info[key] < LARGEST:
            raise refuse(key, "a whole number above zero")
    if not isinstance(info.get("fps"), int | float) or not 0.0 < info["fps"] < LARGEST:
        raise refuse("fps", "rows in a second, a number above zero")
    features = info.get("features")
    if not isinstance(features, dict) or not all(isinstance(f, dict) for f in features.values()):
        raise refuse("features", "the columns of the data set")
    if info["codebase_version"].startswith("v2."):
        try:
            str(info["data_path"]).format(episode_chunk=0, episode_index=0)
        except (KeyError, IndexError, ValueError):
            raise refuse("data_path", "a path with episode_chunk and episode_index") from None
    return info


def _positions(names: list[str]) -> list[int]:
    """Places of the positions in a feature: where some say what they are, those that say so."""
    return [k for k, name in enumerate(names) if name.endswith(POSITION)] or [*range(len(names))]


def _names(info: dict[str, Any], key: str, root: Path) -> list[str]:
    """What a feature holds, as the data set calls it."""
    feature = info["features"][key]
    names = feature.get("names")
    while isinstance(names, dict) and len(names) == 1:  # {"motors": [...]}, {"axes": [...]}
        names = next(iter(names.values()))
    shape = feature.get("shape")
    if names is None and isinstance(shape, list) and [type(n) for n in shape] == [int]:
        names = [f"joint_{k}" for k in range(min(shape[0], MOST_JOINTS))]
    named = isinstance(names, list) and all(isinstance(n, str) for n in names)
    short = short_names(names) if named else []
    if not short or len(set(short)) < len(short):
        where = str(root / "meta" / "info.json")
        place = f"features.{key}.names"
        found, expected = f"{names!r}"[:80], "a name for each joint, each once"
        raise InputError.at(where, found, expected, place=place)
    return list(names)


def _matrix(cells: list[Any], names: list[str], key: str, place: str) -> FloatArray:
    """Positions, shape (n, joints)."""
    for number, cell in enumerate(cells, 1):
        size = len(cell) if isinstance(cell, list) else 1
        if size != len(names):
            raise InputError.at(
                place,
                f"{size} numbers",
                f"{len(names)}: {', '.join(names)}",
                line=number,
                line_word="row",
                place=key,
            )
    return short_floats(np.array(cells, dtype=np.float32).ravel()).reshape(-1, len(names))
