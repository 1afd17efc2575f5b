"""Certificates: their values, and the decision and its sources in words."""

from __future__ import annotations

from typing import Literal, TypeAlias

from rsicalib.facts.records import Record

Decision: TypeAlias = Literal["within", "not within", "undecided"]


class Source(Record):
    """A source of the budget, at the place that is known least."""

    source: str
    """`parameters`, `between placements`, `noise`, `play` or `unseen`: an effect nobody named."""
    effect: str | None
    """The effect, where it is one that nobody named; None for all others of them together."""
    size: float | None
    """Standard uncertainty of the source itself, in its own unit; None where it has several."""
    size_unit: str | None
    """Unit of the size."""
    sensitivity: float | None
    """Standard uncertainty of the place for one unit of the size."""
    distribution: str
    """`normal`, `Student`, or `mixture`: one of several effects."""
    dof: float | None
    """Degrees of freedom; None where they are infinitely many."""
    u: float
    """Standard uncertainty of the place, in the unit of the limit."""

    @property
    def words(self) -> str:
        """The source in words: `unseen: curvature of a22`."""
        words = {
            "noise": "noise of a reading",
            "unseen": "other effects that nobody named",
            "held shapes": "beyond the readings of a shape",
        }
        if self.effect is None:
            return words.get(self.source, self.source)
        term, _, target = self.effect.partition("@")
        return f"unseen: {term.replace('_', ' ')}" + (f" of {target}" if target else "")


class Uncertainty(Record):
    """How large the largest error may be, and what that is made of."""

    expanded: float
    """The largest error over all places is not beyond it, with the probability `confidence`."""
    median: float
    """Median of the largest error."""
    least: float
    """Noise of the readings alone makes it at least so large, with the same probability."""
    u: float
    """Combined standard uncertainty of the place that is known least."""
    coverage_factor: float
    """`expanded / u`: above 2, because the largest error of all places counts."""
    dof: float | None
    """Degrees of freedom of `u` by Welch and Satterthwaite; None where infinitely many."""
    places: int
    """Number of places, each read once."""
    budget: tuple[Source, ...]
    """The sources: the squares of their `u` add up."""


class Known(Record):
    """An error that is known."""

    source: str
    """`check points`, or `effects not applied`."""
    error: float
    """The largest that was seen, or what the effects do, in the unit of the limit."""
    expanded: float | None
    """Its expanded uncertainty by the noise of the readings; None where `uncertainty` holds."""
    poses: int
    """Number of known poses; 0 for effects."""


class CertificateShape(Record, eq=False, repr=False):
    """Whether the largest error of a calibrated mechanism is within a limit."""

    mechanism: str
    """Name of the mechanism."""
    device: str | None
    """The device."""
    valid_from: str | None
    """From when the parameters hold."""
    quantity: Literal["position", "orientation"]
    """What the limit is of: the length of the error of a position, or of roll, pitch and yaw."""
    limit: float
    """The limit, in `unit`."""
    unit: str
    """Unit of the limit and of every error here: the mechanism's length unit, or rad."""
    confidence: float
    """Probability of the expanded uncertainty."""
    decision: Decision
    """By ISO 14253-1: what is between the two is undecided."""
    reasons: tuple[str, ...]
    """Why, a sentence each."""
    uncertainty: Uncertainty | None
    """The budget; None where the result has no covariance to make one of."""
    known: tuple[Known, ...]
    """Errors that are known."""
    decides: str | None
    """Arguments of `rsicalib` that plan the poses which may decide what is undecided."""
    verdict: str
    """Verdict of the result."""
    conditions: tuple[str, ...]
    """Under which conditions it holds, a sentence each."""
    rests_on: tuple[str, ...]
    """What it rests on: the length that gives the scale."""
    not_covered: tuple[str, ...]
    """What it does not cover."""
    independent_points: int
    """Number of poses that another instrument measured; 0: none were used."""
    data_sha256: str
    """SHA-256 of the readings, as the result holds it."""
    files: tuple[str, ...]
    """Files of the readings."""

    @property
    def decided(self) -> str:
        """The decision in a sentence."""
        limit = f"{self.limit:g} {self.unit}"
        return {
            "within": f"The largest {self.quantity} error is within {limit}.",
            "not within": f"The largest {self.quantity} error is not within {limit}.",
            "undecided": f"Undecided: neither within nor not within {limit} has been shown.",
        }[self.decision]
