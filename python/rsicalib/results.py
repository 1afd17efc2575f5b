"""Results: values with names, in the shape of the JSON that the commands print."""

from __future__ import annotations

import json
import os
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from typing import Any, ClassVar, Self

import numpy as np
import numpy.typing as npt

from rsicalib.errors import InputError
from rsicalib.io.files import write_text
from rsicalib.records import IF_KNOWN, OMIT, Record, to_json

__all__ = [
    "ALPHA",
    "Calibration",
    "Check",
    "Data",
    "Excluded",
    "FitQuality",
    "Groups",
    "HeldOut",
    "Hidden",
    "Moved",
    "Name",
    "Noise",
    "Parameter",
    "Reference",
    "Rms",
    "Start",
    "Step",
    "Trace",
    "Unexplained",
    "WithExcluded",
    "load_calibration",
]

FloatArray = npt.NDArray[np.float64]

ALPHA = 0.01
"""A residual that chance would exceed less often than this is significant."""


@dataclass(frozen=True)
class Data(Record):
    """The readings that a result is about."""

    poses: int
    samples: int
    sha256: str
    files: tuple[str, ...] = field(default=(), metadata=OMIT)
    skipped: tuple[Mapping[str, Any], ...] = field(default=(), metadata=OMIT)
    """Rows that were dropped because the caller asked for it: line, column, reason."""


@dataclass(frozen=True)
class Noise(Record):
    """Noise of one sample, by channel, and where it is known from."""

    source: str
    sigma: Mapping[str, float]
    """In each channel's unit, quantisation included."""
    dof: float | None
    correlation: float | None
    """Between neighbouring samples."""


@dataclass(frozen=True)
class Check(Record):
    """Error on known poses: root mean square over components."""

    poses: int
    position_rms: float
    """[length unit]"""
    orientation_rms: float
    """[rad]"""


@dataclass(frozen=True)
class HeldOut(Record):
    """Error on poses that were left out, the terms refitted without them."""

    chi2_per_dof: float | None
    rms_misclosure: float | None = None
    """[length unit]"""


@dataclass(frozen=True)
class FitQuality(Record):
    """How well a model fits."""

    chi2: float | None
    dof: float | None
    p_value: float | None
    """None where lack of fit cannot be judged."""
    rms_misclosure: float | None
    """[length unit]"""
    held_out: HeldOut | None = None
    check: Check | None = field(default=None, metadata=OMIT)
    aligned: Check | None = field(default=None, metadata=OMIT)
    """As `check`, after the best rigid motion of the instrument."""


@dataclass(frozen=True)
class Parameter(Record):
    """An estimate: `value` ± 1.96 `sd` covers the truth 95 times in 100."""

    term: str
    target: str
    name: str
    value: float | None
    sd: float | None
    """None where these poses cannot determine it."""
    unit: str
    place: str | None = field(default=None, metadata=OMIT)
    """Where a searched term acts: a pose, or another channel."""
    note: str | None = field(default=None, metadata=OMIT)
    """What keeps it from being what its term is called."""

    @property
    def interval(self) -> tuple[float, float] | None:
        """Bounds of 95 %, in `unit`."""
        if self.value is None or self.sd is None:
            return None
        return self.value - 1.96 * self.sd, self.value + 1.96 * self.sd

    @property
    def spec(self) -> str:
        """The term at its place, as `terms=[…]` takes it: `curvature@a22`."""
        return f"{self.term}@{self.target}" + (f":{self.place}" if self.place else "")


@dataclass(frozen=True)
class Start(Record):
    """A start that was tried."""

    origin: str = field(metadata={"key": "from"})
    cost: float | None
    collapsed: bool | None = None
    """True where a gain went to zero: the trivial solution."""


@dataclass(frozen=True)
class Excluded(Record):
    """A reading that was found to be bad; None: all of them."""

    pose: int | None
    sample: int | None
    group: str | None
    chain: str | None
    channel: str | None
    reason: str
    samples: int | None = None
    """How many that are."""


@dataclass(frozen=True)
class WithExcluded(Record):
    """The calibration of all readings, where some were left out."""

    fit: FitQuality
    parameters: tuple[Parameter, ...]


@dataclass(frozen=True)
class Reference(Record):
    """What the parameters refer to: the readings that they were found with."""

    centre: tuple[float, ...]
    span: tuple[tuple[float, ...], ...]
    temperature: float | None = None


@dataclass(frozen=True)
class Moved(Record):
    """A parameter that is not what an earlier result says, beyond both uncertainties."""

    term: str
    target: str
    name: str
    before: float
    after: float
    sd: float
    """Of the difference."""
    unit: str


