"""Two effects at once, that hide each other."""

from __future__ import annotations

import numpy as np
import pytest

from tests.blind import effects, trials
from tests.blind.effects import CHANNELS, Effect
from tests.blind.grade import grade
from tests.full import sized

SHARED: list[tuple[Effect, type[Effect]]] = [
    (effects.ReferenceDrift("all", 0.002), effects.Drift),
    (effects.ReferenceTemperature("all", 0.0002), effects.TemperatureOffset),
]


@pytest.mark.parametrize(("shared", "own"), SHARED)
def test_what_all_channels_do_and_one_undoes_is_told(shared: Effect, own: type[Effect]) -> None:
    """Each has a noncentrality of 100 beside the other; one by one, 1 or 2 of 9 are told.

    Of the nine channels some: most of them are told, as six of nine.
    """
    excess, right = [], []
    for number, channel in list(enumerate(CHANNELS))[:: sized(4, 2)]:
        case = trials.staged([84, number], shared, own(channel, 0.01), exactly=100.0)
        result = trials.examine(case)
        excess.append(result["before"]["chi2"] - result["before"]["dof"])
        right.append(grade(result, case.effects).right)
    # Apart they would be worth 200 together.
    assert np.median(excess) < 170
    assert 2 * sum(right) > len(right)
