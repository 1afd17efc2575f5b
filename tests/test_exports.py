"""Results in the words of controllers and robots: read again, they give what the result gives."""

from __future__ import annotations

import json
import subprocess
import tomllib
from dataclasses import replace
from pathlib import Path
from typing import Any
from xml.etree import ElementTree

import numpy as np
import pytest

import rsicalib
from rsicalib import InputError, Trace
from rsicalib.exports.coordinates import coordinates
from rsicalib.exports.opening import export_result
from tests.commands import run_text

DEMO = rsicalib.DEMO / "readings.csv"


@pytest.fixture(scope="module")
def traced() -> Trace:
    """Offsets, gains, and a curved sensor a22."""
    return rsicalib.trace(DEMO, rest=rsicalib.DEMO / "rest.csv")


def test_coordinates_are_those_of_line_and_curve(traced: Trace) -> None:
    readings = rsicalib.load_readings(DEMO)
    found = coordinates(readings, rsicalib.load_mechanism("rsi"), traced)
    values = {(p.term, p.target): p.value for p in traced.parameters}
    for k, name in enumerate(readings.channels):
        line = values["offset", name] + values["gain", name] * readings.values[:, k]
        if name != "a22":
            # offsets of some 3 rad, and counts of thousands times gains: rounding
            assert np.abs(found[:, k] - line).max() < 1e-12
        else:
            curve = found[:, k] - line
            square = np.polyfit(readings.values[:, k], curve, 2)
            assert np.abs(curve).max() > 1e-3
            assert np.abs(np.polyval(square, readings.values[:, k]) - curve).max() < 1e-9


def test_coordinates_of_an_eccentric_sensor_are_those_of_its_formula() -> None:
    terms = ["offset", "gain", "once_per_turn@a22", "crosstalk@a33:a32"]
    found = rsicalib.calibrate(DEMO, rest=rsicalib.DEMO / "rest.csv", terms=terms)
    readings, mechanism = rsicalib.load_readings(DEMO), rsicalib.load_mechanism("rsi")
    values = {(p.term, p.target, p.name): p.value for p in found.parameters}
    channel, count = mechanism.channels[4], readings.values[:, 4]
    low, high = channel.range
    phi = channel.gain * (count - (low + high) / 2)  # nominal, from the middle of its range
    wanted = values["offset", "a22", "offset"] + values["gain", "a22", "gain"] * count
    wanted += values["once_per_turn", "a22", "a"] * np.sin(phi)
    wanted += values["once_per_turn", "a22", "b"] * np.cos(phi)
    # the sine of the core is a polynomial, right to 1e-15; offsets of some 3 rad
    assert np.abs(coordinates(readings, mechanism, found)[:, 4] - wanted).max() < 1e-12
    (text,) = export_result(found, "c").values()
    assert "not in here" not in str(text)
    (moved,) = [line for line in str(text).splitlines() if "Other channels at their mean" in line]
    size = float(moved.split("move it by ")[1].split()[0])
    step = values["crosstalk", "a33", "share"] * values["gain", "a33", "gain"]
    assert found.reference is not None
    centre = found.reference.centre[7]  # of a32, which reads 0 to 4095; two digits are written
    assert size == pytest.approx(abs(step) * max(centre, 4095 - centre), rel=0.05)


def test_what_no_reading_tells_alone_is_not_in_the_header() -> None:
    terms = ["offset", "gain", "hysteresis@a22", "temperature_gain@a22"]
    found = rsicalib.calibrate(DEMO, rest=rsicalib.DEMO / "rest.csv", terms=terms)
    (text,) = export_result(found, "c").values()
    left = [line for line in str(text).splitlines() if "not in here" in line]
    assert [line.split("not in here: ")[1].split()[0] for line in left] == terms[2:]


