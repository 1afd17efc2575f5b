"""Each export read again by a reader of its format: the same places, and the same misclosure.

An arm of a URDF puts its ball into a cone; its zeros and a link are not as drawn. The places of the
ball, and how far they are apart, are those of the result, whichever file carries it.
"""

from __future__ import annotations

import ctypes
import shutil
import subprocess
import tomllib
from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import rsicalib
from rsicalib import Calibration
from rsicalib.exports.opening import export_result
from tests import cone, oracle
from tests.oracle import Array

NAMES = tuple(f"q{k + 1}" for k in range(6))
DRAWN = [(d / 1e3, a / 1e3, alpha) for d, a, alpha in cone.ROWS]
LONGER = [(d, a - 0.0015 * (k == 1), alpha) for k, (d, a, alpha) in enumerate(DRAWN)]
BALL = np.array([0.04, 0.0, 0.12, 1.0])

JOINT = """
  <link name="link_{k}"/>
  <joint name="joint_{k}" type="{kind}">
    <parent link="link_{before}"/> <child link="link_{k}"/> <axis xyz="0 0 1"/>
    <origin xyz="{a!r} 0 {d!r}" rpy="{alpha!r} 0 0"/>
    <limit lower="-3.1" upper="3.1" effort="50" velocity="2"/>
  </joint>"""
MECHANISM = """
name = "arm at a cone"
length_unit = "m"
point = [
  {name = "ball", chain = "arm", at = [0.04, 0.0, 0.12]},
  {name = "cone", unknown = ["at"]},
]
closure = [{name = "ball in cone", kind = "touch", between = ["ball", "cone"], noise = 2e-5}]
[[chain]]
name = "arm"
urdf = "robot.urdf"
base = "link_0"
tip = "link_7"
[chain.channels]
joint_1 = "q1"
joint_2 = "q2"
joint_3 = "q3"
joint_4 = "q4"
joint_5 = "q5"
joint_6 = "q6"
[model]
terms = ["offset@q2", "offset@q3", "offset@q4", "offset@q5", "offset@q6", "link_length@arm/3"]
"""


def urdf() -> str:
    """The arm as drawn: a row of Denavit and Hartenberg stands before the next joint."""
    text, (d, a, alpha) = '<robot name="robot">\n  <link name="link_0"/>', (0.0, 0.0, 0.0)
    for k, row in enumerate([*DRAWN, None], start=1):
        kind = "fixed" if row is None else "revolute"
        text += JOINT.format(k=k, before=k - 1, kind=kind, a=a, d=d, alpha=alpha)
        d, a, alpha = row or (0.0, 0.0, 0.0)
    return f"{text}\n</robot>\n"


def ball(q: Array, rows: list[tuple[float, float, float]]) -> Array:
    """Places of the ball for joint angles (n, 6), in plain matrix products: (n, 3)."""
    frame = np.broadcast_to(np.eye(4), (len(q), 4, 4))
    for angle, (d, a, alpha) in zip(q.T, rows, strict=True):
        frame = frame @ oracle.dh(angle, d, a, alpha)
    return np.asarray((frame @ BALL)[:, :3])


def misclosure(places: Array) -> float:
    """Root mean square distance of the ball from the middle of its places [m]."""
    return float(np.sqrt(np.mean(np.sum((places - places.mean(axis=0)) ** 2, axis=1))))


@dataclass(frozen=True)
class Case:
    """A session of the arm, and its result."""

    folder: Path
    readings: Array
    found: Calibration
    places: Array
    """Of the ball, under the result."""

    @property
    def mechanism(self) -> Path:
        return self.folder / "arm.toml"

    @property
    def session(self) -> Path:
        return self.folder / "readings.csv"


@pytest.fixture(scope="module")
def case(tmp_path_factory: pytest.TempPathFactory) -> Case:
    folder = tmp_path_factory.mktemp("arm")
    (folder / "robot.urdf").write_text(urdf())
    (folder / "arm.toml").write_text(MECHANISM)
    rng, near = np.random.default_rng(7), np.array([0.4, -1.4, -1.6, -1.5, 1.5, 0.0])
    spot, rows = ball(near[None], LONGER)[0], []
    while len(rows) < 24:
        q = near + rng.uniform(-1, 1, 6) * [0.9, 0.6, 0.8, 1.5, 1.5, 3.0]
        for _ in range(60):
            up, down = (ball(q + s * 1e-6 * np.eye(6), LONGER) for s in (1, -1))
            off = ball(q[None], LONGER)[0] - spot
            q = q - np.clip(np.linalg.pinv((up - down).T / 2e-6) @ off, -0.2, 0.2)
        if np.linalg.norm(off) < 1e-9 and np.abs(q).max() < 3.0:
            rows.append(q)
    readings = np.array(rows) - cone.OFFSETS * (np.arange(6) > 0) + 2e-5 * rng.normal(size=(24, 6))
    text = "\n".join(
        [",".join(["at", *NAMES]), *(",".join(["c", *map(repr, r)]) for r in readings.tolist())]
    )
    (folder / "readings.csv").write_text(text + "\n")
    found = rsicalib.calibrate(folder / "readings.csv", folder / "arm.toml", noise=2e-5)
    places = rsicalib.forward(folder / "readings.csv", folder / "arm.toml", found)
    return Case(folder, readings, found, places)


