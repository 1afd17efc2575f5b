"""Writes `data.rs` from NIST's files, so that no figure is typed by hand.

    python transcribe.py FOLDER > data.rs

`FOLDER` holds the 27 `.dat` files of the Statistical Reference Datasets,
nonlinear regression, as published at
https://www.itl.nist.gov/div898/strd/nls/nls_main.shtml (public domain).
"""

import re
import sys
import textwrap
from dataclasses import dataclass
from pathlib import Path

# The function of `models.rs` for each model; the others are called as their problem.
SHARED = {
    "BoxBOD": "saturation",
    "Misra1a": "saturation",
    "Chwirut1": "chwirut",
    "Chwirut2": "chwirut",
    "Gauss1": "gauss",
    "Gauss2": "gauss",
    "Gauss3": "gauss",
    "Hahn1": "cubic_over_cubic",
    "Thurber": "cubic_over_cubic",
    "Lanczos1": "lanczos",
    "Lanczos2": "lanczos",
    "Lanczos3": "lanczos",
}

NUMBER = r"[-+]?(?:\d+\.?\d*|\.\d+)(?:E[-+]?\d+)?"


@dataclass(frozen=True)
class Problem:
    """One file: what to fit, from where, and the certified answer."""

    name: str
    response: str
    """The left side of the model: `y`, or `log[y]`."""
    formula: str
    """The right side of the model, without the error term."""
    starts: tuple[list[float], list[float]]
    certified: list[float]
    sd: list[float]
    rss: float
    residual_sd: float
    data: list[tuple[float, list[float]]]
    """The response as measured, and the predictors."""


def read(path: Path) -> Problem:
    """Reads one `.dat` file; what it says of itself must agree with what it holds."""
    text = path.read_text(encoding="ascii")
    lines = text.splitlines()

    parameters = re.findall(r"^ *b\d+ *=" + rf" +({NUMBER})" * 4 + " *$", text, re.MULTILINE)
    columns = zip(*parameters, strict=True)
    start_1, start_2, certified, sd = ([float(v) for v in column] for column in columns)

    first, last = map(int, _one(r"^ +Data +\(lines +(\d+) to +(\d+)\)", text))
    rows = [[float(word) for word in line.split()] for line in lines[first - 1 : last]]
    data = [(row[0], row[1:]) for row in rows]

    # The model: the lines below its number of parameters, without `pi = ...`.
    below = re.split(r"Parameters? \(.*\)\n", text)[1]
    model = " ".join(
        line.strip()
        for line in re.split(r"Starting [vV]alues", below)[0].splitlines()
        if not line.strip().startswith("pi =")
    )
    response, formula = re.fullmatch(r" *(\S+) *= *(.*?) *\+ *e *", model).groups()

    # Their degrees of freedom are not read: Rat43's file prints 9 where its own
    # residual standard deviation says 15 - 4 = 11 (a Rust test compares them all).
    (observations,) = _one(r"^Number of Observations: +(\d+)", text)
    (count,) = _one(r"^ +(\d+) Parameters", text)
    assert len(data) == int(observations), path
    assert len(certified) == int(count), path
    assert len({len(row) for row in rows}) == 1, path

    return Problem(
        name=_one(r"^Dataset Name: +(\S+)", text)[0],
        response=response,
        formula=re.sub(" +", " ", formula),
        starts=(start_1, start_2),
        certified=certified,
        sd=sd,
        rss=float(_one(rf"^Residual Sum of Squares: +({NUMBER})", text)[0]),
        residual_sd=float(_one(rf"^Residual Standard Deviation: +({NUMBER})", text)[0]),
        data=data,
    )


def read_all(folder: Path) -> list[Problem]:
    """Reads all problems, by name."""
    problems = [read(path) for path in sorted(folder.glob("*.dat"))]
    assert len(problems) == 27, f"{folder} has {len(problems)} problems; there are 27"
    return problems


def _one(pattern: str, text: str) -> tuple[str, ...]:
    (match,) = re.finditer(pattern, text, re.MULTILINE)
    return match.groups()


def _rust(problem: Problem) -> str:
    """One `Strd` in Rust. `repr` is the shortest text that reads back as the same double."""
    model = SHARED.get(problem.name, problem.name.lower())
    response = {"y": "std::convert::identity", "log[y]": "f64::ln"}[problem.response]
    rows = ", ".join(f"({y!r}, &{x!r})" for y, x in problem.data)
    # A row is one word to the wrapper: a line never ends inside one.
    rows = textwrap.fill(
        re.sub(r"\([^)]*\)", lambda row: row[0].replace(" ", "\0"), rows) + ",",
        width=100,
        initial_indent=" " * 12,
        subsequent_indent=" " * 12,
        break_long_words=False,
        break_on_hyphens=False,
    ).replace("\0", " ")
    return f"""\
    // {problem.response} = {problem.formula} + e
    Strd {{
        name: "{problem.name}",
        starts: [&{problem.starts[0]!r}, &{problem.starts[1]!r}],
        certified: &{problem.certified!r},
        sd: &{problem.sd!r},
        rss: {problem.rss!r},
        residual_sd: {problem.residual_sd!r},
        data: &[
{rows}
        ],
        response: {response},
        model: models::{model},
    }},
"""


def main() -> None:
    problems = read_all(Path(sys.argv[1]))
    print("//! The figures of NIST's files. Written by `transcribe.py`; do not edit.")
    print()
    print("use super::{Strd, models};")
    print()
    print("/// The 27 problems, by name.")
    print(f"pub static ALL: [Strd; {len(problems)}] = [")
    print("".join(_rust(problem) for problem in problems), end="")
    print("];")


if __name__ == "__main__":
    main()
