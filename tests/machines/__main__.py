"""Simulated machines of every closure, traced and graded, in pieces.

    python -m tests.machines --machine belts --suite clean --count 50 --records belts.jsonl
    python -m tests.machines --table belts.jsonl

Every trial has a seed of its own: pieces may run in any order, on any number of machines. A trial
whose record is in the file already is not run again. `--files FOLDER` keeps the files of each.
"""

from __future__ import annotations

import argparse
import json
import multiprocessing
import sys
from collections import Counter
from collections.abc import Iterable, Iterator, Sequence
from pathlib import Path
from time import perf_counter

from tests.families.tables import cell
from tests.machines.trials import MACHINES, SUITES, Asked, Record, work


def key(record: Record) -> Asked:
    """What makes a trial."""
    return record["machine"], record["suite"], record["number"], record["seed"]


def load(files: Iterable[Path]) -> list[Record]:
    """The records of files, the last of each trial."""
    found: dict[Asked, Record] = {}
    for file in files:
        for line in file.read_text(encoding="utf-8").splitlines():
            record = json.loads(line)
            found[key(record)] = record
    return list(found.values())


def table(records: Sequence[Record]) -> list[str]:
    """Lines of the table in Markdown: of every machine what was asked, and how often it was so."""
    lines = ["| machine | suite | | |", "|---|---|---|---|"]
    for name in MACHINES:
        for suite in SUITES:
            own = [r for r in records if (r["machine"], r["suite"]) == (name, suite)]
            lines += [f"| {name} | {suite} | {what} | {how} |" for what, how in figures(own)]
    return lines


def figures(own: Sequence[Record]) -> Iterator[tuple[str, str]]:
    """What is counted of trials of one machine and suite."""
    if not own:
        return
    done = [r for r in own if "verdict" in r]
    for what, word in (("flagged: not adequate", "flagged"), ("named", "named")):
        if done and word in done[0]:
            yield what, cell([r[word] for r in done])
    if done and "among" in done[0]:
        yield "named, or in the tie", cell([r["among"] for r in done])
        for kind in sorted({r["kind"] for r in done}):
            yield f"the same, {kind}", cell([r["among"] for r in done if r["kind"] == kind])
    if done and "among" in done[0]:
        yield "extra names", f"{sum(r.get('extras', 0) for r in done)} of {len(done)} machines"
    within = [r["covered"] for r in done if r.get("covered") and r["covered"][1]]
    if within:
        hits, of = (sum(c[k] for c in within) for k in (0, 1))
        each = [c[0] / c[1] for c in within]
        spread = (sum((e - hits / of) ** 2 for e in each) / len(each) / max(1, len(each))) ** 0.5
        yield (
            "parameters in their 95 % interval",
            (f"{100 * hits / of:.1f} ± {100 * spread:.1f} %, {hits} of {of}"),
        )
    for word in ("refused", "crashed"):
        if any(word in r for r in own):
            yield word, cell([word in r for r in own])
    verdicts = Counter(r.get("verdict", "none") for r in own).most_common()
    yield "verdicts", ", ".join(f"{name} {count}" for name, count in verdicts)


def wrong(record: Record) -> bool:
    """Whether a trial went wrong."""
    return "verdict" not in record or bool(record.get("flagged")) or not record.get("among", True)


def main(arguments: Sequence[str] | None = None) -> int:
    """The command."""
    parser = argparse.ArgumentParser(
        "python -m tests.machines",
        description=__doc__,
        formatter_class=argparse.RawTextHelpFormatter,
    )
    parser.add_argument("--machine", choices=[*MACHINES, "all"], default="all")
    parser.add_argument("--suite", choices=[*SUITES, "all"], default="all")
    parser.add_argument("--first", type=int, default=0)
    parser.add_argument("--count", type=int, default=20, help="trials of each")
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--jobs", type=int, default=1)
    parser.add_argument("--minutes", type=float, help="begin no other trial after so long")
    parser.add_argument("--records", type=Path, help="append a line of JSON for each trial")
    parser.add_argument("--files", type=Path, help="keep readings and mechanisms here")
    parser.add_argument("--table", type=Path, nargs="+", help="run nothing: the table of records")
    options = parser.parse_args(arguments)
    if options.table:
        print("\n".join(table(load(options.table))))
        return 0
    names = list(MACHINES) if options.machine == "all" else [options.machine]
    suites = list(SUITES) if options.suite == "all" else [options.suite]
    there = load([options.records]) if options.records and options.records.exists() else []
    known = {key(record) for record in there}
    numbers = range(options.first, options.first + options.count)
    asked = [(m, s, k, options.seed) for k in numbers for m in names for s in suites]
    found = list(there)
    for record in trials([a for a in asked if a not in known], options):
        found.append(record)
        if options.records:
            with options.records.open("a", encoding="utf-8") as file:
                file.write(json.dumps(record) + "\n")
        if wrong(record):
            print(json.dumps(record), file=sys.stderr, flush=True)
    print("\n".join(table([r for r in found if key(r) in set(asked)])))
    return 0


def trials(asked: Sequence[Asked], options: argparse.Namespace) -> Iterator[Record]:
    """The trials in their order, as long as there is time."""
    end = perf_counter() + 60 * (options.minutes or 1e9)
    if options.jobs == 1:
        for one in asked:
            if perf_counter() > end:
                return
            yield work(one, options.files)
        return
    with multiprocessing.get_context("spawn").Pool(options.jobs) as pool:
        for first in range(0, len(asked), 4 * options.jobs):
            if perf_counter() > end:
                return
            turn = [(one, options.files) for one in asked[first : first + 4 * options.jobs]]
            yield from pool.starmap(work, turn, chunksize=1)


if __name__ == "__main__":
    sys.exit(main())
