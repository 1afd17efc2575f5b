"""One verdict, by everything that is known: what speaks against a result, and what is no failure.

Sessions are simulated by `tests.blind` and in plain matrix products, which share nothing with the
core.
"""

from __future__ import annotations

from dataclasses import replace
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import scipy.stats

import rsicalib
from rsicalib import DEMO, Readings
from rsicalib.facts.shapes import Reason
from tests import clean, oracle, simulated
from tests.blind import simulator, trials
from tests.blind.effects.sensor import Slip
from tests.blind.scene import held
from tests.blind.simulator import Device
from tests.blind.trials import Case
from tests.full import sized
from tests.machines import delta, files
from tests.test_examples import EXAMPLES, read_mechanism, sockets

both = pytest.mark.parametrize("verb", [rsicalib.calibrate, rsicalib.trace])


def said(verb: Any, case: Case, **options: Any) -> Any:
    """What a verb says of a case, its check poses included."""
    it = trials.given(case)
    return verb(it.readings, it.mechanism, rest=it.rest, check=it.check, **options)


@cache
def sound(verb: Any) -> Any:
    """What a verb says of a clean session that several tests spoil."""
    return said(verb, trials.staged([31, 0]))


def fit_of(result: Any) -> Any:
    return result.fit if isinstance(result, rsicalib.Calibration) else result.after


# ------------------------------------------------------------------ check poses


@both
def test_check_poses_have_a_chi2_of_their_own(verb: Any) -> None:
    """Of clean sessions its p-values are uniform: a mean of 20 is known to 0.065."""
    p = []
    for number in range(sized(6, 20)):
        found = said(verb, trials.staged([31, number])) if number else sound(verb)
        against = fit_of(found).check.predicted
        assert against.dof > 1.0
        p.append(against.p_value)
    assert abs(np.mean(p) - 0.5) < 4 * np.sqrt(1 / 12 / len(p))
    assert min(p) > 1e-4


@both
def test_check_poses_beyond_what_is_predicted_contradict(verb: Any) -> None:
    """Each known pose is nine predicted standard deviations off along x."""
    case = trials.staged([31, 0])
    clean = sound(verb)
    assert (clean.verdict, clean.reasons) == ("adequate", ())
    poses = np.array(case.check["poses"], copy=True)
    poses[:, 0] += 9.0 * fit_of(clean).check.predicted.position_sd
    found = said(verb, replace(case, check={**case.check, "poses": poses}))
    assert (found.verdict, found.exit_code) == ("unexplained", 4)
    assert "check" in [reason.kind for reason in found.reasons]
    assert found.summary().splitlines()[0].startswith("Contradicted: check poses are off by")
    assert fit_of(found).p_value == fit_of(clean).p_value


@both
def test_one_check_pose_that_is_off_by_itself_contradicts(verb: Any) -> None:
    """The others share the errors of the parameters, among which it is lost."""
    case = trials.staged([31, 0])
    sd = fit_of(sound(verb)).check.predicted.position_sd
    poses = np.array(case.check["poses"], copy=True)
    of_one = np.asarray(case.check["pose"]) == np.asarray(case.check["pose"])[-1]
    poses[of_one, 0] += 12.0 * sd
    found = said(verb, replace(case, check={**case.check, "poses": poses}))
    assert found.verdict == "unexplained"
    assert [reason.kind for reason in found.reasons] == ["check_pose"]
    worst = fit_of(found).check.predicted.worst
    assert worst.pose == found.reasons[0].pose == np.asarray(case.check["pose"])[-1]
    # Of three coordinates one is off by 12, and noise is beside that.
    assert worst.position_rms == pytest.approx(12.0 / np.sqrt(3) * sd, rel=0.3)
    assert worst.p_value < 1e-6


