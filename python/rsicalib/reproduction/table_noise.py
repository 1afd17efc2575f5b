"""Table IX: noise and averaging, closed loop and open loop."""

from __future__ import annotations

from collections.abc import Sequence

from rsicalib.reproduction.document import Cell, Row, Table
from rsicalib.reproduction.noise import NoiseCell, closed_loop_noise, open_loop_noise
from rsicalib.reproduction.study import Study


def table_ix(study: Study) -> tuple[Table, dict[str, float]]:
    """Table IX, and the errors of the offsets in its closed-loop cells by name."""
    printed = study.numbers["noise"]
    rows, cells = [], {}
    for average in (2, 100):
        table = printed[f"closed_average_{average}"]
        for noise in (0, 1, 2, 4):
            name = f"closed {average} {noise}"
            found = closed_loop_noise(
                study.printed.nominal,
                study.printed.closed_loop,
                noise=noise,
                average=average,
                trials=study.trials,
                seed=study.seed,
                progress=study.told(f"Table IX, {name}"),
                workers=study.workers,
            )
            cells[name] = found.offset.value
            if noise or average == 2:
                label = f"closed loop, average {average}, " + _level(noise)
                rows.append(
                    _noise_row(label, found, table["truncation" if not noise else str(noise)])
                )
    angle = float(printed["open_loop_angle_noise_rad"])
    for average in (2, 100):
        table = printed[f"open_average_{average}"]
        for noise in (0, 1, 2, 4):
            if not noise and average == 100:
                continue
            for averaged in (True, False):
                name = f"Table IX, open {average} {noise}"
                found = open_loop_noise(
                    study.printed.nominal,
                    study.printed.fixture,
                    noise=noise,
                    average=average,
                    angle_noise=angle,
                    average_angles=averaged,
                    trials=study.trials,
                    seed=study.seed,
                    progress=study.told(name),
                    workers=study.workers,
                )
                how = "angles averaged" if averaged else "angles not averaged"
                label = f"open loop, average {average}, {_level(noise)}, {how}"
                rows.append(
                    _noise_row(label, found, table["truncation" if not noise else str(noise)])
                )
    title = "noise and averaging: rms error of one calibration, mean over trials"
    columns = ("offsets [rad]", "gains [1e-3 rad/count]")
    notes = (
        "Closed loop: reproduced with “variance” read as standard deviation in counts, poses "
        "placed with N(0, 0.25) in and rad, samples rounded, and their average rounded again; "
        "see the misprints.",
        f"Open loop: not reproduced. With noise of {angle} rad in the angles of each sample, "
        "averaged with them, errors fall with the samples as printed but are too small; with "
        "one error for each pose they do not fall at all.",
    )
    return Table("IX", title, columns, tuple(rows), "partly reproduced", notes), cells


def _noise_row(label: str, found: NoiseCell, printed: Sequence[float]) -> Row:
    off, gain = found.offset, found.gain
    if found.failed:
        label += f" ({found.failed} failed)"
    return Row(
        label,
        (
            Cell(off.value, printed[0], off.sd),
            Cell(gain.value * 1e3, printed[1], None if gain.sd is None else gain.sd * 1e3),
        ),
    )


def _level(noise: int) -> str:
    return f"σ = {noise}" if noise else "truncation"
