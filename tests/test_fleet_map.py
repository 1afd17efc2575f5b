"""The map of a fleet: devices by parameters."""

from __future__ import annotations

import itertools
import json
import re
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import rsicalib
from rsicalib import _core
from rsicalib.fleets.map import MOST_DEVICES, map_figure
from rsicalib.fleets.page import page
from rsicalib.fleets.standing_out import remarks, spreads
from rsicalib.report.figure import STYLE
from rsicalib.report.svg import NARROW, WIDE
from tests.test_families import clean

COUNT = 100
NAMES = ("offset@a11", "gain@a11")


def drawn() -> dict[str, list[object]]:
    rng = np.random.default_rng(0)
    rows: dict[str, list[object]] = {
        "device": [f"no. {k}" for k in range(COUNT)],
        "verdict": ["adequate"] * COUNT,
        "message": [""] * COUNT,
        "steps": ["[]"] * COUNT,
        "chi2": [126.0] * COUNT,
        "dof": [126.0] * COUNT,
        "p_value": rng.uniform(size=COUNT).tolist(),
    }
    for name in NAMES:
        rows[name] = (1.0 + 0.02 * rng.standard_normal(COUNT)).tolist()
        rows[f"{name}_sd"] = [0.003] * COUNT
    rows["gain@a11"][17] = 1.3
    return rows


def test_the_map_has_the_farthest_devices_with_their_distances() -> None:
    rows = drawn()
    figure = map_figure(spreads(rows), rows, "device")
    assert figure is not None
    values = np.array([rows[name] for name in NAMES], dtype=float)
    middle = np.median(values, axis=1, keepdims=True)
    between = 1.4826 * np.median(np.abs(values - middle), axis=1, keepdims=True)
    far = ((values - middle) / between).T
    order = np.argsort(-np.abs(far).max(axis=1))[:MOST_DEVICES]
    for width in (NARROW, WIDE):
        said = re.findall(r"<title>(no\. \d+), (\S+): (\S+) sd</title>", figure.draw(width))
        expected = [
            (f"no. {d}", name, f"{far[d, k]:+.1f}") for d in order for k, name in enumerate(NAMES)
        ]
        # On a desk devices stand side by side, row by row of a parameter.
        across = [expected[k :: len(NAMES)] for k in range(len(NAMES))]
        assert said == (expected if width == NARROW else list(itertools.chain(*across)))
        assert figure.draw(width).count('class="above3"') == 1 + 1  # and in the scale
    assert f"{COUNT - MOST_DEVICES} more are nearer" in figure.caption


def test_what_stands_out_comes_first_in_the_map_and_leads_to_its_report() -> None:
    rows = drawn()
    figure = map_figure(spreads(rows), rows, "device", ["no. 40", "no. 17"], {"no. 40": "a/1.html"})
    assert figure is not None
    for width in (NARROW, WIDE):
        said = re.findall(r"<title>(no\. \d+), gain@a11", figure.draw(width))
        assert said[:2] == ["no. 40", "no. 17"]
        (linked,) = re.findall(r'<a href="(.*?)"><text[^>]*>(.*?)</text></a>', figure.draw(width))
        assert linked == ("a/1.html", "no. 40")
        assert 'role="group"' in figure.draw(width)  # what is in a picture is not reached
    assert "Those first that stand out, then those that are farthest" in figure.caption


def test_what_is_not_known_is_no_dark_cell() -> None:
    """A device that could not be calibrated was a row of black cells."""
    rows = drawn()
    for name in NAMES:
        rows[name][8] = rows[f"{name}_sd"][8] = None
    rows = {name: cells[:MOST_DEVICES] for name, cells in rows.items()}
    figure = map_figure(spreads(rows), rows, "device")
    assert figure is not None
    (cell,) = set(re.findall(r'class="(\w+)"[^>]*><title>no\. 8,', figure.draw(WIDE)))
    assert re.search(rf"svg \.{cell} {{ fill: none;", STYLE)


