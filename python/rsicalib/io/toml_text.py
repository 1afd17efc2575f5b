"""TOML text as values; where it is none, what stands there and what would be right."""

from __future__ import annotations

import re
import tomllib
from typing import Any

from rsicalib.errors import InputError, Where
from rsicalib.plain_text import quoted

PLACE = re.compile(r" \(at (?:line (\d+), column (\d+)|end of document)\)$")
"""Where `tomllib` ends its messages with a place."""

VALUE = "a number, true, false, or text in quotation marks"

MISTAKES = {
    r"Expected (.*)": r"\1",
    r"Unclosed array": "']' at the end of the list",
    r"Unclosed inline table": "'}' at the end of the table",
    r"Unterminated string": "a quotation mark at the end of the text",
    r"Illegal character '\\n'": "a quotation mark at the end of the text",
    r"Invalid value": VALUE,
    r"Invalid (?:initial )?character for a key part": "a name, or one in quotation marks",
    r"Invalid (?:date|time).*": "a date that there is",
    r"Invalid statement": "NAME = VALUE, or a name in brackets",
}
"""What was expected where `tomllib` says so; what was found is the text at that place."""

TWICE = re.compile(r"(?:Cannot (?:declare|overwrite|mutate)|Duplicate inline table key).*")
"""What `tomllib` says of a name that has a value already."""


def parse_toml(text: str, name: str) -> dict[str, Any]:
    """What `tomllib` makes of a text.

    Raises
    ------
    InputError
        It is not TOML; the message begins with `name`.
    """
    try:
        return tomllib.loads(text)
    except tomllib.TOMLDecodeError as error:
        raise _refused(str(error), text, name) from None
    except RecursionError:
        raise InputError.at(name, "values nested too deeply", "TOML") from None


def _refused(message: str, text: str, name: str) -> InputError:
    """The message by place, by what was found there and by what was expected."""
    lines = text.replace("\r\n", "\n").split("\n")
    at = PLACE.search(message)
    said = message if at is None else message[: at.start()]
    if at is None or at[1] is None:
        line, column, found = len(text.rstrip().split("\n")), None, "the end of the file"
    else:
        line, column = int(at[1]), int(at[2])
        rest = lines[line - 1][column - 1 :].strip()
        found = quoted(rest) if rest else "the end of the line"
    if TWICE.fullmatch(said):
        found, expected = "a name that has a value already", "each name once"
        return InputError.at(name, found, expected, line=line)
    wanted = (re.sub(k, words, said) for k, words in MISTAKES.items() if re.fullmatch(k, said))
    expected = next(wanted, "")
    if not expected:
        found, expected = f"{found}, which is no TOML ({said})", "TOML"
    places = [name, f"line {line}", *([] if column is None else [f"column {column}"])]
    where = Where(file=name, line=line, column=None, found=found, expected=expected)
    return InputError(f"{', '.join(places)}: found {found}, expected {expected}", where)
