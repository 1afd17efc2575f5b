"""Closed kinematic chains in plain 4x4 matrix products: a witness sharing no code with the core.

A mechanism is plain data, the dictionary that `tomllib` makes of a mechanism file: `channel`,
`chain` (each with `dh` rows), `point`, `closure`, and optionally `platform` and `rest`. Angles are
in radians, lengths in the mechanism's own unit, readings in counts. Arrays have one row per sample.

Everything here is analytic in its inputs, so derivatives are complex steps, exact to rounding.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import lru_cache
from itertools import combinations, pairwise
from typing import Any

import numpy as np
from numpy.typing import NDArray

Array = NDArray[Any]
Mechanism = dict[str, Any]

PLANE = {"x": (1, 2), "y": (2, 0), "z": (0, 1)}
"""The two axes that a rotation about the third one turns."""

IDENTITY = np.eye(4)

STEP = 1e-30
"""Length of the complex step: its square vanishes beside anything."""


# ------------------------------------------------------------------ transformations


def rotation(axis: str, angle: Array | float) -> Array:
    """Rotation about the axis `"x"`, `"y"` or `"z"` by angles of shape (...): shape (..., 4, 4)."""
    if isinstance(angle, float | int):
        return _turn(axis, angle)
    angle = np.asarray(angle)
    cos, sin = np.cos(angle), np.sin(angle)
    first, second = PLANE[axis]
    out = np.empty((*angle.shape, 4, 4), dtype=cos.dtype)
    out[...] = IDENTITY
    out[..., first, first] = out[..., second, second] = cos
    out[..., first, second] = -sin
    out[..., second, first] = sin
    return out


def translation(x: Array | float = 0.0, y: Array | float = 0.0, z: Array | float = 0.0) -> Array:
    """Translation by `(x, y, z)`, each of shape (...): shape (..., 4, 4)."""
    if isinstance(x, float | int) and isinstance(y, float | int) and isinstance(z, float | int):
        return _shift(x, y, z)
    out = np.empty((*np.broadcast(x, y, z).shape, 4, 4), dtype=np.result_type(x, y, z, float))
    out[...] = IDENTITY
    out[..., 0, 3], out[..., 1, 3], out[..., 2, 3] = x, y, z
    return out


# Mechanisms are made of the same numbers again and again; what these return cannot be written to.


@lru_cache(maxsize=4096)
def _turn(axis: str, angle: float) -> Array:
    return _kept(rotation(axis, np.asarray(angle, dtype=float)))


@lru_cache(maxsize=4096)
def _shift(x: float, y: float, z: float) -> Array:
    return _kept(translation(np.asarray(x, dtype=float), y, z))


@lru_cache(maxsize=4096)
def _link(d: float, a: float, alpha: float) -> Array:
    return _kept(translation(a, 0.0, d) @ rotation("x", alpha))


def _kept(matrix: Array) -> Array:
    matrix.flags.writeable = False
    return matrix


def dh(theta: Array | float, d: Array | float, a: Array | float, alpha: Array | float) -> Array:
    """One Denavit-Hartenberg row, `Rz(theta) Tz(d) Tx(a) Rx(alpha)`: shape (..., 4, 4)."""
    if isinstance(d, float | int) and isinstance(a, float | int) and isinstance(alpha, float | int):
        return rotation("z", theta) @ _link(d, a, alpha)
    return rotation("z", theta) @ translation(z=d) @ translation(x=a) @ rotation("x", alpha)


def roll_pitch_yaw(rx: Array | float, ry: Array | float, rz: Array | float) -> Array:
    """`Rz(rz) Ry(ry) Rx(rx)`, eq. (1): shape (..., 4, 4)."""
    return rotation("z", rz) @ rotation("y", ry) @ rotation("x", rx)


def crossed(a: Array, b: Array) -> Array:
    """The cross product of the last axes, of three: written out, as numpy's own takes long."""
    x, y, z = a[..., 0], a[..., 1], a[..., 2]
    u, v, w = b[..., 0], b[..., 1], b[..., 2]
    return np.stack([y * w - z * v, z * u - x * w, x * v - y * u], axis=-1)


# ------------------------------------------------------------------ any mechanism


