"""A point and its image have the same distances from places on one line: both are told."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

import rsicalib
from tests.full import sized
from tests.oracle import Array

ANCHORS = np.array([[12.0, 2015.0], [2921.0, 1990.0], [0.0, 0.0], [2890.0, 0.0]])
"""Where the belts end, in the order of the columns [mm]."""
HEIGHTS = np.array([100.0, 56.0, 34.0, 78.0])
"""Of the belts' layers, as the mechanism draws them."""
BELTS = ("tl", "tr", "bl", "br")


def lengths(places: Array, seed: int) -> dict[str, Array]:
    """What the belts read at some places, with half a millimetre of noise."""
    rng = np.random.default_rng(seed)
    apart = np.linalg.norm(places[:, None] - ANCHORS[None], axis=2)
    read = np.hypot(apart, HEIGHTS) + rng.normal(0, 0.5, apart.shape)
    return {"pose": np.arange(1, len(places) + 1), **dict(zip(BELTS, read.T, strict=True))}


def told(places: Array, seed: int = 0) -> dict[str, str]:
    """The points of which an image is told, and the words."""
    found = rsicalib.calibrate(lengths(places, seed), "maslow")
    return {str(w.target): w.text for w in found.warnings if w.kind == "mirrored"}


@pytest.mark.parametrize("height", [300.0, 900.0, 1500.0])
@pytest.mark.parametrize("count", [4, 6])
def test_places_in_one_row_leave_an_image_of_each_anchor_that_is_free_across_it(
    height: float, count: int
) -> None:
    row = np.column_stack([np.linspace(600, 2300, count), np.full(count, height)])
    found = told(row)
    assert set(found) == {"top left", "top right"}
    # Beyond the row by as much: noise of half a millimetre moves it by a few.
    x, y = (float(v) for v in found["top left"].split("(")[1].split(")")[0].split(",")[:2])
    assert abs(x - ANCHORS[0, 0]) < 20 and abs(y - (2 * height - ANCHORS[0, 1])) < 30


def test_places_in_one_column_leave_one_of_the_anchor_that_is_free_along_x_too() -> None:
    column = np.column_stack([np.full(6, 1450.0), np.linspace(400, 1600, 6)])
    found = told(column)
    assert set(found) == {"top left", "top right", "bottom right"}
    assert "have one x" in found["bottom right"]


@pytest.mark.parametrize("seed", range(sized(1, 3)))
def test_places_all_over_the_frame_leave_none(seed: int) -> None:
    grid = np.stack(np.meshgrid([700.0, 1450.0, 2200.0], [500.0, 1000.0, 1500.0]), -1)
    assert not told(grid.reshape(-1, 2), seed)


def test_one_place_off_the_row_decides() -> None:
    row = np.column_stack([np.linspace(600, 2300, 6), np.full(6, 900.0)])
    assert not told(np.vstack([row, [[1400.0, 500.0]]]))


BALL_BAR = """
name = "arm and bar"
length_unit = "mm"
point = [
  {name = "ball", chain = "arm", at = [0.0, 0.0, 0.0]},
  {name = "post", unknown = [], at = [700.0, 150.0, 150.0]},
]
channel = [
  {name = "q1", unit = "rad", gain = 1.0, offset = 0.0, noise = 1e-5},
  {name = "q2", unit = "rad", gain = 1.0, offset = 0.0, noise = 1e-5},
  {name = "bar", unit = "mm", gain = 1.0, offset = 0.0, noise = 0.02},
]
closure = [
  {name = "bar", kind = "distance", between = ["ball", "post"], channel = "bar", noise = 0.02},
]
[[chain]]
name = "arm"
dh = [{channel = "q1", a = 300.0}, {channel = "q2", a = 200.0}]
[model]
terms = []
"""


def barred() -> dict[str, Array]:
    """Readings of the arm in its plane, and of the bar to a post 170 mm above it."""
    rng = np.random.default_rng(5)
    q = rng.uniform([-1, 0.3], [1, 2.0], (30, 2))
    ball = np.column_stack(
        [
            300 * np.cos(q[:, 0]) + 200 * np.cos(q.sum(1)),
            300 * np.sin(q[:, 0]) + 200 * np.sin(q.sum(1)),
            np.zeros(30),
        ]
    )
    bar = np.linalg.norm(ball - [680.0, 160.0, 170.0], axis=1) + rng.normal(0, 0.02, 30)
    return {"pose": np.arange(1, 31), "q1": q[:, 0], "q2": q[:, 1], "bar": bar}


def test_a_bar_to_an_arm_in_a_plane_leaves_the_post_above_and_below(tmp_path: Path) -> None:
    (tmp_path / "bar.toml").write_text(BALL_BAR)
    found = rsicalib.calibrate(barred(), tmp_path / "bar.toml")
    (warning,) = [w for w in found.warnings if w.kind == "mirrored"]
    assert warning.target == "post" and "lie on one plane" in warning.text
    height = next(p for p in found.parameters if p.target == "post" and p.name == "z").value
    assert height == pytest.approx(170.0, abs=1.0), "the one on the side of `at`"


def test_where_nothing_is_drawn_neither_solution_is_the_nearer_one(tmp_path: Path) -> None:
    (tmp_path / "bar.toml").write_text(BALL_BAR.replace(", at = [700.0, 150.0, 150.0]", ""))
    found = rsicalib.calibrate(barred(), tmp_path / "bar.toml")
    (warning,) = [w for w in found.warnings if w.kind == "mirrored"]
    assert "Nothing says which is right: give `at`" in warning.text
    height = next(p for p in found.parameters if p.target == "post" and p.name == "z").value
    assert abs(height) == pytest.approx(170.0, abs=1.0)