@dataclass(frozen=True)
class Groups(Record):
    """Mean distance of carried points from their own mean at what they touch, by placement.

    `docs/measured.md` says how it is formed. None where there are no such groups.
    """

    fitted: float | None
    """Mean over the groups that were fitted [unit]."""
    others: float | None
    """Mean over the groups that the fit has not seen [unit]."""
    by_group: Mapping[str, float]
    unit: str
    nominal_fitted: float | None = None
    """`fitted` with the mechanism as it is declared."""
    nominal_others: float | None = None
    before_fitted: float | None = field(default=None, metadata=OMIT)
    """`fitted` before effects were traced."""
    before_others: float | None = field(default=None, metadata=OMIT)


@dataclass(frozen=True)
class Name(Record):
    """A term at its target."""

    term: str
    klass: str = field(metadata={"key": "class"})
    target: str
    place: str | None = field(default=None, metadata=OMIT)


@dataclass(frozen=True)
class Rms(Record):
    """What an effect does to the platform pose: root mean square over components."""

    position: float | None
    """[length unit]"""
    orientation: float | None
    """[rad]"""


@dataclass(frozen=True)
class StepParameter(Record):
    """A parameter of a term that was found missing."""

    name: str
    value: float | None
    sd: float | None
    unit: str
    note: str | None = field(default=None, metadata=OMIT)
    """As in `Parameter`."""


@dataclass(frozen=True)
class Step(Record):
    """A missing term that was found."""

    term: str
    klass: str = field(metadata={"key": "class"})
    target: str
    p_value: float | None
    chi2_rise: float | None = field(default=None, metadata=OMIT)
    """By how much χ² would rise without it."""
    parameters: tuple[StepParameter, ...] = ()
    place: str | None = field(default=None, metadata=OMIT)
    also_fits: tuple[Name, ...] = ()
    """Terms that these poses cannot tell from this one."""
    platform_rms: Rms | None = None
    """What it did to the platform pose, the other parameters having absorbed what they can."""
    curve: tuple[tuple[float, ...], ...] = field(default=(), metadata=OMIT)
    """Rows of reading and correction [rad]; see `curve_over`."""
    curve_sd: tuple[float, ...] = field(default=(), metadata=OMIT)
    """Standard deviation of each correction."""
    curve_over: str | None = field(default=None, metadata=OMIT)
    """`reading`, or `time`: rows are then time, 0 to 1 over the session, and correction [rad], of
    the converter's reference the fraction by which all readings change."""
    held_out: HeldOut | None = None


@dataclass(frozen=True)
class Unexplained(Record):
    """What is left when nothing scores any more."""

    p_value: float | None
    target: str | None
    text: str


@dataclass(frozen=True)
class Hidden(Record):
    """How large an absent effect would have to be to be seen, and what it would do meanwhile."""

    term: str
    target: str
    detectable: float | None
    unit: str
    platform_rms: Rms | None = None


