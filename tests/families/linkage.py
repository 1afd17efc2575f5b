"""Closed chains as they were really built: plain products of 4x4 matrices, loops closed by Newton.

A mechanism is the dictionary of a mechanism file. Rows turn or slide, may carry a mass, and may
have any rigid motion after them that no drawing has. Angles in radians, lengths in the mechanism's
unit; arrays have one row per sample, and where they are coordinates any axes before that.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace
from functools import lru_cache
from typing import Any

import numpy as np

from tests import oracle
from tests.oracle import Array, Mechanism

Where = Mapping[str, Array]
"""Positions of unknown points, (n, 3), by the name of the point; measured distances by column."""


@dataclass(frozen=True)
class Build:
    """What was built.

    `after[chain, row]` is a rigid motion behind a row, counted from 0, of a chain (-1: ahead of
    all); `tips[chain]` shifts the points that a chain carries; `longer[closure]` adds to a
    distance; `gives[channel]` is a coordinate per torque of the masses; `bends[chain]` an angle
    per torque of a unit weight at the points.
    """

    mechanism: Mechanism
    after: Mapping[tuple[str, int], Array] = field(default_factory=dict)
    tips: Mapping[str, Array] = field(default_factory=dict)
    longer: Mapping[str, float] = field(default_factory=dict)
    gives: Mapping[str, float] = field(default_factory=dict)
    bends: Mapping[str, float] = field(default_factory=dict)
    swaps: Mapping[str, str] = field(default_factory=dict)
    """A joint that gives under the load of another one: that of `gives` for the key."""

    def with_motion(self, chain: str, row: int, motion: Array) -> Build:
        """One more rigid motion behind a row."""
        before = self.after.get((chain, row), np.eye(4))
        return replace(self, after={**self.after, (chain, row): before @ motion})

    def with_tip(self, chain: str, shift: Array) -> Build:
        """Points that sit elsewhere on the end of a chain."""
        return replace(self, tips={**self.tips, chain: self.tips.get(chain, 0.0) + shift})

    def with_entry(self, name: str, key: str, value: float) -> Build:
        """One more number in one of the maps."""
        old = getattr(self, name)
        changes: dict[str, Any] = {name: {**old, key: old.get(key, 0.0) + value}}
        return replace(self, **changes)

    def motion(self, chain: str, row: int, q: Array) -> Array:
        """The rigid motion behind a row, (4, 4) or one for each row of `q`."""
        return np.asarray(self.after.get((chain, row), oracle.IDENTITY))

    def more(self, closure: str, q: Array) -> Array:
        """What a distance is longer, or one for each row of `q`."""
        return np.asarray(self.longer.get(closure, 0.0))

    @property
    def is_loaded(self) -> bool:
        """Whether anything gives under weight."""
        return bool(self.gives or self.bends)


@dataclass(frozen=True)
class Lever:
    """A sensed joint in the base: its channel, axis and a point on it, (n, 3)."""

    channel: int
    slides: bool
    axis: Array
    origin: Array

    def moves(self, at: Array) -> Array:
        """How a point that it carries moves per unit of its coordinate."""
        if self.slides:
            return np.broadcast_to(self.axis, at.shape)
        return oracle.crossed(self.axis, at - self.origin)


def names(mechanism: Mechanism) -> list[str]:
    """Channels in the order of the columns."""
    return oracle.channel_names(mechanism)


def limits(mechanism: Mechanism) -> tuple[Array, Array]:
    """Lowest and highest joint coordinates."""
    both = np.array([c["limits"] for c in mechanism["channel"]], dtype=float)
    return both[:, 0], both[:, 1]


def slides(mechanism: Mechanism) -> dict[str, bool]:
    """Whether the joint of a channel slides."""
    rows = [row for chain in mechanism["chain"] for row in chain["dh"] if "channel" in row]
    return {row["channel"]: row.get("joint") == "prismatic" for row in rows}


def chain_of(mechanism: Mechanism, channel: str) -> str:
    """The chain that a channel is in."""
    for chain in mechanism["chain"]:
        if any(row.get("channel") == channel for row in chain["dh"]):
            return str(chain["name"])
    raise KeyError(channel)


def body(row: Mapping[str, Any]) -> Array:
    """From the joint of a row to the next."""
    link = (float(row.get(key, 0.0)) for key in ("d", "a", "alpha"))
    xyz, rpy = (tuple(map(float, row.get(key, (0.0, 0.0, 0.0)))) for key in ("xyz", "rpy"))
    return _body(*link, xyz, rpy)


@lru_cache(maxsize=4096)
def _body(
    d: float,
    a: float,
    alpha: float,
    xyz: tuple[float, ...],
    rpy: tuple[float, ...],
) -> Array:
    out = oracle.dh(0.0, d, a, alpha) @ oracle.translation(*xyz) @ oracle.roll_pitch_yaw(*rpy)
    out.flags.writeable = False
    return out


def then(frame: Array, motion: Array) -> Array:
    """`frame @ motion`, as one product where all frames, (n, 4, 4), have the same motion behind."""
    if motion.ndim > 2:
        return np.asarray(frame @ motion)
    return np.asarray((frame.reshape(-1, 4) @ motion).reshape(frame.shape))


def turned(frame: Array, by: Array) -> Array:
    """`frame @ Rz(by)`, without the zeros and ones of the second."""
    cos, sin = np.cos(by)[..., None], np.sin(by)[..., None]
    x, y = frame[..., 0], frame[..., 1]
    out = np.array(frame)
    out[..., 0], out[..., 1] = cos * x + sin * y, cos * y - sin * x
    return out


def slid(frame: Array, by: Array) -> Array:
    """`frame @ Tz(by)`, without the zeros and ones of the second."""
    out = np.array(frame)
    out[..., 3] += by[..., None] * frame[..., 2]
    return out


def posture(
    build: Build, chain: str, q: Array
) -> tuple[Array, list[Lever], list[tuple[int, float, Array]]]:
    """The end of a chain, (…, n, 4, 4), levers, and masses (levers before it, weight, place)."""
    channels = names(build.mechanism)
    rows = next(c["dh"] for c in build.mechanism["chain"] if c["name"] == chain)
    ahead = build.after.get((chain, -1), oracle.IDENTITY)
    frame = np.broadcast_to(ahead, (*q.shape[:-1], 4, 4))
    levers: list[Lever] = []
    masses: list[tuple[int, float, Array]] = []
    for k, row in enumerate(rows):
        if "theta" in row:
            frame = then(frame, oracle.rotation("z", row["theta"]))
        if "channel" in row:
            i = channels.index(row["channel"])
            sliding = row.get("joint") == "prismatic"
            levers.append(Lever(i, sliding, frame[..., :3, 2], frame[..., :3, 3]))
            frame = (slid if sliding else turned)(frame, q[..., i])
        if "mass" in row:
            centre = frame @ np.append(np.array(row.get("com", [0.0, 0.0, 0.0])), 1.0)
            masses.append((len(levers), float(row["mass"]), centre[..., :3]))
        frame = then(frame, body(row) @ build.motion(chain, k, q))
    return frame, levers, masses


def carried(build: Build, chain: str) -> dict[str, Array]:
    """The points on the end of a chain, in its frame."""
    shift = build.tips.get(chain, np.zeros(3))
    points = [p for p in build.mechanism["point"] if p.get("chain") == chain]
    return {p["name"]: np.array(p["at"], dtype=float) + shift for p in points}


def torques(build: Build, q: Array, *, of_tips: bool = False) -> Array:
    """Torque of the weights about every joint, (n, channels): of the masses, or of the points."""
    down = np.array(build.mechanism["gravity"], dtype=float)
    down = down / np.linalg.norm(down)
    out = np.zeros(q.shape)
    for chain in build.mechanism["chain"]:
        frame, levers, masses = posture(build, chain["name"], q)
        if of_tips:
            masses = [
                (len(levers), 1.0, (frame @ np.append(at, 1.0))[..., :3])
                for at in carried(build, chain["name"]).values()
            ]
        for carrying, weight, centre in masses:
            for lever in levers[:carrying]:
                out[..., lever.channel] += weight * (lever.moves(centre) @ down)
    return out


def loaded(build: Build, q: Array) -> Array:
    """Joint coordinates after every joint has given to its load."""
    if not build.is_loaded:
        return q
    channels, out = names(build.mechanism), q.copy()
    if build.gives:
        torque = torques(build, q)
        for name, compliance in build.gives.items():
            source = build.swaps.get(name, name)
            out[..., channels.index(name)] += compliance * torque[..., channels.index(source)]
    if build.bends:
        torque = torques(build, q, of_tips=True)
        for i, name in enumerate(channels):
            bend = build.bends.get(chain_of(build.mechanism, name), 0.0)
            out[..., i] += bend * torque[..., i]
    return out


def points(build: Build, q: Array, where: Where | None = None) -> dict[str, Array]:
    """Every point in the base, (n, 3), for coordinates before load."""
    q = loaded(build, q)
    out: dict[str, Array] = {}
    for chain in build.mechanism["chain"]:
        frame = posture(build, chain["name"], q)[0]
        for name, at in carried(build, chain["name"]).items():
            out[name] = (frame @ np.append(at, 1.0))[..., :3]
    for point in build.mechanism["point"]:
        if "chain" not in point and "at" in point:
            at = np.array(point["at"], dtype=float)
            out[point["name"]] = np.broadcast_to(at, (*q.shape[:-1], 3))
        elif "unknown" in point and where is not None:
            out[point["name"]] = where[point["name"]]
    return out


def is_link(closure: Mapping[str, Any]) -> bool:
    """Whether a closure is between two unknown points: no sample takes part in it."""
    return all("[" in name for name in closure["between"])


def apart(build: Build, at: Where, closure: Mapping[str, Any]) -> Array:
    """Vector between the two points of a closure, (n, 3)."""
    first, second = closure["between"]
    return at[first] - at[second]


def misclosure(build: Build, q: Array, where: Where | None = None) -> Array:
    """How far every closure is open, in length units: shape (…, n, equations)."""
    at, columns = points(build, q, where), []
    for closure in build.mechanism["closure"]:
        if is_link(closure):
            continue
        gap = apart(build, at, closure)
        if closure["kind"] == "touch":
            columns += [gap[..., k] for k in range(3)]
            continue
        value = closure["value"]
        value = where[value] if isinstance(value, str) and where is not None else value
        value = value + build.more(closure["name"], q)
        columns.append((np.sum(gap**2, axis=-1) - value**2) / (2 * value))
    return np.stack(columns, axis=-1)


def row_slope(function: Callable[[Array], Array], x: Array, steps: Array) -> Array:
    """Central differences of a row-wise function (n, m) -> (n, K) by its own row: (n, K, m).

    All shifted rows go to the function at once, (2, m, n, m).
    """
    shifts = np.diag(steps)[:, None, :]
    ahead, behind = function(np.stack([x + shifts, x - shifts]))
    return np.asarray(np.moveaxis(ahead - behind, 0, -1) / (2 * steps))


def close(function: Callable[[Array], Array], q: Array, steps: Array, tol: float) -> Array:
    """Newton's method from `q`, the shortest step each time; a row that fails is NaN.

    `steps`, (channels,), are small changes of each coordinate, and how the coordinates compare.
    """
    q = q.copy()
    for _ in range(25):
        f = function(q)
        if np.nanmax(np.abs(f), initial=0.0) < 1e-3 * tol:
            break
        slope = row_slope(function, q, steps) * steps
        step = (np.linalg.pinv(slope, rcond=1e-9) @ f[..., None])[..., 0]
        longest = np.abs(step).max(axis=1, keepdims=True)
        reach = 0.3 / 1e-5
        q = q - steps * step * (reach / np.maximum(longest, reach))
    bad = ~(np.abs(function(q)).max(axis=1) < tol)
    q[bad] = np.nan
    return q
