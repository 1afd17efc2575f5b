"""Put into README.md what the commands print: `python -m scripts.make_readme`.

Also draws its picture, `docs/residual.svg`.
"""

from __future__ import annotations

import contextlib
import io
import re
from pathlib import Path

import rsicalib
from rsicalib.io.files import write_text
from rsicalib.report.page import residual_figure

ROOT = Path(__file__).parents[1]
README = ROOT / "README.md"
PICTURE = ROOT / "docs" / "residual.svg"

STYLE = """<style>
text { font: 12px ui-sans-serif, system-ui, sans-serif; fill: #6d6d66; }
text.title { font-size: 13px; fill: #1c1c1a; }
.grid { stroke: #dcdcd4; } .zero, .axis { stroke: #8a8a82; }
.dot { fill: #1f5f8b; fill-opacity: .75; } .noise { fill: #1f5f8b26; }
@media (prefers-color-scheme: dark) { text { fill: #9a9a92; } text.title { fill: #e6e6e0; }
  .grid { stroke: #363732; } .dot { fill: #7db8e0; } .noise { fill: #7db8e033; } }
</style>"""


def picture() -> str:
    """The residual of the demo, before and after."""
    figure = residual_figure(rsicalib.demo())
    head, body = figure.split("\n", 1)
    return f"{head}\n{STYLE}\n{body}\n"


def printed(code: str) -> str:
    """What a piece of Python prints, from the folder of the demo's files."""
    out = io.StringIO()
    with contextlib.redirect_stdout(out), contextlib.chdir(rsicalib.DEMO):
        exec(compile(code, "README.md", "exec"), {})
    return out.getvalue()


def text(readme: str) -> str:
    """The README with its output made again: each `text` block after a `python` block."""

    def again(match: re.Match[str]) -> str:
        return f"{match[1]}{match[2]}{match[3]}{printed(match[2])}```"

    blocks = re.compile(r"(```python\n)(.*?)(```\n\n```text\n).*?```", re.S)
    return blocks.sub(again, readme)


if __name__ == "__main__":
    write_text(README, text(README.read_text(encoding="utf-8")))
    write_text(PICTURE, picture())
