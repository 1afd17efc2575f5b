"""Readings: what is refused and where, what is only suspected, and that nothing is repaired."""

from __future__ import annotations

import hashlib
import io
import math
import pickle
import re
import sys
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from rsicalib.errors import InputError, RsicalibError
from rsicalib.facts.warned import Warned
from rsicalib.io.readings import Readings, load_readings
from rsicalib.io.samples import Skipped
from rsicalib.io.suspicions import suspicions
from rsicalib.io.tables import File, numbers, table_of_file, table_of_numbers
from tests.full import sized

SHARED = Path(__file__).parents[2] / "shared" / "data" / "rsi"


@dataclass(frozen=True)
class Channel:
    name: str
    unit: str = "count"
    range: tuple[float, float] | None = (0.0, 4095.0)
    gain: float = -1.448760e-3


@dataclass(frozen=True)
class Mechanism:
    channels: tuple[Channel, ...]
    name: str = "stub"
    key_columns: tuple[str, ...] = ()
    distance_columns: tuple[str, ...] = ()
    value_columns: tuple[str, ...] = ()
    optional_columns: tuple[str, ...] = ()


NAMES = [f"a{arm}{joint}" for arm in (1, 2, 3) for joint in (1, 2, 3)]
RSI = Mechanism(tuple(Channel(name) for name in NAMES))
BAR = Mechanism(
    (Channel("q1", "rad", None, 1.0), Channel("q2", "rad", None, 1.0)),
    name="ball bar",
    key_columns=("group", "at"),
    distance_columns=("bar",),
    value_columns=("bar",),
)
HEADER = ["pose", "sample", "time_s", "temperature_c", *NAMES]
POSE = ["x", "y", "z", "rx", "ry", "rz"]


def session(poses: int = 6, samples: int = 2, seed: int = 0) -> tuple[np.ndarray, np.ndarray]:
    """Codes of held poses with a count of noise, and the label of each row."""
    rng = np.random.default_rng(seed)
    codes = rng.uniform(1000.0, 3000.0, (poses, 9)).repeat(samples, axis=0)
    return np.rint(codes + rng.normal(size=codes.shape)), np.arange(poses).repeat(samples) + 1


def recording(rows: int = 2000, seed: int = 0) -> np.ndarray:
    """Codes of a smooth motion with a count of noise."""
    rng = np.random.default_rng(seed)
    phase = np.linspace(0.0, 20.0, rows)[:, None] * rng.uniform(0.7, 1.3, 9)
    codes = 2000.0 + 700.0 * np.sin(phase + rng.uniform(0.0, 6.0, 9))
    return np.rint(codes + rng.normal(size=codes.shape))


def cells() -> list[list[str]]:
    """A valid file, header first."""
    values, pose = session()
    rows = [
        [str(label), str(i % 2 + 1), f"{0.02 * i:.3f}", "21.0", *(f"{v:.0f}" for v in row)]
        for i, (label, row) in enumerate(zip(pose, values, strict=True))
    ]
    return [list(HEADER), *rows]


def as_text(rows: list[list[str]]) -> str:
    return "".join(",".join(row) + "\n" for row in rows)


@pytest.fixture
def write(tmp_path):
    def write(content: str | bytes, name: str = "run.csv") -> Path:
        path = tmp_path / name
        path.write_bytes(content if isinstance(content, bytes) else content.encode())
        return path

    return write


def refusal(path, mechanism=RSI, **options) -> InputError:
    with pytest.raises(InputError) as caught:
        load_readings(path, mechanism, **options)
    error = caught.value
    assert str(error) == error.message
    assert error.where is not None
    for part in ("found", "expected"):
        assert error.where[part] in error.message
    return error


# What is loaded


def test_a_valid_file_is_loaded_as_it_stands(write):
    path = write(as_text(cells()))
    readings = load_readings(str(path), RSI)
    values, pose = session()
    np.testing.assert_array_equal(readings.values, values)
    np.testing.assert_array_equal(readings.pose, pose)
    np.testing.assert_array_equal(readings.sample, [1, 2] * 6)
    np.testing.assert_allclose(readings.time_s, 0.02 * np.arange(12))
    np.testing.assert_array_equal(readings.temperature_c, 21.0)
    np.testing.assert_array_equal(readings.lines, np.arange(2, 14))
    assert readings.channels == tuple(NAMES)
    assert readings.held and readings.poses is None
    assert len(readings) == 12 and readings.n_poses == 6
    assert readings.warnings == () and readings.skipped == ()
    assert readings.source == str(path)
    assert readings.sha256 == hashlib.sha256(path.read_bytes()).hexdigest()


def test_arrays_are_contiguous_and_read_only(write):
    readings = load_readings(write(as_text(cells())), RSI)
    assert readings.values.flags.c_contiguous and readings.values.dtype == np.float64
    assert readings.pose.dtype == readings.lines.dtype == np.int64
    for array in (readings.values, readings.pose, readings.time_s, readings.lines):
        with pytest.raises(ValueError, match="read-only"):
            array[0] = 0


def test_without_a_pose_column_every_row_is_a_pose_numbered_by_row(write):
    readings = load_readings(write(as_text([row[4:] for row in cells()])), RSI)
    assert not readings.held
    np.testing.assert_array_equal(readings.pose, np.arange(1, 13))
    assert readings.sample is None and readings.time_s is None and readings.temperature_c is None


