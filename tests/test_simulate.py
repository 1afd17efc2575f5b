"""Simulated devices and the experiments on them.

Witnesses: `tests/oracle.py` for the kinematics, SciPy's MINPACK for the searches, theory for noise.
"""

from __future__ import annotations

import json
import time
from pathlib import Path

import numpy as np
import pytest
from scipy.optimize import least_squares
from scipy.stats import ks_2samp

import rsicalib
from benches.speed import Rival
from rsicalib import InputError, Mechanism, _core
from rsicalib.facts.records import plain
from rsicalib.poses.devices import Device, draw_poses, nominal_device
from rsicalib.poses.simulation import simulate
from rsicalib.reproduction.convergence import (
    convergence_equal,
    convergence_independent,
    edge,
    start_success,
)
from rsicalib.reproduction.noise import (
    averaged,
    closed_loop_noise,
    fixture_lines,
    open_loop_noise,
)
from rsicalib.reproduction.placing import placed
from rsicalib.reproduction.printed import printed_numbers
from rsicalib.reproduction.trials import Draws
from tests import oracle
from tests.commands import run_text

RSI = _core.Mechanism.rsi()
PRINTED = printed_numbers()


def some_device(seed: int = 0) -> Device:
    return Device.drawn(RSI, np.random.default_rng(seed))


# ------------------------------------------------------------------ devices


def test_readings_hold_the_handle_where_the_oracle_has_it() -> None:
    device = some_device()
    poses, exact = draw_poses(device, 50, np.random.default_rng(1))
    angles = device.offsets + device.gains * exact
    # Newton's method to 1e-8 in of 3 in, on both sides smooth: angles to 1e-8.
    np.testing.assert_allclose(angles, oracle.rsi_inverse(poses).reshape(-1, 9), atol=1e-8)
    assert exact.min() >= 20
    assert exact.max() <= 4075
    assert np.all(np.abs(poses[:, :2]) <= 3)
    assert np.all(np.abs(poses[:, 3:]) <= np.pi / 6)


def test_a_drawn_device_is_clamped_at_rest() -> None:
    device = some_device(3)
    at_rest = device.readings([RSI.to_dict()["rest"]["pose"]])[0]
    # Clamped to 2048 with a standard deviation of 20 counts: five of them.
    assert np.all(np.abs(at_rest - 2048) < 100)
    assert np.all(np.abs(at_rest - 2048) > 1e-6)


def test_a_pose_out_of_reach_has_no_readings() -> None:
    found = some_device().readings([[0, 0, -2.666, 0, 0, 0], [0, 0, -20, 0, 0, 0]])
    assert np.isfinite(found[0]).all()
    assert np.isnan(found[1]).all()


def test_samples_scatter_by_noise_and_rounding_and_stay_in_range() -> None:
    device = some_device()
    exact = np.full((2, 9), 2000.25)
    exact[1] = 4094.9
    read = device.sample(exact, np.random.default_rng(2), noise=1.5, samples=20_000)
    assert np.array_equal(read, np.round(read))
    assert read.max() == 4095
    # The variance of 180 000 samples is known to 0.4 %; rounding adds 1/12.
    assert read[0].var() == pytest.approx(1.5**2 + 1 / 12, rel=0.02)
    assert read[0].mean() == pytest.approx(2000.25, abs=0.02)
    quiet = device.sample(exact, np.random.default_rng(2), noise=0.0)
    np.testing.assert_array_equal(quiet[:, 0], np.round(exact))


def test_the_same_seed_writes_the_same_files(tmp_path: Path) -> None:
    for folder, seed in (("a", 5), ("b", 5), ("c", 6)):
        simulate(tmp_path / folder, poses=20, samples=2, check=3, seed=seed)
    names = sorted(p.name for p in (tmp_path / "a").iterdir())
    assert names == ["check.csv", "mechanism.toml", "readings.csv", "rest.csv", "truth.json"]
    for name in names:
        a, b, c = ((tmp_path / folder / name).read_bytes() for folder in "abc")
        assert a == b
        assert a != c or name == "mechanism.toml"
    truth = json.loads((tmp_path / "a" / "truth.json").read_text())
    assert set(truth["off"]) == {c.name for c in RSI.channels}


