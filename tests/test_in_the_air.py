"""Known poses of an arm that has left what it was held at.

The witness is the arm in plain matrix products (`tests/cone.py`).
"""

from __future__ import annotations

import warnings

import numpy as np
import pytest

import rsicalib
from tests import cone
from tests.oracle import Array

SIGMA, PLAY = 2e-5, 0.02
TURNS = np.array([1, 0.6, 0.8, 1.5, 1.5, 3])
MIDDLE = np.array([0.4, -1.4, -1.6, -1.5, 1.5, 0.0])


def drawn() -> rsicalib.Mechanism:
    """Everybody knows where the cone is."""
    at = f"at = {cone.CONE.tolist()}"
    return rsicalib.Mechanism.from_toml(cone.mechanism(SIGMA, PLAY).replace('unknown = ["at"]', at))


def table(q: Array, places: Array, seed: int) -> dict[str, list[float]]:
    read = q - cone.OFFSETS + SIGMA * np.random.default_rng(seed).standard_normal(q.shape)
    columns = {f"q{k + 1}": read[:, k] for k in range(6)}
    columns |= {axis: places[:, i] for i, axis in enumerate("xyz")}
    return {name: column.tolist() for name, column in columns.items()}


def test_known_poses_in_free_space_do_not_speak_against_an_arm_at_a_known_cone() -> None:
    q = MIDDLE + np.random.default_rng(7).uniform(-1, 1, (20, 6)) * TURNS
    found = rsicalib.calibrate(
        cone.session(7).table, drawn(), check=table(q, cone.tip(q), 7), check_point="ball"
    )
    assert found.verdict == "adequate", found.summary()
    assert "open_loops" not in {warning.kind for warning in found.warnings}


def test_an_arm_that_has_changed_is_still_told_at_its_cone() -> None:
    """Its second joint is half a degree elsewhere: the ball in the cone is where it was."""
    taken = cone.session(8, poses=20, samples=1)
    bent = taken.angles + [0, 0.009, 0, 0, 0, 0]
    places = np.tile(cone.CONE, (len(bent), 1))
    found = rsicalib.calibrate(
        cone.session(7).table, drawn(), check=table(bent, places, 8), check_point="ball"
    )
    assert found.reasons[0].kind == "open_loops", found.summary()


def test_a_result_is_applied_in_free_space_without_a_word() -> None:
    """Nobody says that these postures are at the cone, and they are far from it."""
    q = MIDDLE + np.random.default_rng(9).uniform(-1, 1, (20, 6)) * TURNS
    found = rsicalib.calibrate(cone.session(7).table, drawn())
    angles = {k: v for k, v in table(q, cone.tip(q), 9).items() if k not in "xyz"}
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        places = rsicalib.forward(angles, calibration=found, mechanism=drawn())
    # The offset of the first joint is known as well as the cone is: .02 mm at its distance.
    assert np.abs(places[:, :3] - cone.tip(q)).max() < 0.5


def test_a_result_of_another_arm_is_still_told_at_the_cone() -> None:
    taken = cone.session(8, poses=20, samples=1)
    found = rsicalib.calibrate(cone.session(7).table, drawn())
    bent = table(taken.angles + [0, 0.009, 0, 0, 0, 0], np.zeros((20, 3)), 8)
    angles = {k: v for k, v in bent.items() if k not in "xyz"}
    with pytest.warns(rsicalib.OpenLoopsWarning, match="unless the arm was away"):
        rsicalib.forward(angles, calibration=found, mechanism=drawn())


def test_a_blank_key_says_that_nothing_is_touched() -> None:
    """Of an unknown cone, with the column that names it."""
    mechanism = rsicalib.Mechanism.from_toml(cone.mechanism(SIGMA, PLAY))
    found = rsicalib.calibrate(cone.session(7).table, mechanism)
    q = MIDDLE + np.random.default_rng(9).uniform(-1, 1, (20, 6)) * TURNS
    angles = {k: v for k, v in table(q, cone.tip(q), 9).items() if k not in "xyz"}
    wanted = rsicalib.forward(angles, calibration=found, mechanism=mechanism)
    blank = rsicalib.forward(
        {**angles, "at": [""] * len(q)}, calibration=found, mechanism=mechanism
    )
    np.testing.assert_array_equal(blank, wanted)
