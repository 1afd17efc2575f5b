"""The verbs: functions with the names of the commands.

Options that default to None mean "as in Rust": a default is written once, there.
"""

from __future__ import annotations

import hashlib
import os
from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from typing import Any, TypeAlias

import numpy as np
import numpy.typing as npt

from rsicalib import _core, data
from rsicalib._core import Mechanism
from rsicalib.data import Readings
from rsicalib.errors import InputError, UndeterminedError
from rsicalib.mechanisms import load_mechanism_text
from rsicalib.records import plain
from rsicalib.results import (
    ALPHA,
    Calibration,
    Data,
    Moved,
    Parameter,
    Result,
    Trace,
    load_calibration,
    sd_of,
)

__all__ = [
    "DEMO",
    "calibrate",
    "demo",
    "fixture",
    "forward",
    "inverse",
    "load_mechanism",
    "load_readings",
    "terms",
    "trace",
]

FloatArray = npt.NDArray[np.float64]
PathLike: TypeAlias = str | os.PathLike[str]
MechanismArg: TypeAlias = PathLike | Mechanism
ReadingsArg: TypeAlias = PathLike | Readings
SessionsArg: TypeAlias = ReadingsArg | Sequence[ReadingsArg]
CalibrationArg: TypeAlias = PathLike | Result

DEMO = Path(__file__).with_name("demo")
"""Folder of the session that comes with the package: readings.csv, rest.csv, check.csv."""

TIME_BOUND = ("data", "order in time")
"""A class and a need of terms that belong to one session alone."""


def load_mechanism(name_or_path: MechanismArg = "rsi") -> Mechanism:
    """Load a mechanism: a built-in one by its name, or a TOML file.

    Parameters
    ----------
    name_or_path : str, path or Mechanism
        `rsi`, or the path of a mechanism file; a mechanism is returned as it is.

    Returns
    -------
    Mechanism
        Channels, chains, points, closures, platform and rest pose.

    Raises
    ------
    InputError
        There is no such mechanism, or the file contradicts itself.

    Examples
    --------
    >>> load_mechanism("rsi").length_unit
    'in'
    """
    if isinstance(name_or_path, Mechanism):
        return name_or_path
    text = load_mechanism_text(name_or_path)
    return Mechanism.rsi() if text is None else Mechanism.from_toml(text)


def load_readings(
    path: PathLike, mechanism: MechanismArg = "rsi", *, skip_bad_rows: bool = False
) -> Readings:
    """Load a file of readings: one row per sample, one column per channel.

    Parameters
    ----------
    path : path
        CSV, or Parquet if it ends in `.parquet` or `.pq`.
    mechanism : str, path or Mechanism
        Whose channels are the columns.
    skip_bad_rows : bool, optional
        Drop rows that cannot be used and list them in `skipped`.

    Returns
    -------
    Readings
        Values exactly as they stand in the file.

    Raises
    ------
    InputError
        The file cannot be used; the message says where, and what was expected.
    """
    return data.load_readings(path, load_mechanism(mechanism), skip_bad_rows=skip_bad_rows)


def terms(mechanism: MechanismArg = "rsi") -> list[dict[str, Any]]:
    """List every term that can be identified.

    Parameters
    ----------
    mechanism : str, path or Mechanism
        Whose channels, chains and closures are the targets.

    Returns
    -------
    list of dict
        `id`, `class`, `doc`, `needs`, `parameters` (name, unit, typical size) and `targets`.
    """
    found: list[dict[str, Any]] = _core.terms(load_mechanism(mechanism))
    return found


