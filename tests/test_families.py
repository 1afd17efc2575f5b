"""The blind trials of other machines, in small: the simulator against the core, and the grading."""

from __future__ import annotations

import json
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import rsicalib
from rsicalib.facts.verdicts import EXIT_CODES
from tests import places
from tests.families import effects, linkage, run, tables
from tests.families.device import Device, observe, stage
from tests.families.draw import FAMILIES
from tests.families.grade import (
    Errors,
    Truth,
    grade,
    grew_by_chance,
    is_found,
    is_worse,
    speaks_of_noise,
)
from tests.families.power import Linear
from tests.families.trials import drawn, make, readings_of, toml, truth_of
from tests.full import sized

EVERY = pytest.mark.parametrize("family", list(FAMILIES))


@cache
def clean(family: str, seed: int = 0) -> tuple[Device, Any, Any, Any]:
    """A device without effects, its scene, and a session as the library takes it."""
    rng = np.random.default_rng([12, seed])
    device = Device.random(family, rng)
    scene = stage(device, rng)
    mechanism = rsicalib.Mechanism.from_toml(toml(device))
    return device, scene, mechanism, readings_of(mechanism, observe(device, scene, rng))


# ------------------------------------------------------------------ the simulator


@EVERY
def test_every_loop_closes(family: str) -> None:
    """To 1e-10 of the size of the machine, also where something is built otherwise."""
    rng = np.random.default_rng(1)
    device, scene, _, _ = clean(family)
    present, _ = drawn(device, scene, rng, effects.STRUCTURE, 0, 1)
    for built in ((), present):
        readings, columns = device.ideal(scene, built)
        gap = device.misclosure(scene, readings, columns, built)
        assert np.abs(gap).max() < 1e-10 * device.length


@EVERY
def test_every_effect_has_the_noncentrality_that_was_asked_for(family: str) -> None:
    rng = np.random.default_rng(2)
    device, scene, _, _ = clean(family)
    linear = Linear(device, scene)
    effect = linear.scaled(effects.CATALOGUE["curvature"](device, rng, device.names[-1]), 100.0)
    assert linear.noncentrality(effect) == pytest.approx(100.0, rel=0.03)
    half = linear.scaled(effect, 25.0)
    assert half.size == pytest.approx(effect.size / 2, rel=0.05)


def test_the_noncentrality_is_that_of_all_poses_together() -> None:
    """Of unknown points, too, but for the distances in the plate, which are no pose's."""
    device, scene, _, _ = clean("sockets")
    linear = Linear(device, scene)
    effect = effects.CATALOGUE["curvature"](device, np.random.default_rng(2), "q4")
    effect = linear.scaled(effect, 100.0)
    assert linear.by_pose(effect).sum() == pytest.approx(100.0, rel=0.05)
    assert not linear.is_of_few_poses(effect)
    bad = effects.bad(device, np.random.default_rng(2), scene, "two poses")
    assert linear.is_of_few_poses(linear.scaled(bad, 100.0))


def test_every_bad_pose_shows() -> None:
    """Errors alike at two poses may be invisible at one: its loop does not move with the joint."""
    for number in (2, 6, 10):
        case = make("drawwire", "wrong_readings", number, 4711)
        seen = Linear(case.device, case.session.scene).by_pose(case.effects[0])
        assert all(seen[pose - 1] >= 30.0 for pose in case.truths[0].poses)


def test_play_alone_is_wrong_where_it_shows() -> None:
    """It is a part in twenty of what the ball bar scatters by, and half of it with the wire."""
    assert make("ballbar", "wrong_noise", 1, 0).what == "noise and play x 0.5"
    assert make("drawwire", "wrong_noise", 1, 0).what == "play x 0.5"


def test_noncentrality_is_the_growth_of_chi_square() -> None:
    """The core's χ² of a device with an effect, less that of the same noise without."""
    device, scene, mechanism, _ = clean("ballbar")
    linear = Linear(device, scene)
    rng = np.random.default_rng(3)
    effect = linear.scaled(effects.CATALOGUE["curvature"](device, rng, "q3"), 150.0)
    chi2 = []
    for present in ((), (effect,)):
        session = observe(device, scene, np.random.default_rng(4), present)
        found = rsicalib.calibrate(readings_of(mechanism, session), mechanism)
        assert found.fit.chi2 is not None
        chi2.append(found.fit.chi2)
    # 2 √λ n has standard deviation 2 √150.
    assert chi2[1] - chi2[0] == pytest.approx(150.0, abs=3.3 * 2 * np.sqrt(150.0))