def plain(case: Case, coordinates: Array) -> Array:
    """Places of the ball for joint coordinates, with the link as long as the result has it."""
    (longer,) = [p.value for p in case.found.parameters if p.term == "link_length"]
    rows = [(d, a - longer * (k == 1), alpha) for k, (d, a, alpha) in enumerate(DRAWN)]
    return ball(coordinates, rows)


def test_the_result_is_worth_carrying(case: Case) -> None:
    before = misclosure(ball(case.readings, DRAWN))
    after = misclosure(case.places)
    assert before > 20 * after
    (longer,) = [(p.value, p.sd) for p in case.found.parameters if p.term == "link_length"]
    assert longer[1] is not None and abs(longer[0] - 0.0015) < 5 * longer[1]


# Each of these gives the places of the ball from files that were written, by readers of the format.


def by_toml(case: Case, files: dict[str, Any]) -> Array:
    path = case.folder / "calibrated.toml"
    path.write_text(files["calibrated.toml"])
    return rsicalib.forward(case.session, path)


def by_urdf(case: Case, files: dict[str, Any]) -> Array:
    (case.folder / "other").mkdir(exist_ok=True)
    (case.folder / "other" / "robot.urdf").write_text(files["calibrated.urdf"])
    (case.folder / "other" / "arm.toml").write_text(MECHANISM)
    return rsicalib.forward(case.session, case.folder / "other" / "arm.toml")


def by_mujoco(case: Case, files: dict[str, Any]) -> Array:
    mujoco = pytest.importorskip("mujoco", reason="MuJoCo is not installed")
    model = mujoco.MjModel.from_xml_string(files["calibrated.xml"])
    data, out = mujoco.MjData(model), []
    for row in case.readings:
        for name, value in zip(NAMES, row, strict=True):
            data.joint(name).qpos[0] = value
        mujoco.mj_kinematics(model, data)
        out.append(data.site("ball").xpos.copy())
    return np.array(out)


def by_mjcf(case: Case, files: dict[str, Any]) -> Array:
    """As MuJoCo saves it again, read by us: an arm alone closes nothing, so a touch is added."""
    mujoco = pytest.importorskip("mujoco", reason="MuJoCo is not installed")
    ours = files["calibrated.xml"].replace("<worldbody>", '<worldbody><site name="spot"/>')
    connect = '<connect site1="ball" site2="spot"/>'
    ours = ours.replace("</equality>", f"{connect}</equality>")
    mujoco.mj_saveLastXML(str(case.folder / "saved.xml"), mujoco.MjModel.from_xml_string(ours))
    return rsicalib.forward(
        dict(zip(NAMES, case.readings.T, strict=True)), case.folder / "saved.xml"
    )


def by_yaml(case: Case, files: dict[str, Any]) -> Array:
    yaml = pytest.importorskip("ruamel.yaml", reason="no library of YAML is installed")
    document = yaml.YAML(typ="safe").load(files["calibration.yaml"])
    joints = document["/**"]["ros__parameters"]["calibration"]["joints"]
    gain, offset = (np.array([joints[name][key] for name in NAMES]) for key in ("gain", "offset"))
    assert "# not in here: link_length@arm/3" in files["calibration.yaml"]
    return plain(case, gain * case.readings + offset)


def by_c(case: Case, files: dict[str, Any]) -> Array:
    if shutil.which("cc") is None:
        pytest.skip("no C compiler")
    (case.folder / "rsicalib.h").write_text(files["rsicalib.h"])
    source = '#include "rsicalib.h"\n' + "".join(
        f"double {name}_of(double reading) {{ return {name}_coordinate(reading); }}\n"
        for name in NAMES
    )
    (case.folder / "all.c").write_text(source)
    library = case.folder / "all.so"
    words = ["cc", "-std=c99", "-Wall", "-Werror", "-shared", "-fPIC", "-o", str(library)]
    subprocess.run([*words, str(case.folder / "all.c")], check=True)
    assert "not in here: link_length@arm/3" in files["rsicalib.h"]
    loaded = ctypes.CDLL(str(library))
    columns = []
    for name, column in zip(NAMES, case.readings.T, strict=True):
        function = getattr(loaded, f"{name}_of")
        function.restype, function.argtypes = ctypes.c_double, [ctypes.c_double]
        columns.append([function(reading) for reading in column.tolist()])
    return plain(case, np.array(columns).T)


