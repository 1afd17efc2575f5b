"""The figures of real arms, within 0.015 mm of those in the README of the data.

A trace of a whole session takes up to 35 s: some are traced in part here, and in whole by
`RSICALIB_FULL=1 pytest tests/test_measured.py`.
"""

from __future__ import annotations

import shutil
from functools import cache
from pathlib import Path

import numpy as np
import pytest

import rsicalib
from rsicalib import Calibration
from tests import planted
from tests.full import sized

DATA = Path(__file__).parents[2] / "shared" / "data" / "mukca"
EXAMPLES = Path(__file__).parents[1] / "examples"

pytestmark = pytest.mark.skipif(
    not DATA.is_dir(), reason="the measured data (mukca) are not beside this repository"
)

MM = 1e3
WORSE = 0.015

FIGURES = [
    ("panda_2", ("high",), ("front_center",), (8.28, 7.79), (0.165, 0.358), (0.148, 0.336)),
    ("panda_3", (), ("frontcenter",), (3.32, 3.26), (0.151, 0.239), (0.133, 0.182)),
    (
        "panda_3",
        (),
        ("frontcenter", "backleft", "backright"),
        (3.24, 3.29),
        (0.174, 0.211),
        (0.145, 0.172),
    ),
    ("panda_4", (), ("front",), (8.52, 8.85), (0.153, 0.338), (0.140, 0.270)),
    ("panda_1", (), ("front", "right"), (9.16, 7.46), (0.294, 0.966), (0.277, 0.855)),
]


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Mechanism files beside the robot descriptions that they refer to."""
    path = tmp_path_factory.mktemp("mukca")
    for file in [*DATA.glob("*.urdf"), *DATA.glob("*.toml"), *EXAMPLES.glob("mukca_*.toml")]:
        shutil.copy(file, path)
    text = (path / "mukca_panda.toml").read_text()
    (path / "along_y.toml").write_text(text.replace("[0, 0, -1]", "[0, 1, 0]"))
    return path


def fitted(
    folder: Path,
    robot: str,
    groups: tuple[str, ...],
    dropped: tuple[str, ...] = (),
    *,
    loaded: bool = False,
    file: str = "mukca_panda.toml",
) -> Calibration:
    mechanism = rsicalib.load_mechanism(folder / file)
    readings = rsicalib.load_readings(DATA / f"{robot}.csv", mechanism)
    kept = readings.select([g not in dropped for g in readings.keys["group"]])
    terms = mechanism.to_dict()["model"]["terms"] + (["joint_compliance"] if loaded else [])
    return rsicalib.calibrate(kept, mechanism, fit_groups=groups, terms=terms)


@pytest.mark.parametrize("case", FIGURES, ids=lambda c: f"{c[0]}, {'+'.join(c[2])}")
def test_geometry_and_compliance_close_as_well_as_published(folder: Path, case: tuple) -> None:  # type: ignore[type-arg]
    robot, dropped, groups, nominal, geometry, compliance = case
    for loaded, wanted in ((False, geometry), (True, compliance)):
        found = fitted(folder, robot, groups, dropped, loaded=loaded).groups
        assert found is not None and found.fitted is not None and found.others is not None
        assert found.nominal_fitted is not None and found.nominal_others is not None
        assert found.nominal_fitted * MM == pytest.approx(nominal[0], abs=0.006)
        assert found.nominal_others * MM == pytest.approx(nominal[1], abs=0.006)
        assert found.fitted * MM < wanted[0] + WORSE
        # panda_1 is noisy and drifts, and bad samples are left out that the authors kept:
        # its other group, alone at the edge, is held to a twenty-fifth of itself.
        assert found.others * MM < wanted[1] + max(WORSE, 0.04 * wanted[1])


@pytest.mark.parametrize(
    ("robot", "groups", "vanishes"),
    # What is left of the gain on unseen groups with gravity along y, at the most.
    [("panda_4", ("front",), 0.25), ("panda_3", ("frontcenter",), 0.5)],
)
def test_with_gravity_turned_the_gain_vanishes(
    folder: Path, robot: str, groups: tuple[str, ...], vanishes: float
) -> None:
    others = {}
    for name, loaded, file in (
        ("geometry", False, "mukca_panda.toml"),
        ("real", True, "mukca_panda.toml"),
        ("turned", True, "along_y.toml"),
    ):
        found = fitted(folder, robot, groups, loaded=loaded, file=file).groups
        assert found is not None and found.others is not None
        others[name] = found.others * MM
    real, turned = others["geometry"] - others["real"], others["geometry"] - others["turned"]
    assert real > 0.04
    assert turned < vanishes * real, others


def test_a_jump_and_a_move_that_were_planted_are_named(folder: Path) -> None:
    shutil.copy(DATA / "panda_left.csv", folder)
    arm = planted.Arm(folder, "panda_left", "world_frame")
    jump, shows = planted.jumped(arm, np.random.default_rng([902341, 5, 1]), 1)
    move, moves = planted.moved(arm, np.random.default_rng([902341, 5, 10]), "socket0")
    assert min(shows, moves) > planted.SHOWS
    assert (jump, move) == ("named", "named")


def test_a_negative_compliance_is_called_unphysical(folder: Path) -> None:
    found = fitted(folder, "panda_4", ("front",), loaded=True)
    joint2 = found["joint_compliance", "q2"]
    assert joint2.value is not None and joint2.value < 0
    assert joint2.note is not None and "unphysical" in joint2.note
    assert ("unphysical_sign", "q2") in {(w.kind, w.target) for w in found.warnings}


def test_the_calibrated_robot_is_the_same_in_every_form(folder: Path, tmp_path: Path) -> None:
    mechanism, readings = folder / "mukca_panda.toml", DATA / "panda_4.csv"
    found = rsicalib.calibrate(readings, mechanism, fit_groups=["front"])
    wanted = rsicalib.forward(readings, mechanism, found)
    (tmp_path / "calibrated.toml").write_text(rsicalib.export_toml(mechanism, found))
    ((name, text),) = rsicalib.export_urdf(mechanism, found).items()
    (tmp_path / name).write_text(text)
    own = mechanism.read_text().replace("panda.urdf", name)
    (tmp_path / "own.toml").write_text(own)
    shutil.copy(DATA / "panda_masses.toml", tmp_path)
    for file in ("calibrated.toml", "own.toml"):
        again = rsicalib.forward(readings, tmp_path / file)
        assert abs(again - wanted).max() < 1e-9


@cache
def traced(
    folder: Path,
    robot: str,
    groups: tuple[str, ...] | None,
    file: str = "mukca_panda.toml",
    placements: tuple[str, ...] | None = None,
) -> rsicalib.Trace:
    """A trace of a session, or of these of its placements alone."""
    mechanism = rsicalib.load_mechanism(folder / file)
    readings = rsicalib.load_readings(DATA / f"{robot}.csv", mechanism)
    if placements is not None:
        readings = readings.select([group in placements for group in readings.keys["group"]])
    return rsicalib.trace(readings, mechanism, fit_groups=groups)


@pytest.mark.parametrize(
    ("groups", "most"),
    [
        (("frontcenter",), 0.19),
        # One effect takes it to 0.17567, four took it to 0.17521.
        *sized([], [(("frontcenter", "backleft", "backright"), 0.1758)]),
    ],
)
def test_tracing_finds_compliance_that_nobody_spoke_of(
    folder: Path, groups: tuple[str, ...], most: float
) -> None:
    found = traced(folder, "panda_3", groups)
    # Weight at the end, or of the links: these poses cannot tell the two apart.
    first = found.steps[0]
    assert "joint_compliance" in {first.term, *(n.term for n in first.also_fits)}
    assert all(p.value > 0 for s in found.steps for p in s.parameters if p.name == "compliance")
    assert found.groups is not None and found.groups.others is not None
    assert found.groups.others * MM <= most


@pytest.mark.parametrize("robot", sized(["panda_3"], ["panda_3", "panda_4"]))
def test_tracing_finds_no_compliance_where_gravity_is_turned(folder: Path, robot: str) -> None:
    part = sized(("frontcenter", "backleft"), None)
    found = traced(folder, robot, None, "along_y.toml", part)
    assert not [s for s in found.steps if s.klass == "load"]


def test_tracing_says_how_sure_it_is_of_compliance_on_panda_4(folder: Path) -> None:
    found = traced(folder, "panda_4", None, placements=sized(("front", "right", "left"), None))
    # Weight at the end, or of the links: for q4 these poses cannot tell the two apart.
    names = [(s.p_value, {s.term, *(n.term for n in s.also_fits)}) for s in found.steps]
    sure = [p for p, terms in names if "joint_compliance" in terms]
    # By what χ² rises without it, where others may take over; three placements tell less than nine.
    assert sure and all(p is not None and p < sized(1e-4, 1e-6) for p in sure)


PART = "front_left"
"""A placement of panda_2 with bad samples."""


def test_the_broken_placement_and_the_bad_samples_of_panda_2_are_named(folder: Path) -> None:
    """As the README of the data lists them, and nothing else; in part, without the broken one."""
    mechanism = rsicalib.load_mechanism(folder / "mukca_panda.toml")
    readings = rsicalib.load_readings(DATA / "panda_2.csv", mechanism)
    part = readings.select([group == PART for group in readings.keys["group"]])
    found = rsicalib.trace(sized(part, readings), mechanism)
    whole = [(e.group, e.samples) for e in found.excluded if e.pose is None]
    assert whole == sized([], [("high", 62)])
    single = sorted((e.group, e.reason.split(" of its run")[0]) for e in found.excluded if e.pose)
    assert single == [
        *sized([], [("back_left, socket1", "sample 30")]),
        ("front_left, socket1", "sample 21"),
        ("front_left, socket1", "sample 22"),
        *sized([], [("front_right, socket0", "sample 14")]),
    ]


LEFT, FELL = sized((("front",), ("left", "front_rotated")), (None, None))
"""Placements of dinova_2: one that nothing explains; two, in the last of which a tool fell off."""

UNEXPLAINED = [("dinova_2", "mukca_gen3lite.toml"), ("panda_1", "mukca_panda.toml")]


@pytest.mark.parametrize(("robot", "file"), sized(UNEXPLAINED[:1], UNEXPLAINED))
def test_what_stays_unexplained_is_said_and_where(folder: Path, robot: str, file: str) -> None:
    found = traced(folder, robot, None, file, LEFT if robot == "dinova_2" else None)
    assert found.verdict in ("unexplained", "partly_explained")
    assert found.unexplained is not None and found.unexplained.target == "arm"
    assert found.unexplained.p_value is not None and found.unexplained.p_value < 1e-3


def test_the_tool_that_fell_off_after_eleven_points_is_found(folder: Path) -> None:
    found = traced(folder, "dinova_2", None, "mukca_gen3lite.toml", FELL)
    (one,) = [e for e in found.excluded if e.group == "front_rotated, socket1"]
    assert "between its samples 10 and 11" in one.reason and one.samples == 9