def test_a_header_of_c_gives_the_coordinates_within_what_it_states(
    traced: Trace, tmp_path: Path
) -> None:
    (text,) = export_result(traced, "c").values()
    (tmp_path / "rsicalib.h").write_text(str(text))
    readings = rsicalib.load_readings(DEMO)
    calls = "".join(
        f'    scanf("%lf", &a); printf("%.17g ", {name}_coordinate(a));\n'
        for name in readings.channels
    )
    source = tmp_path / "main.c"
    source.write_text(
        '#include <stdio.h>\n#include "rsicalib.h"\n'
        f"int main(void) {{ double a; for (int i = 0; i < {len(readings)}; ++i) {{\n{calls}"
        '    printf("\\n"); } return 0; }\n'
    )
    program = tmp_path / "main"
    try:
        subprocess.run(
            ["cc", "-std=c99", "-Wall", "-Wno-unused-result", "-Werror", "-o", program, source],
            check=True,
        )
    except FileNotFoundError:
        pytest.skip("no C compiler")
    lines = "\n".join(" ".join(map(repr, row)) for row in readings.values.tolist())
    done = subprocess.run([program], input=lines, capture_output=True, text=True, check=True)
    found = np.array([line.split() for line in done.stdout.splitlines()], dtype=float)
    wanted = coordinates(readings, rsicalib.load_mechanism("rsi"), traced)
    stated = [
        float(line.split("within ")[1].split()[0])
        for line in str(text).splitlines()
        if "within" in line
    ]
    assert len(stated) == 9
    # the statement has two digits
    assert (np.abs(found - wanted).max(axis=0) <= 1.05 * np.array(stated) + 1e-12).all()


def test_corrected_readings_are_read_again_and_give_the_same_poses(
    traced: Trace, tmp_path: Path
) -> None:
    lines = rsicalib.calibrate(DEMO, rest=rsicalib.DEMO / "rest.csv")
    # The weight of a reading in a pose is that of a straight line: where a sensor is curved, it
    # differs by some percent, and the pose by as much of what noise of 1e-3 in does to it.
    for found, most in ((lines, 1e-9), (traced, 1e-4)):
        for name, text in export_result(found, "csv", readings=DEMO).items():
            (tmp_path / name).write_text(str(text))
        again = rsicalib.forward(tmp_path / "corrected.csv", tmp_path / "corrected.toml")
        assert np.abs(again - rsicalib.forward(DEMO, calibration=found)).max() < most


def test_a_corrected_bag_is_read_again_by_another_library(traced: Trace, tmp_path: Path) -> None:
    pytest.importorskip("rosbags", reason="the extra ros is not installed")
    reader = pytest.importorskip("mcap_ros2.reader", reason="mcap-ros2-support is not installed")
    files = export_result(traced, "mcap", readings=DEMO)
    assert {*files} == {"corrected.mcap", "corrected.toml"}
    data = files["corrected.mcap"]
    path = tmp_path / "corrected.mcap"
    path.write_bytes(data if isinstance(data, bytes) else b"")
    wanted = coordinates(rsicalib.load_readings(DEMO), rsicalib.load_mechanism("rsi"), traced)
    messages = [m.ros_msg for m in reader.read_ros2_messages(str(path), ["/joint_states"])]
    assert np.array_equal([m.position for m in messages], wanted)
    assert list(messages[0].name) == list(rsicalib.load_readings(DEMO).channels)
    log = rsicalib.import_log(path, hold=0)
    assert np.array_equal(log.sessions[0].columns["a22"], wanted[:, 4])


def test_a_bag_has_the_times_of_the_readings_and_no_others(traced: Trace) -> None:
    pytest.importorskip("rosbags", reason="the extra ros is not installed")
    whole = rsicalib.load_readings(DEMO)
    for times, found in ((None, "no such column"), (np.arange(len(whole)) - 5.0, "-5 in sample 1")):
        with pytest.raises(InputError, match=f"time_s: found {found}, expected the time of each"):
            export_result(traced, "mcap", readings=replace(whole, time_s=times))


def test_parameters_of_ros_2_are_read_by_a_library_of_yaml(traced: Trace) -> None:
    yaml = pytest.importorskip("ruamel.yaml", reason="no library of YAML is installed")
    (text,) = export_result(traced, "ros2").values()
    found = yaml.YAML(typ="safe").load(str(text))["/**"]["ros__parameters"]["calibration"]
    values = {(p.term, p.target): p.value for p in traced.parameters}
    for name in found["joint_names"]:
        assert found["joints"][name]["gain"] == values["gain", name]
        assert found["joints"][name]["offset"] == values["offset", name]
        assert found["joints"][name]["unit"] == "rad"
    assert "curvature@a22 has no place" in str(text)