def channel_names(mechanism: Mechanism) -> list[str]:
    """The channels in the order of the columns of every array of readings."""
    return [channel["name"] for channel in mechanism["channel"]]


def nominal(mechanism: Mechanism) -> tuple[Array, Array]:
    """Nominal offsets [rad] and gains [rad/count], each of shape (channels,)."""
    offsets = np.array([channel["offset"] for channel in mechanism["channel"]])
    gains = np.array([channel["gain"] for channel in mechanism["channel"]])
    return offsets, gains


def chain_end(mechanism: Mechanism, chain: str, angles: Array) -> Array:
    """`base_from_end` of one chain for angles of shape (n, channels): shape (n, 4, 4)."""
    names = channel_names(mechanism)
    rows = next(c["dh"] for c in mechanism["chain"] if c["name"] == chain)
    out: Array = np.broadcast_to(IDENTITY, (len(angles), 4, 4))
    for row in rows:
        theta = row.get("theta", 0.0)
        if "channel" in row:
            theta = theta + angles[:, names.index(row["channel"])]
        out = out @ rotation("z", theta)
        # One product for all frames: the rest of a row is the same behind each of them.
        link = dh(0.0, row.get("d", 0.0), row.get("a", 0.0), row.get("alpha", 0.0))
        out = (out.reshape(-1, 4) @ link).reshape(out.shape)
    return out


def point(mechanism: Mechanism, name: str, angles: Array) -> Array:
    """A point in the base frame: shape (n, 3)."""
    entry = next(p for p in mechanism["point"] if p["name"] == name)
    at = np.append(np.asarray(entry["at"], dtype=float), 1.0)
    if "chain" not in entry:
        return np.broadcast_to(at[:3], (len(angles), 3))
    # From the point to the base: a product with a vector for each row, none of two matrices.
    names = channel_names(mechanism)
    out: Array = np.broadcast_to(at, (len(angles), 4))
    for row in reversed(next(c["dh"] for c in mechanism["chain"] if c["name"] == entry["chain"])):
        link = dh(0.0, row.get("d", 0.0), row.get("a", 0.0), row.get("alpha", 0.0))
        theta = row.get("theta", 0.0)
        if "channel" in row:
            theta = theta + angles[:, names.index(row["channel"])]
        x, y, z, one = (out @ link.T).T
        cos, sin = np.cos(theta), np.sin(theta)
        out = np.stack([cos * x - sin * y, sin * x + cos * y, z, one], axis=-1)
    return out[:, :3]


def points(mechanism: Mechanism, angles: Array) -> Array:
    """All points in the order of the mechanism: shape (n, points, 3)."""
    return np.stack([point(mechanism, p["name"], angles) for p in mechanism["point"]], axis=1)


def misclosure_of_angles(mechanism: Mechanism, angles: Array) -> Array:
    """`|r_a - r_b|² - d²` for every distance closure, eq. (10): shape (n, closures)."""
    columns = []
    ends = {name for closure in mechanism["closure"] for name in closure.get("between", ())}
    at = {name: point(mechanism, name, angles) for name in ends}
    for closure in mechanism["closure"]:
        if closure["kind"] != "distance":
            raise ValueError(f"the oracle knows distances only, not {closure['kind']!r}")
        first, second = (at[name] for name in closure["between"])
        columns.append(np.sum((first - second) ** 2, axis=1) - closure["value"] ** 2)
    return np.stack(columns, axis=1)


def angles_of(offsets: Array, gains: Array, counts: Array) -> Array:
    """`θ = k a + θ_off`, eq. (9), row by row: shape (n, channels)."""
    return np.asarray(counts) * gains + offsets


def misclosure(mechanism: Mechanism, offsets: Array, gains: Array, counts: Array) -> Array:
    """Misclosure of readings of shape (n, channels): shape (n, closures)."""
    return misclosure_of_angles(mechanism, angles_of(offsets, gains, counts))


# ------------------------------------------------------------------ derivatives


def complex_step(function: Callable[[Array], Array], x: Array) -> Array:
    """Derivative of `function` by each element of the vector `x`: shape (*f.shape, len(x))."""
    x = np.asarray(x, dtype=float)
    columns = []
    for i in range(len(x)):
        shifted = x.astype(complex)
        shifted[i] += 1j * STEP
        columns.append(function(shifted).imag / STEP)
    return np.stack(columns, axis=-1)


