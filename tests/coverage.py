"""Whether intervals hold the truth: `python -m tests.coverage --cases 100`.

The machines are those of `tests/families`, clean. Each is calibrated from three sessions: all over
its workspace; from few poses, one sample each; and near one pose, where what differs little from
pose to pose is hardly told (the poses that are nearest to one, of eight times as many). It is
counted how many intervals hold what was put in, those of offsets, gains and unknown points; how
many `value ± 1.96 sd` would; and how many are not those. At other poses of the whole workspace it
is counted how many coordinates of the platform, or of carried points, are within 1.96 of their sd,
where the session determines everything. A calibration that is `undetermined` says so and is not
counted.

Errors of one machine go together, so that shares are means over machines with the standard error of
these.
"""

from __future__ import annotations

import argparse
from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np

from rsicalib import Calibration, Mechanism, calibrate
from rsicalib.errors import InputError
from rsicalib.poses.places import places
from tests.families.device import Device, Scene, Session, observe, stage
from tests.families.draw import FAMILIES, Rng
from tests.families.trials import readings_of, toml, truth_of
from tests.oracle import Array

SESSIONS = ("whole", "few", "near")
ELSEWHERE = 20
"""Poses at which places are predicted."""
NEAREST = 8
"""Poses of which the nearest are taken, for each that is taken."""


@dataclass
class Counts:
    """Shares of the intervals of each machine that hold the truth."""

    inside: list[float] = field(default_factory=list)
    linear: list[float] = field(default_factory=list)
    bent: list[float] = field(default_factory=list)
    places: list[float] = field(default_factory=list)
    intervals: int = 0
    undetermined: int = 0
    refused: int = 0


def near(device: Device, rng: Rng) -> Scene:
    """As many poses as usual and as many samples, all of them near one."""
    drawing = device.drawing
    pool = stage(device, rng, NEAREST * drawing.poses, 1)
    keys = list(zip(pool.group, pool.at, strict=True)) or [("", "")] * len(pool.q)
    scale = np.ptp(pool.q, axis=0)
    kept: list[Array] = []
    for key in dict.fromkeys(keys):
        own = pool.q[[k == key for k in keys]]
        apart = np.abs((own - own[rng.integers(len(own))]) / scale).max(axis=1)
        kept.append(own[np.argsort(apart)[: drawing.poses]])
    usual = stage(device, rng)
    q = np.repeat(np.concatenate(kept), drawing.samples, axis=0)
    return Scene(q, usual.label, usual.before, usual.turn, usual.warmth, usual.group, usual.at)


def staged(device: Device, session: str, rng: Rng) -> Scene:
    """A session of a machine."""
    if session == "near":
        return near(device, rng)
    if session == "few":
        return stage(device, rng, max(device.drawing.poses // 4, 4), 1)
    return stage(device, rng)


def one(family: str, session: str, number: int, seed: int, into: Counts) -> None:
    """One machine; another is drawn in place of one that cannot take its poses."""
    place = [seed, list(FAMILIES).index(family), SESSIONS.index(session), number]
    rng = np.random.default_rng(np.random.SeedSequence(place))
    for _ in range(8):
        try:
            device = Device.random(family, rng)
            scene = staged(device, session, rng)
            break
        except ValueError:
            continue
    else:
        return
    mechanism = Mechanism.from_toml(toml(device))
    try:
        found = calibrate(readings_of(mechanism, observe(device, scene, rng, ())), mechanism)
    except InputError:
        into.refused += 1
        return
    if found.verdict == "undetermined":
        into.undetermined += 1
        return
    inside, linear = [], []
    for p in found.parameters:
        truth, ends = truth_of(device, p), p.interval
        if truth is None or ends is None or p.value is None or p.sd is None:
            continue
        inside.append(ends[0] <= truth <= ends[1])
        linear.append(abs(p.value - truth) <= 1.96 * p.sd)
    into.inside.append(float(np.mean(inside)))
    into.linear.append(float(np.mean(linear)))
    into.bent.append(float(np.mean([p.profile is not None for p in found.parameters])))
    into.intervals += len(inside)
    if not found.unobservable:
        into.places += predicted(device, mechanism, found, rng)


def predicted(device: Device, mechanism: Mechanism, found: Calibration, rng: Rng) -> list[float]:
    """Share of the coordinates elsewhere within 1.96 of their sd; none of poses out of reach."""
    try:
        scene = stage(device, rng, ELSEWHERE, 1)
        values, columns = device.ideal(scene)
        truth = device.points(scene, ())
    except ValueError:
        return []
    rows = readings_of(mechanism, Session(scene, values, columns, True, False))
    seen = places(rows, mechanism, found)
    platform = device.drawing.mechanism.get("platform")
    if platform:
        there = np.mean([truth[name] for name in platform], axis=0)
    else:
        there = np.concatenate(list(truth.values()), axis=1)
    if seen.sd is None or not there.size:
        return []
    count = there.shape[1]
    off, sd = np.abs(seen.values[:, :count] - there), seen.sd[:, :count]
    told = sd > 1e-9 * device.length
    return [float(np.mean(off[told] < 1.96 * sd[told]))] if told.any() else []


def counted(family: str, session: str, cases: int, seed: int = 1, first: int = 0) -> Counts:
    """Coverage of so many machines."""
    counts = Counts()
    for number in range(first, first + cases):
        one(family, session, number, seed, counts)
    return counts


def share(values: Sequence[float]) -> str:
    """A mean in per cent, with its standard error."""
    if not values:
        return "–"
    x = 100.0 * np.asarray(values)
    return f"{x.mean():.1f} ± {x.std(ddof=1) / np.sqrt(len(x)) if len(x) > 1 else np.nan:.1f} %"


def main(arguments: Sequence[str] | None = None) -> None:
    """Print a row for each family and session."""
    parser = argparse.ArgumentParser(prog="python -m tests.coverage", description=__doc__)
    parser.add_argument("--cases", type=int, default=100)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--families", nargs="+", default=list(FAMILIES), choices=list(FAMILIES))
    parser.add_argument("--sessions", nargs="+", default=list(SESSIONS), choices=SESSIONS)
    options = parser.parse_args(arguments)
    print("| family | session | hold | ± 1.96 sd would | not ± 1.96 sd | intervals | places |")
    print("|---|---|---|---|---|---|---|")
    whole = Counts()
    for family in options.families:
        for session in options.sessions:
            found = counted(family, session, options.cases, options.seed)
            whole.inside += found.inside
            whole.linear += found.linear
            whole.places += found.places
            cells = [share(found.inside), share(found.linear), share(found.bent)]
            left = f", {found.undetermined} undetermined" if found.undetermined else ""
            left += f", {found.refused} refused" if found.refused else ""
            print(
                f"| {family} | {session} | {' | '.join(cells)} | {found.intervals}{left} | "
                f"{share(found.places)} |",
                flush=True,
            )
    print(
        f"all: {share(whole.inside)}, by ± 1.96 sd {share(whole.linear)}, "
        f"places {share(whole.places)}"
    )


if __name__ == "__main__":
    main()
