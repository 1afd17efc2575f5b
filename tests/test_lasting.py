"""Sessions with a change between them: what happened once lasts on, in the fit as in `forward`.

Zeros of simulated sensors are shifted in the readings themselves; belts are plain distances.
"""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest

import rsicalib
from tests.full import sized
from tests.oracle import Array
from tests.test_plan_reach import BELTS, distances, table

STEP = 20.0
"""Counts by which a22 reads less from the second session on."""


def session(seed: int, device: Any, shift: float) -> Any:
    """A session of the hand controller, of which the fifth channel, a22, reads `shift` more."""
    made = rsicalib.simulate(poses=30, samples=4, seed=seed, device=device)
    values = np.array(made.readings.values)
    values[:, 4] += shift
    return replace(made.readings, values=values), made


@pytest.mark.parametrize("seed", range(sized(2, 6)))
def test_a_sensor_that_slipped_before_the_second_of_three_sessions_is_one_slip(seed: int) -> None:
    first, made = session(3 * seed, None, 0.0)
    second, _ = session(3 * seed + 1, made.device, STEP)
    third, _ = session(3 * seed + 2, made.device, STEP)
    found = rsicalib.trace([first, second, third], rest=made.rest)
    assert [(s.term, s.target) for s in found.steps] == [("slip", "a22")]
    step = found.steps[0].parameters[0]
    truth = -STEP * made.device.gains[4]
    assert step.value == pytest.approx(truth, abs=4 * step.sd)
    # The first pose of the second session, or one beside that.
    assert found.steps[0].place in {"1/29", "1/30", "2/1", "2/2", "2/3"}
    # Places of the last session, by what the session before it does not know.
    there = rsicalib.forward(third, "rsi", found)
    alone = rsicalib.forward(third, "rsi", rsicalib.calibrate(third, rest=made.rest))
    assert np.abs(there - alone)[:, :3].mean() < 0.02


def test_belts_that_are_wound_up_anew_are_one_slip_of_all() -> None:
    rng = np.random.default_rng(8)
    anchors = np.array(list(BELTS.values()), dtype=float)
    grid = np.stack(np.meshgrid(np.linspace(500, 2400, 5), np.linspace(400, 1600, 5)), -1)
    sessions, sleds = [], []
    for zero in (6.0, 0.0):
        sled = grid.reshape(-1, 2) + rng.uniform(-60, 60, (25, 2))
        lengths = distances(sled, anchors)
        values: Array = np.round(lengths + zero + rng.normal(0.0, 0.3, lengths.shape), 2)
        sessions.append(table(values, "maslow"))
        sleds.append(sled)
    found = rsicalib.trace(sessions, "maslow", terms=["point_position", "offset@each"])
    steps = {(s.term, s.target): s for s in found.steps}
    assert list(steps) == [("slip", "each")]
    step = steps["slip", "each"].parameters[0]
    assert step.value == pytest.approx(6.0, abs=4 * step.sd)
