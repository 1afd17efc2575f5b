"""How visible an effect is, by numerical linearisation; sizes to order; twins that no data tell."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from tests.families import linkage
from tests.families.device import Device, Effect, Scene
from tests.families.effects import CATALOGUE, MOST, possible
from tests.oracle import Array

TWIN = 1.0
"""Where another effect leaves less noncentrality than this, no method can tell the two apart."""


class Linear:
    """The true law about the true readings of a scene: whitened, and what is fitted."""

    def __init__(self, device: Device, scene: Scene) -> None:
        self.device, self.scene = device, scene
        self.readings, self.columns = device.ideal(scene)
        drawing = device.drawing
        steps = device.steps / np.abs(device.gains)
        slope = linkage.row_slope(
            lambda a: device.misclosure(scene, a, self.columns), self.readings, steps
        )
        cover = (slope * device.noise**2) @ np.swapaxes(slope, 1, 2)
        cover = cover + drawing.play**2 * np.eye(cover.shape[1])
        self.play_share = drawing.play**2 / float(np.mean(np.diagonal(cover, axis1=1, axis2=2)))
        sizes, axes = np.linalg.eigh(cover)
        seen = sizes > 1e-9 * sizes[:, -1:]
        roots = np.where(seen, 1 / np.sqrt(np.where(seen, sizes, 1.0)), 0.0)
        self.white = roots[:, :, None] * np.swapaxes(axes, 1, 2)
        self.fitted = self.base(self.model_columns())

    def base(self, columns: Array) -> Array:
        """An orthonormal base of columns."""
        long = np.linalg.norm(columns, axis=0)
        columns = columns[:, long > 0] / long[long > 0]
        left, sizes, _ = np.linalg.svd(columns, full_matrices=False)
        return np.asarray(left[:, sizes > 1e-9 * sizes[:1]])

    def whitened(self, misclosure: Array, links: Array | None = None) -> Array:
        """One long vector, the distances between unknown points behind."""
        samples = np.einsum("nij,nj->ni", self.white, misclosure).ravel()
        return np.concatenate([samples, self.links(()) if links is None else links])

    def links(self, shift: Sequence[float] | Array) -> Array:
        """Distances between unknown points, from the declared ones, in standard deviations."""
        drawing, n = self.device.drawing, 2 * len(self.device.names)
        places = {key: at.copy() for key, at in (drawing.sockets or {}).items()}
        for k, key in enumerate(places):
            if len(shift):
                places[key] = places[key] + np.asarray(shift)[n + 3 * k : n + 3 * k + 3]
        out = []
        for closure in drawing.mechanism["closure"]:
            if linkage.is_link(closure):
                ends = [name.split("=")[1].rstrip("]") for name in closure["between"]]
                for group in dict.fromkeys(group for group, _ in places):
                    gap = np.linalg.norm(places[group, ends[0]] - places[group, ends[1]])
                    out.append((gap - closure["value"]) / closure["sd"])
        return np.array(out)

    def model_columns(self) -> Array:
        """Derivatives by what the model identifies, and by unknown places."""
        device = self.device
        n, names = len(device.names), device.names
        asked = [term.partition("@") for term in device.drawing.mechanism["model"]["terms"]]
        kinds = {"offset": (0, device.steps), "gain": (n, np.full(n, 1e-6))}
        moves: list[tuple[int, float]] = []
        for term, _, at in asked:
            first, steps = kinds[term]
            wanted = range(n) if not at else [names.index(at)]
            moves += [(first + i, float(steps[i])) for i in wanted]
        unknown = 3 * len(device.drawing.sockets or {})
        moves += [(2 * n + k, 1e-5 * device.length) for k in range(unknown)]
        columns = []
        for k, step in moves:
            ends = []
            for sign in (1.0, -1.0):
                shift = np.zeros(2 * n + unknown)
                shift[k] = sign * step
                gap = device.misclosure(self.scene, self.readings, self.columns, shift=shift)
                ends.append(self.whitened(gap, self.links(shift)))
            columns.append((ends[0] - ends[1]) / (2 * step))
        return np.stack(columns, axis=1)

    def column(self, effect: Effect) -> Array:
        """Derivative by the size of an effect, in typical sizes."""
        small = replace(effect, size=1e-3 * effect.typical)
        gap = self.device.misclosure(self.scene, self.readings, self.columns, [small])
        return np.asarray((self.whitened(gap) - self.rest) * 1e3)

    @property
    def rest(self) -> Array:
        """What the true law leaves: zero, to rounding."""
        return self.whitened(self.device.misclosure(self.scene, self.readings, self.columns))

    def left(self, vector: Array, others: Sequence[Effect] = ()) -> Array:
        """A vector off what is fitted, and off the sizes of other effects."""
        base = self.fitted
        if others:
            more = [self.column(other) for other in others]
            base = self.base(np.column_stack([base, *more]))
        return np.asarray(vector - base @ (base.T @ vector))

    def mean(self, effect: Effect) -> Array:
        """What an effect of its size leaves in the misclosure of the law without it."""
        readings, columns = self.device.ideal(self.scene, [effect])
        return self.whitened(self.device.misclosure(self.scene, readings, columns)) - self.rest

    def by_pose(self, effect: Effect, others: Sequence[Effect] = ()) -> Array:
        """The noncentrality of every pose, the first first."""
        left, label = self.left(self.mean(effect), others), self.scene.label
        of_rows = left[: len(label) * self.white.shape[1]].reshape(len(label), -1)
        return np.bincount(label - 1, np.sum(of_rows**2, axis=1))

    def is_of_few_poses(self, effect: Effect, others: Sequence[Effect] = ()) -> bool:
        """Whether two poses see half of it or more: then it is two bad readings."""
        seen = np.sort(self.by_pose(effect, others))
        return bool(seen[-2:].sum() > 0.5 * seen.sum())

    def noncentrality(self, effect: Effect, others: Sequence[Effect] = ()) -> float:
        """By how much χ² of lack of fit grows on average."""
        left = self.left(self.mean(effect), others)
        return float(left @ left)

    def scaled(self, effect: Effect, wanted: float, others: Sequence[Effect] = ()) -> Effect:
        """The effect at the size whose noncentrality is `wanted`; `ValueError` where absurd."""
        effect = replace(effect, size=0.1 * effect.typical)
        for _ in range(12):
            now = self.noncentrality(effect, others)
            if now < 1e-9:
                raise ValueError(f"{effect.term} at {effect.target} does not show")
            if abs(now / wanted - 1) < 0.03:
                break
            factor = float(np.clip(np.sqrt(wanted / now), 1e-2, 30.0))
            effect = replace(effect, size=effect.size * factor)
            if abs(effect.size) > MOST * effect.typical:
                raise ValueError(f"{effect.term} at {effect.target} would be unreasonable")
        else:
            raise ValueError(f"{effect.term} at {effect.target} has no such size")
        return effect

    def twins(self, effect: Effect, others: Sequence[Effect] = ()) -> set[tuple[str, str]]:
        """Class and target of all in the catalogue that explain the effect as well as itself.

        Terms of several parameters have all of them: each is drawn a few times.
        """
        rng = np.random.default_rng(0)
        left = self.left(self.mean(effect), others)
        out = set()
        for term, target in possible(self.device, CATALOGUE):
            many = term in ("joint_tilt", "base_tilt", "base_position", "point_position")
            draws = [CATALOGUE[term](self.device, rng, target) for _ in range(3 if many else 1)]
            if term.endswith("per_turn"):
                draws += [CATALOGUE[term](self.device, rng, target) for _ in range(1)]
            if term == "slip" or term == "crosstalk":
                continue
            own = np.column_stack([self.left(self.column(e), others) for e in draws])
            long = np.linalg.norm(own, axis=0)
            if not np.all(long > 1e-6):
                continue
            rest = left - own / long @ np.linalg.lstsq(own / long, left, rcond=1e-9)[0]
            if float(rest @ rest) < TWIN:
                out.add((draws[0].klass, target))
        return out