def calibrate(
    readings: SessionsArg,
    mechanism: MechanismArg = "rsi",
    *,
    rest: ReadingsArg | None = None,
    check: ReadingsArg | None = None,
    terms: Sequence[str] | None = None,
    closures: Sequence[str] | None = None,
    method: str | None = None,
    noise: float | Mapping[str, float] | None = None,
    calibration: CalibrationArg | None = None,
    align: bool = False,
    fit_groups: Sequence[str] | None = None,
    hold_out_groups: Sequence[str] | None = None,
    skip_bad_rows: bool = False,
    starts: int | None = None,
    max_iterations: int | None = None,
    xtol: float | None = None,
) -> Calibration:
    """Find the parameters of a closed mechanism from its joint readings alone.

    Minimises eq. (51) of `docs/model.md`, noise in every reading, over the
    parameters of `terms`.

    Parameters
    ----------
    readings : path, Readings, or a sequence of them
        `n` samples each; several are sessions of one device.
    mechanism : str, path or Mechanism
        What is read.
    rest : path or Readings, optional
        A reading of the rest pose: where the search starts.
    check : path or Readings, optional
        Known poses, never used in the fit: for the error of the platform.
    terms : sequence of str, optional
        `offset` is a term at every target, `curvature@a22` at one; as the
        mechanism says where not given.
    closures : sequence of str, optional
        Only these.
    method : {"implicit_loop", "algebraic"}, optional
        Noise in the readings, or the paper's least squares.
    noise : float or mapping of str to float, optional
        Standard deviation of one sample, quantisation included, of all channels
        or by name, in their units.
    calibration : path, Calibration or Trace, optional
        An earlier result: where the search starts, whose terms are identified,
        and with which the new one is compared (`moved`).
    align : bool, optional
        Give the error of the check poses also after the best rigid motion of
        the instrument that measured them.
    fit_groups, hold_out_groups : sequence of str, optional
        Values of the column `group` to use, or to leave out.
    skip_bad_rows : bool, optional
        Drop rows that cannot be used and list them in the result.
    starts : int, optional
        Starts to try at the most.
    max_iterations : int, optional
        Steps of the solver.
    xtol : float, optional
        Relative step below which the solver has converged.

    Returns
    -------
    Calibration
        Estimates with standard deviations, lack of fit, and why the solver
        stopped. Look at `verdict`: data that cannot determine a parameter are
        an outcome, not an exception.

    Raises
    ------
    InputError
        The input or the options cannot be used.
    UndeterminedError
        There are fewer equations than parameters.

    See Also
    --------
    trace : which effect explains the residual.

    Examples
    --------
    >>> found = calibrate(DEMO / "readings.csv", rest=DEMO / "rest.csv")
    >>> found.noise.source
    'misclosure of repeats'
    """
    work = _Work(mechanism, skip_bad_rows, calibration)
    work.take(readings, fit_groups, hold_out_groups)
    options = {
        "closures": _listed(closures),
        "method": method,
        "noise": work.noise(noise),
        "starts": starts,
        "max_iterations": max_iterations,
        "xtol": xtol,
    }
    session = work.session(rest, work.terms(terms), options)
    fit = session.fit()
    found = dict(fit.to_dict())
    known = work.known(check)
    if known is not None:
        found["nominal"] = {**NOTHING, "check": work.nominal_error(known, align=False)}
        found["fit"] |= {"check": fit.check(*known)}
        if align:
            found["fit"] |= {"aligned": fit.check(*known, align=True)}
            found["nominal"] |= {"aligned": work.nominal_error(known, align=True)}
    judged = found["fit"]["p_value"]
    verdict = None if judged is None else "adequate" if judged >= ALPHA else "unexplained"
    if found["unobservable"] or not found["converged"]:
        verdict = "undetermined"
    found |= {
        "verdict": found.get("verdict", verdict),
        "method": method or Calibration.method,
        "after_residuals": work.by_pose(fit.residuals()),
    }
    return Calibration.from_dict(work.result(Calibration, found, session))


