"""A figure of a page: its drawing at two widths, and the sentence that says what to see in it."""

from __future__ import annotations

import json
import re
from collections.abc import Mapping
from dataclasses import dataclass
from html import escape
from pathlib import Path
from typing import Any

from rsicalib.report.svg import NARROW, WIDE, Draw

STYLE = Path(__file__).with_name("style.css").read_text(encoding="utf-8")
"""Style of pages and figures."""

RULE = re.compile(
    r"^(?::root|svg|@media screen and \(prefers-color-scheme)[^\n]*\n(?:  [^\n]*\n)*", re.M
)
"""A rule of the style that figures need: colours, and what is drawn."""

OWN = "".join(RULE.findall(STYLE)).replace("]]>", "")
"""Style of a figure that is a file of its own."""


@dataclass(frozen=True)
class Figure:
    """A figure.

    Attributes
    ----------
    name : str
        Name of its file and of its element.
    draw : callable
        An `<svg>` element for a width.
    caption : str
        What to see in it, in a sentence.
    more : str
        What a page has below the drawing: controls, and data of a script.
    """

    name: str
    draw: Draw
    caption: str
    more: str = ""

    def html(self) -> str:
        """The figure in a page: the page shows the width that fits."""
        # No pointer rests on a phone: what would be said there is not sent.
        narrow = re.sub(r"<title>[^<]*</title>", "", self.draw(NARROW))
        return (
            f'<figure id="{self.name}"><div class="desk">{self.draw(WIDE)}</div>'
            f'<div class="phone">{narrow}</div>{self.more}'
            f"<figcaption>{whole(escape(self.caption))}</figcaption></figure>"
        )

    def svg(self) -> str:
        """The figure as a file of its own, in light and dark."""
        drawn = self.draw(WIDE)
        end = drawn.index(">") + 1
        return f"{drawn[:end]}\n<style><![CDATA[\n{OWN}]]></style>{drawn[end:]}\n"


def whole(text: str) -> str:
    """Text of a page: options of commands, dates, numbers with a power of ten, probabilities,
    values with their bounds, shares and multiples of σ stay on one line.
    """
    number = r"-?[0-9.]+(?:e-?[0-9]+)?"
    broken = rf"\bp (?:=|&lt;) {number}|χ² {number}|{number} ± {number}|(?<![\w.]){number} [%σ]|"
    broken += r"(?<![\w-])--[a-z][a-z-]*|(?<![\w.])[0-9.]+e-[0-9]+|\b\d{4}-\d\d-\d\d\b"
    return re.sub(broken, r'<span class="whole">\g<0></span>', text)


def data_element(name: str, data: Mapping[str, Any]) -> str:
    """Data of a script in a page: no text in it can end the element."""
    text = json.dumps(data, ensure_ascii=False, separators=(",", ":"), allow_nan=False)
    for sign in "<>&":
        text = text.replace(sign, f"\\u{ord(sign):04x}")
    return f'<script type="application/json" id="{name}">{text}</script>'