def test_the_command_prints_what_it_writes_as_the_truth(tmp_path: Path) -> None:
    done = run_text("simulate", tmp_path / "made", "--poses", "6", "--json")
    assert done.returncode == 0, done.stderr
    printed = json.loads(done.stdout)
    assert printed == json.loads((tmp_path / "made" / "truth.json").read_text("utf-8"))
    assert printed["format"] == "rsicalib.truth/1"


def test_calibrating_a_simulated_session_finds_its_truth(tmp_path: Path) -> None:
    made = simulate(tmp_path, seed=2)
    found = rsicalib.calibrate(
        tmp_path / "readings.csv", rest=tmp_path / "rest.csv", check=tmp_path / "check.csv"
    )
    z = [
        (found[term, channel.name].value - truth[k]) / found[term, channel.name].sd
        for term, truth in (("offset", made.device.offsets), ("gain", made.device.gains))
        for k, channel in enumerate(RSI.channels)
    ]
    # The largest of 18 normal deviates is above 4.5 once in ten thousand.
    assert np.abs(z).max() < 4.5
    assert found.quality.check is not None
    assert found.quality.check.position_rms < 0.005  # the noise floor is 0.002


def test_any_mechanism_with_a_platform_can_be_simulated() -> None:
    plan = oracle.rsi()
    for channel in plan["channel"]:
        channel |= {"unit": "rad", "gain": 1.0, "offset": 0.0, "noise": 1e-4}
        del channel["range"]
    plan["name"] = "encoders"
    mechanism = _core.Mechanism.from_dict(plain(plan))
    box = ((-1, 1), (-1, 1), (-4, -2), (-0.3, 0.3), (-0.3, 0.3), (-0.3, 0.3))
    made = simulate(None, mechanism, poses=20, samples=1, noise=0.0, within=box, seed=1)
    assert not np.array_equal(made.readings.values, np.round(made.readings.values))
    with pytest.raises(InputError, match="workspace of 'encoders'"):
        simulate(None, mechanism)
    noisy = simulate(None, mechanism, poses=20, samples=40, within=box, seed=1)
    apart = noisy.readings.values.reshape(20, 40, -1).std(axis=1, ddof=1)
    assert noisy.truth["noise"] == 1e-4  # as declared
    assert np.sqrt(np.mean(apart**2)) == pytest.approx(1e-4, rel=0.05)  # 7,020 differences
    # As a hand clamps an encoder, within 0.03 rad, and gains by 2 %: the largest of nine.
    assert 0.01 < np.abs(noisy.device.offsets).max() < 0.3


def test_encoders_without_a_declared_noise_want_one() -> None:
    plan = oracle.rsi()
    for channel in plan["channel"]:
        channel |= {"unit": "rad", "gain": 1.0, "offset": 0.0}
        del channel["range"]
    with pytest.raises(InputError, match="noise: found none declared of a11, which reads rad"):
        simulate(None, _core.Mechanism.from_dict(plain(plan)))


def test_gains_are_drawn_where_a_mechanism_identifies_them() -> None:
    drawn = Mechanism.from_toml(RSI.to_toml().replace('"offset", "gain"', '"offset"'))
    device = simulate(None, drawn, poses=4, check=2, seed=3).device
    assert np.array_equal(device.gains, [c.gain for c in drawn.channels])


