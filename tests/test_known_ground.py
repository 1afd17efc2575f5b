"""A leg on a ground that is known, and is not level."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

import rsicalib
from tests.full import sized
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
    read = np.array(rows) + rng.normal(0, NOISE, (60, 3))
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


@pytest.mark.parametrize("seed", range(sized(1, 3)))
def test_a_ground_that_is_not_level_is_a_tilt_of_the_base_and_no_bend(seed: int) -> None:
    turn = np.random.default_rng([41, seed]).uniform(0, 2 * np.pi)
    slope = 0.02 * np.cos(turn), 0.02 * np.sin(turn)
    found = rsicalib.trace(standing(seed, slope), leg())
    (step,) = found.steps
    assert (step.term, step.target) == ("base_tilt", "leg") and found.verdict == "explained"
    # A leg that is turned by rx and ry sees slopes of ry along x, and of -rx along y.
    for one, truth in zip(step.parameters, (-slope[1], slope[0]), strict=True):
        assert one.value is not None and one.sd is not None
        assert abs(one.value - truth) < 4 * one.sd


@pytest.mark.parametrize("seed", range(sized(3, 6)))
def test_offsets_that_were_asked_for_stay_beside_a_tilt(seed: int) -> None:
    """Joints start 3 mrad from where they are drawn: beside the tilt they take up nothing."""
    rng = np.random.default_rng([43, seed])
    turn = rng.uniform(0, 2 * np.pi)
    slope = 0.02 * np.cos(turn), 0.02 * np.sin(turn)
    wrong = {joint: 0.003 * rng.choice([-1, 1]) for joint in ("femur", "tibia")}
    read = standing(seed + 100, slope)
    found = rsicalib.trace(read | {joint: read[joint] - by for joint, by in wrong.items()}, leg())
    (step,) = found.steps
    assert (step.term, step.target) == ("base_tilt", "leg") and found.verdict == "explained"
    told = [(one.value, one.sd) for one in step.parameters]
    told += [(one.value, one.sd) for one in found.parameters if one.term == "offset"]
    for (value, sd), truth in zip(told, (-slope[1], slope[0], *wrong.values()), strict=True):
        assert value is not None and sd is not None
        assert abs(value - truth) < 4 * sd


FEW = [
    (3, ["offset"]),
    (3, ["offset@femur", "offset@tibia"]),
    (4, ["offset@femur", "offset@tibia", "gain@femur"]),
    (4, ["offset@femur", "offset@tibia"]),
    (6, ["offset@femur", "offset@tibia"]),
]


@pytest.mark.parametrize(("poses", "terms"), FEW)
def test_few_equations_say_what_they_cannot_show(poses: int, terms: list[str]) -> None:
    """An effect of more parameters than equations are left may be of any size, and is listed.

    Witness: the rank of the heights of the foot by differences.
    """
    read = {joint: angles[:poses] for joint, angles in standing(7, (0.0, 0.0)).items()}
    found = rsicalib.trace(read, leg() | {"model": {"terms": terms}})
    (tilt,) = [h for h in found.could_hide if (h.term, h.target) == ("base_tilt", "leg")]

    angles = np.column_stack([read[joint] for joint in ("coxa", "femur", "tibia")])
    feet = np.array([foot(*row) for row in angles])
    step = 1e-6
    columns = []
    for term in terms:
        kind, _, name = term.partition("@")
        for k, joint in enumerate(("coxa", "femur", "tibia")):
            if name in ("", joint):
                moved = angles.copy()
                moved[:, k] += step * (1.0 if kind == "offset" else angles[:, k])
                high = np.array([foot(*row)[2] for row in moved])
                columns.append((high - feet[:, 2]) / step)
    fitted = np.column_stack(columns)
    rank = np.linalg.matrix_rank(fitted, tol=1e-3)
    both = np.linalg.matrix_rank(np.column_stack([fitted, feet[:, :2]]), tol=1e-3)
    assert found.after.dof == poses - rank
    # A tilt has two directions, of which equations see as many as they have ranks more.
    assert (tilt.detectable is None) == (both - rank < 2)
    if terms == ["offset@femur", "offset@tibia"]:
        assert both - rank == min(2, poses - rank)


def test_a_ground_as_drawn_is_adequate() -> None:
    found = rsicalib.trace(standing(7, (0.0, 0.0)), leg())
    assert found.verdict == "adequate" and not found.steps


def on_bed(plane: dict[str, Any]) -> dict[str, Any]:
    """The leg on a plane of its own."""
    closure = [{"name": "on bed", "kind": "plane", "between": ["foot", "bed"], "noise": 0.02}]
    return {**leg(), "plane": [plane], "closure": closure}


@pytest.mark.parametrize("normal", [[0.0, 0.0, 1.0], [0.6, 0.0, 0.8], [0.123, 0.234, 0.964]])
def test_a_normal_of_length_one_is_not_remarked(normal: list[float]) -> None:
    plane = {"name": "bed", "normal": normal, "offset": 20.0}
    assert rsicalib.Mechanism(on_bed(plane)).doubts == []


def test_an_offset_that_is_no_distance_is_named_before_there_are_readings() -> None:
    """A normal of another length, and an offset that may be meant as a distance [mm]."""
    normal = [0.1, 0.2, 1.0]
    (text,) = rsicalib.Mechanism(on_bed({"name": "bed", "normal": normal, "offset": 20.0})).doubts
    long = np.linalg.norm(normal)
    assert "plane bed" in text
    for said in (long, 20.0 / long, 20.0 * long):
        assert f"{said:.6g}" in text
    for other in ({"offset": 0.0}, {"normal": list(np.array(normal) / long), "offset": 20.0}):
        plane = {"name": "bed", "normal": normal, **other}
        assert rsicalib.Mechanism(on_bed(plane)).doubts == []
    # An unknown one is counted from the direction alone.
    assert rsicalib.Mechanism(on_bed({"name": "bed", "normal": normal, "unknown": []})).doubts == []