def test_columns_are_found_by_name_in_any_order(write):
    rows = [row[::-1] for row in cells()]
    np.testing.assert_array_equal(load_readings(write(as_text(rows)), RSI).values, session()[0])


@pytest.mark.parametrize("number", ["1500.5", " 1500.5 ", "+1500.5", "15005e-1", '"1500.5"'])
def test_numbers_are_what_float_takes(write, number):
    rows = cells()
    rows[3][4] = number
    assert load_readings(write(as_text(rows)), RSI).values[2, 0] == 1500.5


@pytest.mark.parametrize("ending", ["\n", "\r\n", "\r"])
@pytest.mark.parametrize("start", [b"", b"\xef\xbb\xbf"], ids=["plain", "byte order mark"])
def test_line_ends_and_a_byte_order_mark_do_not_matter(write, ending, start):
    path = write(start + as_text(cells()).replace("\n", ending).encode())
    readings = load_readings(path, RSI)
    assert readings.lines[-1] == 13 and readings.warnings == ()


def test_lines_are_counted_in_the_file_even_where_a_cell_spans_two(write):
    rows = [[*row, "note"] for row in cells()]
    rows[2][-1] = '"two\nlines"'
    readings = load_readings(write(as_text(rows)), RSI)
    assert list(readings.lines[:4]) == [2, 3, 5, 6]


def test_empty_lines_at_the_end_say_nothing(write):
    assert len(load_readings(write(as_text(cells()) + "\n\n"), RSI)) == 12


def test_other_columns_are_ignored_with_a_warning(write):
    rows = [[*row, extra, "1"] for row, extra in zip(cells(), ["note", *"x" * 12], strict=True)]
    rows[0][-1] = "operator"
    (warning,) = load_readings(write(as_text(rows)), RSI).warnings
    assert warning.kind == "ignored_columns" and "columns: note, operator" in warning.text


def test_known_poses_are_loaded_and_empty_ones_are_unknown(write):
    rows = [[*row, *["0.5"] * 6] for row in cells()]
    rows[0][-6:] = POSE
    rows[4][-6:] = [""] * 6
    readings = load_readings(write(as_text(rows)), RSI)
    assert readings.poses.shape == (12, 6)
    assert np.isnan(readings.poses[3]).all()
    assert (np.delete(readings.poses, 3, axis=0) == 0.5).all()
    assert readings.warnings == ()


def test_keys_and_distances_are_loaded_where_the_mechanism_needs_them(write):
    path = write("group,at,q1,q2,bar\nfront, s0 ,0.1,0.2,50\nfront,s1,0.3,0.4,51\n")
    readings = load_readings(path, BAR)
    assert readings.keys == {"group": ("front", "front"), "at": ("s0", "s1")}
    np.testing.assert_array_equal(readings.columns["bar"], [50.0, 51.0])


def test_a_channel_may_bear_the_name_of_a_pose_column(write):
    stage = Mechanism((Channel("x", "mm", None), Channel("q", "rad", None)))
    readings = load_readings(write("x,q,y\n1,2,3\n4,5,6\n"), stage)
    np.testing.assert_array_equal(readings.values, [[1.0, 2.0], [4.0, 5.0]])
    assert readings.poses is None and "ignored columns: y" in readings.warnings[0].text


@pytest.mark.parametrize("name", ["time", "timestamp", "t [ms]"])
def test_a_time_under_another_name_is_not_ignored_without_a_word(name, write):
    stage = Mechanism((Channel("q", "rad", None),))
    warning = load_readings(write(f"{name},q\n0,1\n1,4\n"), stage).warnings[0]
    assert warning.kind == "ignored_columns"
    assert f"{name!r} looks like a time, which is called 'time_s' here" in warning.text


# What is refused


@pytest.mark.parametrize(
    ("cell", "found"),
    [
        ("", "blank"),
        ("  ", "blank"),
        ("abc", "'abc'"),
        ("nan", "'nan'"),
        ("inf", "'inf'"),
        ("-Infinity", "'-Infinity'"),
        ("1e999", "'1e999'"),
        ("1_500", "'1_500'"),
        ("0x5dc", "'0x5dc'"),
        ('"1500,5"', "'1500,5' with a decimal comma"),
        ("4096", "4096"),
        ("-1", "-1"),
        ("4095.5", "4095.5"),
    ],
)
def test_a_cell_that_is_no_reading_is_refused_by_line_and_column(write, cell, found):
    rows = cells()
    rows[6][5] = cell
    path = write(as_text(rows))
    error = refusal(path)
    assert error.where == {
        "file": str(path),
        "line": 7,
        "column": "a12",
        "found": found,
        "expected": "a number from 0 to 4095 (count)",
    }
    assert error.message.startswith(f"{path}, line 7, column a12: found {found}, expected a number")
    assert "--skip-bad-rows" in error.message


def test_a_channel_without_range_still_takes_finite_numbers_only(write):
    error = refusal(write("group,at,q1,q2,bar\nf,s,0.1,nan,50\n"), BAR)
    assert (error.where["line"], error.where["column"]) == (2, "q2")
    assert error.where["expected"] == "a finite number (rad)"


