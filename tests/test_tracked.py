"""An arm before a tracker that stands anywhere, and is knocked once.

The witness is the arm in plain matrix products (`tests/cone.py`), and numpy for the tracker.
"""

from __future__ import annotations

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

import rsicalib
from rsicalib import InputError
from tests import cone
from tests.full import sized
from tests.oracle import Array

SIGMA, SEEN = 2e-5, 0.02
"""Noise of the encoders [rad] and of the tracker [mm]."""
POSES, SAMPLES, KNOCKED = 48, 3, 30
OFFSETS = cone.OFFSETS * (np.arange(6) > 0)
"""The zero of the first joint is where the tracker says [rad]."""


def drawn(noise: float | None) -> rsicalib.Mechanism:
    asked = ", ".join(f'"offset@q{k}"' for k in range(2, 7))
    text = cone.mechanism(noise, SEEN, f"[{asked}]")
    seen = 'columns = ["x", "y", "z"]\nframe = "tracker"'
    text = text.replace('unknown = ["at"]', seen)
    return rsicalib.Mechanism.from_toml(text + '[[frame]]\nname = "tracker"\nunknown = []\n')


def session(
    seed: int, sigma: float, knocked: bool
) -> tuple[dict[str, list[float]], dict[str, list[float]]]:
    """Readings, and other postures with the places of the ball in the base."""
    rng = np.random.default_rng(seed)
    turns = np.array([1, 0.6, 0.8, 1.5, 1.5, 3])
    q = np.array([0.4, -1.4, -1.6, -1.5, 1.5, 0.0]) + rng.uniform(-1, 1, (POSES + 20, 6)) * turns
    stands = Rotation.random(random_state=seed)
    read = stands.inv().apply(cone.tip(q) - [1500.0, -700.0, 400.0])
    if knocked:
        turned = Rotation.from_rotvec([2e-4, -3e-4, 1e-4])
        read[KNOCKED:] = turned.inv().apply(read[KNOCKED:] - [0.1, -0.2, 0.15])

    def table(rows: Array, places: Array, count: int) -> dict[str, list[float]]:
        every = np.repeat(np.arange(len(rows)), count)
        angles = rows[every] - OFFSETS + sigma * rng.standard_normal((len(every), 6))
        columns = {"pose": every + 1.0, **{f"q{k + 1}": angles[:, k] for k in range(6)}}
        columns |= {axis: places[every, i] for i, axis in enumerate("xyz")}
        return {name: column.tolist() for name, column in columns.items()}

    # The tracker sees each posture once, the encoders are read three times.
    seen = read[:POSES] + SEEN * rng.standard_normal((POSES, 3))
    return table(q[:POSES], seen, SAMPLES), table(q[POSES:], cone.tip(q[POSES:]), 1)


@pytest.mark.parametrize("noise", [SIGMA, None])
@pytest.mark.parametrize("seed", sized([1], list(range(8))))
def test_a_knocked_tracker_is_named_and_the_arm_stays_where_it_is(
    seed: int, noise: float | None
) -> None:
    """A base that moved fits exactly as well: it may be named beside, and is not applied."""
    readings, known = session(seed, SIGMA, knocked=True)
    mechanism = drawn(noise)
    found = rsicalib.trace(readings, mechanism)
    (step,) = found.steps
    fits = {s.term for s in (step, *step.also_fits)}
    assert "frame_slip" in fits and step.place == str(KNOCKED + 1), found.summary()
    assert step.term == "frame_slip" or not step.applied
    angles = {name: column for name, column in known.items() if name not in "xyz"}
    truth = np.transpose([known[axis] for axis in "xyz"])

    def error(result: rsicalib.Calibration | rsicalib.Trace) -> float:
        places = rsicalib.forward(angles, calibration=result, mechanism=mechanism)
        return float(np.sqrt(np.mean(np.square(places[:, :3] - truth))))

    before = rsicalib.calibrate(readings, mechanism)
    assert error(found) <= 1.05 * error(before)


@pytest.mark.parametrize("noise", [SIGMA, None])
@pytest.mark.parametrize("seed", sized([2], list(range(8))))
def test_a_sound_arm_before_a_tracker_is_adequate(seed: int, noise: float | None) -> None:
    readings, _ = session(seed, SIGMA, knocked=False)
    assert rsicalib.trace(readings, drawn(noise)).verdict == "adequate"


