"""The compiled core of rsicalib."""

# Written by `python -m scripts.make_stub`; a test compares.

import os
from collections.abc import Callable, Iterable, Mapping, Sequence
from typing import Any, final

import numpy as np
import numpy.typing as npt

Array = npt.NDArray[np.float64]
Spec = tuple[str, str | None, str | None]
Estimate = tuple[Spec, str, float | None, float | None]

__version__: str
VERDICTS: Sequence[tuple[str, int]]
"""Every verdict, and what the command exits with."""
COMPLETE: tuple[str, ...]
"""Terms of complete geometry of any chain, with its sensors."""
CRITERIA: tuple[str, ...]
"""Names of what a plan can make small; the default first."""
UNKNOWN_THINGS: tuple[str, ...]
"""What results call unknown things, in the place of a term."""
LARGEST: float
"""The largest number that is taken as an input, in size."""
FALSE_ALARMS: float
"""False alarms per sample that a watch promises at most where nothing is said."""
MARGIN: float
"""Readings that a planned pose keeps from the ends of the range."""
SCALINGS: tuple[str, ...]
"""Names of the scalings of a Jacobian's columns."""

@final
class Channel:
    """A sensor: `angle = gain * reading + offset`."""

    @property
    def gain(self) -> float:
        """Nominal joint coordinate per reading: rad, or length."""

    @property
    def label(self) -> Any:
        """What people call it."""

    @property
    def limits(self) -> tuple[float, float] | None:
        """Joint limits, in the joint's coordinate."""

    @property
    def name(self) -> str:
        """Column of the readings."""

    @property
    def noise(self) -> float | None:
        """Standard deviation of one reading, where it is known."""

    @property
    def offset(self) -> float:
        """Nominal joint coordinate at reading zero."""

    @property
    def passive(self) -> Any:
        """True for a joint that has no drive."""

    @property
    def range(self) -> tuple[float, float] | None:
        """Lowest and highest reading, if bounded."""

    @property
    def share(self) -> Any:
        """What its drive carries, in proportion to others of a loop with more drives than motions."""

    @property
    def torque(self) -> Any:
        """Column of the readings with the torque of its drive."""

    @property
    def unit(self) -> str:
        """Unit of a reading: `count`, `rad`, `m`, ..."""

@final
class EvidenceSource:
    """What a report is drawn from, gathered where a report is asked for."""

    def changes(
        self, applied: Mapping[str, Any], covariance: Array | None = None, rms: Any = None
    ) -> dict[str, Any]:
        """What has changed since an earlier result with the covariance of its parameters, (k, k), and
        whether that is worth an update where the loops close to `rms`, poses left out in turn. A trace
        compares with what was asked for: what it found besides may be in the earlier session, too.
        """

    def gather(self) -> dict[str, Any]:
        """The evidence in the shape of its schema."""

@final
class Fit:
    """A fitted model."""

    def check(
        self,
        known_poses: tuple[Mapping[str, Any], Array, tuple[float, float], str | None, bool],
        align: bool = False,
    ) -> dict[str, Any]:
        """Error on known poses: `(poses, position rms, orientation rms)`."""

    def forward(self, table: Mapping[str, Any]) -> Array:
        """Platform pose of every row of a table: shape (n, 6)."""

    def residuals(self) -> Array:
        """Whitened residuals: shape (samples, equations), standard normal if the model is right."""

    def to_dict(self) -> dict[str, Any]:
        """The fit in the shape of the JSON."""

    @property
    def warnings(self) -> list[dict[str, Any]]:
        """What looks wrong with the readings or what is declared of them."""

    @property
    def wires(self) -> dict[str, Any] | None:
        """Which wires are exchanged: of two channels, or the outer ones of one. None where nothing says so."""

