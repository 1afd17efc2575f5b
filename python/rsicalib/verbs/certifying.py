"""Whether a calibrated mechanism keeps a limit where it was not measured: the verb `certify`."""

from __future__ import annotations

import math
import os
import re
import shlex
from collections.abc import Iterator, Mapping, Sequence
from typing import Any

import numpy as np
import numpy.typing as npt

from rsicalib import _core, options
from rsicalib._core import Mechanism
from rsicalib.arrays import FloatArray
from rsicalib.errors import InputError, InputTypeError
from rsicalib.facts.certified import Known, Uncertainty
from rsicalib.facts.shapes import TraceShape
from rsicalib.io.builtin import DEFAULT
from rsicalib.io.cells import POSE
from rsicalib.io.frames import columns_of, is_frame
from rsicalib.io.readings import Readings
from rsicalib.io.tables import numbers, read_table
from rsicalib.plain_text import quoted
from rsicalib.planning.measures import parameters_of
from rsicalib.planning.platform_sd import readings_at_work
from rsicalib.poses.devices import Device
from rsicalib.poses.places import WARMER, held_at, readings_for
from rsicalib.report.words import listed_words, subject
from rsicalib.results.certificate import Certificate
from rsicalib.results.result import Result
from rsicalib.work.applying import as_table
from rsicalib.work.arguments import (
    CalibrationArg,
    MechanismArg,
    ReadingsArg,
    earlier_result,
    mechanism_beside,
    open_mechanism,
    redrawn,
)

PLACES, SEED, POSES = 200, 1, 6
"""Places of the workspace, the seed that they are drawn with, poses that are proposed."""

LENGTHS = {"m": 1.0, "cm": 1e-2, "mm": 1e-3, "um": 1e-6, "µm": 1e-6, "in": 0.0254, "ft": 0.3048}
ANGLES = {"rad": 1.0, "mrad": 1e-3, "deg": math.pi / 180, "°": math.pi / 180}

LEFT = {
    "unexplained": "its residual has no explanation",
    "partly_explained": "part of its residual has no explanation",
}
"""Verdicts of results that leave something: check points say how large it is elsewhere."""


@options.checked
def certify(
    result: CalibrationArg,
    mechanism: MechanismArg = "rsi",
    *,
    limit: float | str,
    confidence: float = 0.95,
    at: ReadingsArg | npt.ArrayLike | None = None,
) -> Certificate:
    """Decide by ISO 14253-1 whether the largest error of a calibrated mechanism is within a limit.

    The largest error over all places counts, each read once. How large it may be is drawn from
    what the session leaves open, eqs. (141) to (145) of `docs/model.md`: errors of the parameters,
    noise of a reading, play, and an effect that nobody named.

    Parameters
    ----------
    result : path, Calibration or Trace
        A trace: a calibration was not searched for effects that could hide.
    mechanism : str, path, mapping or Mechanism
        What was calibrated.
    limit : float or str
        Of the position, in the mechanism's length unit; `"0.5 mm"` has a unit of its own, and
        `"2 mrad"` or `"0.1 deg"` is a limit of the orientation.
    confidence : float
        Probability of the expanded uncertainty.
    at : path, Readings, data frame, or array_like of shape (n, 6), optional
        Places that count: readings, or poses `x y z` [length unit], `rx ry rz` [rad] of a
        platform. 200 of the workspace where not given.

    Returns
    -------
    Certificate
        The decision, the budget, and what would decide an undecided one.

    Raises
    ------
    InputError
        The limit is none, the result is of another mechanism, or a pose is out of reach.

    Examples
    --------
    >>> import rsicalib
    >>> from rsicalib import DEMO
    >>> found = rsicalib.trace(DEMO / "readings.csv", rest=DEMO / "rest.csv")
    >>> certify(found, limit="1 mm").decision
    'within'
    """
    mechanism = mechanism_beside(mechanism, result)
    opened = open_mechanism(mechanism)
    earlier, opened = earlier_result(result, opened)
    if redrawn(earlier, opened):
        other = f"{opened.name!r} drawn otherwise than when {earlier.called} was made"
        raise InputError(f"mechanism: found {other}, expected the drawing that was traced")
    quantity, size, unit = _limit(limit, opened)
    table, places = _places(earlier, opened, at)
    found = _core.certify(
        opened, earlier.to_json(), table, quantity == "orientation", size, confidence
    )
    decision, times = found["decision"], found["times"]
    budget = found["uncertainty"]
    uncertainty = None if budget is None else Uncertainty.from_dict(budget)
    known = tuple(map(Known.from_dict, found["known"]))
    unfit = (*_unfit(earlier, found["unfit"]), *_unsized(earlier, found["unsized_steps"]))
    expanded = math.nan if uncertainty is None else uncertainty.expanded
    return Certificate(
        mechanism=opened.name,
        device=earlier.device,
        valid_from=earlier.valid_from,
        quantity=quantity,
        limit=size,
        unit=unit,
        confidence=confidence,
        decision=decision,
        reasons=(
            *unfit,
            *(() if times is None else _of_check(earlier, times)),
            *_why(decision, size, unit, expanded, known, bool(unfit)),
        ),
        uncertainty=uncertainty,
        known=known,
        decides=_decides(result, mechanism, earlier) if decision == "undecided" else None,
        verdict=earlier.verdict,
        conditions=_conditions(earlier, opened, places),
        rests_on=_rests_on(opened),
        not_covered=_not_covered(earlier, opened, times is not None),
        independent_points=_checked(earlier),
        data_sha256=earlier.readings.sha256,
        files=tuple(os.path.basename(name) for name in earlier.readings.files),
    )


