"""The table of all measured robots: `python benches/measured.py`, writes `docs/measured.md`.

Needs the folder of the data, `--data ../shared/data/mukca`: one CSV per robot, `panda.urdf` or
`gen3lite.urdf` beside it. A robot that the table does not know is fitted on its first group.
Every figure is from `rsicalib.calibrate` and `rsicalib.trace` as a user would call them, with the
mechanism files of `examples/`; nothing is tuned for a robot.
"""

from __future__ import annotations

import argparse
import csv
import shutil
import sys
import tempfile
from collections import Counter
from collections.abc import Iterator
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

if __name__ == "__main__":
    sys.path[0] = str(Path(__file__).parent.parent)  # not benches: a file there may hide a module

import rsicalib
from rsicalib.io.files import write_text
from tests.drawings import as_typical

HERE = Path(__file__).parents[1]
MM = 1e3


@dataclass(frozen=True)
class Case:
    """A robot, the groups it is fitted on, and those that are left out altogether."""

    robot: str
    fitted: tuple[str, ...]
    dropped: tuple[str, ...] = ()
    published: str = ""
    """What the authors reach."""


KNOWN = (
    Case("panda_1", ("front", "right"), published="0.303 / 0.922"),
    Case("panda_2", ("front_center",)),
    Case("panda_2", ("front_center",), ("high",), published="0.168 / 0.347"),
    Case("panda_3", ("frontcenter",), published="0.151 / 0.238"),
    Case("panda_3", ("frontcenter", "backleft", "backright"), published="0.174 / 0.211"),
    Case("panda_4", ("front",), published="0.161 / 0.360"),
)


@dataclass
class Row:
    """What came out of one case."""

    case: Case
    figures: dict[str, str] = field(default_factory=dict)
    traces: dict[str, list[str]] = field(default_factory=dict)
    """By what was fitted: cells of the drawing's gravity, then of that along y."""
    errors: list[str] = field(default_factory=list)

    @property
    def robot(self) -> str:
        """Its name, with what was dropped."""
        dropped = self.case.dropped
        return self.case.robot + (f" without {', '.join(dropped)}" if dropped else "")


class Workshop:
    """A folder with the mechanism files and the robot descriptions that they refer to."""

    def __init__(self, data: Path, folder: Path) -> None:
        self.data, self.folder = data, folder
        for file in [*data.glob("*.urdf"), *data.glob("*.toml")]:
            shutil.copy(file, folder)
        for name in ("panda", "gen3lite"):
            text = (HERE / "examples" / f"mukca_{name}.toml").read_text()
            write_text(folder / f"{name}.toml", text)
            turned = text.replace("gravity = [0, 0, -1]", "gravity = [0, 1, 0]")
            write_text(folder / f"{name}_y.toml", turned)

    def mechanism(self, robot: str, turned: bool = False) -> Path:
        """The file of a robot's kind; `turned`: with gravity along y."""
        kind = "gen3lite" if robot.startswith("dinova") else "panda"
        return self.folder / f"{kind}{'_y' if turned else ''}.toml"

    def readings(self, case: Case) -> rsicalib.Readings:
        """Those of a robot, without the groups that are dropped."""
        file = self.data / f"{case.robot}.csv"
        loaded = rsicalib.load_readings(file, self.mechanism(case.robot))
        return loaded.select([group not in case.dropped for group in loaded.keys["group"]])

    def cases(self) -> Iterator[Case]:
        """Those of the table, then every robot that it does not have."""
        for file in sorted(self.data.glob("*.csv")):
            own = [case for case in KNOWN if case.robot == file.stem]
            with file.open(encoding="utf-8", newline="") as lines:
                groups = list(dict.fromkeys(row["group"] for row in csv.DictReader(lines)))
            yield from own or [Case(file.stem, (groups[0],))]


