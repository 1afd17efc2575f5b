"""Devices as a production makes them: each off its drawing by chance, all of them by the same.

Angles of the arms are those of `tests/blind/geometry.py`, plain products of matrices; neither it
nor what is drawn here knows the core. Offsets are meant at the middle of the converter's range.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

import numpy as np
import numpy.typing as npt

from rsicalib.fleets.dataset import Partition
from tests import oracle
from tests.blind.geometry import A, Geometry, inverse
from tests.oracle import Array

CHANNELS = tuple(f"a{i}{j}" for i in (1, 2, 3) for j in (1, 2, 3))
MIDDLE = 4095 / 2
LENGTHS = ((0, abs(oracle.L1)), (1, oracle.L2), (3, oracle.L3))
"""Rows of an arm with a length of the drawing: base, upper arm, forearm [in]."""

TOLERANCES = {"offset": 0.05, "gain": 3e-5, "link_length": 0.02}
"""`sd` of the drawing: rad, rad per count (2 %), in (half a percent)."""


@dataclass(frozen=True)
class Production:
    """How devices differ from their drawing: `spread` each by chance, `design` all of them.

    Attributes
    ----------
    offset, gain, length : float
        Standard deviation between devices: rad, a part of the gain, a part of each length.
    design : mapping
        What the drawing has wrong: `offset@2` (rad; the second joint of every arm), `gain` (a
        part, of every channel), `length@3` (in; that row of every arm), `length@arm2/3` (of one).
    """

    offset: float = 0.005
    gain: float = 0.003
    length: float = 0.001
    design: Mapping[str, float] = field(default_factory=dict)

    def device(self, rng: np.random.Generator) -> tuple[Array, Array, Geometry]:
        """Angles at the middle of the range (9,), gains (9,), and what was built."""
        offsets, gains = oracle.nominal(oracle.rsi())
        middle = offsets + gains * MIDDLE + self.offset * rng.standard_normal(9)
        gains = gains * (1 + self.gain * rng.standard_normal(9) + self.design.get("gain", 0.0))
        geometry = Geometry()
        for arm in range(3):
            for row, length in LENGTHS:
                wrong = self.design.get(f"length@{row + 1}", 0.0)
                wrong += self.design.get(f"length@arm{arm + 1}/{row + 1}", 0.0)
                change = wrong + self.length * length * rng.standard_normal()
                # The base row is drawn with a negative length.
                geometry = geometry.with_row(arm, row, A, change)
        for joint in range(3):
            middle[joint::3] += self.design.get(f"offset@{joint + 1}", 0.0)
        return middle, gains, geometry


def clear(drawn: Array) -> npt.NDArray[np.bool_]:
    """Which angles of the drawing (n, 3, 3) keep clear of straight elbows and sideways forearms.

    There an arm as built could not follow.
    """
    within = (drawn[:, :, 1] > -2.6) & (drawn[:, :, 1] < -0.6) & (np.abs(drawn[:, :, 2]) < 1.0)
    return np.asarray(np.isfinite(drawn).all(axis=(1, 2)) & within.all(axis=1))


def readings(
    device: tuple[Array, Array, Geometry],
    rng: np.random.Generator,
    poses: int,
    samples: int,
    noise: float = 1.0,
) -> Array:
    """Readings of a device in poses of a hand: shape (poses, samples, 9)."""
    middle, gains, geometry = device
    low, high = np.array([[-2.5, 2.5]] * 2 + [[-5.0, -1.0]] + [[-0.45, 0.45]] * 3).T
    exact = np.empty((0, 9))
    while len(exact) < poses:
        pose = rng.uniform(low, high, (4 * poses, 6))
        drawn = oracle.rsi_inverse(pose)
        angles = inverse(geometry, pose[clear(drawn)]).reshape(-1, 9)
        counts = (angles - middle) / gains + MIDDLE
        within = (counts > 30).all(axis=1) & (counts < 4065).all(axis=1)
        exact = np.vstack([exact, counts[within]])
    read = exact[:poses, None] + noise * rng.standard_normal((poses, samples, 9))
    return np.round(read)


def frame(
    production: Production, devices: int, seed: int, *, poses: int = 24, samples: int = 4
) -> tuple[Partition, list[tuple[Array, Array, Geometry]]]:
    """Readings of a fleet as one partition, and what was built."""
    rng = np.random.default_rng(seed)
    made = [production.device(rng) for _ in range(devices)]
    values = np.concatenate([readings(one, rng, poses, samples).reshape(-1, 9) for one in made])
    columns: dict[str, Any] = {
        "device": np.repeat(np.arange(devices), poses * samples),
        "pose": np.tile(np.repeat(np.arange(poses), samples), devices),
    }
    columns |= {name: np.ascontiguousarray(values[:, k]) for k, name in enumerate(CHANNELS)}
    return Partition(columns, None), made
