"""How a follower follows its leader, in plain numpy: `python -m tests.machines.teleop DATA`.

Joint by joint, percent F of the follower on percent L of the leader:

    F(t) + T F'(t) = o + g L(t - τ) + h sign(L'(t - τ))

τ is a delay (messages, a loop of control), T the time constant of a servo, h what it stands short
of its goal in the direction of its motion (play, friction), g and o the ranges. Intervals are those
of a bootstrap of blocks of one second: what is left is alike over many rows.
"""

from __future__ import annotations

import argparse
import csv
import tempfile
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import numpy as np

import rsicalib
from tests.oracle import Array

JOINTS = ("shoulder_pan", "shoulder_lift", "elbow_flex", "wrist_flex", "wrist_roll")
CLAMP = 99.9
"""Percents beyond are stops of the range, and say nothing."""
ARRIVED = 12
"""Rows after which the follower of an episode has come to where its leader waits."""
LAGS = np.arange(0.0, 9.01, 0.1)
"""Delays that are tried [rows]."""
BLOCK_S = 1.0
DRAWS = 200
SLOW = 4.0
"""Below so many percents a second the direction of motion is blurred by the steps of encoders."""
NAMES = ("shift", "delay", "T", "h", "g", "o")


@dataclass(frozen=True)
class Recording:
    """One joint of one episode: time [s], leader and follower [percent]."""

    time: Array
    leader: Array
    follower: Array

    @property
    def step(self) -> float:
        """From row to row [s]."""
        return float(np.median(np.diff(self.time)))

    def equations(self, lag: float, whole: bool) -> tuple[Array, Array]:
        """Columns and right sides of the rows that say something, the same ones for all lags."""
        n = np.arange(len(self.time))
        led = np.interp(n - lag, n, self.leader)
        told = np.abs(self.leader) < CLAMP
        before = np.convolve(~told, np.ones(int(LAGS[-1]) + 2))[: len(n)] > 0
        rows = ~before & (np.abs(self.follower) < CLAMP) & (n > LAGS[-1] + 1) & (n < n[-1] - 1)
        columns = [led, np.ones(len(n))]
        if whole:
            columns += [-np.gradient(self.follower, self.step)]
            columns += [np.tanh(np.gradient(led, self.step) / SLOW)]
        return np.column_stack(columns)[rows], self.follower[rows]


def read(file: Path) -> dict[str, Recording]:
    """An episode, joint by joint."""
    with file.open(newline="", encoding="utf-8") as lines:
        rows = list(csv.DictReader(lines))
    cell = {name: np.array([float(row[name]) for row in rows]) for name in rows[0]}
    return {
        j: Recording(cell["time_s"], cell[f"leader_{j}"], cell[f"follower_{j}"]) for j in JOINTS
    }


def fitted(recording: Recording, pick: Array | None = None) -> tuple[Array, float, float]:
    """`NAMES` in rows, rows, s, percent, 1, percent; scatter with the shift alone, and with all."""
    found = []
    for whole in (False, True):
        best = (np.inf, 0.0, np.zeros(4))
        for lag in LAGS:
            x, y = recording.equations(lag, whole)
            if pick is not None:
                x, y = x[pick], y[pick]
            beta = np.linalg.lstsq(x, y, rcond=None)[0]
            left = float(np.std(y - x @ beta))
            if left < best[0]:
                best = (left, float(lag), beta)
        found.append(best)
    (alone, shift, plain), (scatter, delay, beta) = found
    return np.array([shift, delay, beta[2], beta[3], plain[0], plain[1]]), alone, scatter


