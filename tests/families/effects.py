"""Undeclared effects at their places in a machine, and laws that no catalogue has."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from itertools import product

import numpy as np

from tests import oracle
from tests.families import linkage
from tests.families.device import Device, Effect, Scene
from tests.families.draw import Rng
from tests.families.linkage import Build
from tests.oracle import Array

MOST = 10.0
"""Effects beyond so many typical sizes are drawn anew."""

Make = Callable[[Device, Rng, str], Effect]


def middle(device: Device) -> tuple[Array, Array]:
    """Middle and half of the range of every joint coordinate."""
    low, high = linkage.limits(device.drawing.mechanism)
    return (low + high) / 2, (high - low) / 2


def unit(device: Device, channel: str) -> float:
    """A radian; of a slide, half its way."""
    i = device.names.index(channel)
    slides = linkage.slides(device.drawing.mechanism)[channel]
    return float(middle(device)[1][i]) if slides else 1.0


def sensor(
    device: Device,
    term: str,
    channel: str,
    typical: float,
    law: Callable[[Array, Scene], Array],
    *,
    outside: bool = False,
    bound: bool = False,
    told: str | None = None,
) -> Effect:
    """An error of one sensor: `size * law(q, scene)`, with `q` of that joint, (n,)."""
    i = device.names.index(channel)

    def bends(size: float, q: Array, scene: Scene) -> Array:
        out = np.zeros(q.shape)
        out[:, i] = size * law(q[:, i], scene)
        return out

    return Effect(
        term,
        "sensor",
        channel,
        typical * unit(device, channel),
        bends=bends,
        outside=outside,
        bound=bound,
        told=None if outside else told or f"{term}@{channel}",
    )


def centre(device: Device, channel: str) -> float:
    """Middle of what a sensor reads: of its range, or of the joint's where it has none.

    A sensor does not know how far its joint goes: a track that bends alike at both its ends does
    so about its own middle.
    """
    i = device.names.index(channel)
    ends = device.drawing.mechanism["channel"][i].get("range")
    if ends is None:
        return float(middle(device)[0][i])
    return float(device.offsets[i] + device.gains[i] * np.mean(ends))


def shape(term: str, typical: float, law: Callable[[Array], Array]) -> Make:
    """A curve about the middle of what the sensor reads, in halves of the joint's range."""

    def make(device: Device, rng: Rng, target: str) -> Effect:
        mid, half = centre(device, target), float(middle(device)[1][device.names.index(target)])
        return sensor(device, term, target, typical, lambda q, _: law((q - mid) / half))

    return make


def harmonic(term: str, order: int, typical: float) -> Make:
    """An error that comes back so many times per turn."""

    def make(device: Device, rng: Rng, target: str) -> Effect:
        phase = rng.uniform(0, 2 * np.pi)
        outside = order > 2
        return sensor(
            device,
            term,
            target,
            typical,
            lambda q, _: np.sin(order * q + phase),
            outside=outside,
        )

    return make


def hysteresis(device: Device, rng: Rng, target: str) -> Effect:
    """Half the width of the loop between shaft and sensor."""
    i, mid = device.names.index(target), middle(device)[0]
    return sensor(device, "hysteresis", target, 1e-3, lambda q, scene: scene.direction(mid)[:, i])


def drift(device: Device, rng: Rng, target: str) -> Effect:
    """A steady drift."""
    return sensor(device, "drift", target, 5e-3, lambda q, s: s.turn - 0.5, bound=True)


def slip(device: Device, rng: Rng, target: str) -> Effect:
    """A sensor that turned on its shaft between two poses."""
    share = rng.uniform(0.25, 0.75)

    def law(q: Array, scene: Scene) -> Array:
        return np.where(scene.label > 1 + round(share * scene.poses), 1.0, 0.0)

    return sensor(device, "slip", target, 0.01, law, bound=True)


def temperature_offset(device: Device, rng: Rng, target: str) -> Effect:
    """An offset that follows the room."""
    return sensor(device, "temperature_offset", target, 1e-3, lambda q, s: s.warmth)


def temperature_gain(device: Device, rng: Rng, target: str) -> Effect:
    """A gain that follows the room."""
    i = device.names.index(target)
    mid, half = (float(x[i]) for x in middle(device))
    law = lambda q, s: s.warmth * (q - mid) / half  # noqa: E731
    return sensor(device, "temperature_gain", target, 1e-3, law)


