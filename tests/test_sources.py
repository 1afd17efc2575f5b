"""Readings as people have them: compressed, commented, of spreadsheets, loggers and data frames.

What is read is compared with the plain file of the same readings; what can be misread is refused.
"""

from __future__ import annotations

import gzip
import io
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow
import pytest
from pyarrow import parquet

import rsicalib
from rsicalib import DEMO, InputError, Readings
from rsicalib.io.stream import rows_of
from tests.channels import Named
from tests.oracle import Array

PLAIN = (DEMO / "rest.csv").read_text(encoding="utf-8")
NAMES = PLAIN.splitlines()[0].split(",")
WANTED = rsicalib.load_readings(DEMO / "rest.csv")


def same(found: Readings, wanted: Readings = WANTED) -> None:
    assert np.array_equal(found.values, wanted.values)
    assert np.array_equal(found.pose, wanted.pose)
    assert found.time_s is not None and np.array_equal(found.time_s, wanted.time_s)  # type: ignore[arg-type]


def semicolons(text: str) -> str:
    return text.replace(",", ";").replace(".", ",")


def units(text: str, unit: str = "count") -> str:
    head, rest = text.split("\n", 1)
    known = {"time_s": "[s]", "temperature_c": "°C", "pose": "-", "sample": ""}
    known |= dict.fromkeys(("x", "y", "z"), "in") | dict.fromkeys(("rx", "ry", "rz"), "(rad)")
    return "\n".join([head, ",".join(known.get(name, unit) for name in NAMES), rest])


SHAPES: dict[str, Callable[[str], bytes]] = {
    "gzip": lambda text: gzip.compress(text.encode()),
    "comments above the header": lambda text: f"# device 7\n#\n{text}".encode(),
    "a byte order mark": lambda text: b"\xef\xbb\xbf" + text.encode(),
    "ends of lines of Windows": lambda text: text.replace("\n", "\r\n").encode(),
    "semicolons and decimal commas": lambda text: semicolons(text).encode(),
    "semicolons and decimal points": lambda text: text.replace(",", ";").encode(),
    "tabs": lambda text: text.replace(",", "\t").encode(),
    "a row of units": lambda text: units(text).encode(),
    "all at once": lambda text: gzip.compress(f"# by a logger\n{semicolons(units(text))}".encode()),
}


@pytest.mark.parametrize("shape", SHAPES)
def test_a_file_as_people_have_it_holds_the_same_readings(shape: str, tmp_path: Path) -> None:
    path = tmp_path / "readings.csv"
    path.write_bytes(SHAPES[shape](PLAIN))
    same(rsicalib.load_readings(path))


@pytest.mark.parametrize("shape", SHAPES)
def test_a_watch_reads_what_calibrate_reads(shape: str, tmp_path: Path) -> None:
    path = tmp_path / "readings.csv"
    path.write_bytes(SHAPES[shape](PLAIN))
    rsi = rsicalib.load_mechanism("rsi")
    rows = list(rows_of(path, rsi))
    assert np.array_equal(np.vstack([part.values for part in rows]), WANTED.values)
    times = np.concatenate([part.time_s for part in rows if part.time_s is not None])
    assert WANTED.time_s is not None and np.array_equal(times, WANTED.time_s)


def test_a_watch_reads_quoted_cells_and_decimals_that_come_late(tmp_path: Path) -> None:
    path = tmp_path / "rows.csv"
    path.write_text('"a","b"\n"1.5","2"\n3,4\n')
    assert np.vstack([r.values for r in rows_of(path, Named("a", "b"))]).tolist() == [
        [1.5, 2],
        [3, 4],
    ]
    with open(path, "w", encoding="utf-8") as file:
        file.write("a;b\n1;2\n")
        file.flush()
        rows = rows_of(path, Named("a", "b"), follow=True)
        assert next(rows).values.tolist() == [[1.0, 2.0]]
        file.write("1,5;2\n")
        file.flush()
        assert next(rows).values.tolist() == [[1.5, 2.0]]


@pytest.mark.parametrize("kind", ["another unit", "a cut gzip file", "UTF-16"])
def test_a_watch_refuses_what_can_be_misread(kind: str, tmp_path: Path) -> None:
    make, words = MISREAD[kind]
    path = tmp_path / "readings.csv"
    path.write_bytes(make(PLAIN))
    with pytest.raises(InputError, match=words):
        list(rows_of(path, rsicalib.load_mechanism("rsi")))


def watched(path: Path) -> Array:
    """Readings of a file as a watch takes them."""
    parts = [part.values for part in rows_of(path, rsicalib.load_mechanism("rsi"))]
    return np.vstack(parts)


