"""What the verbs share: readings and options on their way to the core, results on the way back."""

from __future__ import annotations

import hashlib
import math
import os
from collections.abc import Iterable, Mapping, Sequence
from statistics import NormalDist
from typing import Any, TypeAlias

import numpy as np
import numpy.typing as npt

from rsicalib import _core
from rsicalib.io import readings as data
from rsicalib._core import Mechanism
from rsicalib.io.readings import Readings
from rsicalib.errors import InputError, UndeterminedError, Where
from rsicalib.io.mechanisms import load_mechanism_text
from rsicalib.records import plain
from rsicalib.results import ALPHA, Data, Moved, Parameter, Result, load_calibration
from rsicalib.work.signs import mark_unphysical

__all__ = [
    "NOTHING",
    "Bare",
    "CalibrationArg",
    "FloatArray",
    "MechanismArg",
    "PathLike",
    "ReadingsArg",
    "SessionsArg",
    "Work",
    "as_applied",
    "as_table",
    "earlier_result",
    "listed",
    "load",
    "open_mechanism",
    "posed",
]

FloatArray = npt.NDArray[np.float64]
PathLike: TypeAlias = str | os.PathLike[str]
MechanismArg: TypeAlias = PathLike | Mechanism
ReadingsArg: TypeAlias = PathLike | Readings
SessionsArg: TypeAlias = ReadingsArg | Sequence[ReadingsArg]
CalibrationArg: TypeAlias = PathLike | Result
Known: TypeAlias = tuple[dict[str, Any], FloatArray]

TIME_BOUND = {"data", "order in time"}
"""A class, and a need, of terms that belong to one session alone."""

NOTHING: dict[str, Any] = {"chi2": None, "dof": None, "p_value": None, "rms_misclosure": None}
"""A fit of which nothing is known but its error on known poses."""


def open_mechanism(name_or_path: MechanismArg) -> Mechanism:
    """A mechanism by name, from a file, or as it is."""
    if isinstance(name_or_path, Mechanism):
        return name_or_path
    text = load_mechanism_text(name_or_path)
    if text is None:
        return Mechanism.rsi()
    try:
        return Mechanism.from_toml(text)
    except InputError as error:
        file = os.fspath(name_or_path)
        where = Where(file=file, line=None, column=None, found=None, expected=None)
        raise InputError(f"{file}: {error.message}", where) from None