@pytest.mark.parametrize(
    ("column", "cell", "expected"),
    [
        ("pose", "1.5", "an integer"),
        ("pose", "first", "an integer"),
        ("pose", "", "an integer"),
        ("pose", "9007199254740993", "an integer below 9007199254740992 (2^53) in size"),
        ("sample", "x", "an integer"),
        ("time_s", "", "a finite number (seconds)"),
        ("time_s", "noon", "a finite number (seconds)"),
        ("temperature_c", "inf", "a finite number"),
        ("temperature_c", "1e308", "a number of at most 1e+60 in size"),
    ],
)
def test_the_other_numbers_are_checked_too(write, column, cell, expected):
    rows = cells()
    rows[1][HEADER.index(column)] = cell
    where = refusal(write(as_text(rows))).where
    assert (where["line"], where["column"], where["expected"]) == (2, column, expected)


def test_the_first_fault_is_named_and_the_others_are_counted(write):
    rows = cells()
    rows[9][4], rows[5][12], rows[5][7] = "x", "y", "z"
    error = refusal(write(as_text(rows)))
    assert (error.where["line"], error.where["column"]) == (6, "a21")
    assert "1 more row cannot be used" in error.message


def test_a_missing_channel_is_refused(write):
    rows = [row[:6] + row[7:] for row in cells()]
    where = refusal(write(as_text(rows))).where
    assert (where["line"], where["column"], where["found"]) == (1, "a13", "no such column")
    assert where["expected"] == "a column 'a13' (a channel of 'stub')"


def test_a_doubled_channel_is_refused(write):
    rows = cells()
    rows[0][7] = "a11"
    where = refusal(write(as_text(rows))).where
    assert (where["line"], where["column"]) == (1, "a11")
    assert where["found"] == "it twice, as columns 5 and 8"
    assert where["expected"] == "one column of this name"


@pytest.mark.parametrize(
    ("change", "hint"),
    [
        (lambda text: text.replace("a12", "A12"), "There is 'A12'"),
        (lambda text: text.replace(",", " "), "separate columns by commas"),
        (lambda text: text.partition("\n")[2], "put a header line above it"),
        (lambda text: text.replace("a12", "b12"), "The columns are: pose, sample"),
    ],
)
def test_a_header_that_does_not_fit_is_refused_with_a_guess(write, change, hint):
    error = refusal(write(change(as_text(cells()))))
    assert error.where["line"] == 1 and hint in error.message


@pytest.mark.parametrize("missing", ["group", "at", "bar"])
def test_a_missing_key_or_distance_is_refused(write, missing):
    header = "group,at,q1,q2,bar".replace(missing, "other")
    where = refusal(write(f"{header}\n1,1,1,1,1\n"), BAR).where
    assert (where["line"], where["column"], where["found"]) == (1, missing, "no such column")
    assert "'ball bar'" in where["expected"]


@pytest.mark.parametrize(
    ("row", "column", "expected"),
    [
        ("f,,1,1,50", "at", "text"),
        ("f,s,1,1,0", "bar", "a distance above zero"),
        ("f,s,1,1,-5", "bar", "a distance above zero"),
        ("f,s,1,1,", "bar", "a distance above zero"),
    ],
)
def test_a_blank_key_and_an_impossible_distance_are_refused(write, row, column, expected):
    where = refusal(write(f"group,at,q1,q2,bar\nf,s,1,1,50\n{row}\n"), BAR).where
    assert (where["line"], where["column"], where["expected"]) == (3, column, expected)


def test_a_half_known_pose_is_refused(write):
    rows = [[*row, *["0"] * 6] for row in cells()]
    rows[0][-6:] = POSE
    rows[2][-2] = ""
    where = refusal(write(as_text(rows))).where
    assert (where["line"], where["column"], where["found"]) == (3, "ry", "blank")
    assert "all six" in where["expected"]


def test_some_of_the_six_pose_columns_are_refused(write):
    rows = [[*row, "0", "0", "0"] for row in cells()]
    rows[0][-3:] = "x", "y", "rx"
    where = refusal(write(as_text(rows))).where
    assert (where["line"], where["column"], where["found"]) == (1, "z", "'x' without 'z'")


def test_a_pose_that_comes_again_is_refused(write):
    rows = cells()
    rows[7][0] = rows[8][0] = "2"
    where = refusal(write(as_text(rows))).where
    assert (where["line"], where["column"]) == (8, "pose")
    assert where["found"] == "pose 2 again, which ended at line 5"
    assert where["expected"] == "the rows of a pose next to each other"


@pytest.mark.parametrize(
    ("row", "column", "found"),
    [
        (lambda row: row[:-1], "a33", "12 cells"),
        (lambda row: row[:1], "sample", "1 cell"),
        (lambda row: [*row, "7"], "14 (beyond the last)", "14 cells"),
        (lambda row: [], "pose", "an empty line"),
    ],
)
def test_a_row_of_the_wrong_length_is_refused(write, row, column, found):
    rows = cells()
    rows[4] = row(rows[4])
    where = refusal(write(as_text(rows))).where
    assert (where["line"], where["column"], where["found"]) == (5, column, found)
    assert where["expected"] == "13 cells, as in the header"


