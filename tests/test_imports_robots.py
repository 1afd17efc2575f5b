"""Data sets of robots become readings: LeRobot, ALOHA; written by the libraries that write them."""

from __future__ import annotations

import json
import os
import subprocess
import tomllib
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import rsicalib
from rsicalib import InputError
from rsicalib.imports.teleop import ticks

JOINTS = ("shoulder_pan", "shoulder_lift", "elbow_flex", "wrist_flex", "wrist_roll", "gripper")
RANGES = {
    "leader": (2612, 2446, 2219, 2339, 3811, 1243),
    "follower": (2549, 2303, 2205, 2287, 3835, 1484),
}
LAG = 5
SHARED = Path(__file__).parents[2] / "shared" / "data" / "so101"


def percent(step: np.ndarray, ranges: tuple[int, ...]) -> np.ndarray:
    """What LeRobot writes of encoder steps: bounded, in percent of the range, single precision."""
    share = np.clip(step / np.array(ranges), 0.0, 1.0)
    full = np.array([200.0] * 5 + [100.0])
    return (share * full - np.array([100.0] * 5 + [0.0])).astype(np.float32)


def teleoperated(rows: int, seed: int) -> tuple[np.ndarray, np.ndarray]:
    """Leader and follower, `LAG` rows behind, shape (rows, 6)."""
    rng = np.random.default_rng(seed)
    t = np.arange(rows + LAG)[:, None] / 30.0
    wave = 0.5 + 0.3 * np.sin(t * rng.uniform(0.5, 2.0, 6) + rng.uniform(0.0, 6.0, 6))
    wave[:, 2] += 0.3  # the elbow runs into the end of its range
    leader = percent(np.rint(wave[LAG:] * RANGES["leader"]), RANGES["leader"])
    follower = percent(np.rint(np.clip(wave[:-LAG], 0, 1) * RANGES["follower"]), RANGES["follower"])
    return leader, follower


def dataset(root: Path, version: str, names: list[str], episodes: int = 2, rows: int = 300) -> Path:
    """A data set of LeRobot, by pyarrow, which LeRobot itself writes with."""
    pyarrow = pytest.importorskip("pyarrow")
    parquet = pytest.importorskip("pyarrow.parquet")
    three = version.startswith("v3")
    path = "data/chunk-{chunk_index:03d}/file-{file_index:03d}.parquet"
    if not three:
        path = "data/chunk-{episode_chunk:03d}/episode_{episode_index:06d}.parquet"
    feature = {"dtype": "float32", "shape": [len(names)], "names": names}
    info = {"codebase_version": version, "robot_type": "so101_follower", "fps": 30}
    info |= {"total_episodes": episodes, "total_frames": episodes * rows, "chunks_size": 1000}
    info |= {"data_path": path, "features": {"action": feature, "observation.state": feature}}
    (root / "meta").mkdir(parents=True)
    (root / "meta" / "info.json").write_text(json.dumps(info, indent=4))
    tables = []
    for episode in range(episodes):
        leader, follower = teleoperated(rows, episode)
        single = pyarrow.list_(pyarrow.float32())
        tables.append(
            pyarrow.table(
                {
                    "action": pyarrow.array(list(leader), type=single),
                    "observation.state": pyarrow.array(list(follower), type=single),
                    "timestamp": np.arange(rows, dtype=np.float32) / np.float32(30),
                    "frame_index": np.arange(rows),
                    "episode_index": np.full(rows, episode),
                    "index": episode * rows + np.arange(rows),
                }
            )
        )
    lengths = [{"episode_index": e, "tasks": ["pick"], "length": rows} for e in range(episodes)]
    folder = root / "data" / "chunk-000"
    folder.mkdir(parents=True)
    if three:
        parquet.write_table(pyarrow.concat_tables(tables), folder / "file-000.parquet")
        meta = root / "meta" / "episodes" / "chunk-000"
        meta.mkdir(parents=True)
        parquet.write_table(pyarrow.Table.from_pylist(lengths), meta / "file-000.parquet")
    else:
        for episode, table in enumerate(tables):
            parquet.write_table(table, folder / f"episode_{episode:06d}.parquet")
        text = "".join(json.dumps(row) + "\n" for row in lengths)
        (root / "meta" / "episodes.jsonl").write_text(text)
    return root


FORMS = {
    "v2.1": [f"main_{joint}" for joint in JOINTS],
    "v3.0": [f"{joint}.pos" for joint in JOINTS],
}


