"""The verbs: functions with the names of the commands.

Options that default to None mean "as in Rust": a default is written once, there.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from rsicalib import _core
from rsicalib._core import Mechanism
from rsicalib.arrays import FloatArray
from rsicalib.errors import InputError, UndeterminedError
from rsicalib.groups import measured
from rsicalib.io.readings import Readings
from rsicalib.io.readings import load_readings as read_readings
from rsicalib.places import Places, places, readings_for
from rsicalib.results import Calibration, Trace
from rsicalib.shapes import Parameter
from rsicalib.verdicts import ALPHA
from rsicalib.work.applying import posed
from rsicalib.work.arguments import (
    CalibrationArg,
    MechanismArg,
    PathLike,
    ReadingsArg,
    SessionsArg,
    earlier_result,
    listed,
    open_mechanism,
)
from rsicalib.work.job import Work
from rsicalib.work.outcome import NOTHING

__all__ = [
    "DEMO",
    "calibrate",
    "demo",
    "fixture",
    "forward",
    "forward_sd",
    "inverse",
    "load_mechanism",
    "load_readings",
    "terms",
    "trace",
]

DEMO = Path(__file__).with_name("demo")
"""Folder of the session that comes with the package: readings.csv, rest.csv, check.csv."""


MOST_HELD_OUT = 5000
"""A calibration from more poses is not fitted again without some of them: `trace` does that."""


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
    return open_mechanism(name_or_path)


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
    return read_readings(path, load_mechanism(mechanism), skip_bad_rows=skip_bad_rows)


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
    parameters of `terms`. Readings that are wrong are left out and listed in
    `excluded`; the calibration with them is `with_excluded`.

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
        Values of the column `group` to use, or to leave out. Those that were not
        used are measured too, see `groups` of the result.
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

    See Also
    --------
    trace : which effect explains the residual.

    Examples
    --------
    >>> found = calibrate(DEMO / "readings.csv", rest=DEMO / "rest.csv")
    >>> found.noise.source
    'misclosure of repeats'
    """
    job = Work(mechanism, skip_bad_rows, calibration)
    job.take(readings, fit_groups, hold_out_groups)
    options = {
        "closures": listed(closures),
        "method": method,
        "noise": job.noise(noise),
        "starts": starts,
        "max_iterations": max_iterations,
        "xtol": xtol,
    }
    session = job.session(rest, job.terms(terms), options)
    try:
        fit, whole, out = session.calibrate()
    except UndeterminedError as error:
        return Calibration.from_dict(job.too_few(Calibration, error, session) | {"fit": NOTHING})
    found = dict(fit.to_dict()) | {"excluded": out}
    if whole is not None:
        found["with_excluded"] = {k: whole.to_dict()[k] for k in ("fit", "parameters")}
    if found["converged"] and found["fit"]["dof"] >= 1.0 and job.count <= MOST_HELD_OUT:
        found["fit"] |= {"held_out": fit.held_out()}
    known = job.known(check)
    if known is not None:
        found["nominal"] = {**NOTHING, "check": job.nominal_error(known, align=False)}
        found["fit"] |= {"check": fit.check(*known)}
        if whole is not None:
            found["with_excluded"]["fit"] |= {"check": whole.check(*known)}
        if align:
            found["fit"] |= {"aligned": fit.check(*known, align=True)}
            if whole is not None:
                found["with_excluded"]["fit"] |= {"aligned": whole.check(*known, align=True)}
            found["nominal"] |= {"aligned": job.nominal_error(known, align=True)}
    judged = found["fit"]["p_value"]
    verdict = None if judged is None else "adequate" if judged >= ALPHA else "unexplained"
    if found["fit"]["dof"] < 1.0:
        count = len(found["parameters"])
        text = f"{count} parameters from {job.count} poses leave nothing to check them with"
        found["unobservable"] = [f"{text}; record more poses", *found["unobservable"]]
    if found["unobservable"] or not found["converged"]:
        verdict = "undetermined"
    found |= {
        "verdict": found.get("verdict", verdict),
        "method": method or Calibration.method,
        "after_residuals": job.by_pose(fit.residuals()),
    }
    return measured(job, Calibration.from_dict(job.result(Calibration, found, session)))


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
    alpha: float | None = None,
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
    alpha : float, optional
        Probability of naming anything where nothing is missing.
    seed : int, optional
        Nothing is drawn at random here: the same readings give the same result.
    starts, max_iterations, xtol : optional
        As in `calibrate`.

    Returns
    -------
    Trace
        What was missing, the error before and after, what is left and what
        could hide.

    Raises
    ------
    InputError
        As in `calibrate`.

    Examples
    --------
    >>> found = trace(DEMO / "readings.csv", rest=DEMO / "rest.csv", check=DEMO / "check.csv")
    >>> [(step.klass, step.target) for step in found.steps]
    [('sensor', 'a22')]
    """
    job = Work(mechanism, skip_bad_rows, calibration)
    job.take(readings, fit_groups, hold_out_groups)
    options = {
        "closures": listed(closures),
        "noise": job.noise(noise),
        "starts": starts,
        "max_iterations": max_iterations,
        "xtol": xtol,
    }
    session = job.session(rest, job.terms(terms), options)
    known = job.known(check)
    try:
        report = session.trace(check=known, align=align, without=listed(without), alpha=alpha)
    except UndeterminedError as error:
        nothing = {"before": NOTHING, "after": NOTHING}
        return Trace.from_dict(job.too_few(Trace, error, session) | nothing)
    lacking = {"not_candidates": dict(sorted(session.lacking().items()))}
    return measured(job, Trace.from_dict(job.result(Trace, report, session) | lacking), session)


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
    job = Work(mechanism, skip_bad_rows, None)
    job.take(readings, None, None, known_poses=True)
    table, poses = posed(job.readings[0], job.mechanism)
    try:
        lines, count = _core.fixture(job.mechanism, table, poses)
    except UndeterminedError as error:
        nothing = {"method": "fixture", "fit": NOTHING}
        return Calibration.from_dict(job.too_few(Calibration, error, None) | nothing)
    parameters, blocks, sigma = [], [], {}
    for channel, line in zip(job.mechanism.channels, lines, strict=True):
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
    result = Calibration.from_dict(job.result(Calibration, found, None))
    known = job.known(check)
    if known is None:
        return result
    fit = {"check": job.error(known, result, False), "aligned": None}
    nominal = {"check": job.nominal_error(known, align=False), "aligned": None}
    if align:
        fit["aligned"] = job.error(known, result, True)
        nominal["aligned"] = job.nominal_error(known, align=True)
    again = {**result.to_dict(), "fit": NOTHING | fit, "nominal": NOTHING | nominal}
    return Calibration.from_dict(again)


def forward(
    readings: ReadingsArg,
    mechanism: MechanismArg = "rsi",
    calibration: CalibrationArg | None = None,
    *,
    skip_bad_rows: bool = False,
) -> FloatArray:
    """Find the platform's pose for every reading, or the points that the chains carry.

    Parameters
    ----------
    readings : path or Readings
        `n` samples.
    mechanism : str, path or Mechanism
        With a platform, or with points on its chains.
    calibration : path, Calibration or Trace, optional
        An earlier result; without it the mechanism as it is declared. Terms that
        are bound to the time of their own session are left out.
    skip_bad_rows : bool, optional
        As in `calibrate`.

    Returns
    -------
    ndarray, shape (n, 6)
        `x y z` [length unit] and `rx ry rz` [rad], eq. (1). Of a mechanism without
        a platform, `x y z` of each point that a chain carries, shape (n, 3 points).

    Raises
    ------
    InputError
        The mechanism has neither, or the result is not of this mechanism.

    See Also
    --------
    forward_sd : how well they are known.

    Examples
    --------
    >>> forward(DEMO / "rest.csv").shape[1]
    6
    """
    return _placed(readings, mechanism, calibration, skip_bad_rows, sd=False).values


def forward_sd(
    readings: ReadingsArg,
    mechanism: MechanismArg,
    calibration: CalibrationArg,
    *,
    skip_bad_rows: bool = False,
) -> FloatArray:
    """Find how well a calibration knows what `forward` gives.

    Parameters
    ----------
    readings, mechanism, calibration, skip_bad_rows
        As for `forward`.

    Returns
    -------
    ndarray
        Standard deviations, in the shape of `forward`: of the calibration alone, the
        noise of the reading not counted. NaN where nothing is known of them.
    """
    found = _placed(readings, mechanism, calibration, skip_bad_rows, sd=True)
    return np.full_like(found.values, np.nan) if found.sd is None else found.sd


def _placed(
    readings: ReadingsArg,
    mechanism: MechanismArg,
    calibration: CalibrationArg | None,
    skip_bad_rows: bool,
    *,
    sd: bool,
) -> Places:
    loaded = load_mechanism(mechanism)
    one = readings_for(readings, loaded, skip_bad_rows)
    result = None if calibration is None else earlier_result(calibration, loaded)
    return places(one, loaded, result, sd=sd)


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
