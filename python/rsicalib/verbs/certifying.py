"""Whether a calibrated mechanism keeps a limit where it was not measured: the verb `certify`."""

from __future__ import annotations

import math
import os
import re
import shlex
from collections.abc import Mapping
from dataclasses import replace
from typing import Any

import numpy as np
import numpy.typing as npt

from rsicalib import _core, options
from rsicalib._core import Mechanism
from rsicalib.arrays import FloatArray
from rsicalib.errors import InputError, InputTypeError
from rsicalib.facts.shapes import FitQuality, TraceShape
from rsicalib.io.builtin import DEFAULT
from rsicalib.io.cells import POSE
from rsicalib.io.readings import Readings
from rsicalib.io.tables import read_table
from rsicalib.plain_text import quoted
from rsicalib.planning.measures import parameters_of
from rsicalib.poses.devices import Device, draw_poses
from rsicalib.poses.places import readings_for
from rsicalib.report.words import listed_words, subject
from rsicalib.results.certificate import Certificate, Known, Source, Uncertainty
from rsicalib.results.result import Result
from rsicalib.work.applying import as_applied, as_table, covariance_of
from rsicalib.work.arguments import (
    Bare,
    CalibrationArg,
    MechanismArg,
    ReadingsArg,
    earlier_result,
    open_mechanism,
)

__all__ = ["certify"]

PLACES, DRAWS, SEED, POSES = 200, 2000, 1, 6
"""Places of the workspace, draws of the largest error, their seed, poses that are proposed."""

WARMER = 1.0
"""The temperature may be so far from that of the session [K]."""

LENGTHS = {"m": 1.0, "cm": 1e-2, "mm": 1e-3, "um": 1e-6, "µm": 1e-6, "in": 0.0254, "ft": 0.3048}
ANGLES = {"rad": 1.0, "mrad": 1e-3, "deg": math.pi / 180, "°": math.pi / 180}

JUDGED = ("adequate", "explained")
"""Verdicts of results that predict their error: of others something is not understood."""

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
    at : path, Readings, or array_like of shape (n, 6), optional
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
    opened = open_mechanism(mechanism)
    earlier, opened = earlier_result(result, opened)
    quantity, size, unit = _limit(limit, opened)
    table, places = _places(earlier, opened, at)
    checked, uncertainty = _by_check(earlier, opened, quantity), None
    reasons = (*(() if checked is not None else _not_judged(earlier)), *_unsized(earlier, quantity))
    bound: tuple[str, ...] = ()
    times = None
    covariance = _covariance(earlier)
    expanded = math.nan
    if covariance is not None and np.isfinite(covariance).all() and len(covariance):
        uncertainty, bound, times = _budget(
            earlier, opened, covariance, table, quantity, confidence, checked
        )
        expanded = uncertainty.expanded
    noise = 0.0 if uncertainty is None else uncertainty.least
    seen, known = _known(earlier, quantity, confidence, noise, bound)
    counted = sum(one.error for one in known if one.expanded is None)
    decision, _ = _core.decide(size, math.nan if reasons else expanded, counted, confidence, seen)
    return Certificate(
        mechanism=opened.name,
        device=earlier.device,
        valid_from=earlier.valid_from,
        quantity=quantity,
        limit=size,
        unit=unit,
        confidence=confidence,
        decision=decision,  # type: ignore[arg-type]
        reasons=(
            *reasons,
            *(() if checked is None or times is None else _of_check(earlier, times)),
            *_why(decision, size, unit, expanded, known, bool(reasons)),
        ),
        uncertainty=uncertainty,
        known=known,
        decides=_decides(result, mechanism, earlier) if decision == "undecided" else None,
        verdict=earlier.verdict,
        conditions=_conditions(earlier, opened, places),
        rests_on=_rests_on(opened),
        not_covered=_not_covered(earlier, opened, checked is not None),
        independent_points=_checked(earlier),
        data_sha256=earlier.readings.sha256,
        files=tuple(os.path.basename(name) for name in earlier.readings.files),
    )


