"""Simulated machines of every closure: the simulators by themselves, and what the library says."""

from __future__ import annotations

import tomllib
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from scipy.optimize import fsolve, least_squares

from rsicalib import Mechanism, calibrate, forward, trace
from rsicalib.errors import InputError
from tests.full import sized
from tests.machines import files, statics
from tests.machines.__main__ import main
from tests.machines.kit import Effect, Linear, Machine
from tests.machines.statics import Hanging
from tests.machines.trials import MACHINES, make, run
from tests.oracle import Array

SEED = 0


def drawn(name: str, seed: int = SEED) -> Machine:
    return MACHINES[name](np.random.default_rng(seed))


def chi2(machine: Machine, read: Array) -> float:
    """The least misclosure in standard deviations, by SciPy, all that is unknown free.

    Unknown are what the file identifies and places; the noise of the readings is carried through
    as it is at the truth. Where places stand in the equations themselves: no elimination.
    """
    linear, n = Linear(machine), len(read)
    c, k = len(machine.columns), linear.rows.shape[1] - len(machine.columns)
    slope = machine.slope(linear.rows, machine.values, np.arange(c))
    cover = (slope * machine.sigma**2) @ np.swapaxes(slope, 1, 2) + np.diag(machine.play**2)
    root = np.linalg.inv(np.linalg.cholesky(cover))
    names, steps = list(machine.fitted), np.array(list(machine.fitted.values()))
    near = np.array([machine.values[name] for name in names])

    def gap(p: Array) -> Array:
        values = machine.values | dict(zip(names, near + steps * p[: len(names)], strict=True))
        places = linear.rows[:, c:] + p[len(names) :].reshape(n, k)
        return np.asarray(np.einsum("nij,nj->ni", root, machine.gap(read, places, values)).ravel())

    own = np.kron(np.eye(n), np.ones((len(machine.play), k)))  # whose places a row knows
    seen = np.hstack([np.ones((len(own), len(names))), own])
    start = np.zeros(seen.shape[1])
    found = least_squares(gap, start, x_scale="jac", jac_sparsity=seen, max_nfev=30, ftol=1e-6)
    return float(found.fun @ found.fun)


@pytest.mark.parametrize("name", MACHINES)
def test_loops_close_and_what_is_not_asked_is_zero(name: str) -> None:
    machine = drawn(name)
    rows = machine.closed(machine.values)
    assert np.abs(machine.gap(*machine.parts(rows), machine.values)).max() < 1e-6
    assert np.isfinite(machine.observe(np.random.default_rng(1))).all()


@pytest.mark.parametrize("name", sized(["belts", "delta"], ["belts", "delta", "line", "leader"]))
def test_what_a_session_leaves_is_chi_squared_and_an_effect_adds_its_noncentrality(
    name: str,
) -> None:
    """Three sessions each: the mean of χ² has a standard deviation of √(2 dof / 3)."""
    machine = drawn(name)
    linear = Linear(machine)
    dof = linear.size - linear.base.shape[1]
    rng = np.random.default_rng(2)
    clean = np.mean([chi2(machine, machine.observe(rng)) for _ in range(3)])
    assert abs(clean - dof) < 4 * np.sqrt(2 * dof / 3)
    shown = next(e for e in machine.effects if can(linear, e))
    size = linear.sized(shown, 400.0)
    spoiled = np.mean([chi2(machine, machine.observe(rng, shown, size)) for _ in range(3)])
    # The variance is 2 (dof + 2 λ); a twentieth of λ is what is not linear.
    assert abs(spoiled - dof - 400) < 4 * np.sqrt(2 * (dof + 800) / 3) + 20


def can(linear: Linear, one: Effect) -> bool:
    try:
        linear.sized(one, 400.0)
    except ValueError:
        return False
    return True


@pytest.mark.parametrize("name", MACHINES)
def test_a_case_is_its_numbers_and_its_files_are_files(name: str, tmp_path: Path) -> None:
    one = make(name, "effect", 3, SEED)
    if name in sized(("belts", "bar", "fivebar"), MACHINES):  # one of each module of simulators
        two = make(name, "effect", 3, SEED)
        np.testing.assert_array_equal(one.read, two.read)
        assert one.effect == two.effect
    assert 30 <= one.strength <= 100
    assert one.effect is not None and one.effect.names <= one.names
    csv, mechanism = files.write(one.machine, one.read, tmp_path)
    read_back = tomllib.loads(mechanism.read_text(encoding="utf-8"))
    assert read_back == one.machine.mechanism
    header = csv.read_text(encoding="utf-8").splitlines()[0].split(",")
    assert header[2:] == [*one.machine.columns, *one.machine.text]