@pytest.mark.parametrize(
    ("content", "line", "found"),
    [
        (b"", 1, "an empty file"),
        (b"\n\n", 1, "an empty file"),
        (b"\xef\xbb\xbf", 1, "an empty file"),
        ((",".join(HEADER) + "\n").encode(), None, "no readings"),
        (
            b"pose,a11\n1,\xff2\n",
            2,
            "byte 0xff, which is not UTF-8: 'ÿ2' if the file is Latin-1 (Windows-1252)",
        ),
        (
            "pose,a11\n".encode("utf-16"),
            1,
            "byte 0xff, which is not UTF-8: the file looks like UTF-16",
        ),
        ("pose,a11\n".encode("utf-16-le"), 1, "NUL bytes: the file looks like UTF-16"),
    ],
)
def test_a_file_that_is_no_table_is_refused(write, content, line, found):
    where = refusal(write(content)).where
    assert (where["line"], where["found"]) == (line, found)


def test_a_quote_left_open_is_refused_at_its_line(write):
    rows = cells()
    rows[3][4] = '"1500'
    where = refusal(write(as_text(rows))).where
    assert where["line"] == 4 and "quotes" in where["expected"]


def test_a_file_that_is_not_there_is_refused(tmp_path):
    assert refusal(tmp_path / "none.csv").where["found"] == "no such file"
    assert refusal(tmp_path).where["found"] == "a directory"
    assert refusal("a\0b.csv").where["expected"] == "a file that can be read"


def test_an_input_error_is_a_value_error_that_survives_pickling(write):
    error = refusal(write(""))
    again = pickle.loads(pickle.dumps(error))
    assert isinstance(again, RsicalibError) and isinstance(again, ValueError)
    assert again.message == error.message and again.where == error.where
    assert InputError("no place").where is None


# Skipping


def test_bad_rows_are_skipped_only_when_asked_and_listed(write):
    rows = cells()
    rows[3][4], rows[6], rows[9][6] = "x", rows[6][:5], "5000"
    readings = load_readings(write(as_text(rows)), RSI, skip_bad_rows=True)
    keep = np.delete(np.arange(12), [2, 5, 8])
    np.testing.assert_array_equal(readings.values, session()[0][keep])
    np.testing.assert_array_equal(readings.lines, keep + 2)
    expected = "expected a number from 0 to 4095 (count)"
    assert readings.skipped == (
        Skipped(4, "a11", f"found 'x', {expected}"),
        Skipped(7, "a12", "found 5 cells, expected 13 cells, as in the header"),
        Skipped(10, "a13", f"found 5000, {expected}"),
    )


def test_a_recording_keeps_its_row_numbers_when_rows_are_skipped(write):
    rows = [row[4:] for row in cells()]
    rows[2][0] = ""
    readings = load_readings(write(as_text(rows)), RSI, skip_bad_rows=True)
    assert list(readings.pose[:3]) == [1, 3, 4]


def test_skipping_does_not_excuse_the_header_nor_a_file_without_a_good_row(write):
    rows = cells()
    refusal(write(as_text([rows[0][:-1], *rows[1:]])), skip_bad_rows=True)
    rows[1:] = [[*row[:-1], "x"] for row in rows[1:]]
    assert "No row can be used" in refusal(write(as_text(rows)), skip_bad_rows=True).message


# Arrays, Parquet, writing


def test_arrays_are_checked_as_a_file_is():
    values, pose = session()
    readings = Readings.from_arrays(RSI, values, pose=pose, time_s=np.arange(12.0))
    np.testing.assert_array_equal(readings.values, values)
    assert readings.line_word == "row" and list(readings.lines[:2]) == [1, 2]
    again = Readings.from_arrays(RSI, values, pose=pose, time_s=np.arange(12.0))
    other = Readings.from_arrays(RSI, values + 1, pose=pose, time_s=np.arange(12.0))
    assert readings.sha256 == again.sha256 != other.sha256


@pytest.mark.parametrize(
    ("bad", "found"), [(math.nan, "NaN"), (math.inf, "inf"), (4096.0, "4096.0"), (-1.0, "-1.0")]
)
def test_a_bad_reading_in_an_array_is_refused_by_row_and_channel(bad, found):
    values, _ = session()
    values[4, 2] = bad
    with pytest.raises(InputError, match="arrays, row 5, column a13") as caught:
        Readings.from_arrays(RSI, values)
    assert (caught.value.where["line"], caught.value.where["found"]) == (5, found)


def test_arrays_take_a_mechanism_as_verbs_do():
    import rsicalib

    values, _ = session()
    named, drawn = (Readings.from_arrays(m, values) for m in ("rsi", rsicalib.load_mechanism()))
    assert named.sha256 == drawn.sha256


def test_the_arrays_given_stay_the_callers():
    values, _ = session()
    readings = Readings.from_arrays(RSI, values)
    values[:] = 0.0
    assert readings.values.min() > 0.0 and values.flags.writeable


@pytest.mark.parametrize(
    ("change", "column", "found"),
    [
        ({"values": np.ones((12, 8))}, None, "shape (12, 8)"),
        ({"values": 7.0}, None, "shape ()"),
        ({"values": np.ones((12, 9), dtype=complex)}, None, "type complex128"),
        ({"pose": np.arange(11)}, "pose", "shape (11,)"),
        ({"pose": np.arange(12) + 0.5}, "pose", "0.5"),
        ({"time_s": ["noon"] * 12}, "time_s", "'noon'"),
        ({"poses": np.zeros((12, 5))}, None, "shape (12, 5)"),
        ({"poses": np.c_[np.zeros((12, 5)), np.full(12, np.nan)]}, "rz", "NaN"),
        ({"time_s": np.ma.masked_equal(np.arange(12.0), 3.0)}, "time_s", "blank"),
    ],
)
def test_arrays_that_do_not_fit_are_refused(change, column, found):
    with pytest.raises(InputError) as caught:
        Readings.from_arrays(RSI, **{"values": session()[0], **change})
    assert (caught.value.where["column"], caught.value.where["found"]) == (column, found)


