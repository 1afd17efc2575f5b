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
from typing import Any

import numpy as np

import rsicalib
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
    level: float | None
    """Of `alpha`, the least at which something is still named; None where nothing is."""

    @property
    def called(self) -> bool:
        """Whether it is called otherwise than adequate, or not whole."""
        return self.named or self.verdict != "adequate"


LEVELS = (0.012, 0.008, 0.005, 0.0033, 0.002, 0.001)


def judged(number: int, seed: int = 0, alpha: float | None = None) -> Clean:
    """One clean session."""
    it = given(make("clean", number, seed))

    def traced(alpha: float | None) -> Any:
        return rsicalib.trace(it.readings, it.mechanism, rest=it.rest, alpha=alpha)

    result = traced(alpha)
    named = bool(result.steps or result.excluded)
    level = None
    if named and alpha is not None:
        level = alpha
        for lower in (a for a in LEVELS if a < alpha):
            if not (again := traced(lower)).steps and not again.excluded:
                break
            level = lower
    held_out = getattr(result.before.held_out, "p_value", None)
    return Clean(number, result.verdict, named, result.before.p_value, held_out, level)


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
    parser.add_argument("--alpha", type=float, help="of the search")
    parser.add_argument("--out", type=Path, help="write a line of JSON for each session")
    options = parser.parse_args(arguments)
    found = []
    for number in range(options.first, options.first + options.sessions):
        found.append(judged(number, options.seed, options.alpha))
        if options.out:
            with options.out.open("a") as file:
                file.write(json.dumps(asdict(found[-1])) + "\n")
    print(f"called otherwise than adequate   {rate(one.called for one in found)}")
    print(f"an effect or a bad reading named {rate(one.named for one in found)}")
    return 0


if __name__ == "__main__":
    sys.exit(main())
