"""The sessions whose pages are looked at are what their names say."""

from __future__ import annotations

from pathlib import Path

import pytest

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


def test_every_state_of_the_guide_has_its_order() -> None:
    assert set(GUIDED) < set(pages())
    for name, word in {"guide-next": "go", "guide-done": "done"}.items():
        assert f'"order": {{"word": "{word}"' in guide_page(name)
    assert "a32 does not change" in guide_page("guide-trouble")


def test_the_pictures_of_the_guide_are_there() -> None:
    docs = Path(__file__).parents[1] / "docs"
    assert all((docs / f"{name}.png").stat().st_size > 10_000 for name in GUIDED)