@both
def test_one_check_pose_that_is_so_far_off_that_all_are_is_the_one_that_is_told(verb: Any) -> None:
    """Of the others the error is as predicted: it is that of the session as it was simulated."""
    case = trials.staged([31, 0])
    clean = fit_of(sound(verb)).check.predicted
    poses = np.array(case.check["poses"], copy=True)
    labels = np.asarray(case.check["pose"])
    poses[labels == labels[0], 1] += 300.0 * clean.position_sd
    found = said(verb, replace(case, check={**case.check, "poses": poses}))
    (reason,) = found.reasons
    assert (reason.kind, reason.pose) == ("check_pose", labels[0])
    assert f"check pose {labels[0]} alone is off by" in found.summary().replace("\n", " ")
    off = fit_of(found).check.predicted
    assert off.p_value < 1e-6
    assert off.worst.others_p_value == pytest.approx(clean.p_value, abs=0.2)
    # Two that are off are no single one.
    poses[labels == labels[-1], 1] += 300.0 * clean.position_sd
    found = said(verb, replace(case, check={**case.check, "poses": poses}))
    assert [reason.kind for reason in found.reasons] == ["check"]


@both
@pytest.mark.parametrize("how", ["millimetres", "degrees", "moved", "order"])
def test_known_poses_that_are_misread_are_said_to_be(verb: Any, how: str) -> None:
    """With the unit or the order that is meant they agree; the reason is of what is off most."""
    case = trials.staged([31, 0])
    poses = np.array(case.check["poses"], copy=True)
    if how == "millimetres":
        poses[:, :3] *= 25.4
    elif how == "degrees":
        poses[:, 3:] = np.degrees(poses[:, 3:])
    elif how == "moved":
        poses[:, 0] += 12.0
    else:
        poses = np.roll(poses, 8, axis=0)  # samples of a pose
    found = said(verb, replace(case, check={**case.check, "poses": poses}))
    (warning,) = (w for w in found.warnings if w.kind == "known_poses")
    words = {"millimetres": "25.4 times", "degrees": "in radians", "order": "another order"}
    words["moved"] = "--align"
    assert words[how] in warning.text
    reasons = [reason for reason in found.reasons if reason.kind.startswith("check")]
    own = fit_of(found).check
    if how == "degrees":
        assert [reason.kind for reason in reasons] == ["check_orientation"]
        assert reasons[0].found == own.orientation_rms
        assert reasons[0].expected == own.predicted.orientation_sd
        assert " rad" in found.summary().splitlines()[0]
    assert found.exit_code == 4
    assert "known_poses" not in {w.kind for w in sound(verb).warnings}


def test_the_first_line_is_of_the_reason_that_says_most() -> None:
    """Of the demo, which lacks an effect, poses left out in turn were said to contradict."""
    found = rsicalib.calibrate(DEMO / "readings.csv", rest=DEMO / "rest.csv")
    assert [reason.kind for reason in found.reasons] == ["residual", "held_out"]
    assert found.summary().startswith("The residual is significant (χ² 216 for 126")
    assert "rsicalib trace" in found.summary()


@pytest.mark.parametrize(
    ("pose", "channel", "counts"), [(30, 0, -900.0), *sized([], [(17, 2, 700.0)])]
)
def test_one_wrong_pose_leaves_the_others_to_be_judged(
    pose: int, channel: int, counts: float
) -> None:
    """No start closes the loops with it; without it all that the demo has is found."""
    session = rsicalib.load_readings(DEMO / "readings.csv")
    values = session.values.copy()
    values[session.pose == pose, channel] += counts
    found = rsicalib.trace(replace(session, values=values), rest=DEMO / "rest.csv")
    assert {gone.pose for gone in found.excluded} == {pose}
    assert (found.verdict, [step.target for step in found.steps]) == ("explained", ["a22"])
    assert "no_start" not in {warning.kind for warning in found.warnings}


