"""Rigid bodies that are elsewhere in each pose: a plate on six legs, a body on eight cables."""

from __future__ import annotations

from typing import Any

import numpy as np
import numpy.typing as npt
import pytest
from scipy.spatial.transform import Rotation

import rsicalib
from rsicalib import RsicalibError
from tests.full import sized

Array = npt.NDArray[np.float64]


def ring(radius: float, degrees: list[float]) -> Array:
    angles = np.radians(degrees)
    return radius * np.column_stack([np.cos(angles), np.sin(angles), np.zeros(len(angles))])


FEET = ring(300, [-10, 10, 110, 130, 230, 250])
PLATE = ring(150, [-50, 50, 70, 170, 190, 290])
HIGH = 410.0
"""Where the plate is drawn above the feet [mm]."""
ANGLE, LENGTH = 1e-4, 0.01
"""Noise [rad, mm]."""


def channel(name: str, unit: str, noise: float) -> dict[str, Any]:
    return {"name": name, "unit": unit, "gain": 1.0, "offset": 0.0, "noise": noise}


def hexapod() -> dict[str, Any]:
    """Six legs that measure their length; two angles of the first one are read as well."""
    legs = range(1, 7)
    half = np.pi / 2
    first = [
        {"xyz": FEET[0].tolist()},
        {"channel": "u", "alpha": -half},
        {"channel": "v", "alpha": half},
        {"channel": "L1", "joint": "prismatic"},
    ]
    return {
        "name": "hexapod",
        "length_unit": "mm",
        "channel": [channel("u", "rad", ANGLE), channel("v", "rad", ANGLE)]
        + [channel(f"L{k}", "mm", LENGTH) for k in legs],
        "chain": [{"name": "leg1", "dh": first}],
        "frame": [{"name": "plate", "unknown": ["pose"], "pose": [0, 0, HIGH, 0, 0, 0]}],
        "point": [{"name": "end1", "chain": "leg1", "at": [0, 0, 0]}]
        + [{"name": f"p{k}", "frame": "plate", "at": PLATE[k - 1].tolist()} for k in legs]
        + [{"name": f"b{k}", "at": FEET[k - 1].tolist()} for k in legs[1:]],
        "closure": [{"name": "joint1", "kind": "touch", "between": ["end1", "p1"]}]
        + [
            {
                "name": f"leg{k}",
                "kind": "distance",
                "between": [f"p{k}", f"b{k}"],
                "channel": f"L{k}",
            }
            for k in legs[1:]
        ],
        "model": {"terms": ["offset"]},
    }


def of_hexapod(seed: int, poses: int = 50) -> tuple[Array, Array, Array]:
    """Readings, what their offsets are, and where the first corner of the plate was."""
    rng = np.random.default_rng(seed)
    middle = rng.uniform([-60, -60, 360], [60, 60, 460], (poses, 3))
    turned = Rotation.from_rotvec(rng.uniform(-0.3, 0.3, (poses, 3)))
    corners = middle[:, None] + np.stack([turned.apply(corner) for corner in PLATE], axis=1)
    legs = corners - FEET
    lengths = np.linalg.norm(legs, axis=2)
    # The first leg is where its bearing and its lean from the vertical say.
    x, y, z = (legs[:, 0] / lengths[:, :1]).T
    u, v = np.arctan2(y, x), np.arccos(z)
    offsets = np.array([0.004, -0.006, *rng.normal(0, 0.5, 6)])
    read = np.column_stack([u, v, lengths]) - offsets
    noise = np.array([ANGLE, ANGLE, *6 * [LENGTH]])
    return read + noise * rng.standard_normal(read.shape), offsets, corners[:, 0]


