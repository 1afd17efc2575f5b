"""The search as a beam over explanations, which stands behind a switch."""

from __future__ import annotations

from collections.abc import Iterator

import pytest

import rsicalib
from rsicalib import DEMO
from tests import ablation
from tests.blind import grade, trials
from tests.test_outside import Lawless, examined

BEAM = (["stepwise"], ["stepwise", "charge"])
"""With a constant charge for each parameter, and with that of (118)."""


@pytest.fixture(autouse=True)
def stepwise() -> Iterator[None]:
    """The search is the stepwise one again after each test."""
    yield
    ablation.switch_off([])


@pytest.mark.parametrize("rules", BEAM)
def test_one_effect_is_found_as_the_stepwise_search_finds_it(rules: list[str]) -> None:
    def traced() -> rsicalib.Traced:
        return rsicalib.trace(DEMO / "readings.csv", rest=DEMO / "rest.csv")

    before = traced()
    ablation.switch_off(rules)
    after = traced()
    assert [(s.term, s.target) for s in after.steps] == [(s.term, s.target) for s in before.steps]
    assert len(after.steps) == 1
    assert after.verdict == before.verdict == "explained"
    # The same effect at the same readings is the same fit.
    assert after.after.chi2 == pytest.approx(before.after.chi2, rel=1e-6)


@pytest.mark.parametrize("number", [0, 1])
def test_two_effects_are_found_together(number: int) -> None:
    ablation.switch_off(BEAM[1])
    case = trials.make("pairs", number, 77120)
    it = trials.given(case)
    result = rsicalib.trace(it.readings, it.mechanism, rest=it.rest).to_dict()
    assert grade.grade(result, case.effects).right


def test_noise_that_nobody_knows_of_is_at_its_channel_and_is_no_effect() -> None:
    ablation.switch_off(BEAM[1])
    result = examined(3, Lawless("a22", 4e-3))
    assert result["steps"] == []
    assert result["verdict"] == "unexplained"
    assert result["unexplained"]["target"] == "a22"