@final
class Mechanism:
    """A mechanism: channels, chains, points, closures, platform, rest."""

    def __new__(cls, source: str | os.PathLike[str] | Mapping[str, Any]) -> Mechanism: ...
    @property
    def channels(self) -> list[Channel]:
        """Its sensors, in the order of the columns of readings."""

    @property
    def column_units(self) -> dict[str, str]:
        """Units of the columns that are declared for laws, by their names."""

    @property
    def distance_columns(self) -> list[str]:
        """Columns of the readings that hold measured distances."""

    @property
    def doubts(self) -> list[str]:
        """What is suspicious of it as it is declared, in words."""

    @property
    def equations(self) -> int:
        """Scalar equations of one sample."""

    @staticmethod
    def from_dict(values: Mapping[str, Any]) -> Mechanism:
        """Takes a mechanism from plain values, keys and units as in the TOML."""

    @staticmethod
    def from_toml(text: str) -> Mechanism:
        """Reads a mechanism from TOML text; chains in rows, not as URDF."""

    @property
    def instrument_columns(self) -> list[str]:
        """Columns of the readings that an instrument gives: coordinates of the points that it sees."""

    def inverse(self, pose: Sequence[float]) -> list[float]:
        """Joint coordinates that hold the platform at a pose, one per channel [rad]."""

    @property
    def key_columns(self) -> list[str]:
        """Text columns of the readings that its unknown points need."""

    @property
    def law_columns(self) -> list[str]:
        """Columns of numbers that no closure has of its own: what laws and drives use."""

    @property
    def length_unit(self) -> str:
        """Unit of every length."""

    @property
    def name(self) -> str:
        """What people call it."""

    @property
    def optional_columns(self) -> list[str]:
        """Columns of numbers that laws alone follow: readings may lack them."""

    @property
    def own_columns(self) -> Any:
        """For each closure that samples take part in, the columns of its own: where one of them is blank in a row, the closure
        does not hold there.
        """

    @staticmethod
    def rsi() -> Mechanism:
        """The RSI 6-DOF hand controller."""

    @property
    def terms(self) -> list[Term]:
        """Its terms beside those of the catalogue."""

    def to_dict(self) -> dict[str, Any]:
        """The mechanism as plain values, keys and units as in the TOML."""

    def to_toml(self) -> str:
        """The mechanism as TOML text that `from_toml` reads back."""

    @property
    def value_columns(self) -> list[str]:
        """Columns of the readings with numbers that its closures, points and laws need."""

    def with_sensors(self, sensors: Mapping[str, tuple[float, float]]) -> Mechanism:
        """The same mechanism with sensors of another gain and offset: `{name: (gain, offset)}`."""

    def with_terms(self, terms: Sequence[Term]) -> Mechanism:
        """The same mechanism with more terms of its own."""

@final
class Monitor:
    """A calibrated mechanism that is watched at work."""

    def __new__(
        cls,
        mechanism: Mechanism,
        applied: Mapping[str, Any],
        covariance: Array | None,
        *,
        false_alarms: Any = None,
        dof: Any = None,
        correlation: Any = 0.0,
        interval: Any = None,
    ) -> Monitor: ...
    def counts(self) -> Any:
        """Rows so far, by what became of them."""

    @property
    def interval(self) -> Any:
        """Usual time between neighbouring rows [s]."""

    @property
    def noise(self) -> Any:
        """Noise at work over that of the calibration, and correlation of neighbouring samples."""

    def restore(self, state: bytes) -> None:
        """Goes on where the watch ended whose `state` this is, one of the same mechanism and result."""

    def state(self) -> bytes:
        """All that the watch knows, beside what it was made from, as bytes."""

    def update(self, readings: Any, time: Any = None) -> Any:
        """Tests one row: a reading of each channel, and its time [s]. Returns the alarms."""

    def update_all(self, readings: Any, times: Any = None) -> Any:
        """Tests many rows, shape (n, channels), with their times [s]. Returns the alarms."""

