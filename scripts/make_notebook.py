"""Write `examples/session.ipynb` from `docs/notebook.md`: `python -m scripts.make_notebook`.

The page is run by the tests, so the cells of the notebook are. A test compares the two.
"""

from __future__ import annotations

import json
import re
from pathlib import Path
from typing import Any

from rsicalib.io.files import write_text
from scripts.make_docs import BLOCK

ROOT = Path(__file__).parents[1]
PAGE = ROOT / "docs" / "notebook.md"
NOTEBOOK = ROOT / "examples" / "session.ipynb"


def cells(page: str) -> list[dict[str, Any]]:
    """Cells of a page: text and code in turn, without what the code prints."""
    found: list[dict[str, Any]] = []
    words, end = "", 0
    for match in BLOCK.finditer(page):
        words += page[end : match.start()]
        end = match.end()
        if match[2] == "python":
            found += [_words(words), _code(match[4])]
            words = ""
        elif match[2] != "text":
            words += match[0]
    return [cell for cell in [*found, _words(words + page[end:])] if cell["source"]]


def _words(text: str) -> dict[str, Any]:
    return {"cell_type": "markdown", "metadata": {}, "source": _lines(_tidy(text))}


def _code(text: str) -> dict[str, Any]:
    code: dict[str, Any] = {
        "cell_type": "code",
        "execution_count": None,
        "metadata": {},
        "outputs": [],
    }
    return {**code, "source": _lines(text.strip())}


def _tidy(text: str) -> str:
    """Links to other pages lead nowhere from a notebook."""
    text = re.sub(r"\[([^\]]*)\]\((?!https?:)[^)]*\)", r"\1", text)
    return re.sub(r"\n{3,}", "\n\n", text).strip()


def _lines(text: str) -> list[str]:
    return text.splitlines(keepends=True)


def text() -> str:
    """The notebook."""
    numbered = [
        {"id": f"cell-{k}", **cell} for k, cell in enumerate(cells(PAGE.read_text("utf-8")))
    ]
    kernel = {"display_name": "Python 3", "language": "python", "name": "python3"}
    document = {
        "cells": numbered,
        "metadata": {"kernelspec": kernel},
        "nbformat": 4,
        "nbformat_minor": 5,
    }
    return json.dumps(document, indent=1, ensure_ascii=False) + "\n"


if __name__ == "__main__":
    write_text(NOTEBOOK, text())
