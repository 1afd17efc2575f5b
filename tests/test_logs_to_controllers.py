"""From the log of a machine to its controller and back: simulated in plain distances."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

import rsicalib
from rsicalib.exports.opening import export_result
from tests.commands import run_text
from tests.test_imports import clbm

ANCHORS = np.array([[12.0, 2031.0, 100.0], [2870.0, 2018.0, 56.0], [0.0, 0.0, 34.0]])
ANCHORS = np.vstack([ANCHORS, [2889.0, 0.0, 78.0]])
"""Top left, top right, bottom left, bottom right [mm]."""


def belts(noise: float, rng: np.random.Generator) -> np.ndarray:
    """Lengths at 36 positions of the sled."""
    x, y = np.meshgrid(np.linspace(500.0, 2400.0, 6), np.linspace(400.0, 1600.0, 6))
    sled = np.column_stack([x.ravel(), y.ravel(), np.zeros(36)])
    exact = np.linalg.norm(sled[:, None] - ANCHORS, axis=2)
    return np.asarray(exact + noise * rng.standard_normal(exact.shape))


def test_the_log_of_a_maslow_becomes_anchors_that_its_firmware_takes(tmp_path: Path) -> None:
    log = tmp_path / "serial.log"
    log.write_text(clbm(belts(0.5, np.random.default_rng(0))) + "\n")
    found = rsicalib.calibrate(log, noise=0.8)  # as the closures of the log's mechanism have it
    mechanism = rsicalib.import_log(log).mechanism
    (text,) = export_result(found, "maslow", mechanism or "").values()
    made = {
        line.split("/")[-1].split("=")[0]: float(line.split("=")[1])
        for line in str(text).splitlines()
        if line.startswith("$")
    }
    corners = np.array([[made[f"{b}{a}"] for a in "XYZ"] for b in ("tl", "tr", "bl", "br")])
    told = {(p.target, p.name): p.sd for p in found.parameters}
    places = [("top left", "x", 0, 0), ("top left", "y", 0, 1), ("bottom right", "x", 3, 0)]
    for target, name, row, column in places:
        # noise of 0.5 mm where 0.8 is told
        assert abs(corners[row, column] - ANCHORS[row, column]) < 4 * (told[target, name] or 0.0)
    with pytest.raises(rsicalib.InputError, match="found no chain in 'Maslow4'"):
        export_result(found, "mjcf", mechanism or "")
    # the same lengths under these anchors, as the firmware would say them: the search begins there
    again = tmp_path / "again.log"
    again.write_text(str(text) + log.read_text())
    values = rsicalib.import_log(again).mechanism
    points = {p["name"]: p["at"] for p in rsicalib.load_mechanism(values or "").to_dict()["point"]}
    assert np.abs(np.array(points["top right"]) - corners[1]).max() < 1e-9  # as the lines say


def test_the_folder_of_a_trace_has_the_mechanism_for_the_way_back(tmp_path: Path) -> None:
    log, out = tmp_path / "serial.log", tmp_path / "report"
    log.write_text(clbm(belts(0.5, np.random.default_rng(0))) + "\n")
    assert run_text("trace", log, "--out", out, "--quiet").returncode == 0
    back = ["export", out / "result.json", "--to", "maslow"]
    lost = run_text(*back)
    assert lost.returncode == 2 and f"--mechanism {out / 'mechanism.toml'}" in lost.stderr
    done = run_text(*back, "--mechanism", out / "mechanism.toml")
    assert done.returncode == 0 and "$/kinematics/MaslowKinematics/tlX=" in done.stdout
    assert run_text("trace", log, "--out", out, "--quiet").returncode == 0, "written again"


def printer(
    stops: np.ndarray, radius: float, rng: np.random.Generator, by_hand: float = 0.0
) -> str:
    """A configuration with nominal endstops, and probes of a printer with others [mm].

    Every third height is measured by hand, with the nozzle up to `by_hand` above the bed.
    """
    angles = np.radians([210.0, 330.0, 90.0])
    towers = radius * np.column_stack([np.cos(angles), np.sin(angles)])
    turn = np.linspace(0.0, 2 * np.pi, 12, endpoint=False)
    spots = np.vstack(
        [[0.0, 0.0], *(r * np.column_stack([np.cos(turn), np.sin(turn)]) for r in (60, 110))]
    )
    across = ((spots[:, None] - towers) ** 2).sum(axis=2)
    top = stops + np.sqrt(340.0**2 - radius**2)
    heights = np.where(np.arange(len(spots)) % 3 == 1, rng.uniform(0, 1, len(spots)), 0) * by_hand
    steps = (top - np.sqrt(340.0**2 - across) - heights[:, None]) / (60 / 6400)
    steps += rng.standard_normal(steps.shape)
    lines = [
        "[printer]\nkinematics: delta\ndelta_radius: 172\n",
        *(f"[stepper_{t}]\nmicrosteps: 32\nrotation_distance: 60\n" for t in "bc"),
        "[stepper_a]\nmicrosteps: 32\nrotation_distance: 60\nposition_endstop: 330\n",
        "arm_length: 340\n[delta_calibrate]\nradius: 110\n",
        "#*# <---------------------- SAVE_CONFIG ---------------------->\n#*# [delta_calibrate]\n",
    ]
    numbers = {"height": 0, "manual_height": 0}
    for height, row in zip(heights, steps, strict=True):
        kind = "manual_height" if height else "height"
        name = f"{kind}{numbers[kind]}"
        numbers[kind] += 1
        lines.append(f"#*# {name} = {height:.6f}\n")
        lines.append(f"#*# {name}_pos = {row[0]:.3f},{row[1]:.3f},{row[2]:.3f}\n")
    return "".join(lines)


def test_heights_by_hand_are_of_the_same_printer(tmp_path: Path) -> None:
    """The nozzle stood 0 to 5 mm above the bed; offsets are as true as from the bed alone."""
    stops = np.array([331.2, 329.7, 330.4])
    path = tmp_path / "printer.cfg"
    path.write_text(printer(stops, 172.0, np.random.default_rng(2), by_hand=5.0))
    log = rsicalib.import_log(path)
    assert len(log.sessions[0]) == 25
    assert any("8 of 25 probes are at another height than 0 mm" in f for f in log.findings)
    found = rsicalib.calibrate(path)
    assert found.verdict in ("adequate", "unjudged")
    carriage = stops + np.sqrt(340.0**2 - 172.0**2)
    for p, true in zip(found.parameters, carriage, strict=True):
        assert p.value is not None and p.sd is not None
        assert abs(p.value - true) < 4 * p.sd < 0.2


def test_the_probes_of_a_printer_become_endstops_that_klipper_takes(tmp_path: Path) -> None:
    stops = np.array([331.2, 329.7, 330.4])
    path = tmp_path / "printer.cfg"
    path.write_text(printer(stops, 172.0, np.random.default_rng(1)))
    found = rsicalib.calibrate(path)
    mechanism = rsicalib.import_log(path).mechanism or ""
    (block,) = export_result(found, "klipper", mechanism).values()
    body, probes = path.read_text().split("#*# <")
    for option in ("delta_radius: 172\n", "position_endstop: 330\n", "arm_length: 340\n"):
        body = body.replace(option, "")
    again = tmp_path / "again.cfg"
    again.write_text(f"{body}{block}{probes.split(chr(10), 1)[1]}")
    made = [float(line.split("=")[1]) for line in str(block).splitlines() if "endstop" in line]
    told = [p.sd or 0.0 for p in found.parameters]
    assert (np.abs(made - stops) < 4 * np.array(told)).all()
    # read again, nothing is left to find: the loops close as the calibration closes them
    text = (rsicalib.import_log(again).mechanism or "").replace('["offset"]', "[]")
    closed = rsicalib.calibrate(again, text)
    before, after = found.fit.rms_misclosure, closed.fit.rms_misclosure
    assert before is not None and after is not None
    assert abs(after - before) < 1e-4 * before  # six decimals of mm, and the weights of a fit