@EVERY
def test_clean_devices_are_adequate_and_the_truth_is_recovered(family: str) -> None:
    for seed in range(sized(1, 2)):
        device, _, mechanism, readings = clean(family, seed)
        found = rsicalib.calibrate(readings, mechanism)
        assert found.verdict == "adequate"
        for parameter in found.parameters:
            true = truth_of(device, parameter)
            assert true is not None
            assert parameter.value is not None and parameter.sd is not None
            assert abs(parameter.value - true) < 5 * parameter.sd, parameter


def test_sound_sessions_with_few_places_for_an_effect_and_with_many_are_adequate() -> None:
    """`python -m tests.places` counts them by the thousand."""
    assert len(places.of_few(5).could_hide) == 10
    found = [*map(places.of_few, range(5, 9)), places.of_many(6, poses=150)]
    assert [(r.verdict, r.steps, r.excluded) for r in found] == [("adequate", (), ())] * 5


@EVERY
def test_the_core_evaluates_the_mechanism_alike(family: str) -> None:
    """Carried points of true joint coordinates, by `forward` and by matrix products."""
    device, scene, mechanism, _ = clean(family)
    if device.drawing.mechanism.get("platform"):
        pytest.skip("forward gives the platform; its error is looked at below")
    bare = Device(device.drawing, *nominal(device))
    session = observe(bare, scene, np.random.default_rng(0))
    found = rsicalib.forward(readings_of(mechanism, session), mechanism)
    q = bare.gains * session.values + bare.offsets
    there = linkage.points(bare.build, q, bare.where(scene))
    carried = [p["name"] for p in device.drawing.mechanism["point"] if "chain" in p]
    wanted = np.concatenate([there[name] for name in carried], axis=1)
    np.testing.assert_allclose(np.reshape(found, wanted.shape), wanted, atol=1e-9 * device.length)


def nominal(device: Device) -> tuple[Any, Any]:
    """Offsets and gains as the drawing has them."""
    channels = device.drawing.mechanism["channel"]
    offset, gain = (np.array([c[k] for c in channels], dtype=float) for k in ("offset", "gain"))
    return offset, gain


def test_the_platform_is_where_its_points_are() -> None:
    device, scene, mechanism, readings = clean("rps")
    found = rsicalib.calibrate(readings, mechanism)
    poses = rsicalib.forward(readings, mechanism, found)
    centre = np.mean(list(device.points(scene, ()).values()), axis=0)
    assert np.sqrt(np.mean((poses[:, :3] - centre) ** 2)) < 0.5  # mm; a count of a leg is 0.05


def test_a_case_depends_on_its_seed_only() -> None:
    one, two = (make("gantry", "single", 3, 5) for _ in range(2))
    np.testing.assert_array_equal(one.session.values, two.session.values)
    assert one.truths == two.truths
    assert make("gantry", "single", 4, 5).truths != one.truths


# ------------------------------------------------------------------ the grading


def result(*steps: dict[str, Any], verdict: str = "explained", **more: Any) -> dict[str, Any]:
    return {"verdict": verdict, "steps": list(steps), "excluded": [], "warnings": []} | more


def step(term: str, klass: str, target: str, *ties: tuple[str, str]) -> dict[str, Any]:
    also = [{"term": "any", "class": k, "target": t} for k, t in ties]
    return {"term": term, "class": klass, "target": target, "also_fits": also}


CURVE = Truth("curvature", frozenset({("sensor", "q2")}), ("sensor", "q2"))


@pytest.mark.parametrize(
    ("said", "right"),
    [
        (step("cubic", "sensor", "q2"), True),
        (step("cubic", "sensor", "q3"), False),
        (step("link_length", "geometry", "q2"), False),
        (step("cubic", "sensor", "q3", ("sensor", "q2")), True),
        (step("cubic", "sensor", "q3", ("sensor", "q1"), ("sensor", "q2")), True),
        (
            step("cubic", "sensor", "q3", ("sensor", "q1"), ("sensor", "q4"), ("sensor", "q2")),
            False,
        ),
    ],
)
def test_a_tie_counts_among_two(said: dict[str, Any], right: bool) -> None:
    assert is_found(CURVE, result(said)) == right