def intervals(recording: Recording, seed: int = 0) -> tuple[Array, Array]:
    """Lowest and highest of the 95 % interval of each of `NAMES`."""
    rng = np.random.default_rng(seed)
    rows = len(recording.equations(0.0, False)[1])
    width = round(BLOCK_S / recording.step)
    draws = []
    for _ in range(DRAWS):
        first = rng.integers(0, rows - width, size=-(-rows // width))
        pick = (first[:, None] + np.arange(width)).ravel()[:rows]
        draws.append(fitted(recording, pick)[0])
    low, high = np.percentile(draws, [2.5, 97.5], axis=0)
    return low, high


def quantum(values: Array) -> float:
    """The step of an encoder, as percents have it: one tick of its range."""
    return float(np.min(np.diff(np.unique(np.round(values, 4)))))


def table(folder: Path) -> Iterator[str]:
    """Lines of a table of all joints of all episodes."""
    yield "| joint | shift [ms] | delay [ms] | T [ms] | h [percent] | slope | offset [percent] | "
    yield "scatter, shift alone and all [percent] | ticks, follower by leader |"
    for file in sorted(folder.glob("teleop_*.csv")):
        for joint, one in read(file).items():
            value, alone, scatter = fitted(one)
            low, high = intervals(one)
            row = 1e3 * one.step
            scale = np.array([row, row, 1e3, 1.0, 1.0, 1.0])
            cells = [
                f"{v:.{d}f} ({a:.{d}f} to {b:.{d}f})"
                for v, a, b, d in zip(
                    value * scale, low * scale, high * scale, (0, 0, 0, 2, 3, 1), strict=True
                )
            ]
            ticks = quantum(one.leader) / quantum(one.follower)
            name = f"{file.stem[-1]} {joint}"
            yield (
                f"| {name} | "
                + " | ".join(cells)
                + f" | {alone:.2f}, {scatter:.2f} | {ticks:.3f} |"
            )


def traced(folder: Path) -> Iterator[str]:
    """Lines of a table: what a trace says of the rows without clamped values."""
    yield "| episode | rows | verdict | named | of followers [ms] | misclosure before, after |"
    for file in sorted(folder.glob("teleop_*.csv")):
        for first in (0, ARRIVED):
            rows = np.genfromtxt(file, delimiter=",", names=True)[first:]
            names = [n for n in rows.dtype.names or () if not n.endswith("gripper")]
            readings = {n: rows[n] for n in names}
            found = rsicalib.trace(readings, "so101", skip_bad_rows=True)
            named = ", ".join(f"{step.term} of {label(step.target)}" for step in found.steps)
            lags = [
                f"{1e3 * (p.value or 0.0):.0f} ± {1.96e3 * (p.sd or np.nan):.0f}"
                for p in found.parameters
                if p.term == "lag" and p.value is not None
            ]
            yield (
                f"| {file.stem[-1]} | from {first + 1} | {found.verdict} | {named} | "
                f"{', '.join(lags)} | {found.before.rms_misclosure:.2f}, "
                f"{found.after.rms_misclosure:.2f} |"
            )


PAIR = """
name = "{joint}"
length_unit = "m"
model = {{terms = ["offset@follower_{joint}", "gain@follower_{joint}"]}}
[[closure]]
name = "own"
kind = "equal"
between = ["leader_{joint}", "follower_{joint}"]
noise = 0.3
"""
SIDE = """
[[channel]]
name = "{side}_{joint}"
unit = "percent"
gain = 1.0
offset = 0.0
range = [-100, 100]
noise = 0.05
"""
"""A pair of one joint: as `so101` by itself, with the noise that pan and roll have."""


def one_by_one(folder: Path) -> Iterator[str]:
    """Lines of a table: what a trace says of each joint by itself."""
    yield "| episode, joint | verdict | lag [ms] | servo, T² [ms²] | misclosure before, after |"
    for file in sorted(folder.glob("teleop_*.csv")):
        rows = np.genfromtxt(file, delimiter=",", names=True)[ARRIVED:]
        for joint in JOINTS:
            with tempfile.TemporaryDirectory() as work:
                mechanism = Path(work) / "pair.toml"
                sides = [SIDE.format(side=side, joint=joint) for side in ("leader", "follower")]
                mechanism.write_text(PAIR.format(joint=joint) + "".join(sides), encoding="utf-8")
                own = ("time_s", f"leader_{joint}", f"follower_{joint}")
                found = rsicalib.trace({n: rows[n] for n in own}, mechanism, skip_bad_rows=True)
            told = {step.term: step.parameters[0] for step in found.steps}
            cells = [
                f"{scale * (p.value or 0.0):.0f} ± {1.96 * scale * (p.sd or np.nan):.0f}"
                if (p := told.get(term))
                else "–"
                for term, scale in (("lag", 1e3), ("servo", 1e6))
            ]
            yield (
                f"| {file.stem[-1]}, {joint} | {found.verdict} | {' | '.join(cells)} | "
                f"{found.before.rms_misclosure:.2f}, {found.after.rms_misclosure:.2f} |"
            )


def label(target: str) -> str:
    """All five followers by one word."""
    return "followers" if target.count("follower") == len(JOINTS) else target


def main() -> None:
    """Print all tables."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("data", type=Path)
    folder = parser.parse_args().data / "so101"
    for line in (*table(folder), "", *traced(folder), "", *one_by_one(folder)):
        print(line, flush=True)


if __name__ == "__main__":
    main()
