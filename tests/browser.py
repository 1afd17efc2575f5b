"""A page in Debian's chromium, without a window: what a script sees in it."""

from __future__ import annotations

import html
import json
import os
import re
import shutil
import subprocess
from functools import cache
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import pytest

NAMES = ("chromium", "chromium-browser", "google-chrome")
ATTEMPTS = 3
CHROMIUM = next(filter(None, map(shutil.which, NAMES)), None)

needs_chromium = pytest.mark.skipif(
    CHROMIUM is None, reason="no browser is installed (./check --browser fetches one)"
)

WATCH = """<script>window.wrong = [];
window.addEventListener("error", (e) => wrong.push(String(e.message)));
</script>"""


def look(page: str, probe: str, folder: Path, width: int = 1280, fonts: Path | None = None) -> Any:
    """Open a page and return what a function of the page answers, and the errors of its scripts.

    Parameters
    ----------
    page : str
        The document.
    probe : str
        JavaScript: the body of a function whose answer can be written as JSON.
    folder : Path
        For the file of the page.
    width : int
        Width of the window [px].
    fonts : Path, optional
        Folder with the only fonts that the browser has; those of the machine where not given.

    Returns
    -------
    tuple
        The answer, and a list of messages.
    """
    ask = f"""<pre id="answer"></pre><script>
    const answer = (() => {{ {probe} }})();
    document.getElementById("answer").textContent = JSON.stringify([answer, wrong]);
    </script>"""
    file = folder / f"page-{width}.html"
    # Errors are counted from the first script on; the probe is the last.
    file.write_text(page.replace("<head>", f"<head>{WATCH}", 1).replace("</body>", f"{ask}</body>"))
    command = [*_browser(), f"--window-size={width},900", "--dump-dom", file.as_uri()]
    env = dict(os.environ)
    if fonts is not None:
        conf, cache = folder / "fonts.conf", folder / "fonts-cache"
        conf.write_text(f"<fontconfig><dir>{fonts}</dir><cachedir>{cache}</cachedir></fontconfig>")
        env["FONTCONFIG_FILE"] = str(conf)
    # A browser that crashes says nothing of the page; one that crashes each time does.
    for _ in range(ATTEMPTS):
        done = subprocess.run(command, capture_output=True, text=True, timeout=120, env=env)
        if done.returncode == 0:
            break
    found = re.search(r'<pre id="answer">(.*?)</pre>', done.stdout, flags=re.S)
    assert found is not None, f"the page has no answer: {done.stderr[-500:]}"
    return tuple(json.loads(html.unescape(found.group(1))))


def _browser() -> list[str]:
    """The browser with the profile of this process: a new one takes longer than a page."""
    assert CHROMIUM is not None
    command = [CHROMIUM, "--headless", "--no-sandbox", "--disable-gpu", "--disable-dev-shm-usage"]
    return [*command, f"--user-data-dir={_profile().name}"]


@cache
def _profile() -> TemporaryDirectory[str]:
    """A folder that goes with this process; pages of the package keep nothing in it."""
    return TemporaryDirectory(prefix="profile", ignore_cleanup_errors=True)


def sheets(page: Path) -> int:
    """Number of sheets that a page is printed on."""
    printed = page.with_suffix(".pdf")
    command = [*_browser(), "--no-pdf-header-footer", f"--print-to-pdf={printed}", page.as_uri()]
    subprocess.run(command, capture_output=True, timeout=120, check=True)
    return len(re.findall(rb"/Type /Page\b", printed.read_bytes()))