# ------------------------------------------------------------------ machines


def result_of(mechanism: dict[str, Any], parameters: list[dict[str, Any]]) -> rsicalib.Calibration:
    """A result as a file would hold it."""
    names = [channel["name"] for channel in mechanism["channel"]]
    centre = [0.0 for _ in names]
    document = {
        "format": "rsicalib.calibration/1",
        "version": "0.1.0",
        "mechanism": mechanism["name"],
        "length_unit": mechanism["length_unit"],
        "readings": {"poses": 1, "samples": 1, "sha256": "0"},
        "noise": {"source": "declared", "sigma": dict.fromkeys(names, 1.0)}
        | {"dof": None, "correlation": None},
        "verdict": "adequate",
        "fit": {"chi2": 1.0, "dof": 1, "p_value": 0.5, "rms_misclosure": 0.0},
        "parameters": [{"sd": 0.01, "unit": "", **p} for p in parameters],
        "covariance": (1e-4 * np.eye(len(parameters))).tolist(),
        "termination": "converged",
        "reference": {"centre": centre, "span": [[0.0, 1.0]] * len(names), "temperature": None},
    }
    return rsicalib.Calibration.made(document)


ARMS = """\
name = "{name}"
length_unit = "m"
channel = [
  {{name = "leader_elbow", unit = "percent", gain = 1.0, offset = 0.0}},
  {{name = "follower_elbow", unit = "percent", gain = 1.0, offset = 0.0}},
]
chain = [
  {{name = "l", dh = [{{channel = "leader_elbow"}}]}},
  {{name = "f", dh = [{{channel = "follower_elbow"}}]}},
]
point = [
  {{name = "l", chain = "l", at = [1.0, 0.0, 0.0]}},
  {{name = "f", chain = "f", at = [1.0, 0.0, 0.0]}},
]
closure = [{{name = "elbow", kind = "touch", between = ["l", "f"]}}]
"""


def test_a_follower_gets_the_range_under_which_it_agrees_with_its_leader(tmp_path: Path) -> None:
    mechanism = rsicalib.load_mechanism(ARMS.format(name="arms"))
    # its leader is at 1.04 times its percent, and 2 percent further
    found = result_of(
        mechanism.to_dict(),
        [
            {"term": "gain", "target": "follower_elbow", "name": "gain", "value": 1.04},
            {"term": "offset", "target": "follower_elbow", "name": "offset", "value": 2.0},
        ],
    )
    entry = {"id": 3, "drive_mode": 0, "homing_offset": -12, "range_min": 900, "range_max": 3100}
    base = tmp_path / "follower.json"
    base.write_text(json.dumps({"elbow": entry, "gripper": entry}))
    files = export_result(found, "lerobot", mechanism, base=str(base))
    made = json.loads(str(files["follower.json"]))
    assert made["gripper"] == entry and made["elbow"]["homing_offset"] == -12
    ticks = np.arange(1000, 3000)
    low, high = made["elbow"]["range_min"], made["elbow"]["range_max"]
    new = (ticks - low) / (high - low) * 200 - 100  # as LeRobot normalises
    old = (ticks - 900) / 2200 * 200 - 100
    # two ends that are rounded to whole steps of a range of some 2100
    assert np.abs(new - (1.04 * old + 2.0)).max() < 200 / 2100
    with pytest.raises(InputError, match="expected the calibration file of the follower"):
        export_result(found, "lerobot", mechanism)
    base.write_text(json.dumps({"wrist": entry}))
    with pytest.raises(InputError, match="found the joints wrist"):
        export_result(found, "lerobot", mechanism, base=str(base))


