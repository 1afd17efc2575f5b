"""What is generated is fresh, what is quoted is true, and links lead somewhere."""

from __future__ import annotations

import json
import re
from pathlib import Path

import numpy as np
import pytest

import rsicalib
from scripts import (
    make_commands,
    make_demo,
    make_docs,
    make_formats,
    make_notebook,
    make_stub,
    make_terms,
    public_names,
)
from tests import commands
from tests.constants import constants

ROOT = Path(__file__).parents[1]
NUMBER = re.compile(r"-?\d+(?:\.\d+)?(?:e[+-]?\d+)?")
PAGES = sorted([*ROOT.glob("*.md"), *ROOT.glob("docs/**/*.md")])


def test_the_stub_is_what_the_compiled_module_says() -> None:
    found = make_stub.STUB.read_text(encoding="utf-8")
    assert found == make_stub.formatted(make_stub.stub()), "run python -m scripts.make_stub"
    found = make_stub.NAMES.read_text(encoding="utf-8")
    assert found == make_stub.formatted(make_stub.names()), "run python -m scripts.make_stub"


def test_the_page_of_terms_is_what_the_registry_says() -> None:
    for path, made in make_terms.files().items():
        assert path.read_text(encoding="utf-8") == made, f"{path.name}: run scripts.make_terms"


def test_the_site_has_a_page_for_each_term_and_a_thumbnail_that_leads_there() -> None:
    pytest.importorskip("mkdocs")
    from scripts.site_pages import term_pages, thumbnails

    pages = term_pages()
    assert set(pages) == {term["id"] for term in rsicalib.terms()}
    for name, text in pages.items():
        assert text.startswith(f"# {name}\n")
        for link in re.findall(r"\]\((?!https?:)([^)#]+)", text):
            assert (ROOT / "docs/terms" / link).is_file(), f"{name}: {link}"
    cards = thumbnails((ROOT / "docs/gallery.md").read_text("utf-8"))
    shown = re.findall(r"gallery/(\w+)\.svg.*\]\(terms/(\w+)\.md\)", cards)
    assert len(shown) == len(list((ROOT / "docs/gallery").glob("*.svg")))
    assert all(picture == page and page in pages for picture, page in shown)


CLAIMS = re.findall(r"^\|.*\*\*.*\|$", (ROOT / "docs/claims.md").read_text("utf-8"), re.M)


@pytest.mark.parametrize("row", CLAIMS, ids=lambda row: row.strip("| ").partition(" |")[0])
def test_every_number_that_is_claimed_stands_in_the_section_that_it_names(row: str) -> None:
    ((page, anchor),) = re.findall(r"\]\((\w[\w-]*\.md)#([\w-]+)\)", row)
    text = section((ROOT / "docs" / page).read_text("utf-8"), anchor)
    for number in re.findall(r"\*\*(.+?)\*\*", row):
        assert holds(text, number), f"{page}#{anchor}: {number}"


def test_claims_of_the_search_are_among_them() -> None:
    for anchor in ("sound-devices", "is-a-probability-what-it-says"):
        assert sum(f"search-measured.md#{anchor}" in row for row in CLAIMS) == 1
    assert len(CLAIMS) > 10


def test_the_constants_of_the_search_are_those_of_the_code() -> None:
    source = "".join(path.read_text("utf-8") for path in ROOT.glob("crates/rsicalib/src/**/*.rs"))
    code = re.findall(r"^ *(?:pub(?:\(\w+\))? )?const ([A-Z_]+): [^=]+= ([^;]+);", source, re.M)
    code += [(constant.name, f"{constant.value:g}") for constant in constants()]
    page = (ROOT / "docs/search.md").read_text("utf-8")
    rows = re.findall(r"^\| ([^|]*) \| ([^|]*) \|", section(page, "constants-that-decide"), re.M)
    compared = 0
    for cell, value in rows:
        names = re.findall(r"`([A-Za-z_]+)`", cell)
        assert set(names) <= {name for name, _ in code}, cell
        if len(names) == 1 and re.fullmatch(r"[\d.]+", value):
            compared += 1
            said = {v for name, v in code if name == names[0]}
            assert float(value) in {float(v) for v in said if NUMBER.fullmatch(v)}, cell
    assert compared > 10


