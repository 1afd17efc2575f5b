"""Poses beside a result: λ and variances against numpy on `tests/oracle.py`; an experiment."""

from __future__ import annotations

import csv
import io
import json
from dataclasses import replace
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import rsicalib
from rsicalib import DEMO, InputError, _core
from rsicalib.facts.records import plain
from rsicalib.planning.further import Sessions, explanations
from rsicalib.planning.plan import Plan, plan
from tests import oracle
from tests.blind import effects, planning, simulator
from tests.blind.scene import SESSION_S, held, room
from tests.commands import run_text
from tests.full import sized
from tests.oracle import Array
from tests.test_examples import sockets

MIDDLE, HALF = 2047.5, 2047.5
"""Of the converter's range, as terms of a sensor curve see it."""


TIED = 75
"""No seed before this one has such a tie: to find that out takes as many traces."""


@pytest.fixture(scope="module")
def tie() -> planning.Tie:
    """A session in which the curve of a sensor could have several shapes."""
    for seed in range(TIED, 200):
        found = planning.tie(0, seed)
        if found is None or abs(found.result.noise.correlation) > 0.02:
            continue  # the witness knows no correlation of samples
        of_channel = (t.term in SHAPES and t.target == found.effect.target for t in terms_of(found))
        if all(of_channel) and len(terms_of(found)) > 2:
            return found
    raise AssertionError("no tie")


def terms_of(tie: planning.Tie) -> list[Any]:
    """Terms of the explanations by terms, one each."""
    return [t for terms, _, _ in explanations(tie.result) for t in terms]


SHAPES = {
    "curvature": lambda a, angle: [((a - MIDDLE) / HALF) ** 2],
    "cubic": lambda a, angle: [((a - MIDDLE) / HALF) ** 3],
    "once_per_turn": lambda a, angle: [np.sin(angle), np.cos(angle)],
    "twice_per_turn": lambda a, angle: [np.sin(2 * angle), np.cos(2 * angle)],
}
"""Columns of a sensor's correction [rad] by its reading and its nominal angle."""


