"""A planned pose is one that the mechanism can take, though no file says how far it goes.

The witnesses are plain distances in numpy, from where a result has the anchors, towers and balls.
"""

from __future__ import annotations

from functools import cache
from typing import Any

import numpy as np
import pytest

import rsicalib
from rsicalib import InputError, Mechanism, _core
from rsicalib.planning.identifiability import identifiable
from rsicalib.report.words import MEASURED_LENGTH
from rsicalib.work.applying import as_applied
from tests.oracle import Array

BELTS = {"top left": (12, 2031, 100), "top right": (2870, 2018, 56)}
BELTS |= {"bottom left": (0, 0, 34), "bottom right": (2889, 0, 78)}
"""Anchors of the simulated frame."""

SHORT = 0.004
"""The lower belts read short by this part."""


@cache
def belts() -> tuple[Array, Any]:
    """Readings of a sled whose lower belts read short, and what a trace makes of them."""
    rng = np.random.default_rng(5)
    grid = np.meshgrid(np.linspace(400, 2500, 6), np.linspace(300, 1700, 6))
    sled = np.stack(grid, -1).reshape(-1, 2) + rng.uniform(-60, 60, (36, 2))
    lengths = distances(sled, np.array(list(BELTS.values()), dtype=float))
    lengths[:, 2:] *= 1.0 - SHORT
    values = np.round(lengths + rng.normal(0.0, 0.3, lengths.shape), 2)
    return values, rsicalib.trace(table(values, "maslow"), "maslow")


def table(values: Array, mechanism: Any) -> rsicalib.Readings:
    return rsicalib.Readings.from_arrays(
        rsicalib.load_mechanism(mechanism), values, pose=np.arange(1, len(values) + 1)
    )


def distances(sled: Array, anchors: Array) -> Array:
    """Of each place in the plane of the sled from each anchor."""
    across = np.linalg.norm(sled[:, None, :] - anchors[None, :, :2], axis=2)
    return np.hypot(across, anchors[:, 2])


def anchors_of(result: Any) -> Array:
    """Where a result has the four anchors."""
    found = np.array(list(BELTS.values()), dtype=float)
    for k, name in enumerate(BELTS):
        for p in result.parameters:
            if p.target == name:
                found[k, "xyz".index(p.name)] = p.value
    return found


def amid(anchors: Array, lengths: Array) -> tuple[Array, float]:
    """The place nearest to these lengths by Gauss-Newton, and the largest error there [mm]."""
    at = np.array([1450.0, 1000.0])
    for _ in range(30):
        there = distances(at[None], anchors)[0]
        slopes = (at - anchors[:, :2]) / there[:, None]
        at = at + np.linalg.lstsq(slopes, lengths - there, rcond=None)[0]
    return at, float(np.abs(distances(at[None], anchors)[0] - lengths).max())


@pytest.mark.parametrize("criterion", [None, "volume"])
def test_a_planned_sled_is_in_the_frame_with_belts_as_long_as_its_distances(
    criterion: str | None,
) -> None:
    values, result = belts()
    plan = rsicalib.plan(
        "maslow", 6, result=result, beside=table(values, "maslow"), criterion=criterion
    )
    anchors = anchors_of(result)
    low, high = anchors[:, :2].min(axis=0), anchors[:, :2].max(axis=0)
    assert 0 < len(plan.readings) <= 6
    for row in plan.readings:
        at, off = amid(anchors, row)
        # Readings to expect are without what is open: gains, of which the anchors are not free.
        assert off < 0.3, (row, at)
        assert np.all(at > low) and np.all(at < high), (row, at)
    span = np.ptp(values, axis=0)
    assert np.all(plan.readings >= values.min(axis=0) - 0.1 * span - 1e-6)
    assert np.all(plan.readings <= values.max(axis=0) + 0.1 * span + 1e-6)


