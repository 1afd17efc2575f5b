"""Never wrong with confidence: statements that hold on machines we have not seen.

Readings are simulated by `tests.families`, which shares nothing with the core.
"""

from __future__ import annotations

import re
import tomllib
from copy import deepcopy
from dataclasses import replace
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy import stats

import rsicalib
from rsicalib import InputError, Mechanism, Readings
from rsicalib.report.words import advice
from tests import cone, oracle, simulated
from tests.blind import simulator, trials
from tests.blind.effects import Drift
from tests.blind.effects.sensor import Slip
from tests.blind.scene import held
from tests.families.device import Device, Effect, Scene, Session, observe, stage
from tests.families.draw import Rng
from tests.families.effects import CATALOGUE, bad
from tests.families.power import Linear
from tests.families.steps import coarse
from tests.families.trials import readings_of, toml
from tests.full import sized

Array = NDArray[Any]
TWO_ARMS = Path(__file__).parents[1] / "examples" / "two_arms.toml"

both = pytest.mark.parametrize("verb", [rsicalib.calibrate, rsicalib.trace])


@cache
def drawn(family: str, seed: int, samples: int | None) -> tuple[Device, Scene, Rng]:
    """A device and its scene, drawn once."""
    rng = np.random.default_rng([7, seed])
    device = Device.random(family, rng)
    return device, stage(device, rng, samples=samples), rng


def machine(family: str, seed: int, *, samples: int | None = None) -> tuple[Device, Scene, Rng]:
    """A device of a family, poses of a session, and a generator of its own."""
    device, scene, rng = drawn(family, seed, samples)
    return device, scene, deepcopy(rng)


def given(
    device: Device, scene: Scene, rng: Rng, *effects: Effect, text: str | None = None
) -> tuple[Readings, Mechanism]:
    """Readings of a session with effects, and the mechanism, as the verbs take them."""
    mechanism = Mechanism.from_toml(toml(device) if text is None else text)
    readings: Readings = readings_of(mechanism, observe(device, scene, rng, effects))
    return readings, mechanism


def of(device: Device, rng: Rng, term: str, target: str, size: float) -> Effect:
    """An effect of the catalogue of this size."""
    return replace(CATALOGUE[term](device, rng, target), size=size)


def as_strong(device: Device, scene: Scene, effect: Effect, noncentrality: float) -> Effect:
    """An effect at the size that shows so much."""
    return Linear(device, scene).scaled(effect, noncentrality)


def said(result: Any) -> str:
    """All sentences of a result."""
    return "\n".join([*map(str, result.warnings), *advice(result), result.summary()])


# ------------------------------------------------------------------ a: absurd


def random_numbers() -> tuple[Readings, Mechanism]:
    mechanism = rsicalib.load_mechanism(TWO_ARMS)
    values = np.random.default_rng(0).uniform(-2.5, 2.5, (40, 12))
    return Readings.from_arrays(mechanism, values), mechanism


@both
def test_random_numbers_are_implausible(verb: Any) -> None:
    """The misclosure is beyond 5 % of the shortest length."""
    found = verb(*random_numbers())
    assert found.verdict == "implausible"
    assert found.exit_code == 4


@both
@pytest.mark.parametrize("seed", sized([1], [1, 2]))
def test_random_postures_at_a_cone_are_implausible_and_nothing_is_found(
    verb: Any, seed: int
) -> None:
    """A tool at the wrist and joints that undo their readings close any loop: what explains
    readings that are not of this arm is absurd, and none of them is worse than the others."""
    rng = np.random.default_rng(seed)
    held = np.repeat(rng.uniform(cone.LIMITS[:, 0], cone.LIMITS[:, 1], (40, 6)), 4, axis=0)
    read = held + 2e-5 * rng.standard_normal(held.shape)
    table: dict[str, Any] = {f"q{k + 1}": column for k, column in enumerate(read.T)}
    table |= {"pose": np.repeat(np.arange(40), 4), "at": ["cone"] * 160}
    found = verb(table, Mechanism.from_toml(cone.mechanism(2e-5, 0.02)))
    assert (found.verdict, [reason.kind for reason in found.reasons]) == ("implausible", ["absurd"])
    assert not found.excluded and not getattr(found, "steps", [])
    assert "degrees" not in {w.kind for w in found.warnings}


@both
def test_noise_beyond_a_twentieth_of_the_limits_is_implausible(verb: Any) -> None:
    """Repeats that share nothing: the noise that they give is 0.3 of the range."""
    device, scene, rng = machine("fourbar", 0)
    values = rng.uniform([-3.1, 0.2], [3.1, 3.0], (len(scene.label), 2))
    mechanism = Mechanism.from_toml(toml(device))
    session = Session(scene, values, {}, True, False)
    found = verb(readings_of(mechanism, session), mechanism)
    assert "absurd_noise" in {why.kind for why in found.implausible}
    assert (found.verdict, found.exit_code) == ("implausible", 4)


