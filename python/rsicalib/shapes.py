"""The data of a result, in the shape of the JSON that the commands print.

Nothing here computes or writes: `rsicalib.results` adds what a result can do. Written by
`python -m scripts.make_shapes` from the types of the core; a test compares.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

from rsicalib.arrays import FloatArray
from rsicalib.estimates import Effect, Estimate
from rsicalib.labels import Labelled
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
    "Skipped",
    "Start",
    "Step",
    "StepParameter",
    "TraceShape",
    "Unexplained",
    "WithExcluded",
]


@dataclass(frozen=True)
class Skipped(Record):
    """A row that was dropped."""

    file: str
    """File."""
    line: int | None
    """Line of a CSV file, the header being line 1; row elsewhere."""
    column: str | None
    """Column."""
    reason: str
    """What was found and what was expected."""


@dataclass(frozen=True)
class Data(Record):
    """The readings that a result is about."""

    poses: int
    """Poses."""
    samples: int
    """Samples."""
    sha256: str
    """Digest of the readings as they were used."""
    files: tuple[str, ...] = field(default=(), metadata=OMIT)
    """Files, where there are several."""
    skipped: tuple[Skipped, ...] = field(default=(), metadata=OMIT)
    """Rows that were dropped because the caller asked for it."""


@dataclass(frozen=True)
class Noise(Record):
    """Noise of one sample, by channel, and where it is known from."""

    source: str
    """Where the noise is known from."""
    sigma: Mapping[str, float]
    """Standard deviation by channel, in each channel's unit, quantisation included."""
    dof: float | None
    """Degrees of freedom; null where the noise was declared."""
    correlation: float | None
    """Correlation of neighbouring samples."""


@dataclass(frozen=True)
class Excluded(Record):
    """A reading that was found to be bad; null: all of them."""

    pose: int | None
    """Label of the pose."""
    sample: int | None
    """Sample of the pose, counted from 1."""
    group: str | None
    """Values of the columns that tell its unknown points apart."""
    chain: str | None
    """The chain at fault."""
    channel: str | None
    """The channel at fault."""
    reason: str
    """Why."""
    samples: int | None = None
    """How many samples that are."""


@dataclass(frozen=True)
class HeldOut(Record):
    """Error on poses that were left out, the terms refitted without them."""

    chi2_per_dof: float
    """χ² of the poses left out, per equation."""
    rms_misclosure: float
    """Error of their closures, length units."""


@dataclass(frozen=True)
class Check(Record):
    """Error of the platform pose: root mean square over components, as in Table VI."""

    poses: int
    """Poses compared."""
    position_rms: float
    """Of the position, length units."""
    orientation_rms: float
    """Of roll, pitch and yaw, rad."""


@dataclass(frozen=True)
class FitQuality(Record):
    """How well a model fits."""

    chi2: float | None
    """χ² between poses."""
    dof: float | None
    """Its degrees of freedom."""
    p_value: float | None
    """Probability of a larger χ² by chance; null where lack of fit cannot be judged."""
    rms_misclosure: float | None
    """Error of the closures [length unit]."""
    held_out: HeldOut | None = None
    """Error on poses left out."""
    check: Check | None = field(default=None, metadata=IF_KNOWN)
    """Error on known poses."""
    aligned: Check | None = field(default=None, metadata=IF_KNOWN)
    """As `check`, after the best rigid motion of the instrument."""


@dataclass(frozen=True, repr=False)
class Parameter(Estimate, Record):
    """An estimate: `value` ± 1.96 `sd` covers the truth 95 times in 100."""

    term: str
    """Id of the term."""
    target: str
    """What the term belongs to."""
    name: str
    """Name of the parameter."""
    value: float | None
    """The estimate."""
    sd: float | None
    """Standard deviation; null where these poses cannot determine the parameter."""
    unit: str
    """Unit of both."""
    place: str | None = field(default=None, metadata=IF_KNOWN)
    """Where a searched term acts: a pose, or another channel."""
    note: str | None = field(default=None, metadata=IF_KNOWN)
    """What keeps the parameter from being what its term is called."""


@dataclass(frozen=True)
class WithExcluded(Record):
    """The calibration of all readings, where some were left out."""

    fit: FitQuality
    """How well the model fits."""
    parameters: tuple[Parameter, ...]
    """Estimates."""


