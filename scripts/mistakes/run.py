"""A mistake made with the command, in a folder of its own."""

from __future__ import annotations

import os
import re
import shutil
import signal
import subprocess
import sys
import tempfile
import threading
import time
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import IO

import rsicalib
from rsicalib import DEMO
from scripts.mistakes.catalogue import Mistake

LIMIT = 120.0
"""Seconds after which a command is ended."""


@dataclass(frozen=True)
class Came:
    """What came of it."""

    code: int
    line: str
    text: str
    seconds: float
    megabytes: float


def prepared(folder: Path) -> None:
    """Good files."""
    for name in ("readings.csv", "rest.csv", "check.csv"):
        shutil.copy(DEMO / name, folder / name)
    found = rsicalib.trace(folder / "readings.csv", rest=folder / "rest.csv")
    found.save(folder / "result.json")
    (folder / "rsi.toml").write_text(rsicalib.load_mechanism("rsi").to_toml(), encoding="utf-8")


REAL = f'"{sys.executable}" -m rsicalib'
"""The command, as a shell runs it."""


def run(mistake: Mistake, good: Path, folder: Path, program: str = REAL) -> Came:
    """Make one mistake in an empty folder."""
    for path in good.iterdir():
        shutil.copy(path, folder / path.name)
    mistake.damage(folder)
    variables = {**os.environ, "COLUMNS": "100", "NO_COLOR": "1", **mistake.environment}
    kept = {key: value for key, value in variables.items() if value is not None}
    command = f"{program} {mistake.words} {mistake.shell}"
    begin = time.monotonic()
    with tempfile.TemporaryFile() as out, tempfile.TemporaryFile() as err:
        process = subprocess.Popen(
            ["sh", "-c", command],
            cwd=folder,
            env=kept,
            stdin=subprocess.DEVNULL,
            stdout=out,
            stderr=err,
            start_new_session=True,
        )
        alarm = threading.Timer(LIMIT, os.killpg, [process.pid, signal.SIGKILL])
        alarm.start()
        _, status, usage = os.wait4(process.pid, 0)
        alarm.cancel()
        process.returncode = os.waitstatus_to_exitcode(status)
        seconds = time.monotonic() - begin
        said, printed = (_whole(file) for file in (err, out))
    text = said.decode("utf-8", "replace") + printed.decode("utf-8", "replace")
    megabytes = usage.ru_maxrss / 1024
    return Came(process.returncode, _telling(said, printed), text, seconds, megabytes)


def _whole(file: IO[bytes]) -> bytes:
    file.seek(0)
    return file.read()


def _telling(err: bytes, out: bytes) -> str:
    """The first line that says what is wrong, or what was found."""

    def lines(text: bytes) -> Iterator[str]:
        return (part.strip() for part in text.decode("utf-8", "replace").splitlines())

    said = [part for part in lines(err) if re.match(r"(error|warning|rsicalib.*error):", part)]
    return next(iter([*said, *filter(None, lines(out))]), "")