@pytest.mark.parametrize(("declared", "verdict"), [(1.0, "adequate"), (0.5, "unexplained")])
def test_coarse_sensors_beside_a_short_link_are_not_implausible(
    declared: float, verdict: str
) -> None:
    """A crank of 300 mm with a bracket of 10 mm: 5 mrad at its end are 1.5 mm. Law of cosines."""
    noise, rng = 5e-3, np.random.default_rng(2)
    crank = np.linspace(0, 2 * np.pi, 60, endpoint=False)
    along, up = 600 - 310 * np.cos(crank), 310 * np.sin(crank)
    apart = np.hypot(along, up)
    rocker = np.pi - np.arctan2(up, along)
    rocker -= np.arccos((apart**2 + 500**2 - 700**2) / (1000 * apart))
    channels = [
        {"name": name, "unit": "rad", "gain": 1.0, "offset": 0.0, "noise": noise * declared}
        for name in ("crank", "rocker")
    ]
    chains = [
        {"name": "left", "dh": [{"channel": "crank", "a": 300.0}, {"a": 10.0}]},
        {"name": "right", "dh": [{"a": 600.0}, {"channel": "rocker", "a": 500.0}]},
    ]
    ends = [{"name": c["name"], "chain": c["name"], "at": [0, 0, 0]} for c in chains]
    rod = {"name": "rod", "kind": "distance", "between": ["left", "right"], "value": 700.0}
    mechanism = Mechanism.from_dict(
        {
            "name": "coarse four-bar",
            "length_unit": "mm",
            "channel": channels,
            "chain": chains,
            "point": ends,
            "closure": [rod],
            "model": {"terms": ["offset"]},
        }
    )
    values = np.column_stack([crank, rocker]) + noise * rng.standard_normal((60, 2))
    found = rsicalib.calibrate(Readings.from_arrays(mechanism, values), mechanism)
    assert (found.verdict, found.implausible) == (verdict, ())


def test_an_effect_beyond_thirty_times_its_typical_size_is_implausible() -> None:
    device, scene, rng = machine("ballbar", 0)
    # Of the last joint: a drift of others as large opens the loops, and nothing is looked for.
    drift = of(device, rng, "drift", "q6", 40 * 5e-3)
    found = rsicalib.trace(*given(device, scene, rng, drift))
    assert found.verdict == "implausible"
    assert found.exit_code == 4
    assert [(why.kind, why.target) for why in found.implausible] == [("absurd_effect", "q6")]


@pytest.mark.parametrize(("term", "size"), [("drift", 2.0), ("temperature_offset", 0.4)])
def test_a_slide_drifts_by_lengths(term: str, size: float) -> None:
    """2 mm, and 0.4 mm a kelvin, of the 200 mm that the leg slides: 1 % of it, as of a turn."""
    device, scene, rng = machine("rps", 0)
    effect = of(device, rng, term, "leg2", size)
    found = rsicalib.trace(*given(device, scene, rng, effect))
    assert [(step.term, step.target) for step in found.steps] == [(term, "leg2")]
    assert (found.verdict, found.exit_code) == ("explained", 0)


@pytest.mark.parametrize(
    ("family", "term", "channel"),
    [
        ("rps", "curvature", "turn2"),
        ("rps", "cubic", "turn3"),
        ("drawwire", "curvature", "rail"),
    ],
)
def test_a_curve_is_as_large_as_it_is_in_the_readings(family: str, term: str, channel: str) -> None:
    """Readings span a part of the range: over all of it the parabola would be many times larger."""
    device, scene, rng = machine(family, 0)
    effect = as_strong(device, scene, CATALOGUE[term](device, rng, channel), 120.0)
    found = rsicalib.trace(*given(device, scene, rng, effect))
    assert {step.target for step in found.steps} == {channel}
    assert found.verdict == "explained"


# ------------------------------------------------------------------ b: nothing judges


@both
def test_what_nothing_judges_is_unjudged(verb: Any) -> None:
    """One sample a pose and no declared noise; the advice says what would judge it."""
    found = verb(*given(*machine("fourbar", 0, samples=1)))
    assert found.quality.p_value is None
    assert found.verdict == "unjudged"
    assert found.exit_code == 0
    assert "--noise" in said(found) and "hold each pose" in said(found)


def test_rows_that_are_no_motion_do_not_give_the_noise() -> None:
    """Touches without the column `pose`: neighbours are apart, and scatter by the effect as well.

    `trace` finds the curve; the noise that `calibrate` judges by must not have it in it.
    """
    device, scene, rng = machine("ballbar", 0)
    mechanism = deepcopy(device.drawing.mechanism)
    for entry in (*mechanism["channel"], *mechanism["closure"]):
        entry.pop("noise", None)
    loaded = Mechanism.from_dict(mechanism)
    curve = as_strong(device, scene, CATALOGUE["curvature"](device, rng, "q3"), 3000.0)
    session = replace(observe(device, scene, rng, [curve]), held=False)
    readings = readings_of(loaded, session)
    assert rsicalib.trace(readings, loaded).steps
    assert rsicalib.calibrate(readings, loaded).verdict != "adequate"


@both
def test_repeats_that_are_copies_of_each_other_are_no_evidence(verb: Any) -> None:
    """Each pose stands four times in the file, digit by digit: the repeats show no noise."""
    device, scene, rng = machine("fourbar", 0)
    first = np.flatnonzero(np.diff(scene.label, prepend=0))
    values = observe(device, scene, rng).values[first][scene.label - 1]
    mechanism = Mechanism.from_toml(toml(device))
    found = verb(readings_of(mechanism, Session(scene, values, {}, True, False)), mechanism)
    assert found.verdict in ("undetermined", "unjudged")


# ------------------------------------------------------------------ c: degrees


@both
def test_degrees_taken_for_radians_are_warned_of(verb: Any) -> None:
    device, scene, rng = machine("fourbar", 0)
    mechanism = Mechanism.from_toml(toml(device))
    session = observe(device, scene, rng)
    found = verb(readings_of(mechanism, session.changed(np.degrees(session.values))), mechanism)
    assert "degrees" in {w.kind for w in found.warnings}


def in_degrees(mechanism: dict[str, Any]) -> dict[str, Any]:
    """The same mechanism, all of whose encoders are written in degrees."""
    for channel in mechanism["channel"]:
        channel["unit"] = "deg"
        for key in {"noise", "offset"} & channel.keys():
            channel[key] = np.degrees(channel[key])
        for key in {"limits", "range"} & channel.keys():
            channel[key] = np.degrees(channel[key]).tolist()
    return mechanism