@dataclass(frozen=True, eq=False, kw_only=True)
class Result(Record):
    """What a calibration and a traced calibration have in common."""

    FORMAT: ClassVar[str]

    format: str
    version: str
    mechanism: str
    length_unit: str
    readings: Data
    method: str = field(default="implicit_loop")
    noise: Noise | None
    warnings: tuple[str, ...] = ()
    excluded: tuple[Excluded, ...] = ()
    with_excluded: WithExcluded | None = field(default=None, metadata=IF_KNOWN)
    """What the calibration would be with the readings in `excluded`."""
    verdict: str | None
    parameters: tuple[Parameter, ...]
    covariance: npt.NDArray[np.float64]
    """Of the parameters, in their order and units."""
    unobservable: tuple[str, ...] = ()
    weak: tuple[str, ...] = field(default=(), metadata=OMIT)
    condition: float | None = None
    starts: tuple[Start, ...] = ()
    termination: str = ""
    reference: Reference | None = field(default=None, metadata=OMIT)
    nominal: FitQuality | None = field(default=None, metadata=OMIT)
    """The check poses with the mechanism as it is declared."""
    moved: tuple[Moved, ...] | None = field(default=None, metadata=IF_KNOWN)
    """Against an earlier result, where one was given."""
    groups: Groups | None = field(default=None, metadata=IF_KNOWN)
    """How well points that are touched are repeated, where the mechanism has such."""
    before_residuals: npt.NDArray[np.float64] | None = field(default=None, repr=False)
    after_residuals: npt.NDArray[np.float64] | None = field(default=None, repr=False)
    """Residuals in units of noise, shape (poses, equations); not in the JSON."""

    def __getitem__(self, key: tuple[str, ...]) -> Parameter:
        """The parameter of a term at a target; its name as well where there are several."""
        found = [p for p in self.parameters if (p.term, p.target, p.name)[: len(key)] == key]
        if len(found) == 1:
            return found[0]
        if found:
            names = ", ".join(p.name for p in found)
            raise KeyError(f"{key}: the term has several parameters; add one of {names}")
        known = ", ".join(dict.fromkeys(p.spec for p in self.parameters))
        raise KeyError(f"{key}: not among the parameters; there are {known}")

    @property
    def values(self) -> FloatArray:
        """Estimates, in the order of `parameters`; NaN where unknown."""
        return np.array([p.value for p in self.parameters], dtype=np.float64)

    @property
    def quality(self) -> FitQuality:
        """How well the final model fits."""
        raise NotImplementedError

    @property
    def exit_code(self) -> int:
        """What the command returns: 0 usable, 3 undetermined, 4 residual left."""
        if self.verdict == "undetermined":
            return 3
        return 4 if self.verdict in ("unexplained", "partly_explained") else 0

    def to_dict(self) -> dict[str, Any]:
        """The JSON as a dictionary of plain values; what is not known is None."""
        out = super().to_dict()
        for name in ("before_residuals", "after_residuals"):
            del out[name]
        return out

    def to_json(self) -> str:
        """The result as JSON text, as `--json` prints it."""
        return to_json(self.to_dict())

    def save(self, path: str | os.PathLike[str]) -> None:
        """Write the JSON to a file, whole or not at all.

        Parameters
        ----------
        path : path
            Where to; `load_calibration` and `--calibration` read it.
        """
        write_text(path, self.to_json())

    def summary(self) -> str:
        """The terminal's 25 lines."""
        from rsicalib.report.terminal import summary

        return summary(self)

    def report(self) -> str:
        """The HTML report, one file that needs no network."""
        from rsicalib.report.terminal import html

        return html(self)

    def with_groups(self, groups: Groups) -> Self:
        """The same result with the measure of its groups."""
        return replace(self, groups=groups)

    def __repr__(self) -> str:
        fit = self.quality
        judged = "not judged" if fit.p_value is None else f"p={fit.p_value:.2g}"
        return (
            f"<{type(self).__name__} of {self.mechanism!r}: {self.verdict or 'not judged'}, "
            f"{len(self.parameters)} parameters from {self.readings.poses} poses, {judged}>"
        )

    @classmethod
    def from_dict(cls, data: Mapping[str, Any]) -> Self:
        """Read a result back from its dictionary."""
        return super().from_dict({**data, "format": data.get("format", cls.FORMAT)})


@dataclass(frozen=True, eq=False, repr=False, kw_only=True)
class Calibration(Result):
    """Parameters from joint readings alone: estimates, uncertainty, adequacy.

    Examples
    --------
    >>> import rsicalib
    >>> from rsicalib import DEMO
    >>> calibration = rsicalib.calibrate(DEMO / "readings.csv", rest=DEMO / "rest.csv")
    >>> calibration["gain", "a11"].unit
    'rad/count'
    """

    FORMAT: ClassVar[str] = "rsicalib.calibration/1"

    fit: FitQuality

    @property
    def quality(self) -> FitQuality:
        """How well the model fits."""
        return self.fit


@dataclass(frozen=True, eq=False, repr=False, kw_only=True)
class Trace(Result):
    """A calibration, what was missing from it, and the error before and after."""

    FORMAT: ClassVar[str] = "rsicalib.trace/1"

    before: FitQuality
    steps: tuple[Step, ...] = ()
    after: FitQuality
    unexplained: Unexplained | None = None
    could_hide: tuple[Hidden, ...] = ()
    not_candidates: Mapping[str, str] = field(default_factory=dict, metadata=OMIT)
    """Terms that could not be tried, and what the readings or the mechanism lack for them."""

    @property
    def quality(self) -> FitQuality:
        """How well the final model fits."""
        return self.after


def load_calibration(path: str | os.PathLike[str]) -> Calibration | Trace:
    """Read a result that `save` or `--json` wrote.

    Parameters
    ----------
    path : path
        A file of format `rsicalib.calibration/1` or `rsicalib.trace/1`.

    Returns
    -------
    Calibration or Trace
        Whichever it is.

    Raises
    ------
    InputError
        The file is not such a result.
    """
    name = os.fspath(path)

    def refuse(found: str, hint: str = "") -> InputError:
        expected = "a result of `rsicalib calibrate --json` or `rsicalib trace --json`"
        return InputError.at(name, found=found, expected=expected, hint=hint)

    try:
        with open(path, encoding="utf-8") as file:
            data = json.load(file)
    except OSError as error:
        raise refuse(error.strerror or str(error)) from None
    except ValueError as error:
        raise refuse(f"text that is not JSON ({error})") from None
    form = data.get("format") if isinstance(data, dict) else None
    for kind in (Calibration, Trace):
        if form == kind.FORMAT:
            try:
                return kind.from_dict(data)
            except (KeyError, TypeError, ValueError, AttributeError) as error:
                raise refuse(f"{form} that cannot be read ({error!r})") from None
    raise refuse(f"format {form!r}")
