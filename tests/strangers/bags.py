"""Bags of ROS, MCAP of other programs, and topics as text."""

from __future__ import annotations

import json
import sqlite3
import struct
from collections.abc import Callable
from contextlib import closing
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from tests.strangers import Made, text
from tests.test_imports_ros import mcap, moves, ros1, rosbag2, states

STREAM = states(moves(1))
KIND = "sensor_msgs/msg/JointState"


def channels(
    encoding: str,
    schema: str = "jsonschema",
    name: str = "sensor_msgs/JointState",
    change: Any = None,
) -> Callable[[Path], Path]:
    """A maker of an MCAP file by the library `mcap`, as programs that are not ROS write it."""

    def make(folder: Path) -> Path:
        writer = pytest.importorskip("mcap.writer", reason="mcap is not installed")
        path = folder / "run.mcap"
        with path.open("wb") as file:
            made = writer.Writer(file)
            made.start(profile="", library="foreign")
            definition = b"{}" if encoding == "json" else DEFINITION.encode()
            own = made.register_schema(name, schema, definition)
            channel = made.register_channel("/joint_states", encoding, own)
            for number, (_, _, time, message) in enumerate(STREAM):
                if change is not None:
                    message = change(number, json.loads(json.dumps(message)))
                data = coded(message) if encoding == "ros1" else json.dumps(message).encode()
                made.add_message(channel, time, data, time)
            made.finish()
        return path

    return make


DEFINITION = (
    "Header header\nstring[] name\nfloat64[] position\nfloat64[] velocity\nfloat64[] effort\n"
)


def coded(message: dict[str, Any]) -> bytes:
    """A message of ROS 1, by rosbags."""
    typesys = pytest.importorskip("rosbags.typesys", reason="the extra ros is not installed")
    store = typesys.get_typestore(typesys.Stores.ROS1_NOETIC)
    types = store.types
    stamp = types["builtin_interfaces/msg/Time"](**message["header"]["stamp"])
    head = types["std_msgs/msg/Header"](seq=0, stamp=stamp, frame_id="")
    arrays = [np.array(message[key], float) for key in ("position", "velocity", "effort")]
    return bytes(store.serialize_ros1(types[KIND](head, message["name"], *arrays), KIND))


def cdr(message: dict[str, Any]) -> bytes:
    """A joint state as middleware sends it: each number at a multiple of its size."""
    out = bytearray()

    def put(form: str, *values: Any) -> None:
        out.extend(bytes(-len(out) % struct.calcsize(form[-1])) + struct.pack(f"<{form}", *values))

    def text(value: str) -> None:
        data = value.encode() + b"\0"
        put("I", len(data))
        out.extend(data)

    stamp = message["header"]["stamp"]
    put("i", stamp["sec"])
    put("I", stamp["nanosec"])
    text(message["header"]["frame_id"])
    put("I", len(message["name"]))
    for name in message["name"]:
        text(name)
    for key in ("position", "velocity", "effort"):
        values = message[key]
        put("I", len(values))
        if values:
            put(f"{len(values)}d", *values)
    return b"\0\1\0\0" + bytes(out)


TABLES = """
CREATE TABLE topics(id INTEGER PRIMARY KEY, name TEXT NOT NULL, type TEXT NOT NULL,
  serialization_format TEXT NOT NULL, offered_qos_profiles TEXT NOT NULL);
CREATE TABLE messages(id INTEGER PRIMARY KEY, topic_id INTEGER NOT NULL,
  timestamp INTEGER NOT NULL, data BLOB NOT NULL);
INSERT INTO topics VALUES(1, '/joint_states', 'sensor_msgs/msg/JointState', 'cdr', '');
INSERT INTO topics VALUES(2, '/gripper', 'maker_msgs/msg/Grip', 'cdr', '');
"""


def db3(folder: Path) -> Path:
    """What a recorder of Foxy leaves, by sqlite3 alone: with a topic whose type nobody has."""
    root = folder / "run"
    root.mkdir()
    topics = ""
    for name, kind, count in (
        ("/joint_states", "sensor_msgs/msg/JointState", len(STREAM)),
        ("/gripper", "maker_msgs/msg/Grip", 1),
    ):
        topics += (
            f"    - topic_metadata:\n        name: {name}\n        type: {kind}\n"
            '        serialization_format: cdr\n        offered_qos_profiles: ""\n'
            f"      message_count: {count}\n"
        )
    first, last = STREAM[0][2], STREAM[-1][2]
    (root / "metadata.yaml").write_text(
        "rosbag2_bagfile_information:\n  version: 4\n  storage_identifier: sqlite3\n"
        "  relative_file_paths:\n    - run_0.db3\n"
        f"  duration:\n    nanoseconds: {last - first}\n"
        f"  starting_time:\n    nanoseconds_since_epoch: {first}\n"
        f"  message_count: {len(STREAM) + 1}\n  topics_with_message_count:\n{topics}"
        '  compression_format: ""\n  compression_mode: ""\n'
    )
    rows = [(1, time, cdr(message)) for *_, time, message in STREAM]
    with closing(sqlite3.connect(root / "run_0.db3")) as base, base:
        base.executescript(TABLES)
        words = "INSERT INTO messages(topic_id, timestamp, data) VALUES(?, ?, ?)"
        base.executemany(words, [*rows, (2, first, b"\0\1\0\0grip")])
    return root


