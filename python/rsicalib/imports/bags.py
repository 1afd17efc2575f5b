"""What a bag holds, whoever wrote it: messages of topics, by their types.

Bags of ROS 1 and ROS 2 are read by `rosbags`. An MCAP file of another program, as one of the
Foxglove SDK or one that was converted from ROS 1, has its own encoding for each channel: JSON,
`ros1` or `cdr`. The library `mcap` reads it.
"""

from __future__ import annotations

import json
import re
import struct
from collections.abc import Iterator, Mapping
from contextlib import ExitStack
from pathlib import Path
from types import SimpleNamespace
from typing import Any, Protocol

from rsicalib.errors import InputError
from rsicalib.io.extras import needed

STATE = "sensor_msgs/msg/JointState"

MCAP = b"\x89MCAP0\r\n"
STATES = re.compile(r"(?:.*[/.])?JointState")
ENCODINGS = ("cdr", "ros1", "json")
SCHEMAS = {"ros2msg": 2, "ros1msg": 1}
"""Encodings of definitions that are texts of messages, with the version of ROS."""


class Bag(Protocol):
    """A bag that is open.

    Attributes
    ----------
    topics : mapping of str to str
        Type of the messages of each topic; joint states are `STATE`, whatever their writer said.
    """

    @property
    def topics(self) -> Mapping[str, str]: ...

    def messages(self, topic: str) -> Iterator[tuple[int, Any]]:
        """Time of receipt [ns] and message, by time."""
        ...


def open_bag(source: str, stack: ExitStack) -> Bag:
    """Open a bag; it is closed with the stack."""
    if _profile(Path(source)) not in (None, "ros2"):
        return _Channels(source, stack)
    return _Recorded(source, stack)


def _profile(path: Path) -> str | None:
    """Profile of an MCAP file; None for other files."""
    if not path.is_file():
        return None
    with path.open("rb") as file:
        head = file.read(64)
    if not head.startswith(MCAP) or len(head) < 21 or head[8] != 1:
        return None
    (length,) = struct.unpack_from("<I", head, 17)
    return head[21 : 21 + length].decode("utf-8", "replace")


class _Recorded:
    """A bag of a recorder of ROS."""

    def __init__(self, source: str, stack: ExitStack) -> None:
        highlevel = needed("rosbags.highlevel", source, "a bag of ROS")
        typesys = needed("rosbags.typesys", source, "a bag of ROS")
        types = typesys.get_typestore(typesys.Stores.LATEST)  # of bags that do not say their own
        reader = highlevel.AnyReader([Path(source)], default_typestore=types)
        self._bag = stack.enter_context(reader)
        self.topics = {name: str(topic.msgtype) for name, topic in self._bag.topics.items()}

    def messages(self, topic: str) -> Iterator[tuple[int, Any]]:
        connections = [c for c in self._bag.connections if c.topic == topic]
        for connection, time, raw in self._bag.messages(connections=connections):
            yield time, self._bag.deserialize(raw, connection.msgtype)


class _Channels:
    """An MCAP file whose channels say how they are encoded."""

    def __init__(self, source: str, stack: ExitStack) -> None:
        reader = needed("mcap.reader", source, "an MCAP file of another program than ROS 2")
        self.source = source
        self._reader = reader.make_reader(stack.enter_context(Path(source).open("rb")))
        summary = self._reader.get_summary()
        found = {} if summary is None else summary.channels
        names = {c.topic: summary.schemas[c.schema_id].name for c in found.values() if c.schema_id}
        bare = {c.topic: "" for c in found.values()}
        self.topics = {t: _type(name) for t, name in {**bare, **names}.items()}
        self._stores: dict[tuple[str, int], tuple[Any, str]] = {}

    def messages(self, topic: str) -> Iterator[tuple[int, Any]]:
        found = self._reader.iter_messages(topics=[topic])
        for number, (schema, channel, message) in enumerate(found, 1):
            yield message.log_time, self._decoded(schema, channel, message.data, number)

    def _decoded(self, schema: Any, channel: Any, data: bytes, number: int) -> Any:
        encoding = channel.message_encoding
        if encoding not in ENCODINGS:
            raise InputError.at(
                self.source,
                f"messages in {encoding!r}",
                f"one of {', '.join(ENCODINGS)}",
                column=channel.topic,
                hint="Convert the file, or export the joints as CSV.",
                column_word="topic",
            )
        if encoding == "json":
            try:
                return namespace(json.loads(data))
            except (ValueError, RecursionError) as error:
                raise InputError.at(
                    self.source,
                    f"text that is not JSON ({error})",
                    "JSON",
                    line=number,
                    line_word="message",
                ) from None
        store, kind = self._store(schema, encoding)
        read = store.deserialize_cdr if encoding == "cdr" else store.deserialize_ros1
        return read(data, kind)

    def _store(self, schema: Any, encoding: str) -> tuple[Any, str]:
        """Types of a schema: those of ROS, and what the file defines beside them."""
        key = (encoding, schema.id)
        if key not in self._stores:
            typesys = needed("rosbags.typesys", self.source, "messages of ROS")
            known = typesys.Stores.LATEST if encoding == "cdr" else typesys.Stores.ROS1_NOETIC
            store, kind = typesys.get_typestore(known), _type(schema.name)
            if kind not in store.types and schema.encoding in SCHEMAS:
                types = typesys.get_types_from_msg(schema.data.decode(), kind)
                store.register({k: v for k, v in types.items() if k not in store.types})
            self._stores[key] = (store, kind)
        return self._stores[key]


def _type(name: str) -> str:
    """Name of a type as ROS 2 has it."""
    if STATES.fullmatch(name):
        return STATE
    parts = name.split("/")
    return f"{parts[0]}/msg/{parts[1]}" if len(parts) == 2 else name


def namespace(value: Any) -> Any:
    """An object of JSON with its fields as attributes."""
    if isinstance(value, dict):
        return SimpleNamespace(**{str(name): namespace(inner) for name, inner in value.items()})
    return [namespace(inner) for inner in value] if isinstance(value, list) else value
