"""What users give as a file: its bytes, and the text in them.

Everything that the package reads comes through here, so that a file which is not there, a folder,
or text in another encoding is refused in the same words everywhere.
"""

from __future__ import annotations

import gzip
import io
import json
import os
import re
import sys
import unicodedata
import zlib
from collections.abc import Iterator
from contextlib import contextmanager
from typing import IO, Any

from rsicalib.errors import InputError

STANDARD_INPUT = "-"
"""The path that stands for standard input."""

ON_STREAM = "standard input"
"""What messages call it."""

LIMIT = "RSICALIB_LARGEST_FILE"
"""Variable of the environment with the bytes that a file may hold, as `8e9`."""

LARGEST_FILE = 1e9
"""A file of more bytes is refused where the variable does not say otherwise: what is read whole
must fit into memory several times, a few kB of gzip can hold terabytes, and a device never ends."""

WHOLE = "a whole gzip file"

LONGEST_LINE = 1 << 20
"""A line of a stream that has more bytes is none."""

MARKS = {b"\xff\xfe": "UTF-16", b"\xfe\xff": "UTF-16"}
"""What other encodings begin with."""

ENCODINGS = {"cp1252": "Latin-1 (Windows-1252)", "cp932": "Shift-JIS"}
"""What spreadsheets save text in that is not Unicode, and what people call it."""

UNWRITTEN = {"Cc", "Cn", "Co"}
"""Unicode categories that stand in no text, but for ends of lines and tabs."""

WORD = re.compile(r"""[^\s,;"']{1,20}""")
"""What is shown of a text, to tell whether it is the right one."""

PIECE = 1 << 26
"""Bytes that are read at a time."""

ENOUGH = 4096
"""So many bytes tell what a file is."""


def read_bytes(path: str | os.PathLike[str], expected: str, place: str | None = None) -> bytes:
    """Read a whole file, or standard input where the path is `-`.

    Parameters
    ----------
    path : path
        As it was given.
    expected : str
        What the file is to hold, for the message.
    place : str, optional
        What needs the file, for the message.

    Returns
    -------
    bytes
        As they stand in the file.

    Raises
    ------
    InputError
        There is no such file, it cannot be read, or it holds too much.
    """
    source = os.fsdecode(path)
    with refused_alike(source, expected, place):
        if source == STANDARD_INPUT:
            return _within(standard_input(expected), source)
        with open(source, "rb") as file:
            return _within(file, source)


@contextmanager
def refused_alike(source: str, expected: str, place: str | None = None) -> Iterator[None]:
    """Refuse a file that cannot be opened or read, in the words that stand for it everywhere.

    Parameters
    ----------
    source, expected, place
        As `read_bytes` takes them.

    Raises
    ------
    InputError
        In place of what the system raised.
    """

    def refuse(found: str, expected: str) -> InputError:
        return InputError.at(source, found, expected, place=place)

    try:
        yield
    except InputError:  # too much: said already
        raise
    except FileNotFoundError:
        raise refuse("no such file", expected) from None
    except IsADirectoryError:
        raise refuse("a directory", expected) from None
    except (OSError, ValueError) as error:  # unreadable, a NUL in the path
        reason = getattr(error, "strerror", None) or str(error)
        raise refuse(reason, "a file that can be read") from error


def standard_input(expected: str) -> IO[bytes]:
    """Standard input as bytes.

    Raises
    ------
    InputError
        It is closed.
    """
    stream: IO[bytes] | None = getattr(sys.stdin, "buffer", None)
    if stream is None or stream.closed:
        raise InputError.at(ON_STREAM, "a closed stream", expected)
    return stream


def unpacked(data: bytes, source: str) -> bytes:
    """Bytes of a gzip file as they were before; other bytes as they are.

    Raises
    ------
    InputError
        The file is damaged, or holds too much.
    """
    if not data.startswith(b"\x1f\x8b"):
        return data
    try:
        with gzip.GzipFile(fileobj=io.BytesIO(data)) as file:
            return _within(file, source, " in a gzip file")
    except (OSError, EOFError, zlib.error) as error:
        found = f"a gzip file that is damaged ({error})"
        raise InputError.at(source, found, WHOLE) from None