class Numpy:
    """Rivals by numpy: whitened rows of poses, information and estimates of the session."""

    def __init__(self, tie: planning.Tie) -> None:
        self.tie = tie
        result = tie.result
        names = oracle.channel_names(oracle.rsi())
        self.off = np.array([result["offset", name].value for name in names])
        self.gain = np.array([result["gain", name].value for name in names])
        self.channel = names.index(tie.effect.target)
        self.sigma = np.array([result.noise.sigma[name] for name in names])
        labels = tie.scene.label
        self.old = np.array([tie.values[labels == k].mean(axis=0) for k in np.unique(labels)])
        self.samples = tie.samples

    def linear(self, counts: Array, shape: str, theta: Array) -> tuple[Array, Array]:
        """`L⁻¹ X` and `L⁻¹ f` of the mean of the samples, at θ from the traced parameters."""
        own = counts[:, self.channel]
        curve = np.stack(SHAPES[shape](own, oracle.GAIN * (own - 2048.0)), axis=1)
        angles = counts * self.gain + self.off
        angles = angles + theta[:9] + (counts - 2048.0) * theta[9:18]
        angles[:, self.channel] += curve @ theta[18:]
        mechanism = oracle.rsi()
        f = oracle.misclosure_of_angles(mechanism, angles)
        slope = oracle.row_derivative(lambda q: oracle.misclosure_of_angles(mechanism, q), angles)
        by_curve = slope[:, :, self.channel, None] * curve[:, None, :]
        x = np.concatenate([slope, slope * (counts - 2048.0)[:, None, :], by_curve], axis=2)
        a = slope * self.gain
        cover = a @ (np.diag(self.sigma**2) / self.samples) @ np.swapaxes(a, 1, 2)
        white = np.linalg.inv(np.linalg.cholesky(cover))
        return white @ x, np.einsum("nij,nj->ni", white, f)

    def rows(self, counts: Array, shape: str) -> Array:
        """`W` at the common point."""
        return self.linear(counts, shape, np.zeros(18 + len(SHAPES[shape](counts[:1, 0], 0.0))))[0]

    @cache  # noqa: B019
    def rival(self, shape: str) -> tuple[Array, Array]:
        """θ at the rival's own minimum by Gauss-Newton, and N at the common point."""
        w = self.rows(self.old, shape)
        theta = np.zeros(w.shape[2])
        for _ in range(6):
            x, f = self.linear(self.old, shape, theta)
            flat = x.reshape(-1, x.shape[2])
            scale = np.linalg.norm(flat, axis=0)
            theta = theta - np.linalg.lstsq(flat / scale, f.ravel(), rcond=None)[0] / scale
        flat = w.reshape(-1, w.shape[2])
        return theta, flat.T @ flat

    def lambdas(self, new: Array, a: str, b: str) -> float:
        """λ of all new poses at once, for a true."""
        theta_a, _ = self.rival(a)
        theta_b, n_b = self.rival(b)
        w_a, w_b = self.rows(new, a), self.rows(new, b)
        w_a, w_b = (w.reshape(-1, w.shape[2]) for w in (w_a, w_b))
        e = w_a @ theta_a - w_b @ theta_b
        scale = np.sqrt(np.diag(n_b))
        inverse = np.linalg.inv(n_b / np.outer(scale, scale)) / np.outer(scale, scale)
        spread = np.eye(len(e)) + w_b @ inverse @ w_b.T
        return float(e @ np.linalg.solve(spread, e))

    def expected(self, new: Array, shape: str) -> tuple[Array, Array]:
        """Mean and covariance of the whitened new readings, for this shape true."""
        theta, information = self.rival(shape)
        w = self.rows(new, shape)
        w = w.reshape(-1, w.shape[2])
        scale = np.sqrt(np.diag(information))
        inverse = np.linalg.inv(information / np.outer(scale, scale)) / np.outer(scale, scale)
        return w @ theta, np.eye(len(w)) + w @ inverse @ w.T

    def decides(self, new: Array, shapes: list[str], chi2: Array, prior: Array) -> float:
        """Share of simulated readings after which the true shape is 12 ahead of all others."""
        rng = np.random.default_rng(1)
        expected = [self.expected(new, shape) for shape in shapes]
        share = 0.0
        for a, (mean, cover) in enumerate(expected):
            y = rng.multivariate_normal(mean, cover, 4000)
            off = [(y - m).T for m, _ in expected]
            ends = [
                c + np.sum(e * np.linalg.solve(s, e), axis=0)
                for c, e, (_, s) in zip(chi2, off, expected, strict=True)
            ]
            least = np.min([end for b, end in enumerate(ends) if b != a], axis=0)
            share += prior[a] / prior.sum() * float(np.mean(least - ends[a] > 12.0))
        return share


def planned(tie: planning.Tie, **options: Any) -> Plan:
    readings = planning.readings_of(tie.scene, tie.values)
    return plan(result=tie.result, beside=readings, **options)


def test_lambda_is_that_of_numpy(tie: planning.Tie) -> None:
    sessions = Sessions(planning.readings_of(tie.scene, tie.values), tie.result)
    specs = [
        ([_core.spec(t.term, t.target, t.place) for t in terms], chi2, probability)
        for terms, chi2, probability in explanations(tie.result)
    ]
    found = _core.further(sessions.session, specs, poses=6, criterion="decide")
    shapes = [explanations(tie.result)[k][0][0].term for k in found["kept"]]
    assert len(shapes) > 1
    witness = Numpy(tie)
    every = [
        witness.lambdas(found["readings"], a, b) if a != b else 0.0 for a in shapes for b in shapes
    ]
    # The weights of the witness do not follow the parameters: some per cent of a small difference.
    np.testing.assert_allclose(found["lambda"], every, rtol=0.15, atol=1.0)
    assert min(v for v in found["lambda"] if v > 0) == pytest.approx(
        found["forecast"]["least_lambda"]
    )


