"""The search: a beam over explanations."""

from __future__ import annotations

import pytest

import rsicalib
from rsicalib import DEMO
from tests.blind import grade, trials
from tests.full import sized
from tests.test_outside import Lawless, examined


@pytest.mark.parametrize("number", range(sized(1, 2)))
def test_two_effects_are_found_together(number: int) -> None:
    case = trials.make("pairs", number, 77120)
    it = trials.given(case)
    result = rsicalib.trace(it.readings, it.mechanism, rest=it.rest).to_dict()
    assert grade.grade(result, case.effects).right


def test_noise_that_nobody_knows_of_is_at_its_channel_and_is_no_effect() -> None:
    result = examined(3, Lawless("a22", 4e-3))
    assert result["steps"] == []
    assert result["verdict"] == "unexplained"
    assert result["unexplained"]["target"] == "a22"


def test_a_trace_that_begins_at_an_optimum_finds_what_another_one_finds() -> None:
    """Where parameters are rounding beside their estimates, no step may be as short as they are."""
    readings, rest = DEMO / "readings.csv", DEMO / "rest.csv"
    found = rsicalib.trace(readings, rest=rest)
    earlier = rsicalib.calibrate(readings, rest=rest)
    again = rsicalib.trace(readings, rest=rest, calibration=earlier)
    assert [step.spec for step in again.steps] == [step.spec for step in found.steps] != []
    assert again.verdict == found.verdict == "explained"
