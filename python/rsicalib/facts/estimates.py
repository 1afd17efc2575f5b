"""What follows from the estimate of one parameter, and from one effect that was found."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import TYPE_CHECKING, Protocol

from rsicalib import _core
from rsicalib.plain_text import p_equals
from rsicalib.plots import curve as draw_curve
from rsicalib.plots import on_axes
from rsicalib.units import HALF_95, axis_words, in_thousandths, with_unit

if TYPE_CHECKING:
    from matplotlib.axes import Axes


def estimate_words(value: float | None, sd: float | None, unit: str) -> str:
    """`0.0529 ± 0.011 rad`, with the half width of 95 %; a dash where it is not known."""
    known = "–" if value is None else f"{value:.6g}"
    half = "" if sd is None else f" ± {HALF_95 * sd:.2g}"
    return with_unit(f"{known}{half}", unit)


def parameter_key(spec: str, term: str, name: str) -> str:
    """A parameter's own name in a result: `gain@a11`, `curvature@a22.c2`."""
    return spec if name == term else f"{spec}.{name}"


class Earlier(Protocol):
    """What an earlier result says."""

    @property
    def value(self) -> float:
        """The earlier estimate."""

    @property
    def sd(self) -> float:
        """Standard deviation of the difference."""


class Estimate:
    """Interval and full name of a parameter that has the fields of `shapes.Parameter`."""

    term: str
    target: str
    name: str
    value: float | None
    sd: float | None
    unit: str
    place: str | None
    profile: tuple[float | None, ...] | None
    earlier: Earlier | None

    @property
    def change(self) -> float | None:
        """Difference from an earlier result, in standard deviations of both; None without one."""
        if self.earlier is None or self.value is None or self.earlier.sd <= 0.0:
            return None
        return (self.value - self.earlier.value) / self.earlier.sd

    @property
    def interval(self) -> tuple[float, float] | None:
        """Bounds of 95 %, in `unit`; infinite where the readings set none."""
        if self.value is None or self.sd is None:
            return None
        if self.profile is not None:
            low, high = self.profile
            return (-math.inf if low is None else low), (math.inf if high is None else high)
        return self.value - HALF_95 * self.sd, self.value + HALF_95 * self.sd

    @property
    def at(self) -> tuple[str, str, str | None]:
        """The term, its target and its place, as the core takes them."""
        return self.term, self.target, self.place

    @property
    def spec(self) -> str:
        """The term at its place, as `terms=[…]` takes it: `curvature@a22`."""
        return _core.spec(*self.at)

    @property
    def key(self) -> str:
        """The parameter's own name in a result: `gain@a11`, `curvature@a22.c2`."""
        return parameter_key(self.spec, self.term, self.name)

    def __repr__(self) -> str:
        words = estimate_words(self.value, self.sd, self.unit)
        if self.profile is not None and self.interval is not None:
            words += " (" + " to ".join(f"{end:.4g}" for end in self.interval) + ")"
        return f"<{self.key} = {words}>"


class Size(Protocol):
    """A parameter of an effect."""

    @property
    def name(self) -> str:
        """Its name."""

    @property
    def value(self) -> float | None:
        """The estimate."""

    @property
    def sd(self) -> float | None:
        """Its standard deviation."""

    @property
    def unit(self) -> str:
        """Unit of both."""


class Effect:
    """Name and drawing of an effect that has the fields of `shapes.Step`."""

    term: str
    klass: str
    target: str
    place: str | None
    p_value: float | None
    curve: tuple[tuple[float, ...], ...]
    curve_sd: tuple[float, ...]
    curve_over: str | None
    curve_unit: str | None
    parameters: Sequence[Size]

    @property
    def spec(self) -> str:
        """The term at its place, as `terms=[…]` takes it: `curvature@a22`."""
        return _core.spec(self.term, self.target, self.place)

    def plot(self, *, ax: Axes | None = None) -> Axes:
        """Draw the correction over the reading, or over time, with its 95 % band.

        Parameters
        ----------
        ax : Axes, optional
            Where to; a new figure where not given. Needs matplotlib (`rsicalib[plot]`).

        Returns
        -------
        Axes
            Corrections in mrad, or in the unit of length of a joint that slides; of a converter's
            reference in thousandths of the reading.

        Raises
        ------
        ValueError
            The effect is no curve.
        """
        if not self.curve:
            raise ValueError(f"{self.spec} is no curve; its parameters are {self.parameters}")
        over = "time, 0 to 1 over the session"
        times, unit = in_thousandths(self.curve_unit)
        return draw_curve(
            on_axes(ax),
            self.curve,
            self.curve_sd,
            scale=times,
            name=self.spec,
            x_words=over if self.curve_over == "time" else f"reading of {self.target}",
            y_words=axis_words("correction", unit),
        )

    def __repr__(self) -> str:
        chance = "" if self.p_value is None else f", {p_equals(self.p_value)}"
        sizes = [f"{p.name} = {estimate_words(p.value, p.sd, p.unit)}" for p in self.parameters]
        shown = ", ".join(sizes[:3]) + (f" and {len(sizes) - 3} more" if len(sizes) > 3 else "")
        return f"<{self.spec}: {shown}{chance}>"


class Absent:
    """`repr` of an effect that could hide, with the fields of `shapes.Hidden`."""

    term: str
    target: str
    detectable: float | None
    unit: str

    def __repr__(self) -> str:
        from_size = self.detectable
        size = "never" if from_size is None else f"from {with_unit(f'{from_size:.2g}', self.unit)}"
        return f"<{self.term}@{self.target}: seen {size}>"


class Named(Protocol):
    """A term at its target."""

    @property
    def term(self) -> str:
        """Its id."""

    @property
    def target(self) -> str:
        """What it belongs to."""


class Together:
    """`repr` of effects that explain a session together, with the fields of `shapes.Rival`."""

    probability: float
    terms: Sequence[Named]

    def __repr__(self) -> str:
        names = " + ".join(f"{one.term}@{one.target}" for one in self.terms) or "nothing"
        return f"<{names}: probability {self.probability:.2g}>"


class Fitness:
    """`repr` of how well a model fits, with the fields of `shapes.FitQuality`."""

    chi2: float | None
    dof: float | None
    p_value: float | None
    rms_misclosure: float | None

    def __repr__(self) -> str:
        known = {"χ²": self.chi2, "dof": self.dof, "p": self.p_value, "rms": self.rms_misclosure}
        return f"<Fit: {', '.join(f'{k} = {v:.3g}' for k, v in known.items() if v is not None)}>"
