"""A reversed sign in machines that close in a mirror, too: either of two channels is named.

Readings are from closed forms and from a forward chain written here, which know what was reversed.
"""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from scipy.optimize import least_squares

import rsicalib
from tests import crank
from tests.crank import NOISE, ROD, encoder, four_bar
from tests.full import sized
from tests.oracle import Array


def of_four_bar(seed: int, rows: int = 60) -> Array:
    """Readings over one turn of the crank."""
    return crank.read(crank.turn(rows), seed)


def of_wires(found: rsicalib.Calibration | rsicalib.Trace) -> list[tuple[str, str | None]]:
    kinds = ("reversed", "either_reversed", "exchanged")
    return [(w.kind, w.target) for w in found.warnings if w.kind in kinds]


@pytest.mark.parametrize("verb", [rsicalib.calibrate, rsicalib.trace])
@pytest.mark.parametrize("terms", [("offset",), ("offset", "gain")])
@pytest.mark.parametrize("signs", [[-1, 1], [1, -1]])
def test_either_encoder_of_a_four_bar_may_be_reversed(
    signs: list[int], terms: tuple[str, ...], verb: Any
) -> None:
    read = of_four_bar(1) * signs
    found = verb({"crank": read[:, 0], "rocker": read[:, 1]}, four_bar(*terms))
    assert of_wires(found) == [("either_reversed", "crank+rocker")]
    # What seems to explain readings of a reversed sensor means nothing.
    assert not getattr(found, "steps", ())


@pytest.mark.parametrize("rows", sized([3, 5, 60], [3, 4, 5, 60]))
@pytest.mark.parametrize("rod", [ROD, 251.0, 265.0])
def test_a_sound_four_bar_and_one_with_a_wrong_rod_are_not_reversed(rod: float, rows: int) -> None:
    for seed in range(sized(2, 3)):
        read = of_four_bar(seed, rows)
        mechanism = four_bar("offset", rod=rod)
        found = rsicalib.calibrate({"crank": read[:, 0], "rocker": read[:, 1]}, mechanism)
        assert of_wires(found) == []


# ------------------------------------------------------------------ an arm that touches two cones

JOINTS = ("pan", "lift", "elbow", "wrist", "roll")
DH = [(0, 150, 20, 1), (0, 0, 300, 0), (0, 0, 250, 0), (1, 0, 0, 1), (0, 120, 0, 0)]
"""`theta d a alpha`, the angles in quarter turns [mm]; lift, elbow and wrist are parallel."""
BALL = [30.0, 20.0, 40.0]
CONES = np.array([[330.0, 150.0, 120.0], [360.0, -150.0, 90.0]])
PLAY = 0.05
"""Of the ball in a cone [mm]."""


def arm() -> rsicalib.Mechanism:
    quarter = np.pi / 2
    rows = [
        {"channel": name, "theta": t * quarter, "d": d, "a": a, "alpha": al * quarter}
        for name, (t, d, a, al) in zip(JOINTS, DH, strict=True)
    ]
    return rsicalib.Mechanism.from_dict(
        {
            "name": "arm at two cones",
            "length_unit": "mm",
            "channel": [encoder(name) for name in JOINTS],
            "chain": [{"name": "arm", "dh": rows}],
            "point": [
                {"name": "ball", "chain": "arm", "at": BALL},
                {"name": "cone", "unknown": ["at"]},
            ],
            "closure": [
                {
                    "name": "ball in cone",
                    "kind": "touch",
                    "between": ["ball", "cone"],
                    "noise": PLAY,
                }
            ],
            "model": {"terms": ["offset"]},
        }
    )


def ball(q: Array) -> Array:
    """Where the ball is, by a chain of the convention of Denavit and Hartenberg."""
    frame = np.eye(4)
    for angle, (t, d, a, al) in zip(q, DH, strict=True):
        c, s = np.cos(angle + t * np.pi / 2), np.sin(angle + t * np.pi / 2)
        ca, sa = np.cos(al * np.pi / 2), np.sin(al * np.pi / 2)
        row = [[c, -s * ca, s * sa, a * c], [s, c * ca, -c * sa, a * s], [0, sa, ca, d]]
        frame = frame @ np.array([*row, [0, 0, 0, 1]])
    there: Array = (frame @ [*BALL, 1.0])[:3]
    return there


def of_arm(seed: int, rows: int = 40) -> tuple[Array, list[str]]:
    rng = np.random.default_rng(seed)
    read: list[Array] = []
    while len(read) < rows:
        place = CONES[len(read) % 2] + PLAY * rng.standard_normal(3)
        start = rng.uniform(-1.6, 1.6, 5)
        found = least_squares(
            lambda q, place=place, start=start: np.r_[ball(q) - place, 1e-5 * (q - start)], start
        )
        if np.linalg.norm(ball(found.x) - place) < 1e-3 and np.abs(found.x).max() < 2.5:
            read.append(found.x + NOISE * rng.standard_normal(5))
    return np.array(read) - [0, 0.02, -0.03, 0.01, 0.04], ["AB"[k % 2] for k in range(rows)]


@pytest.mark.parametrize("reversed_one", sized(["roll"], [None, *JOINTS]))
def test_either_of_two_axes_in_the_mirror_plane_of_an_arm_may_be_reversed(
    reversed_one: str | None,
) -> None:
    """Pan and roll turn about lines in the plane in which the arm bends, which is a mirror."""
    read, at = of_arm(3)
    signs = [-1 if name == reversed_one else 1 for name in JOINTS]
    columns = dict(zip(JOINTS, (read * signs).T, strict=True))
    found = rsicalib.calibrate({**columns, "at": at}, arm())
    if reversed_one is None:
        assert found.verdict == "adequate" and of_wires(found) == []
    elif reversed_one in ("pan", "roll"):
        assert of_wires(found) == [("either_reversed", "pan+roll")]
    else:
        assert of_wires(found) == [("reversed", reversed_one)]
