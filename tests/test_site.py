"""Hooks of the documentation site."""

from __future__ import annotations

import re
import xml.etree.ElementTree as ElementTree
from collections import Counter
from html import unescape
from pathlib import Path
from types import SimpleNamespace

import pytest

from scripts.site_equations import is_law, is_symbol, mathml, typeset
from scripts.site_links import on_page_markdown


@pytest.mark.parametrize(
    ("page", "repo", "text", "expected"),
    [
        ("a.md", None, "[x](../examples/x.toml)", "x (`examples/x.toml`)"),
        ("a.md", None, "[examples/x.toml](../examples/x.toml)", "examples/x.toml"),
        ("a.md", "https://e.org/r/", "[x](../b.md)", "[x](https://e.org/r/blob/main/b.md)"),
        ("d/a.md", None, "[x](../model.md)", "[x](../model.md)"),
        ("d/a.md", None, "[x](../../b.md#c)", "x (`b.md`)"),
        ("a.md", None, "[x](model.md) ![y](y.svg)", "[x](model.md) ![y](y.svg)"),
    ],
)
def test_links_that_leave_the_pages_name_the_file(
    page: str, repo: str | None, text: str, expected: str
) -> None:
    file = SimpleNamespace(file=SimpleNamespace(src_uri=page))
    assert on_page_markdown(text, file, SimpleNamespace(repo_url=repo)) == expected


MODEL = (Path(__file__).parents[1] / "docs/model.md").read_text(encoding="utf-8")
PLAIN = str.maketrans("⁰¹²³⁴⁵⁶⁷⁸⁹⁻⁺ᵀⁱ₀₁₂₃₄₅₆₇₈₉'−", "0123456789-+Ti0123456789′-")


def letters(text: str) -> list[str]:
    """What a formula consists of, in no order: scripts are told below before above."""
    text = (
        text.translate(PLAIN)
        .replace("½", "12")
        .replace("¼", "14")
        .replace("−", "-")
        .replace("<=", "≤")
        .replace("\u0304", "¯")
    )
    return sorted(re.sub(r"[\s\u00a0_{}√^]", "", text))


def test_every_equation_of_the_model_is_typeset_and_nothing_of_it_is_lost() -> None:
    blocks = re.findall(r"^```text\n(.*?)^```$", MODEL, flags=re.M | re.S)
    page = typeset(MODEL, is_symbol)
    assert "```text" not in page
    drawn = re.findall(r'<div class="equations">(.*?)</div>', page)
    assert len(drawn) == len(blocks) > 50
    for text, found in zip(blocks, drawn, strict=True):
        table = ElementTree.fromstring(found)  # well-formed
        lines = [line for line in text.splitlines() if line.strip()]
        assert len(table.findall("mtable/mtr")) == len(lines)
        for line, row in zip(lines, table.iter("mtr"), strict=True):
            # Brackets of roots and powers are drawn, and the index `ij,off` has a comma.
            sides = [letters(t.replace(",", "")) for t in (line, "".join(row.itertext()))]
            lost = len(sides[0]) - len(sides[1])
            written, drawn_in = (Counter(side) for side in sides)
            assert lost in (0, 2, 4) and not drawn_in - written, line
            assert set(written - drawn_in) <= set("()"), line
    numbers = re.findall(r"<mtext>\((\d+)\)</mtext>", page)
    assert len(numbers) == len(set(numbers)) + 1 and numbers.count("10") == 2


def test_every_symbol_in_a_sentence_of_the_model_is_typeset_and_no_code_is() -> None:
    plain = re.sub(r"^```.*?^```$|^#[^\n]*$", "", MODEL, flags=re.M | re.S)
    spans = re.findall(r"`([^`\n]+)`", plain)
    page = typeset(MODEL, is_symbol)
    drawn = re.findall(r'<math alttext="([^"]*)"><mrow>(.*?)</mrow></math>(?!</div>)', page)
    left = [text for text in spans if f"`{text}`" in page]
    # Greek letters, superscripts and signs are of formulas; files, commands and keys have none.
    formula = re.compile(r"[α-ωΑ-Ω²⁻ᵀ₀-₉∂̂̄√×·]|^[A-Za-z](_[a-z]+)?$")
    assert [text for text in left if formula.search(text) and " sd" not in text] == []
    assert len(drawn) + len(left) == len(spans) and len(drawn) > 300
    for said, inner in drawn:
        words = unescape(said)
        found = ElementTree.fromstring(f"<math>{inner}</math>")  # well-formed
        sides = [letters(t.replace(",", "")) for t in (words, "".join(found.itertext()))]
        written, drawn_in = (Counter(side) for side in sides)
        assert not drawn_in - written and set(written - drawn_in) <= set("()"), said


def test_laws_of_terms_are_typeset_and_names_of_parameters_are_not() -> None:
    page = typeset("Adds `c2 u²`, where `c2` and `1 + rate t` of `rate@a22`.", is_law)
    assert page.count("<math") == 2
    assert "`c2`" in page and "`rate@a22`" in page


@pytest.mark.parametrize(
    ("text", "expected"),
    [
        ("S^½", "<msup><mi>S</mi><mrow><mfrac><mn>1</mn><mn>2</mn></mfrac></mrow></msup>"),
        ("θz", "<msub><mi>θ</mi><mi>z</mi></msub>"),
        ("xH2", "<msub><mi>x</mi><mrow><mi>H</mi><mn>2</mn></mrow></msub>"),
        ("Σ⁻¹", "<msup><mi>Σ</mi><mrow><mo>−</mo><mn>1</mn></mrow></msup>"),
        ("sin θ", '<mi>sin</mi><mspace width=".2em"/><mi>θ</mi>'),
        ("√3", "<msqrt><mn>3</mn></msqrt>"),
        ("½ a", "<mfrac><mn>1</mn><mn>2</mn></mfrac><mi>a</mi>"),
        ("χ²_c", "<msubsup><mi>χ</mi><mi>c</mi><mn>2</mn></msubsup>"),
        ("a line", "<mtext>&#160;a&#160;</mtext><mtext>&#160;line&#160;</mtext>"),
        ("a < b", "<mi>a</mi><mo>&lt;</mo><mi>b</mi>"),
    ],
)
def test_a_formula_has_its_scripts_fractions_and_roots(text: str, expected: str) -> None:
    assert mathml(text) == expected


def test_a_symbol_that_begins_a_line_stays_in_its_sentence() -> None:
    markdown = pytest.importorskip("markdown")
    page = markdown.markdown(typeset("Lengths, `l3 = 3.971`,\n`l4 = 1.5` in.", is_symbol))
    assert page.count("<p>") == 1 and page.index("<math") < page.rindex("</math>") < page.index(
        "in.</p>"
    )
