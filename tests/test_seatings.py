"""Play of a closure is one draw for each seating: repeats of a seating tell the readings alone.

Witness: an arm in products of plain matrices (`tests/cone.py`), and the covariance of all samples
of a seating written out as one matrix.
"""

from __future__ import annotations

import csv
from typing import Any

import numpy as np
import pytest

import rsicalib
from rsicalib import DEMO, Mechanism
from rsicalib.results.result import Calibration, Trace
from tests import cone
from tests.full import sized
from tests.oracle import Array

SIGMA, PLAY = 2e-5, 0.02


def mechanism(noise: float | None, play: float | None) -> Mechanism:
    return Mechanism.from_toml(cone.mechanism(noise, play))


def offsets(found: Calibration | Trace) -> tuple[Array, Array]:
    """Offsets of joints 2 to 6, and their standard deviations."""
    own = {p.target: p for p in found.parameters if p.term == "offset"}
    each = [own[f"q{k}"] for k in range(2, 7)]
    return np.array([p.value for p in each]), np.array([p.sd for p in each])


def test_the_slopes_of_the_witness_are_its_differences() -> None:
    q = np.array([0.4, -1.4, -1.6, -1.5, 1.5, 0.3])
    steps = 1e-6 * np.eye(6)
    apart = np.column_stack([(cone.tip(q + h) - cone.tip(q - h)) / 2e-6 for h in steps])
    # Rounding: 500 mm, sixteen digits, over the step.
    np.testing.assert_allclose(cone.slopes(q), apart, atol=1e-6)


@pytest.mark.parametrize("declared", [None, SIGMA])
def test_repeats_of_a_seating_do_not_scale_its_play(declared: float | None) -> None:
    taken = cone.session(1)
    found = rsicalib.calibrate(taken.table, mechanism(declared, PLAY))
    assert found.verdict == "adequate"
    # 111 degrees of freedom: three standard deviations of χ² over its expectation are 0.4.
    assert found.fit.chi2 is not None
    assert abs(found.fit.chi2 / 111 - 1.0) < 0.4
    # 840 degrees of freedom within poses: the noise is known to 2.4 %.
    assert found.noise is not None
    assert found.noise.sigma["q3"] == pytest.approx(SIGMA, rel=0.08)
    assert not {"coarse", "noise"} & {w.kind for w in found.warnings}
    value, sd = offsets(found)
    # The noise, and with it a part of the variance, is estimated to a few percent.
    assert sd == pytest.approx(cone.bound(taken.angles, 8, SIGMA, PLAY), rel=0.03)
    assert np.all(np.abs(value - cone.OFFSETS[1:]) < 4.0 * sd)


def test_more_samples_of_a_seating_make_it_no_surer_than_its_play() -> None:
    few, many = cone.session(2, samples=4), cone.session(2, samples=32)
    of = [offsets(rsicalib.calibrate(s.table, mechanism(None, PLAY)))[1] for s in (few, many)]
    assert of[1] == pytest.approx(of[0], rel=0.1)


def test_joints_that_stand_still_leave_the_play_to_judge() -> None:
    taken = cone.session(3, sigma=0.0)
    found = rsicalib.calibrate(taken.table, mechanism(None, PLAY))
    assert found.verdict == "adequate"
    value, sd = offsets(found)
    assert sd == pytest.approx(cone.bound(taken.angles, 1, 1e-9, PLAY), rel=0.03)
    assert np.all(np.abs(value - cone.OFFSETS[1:]) < 4.0 * sd)


@pytest.mark.parametrize("sigma", [0.0, SIGMA])
def test_a_seating_that_nobody_declares_is_told_by_the_fit_and_judges_nothing(sigma: float) -> None:
    taken = cone.session(4, sigma=sigma)
    for verb in (rsicalib.calibrate, rsicalib.trace):
        found = verb(taken.table, mechanism(None, None))
        assert found.verdict == "unjudged"
        value, sd = offsets(found)
        # The play is estimated from 111 degrees of freedom, to 7 %.
        assert sd == pytest.approx(cone.bound(taken.angles, 8, sigma + 1e-9, PLAY), rel=0.25)
        assert np.all(np.abs(value - cone.OFFSETS[1:]) < 4.0 * sd)