@final
class Placer:
    """A mechanism under a result, which tells its place reading by reading."""

    def __new__(cls, mechanism: Mechanism, applied: Mapping[str, Any]) -> Placer: ...
    @property
    def names(self) -> Any:
        """Names of the values."""

    def place(self, reading: Any) -> Array:
        """The place of one reading, one number for each channel: shape (k,)."""

@final
class Session:
    """Readings of one mechanism, with what is known beside them."""

    def __new__(
        cls,
        mechanism: Mechanism,
        table: Mapping[str, Any],
        *,
        rest: Array | None = None,
        terms: Sequence[str] | None = None,
        closures: Sequence[str] | None = None,
        method: str | None = None,
        noise: Sequence[float] | None = None,
        starts: int | None = None,
        max_iterations: int | None = None,
        xtol: float | None = None,
        progress: Callable[[str, float], object] | None = None,
        expected: Mapping[str, Any] | None = None,
    ) -> Session: ...
    def calibrate(
        self, beside: Mapping[str, Any] | None = None
    ) -> tuple[dict[str, Any], Fit, Fit | None]:
        """Fits the terms that the options ask for, without readings that are wrong.

        Returns the calibration, the fit, and the fit of all readings where any was left out.
        """

    def fit(self) -> Fit:
        """Fits the terms that the options ask for."""

    def lacking(self) -> dict[str, str]:
        """Terms that are no candidates here, and what they need: `{id: needs}`."""

    def reference(self) -> dict[str, Any]:
        """What reported parameters refer to: `centre` and `span` of each channel, `temperature`."""

    def suppose(self, supposed: Sequence[str]) -> dict[str, Any]:
        """What effects would do in these poses: `supposed` as in `curvature@a22.c2=0.02`."""

    def trace(
        self,
        beside: Mapping[str, Any] | None = None,
        without: Sequence[str] | None = None,
        off: Sequence[str] | None = None,
        apply_all: Any = False,
    ) -> dict[str, Any]:
        """Closes the loop."""

@final
class Term:
    """A term that is written as a formula: an entry `[[term]]` of a mechanism file."""

    def __new__(
        cls,
        id: str,
        *,
        klass: str,
        per: str,
        parameters: Mapping[str, float],
        correction: str | None = None,
        moves: str | None = None,
        amount: str | None = None,
        doc: str | None = None,
    ) -> Term: ...
    @staticmethod
    def from_dict(values: Mapping[str, Any]) -> Term:
        """Takes a term from plain values, keys as in the TOML."""

    @property
    def id(self) -> str:
        """What scripts call it."""

    def to_dict(self) -> dict[str, Any]:
        """The term as plain values, keys as in the TOML."""

def angles_at(mechanism: Mechanism, poses: Array) -> Array:
    """Joint coordinates that hold the platform at poses of shape (n, 6): (n, channels) [rad, or length]."""

def beyond_chance(p_values: Sequence[float | None]) -> list[bool]:
    """Which of some tests are beyond chance, by the probability of each, all of them counted in; None says nothing."""

def bound(
    mechanism: Mechanism,
    counts: Array,
    offsets: Array,
    gains: Array,
    sigma: Array,
    *,
    closures: Sequence[str] | None = None,
) -> dict[str, Any]:
    """The Cramér-Rao bound for readings of shape (n, channels) with noise `sigma` per channel."""

def bound_at(
    mechanism: Mechanism, offsets: Array, gains: Array, poses: Array, noise: float
) -> dict[str, Any]:
    """The Cramér-Rao bound for poses of shape (n, 6) that are to be visited."""

def calibrate_devices(
    mechanism: Mechanism,
    tables: Sequence[Mapping[str, Any]],
    rests: Sequence[Array | None],
    *,
    terms: Sequence[str] | None = None,
    closures: Sequence[str] | None = None,
    noise: Sequence[float] | None = None,
    trace: Any = True,
    held_out: Any = False,
    time_limit: float | None = None,
) -> dict[str, list[Any]]:
    """Calibrates devices one after the other, column by column in the order of the tables.

    `rests` holds readings of the rest pose, shape (n, C), or None, for each table. A device that
    cannot be calibrated has a message and no numbers; one that takes longer than `time_limit` [s] is
    `ended`, with its calibration where only the trace took longer.
    """

