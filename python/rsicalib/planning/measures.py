"""What a set of poses can and cannot tell about offsets and gains."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import field
from typing import TYPE_CHECKING, Any, ClassVar

import numpy as np

from rsicalib import _core, options
from rsicalib._core import Mechanism
from rsicalib.arrays import Alike, FloatArray
from rsicalib.errors import InputError
from rsicalib.facts.records import NOT_WRITTEN, Record
from rsicalib.plain_text import counted
from rsicalib.plots import lines, on_axes
from rsicalib.poses.devices import nominal
from rsicalib.tabular import Tabular
from rsicalib.work.arguments import (
    CalibrationArg,
    MechanismArg,
    ReadingsArg,
    earlier_result,
    load,
    names_in,
    open_mechanism,
)

if TYPE_CHECKING:
    from matplotlib.axes import Axes


SCALINGS = _core.SCALINGS
"""Scalings of the Jacobian's columns, by name."""

MEANING = {
    "none": "columns as they are: rad beside rad/count",
    "unit_columns": "every column of length one",
    "wrist_position": "each column by how far its parameter moves the points of the closures (rms)",
}


class Measures(Record):
    """Measures of the singular values `s` of the Jacobian (12) under one scaling."""

    scaling: str
    """Name of the scaling."""
    o1: float
    """Geometric mean of `s` over √rows (Borm & Menq 1991)."""
    o2: float
    """Smallest over largest (Driels & Pathre 1990): the inverse condition number."""
    o3: float
    """Smallest (Nahvi, Hollerbach & Hayward 1994)."""
    o4: float
    """Smallest squared over largest (Nahvi & Hollerbach 1996)."""
    o5: float
    """`1 / Σ 1/s²` (Sun & Hollerbach 2008)."""
    condition: float
    """Largest over smallest."""
    singular_values: tuple[float, ...]
    """Largest first."""


class Observability(Alike, Tabular, Record, eq=False, repr=False):
    """What poses can tell of the paper's parameters."""

    ROWS: ClassVar[str | None] = "channel"

    samples: int
    """Rows of readings that took part."""
    scalings: tuple[Measures, ...]
    """One for each scaling."""
    offset_sd: FloatArray
    """Cramér-Rao bound of the offsets for one unit of noise per reading [rad], shape (C,); NaN
    where these poses cannot tell."""
    gain_sd: FloatArray
    """The same of the gains [rad/reading]."""
    unobservable: tuple[str, ...]
    """Directions in the space of parameters that the poses cannot determine, in words."""
    weak: tuple[str, ...]
    """Directions that the poses determine badly, for one unit of noise per reading."""
    channels: tuple[str, ...] = field(default=(), metadata=NOT_WRITTEN)
    """Names of the `C` channels; not in the JSON."""

    def __getitem__(self, scaling: str) -> Measures:
        """The measures under one scaling."""
        for measures in self.scalings:
            if measures.scaling == scaling:
                return measures
        known = ", ".join(m.scaling for m in self.scalings)
        raise KeyError(f"no scaling {scaling!r}; there are {known}")

    def plot(self, scaling: str | None = None, *, ax: Axes | None = None) -> Axes:
        """Draw the singular values, largest first; needs matplotlib (`rsicalib[plot]`).

        Parameters
        ----------
        scaling : str, optional
            One of `scalings`; all of them where not given.
        ax : Axes, optional
            Where to; a new figure where not given.

        Returns
        -------
        Axes
            A gap of many decades separates what the poses cannot tell.

        Raises
        ------
        KeyError
            There is no such scaling.
        """
        chosen = self.scalings if scaling is None else (self[scaling],)
        rows = {m.scaling.replace("_", " "): m.singular_values for m in chosen}
        return lines(on_axes(ax), rows, "number", "singular value of the Jacobian")

    def _table(self) -> dict[str, Any]:
        names = self.channels or tuple(map(str, range(1, len(self.offset_sd) + 1)))
        return {"channel": names, "offset_sd": self.offset_sd, "gain_sd": self.gain_sd}

    def __repr__(self) -> str:
        told = f"{len(self.unobservable)} directions cannot be told" if self.unobservable else ""
        known = [m for m in self.scalings if m.scaling != "none"] or self.scalings[:1]
        words = [f"condition {m.condition:.3g} ({m.scaling.replace('_', ' ')})" for m in known[:1]]
        return f"<Observability of {counted(self.samples, 'sample')}: {told or ''.join(words)}>"

    def text(self) -> str:
        """A table of the measures, and the directions in words."""
        lines = [f"{counted(self.samples, 'sample')}", ""]
        lines.append(
            f"{'scaling':15s} {'O1':>10s} {'O2':>10s} {'O3':>10s} {'O4':>10s} {'O5':>10s} "
            f"{'condition':>10s}"
        )
        for m in self.scalings:
            numbers = (m.o1, m.o2, m.o3, m.o4, m.o5, m.condition)
            lines.append(f"{m.scaling:15s} " + " ".join(f"{v:10.3g}" for v in numbers))
        lines += ["", *(f"{name}: {MEANING[name]}" for name in (m.scaling for m in self.scalings))]
        lines += ["", "cannot be told:" if self.unobservable else "everything can be told"]
        lines += [f"  {words}" for words in self.unobservable]
        if self.weak:
            lines += ["hardly told, for one unit of noise per reading:"]
            lines += [f"  {words}" for words in self.weak]
        return "\n".join(lines) + "\n"


