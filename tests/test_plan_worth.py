"""What plans say of themselves: nothing invented, no copies, what would help, how many more."""

from __future__ import annotations

import json
import math
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import rsicalib
from rsicalib import DEMO, InputError, Mechanism, _core
from rsicalib.cli import main
from rsicalib.facts.shapes import Name
from rsicalib.planning.worthwhile import worth_words
from tests import cone
from tests.machines import files
from tests.machines.trials import MACHINES

READINGS, REST = (DEMO / f"{name}.csv" for name in ("readings", "rest"))


def numbers(value: Any) -> Iterator[float]:
    """All numbers in a document."""
    if isinstance(value, dict | list):
        for one in value.values() if isinstance(value, dict) else value:
            yield from numbers(one)
    elif isinstance(value, float):
        yield value


def test_a_forecast_has_no_number_for_what_cannot_be_observed() -> None:
    """All bases free: the whole moves by inches, and no pose shows it."""
    terms = ["offset", "gain", "link_length", "point_position", "base_position"]
    found = rsicalib.calibrate(READINGS, rest=REST, terms=terms)
    assert found.unobservable
    forecast = rsicalib.plan(result=found, beside=READINGS, poses=3, candidates=300).forecast
    assert forecast is not None
    assert all(abs(value) < 10.0 for value in numbers(forecast.to_dict())), forecast


def test_without_a_workspace_the_joint_limits_are_used() -> None:
    values = Mechanism("rsi").to_dict()
    del values["workspace"]
    free = Mechanism(values)
    plan = rsicalib.plan(free, poses=12, candidates=600, starts=1)
    assert len(plan.poses) == 12 and plan.bound is not None
    for channel, column in zip(free.channels, plan.readings.T, strict=True):
        assert channel.limits is not None
        angle = channel.gain * column + channel.offset
        low, high = channel.limits
        assert np.all((angle >= low - 1e-9) & (angle <= high + 1e-9))
    # A witness: the poses that these readings hold the platform at.
    held = rsicalib.Readings.from_arrays(free, plan.readings)
    np.testing.assert_allclose(rsicalib.forward(held, free), plan.poses, atol=1e-6)


def planned(worth: list[bool], decides: float = 0.9, needed: float | None = None) -> dict[str, Any]:
    """What the core gives of a plan that is to decide."""
    return {"worth": worth, "forecast": {"decides": decides}, "needed": needed}


RIVALS = [
    [Name(term="curvature", klass="sensor", target="a22")],
    [Name(term="link_length", klass="geometry", target="arm2/3")],
]


def test_copies_of_a_pose_are_no_plan() -> None:
    advice = worth_words(planned([True, False, True, False]), RIVALS)
    assert "2 of 4 poses" in advice[0]


def test_poses_that_decide_nothing_are_no_plan_and_what_would_is_said() -> None:
    text = " ".join(worth_words(planned([False] * 10, 0.01), RIVALS))
    assert "no plan" in text and "a22" in text and "arm2/3" in text and "length" in text


def test_poses_that_hardly_decide_say_how_many_would() -> None:
    three = [True] * 3
    advice = worth_words(planned(three, 0.05, 12.0), RIVALS)
    assert "some 12 like them would be a decision" in " ".join(advice)
    assert worth_words(planned(three, needed=1.8), RIVALS) == ()
    advice = worth_words(planned(three, 0.05, 3.6e6), RIVALS)
    assert "more like them do not decide it" in advice[0]
    assert "would be a decision" not in " ".join(advice) and "What would: " in advice[1]


@pytest.fixture(scope="module")
def calibration() -> Any:
    return rsicalib.calibrate(READINGS, rest=REST)