def test_a_follower_in_degrees_gets_the_middle_under_which_it_agrees(tmp_path: Path) -> None:
    mechanism = rsicalib.load_mechanism(ARMS.replace("percent", "deg").format(name="arms"))
    parameters = [("gain", np.deg2rad(1.02)), ("offset", np.deg2rad(7.0))]
    found = result_of(
        mechanism.to_dict(),
        [{"term": n, "target": "follower_elbow", "name": n, "value": v} for n, v in parameters],
    )
    entry = {"id": 3, "drive_mode": 0, "homing_offset": -12, "range_min": 60, "range_max": 3100}
    base = tmp_path / "follower.json"
    base.write_text(json.dumps({"elbow": entry}))
    files = export_result(found, "lerobot", mechanism, base=str(base))
    made = json.loads(str(files["follower.json"]))["elbow"]

    def degrees(ticks: np.ndarray, of: dict[str, int]) -> np.ndarray:  # as LeRobot normalises
        return (ticks - (of["range_min"] + of["range_max"]) / 2) * 360 / 4095

    ticks = np.arange(100, 3000)
    # two ends that are rounded to whole steps
    assert np.abs(degrees(ticks, made) - degrees(ticks, entry) - 7.0).max() <= 360 / 4095
    assert "elbow turns 1.02 degrees for each it reads" in str(files["notes.txt"])
    assert f"elbow: {60 - 80} to {3100 - 80} is beyond" in str(files["notes.txt"])


def test_a_kind_that_does_not_suit_the_mechanism_is_refused(traced: Trace) -> None:
    for to, expected in {
        "maslow": "expected a sled on four belts",
        "klipper": "expected a delta printer",
        "urdf": "expected a mechanism file with a chain from URDF",
        "csv": "expected those that are to be corrected",
        "marlin": "to: found 'marlin', expected one of toml",
    }.items():
        with pytest.raises(InputError, match=expected):
            export_result(traced, to)


def test_the_command_writes_files_and_writes_them_again(traced: Trace, tmp_path: Path) -> None:
    traced.save(tmp_path / "result.json")
    words = ["export", str(tmp_path / "result.json"), "--to", "csv", "--readings", str(DEMO)]
    refused = run_text(*words)  # a table and a mechanism in one stream would be neither
    assert refused.returncode == 2 and not refused.stdout
    assert "expected a folder for corrected.csv, corrected.toml (--out)" in refused.stderr
    for _ in range(2):
        done = run_text(*words, "--out", tmp_path / "out")
        assert done.returncode == 0, done.stderr
    found = {path.name for path in (tmp_path / "out").iterdir()}
    assert found == {"corrected.csv", "corrected.toml", "export.json"}


def without(text: str, *options: str) -> str:
    """A configuration without some options, as the block asks for."""
    lines = text.splitlines(keepends=True)
    return "".join(line for line in lines if not line.startswith(options))


def test_the_geometry_of_a_printer_comes_back_from_its_configuration(tmp_path: Path) -> None:
    from tests.test_imports import PRINTER, probes

    path = tmp_path / "printer.cfg"
    path.write_text(PRINTER.replace("#*# angle = 211.5\n", "") + probes(9))
    values = tomllib.loads(rsicalib.import_log(path).mechanism or "")
    del values["plane"]  # the towers and arms are what is written
    values["point"][-1] = {"name": "nozzle", "at": [0.0, 0.0, 0.0]}
    values["closure"].pop()
    mechanism = rsicalib.load_mechanism(values)
    found = result_of(
        mechanism.to_dict(),
        [
            {"term": "offset", "target": "a", "name": "offset", "value": 626.9},
            {"term": "offset", "target": "b", "name": "offset", "value": 625.7},
            {"term": "base_position", "target": "tower b", "name": "x", "value": 0.31},
            {"term": "base_position", "target": "tower b", "name": "y", "value": -0.2},
            {"term": "distance", "target": "arm c", "name": "d", "value": 0.45},
        ],
    )
    (block,) = export_result(found, "klipper", mechanism).values()
    again = tmp_path / "again.cfg"
    body = without(PRINTER.split("#*# <")[0], "delta_radius", "position_endstop", "arm_length")
    again.write_text(f"{body}{block}#*# [delta_calibrate]\n{probes(9)}")
    made = tomllib.loads(rsicalib.import_log(again).mechanism or "")

    def geometry(document: dict[str, Any]) -> np.ndarray:
        """Heights at the endstop, arms, and distances between the towers: what no origin moves."""
        feet = [_foot(chain["dh"]) for chain in document["chain"]]
        sides = [np.linalg.norm(np.subtract(feet[k], feet[k - 1])) for k in range(3)]
        heights = [channel["offset"] for channel in document["channel"]]
        return np.array([*heights, *(c["value"] for c in document["closure"][:3]), *sides])

    calibrated = rsicalib.load_mechanism(
        str(export_result(found, "toml", mechanism)["calibrated.toml"])
    ).to_dict()
    wanted = geometry(calibrated)
    assert np.abs(wanted - geometry(values)).max() > 0.3, "something was calibrated"
    # six decimals of angles in degrees, at a radius of 172 mm
    assert np.abs(geometry(made) - wanted).max() < 5e-6


