"""Standard streams of any terminal: no text makes the command fail, data are UTF-8."""

from __future__ import annotations

import codecs
import errno
import os
import re
import sys
import unicodedata
from itertools import groupby
from typing import TextIO

from rsicalib.plain_text import printable, wrapped

REPLACED = "rsicalib.replaced"
"""Name of the handler of characters that a terminal has not."""

ASCII = {
    "χ": "chi", "σ": "sigma", "β": "beta", "θ": "theta", "φ": "phi", "λ": "lambda", "µ": "u",
    "²": "^2", "³": "^3", "°": " deg", "±": "+-", "×": "x", "·": "*", "√": "sqrt", "∞": "inf",
    "≤": "<=", "≥": ">=", "≠": "!=", "≈": "~", "→": "->", "←": "<-", "…": "...", "–": "-",
    "—": "-", "−": "-", "’": "'", "‘": "'", "“": '"', "”": '"', "•": "*", "█": "#",
}  # fmt: skip
"""What stands for a character where a terminal has not got it."""

OUTPUT_ERRORS = {errno.ENOSPC, errno.EIO, errno.EBADF, errno.EFBIG, errno.EDQUOT}


def open_streams() -> None:
    """Make standard output and error take any text; a closed one takes it to nowhere.

    A stream that is closed must be opened before any file is: a file would get its number, and
    what is printed would go into the file.
    """
    codecs.register_error(REPLACED, _replaced)
    for name in ("stdout", "stderr"):
        stream: TextIO | None = getattr(sys, name)
        if stream is None:
            setattr(sys, name, open(os.devnull, "w", encoding="utf-8"))
        elif hasattr(stream, "reconfigure"):
            stream.reconfigure(errors=REPLACED)


def _replaced(error: UnicodeError) -> tuple[str, int]:
    """What is written instead of characters that an encoding has not."""
    if not isinstance(error, UnicodeEncodeError):
        raise error
    text = "".join(map(_ascii, error.object[error.start : error.end]))
    return text, error.end


def _ascii(character: str) -> str:
    if character in ASCII:
        return ASCII[character]
    plain = unicodedata.normalize("NFKD", character).encode("ascii", "ignore").decode()
    return plain or "?"


def say(text: str, stream: TextIO | None = None) -> None:
    """Print words for a person: on a terminal in lines that it has room for, else as they are."""
    to = sys.stdout if stream is None else stream
    columns = columns_of(to)
    print(printable(text) if columns is None else folded(printable(text), columns), file=to)


COLUMN = re.compile(r"#?\s*(?:[-•→] +|\S+(?: \S+)* {2,})?")
"""What a line begins with: an indent, and a mark of a list or a label in a column of its own."""


def folded(text: str, width: int) -> str:
    r"""Text in lines of so many columns: no word is broken, and lines go on below where they began.

    Examples
    --------
    >>> print(folded("  noise   one count in each of the channels", 24))
      noise   one count in
              each of the
              channels
    """
    lines = (line for part in _parts(text.split("\n")) for line in _narrowed(part, width))
    return "\n".join(part for line in lines for part in _folded(line, width))


TABLE = re.compile(r"\S {2,}\S.*\S {2,}\S")
"""A row of a table: two gaps at least."""


def _parts(lines: list[str]) -> list[list[str]]:
    """The lines, rows of one table together."""
    return [list(rows) for _, rows in groupby(lines, lambda line: bool(TABLE.search(line)))]


def _narrowed(lines: list[str], width: int) -> list[str]:
    """A table with gaps of two columns, where it is too wide and so fits; else the lines."""
    longest = max(map(len, lines))
    if longest <= width or not all(map(TABLE.search, lines)):
        return lines
    blank = [all(line[k : k + 1] in ("", " ") for line in lines) for k in range(longest)]
    inside = blank.index(False)
    kept = [k for k in range(longest) if k < max(inside, 2) or not all(blank[k - 2 : k + 1])]
    narrow = ["".join(line[k] for k in kept if k < len(line)) for line in lines]
    return narrow if len(kept) <= width else lines


def _folded(line: str, width: int) -> list[str]:
    if len(line) <= width:
        return [line]
    begins = COLUMN.match(line)
    left = len(begins[0]) if begins else 0
    if left > width // 2:  # a column of its own would leave no room
        left = len(line) - len(line.lstrip(" ")) + 2
    # What is a comment stays one.
    indent = f"#{' ' * (left - 1)}" if line.startswith("#") else " " * left
    return wrapped(
        line,
        width,
        subsequent_indent=indent,
        break_long_words=False,
        break_on_hyphens=False,
    )


def columns_of(stream: TextIO) -> int | None:
    """Columns of a terminal, 80 where it does not tell; None of a file or a pipe."""
    try:
        return (os.get_terminal_size(stream.fileno()).columns or 80) if stream.isatty() else None
    except (OSError, ValueError):
        return 80


def emit(text: str) -> None:
    """Print data, as UTF-8 on any terminal."""
    sys.stdout.flush()
    buffer = getattr(sys.stdout, "buffer", None)
    if buffer is None:
        sys.stdout.write(text)
    else:
        buffer.write(text.encode("utf-8", "backslashreplace"))


def is_of_streams(error: OSError) -> bool:
    """Whether an error is that of a standard stream, not of a file."""
    return error.filename is None and error.errno in OUTPUT_ERRORS


def silence(stream: TextIO) -> None:
    """Let what a stream still holds go nowhere, so that the interpreter does not complain."""
    try:
        os.dup2(os.open(os.devnull, os.O_WRONLY), stream.fileno())
    except OSError:
        pass