def test_few_poses_whose_noise_only_the_fit_gives_contradict_nothing() -> None:
    """Of 12 equations for 8 unknowns a pose that is left out takes 3 of the 4 that are too many."""
    for seed in range(sized(6, 12)):
        found = rsicalib.calibrate(cone.session(seed, poses=4).table, mechanism(None, None))
        assert (found.verdict, found.reasons) == ("unjudged", ())


def test_where_nothing_that_moves_the_ball_was_fitted_no_error_is_predicted() -> None:
    taken = cone.session(3, poses=10)
    found = rsicalib.calibrate(taken.table, Mechanism.from_toml(cone.mechanism(None, PLAY, "[]")))
    assert found.predicted is None and "should be right" not in found.summary()


def test_an_exact_closure_that_nobody_declares_is_judged_by_the_readings() -> None:
    taken = cone.session(5, play=0.0)
    found = rsicalib.calibrate(taken.table, mechanism(None, None))
    # 111 degrees of freedom: four standard deviations.
    assert found.fit.p_value is not None and found.fit.p_value > 1e-4
    value, sd = offsets(found)
    assert sd == pytest.approx(cone.bound(taken.angles, 8, SIGMA, 1e-9), rel=0.05)
    # Whole turns of a joint change nothing.
    off = np.angle(np.exp(1j * (value - cone.OFFSETS[1:])))
    assert np.all(np.abs(off) < 4.0 * sd)


def rows(taken: cone.Seatings, without: str, numbered: bool) -> dict[str, Any]:
    """The table without a column, with the number of each sample in its pose where asked for."""
    table: dict[str, Any] = {k: v for k, v in taken.table.items() if k != without}
    if numbered:
        table["sample"] = [1 + k % 8 for k in range(len(taken.table["pose"]))]
    return table


@pytest.mark.parametrize(
    ("wrong", "poses", "meant"),
    [("Bench", 3, "bench"), ("bnech", 1, "bench"), ("bench2", 1, ""), ("rack", 1, "")],
)
def test_a_label_that_looks_misspelt_is_said(wrong: str, poses: int, meant: str) -> None:
    """Each text is a place of its own: of a place that was touched once nothing can be told."""
    taken = cone.session(6, poses=12)
    at = np.array(["bench"] * len(taken.table["pose"]), dtype=object)
    at[np.isin(taken.table["pose"], np.unique(taken.table["pose"])[3 : 3 + poses])] = wrong
    loaded = rsicalib.load_readings({**taken.table, "at": at.tolist()}, mechanism(None, PLAY))
    said = [warning.text for warning in loaded.warnings if warning.kind == "labels"]
    assert len(said) == bool(meant)
    assert all(f"column at: {wrong!r} (" in text and f"than {meant!r}" in text for text in said)


def test_repeats_without_the_column_pose_are_said() -> None:
    taken = cone.session(6, poses=12)
    own = mechanism(None, PLAY)
    for numbered, said in ((True, "sample begins again 11 times"), (False, "12 groups")):
        loaded = rsicalib.load_readings(rows(taken, "pose", numbered), own)
        (warning,) = (w for w in loaded.warnings if w.kind == "unlabelled_repeats")
        assert said in warning.text
    assert not rsicalib.load_readings(rows(taken, "", True), own).warnings


@pytest.mark.parametrize("without", [["pose"], ["pose", "sample"], ["pose", "sample", "time_s"]])
def test_repeats_without_the_column_pose_are_judged_as_with_it(without: list[str]) -> None:
    """Row by row the demo's session was adequate (p = 0.0055), or nothing judged it."""
    with (DEMO / "readings.csv").open(encoding="utf-8") as file:
        rows = list(csv.DictReader(file))
    table = {name: [float(row[name]) for row in rows] for name in rows[0] if name not in without}
    whole = rsicalib.calibrate(DEMO / "readings.csv", rest=DEMO / "rest.csv")
    found = rsicalib.calibrate(table, rest=DEMO / "rest.csv")
    assert found.verdict == whole.verdict == "unexplained"
    assert (found.fit.chi2, found.fit.dof) == (whole.fit.chi2, whole.fit.dof)
    assert found.noise == whole.noise
    assert found.readings.poses == whole.readings.poses
    assert [w.kind for w in found.warnings] == ["unlabelled_repeats"]


