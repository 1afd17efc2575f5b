"""Figures as people read them: a rate with its standard error, and the page of the docs."""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from math import sqrt

from tests.families.draw import FAMILIES

HEAD = """# Machines of other families

Written by `{command} --report docs/families.md`: every machine, what is wrong with it and its
session are drawn at random, and what `rsicalib.trace` says is graded. The simulation shares nothing
with the core. Effects have a noncentrality, the mean growth of χ², of 60 to 200, in the suites
*faint_15*, *faint_30* and *faint_60* exactly that. A rate has its binomial standard error, of which
two pseudo-observations keep that of 0 in 20 from being 0; rates of parameters count those of one
session as if they were of several. Columns of families have counts alone.

- *named right*: class and target of a step are the effect's, or tie with it and no more than one
  other; so is a *twin*, which leaves less than 1 of the noncentrality and which no method can tell.
- *or all that fits as well*: said to be a tie, among however many.
- *said that something is there*: any other verdict than adequate.
- *95 % intervals that hold the truth*: of the offsets, gains and unknown points of each session
  that have one, after bad readings were left out.
- *missed, though the truth fits better*: of the devices that were not named right, those where χ²
  of the truth is lower, 4 charged for each parameter. In the others the readings prefer another
  explanation: with one equation a pose, and few channels, chance makes such ones.
- *error grew*: points at check poses, after a rigid motion, are worse than before, and 1.1 times
  worse than those of a calibration that is told the truth. *Told the truth*: the calibration
  that is told its effects is 1.1 times worse than the one before; it is right, and noise did that.
- *outside*: laws that no term has; the target is right where that sensor is named, or blamed, or
  its steps are said to be coarse.
- *garbage*: random readings in range, those of machines of other families, columns in another
  order, degrees for radians. With exit code 0 a script goes on.
- *verdicts* of a family: {letters}.
"""

LETTERS = {
    "adequate": "a",
    "explained": "e",
    "partly_explained": "p",
    "unexplained": "u",
    "undetermined": "d",
    "unjudged": "j",
    "implausible": "i",
}
"""Verdicts in the narrow columns."""


def error(values: Sequence[bool]) -> float:
    """Binomial standard error of a rate."""
    n = len(values)
    p = (sum(values) + 1) / (n + 2)
    return sqrt(p * (1 - p) / n)


def cell(values: Sequence[bool]) -> str:
    """A rate in per cent with its standard error, and of how many."""
    if not values:
        return "-"
    rate = sum(values) / len(values)
    return f"{100 * rate:.0f} ± {100 * error(values):.0f} %, {sum(values)} of {len(values)}"


def page(tables: Mapping[str, Sequence[tuple[str, str, str]]], command: str) -> str:
    """The page of the docs: the first table in full, the others as its columns."""
    letters = ", ".join(f"{letter} {verdict}" for verdict, letter in LETTERS.items())
    lines = [HEAD.format(command=command, letters=letters)]
    lines += [f"- `{f}`: {(FAMILIES[f].__doc__ or '').strip()}" for f in tables if f in FAMILIES]
    first, *others = tables
    counts = [{(suite, name): value for suite, name, value in tables[f]} for f in others]
    lines += ["", f"## {first}", "", _row("suite", "", first, *others)]
    lines.append("|---" * (3 + len(others)) + "|")
    for suite, name, value in tables[first]:
        narrow = (_narrow(count.get((suite, name), "-")) for count in counts)
        lines.append(_row(suite, name, value, *narrow))
    return "\n".join(lines) + "\n"


def _row(*cells: str) -> str:
    return f"| {' | '.join(cells)} |"


def _narrow(value: str) -> str:
    """A rate as its count, verdicts by their letters."""
    rate = re.search(r"(\d+) of (\d+)$", value)
    if rate:
        return f"{rate[1]}/{rate[2]}"
    verdicts = re.findall(r"(\w+) (\d+)", value)
    return " ".join(n + LETTERS.get(verdict, f" {verdict}") for verdict, n in verdicts) or value