@pytest.mark.parametrize("version", FORMS)
def test_a_data_set_of_a_leader_and_its_follower_becomes_sessions(
    version: str, tmp_path: Path
) -> None:
    root = dataset(tmp_path / "set", version, FORMS[version])
    log = rsicalib.import_log(root)
    assert [session.name for session in log.sessions] == ["episode 0", "episode 1"]
    leader, follower = teleoperated(300, 1)
    inside = np.all(
        np.abs(np.hstack([leader, follower])[:, [0, 1, 2, 3, 4, 6, 7, 8, 9, 10]]) < 100, axis=1
    )
    columns = log.sessions[1].columns
    assert np.array_equal(np.float32(columns["follower_wrist_roll"]), follower[inside, 4])
    assert np.array_equal(np.float32(columns["leader_elbow_flex"]), leader[inside, 2])
    # single precision is written as the decimals it has: 1/30, not 0.03333333507180214
    assert "0.033333335" in log.sessions[0].csv()
    mechanism = tomllib.loads(log.mechanism or "")
    assert [c["between"] for c in mechanism["closure"]] == [
        [f"leader_{joint}", f"follower_{joint}"] for joint in JOINTS[:-1]
    ], "a gripper closes on what it holds"
    assert all(c["range"] == [-100, 100] for c in mechanism["channel"])


def test_what_a_data_set_hides_is_said(tmp_path: Path) -> None:
    log = rsicalib.import_log(dataset(tmp_path / "set", "v3.0", FORMS["v3.0"]))
    said = " | ".join(log.findings)
    assert "leader_shoulder_lift 2446" in said and "follower_shoulder_lift 2303" in said
    assert "leader_elbow_flex is clamped at the end of its range in" in said
    assert f"the follower is {LAG} rows (0.17 s) behind the leader" in said


def test_ranges_of_a_calibration_file_are_compared_with_the_values(tmp_path: Path) -> None:
    root = dataset(tmp_path / "set", "v3.0", FORMS["v3.0"])
    path = tmp_path / "follower.json"
    entry = {"id": 1, "drive_mode": 0, "homing_offset": -1024, "range_min": 709, "range_max": 3012}
    path.write_text(json.dumps({"shoulder_lift": entry, "shoulder_pan": entry}))
    said = " | ".join(rsicalib.import_log(root, ranges=[path]).findings)
    assert "follower_shoulder_pan: the calibration file says 2303 ticks, the values 2549" in said
    assert "follower_shoulder_lift: the" not in said
    path.write_text(json.dumps({"shoulder_pan": {**entry, "range_max": 1.5}}))
    with pytest.raises(InputError, match=r"shoulder_pan.range_max: found 1.5, expected an integer"):
        rsicalib.import_log(root, ranges=[path])


def test_the_step_of_values_tells_the_ticks_of_their_range() -> None:
    rng = np.random.default_rng(0)
    for count in rng.integers(300, 4096, 20).tolist():
        some = rng.integers(1, count, 60)
        assert ticks(np.float32(some / count * 200 - 100).astype(float)) == count
    assert ticks(rng.uniform(-100, 100, 60)) is None, "values without a step tell nothing"


@pytest.mark.skipif(not SHARED.is_dir(), reason="the recordings of an arm are not beside this")
def test_a_real_arm_has_ranges_that_differ_by_what_is_known_of_them() -> None:
    data = np.genfromtxt(SHARED / "teleop_0.csv", delimiter=",", names=True)

    def count(name: str) -> int:
        return ticks(data[name]) or 0

    lift = count("leader_shoulder_lift") / count("follower_shoulder_lift")
    pan = count("leader_shoulder_pan") / count("follower_shoulder_pan")
    assert lift == pytest.approx(1.06, abs=0.005) and pan == pytest.approx(1.025, abs=0.0005)


def test_degrees_are_not_taken_for_percent(tmp_path: Path) -> None:
    parquet = pytest.importorskip("pyarrow.parquet")
    root = dataset(tmp_path / "set", "v2.1", FORMS["v2.1"], episodes=1)
    file = root / "data" / "chunk-000" / "episode_000000.parquet"
    table = parquet.read_table(file)
    steps = np.random.default_rng(3).integers(-1000, 1000, (300, 6))
    column = [row.tolist() for row in np.float32(steps * 360 / 4095)]
    for key in ("action", "observation.state"):
        table = table.set_column(table.schema.get_field_index(key), key, [column])
    parquet.write_table(table, file)
    log = rsicalib.import_log(root)
    assert any("taken as degrees" in finding for finding in log.findings)
    assert len(log.sessions[0]) == 300
    assert tomllib.loads(log.mechanism or "")["channel"][0]["unit"] == "deg"


def test_two_arms_in_one_vector_keep_their_sides(tmp_path: Path) -> None:
    names = [f"{side}_{joint}.pos" for side in ("left", "right") for joint in JOINTS[:3]]
    log = rsicalib.import_log(dataset(tmp_path / "set", "v3.0", names))
    assert "follower_right_elbow_flex" in log.sessions[0].columns


def broken(root: Path, name: str) -> None:
    info = root / "meta" / "info.json"
    text = info.read_text()
    match name:
        case "an old version":
            info.write_text(text.replace("v2.1", "v1.6"))
        case "no state":
            info.write_text(text.replace("observation.state", "observation.images"))
        case "a name twice":
            info.write_text(text.replace("main_gripper", "main_wrist_roll"))
        case "a lost file":
            (root / "data" / "chunk-000" / "episode_000001.parquet").unlink()
        case "a lost row":
            lines = (root / "meta" / "episodes.jsonl").read_text().replace("300", "301")
            (root / "meta" / "episodes.jsonl").write_text(lines)
        case "a lost joint":
            info.write_text(text.replace('"main_gripper"', '"main_gripper", "main_seventh"'))
        case "cut":
            info.write_text(text[:200])


