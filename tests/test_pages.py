"""The sessions whose pages are looked at are what their names say."""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np
import pytest

import rsicalib
from rsicalib import DEMO, Calibration, Trace
from rsicalib.report.curves import any_curve
from rsicalib.report.words import number
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


def test_what_no_effect_explains_has_its_probabilities() -> None:
    """Play of the handle is random from pose to pose: it follows no law, and is of one arm."""
    left = SESSIONS["unexplained"]()
    assert left.evidence is not None and not left.steps
    kinds = [{name.term for name in rival.terms} for rival in left.rivals]
    assert all(kind <= {"unknown_noise", "unknown_law"} for kind in kinds) and len(kinds) > 1
    assert sum(rival.probability for rival in left.rivals) == pytest.approx(1.0)
    # Likelihood ratios of prices.
    prices = np.array([rival.chi2_penalised for rival in left.rivals])
    likely = np.exp(-0.5 * (prices - prices.min()))
    found = [rival.probability for rival in left.rivals]
    np.testing.assert_allclose(found, likely / likely.sum(), rtol=1e-9)
    said = strip(left)
    assert all(words in said for words in ("no law, of arm3", "%"))
    page = left.report()
    chosen = page[page.index('<fieldset id="hypotheses">') : page.index('id="switched-words"')]
    assert "no law, of arm3" in chosen, "what cannot be chosen is told beside what can"
    assert left.unexplained is not None
    assert page.count(left.unexplained.text.split(":")[0]) == 1
    assert any("unknown_noise" in kind for kind in kinds[:1]), "what is random follows no law"


def test_a_law_that_no_term_has_is_fitted_as_such() -> None:
    """Its likeliest errors, taken off the readings, leave less than what was found."""
    found = SESSIONS["partly"]()
    assert found.evidence is not None
    known = {one.kind: one for one in found.evidence.hypotheses}
    law, named = known["unknown_law"], known["found"]
    assert found.rivals[0].terms[0].term == "unknown_law"
    assert law.fit.chi2 < named.fit.chi2 < known["nothing"].fit.chi2
    # It costs parameters, as far as data tell of them.
    assert law.fit.dof < named.fit.dof + 5
    assert law.check is None and not law.known
    page = found.report()
    # Its effect is not applied: the first figures are those without it, and say so.
    assert not found.steps[0].applied and found.after.check is not None
    assert number(found.after.check.position_rms) in page[: page.index('id="mechanism"')]
    assert page[: page.index("<h2>What was found</h2>")].count("not applied to positions") >= 2
    chosen = found.evidence.hypotheses.index(law)
    assert re.search(rf'data-choose="{chosen}">.{{,60}}a law that no term has, of sensor a12', page)


def test_a_recording_has_hypotheses_too() -> None:
    found = SESSIONS["recording"]()
    assert found.evidence is not None and found.readings.samples == 4000
    kinds = [one.kind for one in found.evidence.hypotheses]
    assert kinds[:3] == ["nothing", "found", "rival"]
    assert 'data-choose="1"' in found.report()


def test_where_no_explanation_was_weighed_the_strip_says_so() -> None:
    few = rsicalib.simulate(poses=6, seed=1)
    undetermined = rsicalib.trace(few.readings, rest=few.rest)
    assert undetermined.verdict == "undetermined"
    assert strip(undetermined).startswith("no explanation was weighed")
    bent = rsicalib.calibrate(DEMO / "readings.csv", rest=DEMO / "rest.csv")
    assert strip(bent) == "no explanation was looked for: rsicalib trace does"
    assert strip(SESSIONS["good"]()) == ""


def test_a_law_that_no_term_has_is_a_line_through_the_dots_and_can_be_chosen() -> None:
    found = SESSIONS["bent"]()
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
    assert "a smooth curve of any shape" in page
    chosen = kinds.index(["unknown_law"])
    assert re.search(rf'data-choose="{chosen}">.{{,60}}a law that no term has, of sensor a22', page)


def test_every_state_of_the_guide_has_its_order() -> None:
    assert set(GUIDED) < set(pages())
    for name, word in {"guide-next": "go", "guide-done": "done"}.items():
        assert f'"order": {{"word": "{word}"' in guide_page(name)
    assert "a32 does not change" in guide_page("guide-trouble")


def test_the_pictures_of_the_guide_are_there() -> None:
    docs = Path(__file__).parents[1] / "docs"
    assert all((docs / f"{name}.png").stat().st_size > 10_000 for name in GUIDED)
