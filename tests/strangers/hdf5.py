"""HDF5 of the shape of ALOHA, and of others, by h5py."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from tests.strangers import Made, text

WALK = np.cumsum(np.random.default_rng(0).normal(0.0, 0.01, (60, 14)), axis=0)


def holds(
    arrays: dict[str, Any], name: str = "episode_0.hdf5", **more: Any
) -> Callable[[Path], Path]:
    """A maker of a file with these arrays."""

    def make(folder: Path) -> Path:
        h5py = pytest.importorskip("h5py", reason="the extra hdf5 is not installed")
        path = folder / name
        with h5py.File(path, "w") as root:
            root.attrs["sim"] = False
            for place, values in arrays.items():
                root.create_dataset(place, data=values, **more)
        return path

    return make


def episodes(folder: Path) -> Path:
    """A folder of episodes of different lengths."""
    for k in range(2):
        part = WALK[: 60 - 20 * k]
        holds({"observations/qpos": part, "action": part}, f"episode_{k}.hdf5")(folder)
    return folder


def cut(folder: Path) -> Path:
    """A file whose writer was ended."""
    path = holds({"observations/qpos": WALK, "action": WALK})(folder)
    path.write_bytes(path.read_bytes()[:3000])
    return path


GAP = WALK.copy()
GAP[3, 2] = np.nan

FILES: dict[str, Made] = {
    "compressed in chunks": (
        holds({"observations/qpos": WALK, "action": WALK}, compression="gzip", chunks=(20, 14)),
        {},
        (60, "follower_left_elbow"),
    ),
    "single precision, one arm": (
        holds({"observations/qpos": np.float32(WALK[:, :7]), "action": WALK[:, :7]}),
        {"rate": 50.0},
        (60, "leader_waist"),
    ),
    "another number of joints": (
        holds({"observations/qpos": WALK[:, :9], "action": WALK[:, :9]}),
        {},
        (60, "follower_joint_8"),
    ),
    "a folder of episodes": (episodes, {}, (60, "leader_right_gripper")),
    "robomimic": (
        holds({"data/demo_0/obs/robot0_joint_pos": WALK, "data/demo_0/actions": WALK}),
        {},
        "It has: data, data/demo_0",
    ),
    "no leader": (holds({"observations/qpos": WALK}), {}, "/action: found no such data set"),
    "another length": (
        holds({"observations/qpos": WALK, "action": WALK[1:]}),
        {},
        "found shapes (60, 14) and (59, 14)",
    ),
    "a gap": (
        holds({"observations/qpos": WALK, "action": GAP}),
        {},
        "row 4, column leader_left_elbow: found nan",
    ),
    "cut short": (cut, {}, "what h5py cannot read"),
    "a pointer of Git LFS": (
        text("episode_0.hdf5", "version https://git-lfs.github.com/spec/v1\nsize 3\n"),
        {"format": "aloha"},
        "git lfs pull",
    ),
}
