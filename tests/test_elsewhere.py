"""What is applied is what helps on placements that the search did not see.

The arms are simulated in products of plain matrices, `tests/between.py`.
"""

from __future__ import annotations

from functools import cache

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

import rsicalib
from rsicalib.poses.places import places, readings_for
from tests import between
from tests.full import sized
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


@cache
def of_the_first() -> rsicalib.Trace:
    """The trace of a session whose first placement alone has an error."""
    return rsicalib.trace(session(3, 0.01, only_first=True)[0], between.mechanism())


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


def test_placements_in_another_order_change_nothing() -> None:
    """The halves that are left out, and the poses at which an error is predicted, are found by the
    readings: every order of the same rows gives the same figures, to rounding."""
    table, _ = session(3, 0.01, only_first=True)
    found = [of_the_first()]
    for order in ([3, 0, 2, 1], *sized((), ([0, 2, 1, 3], [3, 0, 1, 2]))):
        rows = [row for k in order for row in range(k * between.POSES, (k + 1) * between.POSES)]
        moved = {name: [column[row] for row in rows] for name, column in table.items()}  # type: ignore[index]
        found.append(rsicalib.trace(moved, between.mechanism()))
    figures = []
    for one in found:
        assert one.elsewhere is not None and one.predicted is not None
        assert one.elsewhere.again is not None
        figures.append(
            [one.elsewhere.without, one.elsewhere.again, one.predicted.position_sd]
            + [p.value for p in one.parameters if p.term == "offset"]
        )
    np.testing.assert_allclose(figures[1:], figures[:1] * (len(found) - 1), rtol=1e-5)
    told = [[(s.term, s.target, s.applied) for s in one.steps] for one in found]
    assert told[0] and all(one == told[0] for one in told)


def test_without_effects_nothing_is_left_out() -> None:
    table, _ = session(2, 0.0, only_first=False)
    assert rsicalib.trace(table, between.mechanism()).elsewhere is None


def test_what_does_not_help_elsewhere_is_named_and_no_part_of_the_parameters() -> None:
    table, _ = session(3, 0.01, only_first=True)
    found = of_the_first()
    named = [step for step in found.steps if not step.applied]
    assert named, "an effect of one placement in four does not hold in the others"
    keys = {(p.term, p.target) for p in found.parameters}
    assert all((step.term, step.target) not in keys for step in named)
    assert "not applied" in found.summary(whole=True)
    # What it does to the ball, after the best motion of everything: a certificate counts it.
    sizes = [step.platform_rms.position for step in found.steps if step.platform_rms]
    assert len(sizes) == len(found.steps) and all(size and size > 0 for size in sizes)
    assert all(step.platform_rms and step.platform_rms.orientation is None for step in found.steps)
    certificate = rsicalib.certify(found, between.mechanism(), limit=1e3)
    known = certificate.known
    assert certificate.conditions[0].startswith("Places of ball, as the chains carry it: 200 ")
    own = [s.platform_rms.position for s in named if s.platform_rms and s.platform_rms.position]
    assert [one.source for one in known] == ["effects not applied"]
    assert known[0].error == pytest.approx(np.sqrt(3) * np.linalg.norm(own))
    (one,) = found.steps
    out = {left.pose for left in found.excluded}
    used = [k for k in range(len(table["at"])) if k + 1 not in out]
    kept = {name: [column[k] for k in used] for name, column in table.items()}
    moved = []
    for more in ([], [f"{one.term}@{one.target}"]):
        fit = rsicalib.calibrate(kept, between.mechanism(), terms=[*cone_terms(), *more])
        assert not fit.excluded
        points = np.asarray(rsicalib.forward(kept, between.mechanism(), fit)).reshape(-1, 3)
        moved.append(points - points.mean(axis=0))
    turned, _ = Rotation.align_vectors(moved[1], moved[0])
    rms = np.sqrt(np.mean((turned.apply(moved[0]) - moved[1]) ** 2))
    # Fits end where a step lowers the cost by 1e-5 or less.
    assert sizes == [pytest.approx(rms, rel=1e-4)]
    every = rsicalib.trace(table, between.mechanism(), apply_all=True)
    assert all(step.applied for step in every.steps)
    assert {(s.term, s.target) for s in every.steps} <= {
        (p.term, p.target) for p in every.parameters
    }


@pytest.mark.parametrize("seed", sized([1], [1, 2]))
def test_of_a_single_placement_a_shape_without_a_law_is_named_alone(seed: int) -> None:
    whole, _ = session(seed, 0.0, only_first=False)
    table = {name: column[: between.POSES] for name, column in whole.items()}  # type: ignore[index]
    q3 = np.array(table["q3"])
    table["q3"] = q3 + 0.004 * np.abs(np.sin(5 * q3))
    found = rsicalib.trace(table, between.mechanism())
    assert [(s.term, s.target, s.applied) for s in found.steps] == [("free_curve", "q3", False)]
    assert "free_curve" not in {p.term for p in found.parameters}
    assert found.elsewhere is not None and found.elsewhere.again is None


