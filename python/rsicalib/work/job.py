"""One call of a verb: its readings on the way to the core, its result on the way back."""

from __future__ import annotations

import os
from collections.abc import Collection, Iterable, Mapping, Sequence
from typing import Any

import numpy as np

from rsicalib import _core, options
from rsicalib._core import Mechanism
from rsicalib.errors import InputError, InputTypeError, UndeterminedError
from rsicalib.facts.digest import digest_of_drawing
from rsicalib.facts.shapes import Between, Parameter
from rsicalib.facts.warned import Warned
from rsicalib.io.frames import in_memory
from rsicalib.io.readings import Readings
from rsicalib.plain_text import meant
from rsicalib.results.result import Result
from rsicalib.work.applying import Known, as_applied, as_table, covariance_of, posed
from rsicalib.work.arguments import (
    Bare,
    CalibrationArg,
    MechanismArg,
    ReadingsArg,
    SessionsArg,
    earlier_result,
    grouped,
    load,
    names_in,
    noise_of_channels,
    open_mechanism,
)
from rsicalib.work.listening import ProgressArg, listener
from rsicalib.work.outcome import (
    beside_earlier,
    described,
    digest_of,
    labels_of,
    reference_of,
)
from rsicalib.work.prior import PopulationArg, expected_of, read_population

MOVED = 0.02
"""Readings of a rest pose that differ by more than this share of a channel's range are not of one
pose: a fixture holds it within a few counts."""