def crosstalk(device: Device, rng: Rng, target: str) -> Effect:
    """A converter's channel that picks up part of the one beside it."""
    i, n = device.names.index(target), len(device.names)
    j = int(rng.choice([k for k in (i - 1, i + 1) if 0 <= k < n]))
    centre = float(np.mean(device.drawing.mechanism["channel"][j]["range"]))

    def reads(size: float, readings: Array, scene: Scene) -> Array:
        out = np.zeros(readings.shape)
        out[:, i] = size * (readings[:, j] - centre)
        return out

    told = f"crosstalk@{target}:{device.names[j]}"
    return Effect("crosstalk", "sensor", target, 5e-3, reads=reads, told=told)


# ------------------------------------------------------------------ geometry


def geometry(
    term: str, target: str, typical: float, builds: Callable[[float, Build], Build]
) -> Effect:
    """An error of what was built."""
    return Effect(term, "geometry", target, typical, builds=builds, told=f"{term}@{target}")


def row_of(target: str) -> tuple[str, int]:
    """Chain and row, counted from 0, of `arm/2`."""
    chain, row = target.split("/")
    return chain, int(row) - 1


def link(term: str, axis: str) -> Make:
    """A link longer along x, or displaced along z."""

    def make(device: Device, rng: Rng, target: str) -> Effect:
        chain, row = row_of(target)
        entries = next(c for c in device.drawing.mechanism["chain"] if c["name"] == chain)
        twist = oracle.rotation("x", entries["dh"][row].get("alpha", 0.0))
        # Behind the body, whose twist is about x: what was along z before is turned back.
        along = twist[:3, :3].T @ np.array([axis == "x", 0.0, axis == "z"], dtype=float)

        def builds(size: float, build: Build) -> Build:
            return build.with_motion(chain, row, oracle.translation(*(size * along)))

        return geometry(term, target, 2e-3 * device.length, builds)

    return make


def turned(phase: float, size: float) -> Array:
    """A small turn about an axis in the plane of x and y."""
    out = oracle.rotation("z", phase) @ oracle.rotation("x", size) @ oracle.rotation("z", -phase)
    return np.asarray(out)


def joint_tilt(device: Device, rng: Rng, target: str) -> Effect:
    """A joint axis tilted against the one before."""
    (chain, row), phase = row_of(target), rng.uniform(0, 2 * np.pi)
    return geometry(
        "joint_tilt", target, 4e-3, lambda s, b: b.with_motion(chain, row, turned(phase, s))
    )


def base_tilt(device: Device, rng: Rng, target: str) -> Effect:
    """A chain whose first axis is tilted."""
    phase = rng.uniform(0, 2 * np.pi)
    rows = next(c["dh"] for c in device.drawing.mechanism["chain"] if c["name"] == target)
    first = next(k for k, row in enumerate(rows) if "channel" in row)
    return geometry(
        "base_tilt", target, 4e-3, lambda s, b: b.with_motion(target, first - 1, turned(phase, s))
    )


def somewhere(rng: Rng, device: Device) -> Array:
    """A direction; of a planar machine one in its plane."""
    out = rng.normal(size=3)
    if is_planar(device):
        out[2] = 0.0
    return np.asarray(out / np.linalg.norm(out))


def base_position(device: Device, rng: Rng, target: str) -> Effect:
    """A chain that stands elsewhere."""
    along = somewhere(rng, device)

    def builds(size: float, build: Build) -> Build:
        before = build.after.get((target, -1), np.eye(4))
        moved = oracle.translation(*(size * along)) @ before
        return replace(build, after={**build.after, (target, -1): moved})

    return geometry("base_position", target, 2e-3 * device.length, builds)


def point_position(device: Device, rng: Rng, target: str) -> Effect:
    """A tool, with all points on it, that sits elsewhere on the end of its chain."""
    along = somewhere(rng, device)
    return geometry(
        "point_position", target, 4e-3 * device.length, lambda s, b: b.with_tip(target, s * along)
    )


def distance(device: Device, rng: Rng, target: str) -> Effect:
    """A distance that is not the drawn one."""
    return Effect(
        "distance",
        "closure",
        target,
        2e-3 * device.length,
        builds=lambda s, b: b.with_entry("longer", target, s),
        told=f"distance@{target}",
    )


