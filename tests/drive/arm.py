"""An arm of six joints with one thing wrong in its body, drawn at random, and its files [mm]."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from tests.machines.arm import JOINTS, LIMITS, NEAR, SPREAD, Body
from tests.machines.files import toml
from tests.machines.plain import frames, place
from tests.oracle import Array

NOISE, PLAY = 5e-5, 0.02
"""Of an encoder [rad], and of a ball that sits in a socket or stands on a table [mm]."""
BALL_KG = 0.05
"""Mass of the ball, which its maker knows [kg]."""
KINDS = ("stiffness", "backlash", "eccentric", "bent")
APART = 150.0
"""Between two cones, at the least, and between two places of a table [mm]."""
SIZES: Mapping[str, tuple[float, float]] = {
    "stiffness": (3e-3, 8e-3),  # rad, under the largest torque of gravity
    "backlash": (2e-3, 5e-3),  # rad, half of the play
    "eccentric": (2e-3, 6e-3),  # centre of the disc by its radius
    "bent": (4e-3, 1e-2),  # rad, in the middle of the link
}
WHERE: Mapping[str, tuple[int, ...]] = {
    "stiffness": (1, 2),  # joints that carry much: shoulder and elbow
    "backlash": (2,),  # the elbow: what it carries is far more than the tool is pressed
    "eccentric": (1, 2, 3, 4, 5),  # the first joint's turns the whole cell as well
    "bent": (1, 2),  # the long links
}


@dataclass(frozen=True)
class Arm:
    """What the maker does not know: offsets of the encoders, one defect, and where things stand."""

    body: Body
    offsets: Array
    kind: str
    joint: int
    size: float
    turn: float
    """Direction of the eccentricity, or of the bend [rad]."""
    touch: str
    """`cones` or `plane`."""
    places: Mapping[str, Array]
    """Centres of the ball in each cone, or of the ball somewhere on the table [mm]."""
    spots: tuple[tuple[str, Array], ...]
    """Where a hand leads the ball first: to each cone, and to the table in three places [mm]."""

    @classmethod
    def drawn(cls, seed: int, kind: str | None = None, touch: str | None = None) -> Arm:
        """The arm of a seed; its kind of defect and what it touches by turns where not given."""
        rng = np.random.default_rng([seed, 37])
        body = Body.random(rng)
        for row, mass in zip(body.rows, (6.0, 8.0, 4.0, 1.5, 1.0, 0.5), strict=True):
            row["mass"] = float(mass * rng.uniform(0.7, 1.3))
            row["com"] = [row.get("a", 0.0) / 2, 0.0, row.get("d", 0.0) / 2]
        kind = kind or KINDS[seed % len(KINDS)]
        touch = touch or ("cones", "plane")[seed // len(KINDS) % 2]
        names = ("left", "right") if touch == "cones" else ("table",)
        joint = int(rng.choice(WHERE[kind]))
        size, turn = rng.uniform(*SIZES[kind]), rng.uniform(-np.pi, np.pi)
        offsets = rng.normal(0, 4e-3, 6)
        spots: list[Array] = []
        while len(spots) < (2 if touch == "cones" else 3):
            spot = body.tip(_posture(rng), {})[0]
            if touch == "plane" and spots:
                spot[2] = spots[0][2]
            if all(np.linalg.norm(spot - other) > APART for other in spots):
                spots.append(spot)
        places = dict(zip(names, spots, strict=False))
        led = tuple((names[k % len(names)], spot) for k, spot in enumerate(spots))
        rest = (float(size), float(turn), touch, places, led)
        return cls(body, offsets, kind, joint, *rest)

    @property
    def target(self) -> str:
        """What a result should name: the channel, or the link."""
        return f"arm/{self.joint + 1}" if self.kind == "bent" else JOINTS[self.joint]

    @property
    def largest_torque(self) -> float:
        """Of gravity about the joint, over the postures that the arm is used in [N m]."""
        rng = np.random.default_rng(0)
        read = np.vstack([_posture(rng) for _ in range(200)])
        return float(np.abs(self._torque(read)).max())

    def _torque(self, read: Array) -> Array:
        """Torque of the weights about the joint, by differences of their heights [N m]."""
        step = np.zeros(6)
        step[self.joint] = 1e-4
        return (self._height(read + step) - self._height(read - step)) / 2e-4 * 9.81e-3

    def _height(self, read: Array) -> Array:
        q = dict(zip(JOINTS, read.T, strict=True))
        out = np.zeros(len(read))
        for k, row in enumerate(self.body.rows):
            bare = {**row, "a": 0.0, "d": 0.0, "alpha": 0.0}
            frame = frames([*self.body.rows[:k], bare], q, len(read))
            out += row["mass"] * place(frame, row["com"])[:, 2]
        return out

    def _last(self) -> dict[str, Any]:
        """The last link with the ball on it: their mass, and where its centre is."""
        row = dict(self.body.rows[-1])
        turned = {"theta": 0.0, "alpha": row.get("alpha", 0.0)}
        carried = {**turned, "a": row.get("a", 0.0), "d": row.get("d", 0.0)}
        ball = place(frames([carried], {}, 1), self.body.tool)[0]
        mass = row["mass"] + BALL_KG
        centre = (row["mass"] * np.array(row["com"]) + BALL_KG * ball) / mass
        return {**row, "mass": mass, "com": [float(x) for x in centre]}

    def mechanism(self) -> str:
        """The mechanism file of the maker: the arm as drawn."""
        channels = [
            {"name": j, "unit": "rad", "gain": 1.0, "offset": 0.0, "limits": list(limits)}
            | {"noise": NOISE}
            for j, limits in zip(JOINTS, LIMITS, strict=True)
        ]
        tip = {"name": "ball", "chain": "arm", "at": [float(x) for x in self.body.tool]}
        document: dict[str, Any] = {
            "name": "arm",
            "length_unit": "mm",
            "gravity": [0.0, 0.0, -1.0],
            "channel": channels,
            "chain": [{"name": "arm", "dh": [*self.body.rows[:-1], self._last()]}],
            "point": [tip],
        }
        if self.touch == "cones":
            document["point"].append({"name": "cone", "unknown": ["at"]})
            between, kind = ["ball", "cone"], "touch"
        else:
            document["plane"] = [{"name": "table", "unknown": ["surface"]}]
            between, kind = ["ball", "table"], "plane"
        closure = {"name": "touch", "kind": kind, "between": between, "noise": PLAY}
        # The zero of the first joint turns the whole cell: no touch can show it.
        terms = [f"offset@{j}" for j in JOINTS[1:]]
        return toml({**document, "closure": [closure], "model": {"terms": terms}})


def _posture(rng: np.random.Generator) -> Array:
    """A posture from which much is in reach: (1, 6)."""
    return np.asarray(NEAR + 0.3 * SPREAD * rng.uniform(-1, 1, 6))[None]


def led(arm: Arm, spot: Array, near: Array = NEAR) -> Array:
    """Readings with the ball of the drawn arm at a spot: where a hand would lead it (6,)."""
    q = near.copy()
    steps = 1e-6 * np.eye(6)
    for _ in range(100):
        off = arm.body.tip(q[None], {})[0] - spot
        slopes = (arm.body.tip(q + steps, {}) - arm.body.tip(q - steps, {})).T / 2e-6
        q = q - np.clip(np.linalg.pinv(slopes) @ off, -0.2, 0.2)
    return np.asarray(q - arm.offsets)
