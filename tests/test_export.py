"""A calibration as TOML, URDF and JSON: whichever is applied, the points are the same."""

from __future__ import annotations

import csv
import io
import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import rsicalib
from rsicalib import DEMO, Calibration, _core
from rsicalib.io.mechanisms import read_mechanism
from rsicalib.verbs import export
from rsicalib.work.job import Work
from tests import commands, cone, oracle
from tests.full import sized

# Readings that are drawn at will close no loop, and `forward` says so.
pytestmark = pytest.mark.filterwarnings("ignore::rsicalib.errors.OpenLoopsWarning")

READINGS, REST = DEMO / "readings.csv", DEMO / "rest.csv"
SAME = 1e-9

# A robot whose axes are not z, with a sensor that is not one to one, and a fixed joint at the tip.
ROBOT = """<?xml version="1.0"?>
<robot name="bent">
<link name="base"/> <link name="upper"><inertial><mass value="2"/>
  <origin xyz="0.1 0 0.2"/></inertial></link>
<link name="fore"/> <link name="wrist"/> <link name="ball"/>
<joint name="shoulder" type="revolute"> <parent link="base"/><child link="upper"/>
  <origin xyz="0 0 0.3" rpy="0.1 0 0"/><axis xyz="0 0 1"/><limit lower="-2" upper="2"/></joint>
<joint name="elbow" type="continuous"> <parent link="upper"/><child link="fore"/>
  <origin xyz="0.1 0 0.4"/><axis xyz="0 1 0"/></joint>
<joint name="reach" type="prismatic"> <parent link="fore"/><child link="wrist"/>
  <origin xyz="0.3 0 0" rpy="0 0.2 0"/><axis xyz="1 0 0.5"/><limit lower="0" upper="0.2"/></joint>
<joint name="tool" type="fixed"> <parent link="wrist"/><child link="ball"/>
  <origin xyz="0.05 0.02 0"/></joint>
</robot>
"""
MECHANISM = """
name = "bent"
length_unit = "m"
[[chain]]
name = "arm"
urdf = "robot.urdf"
base = "base"
tip = "ball"
channels = {shoulder = "q1", elbow = "q2", reach = "s"}
[[point]]
name = "ball"
chain = "arm"
at = [0, 0, 0]
[[point]]
name = "peg"
at = [0.6, 0.1, 0.2]
[[closure]]
name = "bar"
kind = "distance"
between = ["ball", "peg"]
value = 0.5
"""
GEOMETRY = {
    "link_frame": ("x", "y", "z", "rx", "ry", "rz"),
    "link_length": ("a",),
    "link_offset": ("d",),
    "joint_tilt": ("alpha", "beta"),
    "base_position": ("x", "y", "z"),
    "base_bearing": ("rz",),
    "base_tilt": ("rx", "ry"),
    "point_position": ("x", "y", "z"),
    "distance": ("d",),
}


def invented(mechanism: rsicalib.Mechanism, terms: list[str], seed: int = 0) -> Calibration:
    """A calibration with values and uncertainty for every parameter of these terms."""
    rng = np.random.default_rng(seed)
    targets = {t["id"]: t["targets"] for t in rsicalib.terms(mechanism)}
    channels = {c.name: c for c in mechanism.channels}
    parameters = []
    for term in terms:
        for target in targets[term]:
            for name in GEOMETRY.get(term, (term,)):
                value = rng.normal(0.0, 0.02)
                if term == "gain":
                    value = channels[target].gain * (1 + value)
                if term == "offset":
                    value = channels[target].offset + value
                parameters.append(
                    {"term": term, "target": target, "name": name, "value": value, "sd": 1e-3}
                    | {"unit": _core.units_of(mechanism, [((term, target, None), name)])[0][0]}
                )
    return Calibration.from_dict(
        {
            "version": "0",
            "mechanism": mechanism.name,
            "length_unit": mechanism.length_unit,
            "readings": {"poses": 1, "samples": 1, "sha256": ""},
            "noise": {"source": "misclosure of repeats", "dof": 9.0, "correlation": 0.0}
            | {"sigma": {c.name: 1e-5 / abs(c.gain) for c in mechanism.channels}},
            "verdict": "adequate",
            "parameters": parameters,
            "covariance": (1e-6 * np.eye(len(parameters))).tolist(),
            "reference": {
                "centre": rng.normal(0.0, 1.0, len(channels)).tolist(),
                "span": [[-9.0, 9.0]] * len(channels),
                "temperature": None,
            },
            "fit": {"chi2": 1.0, "dof": 1.0, "p_value": 0.5, "rms_misclosure": 1e-5},
        }
    )