@both
def test_a_calibration_that_makes_known_points_worse_has_exit_4(verb: Any) -> None:
    """A device that is as drawn, and a dozen poses with 20 counts of noise."""
    rng = np.random.default_rng(3)
    nominal = Device(*as_drawn())
    scene = held(rng, simulator.hand_poses(rng, 12, nominal), 2, (0.0, 0.0))
    case = trials.recorded("chosen", 0, nominal, scene, rng, (), sigma=20.0)
    found = said(verb, case)
    nominal_error, own = found.nominal.check.position_rms, fit_of(found).check.position_rms
    assert own > 2.0 * nominal_error
    assert found.exit_code == 4
    assert found.reasons[0].kind == "check_declared"
    assert (found.reasons[0].found, found.reasons[0].expected) == (own, nominal_error)
    assert "with the mechanism as it is declared" in found.summary().splitlines()[0]


def as_drawn() -> Any:
    return oracle.nominal(oracle.rsi())


def test_the_open_loop_is_judged_by_check_poses_as_well() -> None:
    """A device that is as drawn, the poses of its fixture off by 0.1 in."""
    rng = np.random.default_rng(5)
    nominal = Device(*as_drawn())
    scene = held(rng, simulator.hand_poses(rng, 12, nominal, corner=0.2), 2, (0.0, 0.0))
    it = trials.given(trials.recorded("chosen", 0, nominal, scene, rng, ()))
    off = 0.1 * rng.standard_normal((12, 6)) * [1, 1, 1, 0.1, 0.1, 0.1]
    fixture = replace(
        it.readings, poses=np.clip(scene.pose, -4, 4) + off[scene.label - scene.label[0]]
    )
    found = rsicalib.fixture(fixture, it.mechanism)
    assert (found.verdict, found.reasons) == ("unjudged", ())
    found = rsicalib.fixture(fixture, it.mechanism, check=it.check)
    assert (found.verdict, found.exit_code) == ("unexplained", 4)
    assert [reason.kind for reason in found.reasons] == ["check_declared"]
    assert "with the mechanism as it is declared" in found.summary().splitlines()[0]


# ------------------------------------------------------------------ one number for one residual


@pytest.mark.parametrize("number", range(sized(1, 6)))
def test_one_residual_has_one_probability(number: int) -> None:
    found = said(rsicalib.trace, trials.make("single", number, 0))
    assert found.unexplained is not None
    assert found.unexplained.p_value == found.after.p_value


def test_clean_sessions_are_called_adequate() -> None:
    """The small form of `python -m tests.clean`: one in a hundred is called otherwise, of 6 more
    than 1 once or twice in 1000, of 24 more than 3 once or twice in 10,000."""
    called = [one for one in map(clean.judged, range(sized(6, 24))) if one.called]
    assert len(called) <= sized(1, 3)


# ------------------------------------------------------------------ nothing absurd is explained


def test_random_readings_are_not_explained() -> None:
    """Random codes in 40 poses: whatever seems to explain them means nothing."""
    mechanism = rsicalib.load_mechanism("rsi")
    for seed in range(sized(1, 3)):
        codes = np.random.default_rng(seed).integers(300, 3800, (40, 9)).astype(float)
        readings = Readings.from_arrays(mechanism, codes, pose=np.arange(40))
        found = rsicalib.trace(readings, mechanism)
        assert found.steps == ()
        assert found.exit_code in (3, 4)
        assert "per turn" not in found.summary()
        if found.verdict == "implausible":
            assert "Check the wiring" in found.summary()


@pytest.mark.parametrize("seed", sized([3], [3, 4, 6]))
def test_a_curve_is_as_large_as_the_first_of_its_waves_may_be(seed: int) -> None:
    """A ripple that is there was absurd: the whole curve was held against the smallest wave."""
    made = rsicalib.simulate(poses=48, samples=6, check=12, seed=seed)
    channel = rsicalib.Mechanism.rsi().channels[4]

    def rippled(session: Readings) -> Readings:
        values = session.values.astype(float)
        angle = channel.gain * values[:, 4] + channel.offset
        values[:, 4] -= 0.04 * np.sin(5 * angle) / channel.gain
        return replace(session, values=np.rint(values))

    found = rsicalib.trace(rippled(made.readings), check=rippled(made.check))
    step = found.steps[0]
    assert (step.term, step.target, step.applied) == ("free_curve", "a22", True)
    assert max(abs(height) for _, height in step.curve) > 0.03
    assert found.implausible == ()
    assert "absurd" not in [reason.kind for reason in found.reasons]
    assert fit_of(found).check.position_rms < 0.3 * found.before.check.position_rms


