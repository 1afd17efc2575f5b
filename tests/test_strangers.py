"""Files of strangers' shape: read without a word of ours, or refused with what to do."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import rsicalib
from rsicalib import InputError
from tests.strangers import Made, bags, datasets, hdf5, klipper, maslow, tables, written

GROUPS: dict[str, dict[str, Made]] = {
    "maslow": maslow.FILES,
    "klipper": klipper.FILES,
    "bags": bags.FILES,
    "datasets": datasets.FILES,
    "hdf5": hdf5.FILES,
    "tables": tables.FILES,
}
ALL = [(group, name) for group, files in GROUPS.items() for name in files]


@pytest.mark.parametrize(("group", "name"), ALL, ids=str)
def test_a_file_of_a_stranger_is_read_or_refused_with_what_to_do(
    group: str, name: str, tmp_path: Path
) -> None:
    if group == "bags":
        pytest.importorskip("rosbags", reason="the extra ros is not installed")
    made, options, outcome = GROUPS[group][name]
    path = made(tmp_path)
    if isinstance(outcome, str):
        with pytest.raises(InputError) as refused:
            rsicalib.import_log(path, **options)
        assert outcome in str(refused.value)
        assert path.name in str(refused.value), "the file is named"
        return
    rows, column = outcome
    session = rsicalib.import_log(path, **options).sessions[0]
    assert column in session.columns and (len(session) == rows or not rows)


def notes(path: Path, **options: Any) -> str:
    return " ".join(rsicalib.import_log(path, **options).findings)


def test_what_a_table_takes_for_granted_is_said(tmp_path: Path) -> None:
    rows = [f"{k * 20},{k % 7}" for k in range(40)]
    (tmp_path / "ms.csv").write_text(tables.lines("timestamp,elbow", rows))
    assert "rows are 20 s apart, more than the 0.5 s of a held pose" in notes(tmp_path / "ms.csv")
    (tmp_path / "twice.csv").write_text(
        tables.lines("time,elbow", [f"{k // 2 / 50},{k // 2 % 7}" for k in range(40)][:-1])
    )
    said = "19 rows have the time of the row before, first row 3 of the log; 19 have its readings"
    assert said in notes(tmp_path / "twice.csv", hold=0)


def test_velocities_of_a_data_set_are_said_and_left_out(tmp_path: Path) -> None:
    pytest.importorskip("pyarrow", reason="the extra parquet is not installed")
    names = [*(f"{joint}.pos" for joint in datasets.JOINTS[:4]), "x.vel", "y.vel"]
    path = datasets.whole("v3.0", datasets.named(names), rows=90)(tmp_path)
    assert "no positions, and not taken: x.vel, y.vel" in notes(path)
    columns = rsicalib.import_log(path).sessions[0].columns
    assert not [name for name in columns if name.endswith("vel")]


@pytest.mark.parametrize(
    ("column", "hint"), [("q1", "--channels q1=COLUMN"), ("at", "--labels at")]
)
def test_readings_under_other_names_are_refused_with_the_import(
    column: str, hint: str, tmp_path: Path
) -> None:
    mechanism = {"name": "arm", "length_unit": "m", "closure": []}
    mechanism["channel"] = [{"name": "q1", "unit": "rad", "gain": 1.0, "offset": 0.0}]
    mechanism["chain"] = [{"name": "arm", "dh": [{"channel": "q1", "a": 1.0}]}]
    mechanism["point"] = [{"name": "tip", "chain": "arm", "at": [0.0, 0.0, 0.0]}]
    mechanism["point"].append({"name": "cone", "unknown": ["at"]})
    mechanism["closure"] = [{"name": "in", "kind": "touch", "between": ["tip", "cone"]}]
    (tmp_path / "run.csv").write_text("time,elbow\n0,1\n" if column == "q1" else "q1\n1\n")
    with pytest.raises(InputError, match=hint):
        rsicalib.load_readings(tmp_path / "run.csv", mechanism)


def test_each_group_has_ten_files() -> None:
    assert all(len(files) >= 10 for files in GROUPS.values())


def test_klippy_log_has_the_geometry_of_its_last_configuration(tmp_path: Path) -> None:
    mechanism = rsicalib.import_log(
        klipper.FILES["klippy.log, the last configuration"][0](tmp_path)
    )
    tower = rsicalib.load_mechanism(mechanism.mechanism or "").channels[0]
    assert tower.offset == pytest.approx(332.99 + (340.0**2 - 172.0**2) ** 0.5)


def test_mcap_of_other_encodings_has_the_readings_of_the_bag(tmp_path: Path) -> None:
    pytest.importorskip("rosbags", reason="the extra ros is not installed")
    (tmp_path / "other").mkdir()
    names = ("MCAP with JSON", "MCAP with messages of ROS 1", "ros2 topic echo", "rostopic echo")
    names += ("a folder of Foxy, by sqlite3",)
    whole = rsicalib.import_log(bags.mcap(tmp_path / "bag.mcap", bags.STREAM), hold=0).sessions[0]
    for name in names:
        found = rsicalib.import_log(bags.FILES[name][0](tmp_path / "other"), hold=0).sessions[0]
        for column in ("time_s", "elbow", "shoulder", "wrist"):
            assert list(found.columns[column]) == list(whole.columns[column]), name


def test_parquet_of_polars_has_its_numbers() -> None:
    pytest.importorskip("pyarrow", reason="the extra parquet is not installed")
    log = rsicalib.import_log(written.HERE / "polars.parquet", hold=0)
    columns = log.sessions[0].columns
    assert list(columns) == ["time_s", *written.JOINTS]
    # microseconds, which the file has, in double precision
    assert np.abs(columns["time_s"] - np.arange(written.ROWS) / 50).max() < 1e-12
    for name, values in zip(written.JOINTS, written.angles().T, strict=True):
        assert np.array_equal(columns[name], values)


def test_a_data_set_whose_rows_duckdb_wrote_has_its_numbers(tmp_path: Path) -> None:
    pytest.importorskip("pyarrow", reason="the extra parquet is not installed")
    rows = tmp_path / "data" / "chunk-000" / "file-000.parquet"
    rows.parent.mkdir(parents=True)
    rows.write_bytes((written.HERE / "duckdb.parquet").read_bytes())
    feature = {"dtype": "float32", "shape": [3], "names": [f"{j}.pos" for j in written.JOINTS]}
    about = {"codebase_version": "v3.0", "fps": 30, "total_episodes": 2}
    about |= {"features": {"action": feature, "observation.state": feature}}
    (tmp_path / "meta").mkdir()
    (tmp_path / "meta" / "info.json").write_text(json.dumps(about))
    log = rsicalib.import_log(tmp_path)
    assert [len(session) for session in log.sessions] == [20, 20]
    for side, arm in enumerate(("leader", "follower")):
        for name, values in zip(written.JOINTS, written.percents(side).T, strict=True):
            read = [session.columns[f"{arm}_{name}"] for session in log.sessions]
            # single precision as its shortest decimals
            assert np.abs(np.concatenate(read) - values).max() < 1e-5


MACHINES = {
    "robot.urdf": (
        b'<?xml version="1.0"?>\n<robot name="r"><link name="b"/></robot>',
        "a [[chain]]",
    ),
    "plain.urdf": (
        b'<robot name="r" xmlns:xacro="x"><xacro:property name="a" value="1"/></robot>',
        "plain_plain.urdf",
    ),
    "robot.urdf.xacro": (
        b'<robot name="r" xmlns:xacro="x"><joint xacro:if="a"/></robot>',
        "xacro ",
    ),
    "declares.urdf": (
        b'<robot name="r" xmlns:xacro="x"><!-- <xacro:a/> --></robot>',
        "a [[chain]]",
    ),
    "world.sdf": (b'<?xml version="1.0"?><sdf version="1.7"/>', "Export it from its program"),
    "robot.usda": (b'#usda 1.0\ndef Xform "robot" {}\n', "Export it from its program"),
    "robot.usd": (b"PXR-USDC\x00\x00\x08", "Export it from its program"),
    "model.mjb": (b"\x01\x02\x00\x03", "mujoco.mj_saveLastXML"),
    "result.json": (b'{"format": "rsicalib.trace/1"}', "no mechanisms"),
}


@pytest.mark.parametrize("name", MACHINES)
def test_a_machine_in_the_words_of_others_is_refused_with_what_to_do(
    name: str, tmp_path: Path
) -> None:
    data, words = MACHINES[name]
    (tmp_path / name).write_bytes(data)
    with pytest.raises(InputError) as refused:
        rsicalib.load_mechanism(tmp_path / name)
    assert words in str(refused.value) and name in str(refused.value)
