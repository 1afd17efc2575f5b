"""Numbers of a result that were edited are told, whatever the loops say of them."""

from __future__ import annotations

import json
import warnings
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest

import rsicalib
from rsicalib import DEMO
from rsicalib.cli import main
from rsicalib.errors import InputError, OpenLoopsWarning


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
    readings, rest, sound = (DEMO / f"{name}.csv" for name in ("readings", "rest", "check"))
    for check, kinds in ((sound, set()), (path, {"open_loops"})):
        traced = rsicalib.trace(readings, rest=rest, check=check)
        assert traced.verdict == ("partly_explained" if kinds else "explained")
        calibrated = rsicalib.calibrate(readings, rest=rest, check=check)
        for found in (traced, calibrated, rsicalib.fixture(sound, check=check)):
            told = ({of.kind for of in all_of} for all_of in (found.warnings, found.reasons))
            assert [kinds_told & {"open_loops"} for kinds_told in told] == [kinds, kinds]
            said = " ".join(found.summary().split())
            assert ("loops of the check readings have a misclosure of" in said) == bool(kinds)
            assert "and –" not in said and "in in " not in said


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


READINGS, REST = str(DEMO / "readings.csv"), str(DEMO / "rest.csv")

VERBS = {
    "forward": f"forward {READINGS} --calibration R",
    "calibrate": f"calibrate {READINGS} --rest {REST} --calibration R --json",
    "trace": f"trace {READINGS} --rest {REST} --calibration R --json",
    "export": "export R --to toml",
    "corrected": f"export R --to csv --readings {READINGS} --out OUT",
    "certify": "certify R --limit 100 --json",
    "watch": f"watch {READINGS} --calibration R --json",
    "devices": "watch STREAM --calibration FOLDER --json",
    "plan": f"plan --result R --beside {READINGS} --poses 1",
    "bound": "plan --calibration R --poses 12",
    "suppose": f"suppose {READINGS} --calibration R --term curvature@a22.c2=0.02",
    "history": "history FOLDER",
}


def command(words: str, folder: Path, capsys: pytest.CaptureFixture[str]) -> tuple[int, str, str]:
    """Exit code, standard output and standard error of a command on `folder/in/result.json`."""
    own = folder / "in"
    paths = {"R": own / "result.json", "OUT": folder / "out", "FOLDER": own}
    head, *rows = (DEMO / "readings.csv").read_text(encoding="utf-8").splitlines()
    stream = "\n".join([f"device,{head}", *(f"d7,{row}" for row in rows[:8]), ""])
    (folder / "stream.csv").write_text(stream, encoding="utf-8")
    paths["STREAM"] = folder / "stream.csv"
    with pytest.raises(SystemExit) as left:
        main([str(paths.get(word, word)) for word in words.split()])
    out, err = capsys.readouterr()
    return int(left.value.code or 0), out, err


