"""Readings that can be used but look wrong, as far as the readings alone can tell.

Each rule asks for evidence that clean data would give less than once in a million
files, so that a warning means something. What needs the closed loop to be seen
(exchanged channels, reversed signs, single bad readings) is left to the fit.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator

import numpy as np
import numpy.typing as npt

from rsicalib import _core
from rsicalib.arrays import FloatArray, IntArray
from rsicalib.facts.warned import Warned
from rsicalib.io.cells import MechanismLike
from rsicalib.io.samples import Samples
from rsicalib.units import is_count

__all__ = ["places", "resolution", "suspicions"]

RARE = 1e-6
"""How often a rule may speak up in clean data, per file."""
MOVED = 0.05
"""Part of a channel's range by which no held pose moves: the guide takes 2 % of it for a tremor."""
NARROW = 0.01
"""Part of their range that all channels together never stay within: a session moves its joints."""
LISTED = 5
"""Places a message names before it only counts."""


def suspicions(readings: Samples, mechanism: MechanismLike) -> list[Warned]:
    """Warnings about suspicious but usable readings.

    Looks for a channel that never changes, a bit of a converter that never toggles,
    codes at an end of the range, a pose that moved while it was sampled, samples and
    poses that are copies of others.

    Parameters
    ----------
    readings : Samples
        `n` samples of `C` channels.
    mechanism : MechanismLike
        Units and ranges of the channels.

    Returns
    -------
    list of Warned
        Each says where, what, and what to do. Empty for clean data.
    """
    return [
        *_constant_channels(readings),
        *_faults(readings, mechanism),
        *_saturated_codes(readings, mechanism),
        *_moved_poses(readings, mechanism),
        *_unheld(readings, mechanism),
        *_narrow(readings, mechanism),
        *_stale_rows(readings),
        *_copied_poses(readings),
    ]


def _constant_channels(readings: Samples) -> Iterator[Warned]:
    """Channels that stand still while another one clearly does not."""
    values, poses = readings.values, readings.n_poses
    if poses < 5:  # one rest pose may well hold a channel still
        return
    still = np.flatnonzero((values == values[0]).all(axis=0))
    if not len(still):
        return
    if max(len(np.unique(column)) for column in values.T) < min(20, poses):
        return  # nothing moves: not a session of different poses
    for k in still:
        yield Warned(
            "constant",
            readings.channels[k],
            f"{readings.channels[k]}: reads {values[0, k]:.10g} in all {len(values)} rows while "
            "other channels move; check its wiring, it cannot be calibrated like this",
        )


def _faults(readings: Samples, mechanism: MechanismLike) -> Iterator[Warned]:
    """Bits that keep one value, alike channels in one message, and codes as at a wall."""
    counts = [is_count(channel.unit) for channel in mechanism.channels]
    starts, lengths = _runs(readings.pose)
    pose = np.repeat(np.arange(len(starts)), lengths)
    alike: dict[tuple[tuple[int, bool], ...], list[str]] = {}
    numbered = pose.astype(np.uintp)
    for k, bits, clipped in _core.faults(readings.values, counts, numbered, readings.held):
        if bits:
            alike.setdefault(tuple(bits), []).append(readings.channels[k])
        if clipped:
            at, poses = clipped
            yield Warned(
                "clipped",
                readings.channels[k],
                f"{readings.channels[k]}: reads exactly {at:.10g} in {len(poses)} poses and never "
                f"beyond ({places(readings, starts[poses])}); it is clipped there: check its "
                "amplifier, and keep the joint within range",
            )
    for stuck, names in alike.items():
        listed = ", ".join(
            f"bit {bit} (worth {1 << bit}) is always {int(state)}" for bit, state in stuck
        )
        yield Warned(
            "stuck_bit",
            "+".join(names),
            f"{', '.join(names)}: {listed}, while higher bits change; check the converter, "
            f"and count at least {1 << stuck[-1][0]} counts of error into the noise",
        )


