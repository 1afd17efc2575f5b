"""A four-bar whose crank goes round: at even steps, steadily, and with a row written twice.

Witness: the rocker by two circles, in closed form (`tests/crank.py`); noise is drawn.
"""

from __future__ import annotations

import numpy as np
import pytest

import rsicalib
from tests import crank
from tests.crank import ROD, four_bar
from tests.full import sized
from tests.oracle import Array


def taken_again(q: Array) -> dict[str, Array]:
    return crank.by_channel(np.insert(q, 20, q[20], axis=0))


@pytest.mark.parametrize("seed", range(sized(1, 2)))
def test_a_row_that_was_written_twice_makes_no_codes_of_even_steps(seed: int) -> None:
    """Steps of the crank passed for those of its encoder: all was within their rounding."""
    wrong, sound = (
        rsicalib.trace(taken_again(crank.read(crank.turn(), seed, rod)), four_bar("offset"))
        for rod in (ROD + 5.0, ROD)
    )
    assert [step.spec for step in wrong.steps] == ["distance@rod"]
    assert sound.verdict == "adequate"


def test_a_drive_that_stands_at_even_steps_has_no_codes() -> None:
    turn = np.repeat(crank.turn(), 4)
    q = crank.read(turn, 1, ROD + 5.0)
    q[:, 0] = turn - 0.05
    session = {**crank.by_channel(q), "pose": np.repeat(np.arange(60), 4)}
    (step,) = rsicalib.trace(session, four_bar("offset")).steps
    assert step.spec == "distance@rod"


@pytest.mark.parametrize("turns", [1.0, 64.0])
def test_a_sound_recording_of_a_steady_crank_has_no_delay(turns: float) -> None:
    """A delay smooths the mean of a stretch: with (164) of single rows each recording had one."""
    rows = 20_000
    q = crank.read(turns * crank.turn(rows))
    session = {**crank.by_channel(q), "time_s": np.arange(rows) / 500.0}
    assert rsicalib.trace(session, four_bar("offset")).verdict == "adequate"
