"""What becomes of a device at work, and what the watch says: `python -m tests.watch.table changes`.

`changes` draws eleven kinds of change and prints alarms per device in the ten seconds after the
change, how often the cause is named, and the delay. `noises` draws sound devices in nine kinds of
noise and prints alarms over the number that was promised. Everything that happens is made in plain
numpy from the oracle's angles: the core sees readings only.
"""

from __future__ import annotations

import argparse
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

import rsicalib
from rsicalib.verbs.monitor import Alarm
from tests.blind.geometry import inverse
from tests.blind.simulator import CHANNELS, Device
from tests.oracle import Array
from tests.watch.device import NOISES, RATE_HZ, Change, Motion, noise_of, read
from tests.watch.device import calibrated as calibrated_device
from tests.watch.trials import quiet

BEFORE = 3_000
"""Rows of the sound device at work."""

AFTER = 4_000
"""Rows after the change: ten seconds."""

WIRE_LAG = 1
"""A frozen channel repeats the last reading before the change."""


@dataclass(frozen=True)
class Truth:
    """What happened: for each cause, names of an alarm that are right, each as `term@target`."""

    causes: tuple[frozenset[str], ...]

    def right(self, alarms: Sequence[Alarm]) -> bool:
        """Every cause is named by the last word on some alarm, and nothing else is."""
        # A word on a row replaces all words on it before; it may be of several alarms.
        last: dict[int, list[Alarm]] = {}
        for alarm in alarms:
            about = alarm.row if alarm.revises is None else alarm.revises
            same = [one for one in last.get(about, []) if one.row == alarm.row]
            last[about] = [*same, alarm]
        named = {f"{alarm.term}@{alarm.target}" for words in last.values() for alarm in words}
        every = all(named & cause for cause in self.causes)
        return every and named <= frozenset().union(*self.causes)


def _channel(rng: np.random.Generator) -> int:
    return int(rng.integers(9))


def _sign(rng: np.random.Generator) -> float:
    return float(rng.choice((-1.0, 1.0)))


def _after(rows: Array) -> Array:
    return (rows >= BEFORE).astype(float)


def _offset(channel: int) -> frozenset[str]:
    return frozenset({f"offset@{CHANNELS[channel]}"})


