"""What no reading could ever show is a convention, for every kind of closure; the rest is judged.

Witnesses: the arms of `tests/machines`, products of plain matrices, linearised by differences, with
the first joint where it is drawn.
"""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import rsicalib
from rsicalib.errors import InputError
from rsicalib.report import words
from tests.full import sized
from tests.machines import arm, files
from tests.machines.arm import Job
from tests.machines.kit import Linear, Machine, Rng
from tests.oracle import Array

ARMS = {
    "plane": arm.draw_plane,
    "line": arm.draw_line,
    "bar": arm.draw_bar,
    "tracker": arm.draw_tracker,
}
"""An arm whose offsets are all free, at what is unknown."""

named = pytest.mark.parametrize("name", ARMS)


def found(machine: Machine, read: Array, folder: Path, verb: Any = rsicalib.calibrate) -> Any:
    """What the library says of a session."""
    csv, mechanism = files.write(machine, read, folder)
    return verb(csv, rsicalib.load_mechanism(mechanism))


def columns(linear: Linear, held: str) -> tuple[list[str], Array]:
    """Columns of all that is fitted but for what is held, and their names."""
    names = [n for n in linear.machine.fitted if n != held]
    return names, np.column_stack([linear.column(n, linear.machine.fitted[n]) for n in names])


def expected_sd(machine: Machine) -> dict[str, float]:
    """Standard deviations of all that is fitted, with the first joint where it is drawn."""
    names, x = columns(Linear(machine), "offset@q1")
    long = np.linalg.norm(x, axis=0)
    sd = np.sqrt(np.diag(np.linalg.inv((x / long).T @ (x / long)))) / long
    return dict(zip(names, sd, strict=True))


def two_planes(job: Job) -> None:
    """A table and a wall, of which only the table is bent: told as one shape, that of both."""
    first = (np.arange(job.poses) % 2 == 0).astype(float)
    job.plane("table", first)
    job.plane("wall", 1 - first)


def at_sockets(job: Job) -> None:
    """Two sockets, of which one moves: told as one move, that of both."""
    job.sockets(np.ones(job.poses))


def seen_plane(job: Job) -> None:
    """A table, and a tracker that sees every touch."""
    job.plane("table")
    job.tracker()


MISTOLD = ("shared", "socket")
"""What is told there is not the whole truth: what is left over is in the estimates."""


@named
@pytest.mark.parametrize("verb", [rsicalib.calibrate, rsicalib.trace])
def test_a_turn_about_the_first_joint_is_a_convention(name: str, verb: Any, tmp_path: Path) -> None:
    rng = np.random.default_rng(11)
    machine = ARMS[name](rng)
    answer = found(machine, machine.observe(rng), tmp_path, verb)
    assert (answer.verdict, answer.exit_code) == ("adequate", 0)
    (said,) = answer.unobservable
    assert "no reading can tell: offset q1 stays as drawn" in said
    assert answer["offset@q1"].sd is None
    assert answer["offset@q1"].value == pytest.approx(0.0, abs=1e-8)
    for key, sd in expected_sd(machine).items():
        if key.startswith("offset@q"):
            # Linearised at the truth; noise and play move the poses by 1e-3 of the arm.
            assert answer[key].sd == pytest.approx(sd, rel=0.02)


@named
def test_an_effect_beside_a_convention_is_named(name: str, tmp_path: Path) -> None:
    rng = np.random.default_rng(12)
    machine = ARMS[name](rng)
    (one,) = (e for e in machine.effects if e.value == "gain@q3")
    size = Linear(machine).sized(one, 100.0)
    answer = found(machine, machine.observe(rng, one, size), tmp_path, rsicalib.trace)
    said = {(s.term, s.target) for s in answer.steps}
    said |= {(t.term, t.target) for s in answer.steps for t in s.also_fits}
    assert answer.verdict == "explained" and ("gain", "q3") in said


SHAPED: dict[str, tuple[Callable[[Job], None], dict[str, float], str]] = {
    "bent": (lambda job: job.plane("table"), {"bend@table": 0.5}, "plane_bend@tool on surface"),
    "shared": (two_planes, {"bend@table": 0.5}, "plane_bend@tool on surface"),
    "pushed": (lambda job: job.plane("table"), {"step@table": 0.5}, "plane_slip@tool on surface:"),
    "sagging": (Job.line, {"bend@guide": 0.5}, "line_bend@tool on guide"),
    "loosened": (Job.line, {"step@guide": 0.5}, "line_slip@tool on guide:"),
    "slipped": (Job.bar, {"moved@post": 0.5}, "point_slip@bar:"),
    "socket": (at_sockets, {"moved@socket[at=s0]": 0.5}, "point_slip@tool in socket:"),
    "knocked": (Job.tracker, {"step@tracker": 0.5}, "point_slip@tool at marker:"),
    "seen": (seen_plane, {"bend@table": 0.5}, "plane_bend@tool on surface"),
}
"""What stands there, how it is bent or moved [mm], and the term that is told of it."""


