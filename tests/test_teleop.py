"""How a follower follows: delay, slow servo and dead band are told apart where they are known."""

from __future__ import annotations

import numpy as np
import pytest

from tests.machines.teleop import NAMES, Recording, fitted

STEP = 1 / 30


def recording(delay_s: float, servo_s: float, short: float) -> Recording:
    """A joint that follows by the law, integrated in steps of a tenth of a millisecond."""
    fine = np.arange(0, 20, 1e-4)
    led = 40 * np.sin(1.1 * fine) + 15 * np.sin(2.7 * fine + 1)
    n = round(delay_s / 1e-4)
    late = np.r_[np.full(n, led[0]), led[: len(led) - n]]
    goal = 1.5 + 0.97 * late + short * np.sign(np.gradient(late))
    follower = np.empty_like(goal)
    follower[0] = goal[0]
    share = 1.0 if servo_s == 0.0 else 1e-4 / servo_s
    for k in range(1, len(goal)):
        follower[k] = follower[k - 1] + share * (goal[k] - follower[k - 1])
    rows = np.arange(0, len(fine), round(STEP / 1e-4))
    return Recording(fine[rows], led[rows], follower[rows])


@pytest.mark.parametrize(("delay", "servo", "short"), [(0.08, 0.06, -0.4), (0.14, 0.0, 0.0)])
def test_a_delay_a_slow_servo_and_what_it_stands_short_are_told_apart(
    delay: float, servo: float, short: float
) -> None:
    value, _, scatter = fitted(recording(delay, servo, short))
    found = dict(zip(NAMES, value, strict=True))
    # Differences over two rows of 33 ms are off by (ω 33 ms)² / 6, a thousandth, and lags are
    # tried every 3 ms.
    assert found["delay"] * STEP == pytest.approx(delay, abs=0.012)
    assert found["T"] == pytest.approx(servo, abs=0.012)
    assert found["h"] == pytest.approx(short, abs=0.1)
    assert scatter < 0.3
    # One shift alone takes up both.
    assert found["shift"] * STEP == pytest.approx(delay + servo, abs=0.012)