def calibrated_sensors(mechanism: Mechanism, applied: Mapping[str, Any]) -> Mechanism:
    """The mechanism with the gains and offsets that a result has found."""

def centre_of_population(mechanism: Mechanism) -> list[float]:
    """Readings from which offsets of a population are counted, one per channel."""

def certify(
    mechanism: Mechanism,
    result: str,
    table: Mapping[str, Any],
    orientation: bool,
    limit: float,
    confidence: float,
) -> dict[str, Any]:
    """Whether the largest error of a result, given as its JSON text, is within a limit at the rows of a table:
    an object with the keys of the core's `Certificate`.
    """

def check(
    mechanism: Mechanism,
    applied: Mapping[str, Any],
    known_poses: tuple[Mapping[str, Any], Array, tuple[float, float], str | None, bool],
    align: bool = False,
) -> dict[str, Any]:
    """Error of a result on known poses, root mean square over components."""

def common_shifts(estimates: Array, levels: Any = None) -> list[dict[str, Any] | None]:
    """Common shift of each parameter, from a row for each device (distance from the drawing, sd), by
    parameters: `{devices, value, half, between, between_interval, p_value}`, None for too few. `levels`
    says for each level in which group each device is; each then has `levels`, devices first.
    """

def compared(
    mechanism: Mechanism, earlier: Sequence[Estimate], now: Sequence[Estimate]
) -> list[tuple[int, float, float, float, bool]]:
    """Parameters that an earlier result knows, too: number among the new ones, before, after, standard
    deviation of the difference, and whether it is beyond both uncertainties.
    """

def declared(mechanism: Mechanism) -> dict[str, Any]:
    """The mechanism as it is declared, as a result on its way to readings."""

def distances(devices: Array, usual: tuple[float, float, float, int]) -> Array:
    """Distance of each device from what is usual, in standard deviations; NaN where it is not known."""

def evidence_schema() -> str:
    """JSON Schema of the evidence that a report is drawn from, as text."""

def expects_more(
    mechanism: Mechanism,
    applied: Mapping[str, Any],
    table: Mapping[str, Any],
    covariance: Array | None = None,
    *,
    own: Any,
) -> float | None:
    """What a result expects of the misclosure of a table of readings, where that is more than `own`, that of
    its own session, explains; none where it is not.
    """

def exported(
    mechanism: Mechanism, applied: Mapping[str, Any]
) -> tuple[Mechanism, dict[str, dict[str, Any]], list[dict[str, Any]]]:
    """The mechanism with the parameters of a result in it, the same motions of the ends of its
    chains as rows `{chain: row}`, and what could not be put in: objects with `kind`, `term`, `target`
    and `text`.
    """

def fixture(
    mechanism: Mechanism, table: Mapping[str, Any], poses: Array
) -> tuple[list[dict[str, Any]], int]:
    """Offset and gain of every channel from known poses, eq. (13): `(lines, poses)`."""

def further(
    session: Session,
    rivals: Sequence[tuple[Sequence[str], float, float]],
    *,
    poses: int,
    criterion: str | None = None,
    within: Sequence[Sequence[float]] | None = None,
    candidates: int | None = None,
    left_out: Sequence[int] | None = None,
    off: Array | None = None,
    from_: Array | None = None,
    way: float | None = None,
    seed: int = 0,
    target: float | None = None,
) -> dict[str, Any]:
    """Chooses poses to visit after a session, beside the readings that it has.

    `left_out` are rows of the session that do not count; `off` are readings of poses that are
    struck off, of shape (m, channels); `from_` is a reading of where the mechanism stands. With a `target` of the
    platform's standard deviation, as few poses as reach it, and `standing`: how they stand to it.
    """

