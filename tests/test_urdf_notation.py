"""One arm in two notations: what is wrong with it is found in both.

The witness is the forward kinematics below, by products of matrices in the frames of the URDF. The
wrist's axes meet in pairs, as in most arms: the links between them lie along one of the two axes.
"""

from __future__ import annotations

from math import pi
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt
import pytest

import rsicalib
from rsicalib.io.urdf import chain_from_urdf
from tests.full import sized

Array = npt.NDArray[np.float64]

JOINTS = 6
NOISE = 2e-5
SIZE = 8e-4
"""Length of an error [m]; tilts are as large in radians."""
CONES = np.array([[0.55, -0.15, 0.05], [0.55, 0.15, 0.05], [0.75, 0.0, 0.30]])

URDF = [
    ((0.0, 0.0, 0.4), (0.0, 0.0, 0.0)),
    ((0.1, 0.0, 0.0), (-pi / 2, 0.0, 0.0)),
    ((0.0, -0.61, 0.0), (0.0, 0.0, 0.0)),
    ((0.12, 0.0, 0.0), (0.0, pi / 2, 0.0)),
    ((0.0, 0.0, 0.55), (0.0, -pi / 2, 0.0)),
    ((0.1, 0.0, 0.0), (0.0, pi / 2, 0.0)),
    ((0.05, 0.02, 0.14), (0.0, 0.0, 0.0)),
]
"""Origin of each joint and of the tip in the frame before: `xyz` and `rpy`."""

TURN = pi / 2
DH: list[dict[str, Any]] = [
    {"d": 0.4},
    {"a": 0.1, "alpha": -TURN},
    {"theta": -TURN, "a": 0.61},
    {"theta": pi, "alpha": TURN},
    {"theta": -pi, "d": 0.67, "alpha": TURN},
    {"theta": pi, "alpha": TURN},
    {"theta": -TURN, "d": 0.1, "xyz": [0.05, 0.02, 0.14]},
]
"""The same arm, x of each row along the common normal of two axes."""

X, Y, Z = np.eye(3)
# The row of the URDF at whose end something is moved or turned, how, along which axis, and its name
# in the URDF and in rows of Denavit and Hartenberg.
ERRORS = {
    "the second axis is farther from the first": (2, "slide", X, "link_length/2", "link_length/2"),
    "the upper arm is longer": (3, "slide", -Y, "link_length/3", "link_length/3"),
    "the elbow is farther along its axis": (3, "slide", Z, "link_offset/3", "link_offset/3"),
    "the forearm passes the elbow": (4, "slide", Y, "link_side/4", "link_length/4"),
    "the elbow is longer": (4, "slide", X, "link_length/4", "link_offset/5"),
    "the forearm is longer": (5, "slide", Z, "link_length/5", "link_offset/5"),
    "the fifth axis passes the fourth": (5, "slide", Y, "link_side/5", "link_length/5"),
    "the fifth joint is along its axis": (5, "slide", X, "link_offset/5", "link_offset/6"),
    "the sixth axis passes the fifth": (6, "slide", Y, "link_side/6", "link_length/6"),
    "the elbow is tilted": (3, "turn", X, "joint_tilt/3", "joint_tilt/3"),
    "the elbow is tilted aside": (3, "turn", Y, "joint_tilt/3", "joint_tilt/3"),
    "the fifth joint is tilted": (5, "turn", Y, "joint_tilt/5", "joint_tilt/5"),
}


def turned(axis: Array, angle: Array) -> Array:
    """Rotations about a unit axis by angles (n,), by Rodrigues: (n, 3, 3)."""
    x, y, z = axis
    k = np.array([[0, -z, y], [z, 0, -x], [-y, x, 0]])
    sine, cosine = np.sin(angle)[:, None, None], np.cos(angle)[:, None, None]
    return np.asarray(np.eye(3) + sine * k + (1 - cosine) * k @ k)