def test_a_free_curve_stays_at_its_edge_and_is_known_less_the_further_it_is() -> None:
    table, _ = session(1, 0.004, only_first=False)
    terms = [*cone_terms(), "free_curve@q3"]
    found = rsicalib.calibrate(table, between.mechanism(), terms=terms)
    q = np.tile([0.4, -1.4, 0.0, -1.5, 1.5, 0.0], (4, 1))
    q3 = np.array(table["q3"], dtype=float)
    beyond = np.array([-0.1, 0.0, 0.2, 0.4])
    q[:, 2] = q3.max() + beyond
    rows = dict(zip(CHANNELS, q.T, strict=True))
    opened = rsicalib.load_mechanism(between.mechanism())
    readings = readings_for(rows, opened, False)
    found_at = places(readings, opened, found)
    names = [(p.term, p.target if p.term == "offset" else p.name) for p in found.parameters]
    value = np.array([p.value for p in found.parameters], dtype=float)

    def tips(value: Array, s: Array) -> Array:
        """Places of the ball where the parameters have these values, the curve read at `s`."""
        turned, ball = q.copy(), between.BALL.copy()
        for (term, name), x in zip(names, value, strict=True):
            if term == "offset":
                turned[:, CHANNELS.index(name)] += x
            elif term == "point_position":
                ball["xyz".index(name[-1])] += x
            elif term == "free_curve":
                turned[:, 2] += x * np.cos(int(name[1:]) * np.pi * s)
        return between.tips(turned, ball)

    along = 1.0 + beyond / (q3.max() - q3.min())
    edge = np.minimum(along, 1.0)
    held, on = tips(value, edge), tips(value, along)
    np.testing.assert_allclose(found_at.values, held, atol=1e-6)
    assert found_at.beyond == (False, False, True, True)
    # What is not known: the parameters, and what the curve would change by going on.
    step = 1e-6
    slopes = np.stack(
        [(tips(value + step * e, edge) - tips(value - step * e, edge)) for e in np.eye(len(value))],
        axis=-1,
    ) / (2 * step)
    # At another placement: by the covariance of means over placements, and by what changes.
    assert found.between is not None
    changing = {(p.term, p.target, p.name): p.sd for p in found.between.parameters}
    shifts = [changing.get((p.term, p.target, p.name), 0.0) for p in found.parameters]
    covariance = np.array(found.between.covariance, dtype=float) + np.diag(np.square(shifts))
    variance = np.einsum("nik,kl,nil->ni", slopes, covariance, slopes) + (on - held) ** 2
    assert found_at.sd is not None
    # Both are differences: theirs of a hundredth of a standard deviation.
    np.testing.assert_allclose(found_at.sd, np.sqrt(variance), rtol=1e-4)
    # A certificate of the farthest place has it as a source.
    budgets = {}
    for row in (0, 3):
        place = {name: column[row : row + 1] for name, column in rows.items()}
        told = rsicalib.certify(found, between.mechanism(), limit=1e3, at=place).uncertainty
        assert told is not None
        budgets[row] = {one.source: one.u for one in told.budget if one.effect is None}
    assert "held shapes" not in budgets[0]
    assert budgets[3]["held shapes"] == pytest.approx(np.linalg.norm((on - held)[3]), rel=1e-6)


CHANNELS = [f"q{k + 1}" for k in range(6)]


def cone_terms() -> list[str]:
    """The terms of the mechanism."""
    return [term.strip('" ') for term in between.TERMS.strip("[]").split(",")]


def slipped(seed: int, in_turn: bool, by: float = 8e-4) -> dict[str, object]:
    """Two placements of an arm whose joint 4 has slipped, after 24 of 60 seatings [rad]."""
    rng = np.random.default_rng(seed)
    read = np.concatenate([between.placement(rng, TRUE) for _ in range(2)])
    at = np.repeat(["a", "b"], between.POSES)
    if in_turn:
        order = np.arange(60).reshape(2, 30).T.ravel()
        read, at = read[order], at[order]
    read[24:, 3] += by
    return {**{f"q{k + 1}": column for k, column in enumerate(read.T)}, "at": at.tolist()}


@pytest.mark.parametrize("seed", sized([1], [1, 2]))
def test_a_slip_is_found_across_places_that_are_touched_in_turn(seed: int) -> None:
    found = rsicalib.trace(slipped(seed, in_turn=True), between.mechanism())
    assert [(s.term, s.target) for s in found.steps] == [("slip", "q4")]
    assert abs(int(found.steps[0].place or 0) - 25) <= 1
    assert "not looked for" not in found.unexplained.text


def test_it_is_said_that_a_slip_was_not_looked_for_among_places_in_one_piece_each() -> None:
    """Such a file may be sorted by names: in which order it was recorded nobody knows."""
    found = rsicalib.trace(slipped(1, in_turn=False, by=sized(0.006, 0.02)), between.mechanism())
    assert "not looked for" in found.unexplained.text and "time_s" in found.unexplained.text
    assert "slip" not in {step.term for step in found.steps}