def _limit(limit: float | str, mechanism: Mechanism) -> tuple[Any, float, str]:
    """What a limit is of, its size in the mechanism's unit or rad, and that unit."""
    own = mechanism.length_unit
    expected = f"a length in {own} above 0, or one with its unit: '0.5 mm', '2 mrad', '0.1 deg'"
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
            raise InputError(f"limit: found {found}, expected a length in {own}")
        return "orientation", value * ANGLES[unit], "rad"
    if unit in LENGTHS and own in LENGTHS:
        return "position", value * LENGTHS[unit] / LENGTHS[own], own
    raise InputError(f"limit: found {quoted(limit)}, expected {expected}")


def _places(
    result: Result, mechanism: Mechanism, at: ReadingsArg | npt.ArrayLike | None
) -> tuple[Mapping[str, Any], str]:
    """Readings of the places that count, as the core takes them, and what they are."""
    posed = _posed(mechanism)
    device = Device(mechanism, *parameters_of(result, mechanism))
    if at is None:
        if posed and mechanism.to_dict().get("workspace"):
            _, exact = draw_poses(device, PLACES, np.random.default_rng(SEED))
            words = f"{PLACES} poses of the workspace"
        else:
            sensors = _core.calibrated_sensors(mechanism, as_applied(result, mechanism))
            exact = _core.within_limits(sensors, PLACES, seed=SEED)
            words = f"{len(exact)} configurations within the limits of the joints"
        readings = _held(result, mechanism, exact)
        return as_table([readings], mechanism, bare=not posed), words
    poses = _poses_of(at, mechanism) if posed else None
    if poses is not None:
        exact = device.readings(poses)
        wrong = np.flatnonzero(~np.isfinite(exact).all(axis=1))
        if len(wrong):
            found = f"pose {wrong[0] + 1} ({', '.join(f'{v:g}' for v in poses[wrong[0]])})"
            expected = "poses within reach, joint limits and ranges"
            raise InputError(f"at: found {found} beyond them, expected {expected}")
        readings = _held(result, mechanism, exact)
    else:
        readings = readings_for(at, mechanism, False)  # type: ignore[arg-type]
        _refuse_beyond_limits(readings, device)
    words = f"{len(readings)} places that were given"
    return as_table([readings], mechanism, bare=not posed), words


def _held(result: Result, mechanism: Mechanism, exact: FloatArray) -> Readings:
    """Held poses with these readings, about as warm as the session where that is known."""
    mean = None if result.reference is None else result.reference.temperature
    number = np.arange(1, len(exact) + 1)
    return _at(mechanism, exact, None if mean is None else mean + WARMER * (-1.0) ** number)


def _posed(mechanism: Mechanism) -> bool:
    """Whether it has a platform; else its places are those of points that chains carry."""
    return bool(mechanism.to_dict().get("platform"))


def _carried(mechanism: Mechanism) -> list[str]:
    """Points that chains carry."""
    return [point["name"] for point in mechanism.to_dict().get("point", ()) if point.get("chain")]


def _at(mechanism: Mechanism, values: FloatArray, temperature: npt.ArrayLike | None) -> Readings:
    """Held poses with these readings."""
    own: Any = mechanism if _posed(mechanism) else Bare(mechanism)
    number = np.arange(1, len(values) + 1)
    return Readings.from_arrays(own, values, pose=number, temperature_c=temperature)


