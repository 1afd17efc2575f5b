"""What happened in a session, apart from the device: poses, order, time and temperature."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from tests import oracle
from tests.oracle import Array

SESSION_S = 900.0
"""A session of held poses lasts a quarter of an hour."""

SAMPLE_S = 0.02
"""Between two samples of one held pose."""


@dataclass(frozen=True)
class Scene:
    """Rows of a session, in the order in which they were read.

    `pose` (n, 6) is the true handle pose, tremor included; `label` (n,) numbers held poses from 1;
    `before` (n,) is the row of the pose before (-1: the rest pose); `turn` is time as a fraction of
    the session; `held` says whether the hand stood still.
    """

    pose: Array
    label: Array
    sample: Array
    before: Array
    time_s: Array
    temperature_c: Array
    held: bool = True

    @property
    def turn(self) -> Array:
        """Time as a fraction of the session, from 0 to about 1: shape (n,)."""
        return self.time_s / (SESSION_S if self.held else self.time_s.max())

    def firsts(self) -> Array:
        """The first row of every held pose: shape (poses,)."""
        return np.flatnonzero(np.diff(self.label, prepend=self.label[0] - 1))

    def distinct(self) -> tuple[Array, Array]:
        """Rows that hold every distinct pose, and for each row of the scene its place in them."""
        rows, back = self.firsts(), self.label - self.label[0]
        if np.array_equal(self.pose[rows][back], self.pose):
            return rows, back
        everything = np.arange(len(self.label))
        return everything, everything

    def previous(self, values: Array, rest: Array) -> Array:
        """`values` (n, m) of the pose before, or of the `rest` pose (m,) at the start."""
        return np.where(self.before[:, None] < 0, rest, values[self.before])


def room(rng: np.random.Generator) -> Callable[[Array], Array]:
    """A room's temperature [°C] by the fraction of the session: from 21 up by 6, with a swing."""
    swing, pace = rng.uniform(0.8, 1.8), rng.uniform(7.0, 11.0)
    return lambda turn: 21.0 + 6.0 * turn + swing * np.sin(pace * turn)


def held(
    rng: np.random.Generator,
    poses: Array,
    samples: int,
    tremor: tuple[float, float],
    start_s: float = 0.0,
    end_s: float = SESSION_S,
    temperature: Callable[[Array], Array] | None = None,
) -> Scene:
    """Poses (p, 6) held one after the other, each read `samples` times.

    `tremor` is the standard deviation of the hand between samples, (in, rad).
    """
    temperature = room(rng) if temperature is None else temperature
    count = len(poses)
    label = np.repeat(np.arange(1, count + 1), samples)
    sample = np.tile(np.arange(1, samples + 1), count)
    begin = np.linspace(start_s, end_s, count) if count > 1 else np.full(1, start_s)
    pose = np.repeat(poses, samples, axis=0)
    if any(tremor):
        pose = pose + rng.standard_normal(pose.shape) * np.repeat(tremor, 3)
    return Scene(
        pose=pose,
        label=label,
        sample=sample,
        before=np.where(label > 1, (label - 2) * samples, -1),
        time_s=begin[label - 1] + SAMPLE_S * (sample - 1),
        temperature_c=np.round(temperature(begin[label - 1] / SESSION_S), 3),
    )


def waved(
    rng: np.random.Generator,
    allowed: Callable[[Array], Array],
    seconds: float = 20.0,
    rate_hz: float = 200.0,
) -> Scene:
    """A smooth wave of the handle, every row a pose, of which `allowed` (n, 6) accepts all."""
    time = np.arange(round(seconds * rate_hz)) / rate_hz
    while True:
        pose = wave(rng, time)
        if np.all(allowed(pose)):
            break
    rows = np.arange(len(time))
    return Scene(
        pose=pose,
        label=rows + 1,
        sample=np.ones_like(rows),
        before=rows - 1,
        time_s=time,
        temperature_c=np.full(len(time), 21.0),
        held=False,
    )


def wave(rng: np.random.Generator, time: Array) -> Array:
    """Three sinusoids of 0.1 to 0.8 Hz in each coordinate about mid-range: shape (n, 6)."""
    centre = np.array([0.0, 0.0, -2.9, 0.0, 0.0, 0.0])
    half = np.array([1.9, 1.9, 1.5, 0.42, 0.42, 0.42])
    frequency = rng.uniform(0.1, 0.8, (3, 6))
    phase = rng.uniform(0, 2 * np.pi, (3, 6))
    weight = rng.dirichlet(np.ones(3), 6).T
    moves = weight * np.sin(2 * np.pi * frequency * time[:, None, None] + phase)
    out: Array = centre + half * moves.sum(axis=1)
    return out


def rest_scene(samples: int = 8) -> Scene:
    """The rest pose, at the very beginning, reached from itself."""
    rng = np.random.default_rng(0)
    return held(rng, np.array([oracle.REST]), samples, (0.0, 0.0))
