"""The small form of `benches/honesty.py`: intervals, tests and starts keep their word.

Everything is seeded, so that a test that passes once passes always; tolerances are those of the
Monte Carlo, so that it passes for the right reason. A figure is off where it misses what is
demanded by more than `SURE` standard errors of itself: 4, once in 16,000 for one figure.
"""

from __future__ import annotations

import json
from collections.abc import Callable
from dataclasses import replace
from functools import partial
from pathlib import Path

import numpy as np
import pytest

import rsicalib
from benches import honesty as bench
from benches.honesty import Cell, Honesty
from rsicalib import Calibration, Trace, _core
from rsicalib.facts.warned import WIRING
from tests.blind import effects, simulator
from tests.blind.effects import Effect
from tests.blind.scene import held
from tests.blind.simulator import CHANNELS, Device
from tests.full import sized
from tests.oracle import Array

SURE = 4.0

CELLS = [
    Cell(24, 2, 0.5, tremor=True),
    Cell(24, 2, 3.0),
    Cell(24, 8, 1.0),
    Cell(48, 2, 1.0, tremor=True),
    Cell(48, 8, 3.0, tremor=True),
]


# The error of a coverage is that of these sessions: of fewer than 100 it is too small at times.
@pytest.fixture(scope="module", params=sized(CELLS[1:4:2], CELLS), ids=lambda cell: cell.name)
def honest(request: pytest.FixtureRequest) -> Honesty:
    """100 sessions of a cell; the 18 parameters of one go together, as its errors know."""
    return bench.honesty(request.param, 100)


def test_intervals_cover_the_truth_as_often_as_they_say(honest: Honesty) -> None:
    assert abs(honest.coverage - 0.95) < SURE * honest.coverage_error
    # The largest of 18 correlated binomials of 100 with a mean miss of 5: skewed, hence 5.
    assert honest.worst < 5.0


def test_the_lack_of_fit_test_has_uniform_p_values(honest: Honesty) -> None:
    assert honest.uniform > 1e-4  # SURE, for a p-value


def test_errors_are_those_of_the_bound(honest: Honesty) -> None:
    assert 0.97 - SURE * honest.rms_error < honest.rms < 1.05 + SURE * honest.rms_error


def test_intervals_are_as_wide_as_the_bound(honest: Honesty) -> None:
    # Their mean over 100 sessions of at least 72 degrees of freedom each: known to 1 %.
    assert 0.96 < honest.width < 1.06


def test_gains_are_not_biased(honest: Honesty) -> None:
    assert abs(honest.bias) < 0.1 + SURE * honest.bias_error


@pytest.mark.parametrize("sigma", sized([0.0, 0.2], [0.0, 0.05, 0.2]))
def test_rounding_that_is_the_same_in_all_samples_does_not_average_out(sigma: float) -> None:
    # How much more the mean of 8 codes varies than if rounding were noise, by trying: √8
    # without noise, where 8 samples are one.
    rng = np.random.default_rng(8)
    exact = rng.uniform(0.0, 1.0, 20_000)
    codes = np.rint(exact[:, None] + sigma * rng.standard_normal((20_000, 8)))
    expected = np.std(codes.mean(axis=1) - exact) / np.sqrt((sigma**2 + 1 / 12) / 8)
    found = bench.honesty(Cell(24, 8, sigma), sized(40, 60))
    assert abs(found.coverage - 0.95) < SURE * found.coverage_error
    assert found.width == pytest.approx(expected, rel=0.05)  # the share of rounding is an estimate


def test_a_noisy_channel_is_told_from_the_others() -> None:
    found = bench.honesty(Cell(24, 8, 1.0, louder=4.0), sized(40, 60))
    assert found.apart == 1.0
    assert abs(found.coverage - 0.95) < SURE * found.coverage_error
    # Each of its two variances is known to 10 %: as good as known.
    assert 0.97 < found.width < 1.05
    assert found.rms < 1.05 + SURE * found.rms_error


