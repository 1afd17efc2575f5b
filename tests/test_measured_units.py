"""Belts that are read in another unit than the drawing. Witness: lengths between points."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

import rsicalib
from tests.machines import files
from tests.machines.belt import BELTS, draw


@pytest.mark.parametrize(
    ("wrong", "times", "said"),
    [
        (BELTS, 1e-3, "tl, tr, bl and br look like another unit"),
        (BELTS, 1.0 / 25.4, "tl, tr, bl and br look like another unit"),
        (("br",), 1.0 / 25.4, "br looks like another unit"),
    ],
)
def test_lengths_in_another_unit_are_named(
    wrong: tuple[str, ...], times: float, said: str, tmp_path: Path
) -> None:
    rng = np.random.default_rng(31)
    machine = draw(rng)
    read = machine.observe(rng)
    read[:, [machine.columns.index(belt) for belt in wrong]] *= times
    found = rsicalib.trace(*files.write(machine, read, tmp_path))
    assert found.verdict == "implausible"
    told = [(warning.kind, warning.targets) for warning in found.warnings]
    assert ("units", wrong) in told
    assert not {"exchanged", "reversed"} & {kind for kind, _ in told}
    assert said in " ".join(found.summary().split())