def _foot(rows: list[dict[str, Any]]) -> np.ndarray:
    """Where a tower stands, in plain matrix products."""
    out = np.eye(4)
    for row in rows:
        for matrix in oracle_row(row):
            out = out @ matrix
    return out[:2, 3]


def oracle_row(row: dict[str, Any]) -> list[np.ndarray]:
    cos, sin = np.cos(row.get("theta", 0.0)), np.sin(row.get("theta", 0.0))
    turn = np.array([[cos, -sin, 0, 0], [sin, cos, 0, 0], [0, 0, 1, 0], [0, 0, 0, 1.0]])
    shift = np.eye(4)
    shift[:3, 3] = [row.get("a", 0.0), 0.0, row.get("d", 0.0)]
    more = np.eye(4)
    more[:3, 3] = row.get("xyz", [0.0, 0.0, 0.0])
    assert not row.get("alpha") and not any(row.get("rpy", [0, 0, 0])), "upright towers"
    return [turn, shift, more]


# ------------------------------------------------------------------ MuJoCo


def arms(tmp_path: Path) -> tuple[Any, rsicalib.Calibration]:
    """Two arms from a model of MuJoCo, and a result with offsets, geometry and a ratio."""
    from tests.test_mjcf import CLOSED, model

    follows = '<joint joint1="r2" joint2="r1" polycoef="0.1 -0.5 0 0 0"/>'
    path = tmp_path / "arms.xml"
    path.write_text(model(CLOSED["connect of sites"] + follows))
    mechanism = rsicalib.load_mechanism(path)
    found = result_of(
        mechanism.to_dict(),
        [
            {"term": "offset", "target": "l2", "name": "offset", "value": 0.03},
            {"term": "offset", "target": "r1", "name": "offset", "value": -0.02},
            {"term": "link_length", "target": "left lower/3", "name": "a", "value": 0.004},
            {"term": "base_position", "target": "right lower", "name": "x", "value": 0.01},
        ],
    )
    return mechanism, found


def test_a_model_of_mujoco_gives_the_points_of_the_calibration(tmp_path: Path) -> None:
    mechanism, found = arms(tmp_path)
    (text,) = export_result(found, "mjcf", mechanism).values()
    path = tmp_path / "calibrated.xml"
    path.write_text(str(text))
    again = rsicalib.load_mechanism(path)
    names = [channel.name for channel in mechanism.channels]
    assert {channel.name for channel in again.channels} == set(names)
    values = np.random.default_rng(0).uniform(-0.4, 0.4, (5, len(names)))
    readings = dict(zip(names, values.T, strict=True))
    wanted = rsicalib.forward(readings, mechanism, found)
    # every number is written with all its digits: rounding
    assert np.abs(rsicalib.forward(readings, again) - wanted).max() < 1e-12
    mujoco = pytest.importorskip("mujoco", reason="MuJoCo, the witness, is not installed")
    there = mujoco.MjModel.from_xml_string(str(text))
    data = mujoco.MjData(there)
    for row, points in zip(values, wanted, strict=True):
        for name, value in zip(names, row, strict=True):
            data.joint(name).qpos[0] = value
        data.joint("right lower 3 follows").qpos[0] = -0.5 * row[names.index("r1")]
        mujoco.mj_kinematics(there, data)
        sites = [data.site(k).xpos for k in range(there.nsite)]
        assert np.abs(np.ravel(sites) - points).max() < 1e-9