class Work:
    """One call of a verb."""

    def __init__(
        self, mechanism: MechanismArg, skip: bool, calibration: CalibrationArg | None
    ) -> None:
        self.mechanism = open_mechanism(mechanism)
        self.skip = skip
        self.earlier = None if calibration is None else earlier_result(calibration, self.mechanism)
        self.readings: list[Readings] = []
        """What is used, one for each session."""
        self.whole: list[Readings] = []
        """The same with the groups that are held out."""
        self.selected: tuple[list[str] | None, list[str] | None] | None = None
        """Groups to use, and to leave out."""
        self.warnings: list[str] = []

    def take(
        self,
        readings: SessionsArg,
        fit_groups: Sequence[str] | None,
        hold_out_groups: Sequence[str] | None,
        known_poses: bool = False,
    ) -> None:
        """Load the sessions, and keep the groups that are asked for."""
        keep, leave = listed(fit_groups), listed(hold_out_groups)
        self.selected = None if keep is None and leave is None else (keep, leave)
        single = isinstance(readings, str | os.PathLike | Readings)
        several: Iterable[ReadingsArg] = [readings] if single else readings  # type: ignore[list-item, assignment]
        for one in several:
            loaded = load(one, self.mechanism, self.skip)
            self.warnings += loaded.warnings
            if loaded.poses is not None and not known_poses:
                self.warnings.append(
                    f"{loaded.source}: known poses are not used here; "
                    "give them to `fixture`, or as check (--check)"
                )
            self.whole.append(loaded)
        self.readings = _grouped(self.whole, keep, leave)
        if not self.readings:
            raise InputError("found no readings, expected at least one file")

    @property
    def count(self) -> int:
        """Number of poses."""
        return sum(r.n_poses for r in self.readings)

    def terms(self, terms: Sequence[str] | None) -> list[str] | None:
        """As asked for; else those of the earlier result that hold beyond its session."""
        if terms is not None or self.earlier is None:
            return listed(terms)
        lasting = _lasting(self.earlier, self.mechanism)
        return list(dict.fromkeys(p.spec for p in lasting))

    def noise(self, noise: float | Mapping[str, float] | None) -> list[float] | None:
        """One standard deviation for each channel."""
        if noise is None:
            return None
        names = [channel.name for channel in self.mechanism.channels]
        if isinstance(noise, Mapping):
            unknown = [name for name in noise if name not in names]
            own = {c.name: c.noise for c in self.mechanism.channels if c.noise is not None}
            sigma = {**own, **noise}
            missing = [name for name in names if name not in sigma]
            if unknown or missing:
                what = f"no channel {unknown[0]!r}" if unknown else f"none for {missing[0]!r}"
                raise InputError(
                    f"noise: found {what}, expected one for each of {', '.join(names)}"
                )
        else:
            sigma = dict.fromkeys(names, noise)
        for name, value in sigma.items():
            if not (np.isfinite(value) and value > 0.0):
                raise InputError(f"noise of {name}: found {value}, expected a number above zero")
        return [float(sigma[name]) for name in names]

    def session(
        self, rest: ReadingsArg | None, terms: list[str] | None, options: dict[str, Any]
    ) -> _core.Session:
        """The core's session."""
        mechanism = self.mechanism
        if self.earlier is not None:
            mechanism = mechanism.with_sensors(_sensors(self.earlier, mechanism))
        values = None
        if rest is not None:
            loaded = load(rest, Bare(self.mechanism), self.skip)
            self.warnings += loaded.warnings
            values = loaded.values
        table = as_table(self.readings, self.mechanism)
        return _core.Session(mechanism, table, rest=values, terms=terms, **options)

    def known(self, check: ReadingsArg | None) -> Known | None:
        """Check poses, as the core takes them."""
        if check is None:
            return None
        loaded = load(check, self.mechanism, self.skip)
        self.warnings += loaded.warnings
        return posed(loaded, self.mechanism)

    def error(self, known: Known, result: Result | None, align: bool) -> dict[str, Any]:
        """Error of a result on check poses."""
        applied = as_applied(result, self.mechanism)
        error: dict[str, Any] = _core.check(self.mechanism, applied, *known, align=align)
        return error

    def nominal_error(self, known: Known, *, align: bool) -> dict[str, Any]:
        """Error of the mechanism as it is declared."""
        return self.error(known, None, align)

    def by_pose(self, whitened: FloatArray) -> FloatArray:
        """Residuals of poses from those of samples, in units of noise: (poses, equations)."""
        first = [_first_rows(r.pose, len(r)) for r in self.readings]
        ends = np.cumsum([0] + [len(r) for r in self.readings])
        starts = np.concatenate([f + end for f, end in zip(first, ends, strict=False)])
        sizes = np.diff(np.append(starts, len(whitened)))
        sums: FloatArray = np.add.reduceat(whitened, starts, axis=0)
        out: FloatArray = sums / np.sqrt(sizes)[:, None]
        return out

    def result(
        self, kind: type[Result], found: dict[str, Any], session: _core.Session | None
    ) -> dict[str, Any]:
        """What the core found, with what only we know."""
        readings = self.readings
        reference = _reference(readings) if session is None else session.reference()
        out = {
            "format": kind.FORMAT,
            "version": _core.__version__,
            "mechanism": self.mechanism.name,
            "length_unit": self.mechanism.length_unit,
            "readings": _described(readings),
            **found,
            "warnings": [*self.warnings, *found.get("warnings", [])],
            "reference": reference,
        }
        out["warnings"] += mark_unphysical(out, _terms(self.mechanism))
        if self.earlier is not None:
            new = [
                p if isinstance(p, Parameter) else Parameter.from_dict(p) for p in out["parameters"]
            ]
            known = _terms(self.mechanism)
            out["moved"] = _moved(self.earlier, [p for p in new if p.term in known])
        return out

    def too_few(
        self, kind: type[Result], error: UndeterminedError, session: _core.Session | None
    ) -> dict[str, Any]:
        """A result that only says why there is none."""
        found = {"verdict": "undetermined", "unobservable": [error.message], "noise": None}
        found |= {"parameters": [], "covariance": [], "termination": "not begun"}
        return self.result(kind, found, session)


