"""A hook of mkdocs: the equations of the model as MathML, which a browser typesets by itself.

In `docs/model.md` equations and symbols are text that reads the same in an editor; on the site
they have subscripts, superscripts, fractions and roots, without a script and without a network. So
have the laws in the sentences of the pages of terms.
"""

from __future__ import annotations

import re
from collections.abc import Callable
from html import escape
from typing import Any

SYMBOLS = "model.md"
"""The page of equations, where a letter between backticks is a symbol."""

LAWS = re.compile(r"terms(?:/\w+)?\.md")
"""Pages where a letter may be the name of a parameter, and laws are formulas."""

PART = re.compile(r"^```(\w*)\n(.*?)^```$|^#[^\n]*$|(?<!`)`([^`\n]+)`(?!`)", re.M | re.S)
"""A block with its language, a heading, or what stands between backticks."""

CODE = re.compile(r"[@:\"\\]|\w\[|--|\.[A-Za-z]|[a-z]{2}/")
"""Signs of what is typed and not read."""

LAW = re.compile(r" [-+] |[²³√·]|[α-ω]|\b(?:sin|cos) ")
"""Signs of a law."""

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
POWER = re.compile(r"\^([-−]?[A-Za-z0-9½])")
"""A power of one letter or number."""

SYMBOL = re.compile(r"[kaθ]ij|[xyzr]H|[RT][xyz]")
"""Words that are a letter with an index."""


def on_page_markdown(markdown: str, page: Any, **_: Any) -> str:
    """Typeset the equations, and what stands for them in sentences."""
    name = page.file.src_uri
    if name == SYMBOLS:
        return typeset(markdown, is_symbol)
    return typeset(markdown, is_law) if LAWS.fullmatch(name) else markdown


def typeset(markdown: str, is_formula: Callable[[str], bool]) -> str:
    """A page with its equations as MathML, and with the formulas of its sentences and tables."""

    def part(found: re.Match[str]) -> str:
        language, block, inline = found.groups()
        if block is not None and language == "text" and is_formula is is_symbol:
            return _block(block)
        if inline is None or not is_formula(inline):
            return found[0]
        # An upright line would end the cell of a table.
        inner = mathml(inline).replace("|", "&#124;")
        said = escape(inline).replace("|", "&#124;")
        # A line that began with <math> would be a block of its own.
        return f'<span><math alttext="{said}"><mrow>{inner}</mrow></math></span>'

    return PART.sub(part, markdown)


def is_symbol(text: str) -> bool:
    """True for a symbol, or a formula of symbols: no word of it is code.

    Examples
    --------
    >>> [is_symbol(text) for text in ("θ_off", "L Lᵀ = S", "sin nφ", "rivals", "model/laws.rs")]
    [True, True, True, False, False]
    """
    words = re.findall(r"(?<![A-Za-z_])[A-Za-z]{2,}", text)
    named = (w in FUNCTIONS or SYMBOL.fullmatch(w) or (w.isupper() and len(w) == 2) for w in words)
    return all(named) and not CODE.search(text)


def is_law(text: str) -> bool:
    """True for a law, which may have parameters that are words.

    Examples
    --------
    >>> [is_law(text) for text in ("c2 u²", "1 + rate t", "a sin φ + b cos φ", "c2", "a + b@a22")]
    [True, True, True, False, False]
    """
    return bool(LAW.search(text)) and not CODE.search(text)


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
    at, text = 0, re.sub(rf"(?<=[{LETTER}])¯", "\u0304", text)
    while at < len(text):
        if text[at] == "√" and (inner := _group(text, at + 1)):
            out.append(f"<msqrt>{mathml(inner)}</msqrt>")
            at += len(inner) + 3
            continue
        if text[at] == "^" and (inner := _group(text, at + 1)):
            out.append(f"<msup>{out.pop()}<mrow>{mathml(inner)}</mrow></msup>")
            at += len(inner) + 3
            continue
        if power := POWER.match(text, at):
            out.append(f"<msup>{out.pop()}<mrow>{mathml(power[1])}</mrow></msup>")
            at = power.end()
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
