"""Files that are written whole or not at all, and the number of cores on any system."""

from __future__ import annotations

import os
from pathlib import Path

import pytest

import rsicalib
from rsicalib import DEMO, InputError
from rsicalib.cores import available_cores
from rsicalib.io.files import whole_file, without_parts, write_text
from rsicalib.io.folders import write_folder
from tests.commands import run_text


def test_a_file_is_replaced_as_a_whole(tmp_path: Path) -> None:
    path = tmp_path / "out.txt"
    path.write_text("before", encoding="utf-8")
    with whole_file(path) as file:
        file.write("after: ±\n")
        file.flush()
        assert path.read_text(encoding="utf-8") == "before"
    assert path.read_bytes() == "after: ±\n".encode()
    assert list(tmp_path.iterdir()) == [path]


def test_an_interrupted_write_leaves_what_was_there(tmp_path: Path) -> None:
    path = write_text(tmp_path / "out.txt", "before")
    with pytest.raises(KeyboardInterrupt), whole_file(path) as file:
        file.write("half")
        raise KeyboardInterrupt
    assert path.read_text() == "before"
    assert list(tmp_path.iterdir()) == [path]


def test_a_part_of_a_file_is_removed_when_the_command_is_left_at_once(tmp_path: Path) -> None:
    with pytest.raises(InputError), whole_file(tmp_path / "out.txt") as file:
        file.write("half")
        with without_parts():
            assert list(tmp_path.iterdir()) == []


def test_a_link_stays_one_and_permissions_stay(tmp_path: Path) -> None:
    real, link = tmp_path / "real.json", tmp_path / "link.json"
    real.write_text("old", encoding="utf-8")
    real.chmod(0o600)
    link.symlink_to("real.json")
    write_text(link, "new")
    assert link.is_symlink() and real.read_text(encoding="utf-8") == "new"
    assert real.stat().st_mode & 0o777 == 0o600
    write_folder(tmp_path, {"link.json": '{"format": "rsicalib.x"}'}, seal="link.json", force=True)
    assert link.is_symlink() and "format" in real.read_text(encoding="utf-8")


def test_a_plan_and_its_page_are_two_files(tmp_path: Path) -> None:
    done = run_text("plan", "--out", "plan.html", cwd=tmp_path)
    assert done.returncode == 2 and "the page is written beside it" in done.stderr
    assert list(tmp_path.iterdir()) == []


@pytest.mark.skipif(os.name != "posix", reason="pipes with names")
def test_a_pipe_is_written_to_and_stays(tmp_path: Path) -> None:
    pipe = tmp_path / "pipe"
    os.mkfifo(pipe)
    end = os.open(pipe, os.O_RDONLY | os.O_NONBLOCK)
    write_text(pipe, "text")
    assert os.read(end, 10) == b"text" and pipe.is_fifo()
    os.close(end)


@pytest.mark.parametrize("name", ["", ".", "/"])
def test_a_path_without_a_name_is_refused(name: str, tmp_path: Path) -> None:
    with pytest.raises(InputError, match=r"expected the name of a file|no name"):
        write_text(name, "text")
    done = run_text("plan", "--out", name, cwd=tmp_path)
    assert done.returncode == 2 and "expected" in done.stderr
    assert list(tmp_path.iterdir()) == []
    with pytest.raises(InputError, match="found no name, expected that of a folder"):
        write_folder("", {"a.txt": "text"})


def test_a_place_where_one_cannot_write_is_refused(tmp_path: Path) -> None:
    nowhere = tmp_path / "missing" / "out.csv"
    with pytest.raises(InputError, match="one cannot write"):
        write_text(nowhere, "text")
    with pytest.raises(InputError, match="one cannot write"):
        rsicalib.load_readings(DEMO / "rest.csv").to_csv(nowhere)


@pytest.mark.parametrize(("counted", "cores"), [(3, 3), (None, 1)])
def test_cores_are_counted_where_a_system_has_no_affinity(
    monkeypatch: pytest.MonkeyPatch, counted: int | None, cores: int
) -> None:
    monkeypatch.delattr(os, "sched_getaffinity", raising=False)
    monkeypatch.setattr(os, "cpu_count", lambda: counted)
    monkeypatch.delattr(os, "process_cpu_count", raising=False)
    assert available_cores() == cores
    monkeypatch.setattr(os, "process_cpu_count", lambda: 2, raising=False)
    assert available_cores() == 2
