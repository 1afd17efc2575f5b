"""Calibrations without a term: what is unknown of a mechanism is determined alone."""

from __future__ import annotations

from pathlib import Path

import numpy as np

import rsicalib
from tests.machines import files
from tests.machines.trials import MACHINES


def test_with_no_term_what_is_unknown_is_determined_alone(tmp_path: Path) -> None:
    rng = np.random.default_rng(3)
    machine = MACHINES["belts"](rng)
    readings, mechanism = files.write(machine, machine.observe(rng), tmp_path)
    found = rsicalib.calibrate(readings, mechanism, terms=[])
    assert {p.term for p in found.parameters} == {"unknown_point"}
    for p in found.parameters:
        assert p.value is not None and p.sd is not None
        off = p.value - machine.values[f"{p.name}@{p.target}"]
        # Five of them: beyond 4.5 deviations in one of a hundred thousand.
        assert abs(off) < 4.5 * p.sd
    # No point is carried: nothing is predicted of where it is.
    assert found.predicted is None
