"""An arm before a tracker, whose ball touches one cone, two, or a groove: one line, or one point.

How the tracker is turned about it only the play there tells, which joints and tracker both see.
The witness is the arm in plain matrix products (`tests/cone.py`), and a fit by scipy of all that is
unknown, the turn included.
"""

from __future__ import annotations

from dataclasses import dataclass
from itertools import islice
from typing import Any

import numpy as np
import pytest
from scipy.optimize import least_squares
from scipy.spatial.transform import Rotation

import rsicalib
from tests import cone
from tests.full import sized
from tests.oracle import Array

SIGMA, PLAY, SEEN = 5e-5, 0.03, 0.03
"""Noise of the encoders [rad], and play and noise of the tracker [mm]."""
CONES = np.array([[-430.0, -200.0, 120.0], [-520.0, 150.0, 180.0]])
ALONG = np.array([0.6, 0.8, 0.0])
STANDS, ORIGIN = Rotation.from_euler("xyz", [0.1, -0.05, 2.1]), np.array([2500.0, -900.0, 300.0])
WHERE = ["one cone", "two cones", "groove"]
OFFSETS = cone.OFFSETS * (np.arange(6) > 0)
"""The zero of the first joint is where the cones say [rad]."""


@dataclass(frozen=True)
class Session:
    """Readings of joints and tracker, and which cone was touched; none: the groove."""

    read: Array
    seen: Array
    at: Array | None

    def table(self) -> dict[str, Any]:
        columns: dict[str, Any] = {"pose": np.arange(len(self.read)) + 1.0}
        columns |= {f"q{k + 1}": self.read[:, k] for k in range(6)}
        columns |= {axis: self.seen[:, i] for i, axis in enumerate("xyz")}
        return columns if self.at is None else columns | {"at": [f"c{k}" for k in self.at]}

    def witness(self) -> float:
        """χ² of the fit by all that is unknown, from where all is."""
        middle = self.seen.mean(axis=0)
        # Of the play of a groove, what is across it.
        across = np.eye(3) if self.at is not None else np.linalg.svd(ALONG[None])[2][1:]
        slope = cone.slopes(self.read + OFFSETS)
        slope = np.concatenate([across @ slope, -slope], axis=1)
        covariance = SIGMA**2 * slope @ slope.swapaxes(1, 2)
        covariance += np.diag([PLAY**2] * len(across) + [SEEN**2] * 3)
        white = np.linalg.inv(np.linalg.cholesky(covariance))

        def left(v: Array) -> Array:
            ball = cone.tip(self.read + np.r_[0.0, v[:5]])
            tracked = (STANDS * Rotation.from_rotvec(v[8:11])).apply(self.seen - middle)
            apart = tracked + STANDS.apply(middle) + ORIGIN + v[5:8] - ball
            if self.at is not None:
                gap = ball - v[11:].reshape(-1, 3)[self.at]
            else:
                along = ALONG + v[11:13] @ across
                off = ball - CONES[0] - v[13:15] @ across
                gap = (off - np.outer(off @ along / (along @ along), along)) @ across.T
            gaps: Array = white @ np.concatenate([gap, apart], axis=1)[..., None]
            return gaps.ravel()

        places = np.zeros(4) if self.at is None else CONES[: 1 + self.at.max()].ravel()
        found = least_squares(left, np.r_[OFFSETS[1:], np.zeros(6), places], x_scale="jac")
        return float(2 * found.cost)


def session(where: str, seed: int, poses: int = 40) -> Session:
    rng = np.random.default_rng([seed, WHERE.index(where)])
    cones = 1 if where == "one cone" else 2
    at = None if where == "groove" else rng.permutation(np.arange(poses) % cones)
    stands = CONES[0] + rng.uniform(-300, 300, (poses, 1)) * ALONG if at is None else CONES[at]
    near = np.array(list(islice(cone.seated(rng, CONES[0], 0.0), poses)))
    q = cone.touching(near, stands + PLAY * rng.standard_normal((poses, 3)))
    reached = np.abs(cone.tip(q) - stands).max(axis=1) < 1.0
    q = q[reached]
    read = q - OFFSETS + SIGMA * rng.standard_normal(q.shape)
    seen = STANDS.inv().apply(cone.tip(q) - ORIGIN) + SEEN * rng.standard_normal((len(q), 3))
    return Session(read, seen, None if at is None else at[reached])


def drawn(where: str, pose: list[float] | None = None) -> rsicalib.Mechanism:
    asked = ", ".join(f'"offset@q{k}"' for k in range(2, 7))
    text = cone.mechanism(SIGMA, PLAY, f"[{asked}]")
    if where == "groove":
        direction = f'[[line]]\nname = "cone"\nunknown = []\ndirection = {ALONG.tolist()}'
        text = text.replace('[[point]]\nname = "cone"\nunknown = ["at"]', direction)
        text = text.replace('kind = "touch"', 'kind = "line"')
    elif where == "one cone":
        text = text.replace('unknown = ["at"]', "unknown = []")
    text += '[[point]]\nname = "marker"\ncolumns = ["x", "y", "z"]\nframe = "tracker"\n'
    text += '[[frame]]\nname = "tracker"\nunknown = []\n'
    text += "" if pose is None else f"pose = {pose}\n"
    text += '[[closure]]\nname = "ball at marker"\nkind = "touch"\nbetween = ["ball", "marker"]\n'
    return rsicalib.Mechanism.from_toml(text + f"noise = {SEEN}\n")


@pytest.mark.parametrize("where", WHERE)
def test_a_sound_arm_is_adequate_wherever_the_tracker_stands(where: str) -> None:
    sound, covered, seeds = 0, 0, sized([1, 2], list(range(40)))
    for seed in seeds:
        made = session(where, seed)
        found = rsicalib.trace(made.table(), drawn(where))
        sound += found.verdict == "adequate"
        assert found.before is not None
        # Held at another turn it is larger, by 3 to 200.
        assert found.before.chi2 == pytest.approx(made.witness(), abs=1.0)
        for k in range(2, 7):
            low, high = found[f"offset@q{k}"].interval or (np.inf, np.inf)
            covered += low <= OFFSETS[k - 1] <= high
    # One of a hundred by chance, and one of twenty intervals.
    assert sound >= 0.93 * len(seeds)
    assert covered >= sized(0.8, 0.91) * 5 * len(seeds)


@pytest.mark.parametrize("where", WHERE)
def test_a_pose_of_the_tracker_that_is_given_is_where_it_is_looked_for(where: str) -> None:
    made = session(where, 3)
    pose = [*ORIGIN.tolist(), *STANDS.as_euler("xyz").tolist()]
    found = rsicalib.calibrate(made.table(), drawn(where, pose))
    assert found.verdict == "adequate" and found.fit is not None
    assert found.fit.chi2 == pytest.approx(made.witness(), abs=1.0)
    angles = [found[f"unknown_frame@tracker.{axis}"].value for axis in ("rx", "ry", "rz")]
    turned = Rotation.from_euler("xyz", angles)
    # Play as large as the noise tells it to some .2 rad.
    assert (turned * STANDS.inv()).magnitude() < 0.8


def test_a_gain_is_named_beside_a_turn_that_only_play_tells() -> None:
    made = session("groove", 5)
    wrong = made.read.copy()
    wrong[:, 3] = (made.read[:, 3] + OFFSETS[3]) / 1.002 - OFFSETS[3]
    found = rsicalib.trace(Session(wrong, made.seen, None).table(), drawn("groove"))
    assert found.verdict == "explained"
    assert [(step.term, step.target) for step in found.steps] == [("gain", "q4")]