def test_a_masked_reading_of_an_array_is_blank():
    """The number below a mask was taken for a reading."""
    values = np.ma.array(session()[0])
    assert load_readings(values, RSI).values.tolist() == session()[0].tolist()
    values[3, 1] = np.ma.masked
    with pytest.raises(InputError, match="row 4, column a12: found blank"):
        load_readings(values, RSI)
    assert len(load_readings(values, RSI, skip_bad_rows=True)) == len(values) - 1


def test_a_mask_says_which_rows_are_used_and_no_other_column_is_one():
    values = session()[0]
    columns = {c.name: values[:, k] for k, c in enumerate(RSI.channels)}
    mask = np.arange(len(values)) % 3 > 0
    told = [load_readings({**columns, "used": used}, RSI) for used in (mask, mask.astype(int))]
    assert len(told[0]) == len(told[1]) == mask.sum()
    with pytest.raises(InputError, match="column a12: found type bool, expected numbers"):
        load_readings({**columns, "a12": mask}, RSI)


def test_what_is_written_is_read_back_unchanged(tmp_path):
    rng = np.random.default_rng(0)
    poses = rng.normal(size=(4, 6))
    poses[1] = np.nan
    readings = Readings.from_arrays(
        BAR,
        rng.normal(size=(4, 2)),
        pose=[3, 3, 5, 5],
        sample=[1, 2, 1, 2],
        time_s=rng.uniform(size=4).cumsum(),
        temperature_c=[20.0, 20.5, 21.0, 1e-300],
        poses=poses,
        keys={"group": ["front, left", "a", "b", 'say "c"'], "at": list("stuv")},
        columns={"bar": [50.0, 51.0, 1 / 3, 52.0]},
    )
    path = tmp_path / "out.csv"
    readings.to_csv(path)
    assert [entry.name for entry in tmp_path.iterdir()] == ["out.csv"]
    again = load_readings(path, BAR)
    for name in ("values", "pose", "sample", "time_s", "temperature_c", "poses"):
        np.testing.assert_array_equal(getattr(again, name), getattr(readings, name))
    assert again.keys == readings.keys and again.held
    np.testing.assert_array_equal(again.columns["bar"], readings.columns["bar"])
    buffer = io.StringIO()
    readings.to_csv(buffer)
    assert buffer.getvalue() == path.read_text(encoding="utf-8")


def test_a_write_that_fails_leaves_nothing_behind(tmp_path, monkeypatch):
    readings = Readings.from_arrays(RSI, session()[0])
    (tmp_path / "out.csv").write_text("before")

    def interrupted(self, target):
        raise KeyboardInterrupt

    monkeypatch.setattr(Path, "replace", interrupted)  # the text is written, and not yet there
    with pytest.raises(KeyboardInterrupt):
        readings.to_csv(tmp_path / "out.csv")
    assert [entry.name for entry in tmp_path.iterdir()] == ["out.csv"]
    assert (tmp_path / "out.csv").read_text() == "before"


def test_selecting_rows_keeps_their_labels_and_lines():
    values, pose = session()
    readings = Readings.from_arrays(RSI, values, pose=pose, keys={"group": [f"g{k}" for k in pose]})
    part = readings.select(readings.pose > 4)
    np.testing.assert_array_equal(part.values, values[8:])
    assert part.keys["group"] == ("g5", "g5", "g6", "g6")
    assert list(part.lines) == [9, 10, 11, 12] and part.n_poses == 2
    assert part.sha256 == readings.sha256
    for mask in ([True], np.ones(12)):
        with pytest.raises(InputError, match="12 truth values"):
            readings.select(mask)


def test_csv_and_parquet_agree(tmp_path, write):
    pa = pytest.importorskip("pyarrow", reason="Parquet needs pyarrow")
    parquet = pytest.importorskip("pyarrow.parquet", reason="Parquet needs pyarrow")
    rows = [[*row, *["0.25"] * 6, "left"] for row in cells()]
    rows[0][-7:] = [*POSE, "group"]
    rows[5][-7:-1] = [""] * 6
    columns = {}
    for name, *column in zip(*rows, strict=True):
        numbers = [float(cell) if cell else None for cell in column] if name != "group" else column
        columns[name] = numbers
        if name in ["pose", "sample", *NAMES]:
            columns[name] = pa.array([int(number) for number in numbers], pa.int32())
    parquet.write_table(pa.table(columns), tmp_path / "run.parquet")
    a = load_readings(write(as_text(rows)), RSI)
    b = load_readings(tmp_path / "run.parquet", RSI)
    for name in ("values", "pose", "sample", "time_s", "temperature_c", "poses"):
        np.testing.assert_array_equal(getattr(a, name), getattr(b, name))
    assert a.keys == b.keys == {"group": ("left",) * 12}
    assert (a.held, a.warnings) == (b.held, b.warnings)
    assert list(b.lines) == list(range(1, 13)) and b.line_word == "row"