@pytest.mark.parametrize("seed", sized([1], [1, 2, 3]))
def test_a_plate_on_six_legs(seed: int) -> None:
    """Offsets of all legs and of the two angles, and where a corner of the plate is."""
    drawn = rsicalib.Mechanism.from_dict(hexapod())
    read, offsets, corner = of_hexapod(seed)
    readings = rsicalib.Readings.from_arrays(drawn, read, pose=np.arange(len(read)))
    found = rsicalib.trace(readings, drawn)
    assert found.verdict == "adequate"
    assert found.steps == ()
    for parameter, true in zip(found.parameters, offsets, strict=True):
        assert parameter.sd is not None
        assert abs(parameter.value - true) < 4 * parameter.sd, parameter
        assert parameter.sd < (1e-3 if parameter.unit == "rad" else 0.2), parameter
    # What the chain of the first leg carries is the corner that the plate has there.
    placed = rsicalib.forward(readings, drawn, found)
    assert np.sqrt(np.mean((placed[:, :3] - corner) ** 2)) < 0.1


def test_a_slip_of_a_leg_is_named() -> None:
    drawn = rsicalib.Mechanism.from_dict(hexapod())
    read, *_ = of_hexapod(5)
    read[30:, 4] -= 0.3
    readings = rsicalib.Readings.from_arrays(
        drawn, read, pose=np.arange(len(read)), time_s=10.0 * np.arange(len(read))
    )
    found = rsicalib.trace(readings, drawn)
    assert found.verdict == "explained"
    assert [(step.term, step.target) for step in found.steps] == [("slip", "L3")]


# ------------------------------------------------------------------ a body on eight cables

WINCHES = np.array([[x, y, z] for z in (0.0, 3.0) for x in (-2, 2) for y in (-1.5, 1.5)])
CORNERS = np.array([[x, y, 0.2 if x < y else 0] for x in (-0.2, 0.2) for y in (-0.15, 0.15)])
ENDS = [0, 1, 2, 3, 1, 3, 0, 2]
"""The corner that each cable holds: the upper ones cross, or nothing would hold the bearing."""
CABLE = 3e-4
"""Noise [m]."""


def on_cables(**body: Any) -> dict[str, Any]:
    names = range(8)
    return {
        "name": "cables",
        "length_unit": "m",
        "channel": [channel(f"c{k}", "m", CABLE) for k in names],
        "frame": [{"name": "body", "unknown": ["pose"], "pose": [0, 0, 1.4, 0, 0, 0]}],
        "point": [{"name": f"k{k}", "frame": "body", "at": CORNERS[k].tolist()} for k in range(4)]
        + [{"name": f"w{k}", "at": WINCHES[k].tolist()} for k in names],
        "closure": [
            {"name": f"cable{k}", "kind": "distance", "between": [f"k{ENDS[k]}", f"w{k}"]}
            | {"channel": f"c{k}"}
            for k in names
        ],
        "model": {"terms": ["offset"]},
    } | body


def hung(
    seed: int, ends: list[int], poses: int = 60, on_body: Array = CORNERS
) -> tuple[Array, Array, Array]:
    """Readings of cables that hold these corners, their offsets, and where the corners are."""
    rng = np.random.default_rng(seed)
    middle = rng.uniform([-1, -0.8, 0.8], [1, 0.8, 2.0], (poses, 3))
    turned = Rotation.from_rotvec(rng.uniform(-0.3, 0.3, (poses, 3)))
    corners = middle[:, None] + np.stack([turned.apply(corner) for corner in on_body], axis=1)
    lengths = np.linalg.norm(corners[:, ends] - WINCHES, axis=2)
    offsets = rng.normal(0, 0.01, 8)
    return lengths - offsets + CABLE * rng.standard_normal(lengths.shape), offsets, corners


def test_a_body_on_eight_cables() -> None:
    read, offsets, corners = hung(7, ENDS)
    drawn = rsicalib.Mechanism.from_dict(on_cables())
    readings = rsicalib.Readings.from_arrays(drawn, read, pose=np.arange(len(read)))
    found = rsicalib.calibrate(readings, drawn)
    assert found.verdict == "adequate"
    for parameter, true in zip(found.parameters, offsets, strict=True):
        assert parameter.sd is not None
        assert abs(parameter.value - true) < 4 * parameter.sd, parameter
    placed = rsicalib.forward(readings, drawn, found)
    off = placed.reshape(len(read), 4, 3) - corners
    assert np.sqrt(np.mean(off**2)) < 3 * CABLE


