"""Effects with a place that is searched for: an order per turn, a pose from which a base or a bar
has moved; and a counterbalance, which all arms share. Witness: the simulator of blind trials."""

from __future__ import annotations

import dataclasses
from dataclasses import dataclass
from pathlib import Path
from typing import ClassVar

import numpy as np
import pytest

import rsicalib
from rsicalib.report.words import number
from tests.blind import trials
from tests.blind.effects import ARMS, BaseSlip, Effect, Ripple
from tests.blind.geometry import Geometry, forward_arm
from tests.blind.trials import examine, staged
from tests.families.device import observe
from tests.families.effects import distance, targets
from tests.families.trials import readings_of
from tests.machines import files
from tests.machines.belt import draw
from tests.test_families import clean


@pytest.mark.parametrize(("channel", "wave"), [("a22", 130.0), ("a31", 270.0), ("a13", 200.0)])
def test_the_order_of_a_periodic_error_is_found(channel: str, wave: float) -> None:
    result = examine(staged([91, int(wave)], Ripple(channel, 0.006, wave=wave, phase=1.0)))
    assert result["verdict"] == "explained"
    (step,) = result["steps"]
    assert (step["term"], step["target"]) == ("n_per_turn", channel)
    values = {p["name"]: p for p in step["parameters"]}
    order = float(step["place"]) + values["detune"]["value"]
    # Waves are so many counts long: the gain of the device moves none.
    nominal = {c.name: abs(c.gain) for c in rsicalib.Mechanism.rsi().channels}[channel]
    true = 2 * np.pi / (wave * nominal)
    assert abs(order - true) < 4.0 * values["detune"]["sd"]
    assert abs(values["detune"]["value"]) <= 0.13  # the nearest place is named
    size = np.hypot(values["a"]["value"], values["b"]["value"])
    assert abs(size - 0.006) < 4.0 * values["a"]["sd"]
    assert not [also for also in step["also_fits"] if also["term"] == "n_per_turn"]


@pytest.mark.parametrize(("size", "not_applied"), [(2.0, "order"), (3.0, None)])
def test_waves_that_two_stretches_leave_open_are_named_and_not_applied(
    size: float, not_applied: str | None, tmp_path: Path
) -> None:
    """Orders a wave apart from one stretch to the other are nearly alike. Witness: as above."""
    rng = np.random.default_rng(6)
    machine = draw(rng, 150)
    read = machine.observe(rng)
    k = machine.columns.index("tl")
    stretches = np.quantile(read[:, k], [0.15, 0.85])
    read = read[(np.abs(read[:, k, None] - stretches) < 120.0).any(axis=1)]
    read[:, k] += size * np.sin(2.0 * np.pi * read[:, k] / 100.0 + 0.7)
    found = rsicalib.trace(*files.write(machine, read, tmp_path))
    (step,) = found.steps
    assert (step.term, step.target, step.not_applied) == ("n_per_turn", "tl", not_applied)
    assert step.wavelength is not None and abs(step.wavelength - 100.0) < 1.0


def test_an_order_may_be_asked_for_and_lies_within_the_orders_there_are() -> None:
    readings, rest = rsicalib.DEMO / "readings.csv", rsicalib.DEMO / "rest.csv"
    found = rsicalib.calibrate(readings, rest=rest, terms=["offset", "gain", "n_per_turn@a22:14.8"])
    assert found["n_per_turn@a22:14.75.a"].place == "14.75"
    with pytest.raises(rsicalib.InputError, match="3 to 100 waves per turn"):
        rsicalib.calibrate(readings, rest=rest, terms=["offset", "gain", "n_per_turn@a22:101"])


@pytest.mark.parametrize(("belt", "wave", "waves"), [("tl", 310.0, 4), ("br", 97.0, 10)])
def test_waves_along_a_belt_are_found_with_their_length(
    belt: str, wave: float, waves: int, tmp_path: Path
) -> None:
    """A drum that is not round. Witness: lengths between points, and a sine of each."""
    rng = np.random.default_rng(int(wave))
    machine = draw(rng, 60)
    read = machine.observe(rng)
    own = read[:, machine.columns.index(belt)]
    assert np.ptp(own) / wave > waves
    own += 4.0 * np.sin(2.0 * np.pi * own / wave + 0.7)
    found = rsicalib.trace(*files.write(machine, read, tmp_path))
    assert found.verdict == "explained"
    (step,) = found.steps
    assert (step.term, step.target) == ("n_per_turn", belt)
    # Known to some parts of a wave over all of them: 4 mm beside a noise of about 1 in 60 poses.
    assert step.wavelength is not None
    assert abs(step.wavelength / wave - 1.0) < 0.2 / waves
    size = np.hypot(*(p.value for p in step.parameters[:2]))
    assert abs(size - 4.0) < 4.0 * (step.parameters[0].sd or 0.0)
    assert f"waves of {number(step.wavelength)} mm" in " ".join(found.summary().split())


