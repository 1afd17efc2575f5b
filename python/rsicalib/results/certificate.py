"""What a certificate says: values, words, and the sheet that is filed."""

from __future__ import annotations

from dataclasses import dataclass
from html import escape
from typing import Literal, TypeAlias

from rsicalib.facts.records import Record
from rsicalib.report.page import document, listed, section, table
from rsicalib.report.words import number
from rsicalib.tabular import Told

__all__ = ["EXIT_CODES", "Certificate", "Decision", "Known", "Source", "Uncertainty"]

Decision: TypeAlias = Literal["within", "not within", "undecided"]

EXIT_CODES: dict[str, int] = {"within": 0, "not within": 4, "undecided": 3}
"""What the command returns."""


@dataclass(frozen=True)
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


@dataclass(frozen=True)
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


@dataclass(frozen=True)
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


@dataclass(frozen=True, eq=False, repr=False)
class Certificate(Told, Record):
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
    def exit_code(self) -> int:
        """What the command returns: 0 within, 4 not within, 3 undecided."""
        return EXIT_CODES[self.decision]

    @property
    def _decided(self) -> str:
        limit = f"{self.limit:g} {self.unit}"
        return {
            "within": f"The largest {self.quantity} error is within {limit}.",
            "not within": f"The largest {self.quantity} error is not within {limit}.",
            "undecided": f"Undecided: neither within nor not within {limit} has been shown.",
        }[self.decision]

    def text(self) -> str:
        """The certificate for people."""
        whose = " · ".join(x for x in (self.mechanism, self.device, self.valid_from) if x)
        lines = [whose, self._decided, *(f"  {reason}" for reason in self.reasons)]
        if self.uncertainty is not None:
            lines += ["", *(f"  {a:34}{b:>12}" for a, b in self._sizes())]
        if self.decides is not None:
            lines += ["", "Poses that may decide it:", f"  rsicalib {self.decides}"]
        return "\n".join(lines) + "\n"

    def _sizes(self) -> list[tuple[str, str]]:
        assert self.uncertainty is not None
        found = self.uncertainty
        rows = [(f"U ({100 * self.confidence:g} %) [{self.unit}]", number(found.expanded))]
        rows += [(f"  {_named(one)}", number(one.u)) for one in found.budget]
        return [*rows, *((f"known: {known.source}", number(known.error)) for known in self.known)]

    def report(self) -> str:
        """One sheet for a quality department: HTML that needs no network."""
        good = "good" if self.decision == "within" else "bad"
        whose = [self.mechanism, self.device, self.valid_from]
        head = "".join(
            [
                f"<header><h1>Certificate of {escape(' · '.join(w for w in whose if w))}</h1>",
                f'<p class="verdict {good}">{escape(self._decided)}</p>',
                listed(self.reasons),
                "</header>",
            ]
        )
        next_poses = ""
        if self.decides is not None:
            next_poses = f"<p><code>rsicalib {escape(self.decides)}</code></p>"
        data = [f"SHA-256 of the readings: {self.data_sha256}", *self.files]
        parts = [
            head,
            section("Poses that may decide it", next_poses),
            section("Uncertainty", self._budget()),
            section("Known errors", self._known()),
            section("Conditions", listed(self.conditions)),
            section("What it rests on", listed(self.rests_on)),
            section("What it does not cover", listed(self.not_covered)),
            section("Data", listed(data)),
        ]
        sheet = "\n".join(part for part in parts if part)
        title = f"Certificate: {self.mechanism}: {self.decision}"
        return document(title, [f'<div class="sheet">{sheet}</div>'])

    def _budget(self) -> str:
        found = self.uncertainty
        if found is None:
            return ""
        expanded = f"{number(found.expanded)} {self.unit}"
        words = (
            f"<p>With a probability of {100 * self.confidence:g} %, the largest error of "
            f"{found.places} places, each read once, is not beyond U = {escape(expanded)} "
            f"(median {number(found.median)}). At the place that is known least "
            f"u = {number(found.u)}, degrees of freedom {_dof(found.dof)}; "
            f"U / u = {number(found.coverage_factor)}.</p>"
        )
        heads = ("source", "distribution", "size", "sensitivity", "degrees", f"u [{self.unit}]")
        rows = [
            (
                _named(one),
                one.distribution,
                "–" if one.size is None else f"{number(one.size)} {one.size_unit or ''}".strip(),
                number(one.sensitivity),
                _dof(one.dof),
                number(one.u),
            )
            for one in found.budget
        ]
        return words + table(heads, rows, 2, "budget of uncertainty")

    def _known(self) -> str:
        if not self.known:
            return "<p>None: no known poses were given, and every effect found is applied.</p>"
        heads = ("source", "poses", f"error [{self.unit}]", "its U")
        rows = [
            (one.source, str(one.poses), number(one.error), number(one.expanded))
            for one in self.known
        ]
        return table(heads, rows, 1, "known errors")

    def __repr__(self) -> str:
        return f"<Certificate of {self.mechanism!r}: {self.decision}, {self.limit:g} {self.unit}>"


def _named(one: Source) -> str:
    """A source in words."""
    words = {
        "parameters": "parameters",
        "noise": "noise of a reading",
        "play": "play",
        "unseen": "other effects that nobody named",
    }
    return words.get(one.source, one.source) if one.effect is None else f"unseen: {one.effect}"


def _dof(dof: float | None) -> str:
    return "∞" if dof is None else number(dof)
