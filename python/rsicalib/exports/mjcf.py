"""MuJoCo: the calibrated mechanism as a model (MJCF), bodies in the places that were found.

A joint's value is the coordinate of its channel, or the reading itself where that is in its unit
with gain 1: its offset is then in the place of the body. Bodies have no shape.
"""

from __future__ import annotations

from typing import Any
from xml.sax.saxutils import quoteattr

import numpy as np

from rsicalib.errors import InputError
from rsicalib.exports.ask import Ask
from rsicalib.exports.coordinates import factor_of, unit_of
from rsicalib.io.rigid import Matrix, rigid, rotation, row_motion


def write(ask: Ask) -> dict[str, str]:
    """Write `calibrated.xml`; what a model has no words for is a comment in it."""
    found = ask.calibrated
    document = found.mechanism.to_dict()
    if not document.get("chain"):
        raise InputError(f"mechanism: found no chain in {document['name']!r}, expected bodies")
    units = unit_of(found.mechanism)
    channels = {channel["name"]: channel for channel in document["channel"]}
    notes = list(found.said)
    direct = {}
    for name, channel in channels.items():
        direct[name] = channel["unit"] == units[name] and channel["gain"] == 1.0
        if not direct[name]:
            gain, offset = (factor_of(channel) * channel[key] for key in ("gain", "offset"))
            notes.append(
                f"joint {name} is at {gain!r} times the reading of {name}, plus {offset!r}"
            )
    writer = _Writer(channels, direct)
    points = document.get("point", [])
    for chain in document["chain"]:
        carried = [p for p in points if p.get("chain") == chain["name"]]
        writer.chain(chain["name"], chain["dh"], carried)
    writer.drivers()
    # An instrument sees its points elsewhere in each pose.
    seen = {p["name"] for p in points if "at" not in p and "unknown" not in p}
    fixed = [p for p in points if "chain" not in p and "unknown" not in p and "at" in p]
    sites = "".join(_site(point, "    ") for point in fixed)
    known = {p["name"] for p in points if "unknown" not in p} - seen
    connects = ""
    for closure in document["closure"]:
        a, b = closure["between"]
        if closure["kind"] == "equal" and {a, b} <= writer.joints:
            apart = writer.shift(b) - writer.shift(a)
            poly = f' polycoef="{apart!r} 1 0 0 0"' if apart else ""
            connects += f"    <joint joint1={quoteattr(a)} joint2={quoteattr(b)}{poly}/>\n"
        elif closure["kind"] == "touch" and {a, b} <= known:
            name = quoteattr(closure["name"])
            connects += f"    <connect name={name} site1={quoteattr(a)} site2={quoteattr(b)}/>\n"
        else:
            notes.append(f"closure {closure['name']}: {closure['kind']}")
    lines = [" ".join(n.split()).replace("--", "- -") for n in notes]
    comments = "".join(f"  <!-- not in here: {line} -->\n" for line in lines)
    scale = "lengths in " + document["length_unit"]
    return {
        "calibrated.xml": (
            f"<mujoco model={quoteattr(document['name'])}>\n"
            f"  <!-- by rsicalib {ask.result.version}: {scale}, angles in radians -->\n"
            f'{comments}  <compiler angle="radian" boundmass="0.001" boundinertia="0.000001"/>\n'
            f"  <worldbody>\n{sites}{''.join(writer.bodies)}  </worldbody>\n"
            f"  <equality>\n{''.join(writer.ratios)}{connects}  </equality>\n"
            f"  <sensor>\n{''.join(writer.sensors)}  </sensor>\n</mujoco>\n"
        )
    }


