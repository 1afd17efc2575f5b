"""A later session of an arm at a cone: each session touches a place of its own."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
import scipy.stats

import rsicalib
from rsicalib import Calibration, Mechanism
from tests import cone
from tests.full import sized

ARM = Mechanism.from_toml(cone.mechanism(2e-5, 0.02))
FREE = tuple(f"offset@q{k}" for k in range(2, 7))
"""Joint 1 turns the cone with it."""

ELSEWHERE = np.array([30.0, -20.0, 10.0])
"""By how much the cone of the later session stands elsewhere."""


def later_session(seed: int, slips: dict[int, float]) -> cone.Seatings:
    """A session whose channels (from 1) read less by `slips` [rad]."""
    session = cone.session(seed + 10_000, poses=30, samples=4, cone=cone.CONE + ELSEWHERE)
    slipped = {
        f"q{joint}": [float(v) - by for v in session.table[f"q{joint}"]]
        for joint, by in slips.items()
    }
    return cone.Seatings({**session.table, **slipped}, session.angles)


def pair(seed: int, slips: dict[int, float], tmp_path: Path) -> tuple[Calibration, Calibration]:
    """An earlier result, and one of a later session."""
    one = cone.session(seed, poses=30, samples=4)
    table = later_session(seed, slips).table
    earlier = rsicalib.calibrate(one.table, ARM, terms=FREE, date="2026-01-01")
    path = tmp_path / f"{seed}.json"
    earlier.save(path)
    later = rsicalib.calibrate(table, ARM, terms=FREE, calibration=path, date="2026-02-01")
    return earlier, later


def difference(earlier: Calibration, later: Calibration) -> tuple[np.ndarray, np.ndarray]:
    """Of the offsets of two results, with its covariance, from what they print."""
    values, spread = [], []
    for result in (earlier, later):
        own = [k for k, p in enumerate(result.parameters) if p.term == "offset"]
        values.append(np.array([result.parameters[k].value for k in own]))
        spread.append(np.asarray(result.covariance)[np.ix_(own, own)])
    return values[1] - values[0], spread[0] + spread[1]


def test_the_test_of_two_results_is_that_of_their_difference(tmp_path: Path) -> None:
    earlier, later = pair(0, {4: 2e-3}, tmp_path)
    d, c = difference(earlier, later)
    statistic = float(d @ np.linalg.solve(c, d))
    assert later.update is not None
    assert later.update.chi2_per_dof == pytest.approx(statistic / 5, rel=1e-6)
    assert later.update.p_value == pytest.approx(scipy.stats.chi2.sf(statistic, 5), rel=1e-5)
    # What is said of the slip, where the other offsets are as they were: generalised least squares.
    design = np.zeros((5, 1))
    design[2] = 1.0
    information = design.T @ np.linalg.solve(c, design)
    size = float(np.linalg.solve(information, design.T @ np.linalg.solve(c, d))[0])
    (change,) = later.update.changes
    assert (change.term, change.target) == ("offset", "q4")
    assert change.size == pytest.approx(size, rel=1e-6)
    assert change.sd == pytest.approx(float(information[0, 0] ** -0.5), rel=1e-6)


def test_nothing_has_changed_where_nothing_has(tmp_path: Path) -> None:
    # One of a hundred changes by chance: two of twelve have a probability of .006.
    updates = [pair(seed, {}, tmp_path)[1].update for seed in range(100, 100 + sized(12, 200))]
    told = [update for update in updates if update is not None]
    assert len(told) == len(updates)
    assert sum(bool(update.changes) for update in told) <= sized(1, 7)
    assert not any(update.worth for update in told if not update.changes)


@pytest.mark.parametrize("slips", [{3: 0.052}, {5: -0.005}, {2: 0.004, 6: 0.02}, {4: 0.9}])
def test_sensors_that_slipped_between_sessions_are_named_with_their_sizes(
    slips: dict[int, float], tmp_path: Path
) -> None:
    for seed in range(300, 300 + sized(2, 20)):
        _, later = pair(seed, slips, tmp_path)
        assert later.update is not None and later.update.worth, later.update
        told = {change.target: change for change in later.update.changes}
        assert told.keys() == {f"q{k}" for k in slips}, later.update.text
        for joint, by in slips.items():
            change = told[f"q{joint}"]
            assert abs(change.size - by) < 4.5 * change.sd
            assert change.platform_rms is not None and change.platform_rms.position > 0
        # Read as before, the ball misses the cone by about what the slip moves it.
        opened = misses(later_session(seed, slips).angles, slips)
        assert later.update.rms_before == pytest.approx(opened, rel=0.05)


def misses(angles: np.ndarray, slips: dict[int, float]) -> float:
    """How far apart poses at one place put the ball where slips are not known [mm, rms]."""
    angles = angles.copy()
    for joint, by in slips.items():
        angles[:, joint - 1] -= by
    places = cone.tip(angles)
    return float(np.sqrt(np.mean(np.square(places - places.mean(axis=0)))))


def test_a_trace_says_what_has_changed_as_calibrate_does(tmp_path: Path) -> None:
    earlier, later = pair(7, {3: 0.01}, tmp_path)
    table = later_session(7, {3: 0.01}).table
    found = rsicalib.trace(table, ARM, terms=FREE, calibration=earlier, date="2026-02-01")
    assert found.update is not None and later.update is not None
    assert [c.target for c in found.update.changes] == [c.target for c in later.update.changes]
    assert "offset of q3" in found.summary()


def test_a_session_that_does_not_close_tells_no_change(tmp_path: Path) -> None:
    """A gain that nobody asked for has changed: offsets take up a part, and say nothing of it."""
    earlier, _ = pair(11, {}, tmp_path)
    table = dict(later_session(11, {}).table)
    table["q4"] = [1.01 * float(v) for v in table["q4"]]
    later = rsicalib.calibrate(table, ARM, terms=FREE, calibration=earlier)
    assert later.verdict == "unexplained"
    assert later.update is not None and later.update.unclear
    assert not later.update.changes and not later.update.worth
    assert "not told" in later.update.text
