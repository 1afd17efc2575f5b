"""Known places of a point, without orientation, beside plain matrix products."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
import scipy.stats

import rsicalib
from rsicalib import DEMO
from rsicalib.errors import InputError
from tests import oracle
from tests.full import sized
from tests.machines import files, plain
from tests.machines.arm import JOINTS, Body, Job
from tests.machines.surfaces import SEEN, known
from tests.oracle import Array


@pytest.fixture(scope="module")
def touched(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, Path, Path, Job, Array]:
    """An arm on a table and a wall, and a tracker's points in a frame of its own."""
    rng = np.random.default_rng(8)
    job = Job(Body.random(rng), rng, 30)
    first = (np.arange(30) % 2 == 0).astype(float)
    job.plane("table", first)
    job.plane("wall", 1 - first)
    read = job.machine("arm").observe(rng)
    folder = tmp_path_factory.mktemp("touched")
    readings, mechanism = files.write(job.machine("arm"), read, folder)
    known(job, read, rng, folder / "seen.csv")
    return readings, mechanism, folder / "seen.csv", job, read


def tip(job: Job, read: Array, offsets: dict[str, float]) -> Array:
    """Where a calibration puts the tool, by Denavit and Hartenberg's matrices."""
    q = {name: read[:, k] + offsets.get(name, 0.0) for k, name in enumerate(JOINTS)}
    return plain.place(plain.frames(job.body.rows, q, len(read)), job.body.tool)


def rms(gap: Array) -> float:
    """Root mean square over components."""
    return float(np.sqrt(np.mean(gap**2)))


def test_places_are_compared_after_a_rigid_motion(
    touched: tuple[Path, Path, Path, Job, Array],
) -> None:
    readings, mechanism, seen, job, read = touched
    found = rsicalib.calibrate(readings, mechanism, check=seen, align=True)
    places = np.genfromtxt(seen, delimiter=",", skip_header=1)[:, 7:10]
    offsets = {p.target: p.value for p in found.parameters if p.term == "offset" and p.value}
    for quality, own in ((found.fit, offsets), (found.nominal, {})):
        assert quality is not None and quality.aligned is not None and quality.check is not None
        witness = tip(job, read, own)
        assert quality.aligned.position_rms == pytest.approx(
            rms(plain.rigid_gap(witness, places)), rel=1e-4
        )
        assert quality.check.position_rms == pytest.approx(rms(witness - places), rel=1e-4)
        assert quality.aligned.orientation_rms is None
        assert quality.aligned.poses == len(read)
    # The error is of the size that is predicted.
    aligned = found.fit.aligned
    assert aligned is not None and aligned.predicted is not None
    assert 1e-3 < aligned.predicted.p_value


@pytest.mark.parametrize("verb", [rsicalib.calibrate, rsicalib.fixture])
def test_what_is_told_of_known_poses_needs_them(verb: Callable[..., object]) -> None:
    readings, check = DEMO / "check.csv", DEMO / "check.csv"
    for told in ({"check_point": "wrist1"}, {"check_noise": 1.0}, {"align": True}):
        (name,) = told
        with pytest.raises(InputError, match=f"^{name}: found no check, expected known poses"):
            verb(readings, **told)
    with pytest.raises(InputError, match=r"found 'wirst1' \(did you mean 'wrist1'\?\), expected a"):
        verb(readings, check=check, check_point="wirst1")
    with pytest.raises(InputError, match="expected places x y z of the point"):
        verb(readings, check=check, check_point="wrist1")


def test_an_instrument_has_noise_of_its_own(
    touched: tuple[Path, Path, Path, Job, Array], tmp_path: Path
) -> None:
    """Errors by the parameters and by the instrument add up; six of 90 go into the rigid motion."""
    readings, mechanism, seen, _, _read = touched
    lines = seen.read_text(encoding="utf-8").splitlines()
    rng, sigma = np.random.default_rng(11), 2.0
    rows = [line.split(",") for line in lines[1:]]
    for row in rows:
        row[7:10] = [f"{float(x) + rng.normal(0, sigma):.9g}" for x in row[7:10]]
    noisy = tmp_path / "noisy.csv"
    noisy.write_text("\n".join([lines[0], *map(",".join, rows)]) + "\n", encoding="utf-8")
    exact = rsicalib.calibrate(readings, mechanism, check=seen, align=True).fit.aligned
    taken = rsicalib.calibrate(readings, mechanism, check=noisy, align=True)
    told = rsicalib.calibrate(readings, mechanism, check=noisy, check_noise=sigma, align=True)
    assert taken.verdict == "unexplained" and taken.reasons[0].kind == "check"
    assert told.verdict == "adequate"
    assert exact is not None and exact.predicted is not None
    aligned = told.fit.aligned
    assert aligned is not None and aligned.predicted is not None
    n = 3 * len(rows)
    both = exact.predicted.position_sd**2 + sigma**2 * (n - 6) / n
    assert aligned.predicted.position_sd**2 == pytest.approx(both, rel=1e-6)


