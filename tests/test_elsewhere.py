"""What is applied is what helps on placements that the search did not see.

The arms are simulated in products of plain matrices, `tests/between.py`.
"""

from __future__ import annotations

import numpy as np

import rsicalib
from tests import between
from tests.oracle import Array

TRUE = np.array([0.004, -0.006, 0.008, -0.010, 1.0, -2.0, 1.5])


def session(seed: int, wrong: float, only_first: bool) -> tuple[dict[str, object], Array]:
    """Four placements with an error of joint 3, quadratic in its angle, and the angles."""
    rng = np.random.default_rng(seed)
    read = np.stack([between.placement(rng, TRUE) for _ in range(4)])
    angles = read + np.array([0.0, *TRUE[:4], 0.0])
    bent = read.copy()
    affected = bent[:1] if only_first else bent
    affected[:, :, 2] += wrong * (affected[:, :, 2] + 1.6) ** 2
    table = {f"q{k + 1}": column for k, column in enumerate(bent.reshape(-1, 6).T)}
    at = [f"plate {k}" for k in range(4) for _ in range(between.POSES)]
    return {**table, "at": at}, angles.reshape(-1, 6)


def error(found: rsicalib.Trace, table: dict[str, object], angles: Array) -> float:
    """Root mean square distance of the ball from where it was."""
    places = np.asarray(rsicalib.forward(table, between.mechanism(), found)).reshape(-1, 3)
    truth = between.tips(angles, between.BALL + TRUE[4:])
    return float(np.sqrt(((places - truth) ** 2).sum(axis=1).mean()))


def test_an_effect_of_all_placements_is_applied() -> None:
    table, angles = session(1, 0.004, only_first=False)
    found = rsicalib.trace(table, between.mechanism())
    assert [step.applied for step in found.steps] == [True] * len(found.steps)
    assert "q3" in {step.target for step in found.steps}
    elsewhere = found.elsewhere
    assert elsewhere is not None and elsewhere.kind == "groups" and elsewhere.blocks == 2
    assert elsewhere.applied < 0.8 * elsewhere.without
    plain = rsicalib.calibrate(table, between.mechanism())
    assert error(found, table, angles) < error(plain, table, angles)  # type: ignore[arg-type]


def test_without_effects_nothing_is_left_out() -> None:
    table, _ = session(2, 0.0, only_first=False)
    assert rsicalib.trace(table, between.mechanism()).elsewhere is None


def test_what_does_not_help_elsewhere_is_named_and_no_part_of_the_parameters() -> None:
    table, _ = session(3, 0.01, only_first=True)
    found = rsicalib.trace(table, between.mechanism())
    named = [step for step in found.steps if not step.applied]
    assert named, "an effect of one placement in four does not hold in the others"
    keys = {(p.term, p.target) for p in found.parameters}
    assert all((step.term, step.target) not in keys for step in named)
    assert "not applied" in found.summary(whole=True)
    every = rsicalib.trace(table, between.mechanism(), apply_all=True)
    assert all(step.applied for step in every.steps)
    assert {(s.term, s.target) for s in every.steps} <= {
        (p.term, p.target) for p in every.parameters
    }


def test_a_free_curve_stays_at_its_edge() -> None:
    table, _ = session(1, 0.004, only_first=False)
    terms = [*cone_terms(), "free_curve@q3"]
    found = rsicalib.calibrate(table, between.mechanism(), terms=terms)
    q = np.tile([0.4, -1.4, 0.0, -1.5, 1.5, 0.0], (3, 1))
    q3 = np.array(table["q3"], dtype=float)
    q[:, 2] = q3.max() + np.array([0.0, 0.2, 0.4])
    places = np.asarray(
        rsicalib.forward(dict(zip(CHANNELS, q.T, strict=True)), between.mechanism(), found)
    )
    values = {p.target: p.value for p in found.parameters if p.term == "offset"}
    ball = between.BALL + [p.value for p in found.parameters if p.term == "point_position"]
    curve = sum(
        p.value * (-1) ** int(p.name[1:]) for p in found.parameters if p.term == "free_curve"
    )
    q += [0.0, values["q2"], values["q3"] + curve, values["q4"], values["q5"], 0.0]
    np.testing.assert_allclose(places.reshape(-1, 3), between.tips(q, ball), atol=1e-6)


CHANNELS = [f"q{k + 1}" for k in range(6)]


def cone_terms() -> list[str]:
    """The terms of the mechanism."""
    return [term.strip('" ') for term in between.TERMS.strip("[]").split(",")]