def test_a_counter_that_begins_again_in_a_motion_makes_no_repeats() -> None:
    t = np.linspace(0.0, 2.0 * np.pi, 400)[:, None]
    angles = np.sin(t * [1.0, 2.0, 3.0, 1.5, 2.5, 0.5]) - 1.55 * (np.arange(6) == 1)
    table = {f"q{k + 1}": angles[:, k] for k in range(6)} | {"at": ["cone"] * 400}
    for count in (2, 8, 100):
        numbers = np.arange(400) % count
        loaded = rsicalib.load_readings({**table, "sample": numbers}, mechanism(None, PLAY))
        assert loaded.repeats is None
        (warning,) = (w for w in loaded.warnings if w.kind == "unlabelled_repeats")
        assert "the readings move on in between" in warning.text


def test_held_poses_with_a_number_for_every_sample_are_said() -> None:
    taken = cone.session(6, poses=12)
    own = mechanism(None, PLAY)
    table = {**taken.table, "sample": np.tile(np.arange(1, 9), 12)}
    apart = {**table, "pose": np.arange(1, 97)}
    (warning,) = rsicalib.load_readings(apart, own).warnings
    assert warning.kind == "unlabelled_repeats"
    assert "sample begins again 11 times" in warning.text
    assert not rsicalib.load_readings(table, own).warnings


def test_one_number_for_all_poses_is_said() -> None:
    taken = cone.session(6, poses=12)
    own = mechanism(None, PLAY)
    table = {**taken.table, "pose": np.ones(96)}
    (warning,) = rsicalib.load_readings(table, own).warnings
    assert warning.kind == "moved_pose" and "all rows are of pose 1" in warning.text


@pytest.mark.parametrize("kind", ["single poses", "motion", "counts that stand still"])
def test_rows_that_are_no_repeats_are_not_said_to_be(kind: str) -> None:
    rng = np.random.default_rng(7)
    t = np.linspace(0.0, 2.0 * np.pi, 400)[:, None]
    wave = np.sin(t * [1.0, 2.0, 3.0, 1.5, 2.5, 0.5])
    angles = {
        "single poses": rng.uniform(-1.0, 1.0, (60, 6)),
        "motion": wave + 1e-5 * rng.standard_normal(wave.shape),
        "counts that stand still": np.rint(30.0 * wave) / 30.0,
    }[kind]
    table = {f"q{k + 1}": angles[:, k] - 1.55 * (k == 1) for k in range(6)}
    loaded = rsicalib.load_readings({**table, "at": ["cone"] * len(angles)}, mechanism(None, PLAY))
    assert "unlabelled_repeats" not in {w.kind for w in loaded.warnings}


def tracked(trembling: bool) -> tuple[dict[str, Array], Mechanism]:
    """Readings of the hand controller, free of noise, and the poses that it is in."""
    device = rsicalib.simulate(poses=6, samples=1, check=40, seed=3, noise=1e-9).check
    assert device.poses is not None
    table = {name: device.values[:, k] for k, name in enumerate(device.channels)}
    own = {name: device.poses[:, k] for k, name in enumerate(("x", "y", "z", "rx", "ry", "rz"))}
    # Five samples of each pose: they differ as only a hand that wanders would differ.
    label = np.arange(40) // 5 if trembling else np.arange(40)
    return {**table, **own, "pose": label + 1.0}, rsicalib.load_mechanism("rsi")


def test_a_known_pose_of_each_sample_is_compared_with_that_sample() -> None:
    session = rsicalib.simulate(seed=3, noise=1e-9)
    errors = []
    for trembling in (False, True):
        known, own = tracked(trembling)
        found = rsicalib.calibrate(session.readings, own, rest=session.rest, check=known)
        assert found.fit.check is not None
        assert found.fit.check.poses == (8 if trembling else 40)
        errors.append(found.fit.check.position_rms)
    assert errors[1] == pytest.approx(errors[0], rel=1e-9)