def seen_by_a_tracker(
    seed: int, folder: Path, wrong: float = 0.0
) -> tuple[rsicalib.Calibration, int]:
    """An arm exactly as drawn that touches a table; `wrong`: what a joint reads too much there."""
    rng = np.random.default_rng([17, seed])
    job = Job(Body.random(rng), rng, 40)
    job.values = dict.fromkeys(job.values, 0.0)
    first = (np.arange(40) % 2 == 0).astype(float)
    job.plane("table", first)
    job.plane("wall", 1 - first)
    read = job.machine("arm").observe(rng)
    known(job, read, rng, folder / "seen.csv")
    spoilt = read + wrong * np.sin(2 * read) * (np.arange(read.shape[1]) == 2)
    paths = files.write(job.machine("arm"), spoilt, folder)
    found = rsicalib.calibrate(*paths, check=folder / "seen.csv", check_noise=SEEN, align=True)
    return found, len(read)


def test_an_arm_as_drawn_is_contradicted_by_more_than_chance_alone(tmp_path: Path) -> None:
    """A calibration adds its errors to a drawing that has none: of six offsets, not 120 numbers."""
    beyond = []
    for seed in range(sized(6, 20)):
        found, poses = seen_by_a_tracker(seed, tmp_path)
        assert found.nominal is not None
        own, drawn = found.fit.aligned, found.nominal.aligned
        assert own is not None and own.predicted is not None and drawn is not None
        chance = np.sqrt(scipy.stats.chi2.isf(1 / 300, own.predicted.dof) / own.predicted.dof)
        kinds = [reason.kind for reason in found.reasons]
        ratio = own.position_rms / drawn.position_rms
        assert ("check_declared" in kinds) == (ratio > max(1.05, chance))
        assert "predicted_declared" not in kinds
        # Two deviations of a root mean square of as many numbers as were measured.
        beyond.append((ratio > 1 + 2 / np.sqrt(2 * 3 * poses), found.verdict))
    assert sum(large and verdict == "adequate" for large, verdict in beyond) >= sized(4, 12)


def test_a_wrong_calibration_beside_a_right_drawing_is_contradicted(tmp_path: Path) -> None:
    found, _ = seen_by_a_tracker(0, tmp_path, wrong=0.01)
    assert found.verdict == "unexplained"
    assert "check_declared" in [reason.kind for reason in found.reasons]


def test_the_predicted_error_is_that_of_many_sessions(tmp_path: Path) -> None:
    """The mean square of errors by the parameters, after the motion of the instrument."""
    squares, predicted = [], []
    for seed in range(sized(6, 12)):
        rng = np.random.default_rng([4, seed])
        job = Job(Body.random(np.random.default_rng(3)), rng, 60)
        job.plane("table")  # of two surfaces, what changes from one to the other would be in it
        read = job.machine("arm").observe(rng)
        readings, mechanism = files.write(job.machine("arm"), read, tmp_path)
        true = job.body.tip(read, job.values)
        with (tmp_path / "true.csv").open("w", encoding="utf-8") as file:
            file.write(",".join([*JOINTS, "x", "y", "z"]) + "\n")
            for q, place in zip(read, true, strict=True):
                file.write(",".join(f"{x:.9g}" for x in [*q, *place]) + "\n")
        found = rsicalib.calibrate(readings, mechanism, check=tmp_path / "true.csv", align=True)
        aligned = found.fit.aligned
        assert aligned is not None and aligned.predicted is not None
        squares.append(aligned.position_rms**2)
        predicted.append(aligned.predicted.position_sd**2)
    ratio = np.mean(np.array(squares) / np.array(predicted))
    # 12 sessions of a few degrees of freedom each; of six the spread is √2 times as large.
    assert sized(0.3, 0.4) < ratio < sized(2.3, 1.9)


