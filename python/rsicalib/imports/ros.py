"""Joint states of ROS: bags (folders of rosbag2, `.db3`, `.mcap`; `.bag` of ROS 1), without ROS.

Names of joints stand in every message, in any order. The time is that of the header, where the
state was measured; the time at which it was received is later, by as much as is said.
"""

from __future__ import annotations

import hashlib
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np

from rsicalib.arrays import FloatArray
from rsicalib.errors import InputError
from rsicalib.imports.asked import HOLD, Asked, chosen
from rsicalib.imports.columns import whole_rows
from rsicalib.imports.condition import Condition
from rsicalib.imports.extras import needed, read_by
from rsicalib.imports.log import Log
from rsicalib.imports.stretches import Recording, session_of

__all__ = ["read"]

STATE = "sensor_msgs/msg/JointState"

COMMANDS = ("command", "cmd", "target", "desired", "goal", "reference", "setpoint")
"""Parts of the names of topics that carry what was asked for, not what was measured."""

FINEST = 2 * np.pi / 2**19
"""An encoder that resolves less [rad] shows its noise where it stands still."""

ENOUGH = 200
"""Differences that are compared: chance does not make so many multiples of one step."""


def read(source: str, asked: Asked) -> Log:
    """Read a bag.

    Raises
    ------
    InputError
        There is no joint state, or a message has some of the joints and not others.
    """
    highlevel = needed("rosbags.highlevel", source, "a bag of ROS")
    typesys = needed("rosbags.typesys", source, "a bag of ROS")
    with read_by("rosbags", source, "a bag of ROS that is whole"):
        types = typesys.get_typestore(typesys.Stores.LATEST)  # of bags that do not say their own
        with highlevel.AnyReader([Path(source)], default_typestore=types) as bag:
            topic = _topic(bag, asked.topic, source)
            messages = list(_messages(bag, topic))
            inside = None
            if asked.when is not None:
                inside = Condition.of(asked.when, bag.topics, source).holds(bag, messages, source)
    if not messages:
        expected = "messages with joint states"
        raise InputError.at(source, column=topic, found="none", expected=expected, column_word="")
    return _log(source, topic, messages, inside, asked)


def _topic(bag: Any, asked: str | None, source: str) -> str:
    """The topic that is asked for; else the one with joint states that are no commands."""
    known: list[str] = [name for name, topic in bag.topics.items() if topic.msgtype == STATE]
    if asked is not None:
        if asked not in known:
            found = (
                f"messages of {bag.topics[asked].msgtype}"
                if asked in bag.topics
                else "no such topic"
            )
            hint = f"Topics with joint states: {', '.join(sorted(known)) or 'none'}."
            raise InputError.at(
                source, column=asked, found=found, expected=STATE, hint=hint, column_word="topic"
            )
        return asked
    states = [name for name in known if not _is_command(name)] or known
    if len(states) != 1:
        found = f"{len(states)} topics with joint states" if states else "no joint states"
        hint = f"Say which by --topic: {', '.join(states)}." if states else ""
        hint = hint or f"Its topics: {', '.join(bag.topics)[:300]}."
        raise InputError.at(source, found=found, expected=f"one topic of {STATE}", hint=hint)
    return states[0]


def _is_command(topic: str) -> bool:
    return any(word in topic.lower() for word in COMMANDS)


def _messages(bag: Any, topic: str) -> Iterator[tuple[int, Any]]:
    """Time of receipt [ns] and message."""
    connections = [c for c in bag.connections if c.topic == topic]
    for connection, time, raw in bag.messages(connections=connections):
        yield time, bag.deserialize(raw, connection.msgtype)


