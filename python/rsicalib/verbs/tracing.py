"""The effect that explains a residual: the verb `trace`."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

from rsicalib.errors import UndeterminedError
from rsicalib.options import checked
from rsicalib.results.result import Trace
from rsicalib.work.arguments import (
    CalibrationArg,
    MechanismArg,
    ReadingsArg,
    SessionsArg,
    names_in,
    with_logs,
)
from rsicalib.work.job import Work
from rsicalib.work.listening import ProgressArg, finished
from rsicalib.work.outcome import NOTHING, DateArg, about
from rsicalib.work.prior import PopulationArg


@checked
def trace(
    readings: SessionsArg,
    mechanism: MechanismArg = "rsi",
    *,
    rest: ReadingsArg | None = None,
    check: ReadingsArg | None = None,
    check_point: str | None = None,
    check_noise: float | None = None,
    check_noise_angle: float | None = None,
    terms: Sequence[str] | None = None,
    without: Sequence[str] | None = None,
    closures: Sequence[str] | None = None,
    noise: float | Mapping[str, float] | None = None,
    calibration: CalibrationArg | None = None,
    population: PopulationArg | None = None,
    align: bool = False,
    fit_groups: Sequence[str] | None = None,
    hold_out_groups: Sequence[str] | None = None,
    skip_bad_rows: bool = False,
    device: str | None = None,
    note: str | None = None,
    date: DateArg | None = None,
    apply_all: bool = False,
    seed: int | None = None,
    starts: int | None = None,
    max_iterations: int | None = None,
    xtol: float | None = None,
    progress: ProgressArg | None = None,
) -> Trace:
    """Trace the residual of a calibration to the effect that the model lacks.

    Fits, and searches over sets of effects, wrong readings and noise that nobody knows
    of for those that are likeliest.

    Parameters
    ----------
    readings : path, Readings, or a sequence of them
        As in `calibrate`; so are all options that are not described here.
    mechanism : str, path or Mechanism
        What is read.
    rest, check, check_point, check_noise, check_noise_angle : optional
        As in `calibrate`.
    terms, closures, noise, calibration : optional
        As in `calibrate`; `terms` are those to begin with.
    without : sequence of str, optional
        Terms that are not candidates.
    align, fit_groups, hold_out_groups, skip_bad_rows, device, note, date : optional
        As in `calibrate`.
    apply_all : bool
        Apply every effect that is found. Else one that does not help on placements, sessions or
        parts of the workspace that are left out, or in whose place a law that no term has is
        likelier, is named, `step.not_applied` says why, and `parameters` are without it.
    seed, starts, max_iterations, xtol, progress : optional
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
    >>> from rsicalib import DEMO
    >>> found = trace(DEMO / "readings.csv", rest=DEMO / "rest.csv", check=DEMO / "check.csv")
    >>> [(step.klass, step.target) for step in found.steps]
    [('sensor', 'a22')]
    """
    readings, mechanism = with_logs(readings, mechanism, skip_bad_rows, calibration)
    job = Work(mechanism, skip_bad_rows, calibration, about(device, note, date), population)
    job.take(readings, fit_groups, hold_out_groups)
    search = {"starts": starts, "max_iterations": max_iterations, "xtol": xtol}
    session = job.asked(rest, terms, closures, noise, progress, search)
    known = job.known(check, check_point, (check_noise, check_noise_angle), align)
    beside = job.beside(known, align)
    try:
        report = session.trace(
            beside, without=names_in("without", without, job.mechanism), apply_all=apply_all
        )
    except UndeterminedError as error:
        nothing = {"before": NOTHING, "after": NOTHING}
        return Trace.made(job.too_few(Trace, error, session) | nothing)
    lacking = {"not_candidates": dict(sorted(session.lacking().items()))}
    found = {**report, **lacking, "update": job.update(report, "after")}
    return finished(Trace.made(job.result(Trace, found, session)))