# ------------------------------------------------------------------ how sure an effect is


def test_the_probability_of_an_effect_is_that_of_the_rise_without_it(tmp_path: Path) -> None:
    """Two rods that are wrong: two effects explain them together, and neither does alone."""
    rng = np.random.default_rng(1)
    machine = delta.draw(rng)
    machine.values.update({"rod@a": 5.0, "rod@b": -5.0})
    found = rsicalib.trace(*files.write(machine, machine.observe(rng), tmp_path))
    assert len(found.steps) > 1
    for step in found.steps:
        alone = scipy.stats.chi2.sf(step.chi2_rise, len(step.parameters))
        # Some hundred places, each over how common its kind is.
        assert alone <= step.p_value <= max(1e6 * alone, 1e-6)


# ------------------------------------------------------------------ a convention is no failure


@both
def test_what_no_reading_could_show_is_a_convention(verb: Any) -> None:
    """The first joint turns the arm with all that it touches."""
    mechanism, readings, truth = sockets()
    found = verb(readings, mechanism, terms=["offset"])
    assert found.verdict == "adequate"
    assert found["offset@q1"].sd is None
    assert any("offset q1" in text and "no reading can tell" in text for text in found.unobservable)
    without = verb(readings, mechanism, terms=[f"offset@q{k}" for k in range(2, 7)])
    assert without.verdict == "adequate" and not without.unobservable
    assert fit_of(found).dof == pytest.approx(fit_of(without).dof)
    assert fit_of(found).chi2 == pytest.approx(fit_of(without).chi2, rel=1e-4)
    for name in truth:
        now, then = found[f"offset@{name}"], without[f"offset@{name}"]
        assert now.value == pytest.approx(then.value, abs=0.02 * then.sd)
        assert now.sd == pytest.approx(then.sd, rel=0.01)


def test_a_residual_is_traced_beside_a_convention() -> None:
    mechanism, readings, _ = sockets()
    values = readings.values.copy()
    values[:, 3] += 0.001 * values[:, 3] ** 2
    bent = replace(readings, values=values).select(np.arange(len(values)) % sized(2, 1) == 0)
    found = rsicalib.trace(bent, mechanism, terms=["offset"])
    assert [(step.term, step.target) for step in found.steps][:1] == [("curvature", "q4")]
    assert found.verdict in ("explained", "partly_explained")


@both
def test_what_other_poses_could_tell_is_undetermined(verb: Any) -> None:
    """A joint that stands still: its offset and its gain are one."""
    mechanism, _, _ = sockets()
    arm = read_mechanism(EXAMPLES / "ball_bar.toml")
    rng = np.random.default_rng(8)
    offsets = np.array([0.0, 0.02, -0.01, 0.015, -0.02, 0.01])
    angles, keys = [], {"group": [], "at": []}
    places = {"front": (450, 0, 150), "left": (150, 420, 200), "high": (300, 250, 500)}
    for group, place in places.items():

        def off(a: Any, at: Any = place) -> Any:
            out = (oracle.point(arm, "ball", a) - np.array(at)) / 100.0
            return np.concatenate([out, a[:, 3:4] - 0.7], axis=1)

        angles.append(simulated.closed(arm, off, 12, rng))
        keys["group"] += [group] * 12
        keys["at"] += ["A"] * 12
    read = simulated.read(arm, np.concatenate(angles), offsets, rng)
    read[:, 3] = 0.7 - offsets[3]
    session = Readings.from_arrays(mechanism, read, keys=keys)
    found = verb(session, mechanism, terms=["offset", "gain"])
    assert (found.verdict, found.exit_code) == ("undetermined", 3)
    assert found.reasons[0].kind == "unobservable"
    assert "What is left: χ²" in " ".join(found.summary().split())


