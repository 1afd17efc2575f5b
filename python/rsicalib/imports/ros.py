"""Joint states of ROS: bags (folders of rosbag2, `.db3`, `.mcap`; `.bag` of ROS 1), without ROS.

Names of joints stand in every message, in any order. The time is that of the header, where the
state was measured; the time at which it was received is later, by as much as is said.
"""

from __future__ import annotations

import hashlib
from contextlib import ExitStack
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from rsicalib.arrays import FloatArray
from rsicalib.errors import InputError
from rsicalib.imports.asked import HOLD, Asked, chosen
from rsicalib.imports.bags import STATE, Bag, open_bag
from rsicalib.imports.columns import whole_rows
from rsicalib.imports.condition import Condition
from rsicalib.imports.log import Log
from rsicalib.imports.stretches import Recording, session_of
from rsicalib.io.extras import read_by
from rsicalib.io.tables import Lines

Message = tuple[int | None, Any]
"""Time of receipt [ns], where it is known, and the message."""

COMMANDS = ("command", "cmd", "target", "desired", "goal", "reference", "setpoint")
"""Parts of the names of topics that carry what was asked for, not what was measured."""

STOPPED = "Where the command was stopped in the middle of a message, delete its lines."
"""What to do with a last message that is not whole, of those that were printed as text."""

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
    with read_by("rosbags or mcap", source, "a bag of ROS that is whole", _mends(source)):
        with ExitStack() as stack:
            bag = open_bag(source, stack)
            topic = _topic(bag, asked.topic, source)
            messages: list[Message] = list(bag.messages(topic))
            inside = None
            if asked.when is not None:
                inside = Condition.of(asked.when, bag.topics, source).holds(bag, messages, source)
    if not messages:
        expected = "messages with joint states"
        raise InputError.at(source, "none", expected, place=topic)
    rows = Lines(source, np.arange(1, len(messages) + 1), "message")
    return log_of(rows, "bag of ROS", topic, messages, inside, asked)


def _mends(source: str) -> str:
    """What makes a bag whole that its recorder did not close."""
    path = Path(source)
    if path.is_dir() and not (path / "metadata.yaml").is_file():
        return "It lacks metadata.yaml: ros2 bag reindex FOLDER, or give the file that is in it."
    if path.suffix == ".mcap":
        return "If its recorder was cut short: mcap recover IN -o OUT."
    if path.suffix in (".bag", ".active"):
        return "If its recorder was cut short: rosbag reindex FILE."
    return "If its recorder was cut short: ros2 bag reindex FOLDER."


def _topic(bag: Bag, asked: str | None, source: str) -> str:
    """The topic that is asked for; else the one with joint states that are no commands."""
    known = [name for name, kind in bag.topics.items() if kind == STATE]
    if asked is not None:
        if asked not in known:
            has = asked in bag.topics
            found = f"messages of {bag.topics[asked]}" if has else "no such topic"
            hint = f"Topics with joint states: {', '.join(sorted(known)) or 'none'}."
            raise InputError.at(source, found, STATE, column=asked, hint=hint, column_word="topic")
        return asked
    states = [name for name in known if not _is_command(name)] or known
    if len(states) != 1:
        found = f"{len(states)} topics with joint states" if states else "no joint states"
        hint = f"Say which by rsicalib import --topic: {', '.join(states)}." if states else ""
        all_topics = ", ".join(f"{name} ({kind})" for name, kind in bag.topics.items())
        hint = hint or f"Its topics: {all_topics[:300]}."
        raise InputError.at(source, found, f"one topic of {STATE}", hint=hint)
    return states[0]


def _is_command(topic: str) -> bool:
    return any(word in topic.lower() for word in COMMANDS)


