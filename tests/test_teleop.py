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


def pair(**channel: object) -> rsicalib.Mechanism:
    """Five joints of a leader and of a follower, in percent of what a gripper or a servo can do."""
    joints = ("base", "shoulder", "elbow", "roll", "pitch")
    names = [(f"leader_{joint}", f"follower_{joint}") for joint in joints]
    own = {"unit": "percent", "gain": 1.0, "offset": 0.0, **channel}
    terms = [f"{term}@{name}" for _, name in names for term in ("offset", "gain")]
    values = {
        "name": "pair",
        "length_unit": "m",
        "channel": [{"name": name, **own} for both in names for name in both],
        "closure": [
            {"name": joint, "kind": "equal", "between": list(both), "noise": 0.1}
            for joint, both in zip(joints, names, strict=True)
        ],
        "model": {"terms": terms},
    }
    return rsicalib.Mechanism.from_dict(values)


@pytest.mark.parametrize("joint", sized([2], [0, 2, 4]))
def test_play_in_percent_is_as_large_as_the_way_that_is_gone(joint: int) -> None:
    """Without a range half a turn was how far such a channel goes: π percent."""
    rng = np.random.default_rng(joint)
    held = rng.uniform(-60, 60, (60, 5))
    play = 0.4 * np.sign(np.diff(held, axis=0, prepend=0.0)) * (np.arange(5) == joint)
    read = np.repeat(np.hstack([held, held * 1.004 + 0.5 - play]), 3, axis=0)
    read += rng.normal(0, 0.05, read.shape) + np.repeat(rng.normal(0, 0.07, (60, 10)), 3, axis=0)
    said = {}
    for name, mechanism in (("none", pair()), ("range", pair(range=[-60.0, 60.0]))):
        columns = [c.name for c in mechanism.channels]
        columns = [*columns[::2], *columns[1::2]]
        rows = {name: read[:, k] for k, name in enumerate(columns)}
        said[name] = rsicalib.trace({"pose": np.repeat(np.arange(60), 3), **rows}, mechanism)
    for found in said.values():
        (step,) = found.steps
        assert (step.term, found.implausible) == ("hysteresis", ())
        assert found.verdict == said["range"].verdict
        (h,) = step.parameters
        assert abs(h.value) == pytest.approx(0.4, abs=0.1)
    one, other = (found.steps[0] for found in said.values())
    assert one.target == other.target
    assert one.parameters[0].value == pytest.approx(other.parameters[0].value, rel=0.01)
