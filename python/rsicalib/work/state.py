"""The file of a watch that survives: what was watched, and all that the watch knew."""

from __future__ import annotations

import hashlib
import json
import os
from collections.abc import Mapping
from typing import Any

from rsicalib.errors import InputError
from rsicalib.facts.records import to_json
from rsicalib.io.files import write_bytes
from rsicalib.io.sources import read_bytes

FORMAT = "rsicalib.watch-state/1"


def write_state(path: str | os.PathLike[str], head: Mapping[str, Any], state: bytes) -> None:
    """Write a line of JSON and the bytes behind it, whole or not at all."""
    whole = {"format": FORMAT, "sha256": hashlib.sha256(state).hexdigest(), **head}
    line = json.dumps(json.loads(to_json(whole)), separators=(",", ":"))
    write_bytes(path, line.encode() + b"\n" + state)


def read_state(path: str | os.PathLike[str]) -> tuple[dict[str, Any], bytes]:
    """What `write_state` has written.

    Raises
    ------
    InputError
        It is no such file, or a damaged one.
    """
    line, _, state = read_bytes(path, "the state of a watch").partition(b"\n")
    try:
        head = json.loads(line)
    except (ValueError, RecursionError):
        head = None
    if not isinstance(head, dict) or head.get("format") != FORMAT:
        raise InputError.at(str(path), "another file", FORMAT)
    if head.get("sha256") != hashlib.sha256(state).hexdigest():
        raise InputError.at(str(path), "a damaged file", "what a watch has written")
    return head, state