def refuse_larger(size: float, source: str, where: str = "") -> None:
    """Refuse more bytes than a file may hold.

    Raises
    ------
    InputError
        With the limit, and how it is raised.
    """
    most = largest_file()
    if size > most:
        hint = f"Where so much is meant, set {LIMIT} to the bytes that may be read, as 8e9."
        found, expected = f"more than {most:g} bytes{where}", f"at most {most:g}"
        raise InputError.at(source, found, expected, hint=hint)


def largest_file() -> int:
    """The bytes that a file may hold.

    Raises
    ------
    InputError
        The variable of the environment is no number of bytes.
    """
    text = os.environ.get(LIMIT, "")
    if not text:
        return int(LARGEST_FILE)
    try:
        return int(float(text))
    except (ValueError, OverflowError):
        raise InputError(f"{LIMIT}: found {text!r}, expected bytes such as 8e9") from None


def _within(file: IO[bytes] | gzip.GzipFile, source: str, where: str = "") -> bytes:
    """All bytes of a file, if they are not too many."""
    most = largest_file()
    pieces: list[bytes] = []
    size = 0
    while piece := file.read(min(PIECE, most + 1 - size)):
        pieces.append(piece)
        size += len(piece)
        refuse_larger(size, source, where)
    return b"".join(pieces)


def decoded(data: bytes, source: str, *, hint: str = "Save the file in UTF-8.") -> str:
    """Text of UTF-8 bytes.

    A byte order mark is dropped without a word: spreadsheets write it, it is
    legal UTF-8 and carries nothing; kept, it would hide in the first name.

    Raises
    ------
    InputError
        The bytes are no UTF-8; the message names the line, and what else they may be.
    """
    if b"\0" in data[:ENOUGH] and data[:2] not in MARKS:
        found = f"NUL bytes: the file {_looks_like(data)}"
        raise InputError.at(source, found, "text in UTF-8", line=1, hint=hint)
    try:
        return data.decode("utf-8-sig")
    except UnicodeDecodeError as error:
        line = data.count(b"\n", 0, error.start) + 1
        found = f"byte 0x{data[error.start]:02x}, which is not UTF-8"
        if data[:2] in MARKS:
            found += f": the file looks like {MARKS[data[:2]]}"
        else:
            read = _in_other_encodings(data, error.start)
            found += f": {', '.join(read)}" if read else ""
            hint = f"The bytes do not tell which encoding it is, and there are others. {hint}"
        raise InputError.at(source, found, "text in UTF-8", line=line, hint=hint) from None


def _in_other_encodings(data: bytes, at: int) -> list[str]:
    """What stands at a byte that is no UTF-8, in each encoding that all bytes are text of."""
    out = []
    for encoding, name in ENCODINGS.items():
        try:
            text = data.decode(encoding)
        except UnicodeDecodeError:
            continue
        if any(unicodedata.category(c) in UNWRITTEN and c not in "\r\n\t" for c in {*text}):
            continue
        word = WORD.match(text, len(data[:at].decode(encoding, "ignore")))
        if word is not None:
            out.append(f"{word[0]!r} if the file is {name}")
    return out


def _looks_like(data: bytes) -> str:
    """What a file with NUL bytes is: in UTF-16 every other byte of plain text is one."""
    start = data[:ENOUGH]
    halves = (start[::2].count(0), start[1::2].count(0))
    utf16 = max(halves) > len(start) // 4 and min(halves) == 0
    return "looks like UTF-16" if utf16 else "does not look like text"


def read_text(path: str | os.PathLike[str], expected: str, place: str | None = None) -> str:
    """Read a file of text in UTF-8; see `read_bytes` and `decoded`."""
    return decoded(read_bytes(path, expected, place), os.fsdecode(path))


def read_json(path: str | os.PathLike[str], expected: str) -> dict[str, Any]:
    """Read a file of JSON that holds an object; see `read_text`.

    Raises
    ------
    InputError
        It holds something else.
    """
    source, text = os.fsdecode(path), read_text(path, expected)
    try:
        found = json.loads(text)
    except json.JSONDecodeError as error:
        line, why = error.lineno, f"text that is not JSON ({error.msg})"
        raise InputError.at(source, why, expected, line=line) from None
    except (ValueError, RecursionError):  # a number of too many digits, nesting that is too deep
        found = "JSON that is too long or nested too deep"
        raise InputError.at(source, found, expected) from None
    if not isinstance(found, dict):
        raise InputError.at(source, "JSON that is no object", expected)
    return found
