"""A rest pose that several joint angles hold, elbows up or down: its reading says which."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.typing import NDArray

import rsicalib

from .full import sized
from .tripod import NAMES, REST, angles, machine


@pytest.mark.parametrize("seed", range(sized(4, 24)))
def test_the_reading_of_the_rest_pose_says_which_of_its_joint_angles_they_are(seed: int) -> None:
    rng = np.random.default_rng([904, seed])
    offsets = rng.normal(0.0, 0.5, 9)
    low, high = np.array([[0, -40, 145, -0.25, -0.25, -0.25], [40, 40, 175, 0.25, 0.25, 0.25]])
    poses = rng.uniform(low, high, (30, 6))

    def read(at: NDArray[np.float64]) -> NDArray[np.float64]:
        return angles(at) - offsets + 0.01 * rng.standard_normal((len(at), 9))

    drawn = machine()
    readings = rsicalib.Readings.from_arrays(drawn, read(poses), pose=np.arange(1, 31))
    rest = rsicalib.Readings.from_arrays(drawn, read(np.array([REST])))
    found = rsicalib.calibrate(readings, drawn, rest=rest, noise=dict.fromkeys(NAMES, 0.01))
    assert found.verdict == "adequate"
    for name, true in zip(NAMES, np.radians(offsets), strict=True):
        low_end, high_end = found[f"offset@{name}"].interval
        # Of 9 offsets at 95 %: three widths are never left by chance.
        middle, half = (low_end + high_end) / 2, (high_end - low_end) / 2
        assert abs(middle - true) < 3.0 * half
