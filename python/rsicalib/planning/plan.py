"""Which poses to visit: the Cramér-Rao bound, and poses chosen to make it small."""

from __future__ import annotations

import os
from collections.abc import Mapping, Sequence

import numpy as np
import numpy.typing as npt

from rsicalib import _core, options
from rsicalib.arrays import FloatArray
from rsicalib.errors import InputError
from rsicalib.io.readings import Readings
from rsicalib.planning.further import Choice, Sessions, plan_further
from rsicalib.planning.measures import counts_of, known_sd, parameters_of
from rsicalib.planning.plans import Bound, Plan
from rsicalib.planning.worthwhile import MOST_POSES
from rsicalib.poses.devices import Within, workspace
from rsicalib.work.arguments import (
    CalibrationArg,
    MechanismArg,
    ReadingsArg,
    SessionsArg,
    open_mechanism,
)

USUAL = 12
"""Poses of a plan that is not told how many."""

CRITERIA = _core.CRITERIA
"""What is made small: the probability of a wrong decision between the explanations of a session,
the variance of the platform averaged over the workspace (V-optimal), of the offsets (A-optimal), of
the joint coordinates averaged over the workspace (I-optimal), or the volume of the confidence
ellipsoid (D-optimal)."""


@options.checked
def bound(
    poses: npt.ArrayLike,
    mechanism: MechanismArg = "rsi",
    *,
    noise: float = 1.0,
    calibration: CalibrationArg | None = None,
) -> Bound:
    """Find the Cramér-Rao bound for poses that are to be visited.

    Parameters
    ----------
    poses : array_like, shape (n, 6)
        `x y z` [length unit], `rx ry rz` [rad].
    mechanism : str, path or Mechanism
        With a platform.
    noise : float
        Standard deviation of one reading, quantisation included; of an average of n, 1/√n of it.
    calibration : path, Calibration or Trace, optional
        Result that gives the offsets and gains; the mechanism's own by default.

    Returns
    -------
    Bound
        Bound for any unbiased estimator.

    Raises
    ------
    InputError
        A pose is out of reach.

    Examples
    --------
    >>> up = [[0, 0, -1.3, a, b, 0] for a in (-0.5, 0.5) for b in (-0.5, 0.5)]
    >>> down = [[x, y, -4.0, 0, 0, c] for x in (-1, 1) for y in (-1, 1) for c in (-0.5, 0.5)]
    >>> bound(up + down).offset_rms < 0.05
    True
    """
    opened = open_mechanism(mechanism, calibration)
    wanted = np.ascontiguousarray(poses, dtype=np.float64).reshape(-1, 6)
    return _bound(noise, _core.bound_at(opened, *parameters_of(calibration, opened), wanted, noise))


