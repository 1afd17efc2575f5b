"""Text from files, made safe for terminals: no control characters, no hidden directions."""

from __future__ import annotations

import unicodedata

__all__ = ["printable"]

HIDDEN = {"Cc", "Cf", "Cs", "Zl", "Zp"}
"""Unicode categories of characters that act on a terminal, or that no one sees."""


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


def _written(character: str) -> str:
    if character in "\n\t" or unicodedata.category(character) not in HIDDEN:
        return character
    return character.encode("unicode_escape").decode() if character.isascii() else _code(character)


def _code(character: str) -> str:
    code = ord(character)
    return f"\\u{code:04x}" if code < 0x10000 else f"\\U{code:08x}"
