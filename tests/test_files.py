"""Files that are written whole or not at all, and the number of cores on any system."""

from __future__ import annotations

import os
from pathlib import Path

import pytest

import rsicalib
from rsicalib import DEMO, InputError
from rsicalib.cores import available_cores
from rsicalib.io.files import whole_file, without_parts, write_text


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
