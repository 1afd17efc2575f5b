"""Closures that say more than is needed: a body held by all distances of its points, and a sphere.

Of the fifteen distances between six points of a body twelve say where all are; the tips of a
spherical five-bar touch radially whatever its joints do. Such equations have no noise, and their
misclosure is of second order. Witnesses: a leg in closed form, and rotations of unit vectors.
"""

from __future__ import annotations

import itertools
from typing import Any

import numpy as np
import pytest
from numpy import pi
from scipy.spatial.transform import Rotation

import rsicalib
from rsicalib import Mechanism
from rsicalib.io.readings import Readings
from tests.full import sized
from tests.oracle import Array

NOISE = 3e-4


def encoder(name: str, low: float = -pi, high: float = pi, noise: float = NOISE) -> dict[str, Any]:
    return {
        "name": name,
        "unit": "rad",
        "gain": 1.0,
        "offset": 0.0,
        "noise": noise,
        "limits": [low, high],
    }


# ------------------------------------------------------------------ six feet

HIPS = [(0.25, 0.12), (0.0, 0.16), (-0.25, 0.12), (0.25, -0.12), (0.0, -0.16), (-0.25, -0.12)]
COXA, FEMUR, TIBIA = 0.06, 0.12, 0.20
LEGS = "abcdef"


def leg(place: tuple[float, float], foot: Array, tibia: float) -> Array:
    """Joint angles of a leg whose foot is there in the frame of the body, (n, 3)."""
    x, y, z = (foot - [*place, 0.0]).T
    side = np.sign(place[1])
    out = np.hypot(x, y) - COXA
    reach = np.hypot(out, z)
    knee = -np.arccos((reach**2 - FEMUR**2 - tibia**2) / (2 * FEMUR * tibia))
    lift = np.arctan2(z, out) - np.arctan2(tibia * np.sin(knee), FEMUR + tibia * np.cos(knee))
    return np.stack([np.arctan2(y, x) - side * pi / 2, lift, knee], axis=1)


def walker(
    seed: int, n: int = 60, longer: float = 0.0, samples: int = 1
) -> tuple[Array, Mechanism]:
    """Six legs of three encoders that stand on uneven ground, which somebody has surveyed."""
    rng = np.random.default_rng([15, seed])
    feet = np.array([[x, y + 0.17 * np.sign(y), -0.14] for x, y in HIPS]) + rng.uniform(
        -0.03, 0.03, (6, 3)
    )
    body = rng.uniform(-0.02, 0.02, (n, 3))
    turn = Rotation.from_rotvec(rng.uniform(-0.12, 0.12, (n, 3))).as_matrix()
    q = np.concatenate(
        [
            leg(place, np.einsum("nji,nj->ni", turn, foot - body), TIBIA + longer * (k == 1))
            for k, (place, foot) in enumerate(zip(HIPS, feet, strict=True))
        ],
        axis=1,
    )
    assert np.isfinite(q).all()
    chain = [
        {
            "name": name,
            "dh": [
                {"a": x},
                {"theta": float(np.sign(y)) * pi / 2, "a": abs(y)},
                {"channel": f"{name}1", "a": COXA, "alpha": pi / 2},
                {"channel": f"{name}2", "a": FEMUR},
                {"channel": f"{name}3", "a": TIBIA},
            ],
        }
        for name, (x, y) in zip(LEGS, HIPS, strict=True)
    ]
    closure = [
        {
            "name": f"{LEGS[a]}-{LEGS[b]}",
            "kind": "distance",
            "between": [f"foot {LEGS[a]}", f"foot {LEGS[b]}"],
            "value": float(np.linalg.norm(feet[a] - feet[b])),
        }
        for a, b in itertools.combinations(range(6), 2)
    ]
    mechanism = {
        "name": "walker",
        "length_unit": "m",
        "channel": [encoder(f"{name}{k}") for name in LEGS for k in (1, 2, 3)],
        "chain": chain,
        "point": [{"name": f"foot {name}", "chain": name, "at": [0, 0, 0]} for name in LEGS],
        "closure": closure,
        "model": {"terms": ["offset"]},
    }
    q = np.repeat(q, samples, axis=0)
    readings = q - 0.01 * rng.standard_normal(18) + NOISE * rng.standard_normal(q.shape)
    return readings, Mechanism.from_dict(mechanism)


@pytest.mark.parametrize("seed", range(sized(2, 4)))
def test_all_fifteen_distances_of_six_feet_are_twelve_equations(seed: int) -> None:
    """Weighed, the other three outweighed all else: most sessions lost a third of their poses."""
    found = rsicalib.calibrate(*walker(seed))
    assert (found.verdict, found.excluded) == ("adequate", ())
    assert found.fit.dof == 12 * 60 - 18
    (warning,) = found.warnings
    assert warning.kind == "follow" and len(warning.targets) == 3