def _poses_of(at: Any, mechanism: Mechanism) -> FloatArray | None:
    """Poses of an array, or of a file that has no readings; None where there are readings."""
    if isinstance(at, str | os.PathLike):
        table = read_table(at)
        if any(channel.name in table.names for channel in mechanism.channels):
            return None
        missing = [name for name in POSE if name not in table.names]
        if missing:
            expected = "x y z rx ry rz, or one column for each channel"
            raise InputError.at(
                table.source, column=missing[0], found="no such column", expected=expected
            )
        columns = [table.numbers(table.names.index(name)) for name in POSE]
        poses = np.stack(columns, axis=1)
        for row, column in np.argwhere(~np.isfinite(poses)):
            cell = table.columns[table.names.index(POSE[column])][row]
            raise InputError.at(
                table.source,
                line=int(table.lines[row]),
                line_word=table.line_word,
                column=POSE[column],
                found=quoted(cell),
                expected="a number",
            )
        if not len(poses):
            raise InputError.at(table.source, found="no row", expected="a pose at least")
        return poses
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
            raise InputError.at(
                readings.source, column=channel.name, found=found, expected=expected
            )


def _not_judged(result: Result) -> tuple[str, ...]:
    """Why a result cannot show that anything is within a limit; nothing where it can."""
    reasons = []
    if not isinstance(result, TraceShape):
        reasons.append(
            "A calibration is not searched for effects that could hide: certify a trace."
        )
    if result.verdict not in JUDGED:
        words = {
            "undetermined": "its poses do not determine the calibration",
            "implausible": "what was found is absurd beside the mechanism's size",
            "unjudged": "nothing judges its residual",
            **LEFT,
        }
        why = words.get(result.verdict, "its residual is significant")
        reasons.append(f"The result is {result.verdict or 'not judged'}: {why}.")
    elif isinstance(result, TraceShape) and not any(h.unseen for h in result.could_hide):
        reasons.append("The result does not hold what its session leaves open: trace again.")
    return tuple(reasons)


def _unsized(result: Result, quantity: str) -> tuple[str, ...]:
    """Effects that are not applied, and of which nobody knows how large they are."""
    steps = result.steps if isinstance(result, TraceShape) else ()
    names = [
        subject(step)
        for step in steps
        if not step.applied and getattr(step.platform_rms, quantity, None) is None
    ]
    if not names:
        return ()
    return (f"How large {listed_words(names)} is at these places, not applied, is not known.",)


Checked = tuple[Mapping[str, Any], int | None, float, float, bool]


def _by_check(result: Result, mechanism: Mechanism, quantity: str) -> Checked | None:
    """What check points show of a result that leaves something, as the core takes it.

    Readings in them, the number of the point that they are of, the mean square of a coordinate of
    the errors, that by noise, and whether the motion of the instrument was taken out.
    """
    if result.verdict not in LEFT or not isinstance(result, TraceShape):
        return None
    check, kept = result.quality.aligned or result.quality.check, result.check_readings
    if kept is None or check is None or check.largest is None:
        return None
    rms: float | None = check.position_rms
    noise = check.largest.position_noise
    if quantity == "orientation":
        rms, noise = check.orientation_rms, check.largest.orientation_noise
    if rms is None or noise is None or not any(h.unseen for h in result.could_hide):
        return None
    posed, point = _posed(mechanism), None
    if kept.point is not None:
        if posed:  # a point of the platform: its orientation is part of the error
            return None
        point = _carried(mechanism).index(kept.point)
    readings = _at(mechanism, np.array(kept.readings), kept.temperature_c)
    table = as_table([readings], mechanism, bare=not posed)
    return table, point, rms**2, noise**2, _aligned(result)


def _of_check(result: Result, times: float) -> tuple[str, ...]:
    size = f"{times:.2g} times" if times >= 1.05 else "no more than"
    return (
        f"The result is {result.verdict}: {LEFT[str(result.verdict)]}. How large its errors are is "
        f"by {_checked(result)} check points: {size} what is predicted of them, with effects that "
        "nobody named.",
    )


