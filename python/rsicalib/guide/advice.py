"""What to measure next, how good the calibration is, and what looks wrong."""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np

from rsicalib import _core
from rsicalib._core import Mechanism
from rsicalib.arrays import FloatArray
from rsicalib.errors import RsicalibError
from rsicalib.exports.coordinates import factor_of
from rsicalib.facts.records import plain
from rsicalib.facts.shapes import Name, Step
from rsicalib.facts.warned import WIRING, Warned
from rsicalib.guide.log import Sample, Taken
from rsicalib.io.readings import Readings
from rsicalib.planning.further import explanations, words
from rsicalib.planning.purposes import gain_of, reason
from rsicalib.results.result import Trace
from rsicalib.verbs.certifying import certify
from rsicalib.verbs.tracing import trace
from rsicalib.work.applying import as_applied, as_table

WAY = 0.1
"""Weight of the way to the next pose, beside ln(variance after / variance before)."""
OFFSET_SD = 0.1
"""What is known of an offset before anything is measured [rad]."""
GAIN_SD = 0.05
"""What is known of a gain, as a fraction of it."""
REST_SD = 0.1
"""What is known of where the rest pose holds the platform, as a fraction of its longest side."""


@dataclass(frozen=True)
class Repeat:
    """A pose that is to be measured again, and why."""

    label: int
    why: str


@dataclass(frozen=True)
class Explained:
    """An explanation that is open: what it is called by programs, and in words."""

    id: str
    text: str

    def state(self) -> dict[str, str]:
        """Plain values for a page."""
        return {"id": self.id, "text": self.text}


@dataclass(frozen=True)
class Advice:
    """What the poses so far say.

    `pose` [length unit, rad] and `readings` are where to go next, `why` is what for; `sd` is the
    standard deviation of the platform now, `sd_next` with the next pose [length unit].
    """

    pose: FloatArray | None = None
    readings: FloatArray | None = None
    keys: tuple[str, ...] = ()
    """What the next pose touches: a text for each text column."""
    why: str = ""
    criterion: str = ""
    sd: float | None = None
    sd_next: float | None = None
    result: Trace | None = None
    measured: Readings | None = None
    """What `result` is a trace of."""
    open: tuple[Explained, ...] = ()
    troubles: tuple[Warned, ...] = ()
    repeat: tuple[Repeat, ...] = ()
    closure: float | None = None
    """Error of the closures in the poses that are kept out [length unit]."""
    closure_fitted: float | None = None
    """The same in the poses that are fitted."""
    wait_s: float = 0.0
    largest: float | None = None
    """Bound of 95 % of the largest error over the workspace, of one reading, once the target is
    reached [length unit]: as `certify` has it."""
    gain: float | None = None
    """By how much the next pose parts what is open [χ²]; None where it has another purpose."""


