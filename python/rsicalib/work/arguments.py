"""Arguments of a verb: what a caller may give, and what becomes of it."""

from __future__ import annotations

import os
from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from typing import Any, TypeAlias

import numpy as np

from rsicalib import _core, options
from rsicalib._core import Mechanism, Term
from rsicalib.errors import InputError, InputTypeError, tell
from rsicalib.facts.digest import digest_of_drawing
from rsicalib.facts.warned import Warned
from rsicalib.imports.kinds import format_of
from rsicalib.imports.log import Log
from rsicalib.imports.opening import import_log
from rsicalib.io.builtin import BUILTIN, DEFAULT, GIVE_YOURS
from rsicalib.io.folders import OF_LOG
from rsicalib.io.frames import ArraysArg, FrameArg, as_table, in_memory
from rsicalib.io.readings import Readings, load_as
from rsicalib.plain_text import meant
from rsicalib.results.result import Result, load_calibration
from rsicalib.work.edited import edits, refuse_other_units

PathLike: TypeAlias = str | os.PathLike[str]
MechanismArg: TypeAlias = PathLike | Mapping[str, Any] | Mechanism
FramelessArg: TypeAlias = PathLike | Readings | Log | ArraysArg
ReadingsArg: TypeAlias = FramelessArg | FrameArg
SessionsArg: TypeAlias = ReadingsArg | Sequence[ReadingsArg]
CalibrationArg: TypeAlias = PathLike | Result


def open_mechanism(name_or_path: MechanismArg, beside: CalibrationArg | None = None) -> Mechanism:
    """A mechanism by name, from a file, from text, from plain values, or as it is.

    `beside` is the result that is taken with it: see `mechanism_beside`.
    """
    name_or_path = mechanism_beside(name_or_path, beside)
    if isinstance(name_or_path, Mechanism):
        return name_or_path
    if not isinstance(name_or_path, str | os.PathLike | Mapping):
        expected = "a name, a path, values or a Mechanism"
        raise InputTypeError(f"mechanism: found {name_or_path!r}, expected {expected}")
    if isinstance(name_or_path, str) and name_or_path in BUILTIN:
        return BUILTIN[name_or_path]()
    from rsicalib.io.mechanisms import load_mechanism

    return load_mechanism(name_or_path)


def mechanism_beside(mechanism: MechanismArg, result: CalibrationArg | None) -> MechanismArg:
    """The mechanism that holds beside a result: the given one; where none was chosen, its own.

    A result that was made in this process knows the mechanism that it was made from. One that was
    read from a file does not: the default holds, and `earlier_result` asks for the mechanism.
    """
    own = result.made_from if isinstance(result, Result) else None
    # A file cannot hold a mechanism: what it calls so is text.
    return own if isinstance(own, Mechanism) and _default(mechanism) else mechanism


def earlier_result(
    calibration: CalibrationArg, mechanism: Mechanism, warned: list[Warned] | None = None
) -> tuple[Result, Mechanism]:
    """A result, or that of its file, and the mechanism with the laws that it was found with.

    Refused if it is of another mechanism, in another length unit, or lacks a value. Every verb and
    every function that takes a result takes it here: what was edited is told here, and
    nowhere else; a verb that makes a result keeps it in `warned`.
    """
    if not isinstance(calibration, str | os.PathLike | Result):
        found, expected = f"a value of type {type(calibration).__name__}", "a path or a result"
        raise InputTypeError(f"calibration: found {found}, expected {expected}")
    result = calibration if isinstance(calibration, Result) else load_calibration(calibration)
    where = "calibration" if result is calibration else os.fspath(calibration)  # type: ignore[arg-type]
    if result.mechanism != mechanism.name:
        found = f"a calibration of {result.mechanism!r}"
        beside = Path(where).parent / OF_LOG
        its = beside if result is not calibration and beside.is_file() else "FILE"
        hint = f"Give its own as mechanism (--mechanism {its})."
        raise InputError.at(where, found, f"one of {mechanism.name!r}", hint=hint)
    if result.length_unit != mechanism.length_unit:
        found, expected = f"lengths in {result.length_unit!r}", f"{mechanism.length_unit!r}"
        expected += f", as the mechanism {mechanism.name!r} has them"
        raise InputError.at(where, found, expected)
    for number, parameter in enumerate(result.parameters):
        if parameter.value is None:
            place = f"parameters[{number}].value"
            raise InputError.at(where, "null", "a number", place=place)
    names = {channel.name for channel in mechanism.channels}
    if result.noise is not None and result.noise.sigma.keys() != names:
        odd = min(names ^ result.noise.sigma.keys())
        found = f"{'none for' if odd in names else 'one for'} {odd!r}"
        expected = f"one for each channel of {mechanism.name!r}"
        raise InputError.at(where, found, expected, place="noise.sigma")
    extended = _with_laws(mechanism, result)
    refuse_other_units(result, extended, where)
    if result.verdict == "implausible":
        tell(f"{result.called} is implausible: nothing that follows from it can be relied on")
    if redrawn(result, mechanism):
        words = (
            f"{mechanism.name!r} is drawn otherwise than when {result.called} was made: what "
            "follows from both is of neither; identify again"
        )
        tell(words)
        if warned is not None:
            warned.append(Warned("redrawn", None, words))
    said = edits(result, extended)
    if said is not None:
        tell(said)
        if warned is not None:
            warned.append(Warned("edited", None, said))
    return result, extended


