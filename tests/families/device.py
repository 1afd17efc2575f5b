"""A machine with a known truth, the session that is taken with it, and what its sensors read."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from tests.families import linkage
from tests.families.draw import FAMILIES, Drawing, Rng
from tests.families.linkage import Build
from tests.oracle import Array

SESSION_S = 1200.0
SAMPLE_S = 0.05
TOLERANCE = 1e-10
"""How far a closed loop may be open, in parts of the size of the machine."""


@dataclass(frozen=True)
class Scene:
    """Rows in the order in which they were read.

    `q` (n, channels) is where the loop is closed from; `before` the row of the pose before (-1:
    parked at mid-range); `turn` time from 0 to 1; `warmth` the temperature above its mean [K].
    """

    q: Array
    label: Array
    before: Array
    turn: Array
    warmth: Array
    group: tuple[str, ...] = ()
    at: tuple[str, ...] = ()

    @property
    def poses(self) -> int:
        """Number of poses."""
        return int(self.label.max())

    def direction(self, middle: Array) -> Array:
        """Sign of the change of every joint from the pose before: (n, channels)."""
        past = np.where(self.before[:, None] < 0, middle, self.q[self.before])
        return np.asarray(np.sign(self.q - past))


@dataclass(frozen=True)
class Effect:
    """Something that the drawing lacks; what it does is linear in `size` to first order.

    `builds` changes what was built, `bends` adds to the joint coordinates that readings stand for,
    `reads` to the readings. `bound` is tied to the time of its session; `rows` are the rows that a
    mishap spoils; `told` how the library is told of it.
    """

    term: str
    klass: str
    target: str
    typical: float
    builds: Callable[[float, Build], Build] | None = None
    bends: Callable[[float, Array, Scene], Array] | None = None
    reads: Callable[[float, Array, Scene], Array] | None = None
    last: bool = False
    """What it does to readings is done to those with noise on them."""
    size: float = 1.0
    outside: bool = False
    bound: bool = False
    rows: tuple[int, ...] = ()
    told: str | None = None


def built(build: Build, effects: Sequence[Effect]) -> Build:
    """A machine with every effect on it."""
    for effect in effects:
        if effect.builds is not None:
            build = effect.builds(effect.size, build)
    return build


@dataclass(frozen=True)
class Device:
    """One machine of a family: `q = gains * reading + offsets`."""

    drawing: Drawing
    offsets: Array
    gains: Array

    @classmethod
    def random(cls, family: str, rng: Rng) -> Device:
        """A drawing of the family, and sensors that are clamped and scaled by chance."""
        drawing = FAMILIES[family](rng)
        channels = drawing.mechanism["channel"]
        n = len(channels)
        gain = np.array([c["gain"] for c in channels], dtype=float)
        offset = np.array([c["offset"] for c in channels], dtype=float)
        gains = gain * (1 + drawing.gains * np.clip(rng.standard_normal(n), -2, 2))
        middle = np.array([np.mean(c.get("range", [0.0, 0.0])) for c in channels])
        shifts = drawing.scatter * np.clip(rng.standard_normal(n), -2, 2)
        return cls(drawing, offset + gain * middle + shifts - gains * middle, gains)

    @property
    def names(self) -> list[str]:
        """Channels."""
        return linkage.names(self.drawing.mechanism)

    @property
    def build(self) -> Build:
        """As drawn."""
        return Build(self.drawing.mechanism)

    @property
    def steps(self) -> Array:
        """Small changes of the joint coordinates: 10 µrad, or as small a part of a slide."""
        low, high = linkage.limits(self.drawing.mechanism)
        sliding = linkage.slides(self.drawing.mechanism)
        slide = np.array([sliding[name] for name in self.names])
        return np.asarray(np.where(slide, 1e-5 * (high - low) / 2, 1e-5))

    @property
    def length(self) -> float:
        """The longest dimension of the drawing."""
        rows = [row for chain in self.drawing.mechanism["chain"] for row in chain["dh"]]
        return float(max(abs(row.get(key, 0.0)) for row in rows for key in ("a", "d")))

    @property
    def noise(self) -> Array:
        """True standard deviation of one reading, rounding included: (channels,)."""
        units = [c["unit"] for c in self.drawing.mechanism["channel"]]
        rounding = np.array([1 / 12 if unit == "count" else 0.0 for unit in units])
        return np.asarray(np.sqrt(self.drawing.sigma**2 + rounding))

    def where(self, scene: Scene, places: dict[tuple[str, str], Array] | None = None) -> Any:
        """Places of unknown points, row by row."""
        places = self.drawing.sockets if places is None else places
        if places is None:
            return {}
        at = np.array([places[key] for key in zip(scene.group, scene.at, strict=True)])
        return {p["name"]: at for p in self.drawing.mechanism["point"] if "unknown" in p}

    @property
    def measured(self) -> dict[str, Any] | None:
        """The closure whose distance is a column, where there is one."""
        for closure in self.drawing.mechanism["closure"]:
            if isinstance(closure.get("value"), str):
                found: dict[str, Any] = closure
                return found
        return None

    def closed(
        self, scene: Scene, effects: Sequence[Effect] = (), play: Array | None = None
    ) -> Array:
        """Joint coordinates of what was built, the loop closed: (n, channels)."""
        if self.measured is not None:
            return scene.q
        first = np.flatnonzero(np.diff(scene.label, prepend=0)) if play is None else slice(None)
        build = built(self.build, effects)
        where = {name: at[first] for name, at in self.where(scene).items()}
        open_by = 0.0 if play is None else play

        def gap(q: Array) -> Array:
            return linkage.misclosure(build, q, where) - open_by

        q = linkage.close(gap, scene.q[first], self.steps, TOLERANCE * self.length)
        if np.isnan(q).any():
            raise ValueError("what was built does not reach every pose")
        return q if play is not None else np.asarray(q[scene.label - 1])

    def ideal(
        self, scene: Scene, effects: Sequence[Effect] = (), play: Array | None = None
    ) -> tuple[Array, dict[str, Array]]:
        """Readings before noise, (n, channels), and the measured distances."""
        q = self.closed(scene, effects, play)
        law = [e.bends(e.size, q, scene) for e in effects if e.bends is not None]
        readings = (q - np.sum(law, axis=0) - self.offsets) / self.gains if law else None
        if readings is None:
            readings = (q - self.offsets) / self.gains
        for effect in effects:
            if effect.reads is not None:
                readings = readings + effect.reads(effect.size, readings, scene)
        columns = {}
        if self.measured is not None:
            build = built(self.build, effects)
            gap = linkage.apart(build, linkage.points(build, q), self.measured)
            longer = build.longer.get(self.measured["name"], 0.0)
            columns[self.measured["value"]] = np.linalg.norm(gap, axis=1) - longer
        return np.asarray(readings), columns

    def misclosure(
        self,
        scene: Scene,
        readings: Array,
        columns: dict[str, Array],
        effects: Sequence[Effect] = (),
        shift: Sequence[float] | Array = (),
    ) -> Array:
        """What the true law, with these effects in it, makes of readings: (n, equations).

        `shift` is added to offsets, relative gains and unknown places, one after the other.
        """
        n = len(self.names)
        more = np.zeros(2 * n + 3 * len(self.drawing.sockets or {}))
        more[: len(shift)] = shift
        for effect in effects:
            if effect.reads is not None:
                readings = readings - effect.reads(effect.size, readings, scene)
        q = self.gains * readings * (1 + more[n : 2 * n]) + self.offsets + more[:n]
        law = [e.bends(e.size, q, scene) for e in effects if e.bends is not None]
        q = q + np.sum(law, axis=0) if law else q
        places = {
            key: at + more[2 * n + 3 * k : 2 * n + 3 * k + 3]
            for k, (key, at) in enumerate((self.drawing.sockets or {}).items())
        }
        return linkage.misclosure(
            built(self.build, effects), q, self.where(scene, places or None) | columns
        )

    def points(self, scene: Scene, effects: Sequence[Effect]) -> dict[str, Array]:
        """Where the carried points really are."""
        build = built(self.build, effects)
        found = linkage.points(build, self.closed(scene, effects), self.where(scene))
        return {
            p["name"]: found[p["name"]] for p in self.drawing.mechanism["point"] if "chain" in p
        }


def stage(device: Device, rng: Rng, poses: int | None = None, samples: int | None = None) -> Scene:
    """Poses within limits at which the drawn loop closes, in random order, sample by sample."""
    drawing = device.drawing
    count = drawing.poses if poses is None else poses
    repeats = drawing.samples if samples is None else samples
    keys = list(drawing.sockets) if drawing.sockets else [("", "")]
    found = [one_place(device, rng, count, key) for key in keys]
    q = np.repeat(np.concatenate(found), repeats, axis=0)
    total = count * len(keys)
    label = np.repeat(np.arange(1, total + 1), repeats)
    turn = np.linspace(0.0, 1.0, total)[label - 1]
    swing, pace = rng.uniform(0.8, 1.8), rng.uniform(7.0, 11.0)
    warmth = 5.0 * turn + swing * np.sin(pace * turn)
    named = [key for key in keys for _ in range(count * repeats)] if drawing.sockets else []
    return Scene(
        q=q,
        label=label,
        before=np.where(label > 1, (label - 2) * repeats, -1),
        turn=turn,
        warmth=warmth - warmth.mean(),
        group=tuple(group for group, _ in named),
        at=tuple(at for _, at in named),
    )


def one_place(device: Device, rng: Rng, count: int, key: tuple[str, str]) -> Array:
    """Closed configurations within limits, and clear of them by a fiftieth: (count, channels)."""
    low, high = linkage.limits(device.drawing.mechanism)
    margin = 0.02 * (high - low)
    kept: list[Array] = []
    for _ in range(200):
        q = rng.uniform(low + margin, high - margin, (2 * count + 20, len(low)))
        n = len(q)
        nothing = np.zeros(n)
        key_of_rows = Scene(
            q,
            np.arange(1, n + 1),
            np.arange(-1, n - 1),
            nothing,
            nothing,
            (key[0],) * n,
            (key[1],) * n,
        )
        if device.measured is None:
            where = device.where(key_of_rows)
            build = device.build

            def gap(x: Array, build: Build = build, where: Any = where) -> Array:
                return linkage.misclosure(build, x, where)

            with np.errstate(all="ignore"):
                q = linkage.close(gap, q, device.steps, TOLERANCE * device.length)
        with np.errstate(invalid="ignore"):
            inside = np.all((q > low + margin) & (q < high - margin), axis=1)
        kept += list(q[inside])
        if len(kept) >= count:
            return np.array(kept[:count])
    raise ValueError(f"only {len(kept)} of {count} poses close within limits")


@dataclass(frozen=True)
class Session:
    """What a file of readings holds."""

    scene: Scene
    values: Array
    columns: dict[str, Array]
    held: bool
    warm: bool

    def changed(self, values: Array) -> Session:
        """Other readings in the same rows."""
        return Session(self.scene, values, self.columns, self.held, self.warm)


def observe(device: Device, scene: Scene, rng: Rng, effects: Sequence[Effect] = ()) -> Session:
    """A session, with the noise of sensors and the play of closures."""
    drawing = device.drawing
    play = None
    if drawing.play and device.measured is None:
        equations = linkage.misclosure(device.build, scene.q, device.where(scene)).shape[1]
        # One draw for each seating: all samples of a pose share it.
        _, seating = np.unique(scene.label, return_inverse=True)
        draws = rng.standard_normal((int(seating.max()) + 1, equations))
        play = drawing.play * draws[seating]
    values, columns = device.ideal(scene, [e for e in effects if not e.last], play)
    values = values + drawing.sigma * rng.standard_normal(values.shape)
    for effect in effects:
        if effect.last and effect.reads is not None:
            values = values + effect.reads(effect.size, values, scene)
    for k, channel in enumerate(drawing.mechanism["channel"]):
        if channel["unit"] == "count":
            values[:, k] = np.clip(np.rint(values[:, k]), *channel["range"])
    columns = {
        name: column + drawing.play * rng.standard_normal(len(column))
        for name, column in columns.items()
    }
    return Session(scene, values, columns, drawing.held, drawing.warm)
