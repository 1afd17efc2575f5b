"""How near to its drawing an arm is, estimated: beside the likelihood in plain matrices."""

from __future__ import annotations

import numpy as np
import pytest

import rsicalib
from tests import drawings
from tests.full import sized
from tests.oracle import Array

SIZES = {"offset": drawings.OFFSET, "point_position": drawings.TOOL}


def geometry(found: rsicalib.Calibration) -> tuple[Array, Array]:
    """Values in typical sizes, and their covariance."""
    sizes = []
    for p in found.parameters:
        if p.term == "link_frame":
            sizes.append(drawings.TURN if p.name.startswith("r") else drawings.LENGTH)
        elif p.term in SIZES:
            # The first offset turns arm and sockets together, as a frame.
            sizes.append(drawings.TURN if p.target == "q1" else SIZES[p.term])
    by, n = np.array(sizes), len(sizes)
    covariance = np.array(found.covariance, dtype=float)[:n, :n] / np.outer(by, by)
    return np.array([p.value for p in found.parameters[:n]], dtype=float) / by, covariance


def likeliest(found: rsicalib.Calibration) -> float:
    """Size of the errors over the root of the noise, by the restricted likelihood: everything else
    is in the covariance already, and the priors are taken out of it."""
    b, covariance = geometry(found)
    told = np.linalg.inv(covariance) - np.eye(len(b))
    c, turned = np.linalg.eigh((told + told.T) / 2)
    w = turned.T @ (told @ b + b)
    kept = c > 1e-9 * c.max()
    c, w = c[kept], w[kept]
    # χ² as drawn, from that of the fit: its slope there is that of the priors.
    chi2 = found.fit.chi2 + b @ told @ b + 2 * b @ b
    dof = found.fit.dof + np.sum(c / (c + 1))

    def cost(size: float) -> float:
        left = chi2 - np.sum(size**2 * w**2 / (1 + size**2 * c))
        noise = max(left / dof, 1.0)
        return float(dof * np.log(noise) + left / noise + np.log1p(size**2 * c).sum())

    tried = np.exp(np.linspace(np.log(1e-3), 0, 600))
    return float(tried[np.argmin([cost(size) for size in tried])])


@pytest.mark.parametrize(("seed", "size"), [(1, 0.1), (2, 0.3)])
def test_the_size_of_errors_is_the_likeliest_and_parameters_follow(seed: int, size: float) -> None:
    rng = np.random.default_rng(seed)
    table = drawings.session(drawings.Arm.drawn(rng, size), rng, 1)
    own = drawings.mechanism()
    typical = rsicalib.calibrate(table, own, population=drawings.as_typical(own))
    found = rsicalib.calibrate(table, own)
    # So many times as much noise beside typical sizes is as much noise beside smaller ones.
    times = 1 / likeliest(typical)
    louder = drawings.mechanism(times * drawings.PLAY)
    same = rsicalib.calibrate(table, louder, population=drawings.as_typical(louder))
    (b, covariance), (before, as_before) = geometry(found), geometry(typical)
    moved = np.linalg.norm(before - b)
    assert times > 1.5 and moved > 0.1
    # The size that is taken has the interval of one more error: a few per cent larger than the
    # likeliest.
    assert np.linalg.norm(geometry(same)[0] - b) < 0.1 * moved
    # Offsets of the two are about other readings, which costs digits.
    np.testing.assert_allclose(covariance, as_before, atol=1e-8)
    assert found.fit.chi2 == pytest.approx(typical.fit.chi2, rel=1e-6)
    assert found.verdict == typical.verdict


def test_arms_that_are_more_wrong_than_is_typical_are_calibrated_as_before() -> None:
    rng = np.random.default_rng(3)
    table = drawings.session(drawings.Arm.drawn(rng, 3.0), rng, 1)
    own = drawings.mechanism()
    found = rsicalib.calibrate(table, own)
    typical = rsicalib.calibrate(table, own, population=drawings.as_typical(own))
    np.testing.assert_allclose(geometry(found)[0], geometry(typical)[0], atol=1e-6)


def test_predictions_elsewhere_are_no_worse_and_hold() -> None:
    counts = drawings.counted(sized(2, 4), 0.1, seed=5)
    others, held = np.array(counts.others), np.array(counts.held)
    assert np.median(others[:, 0] / others[:, 1]) < 1.0
    assert held[:, 0].mean() > 0.8
