"""How visible an effect is: the noncentrality of its mean in the misclosure, and sizes to order."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from tests import oracle
from tests.blind.effects.base import Effect
from tests.blind.simulator import Device, Session
from tests.oracle import Array

QUANTISATION = 1.0 / 12.0
"""Variance of rounding [count²]."""


def whitener(device: Device, counts: Array, sigma: float) -> Array:
    """`L⁻¹` of `A Σ Aᵀ = L Lᵀ` for every row, at a sigma that excludes quantisation: (n, 3, 3)."""
    by_reading = oracle.jacobians(oracle.rsi(), device.offsets, device.gains, counts)[2]
    return whitener_of(by_reading, sigma)


def whitener_of(slope: Array, sigma: float) -> Array:
    """The same from `A` of shape (n, 3, 9)."""
    cover = (sigma**2 + QUANTISATION) * slope @ np.swapaxes(slope, 1, 2)
    return np.linalg.inv(np.linalg.cholesky(cover))


def mean_misclosure(device: Device, scene_counts: Array) -> Array:
    """Misclosure of noise-free readings under the paper's model at the truth: (n, 3)."""
    return oracle.misclosure(oracle.rsi(), device.offsets, device.gains, scene_counts)


def noncentrality(
    device: Device, session: Session, effect: Effect, others: Sequence[Effect] = ()
) -> float:
    """Squared length of the effect's whitened mean, off offsets, gains and the sizes of `others`.

    The chi-square of lack of fit grows by this much if the effect is not in the model.
    """
    scene = session["scene"]
    clean = device.ideal(scene, others)
    readings = device.ideal(scene, (*others, effect))
    base = mean_misclosure(device, clean)
    by_offset, by_gain, by_reading = oracle.jacobians(
        oracle.rsi(), device.offsets, device.gains, readings
    )
    white = whitener_of(by_reading, session["sigma"])
    columns = [white @ by_offset, white @ (by_gain - 2048.0 * by_offset)]
    for other in others:
        rest = [o for o in others if o is not other]
        step = 1e-3 * other.size if other.size else other.sizes[0] * 1e-3
        more = device.ideal(scene, (*rest, other.resized(other.size + step)))
        change = (mean_misclosure(device, more) - base) / step
        columns.append(np.einsum("nij,nj->ni", white, change)[..., None])
    matrix = np.concatenate([c.reshape(-1, c.shape[-1]) for c in columns], axis=1)
    matrix = matrix / np.maximum(np.linalg.norm(matrix, axis=0), 1e-300)
    mean = np.einsum("nij,nj->ni", white, mean_misclosure(device, readings) - base).ravel()
    ortho, upper = np.linalg.qr(matrix)
    left = mean - matrix @ np.linalg.lstsq(upper, ortho.T @ mean, rcond=1e-12)[0]
    return float(left @ left)


def scaled_to(
    device: Device, session: Session, effect: Effect, wanted: float, others: Sequence[Effect] = ()
) -> Effect:
    """The effect at the size whose noncentrality is `wanted`, to a per cent where it is smooth.

    Raises `ValueError` for an effect that these readings cannot show at all.
    """
    for _ in range(4):
        now = noncentrality(device, session, effect, others)
        if now < 1e-6:
            raise ValueError(f"{effect.term} at {effect.target} does not show in these readings")
        if abs(now / wanted - 1) < 0.01:
            break
        effect = effect.resized(effect.size * np.sqrt(wanted / now))
    return effect