def test_a_channel_in_degrees_is_converted() -> None:
    device, scene, rng = machine("fourbar", 0)
    mechanism = Mechanism.from_dict(in_degrees(tomllib.loads(toml(device))))
    session = observe(device, scene, rng)
    readings = readings_of(mechanism, session.changed(np.degrees(session.values)))
    found = rsicalib.calibrate(readings, mechanism)
    assert found.verdict == "adequate"
    for name, true in zip(device.names, device.offsets, strict=True):
        own = found["offset", name]
        assert own.value is not None and own.sd is not None
        assert abs(own.value - true) < 5 * own.sd


# ------------------------------------------------------------------ d: one judgement


def test_both_verbs_judge_a_residual_alike() -> None:
    """Declared noise such that p is 0.004: between what calibrate and trace ask for today."""
    device, scene, rng = machine("ballbar", 1)
    session = observe(device, scene, rng)
    mechanism = Mechanism.from_toml(toml(device))
    fit = rsicalib.calibrate(readings_of(mechanism, session), mechanism).fit
    assert fit.chi2 is not None and fit.dof is not None
    factor = float(np.sqrt(fit.chi2 / stats.chi2.isf(0.004, fit.dof)))
    mechanism = Mechanism.from_toml(toml(device, factor, factor))
    readings = readings_of(mechanism, session)
    one, two = rsicalib.calibrate(readings, mechanism), rsicalib.trace(readings, mechanism)
    assert not two.steps and not two.excluded
    assert one.quality.p_value == pytest.approx(0.004, rel=0.01)
    assert one.exit_code == two.exit_code


# ------------------------------------------------------------------ e: undetermined


@both
def test_a_scale_that_nothing_gives_is_a_convention(verb: Any) -> None:
    """Two arms whose tips touch, all lengths free."""
    mechanism = tomllib.loads(TWO_ARMS.read_text(encoding="utf-8"))
    mechanism["point"] = [
        {"name": "left tip", "chain": "left", "at": [30.0, 0.0, 40.0]},
        {"name": "right tip", "chain": "right", "at": [10.0, 20.0, 30.0]},
    ]
    between = ["left tip", "right tip"]
    mechanism["closure"] = [{"name": "pin", "kind": "touch", "between": between}]
    for channel in mechanism["channel"]:
        channel |= {"limits": [-2.5, 2.5], "noise": 2e-5}
    mechanism["model"] = {"terms": ["offset", "link_length", "link_offset"]}

    def off(a: Array) -> Array:
        ends = [oracle.point(mechanism, name, a) for name in between]
        return np.asarray((ends[0] - ends[1]) / 100.0)

    rng = np.random.default_rng(3)
    values = simulated.read(mechanism, simulated.closed(mechanism, off, 40, rng), np.zeros(12), rng)
    loaded = Mechanism.from_dict(mechanism)
    readings = Readings.from_arrays(loaded, values)
    found = verb(readings, loaded)
    assert (found.verdict, found.exit_code) == ("adequate", 0)
    assert found.unobservable and all("no reading can tell" in text for text in found.unobservable)
    unknown = [p for p in found.parameters if p.sd is None]
    assert any(p.term == "link_length" for p in unknown)


@pytest.mark.parametrize(("family", "link"), [("sockets", "arm/1"), ("ballbar", "arm/4")])
def test_an_effect_that_turns_as_an_offset_does_leaves_the_calibration_determined(
    family: str, link: str
) -> None:
    """One of the two tilts of this link turns about the next joint's axis; the other is found."""
    device, scene, rng = machine(family, 0)
    tilt = as_strong(device, scene, CATALOGUE["joint_tilt"](device, rng, link), 200.0)
    found = rsicalib.trace(*given(device, scene, rng, tilt))
    assert [(step.term, step.target) for step in found.steps] == [("joint_tilt", link)]
    assert found.unobservable
    assert found.verdict == "explained"


# ------------------------------------------------------------------ f: elsewhere


@pytest.mark.parametrize("seed", range(sized(1, 3)))
def test_a_base_of_a_planar_machine_is_found_and_the_rest_determined(seed: int) -> None:
    """Off the plane no reading says where it is, and across the frame offsets take it up."""
    device, scene, rng = machine("fourbar", seed)
    ground = as_strong(device, scene, of(device, rng, "link_length", "output/1", 0.05), 150.0)
    readings, loaded = given(device, scene, rng, ground)
    without = ["link_length", "point_position", "distance", "once_per_turn", "twice_per_turn"]
    without += ["curvature", "cubic", "gain", "crosstalk", "free_curve"]
    found = rsicalib.trace(readings, loaded, without=without)
    assert [step.term for step in found.steps] == ["base_position"]
    assert (found.verdict, found.exit_code) == ("explained", 0)


@pytest.mark.parametrize("seed", range(sized(1, 2)))
def test_a_tilt_of_a_body_with_two_points_is_found(seed: int) -> None:
    """Behind the last joint: both points turn, which no shift of the tool does."""
    device, scene, rng = machine("gantry", seed)
    tilt = as_strong(device, scene, CATALOGUE["joint_tilt"](device, rng, "gantry/4"), 150.0)
    found = rsicalib.trace(*given(device, scene, rng, tilt))
    names = [(n.term, n.target) for n in (found.steps[0], *found.steps[0].also_fits)]
    assert ("joint_tilt", "gantry/4") in names
    assert found.verdict == "explained"


def test_what_does_not_hold_elsewhere_is_at_most_partly_explained() -> None:
    """A curve of a sensor in the two groups that are fitted, and not in the third."""
    device, scene, rng = machine("sockets", 0)
    mechanism = Mechanism.from_toml(toml(device))
    session = observe(device, scene, rng)
    bent = session.values.copy()
    here = np.array(scene.group) != "back"
    bent[here, 2] += 0.004 * bent[here, 2] ** 2
    readings = readings_of(mechanism, session.changed(bent))
    found = rsicalib.trace(readings, mechanism, fit_groups=["front", "left"])
    assert found.groups is not None
    assert found.groups.others is not None and found.groups.before_others is not None
    assert found.groups.others > 1.05 * found.groups.before_others
    assert found.verdict == "partly_explained"
    assert "group" in found.summary().split("\n\n")[0]