def guided_done(progress: Mapping[str, object]) -> bool:
    """Whether a guided session is done.

    `progress` has the fields of `Progress` of the core: `poses`, `most`, `beyond`, `repeat`, `open`, `deciding`, `gain`,
    `usable`, `p_value`, `unmended`, `checked`, `alone`.
    """

def history(
    mechanism: Mechanism,
    results: Sequence[tuple[float, Sequence[Estimate], Array | None, Sequence[Spec]]],
    last: tuple[Mapping[str, Any], Mapping[str, Any], float] | None = None,
) -> tuple[list[dict[str, Any]], list[str], dict[str, Any] | None]:
    """What the parameters of a device have done over its results, in order of their dates.

    Objects with `known` (the results that know a parameter, each with its number in it) and `course`, as in
    `history.json`, None where that cannot be told; the effects that belong to single sessions; and, with the
    last result, when the platform's error will exceed the target: `target`, `now`, and days from then on, `day`
    and `from_day`.
    """

def identifiable(
    mechanism: Mechanism, terms: Sequence[str] | None = None, *, seed: int = 0
) -> dict[str, Any]:
    """Counts what readings of a mechanism can and cannot tell.

    `terms` as users write them; the declared model where not given.
    """

def jacobian(
    mechanism: Mechanism,
    counts: Array,
    offsets: Array,
    gains: Array,
    *,
    closures: Sequence[str] | None = None,
) -> Array:
    """Derivatives of the misclosure by offsets and gains, eq. (12): shape (n equations, 2 channels)."""

def joint_coordinates(
    mechanism: Mechanism, applied: Mapping[str, Any], table: Mapping[str, Any]
) -> Array:
    """Coordinates of the joints under a result, row by row of a table [rad, or length units]: shape (n, C)."""

def judged_open_loop(
    poses: int = 0,
    check: Mapping[str, Any] | None = None,
    nominal: Any = None,
    open_loops: Any = None,
) -> Any:
    """The verdict on lines through so many known poses, and its reasons, by the error of the calibration
    and of the mechanism as declared on check poses, and by their loops that are open: misclosure, that of the
    session, probability by chance. Of no poses: nothing could begin.
    """

def lasting(mechanism: Mechanism, specs: Sequence[Spec]) -> list[str]:
    """The terms of a result that a later session is identified with: `curvature@a22`, each once."""

def means_of_samples(
    mechanism: Mechanism, exact: Array, sigma: float, samples: int, seed: int
) -> Array:
    """Means of samples of exact readings of shape (n, channels), with noise `sigma` [readings], rounded to
    counts and clipped to their ranges one by one.
    """

def mechanism_schema() -> str:
    """JSON Schema of a mechanism file, as text."""

def minimize(
    mechanism: Mechanism,
    counts: Array,
    offsets0: Array,
    gains0: Array,
    *,
    closures: Sequence[str] | None = None,
    xtol: float | None = None,
    max_iterations: int | None = None,
) -> tuple[Array, Array, float, int, str]:
    """Minimises `½ fᵀf` over offsets and gains from a start, eq. (11).

    The paper's own problem in its own parameters: offsets at reading zero [rad], gains
    [rad/reading]; counts of shape (n, channels). Returns offsets, gains, cost, iterations and
    termination.
    """

def misclosure(
    mechanism: Mechanism,
    counts: Array,
    offsets: Array,
    gains: Array,
    *,
    closures: Sequence[str] | None = None,
) -> Array:
    """Misclosure `f` of readings of shape (n, channels), eq. (10): shape (n, equations)."""

def needed_poses(mechanism: Mechanism) -> int | None:
    """Poses from which on a trace is possible; None where that depends on what is touched."""

def observability(
    mechanism: Mechanism,
    counts: Array,
    offsets: Array,
    gains: Array,
    scaling: str,
    *,
    closures: Sequence[str] | None = None,
) -> dict[str, Any]:
    """What poses can tell of offsets and gains, under a named scaling of the columns."""