def joint_compliance(device: Device, rng: Rng, target: str) -> Effect:
    """A joint that gives under the weight of the links."""
    return Effect(
        "joint_compliance",
        "load",
        target,
        6e-3,
        builds=lambda s, b: b.with_entry("gives", target, abs(s)),
        told=f"joint_compliance@{target}",
    )


def sag(device: Device, rng: Rng, target: str) -> Effect:
    """A chain that gives at every joint under a weight at its end."""
    return Effect(
        "sag",
        "load",
        target,
        4e-3 / device.length,
        builds=lambda s, b: b.with_entry("bends", target, abs(s)),
        told=f"sag@{target}",
    )


# ------------------------------------------------------------------ outside any catalogue


def warm_up(device: Device, rng: Rng, target: str) -> Effect:
    """An offset that dies out as an exponential."""
    pace = rng.uniform(0.08, 0.25)
    law = lambda q, s: np.exp(-s.turn / pace)  # noqa: E731
    return sensor(device, "warm_up", target, 0.01, law, outside=True, bound=True)


def backlash(device: Device, rng: Rng, target: str) -> Effect:
    """A dead band with memory: the sensor follows when the shaft has crossed it."""
    i = device.names.index(target)

    def bends(size: float, q: Array, scene: Scene) -> Array:
        out = np.zeros(q.shape)
        first = np.flatnonzero(np.diff(scene.label, prepend=0))
        follows = q[first[0], i]
        lags = np.zeros(scene.poses)
        for pose, row in enumerate(first):
            follows = min(max(follows, q[row, i] - abs(size)), q[row, i] + abs(size))
            lags[pose] = q[row, i] - follows
        out[:, i] = lags[scene.label - 1]
        return out

    typical = 0.01 * unit(device, target)
    return Effect("backlash", "sensor", target, typical, bends=bends, outside=True)


def coupling(device: Device, rng: Rng, target: str) -> Effect:
    """A joint that gives under what its neighbour carries; without weights, that moves with it."""
    mechanism = device.drawing.mechanism
    mates = [
        name
        for name in device.names
        if name != target
        and linkage.chain_of(mechanism, name) == linkage.chain_of(mechanism, target)
    ]
    other = str(rng.choice(mates))
    i, j = device.names.index(target), device.names.index(other)
    mid, half = middle(device)
    load = any("mass" in row for chain in mechanism["chain"] for row in chain["dh"])
    if load:

        def builds(size: float, build: Build) -> Build:
            return replace(
                build.with_entry("gives", target, size), swaps={**build.swaps, target: other}
            )

        return Effect("coupling", "load", target, 6e-3, builds=builds, outside=True)

    def bends(size: float, q: Array, scene: Scene) -> Array:
        out = np.zeros(q.shape)
        u = (q - mid) / half
        out[:, i] = size * u[:, i] * u[:, j]
        return out

    typical = 0.01 * unit(device, target)
    return Effect("coupling", "sensor", target, typical, bends=bends, outside=True)


def coarse(device: Device, rng: Rng, target: str) -> Effect:
    """An encoder of few lines: what it reads is a multiple of its step."""
    i = device.names.index(target)

    def reads(size: float, readings: Array, scene: Scene) -> Array:
        out = np.zeros(readings.shape)
        step = abs(size) / abs(device.gains[i])
        out[:, i] = step * np.rint(readings[:, i] / step) - readings[:, i]
        return out

    typical = 0.01 * unit(device, target)
    return Effect("coarse", "sensor", target, typical, reads=reads, last=True, outside=True)


# ------------------------------------------------------------------ mishaps


