"""A delta printer: three carriages, three rods, and a nozzle that touches the bed [mm]."""

from __future__ import annotations

import numpy as np

from tests.machines.kit import Effect, Machine, Rng, Values, effect
from tests.oracle import Array

TOWERS = ("a", "b", "c")
NOISE, PLAY = 1.0, 0.03
"""Of a reading [steps], and of a touch [mm]."""
ALSO = ("closure", "geometry")


def draw(rng: Rng, poses: int = 48) -> Machine:
    """Rods of 200 to 350 mm, endstops some millimetres from where they were set."""
    rod, tall = rng.uniform(200, 350), rng.uniform(550, 750)
    radius = rod * rng.uniform(0.42, 0.55)
    gain = -1 / rng.choice([80.0, 100.0, 106.667, 160.0])
    bearing = np.deg2rad([90.0, 210.0, 330.0])
    # The mechanism file means the height of a carriage by its offset, a round guess.
    drawn = {"offset": round(tall)}
    values: Values = {f"offset@{t}": drawn["offset"] + rng.normal(0, 2) for t in TOWERS}
    r, phi = 0.8 * radius * np.sqrt(rng.uniform(0, 1, poses)), rng.uniform(0, 2 * np.pi, poses)
    nozzle = np.column_stack([r * np.cos(phi), r * np.sin(phi), np.zeros(poses)])
    bend = rng.normal(0, 1, 3)
    late = (np.arange(poses) >= poses // 2).astype(float)

    def gap(read: Array, places: Array, v: Values) -> Array:
        out = np.empty((len(read), 4))
        x, y, z = places.T
        for i, t in enumerate(TOWERS):
            span = abs(gain) * 25000
            u = (read[:, i] * gain + tall / 2) / span
            up = gain * (1 + v.get(f"gain@{t}", 0.0) + v.get("gain@all", 0.0)) * read[:, i]
            up = up + v[f"offset@{t}"] + v.get(f"curvature@{t}", 0.0) * u * u
            up = up + late * v.get(f"slip@{t}", 0.0)
            far = radius + v.get(f"radius@{t}", 0.0) + v.get("radius@all", 0.0)
            at = bearing[i] + v.get(f"bearing@{t}", 0.0)
            long = rod + v.get(f"rod@{t}", 0.0) + v.get("rod@all", 0.0)
            apart = np.sqrt(
                (x - far * np.cos(at)) ** 2 + (y - far * np.sin(at)) ** 2 + (z - up) ** 2
            )
            out[:, i] = apart - long
        curve = (bend[0] * x * x + bend[1] * x * y + bend[2] * y * y) / radius**2
        out[:, 3] = z - v.get("bend@bed", 0.0) * curve - late * v.get("step@bed", 0.0)
        return out

    # A carriage stands a rod's height above the nozzle.
    x, y = radius * np.cos(bearing), radius * np.sin(bearing)
    apart = np.hypot(nozzle[:, :1] - x, nozzle[:, 1:2] - y)
    up = np.sqrt(rod**2 - apart**2)
    return Machine(
        name="delta",
        mechanism=mechanism(drawn["offset"], gain, radius, rod, bearing),
        columns=TOWERS,
        sigma=np.full(3, NOISE),
        play=np.array([1e-6, 1e-6, 1e-6, PLAY]),
        gap=gap,
        start=np.column_stack([(up - drawn["offset"]) / gain, nozzle]),
        gives=np.array([1e4, 1e4, 1e4, 0.0, 0.0, 10.0]),
        values=values,
        fitted={f"offset@{t}": 0.01 for t in TOWERS},
        effects=tuple(effects()),
    )


def effects() -> list[Effect]:
    """What a delta printer may have."""
    out = []
    for t in TOWERS:
        tower, row = f"tower {t}", f"tower {t}/1"
        out += [
            effect(f"gain@{t}", "sensor", 1e-3, t),
            effect(f"curvature@{t}", "sensor", 0.2, t),
            effect(f"slip@{t}", "sensor", 0.1, t),
            effect(f"radius@{t}", "geometry", 0.5, tower, row),
            effect(f"bearing@{t}", "geometry", 2e-3, tower, row),
            effect(f"rod@{t}", "closure", 0.3, f"rod {t}"),
        ]
    alike = ("each/1", "each/2", "each", "tower a/1+tower b/1+tower c/1")
    return [
        *out,
        effect("gain@all", "sensor", 1e-3, "a+b+c", "each.1", "each", "all", also=("electronics",)),
        effect("radius@all", "geometry", 0.5, *alike),
        effect("rod@all", "closure", 0.3, "each"),
        effect("bend@bed", "closure", 0.1, "bed", "nozzle on bed", also=("geometry",)),
        effect("step@bed", "closure", 0.1, "bed", "nozzle on bed", also=("geometry",)),
    ]


def mechanism(
    offset: float, gain: float, radius: float, rod: float, bearing: Array
) -> dict[str, object]:
    """The mechanism file."""
    channels = [
        {"name": t, "unit": "step", "gain": float(gain), "offset": float(offset), "noise": NOISE}
        for t in TOWERS
    ]
    chains = [
        {
            "name": f"tower {t}",
            "dh": [
                {"theta": float(b), "a": float(radius)},
                {"channel": t, "joint": "prismatic"},
            ],
        }
        for t, b in zip(TOWERS, bearing, strict=True)
    ]
    points: list[dict[str, object]] = [
        {"name": f"carriage {t}", "chain": f"tower {t}", "at": [0.0, 0.0, 0.0]} for t in TOWERS
    ]
    points.append({"name": "nozzle", "unknown": ["pose"], "at": [0.0, 0.0, 0.0]})
    closures: list[dict[str, object]] = [
        {
            "name": f"rod {t}",
            "kind": "distance",
            "between": [f"carriage {t}", "nozzle"],
            "value": float(rod),
        }
        for t in TOWERS
    ]
    closures.append(
        {"name": "nozzle on bed", "kind": "plane", "between": ["nozzle", "bed"], "noise": PLAY}
    )
    return {
        "name": "delta printer",
        "length_unit": "mm",
        "channel": channels,
        "chain": chains,
        "point": points,
        "closure": closures,
        "plane": [{"name": "bed", "normal": [0.0, 0.0, 1.0], "offset": 0.0}],
        "model": {"terms": ["offset"]},
    }
