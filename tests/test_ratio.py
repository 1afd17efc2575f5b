"""Joints that move by ratios of other channels: bars of a parallelogram, wheels of a differential.

Witness: positions of the tool by products of plain matrices, with three draw wires to it.
"""

from __future__ import annotations

import numpy as np
import pytest

import rsicalib
from rsicalib import Mechanism
from rsicalib.verbs.export import calibrated
from tests import oracle
from tests.full import sized
from tests.oracle import Array

HOOKS = np.array([[0.0, -2.0, 2.5], [2.5, 2.0, 0.0], [-1.5, 1.5, 2.0]])
NOISE, WIRE = 5e-5, 2e-4


def mechanism(rows: str, channels: int) -> Mechanism:
    """A chain with three wires of measured length to its end [m]."""
    sensors = "".join(
        f'[[channel]]\nname = "q{k + 1}"\nunit = "rad"\ngain = 1.0\noffset = 0.0\nnoise = {NOISE}\n'
        for k in range(channels)
    )
    hooks = "".join(
        f'[[point]]\nname = "hook{k}"\nat = {list(map(float, hook))}\n'
        f'[[closure]]\nname = "wire{k}"\n'
        f'kind = "distance"\nbetween = ["tool", "hook{k}"]\nvalue = "wire{k}"\nnoise = {WIRE}\n'
        for k, hook in enumerate(HOOKS)
    )
    return Mechanism(
        f'name = "driven"\nlength_unit = "m"\n{sensors}[[chain]]\nname = "arm"\ndh = [{rows}]\n'
        f'[[point]]\nname = "tool"\nchain = "arm"\nat = [0.1, 0.05, 0.02]\n{hooks}'
        '[model]\nterms = ["offset"]\n'
    )


PALLETISER = """{channel = "q1", d = 0.5, a = 0.3, alpha = 1.5707963}, {channel = "q2", a = 1.0},
  {channel = "q2", ratio = -1.0}, {channel = "q3", a = 1.1}"""
"""Bars keep the direction of the forearm while the upper arm turns."""
WRIST = """{channel = "q1", d = 0.5, a = 0.3, alpha = 1.5707963}, {channel = "q2", ratio = 0.5},
  {channel = "q3", ratio = 0.5, alpha = -1.5707963, a = 0.2},
  {channel = "q2", ratio = 0.5}, {channel = "q3", ratio = -0.5, a = 0.4}"""
"""A differential: two wheels tilt the wrist together, and turn it against each other."""


def palletiser(q: Array, bars: float) -> Array:
    """Where the tool is, with another ratio of the bars than drawn."""
    return (
        oracle.dh(q[:, 0], 0.5, 0.3, 1.5707963)
        @ oracle.dh(q[:, 1], 0.0, 1.0, 0.0)
        @ oracle.dh(bars * q[:, 1] + q[:, 2], 0.0, 1.1, 0.0)
        @ np.array([0.1, 0.05, 0.02, 1.0])
    )[:, :3]


def wrist(q: Array) -> Array:
    """Where the tool of the differential is."""
    return (
        oracle.dh(q[:, 0], 0.5, 0.3, 1.5707963)
        @ oracle.dh(0.5 * (q[:, 1] + q[:, 2]), 0.0, 0.2, -1.5707963)
        @ oracle.dh(0.5 * (q[:, 1] - q[:, 2]), 0.0, 0.4, 0.0)
        @ np.array([0.1, 0.05, 0.02, 1.0])
    )[:, :3]


def readings(q: Array, tool: Array, offsets: Array, rng: np.random.Generator) -> dict[str, Array]:
    """Four samples of each pose, and the lengths of the wires."""
    pose = np.repeat(np.arange(len(q)), 4)
    values = (q - offsets)[pose] + NOISE * rng.standard_normal((len(pose), q.shape[1]))
    length = np.linalg.norm(tool[:, None] - HOOKS, axis=2) + WIRE * rng.standard_normal((len(q), 3))
    joints = {f"q{k + 1}": values[:, k] for k in range(q.shape[1])}
    return {"pose": pose + 1, **joints, **{f"wire{k}": length[pose, k] for k in range(3)}}


def test_wheels_of_a_differential_are_calibrated() -> None:
    rng = np.random.default_rng(3)
    device = mechanism(WRIST, 3)
    q, offsets = rng.uniform(-1.2, 1.2, (60, 3)), np.array([0.01, -0.02, 0.015])
    result = rsicalib.calibrate(readings(q, wrist(q), offsets, rng), device)
    assert result.verdict == "adequate"
    for p, truth in zip(result.parameters, offsets, strict=True):
        assert abs(p.value - truth) < 4.0 * p.sd  # 4 sd: 1 in 5,000 for three of them


@pytest.mark.parametrize("seed", range(sized(1, 3)))
def test_bars_of_unequal_length_are_named(seed: int) -> None:
    rng = np.random.default_rng(seed)
    device = mechanism(PALLETISER, 3)
    q = np.column_stack(
        [rng.uniform(-1, 1, 60), rng.uniform(0.3, 1.6, 60), rng.uniform(-1, 0.8, 60)]
    )
    offsets = np.array([0.01, -0.02, 0.015])
    rows = readings(q, palletiser(q, -1.0), offsets, rng)
    assert rsicalib.trace(rows, device).verdict == "adequate"
    found = rsicalib.trace(readings(q, palletiser(q, -1.004), offsets, rng), device)
    assert found.verdict == "explained"
    (step,) = found.steps
    assert (step.term, step.target, step.also_fits) == ("ratio", "arm/3", ())
    result = rsicalib.calibrate(
        readings(q, palletiser(q, -1.004), offsets, rng), device, terms=["offset", "ratio"]
    )
    (ratio,) = (p for p in result.parameters if p.term == "ratio")
    assert abs(ratio.value + 0.004) < 4.0 * ratio.sd
    assert ratio.sd < 4e-4  # a tenth of the effect

    # Put into the mechanism, nothing is left.
    exported = calibrated(device, result).mechanism
    row = exported.to_dict()["chain"][0]["dh"][2]
    assert row["ratio"] == pytest.approx(-1.0 + ratio.value)
    again = readings(q, palletiser(q, -1.004), offsets, rng)
    assert rsicalib.calibrate(again, exported).verdict == "adequate"
