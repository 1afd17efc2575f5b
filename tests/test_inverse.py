"""The inverse kinematics of a platform on three arms, against its closed form: one way to bend."""

from __future__ import annotations

import numpy as np

import rsicalib
from rsicalib import Mechanism
from tests.full import sized
from tests.oracle import Array

BASE, UPPER, FORE, HAND = 110.0, 78.0, 97.0, 40.0
"""Middle to shoulder, both links, and middle of the platform to wrist [mm]."""
BEARINGS = (np.pi, np.pi / 3, -np.pi / 3)
LIMITS = np.array([[-np.pi / 2, np.pi / 2], [-np.pi, 0.0], [-np.pi / 2, np.pi / 2]])
LOW = np.array([-60, -60, -130, -0.5, -0.5, -0.5])
HIGH = np.array([60, 60, -30, 0.5, 0.5, 0.5])


def platform() -> Mechanism:
    ends = {f"w{k + 1}": [*hand(k), 0.0] for k in range(3)}
    side = float(np.linalg.norm(np.subtract(ends["w1"], ends["w2"])))
    pairs = (("w1", "w2"), ("w2", "w3"), ("w1", "w3"))
    channel = {"unit": "rad", "gain": 1.0, "offset": 0.0}
    return Mechanism.from_dict(
        {
            "name": "three arms",
            "length_unit": "mm",
            "channel": [
                {"name": f"a{i}{j}", **channel, "limits": LIMITS[j - 1].tolist()}
                for i in (1, 2, 3)
                for j in (1, 2, 3)
            ],
            "chain": [
                {
                    "name": f"arm{i}",
                    "dh": [
                        {"theta": BEARINGS[i - 1], "a": -BASE, "alpha": np.pi / 2},
                        {"channel": f"a{i}1", "a": UPPER},
                        {"channel": f"a{i}2", "alpha": np.pi / 2},
                        {"channel": f"a{i}3"},
                    ],
                }
                for i in (1, 2, 3)
            ],
            "point": [{"name": f"w{i}", "chain": f"arm{i}", "at": [FORE, 0, 0]} for i in (1, 2, 3)],
            "closure": [
                {"name": f"{a}-{b}", "kind": "distance", "between": [a, b], "value": side}
                for a, b in pairs
            ],
            "platform": ends,
            "model": {"terms": ["offset"]},
        }
    )


def hand(k: int) -> tuple[float, float]:
    """A wrist in the frame of the platform."""
    angle = 2 * np.pi * k / 3
    return HAND * np.cos(angle), -HAND * np.sin(angle)


def turned(axis: int, angle: float) -> Array:
    c, s = np.cos(angle), np.sin(angle)
    planes = {0: (1, 2), 1: (2, 0), 2: (0, 1)}
    i, j = planes[axis]
    out = np.eye(3)
    out[i, i] = out[j, j] = c
    out[i, j], out[j, i] = -s, s
    return out


def arm(bearing: float, wrist: Array) -> Array | None:
    """Angles of an arm whose elbow bends one way, within its limits."""
    p = turned(0, -np.pi / 2) @ (turned(2, -bearing) @ wrist + [BASE, 0, 0])
    sine = p[2] / FORE
    if abs(sine) > 1:
        return None
    third = np.arcsin(sine)
    short = FORE * np.cos(third)
    cosine = (p[0] ** 2 + p[1] ** 2 - UPPER**2 - short**2) / (2 * UPPER * short)
    if abs(cosine) > 1:
        return None
    second = -np.arccos(cosine)
    first = np.arctan2(p[1], p[0])
    first -= np.arctan2(short * np.sin(second), UPPER + short * np.cos(second))
    angles = np.array([(first + np.pi) % (2 * np.pi) - np.pi, second, third])
    inside = (angles > LIMITS[:, 0] + 0.03) & (angles < LIMITS[:, 1] - 0.03)
    return angles if inside.all() else None


def test_a_pose_is_held_within_the_limits_where_it_can_be() -> None:
    """From straight legs the solver comes to folded ones in 5 of 1000."""
    rng = np.random.default_rng(5)
    poses: list[Array] = []
    wanted: list[Array] = []
    while len(poses) < sized(400, 1000):
        pose = rng.uniform(LOW, HIGH)
        turn = turned(2, pose[5]) @ turned(1, pose[4]) @ turned(0, pose[3])
        wrists = [turn @ [*hand(k), 0.0] + pose[:3] for k in range(3)]
        arms = [arm(b, w) for b, w in zip(BEARINGS, wrists, strict=True)]
        if all(a is not None for a in arms):
            poses.append(pose)
            wanted.append(np.concatenate([a for a in arms if a is not None]))
    found = rsicalib.inverse(np.array(poses), platform())
    np.testing.assert_allclose(found, wanted, atol=1e-6)