def open_loops(
    mechanism: Mechanism,
    applied: Mapping[str, Any],
    table: Mapping[str, Any],
    covariance: Array | None = None,
    *,
    source: str | os.PathLike[str] | Mapping[str, Any],
    own: Any = None,
    edited: Any = None,
    scale: Any = 1.0,
    dof: Any = None,
    correlation: Any = 0.0,
) -> Any:
    """Whether the loops of a table of readings are open under a result, beside the misclosure `own` of its own
    session: misclosure, that of the session, the probability by chance, and the same in words; none
    where they close, or where no row of the table tells that. Loops that close better than the noise of the result
    lets them are told where nothing else says that the noise is as it was written.

    `edited`: whether the result's numbers were edited, where that is known.
    """

def places(
    mechanism: Mechanism,
    applied: Mapping[str, Any],
    table: Mapping[str, Any],
    covariance: Array | None = None,
) -> tuple[list[str], Array, Array | None, list[bool]]:
    """Platform poses under a result, or the points that the chains carry, row by row of a table.

    Names of the columns, values of shape (n, k), and with the covariance of the parameters their
    standard deviations; None where nothing is known of those. Last, whether a shape is held in each
    row, beyond the readings at which it was seen.
    """

def plain_numbers(data: bytes, first: int, columns: int) -> list[Array] | None:
    """Columns of a text that is a plain table of numbers from byte `first` on; None on any doubt."""

def plan(
    mechanism: Mechanism,
    offsets: Array,
    gains: Array,
    *,
    poses: int,
    beside: Array | None,
    within: Sequence[Sequence[float]] | None,
    noise: float,
    criterion: str,
    candidates: int,
    starts: int,
    seed: int,
) -> dict[str, Any]:
    """Chooses poses: `poses` of shape (n, 6), `readings` of shape (n, channels), `bound`, `before`.

    `beside` holds readings of poses that are visited already, of shape (m, channels).
    """

def population(
    shares: Sequence[Mapping[str, Any]], tolerances: Sequence[float], levels: Any = None
) -> tuple[dict[str, Any], list[list[tuple[float, float]]], list[int], int | None]:
    """The joint estimate in the shape of the JSON, and value and deviation of the parameters of each
    device with what the others tell (corrections of the drawing, (n, 2); empty for outliers); the
    device of each share, and the level of devices, where `levels` says for each level in which group
    each share is.
    """

def read_result(text: str) -> dict[str, Any]:
    """A result from its JSON text, as plain values: checked against the types that made it."""

def readings_at(
    mechanism: Mechanism, poses: Array, offsets: Array, gains: Array, margin: float
) -> Array:
    """Readings of shape (n, channels) that hold the platform at poses of shape (n, 6).

    NaN in the rows out of reach, beyond a joint limit, or within `margin` of a range's end.
    """

def rms_misclosure(
    mechanism: Mechanism,
    applied: Mapping[str, Any],
    table: Mapping[str, Any],
    counted: Sequence[bool],
) -> float | None:
    """How the loops close under a result in the rows of a table that are counted, root mean square [length unit]; None
    where something is unknown beside the terms.
    """

def rsi_angles(poses: Array) -> Array:
    """Joint angles of the hand controller for poses of shape (n, 6): (n, 9), NaN out of reach [rad]."""

def rsi_poses(angles: Array) -> Array:
    """Handle poses of the hand controller for angles of shape (n, 9), eqs. (2)-(5): (n, 6)."""

def rules() -> list[str]:
    """Names of the rules of the search that can be switched off, to see what each is worth."""

def schemas() -> Sequence[tuple[str, str]]:
    """JSON Schema of each format of results, as text: what can be read."""