def test_the_noise_of_a_noisy_channel_is_found() -> None:
    rng = np.random.default_rng(5)
    device = Device.random(rng)
    scene = held(rng, simulator.hand_poses(rng, 48, device), 8, bench.TREMOR)
    sigma = np.where(np.arange(9) == 4, 4.0, 1.0)
    values = np.rint(device.ideal(scene) + sigma * rng.standard_normal((384, 9)))
    read = bench.table({"values": values, "pose": scene.label, "time_s": None})
    found = _core.Session(bench.RSI, read).fit().to_dict()["noise"]
    assert found["source"] == "misclosure of repeats, by channel"
    assert len(set(found["sigma"].values())) == 2
    # 336 differences within poses, three closures for three arms: 100 degrees of freedom at least.
    assert found["sigma"]["a22"] == pytest.approx(np.sqrt(16 + 1 / 12), rel=SURE / np.sqrt(200))
    assert found["sigma"]["a11"] == pytest.approx(np.sqrt(1 + 1 / 12), rel=SURE / np.sqrt(1600))


def test_one_bad_sample_is_no_noisy_channel() -> None:
    rng = np.random.default_rng(6)
    device = Device.random(rng)
    read = simulator.session(device, rng, simulator.hand_poses(rng, 24, device), 8)
    read["values"][50, 3] += 60
    found = _core.Session(bench.RSI, bench.table(read)).fit().to_dict()["noise"]
    assert found["source"] == "misclosure of repeats"


def test_correlated_samples_are_counted_as_fewer() -> None:
    found = bench.honesty(Cell(24, 8, 1.0, correlation=0.6), sized(30, 100))
    assert found.coverage > 0.93 - SURE * found.coverage_error
    assert found.uniform > 1e-4
    # The mean of 8 such samples varies 1.7 times as much as that of independent ones.
    assert found.width == pytest.approx(1.9, abs=0.3)


def test_correlation_that_two_samples_cannot_show_widens_by_the_lack_of_fit() -> None:
    found = bench.honesty(Cell(48, 2, 1.0, correlation=0.6), sized(30, 100))
    assert found.coverage > 0.93 - SURE * found.coverage_error
    # The mean of two such samples varies (1 + 0.6) times as much as that of independent ones.
    assert found.width == pytest.approx(np.sqrt(1.6), rel=0.05)


def test_a_recording_is_as_honest_as_held_poses() -> None:
    found = bench.honesty(Cell(4000, 0, 1.0), sized(8, 20))
    assert abs(found.coverage - 0.95) < SURE * max(found.coverage_error, 0.02)
    assert found.uniform > 1e-4
    assert found.rms < 1.05 + SURE * found.rms_error
    assert 0.97 < found.width < 1.03  # 9,000 degrees of freedom


def test_plain_least_squares_misplaces_the_handle() -> None:
    if not (bench.DATA / "waved").is_dir():
        pytest.skip("the recording is not here")
    error = bench.handle_errors(bench.recorded(bench.DATA / "waved"))
    # Measured by an independent prototype: 0.0024-0.0030 in against 0.006-0.012 in.
    assert error["implicit_loop"] < 0.004 < error["algebraic"]


def test_plain_least_squares_misplaces_the_handle_of_a_simulated_device() -> None:
    errors = [bench.handle_errors(bench.simulated_recording(seed)) for seed in range(sized(2, 4))]
    implicit, algebraic = (
        np.array([error[method] for error in errors]) for method in ("implicit_loop", "algebraic")
    )
    # Noise in the readings biases plain least squares: two to four times the error, by the
    # independent prototype.
    assert np.median(implicit) < 0.004
    assert np.median(algebraic / implicit) > 1.5


# ------------------------------------------------------------------ starts


@pytest.mark.parametrize("which", ["hand", "III", "both"])
def test_wrong_nominal_gains_lead_to_the_same_fit(which: str) -> None:
    # Demanded is 99.9 %: of 100, none may fail but by bad luck of 1 in 10.
    rows = bench.inline(partial(bench.one_start, which, 1), sized(30, 100))
    assert all(row.arrived for row in rows)


