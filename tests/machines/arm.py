"""An arm of six joints that touches planes, a line, sockets, or is seen by a tracker [mm]."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from tests import oracle
from tests.machines import plain
from tests.machines.kit import WARM, Effect, Machine, Rng, Values, day, effect
from tests.oracle import Array

JOINTS = ("q1", "q2", "q3", "q4", "q5", "q6")
SEEN = ("x", "y", "z")
NOISE, PLAY, TRACKER = 5e-5, 0.03, 0.06
"""Of an encoder [rad], of a touch, and of a measured point [mm]."""
LIMITS = ((-3.1, 3.1), (-2.8, 0.0), (-2.8, 2.8), (-3.1, 3.1), (-3.1, 3.1), (-3.1, 3.1))
NEAR = np.array([0.2, -1.3, 1.5, -1.7, -1.5, 0.3])
SPREAD = np.array([0.7, 0.5, 0.6, 0.9, 0.9, 2.0])


@dataclass(frozen=True)
class Body:
    """The arm as drawn, the tool on it, and its rows that are long or set off."""

    rows: list[dict[str, Any]]
    tool: Array

    @classmethod
    def random(cls, rng: Rng) -> Body:
        """A common build, every length drawn; the tool stands off the last axis."""
        d1, a2, a3, d4, d5, d6 = rng.uniform(0.7, 1.3, 6) * [160, 425, 390, 130, 100, 100]
        right = np.pi / 2
        rows: list[dict[str, Any]] = [
            {"channel": "q1", "d": d1, "alpha": -right},
            {"channel": "q2", "a": a2},
            {"channel": "q3", "a": a3},
            {"channel": "q4", "d": d4, "alpha": right},
            {"channel": "q5", "d": d5, "alpha": -right},
            {"channel": "q6", "d": d6},
        ]
        rows = [{k: v if k == "channel" else float(v) for k, v in row.items()} for row in rows]
        return cls(
            rows, np.array([rng.uniform(40, 80), rng.uniform(-20, 20), rng.uniform(50, 150)])
        )

    def tip(self, read: Array, v: Values, warm: Array | float = 0.0) -> Array:
        """Places of the tool for readings, with all that is wrong with the arm: (n, 3)."""
        q: dict[str, Array] = {}
        time = np.linspace(-0.5, 0.5, len(read))
        for i, name in enumerate(JOINTS):
            low, high = LIMITS[i]
            u = (read[:, i] - (low + high) / 2) / ((high - low) / 2)
            own = read[:, i] * (1 + v.get(f"gain@{name}", 0.0)) + v.get(f"offset@{name}", 0.0)
            own = own + v.get(f"curvature@{name}", 0.0) * u * u
            own = own + v.get(f"once@{name}", 0.0) * np.sin(read[:, i] + i)
            own = own + v.get(f"warm@{name}", 0.0) * warm
            q[name] = own + v.get(f"drift@{name}", 0.0) * time
        rows = [dict(row) for row in self.rows]
        for k, row in enumerate(rows, start=1):
            row |= plain.tilted(row, v.get(f"tilt@arm/{k}", 0.0))
            for length in ("a", "d"):
                grown = v.get(f"growth@arm/{k}", 0.0) * warm if row.get(length) else 0.0
                row[length] = row.get(length, 0.0) + v.get(f"{length}@arm/{k}", 0.0) + grown
        for name in JOINTS:
            soft = v.get(f"compliance@{name}", 0.0)
            if soft:
                q[name] = q[name] + soft * self.torque(read, name)
        return plain.place(plain.frames(rows, q, len(read)), self.tool)

    def torque(self, read: Array, name: str) -> Array:
        """Torque of a unit weight at the tool about a joint: `axis · (tip - joint) × down`."""
        k = JOINTS.index(name)
        q = dict(zip(JOINTS, read.T, strict=True))
        before = plain.frames(self.rows[:k], q, len(read))
        tip = plain.place(plain.frames(self.rows, q, len(read)), self.tool)
        arm = tip - before[:, :3, 3]
        pull = np.cross(arm, np.array([0.0, 0.0, -1.0]))
        return np.asarray(np.sum(before[:, :3, 2] * pull, axis=1))


# ------------------------------------------------------------------------------- closures


Closure = Callable[[Array, Array, Values], Array]
"""Gaps of one closure: tool places, readings, values."""


def flat(name: str, rows: Array, late: Array, bend: Array) -> Closure:
    """Distance from an unknown plane, of the rows that touch it; bent, or it moved late."""

    def gap(tip: Array, read: Array, v: Values) -> Array:
        tilts = np.array([v[f"tilt1@{name}"], v[f"tilt2@{name}"]])
        normal, along, across = face(v[f"yaw@{name}"], v[f"pitch@{name}"], tilts)
        x, y = tip @ along / 300, tip @ across / 300
        curve = bend[0] * x * x + bend[1] * x * y + bend[2] * y * y
        off = tip @ normal - v[f"offset@{name}"] - late * v.get(f"step@{name}", 0.0)
        return np.asarray(rows * (off - v.get(f"bend@{name}", 0.0) * curve))[:, None]

    return gap


def face(yaw: float, pitch: float, tilts: Sequence[float] | Array) -> tuple[Array, Array, Array]:
    """Normal and two directions of a plane: z turned by yaw and pitch, then tilted a little."""
    turn = oracle.roll_pitch_yaw(0.0, pitch, yaw)[:3, :3]
    normal = turn[:, 2] + tilts[0] * turn[:, 0] + tilts[1] * turn[:, 1]
    return normal / np.linalg.norm(normal), turn[:, 0], turn[:, 1]


def straight(name: str, late: Array) -> Closure:
    """Distances from an unknown line, in two directions across it."""

    def gap(tip: Array, read: Array, v: Values) -> Array:
        tilts = [v[f"tilt1@{name}"], v[f"tilt2@{name}"]]
        along, one, two = face(v[f"yaw@{name}"], v[f"pitch@{name}"], tilts)
        one = one - along * (along @ one)
        two = two - along * (along @ two)
        off = tip - np.array([v[f"{c}@{name}"] for c in "xyz"])
        off[:, 2] -= late * v.get(f"step@{name}", 0.0)
        s = tip @ along / 200
        sag = np.zeros((len(tip), 3))
        sag[:, 2] = v.get(f"bend@{name}", 0.0) * s * s
        return np.asarray((off - sag) @ np.column_stack([one, two]))

    return gap


def ball(name: str, long: float, late: Array) -> Closure:
    """Distance from an unknown point."""

    def gap(tip: Array, read: Array, v: Values) -> Array:
        off = tip - np.array([v[f"{c}@{name}"] for c in "xyz"])
        off[:, 0] -= late * v.get(f"moved@{name}", 0.0)
        return np.asarray(np.linalg.norm(off, axis=1) - long - v.get("bar", 0.0))[:, None]

    return gap


def socket(name: str, rows: Array, late: Array) -> Closure:
    """The tool in a socket whose place is unknown; the socket may have been moved late."""

    def gap(tip: Array, read: Array, v: Values) -> Array:
        off = tip - np.array([v[f"{c}@{name}"] for c in "xyz"])
        off[:, 0] -= late * v.get(f"moved@{name}", 0.0)
        return np.asarray(rows[:, None] * off)

    return gap


def seen(rows: Array, late: Array) -> Closure:
    """The tool where a tracker sees it, whose place is unknown."""

    def gap(tip: Array, read: Array, v: Values) -> Array:
        six = np.array([v[f"{c}@tracker"] for c in ("x", "y", "z", "rx", "ry", "rz")])
        turn = oracle.roll_pitch_yaw(*six[3:])[:3, :3]
        there = read[:, 6:9] * (1 + v.get("scale@tracker", 0.0)) @ turn.T + six[:3]
        there[:, 0] += late * v.get("step@tracker", 0.0)
        return np.asarray(rows[:, None] * (tip - there))

    return gap


# ------------------------------------------------------------------------------- machines


@dataclass
class Job:
    """What an arm is held by: closures in turn, with all that the machine needs of them."""

    body: Body
    rng: Rng
    poses: int
    warm: bool = False

    def __post_init__(self) -> None:
        """Postures near one from which everything is in reach."""
        rng, n = self.rng, self.poses
        self.q = NEAR + SPREAD * rng.uniform(-1, 1, (n, 6))
        self.late = (np.arange(n) >= rng.integers(n // 3, 2 * n // 3)).astype(float)
        self.values: Values = {f"offset@{j}": rng.normal(0, 4e-3) for j in JOINTS}
        self.fitted: dict[str, float] = {f"offset@{j}": 1e-5 for j in JOINTS}
        self.closures: list[tuple[Closure, list[float]]] = []
        self.effects: list[Effect] = arm_effects(self.warm)
        self.points: list[dict[str, Any]] = [
            {"name": "tool", "chain": "arm", "at": [float(x) for x in self.body.tool]}
        ]
        self.closed: list[dict[str, Any]] = []
        self.more: dict[str, list[dict[str, Any]]] = {}
        self.text: dict[str, list[str]] = {}
        self.measured = np.zeros((n, 0))

    @property
    def tip(self) -> Array:
        """Where the tool is."""
        return self.body.tip(self.q, self.values)

    def plane(self, name: str, rows: Array | None = None) -> None:
        """An unknown plane through the reach of the arm, nearly level or nearly upright."""
        rng = self.rng
        rows = np.ones(self.poses) if rows is None else rows
        yaw, pitch = rng.uniform(-0.5, 0.5), rng.choice([0.1, 1.4])
        normal = face(yaw, pitch, [0.0, 0.0])[0]
        middle = float((self.tip[rows > 0] @ normal).mean())
        self.values |= {f"yaw@{name}": yaw, f"pitch@{name}": float(pitch)}
        self.values |= {f"tilt1@{name}": 0.0, f"tilt2@{name}": 0.0, f"offset@{name}": middle}
        self.fitted |= {f"tilt1@{name}": 1e-5, f"tilt2@{name}": 1e-5, f"offset@{name}": 1e-2}
        self.closures.append((flat(name, rows, self.late, rng.normal(0, 1, 3)), [PLAY]))
        target = f"surface[surface={name}]"
        for what in ("bend", "step"):
            self.effects.append(named(f"{what}@{name}", 0.2, target, "surface", "tool on surface"))
        column = self.text.setdefault("surface", [""] * self.poses)
        for i in np.flatnonzero(rows):
            column[i] = name
        if not any(c["kind"] == "plane" for c in self.closed):
            self.close("tool on surface", "plane", "surface", PLAY)
            self.more["plane"] = [{"name": "surface", "unknown": ["surface"]}]

    def line(self) -> None:
        """An unknown line."""
        yaw, pitch = self.rng.uniform(-0.5, 0.5), self.rng.uniform(1.2, 1.5)
        self.values |= {
            "yaw@guide": yaw,
            "pitch@guide": pitch,
            "tilt1@guide": 0.0,
            "tilt2@guide": 0.0,
        }
        self.unknown("guide", self.tip.mean(axis=0))
        del self.fitted["x@guide"]  # it runs along x, nearly: which of its points is no matter
        self.fitted |= {"tilt1@guide": 1e-5, "tilt2@guide": 1e-5}
        self.closures.append((straight("guide", self.late), [PLAY, PLAY]))
        self.effects += [
            named(f"{w}@guide", 0.2, "guide", "tool on guide") for w in ("bend", "step")
        ]
        self.close("tool on guide", "line", "guide", PLAY)
        self.more["line"] = [{"name": "guide", "unknown": []}]

    def bar(self) -> None:
        """A bar of known length to an unknown point."""
        long = self.rng.uniform(250, 400)
        self.unknown("post", self.tip.mean(axis=0) + [0.3 * long, -0.3 * long, -0.6 * long])
        self.closures.append((ball("post", long, self.late), [PLAY]))
        self.effects.append(named("moved@post", 0.2, "post", "bar"))
        self.points.append({"name": "post", "unknown": []})
        self.close("bar", "distance", "post", PLAY, value=long)

    def sockets(self, rows: Array) -> None:
        """Two unknown sockets, and which of them the tool is in."""
        column = [""] * self.poses
        which = np.arange(self.poses) % 2
        for k in (0, 1):
            mine = rows * (which == k)
            at = self.tip[mine > 0].mean(axis=0)
            name = f"socket[at=s{k}]"
            self.unknown(name, at)
            self.closures.append((socket(name, mine, self.late), [PLAY] * 3))
            self.effects.append(named(f"moved@{name}", 0.2, name, "tool in socket", "socket"))
            for i in np.flatnonzero(mine):
                column[i] = f"s{k}"
        self.text["at"] = column
        self.points.append({"name": "socket", "unknown": ["at"]})
        self.close("tool in socket", "touch", "socket", PLAY)

    def tracker(self, rows: Array | None = None) -> None:
        """An instrument that stands somewhere and sees the tool."""
        rng = self.rng
        rows = np.ones(self.poses) if rows is None else rows
        six = [*rng.uniform(-2000, 2000, 3), *rng.uniform(-0.2, 0.2, 2), rng.uniform(-2, 2)]
        for c, value in zip(("x", "y", "z", "rx", "ry", "rz"), six, strict=True):
            self.values[f"{c}@tracker"] = float(value)
            self.fitted[f"{c}@tracker"] = 1e-5 if c.startswith("r") else 1e-2
        turn = oracle.roll_pitch_yaw(*six[3:])[:3, :3]
        self.measured = (self.tip - six[:3]) @ turn
        self.measured[rows == 0] = np.nan
        self.closures.append((seen(rows, self.late), [TRACKER] * 3))
        at = ("tracker", "tool at marker", "marker")
        self.effects.append(named("step@tracker", 0.2, *at))
        self.effects.append(named("scale@tracker", 3e-4, *at))
        self.points.append({"name": "marker", "columns": list(SEEN), "frame": "tracker"})
        self.close("tool at marker", "touch", "marker", TRACKER)
        self.more["frame"] = [{"name": "tracker", "unknown": []}]

    def unknown(self, name: str, at: Array) -> None:
        """A point that the mechanism file does not place."""
        for c, value in zip("xyz", at, strict=True):
            self.values[f"{c}@{name}"] = float(value)
            self.fitted[f"{c}@{name}"] = 1e-2

    def close(self, name: str, kind: str, to: str, noise: float, **more: float) -> None:
        """A closure of the mechanism file."""
        self.closed.append(
            {"name": name, "kind": kind, "between": ["tool", to], "noise": noise} | more
        )

    def machine(self, name: str) -> Machine:
        """All of it."""
        body, closures = self.body, self.closures
        measured = np.nan_to_num(self.measured)

        if self.warm:
            measured = np.column_stack([measured, day(self.rng, self.poses)])

        def gap(read: Array, places: Array, v: Values) -> Array:
            warm = read[:, -1] - read[:, -1].mean() if self.warm else 0.0
            tip = body.tip(read[:, :6], v, warm)
            return np.hstack([one(tip, read, v) for one, _ in closures])

        cols = JOINTS + (SEEN if self.measured.shape[1] else ()) + ((WARM,) if self.warm else ())
        still = np.zeros((self.poses, int(self.warm)), dtype=bool)
        return Machine(
            name=name,
            mechanism=self.mechanism(),
            columns=cols,
            sigma=np.array([NOISE] * 6 + [0.0] * measured.shape[1]),
            play=np.concatenate([p for _, p in closures]),
            gap=gap,
            start=np.hstack([self.q, measured]),
            gives=np.array([0.3] * 6 + [100.0] * self.measured.shape[1] + [0.0] * self.warm),
            values=self.values,
            fitted=self.fitted,
            effects=tuple(self.effects),
            text=self.text,
            empty=np.hstack([np.zeros_like(self.q, dtype=bool), np.isnan(self.measured), still]),
        )

    def mechanism(self) -> dict[str, Any]:
        """The mechanism file."""
        channels = [
            {"name": j, "unit": "rad", "gain": 1.0, "offset": 0.0, "limits": list(limits)}
            | {"noise": NOISE}
            for j, limits in zip(JOINTS, LIMITS, strict=True)
        ]
        return {
            "name": "arm",
            "length_unit": "mm",
            "gravity": [0.0, 0.0, -1.0],
            "channel": channels,
            "chain": [{"name": "arm", "dh": self.body.rows}],
            "point": self.points,
            "closure": self.closed,
            **self.more,
            "model": {"terms": ["offset"]},
        }


def named(value: str, typical: float, *targets: str) -> Effect:
    """An error of what an arm is held by: of a closure, or of where something stands."""
    return effect(value, "closure", typical, *targets, also=("geometry",))


def arm_effects(warm: bool) -> list[Effect]:
    """What the arm itself may have."""
    out = []
    for j in JOINTS:
        out += [
            effect(f"gain@{j}", "sensor", 1e-3, j),
            effect(f"curvature@{j}", "sensor", 2e-3, j),
            effect(f"once@{j}", "sensor", 1e-3, j),
            effect(f"drift@{j}", "sensor", 1e-3, j),
        ]
        if warm:
            out.append(effect(f"warm@{j}", "sensor", 3e-5, j))
    out += [effect(f"tilt@arm/{k}", "geometry", 1e-3, f"arm/{k}") for k in range(1, 6)]
    if warm:
        out += [effect(f"growth@arm/{k}", "geometry", 1e-2, f"arm/{k}") for k in range(2, 7)]
    out += [effect(f"a@arm/{k}", "geometry", 0.5, f"arm/{k}") for k in (2, 3)]
    out += [effect(f"d@arm/{k}", "geometry", 0.5, f"arm/{k}") for k in (4, 5)]
    out += [effect(f"compliance@{j}", "load", 2e-6, j, "all", "arm") for j in ("q2", "q3")]
    return out


def draw_plane(rng: Rng, poses: int = 60) -> Machine:
    """An arm that touches two surfaces."""
    job = Job(Body.random(rng), rng, poses)
    first = (np.arange(poses) % 2 == 0).astype(float)
    job.plane("table", first)
    job.plane("wall", 1 - first)
    return job.machine("plane")


def draw_line(rng: Rng, poses: int = 40) -> Machine:
    """An arm whose tool slides along a guide."""
    job = Job(Body.random(rng), rng, poses)
    job.line()
    return job.machine("line")


def draw_bar(rng: Rng, poses: int = 60) -> Machine:
    """An arm that holds a ball bar."""
    job = Job(Body.random(rng), rng, poses)
    job.bar()
    return job.machine("ball bar")


def draw_tracker(rng: Rng, poses: int = 30) -> Machine:
    """An arm before a tracker."""
    job = Job(Body.random(rng), rng, poses)
    job.tracker()
    return job.machine("tracker")


def draw_warm(rng: Rng) -> Machine:
    """The same in a hall whose temperature changes."""
    return draw_sockets(rng, warm=True)


def draw_sockets(rng: Rng, poses: int = 60, warm: bool = False) -> Machine:
    """An arm that touches a surface, and two sockets in every other pose."""
    job = Job(Body.random(rng), rng, poses, warm)
    first = (np.arange(poses) // 2 % 2 == 0).astype(float)
    job.plane("table", first)
    job.sockets(1 - first)
    return job.machine("plane and sockets")


def draw_seen_plane(rng: Rng, poses: int = 50) -> Machine:
    """An arm that touches a surface; a tracker sees every other touch."""
    job = Job(Body.random(rng), rng, poses)
    job.plane("table")
    job.tracker((np.arange(poses) % 2 == 0).astype(float))
    return job.machine("plane and tracker")
