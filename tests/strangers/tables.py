"""CSV and Parquet of plotting programs, spreadsheets and scripts."""

from __future__ import annotations

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
    "a file out of a data set": (part_of_a_data_set, {}, "a part of a LeRobot data set"),
    "an array of NumPy": (
        text("q.npy", b"\x93NUMPY\x01\x00v\x00{'descr': '<f8'}"),
        {},
        "without names: save it as CSV",
    ),
    "a spreadsheet": (text("session.xlsx", b"PK\x03\x04" + bytes(100)), {}, "save it as CSV"),
}
