"""Parameters from joint readings alone: the verb `calibrate`."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

from rsicalib.errors import UndeterminedError
from rsicalib.options import checked
from rsicalib.results.result import Calibration
from rsicalib.work.arguments import (
    CalibrationArg,
    MechanismArg,
    ReadingsArg,
    SessionsArg,
    with_logs,
)
from rsicalib.work.job import Work
from rsicalib.work.listening import ProgressArg, finished
from rsicalib.work.outcome import NOTHING, DateArg, about
from rsicalib.work.prior import PopulationArg


@checked
def calibrate(
    readings: SessionsArg,
    mechanism: MechanismArg = "rsi",
    *,
    rest: ReadingsArg | None = None,
    check: ReadingsArg | None = None,
    check_point: str | None = None,
    check_noise: float | None = None,
    check_noise_angle: float | None = None,
    terms: Sequence[str] | None = None,
    closures: Sequence[str] | None = None,
    method: str | None = None,
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
    seed: int | None = None,
    starts: int | None = None,
    max_iterations: int | None = None,
    xtol: float | None = None,
    progress: ProgressArg | None = None,
) -> Calibration:
    """Find the parameters of a closed mechanism from its joint readings alone.

    Minimises eq. (51) of `docs/model.md`, noise in every reading, over the
    parameters of `terms`. Readings that are wrong are left out and listed in
    `excluded`; the calibration with them is `with_excluded`.

    Parameters
    ----------
    readings : path, Readings, data frame, or a sequence of them
        `n` samples each; several are sessions of one device. Logs of other programs are taken
        as `import_log` reads them.
    mechanism : str, path, mapping or Mechanism
        What is read, as `load_mechanism` takes it.
    rest : path or Readings, optional
        A reading of the rest pose: where the search starts.
    check : path or Readings, optional
        Known poses, never used in the fit: for the error of the platform; `x y z` alone are places
        of a point that a chain carries.
    check_point : str, optional
        Which point, where chains carry several.
    check_noise, check_noise_angle : float, optional
        Standard deviations of what is known: of a coordinate of a place [length unit], and of an
        angle [rad]. Exact where not given: the instrument adds nothing to what is predicted.
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
        and with which the new one is compared: parameter by parameter (`moved`), and
        by what may have changed and whether an update is worth it (`update`).
    population : path or mapping, optional
        What devices of the same design share, `population.json` of `fleet`: a prior of the
        parameters, whose terms are identified unless others are given. Fewer poses are enough.
    align : bool, optional
        Give the error of the check poses also after the best rigid motion of
        the instrument that measured them.
    fit_groups, hold_out_groups : sequence of str, optional
        Values of the column `group` to use, or to leave out. Those that were not
        used are measured too, see `groups` of the result.
    skip_bad_rows : bool, optional
        Drop rows that cannot be used and list them in the result.
    device, note : str, optional
        What the device is called, and what is to be remembered of the session.
    date : str or date, optional
        From when the parameters hold, ISO 8601: `valid_from` of the result.
    seed : int, optional
        Nothing is drawn at random here: the same readings give the same result.
    starts : int, optional
        Upper limit of starts that are tried.
    max_iterations : int, optional
        Steps of the solver.
    xtol : float, optional
        Relative step below which the solver has converged.
    progress : callable, optional
        Called with the stage in words and the share that is done, 0 to 1: an estimate that
        never falls. What it raises ends the job, and is raised.

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
    >>> from rsicalib import DEMO
    >>> found = calibrate(DEMO / "readings.csv", rest=DEMO / "rest.csv")
    >>> found.noise.source
    'misclosure of repeats'
    """
    readings, mechanism = with_logs(readings, mechanism, skip_bad_rows, calibration)
    job = Work(mechanism, skip_bad_rows, calibration, about(device, note, date), population)
    job.take(readings, fit_groups, hold_out_groups)
    search = {"method": method, "starts": starts, "max_iterations": max_iterations, "xtol": xtol}
    session = job.asked(rest, terms, closures, noise, progress, search)
    known = job.known(check, check_point, (check_noise, check_noise_angle), align)
    beside = job.beside(known, align)
    try:
        report, *_ = session.calibrate(beside)
    except UndeterminedError as error:
        return Calibration.made(job.too_few(Calibration, error, session) | {"fit": NOTHING})
    found = {**report, "method": method or Calibration.method, "update": job.update(report, "fit")}
    return finished(Calibration.made(job.result(Calibration, found, session)))
