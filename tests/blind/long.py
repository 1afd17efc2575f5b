"""Long recordings, which are searched by stretches: what is named in each.

`python -m tests.blind.long --rows 20000 --sessions 40` prints how many sessions of each kind are
traced as they should be; all of them at 20,000 rows take half an hour.
"""

from __future__ import annotations

import argparse
from dataclasses import dataclass
from typing import Any

import numpy as np

import rsicalib
from tests.blind import effects, simulator
from tests.blind.effects import Effect
from tests.blind.simulator import CHANNELS, Device
from tests.oracle import Array

KINDS = ("clean", "untimed", "correlated", "ripple", "sag", "slip", "bad", "two")
STEP = 40
"""By how many counts a channel slips."""
OFF = 60
"""By how many counts a bad reading is off."""
BAD = 3
"""Bad rows of a session."""


@dataclass(frozen=True)
class Recording:
    """A long recording: what was done to it, and what a trace should name of it."""

    kind: str
    readings: Any
    rest: Any
    names: frozenset[str]
    """Terms and targets; of a slip with its row, counted from 1."""
    out: frozenset[int] = frozenset()
    """Rows that are wrong, counted from 1."""


def make(kind: str, rows: int, seed: int, alike: float | None = None) -> Recording:
    """The same for the same seed; noise of which a row shares `alike` with the one before.

    Where it is not given half is shared in `correlated`, and nothing in the other kinds.
    """
    rng = np.random.default_rng([seed, KINDS.index(kind), rows])
    device = Device.random(rng)
    present = present_in(kind, rng)
    made = simulator.recording(device, rng, rows / 200.0, effects=present)
    values, time_s = made["values"], made["time_s"]
    names = {f"{named(e)} {e.target}" for e in present}
    out: frozenset[int] = frozenset()
    alike = alike if alike is not None else 0.5 * (kind == "correlated")
    if alike:
        ideal = device.ideal(made["scene"], present)
        values = np.rint(ideal + resembling(rng, ideal.shape, alike)).astype(np.int64)
    if kind == "slip":
        channel, row = int(rng.integers(9)), int(rng.integers(rows // 4, 3 * rows // 4))
        values[row:, channel] += STEP
        names = {f"slip {CHANNELS[channel]} {row + 1}"}
    if kind == "bad":
        bad = np.sort(rng.choice(rows, BAD, replace=False))
        values[bad, rng.integers(9, size=BAD)] += OFF * rng.choice([-1, 1], BAD)
        out = frozenset(int(row) + 1 for row in bad)
    mechanism = rsicalib.load_mechanism("rsi")
    timed = None if kind == "untimed" else time_s
    readings = rsicalib.Readings.from_arrays(mechanism, values, time_s=timed)
    rest = simulator.rest(device, rng, effects=present)["values"]
    held = rsicalib.Readings.from_arrays(mechanism, rest)
    return Recording(kind, readings, held, frozenset(names), out)


def present_in(kind: str, rng: np.random.Generator) -> tuple[Effect, ...]:
    """Effects of a session."""
    ripple = effects.Ripple("a22", 0.003, wave=float(rng.uniform(120, 200)))
    sag = effects.Sag("all", 0.002)
    return {"ripple": (ripple,), "sag": (sag,), "two": (ripple, sag)}.get(kind, ())


def named(effect: Effect) -> str:
    """The term of the library that does what an effect does."""
    return "n_per_turn" if isinstance(effect, effects.Ripple) else effect.term


def resembling(rng: np.random.Generator, shape: tuple[int, ...], alike: float) -> Array:
    """Noise of one count of which a row shares so much with the row before."""
    noise: Array = rng.standard_normal(shape)
    for row in range(1, len(noise)):
        noise[row] = alike * noise[row - 1] + (1.0 - alike**2) ** 0.5 * noise[row]
    return noise


def said(traced: Any) -> tuple[frozenset[str], frozenset[int]]:
    """What a trace names, and which rows it leaves out."""
    slips = {s.term: f" {s.place}" for s in traced.steps if s.term == "slip"}
    names = frozenset(f"{s.term} {s.target}{slips.get(s.term, '')}" for s in traced.steps)
    return names, frozenset(e.pose for e in traced.excluded)


def right(it: Recording, traced: Any) -> bool:
    """Whether that is what there is, and nothing else."""
    names, out = said(traced)
    return names == it.names and out == it.out


def main() -> None:
    """Traces sessions of every kind."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--rows", type=int, default=20_000)
    parser.add_argument("--sessions", type=int, default=40)
    parser.add_argument("--kind", choices=KINDS, action="append")
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--alike", type=float, help="what a row shares with the one before")
    options = parser.parse_args()
    for kind in options.kind or KINDS:
        count = 0
        for number in range(options.sessions):
            it = make(kind, options.rows, options.seed + number, options.alike)
            traced = rsicalib.trace(it.readings, rest=it.rest)
            fine = right(it, traced)
            count += fine
            if not fine:
                there = sorted(it.names) + sorted(it.out)
                print(
                    f"  {kind} {options.seed + number}: {there}, said {traced.verdict}, "
                    f"{[sorted(s) for s in said(traced)]}",
                    flush=True,
                )
        print(f"{kind}: {count} of {options.sessions} right", flush=True)


if __name__ == "__main__":
    main()
