"""What is found depends on no unit and on no order: degrees for radians, another length, channels
and chains the other way round. Witness: the session as it was drawn."""

from __future__ import annotations

import math
from copy import deepcopy
from dataclasses import replace
from typing import Any

import numpy as np
import pytest

import rsicalib
from tests.families import linkage, trials
from tests.families.device import Session
from tests.families.draw import FAMILIES
from tests.full import sized

DEGREE = math.pi / 180
SAME = 1e-4
"""Changes of χ² that decide nothing: a search ends where half of it promises less than 1e-5."""

Seen = tuple[dict[str, Any], Session]
Told = tuple[str, float, tuple[str, ...], tuple[str, ...]]


def told(seen: Seen) -> Told:
    """Verdict, χ², the effects with what ties with them, and the readings that were left out."""
    mechanism = rsicalib.Mechanism.from_dict(seen[0])
    found = rsicalib.trace(trials.readings_of(mechanism, seen[1]), mechanism)
    assert found.after.chi2 is not None
    ties = ([name(step), *sorted(map(name, step.also_fits))] for step in found.steps)
    left_out = tuple(sorted(f"{e.pose} {e.channel}" for e in found.excluded))
    return str(found.verdict), found.after.chi2, tuple(" ".join(t) for t in ties), left_out


def name(found: Any) -> str:
    """Term, target and place."""
    return f"{found.term}@{found.target}:{found.place}"


def in_degrees(mechanism: dict[str, Any], session: Session) -> Seen:
    """Encoders that read degrees: all of their keys are in degrees."""
    values = session.values.copy()
    for k, channel in enumerate(mechanism["channel"]):
        if channel["unit"] == "rad":
            channel |= {"unit": "deg"}
            numbers = {key: channel[key] for key in ("noise", "offset") if key in channel}
            channel |= {key: value / DEGREE for key, value in numbers.items()}
            ends = {key: channel[key] for key in ("limits", "range") if key in channel}
            channel |= {key: [end / DEGREE for end in value] for key, value in ends.items()}
            values[:, k] /= DEGREE
    return mechanism, session.changed(values)


def in_thousandths(mechanism: dict[str, Any], session: Session) -> Seen:
    """Every length in a unit that is a thousand times longer."""
    slides = linkage.slides(mechanism)
    mechanism["length_unit"] = "m"
    for row in (row for chain in mechanism["chain"] for row in chain["dh"]):
        row |= {key: 1e-3 * row[key] for key in ("a", "d") if key in row}
        row |= {key: [1e-3 * x for x in row[key]] for key in ("xyz", "com") if key in row}
    for point in mechanism["point"]:
        point |= {key: [1e-3 * x for x in point[key]] for key in ("at",) if key in point}
    for closure in mechanism["closure"]:
        lengths = {key: closure.get(key) for key in ("value", "noise", "sd")}
        closure |= {key: 1e-3 * x for key, x in lengths.items() if isinstance(x, float)}
    for channel in (c for c in mechanism["channel"] if slides[c["name"]]):
        channel |= {key: 1e-3 * channel[key] for key in ("gain", "offset")}
        channel["limits"] = [1e-3 * x for x in channel["limits"]]
    columns = {name: 1e-3 * column for name, column in session.columns.items()}
    return mechanism, replace(session, columns=columns)


def turned_round(mechanism: dict[str, Any], session: Session) -> Seen:
    """Channels, chains, points and closures in the other order."""
    for key in ("channel", "chain", "point", "closure"):
        mechanism[key].reverse()
    return mechanism, session.changed(np.ascontiguousarray(session.values[:, ::-1]))


def all_of_them(mechanism: dict[str, Any], session: Session) -> Seen:
    """One after the other."""
    return turned_round(*in_thousandths(*in_degrees(mechanism, session)))


@pytest.mark.parametrize("family", list(FAMILIES)[:: sized(2, 1)])
def test_units_and_orders_change_nothing(family: str) -> None:
    case = trials.make(family, "single", 2, 31337)
    mechanism = case.device.drawing.mechanism
    plain = told((deepcopy(mechanism), case.session))
    for change in sized((all_of_them,), (in_degrees, in_thousandths, turned_round)):
        verdict, chi2, steps, left_out = told(change(deepcopy(mechanism), case.session))
        assert (verdict, steps, left_out) == (plain[0], plain[2], plain[3]), change.__name__
        assert abs(chi2 - plain[1]) < SAME * max(1.0, plain[1]), change.__name__
