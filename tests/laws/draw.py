"""The hand controller for the simulator of families, and five laws that couple joints or loads.

Each law is written twice: as the line of a mechanism file, and as a function on the matrices of
the simulator, which shares nothing with the core.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np

import rsicalib
from tests import oracle
from tests.families import linkage
from tests.families.device import Device, Effect, Scene
from tests.families.draw import Drawing, Rng
from tests.oracle import Array


def controller(rng: Rng) -> Drawing:
    """The hand controller, 48 poses of 8 samples."""
    mechanism = rsicalib.Mechanism.rsi().to_dict()
    mechanism.pop("rest", None)
    mechanism["gravity"] = [0.0, 0.0, -1.0]
    return Drawing(mechanism, 48, 8, np.full(9, 1.0), np.full(9, 0.03), gains=0.02)


@dataclass(frozen=True)
class Own:
    """A law in both forms, at a target."""

    entry: dict[str, Any]
    """The `[[term]]` of a mechanism file."""
    targets: Callable[[Device], list[str]]
    make: Callable[[Device, str], Effect]


def bend(term: str, klass: str, typical: float, law: Callable[[Device, Array, int], Array]) -> Any:
    """An effect on one joint, `size * law(device, q, joint)`."""

    def make(device: Device, target: str) -> Effect:
        i = device.names.index(target)

        def bends(size: float, q: Array, scene: Scene) -> Array:
            out = np.zeros(q.shape)
            out[:, i] = size * law(device, q, i)
            return out

        return Effect(term, klass, target, typical, bends=bends, told=f"{term}@{target}")

    return make


def joints(device: Device, channel: int) -> list[int]:
    """Columns of the joints of a channel's chain, base first."""
    names = device.names
    for chain in device.drawing.mechanism["chain"]:
        own = [names.index(row["channel"]) for row in chain["dh"] if "channel" in row]
        if channel in own:
            return own
    raise KeyError(channel)


def hanging(device: Device, q: Array, channel: int) -> Array:
    """Torque of a unit weight at the end of the chain about a joint."""
    return np.asarray(linkage.torques(device.build, q, of_tips=True)[:, channel])


def every(device: Device) -> list[str]:
    """All channels."""
    return device.names


def third(device: Device) -> list[str]:
    """The last joint of every chain of three."""
    return [device.names[joints(device, i)[2]] for i in range(0, len(device.names), 3)]


def stretch(device: Device, target: str) -> Effect:
    """A link that is longer where the third joint is turned: `size * theta_3` along x."""
    chain, row = target.split("/")
    k = int(row) - 1
    names = device.names
    entries = next(c["dh"] for c in device.drawing.mechanism["chain"] if c["name"] == chain)
    last = [names.index(r["channel"]) for r in entries if "channel" in r][2]
    twist = oracle.rotation("x", entries[k].get("alpha", 0.0))
    along = twist[:3, :3].T @ np.array([1.0, 0.0, 0.0])
    moved = Moving(chain, k, along, last)
    return Effect(
        "stretch",
        "geometry",
        target,
        0.01,
        builds=lambda size, build: Longer.of(build, moved, size),
        told=f"stretch@{target}",
    )


@dataclass(frozen=True)
class Moving:
    """Where a link grows, along what, and with which joint."""

    chain: str
    row: int
    along: Array
    joint: int


@dataclass(frozen=True)
class Longer(linkage.Build):
    """A build with a link that grows with a joint."""

    moving: Moving | None = None
    by: float = 0.0

    @classmethod
    def of(cls, build: linkage.Build, moving: Moving, by: float) -> Longer:
        """A build with one more such link."""
        plain = {name: getattr(build, name) for name in linkage.Build.__dataclass_fields__}
        return cls(**plain, moving=moving, by=by)

    def motion(self, chain: str, row: int, q: Array) -> Array:
        """The rigid motion behind a row, (4, 4) or (…, n, 4, 4)."""
        plain = super().motion(chain, row, q)
        if self.moving is None or (chain, row) != (self.moving.chain, self.moving.row):
            return plain
        out = np.tile(np.eye(4), (*q.shape[:-1], 1, 1))
        out[..., :3, 3] = self.by * q[..., self.moving.joint, None] * self.moving.along
        return np.asarray(plain @ out)


def entry(id: str, klass: str, per: str, typical: float, doc: str, **more: str) -> dict[str, Any]:
    """A `[[term]]`."""
    return {"id": id, "class": klass, "per": per, "parameters": {"c": typical}, "doc": doc, **more}


LAWS: dict[str, Own] = {
    "parallelogram": Own(
        entry(
            "parallelogram",
            "sensor",
            "channel",
            0.01,
            "A joint that is driven through the one before.",
            correction="c*sin(theta[1])*theta[2]",
        ),
        third,
        bend(
            "parallelogram",
            "sensor",
            0.01,
            lambda d, q, i: np.sin(q[:, joints(d, i)[0]]) * q[:, joints(d, i)[1]],
        ),
    ),
    "differential": Own(
        entry(
            "differential",
            "sensor",
            "channel",
            0.01,
            "Two joints on one differential.",
            correction="c*cos(theta[2] + theta[3])",
        ),
        lambda device: [n for n in device.names if n not in third(device)],
        bend(
            "differential",
            "sensor",
            0.01,
            lambda d, q, i: np.cos(q[:, joints(d, i)[1]] + q[:, joints(d, i)[2]]),
        ),
    ),
    "hardening": Own(
        entry(
            "hardening",
            "load",
            "channel",
            2e-3,
            "A joint that gives more than in proportion.",
            correction="c*torque*abs(torque)",
        ),
        every,
        bend(
            "hardening",
            "load",
            2e-3,
            lambda d, q, i: hanging(d, q, i) * np.abs(hanging(d, q, i)),
        ),
    ),
    "settled": Own(
        entry(
            "settled",
            "load",
            "channel",
            5e-3,
            "Play that lies where gravity presses it.",
            correction="c*tanh(torque/0.5)",
        ),
        every,
        bend("settled", "load", 5e-3, lambda d, q, i: np.tanh(hanging(d, q, i) / 0.5)),
    ),
    "stretch": Own(
        entry(
            "stretch",
            "geometry",
            "row",
            0.01,
            "A link that grows as the last joint turns.",
            moves="tx",
            amount="c*theta[3]",
        ),
        lambda device: [
            f"{chain['name']}/{row + 1}"
            for chain in device.drawing.mechanism["chain"]
            for row in (1, 2)
        ],
        stretch,
    ),
}
