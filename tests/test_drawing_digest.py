"""A result says which drawing it is of: another machine of the same name is told."""

from __future__ import annotations

import copy
import warnings
from collections.abc import Callable
from typing import Any

import pytest

import rsicalib
from rsicalib import DEMO, OpenLoopsWarning
from rsicalib.errors import InputError

DRAWN = rsicalib.Mechanism.rsi().to_dict()


def lengthened(drawn: dict[str, Any]) -> None:
    drawn["chain"][1]["dh"][-1]["a"] = 1.01 * drawn["chain"][1]["dh"][-1].get("a", 1.0) + 0.01


def reversed_gains(drawn: dict[str, Any]) -> None:
    for channel in drawn["channel"]:
        channel["gain"] = -channel["gain"]


def other_side(drawn: dict[str, Any]) -> None:
    drawn["closure"][0]["value"] *= 1.02


def said_otherwise(drawn: dict[str, Any]) -> None:
    drawn["model"] = {"terms": ["offset"]}
    drawn["channel"][0] |= {"noise": 2.0, "label": "left shoulder"}


@pytest.fixture(scope="module")
def found() -> rsicalib.Trace:
    return rsicalib.trace(DEMO / "readings.csv", rest=DEMO / "rest.csv")


@pytest.mark.parametrize("change", [lengthened, reversed_gains, other_side])
def test_another_drawing_is_told_and_not_signed_for(
    found: rsicalib.Trace, change: Callable[[dict[str, Any]], None]
) -> None:
    drawn = copy.deepcopy(DRAWN)
    change(drawn)
    other = rsicalib.Mechanism.from_dict(drawn)
    with pytest.warns(OpenLoopsWarning, match="drawn otherwise than when this result was made"):
        rsicalib.Monitor(found, other)
    with (
        pytest.warns(OpenLoopsWarning, match="drawn otherwise"),
        pytest.raises(InputError, match="expected the drawing that was traced"),
    ):
        rsicalib.certify(found, other, limit=1.0)


def test_what_is_asked_for_and_how_noisy_it_is_is_no_drawing(found: rsicalib.Trace) -> None:
    drawn = copy.deepcopy(DRAWN)
    said_otherwise(drawn)
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        rsicalib.Monitor(found, rsicalib.Mechanism.from_dict(drawn))
    # A result of an earlier version says nothing of its drawing.
    values = {key: own for key, own in found.to_dict().items() if key != "drawing"}
    changed = copy.deepcopy(DRAWN)
    lengthened(changed)
    rsicalib.Monitor(rsicalib.Trace.from_dict(values), rsicalib.Mechanism.from_dict(changed))