def trace(
    readings: SessionsArg,
    mechanism: MechanismArg = "rsi",
    *,
    rest: ReadingsArg | None = None,
    check: ReadingsArg | None = None,
    terms: Sequence[str] | None = None,
    without: Sequence[str] | None = None,
    closures: Sequence[str] | None = None,
    noise: float | Mapping[str, float] | None = None,
    calibration: CalibrationArg | None = None,
    align: bool = False,
    fit_groups: Sequence[str] | None = None,
    hold_out_groups: Sequence[str] | None = None,
    skip_bad_rows: bool = False,
    seed: int | None = None,
    starts: int | None = None,
    max_iterations: int | None = None,
    xtol: float | None = None,
) -> Trace:
    """Trace the residual of a calibration to the effect that the model lacks.

    Fits, scores every term that the mechanism and the columns allow, refits
    with the best, and stops when what is left is noise.

    Parameters
    ----------
    readings : path, Readings, or a sequence of them
        As in `calibrate`; so are all options that are not described here.
    mechanism : str, path or Mechanism
        What is read.
    rest, check, terms, closures, noise, calibration : optional
        As in `calibrate`; `terms` are those to begin with.
    without : sequence of str, optional
        Terms that are not candidates.
    align, fit_groups, hold_out_groups, skip_bad_rows : optional
        As in `calibrate`.
    seed : int, optional
        Of every random draw.
    starts, max_iterations, xtol : optional
        As in `calibrate`.

    Returns
    -------
    Trace
        What was missing, the error before and after, what is left and what
        could hide.

    Raises
    ------
    InputError, UndeterminedError
        As in `calibrate`.

    Examples
    --------
    >>> found = trace(DEMO / "readings.csv", rest=DEMO / "rest.csv", check=DEMO / "check.csv")
    >>> [(step.klass, step.target) for step in found.steps]
    [('sensor', 'a22')]
    """
    work = _Work(mechanism, skip_bad_rows, calibration)
    work.take(readings, fit_groups, hold_out_groups)
    options = {
        "closures": _listed(closures),
        "noise": work.noise(noise),
        "starts": starts,
        "max_iterations": max_iterations,
        "xtol": xtol,
    }
    session = work.session(rest, work.terms(terms), options)
    known = work.known(check)
    found = dict(
        session.trace(check=known, align=align, without=_listed(without), seed=seed)
    )
    return Trace.from_dict(work.result(Trace, found, session))


def fixture(
    readings: ReadingsArg,
    mechanism: MechanismArg = "rsi",
    *,
    check: ReadingsArg | None = None,
    align: bool = False,
    skip_bad_rows: bool = False,
) -> Calibration:
    """Calibrate open loop, from known poses: a straight line for each channel, eq. (13).

    Parameters
    ----------
    readings : path or Readings
        With the columns `x y z rx ry rz`; rows without a pose are not used.
    mechanism : str, path or Mechanism
        What is read.
    check : path or Readings, optional
        Other known poses, for the error of the platform.
    align : bool, optional
        As in `calibrate`.
    skip_bad_rows : bool, optional
        As in `calibrate`.

    Returns
    -------
    Calibration
        Whose noise is the scatter of the joint coordinates about the lines:
        lack of fit cannot be judged.

    Raises
    ------
    InputError
        A pose is out of reach, or there are none.
    """
    work = _Work(mechanism, skip_bad_rows, None)
    work.take(readings, None, None, known_poses=True)
    table, poses = _posed(work.readings[0], work.mechanism)
    lines, count = _core.fixture(work.mechanism, table, poses)
    parameters, blocks, sigma = [], [], {}
    for channel, line in zip(work.mechanism.channels, lines, strict=True):
        block = np.full((2, 2), np.nan) if line["covariance"] is None else line["covariance"]
        blocks.append(np.array(block))
        sigma[channel.name] = line["residual"] / abs(line["gain"])
        for k, (name, unit) in enumerate((("offset", "rad"), ("gain", f"rad/{channel.unit}"))):
            sd = None if line["covariance"] is None else line["covariance"][k][k] ** 0.5
            parameters.append(Parameter(name, channel.name, name, line[name], sd, unit))
    covariance = np.zeros((2 * len(blocks), 2 * len(blocks)))
    for k, block in enumerate(blocks):
        covariance[2 * k : 2 * k + 2, 2 * k : 2 * k + 2] = block
    found: dict[str, Any] = {
        "method": "fixture",
        "noise": {"source": "scatter about the lines", "sigma": sigma, "correlation": None}
        | {"dof": float(count - 2)},
        "verdict": None if count > 2 else "undetermined",
        "fit": {**NOTHING},
        "parameters": parameters,
        "covariance": covariance,
        "termination": "one linear step",
    }
    result = Calibration.from_dict(work.result(Calibration, found, None))
    known = work.known(check)
    if known is None:
        return result
    fit = {"check": work.error(known, result, False), "aligned": None}
    nominal = {"check": work.nominal_error(known, align=False), "aligned": None}
    if align:
        fit["aligned"] = work.error(known, result, True)
        nominal["aligned"] = work.nominal_error(known, align=True)
    again = {**result.to_dict(), "fit": NOTHING | fit, "nominal": NOTHING | nominal}
    return Calibration.from_dict(again)


