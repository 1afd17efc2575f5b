"""Standard streams of any terminal: no text makes the command fail, data are UTF-8."""

from __future__ import annotations

import codecs
import errno
import os
import sys
import unicodedata
from typing import TextIO

from rsicalib.plain_text import printable

__all__ = ["emit", "is_of_streams", "open_streams", "say", "silence"]

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


def say(text: str) -> None:
    """Print words for a person."""
    print(printable(text))


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
