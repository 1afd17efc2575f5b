"""What is said of TOML that is none: the place, what stands there, what would be right."""

from __future__ import annotations

import pytest

from rsicalib import InputError
from rsicalib.io.toml_text import parse_toml

REFUSED = {
    "no equals sign": (
        'a = 1\nunit "mm"\n',
        "m, line 2, column 6: found '\"mm\"', expected '=' after a key in a key/value pair",
    ),
    "no quotation marks": (
        "unit = mm\n",
        "m, line 1, column 8: found 'mm', expected a number, true, false, or text in quotation "
        "marks",
    ),
    "an open text": (
        'unit = "mm\n',
        "m, line 1, column 11: found the end of the line, expected a quotation mark at the end of "
        "the text",
    ),
    "an open list": (
        "a = [1,\n2\n",
        "m, line 2: found the end of the file, expected ']' at the end of the list",
    ),
    "an open table": (
        "a = {b = 1",
        "m, line 1: found the end of the file, expected '}' at the end of the table",
    ),
    "an open header": (
        "[[closure]\nb = 1\n",
        "m, line 1, column 10: found ']', expected ']]' at the end of an array declaration",
    ),
    "a decimal comma": (
        "a = 250,5\n",
        "m, line 1, column 8: found ',5', expected newline or end of document after a statement",
    ),
    "a key twice": (
        "a = 1\na = 2\n",
        "m, line 2: found a name that has a value already, expected each name once",
    ),
    "a table twice": (
        "[a]\n[a]\n",
        "m, line 2: found a name that has a value already, expected each name once",
    ),
    "a control character": ('a = "\x01"\n', "which is no TOML (Illegal character"),
    "too deep": ("a = " + "[" * 9000, "m: found values nested too deeply, expected TOML"),
}


@pytest.mark.parametrize("case", REFUSED)
def test_says_where_what_was_found_and_what_was_expected(case: str) -> None:
    text, said = REFUSED[case]
    with pytest.raises(InputError) as caught:
        parse_toml(text, "m")
    assert said in str(caught.value)
    assert caught.value.where is not None
    assert caught.value.where["file"] == "m"