def test_a_bad_reading_is_found_where_all_its_poses_are_left_out() -> None:
    truth = Truth("two poses", frozenset({("data", "q1")}), poses=frozenset({3, 9}))
    assert not is_found(truth, result(excluded=[{"pose": 3}]))
    found = result(excluded=[{"pose": 3}, {"pose": 9}, {"pose": 11}])
    assert is_found(truth, found)
    assert grade(found, 0, [truth]).extras == 1


def test_outside_the_target_is_what_counts() -> None:
    truth = Truth("backlash", frozenset({("sensor", "q2")}), ("sensor", "q2"), outside=True)
    assert is_found(truth, result(step("hysteresis", "sensor", "q2")))
    assert is_found(truth, result(verdict="unexplained", unexplained={"target": "q2"}))
    assert not is_found(truth, result(step("hysteresis", "sensor", "q1")))
    coarse = {"kind": "coarse", "target": "q2", "text": "q2 reads in steps of 8.6e-4 rad"}
    assert is_found(truth, result(verdict="adequate", warnings=[coarse]))
    wrong = grade(result(step("link_length", "geometry", "arm/2")), 0, [truth])
    assert wrong.misled and not wrong.found[0]


def test_the_error_grew_where_it_is_beyond_both() -> None:
    assert is_worse(Errors(1.0, 1.2, 1.0)) is True
    assert is_worse(Errors(1.0, 1.05, 1.0)) is False
    assert is_worse(Errors(1.0, 1.2, 1.15)) is False
    assert is_worse(Errors(1.0, 0.9, 0.1)) is False
    assert is_worse(Errors(None, 0.9, 0.1)) is None


def test_the_truth_makes_an_error_grow_by_chance_alone() -> None:
    assert grew_by_chance(Errors(1.0, 5.0, 1.2)) is True
    assert grew_by_chance(Errors(1.0, 5.0, 1.05)) is False
    assert grew_by_chance(Errors(1.0, 5.0, None)) is None


def test_a_track_bends_about_its_own_middle() -> None:
    """Not about that of the joint, which goes through a part of what the sensor reads."""
    device = clean("rps")[0]
    assert effects.centre(device, "leg1") == device.offsets[1] + 4095.5 * device.gains[1]
    assert effects.centre(clean("gantry")[0], "x2") == 300.0


def test_words_on_noise_are_heard() -> None:
    assert speaks_of_noise(result(warnings=[{"kind": "noise"}]))
    assert not speaks_of_noise(result(warnings=[{"kind": "constant", "target": "q1"}]))


def test_rates_have_an_error_even_of_none() -> None:
    assert tables.cell([False] * 20) == "0 ± 5 %, 0 of 20"
    assert tables.cell([]) == "-"


def test_families_are_columns_of_the_table_of_all() -> None:
    def rows(rate: str, verdicts: str) -> list[tuple[str, str, str]]:
        return [("clean", "flagged", rate), ("clean", "verdicts", verdicts)]

    whole = rows("2 ± 2 %, 1 of 58", "adequate 57, unexplained 1")
    one, other = rows("0 ± 3 %, 0 of 29", "adequate 29"), rows("-", "adequate 28, refused 1")
    page = tables.page({"all": whole, "fourbar": one, "fivebar": other}, "the command")
    assert "Written by `the command --report" in page and "`fourbar`: A planar crank" in page
    assert "| clean | flagged | 2 ± 2 %, 1 of 58 | 0/29 | - |" in page
    assert "| clean | verdicts | adequate 57, unexplained 1 | 29a | 28a 1 refused |" in page
    assert set(tables.LETTERS) == set(EXIT_CODES)


def test_the_command_writes_its_figures(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    out, report = tmp_path / "out.json", tmp_path / "page.md"
    asked = ["--family", "fourbar", "--suite", "clean", "--devices", "2"]
    assert run.main([*asked, "--out", str(out), "--report", str(report)]) == 0
    assert "== fourbar" in capsys.readouterr().out
    written = json.loads(out.read_text(encoding="utf-8"))
    assert len(written["devices"]) == 2 and written["command"] in report.read_text(encoding="utf-8")
