"""Rules of the search that are switched off, to see what each is worth."""

from __future__ import annotations

from collections.abc import Iterator

import pytest

import rsicalib
from rsicalib import DEMO, _core
from tests import ablation


@pytest.fixture(autouse=True)
def every_rule() -> Iterator[None]:
    """All rules are on again after each test."""
    yield
    ablation.switch_off([])


def test_a_rule_that_there_is_not_is_refused() -> None:
    ablation.switch_off(["guess"])
    with pytest.raises(rsicalib.InputError, match="find_pairs"):
        rsicalib.trace(DEMO / "readings.csv", rest=DEMO / "rest.csv")


def test_one_clear_effect_needs_none_of_the_rules() -> None:
    found = []
    for rules in ([], list(_core.rules())):
        ablation.switch_off(rules)
        result = rsicalib.trace(DEMO / "readings.csv", rest=DEMO / "rest.csv")
        found.append([(step.term, step.target) for step in result.steps])
    assert found[0] == found[1] != []


def test_what_two_versions_say_is_paired_device_by_device(
    capsys: pytest.CaptureFixture[str],
) -> None:
    def said(right: str) -> list[ablation.Said]:
        each = enumerate(right)
        return [ablation.Said("single", str(k), r == "1", 0, False, "", "", 1.0) for k, r in each]

    before, after = said("111110"), said("000001")
    ablation.compared("rule", before, after, show=False)
    text = capsys.readouterr().out
    # Five of six to one side: 2 · (1 + 6)/64.
    assert "of    6: lost 5, won 1, p = 0.219" in text
