"""Two sessions of one device, half of the devices changed between: what `calibrate` says of it.

Run as `python -m tests.watch.pairs --pairs 200`. A change has a noncentrality of 60 at least: it is
√60 standard deviations of the difference of two such calibrations, or more.
"""

from __future__ import annotations

import argparse
import multiprocessing
from collections.abc import Sequence
from dataclasses import dataclass
from functools import partial

import numpy as np

import rsicalib
from rsicalib.facts.shapes import Update
from tests.blind import simulator
from tests.blind.simulator import CHANNELS, Device
from tests.watch.device import Change, calibrated, readings_of

LEAST = 60.0
"""Noncentrality of a change."""


@dataclass(frozen=True)
class Pair:
    """What was said of one pair of sessions.

    `right` says whether the only change was named, `listed` whether it was named or listed among
    those that fit as well. Both are None where nothing had changed.
    """

    changes: int
    right: bool | None
    listed: bool | None
    worth: bool
    error: tuple[float, float]
    """Error of the handle on check poses, under the earlier and under the later calibration."""


def again(device: Device, rng: np.random.Generator) -> tuple[rsicalib.Readings, rsicalib.Readings]:
    """A later session of 48 poses, and its rest pose."""
    poses = simulator.hand_poses(rng, 48, device)
    session = simulator.session(device, rng, poses)
    return readings_of(session), readings_of(simulator.rest(device, rng))


def altered(
    device: Device, found: rsicalib.Calibration, rng: np.random.Generator
) -> tuple[Device, str]:
    """The device with one change, and where it is: a re-clamped sensor, or a bent forearm."""
    if rng.random() < 0.75:
        channel = int(rng.integers(9))
        sd = found["offset", CHANNELS[channel]].sd
        assert sd is not None
        least = np.sqrt(2.0 * LEAST) * sd
        offsets = device.offsets.copy()
        offsets[channel] += float(rng.choice([-1.0, 1.0])) * least * rng.uniform(1.0, 2.0)
        return Device(offsets, device.gains, device.geometry), CHANNELS[channel]
    arm = str(rng.choice(["arm1", "arm2", "arm3"]))
    change = Change(arm, float(rng.choice([-1.0, 1.0]) * rng.uniform(0.06, 0.12)), axis="forearm")
    return Device(device.offsets, device.gains, change.geometry(device.geometry, 1.0)), arm


def pair(seed: int, number: int) -> Pair:
    """One device: every second one has changed between its sessions."""
    device, earlier, rng = calibrated([seed, number])
    where = None
    if number % 2:
        device, where = altered(device, earlier, rng)
    readings, rest = again(device, rng)
    known = simulator.check(device, rng)
    check = rsicalib.Readings.from_arrays(
        rsicalib.load_mechanism(),
        known["values"].astype(float),
        pose=known["pose"],
        poses=known["poses"],
    )
    later = rsicalib.calibrate(readings, rest=rest, calibration=earlier, check=check)
    update = later.update
    assert update is not None
    named = [change.target.split("/")[0] for change in update.changes]
    right = None if where is None else named == [where]
    listed = None if where is None else right or (len(named) == 1 and where in others(update))
    poses = np.asarray(rsicalib.forward(check, calibration=earlier))
    before = float(np.sqrt(np.mean((poses[:, :3] - known["poses"][:, :3]) ** 2)))
    assert later.fit.check is not None
    after = float(later.fit.check.position_rms)
    return Pair(len(named), right, listed, update.worth, (before, after))


def others(update: Update) -> set[str]:
    """Targets that fit as well as the first change."""
    return {spec.split("@")[1].split("/")[0] for spec in update.changes[0].also_fits}


def figures(pairs: Sequence[Pair]) -> str:
    """The figures of some pairs."""
    same = [p for p in pairs if p.right is None]
    other = [p for p in pairs if p.right is not None]
    moved = sum(p.changes > 0 for p in same)
    right = sum(bool(p.right) for p in other)
    listed = sum(bool(p.listed) for p in other)
    worth = sum(p.worth for p in other)
    kept = sum(not p.worth for p in same)
    error = np.median([p.error for p in other], axis=0)
    return (
        f"unchanged: {moved} of {len(same)} moved falsely, {kept} kept; changed: {right} of "
        f"{len(other)} named right, {listed} named or listed, {worth} worth an update, "
        f"error of the handle {error[0]:.4f} before, {error[1]:.4f} after"
    )


def main(argv: Sequence[str] | None = None) -> None:
    """Measure some pairs."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("--pairs", type=int, default=200)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--jobs", type=int, default=1)
    args = parser.parse_args(argv)
    with multiprocessing.Pool(args.jobs) as pool:
        found = pool.map(partial(pair, args.seed), range(args.pairs), chunksize=1)
    print(f"seed {args.seed}: {figures(found)}")


if __name__ == "__main__":
    main()