def test_a_number_is_found_as_a_whole_and_a_section_ends_at_the_next_of_its_level() -> None:
    page = (
        "# A\n## B c?\n17.9 of 203, 7.91 and 5\n### D\n-1.5\n```\n# no heading\n```\n8\n## E\n7.9\n"
    )
    inner = section(page, "b-c")
    assert not any(holds(inner, wrong) for wrong in ("7.9", "9 of 20", "1.5", "7", "91"))
    assert all(holds(inner, right) for right in ("17.9 of 203", "7.91", "5", "-1.5", "8"))
    assert holds(section(page, "e"), "7.9")


@pytest.mark.parametrize("path", make_docs.pages(), ids=lambda p: p.name)
def test_the_code_of_a_page_runs_and_prints_what_stands_below_it(path: Path) -> None:
    forked = commands.program()
    with make_docs.page(path, forked.parent if forked else make_docs.BIN) as page:
        text = page.text()
        pictures = page.pictures()
    assert path.read_text(encoding="utf-8") == text, "run python -m scripts.make_docs"
    for place, made in pictures.items():
        there = place.read_text(encoding="utf-8")
        assert NUMBER.sub("", there) == NUMBER.sub("", made), f"{place.name}: another drawing"
        old, new = (np.array(NUMBER.findall(drawn), dtype=float) for drawn in (there, made))
        # Products of other lengths of vectors differ by rounding, which may turn a last digit.
        assert np.allclose(old, new, rtol=1e-3, atol=1.0), f"{place.name}: run scripts.make_docs"


@pytest.mark.parametrize("path", make_formats.files(), ids=lambda p: p.name)
def test_the_reference_of_the_formats_is_what_the_types_say(path: Path) -> None:
    found, made = path.read_text(encoding="utf-8"), make_formats.files()[path]
    assert found == made, "run python -m scripts.make_formats"


def test_the_notebook_has_the_cells_of_its_page() -> None:
    found = make_notebook.NOTEBOOK.read_text(encoding="utf-8")
    assert found == make_notebook.text(), "run python -m scripts.make_notebook"
    cells = json.loads(found)["cells"]
    code = ["".join(cell["source"]) for cell in cells if cell["cell_type"] == "code"]
    page = make_notebook.PAGE.read_text(encoding="utf-8")
    assert code == [block.strip() for block in re.findall(r"```python\n(.*?)```", page, re.S)]
    assert "plan" in code[-4] and len(code) > 10


def test_the_reference_of_the_commands_is_what_the_parser_says() -> None:
    found = make_commands.PAGE.read_text(encoding="utf-8")
    assert found == make_commands.text(), "run python -m scripts.make_commands"


def test_the_names_of_the_crate_are_those_that_are_listed() -> None:
    found = public_names.PAGE.read_text(encoding="utf-8")
    assert found == public_names.page(), "run python -m scripts.public_names"
    names = public_names.names()
    assert len(names) <= 60 and sum("::" not in name for name in names) <= 26


