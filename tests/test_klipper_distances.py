"""Distances of a printed object beside the heights of a bed: plain geometry of a delta printer."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest
from scipy.optimize import least_squares

import rsicalib
from tests.full import sized
from tests.oracle import Array
from tests.test_imports import PRINTER

ARM, RADIUS, STOP, STEP = 340.0, 172.0, 332.99, 60 / 6400
BEARING = np.deg2rad([211.5, 330.0, 90.0])
TERMS = ["offset", "link_length@each/1", *(f"distance@arm {t}" for t in "abc")]
CALIPER, TOUCH = 0.05, 0.03
HEIGHTS = sized(15, 30)
FURTHER, LONGER, STOPS = 0.8, 0.6, np.array([-0.7, 0.4, 0.9])
"""How far out the towers really stand, how much longer the arms are, and the endstops [mm]."""


def towers(radius: float) -> Array:
    return np.column_stack([np.cos(BEARING), np.sin(BEARING)]) * radius


def carriages(at: Array, radius: float, arm: float) -> Array:
    """Heights of the carriages that hold the nozzle at a place."""
    apart = np.hypot(*(towers(radius) - at[:2]).T)
    return np.asarray(at[2] + np.sqrt(arm**2 - apart**2))


def nozzle(up: Array, radius: float, arm: float) -> Array:
    """Where three carriages hold the nozzle: SciPy's least squares of three spheres."""
    tops = np.column_stack([towers(radius), up])

    def off(at: Array) -> Array:
        return np.asarray(np.linalg.norm(tops - at, axis=1) - arm)

    return np.asarray(least_squares(off, [0.0, 0.0, 0.0], xtol=1e-14, ftol=1e-14).x)


def printer(rng: np.random.Generator, pairs: int) -> str:
    """`printer.cfg` with heights, and distances between places that were asked for as drawn."""
    drawn, true = STOP + np.sqrt(ARM**2 - RADIUS**2), STOP + STOPS
    true = true + np.sqrt(ARM**2 - RADIUS**2)

    def steps(up: Array, top: Array | float) -> str:
        return ",".join(f"{s:.3f}" for s in np.round((top - up) / STEP))

    text = PRINTER
    for k in range(HEIGHTS):
        far, turn = 110 * np.sqrt((k + 1) / HEIGHTS), 2.4 * k
        at = np.array([far * np.cos(turn), far * np.sin(turn), rng.normal(0, TOUCH)])
        text += f"#*# height{k} = 0.0\n"
        text += (
            f"#*# height{k}_pos = {steps(carriages(at, RADIUS + FURTHER, ARM + LONGER), true)}\n"
        )
    for k in range(pairs):
        turn = np.pi * k / 6
        ends = [80 * s * np.array([np.cos(turn), np.sin(turn), 0.0]) for s in (1, -1)]
        asked = [steps(carriages(end, RADIUS, ARM), drawn) for end in ends]
        ups = [true - np.array([float(s) for s in one.split(",")]) * STEP for one in asked]
        there = [nozzle(up, RADIUS + FURTHER, ARM + LONGER) for up in ups]
        long = np.linalg.norm(there[0] - there[1]) + rng.normal(0, CALIPER)
        text += f"#*# distance{k} = {long:.6f}\n"
        text += "".join(f"#*# distance{k}_pos{e} = {s}\n" for e, s in enumerate(asked, 1))
    return text


@pytest.fixture(scope="module")
def six(tmp_path_factory: pytest.TempPathFactory) -> tuple[rsicalib.Log, Any]:
    """A bed and six distances, read and calibrated."""
    return read(tmp_path_factory.mktemp("six") / "printer.cfg", 6)


def read(path: Path, pairs: int) -> tuple[rsicalib.Log, rsicalib.CalibrationResult]:
    path.write_text(printer(np.random.default_rng(5), pairs), encoding="utf-8")
    log = rsicalib.import_log(path)
    return log, rsicalib.calibrate(path, terms=TERMS)


def test_distances_are_pairs_of_rows_on_no_bed(six: tuple[rsicalib.Log, Any]) -> None:
    log, found = six
    (session,) = log.sessions
    assert np.isnan(np.asarray(session.columns["height"])).sum() == 12
    assert session.columns["touch"][HEIGHTS : HEIGHTS + 2] == ["distance0a", "distance0b"]
    # These heights and six distances tell three endstops, a radius and three arms.
    assert found.to_dict()["fit"]["p_value"] > 1e-3
    for p in found.parameters:
        truth = {"link_length": FURTHER, "distance": LONGER}.get(p.term)
        if truth is not None:
            assert p.sd is not None
            assert abs(p.value - truth) < 5 * p.sd, p


def test_the_files_of_an_import_are_read_as_the_log_is(
    six: tuple[rsicalib.Log, Any], tmp_path: Path
) -> None:
    """A row without a height has an empty cell, not the word `nan`, which is no number."""
    log, found = six
    log.save(tmp_path / "log")
    (heights,) = [k for k, name in enumerate(log.sessions[0].columns) if name == "height"]
    rows = (tmp_path / "log" / "readings.csv").read_text(encoding="utf-8").splitlines()[1:]
    assert [row.split(",")[heights] for row in rows[HEIGHTS:]] == [""] * 12
    again = rsicalib.calibrate(
        tmp_path / "log" / "readings.csv", tmp_path / "log" / "mechanism.toml", terms=TERMS
    )
    assert [(p.key, p.value) for p in again.parameters] == [
        (p.key, p.value) for p in found.parameters
    ]


def test_distances_tell_what_a_bed_alone_does_not(
    six: tuple[rsicalib.Log, Any], tmp_path: Path
) -> None:
    """How long everything is: radius and arms together."""
    sd = []
    for _, found in (read(tmp_path / "printer.cfg", 0), six):
        (radius,) = [p for p in found.parameters if p.term == "link_length"]
        sd.append(radius.sd)
    assert sd[1] is not None
    assert sd[0] is None or sd[1] < 0.5 * sd[0]


def test_a_distance_without_its_second_end_is_refused(tmp_path: Path) -> None:
    path = tmp_path / "printer.cfg"
    text = printer(np.random.default_rng(5), 2).replace("distance1_pos2", "distance1_pos3")
    path.write_text(text, encoding="utf-8")
    with pytest.raises(rsicalib.errors.InputError, match="distance1_pos2"):
        rsicalib.import_log(path)
