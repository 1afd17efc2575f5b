"""Klipper: the geometry of a delta printer as the block that `SAVE_CONFIG` writes.

The towers must be upright. Their radii may differ: the circle through the three is the one
that Klipper knows, and its centre the origin.
"""

from __future__ import annotations

import math

import numpy as np

from rsicalib.arrays import FloatArray
from rsicalib.errors import InputError
from rsicalib.exports.ask import Ask
from rsicalib.io.rigid import row_motion

TOWERS = ("a", "b", "c")
UPRIGHT = 1e-6
"""Klipper's angles and lengths have six decimals: a tower leans by less [rad]."""


def write(ask: Ask) -> dict[str, str]:
    """Write the block; what stands in the file for the same options must go."""
    ask.unless([f"carriage {tower}" for tower in TOWERS], "a delta printer")
    document = ask.calibrated.mechanism.to_dict()
    chains = {chain["name"]: chain["dh"] for chain in document["chain"]}
    carried = {point["name"]: point["at"] for point in document["point"]}
    arms = {c["name"]: c.get("value") for c in document["closure"] if c["kind"] == "distance"}
    channels = {channel["name"]: channel for channel in document["channel"]}
    places, notes = [], list(ask.calibrated.said)
    for tower in TOWERS:
        foot, way = _tower(chains[f"tower {tower}"], carried[f"carriage {tower}"])
        lean = float(np.arccos(np.clip(way[2], -1.0, 1.0)))
        if lean > UPRIGHT:
            notes.append(f"tower {tower} leans by {lean:.2g} rad")
        places.append(foot)
    feet = np.array(places)
    centre = _centre(feet[:, :2])
    out = []
    radius = float(np.hypot(*(feet[0, :2] - centre)))
    lines = ["[printer]", f"delta_radius = {radius:.6f}"]
    for tower, foot in zip(TOWERS, feet, strict=True):
        x, y = foot[:2] - centre
        arm = arms.get(f"arm {tower}", arms.get(f"rod {tower}"))
        if not isinstance(arm, float) or arm <= radius:
            raise InputError(f"arm {tower}: found {arm!r}, expected a length above the radius")
        channel = channels[tower]
        stop = channel["offset"] + foot[2] - math.sqrt(arm**2 - radius**2)
        angle = math.degrees(math.atan2(y, x)) % 360.0
        lines += ["", f"[stepper_{tower}]", f"angle = {angle:.6f}", f"arm_length = {arm:.6f}"]
        lines += [f"position_endstop = {stop:.6f}"]
        drawn = next(c for c in ask.mechanism.channels if c.name == tower)
        if channel["gain"] != drawn.gain:
            ratio = channel["gain"] / drawn.gain
            notes.append(f"rotation_distance of stepper_{tower} must be {ratio:.7f} times itself")
    if np.abs(centre).max() > UPRIGHT:
        notes.append(f"the origin has moved by {centre[0]:.4g}, {centre[1]:.4g} mm")
    notes += [f"{p.spec}, {p.name}" for p in ask.result.parameters if p.target == "bed"]
    out = [
        "# Remove these options where they stand above, then put this at the end of printer.cfg.\n"
    ]
    out += [f"# not in here: {note}\n" for note in notes]
    out += ["#*# <---------------------- SAVE_CONFIG ---------------------->\n"]
    out += ["#*# DO NOT EDIT THIS BLOCK OR BELOW. The contents are auto-generated.\n#*#\n"]
    out += [f"#*# {line}".rstrip() + "\n" for line in lines]
    return {"save_config.cfg": "".join(out)}


def _tower(rows: list[dict[str, object]], at: list[float]) -> tuple[FloatArray, FloatArray]:
    """Where the carriage is at coordinate zero, and the way that it takes."""
    before = np.eye(4)
    for row in rows:
        if row.get("channel") is not None:
            way = before[:3, 2]
        before = before @ row_motion(row)
    return (before @ np.array([*at, 1.0]))[:3], way


def _centre(points: FloatArray) -> FloatArray:
    """Centre of the circle through three points."""
    sides = 2.0 * (points[1:] - points[0])
    squares = (points[1:] ** 2).sum(axis=1) - (points[0] ** 2).sum()
    found: FloatArray = np.linalg.solve(sides, squares)
    return found