@pytest.fixture
def bent(tmp_path: Path) -> tuple[Path, Path]:
    """A mechanism file and readings of it."""
    (tmp_path / "robot.urdf").write_text(ROBOT)
    (tmp_path / "bent.toml").write_text(MECHANISM)
    rng = np.random.default_rng(1)
    rows = np.column_stack([rng.uniform(-1, 1, (20, 2)), rng.uniform(0, 0.2, 20)])
    with (tmp_path / "readings.csv").open("w", newline="") as file:
        writer = csv.writer(file)
        writer.writerow(["q1", "q2", "s"])
        writer.writerows(rows.tolist())
    return tmp_path / "bent.toml", tmp_path / "readings.csv"


EVERY = ["offset", "gain", *GEOMETRY]


@pytest.mark.parametrize("terms", [[term] for term in EVERY] + [EVERY, EVERY[::-1]], ids=str)
def test_the_toml_gives_the_same_points(
    bent: tuple[Path, Path], terms: list[str], tmp_path: Path
) -> None:
    mechanism, readings = bent
    made = invented(rsicalib.load_mechanism(mechanism), terms)
    wanted = rsicalib.forward(readings, mechanism, made)
    (tmp_path / "calibrated.toml").write_text(rsicalib.export_toml(mechanism, made))
    found = rsicalib.forward(readings, tmp_path / "calibrated.toml")
    np.testing.assert_allclose(found, wanted, rtol=0, atol=SAME)
    if terms != ["distance"]:
        assert np.abs(wanted - rsicalib.forward(readings, mechanism)).max() > 1e-4


@pytest.mark.parametrize(
    "terms", [["offset"], ["point_position"], [t for t in EVERY if t != "gain"]]
)
def test_the_urdf_gives_the_same_points(
    bent: tuple[Path, Path], terms: list[str], tmp_path: Path
) -> None:
    mechanism, readings = bent
    made = invented(rsicalib.load_mechanism(mechanism), terms)
    wanted = rsicalib.forward(readings, mechanism, made)
    ((name, text),) = rsicalib.export_urdf(mechanism, made).items()
    (tmp_path / name).write_text(text)
    (tmp_path / "own.toml").write_text(MECHANISM.replace("robot.urdf", name))
    found = rsicalib.forward(readings, tmp_path / "own.toml")
    np.testing.assert_allclose(found, wanted, rtol=0, atol=SAME)


def test_the_rows_agree_with_plain_matrix_products(bent: tuple[Path, Path]) -> None:
    """Geometry of Denavit and Hartenberg stays such, and the oracle reads it."""
    mechanism = read_mechanism(Path(__file__).parents[1] / "examples" / "ball_bar.toml")
    loaded = rsicalib.Mechanism.from_dict(mechanism)
    made = invented(loaded, ["offset", "link_length", "link_offset"])
    angles = np.random.default_rng(0).uniform(-1, 1, (10, 6))
    readings = rsicalib.Readings.from_arrays(loaded, angles)
    found = export.calibrated(loaded, made).mechanism.to_dict()
    true = oracle.point(found, "ball", oracle.angles_of(*oracle.nominal(found), angles))
    np.testing.assert_allclose(rsicalib.forward(readings, loaded, made), true, atol=1e-9)


@pytest.mark.parametrize("terms", [["offset", "gain"], ["gain"], ["offset"]])
def test_platform_poses_are_the_same_too(terms: list[str], tmp_path: Path) -> None:
    whole = rsicalib.load_readings(READINGS)
    # Gains or offsets alone fit nothing, and many poses take long to tell.
    few = 12 if len(terms) == 2 else 4
    made = rsicalib.calibrate(whole.select(whole.pose <= few), rest=REST, terms=terms)
    wanted = rsicalib.forward(READINGS, "rsi", made)
    (tmp_path / "calibrated.toml").write_text(rsicalib.export_toml("rsi", made))
    found = rsicalib.forward(READINGS, tmp_path / "calibrated.toml")
    np.testing.assert_allclose(found, wanted, rtol=0, atol=SAME)


