"""A six-joint arm with a ball that it puts into cones, in products of plain matrices.

Every seating is one draw of where the ball sits; all samples of a pose read the same seating.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from tests.oracle import Array

LIMITS = np.array([[-3.1, 3.1], [-3.1, 0], [-2.8, 2.8], [-3.1, 3.1], [-3.1, 3.1], [-3.1, 3.1]])
OFFSETS = np.array([0.004, -0.006, 0.008, -0.010, 0.005, 0.007])
BALL = np.array([40.0, 0.0, 120.0, 1.0])
CONE = np.array([-430.0, -200.0, 120.0])
ROWS = (
    (162.5, 0.0, np.pi / 2),
    (0.0, -425.0, 0.0),
    (0.0, -392.2, 0.0),
    (133.3, 0.0, np.pi / 2),
    (99.7, 0.0, -np.pi / 2),
    (99.6, 0.0, 0.0),
)
HEAD = """
name = "arm at a cone"
length_unit = "mm"
{channels}
[[chain]]
name = "arm"
dh = [{rows}]
[[point]]
name = "ball"
chain = "arm"
at = [40.0, 0.0, 120.0]
[[point]]
name = "cone"
unknown = ["at"]
[[closure]]
name = "ball in cone"
kind = "touch"
between = ["ball", "cone"]
{play}
[model]
terms = {terms}
"""


def mechanism(noise: float | None, play: float | None, terms: str = '["offset"]') -> str:
    """The mechanism as a file, with what is declared of the noise."""
    declared = "" if noise is None else f", noise = {noise}"
    channels = "".join(
        f'[[channel]]\nname = "q{k + 1}"\nunit = "rad"\ngain = 1.0\noffset = 0.0\n'
        f"limits = [{low}, {high}]\n{declared.removeprefix(', ')}\n"
        for k, (low, high) in enumerate(LIMITS)
    )
    rows = ", ".join(
        f'{{channel = "q{k + 1}", d = {d}, a = {a}, alpha = {alpha}}}'
        for k, (d, a, alpha) in enumerate(ROWS)
    )
    own = "" if play is None else f"noise = {play}"
    return HEAD.format(channels=channels, rows=rows, play=own, terms=terms)


def chain(q: Array) -> tuple[Array, Array]:
    """Place of the ball for joint angles, and its derivative: each joint turns what it carries."""
    frame = np.eye(4)
    axes, places = [], []
    for angle, (d, a, alpha) in zip(q.tolist(), ROWS, strict=True):
        axes.append(frame[:3, 2])
        places.append(frame[:3, 3])
        c, s, ca, sa = math.cos(angle), math.sin(angle), math.cos(alpha), math.sin(alpha)
        frame = frame @ np.array(
            [[c, -s * ca, s * sa, a * c], [s, c * ca, -c * sa, a * s], [0, sa, ca, d], [0, 0, 0, 1]]
        )
    ball = (frame @ BALL)[:3]
    return ball, np.cross(axes, ball - places).T


def tip(q: Array) -> Array:
    """Place of the ball for joint angles."""
    return chain(q)[0]


def slopes(q: Array) -> Array:
    """Derivative of the place of the ball by the joint angles."""
    return chain(q)[1]


def touching(q: Array, place: Array) -> Array:
    """Joint angles near `q` at which the ball is at a place, by Newton's method."""
    for _ in range(30):
        at, slope = chain(q)
        step = np.linalg.pinv(slope) @ (at - place)
        largest = float(np.abs(step).max())
        q = q - step * min(1.0, 0.3 / max(largest, 1e-300))
        if largest < 1e-11:
            break
    return q


@dataclass(frozen=True)
class Seatings:
    """A session: one row for each sample, and the joint angles of each seating."""

    table: dict[str, list[float] | list[str]]
    angles: Array