def measure(shop: Workshop, case: Case) -> Row:
    """All figures of one case."""
    row = Row(case)
    readings = shop.readings(case)
    fitted = list(case.fitted)
    chi2: dict[str, float] = {}
    out: dict[str, set[tuple[int | None, int | None]]] = {}
    for name, turned, loaded in (
        ("typical sizes", False, False),
        ("geometry", False, False),
        ("compliance", False, True),
        ("control", True, True),
    ):
        mechanism = rsicalib.load_mechanism(shop.mechanism(case.robot, turned))
        terms = mechanism.to_dict()["model"]["terms"]
        terms = [*terms, "joint_compliance"] if loaded else terms
        try:
            population = as_typical(mechanism) if name == "typical sizes" else None
            found = rsicalib.calibrate(
                readings, mechanism, fit_groups=fitted, terms=terms, population=population
            )
        except rsicalib.RsicalibError as error:
            row.figures[name] = "not found"
            row.errors.append(f"{row.robot}, {name}: {error}")
            continue
        assert found.groups is not None
        row.figures["nominal"] = pair(found.groups.nominal_fitted, found.groups.nominal_others, 2)
        row.figures[name] = pair(found.groups.fitted, found.groups.others, 3)
        if name == "typical sizes":
            continue
        if found.verdict == "undetermined":
            row.errors.append(f"{row.robot}, {name}: {found.termination}")
        if name == "compliance":
            signs = [w.target for w in found.warnings if w.kind == "unphysical_sign"]
            row.figures["negative"] = ", ".join(filter(None, signs)) or "–"
        if found.fit.chi2 is not None:
            chi2[name] = found.fit.chi2
            out[name] = {(left.pose, left.sample) for left in found.excluded}
        if name == "geometry" and found.fit.p_value is not None:
            p_value = found.fit.p_value
            row.figures["chi2"] = f"{found.fit.chi2:.0f} / {found.fit.dof:.0f}"
            row.figures["p"] = "< 1e-300" if p_value < 1e-300 else f"{p_value:.1g}"
    everything = rsicalib.calibrate(readings, shop.mechanism(case.robot))
    if everything.between is not None and everything.between.halves is not None:
        halves = everything.between.halves
        row.figures["halves"] = f"{halves.chi2_within:.2f} / {halves.chi2_between:.2f}"
    if len(chi2) == 3:
        falls = [
            f"{chi2['geometry'] - chi2[name]:.0f}" if out[name] == out["geometry"] else "–"
            for name in ("compliance", "control")
        ]
        row.figures["falls"] = " / ".join(falls)
    trace(shop, row, readings)
    return row


def short(shop: Workshop, case: Case) -> str:
    """A line of the groups that were not fitted: typical sizes, sizes estimated, traced."""
    readings, fitted = shop.readings(case), list(case.fitted)
    mechanism = rsicalib.load_mechanism(shop.mechanism(case.robot))
    verbs = (
        rsicalib.calibrate(
            readings, mechanism, fit_groups=fitted, population=as_typical(mechanism)
        ),
        rsicalib.calibrate(readings, mechanism, fit_groups=fitted),
        rsicalib.trace(readings, mechanism, fit_groups=fitted),
    )
    others = [found.groups.others if found.groups is not None else None for found in verbs]
    robot = Row(case).robot
    figures = ["–" if v is None else f"{v * MM:.3f}" for v in others]
    return f"| {' | '.join([robot, ', '.join(fitted), *figures])} |"


def trace(shop: Workshop, row: Row, readings: rsicalib.Readings) -> None:
    """What tracing the residual finds, on the groups fitted and on all of them."""
    everything = list(dict.fromkeys(readings.keys["group"]))
    for what, fitted in (("fitted groups", list(row.case.fitted)), ("all groups", everything)):
        if what == "all groups" and fitted == list(row.case.fitted):
            continue
        for turned in (False, True):
            try:
                mechanism = shop.mechanism(row.case.robot, turned)
                found = rsicalib.trace(readings, mechanism, fit_groups=fitted)
            except rsicalib.RsicalibError as error:
                row.errors.append(f"{row.robot}, trace of {what}: {error}")
                continue
            verdict = (found.verdict or "not judged").replace("_", " ")
            cells = [verdict, effects(found), applied(found)]
            if turned:
                row.traces.setdefault(what, []).extend(cells)
                continue
            row.traces[what] = [*cells, left_out(found), left(found)]
            if found.groups is None:
                continue
            if what == "fitted groups":
                row.figures["traced"] = pair(found.groups.fitted, found.groups.others, 3)
            count = sum(e.samples or 0 for e in found.excluded)
            row.figures[what] = f"{verdict}, {count}"


def effects(found: rsicalib.Trace) -> str:
    """What is named, in brackets where it is not applied, and what ties with it."""
    parts = []
    for step in found.steps:
        name = f"{step.term}@{step.target}"
        also = " = ".join(f"{a.term}@{a.target}" for a in step.also_fits)
        parts.append((name if step.applied else f"({name})") + (f" = {also}" if also else ""))
    return ", ".join(parts) or "–"


def applied(found: rsicalib.Trace) -> str:
    """Errors on blocks that were left out: without effects, used, found again."""
    e = found.elsewhere
    if e is None:
        return "–"
    return " / ".join(f"{MM * v:.3f}" for v in (e.without, e.applied, e.again) if v is not None)


def left_out(found: rsicalib.Trace) -> str:
    """How many samples were left out, by place and kind."""
    counts: Counter[tuple[str, str]] = Counter()
    for e in found.excluded:
        counts[e.group or str(e.pose), e.kind.replace("_", " ")] += e.samples or 0
    return "; ".join(f"{place}: {n} {kind}" for (place, kind), n in counts.items()) or "–"


def left(found: rsicalib.Trace) -> str:
    """What is left, where, and on what a law that no term has would depend."""
    u = found.unexplained
    if u is None:
        return "–"
    law = " and ".join(d.variable for d in u.depends_on)
    return " ".join(filter(None, [u.kind, u.target, law and f"({law})"])).replace("_", " ")


def pair(fitted: float | None, others: float | None, digits: int) -> str:
    """Millimetres, fitted groups / other groups."""
    words = ["–" if v is None else f"{v * MM:.{digits}f}" for v in (fitted, others)]
    return " / ".join(words)


