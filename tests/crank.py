"""A four-bar with an encoder at its crank and one at its rocker, by plain trigonometry."""

from __future__ import annotations

from typing import Any

import numpy as np

from rsicalib import Mechanism
from tests.oracle import Array

POST, CRANK, ROCKER, ROD = 300.0, 100.0, 200.0, 250.0
"""Lengths [mm]."""
OFFSETS = {"crank": 0.05, "rocker": -0.03}
NOISE = 1e-4
"""Of an encoder [rad], as declared."""


def encoder(name: str) -> dict[str, Any]:
    return {"name": name, "unit": "rad", "gain": 1.0, "offset": 0.0, "noise": NOISE}


def four_bar(*terms: str, rod: float = ROD) -> Mechanism:
    """Drawn with a rod of this length."""
    right = [{"a": POST}, {"channel": "rocker", "a": ROCKER}]
    ends = ["end of crank", "end of rocker"]
    return Mechanism.from_dict(
        {
            "name": "four-bar",
            "length_unit": "mm",
            "channel": [encoder(name) for name in OFFSETS],
            "chain": [
                {"name": "left", "dh": [{"channel": "crank", "a": CRANK}]},
                {"name": "right", "dh": right},
            ],
            "point": [
                {"name": end, "chain": chain, "at": [0, 0, 0]}
                for end, chain in zip(ends, ("left", "right"), strict=True)
            ],
            "closure": [{"name": "rod", "kind": "distance", "between": ends, "value": rod}],
            "model": {"terms": list(terms)},
        }
    )


MECHANISM = four_bar("offset").to_dict()


def turn(rows: int = 60) -> Array:
    """Crank angles of one turn."""
    return np.linspace(0.0, 2 * np.pi, rows, endpoint=False)


def read(crank: Array, seed: int = 0, rod: float = ROD) -> Array:
    """Readings at these angles of the crank, of a rod of this length: shape (n, 2)."""
    along, up = POST - CRANK * np.cos(crank), CRANK * np.sin(crank)
    apart = np.hypot(along, up)
    corner = np.arccos((apart**2 + ROCKER**2 - rod**2) / (2 * ROCKER * apart))
    true = np.column_stack([crank, np.pi - np.arctan2(up, along) - corner])
    noise = NOISE * np.random.default_rng(seed).standard_normal(true.shape)
    return np.asarray(true - list(OFFSETS.values()) + noise)


def by_channel(readings: Array) -> dict[str, Array]:
    return dict(zip(OFFSETS, readings.T, strict=True))


def columns(rows: int = 60, seed: int = 0) -> dict[str, Array]:
    """Readings of a turn of the crank, by channel."""
    return by_channel(read(turn(rows), seed))