def test_check_poses_that_are_off_as_the_parameters_are_do_not_speak_against_an_effect() -> None:
    """The drift is there, and told of it a fit is no nearer to the check poses than without."""
    case = trials.make("single", 49, 0)
    found = trials.examine(case)
    rms = [found[stage]["check"]["position_rms"] for stage in ("before", "after")]
    told = trials.told(case)
    assert told is not None and rms[1] > 1.15 * rms[0] and rms[1] == pytest.approx(told, rel=0.01)
    assert [step["term"] for step in found["steps"]] == ["drift"]
    assert found["verdict"] == "explained"


def test_check_poses_that_are_off_by_more_than_predicted_speak_against_an_effect() -> None:
    """The sensor drifts in the session, and drifts back while the check poses are read."""
    there = trials.staged([7, 0], Drift("a13", 0.03))
    back = trials.staged([7, 0], Drift("a13", -0.03))
    found = trials.examine(replace(there, check=back.check))
    assert [(step["term"], step["target"]) for step in found["steps"]] == [("drift", "a13")]
    assert found["verdict"] == "partly_explained"
    assert {"check", "check_before"} <= {reason["kind"] for reason in found["reasons"]}


def test_the_error_of_the_platform_is_as_large_as_predicted() -> None:
    """Over 12 hand controllers, read 64 times in each check pose: parameters err, readings do not.

    Each mean square is χ² of about 10, their mean of 120: 1.3 is five standard deviations.
    """
    squares = []
    for number in range(sized(6, 12)):
        case = trials.staged([11, number])
        quiet = simulator.check(case.device, np.random.default_rng(number), samples=64)
        found = trials.examine(replace(case, check=quiet))
        rms = found["after"]["check"]["position_rms"]
        squares.append((rms / found["predicted"]["position_sd"]) ** 2)
    # Errors of a session go together, as two or three independent ones: of six, to a fifth.
    assert sized(0.65, 0.75) < np.sqrt(np.mean(squares)) < sized(1.4, 1.3)


@pytest.mark.parametrize("family", ["fourbar", "ballbar"])
def test_the_error_of_carried_points_is_as_large_as_predicted(family: str) -> None:
    squares = []
    for seed in range(12):
        device, scene, rng = machine(family, seed)
        readings, mechanism = given(device, scene, rng)
        found = rsicalib.calibrate(readings, mechanism)
        values, columns = device.ideal(scene)
        exact = readings_of(mechanism, Session(scene, values, columns, True, False))
        there = np.stack(list(device.points(scene, ()).values()), axis=1)
        error = rsicalib.forward(exact, mechanism, found).reshape(there.shape) - there
        assert found.predicted is not None and found.predicted.orientation_sd is None
        squares.append(np.mean(error**2) / found.predicted.position_sd**2)
    assert 0.7 < np.sqrt(np.mean(squares)) < 1.4


# ------------------------------------------------------------------ g: too little


def test_the_same_session_twice_is_not_twice_the_poses() -> None:
    """Refused, or said and counted once."""
    readings, mechanism = given(*machine("ballbar", 2))
    once = rsicalib.calibrate(readings, mechanism)
    try:
        twice = rsicalib.calibrate([readings, readings], mechanism)
    except InputError:
        return
    assert "same_readings" in {w.kind for w in twice.warnings}
    for one, two in zip(once.parameters, twice.parameters, strict=True):
        assert one.sd is not None and two.sd is not None
        assert two.sd > 0.95 * one.sd


@pytest.mark.parametrize("seed", range(sized(1, 3)))
def test_wiring_is_not_accused_from_one_pose(seed: int) -> None:
    readings, mechanism = given(*machine("rps", seed))
    found = rsicalib.calibrate(readings.select(readings.pose == 1), mechanism)
    assert found.verdict == "undetermined"
    assert "exchanged" not in said(found) and "wrong way round" not in said(found)


@both
@pytest.mark.parametrize("by", [8, 25])
def test_a_pose_that_moved_does_not_make_the_noise(verb: Any, by: int) -> None:
    """Two of its four samples are off by so many standard deviations of a reading."""
    device, scene, rng = machine("fivebar", 0)
    session = observe(device, scene, rng)
    rows = np.flatnonzero(scene.label == 7)[2:]
    session.values[rows, 2] += by * device.noise[2]
    mechanism = Mechanism.from_toml(toml(device))
    found = verb(readings_of(mechanism, session), mechanism)
    assert found.verdict == "adequate"
    assert [(out.pose, out.samples) for out in found.excluded] == [(7, 4)]
    assert "moved while it was sampled" in found.excluded[0].reason
    # Of 117 degrees of freedom and more: 7 % is one standard deviation.
    (sigma, *_) = found.noise.sigma.values()
    assert sigma == pytest.approx(device.noise[0], rel=0.2)
    assert found.noise.dof is not None and found.noise.dof > 100


# ------------------------------------------------------------------ h, i: declared noise


@both
def test_a_declared_noise_that_is_too_large_is_said(verb: Any) -> None:
    """χ² per degree of freedom is 0.25; half the declared noise would fit."""
    device, scene, rng = machine("ballbar", 1)
    found = verb(*given(device, scene, rng, text=toml(device, 2.0, 2.0)))
    assert found.quality.chi2 < 0.35 * found.quality.dof
    told = [str(text) for text in (*found.warnings, *advice(found))]
    assert any("noise" in text and "declared" in text and "large" in text for text in told)