@pytest.mark.parametrize(
    ("options", "words"),
    [
        ({"poses": 0}, "poses: found 0"),
        ({"samples": 0}, "samples: found 0"),
        ({"noise": -1.0}, "noise: found -1"),
        ({"noise": float("nan")}, "noise: found nan"),
        ({"within": ((0, 1),) * 5}, "expected six pairs"),
        ({"within": ((1, 0),) * 6}, "the lower end first"),
        ({"within": ((9, 10),) * 3 + ((0, 1),) * 3}, "a box that the mechanism can reach"),
    ],
)
def test_numbers_that_cannot_be_used_are_refused(options: dict, words: str) -> None:  # type: ignore[type-arg]
    with pytest.raises(InputError, match=words):
        simulate(None, **options)


def test_a_file_where_the_folder_should_be_is_refused(tmp_path: Path) -> None:
    (tmp_path / "there").write_text("")
    with pytest.raises(InputError, match="cannot be a folder"):
        simulate(tmp_path / "there", poses=5, check=1)


# ------------------------------------------------------------------ running trials


def test_results_depend_on_neither_threads_nor_order() -> None:
    def job(rng: np.random.Generator, size: int) -> float:
        return float(rng.standard_normal(size).sum())

    told: list[tuple[int, int]] = []
    one = Draws(95, 3, workers=1).run(job, chunk=10)
    two = Draws(95, 3, lambda done, of: told.append((done, of)), 4).run(job, chunk=10)
    assert one == two
    assert len(one) == 10
    assert told[-1] == (95, 95)
    assert [done for done, _ in told] == sorted(done for done, _ in told)


def test_an_interrupt_ends_the_run_at_once() -> None:
    begun: list[int] = []

    def job(rng: np.random.Generator, size: int) -> int:
        begun.append(size)
        time.sleep(0.01)
        return size

    def stop(done: int, of: int) -> None:
        raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        Draws(1000, 0, stop, 2).run(job, chunk=1)
    assert len(begun) < 500


def test_no_trials_are_refused() -> None:
    with pytest.raises(InputError, match="trials: found 0"):
        Draws(0).run(lambda rng, size: size)


# ------------------------------------------------------------------ convergence


def test_bisection_finds_an_edge_it_is_told() -> None:
    found = edge(lambda factor: factor > 0.7371, 0.5)
    assert found.outside is not None
    assert found.outside < 0.7371 <= found.inside
    assert found.inside - found.outside <= 1e-4
    assert edge(lambda factor: True, 1.5).outside is None


def test_the_region_of_convergence_is_nearly_that_of_minpack() -> None:
    device = nominal_device(RSI)
    region = convergence_equal(device, PRINTED.closed_loop)
    exact = device.readings(PRINTED.closed_loop)
    rival = Rival(exact)

    def minpack(factor: float) -> bool:
        start = np.concatenate([device.offsets, device.gains * factor])
        found = least_squares(rival.fun, start, rival.jac, method="lm", x_scale="jac").x
        return bool(np.abs(found[9:] / device.gains - 1).max() < 1e-3)

    low, high = edge(minpack, 0.8).inside, edge(minpack, 1.2).inside
    # Both are Levenberg-Marquardt with Moré's region, but an edge belongs to a solver: 2 %.
    assert region.low == pytest.approx(low, abs=0.02)
    assert region.high == pytest.approx(high, abs=0.02)


def test_an_anchored_start_converges_from_much_farther() -> None:
    device = nominal_device(RSI)
    paper = convergence_equal(device, PRINTED.closed_loop)
    rest = convergence_equal(device, PRINTED.closed_loop, anchored=True, low=0.4, high=2.0)
    assert rest.low < 0.75 < paper.low
    assert rest.high > 1.3 > paper.high
    rates = [
        start_success(device, PRINTED.closed_loop, [0.5], Draws(40, seed=1), anchored=a)[0].rate
        for a in (False, True)
    ]
    # 0-7 % and 90-98 % of trials, by an independent prototype; 40 trials tell these apart.
    assert rates[0].value < 0.25
    assert rates[1].value > 0.75