@dataclass
class Adviser:
    """Plans and traces what was measured."""

    mechanism: Mechanism
    rest: Readings | None
    seed: int = 0
    prior: Mechanism = field(init=False)
    mistake: Warned | None = None
    """What is wrong with the wires, once it shows."""

    def __post_init__(self) -> None:
        self.prior = _with_priors(self.mechanism, self.rest)

    @property
    def exchanged(self) -> tuple[str, str] | None:
        """Two channels whose wires are exchanged; None where that is not what is wrong."""
        if self.mistake is None or self.mistake.kind != "exchanged":
            return None
        one, other = self.mistake.targets
        return one, other

    def exchange(self, one: str, other: str) -> None:
        """Take the rest reading of one channel for the other's, as the log does with the poses."""
        self.mistake = None
        if self.rest is None:
            return
        a, b = map([c.name for c in self.mechanism.channels].index, (one, other))
        values = self.rest.values.copy()
        values[:, [a, b]] = values[:, [b, a]]
        self.rest = replace(self.rest, values=values)
        self.prior = _with_priors(self.mechanism, self.rest)

    def advise(
        self,
        taken: Taken,
        here: Sequence[float] | None,
        off: Sequence[Sequence[float]],
        target: float,
    ) -> Advice:
        """Trace the poses so far, and choose the next one.

        Parameters
        ----------
        taken : Taken
            Poses to fit, and those that check the closure.
        here : sequence of float or None
            Reading of where the handle is.
        off : sequence of sequence of float
            Readings of poses that the operator struck off.
        target : float
            Standard deviation of the platform from which on poses decide what is open [length
            unit].

        Returns
        -------
        Advice
            With what is wrong, as warnings.
        """
        readings = self.readings(taken) if taken.fitted else None
        result = None if self.mistake else self._traced(readings, taken)
        if not usable(result) and self.mistake is None:
            self.mistake = self._mistake(readings)
            result = None if self.mistake else result
        rivals = [] if result is None else explanations(result)
        planned = self._planned(taken, result, here, off, decide=False)
        sure = planned.get("sd")
        if sure is not None and sure <= target and len(rivals) > 1:
            planned = self._planned(taken, result, here, off, decide=True)
        check = self._closures(result, taken)
        many = len(rivals) > 1
        return Advice(
            **planned,
            result=result,
            measured=None if result is None else readings,
            open=tuple(_explained(terms) for terms, _, _ in rivals) if many else (),
            repeat=_repeats(result),
            closure=check[1],
            closure_fitted=check[0],
            largest=self._largest(result, target) if sure is not None and sure <= target else None,
        )

    def _largest(self, result: Trace | None, target: float) -> float | None:
        """The largest error over the workspace that a certificate would state."""
        if result is None or not usable(result):
            return None
        try:
            found = certify(result, self.mechanism, limit=target)
        except RsicalibError:  # nothing is carried, or no workspace is known
            return None
        return None if found.uncertainty is None else found.uncertainty.expanded

    def _mistake(self, readings: Readings | None) -> Warned | None:
        """What is wrong with the wires, where no trace explains the poses."""
        if self.rest is None or readings is None:
            return None
        mechanism = _with_gains(self.mechanism)
        table = as_table([readings], mechanism)
        try:
            wires = _core.Session(mechanism, table, rest=self.rest.values).fit().wires
            return None if wires is None else Warned.from_dict(wires)
        except RsicalibError:
            return None

    def at_the_end(self, taken: Taken) -> Trace | None:
        """The result of poses that are fewer than advice waits for, once no more come."""
        if self.mistake is not None or not taken.fitted:
            return None
        return self._trace(self.readings(taken))

    def _trace(self, readings: Readings) -> Trace | None:
        try:
            return trace(readings, self.mechanism, rest=self.rest)
        except RsicalibError:
            return None

    def _traced(self, readings: Readings | None, taken: Taken) -> Trace | None:
        touched = {samples[0].keys for samples in taken.fitted.values()} - {()}
        enough = _core.traceable(self.mechanism, len(taken.fitted), len(touched))
        return None if readings is None or not enough else self._trace(readings)

    def readings(self, taken: Taken, *, checked: bool = False) -> Readings:
        """The poses to fit, of the session as it was taken; with those that are `checked`, too."""
        rows = taken.rows()
        labels = {*taken.fitted, *(taken.kept_out if checked else ())}
        warm = [s.temperature_c for _, s in rows]
        return Readings.from_arrays(
            self.mechanism,
            np.array([s.values for _, s in rows]),
            pose=np.array([label for label, _ in rows]),
            time_s=np.array([s.time_s for _, s in rows]),
            temperature_c=None if None in warm else np.array(warm, dtype=np.float64),
            keys={
                name: [s.keys[k] for _, s in rows]
                for k, name in enumerate(self.mechanism.key_columns)
            },
            used=np.array([label in labels for label, _ in rows]),
        )

    def _session(
        self, taken: Taken, result: Trace | None, starts: int | None = None
    ) -> _core.Session:
        """The poses for planning; before they are enough, the rest pose is one of them."""
        poses = dict(taken.fitted)
        if result is None and self.rest is not None:
            first = min((s[0].time_s for s in poses.values()), default=0.0)
            at_rest = [Sample(first - 1.0, _warmth(poses), tuple(row)) for row in self.rest.values]
            poses[0] = at_rest
        if not poses:
            middle = tuple(_middle(self.prior))
            poses[0] = [Sample(0.0, None, middle)] * 2
        table = as_table([self.readings(replace(taken, fitted=poses))], self.mechanism)
        # What no pose can show would be as uncertain as its prior for ever.
        hidden = result is not None and bool(result.unobservable)
        return _core.Session(self.mechanism if hidden else self.prior, table, starts=starts)

    def _planned(
        self,
        taken: Taken,
        result: Trace | None,
        here: Sequence[float] | None,
        off: Sequence[Sequence[float]],
        decide: bool,
    ) -> dict[str, Any]:
        fitted = taken.fitted
        if not fitted and self.mechanism.key_columns:
            return {}  # what there is to touch is known from the first poses
        session = self._session(taken, result)
        rivals = [] if result is None else explanations(result)
        specs = [
            ([_core.spec(t.term, t.target, t.place) for t in terms], chi2, probability)
            for terms, chi2, probability in rivals
        ]
        options: dict[str, Any] = {
            "poses": 1,
            "left_out": [],
            "off": np.array(off, dtype=np.float64) if len(off) else None,
            "from_": None if here is None else np.array(here, dtype=np.float64),
            "way": WAY,
            "seed": self.seed + len(fitted),
        }
        criterion = "decide" if decide else "platform"
        found = None
        for attempt in (criterion, "platform"):
            try:
                found = _core.further(session, specs, criterion=attempt, **options)
                break
            except RsicalibError:
                specs = specs if attempt == "decide" else []
        if found is None:
            return {"troubles": self._troubles(_warned(session))}
        spread = found["forecast"]["platform_sd"]
        names = [words(terms) for terms, _, _ in rivals]
        return {
            "pose": found["poses"][0] if len(found["poses"]) else None,
            "readings": found["readings"][0],
            "keys": tuple(column[0] for column in found["keys"]),
            "why": reason(found["purposes"][0], names, self.mechanism.length_unit),
            "criterion": found["criterion"],
            "gain": gain_of(found["purposes"][0]),
            "sd": _known(spread[0]["position"]),
            "sd_next": _known(spread[1]["position"]),
            "wait_s": found["waits"][0] * _length_s(fitted),
            "troubles": self._troubles(
                w
                for w in (_warned(session) if result is None else result.warnings)
                if w.kind in WIRING
            ),
        }

    def _troubles(self, warnings: Iterable[Warned]) -> tuple[Warned, ...]:
        """Warnings; of wires that are wrong nothing else makes sense."""
        return tuple(warnings) if self.mistake is None else (self.mistake,)

    def _closures(self, result: Trace | None, taken: Taken) -> tuple[float | None, float | None]:
        """How the loops close in the poses that are fitted, and in those that are kept out."""
        if result is None or result.reference is None or result.noise is None or not taken.kept_out:
            return None, None
        readings = self.readings(taken, checked=True)
        table, applied = as_table([readings], self.mechanism), as_applied(result, self.mechanism)

        def closed(poses: Iterable[int]) -> float | None:
            counted = np.isin(readings.pose, list(poses)).tolist()
            return _core.rms_misclosure(self.mechanism, applied, table, counted)

        return closed(taken.fitted), closed(taken.kept_out)