def forward(
    readings: ReadingsArg,
    mechanism: MechanismArg = "rsi",
    calibration: CalibrationArg | None = None,
    *,
    skip_bad_rows: bool = False,
) -> FloatArray:
    """Find the platform's pose for every reading.

    Parameters
    ----------
    readings : path or Readings
        `n` samples.
    mechanism : str, path or Mechanism
        With a platform.
    calibration : path, Calibration or Trace, optional
        An earlier result; without it the mechanism as it is declared. Terms that
        are bound to the time of their own session are left out.
    skip_bad_rows : bool, optional
        As in `calibrate`.

    Returns
    -------
    ndarray, shape (n, 6)
        `x y z` [length unit] and `rx ry rz` [rad], eq. (1).

    Raises
    ------
    InputError
        The mechanism has no platform, or the result is not of this mechanism.

    Examples
    --------
    >>> forward(DEMO / "rest.csv").shape[1]
    6
    """
    loaded = load_mechanism(mechanism)
    one = _load(readings, loaded, skip_bad_rows)
    earlier = None if calibration is None else _earlier(calibration, loaded)
    poses: FloatArray = _core.forward(loaded, _applied(earlier, loaded), _table([one], loaded))
    return poses


def inverse(poses: npt.ArrayLike, mechanism: MechanismArg = "rsi") -> FloatArray:
    """Find the joint coordinates that hold the platform in given poses.

    Parameters
    ----------
    poses : array_like, shape (n, 6) or (6,)
        `x y z` [length unit] and `rx ry rz` [rad].
    mechanism : str, path or Mechanism
        With a platform; for `"rsi"` by the closed forms (6)-(8), within the joint limits.

    Returns
    -------
    ndarray, shape (n, C) or (C,)
        One joint coordinate per channel [rad].

    Raises
    ------
    InputError
        A pose is out of reach; the message says which arm and by how much.

    Examples
    --------
    >>> inverse([0, 0, -2.666, 0, 0, 0]).round(2)
    array([ 0.42, -1.97,  0.  ,  0.42, -1.97,  0.  ,  0.42, -1.97,  0.  ])
    """
    array = np.asarray(poses, dtype=np.float64)
    if array.shape[-1:] != (6,) or array.ndim > 2:
        raise InputError(f"found poses of shape {array.shape}, expected (n, 6) or (6,)")
    closed = isinstance(mechanism, str) and mechanism == "rsi"
    loaded = load_mechanism(mechanism)
    found = []
    for number, pose in enumerate(np.atleast_2d(array)):
        try:
            row = _core.rsi_inverse(list(pose)) if closed else loaded.inverse(list(pose))
        except InputError as error:
            raise InputError(error.message.replace("pose 0 ", f"pose {number} ", 1)) from None
        found.append(np.ravel(row))
    return np.array(found).reshape(*array.shape[:-1], -1)


def demo() -> Trace:
    """Trace the session that comes with the package, as the command `demo` does.

    Returns
    -------
    Trace
        Of `DEMO`.
    """
    return trace(DEMO / "readings.csv", rest=DEMO / "rest.csv", check=DEMO / "check.csv")


# ------------------------------------------------------------------ behind the verbs

NOTHING: dict[str, Any] = {"chi2": None, "dof": None, "p_value": None, "rms_misclosure": None}
"""A fit of which nothing is known but its error on known poses."""

Known: TypeAlias = tuple[dict[str, Any], FloatArray]