@pytest.mark.parametrize(
    ("bad", "found"), [(None, "blank"), (math.nan, "NaN"), ("1500", None), (9999.0, "9999.0")]
)
def test_parquet_cells_are_refused_as_those_of_csv(tmp_path, bad, found):
    pa = pytest.importorskip("pyarrow", reason="Parquet needs pyarrow")
    parquet = pytest.importorskip("pyarrow.parquet", reason="Parquet needs pyarrow")
    columns = {name: list(column) for name, column in zip(NAMES, session()[0].T, strict=True)}
    columns["a22"][3] = bad
    if isinstance(bad, str):  # a column of text that are numbers: as good as CSV
        columns["a22"] = [str(cell) for cell in columns["a22"]]
    parquet.write_table(pa.table(columns), tmp_path / "run.PARQUET")
    if found is None:
        assert load_readings(tmp_path / "run.PARQUET", RSI).values[3, 4] == 1500.0
        return
    where = refusal(tmp_path / "run.PARQUET").where
    assert (where["line"], where["column"], where["found"]) == (4, "a22", found)


def test_what_is_no_parquet_is_refused(write):
    pytest.importorskip("pyarrow", reason="Parquet needs pyarrow")
    assert refusal(write(as_text(cells()), "run.parquet")).where["expected"] == "a Parquet file"


def test_without_pyarrow_a_parquet_file_says_what_to_install(write, monkeypatch):
    monkeypatch.setitem(sys.modules, "pyarrow", None)
    assert "pip install 'rsicalib[parquet]'" in refusal(write(b"PAR1", "run.parquet")).message


def test_a_hundred_thousand_rows_load(write):
    values = np.tile(recording(2000), (50, 1))
    path = write(",".join(NAMES) + "\n" + as_text(values.astype(int).astype(str).tolist()))
    assert len(load_readings(path, RSI)) == 100_000


# What is only suspected


def told(values, pose=None, **options) -> tuple[str, ...]:
    return tuple(map(str, warned(values, pose, **options)))


def warned(values, pose=None, **options) -> tuple[Warned, ...]:
    return Readings.from_arrays(RSI, values, pose=pose, **options).warnings


@pytest.mark.parametrize("seed", range(sized(5, 20)))
def test_clean_readings_raise_no_suspicion(seed):
    values, pose = session(48, 8, seed)
    assert told(values, pose) == ()
    assert told(values[::8]) == ()
    assert told(recording(seed=seed)) == ()
    assert told(values[:8]) == told(values[:8], pose[:8]) == ()  # one rest pose


def test_a_channel_that_never_changes_is_told():
    values, pose = session(12, 4)
    values[:, 4] = 2048
    assert [(w.kind, w.target) for w in warned(values, pose)] == [("constant", "a22")]
    (warning,) = told(values, pose)
    assert warning.startswith("a22: reads 2048 in all 48 rows while other channels move")


@pytest.mark.parametrize(("bit", "state"), [(0, 0), (0, 1), (1, 0), (3, 1), (5, 0)])
def test_a_bit_that_never_toggles_is_told(bit, state):
    for values, pose in (session(48, 8), (recording(), None)):
        codes = values.astype(int)
        codes[:, 7] = codes[:, 7] | 1 << bit if state else codes[:, 7] & ~(1 << bit)
        warning, *_ = told(codes, pose)  # poses at a boundary may now seem to have moved, too
        assert warning.startswith(f"a32: bit {bit} (worth {1 << bit}) is always {state}")


def test_channels_with_the_same_stuck_bits_share_one_message():
    values, pose = session(48, 8)
    (warning,) = told(values.astype(int) & ~3, pose)
    assert warning.startswith(", ".join(NAMES) + ": bit 0 (worth 1) is always 0, bit 1 (worth 2)")


def test_averaged_codes_have_no_bits():
    values, pose = session(48, 8)
    values[0, 0] += 0.5
    values[:, 0] = 2 * np.floor(values[:, 0] / 2)
    values[0, 0] += 0.5
    assert told(values, pose) == ()


def test_saturated_codes_are_told_with_their_lines():
    values, pose = session(12, 4)
    values[4:6, 3] = 4095
    values[40, 8] = 0
    high, low = told(values, pose)[:2]
    assert high.startswith("a21: 2 readings at the end of its range, 4095 (rows 5, 6)")
    assert low.startswith("a33: 1 reading at the end of its range, 0 (row 41)")


def test_a_pose_that_moved_while_it_was_sampled_is_told():
    values, pose = session(48, 8)
    values[pose == 17, 4] += np.linspace(0.0, 40.0, 8).round()
    (warning,) = told(values, pose)
    assert warning.startswith("pose 17 (row 129): a22 scatters by 1")


def test_a_trembling_hand_is_not_a_moved_pose():
    values, pose = session(48, 8)
    tremble = np.random.default_rng(1).normal(size=values.shape)
    size = np.random.default_rng(2).uniform(3.0, 9.0, (48, 9)).repeat(8, axis=0)
    assert told(np.rint(values + size * tremble), pose) == ()


def test_samples_written_twice_are_told():
    values, pose = session(48, 8)
    values[[12, 100, 201]] = values[[11, 99, 200]]
    (warning,) = told(values, pose)
    assert warning.startswith("3 rows repeat an earlier row in every channel (rows 13, 101, 202)")
    (warning,) = told(recording().repeat(2, axis=0))
    assert warning.startswith("2000 rows repeat an earlier row")


def test_a_quiet_device_may_repeat_itself():
    rng = np.random.default_rng(0)
    values, pose = session(48, 8)
    values = values[::8].repeat(8, axis=0) + (rng.uniform(size=values.shape) < 0.02)
    assert told(values, pose) == ()