def _limit(limit: float | str, mechanism: Mechanism) -> tuple[Any, float, str]:
    """What a limit is of, its size in the mechanism's unit or rad, and that unit."""
    own = mechanism.length_unit
    lengths = "one with its unit: '0.5 mm', " if own in LENGTHS else "an angle: "
    expected = f"a length [{own}] above 0, or {lengths}'2 mrad', '0.1 deg'"
    if isinstance(limit, str):
        match = re.fullmatch(r"\s*([0-9.]+(?:[eE][-+]?[0-9]+)?)\s*([a-zA-Zµ°]*)\s*", limit)
        try:
            value = float(match[1]) if match else math.nan
        except ValueError:
            value = math.nan
        unit = match[2] if match else ""
    elif isinstance(limit, int | float) and not isinstance(limit, bool):
        value, unit = float(limit), ""
    else:
        raise InputTypeError(f"limit: found {quoted(limit)}, expected {expected}")
    if not (0 < value <= _core.LARGEST):
        raise InputError(f"limit: found {quoted(limit)}, expected {expected}")
    if unit in ("", own):
        return "position", value, own
    if unit in ANGLES:
        if not _posed(mechanism):
            found = f"an angle for {mechanism.name!r}, which has no platform"
            raise InputError(f"limit: found {found}, expected a length [{own}]")
        return "orientation", value * ANGLES[unit], "rad"
    if unit in LENGTHS and own in LENGTHS:
        return "position", value * LENGTHS[unit] / LENGTHS[own], own
    raise InputError(f"limit: found {quoted(limit)}, expected {expected}")


def _places(
    result: Result, mechanism: Mechanism, at: ReadingsArg | npt.ArrayLike | None
) -> tuple[Mapping[str, Any], str]:
    """Readings of the places that count, as the core takes them, and what they are."""
    posed = _posed(mechanism)
    if at is None:
        exact, of_workspace = readings_at_work(result, mechanism, PLACES, SEED)
        words = f"{len(exact)} configurations within the limits of the joints"
        words = f"{PLACES} poses of the workspace" if of_workspace else words
        readings = held_at(result, mechanism, exact)
        return as_table([readings], mechanism, bare=not posed), words
    device = Device(mechanism, *parameters_of(result, mechanism))
    poses = _poses_of(at, mechanism) if posed else None
    if poses is not None:
        exact = device.readings(poses)
        wrong = np.flatnonzero(~np.isfinite(exact).all(axis=1))
        if len(wrong):
            found = f"pose {wrong[0] + 1} ({', '.join(f'{v:g}' for v in poses[wrong[0]])})"
            expected = "poses within reach, joint limits and ranges"
            raise InputError(f"at: found {found} beyond them, expected {expected}")
        readings = held_at(result, mechanism, exact)
    else:
        readings = readings_for(at, mechanism, False)  # type: ignore[arg-type]
        _refuse_beyond_limits(readings, device)
    words = f"{len(readings)} places that were given"
    return as_table([readings], mechanism, bare=not posed), words


