"""A configuration of Klipper: sections and options, the saved block, and files that it includes."""

from __future__ import annotations

import math
import re
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from rsicalib.errors import InputError
from rsicalib.io.sources import read_text

TOWERS = ("a", "b", "c")

AUTOSAVE = "#*#"
"""What lines of the block that `SAVE_CONFIG` writes begin with."""

LOGGED, LOGGED_END = "===== Config file =====", "======================="
"""What stands around a configuration, saved values in it, in `klippy.log`."""


@dataclass(frozen=True)
class Config:
    """Values of a configuration: section, option, text and where it stands."""

    source: str
    values: dict[tuple[str, str], tuple[str, str, int]]

    def text(self, section: str, option: str) -> str | None:
        """An option as it stands there; None where it is not."""
        found = self.values.get((section, option))
        return None if found is None else found[0]

    def refuse(self, section: str, option: str, expected: str) -> InputError:
        """What is wrong with an option."""
        text, source, line = self.values.get((section, option), (None, self.source, None))
        found = "no such option" if text is None else repr(text)
        place = f"[{section}] {option}"
        return InputError.at(source, found, expected, line=line, place=place)

    def number(self, section: str, option: str, default: float | None = None) -> float:
        """An option as a number."""
        text = self.text(section, option)
        if text is None and default is not None:
            return default
        try:
            value = float(text or "")
        except ValueError:
            value = math.nan
        if not math.isfinite(value):
            raise self.refuse(section, option, "a number")
        return value

    def above_zero(self, section: str, option: str, default: float | None = None) -> float:
        """An option as a number above zero."""
        value = self.number(section, option, default)
        if value <= 0.0:
            raise self.refuse(section, option, "a number above zero")
        return value

    def steps(self, option: str) -> list[float]:
        """Steps of the three towers."""
        text = self.text("delta_calibrate", option) or ""
        try:
            steps = [float(part) for part in text.split(",")]
        except ValueError:
            steps = []
        if len(steps) != len(TOWERS) or not np.isfinite(steps).all():
            expected = "three numbers with commas between them: steps of the towers a, b, c"
            raise self.refuse("delta_calibrate", option, expected)
        return steps

    def line(self, section: str, option: str) -> int:
        """Where an option stands."""
        return self.values[section, option][2]


def read_config(source: str) -> Config:
    """Read a configuration with the files that it includes; the body wins over the saved block."""
    body: dict[tuple[str, str], tuple[str, str, int]] = {}
    saved: dict[tuple[str, str], tuple[str, str, int]] = {}
    _read_into(Path(source), body, saved, ())
    return Config(source, {**saved, **body})


def _lines(text: str) -> list[tuple[int, str]]:
    """Lines of a configuration with their numbers; of `klippy.log` those of its last one."""
    lines = list(enumerate(text.splitlines(), 1))
    begins = [number for number, line in lines if line.strip() == LOGGED]
    if not begins:
        return lines
    after = lines[begins[-1] :]
    end = next((k for k, (_, line) in enumerate(after) if line.startswith(LOGGED_END)), len(after))
    return after[:end]


def _read_into(
    path: Path,
    body: dict[tuple[str, str], tuple[str, str, int]],
    saved: dict[tuple[str, str], tuple[str, str, int]],
    above: tuple[Path, ...],
) -> None:
    section = ""
    for number, raw in _lines(read_text(path, "a configuration of Klipper")):
        automatic = raw.startswith(AUTOSAVE)
        line = re.split(r"(?:^|\s)[#;]", raw[len(AUTOSAVE) * automatic :])[0].strip()
        head = re.fullmatch(r"\[([^\]]+)\]", line)
        if head:
            section = head[1].strip()
            if section.startswith("include "):
                pattern = section.removeprefix("include ").strip()
                found = sorted(path.parent.glob(pattern))
                if not found and not set(pattern) & set("*?["):
                    where = f"[{section}]"
                    raise InputError.at(
                        str(path),
                        "no such file",
                        "the file that is included",
                        line=number,
                        place=where,
                    )
                for file in found:
                    if file not in above:
                        _read_into(file, body, saved, (*above, path))
            continue
        option = re.match(r"([^\s:=][^:=]*?)\s*[:=]\s*(.*)", line)
        if option and not raw[:1].isspace():
            value = (option[2].strip(), str(path), number)
            (saved if automatic else body)[section, option[1].lower()] = value