def test_what_a_mechanism_has_no_words_for_is_named() -> None:
    made = rsicalib.calibrate(READINGS, rest=REST, terms=["offset", "gain", "curvature@a22"])
    text = rsicalib.export_toml("rsi", made)
    assert "# curvature@a22 has no place" in text


def with_parameters(
    made: Calibration, *more: tuple[str, str, str | None, str, float]
) -> Calibration:
    """The same result with parameters of these terms, targets, places, names and values."""
    plain = made.to_dict()
    for term, target, place, name, value in more:
        entry = {"term": term, "target": target, "name": name, "value": value, "sd": 1e-4}
        [units] = _core.units_of(rsicalib.load_mechanism("rsi"), [((term, target, place), name)])
        plain["parameters"].append({**entry, "place": place, "unit": (units or ["in"])[0]})
    plain["covariance"] = np.diag([p["sd"] ** 2 for p in plain["parameters"]]).tolist()
    return Calibration.from_dict(plain)


OF_A_SESSION = (
    ("drift", "a22", None, "rate", 0.05),
    ("wander", "a13", None, "w1", 0.05),
    ("reference_drift", "all", None, "rate", 0.01),
    ("reference_wander", "all", None, "r1", 0.01),
    ("bad_reading", "a21", "17", "error", 100.0),
    ("unknown_point", "socket[at=1]", None, "x", 3.0),
)
"""Parameters that say nothing of any readings but those that they were found with."""


def test_what_stood_at_one_unknown_place_stands_where_it_was_found() -> None:
    """The cone of an arm, drawn elsewhere: the anchors of a sled are such points, too."""
    text = cone.mechanism(2e-5, 0.02).replace(
        'unknown = ["at"]', "at = [-400, -190, 100]\nunknown = []"
    )
    drawn = rsicalib.Mechanism.from_toml(text)
    found = rsicalib.calibrate(cone.session(3, poses=25, samples=2).table, drawn)
    made = rsicalib.Mechanism.from_toml(rsicalib.export_toml(drawn, found)).to_dict()
    (place,) = (point["at"] for point in made["point"] if point["name"] == "cone")
    wanted = [found["unknown_point", "cone", axis].value for axis in "xyz"]
    assert place == pytest.approx(wanted, abs=1e-9)
    # Joint 1 turns arm and cone together, and stays as drawn: the cone is where it is but for that.
    assert np.linalg.norm(place) == pytest.approx(np.linalg.norm(cone.CONE), abs=0.5)


@pytest.mark.parametrize("more", OF_A_SESSION, ids=lambda m: m[0])
def test_what_belongs_to_its_session_is_not_applied_to_another(more: Any) -> None:
    made = rsicalib.calibrate(READINGS, rest=REST, terms=["offset", "gain"])
    told = with_parameters(made, more)
    for readings in (DEMO / "check.csv", REST):  # the latter without any time
        wanted = rsicalib.forward(readings, "rsi", made)
        np.testing.assert_array_equal(rsicalib.forward(readings, "rsi", told), wanted)
    plain = with_parameters(made)
    sd = rsicalib.forward_sd(REST, "rsi", plain)
    np.testing.assert_allclose(rsicalib.forward_sd(REST, "rsi", told), sd, rtol=1e-9)
    assert not any(more[0] in line for line in rsicalib.export_toml("rsi", made).splitlines())


def test_a_slip_that_happened_has_happened_to_all_other_readings() -> None:
    made = rsicalib.calibrate(READINGS, rest=REST, terms=["offset", "gain"])
    slipped = ("slip", "a22", "17", "step", 0.03), ("slip", "a22", "30", "step", 0.01)
    told = with_parameters(made, *slipped)
    plain = made.to_dict()
    entry = next(p for p in plain["parameters"] if (p["term"], p["target"]) == ("offset", "a22"))
    entry["value"] += 0.04
    shifted = Calibration.from_dict(plain)
    for readings in (DEMO / "check.csv", REST):
        wanted = rsicalib.forward(readings, "rsi", shifted)
        found = rsicalib.forward(readings, "rsi", told)
        np.testing.assert_allclose(found, wanted, rtol=0, atol=SAME)
    exported = export.calibrated("rsi", told).mechanism
    assert exported == export.calibrated("rsi", shifted).mechanism


