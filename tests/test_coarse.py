"""A sensor in coarse steps, in a sound device, loses no reading.

`STEPS`, poses, samples and the sensor are drawn anew for each seed. 390 such sessions lost none
(seeds 0 to 129, three sensors each); here is a part of them.
"""

from __future__ import annotations

import numpy as np
import pytest

import rsicalib
from rsicalib import Readings
from tests import crank
from tests.full import sized

STEPS = (2, 4, 8)
"""Counts."""


VERBS = [
    *((rsicalib.calibrate, seed) for seed in sized([0, 2], range(6))),
    *((rsicalib.trace, seed) for seed in sized([1, 3], range(6))),
]
"""Three sessions of each in the small form, all six of them between the two."""


@pytest.mark.parametrize(("verb", "seed"), VERBS)
def test_a_coarse_sensor_loses_no_reading(verb: object, seed: int) -> None:
    rng = np.random.default_rng(seed)
    poses, samples = int(rng.choice([18, 24, 36, 48])), int(rng.choice([1, 2, 4, 8]))
    made = rsicalib.simulate(poses=poses, samples=samples, seed=seed)
    sensor, step = int(rng.integers(9)), int(rng.choice(STEPS))
    values = made.readings.values.copy()
    values[:, sensor] = np.clip(np.round(values[:, sensor] / step) * step, 0, 4095)
    mechanism = rsicalib.load_mechanism("rsi")
    readings = Readings.from_arrays(mechanism, values, pose=made.readings.pose)
    assert callable(verb)
    found = verb(readings, mechanism, rest=made.rest)
    # A bit that never changes is listed, and leaves out no sample.
    assert all(one.samples == 0 for one in found.excluded)


@pytest.mark.parametrize("seed", range(sized(1, 3)))
@pytest.mark.parametrize("noise", sized([0.05, 0.29, 0.4], [0.05, 0.2, 0.26, 0.29, 0.32, 0.4]))
def test_quiet_sensors_lose_no_reading(noise: float, seed: int) -> None:
    """Noise of less than a count, rounded to whole ones: a sample of the next code has not moved.

    400 such sessions of 36 poses lost none (seeds 0 to 39, ten noises from .15 to .5).
    """
    made = rsicalib.simulate(poses=36, samples=8, seed=seed, noise=noise)
    found = rsicalib.calibrate(made.readings, rest=made.rest)
    assert not found.excluded


@pytest.mark.parametrize("seed", range(sized(1, 3)))
@pytest.mark.parametrize("step", STEPS)
def test_a_coarse_sensor_among_quiet_ones_is_adequate(step: int, seed: int) -> None:
    """Noise of .05 counts: the rounding of every sensor lasts over a pose; one has more."""
    made = rsicalib.simulate(poses=36, samples=8, seed=seed, noise=0.05)
    values = made.readings.values.copy()
    # Not rounded twice: of two roundings the second has no error that is uniform.
    values[:, 4] = np.floor(values[:, 4] / step) * step
    readings = Readings.from_arrays(rsicalib.load_mechanism("rsi"), values, pose=made.readings.pose)
    found = rsicalib.calibrate(readings, rest=made.rest)
    assert (found.verdict, found.noise.kind) == ("adequate", "quantisation")
    assert found.noise.sigma["a22"] == pytest.approx(step / np.sqrt(12.0), rel=0.1)


def test_a_wild_sample_of_a_quiet_sensor_is_left_out() -> None:
    made = rsicalib.simulate(poses=24, samples=8, seed=1, noise=0.05)
    values = made.readings.values.copy()
    values[83, 4] += 6.0
    wild = Readings.from_arrays(rsicalib.load_mechanism("rsi"), values, pose=made.readings.pose)
    found = rsicalib.calibrate(wild, rest=made.rest)
    assert [(e.pose, e.samples) for e in found.excluded] == [(int(made.readings.pose[83]), 1)]


@pytest.mark.parametrize("seed", sized([1], range(8)))
def test_round_positions_that_a_crank_was_sent_to_are_no_codes(seed: int) -> None:
    """Some of the multiples of five degrees, once each: the loop closes to the declared noise."""
    rng = np.random.default_rng(seed)
    sent = np.deg2rad(5.0 * np.sort(rng.choice(72, 60, replace=False)))
    sound = crank.read(sent, seed)
    mechanism = crank.four_bar("offset")
    found = rsicalib.calibrate(Readings.from_arrays(mechanism, sound), mechanism)
    assert found.verdict == "adequate" and not found.warnings
    bent = sound + [2e-3, 0.0] * np.sin(sent)[:, None]
    traced = rsicalib.trace(Readings.from_arrays(mechanism, bent), mechanism)
    named = [(step.term, step.target) for step in traced.steps]
    assert (traced.verdict, named) == ("explained", [("once_per_turn", "crank")])


def test_codes_that_leave_the_loop_open_are_codes() -> None:
    """Seventy codes a turn, which its maker did not count as noise."""
    rng = np.random.default_rng(5)
    step = 2 * np.pi / 70
    readings = crank.read(rng.uniform(0.0, 2 * np.pi, 200))
    readings[:, 0] = step * np.round(readings[:, 0] / step)
    mechanism = crank.four_bar("offset")
    found = rsicalib.calibrate(Readings.from_arrays(mechanism, readings), mechanism)
    assert "coarse" in {warning.kind for warning in found.warnings}
    assert found.verdict != "unexplained"
