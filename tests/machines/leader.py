"""A follower arm that copies its leader: joint by joint the same percent of its range."""

from __future__ import annotations

import numpy as np

from tests.machines.kit import Effect, Machine, Rng, Values, effect
from tests.oracle import Array

JOINTS = ("pan", "lift", "elbow", "flex", "roll")
NOISE, PLAY = 0.05, 0.3
"""Of a reading, and of how well a joint follows [percent]."""


def draw(rng: Rng, poses: int = 60) -> Machine:
    """Offsets of percents, gains of a few percent."""
    values: Values = {f"offset@follower_{j}": rng.normal(0, 2) for j in JOINTS}
    values |= {f"gain@follower_{j}": 1 + rng.normal(0, 0.03) for j in JOINTS}
    n, count = len(JOINTS), poses
    late = (np.arange(count) >= rng.integers(count // 3, 2 * count // 3)).astype(float)
    time = np.linspace(-0.5, 0.5, count)
    leader = 85 * rng.uniform(-1, 1, (count, n))

    def gap(read: Array, places: Array, v: Values) -> Array:
        out = np.empty((len(read), n))
        for i, j in enumerate(JOINTS):
            own, x = f"follower_{j}", read[:, n + i]
            u = x / 100
            told = v[f"gain@{own}"] * x + v[f"offset@{own}"]
            told = told + v.get(f"curvature@{own}", 0.0) * u * u + v.get(f"cubic@{own}", 0.0) * u**3
            told = told + v.get(f"slip@{own}", 0.0) * late + v.get(f"drift@{own}", 0.0) * time
            k = (i + 1) % n
            told = told + v.get(f"crosstalk@{own}", 0.0) * read[:, n + k]
            out[:, i] = read[:, i] - told
        return out

    names = [f"{who}_{j}" for who in ("leader", "follower") for j in JOINTS]
    return Machine(
        name="leader",
        mechanism=mechanism(names),
        columns=tuple(names),
        sigma=np.full(2 * n, NOISE),
        play=np.full(n, PLAY),
        gap=gap,
        start=np.hstack([leader, leader]),
        gives=np.array([0.0] * n + [50.0] * n),
        values=values,
        fitted={name: 0.01 if name.startswith("offset") else 1e-4 for name in values},
        effects=tuple(effects()),
    )


def effects() -> list[Effect]:
    """What a pair of joints may have; whose of the two it is no reading tells."""
    out = []
    kinds = (("curvature", 1.0), ("cubic", 1.0), ("slip", 0.5), ("drift", 0.5), ("crosstalk", 0.01))
    for j in JOINTS:
        for kind, size in kinds:
            also = ("closure",)
            targets = (f"follower_{j}", f"leader_{j}", j)
            out.append(effect(f"{kind}@follower_{j}", "sensor", size, *targets, also=also))
    return out


def mechanism(names: list[str]) -> dict[str, object]:
    """The mechanism file."""
    channels = [
        {"name": c, "unit": "percent", "gain": 1.0, "offset": 0.0, "range": [-100.0, 100.0]}
        | {"noise": NOISE}
        for c in names
    ]
    closures = [
        {"name": j, "kind": "equal", "between": [f"leader_{j}", f"follower_{j}"], "noise": PLAY}
        for j in JOINTS
    ]
    terms = [f"{t}@follower_{j}" for j in JOINTS for t in ("offset", "gain")]
    return {
        "name": "leader and follower",
        "length_unit": "m",
        "channel": channels,
        "closure": closures,
        "model": {"terms": terms},
    }
