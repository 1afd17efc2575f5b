"""A link or a distance that is longer in some poses than in others."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, fields

import numpy as np

from tests.families import linkage
from tests.families.device import Device
from tests.families.linkage import Build
from tests.oracle import Array

Law = Callable[[Array], Array]
"""Of joint coordinates, (n, channels), for each row a number."""


@dataclass(frozen=True)
class Place:
    """A row of a chain, counted from 0, and an axis after its joint; or a closure."""

    target: str
    closure: str = ""
    chain: str = ""
    row: int = 0
    axis: int = 0


@dataclass(frozen=True)
class Varying(Build):
    """A build with one place that is longer by a law."""

    place: Place = Place("")
    law: Law = np.zeros_like
    by: float = 0.0

    @classmethod
    def of(cls, build: Build, place: Place, law: Law, by: float) -> Varying:
        """A build with one more such place."""
        plain = {field.name: getattr(build, field.name) for field in fields(Build)}
        return cls(**plain, place=place, law=law, by=by)

    def motion(self, chain: str, row: int, q: Array) -> Array:
        """The rigid motion behind a row, (4, 4) or (…, n, 4, 4)."""
        plain = super().motion(chain, row, q)
        if (chain, row) != (self.place.chain, self.place.row):
            return plain
        rows = next(c["dh"] for c in self.mechanism["chain"] if c["name"] == chain)
        out = np.tile(np.eye(4), (*q.shape[:-1], 1, 1))
        along = linkage.body(rows[row])[self.place.axis, :3]
        out[..., :3, 3] = self.by * self.law(q)[..., None] * along
        return np.asarray(plain @ out)

    def more(self, closure: str, q: Array) -> Array:
        """What a distance is longer."""
        plain = super().more(closure, q)
        return plain if closure != self.place.closure else plain + self.by * self.law(q)


def places(device: Device) -> list[Place]:
    """Links behind the first joint of a chain, each along its drawn axes, and distances."""
    mechanism = device.drawing.mechanism
    out = []
    for chain in mechanism["chain"]:
        rows = chain["dh"]
        first = next(k for k, row in enumerate(rows) if "channel" in row)
        for k, row in list(enumerate(rows))[first:]:
            drawn = linkage.body(row)[:3, 3]
            out += [
                Place(f"{chain['name']}/{k + 1}", "", chain["name"], k, axis)
                for axis in range(3)
                if abs(drawn[axis]) > 1e-9
            ]
    distances = [c for c in mechanism["closure"] if c["kind"] == "distance"]
    out += [
        Place(c["name"], c["name"])
        for c in distances
        if not linkage.is_link(c) and not isinstance(c["value"], str)
    ]
    return out
