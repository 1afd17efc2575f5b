"""Rows in which a closure does not hold: a cone beside a table, a tracker that does not see all."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

import rsicalib
from rsicalib.errors import InputError
from tests.machines import files
from tests.machines.arm import JOINTS, Body, Job
from tests.machines.kit import Machine
from tests.machines.trials import MACHINES
from tests.oracle import Array
from tests.test_machines import chi2

SEED = 4


def session(name: str, folder: Path) -> tuple[Machine, Array, Path, Path]:
    rng = np.random.default_rng(SEED)
    machine = MACHINES[name](rng)
    read = machine.observe(rng)
    return machine, read, *files.write(machine, read, folder)


@pytest.mark.parametrize(
    ("name", "equations", "fitted"),
    [
        # Rows on the table have one equation, those in a socket three. Fitted are five joints (the
        # first turns arm and all together), a plane, and two points.
        ("sockets", 30 + 30 * 3, 5 + 3 + 2 * 3),
        # All rows have the table's, every other one the tracker's three. Plane and frame.
        ("seen", 50 + 25 * 3, 5 + 3 + 6),
    ],
)
def test_what_does_not_hold_is_not_counted_and_says_nothing(
    name: str, equations: int, fitted: int, tmp_path: Path
) -> None:
    """Against SciPy's least squares of the simulator's own equations, zero where none is asked."""
    machine, read, csv, mechanism = session(name, tmp_path)
    found = rsicalib.calibrate(csv, mechanism).to_dict()
    assert round(found["fit"]["dof"]) == equations - fitted
    # The witness carries the noise of the readings through as it is at the truth, the fit as it is
    # at its own readings: the two differ in second order, some thousandths.
    assert found["fit"]["chi2"] == pytest.approx(chi2(machine, read), rel=0.02)
    for p in found["parameters"]:
        truth = machine.values.get(f"{p['name']}@{p['target']}")
        if p["sd"] is not None and truth is not None:
            assert abs(p["value"] - truth) < 5 * p["sd"], p


def test_held_out_rows_are_judged_by_what_holds_in_them(tmp_path: Path) -> None:
    *_, csv, mechanism = session("sockets", tmp_path)
    held = rsicalib.trace(csv, mechanism).to_dict()["before"]["held_out"]
    # 106 degrees of freedom: 1 ± .14, and what is fitted without the fold errs a little more.
    assert 0.6 < held["chi2_per_dof"] < 1.7


def test_a_length_that_was_measured_in_some_rows_counts_there(tmp_path: Path) -> None:
    """A caliper between tool and a known post, in every third row beside a table."""
    rng = np.random.default_rng(SEED)
    job = Job(Body.random(rng), rng, 45)
    job.plane("table")
    machine = job.machine("caliper")
    read = machine.observe(rng)
    post, noise = np.array([300.0, -200.0, 50.0]), 0.05
    long = np.linalg.norm(job.body.tip(read, machine.values) - post, axis=1)
    long += noise * rng.standard_normal(len(long))
    some = np.arange(len(read)) % 3 == 0
    drawn = dict(machine.mechanism)
    drawn["point"] = [*drawn["point"], {"name": "post", "at": post.tolist()}]
    bar = {"name": "caliper", "kind": "distance", "between": ["tool", "post"], "value": "long"}
    drawn["closure"] = [*drawn["closure"], bar | {"noise": noise}]
    csv, mechanism = files.write(machine, read, tmp_path)
    mechanism.write_text(files.toml(drawn), encoding="utf-8")
    head, *rows = csv.read_text(encoding="utf-8").splitlines()
    cells = [f"{x:.5f}" if there else "" for x, there in zip(long, some, strict=True)]
    whole = [f"{row},{cell}" for row, cell in zip(rows, cells, strict=True)]
    csv.write_text("\n".join([head + ",long", *whole]) + "\n", encoding="utf-8")
    found = rsicalib.calibrate(csv, mechanism).to_dict()
    # The post is known: the first joint is, too.
    assert round(found["fit"]["dof"]) == 45 + 15 - (6 + 3)
    assert found["fit"]["p_value"] > 1e-3
    for p in found["parameters"]:
        if p["term"] == "offset" and p["target"] in JOINTS:
            assert abs(p["value"] - machine.values[f"offset@{p['target']}"]) < 5 * p["sd"], p


@pytest.mark.parametrize(("column", "cell"), [("surface", ""), ("q3", "")])
def test_a_row_that_touches_nothing_and_a_blank_reading_are_refused(
    column: str, cell: str, tmp_path: Path
) -> None:
    *_, csv, mechanism = session("sockets", tmp_path)
    head, first, *rows = csv.read_text(encoding="utf-8").splitlines()
    cells = dict(zip(head.split(","), first.split(","), strict=True)) | {column: cell}
    csv.write_text("\n".join([head, ",".join(cells.values()), *rows]) + "\n", encoding="utf-8")
    with pytest.raises(InputError) as refused:
        rsicalib.calibrate(csv, mechanism)
    where = refused.value.where
    assert (where["line"], where["column"], where["found"]) == (2, column, "blank")


@pytest.mark.parametrize(("what", "term"), [("bend", "plane_bend"), ("step", "plane_slip")])
def test_of_two_surfaces_the_one_that_is_not_as_it_should_be_is_named(
    what: str, term: str, tmp_path: Path
) -> None:
    rng = np.random.default_rng(SEED)
    machine = MACHINES["plane"](rng)
    machine.values[f"{what}@wall"] = 0.4
    read = machine.observe(rng)
    found = rsicalib.trace(*files.write(machine, read, tmp_path)).to_dict()
    named = [(step["term"], step["target"]) for step in found["steps"]]
    assert named == [(term, "surface[surface=wall]")]
    told = f"{term}@surface[surface=wall]" + (":31" if term == "plane_slip" else "")
    again = rsicalib.calibrate(tmp_path / "readings.csv", tmp_path / "mechanism.toml", terms=[told])
    assert {p["target"] for p in again.to_dict()["parameters"] if p["term"] == term} == {
        "surface[surface=wall]"
    }


def test_poses_are_planned_beside_rows_that_touch_no_socket(tmp_path: Path) -> None:
    *_, csv, mechanism = session("sockets", tmp_path)
    found = rsicalib.calibrate(csv, mechanism)
    planned = rsicalib.plan(mechanism, 4, result=found, beside=csv)
    assert 1 <= len(planned.readings) <= 4 and set(planned.keys) == {"surface", "at"}
    # A pose touches a socket, or the table.
    touched = zip(planned.keys["at"], planned.keys["surface"], strict=True)
    assert all((at == "") != (surface == "") for at, surface in touched)
