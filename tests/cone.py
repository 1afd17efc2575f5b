"""A six-joint arm with a ball that it puts into cones, in products of plain matrices.

Every seating is one draw of where the ball sits; all samples of a pose read the same seating.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass
from itertools import islice

import numpy as np

from tests import oracle
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
    """Place of the ball for joint angles (…, 6), (…, 3), and its derivative, (…, 3, 6).

    Each joint turns what it carries.
    """
    frame = np.broadcast_to(np.eye(4), (*q.shape[:-1], 4, 4))
    axes, places = [], []
    for k, (d, a, alpha) in enumerate(ROWS):
        axes.append(frame[..., :3, 2])
        places.append(frame[..., :3, 3])
        c, s, ca, sa = np.cos(q[..., k]), np.sin(q[..., k]), math.cos(alpha), math.sin(alpha)
        row = np.zeros(frame.shape)
        row[..., 0, 0], row[..., 0, 1], row[..., 0, 2], row[..., 0, 3] = c, -s * ca, s * sa, a * c
        row[..., 1, 0], row[..., 1, 1], row[..., 1, 2], row[..., 1, 3] = s, c * ca, -c * sa, a * s
        row[..., 2, 1:], row[..., 3, 3] = (sa, ca, d), 1.0
        frame = frame @ row
    ball = (frame @ BALL)[..., :3]
    turned = oracle.crossed(np.stack(axes), ball - np.stack(places))
    return ball, np.moveaxis(turned, 0, -1)


def tip(q: Array) -> Array:
    """Place of the ball for joint angles."""
    return chain(q)[0]


def slopes(q: Array) -> Array:
    """Derivative of the place of the ball by the joint angles."""
    return chain(q)[1]


def touching(q: Array, place: Array) -> Array:
    """Joint angles near `q`, (n, 6), at which the ball is at places, (n, 3), by Newton's method."""
    q, going = q.copy(), np.arange(len(q))
    for _ in range(30):
        at, slope = chain(q[going])
        step = (np.linalg.pinv(slope) @ (at - place[going])[..., None])[..., 0]
        largest = np.abs(step).max(axis=1)
        q[going] -= step * np.minimum(1.0, 0.3 / np.maximum(largest, 1e-300))[:, None]
        going = going[largest >= 1e-11]
        if not len(going):
            break
    return q


def seated(rng: np.random.Generator, cone: Array, play: float) -> Iterator[Array]:
    """Joint angles of seatings one after the other, each with a draw of where the ball sits."""
    while True:
        draws = [(rng.uniform(-1, 1, 6), rng.standard_normal(3)) for _ in range(100)]
        turns, sits = (np.array(column) for column in zip(*draws, strict=True))
        near = np.array([0.4, -1.4, -1.6, -1.5, 1.5, 0.0]) + turns * [1, 0.6, 0.8, 1.5, 1.5, 3]
        place = cone + play * sits
        q = touching(near, place)
        inside = np.all((q > LIMITS[:, 0]) & (q < LIMITS[:, 1]), axis=1)
        yield from q[inside & np.isclose(tip(q), place, atol=1e-6).all(axis=1)]


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
    for q in islice(seated(rng, cone, play), poses):
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