def test_a_pose_copied_from_another_is_told():
    values, pose = session(48, 8)
    values[pose == 30] = values[pose == 12]
    (warning,) = told(values, pose)
    assert "pose 30 (row 233) repeats pose 12 (row 89)" in warning


def test_time_that_goes_back_is_told_with_its_line(write):
    rows = cells()
    rows[6][2] = "0.01"
    (warning,) = load_readings(write(as_text(rows)), RSI).warnings
    assert "line 7, column time_s: time goes back from 0.08 to 0.01 s" in warning.text


@pytest.mark.skipif(not SHARED.is_dir(), reason="the shared data are not beside the repository")
@pytest.mark.parametrize("name", ["readings.csv", "rest.csv", "check.csv"])
def test_the_published_hand_controllers_raise_no_suspicion(name):
    paths = sorted(SHARED.glob(f"*/{name}"))
    assert len(paths) >= 12, "the paper's hand controllers, and later ones beside them"
    for path in paths:
        readings = load_readings(path, RSI)
        assert readings.warnings == () and suspicions(readings, RSI) == []


# A thousand malformed files

NUMBER = re.compile(r"\s*[+-]?(\d+\.?\d*|\.\d+)([eE][+-]?\d+)?\s*", re.ASCII)
TEXTS = st.one_of(
    st.sampled_from(
        [
            "",
            " ",
            "nan",
            "NaN",
            "inf",
            "-inf",
            "1e400",
            "4096",
            "-1",
            "-0",
            "4095",
            "0",
            "1_0",
            "0x1",
        ]
        + ["1;2", "1,2", '"', '""', '"7"', "2", "a11", "pose", "\n", "\r", "\ufeff", "1500.25", "٣"]
    ),
    st.text(max_size=4),
    st.floats().map(str),
)


ACCIDENTS = ["drop", "replace", "insert", "row", "twice", "empty", "column", "swap"]


@st.composite
def malformed(draw) -> bytes:
    """A valid file, after up to three accidents."""
    rows = cells()
    for _ in range(draw(st.integers(0, 3))):
        i = draw(st.integers(0, len(rows) - 1))
        j = draw(st.integers(0, 12)) % max(len(rows[i]), 1)
        accident = draw(st.sampled_from(ACCIDENTS))
        if accident == "drop":
            del rows[i][j : j + 1]
        elif accident == "replace":
            rows[i][j : j + 1] = [draw(TEXTS)]
        elif accident == "insert":
            rows[i].insert(j, draw(TEXTS))
        elif accident == "row" and len(rows) > 1:
            del rows[i]
        elif accident == "twice":
            rows.insert(i, list(rows[i]))
        elif accident == "empty":
            rows.insert(i, [])
        elif accident == "column":
            rows = [row[:j] + row[j + 1 :] for row in rows]
        elif accident == "swap" and rows[0]:
            k = draw(st.integers(0, len(rows[0]) - 1))
            rows[0][j % len(rows[0])], rows[0][k] = rows[0][k], rows[0][j % len(rows[0])]
    data = as_text(rows).encode("utf-8", "replace")
    ending = draw(st.sampled_from(["none"] * 6 + ["cut", "bytes", "separator", "crlf", "mark"]))
    at = draw(st.integers(0, len(data)))
    if ending == "cut":
        data = data[:at]
    elif ending == "bytes":
        data = data[:at] + draw(st.binary(max_size=3)) + data[at:]
    elif ending == "separator":
        data = data.replace(b",", draw(st.sampled_from([b";", b"\t", b", "])))
    elif ending == "crlf":
        data = data.replace(b"\n", b"\r\n")
    elif ending == "mark":
        data = b"\xef\xbb\xbf" + data
    return data


def parse(data: bytes) -> list[tuple[int, list[str]]]:
    """Lines and cells of a CSV file, by a parser that shares nothing with ours (RFC 4180)."""
    text = data.decode("utf-8").removeprefix("\ufeff")
    separator = next((s for s in ",;\t" if s in text.split("\n")[0]), ",")
    rows, row, cell, inside, line, start = [], [], "", False, 1, 1
    for k, char in enumerate(text + "\n" * (not text.endswith(("\n", "\r")))):
        if char == '"' and (inside or not cell):
            if not inside and text[k - 1 : k] == '"':
                cell += '"'  # the second of a pair
            inside = not inside
        elif inside:
            cell += char
        elif char == separator:
            row, cell = [*row, cell], ""
        elif char in "\r\n":
            if not (char == "\n" and text[k - 1 : k] == "\r"):
                rows.append((start, [*row, cell] if row or cell else []))
                row, cell, start = [], "", line + 1
        else:
            cell += char
        line += char in "\r\n" and not (char == "\n" and text[k - 1 : k] == "\r")
    return rows


@pytest.fixture(scope="module")
def scratch(tmp_path_factory) -> Path:
    return tmp_path_factory.mktemp("malformed") / "run.csv"


