"""Draw the picture of the README, `docs/residual.svg`: `python -m scripts.make_readme`."""

from __future__ import annotations

from pathlib import Path

import rsicalib
from rsicalib.io.files import write_text

ROOT = Path(__file__).parents[1]
PICTURE = ROOT / "docs" / "residual.svg"


def picture() -> str:
    """The residual of the demo, before and after."""
    return rsicalib.demo().figures()["residuals"]


if __name__ == "__main__":
    write_text(PICTURE, picture())