def row_derivative(function: Callable[[Array], Array], x: Array) -> Array:
    """Derivative of a row-wise `function` (n, m) -> (n, K) by its own row: shape (n, K, m)."""
    x = np.asarray(x, dtype=float)
    columns = []
    for i in range(x.shape[1]):
        shifted = x.astype(complex)
        shifted[:, i] += 1j * STEP
        columns.append(function(shifted).imag / STEP)
    return np.stack(columns, axis=-1)


def richardson(function: Callable[[Array], Array], x: Array, step: float = 1e-2) -> Array:
    """Central differences extrapolated three times, for functions that are not analytic code.

    Good to about 1e-11 of the size of `function` where it is smooth over a few `step`.
    Shape (*f.shape, len(x)).
    """
    x = np.asarray(x, dtype=float)
    columns = []
    for i in range(len(x)):
        table: list[Array] = []
        for level in range(4):
            h = np.zeros_like(x)
            h[i] = step / 2**level
            table.append((function(x + h) - function(x - h)) / (2 * h[i]))
        for order in range(1, 4):
            table = [
                (4**order * fine - coarse) / (4**order - 1) for coarse, fine in pairwise(table)
            ]
        columns.append(table[0])
    return np.stack(columns, axis=-1)


def jacobians(
    mechanism: Mechanism, offsets: Array, gains: Array, counts: Array
) -> tuple[Array, Array, Array]:
    """Derivatives of the misclosure by offsets, gains and readings, each (n, closures, channels).

    Row `p` of the last is `A_p = ∂f_p/∂a_p`.
    """
    by_angle = row_derivative(
        lambda angles: misclosure_of_angles(mechanism, angles), angles_of(offsets, gains, counts)
    )
    return by_angle, by_angle * np.asarray(counts)[:, None, :], by_angle * np.asarray(gains)


# ------------------------------------------------------------------ the hand controller

L1, L2, L3, L4 = -4.5, 3.2, 3.971, 1.5
BASE_ANGLES = (np.pi, np.pi / 3, -np.pi / 3)
GAIN = -np.deg2rad(340.0) / 4096.0
REST = (0.0, 0.0, -2.666, 0.0, 0.0, 0.0)
REST_COUNT = 2048


def rsi() -> Mechanism:
    """The hand controller in plain numbers: inches, radians, counts."""
    half = np.pi / 2
    limits = [[-half, half], [-np.pi, 0.0], [-half, half]]
    offsets = rsi_inverse(np.array([REST]))[0, 0] - GAIN * REST_COUNT
    channels, chains, ends = [], [], []
    for i, base in enumerate(BASE_ANGLES, start=1):
        channels += [
            {
                "name": f"a{i}{j + 1}",
                "unit": "count",
                "range": [0, 4095],
                "gain": GAIN,
                "offset": float(offsets[j]),
                "limits": limits[j],
            }
            for j in range(3)
        ]
        rows = [
            {"theta": base, "a": L1, "alpha": half},
            {"channel": f"a{i}1", "a": L2},
            {"channel": f"a{i}2", "alpha": half},
            {"channel": f"a{i}3"},
        ]
        chains.append({"name": f"arm{i}", "dh": rows})
        ends.append({"name": f"wrist{i}", "chain": f"arm{i}", "at": [L3, 0.0, 0.0]})
    return {
        "name": "RSI 6-DOF hand controller",
        "length_unit": "in",
        "gravity": [0, 0, -1],
        "channel": channels,
        "chain": chains,
        "point": ends,
        "closure": [
            {
                "name": f"wrist{a}-wrist{b}",
                "kind": "distance",
                "between": [f"wrist{a}", f"wrist{b}"],
                "value": L4 * np.sqrt(3.0),
            }
            for a, b in ((1, 2), (2, 3), (1, 3))
        ],
        "platform": {f"wrist{i + 1}": list(p) for i, p in enumerate(platform())},
        "rest": {"pose": list(REST)},
        "model": {"terms": ["offset", "gain"]},
    }


def platform() -> Array:
    """Wrists in the handle's frame, numbered clockwise seen from above: shape (3, 3)."""
    around = np.array([0.0, -2.0, 2.0]) * np.pi / 3
    out: Array = L4 * np.stack([np.cos(around), np.sin(around), np.zeros(3)], axis=1)
    return out