def test_the_forecast_is_what_simulated_readings_bring(tie: planning.Tie) -> None:
    sessions = Sessions(planning.readings_of(tie.scene, tie.values), tie.result)
    known = explanations(tie.result)
    specs = [
        ([_core.spec(t.term, t.target, t.place) for t in terms], c, p) for terms, c, p in known
    ]
    forecasts = []
    for poses in (3, 6, 12):
        found = _core.further(sessions.session, specs, poses=poses, criterion="decide")
        kept = found["kept"]
        shapes = [known[k][0][0].term for k in kept]
        chi2, prior = (np.array([known[k][column] for k in kept]) for column in (1, 2))
        assert len(kept) == len(known)  # merged explanations share their probability
        expected = Numpy(tie).decides(found["readings"], shapes, chi2, prior)
        # The weights of the witness do not follow the parameters, as for λ; 2 % of the draws.
        assert found["forecast"]["decides"] == pytest.approx(expected, rel=0.3, abs=0.02)
        forecasts.append(expected)
    assert max(forecasts) > 2.0 * min(forecasts)  # not one number for all plans


def test_planned_poses_are_worth_many_random_ones(tie: planning.Tie) -> None:
    found = planned(tie, poses=6)
    assert found.forecast is not None and found.forecast.least_lambda is not None
    witness = Numpy(tie)
    shapes = [terms[0].term for terms, _, _ in explanations(tie.result)]
    poses, _, _ = planning.further_poses(tie, "random", 24, 5)
    counts = (oracle.rsi_inverse(poses).reshape(-1, 9) - tie.device.offsets) / tie.device.gains
    random = [witness.lambdas(counts, a, b) for a in shapes for b in shapes if a != b]
    assert found.forecast.least_lambda > min(random)


def test_poses_keep_margins_and_stay_off_what_is_struck_off(tie: planning.Tie) -> None:
    first = planned(tie, poses=4)
    again = planned(tie, poses=4, off=first.readings)
    span = np.ptp(first.readings, axis=0).max()
    for row in again.readings:
        assert np.abs(first.readings - row).max(axis=1).min() > 0.02 * span
    for found in (first, again):
        assert np.all((found.readings >= 20) & (found.readings <= 4075))
        limits = np.array([c["limits"] for c in oracle.rsi()["channel"]])
        angles = oracle.rsi_inverse(found.poses).reshape(-1, 9)
        margin = 0.015 * np.ptp(limits, axis=1)  # of 0.02, less what the estimate is off
        assert np.all((angles > limits[:, 0] + margin) & (angles < limits[:, 1] - margin))
    assert planned(tie, poses=4).to_dict() == first.to_dict()


def test_the_readings_to_expect_are_those_of_the_device(tie: planning.Tie) -> None:
    found = planned(tie, poses=6)
    scene = planning.continued(tie.scene, found.poses, 1, tie.room, np.zeros(len(found.poses)))
    truth = tie.device.ideal(scene, (tie.effect,))[-len(found.poses) :]
    # The estimate of a session of 24 poses: a few counts in the corners of the workspace.
    assert np.abs(found.readings - truth).max() < 60


def test_a_platform_plan_makes_the_platform_certain() -> None:
    readings = rsicalib.load_readings(DEMO / "readings.csv")
    result = rsicalib.calibrate(readings, rest=DEMO / "rest.csv")
    sizes = {}
    for criterion in ("platform", "offsets", "joints", "volume"):
        found = plan(result=result, beside=readings, poses=3, criterion=criterion)
        assert found.forecast is not None and found.forecast.platform_sd is not None
        spread = found.forecast.platform_sd
        assert spread.before.position is not None and spread.after.position is not None
        assert spread.after.position < spread.before.position
        hidden = found.forecast.worst_hidden
        assert hidden.before is not None and hidden.after is not None
        sizes[criterion] = spread.after.position
    assert min(sizes, key=sizes.__getitem__) == "platform"
    assert plan(result=result, beside=readings, poses=2).criterion == "platform"


def test_other_readings_than_those_of_the_result_are_refused(tie: planning.Tie) -> None:
    other = planning.readings_of(tie.scene, tie.values[::-1].copy())
    with pytest.raises(InputError, match="SHA-256"):
        plan(result=tie.result, beside=other)
    with pytest.raises(InputError, match="expected its readings"):
        plan(result=tie.result)
    with pytest.raises(InputError, match="something open"):
        plan(criterion="decide", candidates=50)


