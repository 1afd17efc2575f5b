"""A command that the tests run in a forked child does what one in a new process does."""

from __future__ import annotations

import contextlib
import os
import subprocess
import sys
import time
from pathlib import Path

import pytest

from rsicalib import DEMO
from tests import commands

pytestmark = pytest.mark.skipif(not commands.FORKS, reason="commands are not forked here")

READINGS = str(DEMO / "readings.csv")
WORDS = [
    ["--help"],
    ["terms", "curvature"],
    ["calibrate", "nowhere.csv"],
    ["calibrate", "nowhere.csv", "--json"],
    ["calibrate", READINGS, "--out", "out"],
    ["rehearse"],
]


def real(*words: str, cwd: Path) -> subprocess.CompletedProcess[bytes]:
    command = [sys.executable, "-m", "rsicalib", *words]
    return subprocess.run(command, stdin=subprocess.DEVNULL, capture_output=True, cwd=cwd)


@pytest.mark.parametrize("words", WORDS, ids=" ".join)
def test_a_forked_command_says_and_writes_what_a_real_one_does(
    words: list[str], tmp_path: Path
) -> None:
    folders = [tmp_path / name for name in ("real", "forked", "shell")]
    for folder in folders:
        folder.mkdir()
    program = commands.program()
    assert program is not None
    every = [
        real(*words, cwd=folders[0]),
        commands.run(*words, cwd=folders[1]),
        subprocess.run([program, *words], capture_output=True, cwd=folders[2]),
    ]
    said = {(done.returncode, done.stdout, done.stderr) for done in every}
    assert len(said) == 1
    written = [{path.name: path.read_bytes() for path in f.rglob("*.json")} for f in folders]
    assert written[0] == written[1] == written[2]


def test_the_environment_and_the_folder_are_those_that_are_asked_for(tmp_path: Path) -> None:
    narrow = commands.run("--help", cwd=tmp_path, env={**os.environ, "COLUMNS": "40"})
    wide = commands.run("--help", cwd=tmp_path, env={**os.environ, "COLUMNS": "200"})
    assert len(narrow.stdout.splitlines()) > len(wide.stdout.splitlines())
    (tmp_path / "mine.csv").write_bytes(Path(READINGS).read_bytes())
    assert commands.run("calibrate", "mine.csv", "--quiet", cwd=tmp_path).returncode == 4


def test_what_an_interpreter_hears_of_at_its_start_starts_one(tmp_path: Path) -> None:
    plain = {**os.environ, "PYTHONIOENCODING": "ascii"}
    done = commands.run("calibrate", READINGS, env=plain)
    assert b"chi" in done.stdout and done.stdout.isascii()


def test_a_command_that_is_not_waited_for_is_ended(tmp_path: Path) -> None:
    # A pipe without a writer is waited for for ever.
    os.mkfifo(tmp_path / "rows")
    with pytest.raises(TimeoutError):
        commands.run("forward", "rows", cwd=tmp_path, timeout=1.0)
    until = time.monotonic() + 30.0
    while works_in(tmp_path) and time.monotonic() < until:
        time.sleep(0.02)
    assert not works_in(tmp_path)


def works_in(folder: Path) -> bool:
    """Whether a process has this folder for its own; one may end while it is looked at."""
    for link in Path("/proc").glob("[0-9]*/cwd"):
        with contextlib.suppress(OSError):
            if os.readlink(link) == os.path.realpath(folder):
                return True
    return False
