"""Nothing of the user's is lost, and a folder with a result is whole."""

from __future__ import annotations

import json
import os
import signal
import subprocess
import sys
import textwrap
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import pytest

import rsicalib
from rsicalib import DEMO, InputError
from rsicalib.io.folders import MARK, write_folder
from tests.commands import run_text as run

READINGS = (DEMO / "readings.csv").read_text(encoding="utf-8")
MINE = "measured by me\n"


def names(folder: Path) -> set[str]:
    return {path.name for path in folder.iterdir()}


def test_measured_readings_are_not_overwritten_by_a_simulation(tmp_path: Path) -> None:
    path = tmp_path / "readings.csv"
    path.write_text(READINGS, encoding="utf-8")
    done = run("simulate", ".", "--poses", "4", cwd=tmp_path)
    assert done.returncode == 2
    assert "readings.csv: found a file that rsicalib did not write" in done.stderr
    assert "--force" in done.stderr
    assert path.read_text(encoding="utf-8") == READINGS and names(tmp_path) == {"readings.csv"}
    assert run("simulate", ".", "--poses", "4", "--force", cwd=tmp_path).returncode == 0
    assert path.read_text(encoding="utf-8") != READINGS


def test_a_simulation_is_replaced_unless_it_was_changed(tmp_path: Path) -> None:
    rsicalib.simulate(tmp_path, poses=4, seed=1)
    rsicalib.simulate(tmp_path, poses=4, seed=2)
    truth = json.loads((tmp_path / "truth.json").read_text())
    assert truth["format"] == "rsicalib.truth/1" and truth["seed"] == 2
    with (tmp_path / "check.csv").open("a", encoding="utf-8") as file:
        file.write("\n")
    with pytest.raises(InputError, match=r"check\.csv"):
        rsicalib.simulate(tmp_path, poses=4, seed=3)
    assert json.loads((tmp_path / "truth.json").read_text()) == truth
    rsicalib.simulate(tmp_path, poses=4, seed=3, force=True)


@pytest.mark.parametrize("name", ["result.json", "report.txt", "report.html", "calibrated.toml"])
def test_a_result_replaces_only_a_result(tmp_path: Path, name: str) -> None:
    (tmp_path / name).write_text(MINE, encoding="utf-8")
    words = ("calibrate", str(DEMO / "readings.csv"), "--quiet", "--out", ".")
    done = run(*words, cwd=tmp_path)
    assert done.returncode == 2 and name in done.stderr
    assert (tmp_path / name).read_text(encoding="utf-8") == MINE
    assert names(tmp_path) == {name}


def test_a_result_of_its_own_is_replaced(tmp_path: Path) -> None:
    words = ("calibrate", str(DEMO / "readings.csv"), "--quiet", "--out", ".")
    for _ in range(2):
        assert run(*words, cwd=tmp_path).returncode == 4
    files = {"result.json", "report.txt", "report.html", "calibrated.toml"}
    assert files <= names(tmp_path)


def test_the_seal_goes_first_and_comes_last(tmp_path: Path) -> None:
    seal = f'{{"format": "rsicalib.calibration/1", "text": "{MARK}"}}'
    write_folder(tmp_path, {"a.txt": MARK, "seal.json": seal}, seal="seal.json")
    (tmp_path / "a.txt").unlink()
    (tmp_path / "a.txt").mkdir()  # now it cannot be written
    with pytest.raises(InputError):
        write_folder(tmp_path, {"seal.json": seal, "a.txt": MARK}, seal="seal.json", force=True)
    assert names(tmp_path) == {"a.txt"}


SLOW_WRITER = textwrap.dedent(
    """
    import sys, time
    from rsicalib.io import folders
    write = folders.write_text
    def slow(path, text):
        write(path, text)
        print(path.name, flush=True)
        time.sleep(60)
    folders.write_text = slow
    seal = '{"format": "rsicalib.calibration/1"}'
    folders.write_folder(sys.argv[1], {"seal.json": seal, "a.txt": folders.MARK}, seal="seal.json")
    """
)


@contextmanager
def slow_writer(folder: Path) -> Iterator[subprocess.Popen[str]]:
    """A process that has written `a.txt` and is about to write the seal."""
    command = [sys.executable, "-c", SLOW_WRITER, str(folder)]

    def heed() -> None:
        # What runs in the background of a shell ignores the signal, and its children do.
        signal.signal(signal.SIGINT, signal.SIG_DFL)

    with subprocess.Popen(
        command, stdout=subprocess.PIPE, stderr=subprocess.DEVNULL, text=True, preexec_fn=heed
    ) as process:
        try:
            assert process.stdout is not None and process.stdout.readline() == "a.txt\n"
            yield process
        finally:
            process.kill()


@pytest.mark.skipif(os.name != "posix", reason="locks of folders and kill -9 are POSIX")
def test_a_second_writer_is_refused_and_a_killed_one_leaves_no_seal(tmp_path: Path) -> None:
    with slow_writer(tmp_path) as first:
        with pytest.raises(InputError, match="another rsicalib"):
            write_folder(tmp_path, {"b.txt": MARK})
        first.send_signal(signal.SIGKILL)
        first.wait(10)
    assert names(tmp_path) == {"a.txt"}
    write_folder(tmp_path, {"b.txt": MARK})


FULL_DISK = textwrap.dedent(
    """
    import resource, signal, sys
    signal.signal(signal.SIGXFSZ, signal.SIG_IGN)
    resource.setrlimit(resource.RLIMIT_FSIZE, (2000, 2000))
    from rsicalib.cli import main
    main(sys.argv[1:])
    """
)


@pytest.mark.skipif(sys.platform != "linux", reason="a limit of file size stands for a full disk")
def test_a_full_disk_is_said_and_leaves_no_part_and_no_result(tmp_path: Path) -> None:
    words = ["calibrate", str(DEMO / "readings.csv"), "--quiet", "--out", str(tmp_path)]
    done = subprocess.run(
        [sys.executable, "-c", FULL_DISK, *words], capture_output=True, text=True, timeout=100
    )
    assert done.returncode == 2 and "one cannot write" in done.stderr
    assert "result.json" not in names(tmp_path)
    assert not [name for name in names(tmp_path) if name.endswith(".part")]


@pytest.mark.skipif(os.name != "posix" or os.geteuid() == 0, reason="root may write anywhere")
def test_a_read_only_folder_is_refused(tmp_path: Path) -> None:
    tmp_path.chmod(0o500)
    with pytest.raises(InputError, match="one cannot write"):
        write_folder(tmp_path, {"a.txt": MARK})


@pytest.mark.skipif(os.name != "posix", reason="SIGINT")
def test_an_interruption_while_writing_leaves_no_part(tmp_path: Path) -> None:
    with slow_writer(tmp_path) as first:
        first.send_signal(signal.SIGINT)
        assert first.wait(30) != 0
    assert names(tmp_path) == {"a.txt"}
