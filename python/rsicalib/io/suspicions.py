"""Readings that can be used but look wrong: the core says what it is, and here are the words.

What needs the closed loop to be seen (exchanged channels, reversed signs, single bad readings)
is left to the fit.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from typing import Any

import numpy as np

from rsicalib import _core
from rsicalib.facts.warned import Warned, WarnedKind
from rsicalib.io.cells import MechanismLike
from rsicalib.io.samples import Samples
from rsicalib.plain_text import counted, nearest

LISTED = 5
"""Places a message names before it only counts."""

KINDS: dict[str, WarnedKind] = {"unheld": "moved_pose"}
"""What results call it, where the core has a finer name."""


def suspicions(readings: Samples, mechanism: MechanismLike) -> list[Warned]:
    """Warnings about suspicious but usable readings.

    Looks for a channel that never changes, a bit of a converter that never toggles,
    codes at an end of the range, a pose that moved while it was sampled, samples and
    poses that are copies of others, labels that look like others, misspelt.

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
    out, moved = [], 0
    found = _core.suspects(mechanism.channels, readings.values, labels_of(readings))
    poses = sum(one["kind"] == "moved_pose" for one in found)
    for one in found:
        kind, channel = one["kind"], one.get("channel")
        moved += kind == "moved_pose"
        if kind == "moved_pose" and moved > LISTED:
            if moved == poses:
                more = f"{poses - LISTED} more poses scatter far beyond the typical"
                out.append(Warned("moved_pose", None, more))
            continue
        own = one.get("channels", [] if channel is None else [channel])
        names = [readings.channels[k] for k in own]
        text = _words(one, names, readings, mechanism)
        out.append(Warned(KINDS.get(kind, kind), "+".join(names) or None, text))
    return out + [one for name in mechanism.key_columns for one in _misspelt(readings, name)]


def _misspelt(readings: Samples, column: str) -> Iterator[Warned]:
    """Labels that differ from a more frequent one by capitals, or stand once and are near one."""
    labels = readings.keys[column]
    if len(set(labels)) < 2:
        return
    first = np.flatnonzero(np.diff(readings.pose, prepend=readings.pose[0] - 1)).tolist()
    count = Counter(labels[i] for i in first)
    for name, times in count.items():
        others = [other for other in count if count[other] > times]
        meant = next((other for other in others if other.casefold() == name.casefold()), None)
        if times == 1:
            meant = meant or nearest(name, [other for other in others if _alike(name, other)])
        if meant is not None:
            rows = [i for i in first if labels[i] == name]
            yield Warned(
                "labels",
                column,
                f"column {column}: {name!r} ({places(readings, rows)}) is another place than "
                f"{meant!r}, which {count[meant]} poses have: where the same was touched, write "
                "the same text",
            )


def _alike(one: str, other: str) -> bool:
    """Whether labels differ in words of four letters and more: in no number, nor `A` and `B`."""
    words, others = one.split(), other.split()
    pairs = [pair for pair in zip(words, others, strict=False) if pair[0] != pair[1]]
    long = all(min(map(len, pair)) >= 4 and "".join(pair).isalpha() for pair in pairs)
    return len(words) == len(others) and long


def _words(
    found: Mapping[str, Any], names: Sequence[str], readings: Samples, mechanism: MechanismLike
) -> str:
    """A suspicion in words, `names` being its channels."""
    name, rows = ", ".join(names), found.get("rows", ())

    def pose(row: int) -> str:
        return f"pose {readings.pose[row]} ({readings.line_word} {readings.lines[row]})"

    match found["kind"]:
        case "constant":
            return (
                f"{name}: reads {found['reads']:.10g} in all {counted(len(readings), 'row')} while "
                "other channels move; check its wiring, it cannot be calibrated like this"
            )
        case "clipped":
            return (
                f"{name}: reads exactly {found['at']:.10g} in {len(rows)} poses and never "
                f"beyond ({places(readings, rows)}); it is clipped there: check its "
                "amplifier, and keep the joint within range"
            )
        case "stuck_bit":
            listed = ", ".join(
                f"bit {bit} (worth {1 << bit}) is always {int(state)}"
                for bit, state in found["bits"]
            )
            off = sum(1 << bit for bit, _ in found["bits"])
            return (
                f"{name}: {listed}, while higher bits change: readings are off by up to {off} "
                "counts; check the converter"
            )
        case "end_of_range":
            return (
                f"{name}: {counted(len(rows), 'reading')} at the end of its "
                f"range, {found['end']:.10g} ({places(readings, rows)}); the joint may have been "
                "further out: leave those rows out (--skip-bad-rows), or keep the joint within "
                "its range"
            )
        case "moved_pose":
            others, unit = found["others"], mechanism.channels[found["channel"]].unit
            return (
                f"{pose(found['row'])}: {name} scatters by {found['scatter']:.3g} while it was "
                f"sampled, other poses by {found['typical']:.2g} ({unit})"
                + (f", and so do{'es' * (others == 1)} {others} more" if others else "")
                + "; it moved, or a reading is bad: take it again or leave it out"
            )
        case "unheld":
            whole = f"all rows are of pose {readings.pose[0]}, in which"
            which = whole if found["poses"] == 1 else "within a pose"
            return (
                f"{which} channels move by {100.0 * found['part']:.0f} % of their range: rows of a "
                "pose are samples while the joints stand still; give every place a number of its "
                "own, or leave the column pose out of a recording of motion"
            )
        case "units":
            return (
                f"readings from {found['low']:.4g} to {found['high']:.4g} with decimals, where "
                f"whole counts are declared and the range is {1.0 / found['part']:.0f} times as "
                "wide: are they in volts, or in radians? Write the counts, or declare unit, range "
                "and gain of what is written"
            )
        case "stale_rows":
            m = len(rows)
            return (
                f"{m} row{'s repeat' if m > 1 else ' repeats'} an earlier row in every channel "
                f"({places(readings, rows)}); the logger may have written old samples again: "
                "they are no new information, drop them"
            )
        case "copied_pose":
            return (
                f"{pose(found['row'])} repeats {pose(found['of'])} reading by reading; it looks "
                "like a copy: drop one"
            )
    raise AssertionError(found)


def labels_of(readings: Samples) -> Any:
    """The pose of each row; None of a recording."""
    return readings.pose if readings.held else None


def places(readings: Samples, rows: Sequence[int]) -> str:
    """The first few lines of a list, and how many more there are."""
    lines = [str(readings.lines[i]) for i in rows[:LISTED]]
    more = f" and {len(rows) - LISTED} more" if len(rows) > LISTED else ""
    word = readings.line_word + "s" * (len(rows) > 1)
    return f"{word} {', '.join(lines)}{more}"