def part(number: int, message: dict[str, Any]) -> dict[str, Any]:
    """A message that has lost a position."""
    if number == 6:
        message["position"][1] = None
    return message


def passive(number: int, message: dict[str, Any]) -> dict[str, Any]:
    """A message with a joint that has no encoder."""
    message["name"].append("finger")
    message["position"].append(float("nan"))
    return message


def halves(number: int, message: dict[str, Any]) -> dict[str, Any]:
    """One of two publishers, each with its joints."""
    part = slice(0, 1) if number % 2 else slice(1, None)
    names = sorted(message["name"])[part]
    at = dict(zip(message["name"], message["position"], strict=True))
    return {**message, "name": names, "position": [at[name] for name in names]}


def folder_of_a_killed_recorder(folder: Path) -> Path:
    (rosbag2(folder / "run", STREAM) / "metadata.yaml").unlink()
    return folder / "run"


def cut(folder: Path) -> Path:
    path = mcap(folder / "run.mcap", STREAM)
    path.write_bytes(path.read_bytes()[:5000])
    return path


def echoed(old: bool = False) -> str:
    """What `ros2 topic echo` prints, or `rostopic echo`."""
    out = "WARNING: topic [/joint_states] does not appear to be published yet\n"
    for _, _, _, message in STREAM:
        stamp, names, values = message["header"]["stamp"], message["name"], message["position"]
        if old:
            out += f"header: \n  seq: 1\n  stamp: \n    secs: {stamp['sec']}\n"
            out += f"    nsecs: {stamp['nanosec']}\n  frame_id: ''\n"
            out += f"name: [{', '.join(names)}]\nposition: [{', '.join(map(repr, values))}]\n"
        else:
            out += f"header:\n  stamp:\n    sec: {stamp['sec']}\n    nanosec: {stamp['nanosec']}\n"
            out += "  frame_id: ''\nname:\n" + "".join(f"- {name}\n" for name in names)
            out += "position:\n" + "".join(f"- {value!r}\n" for value in values)
        out += "velocity: []\neffort: []\n---\n"
    return out


LINES = "\n".join(json.dumps(message) for *_, message in STREAM)
CUT_TEXT = echoed().rsplit("velocity", 1)[0].rsplit("- ", 1)[0]

FILES: dict[str, Made] = {
    "MCAP with JSON": (channels("json"), {"hold": 0}, (100, "elbow")),
    "MCAP with messages of ROS 1": (
        channels("ros1", "ros1msg"),
        {"hold": 0},
        (100, "wrist"),
    ),
    "MCAP with protobuf": (
        channels("protobuf", "protobuf", "robot.JointState"),
        {},
        "topic /joint_states: found messages in 'protobuf', expected one of cdr, ros1, json",
    ),
    "MCAP with JSON that lacks a position": (
        channels("json", change=part),
        {},
        "message 7: found no finite position of ",
    ),
    "MCAP with a joint that has no encoder": (
        channels("json", change=passive),
        {"hold": 0, "channels": {"q1": "elbow"}},
        (100, "q1"),
    ),
    "MCAP of two publishers": (
        channels("json", change=halves),
        {"hold": 0},
        "100 such rows, and none is whole: name the channels that belong together",
    ),
    "MCAP with joint states of another schema": (
        channels("json", name="foxglove.JointStates"),
        {},
        "Its topics: /joint_states (foxglove.JointStates)",
    ),
    "MCAP cut short": (cut, {}, "mcap recover IN -o OUT"),
    "a bag of ROS 1": (lambda f: ros1(f / "run.bag", STREAM), {"hold": 0}, (100, "elbow")),
    "a folder of Foxy, by sqlite3": (db3, {"hold": 0}, (100, "elbow")),
    "its file alone": (lambda f: db3(f) / "run_0.db3", {"hold": 0}, (100, "wrist")),
    "a folder without metadata": (folder_of_a_killed_recorder, {}, "ros2 bag reindex FOLDER"),
    "ros2 topic echo": (text("echo.txt", echoed()), {"hold": 0}, (100, "shoulder")),
    "rostopic echo": (text("echo.txt", echoed(old=True)), {"hold": 0}, (100, "shoulder")),
    "ros2 topic echo, stopped in a message": (text("echo.txt", CUT_TEXT), {}, "delete its lines"),
    "JSON with a key for each joint": (
        text("states.jsonl", '{"t": 0.0, "elbow": 1.5}\n{"t": 0.02, "elbow": 1.6}\n'),
        {},
        "no joint states, which have lists `name` and `position`: save it as CSV",
    ),
    "JSON, an object a line": (text("states.jsonl", LINES), {"hold": 0}, (100, "wrist")),
}