CELL = PLAIN.splitlines()[3].split(",")[-1]
ROWS: dict[str, Callable[[str], str]] = {
    "a cell too many": lambda line: line.replace(",", ",5,", 1),
    "a comma at the end": lambda line: line + ",",
    "a cell too few": lambda line: line.split(",", 1)[1],
    "an underscore in a number": lambda line: line[:-1] + "_" + line[-1],
    "a word": lambda line: line[: -len(CELL)] + "off",
    "nothing": lambda line: line[: -len(CELL)],
    "other digits": lambda line: line[: -len(CELL)] + "\u0661\u0662",
    "text behind a quote": lambda line: line[: -len(CELL)] + f'"{CELL}"5',
}


@pytest.mark.parametrize("kind", ROWS)
def test_a_row_that_calibrate_refuses_is_unreadable_to_a_watch(kind: str, tmp_path: Path) -> None:
    lines = PLAIN.splitlines()
    lines[3] = ROWS[kind](lines[3])
    path = tmp_path / "rows.csv"
    path.write_text("\n".join(lines) + "\n", encoding="utf-8")
    with pytest.raises(InputError, match="line 4"):
        rsicalib.load_readings(path)
    found = watched(path)
    assert np.isnan(found[2]).any()
    others = np.arange(len(found)) != 2
    assert np.array_equal(found[others], WANTED.values[others])


HEADS: dict[str, tuple[Callable[[list[str]], list[str]], str]] = {
    "the time twice": (lambda names: ["time_s", *names[1:]], "time_s: found it twice, as columns"),
    "a channel twice": (lambda names: [*names[:-1], "a11"], "a11: found it twice"),
    "no such channel": (lambda names: [*names[:-1], "A33"], "There is 'A33'; names must agree"),
    "half a pose": (lambda names: [n if n != "y" else "" for n in names], "found 'x' without 'y'"),
}


@pytest.mark.parametrize("ending", ["csv", "parquet"])
@pytest.mark.parametrize("kind", HEADS)
def test_a_head_that_calibrate_refuses_is_refused_by_a_watch(
    kind: str, ending: str, tmp_path: Path
) -> None:
    make, words = HEADS[kind]
    head, rest = PLAIN.split("\n", 1)
    names = make(["pose", *head.split(",")[1:]])
    path = tmp_path / f"rows.{ending}"
    if ending == "csv":
        path.write_text("\n".join([",".join(names), rest]))
    else:
        cells = [np.array([float(v or "nan")]) for v in rest.split("\n", 1)[0].split(",")]
        parquet.write_table(pyarrow.Table.from_arrays(list(map(pyarrow.array, cells)), names), path)
    said = []
    for read in (rsicalib.load_readings, watched):
        with pytest.raises(InputError, match=words) as caught:
            read(path)
        said.append(str(caught.value))
    assert said[0] == said[1]


def test_cells_of_parquet_are_the_same_numbers_to_a_watch(tmp_path: Path) -> None:
    path = tmp_path / "rows.parquet"
    cells = {name: ["1_5", "15", None, " 7 "] for name in (" a ", "b")}
    parquet.write_table(pyarrow.table({**cells, "b": [True, False, True, True]}), path)
    found = np.vstack([part.values for part in rows_of(path, Named("a", "b"))])
    assert np.array_equal(found[:, 0], [np.nan, 15.0, np.nan, 7.0], equal_nan=True)
    assert np.isnan(found[:, 1]).all()


def test_units_of_columns_that_are_not_taken_are_not_asked_for(tmp_path: Path) -> None:
    path = tmp_path / "rows.csv"
    head, below, rest = units(PLAIN).split("\n", 2)
    lines = [f"{line},1" for line in rest.splitlines()]
    path.write_text("\n".join([f"{head},force", f"{below},N", *lines]) + "\n", encoding="utf-8")
    same(rsicalib.load_readings(path))
    assert np.array_equal(watched(path), WANTED.values)


def test_a_line_is_counted_with_the_comments_above_it(tmp_path: Path) -> None:
    path = tmp_path / "readings.csv"
    lines = PLAIN.splitlines()
    lines[2] = lines[2].rsplit(",", 1)[0] + ",x"
    path.write_text("# one\n# two\n" + "\n".join(lines) + "\n", encoding="utf-8")
    with pytest.raises(InputError) as caught:
        rsicalib.load_readings(path)
    assert caught.value.where is not None and caught.value.where["line"] == 5


