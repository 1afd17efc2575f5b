"""Where a sled on belts is: a point that no chain carries, somewhere else in each pose."""

from __future__ import annotations

from typing import Any

import numpy as np
import numpy.typing as npt
import pytest
from scipy import optimize

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


def test_the_drawing_has_the_sled_its_anchors_and_what_they_leave_open() -> None:
    """Places, anchors and the worst direction, beside least squares and differences of its own."""
    rng = np.random.default_rng(4)
    drawn, lengths, sled = machine(14, rng)
    noisy = lengths + rng.normal(0, NOISE, lengths.shape)
    found = rsicalib.trace(readings(drawn, noisy), mechanism=drawn)
    assert found.evidence is not None and found.evidence.drawing is not None
    drawing = found.evidence.drawing
    names = [node.name for node in drawing.nodes]
    assert sorted(names) == sorted(["sled", *(f"b{n}" for n in NAMES)])
    ends = {tuple(sorted(names[k] for k in edge)) for edge in drawing.edges}
    assert ends == {(f"b{n}", "sled") for n in NAMES}
    values = [p.value for p in found.parameters if p.value is not None]

    def anchors(free: Array) -> Array:
        at = DRAWN.copy()
        for row, column, value in zip((0, 0, 1, 1, 3), (0, 1, 0, 1, 0), free, strict=True):
            at[row, column] = value
        return at

    def placed(free: Array, pose: int) -> Array:
        def off(place: Array) -> Array:
            return np.linalg.norm(anchors(free) - [*place, 0.0], axis=1) - noisy[pose]

        return np.asarray(optimize.least_squares(off, sled[pose, :2], xtol=1e-14).x)

    assert len(values) == 5
    free = np.array(values)
    at = np.array(drawing.at).reshape(len(sled), -1, 3)
    order = [names.index(f"b{n}") for n in NAMES]
    np.testing.assert_allclose(at[:, order], np.broadcast_to(anchors(free), (14, 4, 3)), atol=1e-9)
    covariance = np.array(found.covariance)
    for pose in (0, 6, 13):
        np.testing.assert_allclose(drawing.places[pose][:2], placed(free, pose), atol=1e-4)
        steps = 0.01 * np.eye(5)
        moves = [(placed(free + s, pose) - placed(free - s, pose)) / 0.02 for s in steps]
        left = np.array(moves).T @ covariance @ np.array(moves)
        worst = np.sqrt(np.linalg.eigvalsh(left)[-1])
        assert np.linalg.norm(drawing.weakest[pose]) == pytest.approx(worst, rel=0.02)