class _Work:
    """What the verbs share: readings and options on their way to the core, results on the way back."""

    def __init__(
        self, mechanism: MechanismArg, skip: bool, calibration: CalibrationArg | None
    ) -> None:
        self.mechanism = load_mechanism(mechanism)
        self.skip = skip
        self.earlier = None if calibration is None else _earlier(calibration, self.mechanism)
        self.readings: list[Readings] = []
        self.warnings: list[str] = []

    def take(
        self,
        readings: SessionsArg,
        fit_groups: Sequence[str] | None,
        hold_out_groups: Sequence[str] | None,
        known_poses: bool = False,
    ) -> None:
        """Load the sessions, and keep the groups that are asked for."""
        single = isinstance(readings, str | os.PathLike | Readings)
        several: Iterable[ReadingsArg] = [readings] if single else readings  # type: ignore[list-item, assignment]
        for one in several:
            loaded = _load(one, self.mechanism, self.skip)
            self.warnings += loaded.warnings
            if loaded.poses is not None and not known_poses:
                self.warnings.append(
                    f"{loaded.source}: known poses are not used here; "
                    "give them to `fixture`, or as check (--check)"
                )
            self.readings.append(_grouped(loaded, fit_groups, hold_out_groups))
        if not self.readings:
            raise InputError("found no readings, expected at least one file")

    def terms(self, terms: Sequence[str] | None) -> list[str] | None:
        """As asked for; else those of the earlier result that hold beyond its session."""
        if terms is not None or self.earlier is None:
            return _listed(terms)
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
                raise InputError(f"noise: found {what}, expected one for each of {', '.join(names)}")
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
            loaded = _load(rest, _bare(self.mechanism), self.skip)
            self.warnings += loaded.warnings
            values = loaded.values
        table = _table(self.readings, self.mechanism)
        return _core.Session(mechanism, table, rest=values, terms=terms, **options)

    def known(self, check: ReadingsArg | None) -> Known | None:
        """Check poses, as the core takes them."""
        if check is None:
            return None
        loaded = _load(check, self.mechanism, self.skip)
        self.warnings += loaded.warnings
        return _posed(loaded, self.mechanism)

    def error(self, known: Known, result: Result | None, align: bool) -> dict[str, Any]:
        """Error of a result on check poses."""
        applied = _applied(result, self.mechanism)
        error: dict[str, Any] = _core.check(self.mechanism, applied, *known, align=align)
        return error

    def nominal_error(self, known: Known, *, align: bool) -> dict[str, Any]:
        """Error of the mechanism as it is declared."""
        return self.error(known, None, align)

    def by_pose(self, whitened: FloatArray) -> FloatArray:
        """Residuals of samples as residuals of poses, still in units of noise: (poses, equations)."""
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
        if self.earlier is not None:
            new = [p if isinstance(p, Parameter) else Parameter.from_dict(p) for p in out["parameters"]]
            out["moved"] = _moved(self.earlier, new)
        return out


def _listed(names: Sequence[str] | None) -> list[str] | None:
    if isinstance(names, str):
        raise InputError(f"found {names!r}, expected a sequence of names such as [{names!r}]")
    return None if names is None else list(names)


def _load(readings: ReadingsArg, mechanism: Any, skip: bool) -> Readings:
    if not isinstance(readings, Readings):
        return data.load_readings(readings, mechanism, skip_bad_rows=skip)
    names = tuple(channel.name for channel in mechanism.channels)
    if readings.channels != names:
        found, expected = ", ".join(readings.channels), ", ".join(names)
        raise InputError.at(readings.source, found=f"channels {found}", expected=expected)
    return readings


class _bare:  # noqa: N801
    """A mechanism of which only the channels count: a rest reading needs no more."""

    def __init__(self, mechanism: Mechanism) -> None:
        self.name = mechanism.name
        self.channels = mechanism.channels
        self.key_columns: list[str] = []
        self.value_columns: list[str] = []