def listed(names: Sequence[str] | None) -> list[str] | None:
    if isinstance(names, str):
        raise InputError(f"found {names!r}, expected a sequence of names such as [{names!r}]")
    return None if names is None else list(names)


def load(readings: ReadingsArg, mechanism: Any, skip: bool) -> Readings:
    if not isinstance(readings, Readings):
        return data.load_readings(readings, mechanism, skip_bad_rows=skip)
    names = tuple(channel.name for channel in mechanism.channels)
    if readings.channels != names:
        found, expected = ", ".join(readings.channels), ", ".join(names)
        raise InputError.at(readings.source, found=f"channels {found}", expected=expected)
    return readings


class Bare:
    """A mechanism of which only the channels count: to read a rest pose, or to apply a result."""

    def __init__(self, mechanism: Mechanism) -> None:
        self.name = mechanism.name
        self.channels = mechanism.channels
        self.key_columns: list[str] = []
        self.value_columns: list[str] = []


def _grouped(
    readings: list[Readings], keep: list[str] | None, leave: list[str] | None
) -> list[Readings]:
    """The rows of the groups to use; a session without any is left out."""
    if keep is None and leave is None:
        return list(readings)
    for one in readings:
        if "group" not in one.keys:
            expected = "a column 'group' to choose from (--fit-groups, --hold-out-groups)"
            found = "no such column"
            raise InputError.at(one.source, column="group", found=found, expected=expected)
    known = list(dict.fromkeys(g for one in readings for g in one.keys["group"]))
    source = ", ".join(one.source for one in readings)
    for name in [*(keep or []), *(leave or [])]:
        if name not in known:
            found, expected = f"no group {name!r}", f"one of {', '.join(known)}"
            raise InputError.at(source, column="group", found=found, expected=expected)
    used = {g for g in known if (keep is None or g in keep) and (leave is None or g not in leave)}
    masks = [np.array([g in used for g in one.keys["group"]]) for one in readings]
    kept = [one.select(mask) for one, mask in zip(readings, masks, strict=True) if mask.any()]
    if not kept:
        raise InputError.at(source, column="group", found="no row left", expected="some")
    return kept


def as_table(
    readings: Sequence[Readings], mechanism: Mechanism, *, bare: bool = False
) -> dict[str, Any]:
    """Sessions one after the other, as the core takes them; `bare`: the channels alone."""
    if len({r.held for r in readings}) > 1:
        held = next(r.source for r in readings if r.held)
        moving = next(r.source for r in readings if not r.held)
        raise InputError(
            f"found held poses in {held} and a recording in {moving}, expected sessions of one kind"
        )

    def together(columns: list[Any]) -> Any:
        return None if any(c is None for c in columns) else np.concatenate(columns)

    several = len(readings) > 1
    sizes = [len(r) for r in readings]
    keys, columns = ([], []) if bare else (mechanism.key_columns, mechanism.value_columns)
    return {
        "values": np.concatenate([r.values for r in readings]),
        "pose": np.concatenate([r.pose for r in readings]) if readings[0].held else None,
        "time": together([r.time_s for r in readings]),
        "temperature": together([r.temperature_c for r in readings]),
        "session": np.repeat(range(len(readings)), sizes).tolist() if several else None,
        "keys": [[t for r in readings for t in r.keys[name]] for name in keys],
        "columns": [
            np.concatenate([r.columns[name] for r in readings]).tolist() for name in columns
        ],
    }


def posed(readings: Readings, mechanism: Mechanism) -> Known:
    """Readings with known poses, as the core takes them."""
    if readings.poses is None or not np.isfinite(readings.poses).any():
        found = "no known pose" if readings.poses is not None else "no columns x y z rx ry rz"
        expected = "known poses: x y z [length unit] and rx ry rz [rad]"
        raise InputError.at(readings.source, found=found, expected=expected)
    return as_table([readings], mechanism), np.ascontiguousarray(readings.poses)


def _first_rows(pose: npt.NDArray[Any] | None, n: int) -> npt.NDArray[np.intp]:
    """First row of each pose; every row where there are none."""
    if pose is None:
        return np.arange(n)
    return np.flatnonzero(np.r_[True, pose[1:] != pose[:-1]])


