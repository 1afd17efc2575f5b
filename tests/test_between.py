"""What changes from placement to placement, and intervals that hold elsewhere.

The simulator is products of plain matrices; the full form is `python -m tests.between`.
"""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np
import pytest
from scipy import stats

import rsicalib
from tests import between, cone
from tests.full import sized
from tests.machines import arm, files
from tests.oracle import Array
from tests.test_examples import sockets

ARMS = sized(6, 12)
LEAST = sized(0.70, 0.79)
REST = rsicalib.DEMO / "rest.csv"


def test_intervals_hold_at_placements_that_were_not_recorded() -> None:
    found = between.counted(ARMS, 3, 0.005)
    # Of one arm all errors go together: as many independent draws as arms, twice over. The chance
    # that 24 with 95 % are below 79 %, or 12 below 70 %, is 0.1 %.
    assert np.mean(found.mean) > LEAST
    assert np.mean(found.elsewhere) > LEAST
    assert np.mean(found.within) < 0.6, "intervals within placements are far too narrow elsewhere"
    assert np.mean(found.small) > 0.8, "the component is seen"


def test_a_placement_that_differs_as_a_whole_has_no_move_in_it() -> None:
    # A placement of another socket is no tool that moved after its first three samples.
    found = between.counted(sized(5, 40), 5, 0.005)
    # One arm in twenty has readings left out (docs/intervals.md): more than one in five then has
    # a probability of 2.3 %, and of 81 % where it is one in two; of forty more than 6 has 0.3 %.
    assert np.mean(found.damaged) <= sized(1 / 5, 6 / 40)


def test_where_nothing_changes_none_is_seen() -> None:
    found = between.counted(ARMS, 3, 0.0)
    assert np.mean(found.interval) > 0.7
    # Binomial, 12 arms at 5 %: more than 3 has 0.2 %; of 6, more than 2.
    assert sum(found.small) <= sized(2, 3)
    assert np.mean(found.mean) > LEAST


def along(values: Array, pose: Array, group: Sequence[str]) -> list[str]:
    """Groups by the means of their poses along the first principal axis of the readings, each
    channel in parts of its span: by a singular value decomposition."""
    first = [int(np.flatnonzero(pose == p)[0]) for p in dict.fromkeys(pose.tolist())]
    part = values[first] - values[first].mean(axis=0)
    part /= np.ptp(values[first], axis=0)
    place = part @ np.linalg.svd(part, full_matrices=False)[2][0]
    names = [group[row] for row in first]
    mean = {n: np.mean([p for p, own in zip(place, names, strict=True) if own == n]) for n in names}
    return sorted(mean, key=lambda n: float(mean[n]))


def test_a_result_says_how_halves_differ() -> None:
    mechanism, readings, _ = sockets()
    found = rsicalib.calibrate(readings, mechanism)
    assert found.between is not None and found.between.kind == "placement"
    assert found.between.groups == ("front", "left", "high")
    halves = found.between.halves
    assert halves is not None and not halves.own
    # Every other one along the direction in which readings vary most, however rows are ordered.
    assert {frozenset(half) for half in halves.groups} == {
        frozenset(("front", "left")),
        frozenset(("high",)),
    }
    assert along(readings.values, readings.pose, readings.keys["group"])[::2] in (
        ["front", "left"],
        ["left", "front"],
    )
    one = rsicalib.calibrate(readings, mechanism, fit_groups=["front", "left"])
    other = rsicalib.calibrate(readings, mechanism, fit_groups=["high"])
    assert other.between is None, "one placement tells nothing of others"
    apart = rsicalib.forward(readings, mechanism, one) - rsicalib.forward(
        readings, mechanism, other
    )
    # Linearised at the whole, and at 16 of 150 poses.
    assert halves.difference == pytest.approx(float(np.sqrt((apart**2).mean())), rel=0.3)
    assert found.between.sd == 0.0
    assert "3 placements do not differ, or by less than" in found.summary()
    assert all(p.sd_between is not None for p in found.parameters if p.sd is not None)


def fitted_alone(rows: list[Array]) -> tuple[Array, Array]:
    """Offsets and ball of some placements by plain least squares, with their covariance."""
    shared, count = 7, 7 + 3 * len(rows)
    values, plates = np.zeros(shared), [between.tips(q).mean(axis=0) for q in rows]
    for _ in range(6):
        normal, pull = np.zeros((count, count)), np.zeros(count)
        for k, q in enumerate(rows):
            turned, ball = q + np.array([0.0, *values[:4], 0.0]), between.BALL + values[4:]
            places, slopes = between.moving(turned, ball)
            by_ball = [between.tips(turned, ball + e) - places for e in np.eye(3)]
            x = np.zeros((len(q), 3, count))
            x[:, :, :4], x[:, :, 4:7] = slopes[:, :, 1:5], np.stack(by_ball, axis=2)
            x[:, :, shared + 3 * k : shared + 3 * k + 3] = -np.eye(3)
            x, r = (
                x.reshape(-1, count) / between.PLAY,
                ((places - plates[k]) / between.PLAY).ravel(),
            )
            normal, pull = normal + x.T @ x, pull + x.T @ r
        step = -np.linalg.solve(normal, pull)
        values = values + step[:shared]
        plates = [p + step[shared + 3 * k :][:3] for k, p in enumerate(plates)]
    return values, np.linalg.inv(normal)[:shared, :shared]


