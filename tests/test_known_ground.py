"""A leg on a ground that is known, and a body on cables that is free to turn a little."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

import rsicalib
from tests.oracle import Array

COXA, FEMUR, TIBIA, HIGH = 40.0, 80.0, 120.0, 90.0
NOISE = 1e-3
"""Of an angle [rad]."""


def foot(coxa: float, femur: float, tibia: float) -> Array:
    """Where a leg's foot is, by plane trigonometry."""
    out = COXA + FEMUR * np.cos(femur) + TIBIA * np.cos(femur + tibia)
    up = FEMUR * np.sin(femur) + TIBIA * np.sin(femur + tibia)
    return np.array([out * np.cos(coxa), out * np.sin(coxa), up])


def standing(seed: int, tilt: tuple[float, float]) -> dict[str, Array]:
    """Angles of a leg whose foot stands on a ground that is tilted so."""
    rng = np.random.default_rng(seed)
    rows: list[list[float]] = []
    while len(rows) < 60:
        coxa, femur = rng.uniform(-0.8, 0.8), rng.uniform(-0.6, 1.2)

        def above(tibia: float, coxa: float = coxa, femur: float = femur) -> float:
            x, y, z = foot(coxa, femur, tibia)
            return float(z + HIGH - tilt[0] * x - tilt[1] * y)

        low, high = -femur - np.pi / 2, -femur  # the shank hangs down, and points outwards
        if above(low) < 0 < above(high):
            for _ in range(60):
                middle = (low + high) / 2
                low, high = (middle, high) if above(middle) < 0 else (low, middle)
            rows.append([coxa, femur, low])
    read = np.array(rows) - rng.normal(0, 0.003, 3) + rng.normal(0, NOISE, (60, 3))
    return dict(zip(("coxa", "femur", "tibia"), read.T, strict=True))


def leg() -> dict[str, Any]:
    """The mechanism file: the ground is level."""
    channels = ("coxa", "femur", "tibia")
    rows = [
        {"channel": "coxa", "a": COXA, "alpha": np.pi / 2},
        {"channel": "femur", "a": FEMUR},
        {"channel": "tibia", "a": TIBIA},
    ]
    return {
        "name": "leg on the ground",
        "length_unit": "mm",
        "channel": [
            {"name": c, "unit": "rad", "gain": 1.0, "offset": 0.0, "noise": NOISE} for c in channels
        ],
        "chain": [{"name": "leg", "dh": rows}],
        "point": [{"name": "foot", "chain": "leg", "at": [0.0, 0.0, 0.0]}],
        "plane": [{"name": "ground", "normal": [0.0, 0.0, 1.0], "offset": -HIGH}],
        "closure": [{"name": "on ground", "kind": "plane", "between": ["foot", "ground"]}],
        "model": {"terms": ["offset@femur", "offset@tibia"]},
    }


@pytest.mark.parametrize("seed", range(3))
def test_a_ground_that_is_not_level_is_a_tilt_of_the_base_and_no_bend(seed: int) -> None:
    turn = np.random.default_rng([41, seed]).uniform(0, 2 * np.pi)
    slope = 0.02 * np.cos(turn), 0.02 * np.sin(turn)
    found = rsicalib.trace(standing(seed, slope), leg())
    assert [(step.term, step.target) for step in found.steps] == [("base_tilt", "leg")]
    # A leg that is turned about its own x and y on a level ground sees these slopes.
    told = found.steps[0].parameters
    for one, truth in zip(told, (slope[1], -slope[0]), strict=True):
        assert one.value is not None and one.sd is not None
        assert abs(one.value + truth) < 4 * one.sd


def test_a_ground_as_drawn_is_adequate() -> None:
    found = rsicalib.trace(standing(7, (0.0, 0.0)), leg())
    assert found.verdict == "adequate" and not found.steps


ANCHORS = np.array(
    [[x, y, z] for z in (0, 3) for x, y in ((-2, -1.5), (2, -1.5), (2, 1.5), (-2, 1.5))]
)
EYES = np.array([[-0.2, -0.15, 0.0], [0.2, -0.15, 0.0], [0.2, 0.15, 0.2], [-0.2, 0.15, 0.0]])
LENGTH = 3e-4
"""Noise of a cable [m]."""


def hanging(seed: int) -> tuple[dict[str, Array], Array]:
    """Lengths of eight cables that do not cross, and what is added to each."""
    rng = np.random.default_rng(seed)
    rows = []
    for _ in range(60):
        at = rng.uniform([-1, -0.8, 0.8], [1, 0.8, 2.0])
        x, y, z = rng.uniform(-0.3, 0.3, 3)
        about_x = np.array([[1, 0, 0], [0, np.cos(x), -np.sin(x)], [0, np.sin(x), np.cos(x)]])
        about_y = np.array([[np.cos(y), 0, np.sin(y)], [0, 1, 0], [-np.sin(y), 0, np.cos(y)]])
        about_z = np.array([[np.cos(z), -np.sin(z), 0], [np.sin(z), np.cos(z), 0], [0, 0, 1]])
        eyes = at + EYES @ (about_z @ about_y @ about_x).T
        rows.append(np.linalg.norm(np.vstack([eyes, eyes]) - ANCHORS, axis=1))
    offsets = rng.normal(0, 0.01, 8)
    read = np.array(rows) - offsets + rng.normal(0, LENGTH, (60, 8))
    return {f"c{k + 1}": read[:, k] for k in range(8)}, offsets


def body() -> dict[str, Any]:
    """The mechanism file: eight cables to a body whose place is unknown in each pose."""
    return {
        "name": "body on eight cables",
        "length_unit": "m",
        "channel": [
            {"name": f"c{k}", "unit": "m", "gain": 1.0, "offset": 0.0, "noise": LENGTH}
            for k in range(1, 9)
        ],
        "frame": [{"name": "body", "unknown": ["pose"], "pose": [0.0, 0.0, 1.4, 0.0, 0.0, 0.0]}],
        "point": [
            *({"name": f"k{k + 1}", "frame": "body", "at": list(at)} for k, at in enumerate(EYES)),
            *({"name": f"w{k + 1}", "at": [float(x) for x in at]} for k, at in enumerate(ANCHORS)),
        ],
        "closure": [
            {
                "name": f"cable {k + 1}",
                "kind": "distance",
                "between": [f"k{k % 4 + 1}", f"w{k + 1}"],
                "channel": f"c{k + 1}",
            }
            for k in range(8)
        ],
        "model": {"terms": ["offset"]},
    }


@pytest.mark.parametrize("seed", range(3))
def test_a_body_is_where_its_cables_close_best_on_either_side_of_a_free_motion(seed: int) -> None:
    """Such a body can nearly turn: each pose has a second place that nearly closes."""
    rows, offsets = hanging(seed)
    rows["pose"] = np.arange(60.0)
    found = rsicalib.calibrate(rows, body())
    assert found.verdict == "adequate"
    for k, offset in enumerate(offsets):
        one = found["offset", f"c{k + 1}"]
        assert one.value is not None and one.sd is not None
        assert abs(one.value - offset) < 4.5 * one.sd
