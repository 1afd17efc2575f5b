"""A result that was made here knows its mechanism; one that was read from a file asks for it."""

from __future__ import annotations

import copy
import dataclasses
import json
import pickle
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

import rsicalib
from rsicalib import InputError, Trace
from rsicalib._core import Mechanism
from tests import crank


@pytest.fixture(scope="module")
def found() -> Trace:
    return rsicalib.trace(crank.columns(), crank.MECHANISM)


BESIDE: dict[str, Callable[[Any], Any]] = {
    "calibrate": lambda of: rsicalib.calibrate(crank.columns(), calibration=of).values,
    "certify": lambda of: rsicalib.certify(of, limit=1.0).mechanism,
    "export_result": lambda of: rsicalib.export_result(of, "toml"),
    "forward": lambda of: rsicalib.forward(crank.columns(), calibration=of),
    "Monitor": lambda of: rsicalib.Monitor(of),
    "Placer": lambda of: rsicalib.Placer(calibration=of).names,
    "suppose": lambda of: rsicalib.suppose(crank.columns(), ["offset@crank=1"], calibration=of),
    "trace": lambda of: rsicalib.trace(crank.columns(), calibration=of).verdict,
    "watch": lambda of: list(rsicalib.watch(rows(), of)),
    "workspace": lambda of: rsicalib.workspace(of, poses=5).names,
    "observability": lambda of: rsicalib.observability(crank.columns(), calibration=of).text(),
    "plan": lambda of: rsicalib.plan(result=of, beside=crank.columns(), poses=2, candidates=20),
}
"""Every function that takes a result and a mechanism that may be left out."""


def rows() -> rsicalib.Readings:
    return rsicalib.load_readings(crank.columns(), crank.MECHANISM)


@pytest.mark.parametrize("name", BESIDE)
def test_beside_a_result_its_own_mechanism_holds(name: str, found: Trace) -> None:
    BESIDE[name](found)


@pytest.mark.parametrize("name", BESIDE)
def test_a_result_of_a_file_asks_for_its_mechanism(name: str, found: Trace, tmp_path: Path) -> None:
    path = tmp_path / "trace.json"
    found.save(path)
    for one in (path, rsicalib.load_calibration(path)):
        with pytest.raises(
            InputError, match=r"four-bar.*'rsi'.*--mechanism|a column 'a11'|of 'rsi'"
        ):
            BESIDE[name](one)


def test_the_mechanism_that_is_given_comes_first(found: Trace) -> None:
    other = {**crank.MECHANISM, "name": "another"}
    with pytest.raises(InputError, match="of 'four-bar', expected one of 'another'"):
        rsicalib.workspace(found, other)


def test_a_mechanism_is_no_part_of_what_is_written_or_compared(found: Trace) -> None:
    assert isinstance(found.made_from, Mechanism)
    assert "made_from" not in found.to_dict()
    again = Trace.from_dict(json.loads(found.to_json()))
    assert again.made_from is None
    assert again == found
    assert hash(again) == hash(found)


def test_no_file_brings_a_mechanism_of_its_own(found: Trace, tmp_path: Path) -> None:
    path = tmp_path / "trace.json"
    path.write_text(json.dumps(found.to_dict() | {"made_from": crank.MECHANISM}), encoding="utf-8")
    with pytest.raises(InputError, match="Give its own as mechanism"):
        rsicalib.workspace(rsicalib.load_calibration(path))


def test_copies_keep_the_mechanism(found: Trace) -> None:
    pickled = pickle.loads(pickle.dumps(found))
    for one in (pickled, copy.deepcopy(found), dataclasses.replace(found, note="later")):
        assert one.made_from == found.made_from
    assert pickled == found


def test_a_fixture_knows_its_mechanism() -> None:
    made = rsicalib.simulate(poses=12, check=12)
    own = made.device.mechanism
    for check in (None, made.check):
        assert rsicalib.fixture(made.check, own, check=check).made_from == own


def test_what_would_decide_a_certificate_names_the_mechanism(found: Trace, tmp_path: Path) -> None:
    """The command is of the mechanism that was calibrated, not of the built-in one."""
    path = tmp_path / "readings.csv"
    rows().to_csv(path)
    traced = rsicalib.trace(path, crank.MECHANISM)
    decides = rsicalib.certify(traced, limit=0.1).decides
    assert decides is not None
    assert "--mechanism four-bar" in decides
