"""Draw the pictures of the README: `python -m scripts.make_readme`.

`docs/residual.svg` is a figure of the demo's report, `docs/report.png` its first screen as a
headless browser shows it (`chromium` or `google-chrome`; left as it is where there is none).
"""

from __future__ import annotations

import shutil
import subprocess
import tempfile
from pathlib import Path

import rsicalib
from rsicalib.io.files import write_text

ROOT = Path(__file__).parents[1]
PICTURE = ROOT / "docs" / "residual.svg"
SCREEN = ROOT / "docs" / "report.png"
SIZE = "1180,700"


def picture() -> str:
    """The residual of the demo, before and after."""
    return rsicalib.demo().figures()["residuals"]


def photograph(to: Path) -> bool:
    """Take a picture of the first screen of the demo's report; False where no browser is there."""
    browser = shutil.which("chromium") or shutil.which("google-chrome")
    if browser is None:
        return False
    with tempfile.TemporaryDirectory() as folder:
        page = Path(folder) / "report.html"
        page.write_text(rsicalib.demo().report(), encoding="utf-8")
        still = ("--headless", "--no-sandbox", "--disable-gpu", "--hide-scrollbars")
        command = [browser, *still, f"--window-size={SIZE}", f"--screenshot={to}", page.as_uri()]
        subprocess.run(command, check=True, capture_output=True, timeout=120)
    return True


if __name__ == "__main__":
    write_text(PICTURE, picture())
    if not photograph(SCREEN):
        print("no browser: docs/report.png is left as it is")