def test_each_half_is_judged_by_its_own_noise() -> None:
    rng = np.random.default_rng(11)
    shifts = 0.005 * between.SIZES * rng.standard_normal((4, 7))
    rows = [between.placement(rng, shift) for shift in shifts]
    table = {f"q{k + 1}": column for k, column in enumerate(np.concatenate(rows).T)}
    at = [f"plate {k}" for k in range(4) for _ in range(between.POSES)]
    found = rsicalib.calibrate({**table, "at": at}, between.mechanism())
    assert found.between is not None and not found.excluded
    halves = found.between.halves
    assert halves is not None and halves.own
    numbers = [[int(name.split()[1]) for name in half] for half in halves.groups]
    (one, v1), (other, v2) = (fitted_alone([rows[k] for k in half]) for half in numbers)
    apart = one - other
    wanted = apart @ np.linalg.solve(v1 + v2, apart) / 7
    # Beside shifts of each placement nothing but the declared noise is left: within a tenth. The
    # halves are linearised at the whole.
    assert wanted > 3.0
    assert halves.chi2_within == pytest.approx(wanted, rel=0.1)


def test_sessions_are_groups_where_nothing_was_placed() -> None:
    whole = rsicalib.load_readings(rsicalib.DEMO / "readings.csv")
    assert rsicalib.calibrate(whole, rest=REST).between is None
    halves = [whole.select(whole.pose <= 24), whole.select(whole.pose > 24)]
    found = rsicalib.calibrate(halves, rest=REST)
    assert found.between is not None and found.between.kind == "session"
    assert found.between.groups == ("1", "2")


def test_one_zero_that_differs_from_surface_to_surface_has_students_interval(
    tmp_path: Path,
) -> None:
    """Four surfaces on four days: the zero of each day is well known, that of another is not."""
    rng = np.random.default_rng(3)
    body = arm.Body.random(rng)
    zeros, tables = rng.normal(0, 4e-3, 4), []
    for day, zero in enumerate(zeros):
        job = arm.Job(body, rng, 40)
        job.values |= {f"offset@{j}": 0.0 for j in arm.JOINTS} | {"offset@q3": float(zero)}
        job.plane(f"table{day}")
        read = job.machine("arm").observe(rng)
        readings, mechanism = files.write(job.machine("arm"), read, tmp_path / str(day))
        tables.append(readings)
    alone = [rsicalib.calibrate(one, mechanism, terms=["offset@q3"]) for one in tables]
    each = [p for found in alone for p in found.parameters if p.term == "offset"]
    for one, zero in zip(each, zeros, strict=True):
        assert one.value is not None and one.sd is not None
        assert abs(one.value - zero) < 4 * one.sd
    found = rsicalib.calibrate(tables, mechanism, terms=["offset@q3"])
    (pooled,) = (p for p in found.parameters if p.term == "offset")
    assert found.between is not None and pooled.sd_between is not None
    # The mean of four has Student's interval by three degrees of freedom.
    spread = np.std([p.value for p in each], ddof=1) / 2
    student = stats.t.ppf(0.975, 3) / stats.norm.ppf(0.975) * spread
    assert pooled.sd_between == pytest.approx(student, rel=0.2)  # surfaces tell it unequally well


def test_an_arm_that_has_not_changed_is_not_told_changed_at_other_placements() -> None:
    mechanism = rsicalib.Mechanism.from_toml(cone.mechanism(2e-5, between.PLAY, between.TERMS))
    true = np.array([0.004, -0.006, 0.008, -0.010, 1.0, -2.0, 1.5])
    small, moved, sure = 0, 0, []
    for seed in range(sized(6, 40)):
        rng = np.random.default_rng([seed, 99])
        results: list[rsicalib.Calibration] = []
        for _ in range(2):
            shifts = 0.005 * between.SIZES * rng.standard_normal((3, 7))
            rows = np.concatenate([between.placement(rng, true + shift) for shift in shifts])
            columns = {f"q{k + 1}": column for k, column in enumerate(rows.T)}
            at = [f"plate {k}" for k in range(3) for _ in range(between.POSES)]
            earlier = results[-1] if results else None
            found = rsicalib.calibrate({**columns, "at": at}, mechanism, calibration=earlier)
            results.append(found)
        update = results[1].update
        assert update is not None
        small += update.p_value < 0.01
        moved += bool(results[1].moved)
        there = rsicalib.forward_sd(
            {f"q{k + 1}": rows[:, k] for k in range(6)}, mechanism, results[0]
        )
        assert results[0].predicted is not None
        sure.append(float(np.sqrt(np.mean(there**2))) / results[0].predicted.position_sd)
    # Binomial, 6 arms at 1 %: two have .1 %; of 40, four have .1 %.
    assert max(small, moved) <= sized(1, 3)
    assert np.median(sure) == pytest.approx(1.0, abs=0.3)