def test_how_many_more_poses_is_one_call(calibration: Any) -> None:
    """As few as reach it: one pose less does not."""
    now = rsicalib.plan(result=calibration, beside=READINGS, poses=1, candidates=400)
    assert now.forecast is not None and now.forecast.platform_sd is not None
    before = now.forecast.platform_sd.before.position
    assert before is not None
    target = 0.75 * before
    plan = rsicalib.plan(result=calibration, beside=READINGS, target=target, candidates=400)
    count = len(plan.readings)
    assert f"{count} more poses bring it to" in plan.advice[0]
    assert plan.forecast is not None and plan.forecast.platform_sd is not None
    reached = plan.forecast.platform_sd.after.position
    assert reached is not None and reached <= target
    fewer = rsicalib.plan(
        result=calibration, beside=READINGS, poses=count - 1, candidates=400, criterion="platform"
    )
    assert fewer.forecast is not None and fewer.forecast.platform_sd is not None
    assert (fewer.forecast.platform_sd.after.position or math.inf) > target
    none = rsicalib.plan(result=calibration, beside=READINGS, target=9.0, candidates=400)
    assert len(none.readings) == 0 and "No more poses are needed" in none.advice[0]
    assert none.csv().count("\n") == 1


def test_a_target_out_of_reach_says_what_it_would_take(calibration: Any) -> None:
    one = rsicalib.plan(result=calibration, beside=READINGS, poses=1, candidates=300)
    assert one.forecast is not None and one.forecast.platform_sd is not None
    before = one.forecast.platform_sd.before.position
    assert before is not None
    for share, said in ((0.6, "it would take some "), (1e-3, "poses like these do not reach it")):
        plan = rsicalib.plan(
            result=calibration, beside=READINGS, target=share * before, poses=2, candidates=300
        )
        assert len(plan.readings) == 2 and said in plan.advice[0]
    # Of poses in their millions nobody is advised: of what else would help.
    assert "would take" not in plan.advice[0] and "more samples of each pose" in plan.advice[0]


@pytest.mark.parametrize("name", ["plane", "line", "seen"])
def test_beside_a_result_with_something_unknown_is_a_plan(name: str, tmp_path: Path) -> None:
    """A table or a guide that stands anywhere, or a table beside a tracker that does."""
    rng = np.random.default_rng(4)
    machine = MACHINES[name](rng)
    readings, mechanism = files.write(machine, machine.observe(rng), tmp_path)
    found = rsicalib.calibrate(readings, mechanism)
    unknown = {p.term for p in found.parameters} & {*_core.UNKNOWN_THINGS}
    things = {"plane": ["plane"], "line": ["line"], "seen": ["plane", "frame"]}[name]
    assert unknown == {f"unknown_{thing}" for thing in things}
    plan = rsicalib.plan(mechanism, 2, result=found, beside=readings, candidates=200)
    assert len(plan.readings) == 2


def test_the_command_has_it_too(
    calibration: Any, tmp_path: Any, capsys: pytest.CaptureFixture[str]
) -> None:
    calibration.save(tmp_path / "result.json")
    asked = ["plan", "--result", str(tmp_path / "result.json"), "--beside", str(READINGS)]
    with pytest.raises(SystemExit) as done:
        main([*asked, "--target", "9", "--json"])
    assert done.value.code == 0
    assert "No more poses" in json.loads(capsys.readouterr().out)["advice"][0]


def test_a_target_needs_a_result() -> None:
    with pytest.raises(InputError, match="target: found no result"):
        rsicalib.plan(target=0.1)
    with pytest.raises(InputError, match="target"):
        rsicalib.plan(target=-1.0, result="x.json", beside=READINGS)


def test_a_convention_is_nothing_that_poses_could_make_certain() -> None:
    """An arm at one cone: how it stands about its first axis, with the cone, no pose can tell.

    The forecast of more seatings is borne out by taking them.
    """
    drawn = Mechanism(cone.mechanism(2e-5, 0.02))
    few, more = cone.session(5, poses=20, samples=1), cone.session(5, poses=40, samples=1)
    found = rsicalib.calibrate(few.table, drawn)
    plan = rsicalib.plan(drawn, result=found, beside=few.table, poses=4, candidates=300)
    assert plan.forecast is not None and plan.forecast.platform_sd is not None
    before = plan.forecast.platform_sd.before.position
    # Play of 0.02 mm over 60 equations, and the arm is 1 m long.
    assert before is not None and before < 1.0
    after = rsicalib.calibrate(more.table, drawn)
    again = rsicalib.plan(drawn, result=after, beside=more.table, poses=1, candidates=300)
    assert again.forecast is not None and again.forecast.platform_sd is not None
    assert again.forecast.platform_sd.before.position < before
