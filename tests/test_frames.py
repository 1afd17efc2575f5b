"""Frames with belts whose truth is known, traced: short belts, a constant, declared noise."""

from __future__ import annotations

import numpy as np
import pytest

from tests.full import sized
from tests.machines.frames import frame, graded, traced


@pytest.mark.parametrize("k", sized([13], [6, 7, 12, 13]))
def test_short_belts_and_the_constant_are_named_and_the_scale_is_not(k: int) -> None:
    """Before, 6, 7 and 12 missed the gain, and 13 named the scale in two parts, -45 % each."""
    rng = np.random.default_rng((0, k))
    declared = float(np.exp(rng.uniform(np.log(0.5), np.log(3))))
    case = frame(rng, k % 2 == 0, declared)
    said = graded(case, traced(rng, case))
    assert said["short"] and said["constant"]
    assert not said["extras"] and not said["absurd"]
    # Beyond four standard deviations is one in 15,000 by chance.
    assert said["sd_off"] is None or abs(said["sd_off"]) < 4


@pytest.mark.parametrize("k", [37, 39])
def test_what_declared_noise_allows_is_no_effect(k: int) -> None:
    """A bow of up to 3 mm in each length: a curvature and a cross-talk took a part of it."""
    rng = np.random.default_rng((0, k))
    declared = float(np.exp(rng.uniform(np.log(0.5), np.log(3))))
    case = frame(rng, k % 2 == 0, declared, bow=3.0)
    said = graded(case, traced(rng, case))
    assert said["short"] and said["constant"]
    assert not said["extras"] and not said["absurd"]
