"""Columns that are declared for laws, and lengths in columns: in every verb, used or not."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

import rsicalib
from rsicalib import DEMO, InputError, Mechanism
from tests import cone

FORCE = '\n[[column]]\nname = "force"\nunit = "N"\n'
BUILT_IN = rsicalib.load_mechanism("rsi").to_toml()


def with_force(path: Path, to: Path) -> Path:
    """The same table with a column of forces."""
    lines = path.read_text(encoding="utf-8").splitlines()
    rng = np.random.default_rng(3)
    force = ["force", *(f"{rng.uniform(0, 10):.3f}" for _ in lines[1:])]
    text = "\n".join(f"{line},{cell}" for line, cell in zip(lines, force, strict=True)) + "\n"
    to.write_text(text, encoding="utf-8")
    return to


def test_a_column_that_no_law_uses_changes_nothing(tmp_path: Path) -> None:
    drawn = Mechanism.from_toml(BUILT_IN + FORCE)
    readings, rest = with_force(DEMO / "readings.csv", tmp_path / "r.csv"), DEMO / "rest.csv"
    plain = rsicalib.calibrate(DEMO / "readings.csv", rest=rest)
    found = rsicalib.calibrate(readings, drawn, rest=rest)
    assert [(p.value, p.sd) for p in found.parameters] == [
        (p.value, p.sd) for p in plain.parameters
    ]
    assert "<svg" in found.report()
    rows = rsicalib.load_readings(DEMO / "readings.csv")
    watching = rsicalib.watch(rows, found, drawn)
    assert list(watching) == list(rsicalib.watch(rows, plain))
    assert np.array_equal(
        rsicalib.forward(readings, drawn, found),
        rsicalib.forward(DEMO / "readings.csv", "rsi", plain),
    )
    poses = rsicalib.plan(drawn, poses=12, beside=readings)
    assert len(poses.readings) == 12


WIND = """
[[term]]
id = "wind"
class = "load"
per = "channel"
correction = "c*force"
parameters = {c = 0.001}
"""


def test_a_law_whose_column_is_absent_is_no_candidate(tmp_path: Path) -> None:
    drawn, rest = Mechanism.from_toml(BUILT_IN + FORCE + WIND), DEMO / "rest.csv"
    bare = Mechanism.from_toml(BUILT_IN + FORCE)
    plain = rsicalib.trace(DEMO / "readings.csv", bare, rest=rest)
    found = rsicalib.trace(DEMO / "readings.csv", drawn, rest=rest)
    assert [step.to_dict() for step in found.steps] == [step.to_dict() for step in plain.steps]
    assert found.not_candidates["wind"] == "column force, which its law follows"
    with pytest.raises(InputError, match="wind: the readings have no column force"):
        rsicalib.calibrate(DEMO / "readings.csv", drawn, rest=rest, terms=["offset", "wind@a22"])
    # Rows that nobody has read have no force, and need none.
    wanted = {"limit": "0.1 in", "confidence": 0.9}
    signed = rsicalib.certify(found, drawn, **wanted)
    assert signed.uncertainty == rsicalib.certify(plain, bare, **wanted).uncertainty
    sd = rsicalib.workspace(found, drawn, poses=20).sd
    assert np.array_equal(sd, rsicalib.workspace(plain, bare, poses=20).sd)
    made = rsicalib.simulate(None, drawn, poses=4, check=2)
    assert made.readings.columns == {}


def test_check_poses_under_a_law_have_its_column() -> None:
    """A force of some newtons turns joint 2 of an arm at a cone by a milliradian each."""
    session, rng = cone.session(3, poses=25, samples=2), np.random.default_rng(5)
    force = np.repeat(rng.uniform(0, 5, 25), 2)
    read = {**session.table, "force": force, "q2": np.array(session.table["q2"]) - 1e-3 * force}
    drawn = Mechanism.from_toml(cone.mechanism(2e-5, 0.02) + FORCE + WIND)
    angles = session.angles + rng.uniform(-0.3, 0.3, session.angles.shape)
    force = rng.uniform(0, 5, len(angles))
    values = angles - cone.OFFSETS - 1e-3 * force[:, None] * (np.arange(6) == 1)
    check = {f"q{k + 1}": values[:, k] for k in range(6)}
    check |= dict(zip("xyz", cone.tip(angles).T, strict=True)) | {"force": force}
    terms = ["offset", "wind@q2"]
    found = rsicalib.calibrate(read, drawn, terms=terms, check=check, align=True)
    own = found["wind", "q2"]
    assert own.value is not None and own.sd is not None
    assert abs(own.value - 1e-3) < 4 * own.sd
    assert found.fit is not None
    # Without the forces of these places the ball is 1 mm off: half of 5 mrad at half of 900 mm.
    assert found.fit.aligned is not None
    assert found.fit.aligned.position_rms < 0.15
    without = {name: column for name, column in check.items() if name != "force"}
    blind = rsicalib.calibrate(read, drawn, terms=terms, check=without, align=True)
    assert any("without the column force" in warning.text for warning in blind.warnings)


def test_a_law_of_other_joints_is_in_corrected_readings(tmp_path: Path) -> None:
    """Of the other joints of the chain, which no channel has by itself."""
    own = """
