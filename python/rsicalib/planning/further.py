"""Poses to visit after a session: beside its readings, under its result."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from rsicalib import _core
from rsicalib._core import Mechanism
from rsicalib.arrays import FloatArray
from rsicalib.errors import InputError
from rsicalib.facts.shapes import Name
from rsicalib.plain_text import counted
from rsicalib.planning.plans import Forecast, Plan
from rsicalib.planning.purposes import reason
from rsicalib.planning.worthwhile import how_many, worth_words
from rsicalib.poses.devices import Within
from rsicalib.report.words import NO_TERM, subject
from rsicalib.results.result import Result, Trace
from rsicalib.work.arguments import CalibrationArg, MechanismArg, SessionsArg
from rsicalib.work.job import Work
from rsicalib.work.outcome import described

Explained = tuple[list[str], float, float]
"""Effects, penalised χ², probability."""


@dataclass(frozen=True)
class Choice:
    """How poses are chosen; None is as in Rust."""

    poses: int
    criterion: str | None = None
    within: Within | None = None
    candidates: int | None = None
    off: FloatArray | None = None
    from_: FloatArray | None = None
    way: float | None = None
    seed: int = 0
    target: float | None = None

    def options(self) -> dict[str, Any]:
        """As the core takes them."""
        within = None if self.within is None else [(float(a), float(b)) for a, b in self.within]
        return {**vars(self), "within": within}


class Sessions:
    """Readings with their result, ready to be planned beside."""

    def __init__(
        self, readings: SessionsArg, result: CalibrationArg, mechanism: MechanismArg = "rsi"
    ) -> None:
        job = Work(mechanism, False, result, {})
        assert job.earlier is not None
        self.result: Result = job.earlier
        job.skip = bool(self.result.readings.skipped)  # its readings, without the same rows
        job.take(readings, None, None)
        self.mechanism: Mechanism = job.mechanism
        digest = described(job.readings).sha256
        if digest != self.result.readings.sha256:
            source = ", ".join(r.source for r in job.readings)
            expected = f"the readings of the result, SHA-256 {self.result.readings.sha256}"
            raise InputError.at(source, f"readings with SHA-256 {digest}", expected)
        self.readings = job.readings
        noise = self.result.noise
        declared = noise is not None and noise.kind == "declared"
        sigma = dict(noise.sigma) if noise is not None and declared else None
        self.base = base_terms(self.result)
        # Each explanation has its own effects: none begins with those of the best.
        found = [(s.term, s.target, s.place) for s in getattr(self.result, "steps", ())]
        self.session = job.session(None, self.base, {"noise": job.noise(sigma)}, anew=found)

    @property
    def left_out(self) -> list[int]:
        """Rows that the result leaves out."""
        pose = np.concatenate([r.pose for r in self.readings])
        rows = [len(r.pose) for r in self.readings]
        session = np.repeat(np.arange(1, len(rows) + 1), rows)
        first = np.r_[True, (pose[1:] != pose[:-1]) | (session[1:] != session[:-1])]
        starts = np.flatnonzero(first)
        sample = np.arange(len(pose)) - np.repeat(starts, np.diff(np.r_[starts, len(pose)])) + 1
        keys = self.mechanism.key_columns
        group = [g for r in self.readings for g in r.keys[keys[0]]] if keys else []
        out = np.zeros(len(pose), dtype=bool)
        for bad in self.result.excluded:
            if bad.pose is None:
                out |= np.array([g == bad.group for g in group]) if keys else False
            else:
                own = pose == bad.pose
                if bad.session is not None:
                    own &= session == bad.session
                out |= own if bad.sample is None else own & (sample == bad.sample)
        return [int(row) for row in np.flatnonzero(out)]

    @property
    def next_label(self) -> int:
        """Label of a pose after those of the sessions."""
        return int(max(r.pose.max() for r in self.readings)) + 1


def base_terms(result: Result) -> list[str]:
    """Terms that a result began with, as `terms=[…]` takes them."""
    steps = [(s.term, s.target, s.place) for s in getattr(result, "steps", ())]
    bad = (*_core.UNKNOWN_THINGS, "bad_reading")
    kept = [p.spec for p in result.parameters if p.at not in steps and p.term not in bad]
    return list(dict.fromkeys(kept))


def explanations(result: Result) -> list[tuple[tuple[Name, ...], float, float]]:
    """Effects, penalised χ² and probability of each explanation by terms, the best first."""
    if not isinstance(result, Trace) or not result.steps:
        return []
    # Nothing can be predicted by what is no term.
    rivals = [r for r in result.rivals if all(t.term not in NO_TERM for t in r.terms)]
    if rivals:
        return [(r.terms, r.chi2_penalised, r.probability) for r in rivals]
    steps = tuple(
        Name(term=s.term, klass=s.klass, target=s.target, place=s.place) for s in result.steps
    )
    return [(steps, 0.0, 1.0)]


def words(terms: Sequence[Name]) -> str:
    """Effects in words."""
    return " + ".join(map(subject, terms)) or "nothing"


def plan_further(sessions: Sessions, choice: Choice) -> Plan:
    """Choose poses to visit after sessions: see `rsicalib.plan`."""
    rivals = explanations(sessions.result)
    specs: list[Explained] = [
        ([_core.spec(t.term, t.target, t.place) for t in terms], chi2, probability)
        for terms, chi2, probability in rivals
    ]
    options = choice.options()
    found = _core.further(sessions.session, specs, left_out=sessions.left_out, **options)
    needs_length = any(step.needs_length for step in getattr(sessions.result, "steps", ()))
    advice = worth_words(found, [t for t, _, _ in rivals], needs_length=needs_length)
    if choice.target is not None:
        advice = _standing(found, choice.target, sessions.mechanism.length_unit, advice)
    names = [words(terms) for terms, _, _ in rivals]
    merged = tuple(
        f"no pose within reach tells {names[b]} from {names[a]}" for b, a in found["merged"]
    )
    if not all(found["worth"]):
        found = _without(found, found["worth"])
    keys = dict(zip(sessions.mechanism.key_columns, map(tuple, found["keys"]), strict=True))
    unit = sessions.mechanism.length_unit
    seconds = _session_seconds(sessions)
    why = [
        _pause(wait, seconds) + reason(purpose, names, unit)
        for wait, purpose in zip(found["waits"], found["purposes"], strict=True)
    ]
    return Plan(
        mechanism=sessions.mechanism.name,
        length_unit=unit,
        criterion=found["criterion"],
        seed=choice.seed,
        channels=tuple(c.name for c in sessions.mechanism.channels),
        poses=found["poses"],
        readings=found["readings"],
        why=tuple(why),
        keys=keys,
        waits=tuple(found["waits"]) if any(found["waits"]) else (),
        first=sessions.next_label,
        merged=merged,
        forecast=_forecast(found["forecast"]),
        advice=advice,
    )


def _standing(
    found: Mapping[str, Any], target: float, unit: str, advice: tuple[str, ...]
) -> tuple[str, ...]:
    """How a plan stands to its target, in words, before what is said of its poses."""
    standing, count = found["standing"], len(found["worth"])
    before, after = (sd["position"] for sd in found["forecast"]["platform_sd"])
    if standing["kind"] == "already":
        return (f"No more poses are needed: {before:.2g} {unit} already.",)
    if standing["kind"] == "reached":
        more = f"{counted(count, 'more pose')} bring{'s' * (count == 1)}"
        return f"{more} it to {after:.2g} {unit}.", *advice
    known = math.inf if after is None or math.isnan(after) else after
    would = f"{counted(count, 'pose')} would bring it to {known:.2g} {unit}, not to {target:g}"
    return would + how_many(standing["needed"], count), *advice


def _without(found: Mapping[str, Any], worth: Sequence[bool]) -> dict[str, Any]:
    """A plan without the poses that are not worth a visit."""
    kept = [k for k, own in enumerate(worth) if own]
    out = dict(found)
    out["poses"] = found["poses"][kept] if len(found["poses"]) else found["poses"]
    out["readings"] = found["readings"][kept]
    out["keys"] = [[column[k] for k in kept] for column in found["keys"]]
    for key in ("waits", "purposes"):
        out[key] = [found[key][k] for k in kept]
    return out


def _session_seconds(sessions: Sessions) -> float | None:
    times = sessions.readings[-1].time_s
    return None if times is None else float(times.max() - times.min())


def _pause(wait: float, seconds: float | None) -> str:
    if wait == 0.0:
        return ""
    if seconds is None:
        return f"wait {wait:g} of the session first; "
    return f"wait {wait * seconds / 60:.3g} min first; "


def _forecast(found: Mapping[str, Any]) -> Forecast:
    def ends(pair: Sequence[Any] | None) -> dict[str, Any] | None:
        return None if pair is None else {"before": pair[0], "after": pair[1]}

    return Forecast.from_dict(
        {
            "decides": found["decides"],
            "least_lambda": found["least_lambda"],
            "platform_sd": ends(found["platform_sd"]),
            "worst_hidden": ends(found["worst_hidden"]),
        }
    )