@settings(
    max_examples=sized(150, 1000),
    deadline=None,
    suppress_health_check=list(HealthCheck),
    derandomize=True,
)
@given(data=malformed(), skip=st.booleans())
def test_a_malformed_file_is_refused_or_loaded_as_it_stands(scratch, data, skip):
    scratch.write_bytes(data)
    try:
        readings = load_readings(scratch, RSI, skip_bad_rows=skip)
    except InputError as error:
        assert error.where is not None and error.where["file"] == str(scratch)
        return  # any other exception fails the test
    assert np.isfinite(readings.values).all()
    assert readings.values.min() >= 0.0 and readings.values.max() <= 4095.0
    (_, header), *rows = parse(data)
    while not rows[-1][1]:
        rows.pop()
    names = [name.strip() for name in header]
    lines = dict(rows)
    assert len(readings) + len(readings.skipped) == len(rows)
    assert {*readings.lines.tolist(), *(bad.line for bad in readings.skipped)} == {*lines}
    assert skip or not readings.skipped
    for k, line in enumerate(readings.lines.tolist()):
        assert len(lines[line]) == len(names)
        for channel, value in zip(NAMES, readings.values[k], strict=True):
            cell = lines[line][names.index(channel)]
            assert NUMBER.fullmatch(cell) and float(cell) == value
    for bad in readings.skipped:
        # A reading at an end of its range says no more than that it is not beyond.
        usable = len(lines[bad.line]) == len(names) and all(
            NUMBER.fullmatch(cell) and 0.0 < float(cell) < 4095.0 and float(cell) % 1.0 == 0.0
            for name, cell in zip(names, lines[bad.line], strict=True)
            if name in HEADER and name != "time_s"
        )
        assert not usable or bad.column == "time_s"


PLAIN = st.text(alphabet="0123456789+-.eE", min_size=1, max_size=6)
PIECES = st.one_of(
    st.integers(0, 4095).map(str), st.floats(allow_nan=False).map(repr), PLAIN, TEXTS
)


@st.composite
def nearly_plain(draw) -> bytes:
    """A header, and cells that are numbers for the most part."""
    width = draw(st.integers(1, 3))
    numbers = st.one_of(st.integers(0, 4095).map(str), st.floats(-1e9, 1e9).map(repr))
    rows = draw(st.lists(st.lists(numbers, min_size=width, max_size=width), max_size=4))
    for _ in range(draw(st.integers(0, 2))):
        if rows:
            row = rows[draw(st.integers(0, len(rows) - 1))]
            row[draw(st.integers(0, 2)) % max(len(row), 1) :][:1] = []
            row.insert(draw(st.integers(0, 3)), draw(PIECES))
    ending = draw(st.sampled_from(["\n", "\r\n", "\r", "\n\n"]))
    lines = [",".join(["a", "b", "c"][:width]), *(",".join(row) for row in rows)]
    text = ending.join(lines) + draw(st.sampled_from(["", "\n", "\r\n", "\n\r\n", "\n ", "\r"]))
    return draw(st.sampled_from([b"", b"\xef\xbb\xbf"])) + text.encode("utf-8", "replace")


@settings(max_examples=sized(150, 1000), deadline=None, derandomize=True)
@given(data=st.one_of(nearly_plain(), nearly_plain(), malformed()))
def test_what_is_read_fast_is_read_alike_cell_by_cell(data):
    file = File("run.csv", data, "")
    fast = table_of_numbers(file)
    if fast is None:
        return
    slow = table_of_file(file)  # must not be refused
    assert not slow.ragged
    assert fast.names == slow.names
    assert fast.lines.tolist() == slow.lines.tolist()
    for a, b in zip(fast.columns, slow.columns, strict=True):
        assert np.array_equal(np.asarray(a).view(np.int64), numbers(b).view(np.int64))
        assert not np.isnan(a).any()


def test_a_plain_file_is_read_fast_and_one_in_doubt_is_not(tmp_path):
    def fast(text: str) -> bool:
        return table_of_numbers(File("run.csv", text.encode(), "")) is not None

    assert fast("a,b\n1,2\n3,4\n")
    assert fast("a,b\r\n1,2.5\r\n3,-4e1")
    for text in ("a,b\n1,\n", "a,b\n1, 2\n", 'a,b\n"1",2\n', "a,b\n1,nan\n", "a,b\n", "", "a"):
        assert not fast(text), text


def test_a_fault_in_a_plain_file_is_told_as_it_stands(write):
    rows = cells()
    rows[7][HEADER.index(NAMES[2])] = "04096.50"
    with pytest.raises(InputError) as error:
        load_readings(write(as_text(rows)), RSI)
    assert error.value.where is not None
    assert error.value.where["found"] == "04096.50"
    assert error.value.where["line"] == 8


@settings(max_examples=100, deadline=None, derandomize=True)
@given(at=st.floats(0.0, 1.0), byte=st.integers(0, 255))
def test_a_damaged_parquet_file_is_refused_or_loaded(tmp_path_factory, at, byte):
    pa = pytest.importorskip("pyarrow", reason="Parquet needs pyarrow")
    parquet = pytest.importorskip("pyarrow.parquet", reason="Parquet needs pyarrow")
    buffer = io.BytesIO()
    columns = {name: column.copy() for name, column in zip(NAMES, session()[0].T, strict=True)}
    parquet.write_table(pa.table(columns), buffer)
    data = bytearray(buffer.getvalue())
    data[min(int(at * len(data)), len(data) - 1)] = byte
    path = tmp_path_factory.mktemp("damaged") / "run.parquet"
    path.write_bytes(data)
    try:
        readings = load_readings(path, RSI)
    except InputError:
        return
    assert np.isfinite(readings.values).all()
