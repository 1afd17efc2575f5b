"""Options that take names: a text in place of a list, and names that are misspelt."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
import pytest

import rsicalib
from rsicalib import InputError
from tests import crank

TABLE: dict[str, Any] = crank.columns() | {"group": ["left"] * 60, "device": ["one"] * 60}


def calibrate(**options: Any) -> Any:
    return rsicalib.calibrate(TABLE, crank.MECHANISM, **options)


TEXTS: dict[str, tuple[Callable[[], Any], str]] = {
    "terms": (lambda: calibrate(terms="ofset"), "terms: found 'ofset', .*: ['offset']"),
    "terms of targets": (
        lambda: calibrate(terms="offset@crnk, gain"),
        "terms: found 'offset@crnk, gain', .*: ['offset@crank', 'gain']",
    ),
    "each": (lambda: calibrate(terms="offset@each"), ".*: ['offset@each']"),
    "closures": (lambda: calibrate(closures="rodd"), "closures: found 'rodd', .*: ['rod']"),
    "groups": (lambda: calibrate(fit_groups="lft"), "fit_groups: found 'lft', .*: ['left']"),
    "groups left out": (
        lambda: calibrate(hold_out_groups="lefft"),
        "hold_out_groups: found 'lefft', .*: ['left']",
    ),
    "without": (
        lambda: rsicalib.trace(TABLE, crank.MECHANISM, without="driftt"),
        "without: found 'driftt', .*: ['drift']",
    ),
    "suppose": (
        lambda: rsicalib.suppose(TABLE, "ofset@crank=0.1", crank.MECHANISM),  # type: ignore[arg-type]
        "terms: found 'ofset@crank=0.1', .*: ['offset@crank=0.1']",
    ),
    "identifiable": (
        lambda: rsicalib.identifiable(crank.MECHANISM, "ofset"),
        "terms: found 'ofset', .*: ['offset']",
    ),
    "scalings": (
        lambda: rsicalib.observability(TABLE, crank.MECHANISM, scalings="unit_colums"),
        "scalings: found 'unit_colums', .*: ['unit_columns']",
    ),
    "devices": (
        lambda: rsicalib.calibrate_devices(TABLE, crank.MECHANISM, terms="ofset"),
        "terms: found 'ofset', .*: ['offset']",
    ),
    "nothing near": (lambda: calibrate(terms="xyzzy"), "terms: found 'xyzzy', .*: ['xyzzy']"),
}


@pytest.mark.parametrize("option", TEXTS)
def test_a_text_is_answered_with_the_list_that_it_should_have_been(option: str) -> None:
    call, said = TEXTS[option]
    pattern = said.replace("[", r"\[").replace("]", r"\]").replace(".*", ".*a list of names")
    with pytest.raises(TypeError, match=f"{pattern}$"):
        call()


MISSPELT: dict[str, tuple[Callable[[], Any], str]] = {
    "term": (lambda: calibrate(terms=["ofset"]), "offset"),
    "target": (lambda: calibrate(terms=["offset@crnk"]), "crank"),
    "closure": (lambda: calibrate(closures=["rodd"]), "rod"),
    "group": (lambda: calibrate(fit_groups=["lft"]), "left"),
    "noise": (lambda: calibrate(noise={"crnk": 1e-4}), "crank"),
    "without": (lambda: rsicalib.trace(TABLE, crank.MECHANISM, without=["ofset"]), "offset"),
    "criterion": (lambda: rsicalib.plan(poses=3, criterion="plattform"), "platform"),
    "kind of export": (lambda: rsicalib.export_result(calibrate(), "tomml"), "toml"),
    "covariance": (lambda: calibrate().covariance["offset@crnk"], "offset@crank"),
    "picture": (lambda: calibrate().plot("residual"), "residuals"),
    "scaling": (
        lambda: rsicalib.observability(TABLE, crank.MECHANISM, scalings=["unit_colums"]),
        "unit_columns",
    ),
}


@pytest.mark.parametrize("option", MISSPELT)
def test_a_name_that_is_misspelt_is_answered_with_the_nearest(option: str) -> None:
    call, name = MISSPELT[option]
    with pytest.raises((InputError, KeyError, ValueError), match=rf"did you mean ['\"]{name}['\"]"):
        call()


def test_all_groups_are_known_before_they_are_asked_for() -> None:
    np.testing.assert_array_equal(calibrate(fit_groups=["left"]).values, calibrate().values)