@options.checked
def plan(
    mechanism: MechanismArg = "rsi",
    poses: int | None = None,
    *,
    target: float | None = None,
    result: CalibrationArg | None = None,
    beside: SessionsArg | None = None,
    within: Within | None = None,
    noise: float = 1.0,
    criterion: str | None = None,
    calibration: CalibrationArg | None = None,
    off: ReadingsArg | None = None,
    candidates: int | None = None,
    starts: int = 4,
    seed: int = 0,
) -> Plan:
    """Choose poses that decide what a session left open, or that make the platform certain.

    Candidates are drawn from a box, within reach, joint limits and ranges, or among the
    configurations that a path of closed ones joins to those visited already. Beside a result, poses
    are chosen under its model by eqs. (93) to (96) of `docs/model.md`, one after the other with a
    round of exchange. Without one, offsets and gains alone are unknown: from several starts, poses
    are exchanged for candidates until no exchange helps, and the best plan is kept. In a box, the
    poses are then refined among others around them.

    Parameters
    ----------
    mechanism : str, path or Mechanism
        With a platform, unless there is a result.
    poses : int, optional
        Number of poses to visit: 12. With a target the most, 64.
    target : float, optional
        Standard deviation of the platform [length unit] that is to be reached, beside a result: the
        plan has as few poses as reach it, and says how many that are.
    result : path, Calibration or Trace, optional
        What the poses are to complement; `beside` are then its readings, known by their SHA-256.
    beside : path, Readings, a sequence of them, or array_like of shape (n, C), optional
        Readings of poses that are visited already: the plan complements them.
    within : six pairs, optional
        Lowest and highest x, y, z [length unit], rx, ry, rz [rad]; the mechanism's `[workspace]` by
        default, else its joint limits.
    noise : float
        Standard deviation of one reading, quantisation included: scales the bound, not the plan.
    criterion : {"decide", "platform", "offsets", "joints", "volume"}, optional
        What is made small: see `CRITERIA`. `decide` where the result leaves something open, else
        `platform`.
    calibration : path, Calibration or Trace, optional
        Result that gives the offsets and gains; the mechanism's own by default.
    off : path, Readings or array_like of shape (m, C), optional
        Readings of poses that are struck off: neither these nor poses near them are planned.
    candidates : int, optional
        Number of candidate poses: 3000, or 2000 beside a result.
    starts : int
        Number of searches from different starts; one beside a result.
    seed : int
        Same seed, same plan.

    Returns
    -------
    Plan
        Poses with what is to be expected of them.

    Raises
    ------
    InputError
        The box is unknown or out of reach, a number cannot be used, or the readings are not those
        of the result.

    Examples
    --------
    >>> plan(poses=12, criterion="offsets").bound.offset_rms < 0.0056
    True
    """
    opened = open_mechanism(mechanism, calibration if result is None else result)
    struck = None if off is None else counts_of(off, opened)
    if target is not None and (result is None or criterion not in (None, "platform")):
        found = "no result" if result is None else f"criterion {criterion!r}"
        raise InputError(f"target: found {found}, expected a result, and the criterion 'platform'")
    if poses is None:
        poses = USUAL if target is None else MOST_POSES
    if result is not None:
        if beside is None or calibration is not None:
            found = "no readings" if beside is None else "another calibration"
            raise InputError(f"plan beside a result: found {found}, expected its readings (beside)")
        sessions = Sessions(beside, result, opened)
        choice = Choice(poses, criterion, within, candidates, struck, seed=seed, target=target)
        return plan_further(sessions, choice)
    if struck is not None:
        raise InputError("off: found poses that are struck off, expected a result beside them")
    wanted = criterion or "platform"
    found_plan = _core.plan(
        opened,
        *parameters_of(calibration, opened),
        poses=poses,
        beside=None if beside is None else _visited(beside, opened),
        within=None if within is None else workspace(opened, within).tolist(),
        noise=noise,
        criterion=wanted,
        candidates=3000 if candidates is None else candidates,
        starts=starts,
        seed=seed,
    )
    count = len(found_plan["poses"])
    return Plan(
        mechanism=opened.name,
        length_unit=opened.length_unit,
        criterion=wanted,
        seed=seed,
        channels=tuple(c.name for c in opened.channels),
        poses=found_plan["poses"],
        readings=found_plan["readings"],
        why=(f"one of {count} chosen together for {wanted}",) * count,
        bound=_bound(noise, found_plan["bound"]),
        before=None if found_plan["before"] is None else _bound(noise, found_plan["before"]),
    )


def _visited(beside: SessionsArg | npt.ArrayLike, mechanism: _core.Mechanism) -> FloatArray:
    """Readings of all sessions, or of an array: shape (n, C)."""
    if isinstance(beside, list | tuple) and beside:
        files = [one for one in beside if isinstance(one, str | os.PathLike | Readings)]
        if files:
            return np.concatenate([counts_of(one, mechanism) for one in files])
    return counts_of(beside, mechanism)  # type: ignore[arg-type]


def _bound(noise: float, found: Mapping[str, Sequence[float]]) -> Bound:
    return Bound(noise, *(known_sd(found[name]) for name in ("offset_sd", "gain_sd", "joint_sd")))
