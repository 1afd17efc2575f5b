"""Observability and bounds, against numpy on the derivatives of `tests/oracle.py`."""

from __future__ import annotations

import numpy as np
import pytest

import rsicalib
from rsicalib import InputError, _core
from rsicalib.planning.measures import observability
from rsicalib.reproduction.printed import printed_numbers
from tests import oracle
from tests.oracle import Array

PRINTED = printed_numbers()
NOMINAL = oracle.nominal(oracle.rsi())


def counts(poses: Array) -> Array:
    return (oracle.rsi_inverse(poses).reshape(-1, 9) - NOMINAL[0]) / NOMINAL[1]


def jacobian(read: Array) -> tuple[Array, Array]:
    """Derivatives of the misclosure by offsets and gains (3 n, 18), and by readings (n, 3, 9)."""
    by_offset, by_gain, by_reading = oracle.jacobians(oracle.rsi(), *NOMINAL, read)
    return np.concatenate([by_offset, by_gain], axis=2).reshape(-1, 18), by_reading


def scales(name: str, read: Array) -> Array:
    x, _ = jacobian(read)
    if name == "none":
        return np.ones(18)
    if name == "unit_columns":
        return np.linalg.norm(x, axis=0)
    machine = oracle.rsi()
    angles = oracle.angles_of(*NOMINAL, read)
    slopes = oracle.row_derivative(lambda a: oracle.points(machine, a).reshape(len(a), -1), angles)
    square = np.sum(slopes**2, axis=1)  # each joint moves one wrist: (n, 9)
    return np.sqrt(np.concatenate([square.mean(axis=0), (square * read**2).mean(axis=0)]))


@pytest.mark.parametrize("scaling", ["none", "unit_columns", "wrist_position"])
def test_measures_are_those_of_the_oracles_jacobian(scaling: str) -> None:
    read = counts(np.vstack([PRINTED.fixture, PRINTED.closed_loop]))
    x, _ = jacobian(read)
    s = np.linalg.svd(x / scales(scaling, read), compute_uv=False)
    found = observability(read)[scaling]
    # The smallest of these is 1e-5 of the largest or more: rounding of 1e-15 leaves 1e-9.
    np.testing.assert_allclose(found.singular_values, s, rtol=1e-8)
    assert found.o1 == pytest.approx(np.exp(np.mean(np.log(s))) / np.sqrt(len(x)), rel=1e-8)
    assert found.o2 == pytest.approx(s[-1] / s[0], rel=1e-8)
    assert found.o3 == pytest.approx(s[-1], rel=1e-8)
    assert found.o4 == pytest.approx(s[-1] ** 2 / s[0], rel=1e-8)
    assert found.o5 == pytest.approx(1 / np.sum(1 / s**2), rel=1e-8)
    assert found.condition == pytest.approx(s[0] / s[-1], rel=1e-8)


def test_the_bound_is_the_inverse_of_the_information() -> None:
    read = counts(np.vstack([PRINTED.fixture, PRINTED.closed_loop]))
    x, a = jacobian(read)
    scale = np.linalg.norm(x, axis=0)
    information = np.zeros((18, 18))
    for own, by_reading in zip((x / scale).reshape(-1, 3, 18), a, strict=True):
        information += own.T @ np.linalg.solve(by_reading @ by_reading.T, own)
    sd = np.sqrt(np.diag(np.linalg.inv(information))) / scale
    found = observability(read)
    # Condition number some hundred, squared: 1e-11.
    np.testing.assert_allclose(found.offset_sd, sd[:9], rtol=1e-8)
    np.testing.assert_allclose(found.gain_sd, sd[9:], rtol=1e-8)


def test_the_paper_s_order_of_its_pose_sets_holds() -> None:
    sets = [PRINTED.fixture, np.vstack([PRINTED.fixture, PRINTED.closed_loop])]
    alone, together = (observability(counts(p)) for p in sets)
    for scaling in ("unit_columns", "wrist_position"):
        assert together[scaling].condition < alone[scaling].condition / 5
        assert together[scaling].o3 > alone[scaling].o3


def test_a_joint_that_never_moves_is_named() -> None:
    rng = np.random.default_rng(0)
    machine, off, gain = oracle.rsi(), *NOMINAL
    # Turn everything about joint 1 of arm 1: the closures cannot hold, but observability does
    # not ask for that.
    read = counts(PRINTED.closed_loop).repeat(3, axis=0) + rng.uniform(-200, 200, (36, 9))
    read[:, 0] = 2000.0
    found = observability(read)
    assert len(found.unobservable) == 1
    assert "offset a11" in found.unobservable[0]
    assert "gain a11" in found.unobservable[0]
    assert "a12" not in found.unobservable[0]
    assert np.isnan(found.offset_sd[0])
    assert np.isnan(found.gain_sd[0])
    assert np.isfinite(found.offset_sd[1:]).all()
    # It is so: the oracle's misclosure does not change along it.
    moved = off.copy(), gain.copy()
    moved[0][0] -= 2000.0 * 1e-5
    moved[1][0] += 1e-5
    np.testing.assert_allclose(
        oracle.misclosure(machine, *moved, read), oracle.misclosure(machine, off, gain, read)
    )
    assert "cannot be told:" in found.text()


def test_too_few_poses_leave_directions_open() -> None:
    found = observability(counts(PRINTED.closed_loop[:4]))
    # 12 equations for 18 parameters.
    assert len(found.unobservable) == 6
    assert found["unit_columns"].condition == np.inf
    assert found["unit_columns"].o1 == 0
    assert np.isnan(found.offset_sd).any()


def test_one_closure_leaves_the_third_arm_open() -> None:
    read = counts(np.vstack([PRINTED.fixture, PRINTED.closed_loop]))
    found = observability(read, closures=["wrist1-wrist2"])
    alone = [w for w in found.unobservable if "the readings do not depend on it" in w]
    assert len(alone) == 6
    assert all("a3" in words for words in alone)


def test_a_calibration_says_where_the_jacobian_is_taken() -> None:
    made = rsicalib.simulate(None, poses=24, samples=1, seed=1)
    found = rsicalib.calibrate(made.readings, rest=made.rest)
    there = observability(made.readings, calibration=found)
    at_nominal = observability(made.readings)
    assert there["unit_columns"].condition != at_nominal["unit_columns"].condition
    # Bound of a fit that is asymptotically efficient, in units of one count.
    sd = np.array([found["offset", c.name].sd for c in _core.Mechanism.rsi().channels])
    assert found.noise is not None
    np.testing.assert_allclose(there.offset_sd * found.noise.sigma["a11"], sd, rtol=0.01)


def test_unknown_scalings_are_refused_with_the_known_ones() -> None:
    with pytest.raises(InputError, match="none, unit_columns, wrist_position"):
        observability(counts(PRINTED.fixture), scalings=["best"])