HEAD = """\
# Measured: real arms that touch sockets

Made by `python benches/measured.py`; the README of `mukca` describes the data and their source. A
ball on the tool rests in one of two sockets of a plate that was moved between groups; only joint
angles are known. Fit: `rsicalib.calibrate(readings, mechanism, fit_groups=…)`.

The measure is the authors': for each group the mean distance of the predicted ball from its own
mean at its socket, sockets weighted by their samples; then a plain mean over groups. In mm, groups
that were fitted / all others. **Closure is not accuracy**: there are no check poses here. A model
that repeats sockets it has not seen is the better one; how far it is off in the room is not known.

- *Geometry, typical sizes* draws all frames towards the drawing as errors of typical sizes ask;
  *geometry*, and all columns after it, estimates how large the errors of this drawing are, (153) of
  [the model](model.md).
- *Control* is `+ compliance` with gravity along y: as many parameters, with no physics. A gain that
  it has too is not from weight. χ² falls are told where both leave out the same samples.
- *Traced* is `rsicalib.trace(…)` from the geometry, of the fitted groups; nobody tells it of
  compliance. The next columns are its verdict and how many samples it left out, on the fitted
  groups and on all of them.
- *Halves* are χ² per parameter of the difference between two halves of all placements, by what is
  within placements, and with what changes between them; [Intervals,
  counted](intervals.md#between-placements) says what to expect of the second.
"""

TRACES = """\
## What the traces find

An effect in brackets is named and not applied: it does not help on blocks that were left out of the
fitted groups, the search made again without them. After `=` stands what fits as well. *Blocks* are
errors there in mm: without effects / with what is applied / with what is found again (not for
parts of the workspace). *Left out*: samples, by place and kind. *Left*: what is left, where, and in
brackets on what a law that no term has would depend. The columns *along y* are the same trace with
gravity along y, which has no physics.
"""

COLUMNS = {
    "nominal": "nominal",
    "typical sizes": "geometry, typical sizes",
    "geometry": "geometry",
    "compliance": "+ compliance",
    "control": "control",
    "traced": "traced",
    "fitted groups": "verdict, left out",
    "all groups": "all groups",
    "halves": "halves",
}

LEAVES = {
    "chi2": "χ² of geometry / degrees of freedom",
    "p": "p",
    "falls": "χ² falls by compliance / by the control",
    "negative": "compliance that is negative, and so stands for something else",
}

TRACED = ("verdict", "effects", "blocks", "left out", "left")


def page(rows: list[Row]) -> str:
    """The Markdown page."""
    lines = [HEAD, "## Every robot", ""]
    lines += head("robot", "fitted on", "authors", *COLUMNS.values())
    for row in rows:
        figures = [row.figures.get(k, "–") for k in COLUMNS]
        fitted = ", ".join(row.case.fitted)
        lines.append(cells(row.robot, fitted, row.case.published or "–", *figures))
    lines += ["", "## What geometry leaves", "", *head("robot", "fitted on", *LEAVES.values())]
    for row in rows:
        figures = [row.figures.get(k, "–") for k in LEAVES]
        lines.append(cells(row.robot, ", ".join(row.case.fitted), *figures))
    columns = [*TRACED, *(f"{name} along y" for name in TRACED[:3])]
    lines += ["", TRACES, *head("robot", "groups", *columns)]
    traced = []
    for row in rows:
        for what, found in row.traces.items():
            groups = ", ".join(row.case.fitted) if what == "fitted groups" else "all"
            traced.append(cells(row.robot, groups, *found))
    lines += list(dict.fromkeys(traced))
    errors = [f"- {' '.join(error.split())}" for row in rows for error in row.errors]
    return "\n".join([*lines, *(["", *errors] if errors else [])]) + "\n"


def head(*names: str) -> list[str]:
    """The first two lines of a table."""
    return [cells(*names), "|---" * len(names) + "|"]


def cells(*words: str) -> str:
    """A line of a table."""
    return f"| {' | '.join(words)} |"


def main(argv: list[str] | None = None) -> int:
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("--data", type=Path, default=HERE.parent / "shared" / "data" / "mukca")
    parser.add_argument("--out", type=Path, default=HERE / "docs" / "measured.md")
    parser.add_argument("--short", action="store_true", help="groups not fitted, printed alone")
    parser.add_argument("--robot", action="append", help="only this one; may be repeated")
    args = parser.parse_args(argv)
    if not args.data.is_dir():
        print("error: found no folder of measured data, expected --data DIR", file=sys.stderr)
        return 2
    rows: list[Row] = []
    with tempfile.TemporaryDirectory() as folder:
        shop = Workshop(args.data, Path(folder))
        for case in shop.cases():
            if args.robot and case.robot not in args.robot:
                continue
            if args.short:
                print(short(shop, case), flush=True)
                continue
            rows.append(measure(shop, case))
            figures: dict[str, Any] = rows[-1].figures
            print(case.robot, ",".join(case.fitted), figures, file=sys.stderr, flush=True)
    if not args.short:
        write_text(args.out, page(rows))
        print(args.out)
    return 0


if __name__ == "__main__":
    sys.exit(main())
