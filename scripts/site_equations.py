"""A hook of mkdocs: the equations of the model as MathML, which a browser typesets by itself.

In `docs/model.md` equations are text that reads the same in an editor; on the site they have
subscripts, superscripts, fractions and roots, without a script and without a network.
"""

from __future__ import annotations

import re
from html import escape
from typing import Any

__all__ = ["mathml", "on_page_markdown", "typeset"]

PAGES = {"model.md"}

BLOCK = re.compile(r"^```text\n(.*?)^```$", re.M | re.S)

FUNCTIONS = set(
    "sin cos asin acos atan2 min max argmin ln exp diag tr det rank var cov Var mean data".split()
)
"""Names that stand upright, with a gap behind them."""

RAISED = dict(zip("⁰¹²³⁴⁵⁶⁷⁸⁹⁺⁻ᵀⁱ'", "0123456789+−Ti′", strict=True))
LOWERED = dict(zip("₀₁₂₃₄₅₆₇₈₉", "0123456789", strict=True))
HALVES = {"½": (1, 2), "¼": (1, 4)}

LETTER = "A-Za-zâāûα-ωΑ-Ω∂"
SUB = "[A-Za-z0-9α-ω]+"
TOKEN = re.compile(
    rf"""(?P<number>\d+(?:\.\d+)?)
    | (?P<word>atan2|[A-Za-z]{{2,}}(?![A-Za-z]*\d)|a(?=\s(?!cos|sin)[a-z]{{3,}}))
      (?P<word_sub>_{SUB})?
    | (?P<letter>[{LETTER}][\u0302\u0304]?)
      (?P<own>[xyz](?![A-Za-z])|(?:ij|H|i)?\d*)
      (?P<sub>_(?:\{{[^}}]*\}}|{SUB}(?:[,+]{SUB})*))?
    | (?P<half>[{"".join(HALVES)}])
    | (?P<space>\s+)
    | (?P<sign><=|.)""",
    re.X,
)
SCRIPTS = re.compile(rf"([{''.join(LOWERED)}]*)([{''.join(RAISED)}]*)(_{SUB})?")
SYMBOL = re.compile(r"[kaθ]ij|[xyzr]H|R[xyz]")
"""Words that are a letter with an index."""


def on_page_markdown(markdown: str, page: Any, **_: Any) -> str:
    """Typeset the equations of a page of them."""
    return typeset(markdown) if page.file.src_uri in PAGES else markdown


def typeset(markdown: str) -> str:
    """A page with its blocks of equations as MathML."""
    return BLOCK.sub(lambda found: _block(found[1]), markdown)


def _block(text: str) -> str:
    """A block as a table: each line with the number of its equation."""
    rows = []
    for line in filter(str.strip, text.splitlines()):
        # The number stands apart; what is bracketed beside other things is a part of them.
        said, number = re.fullmatch(r"(.*?)(?:\s(\(\d+\)))?\s*", line).groups()  # type: ignore[union-attr]
        parts = [mathml(part) for part in re.split(r"\s{2,}", said.strip())]
        inner = '<mspace width="1.5em"/>'.join(parts)
        rows.append(f"<mtr><mtd>{inner}</mtd><mtd><mtext>{number or ''}</mtext></mtd></mtr>")
    said = " ".join(text.split())
    return (
        f'<div class="equations"><math display="block" alttext="{escape(said)}">'
        f"<mtable>{''.join(rows)}</mtable></math></div>"
    )