class _Writer:
    """Chains on their way to bodies."""

    def __init__(self, channels: dict[str, Any], direct: dict[str, bool]) -> None:
        self.channels = channels
        self.direct = direct
        self.bodies: list[str] = []
        self.sensors: list[str] = []
        self.ratios: list[str] = []
        self.joints: set[str] = set()
        self.followed: dict[str, str] = {}
        """Channels that joints follow, with the kind of these joints."""

    def shift(self, channel: str) -> float:
        """The coordinate of a channel less the value of its joint."""
        return float(self.channels[channel]["offset"]) if self.direct[channel] else 0.0

    def chain(self, name: str, rows: list[dict[str, Any]], points: list[dict[str, Any]]) -> None:
        """Bodies one in the other, a site for each point in the last."""
        before, depth = np.eye(4), 2
        for number, row in enumerate(rows, 1):
            channel = row.get("channel")
            turn = rotation(2, row.get("theta") or 0.0)
            slide = np.eye(4)
            if channel is None:
                before = before @ turn @ _body(row)
                continue
            ratio = 1.0 if row.get("ratio") is None else float(row["ratio"])
            if self.direct[channel]:
                offset = ratio * self.shift(channel)
                if row.get("joint") == "prismatic":
                    slide = rigid([0.0, 0.0, offset])
                else:
                    turn = turn @ rotation(2, offset)
            pad = "  " * depth
            label = quoteattr(f"{name} {number}")
            place = before @ turn @ slide
            self.bodies.append(f"{pad}<body name={label} {_place(place)}>\n")
            self.bodies.append(f"{pad}  {self._joint(channel, row, f'{name} {number}', ratio)}\n")
            before, depth = _body(row), depth + 1
        pad = "  " * depth
        self.bodies += [_site(p, pad, before) for p in points]
        self.bodies += [f"{'  ' * level}</body>\n" for level in range(depth - 1, 1, -1)]

    def _joint(self, channel: str, row: dict[str, Any], place: str, ratio: float) -> str:
        """The joint of a row; one that is a multiple of another follows it."""
        kind = "slide" if row.get("joint") == "prismatic" else "hinge"
        if channel not in self.joints and ratio == 1.0:
            return self._sensed(channel, kind)
        self.followed[channel] = kind
        own, other = quoteattr(f"{place} follows"), quoteattr(channel)
        poly = f"0 {ratio!r} 0 0 0"
        self.ratios.append(f'    <joint joint1={own} joint2={other} polycoef="{poly}"/>\n')
        return f'<joint name={own} type="{kind}" axis="0 0 1"/>'

    def _sensed(self, channel: str, kind: str) -> str:
        """The joint that a channel senses, with its sensor."""
        self.joints.add(channel)
        self.sensors.append(f"    <jointpos joint={quoteattr(channel)}/>\n")
        limits, factor = self.channels[channel].get("limits"), factor_of(self.channels[channel])
        ends = " ".join(repr(end * factor - self.shift(channel)) for end in limits or ())
        span = f' range="{ends}"' if ends else ""
        return f'<joint name={quoteattr(channel)} type="{kind}" axis="0 0 1"{span}/>'

    def drivers(self) -> None:
        """A body for each channel that turns no joint by itself, as motors of a differential."""
        for channel, kind in self.followed.items():
            if channel not in self.joints:
                joint = self._sensed(channel, kind)
                label = quoteattr(f"{channel} drives")
                self.bodies.append(f"    <body name={label}>\n      {joint}\n    </body>\n")


def _body(row: dict[str, Any]) -> Matrix:
    """What follows the joint of a row."""
    return row_motion({**row, "theta": 0.0})


def _site(point: dict[str, Any], pad: str, before: Matrix | None = None) -> str:
    at = (np.eye(4) if before is None else before) @ np.array([*point["at"], 1.0])
    return f'{pad}<site name={quoteattr(point["name"])} pos="{_listed(at[:3])}"/>\n'


def _place(matrix: Matrix) -> str:
    """Position and orientation; two columns of the rotation are as exact as their digits."""
    axes = [*matrix[:3, 0], *matrix[:3, 1]]
    return f'pos="{_listed(matrix[:3, 3])}" xyaxes="{_listed(axes)}"'


def _listed(values: Any) -> str:
    return " ".join(repr(float(value)) for value in values)