def redrawn(result: Result, mechanism: Mechanism) -> bool:
    """Whether a mechanism is drawn otherwise than that of a result, as far as the result tells."""
    return result.drawing not in (None, digest_of_drawing(mechanism))


def _with_laws(mechanism: Mechanism, result: Result) -> Mechanism:
    """A mechanism with the laws of a result as well; refused if it has others of their names."""
    own = {term.id: term for term in mechanism.terms}
    new = []
    for law in result.laws:
        term = Term.from_dict(law.to_dict())
        if own.get(term.id, term) != term:
            found, expected = f"the term {own[term.id]}", f"{term}, as the calibration has it"
            raise InputError(f"mechanism {mechanism.name}: found {found}, expected {expected}")
        if term.id not in own:
            new.append(term)
    return mechanism.with_terms(new) if new else mechanism


class Bare:
    """A mechanism of which the channels count: to read a rest pose, or to apply a result.

    What laws and drives use counts where it is there.
    """

    def __init__(self, mechanism: Mechanism) -> None:
        self.whole = mechanism
        self.name = mechanism.name
        self.channels = mechanism.channels
        self.key_columns: list[str] = []
        self.distance_columns: list[str] = []
        self.value_columns: list[str] = mechanism.law_columns
        self.optional_columns: list[str] = mechanism.law_columns
        self.own_columns: list[list[str]] = []
        self.length_unit = mechanism.length_unit
        self.column_units = mechanism.column_units


def with_logs(
    readings: SessionsArg,
    mechanism: MechanismArg,
    skip: bool,
    beside: CalibrationArg | None = None,
) -> tuple[SessionsArg, MechanismArg]:
    """Sessions with the logs of other programs among them read.

    A mechanism that such a log brings along is the one that holds where none was chosen; after it
    that of the result `beside`.
    """
    if not isinstance(readings, Readings | Log):
        readings = as_table(readings)
    own_of_result = mechanism_beside(mechanism, beside)
    single = isinstance(readings, str | os.PathLike | Readings | Log) or in_memory(readings)
    if not single and not isinstance(readings, Iterable):
        return readings, own_of_result  # refused where readings are taken
    several: list[Any] = [readings] if single else list(readings)  # type: ignore[arg-type]
    logs = {k: log for k, one in enumerate(several) if (log := _log(one, mechanism, skip, beside))}
    if not logs:
        return (several[0] if single else several), own_of_result
    own = next((log.mechanism for log in logs.values() if log.mechanism is not None), None)
    mechanism = own if own is not None and _default(mechanism) else own_of_result
    loaded = open_mechanism(mechanism)
    out: list[ReadingsArg] = []
    for k, one in enumerate(several):
        if k in logs:
            out += logs[k].readings(loaded, skip_bad_rows=skip)
        else:
            out.append(one)
    return out, mechanism


def _default(mechanism: MechanismArg) -> bool:
    """Whether a mechanism is the one that holds where none was chosen."""
    return isinstance(mechanism, str) and mechanism == DEFAULT


def _log(
    readings: object, mechanism: MechanismArg, skip: bool, beside: CalibrationArg | None = None
) -> Log | None:
    """The log of another program that a path leads to; None for readings."""
    if isinstance(readings, Log):
        return readings
    if not isinstance(readings, str | os.PathLike) or format_of(readings) is None:
        return None
    if not _default(mechanism):
        return import_log(readings, mechanism=mechanism, skip_bad_rows=skip)
    log = import_log(readings, skip_bad_rows=skip)
    if log.mechanism is not None:
        return log
    mechanism = mechanism_beside(mechanism, beside)
    try:
        return import_log(readings, mechanism=mechanism, skip_bad_rows=skip)
    except InputError as error:  # what was recorded is of another machine
        raise InputError(f"{error.message} {GIVE_YOURS}", error.where) from None


