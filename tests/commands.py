"""The command, run without a new interpreter for each run.

A server starts once for each process of the tests, as `python` with all modules of the package
imported and nothing computed. For each command it forks, and the child becomes what a new process
is: its streams, folder, arguments and variables are those that were asked for, `__main__` runs, and
it ends as an interpreter does, but for its memory, which is left to the system. What an interpreter
does at its start is the server's, so a command whose variables differ in that has a process of its
own. So has every test of signals, terminals, streams that are closed or pipes whose other end acts.
"""

from __future__ import annotations

import atexit
import gc
import importlib
import marshal
import os
import pkgutil
import runpy
import select
import shlex
import signal
import socket
import subprocess
import sys
import tempfile
import threading
from collections.abc import Mapping
from functools import cache
from io import TextIOWrapper
from pathlib import Path
from typing import NoReturn, TextIO

from tests.asking import HEAD, STATUS, asked, whole

ROOT = Path(__file__).parents[1]
FORKS = sys.platform == "linux"
"""Whether commands are forked: elsewhere a library may not work in a child."""

AT_START = ("PYTHON", "LC_", "LANG", "OPENBLAS_", "OMP_", "MKL_", "LD_")
"""How variables begin that only a process that starts hears of."""


# ------------------------------------------------------------------ asking


def run(
    *words: str | bytes | os.PathLike[str],
    cwd: Path | None = None,
    env: Mapping[str, str] | None = None,
    timeout: float = 300.0,
) -> subprocess.CompletedProcess[bytes]:
    """`rsicalib WORDS` with nothing to read: what it exits with and prints, as bytes."""
    variables = dict(os.environ if env is None else env)
    if not FORKS or at_start(variables) != at_start(os.environ):
        command = [sys.executable, "-m", "rsicalib", *words]
        return subprocess.run(
            command,
            stdin=subprocess.DEVNULL,
            capture_output=True,
            cwd=cwd,
            env=variables,
            timeout=timeout,
        )
    given = [os.fsencode(word) for word in words]
    folder = os.fsencode(cwd or os.getcwd())
    heard = {os.fsencode(key): os.fsencode(value) for key, value in variables.items()}
    with open(os.devnull) as none, tempfile.TemporaryFile() as out, tempfile.TemporaryFile() as err:
        streams = [file.fileno() for file in (none, out, err)]
        code = asked(server(), given, streams, folder, heard, timeout)
        printed = []
        for file in (out, err):
            file.seek(0)
            printed.append(file.read())
    return subprocess.CompletedProcess(["rsicalib", *map(os.fsdecode, given)], code, *printed)


def run_text(
    *words: str | os.PathLike[str], cwd: Path | None = None, timeout: float = 300.0
) -> subprocess.CompletedProcess[str]:
    """What `run` gives, as text."""
    done = run(*words, cwd=cwd, timeout=timeout)
    printed = (part.decode().replace(os.linesep, "\n") for part in (done.stdout, done.stderr))
    return subprocess.CompletedProcess(done.args, done.returncode, *printed)


def at_start(variables: Mapping[str, str]) -> dict[str, str]:
    """What an interpreter and its libraries take from the environment when they start."""
    return {key: value for key, value in variables.items() if key.startswith(AT_START)}


@cache
def program() -> Path | None:
    """The command as a program in a folder that shells may search; None: there is only a real one.

    It starts in a hundredth of a second, and does what `run` does for the streams of its shell.
    """
    if not FORKS:
        return None
    where = server()
    path = Path(where).with_name("bin") / "rsicalib"
    path.parent.mkdir()
    words = [sys.executable, "-IS", str(ROOT / "tests" / "asking.py"), where]
    path.write_text(f'#!/bin/sh\nexec {shlex.join(words)} "$@"\n', encoding="utf-8")
    path.chmod(0o700)
    return path


@cache
def server() -> str:
    """Start the server of this process; where it is asked."""
    folder = tempfile.TemporaryDirectory(prefix="rsicalib-")
    where = os.path.join(folder.name, "ask")
    process = subprocess.Popen(
        [sys.executable, "-m", "tests.commands", where],
        cwd=ROOT,
        stdin=subprocess.PIPE,
        stdout=subprocess.PIPE,
        start_new_session=True,
    )
    assert process.stdin is not None and process.stdout is not None
    if process.stdout.readline() != b"ready\n":
        raise RuntimeError("the server of the commands does not start")

    def end() -> None:
        process.communicate()  # the server ends where nobody holds its input any more
        folder.cleanup()

    atexit.register(end)
    return where