def handle_from_pose(pose: Array) -> Array:
    """`base_from_handle` for poses `(x, y, z, rx, ry, rz)` of shape (n, 6): shape (n, 4, 4)."""
    x, y, z, rx, ry, rz = np.moveaxis(np.asarray(pose), -1, 0)
    return translation(x, y, z) @ roll_pitch_yaw(rx, ry, rz)


def rsi_wrists(pose: Array, wrists: Array | None = None) -> Array:
    """Wrists in the base frame for poses of shape (n, 6): shape (n, 3, 3)."""
    wrists = platform() if wrists is None else wrists
    frame = handle_from_pose(pose)
    out: Array = np.einsum("nij,wj->nwi", frame[:, :3, :3], wrists) + frame[:, None, :3, 3]
    return out


def rsi_inverse(pose: Array) -> Array:
    """Joint angles for poses of shape (n, 6): shape (n, 3 arms, 3 joints), NaN out of reach.

    Not by the paper's arccosines: the forearm's part in the plane of upper arm and column is
    `√(l3² - z²)`, and the elbow is where two circles in that plane meet.
    """
    wrists = rsi_wrists(np.asarray(pose, dtype=float))
    out = np.empty((len(wrists), 3, 3))
    for i, base in enumerate(BASE_ANGLES):
        shoulder_from_base = np.linalg.inv(dh(base, 0.0, L1, np.pi / 2))
        x, y, z = (wrists[:, i] @ shoulder_from_base[:3, :3].T + shoulder_from_base[:3, 3]).T
        with np.errstate(invalid="ignore"):
            forearm = np.sqrt(L3**2 - z**2)
            reach = np.hypot(x, y)
            along = (L2**2 - forearm**2 + reach**2) / (2 * reach)
            aside = np.sqrt(L2**2 - along**2)
        elbow_x = (along * x - aside * y) / reach
        elbow_y = (along * y + aside * x) / reach
        shoulder = np.arctan2(elbow_y, elbow_x)
        bend = np.arctan2(y - elbow_y, x - elbow_x) - shoulder
        bend = np.where(bend > 0, bend - 2 * np.pi, bend)
        bend = np.where(bend <= -2 * np.pi, bend + 2 * np.pi, bend)
        out[:, i] = np.stack([shoulder, bend, np.arctan2(z, forearm)], axis=1)
    return out


def rsi_pose(wrists: Array) -> Array:
    """Handle poses, eqs. (3) to (5), of wrists of shape (n, 3, 3): shape (n, 6)."""
    centre = wrists.mean(axis=1)
    x_axis = (wrists[:, 0] - centre) / L4
    y_axis = (wrists[:, 2] - wrists[:, 1]) / (L4 * np.sqrt(3.0))
    z_axis = np.cross(x_axis, y_axis)
    rz = np.arctan2(x_axis[:, 1], x_axis[:, 0])
    ry = np.arctan2(-x_axis[:, 2], x_axis[:, 0] * np.cos(rz) + x_axis[:, 1] * np.sin(rz))
    rx = np.arctan2(y_axis[:, 2], z_axis[:, 2])
    return np.column_stack([centre, rx, ry, rz])


def rigid_pose(wrists: Array, body: Array | None = None) -> Array:
    """Pose of the best rigid fit (Kabsch) of `body` to points of shape (n, w, 3): shape (n, 6)."""
    body = platform() if body is None else body
    centre, body_centre = wrists.mean(axis=1), body.mean(axis=0)
    cross = np.einsum("nwi,wj->nij", wrists - centre[:, None], body - body_centre)
    u, _, vt = np.linalg.svd(cross)
    flip = np.repeat(np.eye(3)[None], len(wrists), axis=0)
    flip[:, 2, 2] = np.linalg.det(u @ vt)
    turn = u @ flip @ vt
    shift = centre - turn @ body_centre
    rz = np.arctan2(turn[:, 1, 0], turn[:, 0, 0])
    ry = np.arctan2(-turn[:, 2, 0], np.hypot(turn[:, 0, 0], turn[:, 1, 0]))
    rx = np.arctan2(turn[:, 2, 1], turn[:, 2, 2])
    return np.column_stack([shift, rx, ry, rz])


