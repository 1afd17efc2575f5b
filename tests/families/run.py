"""Blind trials on families of machines, graded.

`python -m tests.families.run --family all --suite all --devices 20 --seed 0 --jobs 2` prints one
table for each family. Devices are seeded one by one: results do not depend on the number of jobs.
Files are written after each round of one device of every suite of every family.

`python -m tests.families.run --suite garbage --devices 143 --misses` is 1,000 tries of readings
that have nothing to do with their machine.
"""

from __future__ import annotations

import argparse
import json
import multiprocessing
import sys
from collections import Counter
from collections.abc import Iterator, Sequence
from dataclasses import asdict, dataclass
from functools import partial
from pathlib import Path
from time import perf_counter

from tests.families.draw import FAMILIES
from tests.families.grade import USABLE, Grade, grew_by_chance
from tests.families.tables import cell, page
from tests.families.trials import FAINT, SUITES, Row, run

SINGLE = ("single", "pair", *FAINT)
"""Suites of effects that terms have."""

TOTAL = "all"
"""What the table of all machines together is called."""

Figure = tuple[str, str]
"""What is counted, and how often."""


def rates(suite: str, rows: Sequence[Row]) -> list[tuple[str, list[bool]]]:
    """What is counted of a suite: a name, and one truth value for each device or effect."""
    graded = [row for row in rows if row.grade is not None]
    grades: list[Grade] = [row.grade for row in rows if row.grade is not None]
    out: list[tuple[str, list[bool]]] = []
    if suite == "clean":
        out.append(("flagged: not adequate", [g.flagged for g in grades]))
        out.append(("anything named or left out", [bool(g.said) for g in grades]))
    elif suite in SINGLE:
        out.append(("named right, class and target", [f for g in grades for f in g.found]))
        out.append(("the same, or all that fits as well", [f for g in grades for f in g.among]))
        out.append(("the same, twins not counted", [f for g in grades for f in g.strictly]))
        out.append(("all right and nothing else", [all(g.found) and not g.extras for g in grades]))
        out.append(("explained by a wrong class", [g.misled for g in grades]))
        if suite in FAINT:
            out.append(("said that something is there", [g.flagged for g in grades]))
        missed = [not all(r.grade.found) and (r.behind or 0.0) > 0 for r in graded if r.grade]
        out.append(("missed, though the truth fits better", missed))
    elif suite == "wrong_readings":
        out.append(("bad poses found, all of them", [all(g.found) for g in grades]))
        out.append(("anything else named or left out", [g.extras > 0 for g in grades]))
    elif suite == "outside":
        out.append(("target right", [all(g.found) for g in grades]))
        out.append(("explained by a wrong class", [g.misled for g in grades]))
        explained = [g.verdict == "explained" and not all(g.found) for g in grades]
        out.append(("explained at a wrong target", explained))
    elif suite == "wrong_noise":
        out.append(("effects or bad readings invented", [bool(g.said) for g in grades]))
        out.append(("said that the noise does not fit", [row.noise_said for row in graded]))
    else:
        out.append(("exit code 0", [g.exit_code == USABLE for g in grades]))
        out.append(("refused", [row.error is not None and not row.crashed for row in rows]))
    if suite in (*SINGLE, "wrong_readings", "outside"):
        out.append(("error grew", [g.worse for g in grades if g.worse is not None]))
    if suite in SINGLE:
        grew = [grew_by_chance(row.errors) for row in graded]
        out.append(("error grew, told the truth", [g for g in grew if g is not None]))
    inside = [one for row in rows for one in row.covered]
    if inside:
        out.append(("95 % intervals that hold the truth", inside))
    codes = [row.calibrated for row in rows if row.calibrated is not None]
    if codes and suite != "wrong_noise":
        out.append(("calibrate: exit code 0", [code == USABLE for code in codes]))
    if any(row.crashed for row in rows):
        out.append(("crashed", [row.crashed for row in rows]))
    return out


def summary(rows: Sequence[Row]) -> list[tuple[str, str, str]]:
    """Rows of a table: suite, what, and how often."""
    out = []
    for suite in SUITES:
        own = [row for row in rows if row.suite == suite]
        if own:
            out += [(suite, name, cell(values)) for name, values in rates(suite, own)]
            verdicts = Counter(row.grade.verdict if row.grade else "refused" for row in own)
            said = ", ".join(f"{name} {count}" for name, count in verdicts.most_common())
            out.append((suite, "verdicts", said))
    return out


def as_plain(row: Row) -> dict[str, object]:
    """A row as JSON has it, without the time it took, which is never the same."""
    out: dict[str, object] = asdict(row)
    del out["seconds"]
    return out


