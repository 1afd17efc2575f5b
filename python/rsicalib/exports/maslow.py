"""Maslow4: the anchors as commands of its firmware, `$/kinematics/MaslowKinematics/tlX=0.6`."""

from __future__ import annotations

import math

from rsicalib.errors import InputError
from rsicalib.exports.ask import Ask

ANCHORS = {"tl": "top left", "tr": "top right", "bl": "bottom left", "br": "bottom right"}
NEAR = 1e-6
"""Of a mm: the firmware has its origin bottom left, and bottom right on the axis x."""


def write(ask: Ask) -> dict[str, str]:
    """Write the commands, to be sent one by one; lines with `;` are comments."""
    ask.unless(list(ANCHORS.values()), "a sled on four belts")
    if ask.result.length_unit != "mm":
        raise InputError(f"mechanism: found lengths in {ask.result.length_unit!r}, expected 'mm'")
    found = ask.calibrated
    points = {point["name"]: list(point["at"]) for point in found.mechanism.to_dict()["point"]}
    for p in ask.result.parameters:
        if p.target in points and p.name in ("x", "y", "z") and p.value is not None:
            points[p.target]["xyz".index(p.name)] = p.value
    at = {belt: points[name] for belt, name in ANCHORS.items()}
    x, y = at["bl"][:2]
    turn = math.atan2(at["br"][1] - y, at["br"][0] - x)
    cos, sin = math.cos(turn), math.sin(turn)
    lines = [f"; anchors of {found.mechanism.name} [mm], by rsicalib {ask.result.version}\n"]
    if max(abs(x), abs(y), abs(turn) * max(at["br"][0] - x, 1.0)) > NEAR:
        lines.append("; moved and turned as a whole: bottom left is the origin\n")
    for belt, (u, v, z) in at.items():
        place = (cos * (u - x) + sin * (v - y), -sin * (u - x) + cos * (v - y), z)
        for axis, value in zip("XYZ", place, strict=True):
            text = f"{value:.3f}".replace("-0.000", "0.000")
            lines.append(f"$/kinematics/MaslowKinematics/{belt}{axis}={text}\n")
    lines += [f"; not in here: {note}\n" for note in _left_out(ask)]
    return {"maslow.txt": "".join(lines)}


def _left_out(ask: Ask) -> list[str]:
    """What the firmware has no place for: it takes a belt as its sensor reads it."""
    out = list(ask.calibrated.said)
    drawn = {channel.name: channel for channel in ask.mechanism.channels}
    for channel in ask.calibrated.mechanism.channels:
        gain, offset = channel.gain, channel.offset
        if gain != drawn[channel.name].gain or offset != drawn[channel.name].offset:
            out.append(f"belt {channel.name} is {gain:.7g} times what it reads, {offset:+.4g} mm")
    return out