# ------------------------------------------------------------------ the server


def serve(where: str) -> None:
    """Fork for each command that is asked for, until nobody holds the standard input."""
    import rsicalib

    for module in pkgutil.walk_packages(rsicalib.__path__, "rsicalib."):
        if module.name not in ("rsicalib.__main__", "rsicalib._core"):
            importlib.import_module(module.name)
    with socket.socket(socket.AF_UNIX) as listener:
        listener.bind(where)
        listener.listen()
        gc.collect()
        gc.freeze()  # a child that collected what the server holds would copy all of it
        os.write(1, b"ready\n")
        while True:
            ready, _, _ = select.select([0, listener], [], [])
            if 0 in ready:
                break
            connection, _ = listener.accept()
            if os.fork() == 0:
                listener.close()
                attend(connection)
                return
            connection.close()
            reap(os.WNOHANG)
    reap()


def reap(how: int = 0) -> None:
    """Wait for those that attend and have ended, or for all: their time is that of the tests."""
    try:
        while os.waitpid(-1, how)[0]:
            pass
    except ChildProcessError:
        pass


def attend(connection: socket.socket) -> None:
    """Run one command in a child and tell how it ended; end it where nobody waits any longer.

    It returns in the child alone, which then ends as a process of Python does.
    """
    head, streams, _, _ = socket.recv_fds(connection, HEAD.size, 3)
    words, cwd, environment = marshal.loads(whole(connection, HEAD.unpack(head)[0]))
    ended, held = os.pipe()
    child = os.fork()
    if child == 0:
        connection.close()
        os.close(ended)
        become(words, streams, cwd, environment)
    for end in (held, *streams):
        os.close(end)
    if ended not in select.select([connection, ended], [], [])[0]:
        os.kill(child, signal.SIGKILL)
    status = os.waitstatus_to_exitcode(os.waitpid(child, 0)[1])
    try:
        connection.sendall(STATUS.pack(status))
    except OSError:
        pass  # nobody waits
    os._exit(0)


def become(
    words: list[bytes], streams: list[int], cwd: bytes, environment: dict[bytes, bytes]
) -> NoReturn:
    """Be the process that `python -m rsicalib WORDS` would be."""
    for number, stream in enumerate(streams):
        os.dup2(stream, number)
        os.close(stream)
    # Those of the server have looked at what its own streams are.
    sys.stdin = sys.__stdin__ = opened(sys.stdin, "r")
    sys.stdout = sys.__stdout__ = opened(sys.stdout, "w")
    sys.stderr = sys.__stderr__ = opened(sys.stderr, "w")
    sys.stderr.reconfigure(line_buffering=True)
    os.chdir(cwd)
    os.environb.clear()
    os.environb.update(environment)
    sys.path[0] = os.fsdecode(cwd)
    sys.argv = ["rsicalib", *map(os.fsdecode, words)]
    leave(ended())


def ended() -> int:
    """Run the command: the exit code of an interpreter whose module ends so."""
    try:
        runpy.run_module("rsicalib", run_name="__main__", alter_sys=True)
    except SystemExit as left:
        if left.code is None or isinstance(left.code, int):
            return left.code or 0
        print(left.code, file=sys.stderr)
        return 1
    except BaseException:
        sys.excepthook(*sys.exc_info())
        return 1
    return 0


def leave(code: int) -> NoReturn:
    """End as an interpreter does, but for taking apart what the server had imported.

    That would copy all memory of the server, which costs as much as the command itself.
    """
    threading._shutdown()
    atexit._run_exitfuncs()
    try:
        sys.stdout.flush()
    except OSError:
        code = 120
    sys.stderr.flush()
    os._exit(code)


def opened(stream: TextIO, mode: str) -> TextIOWrapper:
    """A standard stream made anew, as a process makes it of what it finds."""
    words = {"encoding": stream.encoding, "errors": stream.errors, "newline": "\n"}
    out = open(stream.fileno(), mode, closefd=False, **words)
    assert isinstance(out, TextIOWrapper)
    return out


if __name__ == "__main__":
    serve(sys.argv[1])
