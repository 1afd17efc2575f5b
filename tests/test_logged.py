"""What logs have: rows written again, one motion again and again, a sensor that is stuck."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

import rsicalib
from rsicalib import DEMO
from tests.full import sized
from tests.machines.kit import Machine
from tests.machines.trials import MACHINES
from tests.oracle import Array

# Of one arm or of legs, with unknown places and without.
SOME = ("sockets", "bar", "fivebar", "legs")


def session(name: str, seed: int = 3) -> tuple[Machine, dict[str, Any]]:
    """A machine, and its readings by column: each pose once, to all digits."""
    rng = np.random.default_rng(seed)
    machine = MACHINES[name](rng)
    read = machine.observe(rng)
    columns: dict[str, Any] = {"pose": np.arange(len(read)), "time_s": 20.0 * np.arange(len(read))}
    columns |= dict(zip(machine.columns, read.T, strict=True))
    return machine, columns | {key: np.array(one) for key, one in machine.text.items()}


def some_rows(columns: dict[str, Any], rows: Array) -> dict[str, Any]:
    return {name: np.asarray(column)[rows] for name, column in columns.items()}


# ------------------------------------------------------------------ rows that were written again


@pytest.mark.parametrize("name", SOME)
@pytest.mark.parametrize("times", sized([1 / 6], [1 / 6, 1.0]))
def test_rows_that_were_written_again_count_once(name: str, times: float) -> None:
    machine, columns = session(name)
    n = len(columns["pose"])
    again = np.random.default_rng(1).choice(n, round(n * times), replace=False)
    once = rsicalib.calibrate(columns, machine.mechanism)
    found = rsicalib.calibrate(
        some_rows(columns, np.sort(np.r_[np.arange(n), again])), machine.mechanism
    )
    assert (found.verdict, found.noise.source) == (once.verdict, once.noise.source)
    assert found.fit.dof == once.fit.dof
    # Offsets are counted from the mean of all rows: fits end within their tolerance.
    assert found.fit.chi2 == pytest.approx(once.fit.chi2, rel=1e-4)
    assert found.noise.sigma == pytest.approx(once.noise.sigma)
    assert [w.kind for w in found.warnings] == ["stale_rows", *(w.kind for w in once.warnings)]


# ------------------------------------------------------------------ one motion again and again


def cycles(of: int, shuffled: bool) -> dict[str, Any]:
    """The poses of the demo so many times, each reading within a count, two samples each."""
    lines = (DEMO / "readings.csv").read_text(encoding="utf-8").splitlines()
    names, rows = lines[0].split(","), np.loadtxt(lines[1:], delimiter=",")
    poses = rows.reshape(48, -1, len(names))[:, :2]
    rng = np.random.default_rng(1)
    all_ = np.concatenate([poses] * of)
    all_[:, :, 4:] += rng.integers(-1, 2, all_[:, :, 4:].shape)
    if shuffled:
        all_ = all_[rng.permutation(len(all_))]
    all_[:, :, 0] = 1 + np.arange(len(all_))[:, None]
    columns = all_.reshape(-1, len(names)).T
    read = dict(zip(names, columns, strict=True))
    return {"pose": read["pose"].astype(int)} | {n: read[n] for n in names if n.startswith("a")}


def test_a_cycle_hides_no_pose_from_the_search_for_a_start() -> None:
    # 2,400 poses, of which some 150 are looked at: every 16th is one of three in a cycle of 48.
    in_cycles, shuffled = (rsicalib.calibrate(cycles(50, mixed)) for mixed in (False, True))
    assert len(in_cycles.starts) == len(shuffled.starts) == 1
    # The same rows in another order: the same minimum.
    assert in_cycles.fit.chi2 == pytest.approx(shuffled.fit.chi2, rel=1e-4)


# ------------------------------------------------------------------ a sensor that is stuck


@pytest.mark.parametrize("name", SOME)
def test_a_stuck_sensor_is_named(name: str) -> None:
    machine, columns = session(name)
    first = round(0.6 * len(columns["pose"]))
    # The last moves most of what is closed, whatever the machine.
    channel = machine.columns[-1]
    stuck = {
        **columns,
        channel: np.where(columns["pose"] < first, columns[channel], columns[channel][first]),
    }
    found = rsicalib.trace(stuck, machine.mechanism)
    told = [w for w in found.warnings if w.kind == "stuck"]
    assert [w.target for w in told] == [channel]
    assert f"{first} to {columns['pose'][-1]}" in told[0].text


@pytest.mark.parametrize("name", SOME)
def test_a_joint_that_stands_is_not_stuck(name: str) -> None:
    """Sound rows: the same pose of all joints again and again, as coarse converters read it."""
    machine, columns = session(name)
    rows = np.sort(np.r_[np.arange(len(columns["pose"])), [5] * 30])
    columns = some_rows(columns, rows) | {"pose": np.arange(len(rows))}
    for joint, sigma in zip(machine.columns, machine.sigma, strict=True):
        columns[joint] = np.round(columns[joint] / (8 * sigma)) * 8 * sigma
    found = rsicalib.trace(columns, machine.mechanism)
    assert "stuck" not in {w.kind for w in found.warnings}
