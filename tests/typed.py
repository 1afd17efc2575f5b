"""What a type checker knows of every result: `mypy` reads this file, and nothing runs it."""

from __future__ import annotations

from pathlib import Path
from typing import assert_type

import numpy as np
import numpy.typing as npt
from matplotlib.axes import Axes

import rsicalib
from rsicalib.facts.shapes import Before
from rsicalib.io.readings import Readings
from rsicalib.labels import Labelled
from rsicalib.planning.identifiability import Identifiable
from rsicalib.planning.measures import Observability
from rsicalib.planning.plans import Plan
from rsicalib.planning.platform_sd import Workspace
from rsicalib.planning.supposing import Supposition
from rsicalib.poses.simulation import Simulated
from rsicalib.report.past import History
from rsicalib.reproduction.document import Paper
from rsicalib.verbs.monitor import Watching

Array = npt.NDArray[np.float64]


def results(path: Path, table: dict[str, list[float]]) -> None:
    """Every verb."""
    mechanism = rsicalib.Mechanism("rsi")
    assert_type(rsicalib.load_mechanism(path), rsicalib.Mechanism)
    assert_type(rsicalib.load_readings(path), Readings)
    found = rsicalib.calibrate(path, mechanism, progress=lambda stage, share: None)
    assert_type(found, rsicalib.Calibration)
    assert_type(rsicalib.calibrate(table), rsicalib.Calibration)
    traced = rsicalib.trace([path, path], {"name": "mine"}, calibration=found)
    assert_type(traced, rsicalib.Trace)
    assert_type(rsicalib.demo(), rsicalib.Trace)
    assert_type(rsicalib.fixture(path), rsicalib.Calibration)
    assert_type(rsicalib.load_calibration(path), rsicalib.Calibration | rsicalib.Trace)
    assert_type(rsicalib.forward(path, calibration=found), Array)
    assert_type(rsicalib.forward_sd(path, mechanism, traced), Array)
    assert_type(rsicalib.inverse([[0.0] * 6]), Array)
    assert_type(rsicalib.observability(path), Observability)
    assert_type(rsicalib.identifiable(mechanism), Identifiable)
    assert_type(rsicalib.plan(mechanism, 12), Plan)
    assert_type(rsicalib.workspace(found), Workspace)
    assert_type(rsicalib.simulate(), Simulated)
    assert_type(rsicalib.paper(10), Paper)
    assert_type(rsicalib.history(path), History)
    assert_type(rsicalib.suppose(path, ["drift@a22=0.01"]), Supposition)
    assert_type(rsicalib.certify(found, limit="0.5 mm"), rsicalib.Certificate)
    assert_type(rsicalib.watch(path, found), Watching)
    assert_type([alarm for alarm in rsicalib.watch(path, found)], list[rsicalib.Alarm])
    assert_type(rsicalib.Monitor(found).update([0.0]), list[rsicalib.Alarm])


def parts(found: rsicalib.Calibration, traced: rsicalib.Trace) -> None:
    """What is in a result."""
    assert_type(found["gain@a11"], rsicalib.Parameter)
    assert_type(found["gain", "a11"], rsicalib.Parameter)
    assert_type(found[0], rsicalib.Parameter)
    assert_type(found[:2], tuple[rsicalib.Parameter, ...])
    assert_type([p for p in found], list[rsicalib.Parameter])
    assert_type(found.keys(), list[str])
    assert_type(found["gain@a11"].interval, tuple[float, float] | None)
    assert_type(found["gain@a11"].change, float | None)
    assert_type(found["gain@a11"].earlier, Before | None)
    assert_type(found.values, Array)
    assert_type(found.covariance, Labelled)
    assert_type(found.covariance.correlation, Labelled)
    assert_type(found.plot("parameters"), Axes)
    assert_type(traced.steps[0], rsicalib.Step)
    assert_type(traced.steps[0].plot(), Axes)
