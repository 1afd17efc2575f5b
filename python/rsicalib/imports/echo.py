"""Joint states as text: what `ros2 topic echo` or `rostopic echo` printed, or JSON a line."""

from __future__ import annotations

import numpy as np

from rsicalib.errors import InputError
from rsicalib.imports.asked import Asked
from rsicalib.imports.bags import namespace
from rsicalib.imports.log import Log
from rsicalib.imports.ros import STOPPED, Message, log_of
from rsicalib.io.messages import documents, message_of
from rsicalib.io.sources import read_text
from rsicalib.io.tables import Lines


def read(source: str, asked: Asked) -> Log:
    """Read the messages of a topic.

    Raises
    ------
    InputError
        A message is not whole, or has some of the joints and not others.
    """
    messages: list[Message] = []
    lines: list[int] = []
    for line, text in documents(read_text(source, "joint states as text").splitlines()):
        found = message_of(text)
        if isinstance(found, str):
            expected = "a joint state that is whole"
            said = found.removeprefix("found ")
            raise InputError.at(source, said, expected, line=line, hint=STOPPED)
        messages.append((None, namespace(found)))
        lines.append(line)
    if not messages:
        raise InputError.at(source, "no message", "joint states")
    rows = Lines(source, np.array(lines), "line")
    return log_of(rows, "joint states as text", "the text", messages, None, asked)