def slip(
    rng: np.random.Generator, count: int = 1, same_arm: bool = False
) -> list[tuple[int, float]]:
    """Channels that slip in one row, by 0.005 to 0.02 rad each."""
    first = _channel(rng)
    own = [c for c in range(9) if c // 3 == first // 3 and c != first]
    others = [c for c in range(9) if c // 3 != first // 3]
    second = int(rng.choice(own if same_arm else others))
    chosen = (first, second)[:count]
    return [(c, _sign(rng) * float(rng.uniform(0.005, 0.02))) for c in chosen]


@dataclass(frozen=True)
class Life:
    """Counts (n, 9) of a device at work that changes in row `BEFORE`, and what happened."""

    counts: Array
    truth: Truth


def lived(kind: str, rng: np.random.Generator, device: Device, after: int = AFTER) -> Life:
    """The rows of a device with one kind of change."""
    rows = np.arange(BEFORE + after)
    pose = Motion.draw(rng, device).pose(rows / RATE_HZ)
    late = _after(rows)
    angles = inverse(device.geometry, pose).reshape(-1, 9)
    ramp = np.clip((rows - BEFORE) / after, 0.0, 1.0)
    factor = np.ones((len(rows), 9))
    causes: list[frozenset[str]] = []
    if kind in ("slip", "two slips", "two slips of an arm"):
        for c, by in slip(rng, 1 if kind == "slip" else 2, kind.endswith("arm")):
            angles[:, c] -= by * late
            causes.append(_offset(c))
    elif kind == "drift":
        c = _channel(rng)
        angles[:, c] -= _sign(rng) * rng.uniform(0.02, 0.06) * ramp
        causes.append(_offset(c))
    elif kind in ("gain", "creeping gain"):
        c = _channel(rng)
        by = _sign(rng) * rng.uniform(0.01, 0.03)
        factor[:, c] = 1.0 + by * (late if kind == "gain" else ramp)
        causes.append(frozenset({f"gain@{CHANNELS[c]}"}))
    elif kind in ("reference", "creeping reference"):
        by = _sign(rng) * rng.uniform(0.003, 0.01)
        factor[:] = 1.0 + by * (late if kind == "reference" else ramp)[:, None]
        causes.append(frozenset({"reference@all"}))
    elif kind == "bent link":
        arm = int(rng.integers(3))
        change = Change(f"arm{arm + 1}", _sign(rng) * 0.05, axis="forearm")
        bent = inverse(change.geometry(device.geometry, 1.0), pose).reshape(-1, 9)
        angles = np.where(late[:, None] > 0, bent, angles)
        links = {f"link_frame@arm{arm + 1}/{row}" for row in (1, 2, 3)}
        causes.append(frozenset(links | {f"point_position@arm{arm + 1}"}))
    elif kind == "loose bearing":
        arm = int(rng.integers(3))
        shift = np.zeros((len(rows), 3, 3))
        shift[:, arm] = late[:, None] * 0.02 * rng.standard_normal((len(rows), 3))
        angles = inverse(device.geometry, pose, shift).reshape(-1, 9)
        ends = {f"loose@arm{arm + 1}", *(f"loose@arm{arm + 1}/{row}" for row in (1, 2, 3))}
        causes.append(frozenset(ends))
    counts = (angles - device.offsets) / device.gains * factor
    return Life(counts, Truth(tuple(causes)))


KINDS = (
    "slip",
    "two slips",
    "two slips of an arm",
    "drift",
    "gain",
    "creeping gain",
    "reference",
    "creeping reference",
    "bent link",
    "loose bearing",
    "stuck",
)


def at_work(
    kind: str, seed: Sequence[int], after: int = AFTER
) -> tuple[rsicalib.Calibration, Array, Truth]:
    """A calibrated device, what its converter reads at work, and what happened."""
    device, found, rng = calibrated_device(list(seed))
    life = lived(kind, rng, device, after)
    counts = life.counts + noise_of("white", rng, len(life.counts), None)
    values = read("white", counts)
    truth = life.truth
    if kind == "stuck":
        c = _channel(rng)
        values[BEFORE:, c] = values[BEFORE - WIRE_LAG, c]
        truth = Truth((frozenset({f"stuck@{CHANNELS[c]}"}),))
    return found, values, truth


@dataclass(frozen=True)
class Said:
    """Of one device: new alarms, all lines, whether the causes were named, rows until the first."""

    early: bool
    alarms: int
    lines: int
    right: bool
    delay: int | None


def said(kind: str, seed: Sequence[int], promise: float) -> Said:
    """Watch one device."""
    found, values, truth = at_work(kind, seed)
    alarms = rsicalib.Monitor(found, false_alarms=promise).update(values)
    news = [alarm for alarm in alarms if alarm.row >= BEFORE]
    return Said(
        len(news) < len(alarms),
        sum(alarm.revises is None for alarm in news),
        len(news),
        bool(news) and truth.right(news),
        news[0].row - BEFORE if news else None,
    )


def changes(args: argparse.Namespace) -> None:
    """Print a line for each kind of change."""
    print("| change | alarms | lines | most lines | named right | missed | delay in rows |")
    print("|---|---|---|---|---|---|---|")
    for number, kind in enumerate(KINDS):
        if args.kind and kind not in args.kind:
            continue
        found = [said(kind, (args.seed, number, n), args.promise) for n in range(args.devices)]
        found = [one for one in found if not one.early]
        delays = [one.delay for one in found if one.delay is not None]
        low, half, high = np.percentile(delays or [np.nan], [25, 50, 75])
        print(
            f"| {kind} | {np.mean([one.alarms for one in found]):.1f} "
            f"| {np.mean([one.lines for one in found]):.1f} | {max(one.lines for one in found)} "
            f"| {sum(one.right for one in found)} of {len(found)} | {len(found) - len(delays)} "
            f"| {half:.0f} ({low:.0f} … {high:.0f}) |",
            flush=True,
        )


def noises(args: argparse.Namespace) -> None:
    """Print alarms of sound devices over the number that was promised."""
    print("| noise | alarms | promised |")
    print("|---|---|---|")
    for number, kind in enumerate(NOISES):
        if args.noise and kind not in args.noise:
            continue
        each = args.rows // args.devices
        found = [
            quiet([args.seed, number, n], kind, args.promise, each) for n in range(args.devices)
        ]
        alarms = sum(one.alarms for one in found)
        print(f"| {kind} | {alarms} | {args.promise * args.rows:.0f} |", flush=True)


def main(arguments: Sequence[str] | None = None) -> None:
    """Print one table."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("what", choices=("changes", "noises"))
    parser.add_argument("--kind", nargs="+", choices=KINDS)
    parser.add_argument("--noise", nargs="+", choices=NOISES)
    parser.add_argument("--devices", type=int, default=20)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--promise", type=float, default=1e-5)
    parser.add_argument("--rows", type=int, default=400_000, help="of all sound devices together")
    args = parser.parse_args(arguments)
    {"changes": changes, "noises": noises}[args.what](args)


if __name__ == "__main__":
    main()
