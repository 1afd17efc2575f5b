"""Columns whose names have a meaning and that hold something else: what they mean, what to do."""

from __future__ import annotations

from typing import Any

import pytest

import rsicalib
from rsicalib import InputError
from tests import crank

OTHERS: dict[str, tuple[dict[str, Any], str]] = {
    "places on a bed": ({"x": 1.0, "y": 2.0}, "found 'x' without 'z', .* 'x' means: Position of"),
    "a name of a pose": ({"pose": "home"}, "found 'home', .* 'pose' means: Label of a held pose"),
    "hours of use": ({"used": 7}, "found 7, expected 0 or 1. .* 'used' means: 1, or 0 in a row"),
    "words": ({"temperature_c": "warm"}, "found 'warm', .* means: Temperature"),
    "a name of a sample": ({"sample": "a"}, "found 'a', .* 'sample' means: Number of the sample"),
}


@pytest.mark.parametrize("case", OTHERS)
def test_says_what_the_column_means_and_what_to_do(case: str) -> None:
    cells, said = OTHERS[case]
    table = crank.columns() | {name: [cell] * 60 for name, cell in cells.items()}
    with pytest.raises(InputError, match=rf"{said}.*Rename or drop columns.* crank, rocker\."):
        rsicalib.load_readings(table, crank.MECHANISM)


def test_one_cell_that_cannot_be_used_is_a_slip_of_that_row() -> None:
    table = crank.columns() | {"pose": [*range(59), "home"]}
    with pytest.raises(InputError, match=r"found 'home', expected an integer. Correct the data"):
        rsicalib.load_readings(table, crank.MECHANISM)