def by_csv(case: Case, files: dict[str, Any]) -> Array:
    for name, text in files.items():
        (case.folder / name).write_text(text)
    return rsicalib.forward(case.folder / "corrected.csv", case.folder / "corrected.toml")


def by_mcap(case: Case, files: dict[str, Any]) -> Array:
    reader = pytest.importorskip("mcap_ros2.reader", reason="mcap-ros2-support is not installed")
    path = case.folder / "corrected.mcap"
    path.write_bytes(files["corrected.mcap"])
    messages = [m.ros_msg for m in reader.read_ros2_messages(str(path), ["/joint_states"])]
    assert list(messages[0].name) == list(NAMES)
    return plain(case, np.array([message.position for message in messages]))


READERS: dict[str, tuple[str, Callable[[Case, dict[str, Any]], Array]]] = {
    "toml": ("toml", by_toml),
    "urdf": ("urdf", by_urdf),
    "mjcf, by MuJoCo": ("mjcf", by_mujoco),
    "mjcf, saved by MuJoCo": ("mjcf", by_mjcf),
    "ros2": ("ros2", by_yaml),
    "c": ("c", by_c),
    "csv": ("csv", by_csv),
    "mcap": ("mcap", by_mcap),
}


@pytest.mark.parametrize("name", READERS)
def test_what_is_read_again_gives_the_same_places_and_misclosure(name: str, case: Case) -> None:
    if name == "mcap":
        pytest.importorskip("rosbags", reason="the extra ros is not installed")
    to, again = READERS[name]
    session: Any = case.session if to in ("csv", "mcap") else None
    if to == "mcap":  # each message has a time
        whole = rsicalib.load_readings(session, case.mechanism)
        session = replace(whole, time_s=np.arange(float(len(whole))))
    places = again(case, export_result(case.found, to, case.mechanism, readings=session))
    # All numbers are written with all their digits, but those that MuJoCo saves, which have six or
    # seven: of an arm of a metre a millionth. A polynomial of C is within 1e-12 of its line.
    most = 1e-6 if "saved" in name else 1e-11
    assert np.abs(places - case.places).max() < most
    assert abs(misclosure(places) - misclosure(case.places)) < most


def test_anchors_come_back_from_the_lines_of_a_firmware(tmp_path: Path) -> None:
    from tests.test_imports import clbm
    from tests.test_logs_to_controllers import belts

    lengths = belts(0.5, np.random.default_rng(3))
    log = tmp_path / "serial.log"
    log.write_text(clbm(lengths) + "\n")
    text = rsicalib.import_log(log).mechanism or ""
    found = rsicalib.calibrate(log, noise=0.8)
    (lines,) = export_result(found, "maslow", text).values()
    (tmp_path / "again.log").write_text(f"{lines}\n{log.read_text()}")
    points = {
        p["name"]: p
        for p in tomllib.loads(rsicalib.import_log(tmp_path / "again.log").mechanism or "")["point"]
    }
    told = {(p.target, p.name): p.value for p in found.parameters}
    drawn = {p["name"]: p["at"] for p in tomllib.loads(text)["point"]}
    corners = ("top left", "top right", "bottom left", "bottom right")
    wanted = np.array(
        [[told.get((c, axis), drawn[c][k]) for k, axis in enumerate("xyz")] for c in corners]
    )
    made = np.array([points[c]["at"] for c in corners])
    assert np.abs(made - wanted).max() < 5e-4 + 1e-9  # the firmware has three decimals

    def left(anchors: Array) -> float:
        """How far belts are from one point, root mean square, by plain least squares [mm]."""
        from scipy.optimize import least_squares

        total = []
        for row in np.round(lengths, 2):

            def short(at: Array, row: Array = row) -> Array:
                return np.asarray(np.linalg.norm(anchors - [*at, 0.0], axis=1) - row)

            total.append(least_squares(short, [1400.0, 1000.0]).fun)
        return float(np.sqrt(np.mean(np.square(total))))

    # each anchor moves by half a thousandth at the most, and a length by no more
    assert abs(left(made) - left(wanted)) < 1e-3