# ------------------------------------------------------------------ order


def test_a_slip_is_named_in_a_session_without_time() -> None:
    case = trials.staged([41, 0], Slip("a21", 0.02))
    it = trials.given(case)
    bare = replace(it.readings, time_s=None)
    found = rsicalib.trace(bare, it.mechanism, rest=it.rest)
    assert [(step.term, step.target) for step in found.steps] == [("slip", "a21")]
    assert found.verdict == "explained"


def test_check_poses_whose_clock_begins_with_the_session_are_taken_after_it() -> None:
    """A sensor slips in the session, and all known poses are read where it has slipped."""
    made = rsicalib.simulate(poses=36, samples=4, check=12, seed=2)
    gain = rsicalib.Mechanism.rsi().channels[4].gain

    def slipped(session: Readings, rows: Any) -> Readings:
        values = session.values.astype(float)
        values[rows, 4] -= 0.03 / gain
        return replace(session, values=np.rint(values))

    readings = slipped(made.readings, made.readings.pose > made.readings.pose[0] + 17)
    check = slipped(made.check, slice(None))
    time = check.time_s - check.time_s[0]
    first, last = readings.time_s[[0, -1]]
    clocks = {
        "none": None,
        "anew": first + time,
        "later": last + 60.0 + time,
        "before": first - 60.0 - time[-1] + time,
    }
    found = {
        name: rsicalib.trace(readings, check=replace(check, time_s=clock))
        for name, clock in clocks.items()
    }
    error = {name: fit_of(one).check.position_rms for name, one in found.items()}
    for name in ("none", "anew", "later"):
        assert found[name].verdict == "explained"
        assert error[name] == pytest.approx(error["none"], rel=1e-9)
    # A clock that all share says that they were read before it slipped.
    assert error["before"] > 3.0 * error["none"]
    said = {
        name: [w.text for w in one.warnings if w.kind == "time_goes_back"]
        for name, one in found.items()
    }
    (text,) = said.pop("anew")
    assert "count as taken after the last session" in text
    assert not any(said.values())


def test_placements_in_any_order_give_the_same_result() -> None:
    """A ball on the tool that moved once, and rows without time: they may be sorted by any name."""
    mechanism, readings, _ = sockets()
    values = readings.values.copy()
    values[80:, 4] += 0.0005
    keys = list(zip(readings.keys["group"], readings.keys["at"], strict=True))
    placements = list(dict.fromkeys(keys))

    def traced(order: list[int]) -> rsicalib.Trace:
        rows = [k for p in order for k, key in enumerate(keys) if key == placements[p]]
        own = {name: [cells[k] for k in rows] for name, cells in readings.keys.items()}
        return rsicalib.trace(Readings.from_arrays(mechanism, values[rows], keys=own), mechanism)

    first = traced(list(range(6)))
    assert {"slip", "tool_slip", "base_slip"} <= set(first.not_candidates)
    assert "order of the placements" in first.not_candidates["slip"]
    for order in ([5, 4, 3, 2, 1, 0], [2, 0, 5, 1, 4, 3]):
        other = traced(order)
        assert other.verdict == first.verdict
        assert [(s.term, s.target) for s in other.steps] == [
            (s.term, s.target) for s in first.steps
        ]
        assert other.after.chi2 == pytest.approx(first.after.chi2, rel=1e-6)
        assert other.groups is not None and first.groups is not None
        assert other.groups.fitted == pytest.approx(first.groups.fitted, rel=1e-6)


# ------------------------------------------------------------------ closing is not accuracy


