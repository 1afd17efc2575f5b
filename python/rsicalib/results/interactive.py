"""A result at work: parameters by name, data frames, plots, and how a notebook shows it."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import TYPE_CHECKING, Any, ClassVar, Literal, TypeAlias, overload

from rsicalib.facts.shapes import Parameter, ResultShape, Step, TraceShape
from rsicalib.labels import Labelled
from rsicalib.plain_text import meant, quoted
from rsicalib.plots import bars, dots, on_axes
from rsicalib.report.notebook import result_html
from rsicalib.report.words import name_of
from rsicalib.tabular import Tabular
from rsicalib.units import HALF_95

if TYPE_CHECKING:
    from matplotlib.axes import Axes


Kind: TypeAlias = Literal["residuals", "effects", "parameters"]
"""What `plot` draws."""

HIDDEN = 6
"""Effects that could hide which `plot("effects")` draws at the most."""


class Interactive(Tabular, ResultShape, eq=False, repr=False, kw_only=True):
    """Access to a result: as a row of `sqlite3`, by name and by number.

    `result["gain@a11"]` and `result[0]` are parameters, `keys()` are their names, and iteration
    goes over the parameters themselves. A data frame of it is indexed by name, with `term`,
    `target`, `parameter`, `value`, `sd`, the bounds `low` and `high` of 95 %, and `unit`.
    """

    ROWS: ClassVar[str | None] = "name"

    def __post_init__(self) -> None:
        """Name the rows of the covariance, whose order is that of the parameters."""
        values: Any = self.covariance  # None in a result that has no parameters
        names = self.keys() if values is not None and values.size else []
        labelled = Labelled.of([] if values is None else values, names)
        object.__setattr__(self, "covariance", labelled)

    def keys(self) -> list[str]:
        """Names of the parameters, in their order: `gain@a11`, `curvature@a22.c2`."""
        return [p.key for p in self.parameters]

    @overload
    def __getitem__(self, key: str | tuple[str, ...] | int) -> Parameter: ...

    @overload
    def __getitem__(self, key: slice) -> tuple[Parameter, ...]: ...

    def __getitem__(
        self, key: str | tuple[str, ...] | int | slice
    ) -> Parameter | tuple[Parameter, ...]:
        """A parameter: by name, by `(term, target)` or `(term, target, name)`, or by number."""
        if isinstance(key, int | slice):
            return self.parameters[key]
        if isinstance(key, str):
            found = [p for p in self.parameters if key == f"{p.spec}.{p.name}"]
            found = found or [p for p in self.parameters if key == p.spec]
        else:
            found = [p for p in self.parameters if (p.term, p.target, p.name)[: len(key)] == key]
        if len(found) == 1:
            return found[0]
        if found:
            names = ", ".join(p.key for p in found)
            raise KeyError(f"{key!r} has several parameters; ask for one of {names}")
        near = meant(key, self.keys()) if isinstance(key, str) else ""
        there = ", ".join(self.keys())
        raise KeyError(f"{quoted(key)} is not among the parameters{near}; there are {there}")

    def __contains__(self, key: object) -> bool:
        if isinstance(key, Parameter):
            return key in self.parameters
        try:
            return self[key] is not None  # type: ignore[call-overload]
        except (KeyError, IndexError, TypeError):
            return False

    def __iter__(self) -> Iterator[Parameter]:
        return iter(self.parameters)

    def __len__(self) -> int:
        return len(self.parameters)

    def __bool__(self) -> bool:
        return True  # also where nothing could be determined: ask for the verdict

    def _table(self) -> dict[str, list[Any]]:
        bounds = [p.interval or (None, None) for p in self.parameters]
        return {
            "name": self.keys(),
            "term": [p.term for p in self.parameters],
            "target": [p.target for p in self.parameters],
            "parameter": [p.name for p in self.parameters],
            "value": [p.value for p in self.parameters],
            "sd": [p.sd for p in self.parameters],
            "low": [low for low, _ in bounds],
            "high": [high for _, high in bounds],
            "unit": [p.unit for p in self.parameters],
        }

    def plot(self, kind: Kind | None = None, *, ax: Axes | None = None) -> Axes:
        """Draw the result; needs matplotlib (`pip install 'rsicalib[plot]'`).

        Parameters
        ----------
        kind : {"residuals", "effects", "parameters"}, optional
            Residuals of every pose in units of noise, before and after: the first choice where they
            are known, which a saved result's are not, else its parameters; what each effect that
            was found does to the platform, beside what could hide (outlined); or how well each
            parameter is known, as the share of its half width of 95 % in its value.
        ax : Axes, optional
            Where to; a new figure where not given.

        Returns
        -------
        Axes
            For titles and limits of your own.

        Raises
        ------
        ValueError
            There is no such kind, or the result does not have what it draws: residuals are not
            saved with a result.
        """
        if kind is None:
            kind = "parameters" if self.after_residuals is None else "residuals"
        if kind == "residuals":
            return self._plot_residuals(ax)
        if kind == "effects":
            return self._plot_effects(ax)
        if kind == "parameters":
            return self._plot_parameters(ax)
        near = meant(str(kind), ("residuals", "effects", "parameters"))
        raise ValueError(f"found {kind!r}{near}, expected 'residuals', 'effects' or 'parameters'")

    def _plot_residuals(self, ax: Axes | None) -> Axes:
        rows = {"before": self.before_residuals, "after": self.after_residuals}
        known = {name: r for name, r in rows.items() if r is not None and r.size}
        if not known:
            raise ValueError("a result that was loaded from a file has no residuals; fit again")
        ax = dots(on_axes(ax, figsize=(7, 3)), known, "pose, in the order of the readings")
        return ax

    def _plot_effects(self, ax: Axes | None) -> Axes:
        steps: Sequence[Step] = self.steps if isinstance(self, TraceShape) else ()
        hidden = self.could_hide[:HIDDEN] if isinstance(self, TraceShape) else ()
        known = [(name_of(s.term), s.target, s.platform_rms) for s in steps]
        known += [(name_of(h.term), h.target, h.platform_rms) for h in hidden]
        shown = [
            (f"{term} of {target}", rms.position, k >= len(steps))
            for k, (term, target, rms) in enumerate(known)
            if rms is not None and rms.position is not None
        ]
        if not shown:
            raise ValueError("no effect of which it is known what it does to a platform")
        names, sizes, hollow = zip(*shown, strict=True)
        ax = on_axes(ax, figsize=(7, 0.8 + 0.3 * len(shown)))
        words = f"rms error of the platform's position [{self.length_unit}]; outlined: could hide"
        return bars(ax, names, sizes, words, hollow=hollow)

    def _plot_parameters(self, ax: Axes | None) -> Axes:
        known = [(p.key, HALF_95 * p.sd / abs(p.value)) for p in self if p.sd and p.value]
        if not known:
            raise ValueError("no parameter has a standard deviation")
        names, shares = zip(*known, strict=True)
        ax = on_axes(ax, figsize=(7, 0.8 + 0.22 * len(known)))
        bars(ax, names, shares, "half width of 95 % / value")
        ax.set_xscale("log")
        return ax

    def _repr_html_(self) -> str:
        return result_html(self, self._table())