def turn(axis: Array, angle: float) -> Array:
    return np.asarray(turned(axis, np.array([angle]))[0])


Body = tuple[Array, Array]
"""Place and directions (3, 3) of the next joint in the frame after a joint."""


def body(xyz: tuple[float, ...], rpy: tuple[float, ...]) -> Body:
    roll, pitch, yaw = rpy
    return np.array(xyz), turn(Z, yaw) @ turn(Y, pitch) @ turn(X, roll)


def made(error: str | None) -> list[Body]:
    """The arm with one error, that of a body at the next joint and in the frame before."""
    bodies = [body(*of) for of in URDF]
    if error is not None:
        row, kind, way, *_ = ERRORS[error]
        place, directions = bodies[row - 1]
        slid, tilted = (SIZE, 0.0) if kind == "slide" else (0.0, SIZE)
        bodies[row - 1] = place + slid * way, turn(way, tilted) @ directions
    return bodies


def tip(q: Array, bodies: list[Body]) -> Array:
    """Places (n, 3) of the tip at joint angles (n, 6)."""
    place, frame = np.zeros((len(q), 3)), np.broadcast_to(np.eye(3), (len(q), 3, 3))
    for k, (way, directions) in enumerate(bodies):
        place, frame = place + frame @ way, frame @ directions
        if k < JOINTS:
            frame = frame @ turned(Z, q[:, k])
    return np.asarray(place)


def touching(cone: Array, count: int, bodies: list[Body], rng: np.random.Generator) -> Array:
    """Joint angles (count, 6) near random ones that bring the tip to a cone."""
    low, high = [-0.6, -0.8, -1.2, -2.2, -1.8, -2.5], [0.6, 1.0, 1.2, 2.2, 1.8, 2.5]
    q = rng.uniform(low, high, (20 * count, JOINTS))
    q[:, 0] += np.arctan2(cone[1], cone[0])
    for _ in range(25):
        step = 1e-6 * np.eye(JOINTS)
        slope = np.stack([(tip(q + s, bodies) - tip(q - s, bodies)) / 2e-6 for s in step], axis=2)
        way = (np.linalg.pinv(slope, rcond=1e-3) @ (cone - tip(q, bodies))[..., None])[..., 0]
        q = q + np.clip(way, -0.3, 0.3)
    reached = (np.abs(tip(q, bodies) - cone).max(1) < 1e-12) & (np.abs(q).max(1) < 2.9)
    assert reached.sum() >= count
    return np.asarray(q[reached][:count])


def document() -> str:
    """The arm as a URDF."""
    parts = ['<robot name="arm"> <link name="l0"/>']
    for k, (xyz, rpy) in enumerate(URDF, start=1):
        kind = "continuous" if k <= JOINTS else "fixed"
        place, angles = (" ".join(map(repr, values)) for values in (xyz, rpy))
        parts.append(
            f'<link name="l{k}"/> <joint name="j{k}" type="{kind}"> <axis xyz="0 0 1"/>'
            f'<parent link="l{k - 1}"/> <child link="l{k}"/>'
            f'<origin xyz="{place}" rpy="{angles}"/> </joint>'
        )
    return " ".join([*parts, "</robot>"])


def drawing(chain: dict[str, Any]) -> dict[str, Any]:
    names = [f"q{k}" for k in range(1, JOINTS + 1)]
    cones = ["cone[at=A]", "cone[at=B]"]
    return {
        "name": "arm",
        "length_unit": "m",
        "channel": [
            {"name": name, "unit": "rad", "gain": 1.0, "offset": 0.0, "noise": NOISE}
            for name in names
        ],
        "chain": [{"name": "arm", **chain}],
        "point": [
            {"name": "ball", "chain": "arm", "at": [0.0, 0.0, 0.0]},
            {"name": "cone", "unknown": ["at"]},
        ],
        "closure": [
            {"name": "seat", "kind": "touch", "between": ["ball", "cone"], "noise": 2e-5},
            {"name": "A-B", "kind": "distance", "between": cones, "value": 0.3, "sd": 1e-5},
        ],
        "model": {"terms": [f"offset@{name}" for name in names[1:]]},
    }


