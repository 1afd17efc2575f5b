"""Frames that nobody has measured: an instrument anywhere, turned anyhow, sees a plate on legs.

The witness is the simulation: where the balls of the plate were, by numpy alone.
"""

from __future__ import annotations

from typing import Any

import numpy as np
import numpy.typing as npt
import pytest
from scipy.spatial.transform import Rotation

import rsicalib
from tests.test_bodies import FEET, HIGH, LENGTH, PLATE, channel

Array = npt.NDArray[np.float64]

BALLS = np.array([[60.0, 20.0, 140.0], [-90.0, 70.0, 60.0], [30.0, -110.0, 90.0]])
"""In the plate [mm]."""
SEEN = 0.02
"""Noise of the instrument [mm]."""
QUARTER = np.pi / 2
TURNS = {
    "as the base": Rotation.identity(),
    "half a turn": Rotation.from_rotvec([0.0, 0.0, np.pi]),
    "upside down": Rotation.from_rotvec([np.pi, 0.0, 0.0]),
    "roll and yaw are one": Rotation.from_euler("ZYX", [0.7, QUARTER, 0.4]),
    "almost": Rotation.from_euler("ZYX", [-2.0, 1e-4 - QUARTER, 1.1]),
    "anyhow": Rotation.from_rotvec([1.3, -1.7, 0.6]),
}
ORIGIN = np.array([-1400.0, 900.0, 350.0])


def session(
    turned: Rotation, legs: int, balls: int, pose: list[float] | None = None
) -> tuple[rsicalib.Mechanism, rsicalib.Readings, Array]:
    """A hexapod with some of its legs, its readings, and where the balls were."""
    rng = np.random.default_rng(5)
    poses = 30
    middle = rng.uniform([-60, -60, HIGH - 50], [60, 60, HIGH + 50], (poses, 3))
    plates = Rotation.from_rotvec(rng.uniform(-0.3, 0.3, (poses, 3)))

    def carried(points: Array) -> Array:
        return middle[:, None] + np.stack([plates.apply(p) for p in points], axis=1)

    own = list(range(6))[:: 6 // legs] if legs < 4 else list(range(legs))
    lengths = np.linalg.norm(carried(PLATE[own]) - FEET[own], axis=2)
    read = lengths - rng.normal(0, 1, legs) + rng.normal(0, LENGTH, lengths.shape)
    at = carried(BALLS[:balls])
    seen = turned.inv().apply((at - ORIGIN).reshape(-1, 3)).reshape(at.shape)
    seen += rng.normal(0, SEEN, seen.shape)
    frame: dict[str, Any] = {"name": "instrument", "unknown": []}
    drawn = rsicalib.Mechanism.from_dict(
        {
            "name": "hexapod",
            "length_unit": "mm",
            "channel": [channel(f"l{k}", "mm", LENGTH) for k in own],
            "frame": [
                {"name": "plate", "unknown": ["pose"], "pose": [0, 0, HIGH, 0, 0, 0]},
                frame if pose is None else frame | {"pose": pose},
            ],
            "point": [{"name": f"b{k}", "at": FEET[k].tolist()} for k in own]
            + [{"name": f"p{k}", "frame": "plate", "at": PLATE[k].tolist()} for k in own]
            + [
                {"name": f"ball{k}", "frame": "plate", "at": BALLS[k].tolist()}
                for k in range(balls)
            ]
            + [
                {"name": f"seen{k}", "frame": "instrument", "columns": [f"{a}{k}" for a in "xyz"]}
                for k in range(balls)
            ],
            "closure": [
                {
                    "name": f"leg {k}",
                    "kind": "distance",
                    "between": [f"b{k}", f"p{k}"],
                    "channel": f"l{k}",
                }
                for k in own
            ]
            + [
                {
                    "name": f"ball {k}",
                    "kind": "touch",
                    "between": [f"ball{k}", f"seen{k}"],
                    "noise": SEEN,
                }
                for k in range(balls)
            ],
            "model": {"terms": ["offset"]},
        }
    )
    columns = {f"{a}{k}": seen[:, k, i] for k in range(balls) for i, a in enumerate("xyz")}
    readings = rsicalib.Readings.from_arrays(drawn, read, pose=np.arange(poses), columns=columns)
    return drawn, readings, np.concatenate([at, seen], axis=2)


def off(found: rsicalib.Calibration, balls: Array) -> float:
    """How far the frame that was found puts what it sees from where it was, root mean square."""
    pose = {p.name: p.value for p in found.parameters if p.target == "instrument"}
    turned = Rotation.from_euler("xyz", [pose[k] for k in ("rx", "ry", "rz")])
    at, seen = balls.reshape(-1, 6)[:, :3], balls.reshape(-1, 6)[:, 3:]
    error = turned.apply(seen) + [pose[k] for k in "xyz"] - at
    return float(np.sqrt(np.mean(np.sum(error**2, axis=1))))


@pytest.mark.parametrize("turn", TURNS)
@pytest.mark.parametrize(("legs", "balls"), [(6, 1), (6, 3), (5, 1), (3, 3)])
def test_an_instrument_is_found_wherever_it_is(turn: str, legs: int, balls: int) -> None:
    """With fewer than six legs, poses are not told without the instrument."""
    drawn, readings, where = session(TURNS[turn], legs, balls)
    found = rsicalib.calibrate(readings, drawn)
    assert found.verdict == "adequate"
    # Noise of .02 mm in 30 poses, on arms of 100 mm that legs tell by .01 mm: a few hundredths, of
    # five legs a few tenths. Legs as drawn are wrong by 1 mm, a frame that is not found by 100.
    assert off(found, where) < 0.5