def test_time_effects_are_decided_by_waiting() -> None:
    """A drift goes on while the room keeps its last temperature: a pause parts the two.

    Not in every room: where the temperature swings far from its trend, the session itself tells.
    """
    waited = []
    for seed in range(sized(3, 6)):
        sessions = drifting(np.random.default_rng(seed))
        rivals = [(["drift@a22"], 0.0, 0.5), (["temperature_offset@a22"], 1.0, 0.5)]
        found = _core.further(sessions.session, rivals, poses=2, criterion="decide")
        waited.append(found["waits"][0] == 0.5)
        curves = [(["curvature@a22"], 0.0, 0.5), (["once_per_turn@a22"], 1.0, 0.5)]
        found = _core.further(sessions.session, curves, poses=2)
        assert not any(found["waits"])
    assert sum(waited) > len(waited) / 2


def drifting(rng: np.random.Generator) -> Sessions:
    """A session in which a sensor drifts while the room warms, calibrated without the drift."""
    device = simulator.Device.random(rng)
    warmth = room(rng)
    poses = simulator.hand_poses(rng, 24, device)
    scene = held(rng, poses, 4, (0.0, 0.0), 0.0, SESSION_S, warmth)
    drift = (effects.Drift("a22", 0.006),)
    values = simulator.digitise(device.ideal(scene, drift), rng, 1.0, drift)
    readings = planning.readings_of(scene, values)
    rest = rsicalib.Readings.from_arrays(
        rsicalib.load_mechanism("rsi"), simulator.rest(device, rng)["values"]
    )
    return Sessions(readings, rsicalib.calibrate(readings, rest=rest))