@pytest.mark.parametrize("seed", sized([10], [10, 16, 21]))
def test_distances_that_somebody_measured_are_redundant_in_every_fit(seed: int) -> None:
    """Measured to 2 mm, they contradict each other. A fit of a search that did not leave out the
    same equations called the noise a million times too small."""
    values, surveyed = walker(seed, samples=2)
    mechanism, off = surveyed.to_dict(), np.random.default_rng([16, seed])
    for closure in mechanism["closure"]:
        closure["value"] += 0.002 * off.normal()
    mechanism["model"] = {"terms": ["offset", "distance"], "sd": {"distance": 0.002}}
    measured = Mechanism.from_dict(mechanism)
    readings = Readings.from_arrays(measured, values, pose=np.repeat(np.arange(60), 2))
    result = rsicalib.trace(readings, measured)
    assert (result.verdict, result.steps, result.excluded) == ("adequate", (), ())


def test_a_longer_shank_is_named_beside_equations_that_follow() -> None:
    result = rsicalib.trace(*walker(5, longer=0.001))
    (step,) = result.steps
    # A foot that sits farther down is the same as a longer shank.
    assert ("link_length", "b/5") in {
        (step.term, step.target),
        *((n.term, n.target) for n in step.also_fits),
    }


# ------------------------------------------------------------------ a spherical five-bar

RADIUS, BASE, ARC = 80.0, 0.7, (1.0, 1.2)


def reach(axis: Array, tip: Array, side: float) -> Array:
    """Angles of an arm of two arcs, from its first axis to a tip on the unit sphere, (n, 2)."""
    about = tip @ axis.T  # the tip in a frame whose z is the first axis
    away = np.arccos(about[:, 2])
    first, second = ARC
    elbow = side * np.arccos(
        (np.cos(first) * np.cos(second) - np.cos(away)) / (np.sin(first) * np.sin(second))
    )
    middle = Rotation.from_euler("x", first)
    over = middle.apply(
        Rotation.from_euler("z", elbow[:, None]).apply(
            Rotation.from_euler("x", second).apply([0, 0, 1])
        )
    )
    turn = np.arctan2(about[:, 1], about[:, 0]) - np.arctan2(over[:, 1], over[:, 0])
    return (np.stack([turn, elbow], axis=1) + pi) % (2 * pi) - pi


def spherical(seed: int, n: int = 48, samples: int = 4) -> tuple[Any, Mechanism]:
    """Two arms of two joints, all axes through one centre, whose tips meet in a pin."""
    rng = np.random.default_rng([16, seed])
    tip = np.stack([rng.uniform(0.6, 1.6, n), rng.uniform(-0.4, 0.4, n), np.ones(n)], axis=1)
    tip /= np.linalg.norm(tip, axis=1, keepdims=True)
    sides = {"l": (-BASE, 1.0), "r": (BASE, -1.0)}
    columns = [
        reach(Rotation.from_euler("x", base).as_matrix().T, tip, side)
        for base, side in sides.values()
    ]
    q = np.repeat(np.concatenate(columns, axis=1), samples, axis=0)
    assert np.isfinite(q).all()
    names = [f"{arm}{k}" for arm in sides for k in (1, 2)]
    channel = [
        encoder(name, float(q[:, k].min() - 0.3), float(q[:, k].max() + 0.3))
        for k, name in enumerate(names)
    ]
    arms = [
        {
            "name": arm,
            "dh": [
                {"alpha": base},
                {"channel": f"{arm}1", "alpha": ARC[0]},
                {"channel": f"{arm}2", "alpha": ARC[1]},
            ],
        }
        for arm, (base, _) in sides.items()
    ]
    mechanism = Mechanism.from_dict(
        {
            "name": "spherical five-bar",
            "length_unit": "mm",
            "channel": channel,
            "chain": arms,
            "point": [{"name": f"tip {arm}", "chain": arm, "at": [0, 0, RADIUS]} for arm in sides],
            "closure": [{"name": "pin", "kind": "touch", "between": ["tip l", "tip r"]}],
            "model": {"terms": ["offset"]},
        }
    )
    values = q - 0.01 * rng.standard_normal(4) + NOISE * rng.standard_normal(q.shape)
    pose = np.repeat(np.arange(1, n + 1), samples)
    return rsicalib.Readings.from_arrays(mechanism, values, pose=pose), mechanism


@pytest.mark.parametrize("seed", range(sized(3, 6)))
def test_a_spherical_mechanism_has_two_equations(seed: int) -> None:
    """The third made good samples of a clean session tens of standard deviations bad."""
    found = rsicalib.calibrate(*spherical(seed))
    assert (found.verdict, found.excluded) == ("adequate", ())
    assert found.fit.dof == 2 * 48 - 4
