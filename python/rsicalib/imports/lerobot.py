"""LeRobot data sets, versions 2 and 3: positions of a leader (`action`) and of its follower.

`meta/info.json` says the names and where the rows are; version 2 has a Parquet file for each
episode, version 3 many episodes in a file. `action` is a command: where the leader is.
"""

from __future__ import annotations

import hashlib
import json
from pathlib import Path
from typing import Any

import numpy as np

from rsicalib.arrays import FloatArray
from rsicalib.errors import InputError
from rsicalib.imports.asked import Asked
from rsicalib.imports.extras import needed, read_by
from rsicalib.imports.log import Log
from rsicalib.imports.stretches import Recording
from rsicalib.imports.teleop import FOLLOWER, LEADER, Teleop, short_names
from rsicalib.io.sources import read_text

__all__ = ["read", "read_calibration", "read_ranges"]

SIDES = {"observation.state": FOLLOWER, "action": LEADER}
"""Columns of a data set, and what their joints are called here."""

LARGEST = 10**9
"""Episodes, and rows in a second, that no data set has."""

MOST_JOINTS = 1000
"""Joints that no robot has."""

OF_A_RANGE = ("homing_offset", "range_min", "range_max", "drive_mode")


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
    names = {key: _names(info, key, root) for key in SIDES if key in info["features"]}
    if "observation.state" not in names:
        found, expected = "no such feature", "positions of the arm"
        where = str(root / "meta" / "info.json")
        raise InputError.at(where, column="observation.state", found=found, expected=expected)
    rate = info["fps"]
    recordings, digest = [], hashlib.sha256()
    for episode, rows, lines in _episodes(root, info, version, [*names], asked):
        values = np.column_stack([_matrix(rows[key], names[key], key, episode) for key in names])
        digest.update(values.tobytes())
        time = _float(rows["timestamp"]) if "timestamp" in rows else None
        if time is None:
            time = np.arange(len(values)) / rate
        channels = tuple(SIDES[key] + name for key in names for name in names[key])
        recordings.append(Recording(channels, values, time, lines, None, f"episode {episode}"))
    both = [n for n in names["observation.state"] if n in names.get("action", [])]
    told = Teleop(source, tuple(both), recordings, rate, read_ranges(asked.ranges))
    sessions, mechanism, findings = told.sessions(asked)
    if not sessions:
        expected = "rows in which no joint is clamped at the end of its range"
        raise InputError.at(source, found="none", expected=expected)
    if "action" not in names:
        findings.append("no action: there is no leader to compare with")
    words = f"LeRobot data set {version}"
    sha256 = digest.hexdigest()
    return Log(source, words, sessions, mechanism, tuple(findings), "row", sha256=sha256)


def _checked(path: Path) -> dict[str, Any]:
    """The description of a data set, with what is read of it in its place."""
    info = _json(path)

    def refuse(key: str, expected: str, hint: str = "") -> InputError:
        found = repr(info[key])[:80] if key in info else "nothing"
        return InputError.at(
            str(path), column=key, found=found, expected=expected, hint=hint, column_word=""
        )

    if not str(info.get("codebase_version")).startswith(("v2.", "v3.")):
        hint = "LeRobot has a program that converts an earlier data set."
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


def _json(path: Path) -> dict[str, Any]:
    try:
        found = json.loads(read_text(path, "a description of a LeRobot data set"))
    except json.JSONDecodeError as error:
        raise InputError.at(
            str(path), line=error.lineno, found=error.msg, expected="JSON"
        ) from None
    except RecursionError:
        raise InputError.at(str(path), found="JSON nested too deep", expected="less") from None
    if not isinstance(found, dict):
        raise InputError.at(str(path), found=type(found).__name__, expected="a JSON object")
    return found


def _names(info: dict[str, Any], key: str, root: Path) -> list[str]:
    """Joints of a feature, by their short names."""
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
        raise InputError.at(where, column=place, found=found, expected=expected, column_word="")
    return short