def test_without_a_rest_reading_equal_gains_may_be_far_off() -> None:
    # The paper's method converges in [-1.54, -1.33]e-3 rad/count.
    low, high = bench.our_interval(step=0.2, reach=3.0)
    assert low < 2.5 * bench.NOMINAL[1][0]
    assert high > 0.5 * bench.NOMINAL[1][0]


@pytest.mark.parametrize("seed", range(sized(2, 5)))
def test_without_a_rest_reading_and_rest_elsewhere_on_the_track(seed: int) -> None:
    # Nominal offsets as the potentiometers were clamped, gains off by a common factor.
    rng = np.random.default_rng(seed)
    offsets, gains = bench.NOMINAL
    turned = gains * rng.uniform(-400, 400, 9)
    device = Device.random(rng)
    device = replace(device, offsets=device.offsets + turned)
    read = bench.table(simulator.session(device, rng, simulator.hand_poses(rng, 24, device), 2))
    there = _core.Session(bench.believed(device.offsets, device.gains), read, starts=1).fit()
    wrong = bench.believed(offsets + turned, gains * rng.choice([0.4, 0.6, 1.6, 2.5]))
    found = _core.Session(wrong, read).fit()
    np.testing.assert_allclose(
        bench.estimates(found.to_dict()), bench.estimates(there.to_dict()), rtol=1e-6
    )


def session(seed: int) -> tuple[Array, Array, Array]:
    """Readings of 24 poses, their labels, and a rest reading."""
    rng = np.random.default_rng(seed)
    device = Device.random(rng)
    read = simulator.session(device, rng, simulator.hand_poses(rng, 24, device), 2)
    return read["values"], read["pose"], simulator.rest(device, rng)["values"]


def fitted(values: Array, pose: Array, rest: Array) -> _core.Fit:
    """The fit of such a session."""
    read = bench.table({"values": values, "pose": pose, "time_s": None})
    return _core.Session(bench.RSI, read, rest=rest.astype(np.float64)).fit()


def named(found: _core.Fit) -> list[tuple[str, str]]:
    """What a fit warns of, and where."""
    return [(w["kind"], w["target"]) for w in found.warnings]


@pytest.mark.parametrize("channel", sized([8], range(9)))
def test_a_reversed_channel_is_named_and_its_gain_found(channel: int) -> None:
    values, pose, rest = session(channel)
    straight = bench.estimates(fitted(values, pose, rest).to_dict())
    values[:, channel], rest[:, channel] = 4095 - values[:, channel], 4095 - rest[:, channel]
    found = fitted(values, pose, rest)
    assert named(found) == [("reversed", CHANNELS[channel])]
    gain = bench.estimates(found.to_dict())[9 + channel]
    assert gain == pytest.approx(-straight[9 + channel], rel=1e-6)


@pytest.mark.parametrize(("a", "b"), sized([(0, 1), (2, 6)], [(0, 1), (1, 4), (2, 6), (7, 8)]))
def test_two_exchanged_channels_are_named(a: int, b: int) -> None:
    values, pose, rest = session(10 + a)
    for readings in (values, rest):
        readings[:, [a, b]] = readings[:, [b, a]]
    found = fitted(values, pose, rest)
    assert named(found) == [("exchanged", f"{CHANNELS[a]}+{CHANNELS[b]}")]


def test_a_gap_within_the_range_of_motion_is_named() -> None:
    values, pose, rest = session(20)
    for readings in (values, rest):
        turned = readings[:, 1] + 2000
        # Behind the gap of 20° the track begins again.
        readings[:, 1] = np.where(turned > 4095, np.maximum(turned - 4337, 0), turned)
    assert named(fitted(values, pose, rest)) == [("gap", "a12")]


@pytest.mark.parametrize("channel", sized([4], range(9)))
def test_a_stuck_channel_is_named(channel: int) -> None:
    values, pose, rest = session(40 + channel)
    values[20:, channel] = values[20, channel]
    found = [one for one in named(fitted(values, pose, rest)) if one[0] in WIRING - {"no_start"}]
    assert found == [("stuck", CHANNELS[channel])]


def test_a_sound_session_has_no_warnings() -> None:
    assert fitted(*session(30)).warnings == []


