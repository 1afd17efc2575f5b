"""Rods of a delta printer that are all wrong alike: one effect, `distance@each`.

The printer is that of `tests/machines/delta.py`; where its nozzle stands is computed here by SciPy.
"""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from scipy.optimize import least_squares

import rsicalib
from rsicalib.errors import InputError
from rsicalib.report.plain import plain_words
from rsicalib.report.words import subject
from rsicalib.verbs.export import calibrated
from tests.full import sized
from tests.machines import delta, files
from tests.machines.kit import Linear, Machine
from tests.oracle import Array

STRENGTH = 150.0
"""Noncentrality of what is wrong: millimetres of all rods, and a millimetre of one."""
PRINTERS = sized(3, 40)
EACH = ("distance", "each")


def printer(seed: int) -> tuple[np.random.Generator, Machine]:
    rng = np.random.default_rng([seed, 51])
    return rng, delta.draw(rng)


def session(seed: int, wrong: str | None, folder: Path) -> tuple[Machine, Any, float]:
    """A printer with what is wrong, what the library says of it, and how wrong it is."""
    rng, machine = printer(seed)
    named = next((e for e in machine.effects if e.value == wrong), None)
    size = 0.0 if named is None else Linear(machine).sized(named, STRENGTH)
    size *= rng.choice([-1.0, 1.0])
    csv, mechanism = files.write(machine, machine.observe(rng, named, size), folder)
    return machine, rsicalib.trace(csv, mechanism), size


def told(found: Any) -> set[tuple[str, str]]:
    """What is named, and what fits as well."""
    return {(n.term, n.target) for s in found.steps for n in (s, *(s.also_fits or ()))}


def elsewhere(machine: Machine, wrong: dict[str, float]) -> tuple[Machine, Array]:
    """The printer at other places of its bed, without noise: readings, and where the nozzle is."""
    rng = np.random.default_rng(7)
    reach = np.sqrt((machine.start[:, 3:5] ** 2).sum(axis=1)).max()
    n = len(machine.start)
    away, turn = reach * np.sqrt(rng.uniform(0, 1, n)), rng.uniform(0, 2 * np.pi, n)
    start = machine.start.copy()
    start[:, 3:5] = np.column_stack([away * np.cos(turn), away * np.sin(turn)])
    fresh = replace(machine, start=start)
    return fresh, fresh.closed(machine.values | wrong)


def nozzles(found: Any, mechanism: Path, csv: Path) -> Array:
    """Where the rods of a result meet below its carriages."""
    tops = np.asarray(rsicalib.forward(csv, mechanism, found)).reshape(-1, 3, 3)
    document = calibrated(mechanism, found).mechanism.to_dict()
    rods = np.array([c["value"] for c in document["closure"] if c["kind"] == "distance"])

    def below(tops: Array) -> Array:
        def off(at: Array) -> Array:
            return np.asarray(np.linalg.norm(tops - at, axis=1) - rods)

        low = [0.0, 0.0, tops[:, 2].mean() - rods.mean()]
        return np.asarray(least_squares(off, low, xtol=1e-14, ftol=1e-14).x)

    return np.array([below(one) for one in tops])


def error(found: Any, mechanism: Path, csv: Path, truth: Array) -> float:
    """How far the nozzle is from where it is taken to be, root mean square [mm]."""
    off = nozzles(found, mechanism, csv) - truth
    return float(np.sqrt((off**2).sum(axis=1).mean()))


def test_sound_printers_are_adequate(tmp_path: Path) -> None:
    """Of a hundred one may be called otherwise."""
    said = [session(seed, None, tmp_path)[1].verdict for seed in range(PRINTERS)]
    assert said.count("adequate") >= sized(PRINTERS, 38), said


def test_rods_that_are_all_wrong_are_one_effect_or_in_its_tie(tmp_path: Path) -> None:
    """A flat bed tells errors of all rods from those of all towers, or a tie says so."""
    right = nearer = 0
    for seed in range(PRINTERS):
        machine, found, size = session(seed, "rod@all", tmp_path)
        right += len(found.steps) == 1 and EACH in told(found)
        fresh, rows = elsewhere(machine, {"rod@all": size})
        there = files.write(fresh, rows[:, :3], tmp_path / "fresh")
        offsets = rsicalib.calibrate(tmp_path / "readings.csv", there[1])
        before, after = (error(r, there[1], there[0], rows[:, 3:]) for r in (offsets, found))
        nearer += after < before
    assert right >= sized(PRINTERS, 38), right
    assert nearer >= sized(PRINTERS, 39), nearer