@pytest.mark.parametrize("name", SHAPED)
def test_what_explains_where_something_stands_leaves_a_turn_of_the_whole_a_convention(
    name: str, tmp_path: Path
) -> None:
    """Shapes and moves are drawn along axes of the base; the whole may turn nevertheless."""
    rng = np.random.default_rng(14)
    job = Job(arm.Body.random(rng), rng, 60)
    stand, error, term = SHAPED[name]
    stand(job)
    job.values |= error
    machine = job.machine("arm")
    late = int(np.flatnonzero(job.late)[0]) + 1
    told = ["offset", f"{term}{late}" if term.endswith(":") else term]
    machine.mechanism["model"]["terms"] = told
    answer = found(machine, machine.observe(rng), tmp_path)
    (said,) = answer.unobservable
    assert "no reading can tell: offset q1 stays as drawn" in said
    assert answer.verdict != "undetermined" and answer["offset@q1"].sd is None
    assert answer["offset@q1"].value == pytest.approx(0.0, abs=1e-8)
    if name not in MISTOLD:
        # One sample of 5 offsets: 4 standard deviations are 3 in 10,000.
        for key in (f"offset@q{k}" for k in range(2, 7)):
            assert abs(answer[key].value - job.values[key]) < 4 * answer[key].sd


def lazy(draw: Callable[[Rng], Machine], still: tuple[int, ...], rng: Rng) -> Machine:
    """A machine whose operator never moves these joints."""
    machine = draw(rng)
    machine.start[:, still] = machine.start[0, still]
    machine.gives[list(still)] = 0.0
    return machine


@pytest.mark.parametrize("name", ["bar", "tracker"])
@pytest.mark.parametrize("seed", sized([3], [3, 4]))
def test_what_other_poses_could_tell_is_named_and_the_convention_is_not(
    name: str, seed: int, tmp_path: Path
) -> None:
    """Joints 4 to 6 stand still: the tool is one point of the forearm, and four offsets move it."""
    rng = np.random.default_rng(seed)
    machine = lazy(ARMS[name], (3, 4, 5), rng)
    names, x = columns(Linear(machine), "offset@q1")
    long = np.linalg.norm(x, axis=0)
    _, sizes, right = np.linalg.svd(x / long)
    assert np.sum(sizes < 1e-6 * sizes[0]) == 1
    takes_part = np.abs(right[-1]) > 0.2 * np.abs(right[-1]).max()
    witness = {n for n, part in zip(names, takes_part, strict=True) if part}
    assert witness <= {f"offset@q{k}" for k in range(3, 7)}

    # Noise opens the loops, so that the fit does tell the direction, if hardly: a radian and more.
    answer = found(machine, machine.observe(rng), tmp_path)
    hardly, convention = answer.unobservable
    assert "offset q1 stays as drawn" in convention
    assert "offset q1" not in hardly
    # Which of the four bear it most depends on where along it, radians off, the estimate lies.
    named = {f"offset@q{k}" for k in range(1, 7) if f"offset q{k}" in hardly}
    assert named <= {f"offset@q{k}" for k in range(3, 7)} and len(named & witness) >= 2
    # Of an angle that lies anywhere within a turn the standard deviation is as large.
    assert max(answer[key].sd for key in named) > np.pi / np.sqrt(3)
    assert answer["offset@q2"].sd < 0.01
    assert answer.verdict == "undetermined"
    assert hardly in words.sentence(answer) and convention not in words.sentence(answer)


def session(sd_of_rest: float | None, priors: dict[str, float], terms: list[str]) -> Any:
    """A session of the hand controller whose places are free."""
    made = rsicalib.simulate(poses=40, samples=4, seed=3)
    document = rsicalib.load_mechanism("rsi").to_dict()
    if sd_of_rest is not None:
        document["rest"]["sd"] = sd_of_rest
    document["model"]["sd"] = priors
    mechanism = rsicalib.Mechanism.from_dict(document)
    return rsicalib.calibrate(made.readings, mechanism, rest=made.rest, terms=terms)


def test_a_rest_pose_and_a_drawing_tell_what_readings_do_not() -> None:
    """Three shifts of the whole; each is told by what fixes the whole, and by nothing else."""
    terms = ["offset", "gain", "base_position"]
    shifts = session(None, {}, terms)
    assert shifts.verdict == "adequate" and len(shifts.unobservable) == 3
    rest = session(0.05, {}, terms)
    assert rest.verdict == "adequate" and not rest.unobservable
    drawn = session(None, {"base_position": 0.01}, terms)
    assert drawn.verdict == "adequate" and not drawn.unobservable
    whole = [p for p in drawn.parameters if p.term == "base_position"]
    # Three bases share each shift, which their drawings tell to 0.01/sqrt(3).
    assert all(p.sd is not None and p.sd > 0.01 / np.sqrt(3) for p in whole)
    assert shifts.fit.chi2 == pytest.approx(rest.fit.chi2, abs=3.0)


