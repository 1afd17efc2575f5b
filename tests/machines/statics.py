"""Closed mechanisms that hang under their own weight, with joints that have no drive.

What a drive feels follows from virtual work: along every motion that the closures allow, the work
of the weights is that of the drives, and a passive joint does none. With as many drives as the
mechanism has freedoms, `τ_m = g_m - g_p J_p⁻¹ J_m` where `g` is the slope of the weights' fall by
the joints and `J` that of the closures. Slopes by differences of plain matrix products.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from tests.machines import plain
from tests.machines.kit import WARM, Effect, Machine, Rng, Values, day, effect, keep
from tests.oracle import Array

NOISE, PLAY = 1e-4, 0.02
"""Of an encoder [rad], and of a bearing [mm]."""
STEP = 1e-6
POSES, TRIED = 60, 400
STRETCHED = 0.15
"""Loops whose passive joints follow the drives worse than this, by singular values, are nearly
stretched: machines keep away from there, and torques change with every microradian."""
Closed = Callable[[dict[str, Array], list[dict[str, Any]]], Array]
"""Gaps of the closures, (n, equations), for joint coordinates and chains."""


class Hanging:
    """Chains with masses, which of their joints have drives, and how they are closed."""

    def __init__(
        self,
        chains: list[dict[str, Any]],
        drives: list[str],
        down: Array,
        closed: Closed,
        warm: bool = False,
        shares: tuple[float, ...] = (),
    ) -> None:
        self.chains, self.drives, self.down, self.closed = chains, drives, down, closed
        self.warm = warm
        self.shares = dict(zip(drives, shares or [1.0] * len(drives), strict=True))
        self.joints = [row["channel"] for c in chains for row in c["dh"] if "channel" in row]
        self.driven = np.array([j in drives for j in self.joints])

    def named(self, q: Array) -> dict[str, Array]:
        """Coordinates by channel."""
        return dict(zip(self.joints, q.T, strict=True))

    def fall(self, q: Array) -> Array:
        """How far all weights have fallen, each times its mass: (n,)."""
        out = np.zeros(len(q))
        for chain in self.chains:
            rows = chain["dh"]
            for k, row in enumerate(rows):
                if "mass" in row:
                    joint = {**row, "a": 0.0, "d": 0.0, "alpha": 0.0}  # the frame after the joint
                    end = plain.frames([*rows[:k], joint], self.named(q), len(q))
                    out = out + row["mass"] * (plain.place(end, row["com"]) @ self.down)
        return np.asarray(out)

    def loops(self, q: Array) -> Array:
        """Slope of the closures by the joints: (n, equations, joints)."""
        return slope(lambda moved: self.closed(self.named(moved), self.chains), q)

    def works(self, q: Array) -> Array:
        """Which postures are not nearly stretched."""
        j = self.loops(q)
        sizes = np.linalg.svd(j[:, :, ~self.standing(j.shape[1])], compute_uv=False)
        return np.asarray(sizes[:, -1] > STRETCHED * sizes[:, 0])

    def standing(self, equations: int) -> Array:
        """Joints that stand while loops are closed, as many as these leave freedoms."""
        freedoms = len(self.joints) - equations
        return np.array([j in self.drives[:freedoms] for j in self.joints])

    def felt(self, q: Array) -> Array:
        """Torques of the drives, (n, joints): zero where there is none."""
        g, j = slope(self.fall, q), self.loops(q)
        by_drives, by_free = (np.swapaxes(j[:, :, d], 1, 2) for d in (self.driven, ~self.driven))
        out = np.zeros(q.shape)
        weigh = np.array([self.shares[j] ** -0.5 for j in self.joints if j in self.drives])
        by_closures = np.linalg.pinv(by_free)
        for n in range(len(q)):
            # Forces of the closures: passive joints carry nothing, and of the forces that are left
            # those by which drives would work against each other are none.
            force = by_closures[n] @ g[n, ~self.driven]
            left = keep(by_free[n].T)
            carried = g[n, self.driven] - by_drives[n] @ force
            if left.size:
                against = np.linalg.pinv(weigh[:, None] * (by_drives[n] @ left), rcond=1e-9)
                carried = carried - by_drives[n] @ left @ against @ (weigh * carried)
            out[n, self.driven] = carried
        return out

    def gap(self, read: Array, v: Values) -> Array:
        """Gaps for readings, with all that is wrong."""
        n = len(self.joints)
        warm = read[:, n] - read[:, n].mean() if self.warm else np.zeros(len(read))
        q = read[:, :n] + np.array([v[f"offset@{j}"] for j in self.joints])
        for i, j in enumerate(self.joints):
            q[:, i] += v.get(f"warm@{j}", 0.0) * warm
            q[:, i] += v.get(f"curvature@{j}", 0.0) * read[:, i] ** 2
            q[:, i] += v.get(f"once@{j}", 0.0) * np.sin(read[:, i] + i)
        if any(key.startswith(("compliance", "play")) and value for key, value in v.items()):
            torque = self.felt(q)
            for i, j in enumerate(self.joints):
                q[:, i] += v.get(f"compliance@{j}", 0.0) * torque[:, i]
                q[:, i] += v.get(f"play@{j}", 0.0) * np.sign(torque[:, i])
        chains = [
            {**c, "dh": [self.made(f"{c['name']}/{k}", row, v, warm) for k, row in numbered(c)]}
            for c in self.chains
        ]
        return self.closed(self.named(q), chains)

    @staticmethod
    def made(place: str, row: dict[str, Any], v: Values, warm: Array) -> dict[str, Any]:
        """A row as it was made: of another length, which may grow, and tilted at its end."""
        a = row.get("a", 0.0) + v.get(f"a@{place}", 0.0) + v.get(f"growth@{place}", 0.0) * warm
        return {**row, "a": a} | plain.tilted(row, v.get(f"tilt@{place}", 0.0))

    def effects(self) -> tuple[Effect, ...]:
        """What such a mechanism may have."""
        out = []
        for j in self.joints:
            out += [
                effect(f"curvature@{j}", "sensor", 3e-3, j),
                effect(f"once@{j}", "sensor", 2e-3, j),
            ]
        for j in self.drives:
            out += [
                effect(f"compliance@{j}", "load", 3e-6, j),
                effect(f"play@{j}", "load", 1e-3, j),
            ]
        for c in self.chains:
            for k, row in numbered(c):
                if row.get("a") and "channel" in row:
                    at = f"{c['name']}/{k}"
                    out.append(effect(f"a@{at}", "geometry", 0.3, at))
                    out.append(effect(f"tilt@{at}", "geometry", 1e-3, at))
                    if self.warm:
                        out.append(effect(f"growth@{at}", "geometry", 5e-3, at))
        if self.warm:
            out += [effect(f"warm@{j}", "sensor", 3e-5, j) for j in self.joints]
        return tuple(out)

    def told(self, machine: Machine, tells: str) -> Machine:
        """The machine with a file, and readings, that tell what its drives carry."""
        feels = self.felt(machine.start[:, : len(self.joints)])
        text = dict(machine.text)
        document = {**machine.mechanism, "channel": [dict(c) for c in machine.mechanism["channel"]]}
        for name in self.drives:
            i = self.joints.index(name)
            if tells == "share":
                document["channel"][i]["share"] = float(self.shares[name])
            else:  # a drive pushes against what it feels
                document["channel"][i]["torque"] = f"push_{name}"
                text[f"push_{name}"] = [f"{-torque:.6f}" for torque in feels[:, i]]
        return replace(machine, mechanism=document, text=text)

    def machine(
        self, name: str, rng: Rng, start: Array, points: list[Any], closures: list[Any]
    ) -> Machine:
        """The machine about those of the postures at which its drives can stand."""
        n = len(self.joints)
        more = [WARM] if self.warm else []
        if self.warm:
            start = np.column_stack([start, np.zeros(len(start))])
        channels = [
            {"name": j, "unit": "rad", "gain": 1.0, "offset": 0.0, "noise": NOISE}
            | ({} if j in self.drives else {"passive": True})
            for j in self.joints
        ]
        document = {
            "name": name,
            "length_unit": "mm",
            "gravity": [float(x) for x in self.down],
            "channel": channels,
            "chain": self.chains,
            "point": points,
            "closure": closures,
            "model": {"terms": ["offset"]},
        }
        values = {f"offset@{j}": float(rng.normal(0, 5e-3)) for j in self.joints}
        equations = self.closed(self.named(start[:, :n]), self.chains).shape[1]
        machine = Machine(
            name=name,
            mechanism=document,
            columns=(*self.joints, *more),
            sigma=np.array([NOISE] * n + [0.0] * len(more)),
            play=np.full(equations, PLAY),
            gap=lambda read, places, v: self.gap(read, v),
            start=start,
            gives=np.concatenate([~self.standing(equations), np.zeros(len(more))]).astype(float),
            values=values,
            fitted=dict.fromkeys(values, 1e-5),
            effects=self.effects(),
        )
        rows, shut = machine.settled(values)
        rows = rows[shut & self.works(rows[:, :n])][:POSES]
        if self.warm:
            rows[:, n] = day(rng, len(rows))
        return replace(machine, start=rows)


def numbered(chain: dict[str, Any]) -> Iterable[tuple[int, dict[str, Any]]]:
    """Rows of a chain with their numbers, from 1."""
    return enumerate(chain["dh"], start=1)


def slope(of: Callable[[Array], Array], q: Array) -> Array:
    """Derivatives by the joints, the last axis, by differences; all rows go to it at once."""
    steps = STEP * np.eye(q.shape[1])[:, None, :]
    values = of(np.stack([q + steps, q - steps]).reshape(-1, q.shape[1]))
    ahead, behind = values.reshape(2, len(steps), len(q), *values.shape[1:])
    return np.moveaxis((ahead - behind) / (2 * STEP), 0, -1)


def link(rng: Rng, channel: str, a: float, **more: float) -> dict[str, Any]:
    """A joint and a heavy link."""
    mass, along = float(rng.uniform(0.5, 3)), float(a * rng.uniform(0.3, 0.6))
    return {"channel": channel, "a": float(a), "mass": mass, "com": [along, 0.0, 0.0], **more}


def point(name: str, chain: str) -> dict[str, Any]:
    """A point at the end of a chain."""
    return {"name": name, "chain": chain, "at": [0.0, 0.0, 0.0]}


TELLS = ("share", "torque", None)
"""What a mechanism file may say of drives that could work against each other."""


def draw_redundant(rng: Rng, tells: str | None = "share") -> Machine:
    """The same with a third drive, at an elbow."""
    return draw_fivebar(rng, ["m1", "m2", "p1"], tells)


def draw_fivebar(
    rng: Rng, drives: Sequence[str] = ("m1", "m2"), tells: str | None = None
) -> Machine:
    """Two arms that meet in a pin, upright; a drive at each shoulder, encoders at the elbows."""
    base, upper, lower = rng.uniform(0.8, 1.2, 3) * [200, 250, 300]
    chains = [
        {"name": "left", "dh": [link(rng, "m1", upper), link(rng, "p1", lower)]},
        {
            "name": "right",
            "dh": [{"a": float(base)}, link(rng, "m2", upper), link(rng, "p2", lower)],
        },
    ]

    def closed(q: dict[str, Array], chains: list[dict[str, Any]]) -> Array:
        n = len(q["m1"])
        ends = [plain.place(plain.frames(c["dh"], q, n), [0, 0, 0]) for c in chains]
        return np.asarray((ends[0] - ends[1])[:, :2])

    shares = tuple(rng.uniform(0.5, 2, len(drives))) if tells else ()
    hanging = Hanging(chains, list(drives), np.array([0.0, -1.0, 0.0]), closed, shares=shares)
    start = np.array([2.1, -1.4, 1.0, 1.4]) + 0.55 * rng.uniform(-1, 1, (TRIED, 4))
    points = [point("pin 1", "left"), point("pin 2", "right")]
    closures = [{"name": "pin", "kind": "touch", "between": ["pin 1", "pin 2"], "noise": PLAY}]
    machine = hanging.machine("five-bar", rng, start, points, closures)
    return hanging.told(machine, tells) if tells else machine


def draw_warm_legs(rng: Rng) -> Machine:
    """The same in a hall whose temperature changes."""
    return draw_legs(rng, warm=True)


def draw_legs(rng: Rng, warm: bool = False) -> Machine:
    """A platform on three legs: drives at the base, free knees, balls at the platform."""
    around, upper, lower, side = rng.uniform(0.85, 1.15, 4) * [180, 200, 260, 160]
    chains, points = [], []
    for i in range(3):
        rows = [
            {"theta": float(2 * np.pi * i / 3), "a": float(around), "alpha": np.pi / 2},
            link(rng, f"m{i + 1}", upper),
            link(rng, f"p{i + 1}", lower),
        ]
        chains.append({"name": f"leg{i + 1}", "dh": rows})
        points.append(point(f"ball{i + 1}", f"leg{i + 1}"))
    pairs = ((0, 1), (1, 2), (0, 2))

    def closed(q: dict[str, Array], chains: list[dict[str, Any]]) -> Array:
        ends = [plain.place(plain.frames(c["dh"], q, len(q["m1"])), [0, 0, 0]) for c in chains]
        apart = [np.linalg.norm(ends[a] - ends[b], axis=1) for a, b in pairs]
        return np.asarray(np.stack(apart, axis=1) - side)

    hanging = Hanging(chains, ["m1", "m2", "m3"], np.array([0.0, 0.0, -1.0]), closed, warm)
    start = np.array([1.2, 1.0] * 3) + 0.45 * rng.uniform(-1, 1, (TRIED, 6))
    closures = [
        {"name": f"side{k}", "kind": "distance", "value": float(side), "noise": PLAY}
        | {"between": [f"ball{a + 1}", f"ball{b + 1}"]}
        for k, (a, b) in enumerate(pairs, start=1)
    ]
    return hanging.machine("legs", rng, start, points, closures)