def _log(
    source: str,
    topic: str,
    messages: list[tuple[int, Any]],
    inside: np.ndarray | None,
    asked: Asked,
) -> Log:
    names = list(dict.fromkeys(name for _, m in messages for name in m.name))
    places = chosen(asked.channels, names, source, "joint")
    joints = [names[k] for k in places.values()]
    lines = np.arange(1, len(messages) + 1)
    table = np.full((len(messages), len(joints)), np.nan)
    there = np.zeros(table.shape, dtype=bool)
    for row, (_, message) in enumerate(messages):
        at = _positions(message, row + 1, source)
        for column, joint in enumerate(joints):
            if joint in at:
                table[row, column], there[row, column] = at[joint], True
    keep, others = whole_rows(there, joints, lines, source, asked.skip_bad_rows, "message")
    time, findings = _times([messages[row] for row in keep.tolist()], lines[keep], source)
    values = table[keep]
    if others:
        findings.append(f"{others} messages without these joints are not used")
    contact = None
    if inside is not None:
        contact = inside[keep]
        findings.append(f"{contact.mean():.0%} of the messages are under {asked.when}")
        if not contact.any():
            expected = "at least one message at which the condition holds"
            raise InputError.at(source, column=asked.when, found="none", expected=expected)
    if _is_command(topic) or _looks_commanded(values, time):
        findings.append(
            f"the positions of {topic} look like commands: they stand exactly still, and are finer "
            "than any encoder (or the name says so); commands close better than an arm does"
        )
    recording = Recording(tuple(places), values, time, lines[keep], contact)
    session, notes = session_of(recording, asked, source)
    digest = hashlib.sha256(values.tobytes() + time.tobytes()).hexdigest()
    found = (f"joint states of {topic}", *findings, *notes)
    return Log(source, "bag of ROS", (session,), None, found, "message", sha256=digest)


def _positions(message: Any, number: int, source: str) -> dict[str, float]:
    """Positions by joint; refused where they do not belong together."""

    def refuse(found: str, expected: str) -> InputError:
        return InputError.at(
            source, line=number, found=found, expected=expected, line_word="message"
        )

    names, positions = list(message.name), np.asarray(message.position).tolist()
    if len(names) != len(positions):
        raise refuse(f"{len(names)} names and {len(positions)} positions", "one for each name")
    twice = [name for name in names if names.count(name) > 1]
    if twice:
        raise refuse(f"{twice[0]} twice", "each joint once")
    wrong = [n for n, p in zip(names, positions, strict=True) if not np.isfinite(p)]
    if wrong:
        raise refuse(f"no finite position of {wrong[0]}", "finite positions")
    return dict(zip(names, positions, strict=True))


def _times(
    messages: list[tuple[int, Any]], lines: np.ndarray, source: str
) -> tuple[FloatArray, list[str]]:
    """Times from the first message [s], by the header, and what there is to say of them."""
    received = [time for time, _ in messages]
    stamps = [m.header.stamp.sec * 10**9 + m.header.stamp.nanosec for _, m in messages]
    first = next((row for row, stamp in enumerate(stamps) if stamp), None)
    if first is None:
        said = "headers have no time: that of receipt is taken"
        return np.array([t - received[0] for t in received]) / 1e9, [said]
    blank = next((row for row, stamp in enumerate(stamps) if not stamp and row > first), None)
    if blank is not None:  # simulated time begins at zero: there that is no blank
        raise InputError.at(
            source,
            line=int(lines[blank]),
            found="a header without time, where others have one",
            expected="a time in each header, or in none",
            line_word="message",
        )
    late = np.array([r - s for r, s in zip(received, stamps, strict=True)]) / 1e9
    said = f"times are of the headers; receipt is later by {np.median(late):.2g} s, "
    said += f"by {late.min():.2g} to {late.max():.2g} s in single messages"
    return np.array([s - stamps[0] for s in stamps]) / 1e9, [said]


def _looks_commanded(values: FloatArray, time: FloatArray) -> bool:
    """Whether nothing at all moves for as long as a pose is held, though positions know no step."""
    moving = [column for column in values.T if np.ptp(column) > 0.0]
    if not moving or max(_common_step(column) for column in moving) > FINEST:
        return False
    changes = np.flatnonzero(np.any(np.diff(values, axis=0) != 0.0, axis=1))
    first, last = np.r_[0, changes + 1], np.r_[changes, len(values) - 1]
    return bool((time[last] - time[first] >= HOLD).any())


def _common_step(values: FloatArray) -> float:
    """Greatest step that all values are multiples of, to a tenth of `FINEST`: Euclid's way."""
    step = 0.0
    for gap in np.diff(np.unique(values))[:ENOUGH].tolist():
        step, rest = max(step, gap), min(step, gap)
        while rest > FINEST / 10:
            step, rest = rest, min(step % rest, rest - step % rest)
    return step
