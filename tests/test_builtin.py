"""Mechanisms that come with the package load, and are what their pages say."""

from __future__ import annotations

import numpy as np
import pytest

import rsicalib
from rsicalib.io.builtin import BUILTIN


@pytest.mark.parametrize(
    ("name", "channels", "kinds", "equations"),
    [
        ("maslow", ["tl", "tr", "bl", "br"], {"distance"}, 4),
        ("delta", ["a", "b", "c"], {"distance", "plane"}, 4),
        ("so101", None, {"equal"}, 5),
    ],
)
def test_a_built_in_mechanism_is_a_file_that_its_owner_may_change(
    name: str, channels: list[str] | None, kinds: set[str], equations: int
) -> None:
    mechanism = rsicalib.load_mechanism(name)
    assert mechanism.name == name
    assert {closure["kind"] for closure in mechanism.to_dict()["closure"]} == kinds
    assert mechanism.equations == equations
    assert channels is None or [c.name for c in mechanism.channels] == channels
    assert rsicalib.load_mechanism(mechanism.to_toml()) == mechanism


def test_all_files_of_the_package_are_built_in() -> None:
    assert list(BUILTIN) == ["rsi", "delta", "maslow", "so101"]


def test_a_distance_between_points_of_a_group_is_no_equation_of_a_sample() -> None:
    """A ball in sockets whose distance is known: a touch has three equations, the distance none."""
    text = """
name = "arm"
length_unit = "m"
channel = [{name = "q", unit = "rad", gain = 1.0, offset = 0.0}]
chain = [{name = "arm", dh = [{channel = "q", a = 0.4}]}]
point = [{name = "ball", chain = "arm", at = [0.1, 0.0, 0.0]}, {name = "socket", unknown = ["at"]}]
closure = [
  {name = "in", kind = "touch", between = ["ball", "socket"]},
  {name = "pair", kind = "distance", between = ["socket[at=A]", "socket[at=B]"], value = 0.15},
]
"""
    assert rsicalib.load_mechanism(text).equations == 3


def belts(order: str = "tl tr bl br", scale: float = 1.0) -> dict[str, np.ndarray]:
    """Belts of a sled at 36 places, simulated by distances alone; columns in another order."""
    anchors = {"tl": (12, 2031, 100), "tr": (2870, 2018, 56), "bl": (0, 0, 34), "br": (2889, 0, 78)}
    rng = np.random.default_rng(50)
    x, y = np.meshgrid(np.linspace(500, 2400, 6), np.linspace(400, 1600, 6))
    read = []
    for a, b, height in anchors.values():
        apart = np.sqrt((x - a) ** 2 + (y - b) ** 2 + height**2).ravel()
        read.append(scale * (apart + rng.normal(0, 0.3, 36)))
    return {"pose": np.arange(1, 37), **dict(zip(order.split(), read, strict=True))}


@pytest.mark.parametrize("order", ["tr tl bl br", "tl br bl tr", "bl tr tl br"])
def test_belts_whose_columns_are_exchanged_are_said_to_be(order: str) -> None:
    """Anchors that are unknown close the loops with any names: the drawing tells."""
    found = rsicalib.calibrate(belts(order), "maslow")
    assert found.verdict == "unexplained" and found.exit_code == 4
    assert rsicalib.trace(belts(order), "maslow").exit_code == 4
    (warning,) = [one for one in found.warnings if one.kind == "exchanged"]
    exchanged = {a for a, b in zip(order.split(), ("tl", "tr", "bl", "br"), strict=True) if a != b}
    # Of a rectangle the other two exchanged are its mirror image.
    assert set(str(warning.target).split("+")) in (exchanged, {"tl", "tr", "bl", "br"} - exchanged)
    assert not [
        one for one in rsicalib.calibrate(belts(), "maslow").warnings if one.kind == "exchanged"
    ]


def test_belts_in_metres_for_millimetres_are_implausible() -> None:
    found = rsicalib.calibrate(belts(scale=1e-3), "maslow")
    assert found.verdict == "implausible"


def test_a_follower_that_counts_backwards_is_named() -> None:
    """Its gain is fitted at minus one, and everything closes."""
    rng = np.random.default_rng(3)
    joints = ["shoulder_pan", "shoulder_lift", "elbow_flex", "wrist_flex", "wrist_roll"]
    leader = rng.uniform(-80.0, 80.0, (80, 5))
    follower = leader + rng.normal(0.0, 0.5, leader.shape)
    follower[:, 2] *= -1.0
    table = {"pose": np.arange(80), **{f"leader_{n}": leader[:, k] for k, n in enumerate(joints)}}
    table |= {f"follower_{n}": follower[:, k] for k, n in enumerate(joints)}
    found = rsicalib.calibrate(table, "so101")
    told = [(w.kind, w.target) for w in found.warnings]
    assert told == [("reversed", "follower_elbow_flex")]