@pytest.mark.parametrize("play", [PLAY, None])
def test_a_pose_of_many_samples_is_one_seating(play: float | None) -> None:
    """One pose with 500 samples among 39 with four: a seating is one, however often it is read.

    Weighed by samples, 28 of 48 good readings stood off beside 100 of one pose, 44 beside 300.
    """
    taken = cone.session(4, samples=4)
    q = taken.angles[3] - cone.OFFSETS
    more = q + SIGMA * np.random.default_rng(0).standard_normal((496, 6))
    table: dict[str, Any] = {name: list(column) for name, column in taken.table.items()}
    after = 4 * 4  # behind the samples of the fourth pose
    for name in table:
        own = {"pose": [4] * 496, "at": ["cone"] * 496}
        column = own.get(name) or more[:, int(name[1:]) - 1].tolist()
        table[name][after:after] = column
    few = rsicalib.calibrate(taken.table, mechanism(SIGMA, play))
    many = rsicalib.calibrate(table, mechanism(SIGMA, play))
    assert (many.verdict, many.excluded) == (few.verdict, ())
    before, sd = offsets(few)
    # One of 120 equations is better known by its readings, which make a tenth of what is left.
    assert np.all(np.abs(offsets(many)[0] - before) < 0.5 * sd)
    assert offsets(many)[1] == pytest.approx(sd, rel=0.1)


@pytest.mark.parametrize("seed", sized([71], [71, 72]))
def test_a_turn_about_the_normal_of_a_level_table_is_a_convention(seed: int) -> None:
    """It hardly moves the table: what it shares with the tilts is no noise of joint 1."""
    taken = cone.on_a_table(seed)
    found = rsicalib.calibrate(taken.table, Mechanism.from_toml(cone.at_a_table(2e-5, 0.02)))
    assert found.verdict == "adequate"
    sd, ball = cone.sd_at_a_table(taken.angles, 2e-5, 0.02)
    got, own = offsets(found)
    # To what the readings differ from the truth by.
    np.testing.assert_allclose(own, sd, rtol=0.05)
    assert found.predicted is not None
    assert found.predicted.position_sd == pytest.approx(ball, rel=0.2)  # 16 of the poses
    assert np.all(np.abs(got - cone.OFFSETS[1:]) < 4.5 * sd)


def test_groups_that_were_not_fitted_are_held_against_the_fitted_ones() -> None:
    """Of the arm that has changed before the other cone, and of the one that has not."""
    text = cone.mechanism(2e-5, 0.02)
    elsewhere = np.array([-380.0, 260.0, 160.0])
    for bend, verdict in ((0.0, "adequate"), (0.004, "unexplained")):
        a = cone.session(81, samples=2).table
        b = cone.session(82, samples=2, bend=bend, at="other", cone=elsewhere).table
        b["pose"] = [float(pose) + 1000 for pose in b["pose"]]
        both = {name: [*a[name], *b[name]] for name in a}
        both["group"] = both["at"]
        found = rsicalib.calibrate(both, Mechanism.from_toml(text), fit_groups=["cone"])
        assert found.verdict == verdict
        assert [reason.kind for reason in found.reasons] == ["groups"][: int(bend > 0)]
        assert found.groups.others > found.groups.fitted or bend == 0.0


@pytest.mark.parametrize("declared", [0.05, None])
def test_a_point_that_is_measured_in_every_sample_has_noise_in_every_sample(
    declared: float | None,
) -> None:
    """A tracker draws anew where a seating does not: 8 samples tell as much as 8 places."""
    taken = cone.session(91, poses=30, samples=8, play=20.0)
    rng = np.random.default_rng(91)
    places = np.repeat([cone.tip(q) for q in taken.angles], 8, axis=0)
    places = places + 0.05 * rng.standard_normal(places.shape)
    table = {**taken.table, **dict(zip("xyz", places.T.tolist(), strict=True))}
    text = cone.mechanism(2e-5, declared).replace('unknown = ["at"]', 'columns = ["x", "y", "z"]')
    found = rsicalib.calibrate(table, Mechanism.from_toml(text))
    assert (found.verdict, found.excluded) == ("adequate", ())
    # χ² of 84 equations has a standard deviation of 13.
    assert abs(found.fit.chi2 - found.fit.dof) < 4 * np.sqrt(2 * found.fit.dof)
    got, own = offsets(found)
    information = np.zeros((6, 6))
    for q in taken.angles:
        a = cone.slopes(q)
        information += 8 * a.T @ np.linalg.solve(0.05**2 * np.eye(3) + 4e-10 * a @ a.T, a)
    sd = np.sqrt(np.diag(np.linalg.inv(information)))[1:]
    np.testing.assert_allclose(own, sd, rtol=0.1)
    assert np.all(np.abs(got - cone.OFFSETS[1:]) < 4.5 * sd)