MISREAD: dict[str, tuple[Callable[[str], bytes], str]] = {
    "another unit": (lambda text: units(text, "deg").encode(), "found unit 'deg', expected unit"),
    "a cut gzip file": (lambda text: gzip.compress(text.encode())[:-9], "damaged"),
    "Latin-1": (lambda text: f"# Gerät\n{text}".encode("latin-1"), "'ät' if the file is Latin-1"),
    "Shift-JIS": (
        lambda text: f"# 番号\n{text}".encode("cp932"),
        "'番号' if the file is Shift-JIS, expected .* there are others. Save the file as CSV",
    ),
    "no text at all": (
        lambda text: f"# Gerät\n{text}".encode("latin-1") + b"\x81,\x81,\n",
        r"byte 0xe4, which is not UTF-8, expected text in UTF-8",
    ),
    "UTF-16": (lambda text: text.encode("utf-16"), "looks like UTF-16"),
    "a picture": (lambda text: b"\x89PNG\r\n\x1a\n\0\0\0\rIHDR\0\0", "does not look like text"),
    "an open quotation mark": (
        lambda text: f'{text}"1,2\n'.encode(),
        "a quotation mark that no other one closes",
    ),
    "a quotation mark within a cell": (
        lambda text: f'{text}"1"2,3\n'.encode(),
        "text behind a closing quotation mark",
    ),
    "both decimals": (
        lambda text: text.replace(",", ";").replace(".", ",", 1).encode(),
        "expected a finite number",
    ),
    "one line of 50 MB": (
        lambda text: b"x" * 50_000_000,
        r"a cell of more than 131,072 characters",
    ),
}


@pytest.mark.parametrize("kind", MISREAD)
def test_what_can_be_misread_is_refused(kind: str, tmp_path: Path) -> None:
    make, words = MISREAD[kind]
    path = tmp_path / "readings.csv"
    path.write_bytes(make(PLAIN))
    with pytest.raises(InputError, match=words):
        rsicalib.load_readings(path)


def test_a_comma_before_three_digits_is_refused_where_nothing_tells_what_it_means(
    tmp_path: Path,
) -> None:
    path = tmp_path / "readings.csv"
    at = 0
    head = ["time_s", *WANTED.channels]
    rows = [["", *map(str, values)] for values in WANTED.values.astype(int).tolist()]
    for k, row in enumerate(rows):
        row[at] = f"1,{100 + k}"
    path.write_text("\n".join(";".join(row) for row in [head, *rows]), encoding="utf-8")
    with pytest.raises(InputError, match=r"line 2, column time_s: .*decimal or thousands"):
        rsicalib.load_readings(path)
    rows[-1][at] = "1,25"
    path.write_text("\n".join(";".join(row) for row in [head, *rows]), encoding="utf-8")
    found = rsicalib.load_readings(path).time_s
    assert found is not None and found[0] == 1.1 and found[-1] == 1.25


def test_standard_input_is_a_file_too() -> None:
    command = [sys.executable, "-m", "rsicalib", "forward", "-"]
    done = subprocess.run(command, input=PLAIN.encode(), capture_output=True, timeout=100)
    assert done.returncode == 0, done.stderr
    at_rest = subprocess.run([*command[:-1], str(DEMO / "rest.csv")], capture_output=True)
    assert done.stdout == at_rest.stdout


def columns() -> dict[str, Any]:
    return {
        name: np.genfromtxt(io.StringIO(PLAIN), delimiter=",", names=True)[name] for name in NAMES
    }


def frame_of(library: str) -> Any:
    module: Any = pytest.importorskip(library)
    return module.table(columns()) if library == "pyarrow" else module.DataFrame(columns())


@pytest.mark.parametrize("library", ["pandas", "polars", "pyarrow"])
def test_a_data_frame_is_readings(library: str) -> None:
    same(rsicalib.load_readings(frame_of(library)))


def test_columns_and_arrays_are_readings() -> None:
    same(rsicalib.load_readings(columns()))
    assert np.array_equal(rsicalib.load_readings(WANTED.values).values, WANTED.values)
    with pytest.raises(InputError, match="a11"):
        rsicalib.load_readings({name: cells for name, cells in columns().items() if name != "a11"})
    with pytest.raises(InputError, match="shape"):
        rsicalib.load_readings(WANTED.values[:, :5])


def test_calibrate_takes_arrays_with_a_rest_reading_of_one_row() -> None:
    demo = rsicalib.load_readings(DEMO / "readings.csv")
    rest = np.rint(WANTED.values.mean(axis=0))
    whole = rsicalib.calibrate(demo, rest=rest)
    assert whole.readings.samples == len(demo)
    table = {"pose": demo.pose, **dict(zip(demo.channels, demo.values.T, strict=True))}
    again = rsicalib.calibrate(table, rest=rest[np.newaxis])
    assert again.parameters == whole.parameters
