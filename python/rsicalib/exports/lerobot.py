"""LeRobot: the calibration file of a follower, whose ranges make it agree with its leader.

A range holds a gain and an offset, in whole steps of the encoder; it holds nothing else.
"""

from __future__ import annotations

import json

from rsicalib.errors import InputError
from rsicalib.exports.ask import Ask
from rsicalib.imports.lerobot_ranges import read_calibration
from rsicalib.imports.teleop import FOLLOWER

__all__ = ["write"]


def write(ask: Ask) -> dict[str, str]:
    """Write the file that is given as base, with other ranges; and what it cannot hold."""
    base = ask.file("the calibration file of the follower, NAME.json")
    document = read_calibration(base)
    channels = {channel.name: channel for channel in ask.calibrated.mechanism.channels}
    changed = []
    for joint, entry in document.items():
        channel = channels.get(FOLLOWER + joint.removesuffix(".pos").removeprefix("main_"))
        if channel is None:
            continue
        if channel.unit != "percent":
            raise InputError(f"{channel.name}: found unit {channel.unit!r}, expected 'percent'")
        low, high, sign = entry["range_min"], entry["range_max"], -1 if entry["drive_mode"] else 1
        ends = []
        for percent in (-100.0, 100.0):
            before = sign * (percent - channel.offset) / channel.gain
            ends.append(low + (before + 100.0) / 200.0 * (high - low))
        entry["range_min"], entry["range_max"] = (round(end) for end in sorted(ends))
        changed.append(joint)
    if not changed:
        found, expected = f"the joints {', '.join(document)}", "some of the mechanism's"
        raise InputError.at(base, found=found, expected=f"{expected} (follower_…)")
    notes = [
        "ranges are whole steps: each end is right to half a step",
        *(f"not in the file: {note}" for note in ask.calibrated.said),
    ]
    text = json.dumps(document, indent=4) + "\n"
    return {"follower.json": text, "notes.txt": "".join(f"{note}\n" for note in notes)}