def _episodes(
    root: Path, info: dict[str, Any], version: str, keys: list[str], asked: Asked
) -> list[tuple[int, dict[str, Any], np.ndarray]]:
    """Number, columns and rows of each episode that is asked for, in their order."""
    parquet = needed("pyarrow.parquet", "parquet", str(root), "a LeRobot data set")
    total = info["total_episodes"]
    wanted = list(range(total)) if asked.episodes is None else list(asked.episodes)
    beyond = [episode for episode in wanted if not 0 <= episode < total]
    if beyond or not wanted:
        said = f"no episode {beyond[0]}" if beyond else "no episode"
        raise InputError.at(str(root), found=said, expected=f"episodes 0 to {total - 1}")
    if version.startswith("v2."):
        pattern, size = str(info["data_path"]), info["chunks_size"]
        files = [root / pattern.format(episode_chunk=e // size, episode_index=e) for e in wanted]
    else:
        files = sorted((root / "data").glob("chunk-*/file-*.parquet"))
    found: dict[int, list[tuple[dict[str, Any], np.ndarray]]] = {}
    for file in files:
        if not file.is_file():
            expected = "rows of the data set"
            raise InputError.at(str(file), found="no such file", expected=expected)
        with read_by("pyarrow", str(file), "rows of the data set"):
            schema = parquet.ParquetFile(file).schema_arrow.names
            more = [n for n in ("episode_index", "timestamp") if n in schema]
            lacking = [n for n in [*keys, "episode_index"] if n not in schema]
            if lacking:
                expected = f"a column {lacking[0]!r}, as meta/info.json says"
                raise InputError.at(str(file), found="no such column", expected=expected)
            table = parquet.read_table(file, columns=[*keys, *more])
        index = table["episode_index"].to_numpy()
        for episode in np.unique(index).tolist():
            rows = np.flatnonzero(index == episode)
            part = table.take(rows)
            columns = {name: part[name] for name in [*keys, *more]}
            found.setdefault(int(episode), []).append((columns, rows + 1))
    lengths = _lengths(root, version)
    out = []
    for episode in wanted:
        parts = found.get(episode, [])
        count = sum(len(rows) for _, rows in parts)
        if count != lengths.get(episode, count) or not parts:
            expected = f"{lengths.get(episode, 'some')} rows, as meta/episodes says"
            place = f"episode {episode}"
            raise InputError.at(
                str(root), column=place, found=f"{count} rows", expected=expected, column_word=""
            )
        columns = {
            name: [cell for part, _ in parts for cell in part[name].to_pylist()]
            for name in parts[0][0]
        }
        out.append((episode, columns, np.concatenate([rows for _, rows in parts])))
    return out


def _lengths(root: Path, version: str) -> dict[int, int]:
    """Rows of each episode, as the data set says."""
    lines = root / "meta" / "episodes.jsonl"
    if version.startswith("v2."):
        rows = (
            [json.loads(line) for line in lines.read_text().splitlines()] if lines.exists() else []
        )
    else:
        parquet = needed("pyarrow.parquet", "parquet", str(root), "a LeRobot data set")
        rows = [
            row
            for file in sorted((root / "meta" / "episodes").glob("chunk-*/file-*.parquet"))
            for row in parquet.read_table(file, columns=["episode_index", "length"]).to_pylist()
        ]
    return {int(row["episode_index"]): int(row["length"]) for row in rows if "length" in row}


def _matrix(cells: list[Any], names: list[str], key: str, episode: int) -> FloatArray:
    """Positions, shape (n, joints)."""
    for number, cell in enumerate(cells):
        size = len(cell) if isinstance(cell, list) else 1
        if size != len(names):
            place = f"row {number + 1}, {key}"
            expected = f"{len(names)}: {', '.join(names)}"
            raise InputError.at(
                f"episode {episode}",
                column=place,
                found=f"{size} numbers",
                expected=expected,
                column_word="",
            )
    return _float(np.array(cells, dtype=np.float32).ravel()).reshape(-1, len(names))


def _float(cells: Any) -> FloatArray:
    """Single precision as the shortest decimals that it has, in double precision."""
    return np.asarray(cells, dtype=np.float32).astype(str).astype(np.float64)


def read_ranges(paths: tuple[str, ...]) -> dict[str, int]:
    """Ticks of each range, by channel, of calibration files: of the leader, then of the follower.

    One file alone is the follower's.
    """
    sides = (FOLLOWER,) if len(paths) == 1 else (LEADER, FOLLOWER)
    out = {}
    for path, side in zip(paths, sides, strict=False):
        for joint, entry in read_calibration(path).items():
            out[side + short_names([joint])[0]] = entry["range_max"] - entry["range_min"]
    return out


def read_calibration(path: str) -> dict[str, dict[str, int]]:
    """Read a calibration file: of each joint where its range ends, in steps of the encoder.

    Raises
    ------
    InputError
        It is none.
    """
    found: dict[str, dict[str, int]] = _json(Path(path))
    for joint, entry in found.items():
        for key in OF_A_RANGE:
            value = entry.get(key) if isinstance(entry, dict) else None
            if not isinstance(value, int):
                place = f"{joint}.{key}"
                raise InputError.at(
                    path, column=place, found=repr(value), expected="an integer", column_word=""
                )
    return found