def test_declared_ranges_of_belts_are_kept() -> None:
    values, _ = belts()
    drawn = Mechanism("maslow").to_dict()
    for channel in drawn["channel"]:
        channel["range"] = [300.0, 2700.0]
    mechanism = Mechanism(drawn)
    within = values[(values > 300.0).all(axis=1) & (values < 2700.0).all(axis=1)]
    readings = table(within, mechanism)
    result = rsicalib.calibrate(readings, mechanism)
    plan = rsicalib.plan(mechanism, 4, result=result, beside=readings, criterion="volume")
    assert len(plan.readings) and plan.readings.min() > 300.0 and plan.readings.max() < 2700.0
    assert max(amid(anchors_of(result), row)[1] for row in plan.readings) < 0.3


def test_an_effect_supposed_in_a_plan_of_belts_has_a_size() -> None:
    values, result = belts()
    plan = rsicalib.plan(
        "maslow", 12, result=result, beside=table(values, "maslow"), criterion="volume"
    )
    found = rsicalib.suppose(table(plan.readings, "maslow"), ["curvature@tl=10"], "maslow")
    assert found.noncentrality > 1.0


def test_gains_that_differ_by_the_size_of_the_whole_want_a_length_and_no_poses() -> None:
    values, result = belts()
    (step,) = result.steps
    assert step.term == "gain" and {t.target for t in step.also_fits} | {step.target} >= {
        "tl+tr",
        "bl+br",
    }
    assert step.needs_length
    told = result.summary(width=1000)
    assert MEASURED_LENGTH in told and "over more of" not in told
    plan = rsicalib.plan("maslow", 6, result=result, beside=table(values, "maslow"))
    assert MEASURED_LENGTH in " ".join(plan.advice) and "over more of" not in " ".join(plan.advice)


def test_a_gain_that_two_belts_share_is_put_in_beside_what_they_declare() -> None:
    _, result = belts()
    mechanism = Mechanism("maslow")
    found = _core.calibrated_sensors(mechanism, as_applied(result, mechanism))
    gains = {c.name: c.gain for c in found.channels}
    (step,) = result.steps
    for name, gain in gains.items():
        more = step.parameters[0].value if name in step.target.split("+") else 0.0
        assert gain == pytest.approx(1.0 + more, abs=1e-12)


@cache
def touches() -> Array:
    """The session of docs/delta.md."""
    rng = np.random.default_rng(34)
    rod, tall, steps = 280.0, 602.487, 80
    bearing = np.deg2rad([90, 210, 330])
    towers = (140 + 0.8) * np.column_stack([np.cos(bearing), np.sin(bearing)])
    endstops = tall + np.array([-1.4, 0.7, 1.1])
    rows = []
    for pose in range(1, 43):
        radius, turn = 110 * np.sqrt(pose / 42), 2.4 * pose
        x, y, z = radius * np.cos(turn), radius * np.sin(turn), rng.normal(0, 0.03)
        up = z + np.sqrt(rod**2 - np.hypot(*(towers - [x, y]).T) ** 2)
        rows.append(np.round((endstops - up) * steps))
    return np.array(rows)


def test_a_delta_printer_without_limits_is_planned_over_its_bed() -> None:
    readings = table(touches(), "delta")
    result = rsicalib.calibrate(readings, "delta")
    plan = rsicalib.plan("delta", 4, result=result, beside=readings, criterion="offsets")
    span = np.ptp(touches(), axis=0)
    assert len(plan.readings)
    assert np.all(plan.readings >= touches().min(axis=0) - 0.1 * span - 1e-6)
    assert np.all(plan.readings <= touches().max(axis=0) + 0.1 * span + 1e-6)
    offsets = np.array([result["offset", name].value for name in "abc"])
    bearing = np.deg2rad([90, 210, 330])
    towers = 140 * np.column_stack([np.cos(bearing), np.sin(bearing)])
    for row in plan.readings:
        up = offsets - row / 80
        # Differences of the three spheres about the carriages are linear in the place on the bed.
        centres = np.column_stack([towers, up])
        power = (centres**2).sum(axis=1)
        at = np.linalg.solve(2 * (towers[1:] - towers[0]), power[1:] - power[0])
        off = np.linalg.norm(centres - np.r_[at, 0.0], axis=1) - 280.0
        assert np.abs(off).max() < 0.05 and np.hypot(*at) < 1.3 * 110


