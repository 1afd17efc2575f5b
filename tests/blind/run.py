"""Blind trials, graded: `python -m tests.blind.run --suite single --sessions 200 --jobs 2`.

Prints, for each suite, the figures with their standard errors and which term was named for which
truth. Sessions are seeded one by one: results do not depend on the number of jobs.
"""

from __future__ import annotations

import argparse
import json
import multiprocessing
import sys
from collections import Counter
from collections.abc import Iterable, Sequence
from dataclasses import asdict
from functools import partial
from itertools import pairwise
from pathlib import Path

import numpy as np

from rsicalib.io.files import write_text
from tests.blind.trials import FLOOR, SUITES, Row, Size, run


def rate(values: Iterable[float]) -> str:
    """A mean in per cent with its standard error, and of how many."""
    x = np.array(list(values), dtype=float)
    if len(x) == 0:
        return "-"
    # Two pseudo-observations keep the error of 0 of 20 from being 0.
    p = (x.sum() + 1) / (len(x) + 2)
    error = max(float(x.std()), float(np.sqrt(p * (1 - p)))) / np.sqrt(len(x))
    return f"{100 * x.mean():5.1f} ± {100 * error:.1f} %  of {len(x)}"


def middle(values: Iterable[float | None]) -> str:
    """A median and its quartiles, of what is known."""
    known = [v for v in values if v is not None]
    if not known:
        return "-"
    low, half, high = np.percentile(known, [25, 50, 75])
    return f"{half:.4f} ({low:.4f} … {high:.4f})"


def figures(suite: str, rows: Sequence[Row]) -> list[tuple[str, str]]:
    """Name and value of every figure of a suite."""
    grades = [row.grade for row in rows]
    found = [v.credit for g in grades for v in g.effects]
    out: list[tuple[str, str]] = []
    if suite == "clean":
        out.append(("flagged", rate(g.flagged for g in grades)))
    else:
        out.append(("named, class and target", rate(c > 0 for c in found)))
        out.append(("credit, shared names divided", rate(found)))
        out.append(("every effect, nothing else", rate(g.right for g in grades)))
        places = [v.place for g in grades for v in g.effects if v.place is not None]
        out.append(("of one channel or arm, it", rate(p > 0 for p in places)))
        out.append(("at least the arm", rate(v.arm > 0 for g in grades for v in g.effects)))
        out.append(("said to be adequate", rate(g.verdict == "adequate" for g in grades)))
        out.append(("said to be explained", rate(g.verdict == "explained" for g in grades)))
        out.append(("explained by another class", rate(g.misled for g in grades)))
    extra = np.array([g.extras for g in grades], dtype=float)
    error = extra.std() / np.sqrt(max(len(extra), 1))
    out.append(("extra names per session", f"{extra.mean():.3f} ± {error:.3f}"))
    for stage, place in (("before", 0), ("after", 1)):
        out.append((f"handle position {stage} [in]", middle(g.position[place] for g in grades)))
    ratios = [r.grade.position[1] / r.told for r in rows if r.told and r.grade.position[1]]
    out.append(("after / told the answer", middle(ratios)))
    out += worse(rows)
    out.append(("trace [s], as many jobs at once", middle(r.seconds for r in rows)))
    for stage, place in (("before", 0), ("after", 1)):
        out.append((f"handle angle {stage} [rad]", middle(g.orientation[place] for g in grades)))
    return out


def worse(rows: Sequence[Row]) -> list[tuple[str, str]]:
    """How often the handle is worse than before by more than a tenth; where the model is told
    the answer it is so by noise alone.
    """
    known = [(r.told, *r.grade.position) for r in rows]
    errors = [(t, b, a) for t, b, a in known if t and b and a]
    return [
        ("after > 1.1 times before", rate(a > 1.1 * b for _, b, a in errors)),
        ("the same, told the answer", rate(t > 1.1 * b for t, b, _ in errors)),
    ]


def confusion(rows: Sequence[Row]) -> list[str]:
    """Lines of `true term  found/of  named as: term count, …`."""
    named: dict[str, Counter[str]] = {}
    credit: dict[str, list[float]] = {}
    for row in rows:
        for v in row.grade.effects:
            named.setdefault(v.term, Counter())[v.named or "nothing"] += 1
            credit.setdefault(v.term, []).append(v.credit)
    lines = []
    for term, counts in named.items():
        right = sum(c > 0 for c in credit[term])
        words = ", ".join(f"{name} {n}" for name, n in counts.most_common())
        lines.append(
            f"  {term:22s} {right:3d}/{len(credit[term]):<3d} "
            f"credit {np.mean(credit[term]):.2f}  named: {words}"
        )
    return lines


def by_strength(rows: Sequence[Row]) -> list[str]:
    """How many are named in each band of noncentrality."""
    pairs = [
        (strength, v.credit)
        for row in rows
        for strength, v in zip(row.strength, row.grade.effects, strict=False)
    ]
    edges = [0, 45, 100, 300, 1000, np.inf]
    lines = []
    for low, high in pairwise(edges):
        credits = [c > 0 for strength, c in pairs if low <= strength < high]
        if credits:
            lines.append(f"  noncentrality {low:5.0f} … {high:<6.0f} named {rate(credits)}")
    return lines


def misses(rows: Sequence[Row]) -> list[str]:
    """The sessions to look at."""
    return [
        f"  {row.suite} {row.number}: {'; '.join(row.truth) or 'clean'}"
        f" -> {', '.join(v.named or 'nothing' for v in row.grade.effects) or 'flagged'}"
        f", {row.grade.verdict}, {row.grade.extras} extra"
        for row in rows
        if (row.grade.flagged if row.suite == "clean" else not row.grade.right)
    ]


def report(suite: str, rows: Sequence[Row]) -> str:
    """What is printed of a suite."""
    lines = [f"== {suite}: {len(rows)} sessions"]
    lines += [f"  {name:30s} {value}" for name, value in figures(suite, rows)]
    lines += confusion(rows) + by_strength(rows)
    return "\n".join(lines)


def sessions(suite: str, count: int, jobs: int, seed: int, size: Size) -> list[Row]:
    """All rows of a suite, in order."""
    work = partial(run, suite, seed=seed, size=size)
    if jobs == 1:
        return [work(number) for number in range(count)]
    with multiprocessing.get_context("spawn").Pool(jobs) as pool:
        return pool.map(work, range(count), chunksize=1)


def main(arguments: Sequence[str] | None = None) -> int:
    """The command."""
    parser = argparse.ArgumentParser(prog="python -m tests.blind.run", description=__doc__)
    parser.add_argument("--suite", choices=[*SUITES, "all"], default="all")
    parser.add_argument("--sessions", type=int, default=40)
    parser.add_argument("--jobs", type=int, default=1)
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--floor", type=float, default=FLOOR, help="least noncentrality")
    parser.add_argument("--exactly", action="store_true", help="all effects at that noncentrality")
    parser.add_argument("--misses", action="store_true", help="list the sessions that failed")
    parser.add_argument("--out", type=Path, help="write every graded session, one JSON per line")
    options = parser.parse_args(arguments)
    every: list[Row] = []
    size = Size(options.floor, options.exactly)
    for suite in SUITES if options.suite == "all" else (options.suite,):
        rows = sessions(suite, options.sessions, options.jobs, options.seed, size)
        print(report(suite, rows), flush=True)
        if options.misses:
            print("\n".join(misses(rows)), flush=True)
        every += rows
    if options.out:
        lines = [json.dumps(asdict(row)) + "\n" for row in every]
        write_text(options.out, "".join(lines))
    return 0


if __name__ == "__main__":
    sys.exit(main())