def test_a_point_is_named_where_chains_carry_several(
    touched: tuple[Path, Path, Path, Job, Array], tmp_path: Path
) -> None:
    readings, mechanism, seen, job, _read = touched
    document = job.machine("arm").mechanism
    spare = {"name": "spare", "chain": "arm", "at": [0.0, 0.0, 0.0]}
    two = tmp_path / "two.toml"
    two.write_text(files.toml(document | {"point": [*document["point"], spare]}), encoding="utf-8")
    with pytest.raises(InputError, match="tool"):
        rsicalib.calibrate(readings, two, check=seen)
    one = rsicalib.calibrate(readings, two, check=seen, check_point="tool", align=True)
    same = rsicalib.calibrate(readings, mechanism, check=seen, align=True)
    assert one.fit.aligned is not None and same.fit.aligned is not None
    assert one.fit.aligned.position_rms == pytest.approx(same.fit.aligned.position_rms, rel=1e-9)


def test_places_are_no_poses(touched: tuple[Path, Path, Path, Job, Array], tmp_path: Path) -> None:
    readings, mechanism, seen, _, _read = touched
    with pytest.raises(InputError, match="'x' without 'ry'"):
        table = seen.read_text(encoding="utf-8").replace("x,y,z", "x,y,z,rx", 1)
        lines = table.splitlines()
        (tmp_path / "half.csv").write_text(
            "\n".join([lines[0], *(line + ",0" for line in lines[1:])]), encoding="utf-8"
        )
        rsicalib.calibrate(readings, mechanism, check=tmp_path / "half.csv")
    with pytest.raises(InputError, match="orientation"):
        rng = np.random.default_rng(1)
        poses = "\n".join(
            ",".join(map(str, [1 + k, *rng.integers(1000, 3000, 9), *oracle.REST[:3]]))
            for k in range(4)
        )
        header = ",".join(["pose", *(f"a{i}{j}" for i in "123" for j in "123"), "x", "y", "z"])
        (tmp_path / "fixture.csv").write_text(f"{header}\n{poses}\n", encoding="utf-8")
        rsicalib.fixture(tmp_path / "fixture.csv")


def test_an_arm_on_planes_says_where_it_is(
    touched: tuple[Path, Path, Path, Job, Array],
) -> None:
    readings, mechanism, seen, job, read = touched
    found = rsicalib.calibrate(readings, mechanism)
    offsets = {p.target: p.value for p in found.parameters if p.term == "offset" and p.value}
    for table in (readings, seen):  # what is touched has no part in it
        where = rsicalib.forward(table, mechanism, calibration=found)
        assert where == pytest.approx(tip(job, read, offsets), abs=2e-4)  # as written


def test_the_noise_of_known_poses_is_their_own_after_a_motion_of_the_instrument() -> None:
    """Each pose is read by itself: a rigid motion takes six numbers of all, not all of each."""
    p_values, ratios = [], []
    for seed in range(sized(2, 4)):
        session = rsicalib.simulate(samples=2, check=1, seed=seed)
        rng = np.random.default_rng(seed)
        held = np.repeat(rng.uniform(-0.3, 0.3, (20, 6)) * [6, 6, 3, 1, 1, 1], 8, axis=0)
        held[:, 2] -= 2.7
        poses = held + rng.normal(0.0, [0.05] * 3 + [0.02] * 3, held.shape)  # a hand trembles
        read = session.device.readings(poses)
        read = np.rint(read + rng.normal(0.0, 1.0, read.shape))
        known = {name: poses[:, k] for k, name in enumerate(("x", "y", "z", "rx", "ry", "rz"))}
        known |= {name: read[:, k] for k, name in enumerate(session.readings.channels)}
        known["pose"] = np.repeat(np.arange(20), 8)
        found = rsicalib.calibrate(session.readings, rest=session.rest, check=known, align=True)
        for check in (found.fit.check, found.fit.aligned):
            assert check is not None and check.predicted is not None
            p_values.append(check.predicted.p_value)
            ratios.append(check.position_rms / check.predicted.position_sd)
    # Of eight values that are uniform one in 250 is below this, of four one in 500. Before, all
    # were below 1e-10.
    assert min(p_values) > 5e-4
    # 20 poses of 8 samples, which share the errors of the parameters: a twelfth or more.
    assert np.mean(ratios) == pytest.approx(1.0, abs=sized(0.28, 0.2))
