"""Numbers of a result that were edited are told, whatever the loops say of them."""

from __future__ import annotations

import json
import warnings
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest

import rsicalib
from rsicalib import DEMO
from rsicalib.errors import OpenLoopsWarning


@pytest.fixture(scope="module")
def result() -> dict[str, Any]:
    return rsicalib.calibrate(DEMO / "readings.csv", rest=DEMO / "rest.csv").to_dict()


def read(result: dict[str, Any], folder: Path, **how: Any) -> rsicalib.Calibration:
    path = folder / "result.json"
    path.write_text(json.dumps(result, **how), encoding="utf-8")
    found = rsicalib.load_calibration(path)
    assert isinstance(found, rsicalib.Calibration)
    return found


def test_an_edited_noise_of_one_sensor_is_told(result: dict[str, Any], tmp_path: Path) -> None:
    """Poses move by little, and the loops close as before: nothing else shows it."""
    noise = {**result["noise"], "sigma": {**result["noise"]["sigma"]}}
    noise["sigma"]["a22"] *= 9.0
    edited = read({**result, "noise": noise}, tmp_path)
    assert edited.edited
    with pytest.warns(OpenLoopsWarning, match="edited"):
        rsicalib.forward(DEMO / "check.csv", calibration=edited)
    assert read(edited.to_dict(), tmp_path).edited  # saving it again hides nothing


def test_who_writes_the_same_numbers_otherwise_edits_nothing(
    result: dict[str, Any], tmp_path: Path
) -> None:
    words = {**result, "note": "as found", "device": "7"}
    found = read(words, tmp_path, indent=3, sort_keys=True)
    assert found.edited is False
    whole = json.loads(
        json.dumps(result),
        parse_float=lambda t: int(float(t)) if float(t).is_integer() else float(t),
    )
    assert not read(whole, tmp_path).edited
    without = {key: value for key, value in result.items() if key != "digest"}
    assert not read(without, tmp_path).edited


def test_check_readings_whose_loops_are_open_are_told(tmp_path: Path) -> None:
    """A sensor that slips before the check poses: these do not close as the session does."""
    lines = (DEMO / "check.csv").read_text(encoding="utf-8").splitlines()
    column = lines[0].split(",").index("a22")
    moved = [line.split(",") for line in lines[1:]]
    for cells in moved:
        cells[column] = str(int(float(cells[column])) + 60)
    path = tmp_path / "check.csv"
    path.write_text("\n".join([lines[0], *map(",".join, moved)]), encoding="utf-8")
    for check, kinds in ((DEMO / "check.csv", set()), (path, {"open_loops"})):
        found = rsicalib.calibrate(DEMO / "readings.csv", rest=DEMO / "rest.csv", check=check)
        assert {w.kind for w in found.warnings} & {"open_loops"} == kinds


def test_nothing_is_edited_in_a_result_as_it_was_made(tmp_path: Path) -> None:
    """A noise that is declared fifty times too large expects much; the loops close as before."""
    head, *rows = (DEMO / "readings.csv").read_text(encoding="utf-8").splitlines()
    sample = head.split(",").index("sample")
    once = tmp_path / "once.csv"  # without repeats, which would tell the noise
    once.write_text("\n".join([head, *(r for r in rows if r.split(",")[sample] == "1")]), "utf-8")
    found = rsicalib.calibrate(once, rest=DEMO / "rest.csv", noise=50.0)
    saved = read(found.to_dict(), tmp_path)
    older = read({k: v for k, v in found.to_dict().items() if k != "digest"}, tmp_path)
    assert (found.edited, saved.edited, older.edited) == (False, False, None)
    with warnings.catch_warnings():
        warnings.simplefilter("error", OpenLoopsWarning)
        for calibration in (found, saved):
            rsicalib.forward(DEMO / "check.csv", calibration=calibration)
    checked = rsicalib.calibrate(once, rest=DEMO / "rest.csv", noise=50.0, check=DEMO / "check.csv")
    assert "open_loops" not in {warned.kind for warned in checked.warnings}
    # A result without a digest cannot tell this from an edited noise.
    with pytest.warns(OpenLoopsWarning, match="were edited"):
        rsicalib.forward(DEMO / "check.csv", calibration=older)


def test_numbers_that_are_changed_in_memory_are_edited() -> None:
    found = rsicalib.calibrate(DEMO / "readings.csv", rest=DEMO / "rest.csv")
    first = found.parameters[0]
    assert first.value is not None
    changed = (replace(first, value=first.value + 1e-9), *found.parameters[1:])
    assert replace(found, parameters=changed).edited