@options.checked
def observability(
    readings: ReadingsArg,
    mechanism: MechanismArg = "rsi",
    *,
    calibration: CalibrationArg | None = None,
    scalings: Sequence[str] = SCALINGS,
    closures: Sequence[str] | None = None,
    skip_bad_rows: bool = False,
) -> Observability:
    """Measure what poses can tell about offsets and gains by eq. (10), all closures alike.

    Parameters
    ----------
    readings : path, Readings or array_like of shape (n, C)
        Where the Jacobian (12) is taken.
    mechanism : str, path or Mechanism
        Distances, or touches of fixed points.
    calibration : path, Calibration or Trace, optional
        Result that gives the offsets and gains; the mechanism's own by default.
    scalings : sequence of {"none", "unit_columns", "wrist_position"}
        Scalings of the columns: singular values of rad beside rad/count mean nothing.
    closures : sequence of str, optional
        Only these.
    skip_bad_rows : bool, optional
        Drop rows that cannot be used.

    Returns
    -------
    Observability
        Measures, bounds, and directions in words.

    Raises
    ------
    InputError
        The readings cannot be used, or the mechanism has unknown points.

    See Also
    --------
    rsicalib.plan : poses that tell more.
    """
    opened = open_mechanism(mechanism, calibration)
    values = counts_of(readings, opened, skip_bad_rows)
    offsets, gains = parameters_of(calibration, opened)
    names = names_in("closures", closures, opened)
    measures = []
    found = {}
    for scaling in options.names("scalings", scalings, lambda: SCALINGS, none=True) or ():
        found = _core.observability(opened, values, offsets, gains, scaling, closures=names)
        singular = tuple(found["singular_values"])
        measures.append(Measures(scaling, **found["measures"], singular_values=singular))
    if not measures:
        raise InputError(f"scalings: found none, expected some of {', '.join(SCALINGS)}")
    bound = _core.bound(
        opened, values, offsets, gains, np.ones(len(opened.channels)), closures=names
    )
    return Observability(
        len(values),
        tuple(measures),
        known_sd(bound["offset_sd"]),
        known_sd(bound["gain_sd"]),
        tuple(found["unobservable"]),
        tuple(found["weak"]),
        tuple(c.name for c in opened.channels),
    )


def counts_of(
    readings: ReadingsArg, mechanism: Mechanism, skip_bad_rows: bool = False
) -> FloatArray:
    """Readings from a file, an object or an array: shape (n, C)."""
    loaded = load(readings, mechanism, skip_bad_rows)
    return np.ascontiguousarray(loaded.values)


def parameters_of(
    calibration: CalibrationArg | None, mechanism: Mechanism
) -> tuple[FloatArray, FloatArray]:
    """Offsets and gains of a calibration, or as the mechanism declares them."""
    offsets, gains = nominal(mechanism)
    if calibration is not None:
        result, _ = earlier_result(calibration, mechanism)
        where = {c.name: k for k, c in enumerate(mechanism.channels)}
        for p in result.parameters:
            if p.term in ("offset", "gain") and p.target in where and p.value is not None:
                (offsets if p.term == "offset" else gains)[where[p.target]] = p.value
    return offsets, gains


def known_sd(values: Sequence[float]) -> FloatArray:
    """Standard deviations, NaN where they are infinite."""
    array = np.array(values, dtype=np.float64)
    return np.where(np.isfinite(array), array, np.nan)
