"""Mechanisms that come with the package: the core's own, and files that a user may change."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from pathlib import Path

from rsicalib._core import Mechanism

DEFAULT = "rsi"
"""The mechanism that holds where none is given."""
GIVE_YOURS = f"This is the mechanism {DEFAULT!r}: give yours as mechanism (--mechanism FILE)."
"""What to do where it holds, and the data are of another one."""

FOLDER = Path(__file__).parents[1] / "mechanisms"


def _of_file(file: Path) -> Mechanism:
    return Mechanism.from_toml(file.read_text(encoding="utf-8"))


BUILTIN: dict[str, Callable[[], Mechanism]] = {
    DEFAULT: Mechanism.rsi,
    **{file.stem: partial(_of_file, file) for file in sorted(FOLDER.glob("*.toml"))},
}
"""By name. Apart from the files of mechanisms, which only those need who have one."""