@pytest.mark.parametrize("seed", sized([0], list(range(8))))
def test_bodies_that_go_far_are_found_in_every_pose(seed: int) -> None:
    """From where the frame is drawn 3 to 8 of 80 poses ended by half a turn off: 0 of 6 were sound.

    The witness is the simulator; in another pose a body is not far from where it is in its own.
    """
    rng = np.random.default_rng([21, seed])
    on_top = [[x, y, 3.0] for x, y in ((0, 0), (4, 0), (4, 3), (0, 3))]
    below = [[x, y, 0.2] for x, y in ((0, 0), (4, 0), (4, 3), (0, 3))]
    winches = np.array([*on_top, *below])
    around = np.array([[-1, -1], [1, -1], [1, 1], [-1, 1]]) * [0.2, 0.15]
    ends = np.array([*np.c_[around, 4 * [-0.1]][[1, 2, 3, 0]], *np.c_[around, 4 * [0.1]]])
    middle = np.array([2, 1.5, 1.4]) + rng.uniform(-1, 1, (80, 3)) * [1.3, 0.9, 0.8]
    turned = Rotation.from_euler("xyz", rng.uniform(-0.25, 0.25, (80, 3)))
    held = middle[:, None] + np.stack([turned.apply(end) for end in ends], axis=1)
    offsets = rng.normal(0, 0.02, 8)
    read = np.linalg.norm(held - winches, axis=2) - offsets
    read += CABLE * rng.standard_normal(read.shape)
    names = range(8)
    drawn = rsicalib.Mechanism.from_dict(
        on_cables()
        | {
            "frame": [{"name": "body", "unknown": ["pose"], "pose": [2, 1.5, 1.4, 0, 0, 0]}],
            "point": [{"name": f"w{k}", "at": winches[k].tolist()} for k in names]
            + [{"name": f"k{k}", "frame": "body", "at": ends[k].tolist()} for k in names],
            "closure": [
                {"name": f"cable{k}", "kind": "distance", "between": [f"k{k}", f"w{k}"]}
                | {"channel": f"c{k}"}
                for k in names
            ],
        }
    )
    readings = rsicalib.Readings.from_arrays(drawn, read, pose=np.arange(len(read)))
    found = rsicalib.trace(readings, drawn)
    assert found.verdict == "adequate" and not found.excluded
    for parameter, true in zip(found.parameters, offsets, strict=True):
        assert parameter.sd is not None
        assert abs(parameter.value - true) < 4.5 * parameter.sd, parameter


def test_a_corner_that_two_cables_hold_elsewhere_than_drawn_is_named_and_placed() -> None:
    elsewhere = CORNERS.copy()
    elsewhere[2] += [0.006, -0.004, 0.005]
    read, _, corners = hung(8, ENDS, on_body=elsewhere)
    drawn = rsicalib.Mechanism.from_dict(on_cables())
    readings = rsicalib.Readings.from_arrays(drawn, read, pose=np.arange(len(read)))
    found = rsicalib.trace(readings, drawn)
    # The first of its two cables gives it its name.
    assert [(step.term, step.target) for step in found.steps] == [("attachment_position", "cable2")]
    assert found.verdict == "explained"
    for parameter, true in zip(found.steps[0].parameters, elsewhere[2] - CORNERS[2], strict=True):
        assert parameter.sd is not None
        assert abs(parameter.value - true) < 4 * parameter.sd, parameter
    placed = rsicalib.forward(readings, drawn, found).reshape(corners.shape)
    assert np.sqrt(np.mean((placed - corners) ** 2)) < 3 * CABLE


