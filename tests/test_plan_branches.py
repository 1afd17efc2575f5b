"""Planned poses can be reached from where the mechanism is without taking it apart.

The witnesses are plane geometry in numpy: on which side of the ground the rod of a four-bar linkage
passes, and which way round the corners of a platform stand.
"""

from __future__ import annotations

from functools import cache
from typing import Any

import numpy as np
import pytest

import rsicalib
from rsicalib import Mechanism
from tests.full import sized
from tests.oracle import Array
from tests.test_further import sockets

SEEDS = range(sized(1, 3))

BASE = np.array([[0.0, 0.0], [600.0, 0.0], [300.0, 520.0]])
PLATFORM = np.array([[-80.0, -46.19], [80.0, -46.19], [0.0, 92.38]])
LINK = 250.0
"""A planar platform on three legs of two links, with sensors at shoulders and elbows."""

OFF = np.array([0.02, -0.012, -0.015, 0.02, 0.01, 0.008])
"""Offsets of the joints of the three legs."""


def platform(elbows: dict[str, Any] | None = None) -> Mechanism:
    """The platform; with limits of its elbows, if given."""
    legs, sides = range(3), [(0, 1), (1, 2), (0, 2)]
    sensor = {"unit": "rad", "gain": 1.0, "offset": 0.0, "noise": 2e-4}
    channels = [
        {"name": f"{joint}{leg}"} | sensor | ((elbows or {}) if joint == "e" else {})
        for leg in legs
        for joint in "te"
    ]
    chains = [
        {
            "name": f"leg{leg}",
            "dh": [
                {"xyz": [*BASE[leg], 0.0]},
                {"channel": f"t{leg}", "a": LINK},
                {"channel": f"e{leg}", "a": LINK},
            ],
        }
        for leg in legs
    ]
    closures = [
        {
            "name": f"side{i}{j}",
            "kind": "distance",
            "between": [f"p{i}", f"p{j}"],
            "value": float(np.hypot(*(PLATFORM[i] - PLATFORM[j]))),
        }
        for i, j in sides
    ]
    return Mechanism(
        {
            "name": "platform in a plane",
            "length_unit": "mm",
            "channel": channels,
            "chain": chains,
            "point": [{"name": f"p{k}", "chain": f"leg{k}", "at": [0.0, 0.0, 0.0]} for k in legs],
            "closure": closures,
            "platform": {f"p{k}": [*PLATFORM[k], 0.0] for k in legs},
            "model": {"terms": ["offset"]},
        }
    )


def joints(mirrored: bool, poses: int = 40) -> Array:
    """Joint angles of a platform as it is drawn or mirrored, all elbows to the same side."""
    rng, rows = np.random.default_rng(3), []
    while len(rows) < poses:
        turned = rng.uniform(-0.5, 0.5)
        cos, sin = np.cos(turned), np.sin(turned)
        corners = PLATFORM * ([-1.0, 1.0] if mirrored else [1.0, 1.0])
        corners = corners @ np.array([[cos, sin], [-sin, cos]]) + [300.0, 173.0]
        way = corners + rng.uniform(-60, 60, 2) - BASE
        cosine = (np.square(way).sum(axis=1) / LINK**2 - 2.0) / 2.0
        if np.abs(cosine).max() > 0.97:
            continue
        elbow = np.arccos(cosine)
        first = np.arctan2(way[:, 1], way[:, 0]) - 0.5 * elbow
        rows.append(np.column_stack([first, elbow]).ravel())
    return np.array(rows)


def corners(angles: Array) -> Array:
    """Where the legs carry the corners of the platform, row by row."""
    first, elbow = angles[:, 0::2], angles[:, 1::2]
    x = np.cos(first) + np.cos(first + elbow)
    y = np.sin(first) + np.sin(first + elbow)
    return BASE + LINK * np.stack([x, y], axis=-1)


def area(angles: Array) -> Array:
    """Twice the area of the platform, above zero where it is not mirrored."""
    at = corners(angles)
    a, b = at[:, 1] - at[:, 0], at[:, 2] - at[:, 0]
    return a[:, 0] * b[:, 1] - a[:, 1] * b[:, 0]


def session(mechanism: Mechanism, angles: Array, off: Array, noise: float) -> rsicalib.Readings:
    values = angles - off + noise * np.random.default_rng(4).standard_normal(angles.shape)
    pose = np.arange(1, len(values) + 1)
    return rsicalib.Readings.from_arrays(mechanism, values, pose=pose)


@cache
def calibrated(mirrored: bool) -> tuple[Any, ...]:
    mechanism = platform()
    readings = session(mechanism, joints(mirrored), OFF, 2e-4)
    return mechanism, readings, rsicalib.calibrate(readings, mechanism)


@pytest.mark.parametrize("seed", SEEDS)
def test_before_a_session_a_platform_is_planned_as_it_is_drawn(seed: int) -> None:
    for elbows in (None, {"limits": [0.1, 3.0]}):
        angles = rsicalib.plan(platform(elbows), 8, seed=seed).readings
        np.testing.assert_allclose(area(angles), area(joints(False, 1))[0], rtol=1e-6)
        assert elbows is None or np.all(angles[:, 1::2] > 0.1)


