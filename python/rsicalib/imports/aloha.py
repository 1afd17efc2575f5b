"""HDF5 episodes of the shape that ALOHA writes: `/observations/qpos` and `/action`, [T, joints]."""

from __future__ import annotations

import hashlib
from pathlib import Path
from typing import Any

import numpy as np

from rsicalib.arrays import FloatArray
from rsicalib.errors import InputError
from rsicalib.imports.asked import Asked
from rsicalib.imports.log import Log
from rsicalib.imports.stretches import Recording
from rsicalib.imports.teleop import FOLLOWER, LEADER, Teleop
from rsicalib.io.extras import needed, read_by

ARM = "waist shoulder elbow forearm_roll wrist_angle wrist_rotate gripper"
"""Joints of one arm, in the order of the file."""

STATE, ACTION = "/observations/qpos", "/action"


def read(source: str, asked: Asked) -> Log:
    """Read an episode, or a folder of episodes.

    Raises
    ------
    InputError
        A file lacks the positions, or they have another shape.
    """
    h5py = needed("h5py", source, "an HDF5 file")
    path = Path(source)
    files = sorted(path.glob("*.hdf5")) + sorted(path.glob("*.h5")) if path.is_dir() else [path]
    recordings: list[Recording] = []
    digest = hashlib.sha256()
    joints: tuple[str, ...] = ()
    for file in files:
        state, action = _positions(h5py, file)
        digest.update(state.tobytes() + action.tobytes())
        joints = _joints(state.shape[1])
        names = tuple(side + j for side in (LEADER, FOLLOWER) for j in joints)
        if recordings and names != recordings[0].names:
            found = f"{len(joints)} joints"
            expected = f"{len(recordings[0].names) // 2}, as in {files[0].name}"
            raise InputError.at(str(file), found, expected, column=STATE)
        values = np.hstack([action, state])
        time = None if asked.rate is None else np.arange(len(values)) / asked.rate
        lines = np.arange(1, len(values) + 1)
        name = file.stem if len(files) > 1 else ""
        recordings.append(Recording(names, values, time, lines, None, name))
    told = Teleop(source, joints, recordings, asked.rate, {})
    sessions, mechanism, findings = told.sessions(asked)
    if asked.rate is None:
        findings.append(
            "the file has no times, without which no delay is looked for: say how many rows there "
            "are in a second by rsicalib import --rate HZ"
        )
    return Log(
        source,
        "HDF5 of the shape of ALOHA",
        sessions,
        mechanism,
        tuple(findings),
        "row",
        sha256=digest.hexdigest(),
    )


def _joints(count: int) -> tuple[str, ...]:
    """Names of the joints: those of one arm or two where the number fits."""
    arm = ARM.split()
    if count == len(arm):
        return tuple(arm)
    if count == 2 * len(arm):
        return tuple(f"{side}_{joint}" for side in ("left", "right") for joint in arm)
    return tuple(f"joint_{k}" for k in range(count))


def _positions(h5py: Any, file: Path) -> tuple[FloatArray, FloatArray]:
    """Positions of the follower and of the leader, shape (T, joints) each."""
    with read_by("h5py", str(file), "an HDF5 file that is whole"):
        with h5py.File(file, "r") as root:
            for name in (STATE, ACTION):
                if name not in root or not isinstance(root[name], h5py.Dataset):
                    has: list[str] = []
                    root.visit(has.append)
                    hint = f"It has: {', '.join(has)[:200]}."
                    raise InputError.at(
                        str(file),
                        "no such data set",
                        "positions, [T, joints]",
                        hint=hint,
                        place=name,
                    )
            state, action = (np.asarray(root[n][()], dtype=np.float64) for n in (STATE, ACTION))
    if state.ndim != 2 or state.shape != action.shape or not len(state):
        found = f"shapes {state.shape} and {action.shape}"
        expected = f"the same shape [T, joints] of {STATE} and {ACTION}"
        raise InputError.at(str(file), found, expected)
    return state, action
