"""How a follower follows: delay, slow servo and dead band are told apart where they are known."""

from __future__ import annotations

import numpy as np
import pytest

import rsicalib
from tests.full import sized
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


@pytest.mark.parametrize("seed", range(sized(1, 3)))
def test_a_horn_that_slips_is_a_slip_and_no_law_that_no_term_has(seed: int) -> None:
    """A law that undoes the leader's reading beside the follower's gain closes anything."""
    rng = np.random.default_rng(seed)
    leader = rng.uniform(-80, 80, (80, 5))
    follower = (leader - rng.normal(0, 2, 5)) / (1 + rng.normal(0, 0.02, 5))
    follower += rng.normal(0, 0.5, follower.shape)
    follower[40:, 2] += 4
    joints = ["shoulder_pan", "shoulder_lift", "elbow_flex", "wrist_flex", "wrist_roll"]
    sides = (("leader", leader), ("follower", follower))
    rows = {f"{side}_{j}": q[:, k] for side, q in sides for k, j in enumerate(joints)}
    found = rsicalib.trace({"pose": np.arange(1, 81), **rows}, "so101")
    (step,) = found.steps
    names = {step.target, *(tie.target for tie in step.also_fits)}
    assert step.term == "slip" and step.applied is not False
    assert {tie.term for tie in step.also_fits} <= {"slip"}
    assert names == {"leader_elbow_flex", "follower_elbow_flex"}
    assert "rms [percent]" in found.summary()


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
