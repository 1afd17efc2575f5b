"""Drawings for matplotlib: plain numbers in, axes out. matplotlib is loaded when one is drawn."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np
import numpy.typing as npt

from rsicalib.arrays import FloatArray
from rsicalib.plain_text import installed_by
from rsicalib.units import HALF_95

if TYPE_CHECKING:
    from matplotlib.axes import Axes


OLD, NEW = "#b0562f", "#1f5f8b"
"""Before and after: told apart by the colour-blind, and in print."""


def on_axes(ax: Axes | None, **size: Any) -> Axes:
    """Return the axes to draw on: those given, or those of a new figure.

    Parameters
    ----------
    ax : Axes, optional
        Axes of the caller.
    size : optional
        As `matplotlib.pyplot.subplots` takes it, for a new figure.

    Returns
    -------
    Axes
        The axes.

    Raises
    ------
    ImportError
        matplotlib is not installed.
    """
    if ax is not None:
        return ax
    try:
        from matplotlib import pyplot
    except ImportError as error:
        raise ImportError(f"a plot needs matplotlib: {installed_by('plot')}") from error
    new: Axes = pyplot.subplots(**{"layout": "constrained", **size})[1]
    return new


def dots(ax: Axes, rows: Mapping[str, npt.ArrayLike], x_words: str) -> Axes:
    """Draw residuals in units of noise over their number, with the band of ± 2.

    Parameters
    ----------
    ax : Axes
        Where to.
    rows : mapping of str to array_like, shape (n, k)
        By name: the first in the colour of what was, the last in that of what is.
    x_words : str
        What is counted.

    Returns
    -------
    Axes
        The same.
    """
    ax.axhspan(-2, 2, color=NEW, alpha=0.1, lw=0)
    ax.axhline(0, color="0.6", lw=0.8)
    all_rows = {name: np.atleast_2d(np.asarray(r, dtype=np.float64)) for name, r in rows.items()}
    every = list(all_rows.values())
    # What was may be far off everywhere, where one reading bends the fit: what is must be seen.
    edge = min(_edge(np.concatenate([r.ravel() for r in every])), FAR * _edge(every[-1].ravel()))
    told: dict[tuple[int, bool], tuple[float, str]] = {}
    for (name, values), colour in zip(all_rows.items(), (OLD, NEW)[-len(rows) :], strict=False):
        numbers = np.repeat(np.arange(1, len(values) + 1), values.shape[1])
        size, flat = 14 if len(values) <= 300 else 3, values.ravel()
        inside = np.abs(flat) <= edge
        look: dict[str, Any] = {"s": size, "color": colour, "alpha": 0.7, "lw": 0}
        ax.scatter(numbers[inside], flat[inside], label=name, **look)
        at = np.copysign(0.97 * edge, flat)
        for side, mark in ((flat > edge, "^"), (flat < -edge, "v")):
            if side.any():
                ax.scatter(numbers[side], at[side], marker=mark, **look)
        far = np.flatnonzero(~inside)
        own: dict[tuple[int, bool], tuple[float, str]] = {}
        for k in far[np.argsort(-np.abs(flat[far]), kind="stable")][:LABELLED]:
            place = (numbers[k], at[k] > 0)
            own.setdefault(place, (flat[k], colour))  # the largest comes first
        told |= own  # what is comes last, and its number stands where another would lie on it
    for (number, up), (value, colour) in told.items():
        ax.annotate(f"{value:.0f}", (number, 0.94 * edge * (1 if up else -1)), color=colour,
                    fontsize="small", ha="center", va="top" if up else "bottom")  # fmt: skip
    ax.set_ylim(-edge, edge)
    ax.set(xlabel=x_words, ylabel="residual / noise")
    if len(rows) > 1:
        ax.legend(frameon=False, ncols=len(rows), loc="upper right")
    return ax


FAR = 4.0
"""What lies beyond so many times the 95 % point of the sizes is drawn at the edge."""


LABELLED = 3
"""Of those at the edge so many have their size beside them, the largest."""


def _edge(residuals: FloatArray) -> float:
    """Where an axis of residuals ends: beyond all, but for few that are far beyond the rest."""
    sizes = np.abs(residuals[np.isfinite(residuals)])
    usual = max(3.0, FAR * float(np.quantile(sizes, 0.95)))
    return 1.1 * min(usual, max(3.0, float(sizes.max())))


def curve(
    ax: Axes,
    rows: Sequence[Sequence[float]],
    sd: Sequence[float],
    *,
    name: str,
    x_words: str,
    y_words: str,
    scale: float = 1e3,
) -> Axes:
    """Draw a correction over its variable, with its 95 % band.

    Parameters
    ----------
    ax : Axes
        Where to.
    rows : sequence of (float, float)
        Variable and correction.
    sd : sequence of float
        Standard deviation of each correction; may be empty.
    name, x_words, y_words : str
        Labels.
    scale : float
        Corrections are drawn times this.

    Returns
    -------
    Axes
        The same.
    """
    x, y = np.array(rows, dtype=np.float64).T
    y = scale * y
    ax.axhline(0, color="0.6", lw=0.8)
    if len(sd) == len(x):
        half = HALF_95 * scale * np.asarray(sd)
        ax.fill_between(x, y - half, y + half, color=NEW, alpha=0.15, lw=0)
    ax.plot(x, y, color=NEW, label=name)
    ax.set(xlabel=x_words, ylabel=y_words, title=name)
    return ax


def bars(
    ax: Axes,
    names: Sequence[str],
    values: npt.ArrayLike,
    x_words: str,
    *,
    hollow: Sequence[bool] = (),
    whiskers: npt.ArrayLike | None = None,
) -> Axes:
    """Draw horizontal bars, the first on top.

    Parameters
    ----------
    ax : Axes
        Where to.
    names : sequence of str
        One for each bar.
    values : array_like, shape (n,)
        Lengths.
    x_words : str
        What they are.
    hollow : sequence of bool
        Which are drawn as outlines.
    whiskers : array_like, shape (n,), optional
        Half widths of intervals.

    Returns
    -------
    Axes
        The same.
    """
    places = np.arange(len(names))
    empty = [*hollow, *[False] * (len(names) - len(hollow))]
    faces = ["none" if h else NEW for h in empty]
    ax.barh(places, np.asarray(values), color=faces, edgecolor=NEW, xerr=whiskers, height=0.65)
    ax.set_yticks(places, labels=list(names))
    ax.invert_yaxis()
    ax.set(xlabel=x_words)
    return ax


def intervals(
    ax: Axes, x: Sequence[Any], values: npt.ArrayLike, half: npt.ArrayLike, y_words: str
) -> Axes:
    """Draw values with their intervals over numbers or dates."""
    ax.errorbar(np.asarray(x), np.asarray(values), np.asarray(half), fmt="o", color=NEW, capsize=2)
    ax.set(ylabel=y_words)
    return ax


def lines(ax: Axes, rows: Mapping[str, Sequence[float]], x_words: str, y_words: str) -> Axes:
    """Draw positive numbers on a logarithmic scale, one line for each name."""
    for name, values in rows.items():
        ax.semilogy(np.arange(1, len(values) + 1), values, marker="o", ms=4, label=name)
    ax.set(xlabel=x_words, ylabel=y_words)
    ax.legend(frameon=False)
    return ax


def scatter(
    ax: Axes, x: FloatArray, y: FloatArray, colour: FloatArray, labels: Sequence[str]
) -> Axes:
    """Draw points coloured by a number; `labels` are those of x, y and the colour."""
    drawn = ax.scatter(x, y, c=colour, s=18, cmap="viridis")
    ax.figure.colorbar(drawn, ax=ax, label=labels[2])
    ax.set(xlabel=labels[0], ylabel=labels[1], aspect="equal")
    return ax
