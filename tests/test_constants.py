"""Stated constants: each stands in the table of `docs/search.md`, and half of it is another."""

from __future__ import annotations

import re
from pathlib import Path

from tests.constants import OUT, cases, constants, row

PAGE = Path(__file__).parents[1] / "docs" / "search.md"


def test_the_page_has_every_stated_constant_and_no_other() -> None:
    rows = [line for line in PAGE.read_text(encoding="utf-8").splitlines() if "| stated" in line]
    named = {name for row in rows for name in re.findall(r"`([a-z_]+)`", row.split("|")[1])}
    declared = {c.name for c in constants() if not c.name.startswith("prior_of_")}
    assert named == declared
    assert any("`prior_of_…`" in row for row in rows)


def test_each_constant_is_taken_out_once_by_another_value() -> None:
    values = {c.name: c.value for c in constants()}
    out = [one.split("=") for stated in OUT.values() for one in stated.split(",")]
    assert sorted(name for name, _ in out) == sorted(values)
    assert all(float(value) != values[name] for name, value in out)


def test_the_table_has_a_line_for_each_other_value() -> None:
    device = {"verdict": "explained", "said": "slip@q1", "right": True, "misled": False}
    other = device | {"said": "gain@q1", "right": False}
    asked = [*cases(["more"])]
    assert [stated for *_, stated in asked] == ["more=0.125", "more=0.5", "more=1"]
    line = row(*asked[0], ({"a": device, "b": device}, {"a": other, "b": device}))
    assert line == "| `more` | 0.25 | more=0.125 | 1 | 1 | 0 | 1 | 0 → 0 |"


def test_half_and_twice_of_a_whole_number_are_whole() -> None:
    for constant in constants():
        half, twice = constant.others()
        assert float(half) < constant.value < float(twice)
        assert constant.whole <= half.isdigit()