# ------------------------------------------------------------------ bad readings


def test_bad_readings_are_found_and_clean_sessions_left_alone() -> None:
    sessions = sized(2, 10)
    clean = bench.inline(partial(bench.one_bad, None, 0, 1), sessions)
    assert all(row.extras == 0 for row in clean)  # 1 % each: 1 in 10 by bad luck
    one = bench.inline(partial(bench.one_bad, effects.BadReading, 1, 1), sessions)
    assert all(row.pose == 1 for row in one)
    assert bench.error_ratio(one) < 1.05
    sample = bench.inline(partial(bench.one_bad, effects.GrossSample, 1, 1), sessions)
    assert all(row.pose == 1 for row in sample)
    assert bench.error_ratio(sample) < 1.05


def spoilt_file(folder: Path) -> tuple[Path, Path, Effect]:
    """Files of a session of 48 poses with a bad reading, and that reading."""
    rng = np.random.default_rng(11)
    device = Device.random(rng)
    scene = held(rng, simulator.hand_poses(rng, 48, device), 8, (0.0, 0.0))
    (bad,) = bench.spoilt(effects.BadReading, 1, device, scene, rng)
    read = simulator.observe(device, scene, rng, 1.0, (bad,))
    rest = simulator.rest(device, rng)["values"]
    lines = np.column_stack([read["pose"], read["values"]])
    head = ",".join(CHANNELS)
    np.savetxt(folder / "r.csv", lines, "%d", ",", header="pose," + head, comments="")
    np.savetxt(folder / "rest.csv", rest, "%d", ",", header=head, comments="")
    return folder / "r.csv", folder / "rest.csv", bad


def test_a_calibration_is_given_with_and_without_a_bad_reading(tmp_path: Path) -> None:
    readings, rest, bad = spoilt_file(tmp_path)
    found = rsicalib.calibrate(readings, rest=rest)
    assert [bench.at_pose(bad, e.to_dict()) for e in found.excluded] == [True]
    assert found.verdict == "adequate"
    whole = found.with_excluded
    assert whole is not None and whole.fit.chi2 is not None and found.fit.chi2 is not None
    # A reading of noncentrality 40 or more is gone, and the rest of χ² stays.
    assert whole.fit.chi2 - found.fit.chi2 > 20.0
    names = {(p.spec, p.name) for p in whole.parameters}
    assert len(names) == 18 and names < {(p.spec, p.name) for p in found.parameters}
    again = type(found).from_dict(json.loads(found.to_json()))
    assert again.with_excluded == whole
    place = f"left out  pose {found.excluded[0].pose} "
    assert place in found.summary() and "with what was left out" in found.report()
    traced = rsicalib.trace(readings, rest=rest)
    assert traced.with_excluded is not None
    assert traced.with_excluded.fit.chi2 == pytest.approx(whole.fit.chi2)


@pytest.mark.parametrize("verb", [rsicalib.calibrate, rsicalib.trace])
def test_a_wiring_mistake_reaches_json_terminal_and_report(
    verb: Callable[..., Calibration | Trace], tmp_path: Path
) -> None:
    values, pose, rest = session(3)
    values[:, 4], rest[:, 4] = 4095 - values[:, 4], 4095 - rest[:, 4]
    head = ",".join(CHANNELS)
    table = np.column_stack([pose, values])
    np.savetxt(tmp_path / "r.csv", table, "%d", ",", header="pose," + head, comments="")
    np.savetxt(tmp_path / "rest.csv", rest, "%d", ",", header=head, comments="")
    found = verb(tmp_path / "r.csv", rest=tmp_path / "rest.csv")
    words = "a22 reads the wrong way round"
    (warned,) = found.to_dict()["warnings"]
    assert (warned["kind"], warned["target"]) == ("reversed", "a22") and words in warned["text"]
    assert words in found.summary()
    assert words in found.report()


# ------------------------------------------------------------------ cost


def test_the_implicit_loop_costs_little_more_than_least_squares() -> None:
    took = bench.fit_times(seconds=0.2)
    assert took["implicit_loop"] < 4.0 * took["algebraic"]
