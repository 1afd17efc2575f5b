"""Joint states as text: JSON, an object a line, or what `ros2 topic echo` prints.

A message of `ros2 topic echo`, and of `rostopic echo`, is a block of lines that ends with `---`:

```text
header:
  stamp:
    sec: 1700000000
    nanosec: 123456789
name:
- elbow
- shoulder
position:
- 0.1
- 0.2
---
```
"""

from __future__ import annotations

import itertools
import json
import re
from collections.abc import Iterable, Iterator
from typing import Any

END = "---"
TALK = re.compile(r"WARNING\b|\[WARN|A message was lost|\s*total count")
"""Lines that are of the command, not of the topic."""

ENTRY = re.compile(r"\s*- +(.*?)\s*")
PAIR = re.compile(r"(\s*)([A-Za-z_]\w*):(?:\s+(.*?))?\s*")
STAMPS = {"sec": "sec", "secs": "sec", "nanosec": "nanosec", "nsecs": "nanosec"}
"""Fields of a stamp, of ROS 2 and ROS 1, as ROS 2 calls them."""

LISTS = ("name", "position", "velocity", "effort")
BEGINS = re.compile(r"\{|header:|---|WARNING\b|A message was lost")


def is_message(line: str) -> bool:
    """Whether a first line begins messages, and no table."""
    return bool(BEGINS.match(line.lstrip()))


def documents(lines: Iterable[str]) -> Iterator[tuple[int, str]]:
    """Whole messages as they arrive.

    Parameters
    ----------
    lines : iterable of str
        With or without their ends.

    Yields
    ------
    (int, str)
        Number of the line that it begins with, and its text.
    """
    begin, block = 1, list[str]()
    for number, raw in enumerate(lines, 1):
        line = raw.rstrip("\r\n")
        if TALK.match(line):
            continue
        if not block:
            begin = number
        if line.lstrip().startswith("{") and not block:
            yield number, line
        elif line.strip() == END:
            if block:
                yield begin, "\n".join(block)
            block = []
        elif line.strip() or block:
            block.append(line)
    if block:
        yield begin, "\n".join(block)


def as_json(lines: Iterable[str]) -> Iterator[str]:
    """Lines as they are; messages of `ros2 topic echo` as JSON, an object a line.

    What the first line that is not empty is, all are. A message that is not whole stays as it is:
    whoever takes it says so.
    """
    lines = iter(lines)
    for line in lines:
        if not line.strip():
            continue
        rest = itertools.chain([line], lines)
        if not is_message(line) or line.lstrip().startswith("{"):
            yield from rest
            return
        for _, text in documents(rest):
            found = message_of(text)
            yield text if isinstance(found, str) else json.dumps(found)


def message_of(text: str) -> dict[str, Any] | str:
    """A message by its fields; else what is wrong with it, in words.

    Parameters
    ----------
    text : str
        One of `documents`.

    Returns
    -------
    dict or str
        `name`, `position` and `header`, as `sensor_msgs/JointState` has them.
    """
    if not text.lstrip().startswith("{"):
        return _echoed(text)
    try:
        found = json.loads(text)
    except (ValueError, RecursionError) as error:
        return f"found no JSON ({error})"
    return found if isinstance(found, dict) else "found no object"


def positions_of(message: dict[str, Any]) -> dict[str, Any] | str:
    """Position of each joint, and `time_s` where there is a stamp; else what is wrong, in words.

    A message without names holds them itself: `{"q1": 0.1, "q2": 0.2}`.
    """
    names, positions = message.get("name"), message.get("position")
    if not isinstance(names, list) and positions is None:
        return message
    if not isinstance(names, list) or not isinstance(positions, list):
        return "found a message without lists of names and positions"
    if len(names) != len(positions) or len({str(n) for n in names}) != len(names):
        return f"found {len(names)} names and {len(positions)} positions, expected one of each"
    header = message.get("header")
    stamp = header.get("stamp") if isinstance(header, dict) else None
    out = dict(zip(map(str, names), positions, strict=True))
    if isinstance(stamp, dict) and "sec" in stamp:
        try:
            out["time_s"] = float(stamp["sec"]) + 1e-9 * float(stamp.get("nanosec", 0))
        except (TypeError, ValueError):
            return "found a stamp that is no time"
    return out


def _echoed(text: str) -> dict[str, Any] | str:
    """A block of lines."""
    fields: dict[str, Any] = {}
    stamp: dict[str, int] = {}
    key = ""
    for line in filter(str.strip, text.splitlines()):
        entry, pair = ENTRY.fullmatch(line), PAIR.fullmatch(line)
        try:
            if entry is not None and isinstance(fields.get(key), list):
                fields[key].append(_scalar(key, entry[1]))
            elif pair is not None and pair[1] and pair[2] in STAMPS:
                stamp[STAMPS[pair[2]]] = int(pair[3] or "")
            elif pair is not None and not pair[1]:
                key = pair[2]
                if key in fields:
                    return f"found {key} twice, expected {END} between two messages"
                fields[key] = _list(key, pair[3] or "") if key in LISTS else pair[3]
            elif pair is None:
                return f"found {line.strip()[:60]!r}, expected a field of a joint state"
        except ValueError:
            return f"found {line.strip()[:60]!r}, expected {key or 'a field'} of a joint state"
    return {**fields, "header": {"stamp": stamp}} if stamp else fields


def _list(key: str, text: str) -> list[Any]:
    """Entries that stand in one line, or none yet."""
    if not text:
        return []
    if not (text.startswith("[") and text.endswith("]")):
        raise ValueError(text)
    return [_scalar(key, part.strip()) for part in text[1:-1].split(",") if part.strip()]


def _scalar(key: str, text: str) -> str | float:
    """A name, or a number as YAML has it."""
    if key == "name":
        quoted = len(text) > 1 and text[0] == text[-1] and text[0] in "'\""
        return text[1:-1] if quoted else text
    return float(text.replace(".nan", "nan").replace(".inf", "inf"))
