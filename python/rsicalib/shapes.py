"""The data of a result, in the shape of the JSON that the commands print.

Nothing here computes or writes: `rsicalib.results` adds what a result can do.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

from rsicalib.arrays import FloatArray
from rsicalib.estimates import Estimate
from rsicalib.records import IF_KNOWN, NOT_WRITTEN, OMIT, Record

__all__ = [
    "CalibrationShape",
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
    "ResultShape",
    "Rms",
    "Start",
    "Step",
    "StepParameter",
    "TraceShape",
    "Unexplained",
    "WithExcluded",
]


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
class Parameter(Estimate, Record):
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
    """Standard deviation of the difference."""
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


@dataclass(frozen=True, eq=False, repr=False, kw_only=True)
class ResultShape(Record):
    """What a calibration and a traced calibration have in common."""

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
    verdict: str
    implausible: tuple[str, ...] = field(default=(), metadata=OMIT)
    """What is absurd beside the size of the mechanism."""
    parameters: tuple[Parameter, ...]
    covariance: FloatArray
    """Covariance of the parameters, in their order and units."""
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
    before_residuals: FloatArray | None = field(default=None, metadata=NOT_WRITTEN)
    after_residuals: FloatArray | None = field(default=None, metadata=NOT_WRITTEN)
    """Residuals in units of noise, shape (poses, equations); not in the JSON."""


@dataclass(frozen=True, eq=False, repr=False, kw_only=True)
class CalibrationShape(ResultShape):
    """The data of a calibration."""

    fit: FitQuality
    """How well the model fits."""


@dataclass(frozen=True, eq=False, repr=False, kw_only=True)
class TraceShape(ResultShape):
    """The data of a calibration whose residual was traced."""

    before: FitQuality
    """How well the model fits that the search began with."""
    steps: tuple[Step, ...] = ()
    after: FitQuality
    """How well the model fits with the terms of `steps`."""
    unexplained: Unexplained | None = None
    could_hide: tuple[Hidden, ...] = ()
    not_candidates: Mapping[str, str] = field(default_factory=dict, metadata=OMIT)
    """Terms that could not be tried, and what the readings or the mechanism lack for them."""