def _grouped(
    readings: Readings, keep: Sequence[str] | None, leave: Sequence[str] | None
) -> Readings:
    keep, leave = _listed(keep), _listed(leave)
    if keep is None and leave is None:
        return readings
    groups = readings.keys.get("group")
    if groups is None:
        expected = "a column 'group' to choose from (--fit-groups, --hold-out-groups)"
        raise InputError.at(readings.source, column="group", found="no such column", expected=expected)
    known = list(dict.fromkeys(groups))
    for name in [*(keep or []), *(leave or [])]:
        if name not in known:
            found, expected = f"no group {name!r}", f"one of {', '.join(known)}"
            raise InputError.at(readings.source, column="group", found=found, expected=expected)
    mask = [(keep is None or g in keep) and (leave is None or g not in leave) for g in groups]
    if not any(mask):
        raise InputError.at(readings.source, column="group", found="no row left", expected="some")
    return readings.select(np.array(mask))


def _table(readings: Sequence[Readings], mechanism: Mechanism) -> dict[str, Any]:
    """Sessions one after the other, as the core takes them."""
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
    return {
        "values": np.concatenate([r.values for r in readings]),
        "pose": np.concatenate([r.pose for r in readings]) if readings[0].held else None,
        "time": together([r.time_s for r in readings]),
        "temperature": together([r.temperature_c for r in readings]),
        "session": np.repeat(range(len(readings)), sizes).tolist() if several else None,
        "keys": [[t for r in readings for t in r.keys[name]] for name in mechanism.key_columns],
        "columns": [
            np.concatenate([r.columns[name] for r in readings]).tolist()
            for name in mechanism.value_columns
        ],
    }


def _posed(readings: Readings, mechanism: Mechanism) -> Known:
    """Readings with known poses, as the core takes them."""
    if readings.poses is None or not np.isfinite(readings.poses).any():
        found = "no known pose" if readings.poses is not None else "no columns x y z rx ry rz"
        expected = "known poses: x y z [length unit] and rx ry rz [rad]"
        raise InputError.at(readings.source, found=found, expected=expected)
    return _table([readings], mechanism), np.ascontiguousarray(readings.poses)


def _first_rows(pose: npt.NDArray[Any] | None, n: int) -> npt.NDArray[np.intp]:
    """First row of each pose; every row where there are none."""
    if pose is None:
        return np.arange(n)
    return np.flatnonzero(np.r_[True, pose[1:] != pose[:-1]])


def _applied(result: Result | None, mechanism: Mechanism) -> dict[str, Any]:
    """A result as the core applies it to other readings; None: the mechanism as declared."""
    channels = mechanism.channels
    zero = [0.0] * len(channels)
    if result is None:
        # Nothing refers to the readings where nothing was found with them.
        reference: Mapping[str, Any] = {"centre": zero, "span": [zero[:2]] * len(channels)}
        sigma = [1.0 if c.unit == "count" else 1e-5 / abs(c.gain) for c in channels]
        return {**reference, "temperature": None, "sigma": sigma, "parameters": []}
    if result.reference is None or result.noise is None:
        raise InputError("found a result without 'reference' and 'noise', expected both")
    known = [p for p in _lasting(result, mechanism) if p.value is not None]
    return {
        **result.reference.to_dict(),
        "sigma": [result.noise.sigma[c.name] for c in channels],
        "parameters": [(p.spec, p.name, p.value) for p in known],
    }


def _earlier(calibration: CalibrationArg, mechanism: Mechanism) -> Result:
    result = calibration if isinstance(calibration, Result) else load_calibration(calibration)
    if result.mechanism != mechanism.name:
        found = f"a calibration of {result.mechanism!r}"
        raise InputError(f"found {found}, expected one of {mechanism.name!r}")
    return result


def _lasting(result: Result, mechanism: Mechanism) -> list[Parameter]:
    """Parameters that hold beyond the session they were found in."""
    info = {term["id"]: term for term in _core.terms(mechanism)}
    bound = {i for i, t in info.items() if t["class"] == TIME_BOUND[0] or t["needs"] == TIME_BOUND[1]}
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
    from statistics import NormalDist

    before = {(p.spec, p.name): p for p in earlier.parameters}
    pairs = [(before[p.spec, p.name], p) for p in parameters if (p.spec, p.name) in before]
    limit = NormalDist().inv_cdf(1.0 - ALPHA / (2 * max(len(pairs), 1)))
    moved = []
    for old, new in pairs:
        if old.value is None or new.value is None:
            continue
        sd = float(np.hypot(sd_of(old), sd_of(new)))
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


