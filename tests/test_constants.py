"""Stated constants: each stands in the table of `docs/search.md`, and half of it is another."""

from __future__ import annotations

import re
from pathlib import Path

from tests.constants import OUT, constants

PAGE = Path(__file__).parents[1] / "docs" / "search.md"


def test_the_page_has_every_stated_constant_and_no_other() -> None:
    rows = [line for line in PAGE.read_text(encoding="utf-8").splitlines() if "| stated" in line]
    named = {name for row in rows for name in re.findall(r"`([a-z_]+)`", row.split("|")[1])}
    declared = {c.name for c in constants() if not c.name.startswith("prior_of_")}
    assert named == declared
    assert any("`prior_of_…`" in row for row in rows)


def test_what_takes_a_constant_out_is_another_value_of_one_that_there_is() -> None:
    values = {c.name: c.value for c in constants()}
    assert OUT.keys() == {name for name in values if not name.startswith("prior_of_")}
    assert all(float(out) != values[name] for name, out in OUT.items())


def test_half_and_twice_of_a_whole_number_are_whole() -> None:
    for constant in constants():
        half, twice, *_ = constant.others()
        assert float(half) < constant.value < float(twice)
        assert constant.whole <= half.isdigit()
