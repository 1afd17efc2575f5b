"""A command that a signal ends: at once, with the exit code of the signal, no file half written."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import textwrap
import time
from itertools import cycle, product
from pathlib import Path

import pytest

from rsicalib import DEMO
from rsicalib.cli.interruption import Ended, ends_by_signals, exit_code
from tests.full import sized

pytestmark = pytest.mark.skipif(os.name != "posix", reason="signals")

AT_ONCE_S = 5.0
"""What a busy machine needs for what takes a tenth of a second."""

PAUSED = textwrap.dedent(
    """
    import importlib, importlib.abc, os, sys, time
    place, words = sys.argv[1], sys.argv[2:]
    from rsicalib.cli import main

    def pause(*args, **options):
        os.write(1, b"now\\n")  # of several threads, a line each
        time.sleep(100)

    class Importing(importlib.abc.MetaPathFinder):
        def find_spec(self, name, path, target=None):
            if name == "pandas":
                pause()

    if place == "import":  # of what pyarrow imports by itself
        sys.meta_path.insert(0, Importing())
    else:
        module, name = place.split(":")
        owner = importlib.import_module(module)
        *inside, name = name.split(".")
        for part in inside:
            owner = getattr(owner, part)
        setattr(owner, name, pause)
    main(words)
    """
)
"""The command, which says so when it has come to a place, and stays there."""


def ended_at(place: str, words: list[str], folder: Path, number: int) -> tuple[int, float]:
    """Exit code of a command that gets a signal at a place, and the time it took to end."""

    def heed() -> None:
        # What runs in the background of a shell ignores the signal, and its children do.
        signal.signal(signal.SIGINT, signal.SIG_DFL)

    with subprocess.Popen(
        [sys.executable, "-c", PAUSED, place, *words],
        cwd=folder,
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
        preexec_fn=heed,
    ) as process:
        try:
            assert process.stdout is not None and process.stdout.readline() == "now\n"
            began = time.monotonic()
            process.send_signal(number)
            code = process.wait(30)
            took = time.monotonic() - began
            assert process.stderr is not None and process.stderr.read() == "interrupted\n"
        finally:
            process.kill()
    return code, took


@pytest.fixture
def devices(tmp_path: Path) -> Path:
    """A dataset of two devices, each in a row group of its own."""
    pa = pytest.importorskip("pyarrow")
    parquet = pytest.importorskip("pyarrow.parquet")
    head, *rows = (DEMO / "readings.csv").read_text().splitlines()
    names = ["device", *head.split(",")]
    cells = [[f"d{k}", *row.split(",")] for k in range(2) for row in rows]
    columns = {
        name: column if name == "device" else [float(cell) for cell in column]
        for name, column in zip(names, map(list, zip(*cells, strict=True)), strict=True)
    }
    path = tmp_path / "many.parquet"
    parquet.write_table(pa.table(columns), path, row_group_size=len(rows))
    return path


FLEET = {
    "a library is imported": "import",
    "a thread computes": "rsicalib.fleets.engines:calibrate_devices",
    "rows are written": "pyarrow.parquet:write_table",
    "the table is written": "pyarrow.parquet:ParquetWriter.write_table",
    "the page is made": "rsicalib.fleets.run:page",
}


SIGNALS = ("SIGINT", "SIGTERM")


# Each place with one of the signals by turns, and in full with both.
@pytest.mark.parametrize(
    ("name", "where"), sized([*zip(cycle(SIGNALS), FLEET)], [*product(SIGNALS, FLEET)])
)
def test_a_fleet_ends_at_once_wherever_it_is(
    where: str, name: str, devices: Path, tmp_path: Path
) -> None:
    number, place = getattr(signal, name), FLEET[where]
    if place == "import":
        pytest.importorskip("pandas")
    words = ["fleet", str(devices), "--no-trace", "--out", "out"]
    code, took = ended_at(place, words, tmp_path, number)
    assert code == 128 + number and took < AT_ONCE_S
    assert not [path for path in tmp_path.rglob("*") if path.suffix == ".part"]


VERBS = {
    "paper": ("concurrent.futures.thread:_WorkItem.run", ["--trials", "2"]),
    "calibrate": ("rsicalib.verbs.calibration:calibrate", [str(DEMO / "readings.csv")]),
    "import": ("rsicalib.imports.opening:import_log", ["x.csv", "--out", "out"]),
    "forward": ("rsicalib.poses.places:readings_for", [str(DEMO / "readings.csv")]),
    "plan": ("rsicalib.planning.plan:plan", []),
}


@pytest.mark.parametrize("verb", VERBS)
def test_every_verb_that_takes_its_time_ends_at_once(verb: str, tmp_path: Path) -> None:
    place, words = VERBS[verb]
    code, took = ended_at(place, [verb, *words], tmp_path, signal.SIGINT)
    assert code == 130 and took < AT_ONCE_S


def test_signals_end_a_command_as_ctrl_c_does_and_are_left_as_they_were() -> None:
    before = signal.signal(signal.SIGTERM, signal.SIG_DFL)
    try:
        with pytest.raises(Ended) as ended, ends_by_signals():
            os.kill(os.getpid(), signal.SIGTERM)
            time.sleep(1)
        assert exit_code(ended.value) == 128 + signal.SIGTERM
        assert exit_code(KeyboardInterrupt()) == 130
        assert signal.getsignal(signal.SIGTERM) is signal.SIG_DFL
        signal.signal(signal.SIGTERM, signal.SIG_IGN)
        with ends_by_signals():  # whoever has ignored it meant it
            os.kill(os.getpid(), signal.SIGTERM)
    finally:
        signal.signal(signal.SIGTERM, before)
