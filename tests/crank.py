"""A four-bar with an encoder at its crank and one at its rocker, by plain trigonometry."""

from __future__ import annotations

from typing import Any

import numpy as np

POST, CRANK, ROCKER, ROD = 300.0, 100.0, 200.0, 250.0
OFFSETS = {"crank": 0.05, "rocker": -0.03}
NOISE = 1e-4

MECHANISM: dict[str, Any] = {
    "name": "four-bar",
    "length_unit": "mm",
    "channel": [
        {"name": name, "unit": "rad", "gain": 1.0, "offset": 0.0, "noise": NOISE}
        for name in OFFSETS
    ],
    "chain": [
        {"name": "left", "dh": [{"channel": "crank", "a": CRANK}]},
        {"name": "right", "dh": [{"a": POST}, {"channel": "rocker", "a": ROCKER}]},
    ],
    "point": [
        {"name": "end of crank", "chain": "left", "at": [0, 0, 0]},
        {"name": "end of rocker", "chain": "right", "at": [0, 0, 0]},
    ],
    "closure": [
        {
            "name": "rod",
            "kind": "distance",
            "between": ["end of crank", "end of rocker"],
            "value": ROD,
        }
    ],
    "model": {"terms": ["offset"]},
}


def columns(rows: int = 60, seed: int = 0) -> dict[str, np.ndarray[Any, Any]]:
    """Readings of a turn of the crank, by channel."""
    angle = np.linspace(0.0, 2 * np.pi, rows, endpoint=False)
    along, up = POST - CRANK * np.cos(angle), CRANK * np.sin(angle)
    apart = np.hypot(along, up)
    corner = np.arccos((apart**2 + ROCKER**2 - ROD**2) / (2 * ROCKER * apart))
    true = {"crank": angle, "rocker": np.pi - np.arctan2(up, along) - corner}
    noise = NOISE * np.random.default_rng(seed).standard_normal((rows, 2))
    return {name: true[name] - OFFSETS[name] + noise[:, k] for k, name in enumerate(true)}
