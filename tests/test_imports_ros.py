"""Bags of ROS 2 become readings: written by mcap-ros2-support, and by the writer of rosbag2."""

from __future__ import annotations

import tomllib
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import rsicalib
from rsicalib import InputError
from rsicalib.imports.kinds import format_of
from tests import oracle
from tests.simulated import closed

pytest.importorskip("rosbags", reason="the extra ros is not installed")

EXAMPLES = Path(__file__).parents[1] / "examples"
NAMES = ("elbow", "shoulder", "wrist")
START = 1_700_000_000_123_456_789

HEADER = """\
================================================================================
MSG: std_msgs/Header
builtin_interfaces/Time stamp
string frame_id
================================================================================
MSG: builtin_interfaces/Time
int32 sec
uint32 nanosec
"""
STATE = f"""\
std_msgs/Header header
string[] name
float64[] position
float64[] velocity
float64[] effort
{HEADER}"""
WRENCH = f"""\
std_msgs/Header header
geometry_msgs/Wrench wrench
================================================================================
MSG: geometry_msgs/Wrench
geometry_msgs/Vector3 force
geometry_msgs/Vector3 torque
================================================================================
MSG: geometry_msgs/Vector3
float64 x
float64 y
float64 z
{HEADER}"""


def header(time: int) -> dict[str, Any]:
    stamp = {"sec": time // 10**9, "nanosec": time % 10**9} if time else {"sec": 0, "nanosec": 0}
    return {"stamp": stamp, "frame_id": ""}


def state(time: int, values: dict[str, float]) -> dict[str, Any]:
    return {
        "header": header(time),
        "name": list(values),
        "position": list(values.values()),
        "velocity": [],
        "effort": [],
    }


def wrench(time: int, z: float) -> dict[str, Any]:
    nothing = {"x": 0.0, "y": 0.0, "z": 0.0}
    return {"header": header(time), "wrench": {"force": {**nothing, "z": z}, "torque": nothing}}


Stream = list[tuple[str, str, int, dict[str, Any]]]
"""Topic, type, time of receipt [ns] and message."""


def mcap(path: Path, stream: Stream) -> Path:
    """A bag as a robot's recorder writes it, by mcap-ros2-support."""
    writer = pytest.importorskip("mcap_ros2.writer", reason="mcap-ros2-support is not installed")
    with path.open("wb") as file:
        bag = writer.Writer(file)
        texts = {"sensor_msgs/msg/JointState": STATE, "geometry_msgs/msg/WrenchStamped": WRENCH}
        schemas = {kind: bag.register_msgdef(kind, text) for kind, text in texts.items()}
        for topic, kind, time, message in stream:
            bag.write_message(topic, schemas[kind], message, log_time=time, publish_time=time)
        bag.finish()
    return path


def rosbag2(path: Path, stream: Stream, plugin: str = "SQLITE3") -> Path:
    """A folder with `metadata.yaml`, by the writer of rosbags."""
    from rosbags.rosbag2 import StoragePlugin, Writer
    from rosbags.typesys import Stores, get_typestore

    store = get_typestore(Stores.ROS2_HUMBLE)

    def made(kind: str, value: Any) -> Any:
        if not isinstance(value, dict):
            return value
        inner = {"header": "std_msgs/msg/Header", "stamp": "builtin_interfaces/msg/Time"}
        inner |= {"wrench": "geometry_msgs/msg/Wrench"}
        inner |= dict.fromkeys(("force", "torque"), "geometry_msgs/msg/Vector3")
        arrays = ("position", "velocity", "effort")
        fields = {
            k: np.array(v, float) if k in arrays else made(inner.get(k, ""), v)
            for k, v in value.items()
        }
        return store.types[kind](**fields)

    with Writer(path, version=9, storage_plugin=StoragePlugin[plugin]) as bag:
        connections: dict[str, Any] = {}
        for topic, kind, time, message in stream:
            if topic not in connections:
                connections[topic] = bag.add_connection(topic, kind, typestore=store)
            bag.write(connections[topic], time, store.serialize_cdr(made(kind, message), kind))
    return path


def moves(poses: int = 4, seed: int = 0) -> np.ndarray:
    """Poses held for one second, and moves of one second, at 50 Hz, read by encoders."""
    rng = np.random.default_rng(seed)
    places = rng.uniform(-1.0, 1.0, (poses + 1, 3))
    ease = 0.5 - 0.5 * np.cos(np.pi * np.linspace(0.0, 1.0, 50))[:, None]
    parts = []
    for k in range(poses):
        parts += [np.tile(places[k], (50, 1)), places[k] + ease * (places[k + 1] - places[k])]
    values = np.vstack(parts) + 2e-5 * rng.standard_normal((100 * poses, 3))
    return np.round(values / 1e-5) * 1e-5


def states(values: np.ndarray, topic: str = "/joint_states", late: int = 4_000_000) -> Stream:
    """Messages whose names change order from one to the next."""
    stream: Stream = []
    for k, row in enumerate(values.tolist()):
        time = START + k * 20_000_000
        order = np.roll(np.arange(3), k)
        named = {NAMES[i]: row[i] for i in order}
        stream.append((topic, "sensor_msgs/msg/JointState", time + late, state(time, named)))
    return stream


def ros1(path: Path, stream: Stream) -> Path:
    """A bag of ROS 1, by the writer of rosbags."""
    from rosbags.rosbag1 import Writer
    from rosbags.typesys import Stores, get_typestore

    store = get_typestore(Stores.ROS1_NOETIC)
    types = store.types
    with Writer(path) as bag:
        connections: dict[str, Any] = {}
        for topic, kind, time, message in stream:
            if topic not in connections:
                connections[topic] = bag.add_connection(topic, kind, typestore=store)
            stamp = types["builtin_interfaces/msg/Time"](**message["header"]["stamp"])
            head = types["std_msgs/msg/Header"](seq=0, stamp=stamp, frame_id="")
            arrays = [np.array(message[key], float) for key in ("position", "velocity", "effort")]
            made = types[kind](head, message["name"], *arrays)
            bag.write(connections[topic], time, store.serialize_ros1(made, kind))
    return path


BAGS: dict[str, Callable[[Path, Stream], Path]] = {
    "mcap": lambda folder, stream: mcap(folder / "run.mcap", stream),
    "rosbag2 sqlite": lambda folder, stream: rosbag2(folder / "run", stream),
    "ROS 1": lambda folder, stream: ros1(folder / "run.bag", stream),
    "rosbag2 mcap": lambda folder, stream: rosbag2(folder / "run", stream, "MCAP"),
}


@pytest.mark.parametrize("kind", BAGS)
def test_joint_states_become_held_poses_whatever_the_order_of_their_names(
    kind: str, tmp_path: Path
) -> None:
    values = moves()
    path = BAGS[kind](tmp_path, states(values))
    assert format_of(path) == "ros"
    log = rsicalib.import_log(path, channels={"q2": "elbow", "q1": "shoulder", "q3": "wrist"})
    (session,) = log.sessions
    assert list(session.columns) == ["pose", "sample", "time_s", "q2", "q1", "q3"]
    assert session.n_poses == 4
    assert session.motion is not None
    rows = np.concatenate([session.lines, session.motion.lines])
    found = np.vstack(
        [
            np.column_stack([s.columns[q] for q in ("q2", "q1", "q3")])
            for s in (session, session.motion)
        ]
    )
    assert np.array_equal(found, values[rows - 1])
    assert np.array_equal(session.columns["time_s"], (session.lines - 1) * 20_000_000 / 1e9)
    assert any("receipt is later by 0.004 s" in finding for finding in log.findings)
    assert not any("commands" in finding for finding in log.findings)


def test_channels_of_a_mechanism_take_the_joints_of_its_urdf(tmp_path: Path) -> None:
    joints = "".join(
        f'<link name="l{k}"/><joint name="{name}" type="revolute"><parent link="l{k}"/>'
        f'<child link="l{k + 1}"/><axis xyz="0 0 1"/><limit lower="-3" upper="3"/></joint>'
        for k, name in enumerate(NAMES)
    )
    (tmp_path / "arm.urdf").write_text(f'<robot name="arm">{joints}<link name="l3"/></robot>')
    (tmp_path / "arm.toml").write_text(
        'name = "arm"\nlength_unit = "m"\n[[chain]]\nname = "arm"\nurdf = "arm.urdf"\n'
        'base = "l0"\ntip = "l3"\nchannels = {elbow = "q1", shoulder = "q2", wrist = "q3"}\n'
        '[[point]]\nname = "tip"\nchain = "arm"\nat = [0.1, 0, 0]\n'
        '[[point]]\nname = "nail"\nat = [0.1, 0, 0]\n'
        '[[closure]]\nname = "touch"\nkind = "touch"\nbetween = ["tip", "nail"]\n'
    )
    path = mcap(tmp_path / "run.mcap", states(moves(1)))
    log = rsicalib.import_log(path, mechanism=tmp_path / "arm.toml", hold=0)
    assert np.array_equal(log.sessions[0].columns["q2"], moves(1)[:, 1])
    (readings,) = log.readings(rsicalib.load_mechanism(tmp_path / "arm.toml"))
    assert len(readings) == 100


def test_messages_of_another_publisher_are_left_out_and_half_messages_refused(
    tmp_path: Path,
) -> None:
    stream = states(moves(1))
    gripper = state(START + 10_000_000, {"finger": 0.02})
    stream.insert(1, ("/joint_states", "sensor_msgs/msg/JointState", START + 10_000_000, gripper))
    path = mcap(tmp_path / "run.mcap", stream)
    chosen = {name: name for name in NAMES}
    log = rsicalib.import_log(path, channels=chosen)
    assert any("1 messages without these joints" in finding for finding in log.findings)
    with pytest.raises(InputError, match="message 1, finger: found no reading of finger"):
        rsicalib.import_log(path)
    half = state(START + 30_000_000, {"elbow": 0.1, "wrist": 0.2})
    stream.insert(3, ("/joint_states", "sensor_msgs/msg/JointState", START + 30_000_000, half))
    path = mcap(tmp_path / "half.mcap", stream)
    with pytest.raises(InputError, match="message 4, shoulder: found no reading of shoulder"):
        rsicalib.import_log(path, channels=chosen)
    assert (
        len(rsicalib.import_log(path, channels=chosen, hold=0, skip_bad_rows=True).sessions[0])
        == 100
    )


def test_commands_are_told_by_what_they_look_like(tmp_path: Path) -> None:
    places = np.random.default_rng(0).uniform(-1.0, 1.0, (3, 3))
    ease = 0.5 - 0.5 * np.cos(np.pi * np.linspace(0.0, 1.0, 50))[:, None]
    values = np.vstack(
        [np.tile(places[0], (50, 1)), places[0] + ease * (places[1] - places[0])]
        + [np.tile(places[1], (50, 1))]
    )
    log = rsicalib.import_log(mcap(tmp_path / "run.mcap", states(values)))
    assert any("look like commands" in finding for finding in log.findings)


def test_the_topic_is_the_one_that_is_no_command_or_is_asked_for(tmp_path: Path) -> None:
    stream = states(moves(1)) + states(moves(1, seed=1), "/joint_commands")
    stream.sort(key=lambda one: one[2])
    path = mcap(tmp_path / "run.mcap", stream)
    log = rsicalib.import_log(path, hold=0)
    assert "joint states of /joint_states" in log.findings
    asked = rsicalib.import_log(path, topic="/joint_commands", hold=0)
    assert np.array_equal(asked.sessions[0].columns["elbow"], moves(1, seed=1)[:, 0])
    assert any("look like commands" in finding for finding in asked.findings)
    with pytest.raises(
        InputError, match=r"topic /states: found no such.*/joint_commands, /joint_s"
    ):
        rsicalib.import_log(path, topic="/states")
    path = mcap(tmp_path / "two.mcap", [*stream, *states(moves(1), "/left/joint_states")])
    with pytest.raises(InputError, match="2 topics with joint states"):
        rsicalib.import_log(path)


def test_contact_is_known_from_another_topic(tmp_path: Path) -> None:
    stream = states(moves())
    for k in range(400):
        pressed = 100 <= k < 300
        time = START + k * 20_000_000 - 5_000_000
        kind = "geometry_msgs/msg/WrenchStamped"
        stream.append(("/wrench", kind, time, wrench(time, 3.0 if pressed else 0.1)))
    stream.sort(key=lambda one: one[2])
    for when in ("/wrench.force.z>2", "/wrench.wrench.force.z >= 2.5"):
        log = rsicalib.import_log(mcap(tmp_path / "run.mcap", stream), when=when)
        assert log.sessions[0].lines.min() >= 100 and log.sessions[0].lines.max() <= 301
        assert log.sessions[0].n_poses == 2
    with pytest.raises(InputError, match="found no number there; /wrench has the fields header, w"):
        rsicalib.import_log(tmp_path / "run.mcap", when="/wrench.force.q>2")
    with pytest.raises(InputError, match="no such topic"):
        rsicalib.import_log(tmp_path / "run.mcap", when="/force.z>2")
    with pytest.raises(InputError, match=r"when: found '/wrench\.force\.z'"):
        rsicalib.import_log(tmp_path / "run.mcap", when="/wrench.force.z")
    with pytest.raises(InputError, match="at least one message at which the condition holds"):
        rsicalib.import_log(tmp_path / "run.mcap", when="/wrench.force.z>200")


def test_headers_without_time_leave_that_of_receipt(tmp_path: Path) -> None:
    stream = states(moves(1))
    for one in stream:
        one[3]["header"] = header(0)
    log = rsicalib.import_log(mcap(tmp_path / "run.mcap", stream), hold=0)
    assert log.sessions[0].columns["time_s"][-1] == pytest.approx(99 * 0.02)
    assert any("that of receipt is taken" in finding for finding in log.findings)
    stream[7][3]["header"] = header(START)
    with pytest.raises(InputError, match="message 9: found a header without time"):
        rsicalib.import_log(mcap(tmp_path / "some.mcap", stream), hold=0)


SPOILT = {
    "a lost position": (lambda m: m["position"].pop(), "3 names and 2 positions"),
    "no number": (lambda m: m["position"].__setitem__(0, float("nan")), "no finite position of"),
    "a name twice": (lambda m: m["name"].__setitem__(0, m["name"][1]), "twice"),
}


@pytest.mark.parametrize("name", SPOILT)
def test_a_message_that_cannot_be_used_is_refused_by_its_number(name: str, tmp_path: Path) -> None:
    spoil, message = SPOILT[name]
    stream = states(moves(1))
    spoil(stream[41][3])
    with pytest.raises(InputError, match=f"message 42: found.*{message}"):
        rsicalib.import_log(mcap(tmp_path / "run.mcap", stream))


def test_a_bag_without_joint_states_or_cut_short_is_refused(tmp_path: Path) -> None:
    stream = [("/wrench", "geometry_msgs/msg/WrenchStamped", START, wrench(START, 1.0))]
    with pytest.raises(InputError, match=r"found no joint states.*Its topics: /wrench"):
        rsicalib.import_log(mcap(tmp_path / "run.mcap", stream))
    path = mcap(tmp_path / "cut.mcap", states(moves()))
    path.write_bytes(path.read_bytes()[:2000])
    with pytest.raises(InputError, match="expected a bag of ROS that is whole"):
        rsicalib.import_log(path)


def test_a_bag_of_two_arms_leads_to_the_offsets_that_its_poses_have(tmp_path: Path) -> None:
    mechanism = EXAMPLES / "two_arms.toml"
    drawn = tomllib.loads(mechanism.read_text())
    rng = np.random.default_rng(4)
    angles = closed(drawn, lambda q: oracle.misclosure_of_angles(drawn, q), 16, rng)
    offsets = rng.normal(0.0, 0.01, 12)
    names = [channel["name"] for channel in drawn["channel"]]
    step = 2 * np.pi / 2**19
    stream: Stream = []
    kind = "sensor_msgs/msg/JointState"
    for k in range(16):  # held for .64 s, then .4 s on the way: motion need not close
        nearer = np.linspace(0.0, 1.0, 22)[1:-1, None]
        way = (1 - nearer) * angles[k] + nearer * angles[(k + 1) % 16]
        rows = np.vstack([np.tile(angles[k], (32, 1)), way]) - offsets
        rows += 2e-5 * rng.standard_normal(rows.shape)
        for row in (np.round(rows / step) * step).tolist():
            time = START + len(stream) * 20_000_000
            stream.append(
                ("/joint_states", kind, time, state(time, dict(zip(names, row, strict=True))))
            )
    bag = mcap(tmp_path / "run.mcap", stream)
    log = rsicalib.import_log(bag, mechanism=mechanism)
    assert log.sessions[0].n_poses == 16
    found = rsicalib.calibrate(bag, mechanism)  # the bag as it is
    assert found.readings.poses == 16 and found.verdict == "adequate"
    told = {p.target: (p.value, p.sd) for p in found.parameters}
    apart = [
        (told[n][0] - o) / told[n][1] for n, o in zip(names, offsets, strict=True) if told[n][1]
    ]
    assert len(apart) >= 10 and np.abs(apart).max() < 4