def test_documents_have_the_keys_that_the_reference_lists(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    from rsicalib.cli import main

    def keys(*words: str) -> dict[str, object]:
        with pytest.raises(SystemExit):
            main([*words, "--json"])
        out: dict[str, object] = json.loads(capsys.readouterr().out)
        return out

    rest = str(rsicalib.DEMO / "rest.csv")
    result = str(tmp_path / "result.json")
    rsicalib.calibrate(rsicalib.DEMO / "readings.csv", rest=rest).save(result)
    rsicalib.simulate(tmp_path / "made", poses=4)
    truth = json.loads((tmp_path / "made" / "truth.json").read_text("utf-8"))
    belts = tmp_path / "serial.log"
    belts.write_text("CLBM:[{bl:1.0, br:2.0, tr:3.0, tl:4.0}]")
    seen = {
        "rsicalib.truth/1": truth,
        "rsicalib.poses/1": keys("forward", rest),
        "rsicalib.terms/1": keys("terms"),
        "rsicalib.error/1": keys("calibrate", str(tmp_path / "nowhere.csv")),
        "rsicalib.plan/1": keys("plan", "--poses", "10"),
        "rsicalib.export/1": keys("export", result, "--to", "c", "--out", str(tmp_path / "c")),
        "rsicalib.import/1": keys("import", str(belts), "--out", str(tmp_path / "imported")),
    }
    for name, document in seen.items():
        assert document["format"] == name
        listed = make_formats.documented(name)
        assert set(document) <= set(listed), name
    # Those of a fleet take devices: tests/test_population.py.
    assert set(make_formats.BY_HAND) < {*seen, "rsicalib.fleet/1", "rsicalib.population/1"}


def test_every_format_that_is_promised_has_a_heading() -> None:
    promised = set(re.findall(r"`(rsicalib\.\w+/\d+)`", public_names.PAGE.read_text("utf-8")))
    page = make_formats.PAGE.read_text("utf-8")
    headings = set(re.findall(r"^### `(rsicalib\..+)`$", page, re.M))
    assert promised == headings


def test_the_reference_has_the_unit_of_every_parameter() -> None:
    units = {p["unit"] for term in rsicalib.terms() for p in term["parameters"]}
    assert units == set(make_formats.UNITS)


def test_every_page_is_in_the_navigation_of_the_site() -> None:
    listed = set(re.findall(r"[\w/-]+\.md", (ROOT / "mkdocs.yml").read_text(encoding="utf-8")))
    there = {str(path.relative_to(ROOT / "docs")) for path in ROOT.glob("docs/**/*.md")}
    assert listed == there


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
    # An equation stands with its number at the end of a line; a number in the text only cites one.
    shown = re.findall(r"^ *```text\n(.*?)^ *```", page, re.M | re.S)
    known = {number for block in shown for number in re.findall(r" \((\d+)\)$", block, re.M)}
    cited = set(re.findall(r"\((\d+)\)", page.partition("\n## Modules\n")[2]))
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
    for target, anchor in re.findall(r"\]\(([^)#\s]*)(#[^)\s]+)?[^)]*\)", text):
        if "://" in target:
            continue
        file = page.parent / target if target else page
        assert file.exists(), target
        if anchor and file.suffix == ".md":
            assert anchor[1:] in anchors(file), f"{target}{anchor}"


def anchors(page: Path) -> set[str]:
    """Names of the headings of a page, as GitHub and the site make them."""
    return {anchor for _, _, anchor in headings(page.read_text(encoding="utf-8"))}


def headings(text: str) -> list[tuple[int, int, str]]:
    """Place, level and anchor of each heading of a page; what is fenced has none."""
    plain = re.sub(r"^```.*?^```", lambda fenced: " " * len(fenced[0]), text, flags=re.M | re.S)
    found = re.finditer(r"^(#+) (.*)$", plain, re.M)
    words = [(one, re.sub(r"[^\w\s-]", "", one[2].lower()).strip()) for one in found]
    return [(one.start(), len(one[1]), re.sub(r"\s+", "-", said)) for one, said in words]


def section(text: str, anchor: str) -> str:
    """A page from one heading to the next of the same level or above."""
    heads = headings(text)
    ((start, level, _),) = [head for head in heads if head[2] == anchor]
    ends = (place for place, other, _ in heads if place > start and other <= level)
    return text[start : next(ends, len(text))]


def holds(text: str, number: str) -> bool:
    """Whether a text holds a number, or words with numbers, that nothing continues."""
    words = r"\s+".join(map(re.escape, number.split()))
    return re.search(rf"(?<![\w.−-]){words}(?!\w|[.,]\d)", text) is not None


def test_every_public_name_of_python_is_on_its_page() -> None:
    text = (make_docs.DOCS / "python.md").read_text(encoding="utf-8")
    described = re.findall(r"^::: \S*\.(\w+)$", text, re.M) + re.findall(r"`(\w+)`", text)
    members = re.findall(r"members: \[(.*)\]", text)
    errors = {name for line in members for name in line.split(", ")}
    assert {*rsicalib.__all__} - {*described, *errors} == set()
