"""How well touched points are repeated, placement by placement, and on placements unseen."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest

import rsicalib
from rsicalib import InputError
from rsicalib.facts.shapes import Reason
from rsicalib.report.words import advice
from tests.test_examples import sockets


@pytest.fixture(scope="module")
def made() -> tuple[rsicalib.Mechanism, rsicalib.Readings]:
    mechanism, readings, _ = sockets()
    return mechanism, readings


def by_hand(points: Any, readings: rsicalib.Readings) -> dict[str, float]:
    """The measure in the words of the data's README."""
    group, at = np.array(readings.keys["group"]), np.array(readings.keys["at"])
    out = {}
    for g in dict.fromkeys(readings.keys["group"]):
        weights, means = [], []
        for a in dict.fromkeys(readings.keys["at"]):
            own = points[(group == g) & (at == a)]
            means.append(np.linalg.norm(own - own.mean(axis=0), axis=1).mean())
            weights.append(len(own))
        out[g] = float(np.average(means, weights=weights))
    return out


def test_the_measure_is_that_of_the_authors(made: Any) -> None:
    mechanism, readings = made
    uneven = readings.select(np.arange(len(readings)) % 7 != 3)
    found = rsicalib.calibrate(uneven, mechanism, fit_groups=["front", "high"])
    wanted = by_hand(rsicalib.forward(uneven, mechanism, found), uneven)
    groups = found.groups
    assert groups is not None and groups.unit == "mm"
    assert dict(groups.by_group) == pytest.approx(wanted, rel=1e-9)
    assert groups.fitted == pytest.approx((wanted["front"] + wanted["high"]) / 2)
    assert groups.others == pytest.approx(wanted["left"])
    nominal = by_hand(rsicalib.forward(uneven, mechanism), uneven)
    assert groups.nominal_others == pytest.approx(nominal["left"])


def test_holding_out_is_fitting_the_others(made: Any) -> None:
    mechanism, readings = made
    one = rsicalib.calibrate(readings, mechanism, fit_groups=["front", "high"])
    two = rsicalib.calibrate(readings, mechanism, hold_out_groups=["left"])
    np.testing.assert_array_equal(one.values, two.values)
    assert one.groups is not None and two.groups is not None
    assert one.groups.to_dict() == two.groups.to_dict()


def test_with_both_the_rest_is_neither_fitted_nor_measured(made: Any) -> None:
    mechanism, readings = made
    found = rsicalib.calibrate(readings, mechanism, fit_groups=["front"], hold_out_groups=["left"])
    assert found.groups is not None
    assert found.groups.others == found.groups.by_group["left"]
    assert found.groups.by_group.keys() == {"front", "left", "high"}


def test_trace_reports_the_same_measure(made: Any) -> None:
    mechanism, readings = made
    found = rsicalib.trace(readings, mechanism, fit_groups=["front", "left"])
    assert found.groups is not None and found.groups.others is not None
    assert found.to_dict()["groups"]["unit"] == "mm"
    again = rsicalib.Trace.from_dict(found.to_dict())
    assert again.groups is not None and again.groups.others == found.groups.others


def test_trace_says_whether_what_it_found_holds_elsewhere(made: Any) -> None:
    mechanism, readings = made
    fit_groups = ["front", "left"]
    found = rsicalib.trace(readings, mechanism, fit_groups=fit_groups)
    before = rsicalib.calibrate(readings, mechanism, fit_groups=fit_groups)
    wanted = by_hand(rsicalib.forward(readings, mechanism, before), readings)
    groups = found.groups
    assert groups is not None and groups.before_fitted is not None
    assert groups.before_others == pytest.approx(wanted["high"], rel=1e-6)
    assert groups.before_fitted == pytest.approx((wanted["front"] + wanted["left"]) / 2, rel=1e-6)
    assert "at what it touches, other groups [mm]" in found.summary()


def test_what_does_not_hold_elsewhere_is_warned_of(made: Any) -> None:
    mechanism, readings = made
    bent = readings.values.copy()
    bent[:, 2] += 0.002 * bent[:, 2] ** 2
    session = replace(readings, values=bent)
    found = rsicalib.trace(session, mechanism, fit_groups=["front", "left"])
    assert found.steps and "groups_before" not in [reason.kind for reason in found.reasons]
    assert not any("hold elsewhere" in text for text in advice(found))
    reason = Reason("groups_before", found=2.0, expected=1.0)
    worse = replace(found, verdict="partly_explained", reasons=(reason,))
    assert any("hold elsewhere" in text for text in advice(worse))
    said = " ".join(worse.summary().split())
    assert "does not hold elsewhere: groups that were not fitted close to 2.00 mm; 1.00" in said
    assert rsicalib.Trace.from_dict(worse.to_dict()).reasons == (reason,)


def test_an_unknown_group_is_refused_by_name(made: Any) -> None:
    mechanism, readings = made
    with pytest.raises(InputError, match=r"no group 'back'.*front, left, high"):
        rsicalib.calibrate(readings, mechanism, fit_groups=["back"])


def test_groups_are_chosen_over_all_sessions(made: Any) -> None:
    mechanism, readings = made
    group = np.array(readings.keys["group"])
    front, rest = readings.select(group == "front"), readings.select(group != "front")
    found = rsicalib.calibrate([front, rest], mechanism, fit_groups=["left", "high"])
    assert found.groups is not None and found.groups.others == found.groups.by_group["front"]


def test_a_mechanism_that_touches_nothing_unknown_has_no_such_measure() -> None:
    found = rsicalib.calibrate(rsicalib.DEMO / "readings.csv", rest=rsicalib.DEMO / "rest.csv")
    assert found.groups is None and "groups" not in found.to_dict()
