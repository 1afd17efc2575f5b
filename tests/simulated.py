"""Arms that keep a closure, simulated in plain matrix products: shares nothing with the core."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
from numpy.typing import NDArray

from tests import oracle

Array = NDArray[Any]


def joint_limits(mechanism: dict[str, Any]) -> tuple[Array, Array]:
    """Lowest and highest joint coordinates."""
    limits = np.array([c.get("limits", [-np.pi, np.pi]) for c in mechanism["channel"]])
    return limits[:, 0], limits[:, 1]


def derivative(misclosure: Callable[[Array], Array], angles: Array) -> Array:
    """Derivative by complex steps, shape (n, equations, channels): all steps in one call."""
    n, channels = angles.shape
    moved = angles + 1j * oracle.STEP * np.eye(channels)[:, None]
    f = misclosure(moved.reshape(-1, channels)).imag.reshape(channels, n, -1)
    out: Array = np.moveaxis(f / oracle.STEP, 0, -1)
    return out


def closed(
    mechanism: dict[str, Any],
    misclosure: Callable[[Array], Array],
    n: int,
    rng: np.random.Generator,
) -> Array:
    """Joint coordinates, shape (n, channels), within limits, at which the misclosure vanishes."""
    low, high = joint_limits(mechanism)
    kept: list[Array] = []
    for _ in range(100):
        angles = rng.uniform(low, high, (2 * n, len(low)))
        for _ in range(40):
            f = misclosure(angles)
            open_ = np.abs(f).max(axis=1) > 1e-10
            if not open_.any():
                break
            slope = derivative(misclosure, angles[open_])
            step = (np.linalg.pinv(slope, rcond=1e-9) @ f[open_, :, None])[..., 0]
            longest = np.abs(step).max(axis=1, keepdims=True)
            angles[open_] -= step * 0.3 / np.maximum(longest, 0.3)
        good = np.abs(misclosure(angles)).max(axis=1) < 1e-7
        good &= np.all((angles > low) & (angles < high), axis=1)
        kept += list(angles[good])
        if len(kept) >= n:
            return np.array(kept[:n])
    raise RuntimeError(f"only {len(kept)} of {n} configurations close")


def read(
    mechanism: dict[str, Any], angles: Array, offsets: Array, rng: np.random.Generator
) -> Array:
    """Readings of joint coordinates, `angle = gain reading + offset`, with their noise."""
    gains = np.array([c["gain"] for c in mechanism["channel"]])
    noise = np.array([c.get("noise", 1e-5) for c in mechanism["channel"]])
    out: Array = (angles - offsets) / gains + noise * rng.standard_normal(angles.shape)
    return out
