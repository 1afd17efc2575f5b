"""Calibration files of LeRobot: where the range of each joint ends, in steps of its encoder."""

from __future__ import annotations

from rsicalib.errors import InputError
from rsicalib.imports.teleop import FOLLOWER, LEADER, short_names
from rsicalib.io.sources import read_json

OF_A_RANGE = ("homing_offset", "range_min", "range_max", "drive_mode")


def read_ranges(paths: tuple[str, ...]) -> dict[str, int]:
    """Ticks of each range, by channel, of calibration files: of the leader, then of the follower.

    One file alone is the follower's.
    """
    sides = (FOLLOWER,) if len(paths) == 1 else (LEADER, FOLLOWER)
    out = {}
    for path, side in zip(paths, sides, strict=False):
        for joint, entry in read_calibration(path).items():
            out[side + short_names([joint])[0]] = entry["range_max"] - entry["range_min"]
    return out


def read_calibration(path: str) -> dict[str, dict[str, int]]:
    """Read a calibration file: of each joint where its range ends, in steps of the encoder.

    Raises
    ------
    InputError
        It is none.
    """
    found: dict[str, dict[str, int]] = read_json(path, "JSON of LeRobot")
    for joint, entry in found.items():
        for key in OF_A_RANGE:
            value = entry.get(key) if isinstance(entry, dict) else None
            if not isinstance(value, int):
                place = f"{joint}.{key}"
                raise InputError.at(path, repr(value), "an integer", place=place)
    return found
