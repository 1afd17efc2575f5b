"""What a first user gives in Python for a file: taken for what it is, or refused by name."""

from __future__ import annotations

import csv
from collections.abc import Callable
from io import TextIOWrapper
from typing import Any

import numpy as np
import pytest

import rsicalib
from rsicalib import DEMO, InputError
from rsicalib.errors import InputTypeError

READINGS, REST = DEMO / "readings.csv", DEMO / "rest.csv"


def rows() -> list[dict[str, str]]:
    with READINGS.open(encoding="utf-8") as file:
        return list(csv.DictReader(file))


def values() -> list[list[float]]:
    """The channels of the session, row by row."""
    return [[float(row[name]) for name in row if name.startswith("a")] for row in rows()]


def test_rows_as_lists_are_the_array_that_they_are() -> None:
    """They passed for as many sessions of one reading each, which nothing judges."""
    plain = rsicalib.calibrate(values(), rest=REST)
    array = rsicalib.calibrate(np.array(values()), rest=REST)
    assert (plain.verdict, plain.fit.chi2) == (array.verdict, array.fit.chi2)
    assert plain.verdict == "unexplained"


def test_rows_as_dictionaries_are_the_columns_that_they_are() -> None:
    found = rsicalib.calibrate(rows(), rest=REST)
    assert found.fit.chi2 == rsicalib.calibrate(READINGS, rest=REST).fit.chi2
    with pytest.raises(InputError, match="rows with and without 'a22'"):
        rsicalib.calibrate([{k: v for k, v in rows()[0].items() if k != "a22"}, *rows()])


def test_several_sessions_in_memory_stay_several() -> None:
    table = {name: [float(row[name]) for row in rows()] for name in rows()[0]}
    half = [{k: v[:192] for k, v in table.items()}, {k: v[192:] for k, v in table.items()}]
    found = rsicalib.calibrate(half, rest=REST)
    assert found.readings.samples == 384


@pytest.mark.parametrize(
    ("give", "says"),
    [
        (lambda: READINGS.read_text(encoding="utf-8"), "the text of a file, expected its path"),
        (READINGS.read_bytes, "a value of type bytes"),
        (READINGS.open, "a value of type TextIOWrapper"),
        (lambda: [[1.0, 2.0], [3.0]], "rows of unlike lengths"),
    ],
)
def test_what_is_no_path_is_refused_by_name(give: Callable[[], Any], says: str) -> None:
    given = give()
    with pytest.raises(InputTypeError, match=says) as caught:
        rsicalib.calibrate(given, rest=REST)
    assert len(str(caught.value)) < 200
    if isinstance(given, TextIOWrapper):
        given.close()


def test_one_column_and_groups_of_pandas_are_refused() -> None:
    pandas = pytest.importorskip("pandas")
    frame = pandas.read_csv(READINGS)
    for given in (frame["a22"], frame.groupby("pose")):
        with pytest.raises(InputTypeError, match="expected a path, readings, a data frame"):
            rsicalib.calibrate(given, rest=REST)


def test_a_result_that_is_text_or_a_dictionary_is_refused_in_a_line() -> None:
    found = rsicalib.calibrate(READINGS, rest=REST)
    for given in (found.to_json(), found.to_dict()):
        with pytest.raises(InputError, match="calibration: found") as caught:
            rsicalib.forward(READINGS, calibration=given)  # type: ignore[arg-type]
        assert len(str(caught.value)) < 200
    with pytest.raises(InputTypeError, match="folder: found a value of type list"):
        rsicalib.history([found])  # type: ignore[arg-type]
    with pytest.raises(InputError, match="found no readings"):
        rsicalib.watch(np.zeros((0, 9)), found)


def test_names_in_one_text_are_shown_as_the_list_that_is_meant() -> None:
    with pytest.raises(InputTypeError, match=r"\['offset', 'gain'\]"):
        rsicalib.calibrate(READINGS, rest=REST, terms="offset,gain")  # type: ignore[arg-type]
