"""A declared play that is too large is said, and judges nothing where it is many times too large.

Witness: the arm of `tests/machines` on sockets, closed in plain matrices by Newton's method with a
play that is known.
"""

from __future__ import annotations

import re
from dataclasses import replace
from typing import Any

import numpy as np
import pandas as pd
import pytest

import rsicalib
from tests.full import sized
from tests.machines import arm

POSES = 40


def session(
    samples: int, times: float, *, declared: bool = False, seed: int = 5, error: float = 0.0
) -> tuple[pd.DataFrame, rsicalib.Mechanism]:
    """Poses on two sockets, each read a few times, and the arm with so many times the play.

    `declared`: the noise of its encoders is, too. `error`: of its third joint, once per turn [rad].
    """
    rng = np.random.default_rng(seed)
    job = arm.Job(arm.Body.random(rng), rng, POSES)
    job.values["offset@q1"] = 0.0
    job.sockets(np.ones(POSES))
    machine = job.machine("arm")
    (one,) = (e for e in machine.effects if e.value == "once@q3")
    held = replace(machine, sigma=0 * machine.sigma).observe(rng, one, error)
    read = np.repeat(held, samples, axis=0) + rng.normal(0, arm.NOISE, (POSES * samples, 6))
    data = pd.DataFrame(read, columns=list(arm.JOINTS))
    data["pose"] = np.repeat(np.arange(POSES) + 1, samples)
    data["at"] = np.repeat(machine.text["at"], samples)
    drawing = machine.mechanism
    for channel in drawing["channel"] if not declared else ():
        del channel["noise"]
    for closure in drawing["closure"]:
        closure["noise"] *= times
    return data, rsicalib.Mechanism.from_dict(drawing)


def of_readings(seed: int = 5) -> float:
    """Standard deviation of a coordinate of the tool by noise of the encoders, by differences."""
    rng = np.random.default_rng(seed)
    job = arm.Job(arm.Body.random(rng), rng, POSES)
    steps = 1e-6 * np.eye(6)
    slopes = [
        (job.body.tip(job.q + h, job.values) - job.body.tip(job.q - h, job.values)) / 2e-6
        for h in steps
    ]
    return float(arm.NOISE * np.sqrt(np.sum(np.square(slopes)) / (3 * POSES)))


def of_noise(found: Any) -> list[Any]:
    """Warnings of the declared noise."""
    return [warning for warning in found.warnings if warning.kind == "noise"]


@pytest.mark.parametrize("verb", [rsicalib.calibrate, rsicalib.trace])
@pytest.mark.parametrize("samples", [1, 2])
@pytest.mark.parametrize("times", [10.0, 1000.0])
def test_a_play_that_is_not_there_is_said_and_judges_nothing(
    verb: Any, samples: int, times: float
) -> None:
    found = verb(*session(samples, times))
    assert (found.verdict, found.exit_code) == ("unjudged", 0)
    (warned,) = of_noise(found)
    assert warned.target == "tool in socket"
    number = re.search(r"noise = ([0-9.e-]+)", warned.text)
    # Of poses that are read once nothing tells the noise of readings: all is play. Known to 1/√212.
    expected = arm.PLAY if samples > 1 else np.hypot(arm.PLAY, of_readings())
    assert number and float(number[1]) == pytest.approx(expected, rel=0.25)


@pytest.mark.parametrize(("samples", "declared"), [(1, True), (2, False), (3, True)])
def test_a_play_that_is_there_judges(samples: int, declared: bool) -> None:
    found = rsicalib.calibrate(*session(samples, 1.0, declared=declared))
    assert found.verdict == "adequate" and not of_noise(found)


def test_noise_and_play_that_are_declared_together_are_said_together() -> None:
    """Nothing says which of them is too large."""
    found = rsicalib.calibrate(*session(1, 10.0, declared=True))
    assert found.verdict == "unjudged"
    assert [warned.target for warned in of_noise(found)] == [None]


@pytest.mark.parametrize("seed", range(5, 5 + sized(2, 4)))
def test_a_pose_within_the_declared_play_is_not_struck_out(seed: int) -> None:
    """An effect that such a play hides makes poses stand off the others, and none is wrong."""
    found = rsicalib.trace(*session(2, 10.0, seed=seed, error=2e-3))
    assert not found.excluded and found.after.chi2 < found.after.dof