def test_what_a_model_of_mujoco_cannot_hold_is_said(traced: Trace) -> None:
    (text,) = export_result(traced, "mjcf").values()
    assert "not in here: closure wrist1-wrist2: distance" in str(text)
    assert "curvature@a22 has no place" in str(text)
    assert "times the reading of a11" in str(text)


def joints_of(text: str) -> dict[str, dict[str, str]]:
    """Attributes of the joints of a model, in bodies and in equalities, by name or first joint."""
    root = ElementTree.fromstring(text)
    return {j.get("name") or f"={j.get('joint1')}": dict(j.attrib) for j in root.iter("joint")}


def test_ranges_and_equal_joints_of_a_model_are_of_readings() -> None:
    """A joint reads `q`, its coordinate is `q + offset`: ends and equalities are of coordinates."""
    document = {
        "name": "pair",
        "length_unit": "m",
        "channel": [
            {"name": "q1", "unit": "rad", "gain": 1.0, "offset": 0.0, "limits": [-1.0, 1.0]},
            {"name": "q2", "unit": "rad", "gain": 1.0, "offset": 0.0, "limits": [0.5, 2.0]},
        ],
        "chain": [
            {"name": "one", "dh": [{"channel": "q1", "a": 1.0}]},
            {"name": "two", "dh": [{"channel": "q2", "a": 1.0}]},
        ],
        "point": [
            {"name": "tip", "chain": "one", "at": [0.0, 0.0, 0.0]},
            {"name": "end", "chain": "two", "at": [0.0, 0.0, 0.0]},
        ],
        "closure": [{"name": "same", "kind": "equal", "between": ["q1", "q2"], "noise": 0.001}],
    }
    offset = {"term": "offset", "target": "q2", "name": "offset", "value": 0.2}
    mechanism = rsicalib.load_mechanism(document)
    (text,) = export_result(result_of(document, [offset]), "mjcf", mechanism).values()
    joints = joints_of(str(text))
    ends = [float(end) for end in joints["q2"]["range"].split()]
    assert ends == pytest.approx([0.3, 1.8])
    # q1 = q2 + 0.2 where the coordinates are equal
    constants = [float(c) for c in joints["=q1"]["polycoef"].split()]
    assert constants == pytest.approx([0.2, 1.0, 0.0, 0.0, 0.0])


def test_motors_of_a_differential_have_joints_of_their_own() -> None:
    """Every joint that a model names is in it, and what an instrument sees stays out."""
    half = {"ratio": 0.5, "a": 0.0}
    document = {
        "name": "differential",
        "length_unit": "m",
        "channel": [
            {"name": "m1", "unit": "rad", "gain": 1.0, "offset": 0.0},
            {"name": "m2", "unit": "rad", "gain": 1.0, "offset": 0.0},
        ],
        "chain": [
            {
                "name": "wrist",
                "dh": [
                    {"channel": "m1", **half},
                    {"channel": "m2", **half, "alpha": 1.5707963267948966},
                    {"channel": "m1", **half},
                    {"channel": "m2", "ratio": -0.5, "a": 0.2},
                ],
            }
        ],
        "point": [
            {"name": "tip", "chain": "wrist", "at": [0.0, 0.0, 0.0]},
            {"name": "seen", "columns": ["x", "y", "z"]},
        ],
        "closure": [{"name": "probe", "kind": "touch", "between": ["tip", "seen"], "noise": 0.001}],
    }
    mechanism = rsicalib.load_mechanism(document)
    offset = {"term": "offset", "target": "m1", "name": "offset", "value": 0.0}
    (text,) = export_result(result_of(document, [offset]), "mjcf", mechanism).values()
    joints = joints_of(str(text))
    named = {joint["joint2"] for joint in joints.values() if "joint2" in joint}
    assert named == {"m1", "m2"} and named <= set(joints)
    assert "seen" not in {s.get("name") for s in ElementTree.fromstring(str(text)).iter("site")}