def test_a_table_that_nobody_declares_the_noise_of_judges_nothing() -> None:
    """As of a cone: its play is a draw of each touch, and repeats of one say nothing of it."""
    taken = cone.on_a_table(73, samples=4)
    text = cone.at_a_table(None, None)
    for verb in (rsicalib.calibrate, rsicalib.trace):
        found = verb(taken.table, Mechanism.from_toml(text))
        assert (found.verdict, found.excluded) == ("unjudged", ())
    got, own = offsets(rsicalib.calibrate(taken.table, Mechanism.from_toml(text)))
    assert np.all(np.abs(got - cone.OFFSETS[1:]) < 4.5 * own)


@pytest.mark.parametrize("seed", sized([60], list(range(60, 80))))
def test_noise_that_nobody_declares_beside_play_is_told_by_the_fit(seed: int) -> None:
    """Encoders are twenty times as noisy as is presumed: no effect, and nothing to judge one by."""
    taken = cone.session(seed, samples=1, sigma=2e-4)
    found = rsicalib.trace(taken.table, mechanism(None, PLAY))
    assert (found.verdict, found.excluded) == ("unjudged", ())
    assert found.noise is not None
    # 111 degrees of freedom: 7 %.
    assert found.noise.kind == "fit"
    assert found.noise.sigma["q3"] == pytest.approx(2e-4, rel=0.3)


def test_what_is_declared_as_known_is_held_against_the_readings() -> None:
    """Offsets of ten milliradians that are declared to one, and cones 4 mm farther apart."""
    taken = cone.session(91, samples=2)
    tight = mechanism(SIGMA, PLAY).to_dict()
    tight["model"]["sd"] = {"offset": 1e-3}
    other = np.array([-380.0, 260.0, 160.0])
    b = cone.session(92, samples=2, at="other", cone=other).table
    b["pose"] = [float(pose) + 1000 for pose in b["pose"]]
    both = {name: [*taken.table[name], *b[name]] for name in b}
    ends = ["cone[at=cone]", "cone[at=other]"]
    apart = float(np.linalg.norm(other - cone.CONE))
    sessions = [(taken.table, tight, "q")]
    for off, target in ((0.0, ""), (4.0, "bar")):
        bar = {"name": "bar", "kind": "distance", "between": ends, "value": apart + off}
        drawn = mechanism(SIGMA, PLAY).to_dict()
        sessions.append((both, drawn | {"closure": [*drawn["closure"], bar]}, target))
    for table, drawn, target in sessions:
        found = rsicalib.calibrate(table, Mechanism.from_dict(drawn))
        told = [w.target for w in found.warnings if w.kind == "knowledge"]
        assert len(told) == (target != "")
        assert all(str(name).startswith(target) for name in told)
    bar = {"name": "bar", "kind": "distance", "between": ["cone[at=Cone]", ends[1]], "value": 1.0}
    drawn = mechanism(SIGMA, PLAY).to_dict()
    drawn["closure"] = [*drawn["closure"], bar]
    found = rsicalib.calibrate(both, Mechanism.from_dict(drawn))
    assert [w.target for w in found.warnings if w.kind == "unused"] == ["bar"]


def test_an_arm_whose_lengths_may_all_be_zero_is_refused() -> None:
    drawn = mechanism(SIGMA, PLAY).to_dict()
    drawn["point"][0]["at"] = [0.0, 0.0, 0.0]
    own = [f"link_length@arm/{k}" for k in (2, 3)] + [f"link_offset@arm/{k}" for k in (4, 5, 6)]
    drawn["model"]["terms"] = ["offset", *own]
    with pytest.raises(rsicalib.InputError, match="may all be zero"):
        rsicalib.calibrate(cone.session(93, samples=1).table, Mechanism.from_dict(drawn))
