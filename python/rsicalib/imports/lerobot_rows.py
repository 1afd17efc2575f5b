"""Rows of a LeRobot data set: a Parquet file for each episode, or many episodes in a file."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from rsicalib.arrays import FloatArray, IntArray
from rsicalib.errors import InputError
from rsicalib.io.extras import needed, read_by

Rows = tuple[int, dict[str, list[Any]], IntArray]
"""Number of an episode, its columns, and where its rows stand in their files."""

INDEX, TIME = "episode_index", "timestamp"


def episodes(
    root: Path, info: dict[str, Any], keys: Sequence[str], asked: tuple[int, ...] | None
) -> Iterator[Rows]:
    """Read the episodes that are asked for, in their order.

    Parameters
    ----------
    root : Path
        Folder of the data set.
    info : dict
        What `meta/info.json` says.
    keys : sequence of str
        Columns to read, beside the time where there is one.
    asked : tuple of int or None
        Numbers of episodes; None: all.

    Raises
    ------
    InputError
        A file or a row is missing.
    """
    total = info["total_episodes"]
    wanted = tuple(range(total)) if asked is None else asked
    beyond = [episode for episode in wanted if not 0 <= episode < total]
    if beyond or not wanted:
        said = f"no episode {beyond[0]}" if beyond else "no episode"
        raise InputError.at(str(root), said, f"episodes 0 to {total - 1}")
    found: dict[int, list[tuple[Any, IntArray]]] = {}
    for file in _files(root, info, wanted):
        table = _table(file, keys)
        index = np.asarray(table[INDEX].to_numpy())
        for episode in np.unique(index).tolist():
            rows = np.flatnonzero(index == episode)
            found.setdefault(int(episode), []).append((table.take(rows), rows + 1))
    lengths = _lengths(root, info)
    for episode in wanted:
        parts = found.get(episode, [])
        count = sum(len(rows) for _, rows in parts)
        if count != lengths.get(episode, count) or not parts:
            expected = f"{lengths.get(episode, 'some')} rows, as meta/episodes says"
            place = f"episode {episode}"
            raise InputError.at(str(root), f"{count} rows", expected, place=place)
        columns = {
            name: [cell for part, _ in parts for cell in part[name].to_pylist()]
            for name in parts[0][0].column_names
        }
        yield episode, columns, np.concatenate([rows for _, rows in parts])


def _files(root: Path, info: dict[str, Any], wanted: Sequence[int]) -> list[Path]:
    """Files that hold the episodes, or all there are where many share one."""
    if not info["codebase_version"].startswith("v2."):
        return sorted((root / "data").glob("chunk-*/file-*.parquet"))
    pattern, size = str(info["data_path"]), info["chunks_size"]
    return [root / pattern.format(episode_chunk=e // size, episode_index=e) for e in wanted]


def _table(file: Path, keys: Sequence[str]) -> Any:
    """The columns of a file."""
    if not file.is_file():
        hint = "Fetch it, or read the episodes that there are by rsicalib import --episodes N,…"
        expected = "rows of the data set"
        raise InputError.at(str(file), "no such file", expected, hint=hint)
    parquet = needed("pyarrow.parquet", str(file), "a LeRobot data set")
    with read_by("pyarrow", str(file), "rows of the data set"):
        names = parquet.ParquetFile(file).schema_arrow.names
        lacking = [name for name in [*keys, INDEX] if name not in names]
        if lacking:
            expected = f"a column {lacking[0]!r}, as meta/info.json says"
            raise InputError.at(str(file), "no such column", expected)
        return parquet.read_table(file, columns=[*keys, INDEX, *({TIME} & {*names})])


def _lengths(root: Path, info: dict[str, Any]) -> dict[int, int]:
    """Rows of each episode, as the data set says; nothing where it does not."""
    old = info["codebase_version"].startswith("v2.")
    files = sorted((root / "meta" / "episodes").glob("chunk-*/file-*.parquet"))
    files = [root / "meta" / "episodes.jsonl"] if old else files
    found: dict[int, int] = {}
    for file in filter(Path.is_file, files):
        arrow = needed("pyarrow.json" if old else "pyarrow.parquet", str(file), "rows")
        with read_by("pyarrow", str(file), "a length for each episode"):
            table = arrow.read_json(file) if old else arrow.read_table(file)
            index, lengths = (table[name].to_pylist() for name in (INDEX, "length"))
            found |= {int(e): int(n) for e, n in zip(index, lengths, strict=True)}
    return found


def short_floats(cells: Any) -> FloatArray:
    """Single precision as the shortest decimals that it has, in double precision."""
    return np.asarray(cells, dtype=np.float32).astype(str).astype(np.float64)