# ------------------------------------------------------------------ random mechanisms


def random_mechanism(rng: np.random.Generator, chains: int = 3) -> Mechanism:
    """A mechanism of `chains` chains of 2 or 3 sensed joints, all ends at known distances.

    The distances are those of one random configuration, at which every channel reads near the
    middle of its range: so the mechanism can be assembled.
    """
    channels, rows, ends = [], [], []
    for i in range(1, chains + 1):
        joints = int(rng.integers(2, 4))
        base = {"theta": rng.uniform(-3, 3), "d": rng.uniform(-0.5, 0.5)}
        arm: list[dict[str, Any]] = [
            base | {"a": rng.uniform(1, 3), "alpha": rng.uniform(-1.5, 1.5)}
        ]
        for j in range(1, joints + 1):
            name = f"q{i}{j}"
            row = {"a": rng.uniform(0.5, 2), "alpha": rng.uniform(-1.5, 1.5)}
            arm.append({"channel": name, "d": rng.uniform(-0.3, 0.3)} | row)
            gain = GAIN * rng.choice([-1.0, 1.0])
            channels.append(
                {
                    "name": name,
                    "unit": "count",
                    "range": [0, 4095],
                    "gain": float(gain),
                    "offset": float(rng.uniform(-2, 2) - 2048 * gain),
                }
            )
        rows.append({"name": f"chain{i}", "dh": arm})
        ends.append({"name": f"end{i}", "chain": f"chain{i}", "at": list(rng.uniform(-1, 1, 3))})
    mechanism: Mechanism = {
        "name": f"random, {chains} chains",
        "length_unit": "m",
        "channel": channels,
        "chain": rows,
        "point": ends,
        "closure": [],
    }
    at = points(mechanism, angles_of(*nominal(mechanism), np.full((1, len(channels)), 2048.0)))[0]
    for a, b in combinations(range(chains), 2):
        names = [str(ends[a]["name"]), str(ends[b]["name"])]
        value = float(np.linalg.norm(at[a] - at[b]))
        mechanism["closure"].append(
            {"name": "-".join(names), "kind": "distance", "between": names, "value": value}
        )
    return mechanism


def close_loop(mechanism: Mechanism, angles: Array, iterations: int = 30) -> Array:
    """The assembled configurations near `angles`: Newton's method with the shortest step.

    Rows that do not converge come back as NaN. Shape (n, channels).
    """
    for _ in range(iterations):
        f = misclosure_of_angles(mechanism, angles)
        slope = row_derivative(lambda at: misclosure_of_angles(mechanism, at), angles)
        step = (np.linalg.pinv(slope, rcond=1e-9) @ f[..., None])[..., 0]
        longest = np.abs(step).max(axis=1, keepdims=True)
        angles = angles - step * 0.5 / np.maximum(longest, 0.5)
    closed = np.abs(misclosure_of_angles(mechanism, angles)).max(axis=1) < 1e-12
    return np.where(closed[:, None], angles, np.nan)


def assembled_counts(
    mechanism: Mechanism, n: int, rng: np.random.Generator, spread: float = 0.8
) -> tuple[Array, Array, Array]:
    """True offsets, true gains, and `n` noise-free readings that close the loop to 1e-12.

    Offsets differ from nominal by 0.03 rad, gains by 2 %; the joints start within `spread` rad of
    the middle of their range. Counts are real numbers within the range, shape (n, channels).
    """
    offsets, gains = nominal(mechanism)
    middle = angles_of(offsets, gains, np.full((1, len(gains)), 2048.0))
    gains = gains * (1 + 0.02 * rng.standard_normal(len(gains)))
    offsets = middle[0] - 2048.0 * gains + 0.03 * rng.standard_normal(len(gains))
    kept: list[Array] = []
    for _ in range(50):
        start = middle + rng.uniform(-spread, spread, (2 * n, len(gains)))
        counts = (close_loop(mechanism, start) - offsets) / gains
        kept += list(counts[np.all((counts > 0) & (counts < 4095), axis=1)])
        if len(kept) >= n:
            return offsets, gains, np.array(kept[:n])
    raise RuntimeError(f"only {len(kept)} of {n} configurations could be assembled")