@pytest.mark.parametrize("seed", SEEDS)
@pytest.mark.parametrize("mirrored", [False, True])
def test_poses_visited_already_tell_how_a_platform_is_put_together(
    mirrored: bool, seed: int
) -> None:
    angles = joints(mirrored, 12)
    planned = rsicalib.plan(platform(), 8, beside=angles, seed=seed).readings
    assert np.all((area(planned) < 0) == mirrored)


@pytest.mark.parametrize("seed", SEEDS)
@pytest.mark.parametrize("mirrored", [False, True])
def test_after_a_session_a_platform_stays_as_it_was(mirrored: bool, seed: int) -> None:
    mechanism, readings, result = calibrated(mirrored)
    found = rsicalib.plan(mechanism, 8, result=result, beside=readings, seed=seed)
    angles = found.readings + OFF
    assert len(angles) == 8
    # Sides of 160 mm; the offsets are known to some 1e-4 rad.
    expected = area(joints(mirrored, 1))[0]
    np.testing.assert_allclose(area(angles), expected, rtol=0.01)


CRANK, ROD, ROCKER, GROUND = 100.0, 250.0, 200.0, 300.0
"""The four-bar linkage of docs/mechanism.md: its crank turns, its rocker does not."""


def four_bar(rod: float = ROD, rocker: float = ROCKER, terms: str = "offset") -> Mechanism:
    sensor = {"unit": "rad", "gain": 1.0, "offset": 0.0, "noise": 1e-4}
    chains = [
        {"name": "left", "dh": [{"channel": "crank", "a": CRANK}]},
        {"name": "right", "dh": [{"a": GROUND}, {"channel": "rocker", "a": rocker}]},
    ]
    ends = [{"name": c["name"] + " end", "chain": c["name"], "at": [0.0, 0.0, 0.0]} for c in chains]
    between = [end["name"] for end in ends]
    closure = {"name": "rod", "kind": "distance", "between": between, "value": rod}
    return Mechanism(
        {
            "name": "four-bar",
            "length_unit": "mm",
            "channel": [{"name": "crank"} | sensor, {"name": "rocker"} | sensor],
            "chain": chains,
            "point": ends,
            "closure": [closure],
            "model": {"terms": [terms]},
        }
    )


def side(angles: Array) -> Array:
    """On which side of the line from the rocker's post to the end of the crank the rocker is."""
    crank, rocker = angles.T
    x, y = CRANK * np.cos(crank) - GROUND, CRANK * np.sin(crank)
    return np.sign(x * np.sin(rocker) - y * np.cos(rocker))


def turns(crossed: bool) -> Array:
    """A turn of the crank."""
    crank = np.linspace(0.0, 2 * np.pi, 60, endpoint=False)
    x, y = GROUND - CRANK * np.cos(crank), CRANK * np.sin(crank)
    far = np.hypot(x, y)
    inner = np.arccos((far**2 + ROCKER**2 - ROD**2) / (2 * ROCKER * far))
    return np.column_stack([crank, np.pi - np.arctan2(y, x) - (-inner if crossed else inner)])


@pytest.mark.parametrize("seed", SEEDS)
@pytest.mark.parametrize("crossed", [False, True])
def test_the_rocker_of_a_four_bar_linkage_stays_on_its_side(crossed: bool, seed: int) -> None:
    off = np.array([0.05, -0.03])
    readings = session(four_bar(), turns(crossed), off, 1e-4)
    result = rsicalib.calibrate(readings, four_bar())
    found = rsicalib.plan(four_bar(), 6, result=result, beside=readings, seed=seed)
    assert len(found.readings)
    assert set(side(found.readings + off)) == set(side(turns(crossed)))


@pytest.mark.parametrize("seed", SEEDS)
def test_a_parallelogram_that_has_passed_its_dead_points_stays_one(seed: int) -> None:
    """Where all is in one line, it could fold into an antiparallelogram: it has never done so."""
    mechanism = four_bar(GROUND, CRANK, "offset@rocker")
    crank = np.linspace(0.05, 2 * np.pi + 0.05, 60, endpoint=False)
    readings = session(mechanism, np.column_stack([crank, crank]), np.array([0.0, 0.03]), 1e-4)
    result = rsicalib.calibrate(readings, mechanism)
    found = rsicalib.plan(
        mechanism, 6, result=result, beside=readings, criterion="volume", seed=seed
    )
    crank, rocker = (found.readings + [0.0, 0.03]).T
    assert len(crank)
    np.testing.assert_allclose(rocker, crank, atol=0.01)


def test_an_open_arm_may_take_any_pose_at_its_sockets() -> None:
    mechanism, readings, _ = sockets()
    result = rsicalib.calibrate(readings, mechanism)
    found = rsicalib.plan(mechanism, 4, result=result, beside=readings)
    # As planned when no path was asked for.
    known = [
        [-2.89836049, -1.79395229, 1.51910356, -0.95244795, -1.43795102, -0.88572803],
        [-1.92478323, -1.49727871, 1.85396965, -1.43215906, -1.93005521, -2.06400707],
    ]
    np.testing.assert_allclose(found.readings, known, atol=1e-6)
