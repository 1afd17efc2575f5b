"""The data of a result, in the shape of the JSON that the commands print.

Nothing here computes or writes: `rsicalib.results` adds what a result can do. Written by
`python -m scripts.make_shapes` from the types of the core; a test compares.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import field

from rsicalib._core import EvidenceSource
from rsicalib.arrays import FloatArray
from rsicalib.facts.estimates import Absent, Effect, Estimate, Fitness, Together
from rsicalib.facts.records import IF_KNOWN, NOT_WRITTEN, OMIT, Record
from rsicalib.facts.warned import Warned
from rsicalib.labels import Labelled


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


class Data(Record):
    """The readings that a result is about."""

    poses: int
    """Poses."""
    samples: int
    """Samples."""
    sha256: str
    """Digest of the readings as they were used."""
    files: tuple[str, ...] = field(default=(), metadata=OMIT)
    """Files that the readings are from, as they were given."""
    skipped: tuple[Skipped, ...] = field(default=(), metadata=OMIT)
    """Rows that were dropped because the caller asked for it."""


class Noise(Record):
    """Noise of one sample, by channel, and where it is known from."""

    source: str
    """Where the noise is known from, in words."""
    sigma: Mapping[str, float]
    """Standard deviation by channel, in each channel's unit, quantisation included."""
    dof: float | None
    """Degrees of freedom; null where the noise was declared."""
    correlation: float | None
    """Correlation of neighbouring samples."""
    unit: Mapping[str, str] = field(default_factory=dict)
    """Unit of the readings, by channel."""
    kind: str | None = None
    """Where the noise is known from; null in results of earlier versions."""
    seating: float | None = field(default=None, metadata=IF_KNOWN)
    """How well what is touched holds its place, where only the fit tells it, in `length_unit`."""
    closures: Mapping[str, float] = field(default_factory=dict, metadata=OMIT)
    """How well each closure holds, one draw for each seating: the standard deviation as it is
    declared, or as only the fit tells it, in `length_unit` or as equal coordinates count. Closures
    that hold exactly are not listed."""


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
    kind: str = "other"
    """Why, for programs."""
    session: int | None = field(default=None, metadata=IF_KNOWN)
    """Session of the pose, counted from 1, where there are several."""
    touches: str | None = field(default=None, metadata=IF_KNOWN)
    """What a sample touches, by the values of its columns, where that is by far not what its row
    names."""


class HeldOut(Record):
    """Error on poses that were left out, the terms refitted without them."""

    chi2_per_dof: float
    """χ² of the poses left out, per equation."""
    rms_misclosure: float
    """Error of their closures, in `misclosure_unit`. Of a held pose it is that of the mean of its
    samples, while `rms_misclosure` of the fit is of single samples."""
    p_value: float | None = field(default=None, metadata=IF_KNOWN)
    """Probability by chance of poses that fit so badly to the others."""


class Largest(Record):
    """The largest errors of the platform pose, and what noise does to each."""

    position: float
    """Length of the error of the position, length units."""
    orientation: float | None
    """Length of the errors of roll, pitch and yaw together, rad; null where places alone are
    known."""
    position_noise: float | None = None
    """Standard deviation of a coordinate of the position by the noise of the readings and of the
    known pose alone."""
    orientation_noise: float | None = None
    """The same of roll, pitch and yaw, rad."""


class Worst(Record):
    """The least probable of known poses, judged by itself."""

    position_rms: float
    """Error of a coordinate of its position, root mean square [length unit]."""
    position_sd: float
    """Predicted standard deviation of that [length unit]."""
    p_value: float
    """Probability that one of so many poses is as improbable by chance."""
    orientation_rms: float | None = None
    """Error of its orientation, root mean square of the three angles (rad)."""
    orientation_sd: float | None = None
    """Predicted standard deviation of that (rad)."""
    pose: int | None = field(default=None, metadata=IF_KNOWN)
    """Its label; null in a result of an earlier version."""
    others_p_value: float | None = field(default=None, metadata=IF_KNOWN)
    """Probability of the errors of all others together; null where there are none, or this one is
    not off."""


class Expected(Record):
    """An error of known poses against what is predicted of it."""

    position_sd: float
    """Predicted standard deviation of a coordinate of the position, the noise of its readings and
    of the known pose counted in [length unit]."""
    orientation_sd: float | None
    """The same of roll, pitch and yaw (rad)."""
    chi2: float
    """χ² of the errors by their predicted covariance."""
    dof: float
    """Its degrees of freedom: all poses share the errors of the parameters."""
    p_value: float
    """Probability of a larger one by chance."""
    worst: Worst | None = field(default=None, metadata=IF_KNOWN)
    """The least probable of the poses by itself."""