def explained_id(terms: Sequence[Name | Step]) -> str:
    """What an explanation is called by programs: its effects, in whatever order they were found."""
    return "+".join(sorted(_core.spec(t.term, t.target, t.place) for t in terms))


def _explained(terms: Sequence[Name]) -> Explained:
    return Explained(explained_id(terms), words(terms))


def _known(sd: float | None) -> float | None:
    return None if sd is None or not math.isfinite(sd) else float(sd)


def _gain_sd(mechanism: Mechanism) -> float:
    return GAIN_SD * float(np.median([abs(c.gain) for c in mechanism.channels]))


def _with_gains(mechanism: Mechanism) -> Mechanism:
    """The mechanism with weak knowledge of its gains and its rest pose: it tells wires apart."""
    drawing = mechanism.to_dict()
    model = drawing.setdefault("model", {})
    model["sd"] = {"gain": _gain_sd(mechanism), **model.get("sd", {})}
    sides = [c["value"] for c in drawing["closure"] if isinstance(c.get("value"), int | float)]
    if drawing.get("rest") and sides:
        drawing["rest"].setdefault("sd", REST_SD * max(sides))
    return _core.Mechanism.from_dict(plain(drawing))


def _with_priors(mechanism: Mechanism, rest: Readings | None) -> Mechanism:
    """The mechanism with weak knowledge of its sensors, its offsets as of the rest reading."""
    drawing = mechanism.to_dict()
    model = drawing.setdefault("model", {})
    known = {"offset": OFFSET_SD, "gain": _gain_sd(mechanism)}
    model["sd"] = {**known, **model.get("sd", {})}
    if rest is not None and drawing.get("rest"):
        angles = mechanism.inverse(drawing["rest"]["pose"])
        read = rest.values.mean(axis=0)
        own = zip(drawing["channel"], mechanism.channels, angles, read, strict=True)
        for channel, of, angle, reading in own:
            channel["offset"] = float(angle - of.gain * reading) / factor_of(channel)
    return _core.Mechanism.from_dict(plain(drawing))


def _middle(mechanism: Mechanism) -> list[float]:
    """Readings of the rest pose by the drawing, or of the middle of every range."""
    drawing = mechanism.to_dict()
    if drawing.get("rest"):
        angles = mechanism.inverse(drawing["rest"]["pose"])
        pairs = zip(mechanism.channels, angles, strict=True)
        return [float((angle - c.offset) / c.gain) for c, angle in pairs]
    return [sum(c.range) / 2 if c.range else 0.0 for c in mechanism.channels]


def _warmth(poses: Mapping[int, Sequence[Sample]]) -> float | None:
    every = [s.temperature_c for samples in poses.values() for s in samples]
    return every[0] if every else None


def _length_s(poses: Mapping[int, Sequence[Sample]]) -> float:
    times = [s.time_s for samples in poses.values() for s in samples]
    return max(times) - min(times) if times else 0.0


def usable(result: Trace | None) -> bool:
    """Whether a result explains its poses: a single one can be wrong where the others fit."""
    return result is not None and result.exit_code == 0


def _repeats(result: Trace | None) -> tuple[Repeat, ...]:
    if result is None or not usable(result):
        return ()
    return tuple(
        Repeat(bad.pose, f"pose {bad.pose} does not fit the others: {bad.reason}")
        for bad in result.excluded
        if bad.pose is not None
    )


def _warned(session: _core.Session) -> Iterator[Warned]:
    return map(Warned.from_dict, session.fit().warnings)