def _saturated_codes(readings: Samples, mechanism: MechanismLike) -> Iterator[Warned]:
    """Readings at the very ends of a channel's range, where the truth may lie beyond."""
    for k, channel in enumerate(mechanism.channels):
        for end in channel.range or ():
            rows = np.flatnonzero(readings.values[:, k] == end)
            if len(rows):
                yield Warned(
                    "end_of_range",
                    channel.name,
                    f"{channel.name}: {len(rows)} reading{'s' * (len(rows) > 1)} at the end of its "
                    f"range, {end:.10g} ({places(readings, rows)}); the joint may have been "
                    "further out: leave those rows out (--skip-bad-rows), or keep the joint within "
                    "its range",
                )


def _moved_poses(readings: Samples, mechanism: MechanismLike) -> Iterator[Warned]:
    """Held poses that scatter far beyond what is typical of the others."""
    starts, counts = _runs(readings.pose)
    several = counts > 1
    if several.sum() < 8:  # too few to know what is typical
        return
    values = readings.values
    means = np.add.reduceat(values, starts) / counts[:, None]
    squares = np.add.reduceat((values - np.repeat(means, counts, axis=0)) ** 2, starts)
    dof = (counts - 1)[several]
    scatter = np.sqrt(squares[several] / dof[:, None])
    typical = np.maximum(np.median(scatter, axis=0), resolution(values, mechanism))
    # A trembling hand moves some joints more than others, by pose: hence the factor of two.
    limit = 2.0 * np.sqrt(_chi2(dof, 5.5) / _chi2(dof, 0.0))
    excess = scatter / typical / limit[:, None]
    moved = np.flatnonzero(excess.max(axis=1) > 1.0)
    for i in moved[np.argsort(-excess[moved].max(axis=1), kind="stable")][:LISTED]:
        k = int(np.argmax(excess[i]))
        others = int((excess[i] > 1.0).sum()) - 1
        first = starts[several][i]
        unit = mechanism.channels[k].unit
        yield Warned(
            "moved_pose",
            readings.channels[k],
            f"pose {readings.pose[first]} ({readings.line_word} {readings.lines[first]}): "
            f"{readings.channels[k]} scatters by {scatter[i, k]:.3g} while it was sampled, other "
            f"poses by {typical[k]:.2g} ({unit})"
            + (f", and so do{'es' * (others == 1)} {others} more" if others else "")
            + "; it moved, or a reading is bad: take it again or leave it out",
        )
    if len(moved) > LISTED:
        more = len(moved) - LISTED
        yield Warned("moved_pose", None, f"{more} more poses scatter far beyond the typical")


def _unheld(readings: Samples, mechanism: MechanismLike) -> Iterator[Warned]:
    """Poses within which joints go through a good part of their range: they are not held."""
    starts, counts = _runs(readings.pose)
    if not readings.held or not (counts > 1).any():
        return
    values = readings.values
    spans = np.maximum.reduceat(values, starts) - np.minimum.reduceat(values, starts)
    parts = (spans[counts > 1] / _ranges(mechanism)).max(axis=1)
    part = float(np.median(parts))
    if part <= MOVED:
        return
    poses = len(counts)
    which = f"all rows are of pose {readings.pose[0]}, in which" if poses == 1 else "within a pose"
    yield Warned(
        "moved_pose",
        None,
        f"{which} channels move by {100.0 * part:.0f} % of their range: rows of a pose are samples "
        "while the joints stand still; give every place a number of its own, or leave the column "
        "pose out of a recording of motion",
    )


def _ranges(mechanism: MechanismLike) -> FloatArray:
    """What a channel reads from end to end; a turn, or no end, where it has no range."""
    turn = {"rad", "deg", "count"}
    return np.array(
        [
            channel.range[1] - channel.range[0]
            if channel.range is not None
            else math.tau / abs(channel.gain)
            if channel.unit in turn
            else math.inf
            for channel in mechanism.channels
        ]
    )


def _narrow(readings: Samples, mechanism: MechanismLike) -> Iterator[Warned]:
    """Decimals within a hundredth of the range where whole counts are declared."""
    counts = [k for k, c in enumerate(mechanism.channels) if is_count(c.unit) and c.range]
    if not counts or readings.n_poses < 5:
        return
    values = readings.values[:, counts]
    part = (np.ptp(values) / _ranges(mechanism)[counts]).max()
    if part > NARROW or 2 * np.mean(values == np.rint(values)) > 1:
        return
    low, high = values.min(), values.max()
    yield Warned(
        "units",
        "+".join(readings.channels[k] for k in counts),
        f"readings from {low:.4g} to {high:.4g} with decimals, where whole counts are declared and "
        f"the range is {1.0 / part:.0f} times as wide: are they in volts, or in radians? Write "
        "the counts, or declare unit, range and gain of what is written",
    )


