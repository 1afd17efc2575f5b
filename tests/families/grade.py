"""Was it right? What the library said of a machine, against what was wrong with it.

Pure functions of plain values: a result is the dictionary of `rsicalib trace --json`.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Any

Result = dict[str, Any]
Place = tuple[str, str]
"""Class and target."""

TIE = 2
"""A tie counts where the truth is among no more other names than this."""

ROUNDING = 1e-6
"""What two fits of the same readings may differ by."""

GREW = 1.1
"""Errors that are so many times others are larger by more than a trifle."""

USABLE = 0
"""The exit code that tells a script to go on."""


@dataclass(frozen=True)
class Truth:
    """What was wrong: `names` are its class and target, and those that no data tell from it.

    `poses` are the labels of spoiled poses; `outside` says that no term has its law.
    """

    term: str
    names: frozenset[Place] = frozenset()
    strict: Place | None = None
    poses: frozenset[int] = frozenset()
    outside: bool = False
    strength: float | None = None


@dataclass(frozen=True)
class Errors:
    """Errors of the points at check poses [length unit]: before, after, and told the truth."""

    before: float | None = None
    after: float | None = None
    told: float | None = None


@dataclass(frozen=True)
class Grade:
    """One device judged."""

    verdict: str
    exit_code: int
    flagged: bool
    found: tuple[bool, ...]
    """Of every effect: whether it was named, class and target, or tied with few others."""
    strictly: tuple[bool, ...]
    """The same, twins that no data could tell from it not counted."""
    among: tuple[bool, ...]
    """Of every effect: whether it was named, or is among all that fits as well."""
    extras: int
    misled: bool
    worse: bool | None
    said: tuple[str, ...] = field(default=())


def place(name: Result) -> Place:
    """Class and target of a name."""
    return str(name["class"]), str(name["target"])


def names(step: Result, most: int = TIE) -> set[Place]:
    """What a step says: its own name, and its ties where they are few."""
    ties = {place(name) for name in step.get("also_fits") or []} - {place(step)}
    return {place(step)} | (ties if len(ties) <= most else set())


def targets(result: Result) -> set[str]:
    """Every place that is blamed for anything."""
    out = {target for step in result.get("steps") or [] for _, target in names(step)}
    for entry in result.get("excluded") or []:
        out |= {entry[key] for key in ("channel", "chain") if entry.get(key)}
    warned = result.get("warnings") or []
    out |= {warning["target"] for warning in warned if warning["kind"] == "coarse"}
    left = (result.get("unexplained") or {}).get("target")
    return out | ({left} if left else set())


def is_found(truth: Truth, result: Result) -> bool:
    """Whether an effect was named; bad readings: all poses left out; outside: its target."""
    if truth.poses:
        return truth.poses <= left_out(result)
    if truth.outside:
        return bool({target for _, target in truth.names} & targets(result))
    return any(truth.names & names(step) for step in result.get("steps") or [])


def is_among(truth: Truth, result: Result) -> bool:
    """Whether an effect was named, or is among all that is said to fit as well."""
    steps = result.get("steps") or []
    return any(truth.names & names(step, 10**6) for step in steps) or is_found(truth, result)


def is_strict(truth: Truth, result: Result) -> bool:
    """Whether it was named itself."""
    if truth.poses or truth.outside or truth.strict is None:
        return is_found(truth, result)
    return any(truth.strict in names(step) for step in result.get("steps") or [])


def left_out(result: Result) -> set[int]:
    """Labels of poses in which something was found to be bad."""
    entries = result.get("excluded") or []
    return {int(entry["pose"]) for entry in entries if entry.get("pose") is not None}


def extras(truths: Sequence[Truth], result: Result) -> int:
    """Steps that are no effect, and poses left out that were good."""
    right = {name for truth in truths for name in truth.names}
    poses = {pose for truth in truths for pose in truth.poses}
    steps = sum(not right & names(step, 10**6) for step in result.get("steps") or [])
    return steps + len(left_out(result) - poses)


def is_misled(truths: Sequence[Truth], result: Result) -> bool:
    """Whether it is said to be explained, by a class that nothing has that is wrong."""
    if result.get("verdict") != "explained" or not truths:
        return False
    classes = {klass for truth in truths for klass, _ in truth.names}
    said = {step["class"] for step in result.get("steps") or []}
    if result.get("excluded"):
        said.add("data")
    return not said <= classes


def is_worse(errors: Errors) -> bool | None:
    """Whether the errors grew: beyond before, and beyond 1.1 times what the truth gives."""
    if errors.after is None or errors.before is None:
        return None
    told = errors.before if errors.told is None else errors.told
    return errors.after > GREW * told and errors.after > (1 + ROUNDING) * errors.before


def grew_by_chance(errors: Errors) -> bool | None:
    """Whether the calibration that is told the truth has errors beyond 1.1 times those before."""
    if errors.told is None or errors.before is None:
        return None
    return errors.told > GREW * errors.before


def grade(
    result: Result, exit_code: int, truths: Sequence[Truth] = (), errors: Errors | None = None
) -> Grade:
    """Judges one device."""
    return Grade(
        verdict=str(result.get("verdict")),
        exit_code=exit_code,
        flagged=result.get("verdict") != "adequate",
        found=tuple(is_found(truth, result) for truth in truths),
        strictly=tuple(is_strict(truth, result) for truth in truths),
        among=tuple(is_among(truth, result) for truth in truths),
        extras=extras(truths, result),
        misled=is_misled(truths, result),
        worse=None if errors is None else is_worse(errors),
        said=said(result),
    )


def said(result: Result) -> tuple[str, ...]:
    """What was named, in a word each."""
    steps = [f"{step['term']}@{step['target']}" for step in result.get("steps") or []]
    return (*steps, *(f"bad@{pose}" for pose in sorted(left_out(result))))


def speaks_of_noise(result: Result) -> bool:
    """Whether it is said that the declared noise, or play, does not fit."""
    left = (result.get("unexplained") or {}).get("kind")
    return left == "declared_noise" or any(w["kind"] == "noise" for w in result["warnings"])
