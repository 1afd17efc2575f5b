"""What is generated is fresh, what is quoted is true, and links lead somewhere."""

from __future__ import annotations

import re
from pathlib import Path

import pytest

import rsicalib
from scripts import make_demo, make_readme, make_stub, make_terms

ROOT = Path(__file__).parents[1]
PAGES = sorted([*ROOT.glob("*.md"), *ROOT.glob("docs/**/*.md")])


def test_the_stub_is_what_the_compiled_module_says() -> None:
    found = make_stub.STUB.read_text(encoding="utf-8")
    assert found == make_stub.formatted(make_stub.stub()), "run python -m scripts.make_stub"


def test_the_page_of_terms_is_what_the_registry_says() -> None:
    found = make_terms.PAGE.read_text(encoding="utf-8")
    assert found == make_terms.text(), "run python -m scripts.make_terms"


def test_the_readme_shows_what_the_commands_print() -> None:
    found = (ROOT / "README.md").read_text(encoding="utf-8")
    assert found == make_readme.text(found), "run python -m scripts.make_readme"


def test_the_session_of_the_package_is_made_from_its_seed() -> None:
    files, truth = make_demo.make()
    for name, session in files.items():
        found = rsicalib.load_readings(rsicalib.DEMO / f"{name}.csv")
        made = make_demo.readings(session)
        assert (found.values == made.values).all()
        assert (found.pose == made.pose).all()
    note = (rsicalib.DEMO / "README.md").read_text(encoding="utf-8")
    assert truth in note
    assert f"seed {make_demo.SEED}" in note


def test_every_equation_that_the_code_cites_is_on_the_page_of_the_model() -> None:
    page = (ROOT / "docs" / "model.md").read_text(encoding="utf-8")
    known = set(re.findall(r"\((\d+)\)", page))
    cited = set()
    for path in ROOT.glob("crates/*/src/**/*.rs"):
        text = path.read_text(encoding="utf-8")
        for group in re.findall(r"eqs?\.\s*(\(\d+[^.\n]*?\))(?=[\s.,:;`\]|]|$)", text, re.I):
            cited |= set(re.findall(r"\d+", group))
        cited |= set(re.findall(r" {8,}\((\d+)\)$", text, re.M))
    assert cited <= known, sorted(cited - known, key=int)
    assert len(cited) > 10


@pytest.mark.parametrize("page", PAGES, ids=lambda p: str(p.relative_to(ROOT)))
def test_links_lead_to_files_that_are_there(page: Path) -> None:
    text = page.read_text(encoding="utf-8")
    for target in re.findall(r"\]\(([^)#\s]+)[^)]*\)", text):
        if "://" not in target:
            assert (page.parent / target).exists(), target
