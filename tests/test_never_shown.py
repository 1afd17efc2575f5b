"""What no reading could ever show is in no number that says how well something is known.

Witness: the arm of `tests/machines`, products of plain matrices, linearised by differences. Where
it touches sockets whose places are unknown, a turn of the whole with them changes no misclosure.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

import rsicalib
from tests.machines import arm, files
from tests.machines.kit import Linear, Machine
from tests.oracle import Array

ERROR = 3e-3
"""A joint that errs once per turn by so much [rad]."""


def on_sockets(error: float, poses: int = 60) -> tuple[arm.Job, Machine, Array]:
    """An arm on two sockets with an error of its third joint, and its readings."""
    rng = np.random.default_rng(3)
    job = arm.Job(arm.Body.random(rng), rng, poses)
    job.values["offset@q1"] = 0.0
    job.sockets(np.ones(poses))
    machine = job.machine("arm")
    read = machine.observe(rng)
    if error:
        (one,) = (e for e in machine.effects if e.value == "once@q3")
        read = machine.observe(rng, one, error)
    return job, machine, read


def tips(job: arm.Job, names: list[str]) -> Array:
    """Derivatives of places of the tool by values of the arm, by differences: (n, 3, names)."""
    out = []
    for name in names:
        ends = [
            job.body.tip(job.q, job.values | {name: job.values.get(name, 0.0) + sign * 1e-6})
            for sign in (1, -1)
        ]
        out.append((ends[0] - ends[1]) / 2e-6)
    return np.stack(out, axis=2)


def test_a_turn_of_the_whole_changes_no_misclosure() -> None:
    """The witness itself: places of the sockets take up all of a turn about the first joint."""
    _, machine, _ = on_sockets(0.0)
    linear = Linear(machine)
    turn = linear.column("offset@q1", 1e-5)
    places = [n for n in machine.fitted if "socket" in n]
    by_places = np.column_stack([linear.column(n, 1e-2) for n in places])
    left = turn - by_places @ np.linalg.lstsq(by_places, turn, rcond=None)[0]
    assert np.linalg.norm(left) < 1e-6 * np.linalg.norm(turn)


@pytest.mark.parametrize("error", [0.0, ERROR])
def test_what_is_known_of_places_leaves_it_out(error: float, tmp_path: Path) -> None:
    """In pictures of the report, and in a plan, with an effect and without one."""
    job, machine, read = on_sockets(error)
    csv, file = files.write(machine, read, tmp_path)
    mechanism = rsicalib.load_mechanism(file)
    found = rsicalib.trace(csv, mechanism)
    assert [step.target for step in found.steps] == (["q3"] if error else [])
    assert found.evidence is not None and found.evidence.drawing is not None
    drawn = np.linalg.norm(found.evidence.drawing.weakest, axis=1)
    cells = [cell[2] for one in found.evidence.workspace for cell in one.cells]
    assert found.evidence.weakest is not None
    assert found.evidence.weakest.parameter.target != "q1"

    # With what was found: of a joint that errs once per turn, its sine and cosine.
    names = [f"offset@q{k}" for k in range(2, 7)]
    linear = Linear(machine)
    columns = {n: linear.column(n, s) for n, s in machine.fitted.items() if n != "offset@q1"}
    moves = dict(zip(names, np.moveaxis(tips(job, names), 2, 0), strict=True))
    if error:
        # An offset of q3, times the sine and the cosine of its reading.
        for wave in (np.sin, np.cos):
            by = wave(job.q[:, 2])
            columns[wave.__name__] = (
                columns["offset@q3"].reshape(len(by), -1) * by[:, None]
            ).ravel()
            moves[wave.__name__] = moves["offset@q3"] * by[:, None]
    x = np.column_stack(list(columns.values()))
    long = np.linalg.norm(x, axis=0)
    covariance = np.linalg.inv((x / long).T @ (x / long)) / np.outer(long, long)
    own = [list(columns).index(n) for n in moves]
    slopes = np.stack(list(moves.values()), axis=2)
    of_tips = slopes @ covariance[np.ix_(own, own)] @ np.swapaxes(slopes, 1, 2)
    expected = np.sqrt(np.linalg.eigvalsh(of_tips)[:, -1])
    assert drawn == pytest.approx(expected, rel=0.25)
    # A turn that noise and play alone seem to tell would be 100 times as much.
    assert max(cells) < 10 * expected.max()

    plan = rsicalib.plan(mechanism, 2, result=found, beside=csv)
    assert plan.forecast is not None
    known = plan.forecast.platform_sd
    assert known.before.position is not None and known.after.position is not None
    assert known.after.position < known.before.position < 10 * expected.max()


def test_what_has_no_parameter_does_not_hide_there(tmp_path: Path) -> None:
    """The offset of the first joint is left out of the model: nothing says how large it may be."""
    _, machine, read = on_sockets(ERROR)
    machine.mechanism["model"]["terms"] = [f"offset@q{k}" for k in range(2, 7)]
    csv, file = files.write(machine, read, tmp_path)
    mechanism = rsicalib.load_mechanism(file)
    found = rsicalib.trace(csv, mechanism)
    hidden = {(h.term, h.target) for h in found.could_hide}
    assert ("offset", "q1") not in hidden and ("gain", "q1") in hidden
    made = rsicalib.certify(found, mechanism, limit=10.0)
    sources = {share.effect for share in made.uncertainty.budget}  # type: ignore[union-attr]
    assert not any(source and source.startswith("offset") for source in sources)


def test_no_typical_size_stands_for_what_a_joint_gives_about_a_vertical_axis(
    tmp_path: Path,
) -> None:
    """Beside another compliance, too: typical sizes hold what several joints give.

    Witness: the torque of a weight about a vertical axis through the base is `z · (r × down)`,
    which is zero for every place `r`.
    """
    job, machine, read = on_sockets(0.0)
    turned = job.body.torque(job.q, "q1")
    assert np.abs(turned).max() < 1e-9 * np.abs(job.body.torque(job.q, "q2")).max()
    machine.mechanism["gravity"] = [0.0, 0.0, -1.0]
    (chain,) = machine.mechanism["chain"]
    for row, mass in zip([r for r in chain["dh"] if "channel" in r], range(1, 7), strict=True):
        row |= {"mass": float(mass), "com": [-100.0, 10.0 * mass, 30.0]}
    csv, file = files.write(machine, read, tmp_path)
    alone = ["offset", "joint_compliance@q1"]
    for terms in (alone, [*alone, "joint_compliance@q2", "joint_compliance@q3"]):
        found = rsicalib.calibrate(csv, file, terms=terms)
        sd = {p.target: p.sd for p in found.parameters if p.term == "joint_compliance"}
        assert sd.pop("q1") is None
        assert all(known is not None and known > 0.0 for known in sd.values())
        assert any(line.startswith("joint_compliance q1:") for line in found.unobservable)
        # Nor does it hide that the whole may turn about that axis.
        (turn,) = (p for p in found.parameters if (p.term, p.target) == ("offset", "q1"))
        assert turn.sd is None and turn.value == pytest.approx(0.0, abs=1e-12)
