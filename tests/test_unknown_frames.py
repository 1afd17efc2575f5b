"""Frames that nobody has measured: an instrument anywhere, turned anyhow, sees a plate on legs.

The witness is the simulation: where the balls of the plate were, by numpy alone.
"""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import numpy.typing as npt
import pytest
from scipy.optimize import least_squares
from scipy.spatial.transform import Rotation

import rsicalib
from tests.full import sized
from tests.test_bodies import FEET, HIGH, LENGTH, PLATE, channel

Array = npt.NDArray[np.float64]

BALLS = np.array([[60.0, 20.0, 140.0], [-90.0, 70.0, 60.0], [30.0, -110.0, 90.0]])
"""In the plate [mm]."""
SEEN = 0.02
"""Noise of the instrument [mm]."""
QUARTER = np.pi / 2
TURNS = {
    "as the base": Rotation.identity(),
    "half a turn": Rotation.from_rotvec([0.0, 0.0, np.pi]),
    "upside down": Rotation.from_rotvec([np.pi, 0.0, 0.0]),
    "roll and yaw are almost one": Rotation.from_euler("ZYX", [-2.0, 1e-2 - QUARTER, 1.1]),
    "anyhow": Rotation.from_rotvec([1.3, -1.7, 0.6]),
}
ORIGIN = np.array([-1400.0, 900.0, 350.0])