def _posed(mechanism: Mechanism) -> bool:
    """Whether it has a platform; else its places are those of points that chains carry."""
    return bool(mechanism.to_dict().get("platform"))


def _carried(mechanism: Mechanism) -> list[str]:
    """Points that chains carry."""
    return [point["name"] for point in mechanism.to_dict().get("point", ()) if point.get("chain")]


def _poses_of(at: Any, mechanism: Mechanism) -> FloatArray | None:
    """Poses of an array, or of a file that has no readings; None where there are readings."""
    if isinstance(at, str | os.PathLike):
        table = read_table(at)
        if any(channel.name in table.names for channel in mechanism.channels):
            return None
        missing = [name for name in POSE if name not in table.names]
        if missing:
            expected = "x y z rx ry rz, or one column for each channel"
            raise InputError.at(table.source, "no such column", expected, column=missing[0])
        columns = [table.numbers(table.names.index(name)) for name in POSE]
        poses = np.stack(columns, axis=1)
        for row, column in np.argwhere(~np.isfinite(poses)):
            cell = table.columns[table.names.index(POSE[column])][row]
            raise table.fault(row, POSE[column], quoted(cell), "a number")
        if not len(poses):
            raise InputError.at(table.source, "no row", "a pose at least")
        return poses
    if is_frame(at):
        given = columns_of(at)
        read = any(channel.name in given for channel in mechanism.channels)
        if not read and set(POSE) <= set(given):
            at = np.stack([numbers(given[name]) for name in POSE], axis=1)
    if isinstance(at, list | tuple | np.ndarray):
        try:
            poses = np.ascontiguousarray(at, dtype=np.float64)
        except (TypeError, ValueError):
            poses = np.empty(0)
        if poses.ndim != 2 or poses.shape[1] != 6 or not len(poses):
            expected = "numbers of shape (n, 6): x y z rx ry rz"
            raise InputError(f"at: found an array of shape {poses.shape}, expected {expected}")
        return poses
    return None


def _refuse_beyond_limits(readings: Readings, device: Device) -> None:
    """Refuse readings at which a joint would be beyond its limits."""
    for k, channel in enumerate(device.mechanism.channels):
        if channel.limits is None:
            continue
        low, high = channel.limits
        joint = device.offsets[k] + device.gains[k] * readings.values[:, k]
        slack = 1e-9 * (high - low)
        wrong = np.flatnonzero(~((joint >= low - slack) & (joint <= high + slack)))
        if len(wrong):
            found = f"{joint[wrong[0]]:.6g} in pose {readings.pose[wrong[0]]}"
            expected = f"{low:g} to {high:g}, the limits of its joint"
            raise InputError.at(readings.source, found, expected, column=channel.name)


def _unfit(result: Result, reasons: Sequence[str]) -> Iterator[str]:
    """Why a result cannot show that anything is within a limit, in words."""
    words = {
        "undetermined": "its poses do not determine the calibration",
        "implausible": "what was found is absurd beside the mechanism's size",
        "unjudged": "nothing judges its residual",
        **LEFT,
    }
    why = words.get(result.verdict, "its residual is significant")
    for reason in reasons:
        yield {
            "not_traced": "A calibration is not searched for effects that could hide: "
            "certify a trace.",
            "verdict": f"The result is {result.verdict or 'not judged'}: {why}.",
            "nothing_open": "The result does not hold what its session leaves open: trace again.",
        }[reason]


def _unsized(result: Result, steps: Sequence[int]) -> tuple[str, ...]:
    """Effects that are not applied, and of which nobody knows how large they are."""
    if not steps or not isinstance(result, TraceShape):
        return ()
    names = listed_words([subject(result.steps[k]) for k in steps])
    return (f"How large {names} is at these places, not applied, is not known.",)


def _of_check(result: Result, times: float) -> tuple[str, ...]:
    size = f"{times:.2g} times" if times >= 1.05 else "no more than"
    return (
        f"The result is {result.verdict}: {LEFT[str(result.verdict)]}. How large its errors are is "
        f"by {_checked(result)} check points: {size} what is predicted of them, with effects that "
        "nobody named.",
    )


def _checked(result: Result) -> int:
    check = result.quality.check
    return 0 if check is None else int(check.poses)


