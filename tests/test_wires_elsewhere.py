"""Wires and units where no search for a start tells: gains not asked for, unknown frames."""

from __future__ import annotations

from typing import Any

import numpy as np
import numpy.typing as npt
import pytest

import rsicalib
from tests.full import sized

Array = npt.NDArray[np.float64]

NOISE = 1e-4
"""Of an encoder [rad]."""
NEAR, FAR, APART = 120.0, 180.0, 100.0
"""Upper arms and forearms of a five-bar, and how far its motors are apart [mm]."""


def encoder(name: str, noise: float = NOISE) -> dict[str, Any]:
    return {"name": name, "unit": "rad", "gain": 1.0, "offset": 0.0, "noise": noise}


def five_bar(upper: float = NEAR) -> rsicalib.Mechanism:
    """Encoders at the motors and at one elbow; the other forearm is a distance."""
    left = [{"channel": "m1", "a": upper}, {"channel": "e1", "a": FAR}]
    values: dict[str, Any] = {
        "name": "five-bar",
        "length_unit": "mm",
        "channel": [encoder(name) for name in ("m1", "e1", "m2")],
        "chain": [
            {"name": "left", "dh": left},
            {"name": "right", "dh": [{"a": APART}, {"channel": "m2", "a": NEAR}]},
        ],
        "point": [
            {"name": "pin", "chain": "left", "at": [0, 0, 0]},
            {"name": "elbow", "chain": "right", "at": [0, 0, 0]},
        ],
        "closure": [
            {"name": "forearm", "kind": "distance", "between": ["pin", "elbow"], "value": FAR}
        ],
        "model": {"terms": ["offset"]},
    }
    return rsicalib.Mechanism.from_dict(values)


def of_five_bar(seed: int, poses: int = 50) -> Array:
    """Readings with the pin anywhere above: each arm by the law of cosines."""
    rng = np.random.default_rng(seed)
    rows = []
    while len(rows) < poses:
        x, y = rng.uniform([-80, 100], [180, 260])
        arms = [np.hypot(x, y), np.hypot(x - APART, y)]
        if max(arms) > NEAR + FAR - 4 or min(arms) < FAR - NEAR + 4:
            continue
        bent = [np.arccos((NEAR**2 + d * d - FAR**2) / (2 * NEAR * d)) for d in arms]
        m1, m2 = np.arctan2(y, x) + bent[0], np.arctan2(y, x - APART) - bent[1]
        e1 = np.arctan2(y - NEAR * np.sin(m1), x - NEAR * np.cos(m1)) - m1
        rows.append([m1, e1, m2])
    read = np.array(rows) - [0.008, -0.012, 0.01] + NOISE * rng.standard_normal((poses, 3))
    read[:, 1] = (read[:, 1] + np.pi) % (2 * np.pi) - np.pi
    return read


def suspected(read: Array, drawn: rsicalib.Mechanism, **more: Any) -> set[tuple[str, str | None]]:
    """Kinds and targets of warnings about wires and units."""
    readings = rsicalib.Readings.from_arrays(drawn, read, pose=np.arange(len(read)), **more)
    found = rsicalib.calibrate(readings, drawn)
    return {(w.kind, w.target) for w in found.warnings if w.kind in WIRES}


WIRES = ("reversed", "exchanged", "degrees", "length")


@pytest.mark.parametrize("seed", range(sized(1, 3)))
def test_a_long_link_is_no_other_unit(seed: int) -> None:
    """A link that is drawn 10 % too long: readings times 0.017 close better, and not."""
    assert suspected(of_five_bar(seed), five_bar(1.1 * NEAR)) == set()


@pytest.mark.parametrize("seed", range(sized(1, 3)))
def test_degrees_are_told(seed: int) -> None:
    read = np.degrees(of_five_bar(seed))
    assert ("degrees", "m1+e1+m2") in suspected(read, five_bar())


@pytest.mark.parametrize("channel", range(3))
def test_a_reversed_encoder_is_told_where_its_gain_is_not_asked_for(channel: int) -> None:
    read = of_five_bar(4)
    read[:, channel] *= -1
    assert suspected(read, five_bar()) == {("reversed", ("m1", "e1", "m2")[channel])}


