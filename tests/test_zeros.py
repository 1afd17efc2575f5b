"""Encoders whose zeros are anywhere, and loops so far open that repeats tell no noise."""

from __future__ import annotations

from itertools import islice

import numpy as np
import pytest
from scipy.optimize import least_squares

import rsicalib
from tests import cone
from tests.full import sized
from tests.oracle import Array

PLAY, NOISE = 0.05, 2e-5
"""How well the ball rests [mm], and noise of an encoder [rad]."""
FREE = ("q2", "q3", "q4", "q5")
"""Joint 1 turns with the cone, joint 6 about the ball."""
TERMS = '["offset@q2", "offset@q3", "offset@q4", "offset@q5"]'


def at_a_cone(seed: int, zeros: Array, poses: int = 40) -> dict[str, list[float] | list[str]]:
    """Seatings of an arm whose encoders read angles less `zeros`."""
    rng = np.random.default_rng([seed, 181])
    q = np.array(list(islice(cone.seated(rng, cone.CONE, PLAY), poses)))
    read = q - zeros + NOISE * rng.standard_normal(q.shape)
    table: dict[str, list[float] | list[str]] = {f"q{k + 1}": [*read[:, k]] for k in range(6)}
    return {"pose": [*range(poses)], "at": ["cone"] * poses, **table}


@pytest.mark.parametrize("seed", range(sized(8, 60)))
def test_zeros_anywhere_are_found(seed: int) -> None:
    """One, two, three or four encoders were never set to zero.

    Such an arm closes at one cone with joint 1 reversed, too, where encoders are half a turn off:
    then both are said. Of 60 devices one is so.
    """
    rng = np.random.default_rng([seed, 182])
    zeros, count = np.zeros(6), 1 + seed % 4
    which = rng.choice([1, 2, 3, 4], count, replace=False)
    zeros[which] = rng.uniform(-np.pi, np.pi, count)
    arm = rsicalib.load_mechanism(cone.mechanism(NOISE, PLAY, TERMS))
    found = rsicalib.calibrate(at_a_cone(seed, zeros), arm)
    if found.verdict == "implausible":
        kinds = {warned.kind: warned for warned in found.warnings}
        assert {"zeros", "reversed"} <= {*kinds}
        far = [name for k, name in enumerate(FREE, 1) if abs(zeros[k]) > np.pi / 4]
        assert set(kinds["zeros"].targets) == {*far}
        return
    assert found.verdict == "adequate"
    assert not [warned for warned in found.warnings if warned.kind in ("zeros", "reversed")]
    for k, name in enumerate(FREE, 1):
        parameter = found[f"offset@{name}"]
        off = np.angle(np.exp(1j * (parameter.value - zeros[k])))
        assert abs(off) < 5.0 * parameter.sd, name


# ------------------------------------------------------------------ two arms that hold a bar

BALLS = {"left": [[60, 0, 20], [-30, 52, 20], [-30, -52, 20]]}
BALLS["right"] = [[30, 52, 10], [-60, 0, 10], [30, -52, 10]]
RODS = ((0, 0), (0, 2), (1, 1), (1, 2), (2, 0), (2, 1))
APART = -900.0
"""Between the arms, which face each other [mm]."""


def frame(q: Array) -> Array:
    """End of an arm, (4, 4)."""
    at = np.eye(4)
    for angle, (d, a, alpha) in zip(q, cone.ROWS, strict=True):
        c, s, ca, sa = np.cos(angle), np.sin(angle), np.cos(alpha), np.sin(alpha)
        row = [
            [c, -s * ca, s * sa, a * c],
            [s, c * ca, -c * sa, a * s],
            [0, sa, ca, d],
            [0, 0, 0, 1],
        ]
        at = at @ np.array(row)
    return at


def lengths(left: Array, right: Array) -> Array:
    """Of the six rods."""
    places = []
    base = np.diag([-1.0, -1.0, 1.0, 1.0])
    base[0, 3] = -APART
    for first, q, name in ((np.eye(4), left, "left"), (base, right, "right")):
        balls = np.column_stack([np.array(BALLS[name], dtype=float), np.ones(3)])
        places.append((first @ frame(q) @ balls.T).T[:, :3])
    return np.array([np.linalg.norm(places[0][i] - places[1][j]) for i, j in RODS])


HOME = np.array([0.3, -1.2, -1.4, -0.6, 1.3, 0.2]), np.array([-0.2, -1.3, -1.5, 0.4, -1.2, 0.5])


def holding(seed: int, poses: int, samples: int) -> tuple[Array, Array]:
    """Readings (poses · samples, 12) with the rods as long as they are at home, and the rods."""
    rng = np.random.default_rng([seed, 183])
    drawn = lengths(*HOME)
    rows: list[Array] = []
    while len(rows) < poses:
        left = HOME[0] + rng.uniform(-0.6, 0.6, 6)
        start = HOME[1] + rng.uniform(-0.6, 0.6, 6)
        end = least_squares(
            lambda q, left=left: lengths(left, q) - drawn, start, xtol=1e-14, ftol=1e-14
        )
        if end.cost < 1e-18 and np.all(np.abs(end.x) < 3.0):
            rows.append(np.concatenate([left, end.x]))
    angles = np.repeat(np.array(rows), samples, axis=0)
    return angles + NOISE * rng.standard_normal(angles.shape), drawn


def two_arms(drawn: Array) -> rsicalib.Mechanism:
    names = [f"{side}{k}" for side in "lr" for k in range(1, 7)]
    rows = {
        side: [
            {"channel": f"{side[0]}{k}", "d": d, "a": a, "alpha": alpha}
            for k, (d, a, alpha) in enumerate(cone.ROWS, 1)
        ]
        for side in BALLS
    }
    rows["right"].insert(0, {"theta": np.pi, "a": APART})
    return rsicalib.Mechanism.from_dict(
        {
            "name": "two arms",
            "length_unit": "mm",
            "channel": [
                {"name": n, "unit": "rad", "gain": 1.0, "offset": 0.0, "noise": NOISE}
                for n in names
            ],
            "chain": [{"name": side, "dh": dh} for side, dh in rows.items()],
            "point": [
                {"name": f"{side}{k}", "chain": side, "at": at}
                for side, balls in BALLS.items()
                for k, at in enumerate(balls)
            ],
            "closure": [
                {
                    "name": f"{i}{j}",
                    "kind": "distance",
                    "between": [f"left{i}", f"right{j}"],
                    "value": v,
                }
                for (i, j), v in zip(RODS, drawn.tolist(), strict=True)
            ],
            "model": {"terms": [f"offset@{n}" for n in names if n not in ("l6", "r6")]},
        }
    )


@pytest.mark.parametrize("wrong", ["none", "l2", "r4"][: sized(3, 3)])
def test_loops_far_open_say_nothing_of_noise(wrong: str) -> None:
    """With a reversed sign repeats seemed to scatter by 1e6 times their noise."""
    read, drawn = holding(1, 30, 4)
    arms = two_arms(drawn)
    names = [channel.name for channel in arms.channels]
    if wrong != "none":
        read[:, names.index(wrong)] *= -1.0
    table = dict(zip(names, read.T, strict=True))
    found = rsicalib.calibrate({"pose": np.repeat(np.arange(30), 4), **table}, arms)
    said = {warned.kind: warned.target for warned in found.warnings}
    assert "noise" not in said
    assert found.noise is not None and found.noise.kind == "declared"
    if wrong == "none":
        assert found.verdict == "adequate"
    else:
        assert said == {"reversed": wrong}