def paged(rows: dict[str, list[Any]], at: Path | None = None) -> str:
    """The page of a fleet's rows."""
    spread = spreads(rows)
    out = remarks(rows, "device", spread)
    return page(rows, "device", rsicalib.load_mechanism("rsi"), spread, out, at=at)


def test_why_of_a_traced_device_is_what_was_found() -> None:
    rows = drawn()
    rows["verdict"][5] = "explained"
    rows["steps"][5] = json.dumps([{"term": "once_per_turn", "target": "a22"}])
    text = paged(rows)
    assert '<td>no. 5</td><td>explained</td><td class="long">once per turn of a22</td>' in text
    assert '<figure id="map">' in text


def test_a_device_that_stands_out_has_one_row_with_why_and_a_link(tmp_path: Path) -> None:
    """A device of random readings had a row for each of its parameters, and its verdict after."""
    rows = drawn()
    rows["file"] = [str(tmp_path / f"device {k}" / "readings.csv") for k in range(COUNT)]
    for k, verdict, message in (
        (3, "implausible", "noise of 110 count in a11"),
        (4, "unexplained", "Errors of arm3 alone explain it. " + 99 * "More words. "),
        (5, "partly_explained", "Something is left."),
    ):
        rows["verdict"][k], rows["message"][k] = verdict, message
        for name in NAMES:
            rows[name][k] = 9.0 + k
    rows["steps"][5] = json.dumps([{"term": "wander", "target": "a12"}])
    text = paged(rows, at=tmp_path / "out")
    found = dict(
        re.findall(r'>(no\. \d+)</a></td><td>[\w ]+</td><td class="long">(.*?)</td>', text)
    )
    assert found["no. 3"] == "noise of 110 count in a11"  # its numbers mean nothing
    assert found["no. 4"].startswith("Errors of arm3 alone explain it.")
    assert found["no. 4"].endswith(" …") and len(found["no. 4"]) <= 240
    assert re.fullmatch(
        r"wander of a12; Something is left\.; \S+ = 14: .*; and 1 more parameter", found["no. 5"]
    )
    assert found["no. 17"].startswith("gain@a11 = 1.3: ")
    assert len(found) == 4 and all(found.values())
    assert text.count('<a href="../device%203/readings.csv">no. 3</a>') == 1


@pytest.mark.parametrize("misfit", [False, True])
def test_a_fleet_that_does_not_fit_together_is_no_good_one(*, misfit: bool) -> None:
    rows = drawn()
    html = page(rows, "device", rsicalib.load_mechanism("rsi"), [], [], misfit=misfit)
    assert ('class="verdict bad"' in html) == misfit
    assert ('class="verdict good"' in html) == (not misfit)


def test_numbers_of_a_fleet_have_units() -> None:
    """Witness: the units that a result of the same mechanism writes."""
    found = rsicalib.calibrate(rsicalib.simulate(seed=1).readings)
    units = {p.key: p.unit for p in found.parameters}
    rows = drawn()
    html = paged(rows)
    table = html[html.index("<h2>Parameters over the fleet</h2>") :]
    cells = dict(re.findall(r"<tr><td>([a-z]+@a\d\d)[^[]*\[(.*?)\]", table))
    assert cells == {name: units[name] for name in NAMES}


def test_every_parameter_has_its_unit_by_the_name_of_its_column() -> None:
    """Places, targets of several, coordinates of unknown things; witness: what results write."""
    rsi = rsicalib.load_mechanism("rsi")
    terms = ["offset", "gain", "curvature@each.2", "once_per_turn@a12", "crosstalk@a22:a21"]
    made = rsicalib.simulate(seed=1).readings
    found = rsicalib.calibrate(made, terms=[*terms, "link_length@arm1/2", "gain@each.1"])
    _, _, sockets, readings = clean("sockets")
    for mechanism, one in ((rsi, found), (sockets, rsicalib.calibrate(readings, sockets))):
        units = {p.key: p.unit for p in one.parameters}
        assert {key: _core.unit_of_key(mechanism, key) for key in units} == units
    assert _core.unit_of_key(rsi, "slip@a22") is None  # its name is not said
    assert _core.unit_of_key(rsi, "gain@a77") is None