class Check(Record):
    """Error of the platform pose: root mean square over components, as in Table VI."""

    poses: int
    """Poses compared."""
    position_rms: float
    """Of the position, length units."""
    orientation_rms: float | None
    """Of roll, pitch and yaw, rad; null where places alone are known."""
    largest: Largest | None = field(default=None, metadata=IF_KNOWN)
    """Where it is largest."""
    predicted: Expected | None = field(default=None, metadata=IF_KNOWN)
    """The same as a calibration predicts it; none of what has no covariance."""


class FitQuality(Fitness, Record, repr=False):
    """How well a model fits."""

    chi2: float | None
    """χ² between poses."""
    dof: float | None
    """Its degrees of freedom."""
    p_value: float | None
    """Probability of a larger χ² by chance; null where lack of fit cannot be judged."""
    rms_misclosure: float | None
    """Error of the closures of single samples, in `misclosure_unit`; that of `held_out` is of the
    means of held poses."""
    misclosure_unit: str | None = field(default=None, metadata=IF_KNOWN)
    """Unit of `rms_misclosure`: of length, or of the coordinates that closures make equal."""
    held_out: HeldOut | None = None
    """Error on poses left out."""
    check: Check | None = field(default=None, metadata=IF_KNOWN)
    """Error on known poses."""
    aligned: Check | None = field(default=None, metadata=IF_KNOWN)
    """As `check`, after the best rigid motion of the instrument."""


class Before(Record):
    """What an earlier result says of a parameter: the value that it left behind, slips included."""

    value: float
    """The earlier estimate."""
    sd: float
    """Standard deviation of the difference, by both uncertainties."""


class Parameter(Estimate, Record, repr=False):
    """An estimate: `interval`, or `value` ± 1.96 `sd` where there is none, covers the truth 95
    times in 100.
    """

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
    profile: tuple[float | None, ...] | None = field(
        default=None, metadata={"key": "interval", **IF_KNOWN}
    )
    """Bounds of 95 % where `value` ± 1.96 `sd` are not: few degrees of freedom of the noise, or
    readings that bend within it, by profile likelihood. A bound is null where the readings set
    none."""
    sd_between: float | None = field(default=None, metadata=IF_KNOWN)
    """Standard deviation of the mean over groups, as of `between.covariance`; null where there are
    none."""
    place: str | None = field(default=None, metadata=IF_KNOWN)
    """Where a searched term acts: a pose, or another channel; `2/1` is pose 1 of session 2, where
    several sessions have that number."""
    place_interval: tuple[str, ...] | None = field(default=None, metadata=IF_KNOWN)
    """First and last pose at which something may have happened that has acted ever since, 95 %."""
    note: str | None = field(default=None, metadata=IF_KNOWN)
    """What keeps the parameter from being what its term is called."""
    earlier: Before | None = field(default=None, metadata=IF_KNOWN)
    """What an earlier result says of it, where one was given and knows it."""


class WithExcluded(Record):
    """The calibration of all readings, where some were left out."""

    fit: FitQuality
    """How well the model fits."""
    parameters: tuple[Parameter, ...]
    """Estimates."""


class Reason(Record):
    """A reason of a verdict, with its numbers."""

    kind: str
    """What it is."""
    found: float | None = None
    """What was found: an error, or χ² per degree of freedom."""
    expected: float | None = None
    """What was expected in its place."""
    p_value: float | None = None
    """Probability of more by chance."""
    pose: int | None = field(default=None, metadata=IF_KNOWN)
    """Label of the known pose that is off alone."""


class Changing(Record):
    """A parameter that may change from group to group."""

    term: str
    """Id of the term."""
    target: str
    """What the term belongs to."""
    name: str
    """Name of the parameter."""
    sd: float
    """Standard deviation from group to group that is counted with: more than the most likely one
    where few groups tell of it."""
    unit: str
    """Its unit."""


class Halves(Record):
    """Estimates of every other group against those of the rest: what cross-validation says."""

    groups: tuple[tuple[str, ...], ...]
    """Names of the groups of each half."""
    difference: float
    """Root mean square difference of a coordinate of predicted positions, in `length_unit`."""
    within: float
    """The same as the intervals within groups predict it."""
    between: float
    """The same with what changes from group to group."""
    chi2_within: float
    """χ² of the difference of the parameters per parameter, by what is within groups."""
    chi2_between: float
    """The same with what changes from group to group."""
    own: bool
    """True where each half has told on its own how much changes; else all groups have, the
    difference among them."""


