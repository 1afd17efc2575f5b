"""Where a sled on belts is: a point that no chain carries, somewhere else in each pose."""

from __future__ import annotations

from typing import Any

import numpy as np
import numpy.typing as npt

import rsicalib

Array = npt.NDArray[np.float64]

NAMES = ["tl", "tr", "bl", "br"]
DRAWN = np.array([[0, 2000, 100], [3000, 2000, 56], [0, 0, 34], [3000, 0, 78]], float)
"""Anchors as drawn [mm]; the last two span the axis x."""
FREE: list[list[str]] = [["x", "y"], ["x", "y"], [], ["x"]]
NOISE = 0.3


def machine(
    poses: int, rng: np.random.Generator, noise: float = NOISE
) -> tuple[rsicalib.Mechanism, Array, Array]:
    """A mechanism with wrong anchors, the true lengths of its belts, and where the sled was."""
    true = DRAWN.copy()
    true[0, :2] += rng.normal(0, 60, 2)
    true[1, :2] += rng.normal(0, 60, 2)
    true[3, 0] += rng.normal(0, 60)
    sled = np.column_stack([rng.uniform([600, 400], [2400, 1600], (poses, 2)), np.zeros(poses)])
    lengths = np.linalg.norm(sled[:, None] - true, axis=2)
    points: list[dict[str, Any]] = [
        {"name": "sled", "unknown": ["pose"], "at": [1500.0, 1000.0, 0.0], "free": ["x", "y"]}
    ]
    for name, at, free in zip(NAMES, DRAWN, FREE, strict=True):
        points.append({"name": name, "at": at.tolist()})
        points[-1] |= {"unknown": [], "free": free} if free else {}
    drawn = {
        "name": "frame",
        "length_unit": "mm",
        "channel": [
            {"name": f"b{n}", "unit": "mm", "gain": 1.0, "offset": 0.0, "noise": noise}
            for n in NAMES
        ],
        "closure": [
            {"name": f"belt {n}", "kind": "distance", "between": ["sled", n], "channel": f"b{n}"}
            for n in NAMES
        ],
        "point": points,
        "model": {"terms": []},
    }
    return rsicalib.Mechanism.from_dict(drawn), lengths, sled


def readings(drawn: rsicalib.Mechanism, lengths: Array) -> rsicalib.Readings:
    return rsicalib.Readings.from_arrays(drawn, lengths, pose=np.arange(len(lengths)))


def test_a_sled_is_found_where_it_was() -> None:
    """Anchors wrong by 60 mm, lengths by a nanometre."""
    rng = np.random.default_rng(1)
    drawn, lengths, sled = machine(30, rng, 1e-6)
    fine = readings(drawn, lengths + rng.normal(0, 1e-6, lengths.shape))
    result = rsicalib.calibrate(fine, drawn)
    found = rsicalib.forward(fine, drawn, result)
    np.testing.assert_allclose(found, sled, rtol=0, atol=1e-4)
    placer = rsicalib.Placer(drawn, result)
    assert placer.names == ("sled.x", "sled.y", "sled.z")
    np.testing.assert_allclose(placer(lengths[7]), sled[7], rtol=0, atol=1e-4)


def test_places_scatter_as_told() -> None:
    """Forty calibrations in the same poses, each with its noise: places from exact lengths."""
    rng = np.random.default_rng(2)
    drawn, lengths, sled = machine(24, rng)
    exact = readings(drawn, lengths)
    errors, told = [], []
    for _ in range(40):
        noisy = readings(drawn, lengths + rng.normal(0, NOISE, lengths.shape))
        result = rsicalib.calibrate(noisy, drawn)
        errors.append(rsicalib.forward(exact, drawn, result) - sled)
        told.append(rsicalib.forward_sd(exact, drawn, result))
    # Five coordinates of anchors in 40 draws: a χ² of 200 degrees of freedom at best, 40 at worst,
    # whose ratio has a standard deviation of .1 to .22.
    assert 0.45 < np.mean(np.square(errors)) / np.mean(np.square(told)) < 1.6


def test_readings_without_an_error_have_places_as_drawn() -> None:
    """Without a calibration the anchors are as drawn."""
    drawn, _, sled = machine(5, np.random.default_rng(3))
    as_drawn = np.linalg.norm(sled[:, None] - DRAWN, axis=2)
    found = rsicalib.forward(readings(drawn, as_drawn), drawn)
    np.testing.assert_allclose(found, sled, rtol=0, atol=1e-6)