def shares(
    mechanism: Mechanism,
    tables: Sequence[Mapping[str, Any]],
    rests: Sequence[Array | None],
    terms: Sequence[str],
    expected: Mapping[str, Any],
    *,
    closures: Sequence[str] | None = None,
    noise: Sequence[float] | None = None,
) -> list[dict[str, Any] | str]:
    """What each device tells of `terms`, given what is expected; why not, for one that tells nothing."""

def spec(term: str, target: str | None = None, place: str | None = None) -> str:
    """A term at its place, as it is asked for: `curvature@a22`, `slip@a22:17`."""

def standing_out(
    verdicts: npt.NDArray[np.int64],
    fits: Array,
    devices: Iterable[Array],
    usual: Sequence[tuple[float, float, float, int]],
) -> list[tuple[int, float, tuple[int, float | None] | None]]:
    """Devices that stand out, those first that need a decision: each with its size, and the parameter with how many
    times worse than usual it is known; None where the verdict says why. `fits` has χ² and degrees of freedom,
    `devices` gives the values of one parameter after the other, of which `usual` has what is usual.
    """

def still_stretches(
    values: Array, time: Any, hold: float, inside: npt.NDArray[np.bool_] | None = None
) -> list[tuple[int, int]]:
    """First row, and row after the last, of each stretch of a recording that is still for `hold` seconds. `values`
    has shape (n, channels), and `inside` says which rows may belong to a stretch.
    """

def summed(devices: Array) -> dict[str, Any] | None:
    """The tests of fit of many devices together: `{devices, chi2, dof, p_value}`, None for too few.

    `devices` has a row for each: chi2, dof, p-value.
    """

def suspects(
    channels: Sequence[Any], values: Array, pose: npt.NDArray[np.int64] | None
) -> list[dict[str, Any]]:
    """What looks wrong in readings of shape (n, channels): the variants of `Suspect`, each as a dictionary
    with its `kind`. Rows are counted from 0; `pose` labels each row, None for a recording.
    """

def terms(mechanism: Mechanism) -> list[dict[str, Any]]:
    """Every term there is, with its targets in a mechanism."""

def traceable(mechanism: Mechanism, poses: int, touched: int) -> bool:
    """Whether poses that touch so many unknown places are enough for a trace."""

def unit_of_key(mechanism: Mechanism, key: str) -> str | None:
    """The unit of a parameter that a column is called after, as `gain@a11`; None where it has none, or
    several.
    """

def units_of(mechanism: Mechanism, named: Sequence[tuple[Spec, str]]) -> list[list[str]]:
    """The units that each parameter of a result may have, of ((term, target, place), name); empty where
    any will do.
    """

def unlabelled(
    channels: Sequence[Any],
    values: Array,
    pose: npt.NDArray[np.int64] | None,
    sample: npt.NDArray[np.int64] | None,
) -> dict[str, Any] | None:
    """Poses that nothing numbers: a variant of `Unlabelled` as a dictionary with its `kind`, None where every
    row is a pose of its own. `sample` numbers the sample of each row.
    """

def usual(
    devices: Array, verdicts: npt.NDArray[np.int64]
) -> tuple[tuple[float, float, float, int], tuple[int, float]] | None:
    """What is usual of a parameter over a fleet, (median, sd between devices, sd of one, how many), and the device that is
    farthest from that, with its distance; None for too few. `devices` has a value and its sd in each row,
    `verdicts` their places in `VERDICTS`, -1 for refused.
    """

def within_limits(mechanism: Mechanism, count: Any, *, seed: int = 0) -> Array:
    """Readings of random configurations within the limits of the joints, of shape (n, channels):
    closures between points that chains carry hold, others do not.
    """

def workspace(
    mechanism: Mechanism, within: Sequence[Sequence[float]] | None = None
) -> list[list[float]]:
    """The box of a workspace, given or the mechanism's own: six pairs, lowest and highest."""

def written_keys() -> Sequence[tuple[str, Sequence[str]]]:
    """Keys of each type of a result that are always written."""