@pytest.mark.parametrize("order", [1, -1])
def test_all_corners_together_are_where_the_frame_of_the_body_is(order: int) -> None:
    """Where nothing else sees the body, six of their twelve coordinates say nothing, in no pose, in
    whichever order its cables are declared."""
    read, *_ = hung(9, ENDS)
    drawn = rsicalib.Mechanism.from_dict(on_cables(closure=on_cables()["closure"][::order]))
    readings = rsicalib.Readings.from_arrays(drawn, read, pose=np.arange(len(read)))
    found = rsicalib.calibrate(readings, drawn, terms=["offset", "attachment_position"])
    assert found.verdict == "adequate"
    assert len(found.unobservable) == 6
    assert all("no reading can tell" in one for one in found.unobservable)
    # Of eight lengths in a pose its six coordinates take six.
    assert found.fit is not None and found.fit.dof == len(read) * (8 - 6) - (8 + 12 - 6)


UNCROSSED = [0, 1, 2, 3, 0, 1, 2, 3]
"""Cables that do not cross: turned to the left or to the right, the body nearly closes all."""


def uncrossed(read: Array) -> tuple[rsicalib.Mechanism, rsicalib.Readings]:
    closures = on_cables()["closure"]
    for k, closure in enumerate(closures):
        closure["between"] = [f"k{UNCROSSED[k]}", f"w{k}"]
    drawn = rsicalib.Mechanism.from_dict(on_cables(closure=closures))
    numbers = np.arange(len(read))
    return drawn, rsicalib.Readings.from_arrays(drawn, read, pose=numbers, time_s=10.0 * numbers)


@pytest.mark.parametrize("seed", range(21, 21 + sized(1, 10)))
def test_each_pose_has_two_places_that_nearly_close(seed: int) -> None:
    read, offsets, corners = hung(seed, UNCROSSED)
    drawn, readings = uncrossed(read)
    found = rsicalib.trace(readings, drawn)
    assert found.verdict == "adequate" and not found.steps and not found.excluded
    for parameter, true in zip(found.parameters, offsets, strict=True):
        assert parameter.sd is not None
        # Of 80 parameters, which near a pose with a free motion do not depend linearly on readings.
        assert abs(parameter.value - true) < 5 * parameter.sd, parameter
    # Near a pose with a free motion either place may be within the noise; most are where they were.
    placed = rsicalib.forward(readings, drawn, found).reshape(len(read), 4, 3)
    off = np.sqrt(np.mean((placed - corners) ** 2, axis=(1, 2)))
    assert np.median(off) < 3 * CABLE


def test_a_slip_is_named_where_poses_have_two_places() -> None:
    read, *_ = hung(31, UNCROSSED, sized(40, 60))
    read[len(read) // 2 :, 5] -= 0.003
    drawn, readings = uncrossed(read)
    found = rsicalib.trace(readings, drawn)
    assert [(step.term, step.target) for step in found.steps] == [("slip", "c5")]
    assert found.verdict == "explained"


def test_what_a_body_may_not_be() -> None:
    points = [{"name": f"k{k}", "unknown": ["pose"], "at": CORNERS[k].tolist()} for k in range(4)]
    points += [{"name": f"w{k}", "at": WINCHES[k].tolist()} for k in range(8)]
    bars = on_cables()["closure"] + [
        {"name": "bar", "kind": "distance", "between": ["k0", "k1"], "value": 0.3}
    ]
    with pytest.raises(RsicalibError, match=r"one rigid body: a \[\[frame\]\] with `unknown"):
        rsicalib.Mechanism.from_dict(on_cables(point=points, closure=bars, frame=[]))
    twice = [{"name": "body", "unknown": ["pose", "group"]}]
    with pytest.raises(RsicalibError, match="`pose` alone"):
        rsicalib.Mechanism.from_dict(on_cables(frame=twice))
    once = [{"name": "body", "unknown": []}]
    with pytest.raises(RsicalibError, match="in a frame that is known or has"):
        rsicalib.Mechanism.from_dict(on_cables(frame=once))