class Between(Record):
    """What changes from group to group: placements, or sessions.

    `covariance` holds within the groups of the session. Parameters as means over groups, as another
    session has them, have the covariance of this table; in one other group each of `parameters`
    differs from that mean by its `sd` beside.
    """

    kind: str
    """What tells groups apart."""
    groups: tuple[str, ...]
    """Names of the groups."""
    sd: float
    """Most likely standard deviation of the changes, in typical sizes of their parameters."""
    interval: tuple[float, ...]
    """Standard deviations between which it lies with 95 % probability."""
    p_value: float
    """Probability by chance of groups that differ so much, were nothing to change."""
    parameters: tuple[Changing, ...]
    """Parameters that may change, and by how much they are expected to."""
    covariance: Labelled
    """Covariance of the parameters between groups, in their order and units; null where unknown."""
    halves: Halves | None = field(default=None, metadata=IF_KNOWN)
    """One half of the groups against the other."""


class Predicted(Record):
    """Predicted error, root mean square over components."""

    poses: int
    """Poses for which the error is predicted."""
    position_sd: float
    """Standard deviation of a coordinate of the platform's position, or of carried points, by the
    errors of the parameters [length unit]."""
    orientation_sd: float | None
    """Standard deviation of roll, pitch and yaw (rad); null without a platform."""


class Start(Record):
    """A start that was tried."""

    origin: str = field(metadata={"key": "from"})
    """Where the start began."""
    cost: float | None
    """`fᵀf` where the start ended."""
    chi2: float | None = field(default=None, metadata=IF_KNOWN)
    """χ² where it ended, by the noise that is assumed, of the samples that the search of starts
    uses; null where a gain went to zero."""
    collapsed: bool | None = None
    """True where a gain went to zero: the trivial solution."""
    anchor: str | None = field(default=None, metadata=IF_KNOWN)
    """The reading of each channel whose coordinate is known or presumed; null in results of earlier
    versions, as `gains`."""
    gains: str | None = field(default=None, metadata=IF_KNOWN)
    """Gains from which it began."""


class Reference(Record):
    """What the parameters of a result refer to, beside the mechanism.

    Offsets are told apart from gains about `centre`, a free curve runs over `span`, and
    temperatures count from `temperature`: all of the readings that the result was found with. A
    gain turns about reading zero where no offset was fitted.
    """

    centre: tuple[float, ...]
    """Mean reading of each channel, zero where its offset is as it was drawn."""
    span: tuple[tuple[float, ...], ...]
    """Lowest and highest reading of each channel."""
    temperature: float | None
    """Mean temperature [°C], where it was measured."""


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


class Misclosure(Record):
    """Reference statistics of the misclosure: how the loops close under a result."""

    rms: Mapping[str, float]
    """Root mean square by closure, in units of length."""
    dof: float | None
    """Degrees of freedom of the noise; null where it was declared."""
    correlation: float
    """Correlation of neighbouring samples."""
    interval_s: float | None
    """Usual time between neighbouring samples, in seconds; null without times."""


class Rms(Record):
    """What an effect does to the platform pose, or, without a platform, to the points that chains
    carry, after the best rigid motion: root mean square over components.
    """

    position: float | None
    """Position, in units of length."""
    orientation: float | None
    """Orientation, in radians; null of points."""


class Changed(Record):
    """A change between two sessions of a device."""

    term: str
    """Id of the term."""
    target: str
    """Where: a channel, a closure, a chain or a link of it."""
    size: float
    """How large: the value of a single parameter, or the length of a displacement."""
    sd: float
    """Standard deviation of the size."""
    unit: str
    """Unit of both."""
    p_value: float
    """Probability of such a change by chance, for any of the candidates."""
    platform_rms: Rms | None
    """What it does to the platform."""
    also_fits: tuple[str, ...] = ()
    """Changes that these readings cannot tell from it, as `offset@a22`."""


class Update(Record):
    """A later session against an earlier result."""

    worth: bool
    """True where something has changed for sure, and this result has the smaller held-out error."""
    text: str
    """The same as a sentence."""
    chi2_per_dof: float
    """χ² of the readings under the earlier result, its uncertainty counted in, per degree of
    freedom; of the parameters that both results have where other loops close in each session."""
    p_value: float
    """Probability of more by chance."""
    rms_before: float
    """Misclosure of the poses under the earlier result, root mean square in units of length."""
    rms_after: float | None
    """The same under this result, poses left out in turn; null where that was not computed."""
    changes: tuple[Changed, ...]
    """What has changed, the most certain first."""
    session_only: tuple[str, ...]
    """Effects of the earlier result that belong to its session, and are not compared."""
    unclear: bool = False
    """True where something is not as it was, and no change from one session to the other explains
    it, or where that is not told: there are no `changes` then."""


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