def test_what_has_no_scale_is_refused_with_advice() -> None:
    terms = ["offset", "gain", "link_length", "distance"]
    with pytest.raises(InputError, match="one length that is known"):
        session(None, {}, terms)
    known = session(None, {}, [*terms[:3], "distance@wrist1-wrist2", "distance@wrist2-wrist3"])
    assert known.verdict == "adequate" and not known.unobservable


def test_two_gains_of_equal_channels_are_refused_and_one_is_found() -> None:
    """With both gains zero the closure holds whatever is read."""
    channels = [{"name": name, "unit": "rad", "gain": 1.0, "offset": 0.0} for name in ("a", "b")]
    closures = [{"name": "same", "kind": "equal", "between": ["a", "b"]}]
    pair = rsicalib.Mechanism.from_toml(
        files.toml({"name": "pair", "length_unit": "mm", "channel": channels, "closure": closures})
    )
    rng = np.random.default_rng(4)
    turned = rng.uniform(-1.0, 1.0, 40)
    noise = 1e-4 * rng.standard_normal((2, 40))
    read = {"a": turned + noise[0], "b": (turned - 0.02) / 1.03 + noise[1]}
    with pytest.raises(InputError, match=r"one gain that is known.*gain@CHANNEL"):
        rsicalib.calibrate(read, pair, terms=["offset", "gain"])
    found = rsicalib.calibrate(read, pair, terms=["offset@b", "gain@b"])
    gain = found["gain@b"]
    assert gain.sd is not None and abs(gain.value - 1.03) < 4 * gain.sd
    with pytest.raises(InputError, match="one gain that is known"):
        rsicalib.calibrate(read, pair, terms=["gain@a+b"])
    # A search looks at gains of both, and refuses nobody.
    bent = read | {"b": read["b"] + 0.05 * np.sin(2 * turned)}
    traced = rsicalib.trace(bent, pair, terms=["offset@b", "gain@b"])
    assert traced.verdict != "adequate" and traced["gain@b"].value > 0.5


def test_closures_that_are_used_up_by_unknowns_of_the_pose_ask_for_a_sensor() -> None:
    """Three cranks with rods to a plate that is anywhere: a pose has three equations for three."""
    turns = np.radians([90.0, 210.0, 330.0])
    legs, ends, rods = [], [], []
    for k, turn in enumerate(turns, 1):
        rows = [{"theta": float(turn), "a": 250.0}, {"channel": f"m{k}", "a": 180.0}]
        legs.append({"name": f"leg{k}", "dh": rows})
        corner = [60.0 * float(np.cos(turn)), 60.0 * float(np.sin(turn)), 0.0]
        ends.append({"name": f"elbow{k}", "chain": f"leg{k}", "at": [0.0, 0.0, 0.0]})
        ends.append({"name": f"corner{k}", "frame": "plate", "at": corner})
        between = [f"elbow{k}", f"corner{k}"]
        rods.append({"name": f"rod{k}", "kind": "distance", "between": between, "value": 160.0})
    motors = [{"name": f"m{k}", "unit": "rad", "gain": 1.0, "offset": 0.0} for k in (1, 2, 3)]
    whole = {"name": "three cranks", "length_unit": "mm", "channel": motors, "chain": legs}
    whole |= {"point": ends, "closure": rods, "frame": [{"name": "plate", "unknown": ["pose"]}]}
    rng = np.random.default_rng(3)
    read = {f"m{k}": rng.uniform(2.0, 3.0, 40) for k in (1, 2, 3)}
    found = rsicalib.calibrate(read, rsicalib.Mechanism.from_toml(files.toml(whole)))
    assert found.verdict == "undetermined" and found.exit_code == 3
    assert "read one more joint or length" in " ".join(found.summary().split())
    assert not any("more poses" in line for line in words.advice(found))


def test_a_tilt_that_repeats_an_offset_stays_as_drawn(tmp_path: Path) -> None:
    """Two terms of one joint that do the same: one of them is held, whatever the noise is."""
    rng = np.random.default_rng(5)
    machine = arm.draw_bar(rng)
    machine.mechanism["model"]["terms"] = ["offset", "base_bearing"]
    answer = found(machine, machine.observe(rng), tmp_path)
    assert answer.verdict == "adequate"
    # The base turns as the first joint does, and both as the whole does: two conventions.
    assert len(answer.unobservable) == 2
    assert all(abs(p.value) < 0.05 for p in answer.parameters if p.term != "unknown_point")
