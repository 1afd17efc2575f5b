"""Poses that differ from the others and alone show what the model lacks are no wrong poses.

Witness: an arm in products of plain matrices (`tests/cone.py`), nearly all of whose poses have the
elbow on one side; an eccentric encoder at the elbow shows in the few that do not.
"""

from __future__ import annotations

from itertools import islice
from typing import Any

import numpy as np
import pytest

import rsicalib
from rsicalib import Mechanism
from tests import cone
from tests.full import sized
from tests.oracle import Array

NOISE, PLAY = 2e-5, 0.02
ELBOW = 2


def few(rng: np.random.Generator, count: int) -> list[Array]:
    """Poses with the elbow on the other side."""
    found: list[Array] = []
    while len(found) < count:
        turns = rng.uniform(-1, 1, 6) * [1, 0.6, 0.6, 1.5, 1.5, 3]
        near = np.array([0.4, -1.0, 1.6, -1.5, 1.5, 0.0]) + turns
        place = cone.CONE + PLAY * rng.standard_normal(3)
        (q,) = cone.touching(near[None], place[None])
        inside = np.all((q > cone.LIMITS[:, 0]) & (q < cone.LIMITS[:, 1]))
        if inside and np.allclose(cone.tip(q), place, atol=1e-6) and q[ELBOW] > 0.8:
            found.append(q)
    return found


def session(seed: int, eccentric: float) -> dict[str, Any]:
    """40 poses with the elbow on one side and 3 with it on the other, in any order."""
    rng = np.random.default_rng([5, seed])
    usual = (q for q in cone.seated(rng, cone.CONE, PLAY) if -2.3 < q[ELBOW] < -0.9)
    angles = np.array([*islice(usual, 40), *few(rng, 3)])
    angles = angles[rng.permutation(len(angles))]
    read = angles - cone.OFFSETS + NOISE * rng.standard_normal(angles.shape)
    read[:, ELBOW] += eccentric * np.sin(angles[:, ELBOW])
    columns = {f"q{k + 1}": read[:, k] for k in range(6)}
    return {**columns, "pose": np.arange(1, len(read) + 1), "at": ["cone"] * len(read)}


@pytest.mark.parametrize("seed", range(sized(1, 6)))
def test_poses_that_alone_show_an_eccentric_encoder_are_kept(seed: int) -> None:
    """Without the rule `kept_in` the first loses a sound pose, and another term is named."""
    found = rsicalib.trace(session(seed, 6e-4), Mechanism.from_toml(cone.mechanism(NOISE, PLAY)))
    assert not found.excluded
    assert "once_per_turn@q3" in {step.spec for step in found.steps}
