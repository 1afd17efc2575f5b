"""A machine of three legs of two links on a swivel, all nine joints sensed, in degrees.

Its angles at a pose are a closed form.
"""

from __future__ import annotations

from itertools import combinations
from typing import Any

import numpy as np
from numpy.typing import NDArray

import rsicalib

BASE, PLATE, UPPER, LOWER = 150.0, 60.0, 120.0, 130.0
AROUND = np.radians([0.0, 120.0, 240.0])
WRISTS = PLATE * np.stack([np.cos(AROUND), np.sin(AROUND), np.zeros(3)], axis=1)
NAMES = [f"{leg}{joint}" for leg in "123" for joint in "abc"]
REST = [0.0, 0.0, 160.0, 0.0, 0.0, 0.0]


def machine(terms: tuple[str, ...] = ("offset",)) -> rsicalib.Mechanism:
    """The machine without joint limits: nothing declared says how its elbows stand."""
    legs = [
        {
            "name": f"leg{k}",
            "dh": [
                {"theta": float(AROUND[k - 1] + np.pi), "a": -BASE},
                {"channel": f"{k}a", "alpha": np.pi / 2},
                {"channel": f"{k}b", "a": UPPER},
                {"channel": f"{k}c", "a": LOWER},
            ],
        }
        for k in (1, 2, 3)
    ]
    between = [(f"w{a}", f"w{b}") for a, b in combinations((1, 2, 3), 2)]
    side = float(np.linalg.norm(WRISTS[0] - WRISTS[1]))
    drawn: dict[str, Any] = {
        "name": "tripod",
        "length_unit": "mm",
        "channel": [{"name": n, "unit": "deg", "gain": 1.0, "offset": 0.0} for n in NAMES],
        "chain": legs,
        "point": [{"name": f"w{k}", "chain": f"leg{k}", "at": [0, 0, 0]} for k in (1, 2, 3)],
        "closure": [
            {"name": "-".join(pair), "kind": "distance", "between": pair, "value": side}
            for pair in between
        ],
        "platform": {f"w{k}": WRISTS[k - 1] for k in (1, 2, 3)},
        "rest": {"pose": REST},
        "model": {"terms": list(terms)},
    }
    return rsicalib.Mechanism.from_dict(drawn)


def angles(poses: NDArray[np.float64]) -> NDArray[np.float64]:
    """Joint angles (deg) of poses x y z rx ry rz, every elbow on the same side."""
    rx, ry, rz = poses[:, 3:].T
    zero, one = np.zeros_like(rx), np.ones_like(rx)
    about = [
        np.stack(
            [[one, zero, zero], [zero, np.cos(rx), -np.sin(rx)], [zero, np.sin(rx), np.cos(rx)]]
        ),
        np.stack(
            [[np.cos(ry), zero, np.sin(ry)], [zero, one, zero], [-np.sin(ry), zero, np.cos(ry)]]
        ),
        np.stack(
            [[np.cos(rz), -np.sin(rz), zero], [np.sin(rz), np.cos(rz), zero], [zero, zero, one]]
        ),
    ]
    turn_x, turn_y, turn_z = (np.moveaxis(turn, -1, 0) for turn in about)
    turns = turn_z @ turn_y @ turn_x
    legs = []
    for k in range(3):
        wrist = poses[:, :3] + turns @ WRISTS[k]
        out = np.array([-np.cos(AROUND[k]), -np.sin(AROUND[k])])
        across = np.array([np.sin(AROUND[k]), -np.cos(AROUND[k])])
        x, y, z = wrist[:, :2] @ out + BASE, wrist[:, :2] @ across, wrist[:, 2]
        far = np.hypot(x, y)
        elbow = -np.arccos((far**2 + z**2 - UPPER**2 - LOWER**2) / (2.0 * UPPER * LOWER))
        shoulder = np.arctan2(z, far) - np.arctan2(
            LOWER * np.sin(elbow), UPPER + LOWER * np.cos(elbow)
        )
        legs += [np.arctan2(y, x), shoulder, elbow]
    return np.degrees(np.stack(legs, axis=1))


def moved(rows: int, rng: np.random.Generator, hertz: float = 10.0) -> NDArray[np.float64]:
    """Poses on a smooth way through the workspace, row by row."""
    half = np.array([40.0, 40.0, 30.0, 0.25, 0.25, 0.25])
    time = np.arange(rows) / hertz
    periods, phases = rng.uniform(5.0, 40.0, (3, 6)), rng.uniform(0.0, 2.0 * np.pi, (3, 6))
    waves = np.sin(2.0 * np.pi * time[:, None, None] / periods + phases).mean(axis=1)
    return np.asarray(REST) + half * waves
