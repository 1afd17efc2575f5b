"""Pictures of the terms: what each does, computed by the core at its typical size.

A term that acts on readings is drawn as the correction of a joint angle over what it depends on. A
term that moves something is drawn as an arm, as drawn (grey) and with the effect, many times
enlarged.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from html import escape
from typing import Any

import numpy as np

from rsicalib import _core
from rsicalib._core import Mechanism
from rsicalib.arrays import FloatArray

WIDTH, HEIGHT = 360.0, 170.0
ROWS = 121

VARIABLES = {
    "reference_drift": "time",
    "reference_wander": "time",
    "reference_temperature": "temperature",
    "drift": "time",
    "wander": "time",
    "slip": "time",
    "temperature_offset": "temperature",
    "temperature_gain": "temperature",
    "crosstalk": "neighbour",
    "lag": "velocity",
    "drag": "velocity",
    "servo": "acceleration",
    "channel_skew": "velocity",
}
"""What a correction is drawn over, where that is not the reading."""

LABELS = {
    "reading": "reading [counts]",
    "time": "time in the session, 0 to 1",
    "temperature": "temperature [°C]",
    "neighbour": "reading of the neighbour [counts]",
    "velocity": "velocity [counts/s]",
    "acceleration": "acceleration [counts/s²]",
}

SENSED = """
name = "joint"
length_unit = "m"
channel = [
  {name = "b", unit = "count", range = [0, 4095], gain = 1e-3, offset = -2.0475},
  {name = "a", unit = "count", range = [0, 4095], gain = 1e-3, offset = -2.0475},
]
chain = [
  {name = "left", dh = [{channel = "b", a = 1.0}]},
  {name = "right", dh = [{channel = "a", a = 1.0}]},
]
point = [
  {name = "one", chain = "left", at = [0, 0, 0]},
  {name = "two", chain = "right", at = [0, 0, 0]},
]
closure = [{name = "rod", kind = "distance", between = ["one", "two"], value = 1.0}]
"""

FOLLOWER = '{name = "follower", kind = "equal", between = ["b", "a"]}'
"""A closure by which one joint is to be where the other is."""

LIMBS = (
    "d = 0.35, alpha = 1.5707963",
    "a = 0.8, mass = 1.0, com = [0.4, 0, 0]",
    "a = 0.6, mass = 1.0, com = [0.3, 0, 0]",
)
POSE = (-0.5, 1.0, -1.1)
"""Readings of the arm that is drawn [rad]."""


def picture(term: Mapping[str, Any]) -> str:
    """Draw a term.

    Parameters
    ----------
    term : mapping
        As `rsicalib.terms` gives it.

    Returns
    -------
    str
        An SVG document.
    """
    if term["class"] in ("sensor", "electronics", "data"):
        body = _correction(term)
    elif term["id"].startswith(("plane_", "line_")):
        body = _surface(bent=term["id"].endswith("_bend"))
    elif term["class"] == "closure":
        body = _distance(term["parameters"][0]["name"])
    else:
        body = _arm(term)
    words = escape(f"{term['id'].replace('_', ' ')}: what it does")
    return (
        f'<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 {WIDTH:g} {HEIGHT:g}" '
        f'width="{WIDTH:g}" role="img" aria-label="{words}">\n{STYLE}\n{body}\n</svg>\n'
    )


STYLE = """<style>
text { font: 12px ui-sans-serif, system-ui, sans-serif; fill: #6d6d66; }
.axis { stroke: #8a8a82; } .old { stroke: #a8a8a0; fill: none; stroke-width: 3; }
.new { stroke: #1f5f8b; fill: none; stroke-width: 2; } .joint { fill: #1f5f8b; }
@media (prefers-color-scheme: dark) { text { fill: #9a9a92; } .old { stroke: #63645e; }
  .new { stroke: #7db8e0; } .joint { fill: #7db8e0; } }
</style>"""


def _applied(
    mechanism: Mechanism, parameters: list[tuple[tuple[str, str, str | None], str, float]]
) -> dict[str, Any]:
    """A result of these parameters alone."""
    channels = mechanism.channels
    middle = [sum(c.range) / 2 if c.range else 0.0 for c in channels]
    span = [list(c.range) if c.range else [-math.pi, math.pi] for c in channels]
    known = {"centre": middle, "span": span, "temperature": 20.0, "sigma": [1.0] * len(channels)}
    return {**known, "declared": True, "closures": [], "own": True, "parameters": parameters}


def _table(values: FloatArray, **more: Any) -> dict[str, Any]:
    empty = {"pose": None, "time": None, "temperature": None, "session": None}
    return {"values": values, **empty, "keys": [], "columns": [], "used": None, **more}


def _correction(term: Mapping[str, Any]) -> str:
    follows = term["id"] == "drag"
    drawing = SENSED.replace("closure = [", f"closure = [{FOLLOWER}, ") if follows else SENSED
    mechanism = Mechanism(drawing)
    kind = VARIABLES.get(term["id"], "reading")
    share = np.linspace(0.0, 1.0, ROWS)
    values = np.full((ROWS, 2), 2800.0)
    more: dict[str, Any] = {"time": share, "temperature": np.full(ROWS, 20.0)}
    x = 4095.0 * share
    if kind == "reading":
        values[:, 1] = x
    elif kind == "neighbour":
        values[:, 0] = x
    elif kind == "temperature":
        x = more["temperature"] = 10.0 + 20.0 * share
    elif kind in ("velocity", "acceleration"):  # a swing, fastest in its middle
        more["time"] = 4.0 * share
        values[:, 1] = 2047.5 + 1500.0 * np.sin(np.pi * (share - 0.5))
        x = np.gradient(values[:, 1], more["time"])
        if kind == "acceleration":
            x = -((np.pi / 4.0) ** 2) * (values[:, 1] - 2047.5)
        if follows:
            values[:, 0] = values[:, 1]
    else:
        x = share
    if term["id"] == "hysteresis":  # up, and down again, as held poses
        values = np.vstack([values, values[::-1]])
        x = np.r_[x, x[::-1]]
        more = {"pose": np.arange(len(values))}
    if term["id"] == "bad_reading":
        more |= {"pose": np.arange(ROWS)}
    place = {"label of a pose": "60", "waves per turn": "3"}.get(term["place"])
    target = {"electronics": "all"}.get(term["class"], "a")
    sizes = {p["name"]: p["typical"] * (-1) ** k for k, p in enumerate(term["parameters"])}
    declared = mechanism.channels[1]
    absolute = {
        "offset": declared.offset,
        "gain": declared.gain,
    }  # of these the value itself is asked
    sizes = {name: size + absolute.get(name, 0.0) for name, size in sizes.items()}
    wanted = [((term["id"], target, place), name, size) for name, size in sizes.items()]
    angles = []
    for parameters in ([], wanted):
        found = _core.places(mechanism, _applied(mechanism, parameters), _table(values, **more))
        at = dict(zip(found[0], np.asarray(found[1]).T, strict=True))
        angles.append(np.arctan2(at["two.y"], at["two.x"]))
    turn = (angles[1] - angles[0] + np.pi) % (2 * np.pi) - np.pi
    return _curve(np.asarray(x), 1e3 * turn, LABELS[kind])


def _curve(x: FloatArray, y: FloatArray, words: str) -> str:
    left, right, top, bottom = 46.0, WIDTH - 8.0, 10.0, HEIGHT - 34.0
    low, high = min(0.0, float(y.min())), max(0.0, float(y.max()))
    room = 0.08 * (high - low) or 1.0
    low, high = low - room, high + room

    def across(value: float) -> float:
        return float(left + (right - left) * (value - x.min()) / (np.ptp(x) or 1.0))

    def up(value: float) -> float:
        return bottom - (bottom - top) * (value - low) / (high - low)

    points = " ".join(f"{across(a):.1f},{up(b):.1f}" for a, b in zip(x, y, strict=True))
    body = [f'<line class="axis" x1="{left}" y1="{up(0):.1f}" x2="{right}" y2="{up(0):.1f}"/>']
    body.append(f'<polyline class="new" points="{points}"/>')
    for value in (float(y.min()), float(y.max())):
        if abs(value) > 0.02 * (high - low):
            body.append(_text(left - 4, up(value) + 4, f"{value:.2g}", "end"))
    body.append(_text(left - 4, up(0.0) + 4, "0", "end"))
    for value in (float(x.min()), float(x.max())):
        anchor = "start" if value == x.min() else "end"
        body.append(_text(across(value), bottom + 14, f"{value:.4g}", anchor))
    body.append(_text((left + right) / 2, HEIGHT - 6, escape(words), "middle"))
    body.append(
        f'<text x="12" y="{(top + bottom) / 2:.0f}" text-anchor="middle" '
        f'transform="rotate(-90 12 {(top + bottom) / 2:.0f})">correction [mrad]</text>'
    )
    return "\n".join(body)


def _arm(term: Mapping[str, Any]) -> str:
    """An arm of three joints, as drawn and with the effect."""
    chains, names = [], []
    for k in range(1, 4):  # a chain to each joint: that is where the places of joints are from
        own = [f"q{j + 1}to{k}" for j in range(k)]
        rows = [f'{{channel = "{c}", {limb}}}' for c, limb in zip(own, LIMBS, strict=False)]
        if k == 3 and term["id"] == "ratio":  # bars turn the last link back as the second turns
            rows[2] = f'{{channel = "{own[1]}", ratio = -1.0}}, {rows[2]}'
        chains.append(f'{{name = "to{k}", dh = [{", ".join(rows)}]}}')
        names += own
    joints = ", ".join(f'{{name = "{c}", unit = "rad", gain = 1.0, offset = 0.0}}' for c in names)
    points = [f'{{name = "p{k}", chain = "to{k}", at = [0, 0, 0]}}' for k in range(1, 4)]
    mechanism = Mechanism(
        f'name = "arm"\nlength_unit = "m"\ngravity = [0, 0, -1]\nchannel = [{joints}]\n'
        f"chain = [{', '.join(chains)}]\n"
        f'point = [{", ".join(points)}, {{name = "fixed", at = [1, 0, 0]}}]\n'
        'closure = [{name = "bar", kind = "distance", between = ["p3", "fixed"], value = 1.0}]\n'
    )
    drawn = []
    for share in (0.0, 1.0):
        drawn.append(_joints(mechanism, _effect(term, share)))
    body = []
    for name, joint in zip(("old", "new"), drawn, strict=True):
        # Looked at from above and aside, so that what leaves the plane is seen.
        places = [(40 + 190 * x + 90 * y, 150 - 105 * z - 60 * y) for x, y, z in joint]
        line = " ".join(f"{x:.1f},{y:.1f}" for x, y in places)
        body.append(f'<polyline class="{name}" points="{line}"/>')
        if name == "new":
            body += [f'<circle class="joint" cx="{x:.1f}" cy="{y:.1f}" r="3"/>' for x, y in places]
    body.append(_text(WIDTH - 8, HEIGHT - 24, "grey: as drawn", "end"))
    body.append(_text(WIDTH - 8, HEIGHT - 8, "blue: with the effect, enlarged", "end"))
    return "\n".join(body)


def _effect(
    term: Mapping[str, Any], share: float
) -> list[tuple[tuple[str, str, str | None], str, float]]:
    """Parameters of the effect on every chain that it acts on: what it does to the whole arm."""
    name, parameter = term["id"], term["parameters"][0]["name"]
    large = 0.25 * share
    if name == "link_growth":  # at one temperature it is a length
        name, parameter = "link_length", "a"
    if name == "link_side":  # rows of this arm have it as their length
        return [(("link_frame", f"to{k}/2", None), "y", large) for k in (2, 3)]
    if name in ("link_length", "link_offset", "joint_tilt", "link_frame"):
        sizes = {parameter: large}
        if name == "joint_tilt":
            sizes = {"alpha": 2.0 * large, "beta": large}
        if name == "link_frame":
            sizes = {"x": 0.5 * large, "y": -0.6 * large, "rz": 1.5 * large}
        return [((name, f"to{k}/2", None), p, v) for k in (2, 3) for p, v in sizes.items()]
    if name == "ratio":
        return [((name, "to3/3", None), parameter, 2.0 * large)]
    if name in ("joint_compliance", "joint_sag", "counterbalance", "gear_play"):
        return [((name, f"q2to{k}", None), parameter, large) for k in (2, 3)]
    if name == "sag":
        return [((name, "all", None), parameter, 0.6 * large)]
    if name == "base_bearing":
        return [((name, f"to{k}", None), parameter, 2.0 * large) for k in (1, 2, 3)]
    if name == "base_tilt":
        return [((name, f"to{k}", None), "ry", large) for k in (1, 2, 3)]
    if name in ("point_position", "tool_slip"):  # the same, from one pose on
        return [(("point_position", "to3", None), "y", -large)]
    if name == "base_slip":
        name = "base_position"
    return [((name, f"to{k}", None), parameter, large) for k in (1, 2, 3)]


def _joints(
    mechanism: Mechanism, parameters: list[tuple[tuple[str, str, str | None], str, float]]
) -> FloatArray:
    """Places of the base and of the three joints, shape (4, 3)."""
    applied = _applied(mechanism, parameters)
    found = _core.places(mechanism, applied, _table(np.array([[*POSE[:1], *POSE[:2], *POSE]])))
    tips = np.asarray(found[1]).reshape(3, 3)
    base = np.zeros(3)
    if parameters and parameters[0][0][0] == "base_position":
        base[0] = parameters[0][2]
    return np.vstack([base, tips])


def _surface(bent: bool) -> str:
    """A plane or a line from the side, and the same bent or moved."""
    body = '<line class="old" x1="60" y1="90" x2="285" y2="90"/>'
    path = "M60 70 Q172 120 285 70" if bent else "M60 60 L285 80"
    return f'{body}<path class="new" d="{path}"/>'


def _distance(parameter: str) -> str:
    body = ['<line class="old" x1="60" y1="90" x2="250" y2="90"/>']
    body.append('<line class="new" x1="60" y1="80" x2="285" y2="80"/>')
    body += [f'<circle class="joint" cx="{x}" cy="80" r="4"/>' for x in (60, 285)]
    body.append(_text(172, 66, f"value + {parameter}", "middle"))
    body.append(_text(155, 112, "value, as drawn", "middle"))
    return "\n".join(body)


def _text(x: float, y: float, words: str, anchor: str) -> str:
    return f'<text x="{x:.1f}" y="{y:.1f}" text-anchor="{anchor}">{words}</text>'