def mathml(text: str) -> str:
    """A formula as elements of MathML.

    Examples
    --------
    >>> mathml("θ_off + l2²")
    '<msub><mi>θ</mi><mi>off</mi></msub><mo>+</mo><msubsup><mi>l</mi><mn>2</mn><mn>2</mn></msubsup>'
    >>> mathml("√(a + 1)")
    '<msqrt><mi>a</mi><mo>+</mo><mn>1</mn></msqrt>'
    """
    out: list[str] = []
    at = 0
    while at < len(text):
        if text[at] == "√" and (inner := _group(text, at + 1)):
            out.append(f"<msqrt>{mathml(inner)}</msqrt>")
            at += len(inner) + 3
            continue
        if text[at] == "^" and (inner := _group(text, at + 1)):
            out.append(f"<msup>{out.pop()}<mrow>{mathml(inner)}</mrow></msup>")
            at += len(inner) + 3
            continue
        token = TOKEN.match(text, at)
        assert token is not None
        at = token.end()
        if token["space"]:
            continue
        scripts = SCRIPTS.match(text, at)
        assert scripts is not None
        at = scripts.end()
        base, below = _base(token)
        below += _digits(scripts[1], LOWERED) + _lowered((scripts[3] or "")[1:])
        out.append(_scripted(base, below, _digits(scripts[2], RAISED)))
        if token["word"] in FUNCTIONS and text[at : at + 1] != "(":
            out.append('<mspace width=".2em"/>')
        if token["sign"] == "√":  # of the one thing that follows
            root = TOKEN.match(text, at)
            assert root is not None
            out[-1] = f"<msqrt>{mathml(root[0])}</msqrt>"
            at = root.end()
    return "".join(out)


def _base(token: re.Match[str]) -> tuple[str, str]:
    """The element of a token without its scripts, and what stands below it."""
    if token["number"]:
        return f"<mn>{token['number']}</mn>", ""
    if token["half"]:
        over, under = HALVES[token["half"]]
        return f"<mfrac><mn>{over}</mn><mn>{under}</mn></mfrac>", ""
    if token["letter"]:
        own, sub = token["own"] or "", (token["sub"] or "")[1:].strip("{}")
        return f"<mi>{token['letter']}</mi>", _lowered(",".join(filter(None, (own, sub))))
    if word := token["word"]:
        sub = _lowered((token["word_sub"] or "")[1:])
        if SYMBOL.fullmatch(word):
            return f"<mi>{word[0]}</mi>", _lowered(word[1:]) + sub
        if word in FUNCTIONS or sub:
            return f"<mi>{word}</mi>", sub
        if len(word) == 2 and word[0].isupper():  # a product of matrices
            return f"<mi>{word[0]}</mi><mi>{word[1]}</mi>", ""
        return f"<mtext>&#160;{word}&#160;</mtext>", ""
    sign = {"-": "−", "<=": "≤"}.get(token["sign"], token["sign"])
    look = ' stretchy="false"' * (sign in "()[]|‖") + ' lspace="0" rspace="0"' * (sign in "|‖")
    return f"<mo{look}>{escape(sign)}</mo>", ""


def _lowered(text: str) -> str:
    """An index: letters, digits and signs."""
    parts = re.findall(r"\d+|[A-Za-zα-ω]+|.", text)
    kinds = ["mn" if p[0].isdigit() else "mi" if p[0].isalpha() else "mo" for p in parts]
    return "".join(f"<{k}>{escape(p)}</{k}>" for k, p in zip(kinds, parts, strict=True))


def _digits(text: str, of: dict[str, str]) -> str:
    return _lowered("".join(of[sign] for sign in text))


def _scripted(base: str, below: str, above: str) -> str:
    """A base with what stands below and above it."""
    below, above = (_one(part) for part in (below, above))
    if below and above:
        return f"<msubsup>{_one(base)}{below}{above}</msubsup>"
    if below or above:
        kind = "msub" if below else "msup"
        return f"<{kind}>{_one(base)}{below or above}</{kind}>"
    return base


def _one(parts: str) -> str:
    """Elements as one."""
    return f"<mrow>{parts}</mrow>" if len(re.findall(r"</m[ino]>", parts)) > 1 else parts


def _group(text: str, at: int) -> str:
    """What stands between the bracket at a place and its other half; empty where there is none."""
    depth = 0
    for end in range(at, len(text)):
        depth += (text[end] == "(") - (text[end] == ")")
        if depth == 0:
            return text[at + 1 : end]
    return ""