REFUSED = {
    "an old version": "codebase_version: found 'v1.6', expected v2.0, v2.1 or v3.0",
    "no state": "observation.state: found no such feature",
    "a name twice": "expected a name for each joint, each once",
    "a lost file": "episode_000001.parquet: found",
    "a lost row": "episode 0: found 300 rows, expected 301 rows",
    "a lost joint": "row 1, observation.state: found 6 numbers, expected 7",
    "cut": "info.json, line",
}


@pytest.mark.parametrize("name", REFUSED)
def test_a_data_set_that_is_not_whole_is_refused(name: str, tmp_path: Path) -> None:
    root = dataset(tmp_path / "set", "v2.1", FORMS["v2.1"])
    broken(root, name)
    with pytest.raises(InputError, match=REFUSED[name]):
        rsicalib.import_log(root)


# ------------------------------------------------------------------ ALOHA


def episode(path: Path, **more: Any) -> tuple[np.ndarray, np.ndarray]:
    """An episode as ALOHA records it: compressed, in chunks, with attributes."""
    h5py = pytest.importorskip("h5py", reason="the extra hdf5 is not installed")
    rng = np.random.default_rng(0)
    action = np.cumsum(rng.normal(0.0, 0.01, (400, 14)), axis=0)
    qpos = np.roll(action, 2, axis=0).astype(np.float32)
    with h5py.File(path, "w", rdcc_nbytes=1024**2 * 2) as root:
        root.attrs["sim"] = False
        group = root.create_group("observations")
        group.create_dataset("qpos", data=qpos, chunks=(100, 14), compression="gzip")
        group.create_dataset("qvel", data=np.zeros((400, 14)))
        root.create_dataset("action", data=action, **more)
    return qpos, action


def test_an_episode_of_aloha_becomes_a_leader_and_its_follower(tmp_path: Path) -> None:
    path = tmp_path / "episode_0.hdf5"
    qpos, action = episode(path, chunks=True, compression="lzf")
    log = rsicalib.import_log(path, rate=50)
    columns = log.sessions[0].columns
    assert np.array_equal(columns["follower_right_elbow"], qpos[:, 9].astype(float))
    assert np.array_equal(columns["leader_left_waist"], action[:, 0])
    assert columns["time_s"][1] == 0.02
    mechanism = tomllib.loads(log.mechanism or "")
    assert len(mechanism["closure"]) == 12 and mechanism["channel"][0]["unit"] == "rad"


def test_an_episode_without_positions_is_refused_with_what_it_has(tmp_path: Path) -> None:
    h5py = pytest.importorskip("h5py", reason="the extra hdf5 is not installed")
    path = tmp_path / "episode_0.hdf5"
    with h5py.File(path, "w") as root:
        root.create_dataset("qpos", data=np.zeros((3, 14)))
    with pytest.raises(InputError, match=r"/observations/qpos: found no such.*It has: qpos"):
        rsicalib.import_log(path)
    episode(path)
    with h5py.File(path, "a") as root:
        root["action"][7, 3] = np.nan
    with pytest.raises(InputError, match="row 8, column leader_left_forearm_roll: found nan"):
        rsicalib.import_log(path)
    path.write_bytes(path.read_bytes()[:100])
    with pytest.raises(InputError, match="expected an HDF5 file"):
        rsicalib.import_log(path)


def test_a_library_that_is_not_there_is_named_with_its_extra(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    path = tmp_path / "episode_0.hdf5"
    path.write_bytes(b"\x89HDF\r\n\x1a\n")
    monkeypatch.setitem(__import__("sys").modules, "h5py", None)
    words = r"no library 'h5py' for an HDF5.*pip install 'rsicalib\[hdf5\]'"
    with pytest.raises(InputError, match=words):
        rsicalib.import_log(path)


def test_a_data_set_that_lerobot_itself_wrote_is_read(tmp_path: Path) -> None:
    python = os.environ.get("RSICALIB_LEROBOT")
    if not python:
        pytest.skip("RSICALIB_LEROBOT does not name a Python that has lerobot")
    program = Path(__file__).parent / "machines" / "by_lerobot.py"
    subprocess.run([python, program, tmp_path / "pick"], check=True)
    log = rsicalib.import_log(tmp_path / "pick")
    assert [len(session) for session in log.sessions] == [300, 300]
    elbow = ["leader_elbow_flex", "follower_elbow_flex"]
    assert set(elbow) <= set(log.sessions[0].columns)
    assert any("2600" in note for note in log.findings), "its steps are told by the values"
    assert any("4 rows" in note for note in log.findings)
