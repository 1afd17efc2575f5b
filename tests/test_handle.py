"""The handle as the guide draws it, and the moves that it asks for."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

import rsicalib
from rsicalib import DEMO
from rsicalib.guide.advice import _with_priors
from rsicalib.guide.handle import Handle, moves, turned
from tests.full import sized

NEAR = np.zeros(6)


def test_a_turn_is_that_of_scipy() -> None:
    angles = np.array([0.3, -0.4, 1.1])
    expected = Rotation.from_euler("xyz", angles).as_matrix()
    np.testing.assert_allclose(turned(angles), expected, atol=1e-15)


@pytest.mark.parametrize("seed", range(sized(5, 20)))
def test_the_moves_bring_the_handle_there(seed: int) -> None:
    """Shift and turn put back together, by SciPy's rotations."""
    rng = np.random.default_rng(seed)
    now, want = rng.uniform(-0.6, 0.6, (2, 6))
    found = moves(now, want, NEAR)
    towards = {"right", "away from you", "up", "far side up", "right side down", "turn left"}
    signed = [m["amount"] * (1.0 if m["words"] in towards else -1.0) for m in found]
    np.testing.assert_allclose(now[:3] + signed[:3], want[:3], atol=1e-12)
    turn = Rotation.from_rotvec(np.radians(signed[3:])) * Rotation.from_euler("xyz", now[3:])
    np.testing.assert_allclose(turn.as_euler("xyz"), want[3:], atol=1e-9)
    assert not any(m["done"] for m in found)


def test_words_are_those_of_who_has_x_to_the_right_and_y_ahead() -> None:
    still = np.zeros(6)
    for k, words in enumerate(("right", "away from you", "up", "far side up", "right side down")):
        found = moves(still, np.eye(6)[k] * 0.1, np.full(6, 0.05))
        assert [m["words"] for m in found if not m["done"]] == [words]
    # About z by the right hand is against the clock, seen from above.
    left = moves(still, np.array([0, 0, 0, 0, 0, 0.2]), np.full(6, 0.05))[5]
    assert (left["words"], round(left["amount"], 1)) == ("turn left", 11.5)


def test_the_handle_is_where_the_forward_kinematics_have_it() -> None:
    mechanism = rsicalib.load_mechanism("rsi")
    readings = rsicalib.load_readings(DEMO / "readings.csv")
    result = rsicalib.trace(readings, rest=DEMO / "rest.csv")
    handle = Handle(mechanism, _with_priors(mechanism, rsicalib.load_readings(DEMO / "rest.csv")))
    handle.know(result)
    one = readings.values[:1]
    expected = rsicalib.forward(one, calibration=result)[0]
    pose = handle.pose(one[0])
    assert pose is not None
    np.testing.assert_allclose(pose, expected, atol=1e-12)
    corners = np.array(handle.corners(pose))
    sides = np.linalg.norm(corners - np.roll(corners, 1, axis=0), axis=1)
    np.testing.assert_allclose(sides, 2.598, atol=1e-3)  # an equilateral handle of 1.5 √3