def test_a_gantry_whose_axes_carry_no_length_reaches_its_sockets() -> None:
    """Three slides on each other, a ball at the end; sockets half a metre away."""
    drawn = gantry()
    mechanism = Mechanism(drawn)
    rng = np.random.default_rng(2)
    sockets = rng.uniform([100, 100, 20], [500, 500, 200], (5, 3))
    turn, tilt = rng.uniform(-3, 3, 60), rng.uniform(-0.8, 0.8, 60)
    at = rng.integers(0, 5, 60)
    axes = sockets[at] - tip(turn, tilt)
    values = np.c_[axes, turn, tilt] + rng.normal(0, [0.003] * 3 + [2e-5] * 2, (60, 5))
    readings = rsicalib.Readings.from_arrays(
        mechanism, values, pose=np.arange(1, 61), keys={"at": [f"s{k}" for k in at]}
    )
    result = rsicalib.calibrate(readings, mechanism)
    plan = rsicalib.plan(mechanism, 5, result=result, beside=readings, criterion="volume")
    assert len(plan.readings)
    for row, own in zip(plan.readings, plan.keys["at"], strict=True):
        c, b = row[3:] + [result["offset", name].value for name in "cb"]
        there = row[:3] + tip(np.array([c]), np.array([b]))[0]
        assert np.abs(there - sockets[int(own[1:])]).max() < 0.1


def test_offsets_of_belts_are_put_into_a_mechanism_as_they_were_found() -> None:
    """A length is `offset + gain` times the reading, in the file as in the result."""
    terms = ["offset@bl", "offset@br", "gain@bl+br"]
    result = rsicalib.calibrate(table(belts()[0], "maslow"), "maslow", terms=terms)
    told = {(p.term, p.target): p.value for p in result.parameters}
    mechanism = Mechanism("maslow")
    found = _core.calibrated_sensors(mechanism, as_applied(result, mechanism)).to_dict()
    for channel in found["channel"][2:]:
        assert channel["offset"] == pytest.approx(told["offset", channel["name"]], abs=1e-9)
        assert channel["gain"] == pytest.approx(1.0 + told["gain", "bl+br"], abs=1e-12)


def tip(turn: Array, tilt: Array) -> Array:
    """The ball of the gantry, `Rz(turn) Ry(tilt) (80, 0, -120)`."""
    x = 80 * np.cos(tilt) - 120 * np.sin(tilt)
    z = -80 * np.sin(tilt) - 120 * np.cos(tilt)
    return np.column_stack([x * np.cos(turn), x * np.sin(turn), z])


def gantry() -> dict[str, Any]:
    """Slides along x, y and z of the base, then a turn about z and one about y."""
    right = np.pi / 2
    slide = [
        {"name": f"{axis}_axis", "unit": "mm", "gain": 1.0, "offset": 0.0, "noise": 0.003}
        for axis in "xyz"
    ]
    turns = [
        {"name": name, "unit": "rad", "gain": 1.0, "offset": 0.0, "noise": 2e-5} for name in "cb"
    ]
    rows = [
        {"rpy": [0.0, right, 0.0]},
        {"channel": "x_axis", "joint": "prismatic", "rpy": [-right, 0.0, 0.0]},
        {"channel": "y_axis", "joint": "prismatic", "rpy": [right, 0.0, -right]},
        {"channel": "z_axis", "joint": "prismatic"},
        {"channel": "c", "alpha": -right},
        {"channel": "b", "rpy": [right, 0.0, 0.0]},
    ]
    return {
        "name": "gantry",
        "length_unit": "mm",
        "channel": slide + turns,
        "chain": [{"name": "g", "dh": rows}],
        "point": [
            {"name": "tip", "chain": "g", "at": [80.0, 0.0, -120.0]},
            {"name": "socket", "unknown": ["at"]},
        ],
        "closure": [{"name": "seat", "kind": "touch", "between": ["tip", "socket"], "noise": 0.01}],
        "model": {"terms": ["offset@c", "offset@b"]},
    }


def test_belts_are_not_counted_for_their_lengths_are_read() -> None:
    with pytest.raises(InputError, match="reads a length"):
        identifiable("maslow")
