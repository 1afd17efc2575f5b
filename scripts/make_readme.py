"""Draw the pictures of the README and of `docs/guide.md`: `python -m scripts.make_readme`.

`docs/residual.svg` is a figure of the demo's report, `docs/report.png` its first screen as a
headless browser shows it, `docs/guide-*.png` the page of the guide in a session of `tests.pages`
(`chromium` or `google-chrome`; pictures are left as they are where there is none).
"""

from __future__ import annotations

import shutil
import subprocess
import tempfile
from pathlib import Path

import rsicalib
from rsicalib.io.files import write_text
from tests.pages import GUIDED, guide_page

ROOT = Path(__file__).parents[1]
PICTURE = ROOT / "docs" / "residual.svg"
SCREEN = ROOT / "docs" / "report.png"
SIZE = "1180,700"
HEIGHTS = {"guide-next": 700, "guide-trouble": 340, "guide-done": 320}
"""Of what the page of the guide shows at a width of 1200 px."""


def picture() -> str:
    """The residual of the demo, before and after."""
    return rsicalib.demo().figures()["residuals"]


def photograph(browser: str, text: str, size: str, to: Path) -> None:
    """Take a picture of the first screen of a page."""
    with tempfile.TemporaryDirectory() as folder:
        page = Path(folder) / "page.html"
        page.write_text(text, encoding="utf-8")
        still = ("--headless", "--no-sandbox", "--disable-gpu", "--hide-scrollbars")
        command = [browser, *still, f"--window-size={size}", f"--screenshot={to}", page.as_uri()]
        subprocess.run(command, check=True, capture_output=True, timeout=120)


if __name__ == "__main__":
    write_text(PICTURE, picture())
    browser = shutil.which("chromium") or shutil.which("google-chrome")
    if browser is None:
        print("no browser: docs/*.png are left as they are")
    else:
        photograph(browser, rsicalib.demo().report(), SIZE, SCREEN)
        for name in GUIDED:
            file = SCREEN.with_name(f"{name}.png")
            photograph(browser, guide_page(name), f"1200,{HEIGHTS[name]}", file)
