"""`guide --drive`: robots that take their session alone, with and without physics."""

from __future__ import annotations

import json
import shlex
import sys
from pathlib import Path

import numpy as np
import pytest

import rsicalib
from rsicalib import InputError
from rsicalib.guide.drive import passed
from rsicalib.guide.run import guide
from tests import cone

ROBOT = [sys.executable, "-m", "tests.drive.plain"]


def taken(folder: Path, *more: str, target: float = 0.05) -> rsicalib.Trace | None:
    """The session of the robot without physics."""
    mechanism = folder / "arm.toml"
    mechanism.write_text(cone.mechanism(2e-5, 0.02), encoding="utf-8")
    command = shlex.join([*ROBOT, *more])
    return guide(folder / "s", mechanism, drive=command, target=target, port=None, quiet=True)


def test_a_robot_takes_its_session_alone(tmp_path: Path) -> None:
    result = taken(tmp_path, "--refuse", "2")
    assert result is not None and result.verdict == "adequate"
    for k in range(1, 6):
        # Five standard deviations: a chance of one in a million, of five offsets.
        own = result["offset", f"q{k + 1}"]
        assert own.sd is not None and abs(own.value - cone.OFFSETS[k]) < 5 * own.sd
    kept = json.loads((tmp_path / "s" / "guide.json").read_text())
    assert len(kept["struck_off"]) == 2  # what the robot refused is not asked for again
    rows = rsicalib.load_readings(tmp_path / "s" / "readings.csv", tmp_path / "arm.toml")
    assert set(rows.keys["at"]) == {"cone"}
    ends = cone.LIMITS
    assert np.all((rows.values > ends[:, 0]) & (rows.values < ends[:, 1]))


@pytest.mark.parametrize(
    ("answer", "found"),
    [
        ("moving…", "moving"),
        ('{"readings": []}', "readings"),
        ('{"readings": [{"q1": 0.1, "at": "cone"}]}', "q2 None"),
        ('{"readings": [{"q1": "0.1", "at": "cone"}]}', "q1 '0.1'"),
        ('{"readings": [{"q1": NaN, "at": "cone"}]}', "q1 nan"),
        ('{"readings": [{"q1": 0.1}]}', "no 'at'"),
        ('{"cannot": "no power"}', "no power"),
    ],
)
def test_an_answer_that_is_none_is_refused_with_its_line(
    answer: str, found: str, tmp_path: Path
) -> None:
    with pytest.raises(InputError, match="--drive, line 1") as refused:
        taken(tmp_path, "--answer", answer)
    assert found in str(refused.value)


def test_a_command_that_ends_or_is_none_is_said(tmp_path: Path) -> None:
    (tmp_path / "arm.toml").write_text(cone.mechanism(2e-5, 0.02), encoding="utf-8")
    for command, words in (("no-such-command", "cannot be run"), ("true", "end of its output")):
        with pytest.raises(InputError, match=words):
            out = tmp_path / words.split()[0]
            guide(out, tmp_path / "arm.toml", drive=command, target=1.0, port=None, quiet=True)


def test_a_pose_beyond_a_limit_is_told_from_one_within() -> None:
    mechanism = rsicalib.Mechanism.from_toml(cone.mechanism(2e-5, 0.02))
    within = [0.4, -1.4, -1.6, -1.5, 1.5, 0.0]
    assert passed(mechanism, within) is None
    assert "q2" in str(passed(mechanism, [0.4, 0.1, *within[2:]]))


NO_PHYSICS = not __import__("importlib.util").util.find_spec("mujoco")


@pytest.mark.skipif(NO_PHYSICS, reason="no MuJoCo")
def test_a_robot_goes_on_while_its_answer_is_of_no_use(tmp_path: Path) -> None:
    from tests.drive.__main__ import run

    one = run(5019, tmp_path, "bent", "cones")  # unexplained, six poses after the target
    assert one.named and one.verdict == "explained"


@pytest.mark.skipif(NO_PHYSICS, reason="no MuJoCo")
def test_a_soft_joint_in_a_physical_model_is_named(tmp_path: Path) -> None:
    from tests.drive.__main__ import run

    one = run(0, tmp_path, "stiffness", "cones")
    assert one.named and one.beyond == 0
