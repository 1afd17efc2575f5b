"""Data sets of LeRobot, by pyarrow, which LeRobot itself writes with."""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from tests.strangers import Made
from tests.test_imports_robots import FORMS, JOINTS, dataset


def whole(version: str, change: Callable[[Path], Any], **more: Any) -> Callable[[Path], Path]:
    """A maker of a data set that something is done to."""

    def make(folder: Path) -> Path:
        root = dataset(
            folder / "set",
            version,
            FORMS[version[:2] + ".1" if "2" in version else version],
            **more,
        )
        change(root)
        return root

    return make


def info(**values: Any) -> Callable[[Path], Any]:
    """Other entries of `meta/info.json`."""

    def change(root: Path) -> None:
        path = root / "meta" / "info.json"
        path.write_text(json.dumps({**json.loads(path.read_text()), **values}))

    return change


def named(names: Any) -> Callable[[Path], Any]:
    """Other names of the joints."""
    feature = {"dtype": "float32", "shape": [6], "names": names}
    return info(features={"action": feature, "observation.state": feature})


def rows(root: Path) -> list[Path]:
    return sorted((root / "data").rglob("*.parquet"))


def without_names(folder: Path) -> Path:
    """Version 2.0, joints without names, no leader."""
    pyarrow = pytest.importorskip("pyarrow")
    parquet = pytest.importorskip("pyarrow.parquet")
    root = folder / "set"
    (root / "meta").mkdir(parents=True)
    (root / "data" / "chunk-000").mkdir(parents=True)
    about = {"codebase_version": "v2.0", "fps": 50, "total_episodes": 1}
    about |= {"data_path": "data/chunk-{episode_chunk:03d}/episode_{episode_index:06d}.parquet"}
    about |= {"features": {"observation.state": {"dtype": "float32", "shape": [3], "names": None}}}
    (root / "meta" / "info.json").write_text(json.dumps(about))
    state = np.random.default_rng(0).uniform(-1, 1, (30, 3)).astype(np.float32)
    cells = pyarrow.FixedSizeListArray.from_arrays(pyarrow.array(state.ravel()), 3)
    table = pyarrow.table({"observation.state": cells, "episode_index": np.zeros(30, dtype=int)})
    parquet.write_table(table, root / "data" / "chunk-000" / "episode_000000.parquet")
    return root


POINTER = "version https://git-lfs.github.com/spec/v1\nsize 3\n"
MOTORS = {"motors": [f"main_{joint}" for joint in JOINTS]}

FILES: dict[str, Made] = {
    "joints without names": (without_names, {}, (30, "follower_joint_2")),
    "names under motors": (whole("v2.1", named(MOTORS), rows=90), {}, (0, "leader_wrist_roll")),
    "version 3, one episode": (
        whole("v3.0", lambda _: None, rows=90),
        {"episodes": [1]},
        (0, "follower_elbow_flex"),
    ),
    "more keys than ours": (
        whole("v3.0", info(splits={"train": "0:2"}, robot_type=None), rows=90),
        {},
        (0, "leader_elbow_flex"),
    ),
    "an old version": (
        whole("v2.1", info(codebase_version="v1.6")),
        {},
        "found 'v1.6', expected v2.0, v2.1 or v3.0. LeRobot has a program",
    ),
    "files that Git LFS did not fetch": (
        whole("v3.0", lambda root: rows(root)[0].write_text(POINTER)),
        {},
        "git lfs pull",
    ),
    "an episode that was not fetched": (
        whole("v2.1", lambda root: rows(root)[1].unlink()),
        {},
        "read the episodes that there are by rsicalib import --episodes",
    ),
    "no files at all": (
        whole("v3.0", lambda root: rows(root)[0].unlink()),
        {},
        "episode 0: found 0 rows, expected 300 rows",
    ),
    "an episode that there is not": (
        whole("v2.1", lambda _: None),
        {"episodes": [7]},
        "found no episode 7, expected episodes 0 to 1",
    ),
    "a base that drives": (
        whole("v3.0", named([*(f"arm_{joint}.pos" for joint in JOINTS[:4]), "x.vel", "y.vel"])),
        {"channels": {"q1": "follower_x.vel"}},
        "found no joint 'follower_x.vel'",
    ),
    "names as numbers": (whole("v2.1", named([1, 2, 3, 4, 5, 6])), {}, "a name for each joint"),
}
