"""Write `docs/mistakes.md`: `python -m scripts.make_mistakes`, a minute of work.

Every mistake of `scripts/mistakes` is made with the command as a user would; the page says what
came. `tests/test_mistakes.py` makes the small ones again.
"""

from __future__ import annotations

import re
import tempfile
from pathlib import Path

from rsicalib.io.files import write_text
from scripts.mistakes.catalogue import CALIBRATE, FORWARD, MISTAKES, Mistake
from scripts.mistakes.run import Came, prepared, run

PAGE = Path(__file__).parents[1] / "docs" / "mistakes.md"
BEGIN, END = 60, 40
"""Characters of the begin and the end of a message that the table shows."""

ADVICE = re.compile(r" (Correct the file, or drop such rows with .*|See 'rsicalib[^']*')\.$")
"""What refusals of rows and of options end with."""

HEAD = f"""\
# Mistakes, and what came

Written by `python -m scripts.make_mistakes`: each mistake was made with the command, in a folder
with a copy of the demo's files. Where no command is shown, and for `…`, it is
`rsicalib {CALIBRATE}`; `forward` is
`rsicalib {FORWARD}`. The table shows begin and end of the first
line that is printed: with exit code 2 what follows `error:`, without the advice how to drop bad
rows or to ask for help. The model lacks an effect of the demo's session, so `calibrate` ends with
exit code 4 where a mistake did no harm; [commands.md](commands.md) says what the exit codes mean.

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
    line = came.line.removeprefix("error: ") if came.code == 2 else came.line
    line = ADVICE.sub("", line)
    if len(line) > BEGIN + END:
        line = f"{line[:BEGIN].rpartition(' ')[0]} … {line[-END:].partition(' ')[2]}"
    typed = f"{mistake.words} {mistake.shell}".strip().replace(CALIBRATE, "…")
    typed = {"…": "", FORWARD: "forward"}.get(typed, typed)
    words = f"`{typed}`".replace("|", "\\|") if typed else ""
    shown = line.replace("|", "\\|").replace("`", "'")
    cells = [mistake.what, words, *figures, f"`{shown}`" if shown else ""]
    return "| " + " | ".join(cells) + " |\n"


if __name__ == "__main__":
    write_text(PAGE, text())