def miss(row: Row) -> str | None:
    """A line on a device that went wrong; None where nothing did."""
    grade = row.grade
    what = f"  {row.family} {row.suite} {row.number}: {', '.join(row.truth) or 'clean'} ->"
    if grade is None:
        return None if row.suite == "garbage" and not row.crashed else f"{what} {row.error}"
    wrong = {
        "clean": grade.flagged or bool(grade.said),
        "garbage": grade.exit_code == USABLE,
        "wrong_noise": bool(grade.said) or not row.noise_said,
    }.get(row.suite, not all(grade.found) or grade.misled or bool(grade.worse))
    if not wrong:
        return None
    more = " misled" * grade.misled + " error grew" * bool(grade.worse)
    if row.behind is not None:
        more += f" behind {row.behind:.1f}"
    return f"{what} {grade.verdict}: {', '.join(grade.said) or 'nothing'}{more}"


def rounds(
    families: Sequence[str], suites: Sequence[str], devices: int, jobs: int, seed: int
) -> Iterator[list[Row]]:
    """Device after device, one of every suite of every family at a time."""
    work = partial(one, seed=seed)
    each = [[(f, s, k) for f in families for s in suites] for k in range(devices)]
    if jobs == 1:
        yield from ([work(asked) for asked in turn] for turn in each)
        return
    with multiprocessing.get_context("spawn").Pool(jobs) as pool:
        yield from (pool.map(work, turn, chunksize=1) for turn in each)


def one(asked: tuple[str, str, int], seed: int) -> Row:
    """One device."""
    return run(*asked, seed)


@dataclass
class Figures:
    """All rows so far, and where they are written."""

    command: str
    rows: list[Row]
    out: Path | None = None
    report: Path | None = None

    def tables(self) -> dict[str, list[tuple[str, str, str]]]:
        """The summary of every family that was looked at."""
        there = {row.family for row in self.rows}
        by_family = {f: [row for row in self.rows if row.family == f] for f in FAMILIES}
        out = {f: summary(rows) for f, rows in by_family.items() if f in there}
        return {TOTAL: summary(self.rows), **out} if len(out) > 1 else out

    def write(self) -> None:
        """Writes the files that were asked for."""
        tables = self.tables()
        if self.out:
            plain = [as_plain(row) for row in self.rows]
            out = {"command": self.command, "figures": tables, "devices": plain}
            self.out.write_text(json.dumps(out, indent=1) + "\n", encoding="utf-8")
        if self.report:
            self.report.write_text(page(tables, self.command), encoding="utf-8")

    def show(self, misses: bool) -> None:
        """Prints the tables."""
        for family, lines in self.tables().items():
            print(f"== {family}")
            for suite, name, value in lines:
                print(f"  {suite:15s} {name:34s} {value}")
            if misses and family != TOTAL:
                own = (row for row in self.rows if row.family == family)
                print("\n".join(filter(None, map(miss, own))))


def main(arguments: Sequence[str] | None = None) -> int:
    """The command."""
    parser = argparse.ArgumentParser(prog="python -m tests.families.run", description=__doc__)
    parser.add_argument("--family", choices=[*FAMILIES, "all"], default="all")
    parser.add_argument("--suite", choices=[*SUITES, "all"], default="all")
    parser.add_argument("--devices", type=int, default=20, help="of every suite of every family")
    parser.add_argument("--minutes", type=float, help="begin no other device after so long")
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--jobs", type=int, default=1)
    parser.add_argument("--misses", action="store_true", help="list the devices that went wrong")
    parser.add_argument("--out", type=Path, help="write figures and every graded device as JSON")
    parser.add_argument("--report", type=Path, help="write the tables as a page of the docs")
    options = parser.parse_args(arguments)
    families = list(FAMILIES) if options.family == "all" else [options.family]
    suites = list(SUITES) if options.suite == "all" else [options.suite]
    command = (
        f"python -m tests.families.run --family {options.family} --suite {options.suite} "
        f"--devices {options.devices} --seed {options.seed}"
    )
    if options.minutes is not None:
        command += f" --minutes {options.minutes:g}"
    figures = Figures(command, [], options.out, options.report)
    start = perf_counter()
    for rows in rounds(families, suites, options.devices, options.jobs, options.seed):
        figures.rows += rows
        figures.write()
        if options.minutes is not None and perf_counter() - start > 60 * options.minutes:
            break
    figures.show(options.misses)
    return 0


if __name__ == "__main__":
    sys.exit(main())
