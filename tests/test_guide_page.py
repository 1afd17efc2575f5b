"""The page of the guide in a real browser, in states that are written here."""

from __future__ import annotations

import json
from importlib.resources import files
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from tests.browser import look, needs_chromium

pytestmark = needs_chromium

NOW = [[-2.057, 0.587, -0.37], [-4.188, 0.654, -1.856], [-3.452, 2.772, -0.544]]
WANT = [[-1.891, 1.653, 0.561], [-2.944, -0.26, -0.847], [-4.251, 1.955, -0.481]]
UP = {"words": "up", "axis": "up or down", "amount": 0.668, "turn": False, "done": False}
STATE: dict[str, Any] = {
    "mechanism": "rsi",
    "unit": "in",
    "phase": "move",
    "order": {"word": "go", "text": "to pose 6", "trouble": None},
    "handle": {
        "names": ["wrist1", "wrist2", "wrist3"],
        "now": NOW,
        "want": WANT,
        "bounds": [[-3.0, 3.0], [-3.0, 3.0], [-5.7, -0.3]],
        "moves": [UP],
    },
    "course": [[0, 0.215], [1, 0.154], [2, 0.0981], [3, 0.0567], [4, 0.0339], [5, 0.0086]],
    "silent": False,
    "ended": None,
    "channels": [
        {
            "name": "a11",
            "label": None,
            "now": 9.0,
            "want": 5.0,
            "low": 0.0,
            "high": 99.0,
            "loose": 2,
        }
    ],
    "hold": 0.0,
    "next": 6,
    "repeat": None,
    "pose": [0.0] * 6,
    "touch": "",
    "why": "",
    "wait_s": 0.0,
    "taken": 5,
    "held_out": 0,
    "samples": 40,
    "sd": 0.0086,
    "sd_next": 0.0044,
    "target": 0.003,
    "largest": None,
    "named": [],
    "open": [],
    "found": "",
    "verdict": None,
    "troubles": [],
    "message": "",
    "note": "pose 5 is taken",
    "done": False,
}

SEES = """
const boxes = (svg) => [...svg.querySelectorAll(".name")].map((word) => {
  const { x, y, width, height } = word.getBBox();
  return [x, y, width, height];
});
const points = (kind) => document.querySelector(`#above .${kind}`).getAttribute("points")
  .split(" ").map((p) => p.split(",").map(Number));
const shown = [...document.querySelectorAll(".live")].filter((p) => p.getClientRects().length);
const scale = document.querySelector("#above .scale");
return { names: ["above", "front"].map((id) => boxes(document.getElementById(id))),
  ways: shown.length, order: document.getElementById("headline").textContent,
  now: shown.length ? points("now") : [], want: shown.length ? points("want") : [],
  scale: scale && [+scale.getAttribute("d").match(/h([0-9.]+)/)[1],
    scale.nextElementSibling.textContent],
  button: document.getElementById("take-over").getClientRects().length
    ? document.getElementById("take-over").textContent : "",
  troubles: [...document.querySelectorAll("#troubles p")].map((p) => p.textContent),
  open: document.getElementById("open").textContent,
  figures: [...document.querySelectorAll("#course text")].map((t) => t.textContent) };
"""


def seen(folder: Path, **changes: Any) -> dict[str, Any]:
    """What the page shows of a state; it has no script error."""
    whole = files("rsicalib.guide").joinpath("page.html").read_text(encoding="utf-8")
    page = whole.replace("/* the state at first */", json.dumps(STATE | changes))
    found, errors = look(page, SEES, folder, 800)
    assert errors == []
    return dict(found)


def test_the_handle_is_drawn_to_a_scale_and_its_names_lie_apart(tmp_path: Path) -> None:
    found = seen(tmp_path)
    pixels, words = found["scale"]
    each = pixels / float(words.removesuffix(" in"))
    for kind, corners in (("now", NOW), ("want", WANT)):
        drawn, true = np.array(found[kind]), np.array(corners)[:, :2] * [each, -each]
        # Both views have one scale; where its middle is does not matter. Pixels have a tenth.
        np.testing.assert_allclose(drawn - drawn[0], true - true[0], atol=0.3)
    assert np.ptp(np.array(found["now"]), axis=0).max() > 60.0  # a quarter of the view
    for boxes in found["names"]:
        for k, (x, y, wide, high) in enumerate(boxes):
            assert x >= 0.0 and x + wide <= 260.0
            for other in boxes[:k]:
                apart_x = x >= other[0] + other[2] or other[0] >= x + wide
                apart_y = abs(y - other[1]) >= 0.7 * high
                assert apart_x or apart_y
    assert found["figures"] == ["target", f"{0.215:.2g}", "0.0086"]


def test_a_hand_that_is_still_where_nothing_is_taken_is_told_what_to_do(tmp_path: Path) -> None:
    page = (files("rsicalib.guide") / "page.html").read_text(encoding="utf-8")
    for phase, wanted in (("move", "hold it longer"), ("hold", "what it is for")):
        state = STATE | {"phase": phase, "message": "hold it longer", "why": "what it is for"}
        said = page.replace("/* the state at first */", json.dumps(state))
        said, wrong = look(said, 'return document.getElementById("why").textContent;', tmp_path)
        assert (said, wrong) == (wanted, [])


def test_where_no_sample_comes_no_way_to_a_pose_is_shown(tmp_path: Path) -> None:
    """What was shown last is not where the handle is."""
    order = {"word": "wait", "text": "no sample for 9 s", "trouble": None}
    found = seen(tmp_path, silent=True, order=order)
    assert found["ways"] == 0 and "no sample for 9 s" in found["order"]


@pytest.mark.parametrize("word", ["stop", "go"])
def test_where_the_order_is_to_stop_no_way_to_a_pose_is_shown(word: str, tmp_path: Path) -> None:
    found = seen(tmp_path, order={"word": word, "text": "now", "trouble": None})
    assert found["order"] == f"{word} now"
    assert found["ways"] == (word == "go")


@pytest.mark.parametrize("pair", [None, ["a11", "a23"]])
def test_exchanged_wires_can_be_taken_over_where_the_order_is_to_stop(
    pair: list[str] | None, tmp_path: Path
) -> None:
    words = "a11 and a23 look exchanged"
    found = seen(tmp_path, order={"word": "stop", "text": words}, exchanged=pair)
    assert found["button"] == ("Take a11 and a23 for one another" if pair else "")


def test_what_the_order_says_is_not_said_twice_and_other_explanations_are(tmp_path: Path) -> None:
    facts = {"kind": "slip", "target": "a22", "pose": "4"}
    slip = {**facts, "id": "slip@a22:4", "text": "a22 slipped, and more"}
    other = {**facts, "id": "constant@a31", "text": "a31 does not change"}
    order = {"word": "stop", "text": "a22 slipped", "trouble": "slip@a22:4"}
    explained = [
        {"id": "curvature@a22", "text": "a parabola"},
        {"id": "curvature@a22+gain@a11", "text": "both"},
    ]
    changes = {"named": ["a parabola"], "open": explained, "found": "curvature@a22"}
    found = seen(tmp_path, order=order, troubles=[slip, other], **changes)
    assert found["troubles"] == ["a31 does not change"]
    assert found["open"] == "not decided from both"