@pytest.mark.parametrize(
    ("family", "seed"),
    [("ballbar", 2), ("drawwire", 1), *sized([], [("sockets", 2), ("ballbar", 3)])],
)
def test_a_declared_noise_that_is_too_small_is_no_effect(family: str, seed: int) -> None:
    """0.3 of the noise is declared, and no pose is read twice: χ² per degree of freedom is 11."""
    device, scene, rng = machine(family, seed)
    found = rsicalib.trace(*given(device, scene, rng, text=toml(device, 0.3, 0.3)))
    assert (found.verdict, found.exit_code) == ("unexplained", 4)
    assert not found.steps and not found.excluded
    # 3.3 times as much would fit, to three of its standard deviations; no sensor is blamed.
    factor = np.sqrt(found.after.chi2 / found.after.dof)
    assert factor == pytest.approx(1 / 0.3, rel=3 / np.sqrt(2 * found.after.dof))
    assert f"{factor:.2f} times" in found.unexplained.text
    assert found.unexplained.target is None


@pytest.mark.parametrize("family", ["ballbar", "drawwire"])
def test_an_effect_is_found_beside_a_declared_noise_that_is_too_small(family: str) -> None:
    """Half of the noise is declared; the effect has a noncentrality of 150 of the true one."""
    device, scene, rng = machine(family, 1)
    twice = as_strong(device, scene, of(device, rng, "once_per_turn", "q2", 1e-3), 150.0)
    found = rsicalib.trace(*given(device, scene, rng, twice, text=toml(device, 0.5, 0.5)))
    assert [step.target for step in found.steps] == ["q2"]
    assert found.verdict == "partly_explained"
    assert "noise" in {w.kind for w in found.warnings}


def test_what_moves_everything_could_not_be_seen_at_any_size() -> None:
    """All legs on longer bases: the same readings, where rounding took it for 10^15 mm."""
    found = rsicalib.trace(*given(*machine("rps", 0)))
    sizes = [hidden.detectable for hidden in found.could_hide]
    longer = [h for h in found.could_hide if (h.term, h.target) == ("link_offset", "each/1")]
    assert [h.detectable for h in longer] == [None]
    assert max(size for size in sizes if size is not None) < 1e3


def test_play_is_averaged_alike_in_the_fit_and_in_the_search() -> None:
    """A long link beside a declared play that rules, with eight samples a pose."""
    device, scene, rng = machine("gantry", 3, samples=8)
    mechanism = deepcopy(device.drawing.mechanism)
    for closure in mechanism["closure"]:
        closure["noise"] = 0.05
    device = replace(device, drawing=replace(device.drawing, mechanism=mechanism, play=0.05))
    link = CATALOGUE["link_length"](device, rng, "scara/2")
    # `as_strong` counts samples as independent: here eight of them share one play.
    strong = as_strong(device, scene, link, 8 * 75.0)
    readings, loaded = given(device, scene, rng, strong)
    fit = rsicalib.calibrate(readings, loaded).fit
    assert fit.p_value is not None and fit.p_value < 1e-3
    found = rsicalib.trace(readings, loaded)
    names = [n for step in found.steps for n in (step, *step.also_fits)]
    assert any(n.target in ("scara/2", "scara/3") for n in names)


# ------------------------------------------------------------------ j: planar


def planar(play: float | None) -> tuple[Device, Readings, Mechanism]:
    device, scene, rng = machine("fivebar", 0)
    if play is None:
        return device, *given(device, scene, rng)
    mechanism = deepcopy(device.drawing.mechanism)
    mechanism["closure"][0]["noise"] = play
    for channel, sigma in zip(mechanism["channel"], device.noise, strict=True):
        channel["noise"] = float(sigma)
    # The play is in the plane, as the machine is.
    q = device.closed(scene)
    values = (q - device.offsets) / device.gains + device.noise * rng.standard_normal(q.shape)
    loaded = Mechanism.from_dict(mechanism)
    readings = readings_of(loaded, Session(scene, values, {}, True, True))
    return device, readings, loaded


@pytest.mark.parametrize("play", [None, 1e-6])
def test_a_planar_touch_calibrates(play: float | None) -> None:
    device, readings, mechanism = planar(play)
    found = rsicalib.calibrate(readings, mechanism)
    assert found.verdict == "adequate"
    for name, true in zip(device.names, device.offsets, strict=True):
        own = found["offset", name]
        assert own.value is not None and own.sd is not None
        assert abs(own.value - true) < 5 * own.sd


def test_a_planar_touch_has_two_equations() -> None:
    """40 poses, two equations each, four offsets: the third, 0 = 0, is no degree of freedom."""
    _, readings, mechanism = planar(1e-6)
    found = rsicalib.calibrate(readings, mechanism)
    assert found.fit.dof == pytest.approx(76.0, abs=1.0)


def on_a_plate(seed: int, play: float | None, leans: float) -> tuple[Readings, Mechanism]:
    """A planar arm whose pin rests in two holes of a plate, placed twice, 25 times in each [m].

    Everything may lean together: the plane of the machine is then no plane of the base.
    """
    rng = np.random.default_rng([17, seed])
    links, pin, noise = (0.4, 0.35, 0.2), np.array([0.03, 0.01]), 1e-4
    rows: list[Any] = [{"channel": f"q{k + 1}", "a": links[k]} for k in range(3)]
    channels = [
        {"name": f"q{k + 1}", "unit": "rad", "gain": 1.0, "offset": 0.0, "limits": [-3.0, 3.0]}
        | {"noise": noise}
        for k in range(3)
    ]
    rest: dict[str, Any] = {"name": "rest", "kind": "touch", "between": ["pin", "hole"]}
    plate = {"name": "plate", "kind": "distance", "between": ["hole[at=A]", "hole[at=B]"]}
    mechanism = {
        "name": "planar arm",
        "length_unit": "m",
        "channel": channels,
        "chain": [{"name": "arm", "dh": [{"theta": 0.3, "alpha": leans}, *rows]}],
        "point": [
            {"name": "pin", "chain": "arm", "at": [*pin, 0.1]},
            {"name": "hole", "unknown": ["group", "at"]},
        ],
        "closure": [
            rest if play is None else {**rest, "noise": play},
            {**plate, "value": 0.25, "sd": 1e-5},
        ],
        "model": {"terms": ["offset@q2", "offset@q3"]},
    }
    values, keys = [], []
    for group, middle, bearing in (("one", (0.45, 0.2), 0.3), ("two", (0.2, 0.5), 1.4)):
        for at, side in (("A", -0.125), ("B", 0.125)):
            hole = np.array(middle) + side * np.array([np.cos(bearing), np.sin(bearing)])
            for _ in range(25):
                values.append(closed_by_cosines(hole, links, pin, rng))
                keys.append((group, at))
    read = np.array(values) - OFFSETS + noise * rng.standard_normal((len(values), 3))
    named = {"group": [key[0] for key in keys], "at": [key[1] for key in keys]}
    loaded = Mechanism.from_dict(mechanism)
    return Readings.from_arrays(loaded, read, keys=named), loaded


