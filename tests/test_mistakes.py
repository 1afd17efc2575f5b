"""Mistakes that people make with the command: refused with a place, never a traceback."""

from __future__ import annotations

import os
import shlex
from pathlib import Path

import pytest

from scripts.mistakes.catalogue import MISTAKES, Mistake
from scripts.mistakes.run import REAL, prepared, run
from tests.commands import program
from tests.full import sized

# Columns that are exchanged or reversed take as long as thirty other mistakes; `test_statistics.py`
# names them.
LONG = sized({"two columns exchanged", "a sign reversed"}, set())
SMALL = [mistake for mistake in MISTAKES if not mistake.large and mistake.what not in LONG]

pytestmark = pytest.mark.skipif(os.name != "posix", reason="a shell")


@pytest.fixture(scope="module")
def good(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("good")
    prepared(folder)
    return folder


def commanded(mistake: Mistake) -> str:
    """The command: a process of its own where its streams or variables are the mistake."""
    forked = program()
    if forked is None or mistake.shell or mistake.environment:
        return REAL
    return shlex.quote(str(forked))


@pytest.mark.parametrize("mistake", SMALL, ids=[mistake.what for mistake in SMALL])
def test_a_mistake_comes_to_its_exit_code_and_message(
    mistake: Mistake, good: Path, tmp_path: Path
) -> None:
    came = run(mistake, good, tmp_path, commanded(mistake))
    assert came.code == mistake.code, came.text
    assert mistake.says in came.text
    assert "Traceback" not in came.text


def test_every_mistake_is_on_the_page_as_it_came() -> None:
    page = Path(__file__).parents[1] / "docs" / "mistakes.md"
    rows = [line.split(" | ") for line in page.read_text(encoding="utf-8").splitlines()]
    listed = {row[0].removeprefix("| "): row[2] for row in rows if len(row) > 3}
    assert {m.what: str(m.code) for m in MISTAKES}.items() <= listed.items()
