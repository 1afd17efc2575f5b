"""How often clean sessions are called otherwise than adequate: `python -m tests.clean`.

Draws sessions of the hand controller in which nothing is missing, by the simulator of
`tests/blind`, traces each, and counts what is called otherwise: by the search, by the residual, by
poses left out in turn, and together. `docs/limits.md` has the figures.
"""

from __future__ import annotations

import argparse
import json
import sys
from collections.abc import Iterable, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path

import numpy as np

import rsicalib
from rsicalib.work.closing import open_loops
from tests.blind.trials import given, make


@dataclass(frozen=True)
class Clean:
    """What is said of a clean session."""

    number: int
    verdict: str
    named: bool
    """An effect, or a bad reading."""
    residual: float | None
    """Probability of the residual as asked for."""
    held_out: float | None
    """Probability of the error on poses left out in turn."""
    open_loops: bool = False
    """Whether the loops of its check readings are called open."""

    @property
    def called(self) -> bool:
        """Whether it is called otherwise than adequate, or not whole."""
        return self.named or self.verdict != "adequate"


def judged(number: int, seed: int = 0) -> Clean:
    """One clean session."""
    it = given(make("clean", number, seed))
    result = rsicalib.trace(it.readings, it.mechanism, rest=it.rest)
    named = bool(result.steps or result.excluded)
    held_out = getattr(result.before.held_out, "p_value", None)
    opened = open_loops(it.check, it.mechanism, result) is not None
    return Clean(number, result.verdict, named, result.before.p_value, held_out, opened)


def rate(values: Iterable[bool]) -> str:
    """A share in per cent with its standard error."""
    x = np.fromiter(values, dtype=bool)
    p = (x.sum() + 1) / (len(x) + 2)
    return f"{100 * x.mean():.2f} ± {100 * np.sqrt(p * (1 - p) / len(x)):.2f} %  of {len(x)}"


def main(arguments: Sequence[str] | None = None) -> int:
    """The command."""
    parser = argparse.ArgumentParser(prog="python -m tests.clean", description=__doc__)
    parser.add_argument("--sessions", type=int, default=1200)
    parser.add_argument("--first", type=int, default=0)
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--out", type=Path, help="write a line of JSON for each session")
    options = parser.parse_args(arguments)
    found = []
    for number in range(options.first, options.first + options.sessions):
        found.append(judged(number, options.seed))
        if options.out:
            with options.out.open("a") as file:
                file.write(json.dumps(asdict(found[-1])) + "\n")
    print(f"called otherwise than adequate   {rate(one.called for one in found)}")
    print(f"an effect or a bad reading named {rate(one.named for one in found)}")
    print(f"loops of check readings open     {rate(one.open_loops for one in found)}")
    return 0


if __name__ == "__main__":
    sys.exit(main())