class Work:
    """One call of a verb."""

    def __init__(
        self,
        mechanism: MechanismArg,
        skip: bool,
        calibration: CalibrationArg | None,
        about: Mapping[str, str | None],
        population: PopulationArg | None = None,
    ) -> None:
        self.mechanism = open_mechanism(mechanism, calibration)
        self.population = (
            None if population is None else read_population(population, self.mechanism)
        )
        """What devices of the same design share."""
        self.skip = skip
        self.warnings: list[Warned] = []
        self.earlier: Result | None = None
        self.supersedes: str | None = None
        """Digest of the earlier result."""
        if calibration is not None:
            self.earlier, self.mechanism = earlier_result(
                calibration, self.mechanism, self.warnings
            )
            self.supersedes = digest_of(calibration, self.earlier)
        self.readings: list[Readings] = []
        """What is used, one for each session."""
        self.whole: list[Readings] = []
        """The same with the groups that are held out."""
        self.selected: tuple[list[str] | None, list[str] | None] | None = None
        """Groups to use, and to leave out."""
        self.checked: Readings | None = None
        """Readings of the check poses."""
        self.about = about
        """Device, note and date, by the keys of the result."""

    def take(
        self,
        readings: SessionsArg,
        fit_groups: Sequence[str] | None,
        hold_out_groups: Sequence[str] | None,
        known_poses: bool = False,
    ) -> None:
        """Load the sessions, and keep the groups that are asked for."""
        single = isinstance(readings, str | os.PathLike | Readings) or in_memory(readings)
        if not single and not isinstance(readings, Iterable):
            expected = "a path, readings, a data frame, an array, or a list of them"
            raise InputTypeError(f"readings: found {readings!r}, expected {expected}")
        several: Iterable[ReadingsArg] = [readings] if single else readings  # type: ignore[list-item, assignment]
        for one in several:
            loaded = load(one, self.mechanism, self.skip)
            self.warnings += loaded.warnings
            if loaded.poses is not None and not known_poses:
                text = (
                    f"{loaded.source}: known poses are not used here; "
                    "give them to `fixture`, or as check (--check)"
                )
                self.warnings.append(Warned("unused_poses", None, text))
            self.whole.append(loaded)
        keep = options.names("fit_groups", fit_groups, self._groups)
        leave = options.names("hold_out_groups", hold_out_groups, self._groups)
        self.selected = None if keep is None and leave is None else (keep, leave)
        self.readings = grouped(self.whole, keep, leave)
        if not self.readings:
            raise InputError("found no readings, expected at least one file")

    def _groups(self) -> list[str]:
        """Groups of all sessions."""
        return sorted({group for one in self.whole for group in one.keys.get("group", ())})

    @property
    def count(self) -> int:
        """Number of poses."""
        return sum(r.n_poses for r in self.readings)

    def has_unknown(self) -> bool:
        """Whether something stands unknown: with no term this is determined alone."""
        whole = self.mechanism.to_dict()
        things = [t for kind in ("point", "plane", "line", "frame") for t in whole.get(kind) or ()]
        return any(thing.get("unknown") is not None for thing in things)

    def terms(self, terms: Sequence[str] | None) -> list[str] | None:
        """As asked for; else those of the earlier result that hold beyond its session."""
        if terms is None and self.population is not None:
            return list(self.population["terms"])
        if terms is not None or self.earlier is None:
            return names_in("terms", terms, self.mechanism, none=self.has_unknown())
        return _core.lasting(self.mechanism, [p.at for p in self.earlier.parameters])

    def noise(self, noise: float | Mapping[str, float] | None) -> list[float] | None:
        """Standard deviation of one sample of each channel."""
        return noise_of_channels(noise, self.mechanism)

    def asked(
        self,
        rest: ReadingsArg | None,
        terms: Sequence[str] | None,
        closures: Sequence[str] | None,
        noise: float | Mapping[str, float] | None,
        progress: ProgressArg | None,
        search: Mapping[str, Any],
    ) -> _core.Session:
        """The session as the options of a verb ask for it; `search` is handed on."""
        chosen = {"closures": names_in("closures", closures, self.mechanism)}
        options = {**chosen, "noise": self.noise(noise), "progress": listener(progress), **search}
        return self.session(rest, self.terms(terms), options)

    def session(
        self,
        rest: ReadingsArg | None,
        terms: list[str] | None,
        options: dict[str, Any],
        *,
        anew: Collection[tuple[str, str, str | None]] = (),
    ) -> _core.Session:
        """The core's session; it does not begin with the effects `anew` of the earlier result."""
        mechanism = self.mechanism
        if self.earlier is not None:
            applied = as_applied(self.earlier, mechanism)
            # What channels share is fitted as it is reported: beside what is declared.
            own = {channel.name for channel in mechanism.channels}
            shared = {at for at, _, _ in applied["parameters"] if at[1] not in own}
            fitted = {at for at in shared if _core.spec(*at) in (terms or ())}
            begun = [p for p in applied["parameters"] if p[0] not in {*anew, *fitted}]
            mechanism = _core.calibrated_sensors(mechanism, {**applied, "parameters": begun})
        values = None
        if rest is not None:
            loaded = load(rest, Bare(self.mechanism), self.skip, "rest")
            self.warnings += loaded.warnings
            self.warnings += _moved(loaded, self.mechanism)
            values = loaded.values
        table = as_table(self.readings, self.mechanism)
        if self.population is not None:
            options = {**options, "expected": expected_of(self.population)}
        return _core.Session(mechanism, table, rest=values, terms=terms, **options)

    def known(
        self,
        check: ReadingsArg | None,
        point: str | None = None,
        noise: tuple[float | None, float | None] = (None, None),
        align: bool = False,
    ) -> Known | None:
        """Check poses, or check places of a point, as the core takes them.

        What is told of check poses is refused where there are none.
        """
        if check is None:
            told = {"check_point": point, "check_noise": noise[0], "check_noise_angle": noise[1]}
            told["align"] = align or None
            for name in (name for name, given in told.items() if given is not None):
                raise InputError(f"{name}: found no check, expected known poses (check) beside it")
            return None
        if point is not None:
            self._refuse_unless_carried(point)
        open_chains = point is not None or not self.mechanism.to_dict().get("platform")
        read_by = Bare(self.mechanism) if open_chains else self.mechanism
        loaded = load(check, read_by, self.skip, "check")
        self.warnings += loaded.warnings
        self.warnings += self._without(loaded)
        self.checked = loaded
        turned = loaded.poses is not None and np.isfinite(loaded.poses[:, 3:]).any()
        if point is not None and turned:
            found = f"{point!r} and poses with rx ry rz in {loaded.source}"
            raise InputError(f"check_point: found {found}, expected places x y z of the point")
        return posed(loaded, self.mechanism, point, (noise[0] or 0.0, noise[1] or 0.0))

    def _refuse_unless_carried(self, point: str) -> None:
        """Refuse the name of a point that no chain carries."""
        points = self.mechanism.to_dict().get("point") or ()
        known = [one["name"] for one in points if one.get("chain") is not None]
        if point not in known:
            found = f"{point!r}{meant(point, known)}"
            expected = f"a point that a chain carries: {', '.join(known) or 'there is none'}"
            raise InputError(f"check_point: found {found}, expected {expected}")

    def _without(self, check: Readings) -> list[Warned]:
        """Columns of laws that the sessions have and check poses have not."""
        read = {name for one in self.readings for name in one.columns}
        absent = [n for n in self.mechanism.optional_columns if n in read - {*check.columns}]
        if not absent:
            return []
        text = (
            f"{check.source}: known poses without the column{'s' * (len(absent) > 1)} "
            f"{', '.join(absent)}: laws that follow it are as at its mean in the session"
        )
        return [Warned("other", None, text)]

    def beside(self, known: Known | None, align: bool) -> dict[str, Any]:
        """What the core judges a calibration by, beside the readings that are fitted."""
        whole, groups = None, None
        if self.mechanism.key_columns:
            whole = as_table(self.whole, self.mechanism)
            if all("group" in r.keys for r in self.whole):
                groups = [text for r in self.whole for text in r.keys["group"]]
        keep, leave = self.selected or (None, None)
        own = len(self.whole) == len(self.readings)  # else sessions have other numbers here
        return {
            "mechanism": self.mechanism,
            "declared": as_applied(None, self.mechanism),
            "known": known,
            "align": align,
            "whole": whole,
            "groups": groups,
            "keep": keep,
            "leave": leave,
            "own": own,
        }

    def error(self, known: Known, result: Result | None, align: bool) -> dict[str, Any]:
        """Error of a result on check poses."""
        applied = as_applied(result, self.mechanism)
        return _core.check(self.mechanism, applied, known, align=align)

    def nominal_error(self, known: Known, *, align: bool) -> dict[str, Any]:
        """Error of the mechanism as it is declared."""
        return self.error(known, None, align)

    def result(
        self, kind: type[Result], found: dict[str, Any], session: _core.Session | None
    ) -> dict[str, Any]:
        """What the core found, with what only we know."""
        readings = self.readings
        reference = reference_of(readings) if session is None else session.reference()
        out = {
            "format": kind.FORMAT,
            "version": _core.__version__,
            "mechanism": self.mechanism.name,
            "made_from": self.mechanism,
            "length_unit": self.mechanism.length_unit,
            **self.about,
            "drawing": digest_of_drawing(self.mechanism),
            "readings": described(readings),
            **found,
            "warnings": [
                *(warned.to_dict() for warned in self.warnings),
                *found.get("warnings", []),
                *found.get("remarks", []),
            ],
            "reference": found.get("reference") or reference,
        }
        labels = labels_of(self.mechanism)
        if labels:
            out["labels"] = labels
        laws = [term.to_dict() for term in self.mechanism.terms]
        if laws:
            out["laws"] = laws
        if self.earlier is not None:
            new = [
                p if isinstance(p, Parameter) else Parameter.from_dict(p) for p in out["parameters"]
            ]
            told = beside_earlier(self.mechanism, self.earlier, new, _between(out))
            out["parameters"], out["moved"] = told
            out["supersedes"] = self.supersedes
        return out

    def update(self, found: Mapping[str, Any], fit: str) -> dict[str, Any] | None:
        """What has changed since the earlier result; None where that cannot be told.

        `fit` says where the fit of the result stands in what the core found.
        """
        if self.earlier is None or found["verdict"] in ("implausible", "undetermined"):
            return None  # there is nothing that could have changed to it
        applied = as_applied(self.earlier, self.mechanism)
        held_out = found[fit].get("held_out")
        rms = None if held_out is None else held_out["rms_misclosure"]
        source: _core.EvidenceSource = found["source"]
        try:
            covariance = covariance_of(self.earlier, beside=_between(found))
            update: dict[str, Any] = source.changes(applied, covariance, rms)
        except InputError:
            return None  # they have no parameter in common
        return update

    def too_few(
        self, kind: type[Result], error: UndeterminedError, session: _core.Session | None
    ) -> dict[str, Any]:
        """A result that only says why there is none."""
        found = _core.judged_open_loop() | {"unobservable": [error.message], "noise": None}
        found |= {"parameters": [], "covariance": [], "termination": "not begun"}
        return self.result(kind, found, session)


def _between(found: Mapping[str, Any]) -> Between | None:
    """What changes from group to group, by what the core found."""
    between = found.get("between")
    return Between.from_dict(between) if isinstance(between, Mapping) else between


def _moved(rest: Readings, mechanism: Mechanism) -> list[Warned]:
    """A warning where the readings of the rest pose are not of one pose."""
    for channel, low, high in zip(
        mechanism.channels, rest.values.min(axis=0), rest.values.max(axis=0), strict=True
    ):
        if channel.range is not None and high - low > MOVED * (channel.range[1] - channel.range[0]):
            text = (
                f"{rest.source}: the readings of the rest pose differ by {high - low:.0f} "
                f"{channel.unit} in {channel.name}, and their mean is taken: is it the right file?"
            )
            return [Warned("moved_rest", channel.name, text)]
    return []