@dataclass(frozen=True)
class Start(Record):
    """A start that was tried."""

    origin: str = field(metadata={"key": "from"})
    """Where the start began."""
    cost: float | None
    """`fᵀf` where the start ended."""
    collapsed: bool | None = None
    """True where a gain went to zero: the trivial solution."""


@dataclass(frozen=True)
class Reference(Record):
    """What the parameters of a result refer to, beside the mechanism.

    Offsets are told apart from gains about `centre`, a free curve runs over `span`, and
    temperatures count from `temperature`: all of the readings that the result was found with.
    """

    centre: tuple[float, ...]
    """Mean reading of each channel."""
    span: tuple[tuple[float, ...], ...]
    """Lowest and highest reading of each channel."""
    temperature: float | None
    """Mean temperature [°C], where it was measured."""


@dataclass(frozen=True)
class Moved(Record):
    """A parameter that is not what an earlier result says, beyond both uncertainties."""

    term: str
    """Id of the term."""
    target: str
    """What the term belongs to."""
    name: str
    """Name of the parameter."""
    before: float
    """The earlier estimate."""
    after: float
    """The estimate now."""
    sd: float
    """Standard deviation of the difference."""
    unit: str
    """Unit of all three."""


@dataclass(frozen=True)
class Groups(Record):
    """Mean distance of carried points from their own mean at what they touch, by placement.

    `docs/measured.md` says how the measure is formed. Null where there are no such groups.
    """

    fitted: float | None
    """Mean over the groups that were fitted [unit]."""
    others: float | None
    """Mean over the groups that the fit has not seen [unit]."""
    by_group: Mapping[str, float]
    """Group by group [unit]."""
    unit: str
    """Unit of all of them."""
    nominal_fitted: float | None = None
    """`fitted` with the mechanism as it is declared."""
    nominal_others: float | None = None
    """`others` with the mechanism as it is declared."""
    before_fitted: float | None = field(default=None, metadata=IF_KNOWN)
    """`fitted` before effects were traced."""
    before_others: float | None = field(default=None, metadata=IF_KNOWN)
    """`others` before effects were traced."""


@dataclass(frozen=True)
class StepParameter(Record):
    """A parameter of a term that was found missing."""

    name: str
    """Name of the parameter."""
    value: float | None
    """The estimate."""
    sd: float | None
    """Standard deviation."""
    unit: str
    """Unit of both."""
    note: str | None = field(default=None, metadata=IF_KNOWN)
    """As in `Parameter`."""


@dataclass(frozen=True)
class Name(Record):
    """A term at its target."""

    term: str
    """Id of the term."""
    klass: str = field(metadata={"key": "class"})
    """Where the fault lies."""
    target: str
    """What the term belongs to."""
    place: str | None = field(default=None, metadata=IF_KNOWN)
    """Where a searched term acts."""


@dataclass(frozen=True)
class Rms(Record):
    """What an effect does to the platform pose: root mean square over components."""

    position: float | None
    """Position, in units of length."""
    orientation: float | None
    """Orientation, in radians."""


@dataclass(frozen=True, repr=False)
class Step(Effect, Record):
    """A missing term that was found."""

    term: str
    """Id of the term."""
    klass: str = field(metadata={"key": "class"})
    """Where the fault lies."""
    target: str
    """What the term belongs to."""
    p_value: float | None
    """Probability by chance, corrected for the places looked at."""
    chi2_rise: float | None = field(default=None, metadata=IF_KNOWN)
    """By how much χ² would rise without the term."""
    parameters: tuple[StepParameter, ...] = ()
    """Estimates."""
    place: str | None = field(default=None, metadata=IF_KNOWN)
    """Where a searched term acts."""
    also_fits: tuple[Name, ...] = ()
    """Terms that these poses cannot tell from this one."""
    platform_rms: Rms | None = None
    """What the term did to the platform pose, the other parameters having absorbed what they
    can."""
    curve: tuple[tuple[float, ...], ...] = field(default=(), metadata=OMIT)
    """Rows of reading and correction (rad); see `curve_over`."""
    curve_sd: tuple[float, ...] = field(default=(), metadata=OMIT)
    """Standard deviation of each correction."""
    curve_over: str | None = field(default=None, metadata=IF_KNOWN)
    """`reading`, or `time`: rows are then time, 0 to 1 over the session, and correction (rad); for
    the converter's reference the correction is the fraction by which all readings change."""
    held_out: HeldOut | None = None
    """Error on poses left out, with this effect and those before."""


