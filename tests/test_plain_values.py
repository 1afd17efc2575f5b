"""Mechanisms of plain values: what Python has, and what is refused, with its place."""

from __future__ import annotations

import copy
import tomllib
from collections.abc import Callable
from typing import Any

import numpy as np
import pytest

import rsicalib
from rsicalib.errors import InputError

BELTS = rsicalib.load_mechanism("maslow").to_dict()


def changed(change: Callable[[dict[str, Any]], object]) -> dict[str, Any]:
    values = copy.deepcopy(BELTS)
    change(values)
    return values


def at(path: str, value: object) -> Callable[[dict[str, Any]], object]:
    """Sets one entry: `point[1].at`."""
    *folders, last = path.replace("[", ".").replace("]", "").split(".")

    def change(values: Any) -> None:
        for folder in folders:
            values = values[int(folder) if folder.isdigit() else folder]
        values[int(last) if last.isdigit() else last] = value

    return change


@pytest.mark.parametrize(
    ("path", "value"),
    [
        ("point[1].at", np.array([0.0, 2000.0, 100.0])),
        ("point[1].at", (0, 2000, 100)),
        ("channel[0].gain", np.float32(1.0)),
        ("channel[0].gain", np.int64(1)),
        ("channel[0].gain", 1),
        ("gravity", None),
    ],
)
def test_arrays_numbers_of_numpy_tuples_and_none_are_plain_values(path: str, value: object) -> None:
    declared = rsicalib.Mechanism.from_dict(changed(at("point[1].at", [0.0, 2000.0, 100.0])))
    assert rsicalib.Mechanism.from_dict(changed(at(path, value))) is not None
    if path != "gravity":
        both = changed(at("point[1].at", [0.0, 2000.0, 100.0]))
        at(path, value)(both)
        assert rsicalib.Mechanism.from_dict(both) == declared


@pytest.mark.parametrize(
    ("path", "value", "found", "expected"),
    [
        ("closure[0].value", True, "", "expected a number, or the name of a column"),
        ("closure[0].value", [1.0], "", "expected a number, or the name of a column"),
        ("point[1].unknown", "at", 'found text "at"', "expected a list"),
        ("point[1].unknown", True, "found true", "expected a list"),
        ("point[1].unknown[0]", 3, "found 3", "expected text"),
        ("channel[0].gain", "1.0", 'found text "1.0"', "expected a number"),
        ("channel[0].gain", [1.0], "found a list", "expected a number"),
        ("point[1].at", [1.0, 2.0], "found a list of 2", "expected a list of 3"),
        ("point[1].at", "here", 'found text "here"', "expected a list"),
        ("point[1].at", b"at", "found a value of type bytes", "expected plain values"),
        ("channel", {"name": "a"}, "found an object", "expected a list"),
        ("closure", "x", 'found text "x"', "expected a list"),
        ("model", "offset", 'found text "offset"', "expected an object"),
        ("name", object(), "found a value of type object", "expected plain values"),
        ("name", {1: 2}, "found the key 1", "expected plain values"),
    ],
)
def test_a_value_of_another_type_is_refused_with_its_path(
    path: str, value: object, found: str, expected: str
) -> None:
    def change(values: dict[str, Any]) -> None:
        values["closure"][0].pop("channel", None)
        values["point"][1]["unknown"] = ["place"]
        at(path, value)(values)

    with pytest.raises(InputError) as caught:
        rsicalib.Mechanism.from_dict(changed(change))
    message = str(caught.value)
    assert path.removesuffix("[0]") in message
    assert found in message
    assert expected in message


def test_the_words_are_those_of_a_file() -> None:
    text = 'name = "x"\nlength_unit = "mm"\n[[point]]\nname = "p"\nunknown = "at"\n'
    for of in (
        lambda: rsicalib.Mechanism.from_toml(text),
        lambda: rsicalib.Mechanism.from_dict(tomllib.loads(text)),
    ):
        with pytest.raises(InputError, match=r'found text "at", expected a list'):
            of()


def test_values_in_themselves_are_refused() -> None:
    values: dict[str, Any] = copy.deepcopy(BELTS)
    values["model"] = values
    with pytest.raises(InputError, match="in each other"):
        rsicalib.Mechanism.from_dict(values)


def test_a_thing_of_a_kind_of_which_there_is_none_is_told() -> None:
    def change(values: dict[str, Any]) -> None:
        between = values["closure"][0]["between"]
        values["closure"].append({"name": "table", "kind": "plane", "between": between})

    with pytest.raises(InputError, match=r"found plane .*; expected one that is declared, and no"):
        rsicalib.Mechanism.from_dict(changed(change))
