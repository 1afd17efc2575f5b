"""The sessions whose pages are looked at are what their names say."""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np
import pytest

import rsicalib
from rsicalib import DEMO, Calibration, Trace
from rsicalib.report.curves import any_curve
from tests.pages import GUIDED, SESSIONS, guide_page, pages

VERDICTS = {
    "good": "adequate",
    "bent": "explained",
    "shared": "explained",
    "tie": "explained",
    "partly": "partly_explained",
    "unexplained": "unexplained",
    "belts": "explained",
}


@pytest.mark.parametrize("name", VERDICTS)
def test_a_session_is_what_its_name_says(name: str) -> None:
    found = SESSIONS[name]()
    assert found.verdict == VERDICTS[name]
    ties = [step for step in found.steps if step.also_fits]
    assert not ties or name != "shared"
    assert ties or name != "tie"
    # A page that is shown to a colleague is sent by mail.
    assert len(found.report()) < 1_000_000


def strip(result: Calibration | Trace) -> str:
    """What the strip of a report says to who cannot see it; empty where there is none."""
    said = re.search(r'aria-label="How sure: ([^"]*)"', result.report())
    return said[1] if said else ""


def test_where_no_explanation_holds_the_strip_says_so() -> None:
    left = SESSIONS["unexplained"]()
    assert left.evidence is not None and not left.rivals
    tried = len(left.evidence.left)
    assert strip(left) == (
        f"an effect that is not known, at arm3: none of the {tried} that were tried holds"
    )
    few = rsicalib.simulate(poses=6, seed=1)
    undetermined = rsicalib.trace(few.readings, rest=few.rest)
    assert undetermined.verdict == "undetermined"
    assert strip(undetermined).startswith("no explanation was weighed")
    bent = rsicalib.calibrate(DEMO / "readings.csv", rest=DEMO / "rest.csv")
    assert strip(bent) == "no explanation was looked for: rsicalib trace does"
    assert strip(SESSIONS["good"]()) == ""


def test_a_law_that_no_term_has_is_a_line_through_the_dots_and_can_be_chosen() -> None:
    found = rsicalib.demo()
    assert found.evidence is not None
    law = found.evidence.effects[0].law
    assert law is not None
    curve = np.array(any_curve(found.evidence, found.steps[0], law))
    x, y, sd = np.array(law.dots).T
    chi2 = [
        float(np.sum(((y - np.interp(x, *np.array(line).T)) / sd) ** 2))
        for line in (curve, law.line)
    ]
    # Dots are what the residual asks for, to first order: they are as near to the line of each fit
    # as their χ² says, which the curve lowers.
    kinds = [[n.term for n in one.effects] for one in found.evidence.hypotheses]
    fits = [found.evidence.hypotheses[kinds.index([k])].fit for k in ("free_curve", "curvature")]
    assert chi2[0] - chi2[1] == pytest.approx(fits[0].chi2 - fits[1].chi2, abs=1.0)
    page = found.report()
    assert "a law that no term has (any curve)" in page
    chosen = kinds.index(["free_curve"])
    assert re.search(rf'data-choose="{chosen}">.{{,60}}a law that no term has, of sensor a22', page)


def test_every_state_of_the_guide_has_its_order() -> None:
    assert set(GUIDED) < set(pages())
    for name, word in {"guide-next": "go", "guide-done": "done"}.items():
        assert f'"order": {{"word": "{word}"' in guide_page(name)
    assert "a32 does not change" in guide_page("guide-trouble")


def test_the_pictures_of_the_guide_are_there() -> None:
    docs = Path(__file__).parents[1] / "docs"
    assert all((docs / f"{name}.png").stat().st_size > 10_000 for name in GUIDED)
