"""LeRobot: the calibration file of a follower, whose ranges make it agree with its leader.

A range holds a gain and an offset, in whole steps of the encoder; it holds nothing else. An arm
that reads degrees counts them from the middle of its range, `360 / 4095` for each step, whatever
its ends: its range holds an offset alone.
"""

from __future__ import annotations

import json
import math
from typing import Any

from rsicalib.errors import InputError
from rsicalib.exports.ask import Ask
from rsicalib.imports.lerobot_ranges import read_calibration
from rsicalib.imports.teleop import DEGREES, FOLLOWER

HALF = 0.5
"""Of a step of the encoder: an end of a range is right to no more."""


def write(ask: Ask) -> dict[str, str]:
    """Write the file that is given as base, with other ranges; and what it cannot hold."""
    base = ask.file("the calibration file of the follower, NAME.json")
    document = read_calibration(base)
    channels = {channel.name: channel for channel in ask.calibrated.mechanism.channels}
    changed, notes = [], []
    for joint, entry in document.items():
        channel = channels.get(FOLLOWER + joint.removesuffix(".pos").removeprefix("main_"))
        if channel is None:
            continue
        if channel.unit == "percent":
            ends = _of_percent(entry, channel.gain, channel.offset)
        elif channel.unit == "deg":
            ends = _of_degrees(entry, math.degrees(channel.offset))
            gain = math.degrees(channel.gain)
            if abs(gain - 1.0) * (entry["range_max"] - entry["range_min"]) >= HALF:
                notes.append(f"not in the file: {joint} turns {gain:.7g} degrees for each it reads")
        else:
            expected = "'percent' or 'deg'"
            raise InputError(f"{channel.name}: found unit {channel.unit!r}, expected {expected}")
        entry["range_min"], entry["range_max"] = (round(end) for end in sorted(ends))
        if not 0 <= entry["range_min"] < entry["range_max"] <= DEGREES:
            notes.append(
                f"{joint}: {entry['range_min']} to {entry['range_max']} is beyond what its encoder "
                f"has, 0 to {DEGREES:g}: set its middle anew before this is of use"
            )
        changed.append(joint)
    if not changed:
        found, expected = f"the joints {', '.join(document)}", "some of the mechanism's"
        raise InputError.at(base, found, f"{expected} (follower_…)")
    notes = [
        "ranges are whole steps: each end is right to half a step",
        *notes,
        *(f"not in the file: {note}" for note in ask.calibrated.said),
    ]
    text = json.dumps(document, indent=4) + "\n"
    return {"follower.json": text, "notes.txt": "".join(f"{note}\n" for note in notes)}


def _of_percent(entry: dict[str, Any], gain: float, offset: float) -> list[float]:
    """Steps at which the corrected percent is at its ends."""
    low, high, sign = entry["range_min"], entry["range_max"], -1 if entry["drive_mode"] else 1
    before = [sign * (percent - offset) / gain for percent in (-100.0, 100.0)]
    return [low + (percent + 100.0) / 200.0 * (high - low) for percent in before]


def _of_degrees(entry: dict[str, Any], offset: float) -> list[float]:
    """The range about another middle; LeRobot does not turn degrees round by `drive_mode`."""
    shift = offset * DEGREES / 360.0
    return [entry["range_min"] - shift, entry["range_max"] - shift]
