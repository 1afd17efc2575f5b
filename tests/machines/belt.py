"""A sled on four belts: anchors unknown, the sled somewhere in its plane in each pose [mm]."""

from __future__ import annotations

import numpy as np

from tests.machines.kit import Effect, Machine, Rng, Values, effect
from tests.oracle import Array

BELTS = ("tl", "tr", "bl", "br")
ANCHORS = dict(zip(BELTS, ("top left", "top right", "bottom left", "bottom right"), strict=True))
NOISE, PLAY = 0.2, 0.8
"""Of a reading, and of a belt that lies [mm]."""


def draw(rng: Rng, poses: int = 40) -> Machine:
    """A frame 1.4 to 3.2 m wide, drawn some centimetres from where its anchors are."""
    width = float(rng.uniform(1400, 3200))
    high = float(width * rng.uniform(0.55, 0.75))
    drawn = {"tl": (0.0, high), "tr": (width, high), "bl": (0.0, 0.0), "br": (width, 0.0)}
    z = {belt: float(rng.uniform(30, 110)) for belt in BELTS}
    values: Values = {}
    for belt, (x, y) in drawn.items():
        off = rng.normal(0, 15, 2)
        values[f"x@{ANCHORS[belt]}"] = x + (0.0 if belt == "bl" else float(off[0]))
        values[f"y@{ANCHORS[belt]}"] = y + (float(off[1]) if belt in ("tl", "tr") else 0.0)
    across, up = rng.uniform(0.15, 0.85, (2, poses))
    sled = np.column_stack([across * width, up * high])
    late = (np.arange(poses) >= rng.integers(poses // 4, 3 * poses // 4)).astype(float)

    def gap(read: Array, places: Array, v: Values) -> Array:
        out = np.empty((len(read), 4))
        middle, half = width / 2, width / 2
        for i, (belt, anchor) in enumerate(ANCHORS.items()):
            moved = late * v.get(f"moved@{anchor}", 0.0)
            dx = places[:, 0] - v[f"x@{anchor}"] - moved
            dy = places[:, 1] - v[f"y@{anchor}"]
            low = 1.0 if belt in ("bl", "br") else 0.0
            offset: Array | float = v.get(f"offset@{belt}", 0.0) + v.get("offset@all", 0.0)
            offset = offset + low * v.get("offset@bl+br", 0.0) + late * v.get(f"slip@{belt}", 0.0)
            gain = v.get(f"gain@{belt}", 0.0) + low * v.get("gain@bl+br", 0.0)
            u = (read[:, i] - middle) / half
            told = read[:, i] * (1 + gain) + offset + v.get(f"curvature@{belt}", 0.0) * u * u
            out[:, i] = np.sqrt(dx * dx + dy * dy + z[belt] ** 2) - told
        return out

    free = [f"{c}@{a}" for a in ("top left", "top right") for c in "xy"] + ["x@bottom right"]
    start = np.array([sum(drawn["tl"]) / 3] * 4)
    return Machine(
        name="belts",
        mechanism=mechanism(drawn, z),
        columns=BELTS,
        sigma=np.full(4, NOISE),
        play=np.full(4, PLAY),
        gap=gap,
        start=np.column_stack([np.tile(start, (poses, 1)), sled]),
        gives=np.array([1e3] * 4 + [0.0, 0.0]),
        values=values,
        fitted=dict.fromkeys(free, 0.1),
        effects=tuple(effects()),
    )


def effects() -> list[Effect]:
    """What a belt machine may have; a belt too long is its offset, by another name."""
    out = []
    for belt, anchor in ANCHORS.items():
        closed = f"belt {belt}"
        out += [
            effect(f"offset@{belt}", "sensor", 3.0, belt, closed, also=("closure",)),
            effect(f"gain@{belt}", "sensor", 1e-3, belt, closed, also=("closure",)),
            effect(f"curvature@{belt}", "sensor", 3.0, belt, closed, also=("closure",)),
            effect(f"slip@{belt}", "sensor", 2.0, belt, closed, also=("closure",)),
            effect(f"moved@{anchor}", "geometry", 2.0, anchor, closed, also=("closure",)),
        ]
    lower = ("bl+br", "belt bl+belt br")
    all_ = ("tl+tr+bl+br", "each", "all")
    return [
        *out,
        effect("offset@bl+br", "sensor", 3.0, *lower, also=("closure",)),
        effect("gain@bl+br", "sensor", 1e-3, *lower, also=("closure",)),
        effect("offset@all", "sensor", 10.0, *all_, also=("closure", "electronics")),
    ]


def mechanism(drawn: dict[str, tuple[float, float]], z: dict[str, float]) -> dict[str, object]:
    """The mechanism file: three coordinates fixed, by which the whole stands somewhere."""
    free = {"tl": ["x", "y"], "tr": ["x", "y"], "br": ["x"]}
    middle = [drawn["tr"][0] / 2, drawn["tr"][1] / 2, 0.0]
    points: list[dict[str, object]] = [
        {"name": "sled", "unknown": ["pose"], "at": middle, "free": ["x", "y"]}
    ]
    for belt, anchor in ANCHORS.items():
        point: dict[str, object] = {"name": anchor, "at": [*drawn[belt], z[belt]]}
        points.append(point | ({"unknown": [], "free": free[belt]} if belt in free else {}))
    channels = [
        {"name": b, "unit": "mm", "gain": 1.0, "offset": 0.0, "noise": NOISE} for b in BELTS
    ]
    closures = [
        {
            "name": f"belt {b}",
            "kind": "distance",
            "between": ["sled", ANCHORS[b]],
            "channel": b,
            "noise": PLAY,
        }
        for b in BELTS
    ]
    return {
        "name": "sled on belts",
        "length_unit": "mm",
        "channel": channels,
        "point": points,
        "closure": closures,
        "model": {"terms": []},
    }
