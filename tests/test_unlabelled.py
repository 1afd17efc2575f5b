"""Files without the column `pose`: poses that were read once each, or a recording in motion.

Witness: positions of the tool by products of plain matrices, with three draw wires to it.
"""

from __future__ import annotations

import numpy as np
import pytest

import rsicalib
from tests import crank
from tests.full import sized
from tests.oracle import Array
from tests.test_ratio import HOOKS, NOISE, PALLETISER, WIRE, mechanism, palletiser

ROWS = 120


def read(q: Array, errors: Array, step_s: float, seed: int) -> dict[str, Array]:
    """One row for each pose, with its time and the lengths of the wires."""
    rng = np.random.default_rng(seed)
    values = q - errors + NOISE * rng.standard_normal(q.shape)
    length = np.linalg.norm(palletiser(q, -1.0)[:, None] - HOOKS, axis=2)
    length += WIRE * rng.standard_normal(length.shape)
    joints = {f"q{k + 1}": values[:, k] for k in range(3)}
    wires = {f"wire{k}": length[:, k] for k in range(3)}
    return {"time_s": step_s * np.arange(len(q)), **joints, **wires}


def poses(seed: int) -> Array:
    """Joint angles that have nothing to do with those of the row before."""
    return np.random.default_rng(seed).uniform([-1.2, 0.3, -1.8], [1.2, 1.3, -0.6], (ROWS, 3))


def motion() -> Array:
    """Joint angles of a slow wave of each joint."""
    t = np.linspace(0.0, 2 * np.pi, 4 * ROWS)[:, None]
    return np.array([0.0, 0.8, -1.2]) + [1.2, 0.5, 0.6] * np.sin(t * [1.0, 2.0, 3.0] + [0.0, 1, 2])


def bent(q: Array, channel: int) -> Array:
    """Hysteresis of one sensor: half its width to the side from which the joint came."""
    errors = np.zeros(q.shape)
    errors[1:, channel] = 6 * NOISE * np.sign(np.diff(q[:, channel]))
    return errors


@pytest.mark.parametrize("channel", sized([2], [0, 1, 2]))
@pytest.mark.parametrize("kind", ["poses", "motion"])
def test_hysteresis_is_named_in_single_poses_and_in_a_motion(kind: str, channel: int) -> None:
    q, step_s = (poses(channel), 10.0) if kind == "poses" else (motion(), 0.1)
    explained = 0
    for seed in range(sized(3, 6)):
        found = rsicalib.trace(read(q, bent(q, channel), step_s, seed), mechanism(PALLETISER, 3))
        (step,) = found.steps
        assert (step.term, step.target) == ("hysteresis", f"q{channel + 1}")
        (half,) = step.parameters
        assert abs(half.value - 6 * NOISE) < 4.0 * half.sd
        explained += found.verdict == "explained"
    # Where a joint turns round, noise decides from which side it came: some sessions show it.
    assert explained >= sized(2, 4)


def counts(seed: int, noise: float, reach: int) -> Array:
    """Whole numbers of nine channels: 24 poses within a small reach, eight samples of each."""
    rng = np.random.default_rng(seed)
    held = rng.integers(2000 - reach, 2000 + reach, (24, 9)).repeat(8, axis=0)
    return np.round(held + noise * rng.standard_normal(held.shape))


@pytest.mark.parametrize("seed", range(sized(4, 12)))
def test_repeats_of_a_small_workspace_are_told_and_not_taken(seed: int) -> None:
    mechanism = rsicalib.load_mechanism("rsi")
    readings = rsicalib.Readings.from_arrays(mechanism, counts(seed, 2.0, 60))
    (said,) = (w for w in readings.warnings if w.kind == "unlabelled_repeats")
    assert "24 groups of 8" in said.text and readings.repeats is None


@pytest.mark.parametrize("seed", range(sized(15, 60)))
def test_poses_of_their_own_are_no_repeats(seed: int) -> None:
    """Poses anywhere, a grid that is walked row by row, and a slow motion."""
    mechanism = rsicalib.load_mechanism("rsi")
    rng = np.random.default_rng(seed)
    grid = np.stack(np.meshgrid(np.arange(6), np.arange(8), indexing="ij"), axis=-1).reshape(-1, 2)
    walked = 1500 + (grid @ rng.uniform(-40, 40, (2, 9))) + rng.standard_normal((48, 9))
    wave = 1500 + 400 * np.sin(np.linspace(0, 9, 96)[:, None] * rng.uniform(0.5, 1.5, 9))
    for values in (rng.integers(1000, 3000, (96, 9)).astype(float), walked.round(), wave.round()):
        readings = rsicalib.Readings.from_arrays(mechanism, values)
        assert not [w for w in readings.warnings if w.kind == "unlabelled_repeats"]


@pytest.mark.parametrize("reading", [2000.0, 2000.5])
def test_a_device_that_stands_still_is_read(reading: float) -> None:
    """Rows of which no channel moves were no readings: a greatest of nothing was asked for."""
    mechanism = rsicalib.load_mechanism("rsi")
    readings = rsicalib.Readings.from_arrays(mechanism, np.full((20, 9), reading))
    assert len(readings) == 20 and readings.repeats is None


def test_an_encoder_that_begins_each_turn_anew_holds_no_pose() -> None:
    """A recording of ten turns: between two jumps of the encoder the crank goes round."""
    turned = np.linspace(0.0, 20.8 * np.pi, 3000)
    readings = crank.read(turned) + [2e-3, 0.0] * np.sin(turned)[:, None]
    wrapped = np.column_stack([np.mod(readings[:, 0], 2 * np.pi), readings[:, 1]])
    mechanism = crank.four_bar("offset")
    for values in (readings, wrapped):
        columns = dict(zip(crank.OFFSETS, values.T, strict=True))
        table = {"time_s": 0.01 * np.arange(len(turned)), **columns}
        found = rsicalib.trace(table, mechanism)
        named = [(step.term, step.target) for step in found.steps]
        assert (found.verdict, named) == ("explained", [("once_per_turn", "crank")])
        assert found.readings.poses == 3000 and not found.warnings