OFFSETS = np.array([0.0, 0.02, -0.015])


def closed_by_cosines(hole: Array, links: tuple[float, ...], pin: Array, rng: Rng) -> Array:
    """Angles of three planar joints that bring the pin into the hole, by the law of cosines."""
    while True:
        heading = rng.uniform(-np.pi, np.pi)
        last = links[2] + pin[0]
        turned = [
            last * np.cos(heading) - pin[1] * np.sin(heading),
            last * np.sin(heading) + pin[1] * np.cos(heading),
        ]
        x, y = hole - turned
        cosine = (x * x + y * y - links[0] ** 2 - links[1] ** 2) / (2 * links[0] * links[1])
        if abs(cosine) > 0.98:
            continue
        elbow = rng.choice([-1, 1]) * np.arccos(cosine)
        reach = links[0] + links[1] * np.cos(elbow), links[1] * np.sin(elbow)
        shoulder = np.arctan2(y, x) - np.arctan2(reach[1], reach[0])
        q = np.array([shoulder, elbow, heading - shoulder - elbow])
        q = (q + np.pi) % (2 * np.pi) - np.pi
        if np.all(np.abs(q) < 2.9):
            return np.asarray(q)


@pytest.mark.parametrize("play", [None, 1e-6])
@pytest.mark.parametrize("leans", [0.0, 0.4])
def test_a_planar_touch_of_unknown_points_has_two_equations(
    play: float | None, leans: float
) -> None:
    """100 touches, two equations each, less 2 offsets and 8 coordinates; 2 distances are known."""
    readings, mechanism = on_a_plate(0, play, leans)
    for found in (rsicalib.calibrate(readings, mechanism), rsicalib.trace(readings, mechanism)):
        assert found.verdict == "adequate"
        assert not found.warnings and not found.unobservable
        assert 190.0 - 1e-6 < found.quality.dof < 192.0
        for name, true in (("q2", OFFSETS[1]), ("q3", OFFSETS[2])):
            own = found["offset", name]
            assert abs(own.value - true) < 5 * own.sd


# ------------------------------------------------------------------ k: coarse encoders


@both
def test_the_step_of_a_coarse_encoder_joins_the_noise(verb: Any) -> None:
    device, scene, rng = machine("ballbar", 3)
    mechanism = Mechanism.from_toml(toml(device))
    session = observe(device, scene, rng)
    step = 5e-3
    rounded = session.changed(step * np.rint(session.values / step))
    found = verb(readings_of(mechanism, rounded), mechanism)
    assert not found.excluded and not getattr(found, "steps", ())
    assert found.noise is not None
    for sigma in found.noise.sigma.values():
        assert sigma == pytest.approx(step / np.sqrt(12), rel=0.1)


@both
def test_steps_of_one_encoder_are_said_and_no_pose_moved(verb: Any) -> None:
    """Steps of three times its noise: within a pose the encoder reads one code, or two."""
    device, scene, rng = machine("fivebar", 1)
    mechanism = Mechanism.from_toml(toml(device))
    session = observe(device, scene, rng)
    values = session.values.copy()
    step = 3 * device.noise[1]
    values[:, 1] = step * np.rint(values[:, 1] / step)
    found = verb(readings_of(mechanism, session.changed(values)), mechanism)
    assert found.verdict == "adequate"
    (text,) = (w.text for w in found.warnings if w.kind == "coarse")
    told = re.match(r"(\w+) reads in steps of (\S+) rad: .* is (\d+) % of the variance", text)
    assert told is not None, text
    assert told[1] == mechanism.channels[1].name
    assert float(told[2]) == pytest.approx(step, rel=1e-3)
    # Of rounding 9 / 12, of the sensor 1 or, where what it reads stays within a code, less.
    assert 25 <= float(told[3]) <= 100
    assert "moved_pose" not in {w.kind for w in found.warnings}


@pytest.mark.parametrize("steps", sized([16], [8, 16]))
@pytest.mark.parametrize("family", ["fourbar", "fivebar", "gantry"])
def test_one_encoder_in_large_steps_spoils_no_clean_session(family: str, steps: int) -> None:
    """All samples of a pose fall on one code: repeats do not show what rounding does to it.

    Where nobody declares it, the noise is that of the sensor and of rounding, `s²/12`, which 4
    samples in 60 poses tell to about a tenth, and in 40 of two equations likewise.
    """
    for number in range(sized(1, 3)):
        device, scene, rng = machine(family, number)
        mechanism = Mechanism.from_toml(toml(device))
        session = coarse(device, observe(device, scene, rng), steps)
        found = rsicalib.calibrate(readings_of(mechanism, session), mechanism)
        assert found.verdict == "adequate"
        assert not found.excluded
        assert found.noise is not None and found.fit.chi2 is not None
        # Chance: 4 standard deviations of a mean of so many squares.
        assert abs(found.fit.chi2 / found.fit.dof - 1.0) < 4.0 * np.sqrt(2.0 / found.fit.dof)
        if mechanism.channels[0].noise is None:
            sigma = list(found.noise.sigma.values())
            true = device.noise * np.sqrt(1.0 + (np.arange(len(sigma)) == 1) * steps**2 / 12.0)
            assert sigma == pytest.approx(list(true), rel=0.25)