@pytest.mark.parametrize("seed", sized([3], range(8)))
def test_an_effect_beside_noise_that_is_declared_too_small_is_applied(seed: int) -> None:
    """What is left of encoders and a tracker that are a quarter noisier does not undo it."""
    told, _ = session(seed, 1.25 * SIGMA, False)
    rng = np.random.default_rng([seed, 2])
    for axis in "xyz":
        own = np.array(told[axis]) + 0.75 * SEEN * rng.standard_normal(POSES).repeat(SAMPLES)
        told[axis] = own.tolist()
    told["q3"] = (1.002 * np.array(told["q3"])).tolist()
    found = rsicalib.trace(told, drawn(SIGMA))
    (step,) = found.steps
    assert (step.term, step.target, step.not_applied) == ("gain", "q3", None)
    assert "noise" in {warning.kind for warning in found.warnings}


@pytest.mark.parametrize("mistake", ["exchanged", "reversed"])
@pytest.mark.parametrize("noise", sized([SIGMA], [SIGMA, None]))
def test_columns_of_the_other_hand_are_said(noise: float | None, mistake: str) -> None:
    """Left-handed: no turn of the tracker undoes it. No effect is named for it."""
    readings, _ = session(5, SIGMA, knocked=False)
    if mistake == "exchanged":
        readings["y"], readings["z"] = readings["z"], readings["y"]
    else:
        readings["x"] = [-x for x in readings["x"]]
    found = rsicalib.trace(readings, drawn(noise))
    (said,) = [warning for warning in found.warnings if warning.kind == "left_handed"]
    assert "x, y, z" in said.text and "left-handed" in said.text
    assert "See to the warning first (cone is left-handed)" in " ".join(found.summary().split())
    assert not found.steps and found.exit_code != 0


def test_columns_in_another_order_of_the_same_hand_are_a_turn_of_the_tracker() -> None:
    readings, _ = session(5, SIGMA, knocked=False)
    readings["x"], readings["y"], readings["z"] = readings["y"], readings["z"], readings["x"]
    found = rsicalib.trace(readings, drawn(SIGMA))
    assert found.verdict == "adequate" and not found.warnings


@pytest.mark.parametrize("times", [1e-3, 1 / 25.4])
def test_columns_in_another_unit_are_said(times: float) -> None:
    """A tracker that writes metres, or inches."""
    readings, _ = session(5, SIGMA, knocked=False)
    for axis in "xyz":
        readings[axis] = [times * x for x in readings[axis]]
    found = rsicalib.trace(readings, drawn(SIGMA))
    (said,) = [warning for warning in found.warnings if warning.kind == "units"]
    assert f"with {1 / times:.4g} times these" in said.text and said.target == "cone"
    assert not found.steps and found.exit_code != 0


def test_a_part_of_a_point_that_was_seen_is_refused() -> None:
    readings, _ = session(5, SIGMA, knocked=False)
    readings["y"][7] = float("nan")
    with pytest.raises(InputError, match=r"y: found NaN, expected a .* or all of x y z empty"):
        rsicalib.calibrate(readings, drawn(SIGMA))
    for axis in "xz":
        readings[axis][7] = float("nan")
    with pytest.raises(InputError, match="NaN"):  # the only closure of the row
        rsicalib.calibrate(readings, drawn(SIGMA))


@pytest.mark.parametrize("seed", sized([2], list(range(10))))
def test_an_instrument_that_reads_long_is_named(seed: int) -> None:
    """Of links that are all longer by the same part it cannot be told: these are drawn."""
    readings, _ = session(seed, SIGMA, knocked=False)
    for axis in "xyz":
        readings[axis] = [1.0004 * x for x in readings[axis]]
    found = rsicalib.trace(readings, drawn(SIGMA))
    assert found.verdict == "explained"
    fits = {s.term for step in found.steps for s in (step, *step.also_fits)}
    assert "instrument_scale" in fits, found.summary()
    (step,) = found.steps
    if step.term == "instrument_scale":
        (scale,) = step.parameters
        assert scale.value is not None and scale.sd is not None
        assert abs(scale.value - (1 / 1.0004 - 1)) < 4 * scale.sd
