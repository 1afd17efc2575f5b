"""Table IX: noise and averaging, closed loop and open loop."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any

from rsicalib.arrays import FloatArray
from rsicalib.reproduction.document import Cell, Row, Table
from rsicalib.reproduction.noise import NoiseCell, closed_loop_noise, open_loop_noise
from rsicalib.reproduction.study import Study


def table_ix(study: Study) -> tuple[Table, dict[str, float]]:
    """Table IX, and the errors of the offsets in its closed-loop cells by name."""
    printed = study.numbers["noise"]
    levels = [(average, noise) for average in (2, 100) for noise in (0, 1, 2, 4)]
    rows, cells = [], {}

    def cell(of: Callable[..., NoiseCell], poses: FloatArray, name: str, **how: Any) -> NoiseCell:
        return of(study.printed.nominal, poses, study.draws(f"Table IX, {name}"), **how)

    def row(kind: str, label: str, average: int, noise: int, found: NoiseCell) -> Row:
        table = printed[f"{kind}_average_{average}"]
        return _noise_row(label, found, table[str(noise) if noise else "truncation"])

    for average, noise in levels:
        name, poses = f"closed {average} {noise}", study.printed.closed_loop
        found = cell(closed_loop_noise, poses, name, noise=noise, average=average)
        cells[name] = found.offset.value
        if noise or average == 2:
            label = f"closed loop, average {average}, {_level(noise)}"
            rows.append(row("closed", label, average, noise, found))
    angle = float(printed["open_loop_angle_noise_rad"])
    for average, noise in levels:
        for averaged in (True, False) if noise or average == 2 else ():
            how = {"angle_noise": angle, "average_angles": averaged}
            name, poses = f"open {average} {noise}", study.printed.fixture
            found = cell(open_loop_noise, poses, name, noise=noise, average=average, **how)
            words = "angles averaged" if averaged else "angles not averaged"
            label = f"open loop, average {average}, {_level(noise)}, {words}"
            rows.append(row("open", label, average, noise, found))
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
    sd = None if gain.sd is None else gain.sd * 1e3
    cells = Cell(off.value, printed[0], off.sd), Cell(gain.value * 1e3, printed[1], sd)
    return Row(label, cells)


def _level(noise: int) -> str:
    return f"σ = {noise}" if noise else "truncation"
