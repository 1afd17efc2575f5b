"""The paper's tables, computed again beside the printed ones.

J. M. Hollerbach and D. M. Lokhorst, "Closed-Loop Kinematic Calibration of the RSI 6-DOF Hand
Controller". The printed numbers come with the package (`reproduction/tables.toml`). No raw readings
were published: what needs them is simulated on a device with parameter set I.
"""

from __future__ import annotations

from collections.abc import Callable

from rsicalib import _core, options
from rsicalib.reproduction.document import Paper
from rsicalib.reproduction.misprints import misprints
from rsicalib.reproduction.printed import printed_numbers
from rsicalib.reproduction.section_iv import calibration_table, calibrations
from rsicalib.reproduction.study import Study
from rsicalib.reproduction.table_convergence import convergence
from rsicalib.reproduction.table_noise import table_ix
from rsicalib.reproduction.tables_geometry import poses, table_i
from rsicalib.reproduction.tables_observability import bounds, table_viii
from rsicalib.reproduction.tables_parameters import parameters, table_vi, table_vii


@options.checked
def paper(
    trials: int = 1000,
    *,
    seed: int = 1995,
    progress: Callable[[str, int, int], None] | None = None,
    workers: int | None = None,
) -> Paper:
    """Compute every table of the paper again.

    Parameters
    ----------
    trials : int
        Number of trials in every simulated cell; standard errors shrink with its root.
    seed : int
        Same seed, same figures, on any number of cores.
    progress : callable, optional
        Called with what is being computed, trials done, and trials in all.
    workers : int, optional
        Threads; as many as there are cores by default.

    Returns
    -------
    Paper
        Tables and misprints, each figure beside the printed one.

    Raises
    ------
    InputError
        There are not enough trials.
    """
    printed = printed_numbers()
    study = Study(printed, trials, seed, progress or (lambda _what, _done, _of: None), workers)
    found = calibrations(study)
    noise, cells = table_ix(study)
    tables = (
        table_i(study),
        poses(study, "II", "calibration poses of the fixture", printed.fixture),
        poses(study, "III", "calibration poses of the closed loop", printed.closed_loop),
        parameters(study, "IV", "calibrated offsets (rad)", "offsets", found),
        parameters(study, "V", "calibrated gains (1e-3 rad/count)", "gains", found),
        table_vi(study),
        table_vii(study),
        table_viii(study),
        noise,
        convergence(study),
        calibration_table(study, found),
        bounds(study),
    )
    study.say("misprints", 0, 1)
    settled = misprints(printed, cells, max(2, trials // 2), seed)
    study.say("misprints", 1, 1)
    return Paper("rsicalib.paper/1", _core.__version__, trials, seed, tables, settled)