def test_a_predicted_error_far_above_the_misclosure_is_in_the_first_line() -> None:
    """Of sound sessions it is 0.2 to 1.6 times the misclosure, of arms and of hand controllers."""
    found = sound(rsicalib.calibrate)
    assert found.predicted is not None and found.fit.rms_misclosure is not None
    assert found.summary().startswith("Adequate: ")
    far = replace(found.predicted, position_sd=20.0 * found.fit.rms_misclosure)
    first = replace(found, predicted=far).summary()
    assert first.startswith("Adequate, yet the platform is predicted to err by ")


def two_arms(seed: int, play: float) -> tuple[rsicalib.Mechanism, dict[str, Any]]:
    """Two arms, as drawn but for offsets, whose tips touch in eight poses to within a play."""
    own = read_mechanism(EXAMPLES / "two_arms.toml")
    for channel in own["channel"]:
        channel["limits"] = [-2.5, 2.5]
    rng = np.random.default_rng(seed)

    def off(angles: Any) -> Any:
        return oracle.point(own, "left1", angles) - oracle.point(own, "right1", angles)

    angles = simulated.closed(own, off, 8, rng)
    inverse = np.linalg.pinv(simulated.derivative(off, angles))
    angles -= np.einsum("nij,nj->ni", inverse, rng.normal(0.0, play, (8, 3)))
    values = simulated.read(own, angles, rng.normal(0.0, 0.01, 12), rng)
    text = (EXAMPLES / "two_arms.toml").read_text()
    first, last = text.index("closure = ["), text.index("]\n[[chain]]")
    touch = '{name = "tips", kind = "touch", between = ["left1", "right1"], '
    text = f"{text[:first]}closure = [{touch}noise = {play}}}{text[last:]}"
    columns = {c["name"]: values[:, k] for k, c in enumerate(own["channel"])}
    return rsicalib.Mechanism.from_toml(text), {"pose": np.arange(8), **columns}


@both
def test_readings_that_tell_less_than_the_drawing_determine_nothing(verb: Any) -> None:
    """Offsets that are 0.05 rad off, as offsets may be, put points of these arms 30 mm off."""
    mechanism, table = two_arms(11, 60.0)
    found = verb(table, mechanism)
    assert (found.verdict, found.exit_code) == ("undetermined", 3)
    (reason,) = found.reasons
    assert reason.kind == "predicted"
    assert reason.found == found.predicted.position_sd
    assert reason.expected == pytest.approx(drawn_error(table), rel=0.05)
    first = " ".join(found.summary().split("\n\n")[0].split())
    assert f"predicted to err by {reason.found:.0f} mm, and by {reason.expected:.0f} mm" in first
    # What tells more than the drawing, be it not much more, is a calibration.
    mechanism, table = two_arms(11, 10.0)
    found = verb(table, mechanism)
    assert (found.verdict, found.exit_code) == ("adequate", 0)


def drawn_error(table: dict[str, Any]) -> float:
    """What offsets with a standard deviation of 0.05 rad do to a coordinate of the arms' points."""
    own = read_mechanism(EXAMPLES / "two_arms.toml")
    angles = np.stack([table[c["name"]] for c in own["channel"]], axis=1)

    def places(angles: Any) -> Any:
        return np.concatenate([oracle.point(own, p["name"], angles) for p in own["point"]], axis=1)

    slope = simulated.derivative(places, angles)
    return float(0.05 * np.sqrt(np.sum(slope**2, axis=2).mean()))


def test_what_is_predicted_to_be_worse_than_as_drawn_says_so() -> None:
    """Three known poses that are no better off vouch for nothing: `verdict.rs` tests when."""
    found = said(rsicalib.calibrate, trials.staged([31, 0]))
    reason = Reason("predicted_declared", 62.0, 5.0)
    first = replace(found, verdict="unexplained", reasons=(reason,)).summary()
    assert " ".join(first.split()).startswith(
        "Contradicted: check poses are predicted to be off by 62.0 in; 5.00 in is their error "
        "with the mechanism as it is declared"
    )
    assert "Do not use it" in first
