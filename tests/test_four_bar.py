"""A four-bar whose crank goes round: at even steps, steadily, and with a row written twice.

Witness: the rocker by two circles, in closed form; the crank's reading and its noise are drawn.
"""

from __future__ import annotations

import numpy as np
import pytest

import rsicalib
from rsicalib import Mechanism
from tests.oracle import Array

NOISE = 1e-4
"""Of both encoders [rad], as declared."""
CRANK, ROCKER, POST, ROD = 100.0, 200.0, 300.0, 250.0


def mechanism() -> Mechanism:
    encoder = {"unit": "rad", "gain": 1.0, "offset": 0.0, "noise": NOISE}
    return Mechanism.from_dict(
        {
            "name": "four-bar",
            "length_unit": "mm",
            "channel": [{"name": name, **encoder} for name in ("crank", "rocker")],
            "chain": [
                {"name": "left", "dh": [{"channel": "crank", "a": CRANK}]},
                {"name": "right", "dh": [{"a": POST}, {"channel": "rocker", "a": ROCKER}]},
            ],
            "point": [
                {"name": f"end of {name}", "chain": chain, "at": [0, 0, 0]}
                for name, chain in (("crank", "left"), ("rocker", "right"))
            ],
            "closure": [
                {
                    "name": "rod",
                    "kind": "distance",
                    "between": ["end of crank", "end of rocker"],
                    "value": ROD,
                }
            ],
            "model": {"terms": ["offset"]},
        }
    )


def readings(angles: Array, seed: int, rod: float = ROD) -> Array:
    """Of crank angles, with offsets and noise."""
    across, up = POST - CRANK * np.cos(angles), CRANK * np.sin(angles)
    apart = np.hypot(across, up)
    beside = np.arccos((apart**2 + ROCKER**2 - rod**2) / (2 * ROCKER * apart))
    rocker = np.pi - np.arctan2(up, across) - beside
    noise = NOISE * np.random.default_rng([77, seed]).standard_normal((len(angles), 2))
    return np.column_stack([angles - 0.05, rocker + 0.03]) + noise


def taken_again(q: Array) -> dict[str, Array]:
    return {"crank": np.insert(q[:, 0], 20, q[20, 0]), "rocker": np.insert(q[:, 1], 20, q[20, 1])}


@pytest.mark.parametrize("seed", range(2))
def test_a_row_that_was_written_twice_makes_no_codes_of_even_steps(seed: int) -> None:
    """Steps of the crank passed for those of its encoder: all was within their rounding."""
    turn = np.linspace(0, 2 * np.pi, 60, endpoint=False)
    (step,) = rsicalib.trace(taken_again(readings(turn, seed, ROD + 5.0)), mechanism()).steps
    assert step.spec == "distance@rod"
    assert rsicalib.trace(taken_again(readings(turn, seed)), mechanism()).verdict == "adequate"


def test_a_drive_that_stands_at_even_steps_has_no_codes() -> None:
    turn = np.repeat(np.linspace(0, 2 * np.pi, 60, endpoint=False), 4)
    q = readings(turn, 1, ROD + 5.0)
    q[:, 0] = turn - 0.05
    session = {"crank": q[:, 0], "rocker": q[:, 1], "pose": np.repeat(np.arange(60), 4)}
    (step,) = rsicalib.trace(session, mechanism()).steps
    assert step.spec == "distance@rod"


@pytest.mark.parametrize("turns", [1.0, 64.0])
def test_a_sound_recording_of_a_steady_crank_has_no_delay(turns: float) -> None:
    """A delay smooths the mean of a stretch: with (164) of single rows each recording had one."""
    rows = 20_000
    q = readings(np.linspace(0, 2 * np.pi * turns, rows, endpoint=False), 0)
    session = {"crank": q[:, 0], "rocker": q[:, 1], "time_s": np.arange(rows) / 500.0}
    assert rsicalib.trace(session, mechanism()).verdict == "adequate"
