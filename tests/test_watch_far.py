"""A watch of a change that is farther than a linearisation reaches."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.typing import NDArray

import rsicalib

from .full import sized
from .tripod import NAMES, REST, angles, machine, moved

NOISE = 0.01
"""Standard deviation of a reading (deg)."""

ROWS, CHANGE = 3000, 1000


def at_work(seed: int) -> tuple[rsicalib.Monitor, NDArray[np.float64]]:
    """A watch of a calibrated device, and readings of a sound one at work."""
    rng = np.random.default_rng([905, seed])
    offsets = rng.normal(0.0, 0.5, 9)

    def read(poses: NDArray[np.float64]) -> NDArray[np.float64]:
        return angles(poses) - offsets + NOISE * rng.standard_normal((len(poses), 9))

    half = np.array([40.0, 40.0, 30.0, 0.25, 0.25, 0.25])
    poses = np.asarray(REST) + half * rng.uniform(-1.0, 1.0, (40, 6))
    drawn = machine()
    session = rsicalib.Readings.from_arrays(drawn, read(poses), pose=np.arange(1, 41))
    found = rsicalib.calibrate(session, drawn, noise=dict.fromkeys(NAMES, NOISE))
    assert found.verdict == "adequate"
    return rsicalib.Monitor(found, drawn), read(moved(ROWS, rng))


def seconds(rows: NDArray[np.float64]) -> NDArray[np.float64]:
    return np.arange(len(rows)) / 10.0


@pytest.mark.parametrize("degrees", [20.0, 45.0, -90.0, 180.0])
@pytest.mark.parametrize("seed", range(sized(2, 12)))
def test_a_sensor_that_slipped_far_is_named_with_how_far(degrees: float, seed: int) -> None:
    monitor, rows = at_work(seed)
    channel = (4 * seed + int(abs(degrees)) // 45) % 9
    rows[CHANGE:, channel] -= degrees
    rows[2 * CHANGE :, (channel + 3) % 9] -= 0.5
    alarms = monitor.update(rows, seconds(rows))
    far, *later = [alarm for alarm in alarms if alarm.since_row < 2 * CHANGE - 20]
    assert (far.term, far.target) == ("offset", NAMES[channel]), [a.text() for a in alarms]
    assert CHANGE <= far.row < CHANGE + 10
    # An offset adds to the reading: 180 degrees either way are one place.
    off = (far.size - np.radians(degrees) + np.pi) % (2 * np.pi) - np.pi
    assert abs(off) < 5 * far.sd
    assert later == []
    # What changes later, and by little, is named as ever.
    near = [alarm for alarm in alarms if alarm.since_row >= 2 * CHANGE - 20]
    assert near and near[-1].target == NAMES[(channel + 3) % 9]
    assert abs(near[-1].size - np.radians(0.5)) < 5 * near[-1].sd


@pytest.mark.parametrize("seed", range(sized(3, 12)))
def test_a_sensor_that_is_unplugged_is_told_and_watched_again_once_it_reads(seed: int) -> None:
    monitor, rows = at_work(20 + seed)
    channel = (2, 4, 8)[seed % 3]
    rows[CHANGE : CHANGE + 300, channel] = 0.0
    rows[2 * CHANGE :, 0] -= 0.5
    alarms = monitor.update(rows, seconds(rows))
    first = [alarm for alarm in alarms if alarm.since_row < CHANGE + 300]
    assert len(first) == 1, [a.text() for a in alarms]
    assert (first[0].target, first[0].action) == (NAMES[channel], "stop")
    last = alarms[-1]
    assert len(alarms) > 1 and last.since_row >= 2 * CHANGE - 20
    assert last.target == NAMES[0] and abs(last.size - np.radians(0.5)) < 5 * last.sd
    assert 290 < monitor.summary().silent < 320


@pytest.mark.parametrize("seed", range(sized(3, 12)))
def test_cables_that_are_exchanged_are_no_bent_link(seed: int) -> None:
    monitor, rows = at_work(40 + seed)
    rows[CHANGE:, [1, 4]] = rows[CHANGE:, [4, 1]]
    alarms = monitor.update(rows, seconds(rows))
    assert alarms and CHANGE <= alarms[0].row < CHANGE + 20
    # Whatever is said, nothing is moved by more than the machine is large (mm, rad).
    assert all(abs(alarm.size) < 300.0 for alarm in alarms if alarm.unit != "alarms")
