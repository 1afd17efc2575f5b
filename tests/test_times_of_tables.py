"""Times of a table that are dates or durations, as its library has them: seconds from the first."""

from __future__ import annotations

import datetime
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import rsicalib
from rsicalib import InputError
from tests import crank

pandas = pytest.importorskip("pandas")
pyarrow = pytest.importorskip("pyarrow")

SECONDS = 0.1 * np.arange(60)
DATES = np.datetime64("2025-03-01T12:00", "ns") + (SECONDS * 1e9).round().astype("m8[ns]")
OF_PYTHON = [
    datetime.datetime(2025, 3, 1, 12) + datetime.timedelta(milliseconds=100 * k) for k in range(60)
]


def frame(**columns: Any) -> Any:
    return pandas.DataFrame(crank.columns()).assign(**columns)


def dates(zone: str | None = None) -> Any:
    return pandas.DatetimeIndex(DATES, tz=zone)


TABLES: dict[str, Callable[[], Any]] = {
    "dates": lambda: frame(time_s=dates()),
    "dates in a zone": lambda: frame(time_s=dates("Asia/Tokyo")),
    "durations": lambda: frame(time_s=dates() - dates()[0]),
    "an index": lambda: frame().set_index(dates()),
    "an index of durations": lambda: frame().set_index(dates() - dates()[0]),
    "an index with a name": lambda: frame().set_index(dates().rename("time_s")),
    "another name": lambda: frame(timestamp=dates()),
    "an index with another name": lambda: frame().set_index(dates().rename("stamp")),
    "arrays": lambda: crank.columns() | {"time_s": DATES},
    "arrays of durations": lambda: crank.columns() | {"time_s": DATES - DATES[0]},
    "dates of Python": lambda: crank.columns() | {"time_s": OF_PYTHON},
    "objects": lambda: frame(time_s=pandas.Series(OF_PYTHON, dtype=object)),
    "Arrow": lambda: pyarrow.Table.from_pandas(frame(time_s=dates())),
}


def times(table: Any) -> Any:
    return rsicalib.load_readings(table, crank.MECHANISM).time_s


def imported(path: Path) -> Any:
    log = rsicalib.import_log(path, mechanism=crank.MECHANISM, hold=0.0)
    return log.readings(rsicalib.load_mechanism(crank.MECHANISM))[0].time_s


@pytest.mark.parametrize("kind", TABLES)
def test_dates_and_durations_are_seconds_from_the_first(kind: str) -> None:
    # A nanosecond is the last digit of all of them.
    np.testing.assert_allclose(times(TABLES[kind]()), SECONDS, rtol=0, atol=1e-9)


@pytest.mark.parametrize("name", ["time_s", "timestamp"])
def test_dates_of_a_parquet_file_are_taken(name: str, tmp_path: Path) -> None:
    path = tmp_path / "readings.parquet"
    frame(**{name: dates()}).to_parquet(path)
    np.testing.assert_allclose(times(path), SECONDS, rtol=0, atol=1e-9)
    np.testing.assert_allclose(imported(path), SECONDS, rtol=0, atol=1e-9)


def test_arrays_may_have_dates() -> None:
    values = np.column_stack([*crank.columns().values()])
    mechanism = rsicalib.load_mechanism(crank.MECHANISM)
    found = rsicalib.Readings.from_arrays(mechanism, values, time_s=DATES)
    assert found.time_s is not None
    np.testing.assert_allclose(found.time_s, SECONDS, rtol=0, atol=1e-9)


def test_numbers_are_seconds_as_they_stand_beside_an_index_of_dates() -> None:
    table = frame(time_s=SECONDS + 7.0).set_index(dates())
    np.testing.assert_array_equal(times(table), SECONDS + 7.0)


def test_a_duration_is_not_counted_from_the_first() -> None:
    later = DATES - DATES[0] + np.timedelta64(7, "s")
    np.testing.assert_allclose(times(frame(time_s=later)), SECONDS + 7.0, rtol=0, atol=1e-9)


def test_a_date_that_is_missing_is_told_by_its_row() -> None:
    missing = DATES.copy()
    missing[3] = "NaT"
    with pytest.raises(InputError, match=r"row 4, column time_s: found 'NaT', expected a finite"):
        times(frame(time_s=missing))


def test_dates_are_no_other_numbers() -> None:
    for name in ("crank", "pose", "temperature_c"):
        with pytest.raises(InputError, match=rf"column {name}: found 2025-03-01T12:00:00"):
            times(frame(**{name: dates()}))


@pytest.mark.parametrize("text", ["2025-03-01 12:00:07.25", "01.03.2025 12:00:07"])
def test_text_of_a_date_has_a_way_in(text: str, tmp_path: Path) -> None:
    table = frame(time_s=text)
    with pytest.raises(InputError, match=r"becomes dates by pandas\.to_datetime"):
        times(table)
    table.to_csv(tmp_path / "readings.csv", index=False)
    with pytest.raises(InputError, match=r"Dates as ISO 8601 has them.* rsicalib import"):
        times(tmp_path / "readings.csv")


def test_a_file_of_dates_is_read_by_import(tmp_path: Path) -> None:
    path = tmp_path / "readings.csv"
    frame(time_s=dates()).to_csv(path, index=False)
    np.testing.assert_allclose(imported(path), SECONDS, rtol=0, atol=1e-6)
