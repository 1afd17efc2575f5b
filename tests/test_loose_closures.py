"""How well closures hold is one fact: of the fit, of the result, of what the result is applied to.

Witness: the arm in plain matrix products of `tests/cone.py`, and the seatings that it drew.
"""

from __future__ import annotations

import numpy as np
import pytest

import rsicalib
from rsicalib import DEMO, Mechanism
from tests import cone
from tests.full import sized
from tests.oracle import Array

PLAY = 0.02


def at_known_cone(play: float | None, terms: str = '["offset"]') -> Mechanism:
    """The arm of `cone` before a cone whose place is known."""
    place = ", ".join(map(str, cone.CONE))
    text = cone.mechanism(None, play, terms).replace('unknown = ["at"]', f"at = [{place}]")
    return Mechanism.from_toml(text)


def drawn(session: cone.Seatings) -> float:
    """Root mean square of where the ball sat, by coordinate."""
    off: Array = np.array([cone.tip(q) - cone.CONE for q in session.angles])
    return float(np.sqrt(np.mean(off**2)))


def test_a_result_says_of_each_closure_how_well_it_holds() -> None:
    session = cone.session(11)
    declared = rsicalib.calibrate(session.table, at_known_cone(PLAY))
    assert declared.noise is not None
    assert dict(declared.noise.closures) == {"ball in cone": pytest.approx(PLAY)}
    told = rsicalib.calibrate(session.table, at_known_cone(None))
    assert told.noise is not None
    # 114 degrees of freedom tell a standard deviation to 7 %.
    assert told.noise.closures["ball in cone"] == pytest.approx(drawn(session), rel=0.2)
    exact = rsicalib.calibrate(cone.session(12, play=0.0).table, at_known_cone(None))
    assert exact.noise is not None
    assert dict(exact.noise.closures) == {}


def test_unlike_closures_keep_their_own() -> None:
    whole = rsicalib.load_mechanism("rsi").to_dict()
    for closure, noise in zip(whole["closure"], (0.001, 0.002, 0.0), strict=True):
        closure["noise"] = noise
    found = rsicalib.calibrate(
        DEMO / "readings.csv", rest=DEMO / "rest.csv", mechanism=Mechanism.from_dict(whole)
    )
    assert found.noise is not None
    names = [closure["name"] for closure in whole["closure"]]
    assert dict(found.noise.closures) == {names[0]: 0.001, names[1]: 0.002}


@pytest.mark.parametrize("play", sized([None], [PLAY, None]))
def test_a_later_clean_session_of_seatings_has_no_change(play: float | None) -> None:
    """Was: a link 265 mm longer.

    Gains that a result does not have were taken for zero, and the play of a seating for as many
    draws as it has samples.
    """
    mechanism, samples = at_known_cone(play), sized(4, 8)
    first = rsicalib.calibrate(cone.session(21, samples=samples).table, mechanism)
    for seed in sized((22,), (22, 23, 24)):
        table = cone.session(seed, samples=samples).table
        later = rsicalib.calibrate(table, mechanism, calibration=first)
        assert later.update is not None
        assert later.update.changes == ()
        # 120 equations: χ² per degree of freedom has a standard deviation of .13.
        assert later.update.chi2_per_dof == pytest.approx(1.0, abs=0.5)


def test_a_joint_that_slipped_between_sessions_of_seatings_is_named() -> None:
    mechanism = at_known_cone(PLAY)
    first = rsicalib.calibrate(cone.session(21).table, mechanism)
    table = dict(cone.session(25).table)
    table["q3"] = [float(q) - 2e-3 for q in table["q3"]]
    later = rsicalib.calibrate(table, mechanism, calibration=first)
    assert later.update is not None
    (change,) = later.update.changes
    assert (change.term, change.target) == ("offset", "q3")
    assert abs(change.size - 2e-3) < 4.0 * change.sd


def test_loops_that_close_exactly_are_no_seatings() -> None:
    """Held poses whose samples are the same numbers, simulated without any noise."""
    for seed, samples in ((31, 2), (32, 8)):
        table = cone.session(seed, poses=20, samples=samples, sigma=0.0, play=0.0).table
        for verb in (rsicalib.calibrate, rsicalib.trace):
            found = verb(table, at_known_cone(None))
            assert found.verdict == "adequate"
            values = [found[f"offset@q{k}"].value for k in range(1, 7)]
            assert values == pytest.approx(cone.OFFSETS, abs=1e-9)
