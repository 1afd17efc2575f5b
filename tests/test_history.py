"""Results of one device against date."""

from __future__ import annotations

import json
import re
import shutil
from dataclasses import replace
from pathlib import Path

import matplotlib
import numpy as np
import pytest

import rsicalib
from rsicalib import Calibration, InputError, Trace, load_calibration
from rsicalib.planning.platform_sd import readings_at_work
from rsicalib.poses.places import held_at
from rsicalib.report.past import Forecast
from tests import cone, oracle
from tests.blind import simulator
from tests.blind.simulator import Device
from tests.commands import run_text
from tests.oracle import Array
from tests.watch.device import readings_of

matplotlib.use("Agg")

DATES = ("2025-01-10", "2025-02-11", "2025-04-01", "2025-06-20", "2025-09-01")
DAYS = (0, 32, 81, 161, 234)
DRIFT = 1e-4
"""Of the offset of a22, rad per day."""


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Five results of a device whose a22 drifts, and some files that are none of its own."""
    place = tmp_path_factory.mktemp("history")
    rng = np.random.default_rng(3)
    device = Device.random(rng)
    for date, day in zip(DATES, DAYS, strict=True):
        offsets = device.offsets.copy()
        offsets[4] += DRIFT * day
        now = Device(offsets, device.gains)
        session = simulator.session(now, rng, simulator.hand_poses(rng, 40, now), 8)
        rest = readings_of(simulator.rest(now, rng))
        found = rsicalib.calibrate(readings_of(session), rest=rest, device="seven", date=date)
        found.save(place / f"{date}.json")
    text = found.to_json()
    (place / "broken.json").write_text('{"format":')
    (place / "none.json").write_text("[]")
    (place / "other.json").write_text(text.replace('"seven"', '"eight"'))
    (place / "undated.json").write_text(text.replace(f'"{DATES[-1]}"', "null"))
    (place / "misdated.json").write_text(text.replace(f'"{DATES[-1]}"', '"01/09/2025"'))
    (place / "sent again.json").write_text(text)
    return place


def test_parameters_stand_against_date_with_their_drift(folder: Path) -> None:
    found = rsicalib.history(folder)
    assert found.device == "seven"
    assert tuple(past.valid_from for past in found.results) == DATES
    series = {(s.term, s.target): s for s in found.parameters}
    assert len(series) == 18
    drifting = series["offset", "a22"]
    assert drifting.rate is not None
    assert drifting.rate_sd is not None
    assert drifting.p_value is not None
    assert abs(drifting.rate - DRIFT) < 4 * drifting.rate_sd
    assert drifting.p_value < 1e-3
    # Witness: the same line by numpy, which scales nothing.
    weight = 1.0 / np.array(drifting.sd)
    slope, _ = np.polyfit(DAYS, drifting.values, 1, w=weight)
    assert drifting.rate == pytest.approx(slope, rel=1e-6)
    for key, one in series.items():
        if key != ("offset", "a22"):
            assert one.p_value is not None
            assert one.p_value > 1e-4


def test_a_history_is_a_table_a_picture_and_a_line(folder: Path) -> None:
    found = rsicalib.history(folder)
    frame = found.to_dataframe()
    own = frame[frame.name == "offset@a22"]
    (series,) = (s for s in found.parameters if s.key == "offset@a22")
    assert tuple(own.valid_from) == DATES and tuple(own.value) == series.values
    axes = found.plot()  # what drifts
    assert axes.get_ylabel() == "offset@a22 [rad]"
    drawn = np.asarray(axes.lines[0].get_ydata(), dtype=float)
    np.testing.assert_array_equal(drawn, series.values)
    with pytest.raises(KeyError, match="there are offset@a11"):
        found.plot("offset@a99")
    assert repr(found) == "<History of 'seven': 5 results, offset@a22 drifts>"
    assert "<pre>seven: 5 results" in found._repr_html_()


def test_damaged_and_foreign_files_are_listed_and_left_out(folder: Path) -> None:
    left = {one.file: one.reason for one in rsicalib.history(folder).left_out}
    assert set(left) == {
        *("broken.json", "none.json", "other.json", "undated.json"),
        *("misdated.json", "sent again.json"),
    }
    assert "JSON" in left["broken.json"]
    assert not [reason for reason in left.values() if str(folder) in reason]  # `file` says which
    assert "'eight'" in left["other.json"]
    assert "date" in left["undated.json"]
    assert "found '01/09/2025'" in left["misdated.json"]
    assert left["sent again.json"] == f"a copy of {DATES[-1]}.json"
    assert rsicalib.history(folder, device="eight").results[0].file == "other.json"
    with pytest.raises(InputError, match="'nine'"):
        rsicalib.history(folder, device="nine")


def test_the_day_of_too_large_an_error_is_that_of_the_drift(folder: Path) -> None:
    target = 0.02
    found = rsicalib.history(folder, target=target).forecast
    assert found is not None
    assert found.day is not None
    assert found.from_day is not None
    assert DATES[-1] < found.from_day < found.day
    # Witness: how far the handle moves with the offset of a22, by the oracle's kinematics.
    rng = np.random.default_rng(1)
    poses = simulator.hand_poses(rng, 200)
    mechanism = oracle.rsi()
    offsets, gains = oracle.nominal(mechanism)
    counts = (oracle.rsi_inverse(poses).reshape(-1, 9) - offsets) / gains
    moved = offsets.copy()
    moved[4] += 1e-3
    here, there = (oracle.points(mechanism, counts * gains + o) for o in (offsets, moved))
    per_rad = np.sqrt(((there - here).mean(axis=1) ** 2).mean()) / 1e-3
    days = (np.datetime64(found.day) - np.datetime64(DATES[-1])).astype(int)
    # Readings are moved onto the closures first, and the rate is known to a quarter.
    assert 0.3 < days * DRIFT * per_rad / target < 3.0


# The witness moves a result's parameters, at readings without noise.
@pytest.mark.filterwarnings("ignore::rsicalib.OpenLoopsWarning")
def test_the_forecast_draws_all_parameters_together(folder: Path) -> None:
    target = 0.01
    found = rsicalib.history(folder, target=target).forecast
    assert found is not None
    results = [load_calibration(folder / f"{date}.json") for date in DATES]
    to_come, drift = _drawn_together(results, 20_000)
    days = np.arange(3651)
    squares = [(to_come**2).sum(1), 2.0 * (to_come * drift).sum(1), (drift**2).sum(1)]
    above = np.array([np.mean(np.polyval(squares[::-1], day) > target**2) for day in days])
    assert found.now == pytest.approx(np.sqrt(np.median(squares[0])), rel=0.05)
    for said, share in ((found.day, 0.5), (found.from_day, 0.05)):
        assert said is not None
        # The share is counted among 4,000 draws, here among 20,000: 4 standard errors of both.
        wide = 4.0 * np.sqrt(share * (1.0 - share) * (1 / 4_000 + 1 / 20_000))
        first, last = (np.argmax(above >= share + side * wide) for side in (-1, 1))
        assert first <= int((np.datetime64(said) - np.datetime64(DATES[-1])).astype(int)) <= last


def _drawn_together(results: list[Calibration | Trace], draws: int) -> tuple[Array, Array]:
    """Errors of the platform today and per day: coordinates over the root of their number.

    Lines through all parameters of all results by numpy, and the errors of all results drawn.
    """
    last, rsi = results[-1], rsicalib.load_mechanism("rsi")
    n, days = len(last.parameters), np.array(DAYS) - DAYS[-1]
    values = [np.array([p.value for p in result.parameters], dtype=float) for result in results]
    roots = [np.linalg.cholesky(result.covariance) for result in results]
    lines = [np.hstack([np.eye(n), day * np.eye(n)]) for day in days]
    whitened = [np.linalg.solve(root, x) for root, x in zip(roots, lines, strict=True)]
    told = [np.linalg.solve(root, v - values[-1]) for root, v in zip(roots, values, strict=True)]
    slope = np.linalg.pinv(np.vstack(whitened), rcond=1e-14)[n:]
    errors = np.random.default_rng(5).standard_normal((draws, n * len(results)))
    rates = slope @ np.concatenate(told) - errors @ slope.T
    # How the platform moves with each parameter, by poses that are found again.
    readings, _ = readings_at_work(last, rsi, 40, seed=0)
    at = held_at(last, rsi, readings)

    def places(moved: Array) -> Array:
        shifted = zip(last.parameters, values[-1] + moved, strict=True)
        own = tuple(replace(p, value=float(v)) for p, v in shifted)
        found: Array = rsicalib.forward(at, rsi, replace(last, parameters=own))[:, :3].ravel()
        return found

    steps = np.diag(np.sqrt(np.diagonal(last.covariance)))
    by = [(places(step) - places(-step)) / (2.0 * step.sum()) for step in steps]
    moves = np.array(by) / np.sqrt(by[0].size)
    return -errors[:, -n:] @ roots[-1].T @ moves, rates @ moves


def test_the_forecast_does_not_depend_on_where_readings_are_zero(tmp_path: Path) -> None:
    first = rsicalib.simulate(poses=30, seed=1)
    sessions = [first, *(rsicalib.simulate(poses=30, seed=k, device=first.device) for k in (2, 3))]

    def forecast(shift: float) -> Forecast:
        drawn = rsicalib.load_mechanism("rsi").to_dict()
        for channel in drawn["channel"]:
            channel["offset"] -= shift * channel["gain"]
            channel.pop("range", None)
            channel.update(unit="V", noise=1.0)  # no counts of a converter
        mechanism, place = rsicalib.Mechanism.from_dict(drawn), tmp_path / f"{shift:g}"
        place.mkdir()

        def moved(read: rsicalib.Readings) -> rsicalib.Readings:
            return rsicalib.Readings.from_arrays(mechanism, read.values + shift, pose=read.pose)

        rest = moved(first.rest)
        for year, made in enumerate(sessions, 2025):
            date = f"{year}-01-01"
            found = rsicalib.calibrate(moved(made.readings), mechanism, rest=rest, date=date)
            found.save(place / f"{year}.json")
        told = rsicalib.history(place, mechanism, target=0.006).forecast
        assert told is not None
        return told

    def days(told: Forecast) -> list[int]:
        start = np.datetime64("2027-01-01")
        assert told.day is not None and told.from_day is not None
        both = np.array([told.day, told.from_day], dtype="datetime64[D]")
        return [int(days) for days in (both - start).astype(int)]

    here, there = forecast(0.0), forecast(-2048.0)
    # The draws are others: a median of 4,000 is known to 2 %, one in twenty of them to 6 %.
    assert there.now == pytest.approx(here.now, rel=0.05)
    np.testing.assert_allclose(days(there), days(here), rtol=0.12)


def test_the_command_prints_text_json_and_a_page(folder: Path, tmp_path: Path) -> None:
    words = ["history", folder, "--target", "0.02"]
    done = run_text(*words)
    assert done.returncode == 0, done.stderr
    assert "drifts beyond chance: offset@a22" in done.stdout
    assert "broken.json" in done.stdout
    done = run_text(*words, "--json", "--out", tmp_path)
    assert json.loads(done.stdout)["format"] == "rsicalib.history/1"
    page = (tmp_path / "history.html").read_text()
    assert page.count("<figure") == 18 + 1  # and all in one grid
    assert "Drifting: offset of a22" in page


def test_one_result_has_no_rate_and_no_forecast(folder: Path, tmp_path: Path) -> None:
    shutil.copy(folder / f"{DATES[0]}.json", tmp_path)
    past = rsicalib.history(tmp_path, target=0.02)
    assert past.forecast is None and all(one.rate is None for one in past.parameters)
    for said in (past.text(), past.page()):
        assert "second result" in said and "ten years" not in said


def test_a_folder_without_results_says_so(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="no such folder"):
        rsicalib.history(tmp_path / "nowhere")
    with pytest.raises(InputError, match="a result with a date"):
        rsicalib.history(tmp_path)


def test_a_folder_of_results_of_another_mechanism_asks_for_it(folder: Path) -> None:
    with pytest.raises(InputError, match="expected a result with a date") as refused:
        rsicalib.history(folder, "so101")
    first = refused.value.message.split(f". {DATES[0]}.json: ")[1]
    assert first.startswith("found a calibration of 'rsi', expected one of")
    assert refused.value.message.endswith("(--mechanism FILE).") and ".," not in first


@pytest.fixture(scope="module")
def moved(tmp_path_factory: pytest.TempPathFactory) -> rsicalib.History:
    """Five results of devices that share no offset: as one device they scatter in all."""
    place = tmp_path_factory.mktemp("moved")
    for seed, date in enumerate(DATES):
        made = rsicalib.simulate(seed=seed)
        found = rsicalib.calibrate(made.readings, rest=made.rest, device="seven", date=date)
        found.save(place / f"{date}.json")
    return rsicalib.history(place, target=0.002)


def test_a_page_of_a_device_that_scatters_is_no_good_one(moved: rsicalib.History) -> None:
    scattered = [one for one in moved.parameters if one.scatter]
    assert len(scattered) > 10 and not any(one.jumps for one in moved.parameters)
    page = moved.page()
    assert 'class="verdict bad"' in page
    assert re.search(rf"<summary>{len(scattered)} ", page), "a long list is folded"
    assert all(name not in page for name in ("<th>note", "<th>found", "line is a jump"))


def test_an_error_above_the_target_has_no_day_to_come(moved: rsicalib.History) -> None:
    forecast = moved.forecast
    assert forecast is not None and forecast.day is not None
    assert forecast.now > forecast.target
    said = next(line for line in moved.text().splitlines() if line.startswith("platform error"))
    assert "already" in said and forecast.day not in said


def test_results_of_unknown_points_alone_say_that_nothing_is_compared(tmp_path: Path) -> None:
    arm = rsicalib.Mechanism.from_toml(cone.mechanism(2e-5, 0.02, terms="[]"))
    for month in (1, 2):
        found = rsicalib.calibrate(
            cone.session(month, poses=12, samples=2).table, arm, date=f"2026-0{month}-01"
        )
        found.save(tmp_path / f"{month}.json")
    told = rsicalib.history(tmp_path, arm)
    assert "no parameter of these results outlasts its session" in told.text()
    assert "second result" not in str(told) and "parameter  last" not in told.text()
    assert "no rate" in repr(told) and "nothing drifts" not in repr(told)