class OwnTerm(Record):
    """A term that is written as a formula.

    `correction` is added to joint coordinates (rad, or length units for a prismatic joint), or to
    the value of a distance (length units). A law of geometry has `moves` and `amount` in its place
    (length units or rad): the frame after the joint of the row moves, or that of the chain's first
    joint. Formulas are of the parameters and of variables (`docs/laws.md`).
    """

    id: str
    """Name of the term, for scripts."""
    klass: str = field(metadata={"key": "class"})
    """Kind of the fault."""
    per: str
    """Kind of target: `channel`, `row`, `chain`, `closure` or `all`."""
    parameters: Mapping[str, float]
    """Names of the parameters, and a size of each that occurs in practice. All are zero where the
    effect is absent."""
    correction: str | None = field(default=None, metadata=IF_KNOWN)
    """Correction of a joint coordinate or of a distance."""
    moves: str | None = field(default=None, metadata=IF_KNOWN)
    """Axis that moves, of a law of geometry."""
    amount: str | None = field(default=None, metadata=IF_KNOWN)
    """By how much it moves."""
    doc: str = ""
    """Description of the effect."""


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


class Name(Record):
    """A term at its target."""

    term: str
    """Id of the term."""
    klass: str = field(metadata={"key": "class"})
    """Where the fault lies."""
    target: str
    """What the term belongs to."""
    place: str | None = field(default=None, metadata=IF_KNOWN)
    """Where a searched term acts; `2/1` is pose 1 of session 2, where several sessions have that
    number."""
    label: str | None = field(default=None, metadata=IF_KNOWN)
    """What people call the target."""


class LawParameter(Record):
    """A number of a closed form."""

    name: str
    """Its name."""
    value: float
    """Its value."""
    interval: tuple[float, ...]
    """Values between which it lies with 95 % probability."""
    unit: str
    """Unit of all three."""


class CurveLaw(Record):
    """The closed form behind a free curve."""

    form: str | None
    """Name of the form; null where no form that is known is the law."""
    text: str
    """What the curve does, in words."""
    parameters: tuple[LawParameter, ...] = ()
    """What was searched for, then the amplitudes."""
    also_fits: tuple[str, ...] = ()
    """Other forms that fit as well."""


class Step(Effect, Record, repr=False):
    """A missing term that was found."""

    term: str
    """Id of the term."""
    klass: str = field(metadata={"key": "class"})
    """Where the fault lies."""
    target: str
    """What the term belongs to."""
    p_value: float | None
    """Probability by chance of a χ² that rises so much without it, corrected for the places looked
    at."""
    applied: bool = True
    """False where the effect is named, and no part of `parameters`."""
    not_applied: str | None = field(default=None, metadata=IF_KNOWN)
    """Why it is not applied."""
    probability: float | None = field(default=None, metadata=IF_KNOWN)
    """Probability of the explanations with this effect among `rivals`; null where there are
    none."""
    chi2_rise: float | None = field(default=None, metadata=IF_KNOWN)
    """By how much χ² would rise without the term."""
    parameters: tuple[StepParameter, ...] = ()
    """Estimates."""
    place: str | None = field(default=None, metadata=IF_KNOWN)
    """Where a searched term acts; `2/1` is pose 1 of session 2, where several sessions have that
    number."""
    label: str | None = field(default=None, metadata=IF_KNOWN)
    """What people call the target."""
    wavelength: float | None = field(default=None, metadata=IF_KNOWN)
    """How long a wave is of an error that repeats along what has no turn, in the unit of that
    coordinate."""
    also_fits: tuple[Name, ...] = ()
    """Terms that these poses cannot tell from this one."""
    needs_length: bool = False
    """True where this term changes the size of the whole, or one of these differs from it by that:
    a length that is known would tell, no pose does."""
    needs_repeats: bool = False
    """True where this term or one of these is of when readings were taken: the first poses once
    more at the end would tell them apart."""
    platform_rms: Rms | None = None
    """What the term did to the platform pose, the other parameters having absorbed what they
    can."""
    curve: tuple[tuple[float, ...], ...] = field(default=(), metadata=OMIT)
    """Rows of reading and correction, in `curve_unit`; see `curve_over`."""
    curve_sd: tuple[float, ...] = field(default=(), metadata=OMIT)
    """Standard deviation of each correction."""
    curve_over: str | None = field(default=None, metadata=IF_KNOWN)
    """`reading`, or `time`: rows are then time, 0 to 1 over the session, and correction."""
    curve_unit: str | None = field(default=None, metadata=IF_KNOWN)
    """Unit of the corrections: `rad`, the unit of length for a joint that slides, or `1` for a
    fraction of all readings."""
    curve_law: CurveLaw | None = field(default=None, metadata=IF_KNOWN)
    """The closed form behind a free curve, for the readings or times that occur."""
    held_out: HeldOut | None = None
    """Error on poses left out, with this effect and those before."""


class Elsewhere(Record):
    """Errors of closures on blocks that were left out in turn, root mean square in `unit`.

    Blocks are placements or sessions, or, of a single one, parts of the workspace.
    """

    kind: str
    """What was left out."""
    blocks: int
    """How many blocks."""
    without: float
    """Without any of the effects that are judged."""
    again: float | None
    """With what a search finds again without the block; null for parts of the workspace."""
    applied: float
    """With the effects that are applied."""
    without_each: tuple[float, ...]
    """Without each of `steps`, the others refitted."""
    unit: str
    """Unit of all of them."""
    found: float | None = field(default=None, metadata=IF_KNOWN)
    """With all effects that were found; null in a result of an earlier version."""


