"""Mechanisms that come with the package load, and are what their pages say."""

from __future__ import annotations

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