def as_applied(result: Result | None, mechanism: Mechanism) -> dict[str, Any]:
    """A result as the core applies it to other readings; None: the mechanism as declared."""
    channels = mechanism.channels
    zero = [0.0] * len(channels)
    if result is None:
        # Nothing refers to the readings where nothing was found with them.
        reference: Mapping[str, Any] = {"centre": zero, "span": [zero[:2]] * len(channels)}
        guess = [1.0 if c.unit == "count" else 1e-5 / abs(c.gain) for c in channels]
        own = [c.noise for c in channels]
        sigma = [g if n is None else n for g, n in zip(guess, own, strict=True)]
        return {**reference, "temperature": None, "sigma": sigma, "parameters": []}
    if result.reference is None or result.noise is None:
        raise InputError("found a result without 'reference' and 'noise', expected both")
    known = [p for p in _lasting(result, mechanism) if p.value is not None]
    return {
        **result.reference.to_dict(),
        "sigma": [result.noise.sigma[c.name] for c in channels],
        "parameters": [(p.spec, p.name, p.value) for p in known],
    }


def earlier_result(calibration: CalibrationArg, mechanism: Mechanism) -> Result:
    result = calibration if isinstance(calibration, Result) else load_calibration(calibration)
    if result.mechanism != mechanism.name:
        found = f"a calibration of {result.mechanism!r}"
        raise InputError(f"found {found}, expected one of {mechanism.name!r}")
    return result


def _terms(mechanism: Mechanism) -> dict[str, Mapping[str, Any]]:
    return {term["id"]: term for term in _core.terms(mechanism)}


def _lasting(result: Result, mechanism: Mechanism) -> list[Parameter]:
    """Parameters that hold beyond the session they were found in."""
    info = _terms(mechanism)
    bound = {i for i, t in info.items() if {t["class"], t["needs"]} & TIME_BOUND}
    return [p for p in result.parameters if p.term in info and p.term not in bound]


def _sensors(result: Result, mechanism: Mechanism) -> dict[str, tuple[float, float]]:
    """Gain and offset of every channel under an earlier result."""
    sensors = {c.name: [c.gain, c.offset] for c in mechanism.channels}
    for p in result.parameters:
        if p.term in ("gain", "offset") and p.target in sensors and p.value is not None:
            sensors[p.target][p.term == "offset"] = p.value
    return {name: (gain, offset) for name, (gain, offset) in sensors.items()}


def _moved(earlier: Result, parameters: Sequence[Parameter]) -> list[Moved]:
    """Parameters that differ by more than chance would make one of them differ once in 100."""
    before = {(p.spec, p.name): p for p in earlier.parameters}
    pairs = [(before[p.spec, p.name], p) for p in parameters if (p.spec, p.name) in before]
    limit = NormalDist().inv_cdf(1.0 - ALPHA / (2 * max(len(pairs), 1)))
    moved = []
    for old, new in pairs:
        if old.value is None or new.value is None:
            continue
        sd = float(np.hypot(_sd(old), _sd(new)))
        if abs(new.value - old.value) > limit * sd:
            same = (new.term, new.target, new.name)
            moved.append(Moved(*same, before=old.value, after=new.value, sd=sd, unit=new.unit))
    return moved


def _described(readings: Sequence[Readings]) -> Data:
    """Where the data are from, and their digest."""
    digest = readings[0].sha256
    if len(readings) > 1:
        digest = hashlib.sha256("".join(r.sha256 for r in readings).encode()).hexdigest()
    skipped = [
        {"file": r.source, "line": s.line, "column": s.column, "reason": s.reason}
        for r in readings
        for s in r.skipped
    ]
    return Data(
        poses=sum(r.n_poses for r in readings),
        samples=sum(len(r) for r in readings),
        sha256=digest,
        files=tuple(r.source for r in readings) if len(readings) > 1 else (),
        skipped=tuple(skipped),
    )


def _reference(readings: Sequence[Readings]) -> dict[str, Any]:
    values = np.concatenate([r.values for r in readings])
    return {
        "centre": plain(values.mean(axis=0)),
        "span": plain(np.column_stack([values.min(axis=0), values.max(axis=0)])),
        "temperature": None,
    }


def _sd(parameter: Parameter) -> float:
    return math.inf if parameter.sd is None else parameter.sd
