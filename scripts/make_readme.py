"""Draw the picture of the README, `docs/residual.svg`: `python -m scripts.make_readme`."""

from __future__ import annotations

from pathlib import Path

import rsicalib
from rsicalib.io.files import write_text
from rsicalib.report.page import residual_figure

ROOT = Path(__file__).parents[1]
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


if __name__ == "__main__":
    write_text(PICTURE, picture())