def test_pieces_of_a_campaign_are_the_campaign(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """Records of a piece are not run again, and the table counts all of them."""
    records = ["--records", str(tmp_path / "r.jsonl")]
    asked = ["--machine", "leader", "--suite", "clean"]
    assert main([*asked, "--count", "2", *records]) == 0
    assert main([*asked, "--first", "1", "--count", "2", *records]) == 0
    capsys.readouterr()
    lines = (tmp_path / "r.jsonl").read_text(encoding="utf-8").splitlines()
    assert len(lines) == 3
    assert main(["--table", str(tmp_path / "r.jsonl")]) == 0
    printed = capsys.readouterr().out
    assert "of 3" in printed or "none 3" in printed


@pytest.mark.parametrize("name", ["fivebar", "legs"])
def test_drives_do_the_work_of_the_weights(name: str) -> None:
    """A drive turns by 0.1 mrad, the loops are closed again: its work is what the weights fall."""
    hanging, start = hanging_of(name)
    for drive in np.flatnonzero(hanging.driven):
        ends = []
        for sign in (1, -1):
            moved = start.copy()
            moved[:, drive] += sign * 5e-5
            ends.append(shut(hanging, moved))
        work = hanging.felt(start)[:, drive] * 1e-4
        fallen = hanging.fall(ends[0]) - hanging.fall(ends[1])
        # The third derivative of the fall, where a loop is nearly stretched 1e4 of it, times 1e-9.
        np.testing.assert_allclose(work, fallen, atol=1e-5 * np.abs(work).max())


def test_drives_that_could_work_against_each_other_hold_the_weights() -> None:
    """A motion of the loop: the work of all three drives together is what the weights fall."""
    machine = statics.draw_redundant(np.random.default_rng(SEED))
    hanging = redundant(machine)
    start = machine.closed(machine.values | dict.fromkeys(machine.fitted, 0.0))
    torque = hanging.felt(start)
    stands = hanging.standing(2)
    for drive in np.flatnonzero(stands):
        ends = []
        for sign in (1, -1):
            moved = start.copy()
            moved[:, drive] += sign * 5e-5
            ends.append(shut(hanging, moved, stands))
        work = np.sum(torque * (ends[0] - ends[1]), axis=1)
        fallen = hanging.fall(ends[0]) - hanging.fall(ends[1])
        np.testing.assert_allclose(work, fallen, atol=1e-5 * np.abs(work).max())


def redundant(machine: Machine) -> Hanging:
    """The mechanism of a machine with shares, its drawing as its truth."""
    channels = machine.mechanism["channel"]
    drives = [c["name"] for c in channels if not c.get("passive")]
    shares = tuple(c["share"] for c in channels if not c.get("passive"))
    right = machine.values | dict.fromkeys(machine.fitted, 0.0)

    def closed(q: dict[str, Array], chains: object) -> Array:
        read = np.stack([q[c] for c in machine.columns], axis=1)
        return machine.gap(read, read[:, :0], right)

    down = np.array(machine.mechanism["gravity"])
    return Hanging(machine.mechanism["chain"], drives, down, closed, shares=shares)


@pytest.mark.parametrize("tells", statics.TELLS)
def test_what_drives_carry_is_declared_or_not_looked_for(tells: str | None, tmp_path: Path) -> None:
    """A shoulder that gives, where an elbow has a drive too: noncentrality 150."""
    rng = np.random.default_rng(SEED)
    machine = statics.draw_redundant(rng, tells or "share")
    if tells is None:
        for channel in machine.mechanism["channel"]:
            channel.pop("share", None)
    gives = next(e for e in machine.effects if e.value == "compliance@m1")
    size = Linear(machine).sized(gives, 150.0)
    csv, mechanism = files.write(machine, machine.observe(rng, gives, size), tmp_path)
    asked = ["offset", "joint_compliance@m1"]
    traced = trace(csv, mechanism)
    if tells is None:
        assert "share" in traced.to_dict()["not_candidates"]["joint_compliance"]
        with pytest.raises(InputError, match="share"):
            calibrate(csv, mechanism, terms=asked)
        return
    step = traced.to_dict()["steps"][0]
    named = {(s["term"], s["target"]) for s in [step, *(step["also_fits"] or [])]}
    assert ("joint_compliance", "m1") in named
    found = calibrate(csv, mechanism, terms=asked)["joint_compliance@m1"]
    assert abs(found.value - size) < 4 * found.sd


def test_drives_of_one_make_give_alike(tmp_path: Path) -> None:
    """Two gearboxes of one size at arms that are not drawn alike: one effect, or in its tie."""
    rng, machine = np.random.default_rng(SEED), drawn("fivebar")
    gives = [e for e in machine.effects if e.value in ("compliance@m1", "compliance@m2")]
    size = Linear(machine).sized(gives[0], 1000.0)
    soft = replace(machine, values=machine.values | {e.value: size for e in gives})
    csv, mechanism = files.write(machine, soft.observe(rng), tmp_path)
    found = trace(csv, mechanism)
    assert found.verdict == "explained"
    (step,) = found.steps
    named = {(s.term, s.target): s for s in (step, *(step.also_fits or ()))}
    both = [key for key in named if key[0] == "joint_compliance" and key[1] not in ("m1", "m2")]
    assert both, named.keys()
    again = calibrate(csv, mechanism, terms=["offset", "@".join(both[0])])
    (own,) = (p for p in again.parameters if p.term == "joint_compliance")
    assert own.value is not None and own.sd is not None
    assert abs(own.value - size) < 4 * own.sd


@pytest.mark.parametrize("drive", ["m1", "m2"])
def test_points_are_where_the_loops_close_under_a_load(drive: str, tmp_path: Path) -> None:
    """The pins of two arms meet: torques of an open chain would leave them apart."""
    rng = np.random.default_rng(SEED)
    machine = drawn("fivebar")
    gives = next(e for e in machine.effects if e.value == f"compliance@{drive}")
    size = Linear(machine).sized(gives, 3000.0)
    csv, mechanism = files.write(machine, machine.observe(rng, gives, size), tmp_path)
    found = calibrate(csv, mechanism, terms=["offset", f"joint_compliance@{drive}"])
    assert found.fit is not None and found.fit.rms_misclosure is not None
    places = np.asarray(forward(csv, mechanism, found)).reshape(-1, 2, 3)
    apart = (places[:, 0] - places[:, 1])[:, :2]
    assert np.sqrt(np.mean(apart**2)) < 1.2 * found.fit.rms_misclosure


def hanging_of(name: str) -> tuple[Hanging, Array]:
    """A mechanism whose drawing is its truth, and postures at which it is closed."""
    machine = drawn(name)
    chains = machine.mechanism["chain"]
    drives = [c["name"] for c in machine.mechanism["channel"] if not c.get("passive")]

    def closed(q: dict[str, Array], chains: object) -> Array:
        read = np.stack([q[c] for c in machine.columns], axis=1)
        return machine.gap(read, read[:, :0], right)

    right = machine.values | dict.fromkeys(machine.fitted, 0.0)
    down = np.array(machine.mechanism["gravity"])
    hanging = Hanging(chains, drives, down, closed)
    return hanging, shut(hanging, machine.closed(right)[:: sized(4, 1)])


def shut(hanging: Hanging, q: Array, stands: Array | None = None) -> Array:
    """Joints that do not stand, or have no drive, turned by SciPy until the loops are closed."""
    out, stands = q.copy(), hanging.driven if stands is None else stands
    for row in out:

        def gap(free: Array, row: Array = row) -> Array:
            row[~stands] = free
            return hanging.closed(hanging.named(row[None]), hanging.chains)[0]

        row[~stands] = fsolve(gap, row[~stands].copy(), xtol=1e-12)
    return out


THERE: tuple[str, ...] = ("delta", "fivebar", "legs", "redundant", "warm_legs")
"""Machines whose closures the core has."""


@pytest.mark.parametrize("name", THERE)
def test_clean_machines_are_adequate_and_effects_are_among_the_named(name: str) -> None:
    """The small form of `python -m tests.machines`: one of six may go wrong by chance."""
    cases, right = sized((1, 1), (6, 5))
    clean = [run(name, "clean", k, SEED) for k in range(cases)]
    assert sum(r.get("verdict") == "adequate" for r in clean) >= right, clean
    spoiled = [run(name, "effect", k, SEED) for k in range(cases)]
    assert sum(bool(r.get("among")) for r in spoiled) >= right, spoiled


def test_a_machine_without_chains_may_say_where_down_is(tmp_path: Path) -> None:
    """No channel moves a joint that could hang: a trace ended in a panic."""
    case = make("belts", "clean", 0, 8831)
    csv, mechanism = files.write(case.machine, case.read, tmp_path)
    text = mechanism.read_text(encoding="utf-8")
    declared = Mechanism.from_toml(f"gravity = [0.0, -1.0, 0.0]\n{text}")
    assert trace(csv, declared).verdict == trace(csv, mechanism).verdict
