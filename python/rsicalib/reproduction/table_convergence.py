"""The text on convergence: starting gains from which the truth is found."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from rsicalib import _core
from rsicalib.arrays import FloatArray
from rsicalib.poses.devices import Device
from rsicalib.reproduction.convergence import (
    convergence_equal,
    convergence_independent,
    start_success,
)
from rsicalib.reproduction.document import Cell, Row, Table
from rsicalib.reproduction.placing import placed
from rsicalib.reproduction.study import Study
from rsicalib.reproduction.trials import Estimate


def convergence(study: Study) -> Table:
    """Intervals of convergence beside the printed ones, and independent gain errors."""
    printed = study.numbers["convergence"]
    nominal, poses = study.printed.nominal, study.printed.closed_loop
    gain = float(nominal.gains[0]) * 1e3
    flat = poses * [1, 1, 0, 1, 1, 1]
    rows, islands = [], []
    cases: list[tuple[str, FloatArray, bool, Sequence[float | None]]] = [
        ("Table III", poses, False, printed["closed_loop_poses"]),
        ("Table III with z = 0", flat, False, printed["closed_loop_poses_z0"]),
        ("Table III, anchored at rest", poses, True, (None, None)),
        ("Table III with z = 0, anchored at rest", flat, True, (None, None)),
    ]
    for k, (label, where, anchored, shown) in enumerate(cases):
        study.say("convergence", k, len(cases) + 1)
        region = convergence_equal(nominal, where, anchored=anchored)
        ends = gain * region.high, gain * region.low
        rows.append(Row(label, tuple(map(Cell, ends, shown))))
        for first, last in region.islands:
            islands.append(f"{label}: also {gain * last:.3f} … {gain * first:.3f}")
    rng = np.random.default_rng(study.seed)
    sd = study.numbers["convergence"]["pose_perturbation_sd"]
    placement = (float(sd["position_in"]), float(sd["orientation_rad"]))
    count = 40
    by_hand = []
    for own in placed(nominal, poses, placement, rng, count):
        region = convergence_equal(nominal, _poses_of(nominal, own), islands=False)
        by_hand.append([gain * region.high, gain * region.low])
    estimates = [Estimate.of(column) for column in np.array(by_hand).T]
    cells = tuple(Cell(e.value, None, e.sd) for e in estimates)
    rows.append(Row(f"Table III placed by hand, mean of {count}", cells))
    few = max(20, min(study.trials, 200))
    notes = list(islands)
    for anchored, words in ((False, "the paper's start"), (True, "anchored at rest")):
        draws = study.draws(f"convergence, {words}", few)
        far = convergence_independent(nominal, poses, draws, anchored=anchored)
        quiet = replace(draws, progress=None)
        rates = start_success(nominal, poses, (0.1, 0.2, 0.5), quiet, anchored=anchored)
        shares = ", ".join(
            f"±{s.error:.0%} {s.rate.value:.0%} ± {s.rate.sd or 0:.0%}" for s in rates
        )
        notes.append(
            f"Independent gain errors, {words}, {few} draws: succeeds from {shares}; along a "
            f"random direction the edge is at {np.quantile(far, 0.1):.0%} (first tenth), "
            f"{np.median(far):.0%} (median) of the largest error."
        )
    notes += [
        "Edges by bisection from -1.449e-3; the paper's are from MATLAB's solver of 1993, and "
        "an edge belongs to a solver as much as to a problem. For z = 0 the printed interval "
        "is not reproduced: its lower end lies beyond islands that no bisection would find "
        "from the inside.",
        "Anchored: offsets start at θ_rest - k a_rest, so that a wrong gain swings a joint "
        "about the rest pose instead of count zero.",
    ]
    return Table(
        "convergence",
        "starting gains (1e-3 rad/count), all alike, from which the truth is found",
        ("from", "to"),
        tuple(rows),
        "partly reproduced",
        tuple(notes),
    )


def _poses_of(device: Device, exact: FloatArray) -> FloatArray:
    return _core.rsi_poses(np.ascontiguousarray(exact * device.gains + device.offsets))
