"""Rows that repeat others digit by digit say nothing new: numpy counts how many differ."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

import rsicalib
from tests import crank
from tests.crank import four_bar

both = pytest.mark.parametrize("verb", [rsicalib.calibrate, rsicalib.trace])


@both
@pytest.mark.parametrize("held", [False, True])
def test_two_postures_ten_times_each_leave_nothing_to_check_two_offsets_with(
    held: bool, verb: Any
) -> None:
    read = np.repeat(crank.read(crank.turn())[[3, 20]], 10, axis=0)
    given: dict[str, Any] = crank.by_channel(read)
    if held:
        given["pose"] = np.arange(1, 21)
    found = verb(given, four_bar("offset"))
    different = len(np.unique(read, axis=0))
    (warned,) = [w for w in found.warnings if w.kind == "same_readings"]
    assert warned.text.startswith(f"{len(read) - different} of {len(read)} poses")
    assert f"{different} differ" in warned.text and "other poses" in warned.text
    assert found.verdict == "undetermined" and "record other poses" in found.summary()
    assert "declare the noise" not in found.summary()


@both
def test_one_posture_twenty_times_is_one(verb: Any) -> None:
    read = np.repeat(crank.read(crank.turn())[:1], 20, axis=0)
    found = verb(crank.by_channel(read), four_bar("offset"))
    assert found.verdict == "undetermined"
    text = found.summary(whole=True)
    assert "20 poses, of which 1 is different" in " ".join(text.split())
    assert "record other poses" in " ".join(text.split())
    assert "\n\n\n" not in text


@both
def test_a_few_rows_that_come_again_change_nothing_that_is_said_of_rows(verb: Any) -> None:
    """A recording may stand still for a while."""
    read = crank.read(crank.turn())
    read[20:23] = read[20]
    found = verb(crank.by_channel(read), four_bar("offset"))
    assert "same_readings" not in {w.kind for w in found.warnings}