def test_a_pose_is_left_out_of_its_own_session_alone() -> None:
    """Both sessions count their poses from 1: the label of a bad pose stands in both."""
    first = rsicalib.load_readings(DEMO / "readings.csv")
    # Once more, with noise of its own: the same to the last digit counts once.
    rng = np.random.default_rng(3)
    values = first.values + rng.normal(0, 0.5, first.values.shape)
    bad = int(first.pose[len(values) // 2])
    values[first.pose == bad, 4] += 200.0
    second = replace(first, values=values)
    result = rsicalib.trace([first, second])
    entries = [entry for entry in result.excluded if entry.pose == bad]
    assert [(entry.session, entry.channel is not None) for entry in entries] == [(2, True)]
    assert f"session 2 pose {bad}" in result.summary(whole=True)
    own = np.flatnonzero(first.pose == bad) + len(values)
    assert set(own) <= set(Sessions([first, second], result).left_out)
    assert not set(own - len(values)) & set(Sessions([first, second], result).left_out)


def test_rows_that_a_result_has_skipped_are_skipped_by_its_plan(tmp_path: Path) -> None:
    lines = (DEMO / "readings.csv").read_text().splitlines()
    cells = lines[20].split(",")
    lines[20] = ",".join([*cells[:-1], ""])
    bad = tmp_path / "readings.csv"
    bad.write_text("\n".join(lines) + "\n")
    result = rsicalib.calibrate(bad, skip_bad_rows=True)
    assert [row.line for row in result.readings.skipped] == [21]
    assert sum(len(r.pose) for r in Sessions(bad, result).readings) == len(lines) - 2


def test_the_command_writes_what_the_guide_and_people_read(tmp_path: Path) -> None:
    result = rsicalib.trace(DEMO / "readings.csv", rest=DEMO / "rest.csv")
    result.save(tmp_path / "trace.json")
    words = ["plan", "--poses", "3", "--json"]
    words += ["--result", tmp_path / "trace.json", "--beside", DEMO / "readings.csv"]
    done = run_text(*words, "--out", tmp_path / "plan.csv")
    assert done.returncode == 0, done.stderr
    told = json.loads(done.stdout)
    assert told["format"] == "rsicalib.plan/1"
    assert set(told["forecast"]) == {"decides", "least_lambda", "platform_sd", "worst_hidden"}
    rows = list(csv.DictReader(io.StringIO((tmp_path / "plan.csv").read_text())))
    channels = oracle.channel_names(oracle.rsi())
    assert list(rows[0]) == ["pose", "x", "y", "z", "rx", "ry", "rz", *channels, "why"]
    old = rsicalib.load_readings(DEMO / "readings.csv").pose.max()
    assert [int(row["pose"]) for row in rows] == [old + 1, old + 2, old + 3]
    again = run_text(*words, "--off", tmp_path / "plan.csv")
    assert again.returncode == 0, again.stderr
    assert json.loads(again.stdout)["readings"] != told["readings"]


def test_a_small_experiment_decides_more_ties_than_random_poses_do() -> None:
    """`python -m tests.blind.planning` is the full one; figures: docs/plan-measured.md."""
    seed = 20261122
    wanted = sized(1, 4)
    found = [it for it, _ in zip(planning.ties(wanted, seed), range(wanted), strict=False)]
    assert len(found) == wanted
    rows = [planning.outcome(it, way, 6, seed) for it in found for way in ("decide", "random")]
    good = {
        way: sum(r.decided and r.right for r in rows if r.way == way)
        for way in ("decide", "random")
    }
    assert good["decide"] >= good["random"]
    assert not any(r.decided and not r.right for r in rows if r.way == "decide")
    assert any("undecided" in line for line in planning.table(rows))


def test_an_arm_on_sockets_gets_placements_points_and_postures() -> None:
    mechanism, readings, _ = sockets()
    result = rsicalib.calibrate(readings, mechanism)
    found = plan(mechanism, poses=4, result=result, beside=readings)
    assert found.criterion == "platform"
    assert found.poses.shape == (0, 6) and set(found.keys) == {"group", "at"}
    header = found.csv().splitlines()[0].split(",")
    assert header[:3] == ["pose", "group", "at"] and header[-1] == "why"
    known = set(zip(readings.keys["group"], readings.keys["at"], strict=True))
    assert set(zip(found.keys["group"], found.keys["at"], strict=True)) <= known
    # The arm touches what it is said to touch: where its chain is, under the result, is where the
    # result has that point.
    planned = rsicalib.Readings.from_arrays(
        mechanism, found.readings, keys={k: list(v) for k, v in found.keys.items()}
    )
    points = np.asarray(rsicalib.forward(planned, mechanism, result))
    places = {(p.target, p.name): p.value for p in result.parameters if p.term == "unknown_point"}
    for point, group, at in zip(points, found.keys["group"], found.keys["at"], strict=True):
        own = [places[f"socket[group={group},at={at}]", axis] for axis in "xyz"]
        np.testing.assert_allclose(point, own, atol=1e-3 * np.abs(points).max())


def test_any_linkage_without_a_platform_gets_joint_readings() -> None:
    mechanism = oracle.rsi() | {"name": "another"}
    mechanism.pop("platform", None)
    mechanism.pop("rest", None)
    bare = rsicalib._core.Mechanism.from_dict(plain(mechanism))
    rng = np.random.default_rng(4)
    off, gain = oracle.nominal(oracle.rsi())
    device = simulator.Device(off, gain)
    counts = (oracle.rsi_inverse(planning.wide_poses(rng, device, 16)).reshape(-1, 9) - off) / gain
    values = np.rint(np.repeat(counts, 4, axis=0) + rng.standard_normal((64, 9)))
    readings = rsicalib.Readings.from_arrays(bare, values, pose=np.repeat(np.arange(1, 17), 4))
    result = rsicalib.calibrate(readings, bare)
    found = plan(bare, poses=3, result=result, beside=readings, criterion="volume")
    f = oracle.misclosure(oracle.rsi(), *sensors(result), found.readings)
    # Of 6.75 in²: the plan is for the estimate from means of samples, the result for all samples.
    assert np.abs(f).max() < 0.02
    assert found.csv().splitlines()[0].split(",")[0] == "pose" and not found.keys


def sensors(result: Any) -> tuple[Array, Array]:
    """Offsets and gains of a result."""
    names = oracle.channel_names(oracle.rsi())
    return tuple(np.array([result[term, n].value for n in names]) for term in ("offset", "gain"))  # type: ignore[return-value]
