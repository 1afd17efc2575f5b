"""Text from files, made safe for terminals: no control characters, no hidden directions."""

from __future__ import annotations

import difflib
import re
import textwrap
import unicodedata
from collections.abc import Iterable
from typing import Any

LINE = 40
"""Longer values are cut in messages."""

KEPT = re.compile(r" (?=±)|(?<=±) |(?<=\bp) (?=[=<] [\d.])|(?<=\bp [=<]) (?=[\d.])|(?<=χ²) (?=\d)")
"""Blanks that stay within a line."""

ESCAPED = ("utf-8", "backslashreplace")

WORD = 160
"""Words of messages that are longer are cut: paths may be long."""

LONG = re.compile(r"""[^\s"']{2000,}|"[^"]{2000,}"|'[^']{2000,}'""".replace("2000", str(2 * WORD)))

HIDDEN = {"Cc", "Cf", "Cs", "Zl", "Zp"}
"""Unicode categories of characters that act on a terminal, or that no one sees."""


def counted(number: int, what: str) -> str:
    """So many of something: `1 pose`, `2 poses`."""
    return f"{number} {what}" if number == 1 else f"{number} {what}s"


SMALLEST = 1e-99
"""A p-value below it may be one that a double cannot hold: it is not zero."""


def p_equals(p: float, digits: str = ".2g") -> str:
    """A p-value: `p = 0.03`, or `p < 1e-99`.

    Examples
    --------
    >>> p_equals(0.0312), p_equals(0.0)
    ('p = 0.031', 'p < 1e-99')
    """
    return f"p < {SMALLEST:g}" if p < SMALLEST else f"p = {p:{digits}}"


def installed_by(extra: str) -> str:
    """How an extra of the package is installed: quoted, as brackets are a pattern for shells."""
    return f"pip install 'rsicalib[{extra}]'"


def printable(text: str) -> str:
    r"""Text with its control characters written out; ends of lines and tabs stay.

    Examples
    --------
    >>> printable("arm\x1b[31m")
    'arm\\x1b[31m'
    """
    if text.isascii() and text.replace("\n", "").replace("\t", "").isprintable():
        return text
    return "".join(_written(c) for c in text)


def quoted(value: object) -> str:
    """A value as a message shows it: as Python writes it, and no longer than a line.

    Examples
    --------
    >>> quoted("x" * 1000)
    "'xxxxxxxxxxxxxxxxxxxxxxxxxxxxxxxxxxxxx...' (1000 characters)"
    """
    if isinstance(value, str):
        return (
            repr(value)
            if len(value) <= LINE
            else f"{value[:37] + '...'!r} ({len(value)} characters)"
        )
    try:
        shown = repr(value)
    except Exception:  # of any class that a caller may have
        return f"a {type(value).__name__}"
    return shown if len(shown) <= 2 * LINE else f"{shown[:LINE]}... ({type(value).__name__})"


def encodable(text: str) -> str:
    r"""Text that UTF-8 can write: bytes of a name that are no text are written out.

    Examples
    --------
    >>> encodable(b"caf\xe9".decode("utf-8", "surrogateescape"))
    'caf\\xe9'
    """
    if text.isascii():
        return text
    data = text.encode("utf-8", "surrogateescape") if _bytes_in(text) else text.encode(*ESCAPED)
    return data.decode("utf-8", "backslashreplace")


def _bytes_in(text: str) -> bool:
    """Whether all surrogates of a text stand for bytes."""
    return all(not "\ud800" <= c <= "\udfff" or "\udc80" <= c <= "\udcff" for c in text)


def meant(name: str, known: Iterable[str]) -> str:
    """The known name that may have been meant, in brackets; empty where none is near.

    Examples
    --------
    >>> meant("calibarte", ["calibrate", "trace"])
    " (did you mean 'calibrate'?)"
    """
    near = nearest(name, (k for k in known if k != name))
    return "" if near is None else f" (did you mean {near!r}?)"


def nearest(name: str, known: Iterable[str]) -> str | None:
    """The known name that is nearest, itself if it is one of them; None where none is near."""
    near = difflib.get_close_matches(name[:200], list(known), 1, 0.7)
    return near[0] if near else None


def shortened(message: str) -> str:
    """A message whose long words, and long texts in quotation marks, are cut: no one reads them."""
    return LONG.sub(lambda found: f"{found[0][:WORD]}... ({len(found[0])} characters)", message)


def wrapped(text: str, width: int, **how: Any) -> list[str]:
    """Text in lines of so many columns, as `textwrap.wrap`; no line ends within a value and its
    bound, or within a probability.

    Examples
    --------
    >>> wrapped("an offset of 0.3 ± 0.1 rad", 18)
    ['an offset of', '0.3 ± 0.1 rad']
    """
    lines = textwrap.wrap(KEPT.sub("\u00a0", text), width, **how)
    return [line.replace("\u00a0", " ") for line in lines]


def _written(character: str) -> str:
    if character in "\n\t" or unicodedata.category(character) not in HIDDEN:
        return character
    return character.encode("unicode_escape").decode() if character.isascii() else _code(character)


def _code(character: str) -> str:
    code = ord(character)
    return f"\\u{code:04x}" if code < 0x10000 else f"\\U{code:08x}"


def as_sentence(words: str) -> str:
    """Words with one full stop at their end.

    Examples
    --------
    >>> as_sentence("no date"), as_sentence("no date.")
    ('no date.', 'no date.')
    """
    return f"{words.removesuffix('.')}."
