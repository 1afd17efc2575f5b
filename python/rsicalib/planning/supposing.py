"""What an effect would do in given poses, and whether they would show it: the verb `suppose`."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import field, replace
from html import escape
from typing import TYPE_CHECKING

import numpy as np
import numpy.typing as npt

from rsicalib import options
from rsicalib.arrays import Alike, FloatArray
from rsicalib.errors import InputError
from rsicalib.facts.records import Record
from rsicalib.facts.shapes import Rms
from rsicalib.plots import dots as draw_dots
from rsicalib.plots import on_axes
from rsicalib.report.figure import Figure
from rsicalib.report.page import document
from rsicalib.report.residuals import MOST_DOTS, Dots, draw_residuals
from rsicalib.report.words import name_of
from rsicalib.tabular import Told
from rsicalib.units import with_unit
from rsicalib.work.arguments import CalibrationArg, MechanismArg, ReadingsArg, SessionsArg, names_in
from rsicalib.work.job import Work
from rsicalib.work.outcome import about

if TYPE_CHECKING:
    from matplotlib.axes import Axes


SEEN = 0.5
"""An effect that is found more often than not is called visible."""


class SupposedParameter(Record):
    """A parameter of an effect, with the value that it is supposed to have."""

    name: str
    """Name of the parameter."""
    value: float
    """The value."""
    unit: str
    """Unit of the value."""


class SupposedEffect(Record):
    """An effect with the sizes that it is supposed to have."""

    term: str
    """Id of the term."""
    target: str
    """What the term belongs to."""
    klass: str = field(metadata={"key": "class"})
    """Where its fault lies."""
    place: str | None
    """Where a searched term acts."""
    parameters: tuple[SupposedParameter, ...]
    """All parameters of the term."""

    @property
    def words(self) -> str:
        """The effect and its sizes."""
        sizes = [
            f"{p.name} = {with_unit(f'{p.value:.3g}', p.unit)}" for p in self.parameters if p.value
        ]
        return f"{name_of(self.term)} of {self.target}: {', '.join(sizes) or 'nothing'}"


class Supposition(Alike, Told, Record, eq=False, repr=False):
    """What an effect would do in given poses, to first order in its size."""

    mechanism: str
    """Name of the mechanism."""
    length_unit: str
    """Unit of every length."""
    effects: tuple[SupposedEffect, ...]
    """What is supposed."""
    noncentrality: float
    """By how much χ² would grow on average, after the other parameters have absorbed what they
    can."""
    seen: float
    """Probability that `trace` scores the effect above chance."""
    noticed: float
    """Probability that the residual as a whole is significant."""
    platform_rms: Rms | None
    """What the effect does to the platform while it is not in the model [length unit, rad]; None
    without a platform."""
    poses: tuple[int, ...]
    """Numbers of the poses."""
    residuals: FloatArray
    """Residual that the effect would leave, in units of noise."""

    def text(self) -> str:
        """What would happen, for people."""
        lines = [effect.words for effect in self.effects]
        lines.append(f"  noncentrality   {self.noncentrality:.3g}")
        lines.append(f"  found by trace  {_percent(self.seen)}")
        lines.append(f"  fit significant {_percent(self.noticed)}")
        if self.platform_rms is not None and self.platform_rms.position is not None:
            cost = f"{self.platform_rms.position:.2g} {self.length_unit}"
            turn = f"{1e3 * (self.platform_rms.orientation or 0.0):.2g} mrad"
            lines.append(f"  platform off by {cost} and {turn} rms while it is not in the model")
        if self.seen < SEEN:
            lines.append("  These poses would more likely than not miss it.")
        return "\n".join(lines) + "\n"

    def figure(self, order: npt.ArrayLike | None = None, words: str = "in order of time") -> Figure:
        """Draw the residual of every pose that the effect would leave.

        Parameters
        ----------
        order : array_like of int, shape (poses,), optional
            Another order of the poses, which is drawn below.
        words : str
            What that order is.

        Returns
        -------
        Figure
            One dot for each equation of each pose, in units of noise.
        """
        title = "; ".join(effect.words for effect in self.effects)
        equations = tuple(f"equation {e + 1}" for e in range(self.residuals.shape[1]))
        dots = Dots(-(-len(self.poses) // MOST_DOTS), (), equations, {})
        panels = [(title, dots.blocks(self.residuals))]
        if order is not None:
            panels.append((words, dots.blocks(self.residuals[np.asarray(order)])))
        dots = replace(dots, labels=tuple(str(k + 1) for k in range(len(panels[0][1]))))
        caption = (
            "Each dot is what the effect would leave of one closure in one pose, noise apart. "
            "Inside the band of ± 2 σ noise alone lies 95 times in 100."
        )
        return Figure("supposed", lambda width: draw_residuals(panels, dots, width), caption)

    def plot(self, *, ax: Axes | None = None) -> Axes:
        """Draw the residual of every pose that the effect would leave, in units of noise.

        Parameters
        ----------
        ax : Axes, optional
            Where to; a new figure where not given. Needs matplotlib (`rsicalib[plot]`).

        Returns
        -------
        Axes
            For titles and limits of your own.
        """
        ax = draw_dots(on_axes(ax, figsize=(7, 3)), {"": self.residuals}, "pose, in order of time")
        ax.set_title("; ".join(effect.words for effect in self.effects))
        return ax

    def __repr__(self) -> str:
        what = "; ".join(effect.words for effect in self.effects)
        return f"<Supposition: {what}; found by trace {_percent(self.seen)}>"

    def report(self) -> str:
        """The same as one HTML file that needs no network."""
        title = f"Suppose: {self.mechanism}"
        words = f"<pre>{escape(self.text())}</pre>\n{self.figure().html()}"
        return document(title, [f"<h1>{escape(title)}</h1>", words])


@options.checked
def suppose(
    readings: SessionsArg,
    terms: Sequence[str],
    mechanism: MechanismArg = "rsi",
    *,
    rest: ReadingsArg | None = None,
    model: Sequence[str] | None = None,
    closures: Sequence[str] | None = None,
    noise: float | Mapping[str, float] | None = None,
    calibration: CalibrationArg | None = None,
    skip_bad_rows: bool = False,
) -> Supposition:
    """Say what an effect would do in the poses of a session or of a plan.

    The readings say where the mechanism was, how often each pose was sampled, and the noise; a
    plan has one sample of each pose, so its noise must be given.

    Parameters
    ----------
    readings : path, Readings, or a sequence of them
        As in `calibrate`, or the CSV of a plan with a column for each channel.
    terms : sequence of str
        What is supposed: `curvature@a22.c2=0.02`; the name of the parameter may be left out where
        the term has one. Several are supposed together.
    mechanism : str, path or Mechanism
        What is read.
    rest, closures, noise, calibration, skip_bad_rows : optional
        As in `calibrate`.
    model : sequence of str, optional
        Terms that are fitted beside; `terms` of `calibrate`.

    Returns
    -------
    Supposition
        Residuals, noncentrality, probability to be seen, and the cost at the platform.

    Raises
    ------
    InputError
        There is no such term, target or parameter, the readings lack what the term needs, or
        nothing says what the noise is.

    Examples
    --------
    >>> from rsicalib import DEMO
    >>> suppose(DEMO / "readings.csv", ["curvature@a22.c2=0.06"]).seen > 0.99
    True
    """
    job = Work(mechanism, skip_bad_rows, calibration, about(None, None, None))
    job.take(readings, None, None, known_poses=True)
    options = {"closures": names_in("closures", closures, job.mechanism), "noise": job.noise(noise)}
    session = job.session(rest, job.terms(model), options)
    wanted = names_in("terms", terms, job.mechanism) or []
    if not wanted:
        raise InputError("found no term, expected one such as 'curvature@a22.c2=0.02'")
    own = {"mechanism": job.mechanism.name, "length_unit": job.mechanism.length_unit}
    return Supposition.from_dict({**own, **session.suppose(wanted)})


def _percent(share: float) -> str:
    """A probability in words that do not claim certainty."""
    if share > 0.999:
        return "> 99.9 %"
    return "< 0.1 %" if share < 0.001 else f"{100 * share:.1f} %"
