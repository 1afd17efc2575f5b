"""Find values of Rust in messages of the core: `python -m scripts.messages`.

A message that is made with `{:?}` shows people `Some(Known(-1.0))`. Names, numbers and choices have
functions in `text.rs`, the only file that may use it. Tests and assertions may, too.

Wrong lines are printed as `file:line: text`, and the command then exits with 1.
"""

from __future__ import annotations

import re
import sys
from collections.abc import Iterator
from pathlib import Path

ROOT = Path(__file__).parents[1]
CORE = ROOT / "crates/rsicalib/src"
DEBUG = re.compile(r"\{\w*:[^{}\"]*\?\}")
OWN = re.compile(r"\b(assert|debug_assert|panic|unreachable)\w*!|\bunwrap_or_else\(.*panic")
FUNCTIONS = "text.rs"
"""Where names, numbers and choices become words."""


def wrong(text: str) -> Iterator[tuple[int, str]]:
    """Lines of a file that show values of Rust, counted from one; a file ends at its tests."""
    for number, line in enumerate(text.splitlines(), start=1):
        if line.startswith("#[cfg(test)]"):
            return
        if DEBUG.search(line) and not OWN.search(line) and not line.lstrip().startswith("//"):
            yield number, line.strip()


def main() -> int:
    """The command."""
    found = [
        f"{file.relative_to(ROOT)}:{number}: {line}"
        for file in sorted(CORE.rglob("*.rs"))
        if file.relative_to(CORE) != Path(FUNCTIONS)
        for number, line in wrong(file.read_text(encoding="utf-8"))
    ]
    print("\n".join(found), end="\n" if found else "")
    return 1 if found else 0


if __name__ == "__main__":
    sys.exit(main())