class Rival(Together, Record, repr=False):
    """Effects that explain a session together, nearly as well as the best do."""

    terms: tuple[Name, ...]
    """The effects: `unknown_law` is a law that no term has, `unknown_noise` errors that follow
    none."""
    chi2_penalised: float
    """Price of the explanation: χ² by the noise that may be, with what its effects, their places
    and wrong readings cost."""
    probability: float
    """Probability among the explanations that are listed."""


class DependsOn(Record):
    """A variable on which errors depend."""

    variable: str
    """The variable: `theta[q1]`, `direction[q1]`, `travelled[q1]`, `torque[q1]`, `time`, …."""
    share: float
    """Share of what the law explains that is lost without the variable, of all of its variables."""
    also: tuple[str, ...] = field(default=(), metadata=OMIT)
    """Variables that these data cannot tell from it."""


class FormulaParameter(Record):
    """A parameter of a formula."""

    name: str
    """Its name in the formula."""
    value: float
    """The estimate, to first order."""
    sd: float
    """Standard deviation."""


class FoundLaw(Record):
    """A formula for the errors of a channel, a link or a closure, which no term has."""

    target: str
    """The channel, the row of a chain or the closure."""
    formula: str
    """The correction of its coordinate or value, or by how much its frame moves, as a mechanism
    file writes it."""
    parameters: tuple[FormulaParameter, ...]
    """Its parameters."""
    probability: float
    """Its probability among all formulas that were weighed and the smooth function."""
    term: str
    """Lines for the mechanism file that make it a term."""


class Unexplained(Record):
    """What is left when nothing scores any more."""

    p_value: float | None
    """Probability of the residual by chance."""
    target: str | None
    """Where the structure is."""
    text: str
    """What is left, in words."""
    kind: str | None = None
    """What it is; null in results of earlier versions."""
    depends_on: tuple[DependsOn, ...] = field(default=(), metadata=OMIT)
    """What the likeliest law that no term has depends on, where it ties with what was found, or
    something is left."""
    also_of: tuple[str, ...] = field(default=(), metadata=OMIT)
    """Other targets of which such a law fits as well, the likeliest first."""
    law: FoundLaw | None = field(default=None, metadata=IF_KNOWN)
    """A formula that fits as well as that law, within 6 in price."""


class Unseen(Record):
    """What a session leaves open of an effect that it was not found to have.

    With an effect of `d` parameters `h`, typical sizes `D`, and the projected normal equations `M`,
    `u` of (71),

    ```text V = (D⁻² + M)⁻¹, m = V u, ln B = ½ uᵀ V u - ½ ln det(1 + D M D) (141) ```

    `h` is normal with mean `m` and covariance `V` if it is there, and `B` is how much more likely
    the readings are with it than without.
    """

    probability: float
    """Probability that it is this one, if there is one that nobody named."""
    mean: tuple[float, ...]
    """Mean of each of its parameters."""
    covariance: Labelled
    """Their covariance, row by row."""
    moves: tuple[tuple[float, ...], ...]
    """By how much each parameter of the result is too large for it, row by row, for one unit of
    each of its own: unknown points are left out."""


class Hidden(Absent, Record, repr=False):
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
    place: str | None = field(default=None, metadata=IF_KNOWN)
    """Where a searched term would act: another channel."""
    label: str | None = field(default=None, metadata=IF_KNOWN)
    """What people call the target."""
    unseen: Unseen | None = field(default=None, metadata=IF_KNOWN)
    """What the session leaves open of it."""


class CheckReadings(Record):
    """Readings in known poses, the mean of each: they tell how large errors are elsewhere."""

    readings: tuple[tuple[float, ...], ...]
    """Pose by pose, channel by channel: 200 poses at the most, evenly spread over their order."""
    temperature_c: tuple[float, ...] | None = field(default=None, metadata=IF_KNOWN)
    """Temperature (°C), where it was measured."""
    point: str | None = field(default=None, metadata=IF_KNOWN)
    """The point whose places are known, where it was named."""


class Alternative(Record):
    """A law that fits as well."""

    effect: Name
    """The effect."""
    line: tuple[tuple[float, ...], ...]
    """Variable and correction."""