def session(
    turned: Rotation,
    legs: int,
    balls: int,
    pose: list[float] | None = None,
    plate: tuple[float, ...] = (0, 0, HIGH, 0, 0, 0),
    moved: Array | None = None,
    joints: Array = PLATE,
    marks: Array = BALLS,
    knocked: tuple[int, Array, Rotation] | None = None,
    pushed: tuple[int, int, Array] | None = None,
) -> tuple[rsicalib.Mechanism, rsicalib.Readings, Array]:
    """A hexapod with some of its legs, its readings, and where the balls were.

    `moved` is how far its feet stand from where they are drawn; `joints` are where the plate
    has its own, and `marks` its balls. The instrument is knocked before a pose: so far along
    and about its axes. A ball is pushed along the axes of the plate before a pose: `pushed` has
    the pose, the ball and how far.
    """
    feet = FEET if moved is None else FEET + moved
    rng = np.random.default_rng(5)
    poses = 30
    middle = rng.uniform([-60, -60, HIGH - 50], [60, 60, HIGH + 50], (poses, 3))
    plates = Rotation.from_rotvec(rng.uniform(-0.3, 0.3, (poses, 3)))

    def carried(points: Array) -> Array:
        offset: Array = np.stack([plates.apply(p) for p in points], axis=1)
        return middle[:, None] + offset

    own = list(range(6))[:: 6 // legs] if legs < 4 else list(range(legs))
    lengths = np.linalg.norm(carried(joints[own]) - feet[own], axis=2)
    read = lengths - rng.normal(0, 1, legs) + rng.normal(0, LENGTH, lengths.shape)
    at = carried(marks[:balls])
    if pushed is not None:
        first, ball, by = pushed
        at[first:, ball] += plates[first:].apply(by)
    seen = turned.inv().apply((at - ORIGIN).reshape(-1, 3)).reshape(at.shape)
    if knocked is not None:
        first, along, about = knocked
        after = seen[first:] - along
        seen[first:] = about.inv().apply(after.reshape(-1, 3)).reshape(after.shape)
    seen += rng.normal(0, SEEN, seen.shape)
    frame: dict[str, Any] = {"name": "instrument", "unknown": []}
    drawn = rsicalib.Mechanism.from_dict(
        {
            "name": "hexapod",
            "length_unit": "mm",
            "channel": [channel(f"l{k}", "mm", LENGTH) for k in own],
            "frame": [
                {"name": "plate", "unknown": ["pose"], "pose": list(plate)},
                frame if pose is None else frame | {"pose": pose},
            ],
            "point": [{"name": f"b{k}", "at": FEET[k].tolist()} for k in own]
            + [{"name": f"p{k}", "frame": "plate", "at": PLATE[k].tolist()} for k in own]
            + [
                {"name": f"ball{k}", "frame": "plate", "at": BALLS[k].tolist()}
                for k in range(balls)
            ]
            + [
                {"name": f"seen{k}", "frame": "instrument", "columns": [f"{a}{k}" for a in "xyz"]}
                for k in range(balls)
            ],
            "closure": [
                {
                    "name": f"leg {k}",
                    "kind": "distance",
                    "between": [f"b{k}", f"p{k}"],
                    "channel": f"l{k}",
                }
                for k in own
            ]
            + [
                {
                    "name": f"ball {k}",
                    "kind": "touch",
                    "between": [f"ball{k}", f"seen{k}"],
                    "noise": SEEN,
                }
                for k in range(balls)
            ],
            "model": {"terms": ["offset"]},
        }
    )
    columns = {f"{a}{k}": seen[:, k, i] for k in range(balls) for i, a in enumerate("xyz")}
    readings = rsicalib.Readings.from_arrays(drawn, read, pose=np.arange(poses), columns=columns)
    return drawn, readings, np.concatenate([at, seen], axis=2)


def off(found: rsicalib.Calibration, balls: Array) -> float:
    """How far the frame that was found puts what it sees from where it was, root mean square."""
    pose = {p.name: p.value for p in found.parameters if p.target == "instrument"}
    turned = Rotation.from_euler("xyz", [pose[k] for k in ("rx", "ry", "rz")])
    at, seen = balls.reshape(-1, 6)[:, :3], balls.reshape(-1, 6)[:, 3:]
    error = turned.apply(seen) + [pose[k] for k in "xyz"] - at
    return float(np.sqrt(np.mean(np.sum(error**2, axis=1))))


FOUND = 0.5
"""What 30 poses tell of offsets puts a frame .04 to .33 mm off at the balls; one that is not found
is off by 500 mm and more [mm]."""


@pytest.mark.parametrize("turn", sized(["as the base", "roll and yaw are almost one"], TURNS))
@pytest.mark.parametrize(("legs", "balls"), [(6, 1), (6, 3), (5, 3), (3, 3)])
def test_an_instrument_is_found_wherever_it_is(turn: str, legs: int, balls: int) -> None:
    """With fewer than six legs, poses are not told without the instrument."""
    drawn, readings, where = session(TURNS[turn], legs, balls)
    found = rsicalib.calibrate(readings, drawn)
    assert found.verdict == "adequate"
    assert off(found, where) < FOUND


@pytest.mark.parametrize("start", [None, [-1340.0, 950.0, 280.0, 0.3, 1.57, 0.8]])
def test_a_quarter_turn_does_not_lock(start: list[float] | None) -> None:
    """Roll and yaw turn the frame about one axis, where it is and where it is drawn."""
    turned = Rotation.from_euler("ZYX", [0.7, QUARTER, 0.4])
    drawn, readings, where = session(turned, 6, 1, start)
    found = rsicalib.calibrate(readings, drawn)
    assert found.fit is not None
    # One in a thousand by chance. Near there `rx` and `rz` may have no sd of their own.
    assert found.fit.p_value is not None and found.fit.p_value > 1e-3
    assert off(found, where) < FOUND


def test_a_frame_that_is_not_found_is_said_to_be_lost() -> None:
    """A plate on four legs is looked for turned by 143 degrees, where they nearly close too."""
    drawn, readings, where = session(TURNS["anyhow"], 4, 1, plate=(0, 0, HIGH, 0, 0, 2.5))
    found = rsicalib.calibrate(readings, drawn)
    assert off(found, where) > 100
    assert found.verdict == "undetermined"
    assert [reason.kind for reason in found.reasons] == ["not_converged"]
    said = {warning.kind: warning.target for warning in found.warnings}
    # What is left is of the start, and tells nothing of the noise.
    assert said == {"no_start": "instrument"}


@pytest.mark.parametrize(
    ("end", "of", "effect"),
    [
        ("moved", np.zeros((6, 3)), "anchor_position@leg 2"),
        ("joints", PLATE, "attachment_position@leg 2"),
        ("marks", BALLS, "attachment_position@ball 2"),
    ],
)
def test_an_end_that_is_elsewhere_than_drawn_is_named(end: str, of: Array, effect: str) -> None:
    """A foot along the axes of the base; a joint of the plate, or a ball on it, along its own."""
    moved = np.zeros_like(of)
    moved[2] = [2.0, -1.6, 2.4]
    drawn, readings, _ = session(TURNS["anyhow"], 6, 3, **{end: of + moved})
    found = rsicalib.trace(readings, drawn)
    (step,) = found.steps
    assert step.spec == effect
    assert found.verdict == "explained"
    # Along its leg the zero of the leg takes up a part: told by its interval.
    told = [(p.value, p.sd) for p in step.parameters]
    for (value, sd), truth in zip(told, moved[2], strict=True):
        assert sd is not None and abs(value - truth) < 4 * sd


@pytest.mark.parametrize("ball", [0, 1])
def test_a_ball_that_is_pushed_once_is_named_with_its_pose(ball: int) -> None:
    """Along the axes of the plate, on which it stays."""
    by = np.array([0.2, -0.15, 0.25])
    drawn, readings, _ = session(TURNS["anyhow"], 6, 3, pushed=(17, ball, by))
    found = rsicalib.trace(readings, drawn)
    (step,) = found.steps
    assert (step.term, step.target, step.place) == ("attachment_slip", f"ball {ball}", "17")
    assert found.verdict == "explained"
    for parameter, truth in zip(step.parameters, by, strict=True):
        assert parameter.sd is not None and abs(parameter.value - truth) < 4 * parameter.sd


def test_an_instrument_that_is_knocked_once_is_named_with_its_pose() -> None:
    """One move of all that it sees, along and about its own axes."""
    along, about = np.array([0.4, -0.3, 0.2]), np.array([4e-4, 3e-4, -5e-4])
    knocked = (17, along, Rotation.from_euler("xyz", about))
    drawn, readings, _ = session(TURNS["anyhow"], 6, 3, knocked=knocked)
    found = rsicalib.trace(readings, drawn)
    (step,) = found.steps
    # Poses are labelled from 0.
    assert (step.term, step.target, step.place) == ("frame_slip", "ball 0", "17")
    assert found.verdict == "explained"
    told = [(p.value, p.sd) for p in step.parameters]
    for (value, sd), truth in zip(told, [*along, *about], strict=True):
        assert sd is not None and abs(value - truth) < 4 * sd


def test_poses_are_planned_where_the_body_has_been() -> None:
    """The witness is where SciPy finds the plate with the lengths that are planned."""
    drawn, readings, _ = session(TURNS["anyhow"], 6, 3)
    found = rsicalib.calibrate(readings, drawn)
    plan = rsicalib.plan(drawn, poses=8, result=found, beside=readings)
    assert plan.readings.shape == (8, 6)
    offsets = [p.value for p in found.parameters if p.term == "offset"]

    def missed(x: Array, lengths: Array) -> Array:
        corners = Rotation.from_rotvec(x[3:] / 100).apply(PLATE) + x[:3]
        return np.asarray(np.linalg.norm(corners - FEET, axis=1) - lengths)

    for lengths in plan.readings + offsets:
        at = least_squares(missed, [0, 0, HIGH, 0, 0, 0], args=(lengths,))
        assert np.abs(at.fun).max() < 1e-6
        # Postures of the session are within 60 mm of the middle, and turned by .52 rad at the most.
        assert np.abs(at.x[:3] - [0, 0, HIGH]).max() < 120
        assert np.linalg.norm(at.x[3:]) / 100 < 1.0


def test_a_result_is_applied_where_no_instrument_sees_the_body() -> None:
    """Legs alone tell where the body is, as in a file whose columns of the instrument are blank."""
    drawn, readings, _ = session(TURNS["anyhow"], 6, 3)
    found = rsicalib.calibrate(readings, drawn)
    legs = {f"l{k}": readings.values[:, k] for k in range(6)}
    blank = dict.fromkeys((f"{a}{k}" for k in range(3) for a in "xyz"), np.full(30, np.nan))
    alone = rsicalib.forward(legs, drawn, found)
    np.testing.assert_allclose(alone, rsicalib.forward(legs | blank, drawn, found), rtol=0)
    with pytest.raises(rsicalib.InputError, match="l3"):
        rsicalib.forward({k: v for k, v in legs.items() if k != "l3"}, drawn, found)


@pytest.mark.parametrize("mistake", ["exchanged", "inches"])
def test_a_mistake_in_all_columns_of_an_instrument_is_told_once(mistake: str) -> None:
    """What it sees is three points: a part of them undone closes nothing."""
    drawn, readings, _ = session(TURNS["anyhow"], 6, 3)
    columns = dict(readings.columns)
    for k in range(3):
        if mistake == "inches":
            columns |= {f"{a}{k}": columns[f"{a}{k}"] / 25.4 for a in "xyz"}
        else:
            columns |= {f"x{k}": columns[f"y{k}"], f"y{k}": columns[f"x{k}"]}
    found = rsicalib.trace(replace(readings, columns=columns), drawn)
    kind = "units" if mistake == "inches" else "left_handed"
    assert [(w.kind, w.target) for w in found.warnings] == [(kind, "seen0")]
    assert "mistake" in [reason.kind for reason in found.reasons] and not found.steps
    assert "See to the warning first" in found.summary()
