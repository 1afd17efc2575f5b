"""Long recordings, which are searched by stretches: all rows have the last word.

Full size: `python -m tests.blind.long --rows 20000 --sessions 40`.
"""

from __future__ import annotations

import re
from functools import cache
from typing import Any

import numpy as np
import pytest

import rsicalib
from tests.blind import long
from tests.full import sized

ROWS = 9000
"""Few more than those from which on a recording is long."""


@cache
def recording(kind: str) -> tuple[long.Recording, Any]:
    """A recording that several tests look at, and its trace."""
    it = long.make(kind, ROWS, seed=5)
    return it, traced(it)


def traced(it: long.Recording) -> Any:
    return rsicalib.trace(it.readings, rest=it.rest)


# What `clean` and `sag` have is in `untimed` and `two` as well, and the next test is of noise that
# is correlated.
@pytest.mark.parametrize("kind", sized(["untimed", "ripple", "slip", "bad", "two"], long.KINDS))
def test_what_a_long_recording_has_is_named_and_nothing_else(kind: str) -> None:
    it, found = recording(kind)
    assert long.said(found) == (it.names, it.out)


@pytest.mark.parametrize("kind", sized(["ripple"], ["clean", "ripple", "slip"]))
def test_noise_that_resembles_its_neighbours_is_no_effect(kind: str) -> None:
    """Of few rows, too: a search that took them for independent named something in 5 of 5."""
    it = long.make(kind, 4000, seed=302, alike=0.5)
    assert long.said(traced(it)) == (it.names, it.out)


@pytest.mark.parametrize("seed", range(sized(1, 3)))
def test_noise_that_resembles_its_neighbours_is_no_law(seed: int) -> None:
    """A smooth law over what varies slowly explains it: of six such recordings four had one."""
    found = traced(long.make("clean", 2000, seed=seed, alike=0.8))
    assert not found.steps and not found.unexplained.depends_on


def test_the_report_of_a_long_recording_is_sent_by_mail() -> None:
    """Of two effects it had 1001 kB."""
    _, found = recording("two")
    assert len(found.steps) == 2
    page = found.report()
    assert len(page.encode()) < 750_000
    # Every block of rows has its dot yet, and every equation.
    (residuals,) = re.findall(r'<figure id="residuals">.*?</figure>', page, flags=re.S)
    desk, phone = residuals.split('<div class="phone">')
    assert desk.count("<circle") == 2 * 300 * 3 == phone.count("h0") + phone.count("<circle")


def test_the_same_is_named_by_stretches_as_by_rows() -> None:
    it, every = recording("two")
    # So few are searched row by row.
    few = rsicalib.trace(it.readings.select(np.arange(ROWS) < 1500), rest=it.rest)
    assert long.said(every) == long.said(few)
    assert every.verdict == few.verdict == "explained"
    ours = {p.name: p for step in every.steps for p in step.parameters}
    for other in (p for step in few.steps for p in step.parameters):
        off = ours[other.name].value - other.value
        assert abs(off) < 3.0 * np.hypot(ours[other.name].sd, other.sd)


def test_parameters_and_the_test_of_fit_are_those_of_all_rows() -> None:
    it, found = recording("ripple")
    (step,) = found.steps
    name = f"{step.term}@{step.target}:{step.place}"
    told = rsicalib.calibrate(it.readings, rest=it.rest, terms=["offset", "gain", name])
    np.testing.assert_allclose(found.values, told.values, rtol=1e-6, atol=1e-9)
    assert found.unexplained.p_value == pytest.approx(told.fit.p_value, rel=1e-3)
    assert found.after_residuals is not None and len(found.after_residuals) == ROWS


def test_poses_in_any_order_are_no_stretches() -> None:
    """Rows that are no motion are searched one by one, though not all of them."""
    it = long.make("ripple", ROWS, seed=2)
    order = np.random.default_rng(2).permutation(ROWS)
    shuffled = rsicalib.Readings.from_arrays(
        rsicalib.load_mechanism("rsi"), np.asarray(it.readings.values)[order]
    )
    assert long.said(rsicalib.trace(shuffled, rest=it.rest))[0] == it.names