@pytest.fixture(scope="module")
def arms(tmp_path_factory: pytest.TempPathFactory) -> dict[str, Any]:
    """The arm in both notations."""
    file: Path = tmp_path_factory.mktemp("arm") / "arm.urdf"
    file.write_text(document(), encoding="utf-8")
    joints = {f"j{k}": f"q{k}" for k in range(1, JOINTS + 1)}
    found = chain_from_urdf(file, "l0", f"l{JOINTS + 1}", joints).rows
    rows = [row | ({"channel": f"q{k}"} if k else {}) for k, row in enumerate(DH)]
    return {
        "urdf": rsicalib.Mechanism.from_dict(drawing({"dh": found})),
        "dh": rsicalib.Mechanism.from_dict(drawing({"dh": rows})),
    }


def session(drawn: Any, error: str | None, seed: int) -> Any:
    """Readings of the arm at three cones."""
    rng, count = np.random.default_rng(seed), 30
    bodies = made(error)
    exact = np.concatenate([touching(cone, count, bodies, rng) for cone in CONES])
    offsets = rng.normal(0, 0.01, JOINTS) * (np.arange(JOINTS) > 0)
    values = exact - offsets + rng.normal(0, NOISE, exact.shape)
    keys = {"at": np.repeat(["A", "B", "C"], count).tolist()}
    return rsicalib.Readings.from_arrays(
        drawn, values, pose=np.arange(1, len(values) + 1), keys=keys
    )


def dh_bodies() -> list[Body]:
    """The rows of Denavit and Hartenberg as bodies: `theta` is about the axis of the joint."""
    bodies: list[Body] = []
    for row in DH:
        about = turn(Z, row.get("theta", 0.0))
        way = np.array([row.get("a", 0.0), 0.0, row.get("d", 0.0)]) + row.get("xyz", np.zeros(3))
        bodies.append((about @ way, about @ turn(X, row.get("alpha", 0.0))))
    return bodies


def test_the_two_notations_draw_one_arm() -> None:
    q = np.random.default_rng(1).uniform(-2, 2, (20, JOINTS))
    np.testing.assert_allclose(tip(q, dh_bodies()), tip(q, made(None)), rtol=0, atol=1e-12)


@pytest.mark.parametrize("notation", ["urdf", "dh"])
@pytest.mark.parametrize("error", sized(["the fifth axis passes the fourth"], list(ERRORS)))
def test_an_error_is_named_in_both_notations(
    arms: dict[str, Any], error: str, notation: str
) -> None:
    drawn = arms[notation]
    found = rsicalib.trace(session(drawn, error, 5), drawn)
    (step,) = found.steps
    term, row = ERRORS[error][3 if notation == "urdf" else 4].split("/")
    names = {(s.term, s.target) for s in (step, *step.also_fits)}
    assert (term, f"arm/{row}") in names, found.summary()
    assert found.verdict == "explained", found.summary()


@pytest.mark.parametrize("notation", sized(["urdf"], ["urdf", "dh"]))
def test_a_sound_arm_is_adequate(arms: dict[str, Any], notation: str) -> None:
    seeds = range(sized(1, 20))
    found = [rsicalib.trace(session(arms[notation], None, k), arms[notation]) for k in seeds]
    assert [f.verdict for f in found].count("adequate") >= len(seeds) - (len(seeds) > 1)


def test_where_length_and_offset_move_a_link_every_way_there_is_no_side(
    arms: dict[str, Any],
) -> None:
    places = {
        name: next(t["targets"] for t in rsicalib.terms(drawn) if t["id"] == "link_side")
        for name, drawn in arms.items()
    }
    assert places == {"urdf": ["arm/4", "arm/5", "arm/6"], "dh": []}