def test_edges_along_random_directions_are_sorted_and_seeded() -> None:
    device = nominal_device(RSI)
    found = convergence_independent(device, PRINTED.closed_loop, Draws(12, seed=4, workers=2))
    again = convergence_independent(device, PRINTED.closed_loop, Draws(12, seed=4, workers=1))
    np.testing.assert_array_equal(found, again)
    assert np.all(np.diff(found) >= 0)
    assert found[0] > 0.02


# ------------------------------------------------------------------ noise


def test_a_cell_of_table_ix_is_what_scipy_finds_on_the_same_readings() -> None:
    device = nominal_device(RSI)
    draws = Draws(12, seed=7, workers=1)
    cell = closed_loop_noise(device, PRINTED.closed_loop, draws, noise=1.0, average=2)
    rng = np.random.default_rng(np.random.SeedSequence(7).spawn(1)[0])
    exact = placed(device, PRINTED.closed_loop, (0.25, 0.25), rng, 12)
    errors = []
    for counts in averaged(device, exact, rng, 1.0, 2, True):
        rival = Rival(counts)
        start = np.concatenate([device.offsets, device.gains])
        found = least_squares(
            rival.fun, start, rival.jac, method="lm", x_scale="jac", xtol=1e-14, ftol=1e-14
        ).x
        errors.append(np.sqrt(np.mean((found[:9] - device.offsets) ** 2)))
    assert cell.failed == 0
    # Errors of 0.02 rad, minima agreeing to 1e-8.
    assert cell.offset.value == pytest.approx(np.mean(errors), rel=1e-5)
    assert cell.offset.sd == pytest.approx(np.std(errors, ddof=1) / np.sqrt(12), rel=1e-4)


@pytest.mark.parametrize(("noise", "average"), [(0.0, 7), (0.3, 2), (2.0, 5)])
def test_averages_are_distributed_as_means_of_samples(noise: float, average: int) -> None:
    device = nominal_device(RSI)
    exact = np.full((4000, 1, 9), 1000.3)
    exact[..., 1], exact[..., 2] = 0.4, 2047.5
    found = averaged(device, exact, np.random.default_rng(3), noise, average, False)[:, 0]
    rng = np.random.default_rng(4)
    drawn = device.sample(exact[:, 0], rng, noise=noise, samples=average).mean(axis=1)
    for channel in range(9):
        # Of 27 pairs of the same law, one in 300 has a lower probability.
        assert ks_2samp(found[:, channel], drawn[:, channel]).pvalue > 1e-4
    if noise > 0:
        off = np.corrcoef(found.T) - np.eye(9)
        assert np.max(np.abs(off)) < 5 / np.sqrt(4000)


def test_open_loop_errors_are_those_of_ordinary_least_squares() -> None:
    device = nominal_device(RSI)
    cell = open_loop_noise(device, PRINTED.fixture, Draws(400, seed=1), noise=0.0, average=2)
    exact = device.readings(PRINTED.fixture)
    # Variance of an intercept, eq. (13): σ² (1/n + mean² / Σ(a - mean)²), σ² from the angles and
    # from rounding (k²/12).
    sigma2 = 0.005**2 / 2 + device.gains**2 / 12
    spread = np.sum((exact - exact.mean(axis=0)) ** 2, axis=0)
    variance = sigma2 * (1 / 12 + exact.mean(axis=0) ** 2 / spread)
    # The mean of an rms of nine is a little below the root of the mean square: 5 %.
    assert cell.offset.value == pytest.approx(np.sqrt(variance.mean()), rel=0.08)


def test_the_lines_of_the_fixture_are_those_of_polyfit() -> None:
    rng = np.random.default_rng(0)
    readings, angles = rng.uniform(1000, 3000, (12, 9)), rng.normal(size=(12, 9))
    offsets, gains = fixture_lines(readings, angles)
    for k in range(9):
        gain, offset = np.polyfit(readings[:, k], angles[:, k], 1)
        assert offsets[k] == pytest.approx(offset, rel=1e-9)
        assert gains[k] == pytest.approx(gain, rel=1e-9)
