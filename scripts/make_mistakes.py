"""Write `docs/mistakes.md`: `python -m scripts.make_mistakes`, a minute of work.

Every mistake of `scripts/mistakes` is made with the command as a user would; the page says what
came. `tests/test_mistakes.py` makes the small ones again.
"""

from __future__ import annotations

import tempfile
from pathlib import Path

from rsicalib.io.files import write_text
from scripts.mistakes.catalogue import MISTAKES, Mistake
from scripts.mistakes.run import Came, prepared, run

PAGE = Path(__file__).parents[1] / "docs" / "mistakes.md"
WIDEST = 150
"""Characters of a message that the table shows."""

HEAD = """\
# Mistakes, and what came

Written by `python -m scripts.make_mistakes`: each mistake was made with the command, in a folder
with a copy of the demo's files. Where the command can go on, the table shows the first line that it
prints. The model lacks an effect of the demo's session, so `calibrate` ends with exit code 4 where
a mistake did no harm; [commands.md](commands.md) says what the exit codes mean.

| mistake | command | exit | first line |
|---|---|---|---|
"""

LARGE = """
## Deep and large

Time and largest memory of the whole command, with Python and its libraries, on a machine at work.

| input | command | exit | time [s] | memory [MB] | first line |
|---|---|---|---|---|---|
"""


def text() -> str:
    """The whole page."""
    with tempfile.TemporaryDirectory() as good:
        prepared(Path(good))
        came = [(mistake, made(mistake, Path(good))) for mistake in MISTAKES]
    small = [_row(m, c, [str(c.code)]) for m, c in came if not m.large]
    figures = [
        _row(m, c, [str(c.code), f"{c.seconds:.1f}", f"{c.megabytes:.0f}"])
        for m, c in came
        if m.large
    ]
    return "".join([HEAD, *small, LARGE, *figures])


def made(mistake: Mistake, good: Path) -> Came:
    """What comes of a mistake in a folder of its own."""
    with tempfile.TemporaryDirectory() as folder:
        return run(mistake, good, Path(folder))


def _row(mistake: Mistake, came: Came, figures: list[str]) -> str:
    line = came.line if len(came.line) <= WIDEST else came.line[:WIDEST] + "…"
    words = f"`rsicalib {mistake.words} {mistake.shell}".strip().replace("|", "\\|") + "`"
    shown = line.replace("|", "\\|").replace("`", "'")
    cells = [mistake.what, words, *figures, f"`{shown}`" if shown else ""]
    return "| " + " | ".join(cells) + " |\n"


if __name__ == "__main__":
    write_text(PAGE, text())
