"""An ankle with two rods that is its own image in a mirror: exchanged motors are a reversed roll.

Witness: cranks and the foot in products of rotations, rods closed by bisection.
"""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from scipy.optimize import brentq

import rsicalib
from tests.oracle import Array

NOISE = 3e-5
"""Of an angle [rad]."""
CRANK, ROD, HIGH, WIDE = 40.0, 200.0, 200.0, 30.0
EYES = np.array([[-45.0, WIDE, -5.0], [-45.0, -WIDE, -5.0]])
NAMES = ("left", "right", "pitch", "roll")
QUARTER = np.pi / 2


def motor(eye: Array, side: float) -> float | None:
    """Angle of a crank at which its rod is as long as it is."""

    def longer(angle: float) -> float:
        pin = np.array([-CRANK * np.cos(angle), side * WIDE, HIGH + CRANK * np.sin(angle)])
        return float(np.linalg.norm(pin - eye)) - ROD

    return None if longer(-1.2) * longer(1.2) > 0.0 else float(brentq(longer, -1.2, 1.2))


def postures(seed: int, count: int = 40) -> Array:
    """Angles of motors and foot, (count, 4)."""
    rng = np.random.default_rng([seed, 201])
    rows: list[list[float]] = []
    while len(rows) < count:
        pitch, roll = rng.uniform([-0.6, -0.4], [0.6, 0.4])
        (cp, sp), (cr, sr) = ((np.cos(a), np.sin(a)) for a in (pitch, roll))
        turn = np.array([[cp, sp * sr, sp * cr], [0.0, cr, -sr], [-sp, cp * sr, cp * cr]])
        motors = [motor(turn @ eye, side) for eye, side in zip(EYES, (1.0, -1.0), strict=True)]
        if None not in motors:
            rows.append([*motors, pitch, roll])  # type: ignore[list-item]
    return np.array(rows)


def ankle() -> rsicalib.Mechanism:
    """The foot turns about y, then about x; both cranks about y."""
    back, forth = [-QUARTER, 0, 0], [QUARTER, 0, 0]
    foot = [{"rpy": back}, {"channel": "pitch", "rpy": forth}, {"rpy": [0, QUARTER, 0]}]
    foot.append({"channel": "roll", "rpy": [0, -QUARTER, 0]})
    chains: list[dict[str, Any]] = [{"name": "foot", "dh": foot}]
    points: list[dict[str, Any]] = []
    for name, eye in zip(NAMES, EYES, strict=False):
        at = {"xyz": [0, float(eye[1]), HIGH], "rpy": back}
        chains.append({"name": f"{name} crank", "dh": [at, {"channel": name, "rpy": forth}]})
        points.append({"name": f"{name} pin", "chain": f"{name} crank", "at": [-CRANK, 0, 0]})
        points.append({"name": f"{name} eye", "chain": "foot", "at": eye.tolist()})
    rods = [
        {"name": f"{name} rod", "kind": "distance", "between": [f"{name} pin", f"{name} eye"]}
        | {"value": ROD}
        for name in NAMES[:2]
    ]
    encoder = {"unit": "rad", "gain": 1.0, "offset": 0.0, "noise": NOISE, "limits": [-1.3, 1.3]}
    return rsicalib.Mechanism.from_dict(
        {
            "name": "ankle",
            "length_unit": "mm",
            "channel": [{"name": name, **encoder} for name in NAMES],
            "chain": chains,
            "point": points,
            "closure": rods,
            "model": {"terms": ["offset"]},
        }
    )


def told(seed: int, change: Any) -> tuple[rsicalib.Calibration, Array]:
    """A calibration of readings that were changed, and the offsets that they had."""
    rng = np.random.default_rng([seed, 202])
    offsets = rng.normal(0, 0.02, 4)
    read = np.repeat(postures(seed) - offsets, 3, axis=0)
    read += NOISE * rng.standard_normal(read.shape)
    table = dict(zip(NAMES, change(read).T, strict=True))
    found = rsicalib.calibrate({"pose": np.repeat(np.arange(40), 3), **table}, ankle())
    return found, offsets


@pytest.mark.parametrize("seed", range(2))
def test_a_sound_ankle_has_its_offsets(seed: int) -> None:
    found, offsets = told(seed, lambda read: read)
    assert (found.verdict, found.warnings) == ("adequate", ())
    for name, offset in zip(NAMES, offsets, strict=True):
        parameter = found[f"offset@{name}"]
        assert abs(parameter.value - offset) < 4.5 * parameter.sd


@pytest.mark.parametrize("wrong", ["roll", "motors"])
def test_a_reversed_roll_and_exchanged_motors_are_said_together(wrong: str) -> None:
    """One is the other in a mirror: no reading tells which it was."""
    changes = {
        "roll": lambda read: read * [1, 1, 1, -1],
        "motors": lambda read: read[:, [1, 0, 2, 3]],
    }
    found, _ = told(1, changes[wrong])
    kinds = {warned.kind: warned.target for warned in found.warnings}
    assert kinds == {"exchanged": "left+right", "reversed": "roll"}


@pytest.mark.parametrize("by", [1.75, -1.0])
@pytest.mark.parametrize("name", NAMES)
def test_a_zero_that_is_far_off_is_found(name: str, by: float) -> None:
    """100° at the pitch put another crank beyond its limits, in an assembly that closes, too."""
    zeros = np.array([by if other == name else 0.0 for other in NAMES])
    found, offsets = told(2, lambda read: read - zeros)
    assert found.verdict == "adequate"
    for other, offset in zip(NAMES, offsets + zeros, strict=True):
        parameter = found[f"offset@{other}"]
        assert abs(parameter.value - offset) < 4.5 * parameter.sd