def log_of(
    rows: Lines,
    kind: str,
    topic: str,
    messages: list[Message],
    inside: np.ndarray | None,
    asked: Asked,
) -> Log:
    """The log that joint states are.

    Parameters
    ----------
    rows : Lines
        Where each message stands.
    kind, topic : str
        What it is in words, and where the joint states are.
    messages : list of Message
        In order of time; a message has `name`, `position`, and a `header` where there is one.
    inside : ndarray of bool, shape (n,), or None
        At which there is contact, where that was asked for.
    asked : Asked
        Options of the import.

    Raises
    ------
    InputError
        A message has some of the joints and not others, or no finite positions.
    """
    positions = [_positions(message, rows, row) for row, (_, message) in enumerate(messages)]
    names = list(dict.fromkeys(name for at in positions for name in at))
    places = chosen(asked.channels, names, rows.source, "joint")
    joints = [names[k] for k in places.values()]
    table = np.full((len(messages), len(joints)), np.nan)
    there = np.zeros(table.shape, dtype=bool)
    for row, at in enumerate(positions):
        for column, joint in enumerate(joints):
            if joint not in at:
                continue
            if not _finite(at[joint]):
                raise rows.fault(row, f"no finite position of {joint}", "finite positions")
            table[row, column], there[row, column] = at[joint], True
    keep, others = whole_rows(there, joints, rows, asked.skip_bad_rows)
    rows = replace(rows, numbers=rows.numbers[keep])
    time, findings = _times([messages[row] for row in keep.tolist()], rows)
    values = table[keep]
    if others:
        findings.append(f"{others} messages without these joints are not used")
    contact = None
    if inside is not None:
        contact = inside[keep]
        findings.append(f"{contact.mean():.0%} of the messages are under {asked.when}")
        if not contact.any():
            expected = "at least one message at which the condition holds"
            raise InputError.at(rows.source, "none", expected, column=asked.when)
    if _is_command(topic) or _looks_commanded(values, time):
        findings.append(
            f"the positions of {topic} look like commands: they stand exactly still, and are finer "
            "than any encoder (or the name says so); commands close better than an arm does"
        )
    recording = Recording(tuple(places), values, time, rows.numbers, contact)
    session, notes = session_of(recording, asked, rows.source)
    times = b"" if time is None else time.tobytes()
    digest = hashlib.sha256(values.tobytes() + times).hexdigest()
    found = (f"joint states of {topic}", *findings, *notes)
    return Log(rows.source, kind, (session,), None, found, rows.word, sha256=digest)


def _positions(message: Any, rows: Lines, row: int) -> dict[str, float]:
    """Positions by joint; refused where they do not belong together."""

    def refuse(found: str, expected: str) -> InputError:
        return rows.fault(row, found, expected, hint=STOPPED if rows.word == "line" else "")

    lists: list[Any] = [getattr(message, field, None) for field in ("name", "position")]
    if any(one is None or isinstance(one, str) or not hasattr(one, "__len__") for one in lists):
        raise refuse("a message without lists of names and positions", "a joint state")
    names, positions = list(lists[0]), np.asarray(lists[1]).tolist()
    if len(names) != len(positions):
        raise refuse(f"{len(names)} names and {len(positions)} positions", "one for each name")
    if not all(isinstance(name, str) for name in names):
        raise refuse(f"names {names!r}"[:80], "texts")
    twice = [name for name in names if names.count(name) > 1]
    if twice:
        raise refuse(f"{twice[0]} twice", "each joint once")
    return dict(zip(names, positions, strict=True))


def _finite(value: Any) -> bool:
    number = isinstance(value, int | float) and not isinstance(value, bool)
    return number and bool(np.isfinite(value))


def _stamp(message: Any) -> int:
    """When a state was measured [ns]; 0 where its header does not say."""
    stamp = getattr(getattr(message, "header", None), "stamp", None)
    for whole, fine in (("sec", "nanosec"), ("secs", "nsecs"), ("sec", "nsec")):
        if hasattr(stamp, whole) and hasattr(stamp, fine):
            return int(getattr(stamp, whole)) * 10**9 + int(getattr(stamp, fine))
    return 0


def _times(messages: list[Message], rows: Lines) -> tuple[FloatArray | None, list[str]]:
    """Times from the first message [s], by the header, and what there is to say of them."""
    stamps = []
    for row, (_, message) in enumerate(messages):
        try:
            stamps.append(_stamp(message))
        except (TypeError, ValueError, OverflowError):
            found, expected = "a stamp that is no time", "whole seconds and nanoseconds"
            raise rows.fault(row, found, expected) from None
    received = [time for time, _ in messages if time is not None]
    first = next((row for row, stamp in enumerate(stamps) if stamp), None)
    if first is None and not received:
        return None, ["headers have no time"]
    if first is None:
        said = "headers have no time: that of receipt is taken"
        return np.array([t - received[0] for t in received]) / 1e9, [said]
    blank = next((row for row, stamp in enumerate(stamps) if not stamp and row > first), None)
    if blank is not None:  # simulated time begins at zero: there that is no blank
        found = "a header without time, where others have one"
        raise rows.fault(blank, found, "a time in each header, or in none")
    time = np.array([s - stamps[0] for s in stamps]) / 1e9
    if not received:
        return time, []
    late = np.array([r - s for r, s in zip(received, stamps, strict=True)]) / 1e9
    said = f"times are of the headers; receipt is later by {np.median(late):.2g} s, "
    said += f"by {late.min():.2g} to {late.max():.2g} s in single messages"
    return time, [said]


def _looks_commanded(values: FloatArray, time: FloatArray | None) -> bool:
    """Whether nothing at all moves for as long as a pose is held, though positions know no step."""
    moving = [column for column in values.T if np.ptp(column) > 0.0]
    if time is None or not moving or max(_common_step(column) for column in moving) > FINEST:
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
