"""Results whose values were edited: `python -m tests.edited` tries as many as wanted."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

import rsicalib
from rsicalib import DEMO, InputError
from tests.edited import run
from tests.full import sized


def test_an_edited_result_is_refused_or_told_or_gives_the_poses_that_it_gave(
    tmp_path: Path,
) -> None:
    counts, faults = run(sized(100, 800), 1, tmp_path)
    assert faults == []
    assert min(counts["refused"], counts["told"], counts["as good"]) > sized(2, 20)


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