def resolution(values: FloatArray, mechanism: MechanismLike) -> FloatArray:
    """Scatter that rounding alone gives, shape (C,); a millionth of the span where unknown."""
    counts = [is_count(channel.unit) for channel in mechanism.channels]
    rounding = np.array(_core.steps(values, counts)) / math.sqrt(12.0)
    return np.asarray(np.maximum(rounding, 1e-6 * np.ptp(values, axis=0)))


def _chi2(dof: IntArray, z: float) -> FloatArray:
    """Quantile of χ² per degree of freedom, `z` normal deviations out (Wilson and Hilferty)."""
    h = 2.0 / (9.0 * dof)
    return np.asarray((1.0 - h + z * np.sqrt(h)) ** 3)


def _stale_rows(readings: Samples) -> Iterator[Warned]:
    """Rows that repeat the one before in every channel, amid rows that do not."""
    values = readings.values
    pair = np.ones(len(values) - 1, dtype=np.bool_)
    if readings.held:
        pair = readings.pose[1:] == readings.pose[:-1]
    same = values[1:] == values[:-1]
    stale = pair & same.all(axis=1)
    fresh = pair & ~stale
    busy = fresh & (same.mean(axis=1) <= 0.5)
    if not stale.any() or fresh.sum() < 20 or 2 * busy.sum() < fresh.sum():
        return  # nothing repeats, or repeating is nothing unusual here
    # Channels that repeat by chance do so independently: as many whole rows as this would.
    expected = pair.sum() * np.prod(same[fresh].mean(axis=0))
    starts, counts = _runs(stale)
    bounds = np.r_[True, busy | ~pair, True]  # what lies before and after each pair
    calm = stale[starts] & bounds[starts] & bounds[starts + counts + 1]
    rows = np.flatnonzero(np.repeat(calm, counts)) + 1
    m = len(rows)
    if m and m * math.log(max(expected, 1e-300)) - math.lgamma(m + 1) < math.log(RARE):
        yield Warned(
            "stale_rows",
            None,
            f"{m} row{'s repeat' if m > 1 else ' repeats'} the row before in every channel "
            f"({places(readings, rows)}); the logger may have written old samples again: "
            "they are no new information, drop them",
        )


def _copied_poses(readings: Samples) -> Iterator[Warned]:
    """Held poses whose samples are, one by one, those of another pose."""
    if not readings.held:
        return
    seen: dict[bytes, int] = {}
    starts, counts = _runs(readings.pose)
    for start, count in zip(starts, counts, strict=True):
        block = readings.values[start : start + count]
        if (block == block[0]).all():
            continue  # without noise, a pose visited twice does read the same
        first = seen.setdefault(block.tobytes(), int(start))
        if first != start:
            yield Warned(
                "copied_pose",
                None,
                f"pose {readings.pose[start]} ({readings.line_word} {readings.lines[start]}) "
                f"repeats pose {readings.pose[first]} ({readings.line_word} "
                f"{readings.lines[first]}) reading by reading; it looks like a copy: drop one",
            )


def _runs(labels: npt.NDArray[np.int64] | npt.NDArray[np.bool_]) -> tuple[IntArray, IntArray]:
    """Where each run of equal labels starts, and how long it is."""
    starts = np.flatnonzero(np.r_[True, labels[1:] != labels[:-1]])
    return starts, np.diff(np.r_[starts, len(labels)])


def places(readings: Samples, rows: Iterable[np.int64] | IntArray) -> str:
    """The first few lines of a list, and how many more there are."""
    lines = [str(readings.lines[i]) for i in rows]
    more = f" and {len(lines) - LISTED} more" if len(lines) > LISTED else ""
    word = readings.line_word + "s" * (len(lines) > 1)
    return f"{word} {', '.join(lines[:LISTED])}{more}"