# ------------------------------------------------------------------ l, m, n: loads


@pytest.mark.parametrize("seed", [1])
def test_no_load_lifts(seed: int) -> None:
    device, scene, rng = machine("sockets", seed)
    lift = Effect(
        "lift",
        "load",
        "q3",
        6e-3,
        builds=lambda s, b: b.with_entry("gives", "q3", -abs(s)),
    )
    found = rsicalib.trace(*given(device, scene, rng, as_strong(device, scene, lift, 150.0)))
    for step in found.steps:
        if step.klass == "load":
            assert all(p.value is not None and p.value > 0.0 for p in step.parameters)


def compliances(device: Device, rng: Rng) -> list[Effect]:
    """As an arm of a metre has them, in rad/(kg m)."""
    sizes = {"q2": 3e-4, "q3": 4e-4, "q4": 4e-3}
    return [of(device, rng, "joint_compliance", q, size) for q, size in sizes.items()]


@pytest.mark.parametrize("seed", sized([0], [0, 1]))
def test_compliance_of_several_joints_is_found(seed: int) -> None:
    device, scene, rng = machine("sockets", seed)
    found = rsicalib.trace(*given(device, scene, rng, *compliances(device, rng)))
    assert found.verdict == "explained"
    assert {(step.term, step.target) for step in found.steps} == {
        ("joint_compliance", q) for q in ("q2", "q3", "q4")
    }


@pytest.mark.parametrize("seed", sized([0], [0, 1, 2, 3]))
def test_a_joint_that_is_many_times_as_soft_is_told_as_it_is(seed: int) -> None:
    """Joint 4 gives fifty times as much as the others of its arm."""
    device, scene, rng = machine("sockets", seed)
    sizes = {"q2": 3e-4, "q4": 2e-2}
    effects = [of(device, rng, "joint_compliance", q, size) for q, size in sizes.items()]
    readings, mechanism = given(device, scene, rng, *effects)
    terms = [*mechanism.to_dict()["model"]["terms"], *(f"joint_compliance@{q}" for q in sizes)]
    found = rsicalib.calibrate(readings, mechanism, terms=terms)
    assert found.verdict == "adequate"
    for effect in effects:
        own = found["joint_compliance", effect.target]
        assert own.value is not None and own.sd is not None
        assert abs(abs(own.value) - abs(effect.size)) < 4 * own.sd


@pytest.mark.parametrize("seed", sized([0], [0, 1]))
@pytest.mark.parametrize("soft", sized([2], [0, 2]))
def test_a_tool_that_slipped_is_found_beside_compliance(soft: int, seed: int) -> None:
    """From row 70 of 120 on the ball sits 1 mm elsewhere; so many joints give."""
    device, scene, rng = machine("sockets", seed)
    mechanism = Mechanism.from_toml(toml(device))
    gives = compliances(device, rng)[:soft]
    moved = np.array([8e-4, 0.0, 6e-4])
    tool = Effect("tool", "geometry", "arm", 1.0, builds=lambda s, b: b.with_tip("arm", s * moved))
    early, late = (
        observe(device, scene, np.random.default_rng(5), effects)
        for effects in (gives, [*gives, tool])
    )
    slipped = np.arange(len(scene.label)) >= 70
    values = np.where(slipped[:, None], late.values, early.values)
    found = rsicalib.trace(readings_of(mechanism, early.changed(values)), mechanism)
    assert found.verdict == "explained"
    assert not found.excluded
    (slip,) = (step for step in found.steps if step.term == "tool_slip")
    assert (slip.target, slip.place) == ("arm", "71")
    for parameter, true in zip(slip.parameters, moved, strict=True):
        assert parameter.value is not None and parameter.sd is not None
        assert abs(parameter.value - true) < 5 * parameter.sd
    others = {(step.term, step.target) for step in found.steps if step is not slip}
    assert others == {("joint_compliance", q) for q in ("q2", "q3")[:soft]}


# ------------------------------------------------------------------ o: late slips


@pytest.mark.parametrize("family", ["ballbar", "gantry"])
def test_a_slip_of_two_poses_is_bad_readings(family: str) -> None:
    device, scene, rng = machine(family, 0)
    late = scene.label > scene.poses - 2
    first = np.arange(len(device.names)) == 1

    def reads(size: float, readings: Array, scene: Scene) -> Array:
        return np.asarray(size * np.outer(late, first) / device.gains)

    effect = Effect("late", "data", device.names[1], 0.01, reads=reads)
    found = rsicalib.trace(*given(device, scene, rng, as_strong(device, scene, effect, 200.0)))
    assert not [step for step in found.steps if step.term == "slip"]
    assert {entry.pose for entry in found.excluded} == {scene.poses - 1, scene.poses}


@pytest.mark.parametrize("seed", range(sized(2, 8)))
def test_a_slip_with_three_poses_on_one_side_is_a_slip(seed: int) -> None:
    """By 30 mrad. Of two of these it was said that they wander, and their first pose left out."""
    rng = np.random.default_rng([seed, 12, 3])
    device = simulator.Device.random(rng)
    name, sign = str(rng.choice(simulator.CHANNELS)), float(rng.choice([-1.0, 1.0]))
    scene = held(rng, simulator.hand_poses(rng, 12, device), 8, (0.004, 0.002))
    before = 9 if seed % 2 == 0 else 3
    at = float(np.mean([scene.turn[scene.label == label].mean() for label in (before, before + 1)]))
    session = simulator.observe(device, scene, rng, 1.0, (Slip(name, 0.03 * sign, at=at),))
    mechanism = rsicalib.load_mechanism("rsi")
    rest = Readings.from_arrays(mechanism, simulator.rest(device, rng)["values"])
    columns = {key: session[key] for key in ("pose", "time_s")}
    readings = Readings.from_arrays(mechanism, session["values"], **columns)
    found = rsicalib.trace(readings, mechanism, rest=rest)
    assert not found.excluded
    assert [(step.term, step.target) for step in found.steps] == [("slip", name)]