def _budget(
    result: Result,
    mechanism: Mechanism,
    covariance: FloatArray,
    table: Mapping[str, Any],
    quantity: str,
    confidence: float,
    checked: Checked | None,
) -> tuple[Uncertainty, tuple[str, ...], float]:
    """The budget, effects bound to the session, and how much larger errors are by check points."""
    noise = result.noise
    assert noise is not None  # `as_applied` refuses a result without it
    hidden = result.could_hide if isinstance(result, TraceShape) else ()
    unseen = [
        ((h.term, h.target, h.place), h.unseen.to_dict()) for h in hidden if h.unseen is not None
    ]
    play = _play(result, mechanism)
    applied = as_applied(result, mechanism)
    orientation = quantity == "orientation"
    found = _core.budget(
        mechanism, applied, covariance, _between(result), table, noise.dof, play, unseen,
        orientation, confidence, DRAWS, SEED, checked,
    )  # fmt: skip
    sigma = math.sqrt(float(np.mean(np.square(list(noise.sigma.values())))))
    units = {channel.unit for channel in mechanism.channels}
    sizes = {"play": (play, mechanism.length_unit)}
    if len(units) == 1:
        sizes["noise"] = (sigma, units.pop())
    sources = []
    for one in found["budget"]:
        size, unit = sizes.get(one["source"], (None, None))
        sensitivity = None if not size else one["u"] / size
        kind = "mixture" if one["source"] == "unseen" else "normal"
        kind = "Student" if one["dof"] is not None else kind
        sources.append(
            Source(**one, size=size, size_unit=unit, sensitivity=sensitivity, distribution=kind)
        )
    whole = Uncertainty(
        expanded=found["expanded"],
        median=found["median"],
        least=found["least"],
        u=found["u"],
        coverage_factor=found["expanded"] / found["u"],
        dof=found["dof"],
        places=found["places"],
        budget=tuple(sources),
    )
    return whole, tuple(found["of_its_session"]), found["times"]


def _covariance(result: Result) -> FloatArray | None:
    """Covariance of the parameters, as means over groups where they change between those."""
    between = result.between
    if between is None:
        return covariance_of(result)
    return covariance_of(replace(result, covariance=between.covariance))


def _between(result: Result) -> list[float]:
    """Variances of what changes between placements, for each parameter that has a value."""
    if result.between is None:
        return []
    sd = {(p.term, p.target, p.name): p.sd for p in result.between.parameters}
    known = [p for p in result.parameters if p.value is not None]
    return [sd.get((p.term, p.target, p.name), 0.0) ** 2 for p in known]


def _play(result: Result, mechanism: Mechanism) -> float:
    """Standard deviation of how what is touched sits: declared, or found by the fit."""
    closures = mechanism.to_dict().get("closure", ())
    declared = [closure.get("noise") or 0.0 for closure in closures]
    found = result.noise.seating if result.noise is not None else None
    return float(max([*declared, found or 0.0], default=0.0))


def _known(
    result: Result, quantity: str, confidence: float, noise: float, bound: tuple[str, ...] = ()
) -> tuple[tuple[float, float, int, float] | None, tuple[Known, ...]]:
    """What check poses have shown, as the core takes it, and all errors that are known."""
    known, seen = [], None
    check = result.quality.check if not _aligned(result) else result.quality.aligned
    if check is not None and check.largest is not None:
        largest = check.largest
        error = largest.position if quantity == "position" else largest.orientation
        sd = largest.position_noise if quantity == "position" else largest.orientation_noise
        if error is not None and sd is not None:
            seen = (error, sd, check.poses, noise)
            _, own = _core.decide(1.0, math.inf, 0.0, confidence, seen)
            known.append(Known("check points", error, own, check.poses))
    sizes = []
    for step in result.steps if isinstance(result, TraceShape) else ():
        of_its_session = _core.spec(step.term, step.target, step.place) in bound
        if step.platform_rms is not None and (of_its_session or not step.applied):
            # Of three coordinates; and a drift is √3 times its root mean square at its end.
            times = 3.0 if of_its_session else math.sqrt(3.0)
            size = getattr(step.platform_rms, quantity)
            sizes += [] if size is None else [times * size]
    if sizes:
        known.append(Known("effects not applied", math.hypot(*sizes), None, 0))
    return seen, tuple(known)


def _aligned(result: Result) -> bool:
    quality: FitQuality = result.quality
    return quality.aligned is not None


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