class Law(Record):
    """An effect as a law of one variable."""

    over: str
    """The variable: `reading of a22`, `time`."""
    of_reading: bool
    """True where that is the reading of the channel that the law corrects."""
    unit: str
    """Unit of the variable."""
    correction_unit: str
    """Unit of the correction."""
    dots: tuple[tuple[float, ...], ...]
    """The variable, the correction that the law gives and the residual asks for, and its standard
    deviation."""
    per_dot: int
    """Poses whose weighted mean one dot is."""
    poses: tuple[int, ...]
    """Number of the pose of each dot, as in the drawing; empty where a dot is the mean of
    several."""
    line: tuple[tuple[float, ...], ...]
    """The law: variable and correction."""
    alternatives: tuple[Alternative, ...]
    """What these poses cannot tell from it, each with the offset and gain of its own fit."""


class Against(Record):
    """The residual against a variable of the configuration."""

    over: str
    """The variable: `angle of a22`, `pose`."""
    unit: str
    """Unit of the variable."""
    dots: tuple[tuple[float, ...], ...]
    """The variable, the residual without the effect, and what the effect explains of it, in units
    of noise."""


class Score(Record):
    """How far a candidate stands out."""

    effect: Name
    """The candidate."""
    score: float
    """By how much χ² would fall with it, to first order, eq. (72)."""
    charged: float
    """The same less the charge for its parameters and for the places looked at."""
    dof: float
    """Degrees of freedom of the score."""
    p_value: float
    """Probability by chance, corrected for the places looked at."""
    chosen: bool
    """True for what was found, or what these poses cannot tell from it."""


class EffectEvidence(Record):
    """Evidence of one effect."""

    law: Law | None
    """The effect as a law of one variable; null where it is no such law."""
    against: Against | None
    """The residual against a variable; null beside a law."""
    added_variable: tuple[tuple[float, ...], ...]
    """Added-variable plot: what the effect explains, and the residual without it, in units of
    noise."""
    per_dot: int
    """Equations whose mean one dot of `added_variable` is."""
    of_pose: tuple[int, ...]
    """Number of the pose of each dot of `added_variable`, as in the drawing; empty where a dot is
    the mean of several."""
    scores: tuple[Score, ...]
    """Scores of all candidates without the effect, best first."""


class Reliability(Record):
    """Reliability of single readings, after Baarda: channel by channel, pose by pose; null where no
    other reading checks one.
    """

    detectable: tuple[tuple[float | None, ...], ...]
    """Minimum detectable error of the channel's mean reading in the pose, in its unit: seen at the
    level 0.001 in four sessions of five."""
    external: tuple[tuple[float | None, ...], ...]
    """External reliability: what an error of that size does to the worst-hit combination of
    parameters, in its standard deviations."""


class Node(Record):
    """A joint, a point that a chain carries, or an end of closures that no chain carries."""

    name: str
    """Channel of the joint, or of the length to a point that stands; name of another point."""
    chain: str
    """The chain; of a point that stands its name, and empty for a point that moves."""
    joint: bool
    """True for a joint, and for the far end of a length that a channel measures."""


class KnownPlace(Record):
    """The position of a known pose."""

    at: tuple[float, ...]
    """Where it is known to be [length unit]."""
    before: tuple[float, ...]
    """Where it is found before, as in `before` [length unit]."""
    after: tuple[float, ...]
    """Where it is found with the calibration [length unit]."""


class Drawing(Record):
    """The mechanism in its poses."""

    nodes: tuple[Node, ...]
    """Joints, and points that chains carry."""
    edges: tuple[tuple[int, ...], ...]
    """Pairs of nodes that a body or a closure joins."""
    poses: tuple[int, ...]
    """Number of the pose of each row of `at`."""
    at: tuple[tuple[float, ...], ...]
    """Coordinates of all nodes in a pose: x, y, z of the first, of the second, … [length unit]."""
    places: tuple[tuple[float, ...], ...]
    """Position of the platform, or of the first point that a chain carries [length unit]."""
    weakest: tuple[tuple[float, ...], ...]
    """Direction in which the parameters determine the position least, one standard deviation long
    [length unit]."""
    before: tuple[tuple[float, ...], ...]
    """`places` before: without what was found, or, where nothing was, with the mechanism as it is
    declared [length unit]."""
    known: tuple[KnownPlace, ...]
    """Known poses, the instrument moved onto the calibration where that was asked for."""


class Slice(Record):
    """A plane of the workspace: of a platform at orientation zero, or everything within the limits
    of the joints, seen from one side.
    """

    of: str | None
    """The point that is carried, or the chain where it carries several; null: the platform."""
    axes: tuple[str, ...]
    """Names of the two coordinates that change."""
    fixed: str
    """Name of the third coordinate."""
    value: float | None
    """Its value; null: a cell is the root mean square over all its values [length unit]."""
    step: tuple[float, ...]
    """Distance of neighbouring cells along both axes [length unit]."""
    cells: tuple[tuple[float, ...], ...]
    """Both coordinates of a cell, and the standard deviation of the position there, root mean
    square of x, y and z, noise of the reading not counted [length unit]."""