@pytest.mark.parametrize("arm", ARMS)
def test_a_base_that_moved_once_is_found_with_its_pose(arm: str) -> None:
    rng = np.random.default_rng(int(arm[-1]))
    moved = BaseSlip(arm, 0.04, **BaseSlip.details(rng))
    case = staged([92, int(arm[-1])], moved)
    result = examine(case)
    assert result["verdict"] == "explained"
    (step,) = result["steps"]
    assert (step["term"], step["target"]) == ("base_slip", arm)
    scene = case.readings["scene"]
    assert int(step["place"]) == scene.label[np.argmax(scene.turn > moved.at)]
    values = {p["name"]: p for p in step["parameters"]}
    for axis, along in zip("xyz", moved.along, strict=True):
        # Turns are about the shoulder, so that the shift is that of the shoulder.
        assert abs(values[axis]["value"] - 0.04 * along) < 4.5 * values[axis]["sd"]


@dataclass(frozen=True)
class Lifted(Effect):
    """Springs that lift all arms at their first joint: the sag of the simulator, the other way."""

    term: ClassVar[str] = "counterbalance"

    def shafts(self, angles: np.ndarray, scene: trials.Scene, rest: np.ndarray) -> np.ndarray:
        """The joints stand where the handle has them; sensors on the drives do not see the bend."""
        out = angles.copy()
        for arm in range(3):
            own = angles.reshape(-1, 3, 3)[:, arm]
            torque = -forward_arm(Geometry(), arm, own)[1][:, 2, 0]
            out[:, 3 * arm] += self.size * torque
        return out


def test_a_counterbalance_of_all_arms_is_one_constant() -> None:
    result = examine(staged([93, 1], Lifted("all", 0.002)))
    assert result["verdict"] == "explained"
    (step,) = result["steps"]
    assert (step["term"], step["target"]) == ("counterbalance", "each.1")
    (value,) = step["parameters"]
    assert abs(value["value"] - 0.002) < 4.0 * value["sd"]


@dataclass(frozen=True)
class Leaning(Effect):
    """The gear of one joint has play, and the joint lies where the weight of the handle pulls."""

    term: ClassVar[str] = "gear_play"

    def shafts(self, angles: np.ndarray, scene: trials.Scene, rest: np.ndarray) -> np.ndarray:
        """The joint stands where the handle has it; the motor holds `size` before that side."""
        out = angles.copy()
        arm, joint = divmod(self.channel, 3)
        torque = -forward_arm(Geometry(), arm, angles.reshape(-1, 3, 3)[:, arm])[1][:, 2, joint]
        out[:, self.channel] -= self.size * np.sign(torque)
        return out


@pytest.mark.parametrize("channel", ["a22", "a33", "a12"])
def test_play_of_a_gear_lies_where_the_load_pulls(channel: str) -> None:
    result = examine(staged([95, int(channel[1:])], Leaning(channel, 0.004)))
    assert result["verdict"] == "explained"
    (step,) = result["steps"]
    assert (step["term"], step["target"]) == ("gear_play", channel)
    (value,) = step["parameters"]
    # Half a play of 4 mrad is no first-order change of the pull's side.
    assert abs(value["value"] - 0.004) < 4.0 * value["sd"]


SHIFT = {"ballbar": 0.03, "drawwire": 0.01}
"""Lengths, each in its unit, that move the closures by about ten standard deviations in all."""


@pytest.mark.parametrize(("family", "seed"), [("ballbar", 0), ("drawwire", 4)])
def test_a_distance_that_changed_once_is_found_with_its_pose(family: str, seed: int) -> None:
    """Poses from one on are those of the same machine with another bar: nothing of it is shared
    with the core."""
    device, scene, mechanism, _ = clean(family, seed)
    (closure,) = targets(device, "distance")
    from_pose = scene.poses // 2
    longer = distance(device, np.random.default_rng(seed), closure)
    longer = dataclasses.replace(longer, size=SHIFT[family])
    rngs = [np.random.default_rng([seed, k]) for k in (0, 1)]
    as_drawn, changed = observe(device, scene, rngs[0]), observe(device, scene, rngs[1], [longer])
    later = scene.label >= from_pose
    columns = {
        name: np.where(later, changed.columns[name], as_drawn.columns[name])
        for name in as_drawn.columns
    }
    values = np.where(later[:, None], changed.values, as_drawn.values)
    session = dataclasses.replace(as_drawn, values=values, columns=columns)
    result = rsicalib.trace(readings_of(mechanism, session), mechanism)
    assert result.verdict == "explained"
    (step,) = result.steps
    assert (step.term, step.target) == ("distance_slip", closure)
    assert step.place is not None and abs(int(step.place) - from_pose) <= 2
    (parameter,) = step.parameters
    assert abs(parameter.value - longer.size) < 4.5 * (parameter.sd or 0.0)