@pytest.mark.parametrize("verb", VERBS)
def test_every_verb_tells_an_edited_result_alike(
    verb: str, result: dict[str, Any], tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """One value moved by one standard deviation: loops, poses and budgets show nothing of it."""
    first, *others = result["parameters"]
    moved = {**first, "value": first["value"] + first["sd"]}
    named = {**result, "device": "d7", "valid_from": "2025-03-01"}
    (tmp_path / "in").mkdir()
    for edited, parameters in ((False, [first, *others]), (True, [moved, *others])):
        whole = {**named, "parameters": parameters}
        (tmp_path / "in" / "result.json").write_text(json.dumps(whole), encoding="utf-8")
        words = VERBS[verb] if not edited else VERBS[verb].replace("OUT", "OUT --force")
        code, out, err = command(words, tmp_path, capsys)
        told = [line for line in err.splitlines() if "were edited after it was written" in line]
        assert len(told) == edited, err
        if not edited:
            usual = code
        else:
            assert code == (usual or 4)
            assert told[0].startswith("warning: numbers of ") and "result.json" in told[0]
    if verb in ("calibrate", "trace"):
        assert "edited" in {one["kind"] for one in json.loads(out)["warnings"]}


def test_functions_tell_it_where_they_were_called(result: dict[str, Any], tmp_path: Path) -> None:
    first, *others = result["parameters"]
    moved = {**first, "value": first["value"] + first["sd"]}
    edited = read({**result, "parameters": [moved, *others]}, tmp_path)
    calls: list[Callable[[], object]] = [
        lambda: rsicalib.forward(DEMO / "check.csv", calibration=edited),
        lambda: rsicalib.Monitor(edited),
        lambda: rsicalib.Placer(calibration=edited),
        lambda: rsicalib.certify(edited, limit=1.0),
        lambda: rsicalib.suppose(DEMO / "check.csv", ["curvature@a22.c2=0.02"], calibration=edited),
    ]
    for call in calls:
        with pytest.warns(OpenLoopsWarning, match=r"numbers of .*result.json were edited") as told:
            call()
        assert {one.filename for one in told} == {__file__}


@pytest.mark.parametrize("factor", [10.0, 100.0, 1e3, 1e4])
def test_sensors_all_too_steep_are_told_without_a_digest(
    factor: float, result: dict[str, Any], tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """Whatever its loops do, such a result expects it: its own session was closed far better."""
    own = [
        {**p, "value": factor * p["value"]} if p["term"] == "gain" else p
        for p in result["parameters"]
    ]
    whole = {key: value for key, value in result.items() if key != "digest"}
    (tmp_path / "in").mkdir()
    for parameters, code in ((own, 4), (result["parameters"], 0)):
        changed = {**whole, "parameters": parameters}
        (tmp_path / "in" / "result.json").write_text(json.dumps(changed), encoding="utf-8")
        for verb in ("watch", "export"):
            assert command(VERBS[verb], tmp_path, capsys)[0] == code


def test_a_sensor_that_is_not_as_noisy_as_a_result_without_a_digest_says_is_told(
    result: dict[str, Any], tmp_path: Path
) -> None:
    """Poses weigh arms by the noise: 15 standard deviations, of which 100,000 edits had one."""
    whole = {key: value for key, value in result.items() if key != "digest"}
    sigma = {**whole["noise"]["sigma"], "a22": 8.5 * whole["noise"]["sigma"]["a22"]}
    edited = {**whole, "noise": {**whole["noise"], "sigma": sigma}}
    for table in (DEMO / "readings.csv", DEMO / "check.csv"):
        with pytest.warns(OpenLoopsWarning, match="close better than the noise"):
            rsicalib.forward(table, calibration=read(edited, tmp_path))
        with warnings.catch_warnings():
            warnings.simplefilter("error", OpenLoopsWarning)
            rsicalib.forward(table, calibration=read(whole, tmp_path))


def test_what_was_deleted_beside_the_digest_is_told(result: dict[str, Any], tmp_path: Path) -> None:
    bare = {k: v for k, v in result.items() if k not in ("digest", "misclosure")}
    with pytest.warns(OpenLoopsWarning, match="neither a `digest` nor the `misclosure`"):
        rsicalib.forward(DEMO / "check.csv", calibration=read(bare, tmp_path))
    first, *others = result["parameters"]
    other = {**result, "parameters": [{**first, "unit": "deg"}, *others]}
    with pytest.raises(InputError, match=r"parameters\[0\].unit: found 'deg', expected 'rad'"):
        rsicalib.forward(DEMO / "check.csv", calibration=read(other, tmp_path))


def test_numbers_that_are_changed_in_memory_are_edited() -> None:
    found = rsicalib.calibrate(DEMO / "readings.csv", rest=DEMO / "rest.csv")
    first = found.parameters[0]
    assert first.value is not None
    changed = (replace(first, value=first.value + 1e-9), *found.parameters[1:])
    assert replace(found, parameters=changed).edited