class ParameterName(Record):
    """Name of a parameter."""

    term: str
    """Id of the term."""
    target: str
    """What the term belongs to."""
    name: str
    """Name of the parameter."""
    unit: str
    """Unit of the parameter."""


class Weakest(Record):
    """The place of the workspace that is known least."""

    of: str | None
    """What is carried there, as for a plane; null: the platform."""
    place: tuple[float, ...]
    """x, y, z [length unit]."""
    sd: float
    """Standard deviation there, root mean square of x, y and z [length unit]."""
    along: tuple[float, ...]
    """Direction that is known least, one standard deviation long [length unit]."""
    parameter: ParameterName
    """The parameter that is most correlated with the position along it, offsets about the mean
    reading."""
    correlation: float
    """Size of that correlation."""


class Switch(Record):
    """A suspect."""

    effect: Name | None
    """The effect; on: it is in the model. Null for readings."""
    pose: int | None
    """Label of the pose; on: its readings are left out. Null for an effect."""
    channel: str | None
    """The channel at fault, where it can be told."""


class SwitchFit(Record):
    """One fit of a switchboard."""

    chi2: float
    """χ² between poses."""
    dof: float
    """Its degrees of freedom."""
    p_value: float | None
    """Probability of a larger one by chance; null where lack of fit cannot be judged."""
    rms_misclosure: float
    """Error of the closures [length unit]."""
    values: tuple[float | None, ...]
    """Estimates in the order of `parameters`; null where not in the model."""
    sd: tuple[float | None, ...]
    """Their standard deviations; null where unknown."""
    residuals: tuple[float, ...]
    """Residuals in units of noise, pose by pose, equation by equation."""


class Switchboard(Record):
    """The fits with and without each suspect, on averages of the samples of each pose."""

    switches: tuple[Switch, ...]
    """The suspects."""
    parameters: tuple[ParameterName, ...]
    """What each parameter is: of the terms of any fit."""
    fits: tuple[SwitchFit, ...]
    """Number `n` has switch `i` on where bit `i` of `n` is set."""


class Hypothesis(Record):
    """Effects that a session may be explained by, fitted to the averages of the samples of each
    pose.
    """

    effects: tuple[Name, ...]
    """The effects, wrong readings left out; none: the model that the search began with."""
    kind: str
    """What this is."""
    parameters: tuple[ParameterName, ...]
    """Estimates of all parameters, in the order of `fit.values`."""
    fit: SwitchFit
    """The fit."""
    check: Check | None
    """Error on known poses."""
    places: tuple[tuple[float, ...], ...]
    """`places` of the drawing with these effects [length unit]."""
    known: tuple[tuple[float, ...], ...]
    """Positions of the known poses with these effects [length unit]."""
    workspace: tuple[Slice, ...]
    """How well the calibration with these effects places what is carried, as `workspace` of the
    evidence."""


class Evidence(Record):
    """What the pictures of a report are drawn from, beyond the result itself.

    Residuals are those of the search, which averages the samples of a held pose.
    """

    equations: tuple[str, ...]
    """Closure of each equation; a touch has several."""
    poses: tuple[int, ...]
    """Label of each pose; empty for a recording, whose poses are its rows."""
    channels: tuple[str, ...]
    """Names of the channels."""
    readings: tuple[tuple[float, ...], ...]
    """Mean reading of each channel, pose by pose, in its unit; empty for a long recording."""
    effects: tuple[EffectEvidence, ...]
    """One for each effect that was found, in the order of `steps`."""
    left: tuple[Score, ...]
    """Scores of what is not in the final model, best first."""
    reliability: Reliability | None
    """What a wrong reading would have to be to be seen; null for a long recording."""
    drawing: Drawing | None
    """The mechanism in its poses; null where no chain carries a point."""
    workspace: tuple[Slice, ...]
    """How well the calibration places what is carried, over the workspace or the limits of the
    joints."""
    weakest: Weakest | None
    """The place that it knows least there; null where nothing is uncertain."""
    switchboard: Switchboard | None
    """The fits with and without each suspect; null where nothing is suspected."""
    hypotheses: tuple[Hypothesis, ...]
    """What a session may be explained by, nothing first, each fitted; empty where nothing is to be
    explained."""


