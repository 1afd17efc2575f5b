"""Calibration from known poses: the verb `fixture`."""

from __future__ import annotations

from typing import Any

import numpy as np

from rsicalib import _core, options
from rsicalib.errors import InputError, UndeterminedError
from rsicalib.facts.shapes import Parameter
from rsicalib.facts.warned import Warned
from rsicalib.plain_text import counted
from rsicalib.results.result import Calibration
from rsicalib.work.applying import posed
from rsicalib.work.arguments import MechanismArg, ReadingsArg
from rsicalib.work.closing import open_loops
from rsicalib.work.job import Work
from rsicalib.work.outcome import NOTHING, DateArg, about
from rsicalib.work.reach import reach_told


@options.checked
def fixture(
    readings: ReadingsArg,
    mechanism: MechanismArg = "rsi",
    *,
    check: ReadingsArg | None = None,
    check_point: str | None = None,
    check_noise: float | None = None,
    check_noise_angle: float | None = None,
    align: bool = False,
    skip_bad_rows: bool = False,
    device: str | None = None,
    note: str | None = None,
    date: DateArg | None = None,
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
    check_point, check_noise, check_noise_angle, align : optional
        As in `calibrate`.
    skip_bad_rows, device, note, date : optional
        As in `calibrate`.

    Returns
    -------
    Calibration
        Whose noise is that of one reading about its line, by the repeats in a pose and by the
        scatter of poses: lack of fit cannot be judged.

    Raises
    ------
    InputError
        A pose is out of reach (the message says in which line, which arm and by how much), or
        there are none.
    """
    job = Work(mechanism, skip_bad_rows, None, about(device, note, date))
    job.take(readings, None, None, known_poses=True)
    known = job.known(check, check_point, (check_noise, check_noise_angle), align)
    table, poses, *_ = posed(job.readings[0], job.mechanism)
    if not np.isfinite(poses).all(axis=1).any():
        raise InputError.at(
            job.readings[0].source,
            "places without orientation",
            "known poses: x y z [length unit] and rx ry rz [rad]",
        )
    read = job.readings[0]
    labels = read.pose if read.held else None
    where = (read.source, read.lines)
    try:
        with reach_told(job.mechanism, poses, *where, line_word=read.line_word, labels=labels):
            lines, count = _core.fixture(job.mechanism, table, poses)
    except UndeterminedError as error:
        nothing = {"method": "fixture", "fit": NOTHING}
        return Calibration.made(job.too_few(Calibration, error, None) | nothing)
    known_rows = np.asarray(np.isfinite(poses).all(axis=1))
    if not known_rows.all():
        without = len(np.unique(job.readings[0].pose[~known_rows]))
        rows = len(known_rows) - known_rows.sum()
        text = (
            f"{job.readings[0].source}: {counted(rows, 'row')} of {counted(without, 'pose')} have "
            f"no known pose (x y z rx ry rz) and are not used; {count} poses are"
        )
        job.warnings.append(Warned("unused_poses", None, text))
    parameters, blocks, sigma = [], [], {}
    for channel, line in zip(job.mechanism.channels, lines, strict=True):
        block = np.full((2, 2), np.nan) if line["covariance"] is None else line["covariance"]
        blocks.append(np.array(block))
        sigma[channel.name] = line["noise"]
        for k, (name, unit) in enumerate((("offset", "rad"), ("gain", f"rad/{channel.unit}"))):
            sd = None if line["covariance"] is None else line["covariance"][k][k] ** 0.5
            parameters.append(Parameter(name, channel.name, name, line[name], sd, unit))
    repeated = len(known_rows) > job.readings[0].n_poses
    covariance = np.zeros((2 * len(blocks), 2 * len(blocks)))
    for k, block in enumerate(blocks):
        covariance[2 * k : 2 * k + 2, 2 * k : 2 * k + 2] = block
    found: dict[str, Any] = {
        "method": "fixture",
        "noise": {
            "source": ("repeats, and " if repeated else "") + "scatter about the lines",
            "sigma": sigma,
            "unit": {channel.name: channel.unit for channel in job.mechanism.channels},
            "kind": "fit",
            "correlation": None,
            "dof": min(line["dof"] for line in lines),
        },
        **_core.judged_open_loop(count),
        "fit": {**NOTHING},
        "parameters": parameters,
        "covariance": covariance,
        "termination": "one linear step",
    }
    result = Calibration.made(job.result(Calibration, found, None))
    if known is None:
        return result
    fit = {"check": job.error(known, result, False), "aligned": None}
    nominal = {"check": job.nominal_error(known, align=False), "aligned": None}
    if align:
        fit["aligned"] = job.error(known, result, True)
        nominal["aligned"] = job.nominal_error(known, align=True)
    checked, declared = (e["aligned" if align else "check"] for e in (fit, nominal))
    opened = None if job.checked is None else open_loops(job.checked, job.mechanism, result)
    judged = _core.judged_open_loop(count, checked, declared, opened and opened[:3])
    again = result.to_dict() | judged | {"fit": NOTHING | fit, "nominal": NOTHING | nominal}
    again["made_from"] = result.made_from
    if opened is not None:
        told = Warned("open_loops", None, opened.text)
        again["warnings"] = [*again["warnings"], told.to_dict()]
    return Calibration.made(again)