def test_the_next_calibration_takes_the_terms_that_outlast_their_session() -> None:
    made = rsicalib.calibrate(READINGS, rest=REST, terms=["offset", "gain", "crosstalk@a22:a21"])
    slip = ("slip", "a22", "17", "step", 0.03)
    told = with_parameters(made, *OF_A_SESSION, slip)
    job = Work("rsi", False, told, {})
    assert job.terms(None) == Work("rsi", False, made, {}).terms(None)
    assert "crosstalk@a22:a21" in (job.terms(None) or [])
    assert job.terms(["drift"]) == ["drift"]


def run(*words: str | Path, cwd: Path | None = None) -> str:
    done = commands.run_text(*words, cwd=cwd)
    assert done.returncode in (0, 3, 4), done.stderr
    return done.stdout


def table(text: str) -> tuple[list[str], np.ndarray[Any, Any]]:
    header, *rows = csv.reader(io.StringIO(text))
    return header, np.array(rows, dtype=float)


def test_the_command_writes_all_three_and_forward_takes_them(
    bent: tuple[Path, Path], tmp_path: Path
) -> None:
    mechanism, readings = bent
    out = tmp_path / "out"
    run("calibrate", readings, "--mechanism", mechanism, "--terms", "offset@q2,link_length@arm/3",
        "--out", out, "--quiet")  # fmt: skip
    assert {"result.json", "calibrated.toml", "calibrated.urdf"} <= {p.name for p in out.iterdir()}
    result = out / "result.json"
    given = run("forward", readings, "--mechanism", mechanism, "--calibration", result)
    names, wanted = table(given)
    assert names[:4] == ["pose", "ball.x", "ball.y", "ball.z"]
    assert names[4:] == ["sd_ball.x", "sd_ball.y", "sd_ball.z"]
    _, toml = table(run("forward", readings, "--mechanism", out / "calibrated.toml"))
    own = out / "own.toml"
    own.write_text(MECHANISM.replace("robot.urdf", "calibrated.urdf"))
    _, urdf = table(run("forward", readings, "--mechanism", own))
    np.testing.assert_allclose(toml, wanted[:, :4], atol=SAME)
    np.testing.assert_allclose(urdf, wanted[:, :4], atol=SAME)


def test_the_uncertainty_of_a_pose_is_that_of_many_calibrations(bent: tuple[Path, Path]) -> None:
    """Against a seeded Monte Carlo over the parameters: n draws know a deviation to 1 / √(2 n)."""
    draws = sized(250, 2000)
    path, readings = bent
    mechanism = rsicalib.load_mechanism(path)
    made = invented(mechanism, ["offset", "link_frame"])
    sd = rsicalib.forward_sd(readings, mechanism, made)
    rng = np.random.default_rng(3)
    plain = made.to_dict()
    drawn = []
    for _ in range(draws):
        for p, old in zip(plain["parameters"], made.parameters, strict=True):
            p["value"] = (old.value or 0.0) + 1e-3 * rng.standard_normal()
        drawn.append(rsicalib.forward(readings, mechanism, Calibration.from_dict(plain)))
    np.testing.assert_allclose(sd, np.std(drawn, axis=0), rtol=5.0 / np.sqrt(2 * draws))


def test_a_saved_calibration_starts_the_next_and_says_what_moved(tmp_path: Path) -> None:
    before = rsicalib.calibrate(READINGS, rest=REST, terms=["offset", "gain"])
    plain = json.loads(before.to_json())
    entry = next(p for p in plain["parameters"] if p["term"] == "offset")
    entry["value"] += 20 * entry["sd"]  # as if this sensor had slipped since
    (tmp_path / "old.json").write_text(json.dumps(plain))
    same = rsicalib.calibrate(READINGS, calibration=before)
    assert same.moved == ()
    moved = rsicalib.calibrate(READINGS, calibration=tmp_path / "old.json").moved
    assert moved is not None and [(m.term, m.target) for m in moved] == [
        ("offset", entry["target"])
    ]
