"""Figures as people read them: a rate with its standard error, and the page of the docs."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from math import sqrt

from tests.families.draw import FAMILIES

HEAD = """# Machines of other families

Written by `{command} --report docs/families.md`, which draws every machine, what is wrong with it
and its session at random, and grades what `rsicalib.trace` says. Nothing of the simulation is
shared with the core. Effects are as large as makes their noncentrality, the mean growth of χ²,
60 to 200, and in the suites *faint_15*, *faint_30* and *faint_60* exactly that. A rate has its
binomial standard error, of which two pseudo-observations keep that of 0 in 20 from being 0; rates
of parameters count those of one session as if they were of several.

- *named right*: class and target of a step are the effect's, or tie with it and no more than one
  other; so is a *twin*, which leaves less than 1 of the noncentrality and which no method can tell.
- *said that something is there*: any other verdict than adequate.
- *95 % intervals that hold the truth*: of the offsets, gains and unknown points of each session
  that have one, after bad readings were left out.
- *or all that fits as well*: said to be a tie, among however many.
- *missed, though the truth fits better*: of the devices that were not named right, those where χ²
  of the truth is lower, 4 charged for each parameter. In the others the readings prefer another
  explanation: with one equation a pose, and few channels, chance makes such ones.
- *error grew*: points at check poses are worse than before, and 1.1 times worse than those of a
  calibration that is told the truth. Points are compared after a rigid motion.
- *error grew, told the truth*: the calibration that is told its effects is 1.1 times worse than the
  one before. It is right, and noise did that.
- *outside*: laws that no term has; the target is right where that sensor is named, or blamed, or
  its steps are said to be coarse.
- *garbage*: random readings in range, those of machines of other families, columns in another
  order, degrees for radians. With exit code 0 a script goes on.
"""


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
    """The page of the docs."""
    lines = [HEAD.format(command=command)]
    for family, rows in tables.items():
        made = FAMILIES.get(family)
        words = "All of them together." if made is None else (made.__doc__ or "").strip()
        lines += [f"## {family}", "", words, "", "| suite | | |", "|---|---|---|"]
        lines += [f"| {suite} | {name} | {value} |" for suite, name, value in rows]
        lines.append("")
    return "\n".join(lines)