def _why(
    decision: str,
    limit: float,
    unit: str,
    expanded: float,
    known: tuple[Known, ...],
    refused: bool,
) -> tuple[str, ...]:
    """The decision in words."""
    largest = max((one.error for one in known), default=0.0)
    if decision == "not within":
        if largest <= limit:
            return (f"Noise of a reading alone takes the largest error beyond {limit:.3g} {unit}.",)
        return (f"A known error is {largest:.3g} {unit}, beyond the limit by more than its U.",)
    if decision == "within":
        return (f"U is {expanded:.3g} {unit}, within the limit of {limit:.3g} {unit}.",)
    out = []
    if math.isnan(expanded):
        out.append("The result has no covariance: how large the error may be is not known.")
    elif not refused:
        out.append(f"U is {expanded:.3g} {unit} beside a limit of {limit:.3g} {unit}.")
    if not any(one.expanded is not None for one in known):
        out.append("Without check points, nothing can show that it is not within the limit.")
    return tuple(out)


def _decides(result: CalibrationArg, mechanism: MechanismArg, earlier: Result) -> str | None:
    """Arguments that plan what may decide; None where no pose would."""
    if earlier.verdict == "implausible" or not earlier.readings.files:
        return None
    path = "trace.json" if isinstance(result, Result) else os.fspath(result)
    model = mechanism.name if isinstance(mechanism, Mechanism) else mechanism
    words = ["plan"]
    if not isinstance(model, str | os.PathLike):
        model = earlier.mechanism
    if os.fspath(model) != DEFAULT:
        words += ["--mechanism", os.fspath(model)]
    words += ["--result", path, "--beside", *earlier.readings.files]
    return shlex.join([*words, "--poses", str(POSES), "--criterion", "platform"])


def _conditions(result: Result, mechanism: Mechanism, places: str) -> tuple[str, ...]:
    of = "the platform"
    names = _carried(mechanism)
    if not _posed(mechanism) and not names:
        of = "no point, since no chain carries one"
    elif not _posed(mechanism):
        of = f"{listed_words(names)}, as the chains carry {'it' if len(names) == 1 else 'them'}"
    out = [f"Places of {of}: {places}, one reading each, the effects found applied."]
    mean = None if result.reference is None else result.reference.temperature
    if mean is not None:
        between = f"{mean - WARMER:.1f} to {mean + WARMER:.1f} °C"
        out.append(f"Temperature: {between}, about the mean of the session, or as given.")
    else:
        out.append("Temperature: that of the session, which was not measured.")
    points = _checked(result)
    out.append(
        f"Independent points of an instrument: {points} poses, not used in the fit."
        if points
        else "Independent points of an instrument: none were used."
    )
    return tuple(out)


def _rests_on(mechanism: Mechanism) -> tuple[str, ...]:
    """The lengths that give the scale."""
    values = mechanism.to_dict()
    unit = mechanism.length_unit
    out = []
    for closure in values.get("closure", ()):
        value = closure.get("value")
        if isinstance(value, str):
            out.append(f"Scale: the measured distance {closure['name']} (column {value}).")
        elif value:
            sd = f", sd {closure['sd']:g}" if closure.get("sd") else ""
            out.append(f"Scale: the distance {closure['name']}, {value:.7g} {unit}{sd}.")
    if values.get("chain"):
        out.append("Scale: lengths of the chains as drawn, where no effect changes them.")
    if any("value" in point for point in values.get("rest", {})):
        out.append("The rest pose.")
    return tuple(out)


def _not_covered(result: Result, mechanism: Mechanism, checked: bool) -> tuple[str, ...]:
    out = [f"Not determined by these readings: {text}." for text in result.unobservable]
    out.append("Errors of the length that gives the scale, beyond what the session shows of them.")
    out.append("Loads and speeds that the session did not have, temperatures beyond those above.")
    moving = [
        point["name"]
        for point in mechanism.to_dict().get("point", ())
        if "pose" in point.get("unknown", ())
    ]
    if moving:
        out.append(f"The place of {listed_words(moving)}, which no chain carries.")
    out.append("Damage and wear since the session: rsicalib watch looks for them.")
    if checked:
        out.append("Places that are unlike the check points: by those is what has no explanation.")
    if not _checked(result):
        out.append("The place of the whole in any other frame than the mechanism's own.")
    return tuple(out)