class ResultShape(Record, eq=False, repr=False, kw_only=True):
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
    warnings: tuple[Warned, ...] = ()
    """Suspicious things."""
    excluded: tuple[Excluded, ...] = ()
    """Readings that were left out."""
    with_excluded: WithExcluded | None = field(default=None, metadata=IF_KNOWN)
    """The calibration with the readings in `excluded`."""
    verdict: str
    """The verdict."""
    reasons: tuple[Reason, ...] = field(default=(), metadata=OMIT)
    """Why it is not better; the first says most."""
    implausible: tuple[Warned, ...] = field(default=(), metadata=OMIT)
    """What is absurd beside the size of the mechanism."""
    parameters: tuple[Parameter, ...]
    """Estimates."""
    covariance: Labelled
    """Covariance of the parameters, in their order and units; null where unknown."""
    between: Between | None = field(default=None, metadata=IF_KNOWN)
    """What changes from group to group, placements or sessions; null where the session has none, or
    where they tell nothing."""
    predicted: Predicted | None = field(default=None, metadata=IF_KNOWN)
    """Predicted error at the poses of the session, what changes between groups included; null where
    the data determine none."""
    unobservable: tuple[str, ...] = ()
    """Directions in the space of parameters that the data cannot tell: those that other poses
    could, then those that no reading could, which a convention fixes."""
    too_many: tuple[str, ...] = field(default=(), metadata=OMIT)
    """Terms without which these poses would determine the rest."""
    weak: tuple[str, ...] = field(default=(), metadata=OMIT)
    """Directions that the data hardly tell."""
    condition: float | None = None
    """Condition number, offsets about the mean reading."""
    starts: tuple[Start, ...] = ()
    """Starts that were tried."""
    termination: str = ""
    """Why the solver stopped."""
    termination_kind: str | None = field(default=None, metadata=IF_KNOWN)
    """The same for programs; null where no solver ran, and in results of earlier versions."""
    converged: bool | None = field(default=None, metadata=IF_KNOWN)
    """True where the solver ended at a minimum in which every joint moves; null as
    `termination_kind`."""
    reference: Reference | None = field(default=None, metadata=IF_KNOWN)
    """The readings that the parameters refer to."""
    nominal: FitQuality | None = field(default=None, metadata=IF_KNOWN)
    """The check poses with the mechanism as it is declared."""
    moved: tuple[Moved, ...] | None = field(default=None, metadata=IF_KNOWN)
    """Parameters that differ from an earlier result, where one was given."""
    supersedes: str | None = None
    """SHA-256 of the earlier result that this one is meant to replace."""
    digest: str | None = field(default=None, metadata=IF_KNOWN)
    """Digest of the numbers that poses come from, as they were written: others were edited."""
    drawing: str | None = field(default=None, metadata=IF_KNOWN)
    """Digest of the drawing that it was found with; null in results of earlier versions."""
    misclosure: Misclosure | None = field(default=None, metadata=IF_KNOWN)
    """How the loops close under this result: what a watch compares with."""
    update: Update | None = field(default=None, metadata=IF_KNOWN)
    """What has changed since an earlier result, and whether it is worth an update."""
    groups: Groups | None = field(default=None, metadata=IF_KNOWN)
    """How well points that are touched are repeated, where the mechanism has such."""
    labels: Mapping[str, str] = field(default_factory=dict, metadata=OMIT)
    """What people call channels and links, by target."""
    laws: tuple[OwnTerm, ...] = field(default=(), metadata=OMIT)
    """Terms that users wrote, as the mechanism file declared them."""
    before_residuals: FloatArray | None = field(default=None, metadata=NOT_WRITTEN)
    """Residuals in units of noise, shape (poses, equations), before; not in the JSON."""
    after_residuals: FloatArray | None = field(default=None, metadata=NOT_WRITTEN)
    """The same of the final model."""
    source: EvidenceSource | None = field(default=None, metadata=NOT_WRITTEN)
    """What gathers the evidence for a report; None where the result was read from a file."""


class CalibrationShape(ResultShape, eq=False, repr=False, kw_only=True):
    """A calibration: parameters from joint readings alone."""

    fit: FitQuality
    """How well the model fits."""


class TraceShape(ResultShape, eq=False, repr=False, kw_only=True):
    """A calibration whose residual was traced."""

    before: FitQuality
    """How well the model fits that the search began with."""
    steps: tuple[Step, ...] = ()
    """Effects that were found, in their order."""
    elsewhere: Elsewhere | None = field(default=None, metadata=IF_KNOWN)
    """What the effects do to predictions elsewhere; null where nothing was found, or where the
    session has nothing to leave out."""
    rivals: tuple[Rival, ...] = field(default=(), metadata=OMIT)
    """Explanations within 12 of the best in penalised χ², itself included; the best first, 8 at
    most."""
    after: FitQuality
    """How well the model fits with the terms of `steps`."""
    unexplained: Unexplained | None = None
    """What is left."""
    could_hide: tuple[Hidden, ...] = ()
    """Absent effects that would not have been seen."""
    check_readings: CheckReadings | None = field(default=None, metadata=IF_KNOWN)
    """Readings in the known poses, where the result leaves something: by these a certificate tells
    how large its errors are."""
    not_candidates: Mapping[str, str] = field(default_factory=dict, metadata=OMIT)
    """Terms that could not be tried, and what the readings or the mechanism lack for them."""