def test_towers_that_are_all_wrong_stay_in_the_tie(tmp_path: Path) -> None:
    """Rods do nearly the same to a flat bed: which of the two is told first, chance decides."""
    said = [told(session(seed, "radius@all", tmp_path)[1]) for seed in range(PRINTERS)]
    right = sum(("link_length", "each/1") in one for one in said)
    assert right >= sized(PRINTERS, 38), right


def test_one_rod_that_is_wrong_is_that_one(tmp_path: Path) -> None:
    right = asked = 0
    for seed in range(PRINTERS):
        rod = delta.TOWERS[seed % 3]
        try:
            _, found, _ = session(seed, f"rod@{rod}", tmp_path)
        except ValueError:  # it does not show on this bed
            continue
        asked += 1
        right += ("distance", f"rod {rod}") in told(found)
        assert EACH not in {(s.term, s.target) for s in found.steps}
    assert right >= asked - sized(0, 2), (right, asked)


def test_all_rods_longer_are_asked_for_by_name_and_each_gets_the_same(tmp_path: Path) -> None:
    """In a file, in Python, under an earlier result, and in the mechanism that comes of it."""
    rng, machine = printer(1)
    longer = next(e for e in machine.effects if e.value == "rod@all")
    csv, file = files.write(machine, machine.observe(rng, longer, 4.0), tmp_path)
    found = rsicalib.calibrate(csv, file, terms=["offset", "distance@each"])
    own = found["distance@each"]
    assert (own.term, own.target, own.name, own.unit) == ("distance", "each", "d", "mm")
    assert own.sd is not None and own.value is not None and abs(own.value - 4.0) < 4 * own.sd
    text = file.read_text().replace('["offset"]', '["offset", "distance@each"]')
    declared = tmp_path / "declared.toml"
    declared.write_text(text)
    assert rsicalib.calibrate(csv, declared)["distance@each"].value == own.value

    def rods(mechanism: Any) -> Array:
        closures = mechanism.to_dict()["closure"]
        return np.array([c["value"] for c in closures if c["kind"] == "distance"])

    drawn = rsicalib.load_mechanism(file)
    np.testing.assert_allclose(rods(calibrated(file, found).mechanism) - rods(drawn), own.value)
    again = rsicalib.calibrate(csv, file, calibration=found)
    assert again["distance@each"].value == pytest.approx(own.value, abs=0.1 * own.sd)


def test_rods_of_other_lengths_or_of_columns_have_no_common_target(tmp_path: Path) -> None:
    """One that is longer by a fifth is of another make, and each of two kinds has its own."""
    _, machine = printer(1)
    rods = [c for c in machine.mechanism["closure"] if c["kind"] == "distance"]
    rods[0]["value"] *= 1.2
    csv, file = files.write(machine, machine.start[:, :3], tmp_path)
    (two,) = [t for t in rsicalib.terms(file) if t["id"] == "distance"]
    assert "each" in two["targets"]  # those of the two that are alike
    rods[1]["value"] *= 0.8
    files.write(machine, machine.start[:, :3], tmp_path)
    (none,) = [t for t in rsicalib.terms(file) if t["id"] == "distance"]
    assert "each" not in none["targets"]
    with pytest.raises(InputError, match="each"):
        rsicalib.calibrate(csv, file, terms=["offset", "distance@each"])


def test_words_say_that_all_rods_are_longer(tmp_path: Path) -> None:
    _, found, size = session(2, "rod@all", tmp_path)
    (step,) = found.steps
    assert subject(step) == "distance of all closures of one make"
    said = plain_words(found, found.evidence)
    assert said.startswith("All closures of one make are wrong, alike")
    assert f"Each is {'longer' if size > 0 else 'shorter'} by" in said
    assert "distance of all closures of one make" in found.report()
