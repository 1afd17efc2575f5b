"""A page in Debian's chromium, without a window: what a script sees in it."""

from __future__ import annotations

import html
import json
import re
import shutil
import subprocess
from pathlib import Path
from typing import Any

import pytest

NAMES = ("chromium", "chromium-browser", "google-chrome")
ATTEMPTS = 3
CHROMIUM = next(filter(None, map(shutil.which, NAMES)), None)

needs_chromium = pytest.mark.skipif(
    CHROMIUM is None, reason="chromium is not installed (Debian: apt install chromium)"
)

WATCH = """<script>window.wrong = [];
window.addEventListener("error", (e) => wrong.push(String(e.message)));
</script>"""


def look(page: str, probe: str, folder: Path, width: int = 1280) -> Any:
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

    Returns
    -------
    tuple
        The answer, and a list of messages.
    """
    assert CHROMIUM is not None
    ask = f"""<pre id="answer"></pre><script>
    const answer = (() => {{ {probe} }})();
    document.getElementById("answer").textContent = JSON.stringify([answer, wrong]);
    </script>"""
    file = folder / f"page-{width}.html"
    # Errors are counted from the first script on; the probe is the last.
    file.write_text(page.replace("<head>", f"<head>{WATCH}", 1).replace("</body>", f"{ask}</body>"))
    command = [CHROMIUM, "--headless", "--no-sandbox", "--disable-gpu", "--disable-dev-shm-usage"]
    command += [f"--user-data-dir={folder / 'profile'}", f"--window-size={width},900"]
    command += ["--dump-dom", file.as_uri()]
    # A browser that crashes says nothing of the page; one that crashes each time does.
    for _ in range(ATTEMPTS):
        done = subprocess.run(command, capture_output=True, text=True, timeout=120)
        if done.returncode == 0:
            break
    found = re.search(r'<pre id="answer">(.*?)</pre>', done.stdout, flags=re.S)
    assert found is not None, f"the page has no answer: {done.stderr[-500:]}"
    return tuple(json.loads(html.unescape(found.group(1))))