[[term]]
id = "own"
class = "sensor"
per = "channel"
correction = "k*sin(theta[1]) + h*cos(theta[2])"
parameters = {k = 0.003, h = 0.001}
"""
    drawn, rest = Mechanism.from_toml(BUILT_IN + own), DEMO / "rest.csv"
    found = rsicalib.calibrate(
        DEMO / "readings.csv", drawn, rest=rest, terms=["offset", "gain", "own@a23"]
    )
    sizes = [found["own", "a23", name].value for name in ("k", "h")]
    assert all(abs(size or 0.0) > 1e-5 for size in sizes), "the session tells them apart from zero"
    made = rsicalib.export_result(found, "csv", drawn, readings=DEMO / "check.csv")
    for name in ("corrected.csv", "corrected.toml"):
        (tmp_path / name).write_text(str(made[name]), encoding="utf-8")
    corrected = rsicalib.forward(tmp_path / "corrected.csv", tmp_path / "corrected.toml")
    wanted = rsicalib.forward(DEMO / "check.csv", drawn, found)
    # Arms are weighed by their noise, which a law changes a little.
    np.testing.assert_allclose(corrected, wanted, atol=5e-5)


def test_a_column_stands_beside_an_arm_at_a_cone() -> None:
    text = cone.mechanism(2e-5, 0.02)
    session = cone.session(3, poses=25, samples=2)
    table = {**session.table, "force": [1.0] * len(session.table["pose"])}
    plain = rsicalib.calibrate(session.table, Mechanism.from_toml(text))
    found = rsicalib.calibrate(table, Mechanism.from_toml(text + FORCE))
    assert [p.value for p in found.parameters] == [p.value for p in plain.parameters]
    places = rsicalib.forward(session.table, Mechanism.from_toml(text + FORCE), found)
    assert np.array_equal(places, rsicalib.forward(session.table, Mechanism.from_toml(text), plain))


def test_closures_that_are_left_out_leave_their_columns(tmp_path: Path) -> None:
    own = BUILT_IN.replace("value = 2.598076211353316", 'value = "d12"', 1)
    assert 'value = "d12"' in own, "the built-in machine has other lengths"
    drawn = Mechanism.from_toml(own)
    lines = (DEMO / "readings.csv").read_text(encoding="utf-8").splitlines()
    path = tmp_path / "r.csv"
    path.write_text(
        "\n".join([lines[0] + ",d12", *(line + ",2.598076211353316" for line in lines[1:])]) + "\n",
        encoding="utf-8",
    )
    names = [c["name"] for c in drawn.to_dict()["closure"]]
    for some in (names[1:], names[:2], names):
        found = rsicalib.calibrate(path, drawn, rest=DEMO / "rest.csv", closures=some)
        plain = rsicalib.calibrate(DEMO / "readings.csv", rest=DEMO / "rest.csv", closures=some)
        assert found.fit is not None and plain.fit is not None
        assert found.fit.chi2 == pytest.approx(plain.fit.chi2, rel=1e-6)


def test_a_length_between_unknown_points_may_be_a_column() -> None:
    """Two cones, whose distance somebody has measured: as a number, and as a column."""
    text = cone.mechanism(2e-5, 0.02).replace('unknown = ["at"]', 'unknown = ["at"]', 1)
    other = cone.CONE + np.array([60.0, 25.0, -10.0])
    apart = float(np.linalg.norm(other - cone.CONE))
    one = cone.session(5, poses=15, samples=2, at="a")
    two = cone.session(6, poses=15, samples=2, at="b", cone=other)
    table: dict[str, list[float] | list[str]] = {
        name: [*one.table[name], *two.table[name]]  # type: ignore[list-item]
        for name in one.table
    }
    table["pose"] = [*one.table["pose"], *(15 + float(p) for p in two.table["pose"])]
    link = '[[closure]]\nname = "bar"\nkind = "distance"\nbetween = ["cone[at=a]", "cone[at=b]"]\n'
    head, model = text.split("[model]")
    free = rsicalib.calibrate(table, Mechanism.from_toml(text))
    known = Mechanism.from_toml(f"{head}{link}value = {apart!r}\nsd = 0.01\n[model]{model}")
    number = rsicalib.calibrate(table, known)
    column = rsicalib.calibrate(
        {**table, "bar": [apart] * len(table["pose"])},
        Mechanism.from_toml(f'{head}{link}value = "bar"\nsd = 0.01\n[model]{model}'),
    )
    assert [p.value for p in column.parameters] == pytest.approx(
        [p.value for p in number.parameters], rel=1e-9, abs=1e-12
    )
    assert not [w for w in column.warnings if w.kind == "unused"]
    assert number.fit is not None and free.fit is not None
    assert column.fit is not None and number.fit.dof == column.fit.dof > free.fit.dof


def test_a_closure_that_holds_in_few_poses_is_judged_there_alone() -> None:
    """A block of poses is off; a tape that was read in three of 60 poses takes nothing from it."""
    made = rsicalib.simulate(None, poses=60, samples=1, noise=1.0, seed=2, check=2).readings
    table = dict(zip(made.channels, made.values.T, strict=True))
    table["a22"] = table["a22"] + 5.0 * ((np.arange(60) >= 20) & (np.arange(60) < 30))
    whole = rsicalib.load_mechanism("rsi").to_dict()
    first = whole["closure"][0]
    length = np.where(np.arange(60) % 20 == 0, first["value"], np.nan)
    tape = {"name": "tape", "kind": "distance", "between": first["between"]}
    own = {**tape, "value": "tape", "noise": 0.01}
    more = Mechanism.from_dict({**whole, "closure": [*whole["closure"], own]})
    fits = (
        rsicalib.calibrate(table, noise=1.04).fit,
        rsicalib.calibrate({**table, "tape": length}, more, noise=1.04).fit,
    )
    plain, beside = (fit.held_out.p_value for fit in fits if fit is not None and fit.held_out)
    assert plain is not None and beside is not None
    # Counted in all 60 poses the tape made it a hundred times as large.
    assert plain < 2e-3 and beside < 3 * plain
