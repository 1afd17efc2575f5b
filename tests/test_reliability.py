"""The reliability table: what is said to be likely, and how often it is so."""

from __future__ import annotations

from typing import Any

import pytest

from tests import reliability
from tests.families.grade import Truth
from tests.reliability import Row, Statement


def step(term: str, target: str, *also: tuple[str, str]) -> dict[str, Any]:
    """An effect as results have it."""
    names = [{"term": t, "class": "sensor", "target": at} for t, at in also]
    return {"term": term, "class": "sensor", "target": target, "also_fits": names}


def test_what_fits_as_well_counts_and_other_explanations_do_not() -> None:
    drift, slip, gain = step("drift", "q1"), step("slip", "q1"), step("gain", "q3")
    explanations = [([drift], 0.6), ([slip], 0.3), ([gain], 0.1)]
    rivals = [{"terms": terms, "probability": p} for terms, p in explanations]
    alone = {"steps": [drift], "rivals": rivals}
    assert reliability.probability(alone, drift) == pytest.approx(0.6)
    tied = step("drift", "q1", ("slip", "q1"))
    assert reliability.probability(alone, tied) == pytest.approx(0.9)
    # Nothing else is nearly as good.
    assert reliability.probability({"steps": [drift]}, drift) == 1.0


def test_a_law_that_no_term_has_is_right_where_it_ties_at_its_place() -> None:
    law = Truth("any", frozenset({("sensor", "q1")}), outside=True)
    assert not reliability.is_right(law, step("drift", "q1"))
    assert reliability.is_right(law, step("drift", "q1", ("unknown_law", "q1")))
    assert not reliability.is_right(law, step("drift", "q1", ("unknown_law", "q2")))
    named = Truth("drift", frozenset({("sensor", "q1")}))
    assert reliability.is_right(named, step("slip", "q1", ("drift", "q2")))


def test_the_table_counts_each_statement_where_it_belongs() -> None:
    def row(strength: float, probability: float, right: bool) -> Row:
        said = (Statement(probability, right, "drift@q1"),)
        return Row("rsi", 0, "catalogue", strength, "", "explained", said, right, 1.0)

    rows = [row(20, 0.95, True), row(20, 1.0, False), row(40, 0.6, True), row(100, 0.93, True)]
    text = reliability.table(rows)
    assert "| 10 to 30 | 2 |" in text[2]
    assert "1 of 2 (50%), 98% said" in text[2]
    assert "1 of 1 (100%), 60% said" in text[3]
    assert "2 of 3 (67%)" in text[5]
    assert any("explained 4, of these wrongly 1" in line for line in text)


def test_a_device_is_the_same_whoever_draws_it_and_what_is_said_of_it_is_a_probability() -> None:
    kinds = [reliability.drawn("fourbar", k, 5)[0] for k in range(400)]
    for kind, share in reliability.MIX.items():
        # Three binomial standard deviations of 400.
        assert abs(kinds.count(kind) / 400 - share) < 3 * (share * (1 - share) / 400) ** 0.5
    number = kinds.index("catalogue")
    one, again = (reliability.run(("fourbar", number), 5) for _ in range(2))
    assert one is not None
    assert again is not None
    assert one.said == again.said
    assert one.truth == again.truth != ""
    assert all(0.0 <= said.probability <= 1.0 + 1e-9 for said in one.said)