def session(
    seed: int,
    poses: int = 40,
    samples: int = 8,
    sigma: float = 2e-5,
    play: float = 0.02,
    bend: float = 0.0,
    at: str = "cone",
    cone: Array = CONE,
) -> Seatings:
    """Seatings in one cone; `bend` is the error of joint 2 at the horizontal, by its load [rad]."""
    rng, noise = np.random.default_rng(seed), np.random.default_rng([seed, 1])
    columns: dict[str, list[float]] = {"pose": [], **{f"q{k + 1}": [] for k in range(6)}}
    angles: list[Array] = []
    while len(angles) < poses:
        near = np.array([0.4, -1.4, -1.6, -1.5, 1.5, 0.0])
        near = near + rng.uniform(-1, 1, 6) * [1, 0.6, 0.8, 1.5, 1.5, 3]
        place = cone + play * rng.standard_normal(3)
        q = touching(near, place)
        inside = np.all((q > LIMITS[:, 0]) & (q < LIMITS[:, 1]))
        if not inside or not np.allclose(tip(q), place, atol=1e-6):
            continue
        angles.append(q)
        wrong = np.zeros(6)
        wrong[1] = bend * np.cos(q[1])
        for _ in range(samples):
            read = q - OFFSETS + wrong + sigma * noise.standard_normal(6)
            columns["pose"].append(len(angles))
            for k in range(6):
                columns[f"q{k + 1}"].append(float(read[k]))
    table: dict[str, list[float] | list[str]] = {**columns}
    table["at"] = [at] * len(columns["pose"])
    return Seatings(table, np.array(angles))


def bound(angles: Array, samples: int, sigma: float, play: float) -> Array:
    """Standard deviation of the offsets of joints 2 to 6, by the likelihood of all samples at once.

    The covariance of the 3 n misclosures of one seating is written out as a whole: noise of the
    readings in each sample, and the play, which is the same in all.
    """
    information = np.zeros((8, 8))
    for q in angles:
        a = slopes(q)
        one, shared = np.eye(samples), np.ones((samples, samples))
        cover = np.kron(one, sigma**2 * a @ a.T) + np.kron(shared, play**2 * np.eye(3))
        # Joint 1 turns the cone with it: it is not asked for here.
        x = np.tile(np.column_stack([a[:, 1:], -np.eye(3)]), (samples, 1))
        information += x.T @ np.linalg.solve(cover, x)
    return np.asarray(np.sqrt(np.diag(np.linalg.inv(information)))[:5])


# ------------------------------------------------------------------ a level table

TABLE = 110.0


def at_a_table(noise: float | None, play: float | None) -> str:
    """The mechanism whose ball touches a table of which nothing is known."""
    text = mechanism(noise, play)
    text = text.replace('[[point]]\nname = "cone"', '[[plane]]\nname = "table"')
    return text.replace(
        'kind = "touch"\nbetween = ["ball", "cone"]', 'kind = "plane"\nbetween = ["ball", "table"]'
    )


def on_a_table(
    seed: int, poses: int = 60, samples: int = 1, sigma: float = 2e-5, play: float = 0.02
) -> Seatings:
    """Touches of a level table."""
    rng = np.random.default_rng(seed)
    angles, rows = [], []
    while len(angles) < poses:
        q = np.array([0.4, -1.4, -1.6, -1.5, 1.5, 0.0])
        q = q + rng.uniform(-1, 1, 6) * [1, 0.6, 0.8, 1.5, 1.5, 3]
        height = TABLE + play * rng.standard_normal()
        for _ in range(30):
            ball, slope = chain(q)
            q = q - slope[2] * (ball[2] - height) / (slope[2] @ slope[2])
        if np.all((q > LIMITS[:, 0]) & (q < LIMITS[:, 1])) and abs(tip(q)[2] - height) < 1e-6:
            angles.append(q)
            rows += list(q - OFFSETS + sigma * rng.standard_normal((samples, 6)))
    table: dict[str, list[float] | list[str]] = {
        f"q{k + 1}": [float(row[k]) for row in rows] for k in range(6)
    }
    table["pose"] = [float(pose) for pose in range(poses) for _ in range(samples)]
    table["at"] = ["table"] * len(rows)
    return Seatings(table, np.array(angles))


def sd_at_a_table(angles: Array, sigma: float, play: float) -> tuple[Array, float]:
    """Standard deviations of the offsets of joints 2 to 6, and of a coordinate of the ball.

    Root mean square over these poses. Joint 1 is as drawn: with it turns the whole.
    """
    information = np.zeros((8, 8))
    for q in angles:
        ball, a = chain(q)
        x = np.concatenate([a[2, 1:], -ball[:2], [-1.0]])
        information += np.outer(x, x) / (sigma**2 * a[2] @ a[2] + play**2)
    cover = np.linalg.inv(information)[:5, :5]
    moved = [np.trace(a @ cover @ a.T) / 3 for a in (slopes(q)[:, 1:] for q in angles)]
    return np.sqrt(np.diag(cover)), float(np.sqrt(np.mean(moved)))