@dataclass(frozen=True)
class Unexplained(Record):
    """What is left when nothing scores any more."""

    p_value: float | None
    """Probability of the residual by chance."""
    target: str | None
    """Where the structure is."""
    text: str
    """What is left, in words."""


@dataclass(frozen=True)
class Hidden(Record):
    """How large an absent effect would have to be to be seen, and what it would do meanwhile."""

    term: str
    """Id of the term."""
    target: str
    """What the term belongs to."""
    detectable: float | None
    """Size that would have been seen in four sessions of five."""
    unit: str
    """Unit of the size."""
    platform_rms: Rms | None = None
    """What an effect of that size does to the platform."""


@dataclass(frozen=True, eq=False, repr=False, kw_only=True)
class ResultShape(Record):
    """What a calibration and a traced calibration have in common."""

    format: str
    """Kind of the document and version of its shape."""
    version: str
    """Version of the program."""
    mechanism: str
    """Name of the mechanism."""
    length_unit: str
    """Unit of every length."""
    device: str | None = None
    """The device that was calibrated, as the user calls it."""
    note: str | None = None
    """What the user noted of the session."""
    valid_from: str | None = None
    """Date, or date and time, from which the parameters hold: ISO 8601."""
    readings: Data
    """The readings that the result is about."""
    method: str = "implicit_loop"
    """How the parameters were found."""
    noise: Noise | None
    """Noise of one sample."""
    warnings: tuple[str, ...] = ()
    """Suspicious things."""
    excluded: tuple[Excluded, ...] = ()
    """Readings that were left out."""
    with_excluded: WithExcluded | None = field(default=None, metadata=IF_KNOWN)
    """The calibration with the readings in `excluded`."""
    verdict: str
    """The verdict."""
    implausible: tuple[str, ...] = field(default=(), metadata=OMIT)
    """What is absurd beside the size of the mechanism."""
    parameters: tuple[Parameter, ...]
    """Estimates."""
    covariance: Labelled
    """Covariance of the parameters, in their order and units; null where unknown."""
    unobservable: tuple[str, ...] = ()
    """Directions in the space of parameters that the data cannot tell."""
    weak: tuple[str, ...] = field(default=(), metadata=OMIT)
    """Directions that the data hardly tell."""
    condition: float | None = None
    """Condition number, offsets about the mean reading."""
    starts: tuple[Start, ...] = ()
    """Starts that were tried."""
    termination: str = ""
    """Why the solver stopped."""
    reference: Reference | None = field(default=None, metadata=IF_KNOWN)
    """The readings that the parameters refer to."""
    nominal: FitQuality | None = field(default=None, metadata=IF_KNOWN)
    """The check poses with the mechanism as it is declared."""
    moved: tuple[Moved, ...] | None = field(default=None, metadata=IF_KNOWN)
    """Parameters that differ from an earlier result, where one was given."""
    groups: Groups | None = field(default=None, metadata=IF_KNOWN)
    """How well points that are touched are repeated, where the mechanism has such."""
    before_residuals: FloatArray | None = field(default=None, metadata=NOT_WRITTEN)
    """Residuals in units of noise, shape (poses, equations), before; not in the JSON."""
    after_residuals: FloatArray | None = field(default=None, metadata=NOT_WRITTEN)
    """The same of the final model."""


@dataclass(frozen=True, eq=False, repr=False, kw_only=True)
class CalibrationShape(ResultShape):
    """A calibration: parameters from joint readings alone."""

    fit: FitQuality
    """How well the model fits."""


@dataclass(frozen=True, eq=False, repr=False, kw_only=True)
class TraceShape(ResultShape):
    """A calibration whose residual was traced."""

    before: FitQuality
    """How well the model fits that the search began with."""
    steps: tuple[Step, ...] = ()
    """Effects that were found, in their order."""
    after: FitQuality
    """How well the model fits with the terms of `steps`."""
    unexplained: Unexplained | None = None
    """What is left."""
    could_hide: tuple[Hidden, ...] = ()
    """Absent effects that would not have been seen."""
    not_candidates: Mapping[str, str] = field(default_factory=dict, metadata=OMIT)
    """Terms that could not be tried, and what the readings or the mechanism lack for them."""
