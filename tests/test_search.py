"""The search: a beam over explanations."""

from __future__ import annotations

import pytest

import rsicalib
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
