"""The paper's misprints, each settled by a calculation rather than by opinion."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any

import numpy as np

from rsicalib.reproduction import misprinted_equations as equations
from rsicalib.reproduction import misprinted_tables as tables
from rsicalib.reproduction.document import Misprint
from rsicalib.reproduction.noise import NoiseCell, closed_loop_noise
from rsicalib.reproduction.printed import Printed
from rsicalib.reproduction.trials import Draws


def misprints(
    paper: Printed, averages: Mapping[str, float], trials: int, seed: int
) -> tuple[Misprint, ...]:
    """Re-derive every misprint.

    Parameters
    ----------
    paper : Printed
        The paper's numbers.
    averages : mapping of str to float
        Computed cells of Table IX by name, as `rsicalib.paper` has them.
    trials, seed : int
        Number of trials, and the seed, of the simulations for Table IX.

    Returns
    -------
    tuple of Misprint
        In the order of the paper.
    """
    one_by_one: list[Callable[[Printed], Misprint]] = [
        tables.table_i,
        equations.eq_4,
        equations.eq_5,
        equations.ranges,
        equations.eq_8,
        equations.eq_12,
        equations.eq_13,
        tables.table_ii,
        tables.offset_3,
        tables.offset_from,
        tables.table_vii,
        tables.jacobian,
        tables.discussion,
    ]
    return (*(one(paper) for one in one_by_one), *table_ix(paper, averages, trials, seed))


def table_ix(
    paper: Printed, averages: Mapping[str, float], trials: int, seed: int
) -> tuple[Misprint, ...]:
    """Noise, averages and poses of Table IX."""
    printed = paper.numbers["noise"]["closed_average_2"]
    hundred = paper.numbers["noise"]["closed_average_100"]
    device, poses = paper.nominal, paper.closed_loop

    def found(noise: float, average: int, **how: Any) -> NoiseCell:
        draws = Draws(trials, seed)
        return closed_loop_noise(device, poses, draws, noise=noise, average=average, **how)

    variance = [found(float(np.sqrt(v)), 2).offset.value for v in (1, 2, 4)]
    unrounded = found(1.0, 100, round_average=False).offset.value
    at_table = {s: found(s, 2, placement=(0.0, 0.0)) for s in (0, 1, 2, 4)}
    exact = {s: cell.offset.value for s, cell in at_table.items()}
    lost = sum(cell.failed for cell in at_table.values())
    level = {0: "truncation", 1: "1", 2: "2", 4: "4"}
    worse = [exact[s] / printed[level[s]][0] for s in exact]
    deviation = [averages[f"closed 2 {s}"] for s in (1, 2, 4)]
    rows = [averages[f"closed 100 {s}"] for s in (1, 2, 4)]
    truncation = averages["closed 2 0"]
    return (
        Misprint(
            "Table IX, “variance 1, 2, 4”",
            "variance",
            "standard deviation, in counts",
            "Printed errors double from row to row, "
            f"{_list([printed[str(s)][0] for s in (1, 2, 4)])}: so they do with these standard "
            f"deviations, {_list(deviation)}; with these variances they are {_list(variance)}.",
            {f"variance {v}": x for v, x in zip((1, 2, 4), variance, strict=True)},
        ),
        Misprint(
            "Table IX, averages of 100",
            "variance 1, 1, 1",
            "1, 2, 4",
            f"Standard deviations 1, 2, 4 give {_list(rows)}, the printed rows are "
            f"{_list([hundred[str(s)][0] for s in (1, 2, 4)])}.",
            {f"σ = {s}": x for s, x in zip((1, 2, 4), rows, strict=True)},
        ),
        Misprint(
            "Table IX, averages of 100",
            "(not said)",
            "the average is rounded again",
            f"Without that the error at σ = 1 is {unrounded:.4f} rad, far below the truncation row "
            f"({truncation:.4f}); printed {hundred['1'][0]}. Rounded again it is {rows[0]:.4f}.",
            {"not rounded": unrounded, "rounded": rows[0]},
        ),
        Misprint(
            "Table IX, poses",
            "“the poses of Table III”",
            "Table III as placed by hand: + N(0, 0.25) in and rad",
            f"Exactly at Table III errors are {_list([exact[s] for s in (0, 1, 2, 4)])} for "
            f"truncation, 1, 2, 4: {min(worse):.1f} to {max(worse):.1f} times the printed ones ("
            f"{lost} of {4 * trials} trials did not even come near the truth and are left out). "
            f"With the perturbation of section IV-B: {_list([truncation, *deviation])}.",
            {f"exact, σ = {s}": exact[s] for s in (0, 1, 2, 4)},
        ),
    )


def _list(values: list[float]) -> str:
    return ", ".join(f"{v:.3f}" for v in values)
