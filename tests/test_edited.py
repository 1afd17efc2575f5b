"""Results whose values were edited: `python -m tests.edited` tries as many as wanted."""

from __future__ import annotations

import json
import warnings
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

import rsicalib
from rsicalib import DEMO, InputError
from rsicalib.errors import OpenLoopsWarning
from tests.edited import Case, run
from tests.full import sized


def test_an_edited_result_is_refused_or_told_or_gives_the_poses_that_it_gave(
    tmp_path: Path,
) -> None:
    counts, faults = run(sized(60, 1200), 1, tmp_path)
    assert faults == []
    assert min(counts["refused"], counts["told"], counts["as good"]) > sized(1, 20)


def test_a_table_with_rows_of_unlike_lengths_is_refused(tmp_path: Path) -> None:
    """Of what a session leaves open: 16 of 20,000 edited results ended in a traceback."""
    found = rsicalib.trace(DEMO / "readings.csv", rest=DEMO / "rest.csv").to_dict()
    hidden = next(
        one
        for one in found["could_hide"]
        if len((one.get("unseen") or {}).get("covariance", [])) > 1
    )
    hidden["unseen"]["covariance"][0].pop()
    path = tmp_path / "result.json"
    path.write_text(json.dumps(found), encoding="utf-8")
    with pytest.raises(InputError, match="rows of unlike lengths"):
        rsicalib.load_calibration(path)


def test_an_arm_at_cones_whose_result_has_two_values_exchanged_is_told(tmp_path: Path) -> None:
    """Without the digest: the readings say which cone they touch, and the result where that is."""
    case = Case.of_arm(7, tmp_path)
    bare = {key: value for key, value in case.result.items() if key != "digest"}
    offsets = [p for p in bare["parameters"] if p["term"] == "offset"]
    with warnings.catch_warnings():
        warnings.simplefilter("error", OpenLoopsWarning)
        case.forward(bare)
    one, other = offsets[1], offsets[3]
    one["value"], other["value"] = other["value"], one["value"]
    with pytest.warns(OpenLoopsWarning, match="do not close"):
        case.forward(bare)
    # Without the column of the cones the arm is in the air, and nothing tells.
    in_the_air = {name: column for name, column in case.readings.items() if name != "at"}
    with warnings.catch_warnings():
        warnings.simplefilter("error", OpenLoopsWarning)
        replace(case, readings=in_the_air).forward(bare)


@pytest.mark.parametrize("term", ["drift", "wander@a11", "lag@a11"])
def test_a_result_without_a_digest_is_taken_whatever_its_terms_need(
    term: str, tmp_path: Path
) -> None:
    """Of the first two no parameter outlasts the session, and of the last no row tells."""
    made = rsicalib.simulate(poses=60, samples=1, seed=3)
    readings = made.readings
    if term.startswith("lag"):
        mechanism = rsicalib.load_mechanism("rsi")
        seconds = np.arange(len(readings)) / 10.0
        readings = rsicalib.Readings.from_arrays(mechanism, readings.values, time_s=seconds)
    terms = ["offset", "gain", term]
    found = rsicalib.calibrate(readings, rest=made.rest, terms=terms, noise=1.0)
    bare = {key: value for key, value in found.to_dict().items() if key != "digest"}
    path = tmp_path / "result.json"
    path.write_text(json.dumps(bare), encoding="utf-8")
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", OpenLoopsWarning)
        poses = rsicalib.forward(readings, calibration=path)
    assert len(poses) == len(readings)
