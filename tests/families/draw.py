"""The families of machines: each draws its geometry, its noise and its session at random."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np

from tests.oracle import Array, Mechanism

HALF = np.pi / 2
Rng = np.random.Generator


@dataclass(frozen=True)
class Drawing:
    """A machine on paper, and how a session with it is taken.

    `sigma` is the true noise of every channel in its unit, `play` the true one of every closure;
    `scatter` how far true offsets, in joint coordinates, are from the drawn ones, `gains` how far
    true gains. `sockets` are true places of unknown points, by `(group, at)`.
    """

    mechanism: Mechanism
    poses: int
    samples: int
    sigma: Array
    scatter: Array
    gains: float = 0.0
    play: float = 0.0
    warm: bool = False
    sockets: dict[tuple[str, str], Array] | None = None
    held: bool = True


def scaled(rng: Rng, value: float, by: float = 0.15) -> float:
    """A dimension that differs from drawing to drawing, to four digits."""
    return float(f"{value * (1 + by * rng.uniform(-1, 1)):.4g}")


def encoder(name: str, low: float, high: float, noise: float | None = None) -> dict[str, Any]:
    """A channel in radians, or in the length unit, that reads the joint itself."""
    channel = {"name": name, "unit": "rad", "gain": 1.0, "offset": 0.0, "limits": [low, high]}
    return channel if noise is None else {**channel, "noise": noise}


def fourbar(rng: Rng) -> Drawing:
    """A planar crank and rocker with an encoder on each, and a coupler of known length [mm]."""
    crank, rocker = scaled(rng, 40.0), scaled(rng, 90.0)
    ground = scaled(rng, 110.0, 0.1)
    coupler = float(f"{0.5 * (ground - crank + rocker) + crank * rng.uniform(0.6, 1.0):.4g}")
    mechanism = {
        "name": "four-bar",
        "length_unit": "mm",
        "channel": [encoder("crank", -3.1, 3.1), encoder("rocker", 0.2, 3.0)],
        "chain": [
            {"name": "input", "dh": [{"channel": "crank", "a": crank}]},
            {"name": "output", "dh": [{"a": ground}, {"channel": "rocker", "a": rocker}]},
        ],
        "point": [
            {"name": "pin", "chain": "input", "at": [0.0, 0.0, 0.0]},
            {"name": "end", "chain": "output", "at": [0.0, 0.0, 0.0]},
        ],
        "closure": [
            {"name": "coupler", "kind": "distance", "between": ["pin", "end"], "value": coupler}
        ],
        "model": {"terms": ["offset"]},
    }
    return Drawing(mechanism, 60, 4, np.full(2, 2e-4), np.full(2, 0.02))


def fivebar(rng: Rng) -> Drawing:
    """Two planar arms of two sensed joints that meet in a pin [m]."""
    upper, lower = scaled(rng, 0.4), scaled(rng, 0.55)
    base = scaled(rng, 0.35)
    arms = [
        {"name": "left", "dh": [{"channel": "l1", "a": upper}, {"channel": "l2", "a": lower}]},
        {
            "name": "right",
            "dh": [{"a": base}, {"channel": "r1", "a": scaled(rng, upper)}]
            + [{"channel": "r2", "a": scaled(rng, lower)}],
        },
    ]
    mechanism = {
        "name": "five-bar",
        "length_unit": "m",
        "channel": [
            encoder("l1", 0.9, 3.1),
            encoder("l2", -2.4, -0.3),
            encoder("r1", 0.0, 2.2),
            encoder("r2", 0.3, 2.4),
        ],
        "chain": arms,
        "point": [
            {"name": "left tip", "chain": "left", "at": [0.0, 0.0, 0.0]},
            {"name": "right tip", "chain": "right", "at": [0.0, 0.0, 0.0]},
        ],
        "closure": [{"name": "pin", "kind": "touch", "between": ["left tip", "right tip"]}],
        "model": {"terms": ["offset"]},
    }
    return Drawing(mechanism, 40, 4, np.full(4, 1e-4), np.full(4, 0.02), warm=True)


def six_joints(rng: Rng, unit: float, noise: float) -> tuple[list[Any], list[Any]]:
    """Channels and rows of an arm with six turning joints; `unit` is a metre in its unit."""
    rows: list[Any] = [
        {"channel": "q1", "d": scaled(rng, 0.16 * unit), "alpha": HALF},
        {"channel": "q2", "a": -scaled(rng, 0.42 * unit)},
        {"channel": "q3", "a": -scaled(rng, 0.39 * unit)},
        {"channel": "q4", "d": scaled(rng, 0.13 * unit), "alpha": HALF},
        {"channel": "q5", "d": scaled(rng, 0.1 * unit), "alpha": -HALF},
        {"channel": "q6", "d": scaled(rng, 0.1 * unit)},
    ]
    ends = [(-3.0, 3.0), (-3.0, 0.0), (-2.6, 2.6), (-3.0, 3.0), (-3.0, 3.0), (-3.0, 3.0)]
    channels = [encoder(f"q{k}", *end, noise) for k, end in enumerate(ends, start=1)]
    return channels, rows


def sockets(rng: Rng) -> Drawing:
    """An arm with heavy links whose ball rests in two sockets of a plate, placed thrice [m]."""
    noise, play = 2e-5, 5e-5
    channels, rows = six_joints(rng, 1.0, noise)
    for row, mass in zip(rows, (4.0, 8.0, 3.0, 1.3, 1.2, 0.8), strict=True):
        row["mass"] = scaled(rng, mass)
        row["com"] = [0.5 * row.get("a", 0.0), 0.0, 0.5 * row.get("d", 0.0)]
    between = 0.15
    mechanism = {
        "name": "arm on sockets",
        "length_unit": "m",
        "gravity": [0, 0, -1],
        "channel": channels,
        "chain": [{"name": "arm", "dh": rows}],
        "point": [
            {"name": "ball", "chain": "arm", "at": [scaled(rng, 0.06), 0.0, scaled(rng, 0.12)]},
            {"name": "socket", "unknown": ["group", "at"]},
        ],
        "closure": [
            {"name": "rest", "kind": "touch", "between": ["ball", "socket"], "noise": play},
            {
                "name": "plate",
                "kind": "distance",
                "between": ["socket[at=A]", "socket[at=B]"],
                "value": between,
                "sd": 1e-5,
            },
        ],
        "model": {"terms": [f"offset@q{k}" for k in range(2, 7)]},
    }
    places = {}
    for group, bearing in (("front", 0.2), ("left", 1.7), ("back", -1.2)):
        centre = np.array([np.cos(bearing), np.sin(bearing), 0.0]) * rng.uniform(0.35, 0.55)
        centre[2] = rng.uniform(0.05, 0.55)
        along = rng.normal(size=3)
        along *= between / 2 / np.linalg.norm(along)
        places[group, "A"], places[group, "B"] = centre - along, centre + along
    scatter = np.array([0.0, 0.01, 0.01, 0.01, 0.01, 0.01])
    return Drawing(
        mechanism, 20, 1, np.full(6, noise), scatter, play=play, sockets=places, held=False
    )


def ballbar(rng: Rng) -> Drawing:
    """An arm whose tool ball is held at a known distance from a ball on the table [mm]."""
    noise, play = 3e-5, 0.005
    channels, rows = six_joints(rng, 1000.0, noise)
    mechanism = {
        "name": "ball bar",
        "length_unit": "mm",
        "gravity": [0, 0, -1],
        "channel": channels,
        "chain": [{"name": "arm", "dh": rows}],
        "point": [
            {"name": "ball", "chain": "arm", "at": [scaled(rng, 50.0), 0.0, scaled(rng, 120.0)]},
            {"name": "table", "at": [scaled(rng, 350.0), scaled(rng, -200.0), 30.0]},
        ],
        "closure": [
            {
                "name": "bar",
                "kind": "distance",
                "between": ["ball", "table"],
                "value": scaled(rng, 500.0),
                "noise": play,
            }
        ],
        "model": {"terms": ["offset"]},
    }
    return Drawing(mechanism, 150, 1, np.full(6, noise), np.full(6, 0.01), play=play)


def gantry(rng: Rng) -> Drawing:
    """A jointed arm and a sliding one that hold a bar by two distances [mm]."""
    turn, slide = 5e-5, 5e-3
    channels = [
        encoder("t1", -1.2, 1.2, turn),
        encoder("t2", -2.2, -0.3, turn),
        encoder("z1", -60.0, 60.0, slide),
        encoder("t3", -1.5, 1.5, turn),
        encoder("x2", 150.0, 450.0, slide),
        encoder("w2", -1.0, 1.0, turn),
        encoder("z2", -60.0, 60.0, slide),
    ]
    for channel in channels:
        channel["unit"] = "mm" if channel["name"] in ("z1", "x2", "z2") else "rad"
    left = [
        {"channel": "t1", "a": scaled(rng, 300.0), "d": 120.0},
        {"channel": "t2", "a": scaled(rng, 250.0)},
        {"channel": "z1", "joint": "prismatic"},
        {"channel": "t3", "a": scaled(rng, 60.0), "alpha": HALF},
    ]
    right = [
        {"theta": HALF, "a": scaled(rng, -350.0), "alpha": HALF},
        {"channel": "x2", "joint": "prismatic", "alpha": -HALF},
        {"channel": "w2", "a": scaled(rng, 80.0), "alpha": 0.6},
        {"channel": "z2", "joint": "prismatic", "d": 150.0},
    ]
    mechanism = {
        "name": "gantry and arm",
        "length_unit": "mm",
        "channel": channels,
        "chain": [{"name": "scara", "dh": left}, {"name": "gantry", "dh": right}],
        "point": [
            {"name": "a1", "chain": "scara", "at": [20.0, scaled(rng, 40.0), 0.0]},
            {"name": "a2", "chain": "scara", "at": [-10.0, -30.0, scaled(rng, 25.0)]},
            {"name": "b1", "chain": "gantry", "at": [30.0, 0.0, scaled(rng, 20.0)]},
            {"name": "b2", "chain": "gantry", "at": [-30.0, scaled(rng, 35.0), 0.0]},
        ],
        "closure": [
            {"name": "bar1", "kind": "distance", "between": ["a1", "b1"], "value": 200.0},
            {"name": "bar2", "kind": "distance", "between": ["a2", "b2"], "value": 220.0},
        ],
        "model": {"terms": ["offset"]},
    }
    sigma = np.array([c["noise"] for c in channels])
    scatter = np.where(sigma == slide, 0.5, 0.01)
    return Drawing(mechanism, 60, 3, sigma, scatter, warm=True)


def rps(rng: Rng) -> Drawing:
    """A platform on three legs that turn and slide, both read in counts [mm]."""
    radius, side = scaled(rng, 180.0), scaled(rng, 200.0)
    turn, slide = 1.2e-3, 0.05
    channels, chains, tips = [], [], []
    for i in range(3):
        bearing = 2 * np.pi * i / 3
        channels += [
            {
                "name": f"turn{i + 1}",
                "unit": "count",
                "range": [0, 4095],
                "gain": turn,
                "offset": -2048 * turn,
                "limits": [-0.5, 0.5],
            },
            {
                "name": f"leg{i + 1}",
                "unit": "count",
                "range": [0, 8191],
                "gain": slide,
                "offset": 150.0,
                "limits": [240.0, 440.0],
            },
        ]
        rows = [
            {"theta": bearing, "a": radius, "alpha": HALF},
            {"channel": f"turn{i + 1}", "alpha": -HALF},
            {"channel": f"leg{i + 1}", "joint": "prismatic"},
        ]
        chains.append({"name": f"leg{i + 1}", "dh": rows})
        tips.append({"name": f"ball{i + 1}", "chain": f"leg{i + 1}", "at": [0.0, 0.0, 0.0]})
    reach = side / np.sqrt(3.0)
    platform = {
        f"ball{i + 1}": [
            float(reach * np.cos(2 * np.pi * i / 3)),
            float(reach * np.sin(2 * np.pi * i / 3)),
            0.0,
        ]
        for i in range(3)
    }
    sides = [
        {
            "name": f"side{a}{b}",
            "kind": "distance",
            "between": [f"ball{a}", f"ball{b}"],
            "value": side,
        }
        for a, b in ((1, 2), (2, 3), (1, 3))
    ]
    mechanism = {
        "name": "three legs",
        "length_unit": "mm",
        "channel": channels,
        "chain": chains,
        "point": tips,
        "closure": sides,
        "platform": platform,
        "model": {"terms": ["offset", "gain"]},
    }
    return Drawing(
        mechanism,
        48,
        4,
        np.full(6, 1.0),
        np.array([0.02, 2.0] * 3),
        gains=0.01,
        warm=True,
    )


def drawwire(rng: Rng) -> Drawing:
    """An arm on a rail, and a wire from its tool to an anchor whose length is measured [cm]."""
    turn, slide, wire = 5e-5, 2e-3, 5e-3
    channels = [
        encoder("rail", 0.0, 120.0, slide),
        encoder("q1", -3.0, 3.0, turn),
        encoder("q2", -2.8, 0.0, turn),
        encoder("q3", -2.2, 2.2, turn),
    ]
    channels[0]["unit"] = "cm"
    rows = [
        {"theta": HALF, "alpha": HALF},
        {"channel": "rail", "joint": "prismatic", "alpha": -HALF},
        {"channel": "q1", "d": scaled(rng, 30.0), "alpha": HALF},
        {"channel": "q2", "a": scaled(rng, 45.0)},
        {"channel": "q3", "a": scaled(rng, 40.0)},
    ]
    mechanism = {
        "name": "draw wire",
        "length_unit": "cm",
        "channel": channels,
        "chain": [{"name": "arm", "dh": rows}],
        "point": [
            {"name": "eyelet", "chain": "arm", "at": [5.0, scaled(rng, 4.0), scaled(rng, 6.0)]},
            {"name": "anchor", "at": [scaled(rng, 60.0), scaled(rng, 110.0), scaled(rng, -15.0)]},
        ],
        "closure": [
            {
                "name": "wire",
                "kind": "distance",
                "between": ["eyelet", "anchor"],
                "value": "wire",
                "noise": wire,
            }
        ],
        "model": {"terms": ["offset"]},
    }
    sigma = np.array([slide, turn, turn, turn])
    scatter = np.array([0.1, 0.01, 0.01, 0.01])
    return Drawing(mechanism, 150, 1, sigma, scatter, play=wire)


FAMILIES: dict[str, Callable[[Rng], Drawing]] = {
    "fourbar": fourbar,
    "fivebar": fivebar,
    "sockets": sockets,
    "ballbar": ballbar,
    "gantry": gantry,
    "rps": rps,
    "drawwire": drawwire,
}
"""By the name that the command takes."""
