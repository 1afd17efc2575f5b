"""Asks the server of `tests/commands.py` to run a command, and waits for it.

A program of its own, and a small one: what a shell of a test finds in place of the command. It
imports nothing that takes time.
"""

from __future__ import annotations

import array
import marshal
import os
import signal
import socket
import struct
import sys

HEAD = struct.Struct("!I")
STATUS = struct.Struct("!i")


def whole(connection: socket.socket, size: int) -> bytes:
    """So many bytes; fewer where the other end has gone."""
    out = b""
    while len(out) < size and (part := connection.recv(size - len(out))):
        out += part
    return out


def asked(
    where: str,
    words: list[bytes],
    streams: list[int],
    cwd: bytes,
    environment: dict[bytes, bytes],
    timeout: float | None = None,
) -> int:
    """What the command exits with, or minus the signal that ended it; it is ended in time."""
    with socket.socket(socket.AF_UNIX) as connection:
        connection.settimeout(timeout)
        connection.connect(where)
        body = marshal.dumps((words, cwd, environment))
        ends = [(socket.SOL_SOCKET, socket.SCM_RIGHTS, array.array("i", streams))]
        connection.sendmsg([HEAD.pack(len(body))], ends)
        connection.sendall(body)
        status = whole(connection, STATUS.size)
    if len(status) < STATUS.size:
        raise RuntimeError("the server of the commands has gone")
    return int(STATUS.unpack(status)[0])


if __name__ == "__main__":
    given = [os.fsencode(word) for word in sys.argv[2:]]
    code = asked(sys.argv[1], given, [0, 1, 2], os.getcwdb(), dict(os.environb))
    if code < 0:
        signal.signal(-code, signal.SIG_DFL)
        os.kill(os.getpid(), -code)
    os._exit(code)
