"""An arm whose stand was pushed amid a session at three cones, or one cone that was."""

from __future__ import annotations

from itertools import islice

import numpy as np
import pytest

import rsicalib
from tests import cone
from tests.full import sized
from tests.oracle import Array

NOISE, PLAY, POSES, MOVED = 2e-5, 0.02, 42, 23
CONES = {
    "a": np.array([-430.0, -200.0, 120.0]),
    "b": np.array([-380.0, 220.0, 150.0]),
    "c": np.array([-520.0, 30.0, 260.0]),
}


def turned(by: Array) -> Array:
    """The rotation by a small vector (3,), to second order."""
    x, y, z = by
    w = np.array([[0, -z, y], [z, 0, -x], [-y, x, 0]])
    return np.asarray(np.eye(3) + w + 0.5 * w @ w)


def session(seed: int, shift: Array, turn: Array, of: str) -> dict[str, list[float] | list[str]]:
    """Seatings in three cones by turns; from pose `MOVED` on the arm sees some elsewhere."""
    rng = np.random.default_rng([seed, 191])
    rows, at = [], []
    for pose in range(POSES):
        name = "abc"[pose % 3]
        place = CONES[name]
        if pose + 1 >= MOVED and name in of:
            place = turned(turn) @ place + shift
        rows.append(next(islice(cone.seated(rng, place, PLAY), 1)))
        at.append(name)
    offsets = cone.OFFSETS * [0, 1, 1, 1, 1, 0]
    read = np.array(rows) - offsets + NOISE * rng.standard_normal((POSES, 6))
    table: dict[str, list[float] | list[str]] = {f"q{k + 1}": [*read[:, k]] for k in range(6)}
    return {"pose": [*range(1, POSES + 1)], "at": at, **table}


@pytest.mark.parametrize("seed", range(sized(3, 12)))
@pytest.mark.parametrize("of", ["abc", "b"])
def test_what_moved_is_told(of: str, seed: int) -> None:
    """All cones at once are the base of the arm, which no cone is tied to; one is that cone."""
    rng = np.random.default_rng([seed, 192])
    shift, turn = rng.normal(0, 0.5, 3), rng.normal(0, 1e-3, 3)
    terms = '["offset@q2", "offset@q3", "offset@q4", "offset@q5"]'
    arm = rsicalib.load_mechanism(cone.mechanism(NOISE, PLAY, terms))
    found = rsicalib.trace(session(seed, shift, turn, of), arm)
    assert found.verdict == "explained"
    named = [(step.term, step.place) for step in found.steps]
    if of == "abc":
        assert named == [("base_slip", str(MOVED))]
    else:
        assert [term for term, _ in named] == ["point_slip"]