def load(readings: ReadingsArg, mechanism: Any, skip: bool, called: str = "") -> Readings:
    """Readings as they are, from a file or a data frame; refused if they have other channels.

    Messages call a data frame by its argument, where it is `called` so and is not the session.
    """
    log = _log(readings, getattr(mechanism, "whole", mechanism), skip)
    if log is not None:
        sessions = log.readings(mechanism, skip_bad_rows=skip)
        if len(sessions) > 1:
            found = f"{len(sessions)} sessions"
            hint = "Import it (rsicalib import), and give one of its files."
            raise InputError.at(log.source, found, "one", hint=hint)
        return sessions[0]
    if not isinstance(readings, Readings):
        assert not isinstance(readings, Log)  # it is one of the logs above
        return load_as(called, readings, mechanism, skip)
    names = tuple(channel.name for channel in mechanism.channels)
    if readings.channels != names:
        found, expected = ", ".join(readings.channels), ", ".join(names)
        raise InputError.at(readings.source, f"channels {found}", expected)
    return readings


def grouped(
    readings: list[Readings], keep: list[str] | None, leave: list[str] | None
) -> list[Readings]:
    """The rows of the groups to use; a session without any is left out."""
    if keep is None and leave is None:
        return list(readings)
    for one in readings:
        if "group" not in one.keys:
            expected = "a column 'group' to choose from (--fit-groups, --hold-out-groups)"
            found = "no such column"
            raise InputError.at(one.source, found, expected, column="group")
    known = list(dict.fromkeys(g for one in readings for g in one.keys["group"]))
    source = ", ".join(one.source for one in readings)
    for name in [*(keep or []), *(leave or [])]:
        if name not in known:
            found = f"no group {name!r}{meant(name, known)}"
            expected = f"one of {', '.join(known)}"
            raise InputError.at(source, found, expected, column="group")
    used = {g for g in known if (keep is None or g in keep) and (leave is None or g not in leave)}
    masks = [np.array([g in used for g in one.keys["group"]]) for one in readings]
    kept = [one.select(mask) for one, mask in zip(readings, masks, strict=True) if mask.any()]
    if not kept:
        raise InputError.at(source, "no row left", "some", column="group")
    return kept


def names_in(
    option: str, given: Sequence[str] | None, mechanism: Mechanism, *, none: bool = False
) -> list[str] | None:
    """Names of terms or closures of a mechanism as a list: see `options.names`."""

    def known() -> list[str]:
        if option == "closures":
            return [closure["name"] for closure in mechanism.to_dict()["closure"]]
        terms = [(term["id"], term["targets"]) for term in _core.terms(mechanism)]
        targets = [f"{term}@{target}" for term, own in terms for target in (*own, "each")]
        return [*(term for term, _ in terms), *targets]

    return options.names(option, given, known, none=none)


def noise_of_channels(
    noise: float | Mapping[str, float] | None, mechanism: Mechanism
) -> list[float] | None:
    """Standard deviation of one sample of each channel; None where nothing is declared.

    One number is that of all channels, in their unit: of channels in several it is refused.
    """
    if noise is None:
        return None
    names = [channel.name for channel in mechanism.channels]
    if isinstance(noise, Mapping):
        unknown = [name for name in noise if name not in names]
        own = {c.name: c.noise for c in mechanism.channels if c.noise is not None}
        sigma = {**own, **noise}
        missing = [name for name in names if name not in sigma]
        if unknown or missing:
            what = f"none for {missing[0]!r}" if missing else ""
            if unknown:
                what = f"no channel {unknown[0]!r}{meant(str(unknown[0]), names)}"
            raise InputError(f"noise: found {what}, expected one for each of {', '.join(names)}")
    else:
        units = dict.fromkeys(channel.unit for channel in mechanism.channels)
        if len(units) > 1:
            found = f"one number, {noise:g}, for channels in {', '.join(units)}"
            each = ", ".join(f"{c.name} [{c.unit}]" for c in mechanism.channels)
            raise InputError(f"noise: found {found}; expected one for each of {each}")
        sigma = dict.fromkeys(names, noise)
    return [options.noise_of(sigma[c.name], [c]) for c in mechanism.channels]
