"""CSV and Parquet of plotting programs, spreadsheets and scripts."""

from __future__ import annotations

import gzip
from pathlib import Path

import numpy as np
import pytest

from tests.strangers import Made, text

START = 1_700_000_000


def lines(header: str, rows: list[str]) -> str:
    return "\n".join([header, *rows]) + "\n"


def plot(lost: int | None = None) -> str:
    """What Foxglove saves of a plot: a row for each value, one series after another."""
    rows = [
        f"{k / 50},{START + k / 50:.9f},{START + k / 50 - 0.004:.9f},/joint_states.position[{j}],"
        f"{np.sin(k / 10) + j}"
        for j in range(2)
        for k in range(40)
    ]
    if lost is not None:
        del rows[lost]
    return lines("elapsed time,receive time,header.stamp,topic,value", rows)


ECHOED = lines(
    "%time,field.header.seq,field.header.stamp,field.name0,field.position0,field.position1",
    [
        f"{START * 10**9 + 20_000_000 * k},{k},{START * 10**9},elbow,{k / 100},{-k / 50}"
        for k in range(20)
    ],
)
TWO = "__time,/joint_states/elbow/position,/joint_states/wrist/position"
PLOTTED = [f"{START + k / 50},{k},{-k}" for k in range(9)]


JOINTS = ("elbow", "wrist")
ROWS = [(k / 50, np.sin(min(k, 40) / 9), np.cos(min(k, 40) / 9)) for k in range(100)]
"""Two joints that move and stand still from 0.8 s on, 50 rows a second."""


def table(time: str = "time", mark: str = ",", by: float = 1.0, form: str = "{:.3f}") -> str:
    """A table of a script, by the name and the unit of its time."""
    rows = [mark.join([form.format(by * t), f"{a:.6f}", f"{b:.6f}"]) for t, a, b in ROWS]
    return lines(mark.join([time, *JOINTS]), rows)


def parquet(folder: Path) -> Path:
    """A folder of a data lake: two files, with a column of text."""
    pyarrow = pytest.importorskip("pyarrow")
    writer = pytest.importorskip("pyarrow.parquet")
    for part in range(2):
        table = pyarrow.table(
            {"timestamp": START * 10**9 + np.arange(9) * 10**7, "q1": np.arange(9.0) + part}
            | {"robot": ["r1"] * 9}
        )
        writer.write_table(table, folder / f"part-{part}.parquet")
    return folder


def partitions(folder: Path) -> Path:
    """A folder for each day, as data lakes have them."""
    for day in ("a", "b"):
        (folder / f"day={day}").mkdir()
        parquet(folder / f"day={day}")
    return folder


def part_of_a_data_set(folder: Path) -> Path:
    """One file of a data set of LeRobot."""
    from tests.test_imports_robots import FORMS, dataset

    return next((dataset(folder / "set", "v3.0", FORMS["v3.0"]) / "data").rglob("*.parquet"))


FILES: dict[str, Made] = {
    # times in nanoseconds, joints by their numbers
    "rostopic echo -p": (
        text("joints.csv", ECHOED),
        {"format": "columns", "channels": {"q1": "field.position0"}, "hold": 0},
        (20, "q1"),
    ),
    "semicolons and decimal commas": (
        text("messung.csv", "\ufefftime;elbow\n" + "\n".join(f"{k},5;{k},25" for k in range(1, 9))),
        {"format": "columns", "hold": 0},
        (8, "elbow"),
    ),
    "a plot of Foxglove": (
        text("plot.csv", plot()),
        {"channels": {"q1": "/joint_states.position[1]"}, "hold": 0},
        (40, "q1"),
    ),
    "a plot of Foxglove that lacks a value": (
        text("plot.csv", plot(lost=29)),
        {"hold": 0},
        "line 70, /joint_states.position[0]: found no reading",
    ),
    "PlotJuggler, quoted": (
        text("plot.csv", lines(",".join(f'"{n}"' for n in TWO.split(",")), PLOTTED)),
        {"hold": 0},
        (9, "/joint_states/wrist/position"),
    ),
    "a row with a cell too many": (
        text("plot.csv", lines(TWO, [*PLOTTED, "1,2,3,4"])),
        {"hold": 0},
        "line 11, column 4 (beyond the last): found 4 cells",
    ),
    "a folder of Parquet": (parquet, {"hold": 0}, (9, "q1")),
    "a folder of Parquet for each day": (partitions, {"hold": 0}, (9, "q1")),
    "a data frame with its index": (
        text(
            "frame.csv",
            "\n".join(
                ",".join(c)
                for c in zip(["", *map(str, range(100))], table().splitlines(), strict=False)
            ),
        ),
        {},
        (60, "wrist"),
    ),
    "a file out of a data set": (part_of_a_data_set, {}, "a part of a LeRobot data set"),
    "an array of NumPy": (
        text("q.npy", b"\x93NUMPY\x01\x00v\x00{'descr': '<f8'}"),
        {},
        "without names: save it as CSV",
    ),
    "a table of a script, packed": (
        text("run.csv.gz", gzip.compress(table().encode())),
        {},
        (60, "elbow"),
    ),
    "packed, and cut": (
        text("run.csv.gz", gzip.compress(table().encode())[:600]),
        {},
        "a gzip file that is damaged",
    ),
    "text of a spreadsheet": (
        text("run.txt", table(mark="\t").encode("utf-16")),
        {},
        "looks like UTF-16, expected text in UTF-8. Save the file as CSV in UTF-8",
    ),
    "times in brackets": (text("run.csv", table("t[ms]", by=1e3)), {}, (60, "wrist")),
    "times since the robot was switched on": (
        text("run.csv", table("stamp_ns", by=1e9, form="{:.0f}")),
        {},
        (60, "wrist"),
    ),
    "times that a spreadsheet has rounded": (
        text("run.csv", table(form="{:.0f}")),
        {},
        "times that most rows share with the row before, expected a time for each row",
    ),
    "the same with its rate": (
        text("run.csv", table(form="{:.0f}")),
        {"rate": 50.0},
        (60, "elbow"),
    ),
    "times under another word": (
        text("run.csv", table("Zeit")),
        {},
        "found no column of times, expected one called time, timestamp or t",
    ),
    "two runs in one file": (
        text("run.csv", 2 * table()),
        {"channels": {"q1": "elbow"}},
        "line 102, column elbow: found 'elbow', expected a finite number. The header stands here",
    ),
    "without a header": (
        text("run.csv", table().split("\n", 1)[1]),
        {"rate": 50.0},
        "line 1: found numbers, expected names of columns. Put a header line above them",
    ),
    "spaces between cells": (
        text("run.csv", table(mark=" ")),
        {"format": "columns", "channels": {"q1": "elbow"}},
        "Commas, semicolons or tabs stand between cells",
    ),
    "NUL after power was lost": (
        text("run.csv", table() + 300 * "\0"),
        {"hold": 0},
        "found NUL bytes: the file does not look like text",
    ),
    "a spreadsheet": (text("session.xlsx", b"PK\x03\x04" + bytes(100)), {}, "save it as CSV"),
}