# ------------------------------------------------------------------ p: the tool


@pytest.mark.parametrize("family", ["ballbar", "sockets"])
def test_a_tool_that_sits_elsewhere_is_found(family: str) -> None:
    device, scene, rng = machine(family, 0)
    tool = as_strong(device, scene, CATALOGUE["point_position"](device, rng, "arm"), 300.0)
    found = rsicalib.trace(*given(device, scene, rng, tool))
    assert found.verdict == "explained"
    assert len(found.steps) == 1
    names = {(n.term, n.target) for n in (found.steps[0], *found.steps[0].also_fits)}
    assert ("point_position", "arm") in names


# ------------------------------------------------------------------ q: one equation


def one_equation(term: str, target: str, seed: int, family: str, strength: float) -> Any:
    device, scene, rng = machine(family, seed)
    effect = as_strong(device, scene, CATALOGUE[term](device, rng, target), strength)
    return rsicalib.trace(*given(device, scene, rng, effect))


@pytest.mark.parametrize("seed", range(sized(1, 4)))
@pytest.mark.parametrize(
    ("family", "target"), [("ballbar", "q2"), ("ballbar", "q5"), ("drawwire", "q2")]
)
def test_with_one_equation_the_channel_is_first_or_the_tie_is_said(
    family: str, target: str, seed: int
) -> None:
    found = one_equation("twice_per_turn", target, seed, family, 80.0)
    assert found.steps
    names = (found.steps[0], *found.steps[0].also_fits)
    assert target in {name.target for name in names}


@pytest.mark.parametrize("seed", sized([5], [5, 18, 26]))
def test_what_fits_as_well_is_said(seed: int) -> None:
    """The coupler of a four-bar: told of it, χ² is within 6 of that of what is named instead."""
    device, scene, rng = machine("fourbar", seed)
    effect = as_strong(device, scene, CATALOGUE["distance"](device, rng, "coupler"), 120.0)
    readings, mechanism = given(device, scene, rng, effect)
    found = rsicalib.trace(readings, mechanism)
    told = rsicalib.calibrate(readings, mechanism, terms=["offset", "distance@coupler"])
    assert len(found.steps) == 1
    assert told.fit.chi2 is not None and found.after.chi2 is not None
    assert told.fit.chi2 < found.after.chi2 + 6.0
    names = {(n.klass, n.target) for n in (found.steps[0], *found.steps[0].also_fits)}
    assert ("closure", "coupler") in names


# ------------------------------------------------------------------ r: no such candidates


def targets(mechanism: Mechanism, term: str) -> list[str]:
    (own,) = (t for t in rsicalib.terms(mechanism) if t["id"] == term)
    return list(own["targets"])


def test_encoders_in_radians_have_no_common_reference() -> None:
    readings, mechanism = given(*machine("ballbar", 0))
    found = rsicalib.trace(readings, mechanism)
    assert not [h for h in found.could_hide if h.term.startswith("reference")]
    assert "reference_drift" not in found.not_candidates  # nothing is lacking to look for one
    assert "link masses" in found.not_candidates["joint_compliance"]


@pytest.mark.parametrize("term", ["once_per_turn", "twice_per_turn"])
def test_a_slide_has_no_turns(term: str) -> None:
    device, _, _ = machine("gantry", 0)
    mechanism = Mechanism.from_toml(toml(device))
    assert targets(mechanism, term) == ["t1", "t2", "t3", "w2"]


# ------------------------------------------------------------------ seen on the way


@pytest.mark.filterwarnings("ignore::rsicalib.errors.OpenLoopsWarning")  # they do not close
def test_a_slip_does_not_keep_a_calibration_from_other_readings() -> None:
    """A term bound to its session is left out, also where other readings have fewer poses."""
    device, scene, rng = machine("fourbar", 0)
    slip = as_strong(device, scene, CATALOGUE["slip"](device, rng, "crank"), 150.0)
    readings, mechanism = given(device, scene, rng, slip)
    found = rsicalib.trace(readings, mechanism)
    assert [step.term for step in found.steps] == ["slip"]
    few = readings.select(readings.pose <= 5)
    assert rsicalib.forward(few, mechanism, found).shape == (len(few), 6)


def with_a_bad_pose(seed: int) -> tuple[Readings, Mechanism, int]:
    """One equation a pose, and one channel that is wrong in one of the poses."""
    device, scene, rng = machine("ballbar", seed)
    wrong = as_strong(device, scene, bad(device, rng, scene, "pose"), 150.0)
    return *given(device, scene, rng, wrong), int(scene.label[wrong.rows[0]])


@pytest.mark.parametrize("seed", range(sized(1, 2)))
def test_a_bad_reading_leaves_the_rest_determined(seed: int) -> None:
    """With one equation a pose what is left out takes the equation with it."""
    readings, mechanism, pose = with_a_bad_pose(seed)
    found = rsicalib.calibrate(readings, mechanism)
    assert [entry.pose for entry in found.excluded] == [pose]
    assert not found.unobservable
    assert found.exit_code == 0


@both
def test_a_pose_that_is_left_out_costs_its_equations_and_no_more(verb: Any) -> None:
    readings, mechanism, pose = with_a_bad_pose(0)
    found = verb(readings, mechanism)
    assert [entry.pose for entry in found.excluded] == [pose]
    good = rsicalib.calibrate(readings.select(readings.pose != pose), mechanism)
    assert found.quality.dof == pytest.approx(good.fit.dof)