def bad(device: Device, rng: Rng, scene: Scene, kind: str) -> Effect:
    """Readings that are wrong: `sample`, `pose`, `two poses`, or a pose that `moved`."""
    i = int(rng.integers(len(device.names)))
    count = 2 if kind == "two poses" else 1
    poses = rng.choice(np.arange(2, scene.poses), count, replace=False)
    rows = np.flatnonzero(np.isin(scene.label, poses))
    if kind == "sample":
        rows = rows[-1:]
    which = np.zeros(len(device.names))
    which[i] = 1.0
    if kind == "moved":
        rows = rows[len(rows) // 2 :]
        half = rng.permutation(len(which))[: max(1, len(which) // 2)]
        which[half] = rng.uniform(0.5, 1.0, len(half)) * rng.choice([-1.0, 1.0], len(half))
    units = np.array([unit(device, name) for name in device.names])
    mask = np.zeros(len(scene.label))
    mask[rows] = 1.0

    def reads(size: float, readings: Array, scene: Scene) -> Array:
        if len(readings) != len(mask):
            return np.zeros(readings.shape)
        return np.asarray(size * mask[:, None] * which * units / device.gains)

    return Effect(
        "bad_reading",
        "data",
        device.names[i],
        0.01,
        reads=reads,
        bound=True,
        rows=tuple(int(r) for r in rows),
    )


# ------------------------------------------------------------------ what there is, and where


SENSOR: dict[str, Make] = {
    "curvature": shape("curvature", 0.02, lambda u: u**2),
    "cubic": shape("cubic", 0.03, lambda u: u**3),
    "once_per_turn": harmonic("once_per_turn", 1, 0.01),
    "twice_per_turn": harmonic("twice_per_turn", 2, 0.01),
    "hysteresis": hysteresis,
    "drift": drift,
    "slip": slip,
    "crosstalk": crosstalk,
    "temperature_offset": temperature_offset,
    "temperature_gain": temperature_gain,
}
STRUCTURE: dict[str, Make] = {
    "link_length": link("link_length", "x"),
    "link_offset": link("link_offset", "z"),
    "joint_tilt": joint_tilt,
    "base_position": base_position,
    "base_tilt": base_tilt,
    "point_position": point_position,
    "distance": distance,
    "joint_compliance": joint_compliance,
    "sag": sag,
}
CATALOGUE = SENSOR | STRUCTURE
OUTSIDE: dict[str, Make] = {
    "three_lobes": harmonic("three_lobes", 3, 0.01),
    "warm_up": warm_up,
    "backlash": backlash,
    "coupling": coupling,
    "coarse": coarse,
}
MISHAPS = ("sample", "pose", "two poses", "moved")


def is_planar(device: Device) -> bool:
    """Whether all axes are along z and nothing leaves the plane."""
    rows = [row for chain in device.drawing.mechanism["chain"] for row in chain["dh"]]
    return all(not row.get("alpha") and not row.get("d") for row in rows)


def targets(device: Device, term: str) -> list[str]:
    """Where an effect can be in this machine."""
    drawing = device.drawing
    mechanism = drawing.mechanism
    chains = mechanism["chain"]
    slides = linkage.slides(mechanism)
    units = {c["name"]: c["unit"] for c in mechanism["channel"]}
    if term in ("once_per_turn", "twice_per_turn", "three_lobes"):
        return [name for name in device.names if not slides[name]]
    if term.startswith("temperature"):
        return device.names if drawing.warm else []
    if term == "hysteresis" and not drawing.held:  # nobody knows where such rows came from
        return []
    if term == "crosstalk":
        return [name for name in device.names if units[name] == "count"]
    if term in ("link_length", "link_offset", "joint_tilt"):
        if is_planar(device) and term != "link_length":
            return []
        return [f"{c['name']}/{k + 1}" for c in chains for k in range(len(c["dh"]))]
    if term == "base_tilt" and is_planar(device):
        return []
    if term in ("base_position", "base_tilt", "point_position"):
        return [c["name"] for c in chains]
    if term == "distance":
        sampled = [c for c in mechanism["closure"] if not linkage.is_link(c)]
        return [c["name"] for c in sampled if c["kind"] == "distance"]
    if term == "joint_compliance":
        heavy = any("mass" in row for c in chains for row in c["dh"])
        return device.names if heavy else []
    if term == "sag":
        return [c["name"] for c in chains] if "gravity" in mechanism else []
    if term == "coupling":
        mates = {name: linkage.chain_of(mechanism, name) for name in device.names}
        return [n for n in device.names if list(mates.values()).count(mates[n]) > 1]
    return device.names


def possible(device: Device, kinds: dict[str, Make]) -> list[tuple[str, str]]:
    """Every term of `kinds` with every target it can have here."""
    return [pair for term in kinds for pair in product([term], targets(device, term))]
