"""A data frame, a mapping, rows or `Readings` wherever readings are asked for."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import rsicalib
from rsicalib import DEMO, InputError, Trace
from tests import crank

pandas = pytest.importorskip("pandas")


@pytest.fixture(scope="module")
def found() -> Trace:
    return rsicalib.trace(crank.columns(), crank.MECHANISM)


def readings() -> rsicalib.Readings:
    return rsicalib.load_readings(crank.columns(), crank.MECHANISM)


GIVEN: dict[str, Callable[[Path], Any]] = {
    "a frame": lambda _: pandas.DataFrame(crank.columns()),
    "columns in another order": lambda _: pandas.DataFrame(crank.columns())[["rocker", "crank"]],
    "a mapping": lambda _: crank.columns(),
    "an array": lambda _: np.column_stack([*crank.columns().values()]),
    "rows": lambda _: np.column_stack([*crank.columns().values()]).tolist(),
    "Readings": lambda _: readings(),
    "a path": lambda folder: saved(folder),
}


def saved(folder: Path) -> Path:
    readings().to_csv(folder / "readings.csv")
    return folder / "readings.csv"


TAKES: dict[str, Callable[[Any, Trace], Any]] = {
    "calibrate": lambda given, of: rsicalib.calibrate(given, crank.MECHANISM).values,
    "calibrate, beside": lambda given, of: rsicalib.calibrate(given, calibration=of).values,
    "trace": lambda given, of: rsicalib.trace(given, crank.MECHANISM).values,
    "forward": lambda given, of: np.asarray(rsicalib.forward(given, calibration=of)),
    "observability": lambda given, of: rsicalib.observability(given, crank.MECHANISM).text(),
    "suppose": lambda given, of: rsicalib.suppose(
        given, ["offset@crank=1"], crank.MECHANISM
    ).text(),
    "certify": lambda given, of: rsicalib.certify(of, limit=1.0, at=given).text(),
    "export_result": lambda given, of: rsicalib.export_result(of, "csv", readings=given),
    "watch": lambda given, of: watching(given, of),
    "Monitor": lambda given, of: updated(given, of),
}


def watching(given: Any, of: Trace) -> Any:
    watch = rsicalib.watch(given, of)
    return list(watch), watch.summary()


def updated(given: Any, of: Trace) -> Any:
    monitor = rsicalib.Monitor(of)
    given = rsicalib.load_readings(given, crank.MECHANISM) if isinstance(given, Path) else given
    return monitor.update(given), monitor.summary()


@pytest.mark.parametrize("name", TAKES)
def test_all_that_is_readings_gives_the_same(name: str, found: Trace, tmp_path: Path) -> None:
    took = {kind: TAKES[name](given(tmp_path), found) for kind, given in GIVEN.items()}
    for kind, one in took.items():
        if isinstance(one, np.ndarray):
            np.testing.assert_array_equal(one, took["a frame"], err_msg=kind)
        else:
            assert one == took["a frame"], kind


def test_a_watch_counts_rows_of_a_frame_that_cannot_be_used(found: Trace) -> None:
    table = pandas.DataFrame(crank.columns())
    table.loc[3, "crank"] = np.nan
    watch = rsicalib.watch(table, found)
    assert list(watch) == []
    assert (watch.summary().rows, watch.summary().unreadable) == (60, 1)


def test_a_watch_refuses_a_frame_without_a_channel(found: Trace) -> None:
    with pytest.raises(InputError, match="column rocker: found no such column"):
        rsicalib.watch({"crank": [0.0]}, found)
    with pytest.raises(TypeError, match="readings: found 3, expected a path, readings, a data"):
        rsicalib.watch(3, found)  # type: ignore[arg-type]


def test_a_watch_takes_dates_row_by_row_or_frame_by_frame(found: Trace, tmp_path: Path) -> None:
    """The same times, whatever they are counted from: no row is late."""
    dates = pandas.date_range("2025-03-01", periods=60, freq="100ms")
    table = pandas.DataFrame(crank.columns()).assign(time_s=dates)
    table.to_parquet(tmp_path / "readings.parquet")
    for given in (table, tmp_path / "readings.parquet"):
        watch = rsicalib.watch(given, found, false_alarms="0.1/h")
        assert list(watch) == []
        assert watch.summary().false_alarms == pytest.approx(0.1 * 0.1 / 3600)
    # Dates in a column of another name are times, as where a session is loaded.
    named = rsicalib.watch(table.rename(columns={"time_s": "stamp"}), found, false_alarms="0.1/h")
    assert named.summary().false_alarms == pytest.approx(0.1 * 0.1 / 3600)
    monitor = rsicalib.Monitor(found)
    for first in (0, 20, 40):
        monitor.update(table[first : first + 20])
    assert (monitor.summary().used, monitor.summary().late) == (60, 0)


def test_a_watch_over_devices_takes_a_frame(found: Trace, tmp_path: Path) -> None:
    rsicalib.calibrate(crank.columns(), crank.MECHANISM, device="one").save(tmp_path / "one.json")
    table = pandas.DataFrame(crank.columns()).assign(device="one")
    watch = rsicalib.watch_devices(table, tmp_path, crank.MECHANISM)
    assert list(watch) == []
    assert watch.summary().rows == 60


def test_a_cell_of_which_pandas_says_nothing_is_blank() -> None:
    table = pandas.DataFrame(crank.columns()).astype(object)
    table.loc[5, "crank"] = pandas.NA
    with pytest.raises(InputError, match="row 6, column crank: found blank"):
        rsicalib.load_readings(table, crank.MECHANISM)
    kept = rsicalib.load_readings(table, crank.MECHANISM, skip_bad_rows=True)
    assert len(kept) == len(table) - 1


def test_what_is_in_memory_is_called_by_its_argument() -> None:
    frame = rsicalib.load_readings(DEMO / "readings.csv").to_dataframe()
    for name in ("rest", "check"):
        words = rf"^{name} \(data in memory\): found no readings"
        with pytest.raises(InputError, match=words):
            rsicalib.calibrate(frame, **{name: frame.iloc[:0]})
    with pytest.raises(InputError, match="The names of the columns are numbers"):
        rsicalib.load_readings(pandas.DataFrame(frame.to_numpy()))


@pytest.mark.parametrize("source", ["run", "run v1.5"])
def test_a_name_of_arrays_is_no_file_whatever_is_in_it(source: str) -> None:
    given = np.column_stack([*crank.columns().values()])
    named = rsicalib.Readings.from_arrays(
        rsicalib.load_mechanism(crank.MECHANISM), given, source=source
    )
    assert rsicalib.calibrate(named, crank.MECHANISM).readings.files == ()
