"""The command on any terminal: replacements, never a crash; data are UTF-8; nothing acts on it."""

from __future__ import annotations

import json
import os
import subprocess
import sys
from pathlib import Path

import pytest

from rsicalib import DEMO
from rsicalib.plain_text import printable

READINGS = str(DEMO / "readings.csv")
ENCODINGS = ("ascii", "latin-1", "cp1252")


def run(
    *words: str, encoding: str = "utf-8", cwd: Path | None = None, **environment: str
) -> subprocess.CompletedProcess[bytes]:
    kept = {k: v for k, v in os.environ.items() if k not in ("HOME", "PYTHONUTF8")}
    changed = {**kept, "PYTHONIOENCODING": encoding, "LC_ALL": "C", **environment}
    command = [sys.executable, "-m", "rsicalib", *words]
    return subprocess.run(command, capture_output=True, env=changed, cwd=cwd, timeout=100)


@pytest.mark.parametrize("encoding", ENCODINGS)
def test_words_are_replaced_where_the_terminal_has_not_got_them(encoding: str) -> None:
    done = run("calibrate", READINGS, encoding=encoding)
    assert done.returncode == 4, done.stderr
    text = done.stdout.decode(encoding)
    assert "chi" in text and "?" not in text


@pytest.mark.parametrize("words", [("--help",), ("trace", "--help"), ("terms",), ("mechanism",)])
def test_help_and_lists_are_printed_in_ascii(words: tuple[str, ...]) -> None:
    done = run(*words, encoding="ascii", COLUMNS="40")
    assert done.returncode == 0 and len(done.stdout) > 100, done.stderr


def test_json_is_utf_8_on_any_terminal() -> None:
    plain = run("calibrate", READINGS, "--json", "--note", "Gerät")
    ascii_only = run("calibrate", READINGS, "--json", "--note", "Gerät", encoding="ascii")
    assert plain.stdout == ascii_only.stdout
    assert json.loads(ascii_only.stdout)["note"] == "Gerät"


@pytest.mark.skipif(not Path("/dev/full").exists(), reason="no /dev/full here")
@pytest.mark.parametrize("words", [("terms",), ("calibrate", READINGS, "--json"), ("--help",)])
def test_a_full_standard_output_is_said(words: tuple[str, ...]) -> None:
    with open("/dev/full", "w", encoding="utf-8") as full:
        done = subprocess.run(
            [sys.executable, "-m", "rsicalib", *words], stdout=full, stderr=subprocess.PIPE
        )
    assert done.returncode == 2, done.stderr
    assert done.stderr.decode().startswith("error: standard output: No space left")
    assert b"Traceback" not in done.stderr


@pytest.mark.skipif(os.name != "posix", reason="a shell that closes streams")
@pytest.mark.parametrize("closed", [">&-", "2>&-", ">&- 2>&-"])
def test_a_closed_stream_takes_nothing_and_no_file_takes_its_place(
    closed: str, tmp_path: Path
) -> None:
    command = f'"{sys.executable}" -m rsicalib calibrate "{READINGS}" --out "{tmp_path}" {closed}'
    done = subprocess.run(["sh", "-c", command], capture_output=True, timeout=100)
    assert done.returncode == 4, done.stderr
    assert json.loads((tmp_path / "result.json").read_text(encoding="utf-8"))["verdict"]
    assert (tmp_path / "report.html").read_bytes().startswith(b"<!doctype html>")


def test_control_characters_of_files_do_not_reach_the_terminal(tmp_path: Path) -> None:
    name = "a\x1b]0;owned\x07\u202e.csv"
    (tmp_path / name).write_text("x\x1b[31m,y\n1,2\n", encoding="utf-8")
    done = run("calibrate", name, cwd=tmp_path)
    assert done.returncode == 2
    assert b"\x1b" not in done.stderr + done.stdout and "\u202e".encode() not in done.stderr
    assert b"a\\x1b]0;owned\\x07\\u202e.csv" in done.stderr


@pytest.mark.parametrize(
    ("text", "shown"),
    [
        ("plain χ² ≤ 1\n\tend", "plain χ² ≤ 1\n\tend"),
        ("\x1b[2J\r\x08", "\\x1b[2J\\r\\x08"),
        ("\u200b\u2028\U000e0001", "\\u200b\\u2028\\U000e0001"),
        ("\ud800", "\\ud800"),
    ],
)
def test_characters_that_act_are_written_out(text: str, shown: str) -> None:
    assert printable(text) == shown
