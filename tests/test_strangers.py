"""Files of strangers' shape: read without a word of ours, or refused with what to do."""

from __future__ import annotations

from pathlib import Path

import pytest

import rsicalib
from rsicalib import InputError
from tests.strangers import Made, bags, datasets, hdf5, klipper, maslow, tables

GROUPS: dict[str, dict[str, Made]] = {
    "maslow": maslow.FILES,
    "klipper": klipper.FILES,
    "bags": bags.FILES,
    "datasets": datasets.FILES,
    "hdf5": hdf5.FILES,
    "tables": tables.FILES,
}
ALL = [(group, name) for group, files in GROUPS.items() for name in files]


@pytest.mark.parametrize(("group", "name"), ALL, ids=" ".join)
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
    whole = rsicalib.import_log(bags.mcap(tmp_path / "bag.mcap", bags.STREAM), hold=0).sessions[0]
    for name in names:
        found = rsicalib.import_log(bags.FILES[name][0](tmp_path / "other"), hold=0).sessions[0]
        for column in ("time_s", "elbow", "shoulder", "wrist"):
            assert list(found.columns[column]) == list(whole.columns[column]), name


MACHINES = {
    "robot.urdf": (
        b'<?xml version="1.0"?>\n<robot name="r"><link name="b"/></robot>',
        "a [[chain]]",
    ),
    "robot.urdf.xacro": (b'<robot name="r" xmlns:xacro="x"/>', "xacro "),
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
