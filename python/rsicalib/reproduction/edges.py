"""Where a property ends along a line: walk until it fails, and bisect."""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np

from rsicalib.facts.records import Record


class Edge(Record):
    """Where convergence ends in one direction.

    Attributes
    ----------
    inside, outside : float
        The last start that succeeds and the first that fails, as factors on the gains.
    """

    inside: float
    outside: float | None


def edge(
    succeeds: Callable[[float], bool], limit: float, *, step: float = 0.01, width: float = 1e-4
) -> Edge:
    """Walk from 1 towards a limit until a start fails, and bisect the edge.

    Parameters
    ----------
    succeeds : callable
        Function of a factor: whether the start with it succeeds.
    limit : float
        Factor at which the walk ends.
    step : float
        Step of the walk; a gap or an island that is narrower may be missed.
    width : float
        Width at which the bisection ends.

    Returns
    -------
    Edge
        `outside` is None where every start up to the limit succeeds.
    """
    inside = 1.0
    grid = np.linspace(1.0, limit, int(np.ceil(abs(limit - 1.0) / step)) + 1)[1:]
    for factor in grid.tolist():
        if succeeds(factor):
            inside = factor
            continue
        outside = factor
        while abs(outside - inside) > width:
            middle = (inside + outside) / 2
            if succeeds(middle):
                inside = middle
            else:
                outside = middle
        return Edge(inside, outside)
    return Edge(inside, None)


def intervals(values: Sequence[float], gap: float) -> list[tuple[float, float]]:
    """Neighbouring values as intervals."""
    runs: list[list[float]] = []
    for value in sorted(values):
        if runs and value - runs[-1][1] <= gap:
            runs[-1][1] = value
        else:
            runs.append([value, value])
    return [(first, last) for first, last in runs]