# ------------------------------------------------------------------ an arm that a tracker sees

DH = [(0.0, 400.0, 180.0, -1), (-1.0, 0.0, 600.0, 0), (0.0, 0.0, 120.0, -1)]
DH += [(0.0, 640.0, 0.0, 1), (0.0, 0.0, 0.0, -1), (0.0, 200.0, 0.0, 0)]
"""`theta d a alpha`, the angles in quarter turns [mm]."""
REFLECTOR = [50.0, 0.0, 100.0]


def tracked() -> rsicalib.Mechanism:
    rows = [
        {"channel": f"q{k + 1}", "theta": t * np.pi / 2, "d": d, "a": a, "alpha": al * np.pi / 2}
        for k, (t, d, a, al) in enumerate(DH)
    ]
    values: dict[str, Any] = {
        "name": "arm and tracker",
        "length_unit": "mm",
        "channel": [encoder(f"q{k + 1}", 3e-5) for k in range(6)],
        "chain": [{"name": "arm", "dh": rows}],
        "frame": [{"name": "tracker", "unknown": []}],
        "point": [
            {"name": "reflector", "chain": "arm", "at": REFLECTOR},
            {"name": "seen", "columns": ["mx", "my", "mz"], "frame": "tracker"},
        ],
        "closure": [
            {"name": "seen there", "kind": "touch", "between": ["reflector", "seen"], "noise": 0.02}
        ],
        "model": {"terms": ["offset"]},
    }
    return rsicalib.Mechanism.from_dict(values)


def of_tracked(seed: int, poses: int = 40) -> tuple[Array, dict[str, Array]]:
    """Readings, and what the tracker measures: its axes are those of the base, turned about z."""
    rng = np.random.default_rng(seed)
    read = rng.uniform(-1, 1, (poses, 6)) * [2.5, 1.2, 1.3, 2.7, 1.7, 2.7]
    seen = []
    for q in read:
        frame = np.eye(4)
        for angle, (t, d, a, al) in zip(q, DH, strict=True):
            c, s = np.cos(angle + t * np.pi / 2), np.sin(angle + t * np.pi / 2)
            ca, sa = np.cos(al * np.pi / 2), np.sin(al * np.pi / 2)
            row = [[c, -s * ca, s * sa, a * c], [s, c * ca, -c * sa, a * s], [0, sa, ca, d]]
            frame = frame @ np.array([*row, [0, 0, 0, 1]])
        x, y, z = frame[:3] @ [*REFLECTOR, 1]
        seen.append([0.6 * x + 0.8 * y + 900, -0.8 * x + 0.6 * y - 300, z + 150])
    there = np.array(seen) + 0.02 * rng.standard_normal((poses, 3))
    return read + 3e-5 * rng.standard_normal(read.shape), dict(
        zip(("mx", "my", "mz"), there.T, strict=True)
    )


def test_wires_of_an_arm_that_a_tracker_sees() -> None:
    read, seen = of_tracked(1)
    assert suspected(read, tracked(), columns=seen) == set()
    exchanged = read[:, [1, 0, 2, 3, 4, 5]]
    assert suspected(exchanged, tracked(), columns=seen) == {("exchanged", "q1+q2")}
    turned = read * [1, -1, 1, 1, 1, 1]
    assert suspected(turned, tracked(), columns=seen) == {("reversed", "q2")}


@pytest.mark.parametrize("pair", [(0, 3), (1, 2), (3, 5)])
def test_wires_are_told_in_many_poses_as_in_few(pair: tuple[int, int]) -> None:
    """Of 400 poses 20 are looked at first; what they say is then held against all."""
    read, seen = of_tracked(2, 400)
    order = list(range(6))
    order[pair[0]], order[pair[1]] = pair[1], pair[0]
    name = f"q{pair[0] + 1}+q{pair[1] + 1}"
    assert suspected(read[:, order], tracked(), columns=seen) == {("exchanged", name)}
