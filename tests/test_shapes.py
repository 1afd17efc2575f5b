"""The shapes of results are those of the core: generated, and read back as they were written."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import pytest

import rsicalib
from rsicalib import DEMO, InputError
from scripts.make_shapes import files


def test_the_classes_and_the_schema_are_those_of_the_core() -> None:
    for path, text in files().items():
        assert path.read_text(encoding="utf-8") == text, "run `python -m scripts.make_shapes`"


@pytest.fixture(scope="module")
def traced() -> dict[str, Any]:
    return rsicalib.trace(DEMO / "readings.csv", rest=DEMO / "rest.csv").to_dict()


def test_a_result_is_read_back_to_the_last_digit(traced: dict[str, Any], tmp_path: Path) -> None:
    path = tmp_path / "result.json"
    path.write_text(json.dumps(traced), encoding="utf-8")
    assert rsicalib.load_calibration(path).to_dict() == traced


def damaged(result: dict[str, Any], keys: tuple[str | int, ...], value: Any) -> dict[str, Any]:
    """A copy with another value at one place; the entry is removed where it is `...`."""
    copy: Any = json.loads(json.dumps(result))
    entry = copy
    for key in keys[:-1]:
        entry = entry[key]
    if value is ...:
        del entry[keys[-1]]
    else:
        entry[keys[-1]] = value
    out: dict[str, Any] = copy
    return out


@pytest.mark.parametrize(
    ("keys", "value", "place"),
    [
        (("parameters", 3, "value"), "x", r"parameters\[3\]\.value"),
        (("parameters", 3), ..., "covariance"),
        (("parameters", 3, "target"), None, r"parameters\[3\]\.target"),
        (("parameters", 3, "sd"), -1.0, r"parameters\[3\]\.sd"),
        (("parameters", 3, "interval"), [1e5, 2e5], r"parameters\[3\]\.interval"),
        (("covariance", 0), ..., "covariance"),
        (("covariance", 0, 0), "1", r"covariance\[0\]\[0\]"),
        (("reference", "span"), [], r"reference\.span"),
        (("reference", "centre", 0), None, r"reference\.centre\[0\]"),
        (("noise", "sigma", "a11"), 0.0, r"noise\.sigma\.a11"),
        (("verdict",), "splendid", "verdict"),
        (("readings",), ..., "readings"),
        (("format",), "rsicalib.trace/2", "format"),
    ],
)
def test_a_damaged_result_is_refused_by_place(
    traced: dict[str, Any], tmp_path: Path, keys: tuple[str | int, ...], value: Any, place: str
) -> None:
    path = tmp_path / "result.json"
    path.write_text(json.dumps(damaged(traced, keys, value)), encoding="utf-8")
    with pytest.raises(InputError, match=place):
        rsicalib.load_calibration(path)


def test_a_parameter_twice_is_refused(traced: dict[str, Any], tmp_path: Path) -> None:
    parameters = [*traced["parameters"][:-1], traced["parameters"][0]]
    path = tmp_path / "result.json"
    path.write_text(json.dumps({**traced, "parameters": parameters}), encoding="utf-8")
    with pytest.raises(InputError, match="again"):
        rsicalib.load_calibration(path)


@pytest.mark.parametrize("text", ["NaN", "Infinity", "{", "[" * 100_000, '{"format": 1e999}'])
def test_text_that_is_no_result_is_refused(tmp_path: Path, text: str) -> None:
    path = tmp_path / "result.json"
    path.write_text(text, encoding="utf-8")
    with pytest.raises(InputError, match="found"):
        rsicalib.load_calibration(path)
