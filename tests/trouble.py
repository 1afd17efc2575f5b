"""What goes wrong in a guided session: `python -m tests.trouble --sessions 20` has so many of each.

Counts how often the guide says the right thing before the session is done, and what it says
otherwise.
"""

from __future__ import annotations

import argparse
import secrets
import sys
import tempfile
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import ClassVar

import numpy as np

from tests import oracle, person
from tests.blind.effects import Effect
from tests.blind.effects.mishaps import BaseSlip
from tests.blind.effects.sensor import Slip
from tests.blind.planning import rate, wide_poses
from tests.blind.simulator import CHANNELS, TOP, Device
from tests.oracle import Array


@dataclass
class Trouble:
    """What goes wrong, from a pose on or at one pose, and how the guide should say so."""

    channel: int
    pose: int
    begins_again: ClassVar[bool] = True
    """Whether an operator who is told ends the session."""

    def effects(self, pose: int, late: bool) -> tuple[Effect, ...]:
        """Effects in this pose; `late` in the second half of it."""
        return ()

    def codes(self, codes: Array, pose: int) -> Array:
        """What is read instead."""
        return codes

    def said(self, text: str) -> bool:
        """Whether this names what went wrong."""
        raise NotImplementedError

    @property
    def name(self) -> str:
        """Of the channel."""
        return CHANNELS[self.channel]


@dataclass
class Slipped(Trouble):
    """A potentiometer that slips on its shaft by `size` [rad] before a pose."""

    size: float = 0.03

    def effects(self, pose: int, late: bool) -> tuple[Effect, ...]:
        """The slip from its pose on."""
        return (Slip(self.name, self.size, at=-1.0),) if pose >= self.pose else ()

    def said(self, text: str) -> bool:
        """By its channel."""
        return text.startswith((f"{self.name} slipped", f"{self.name} changes in the course"))


@dataclass
class DeadZone(Trouble):
    """A track that ends: beyond `last` the wiper stands on nothing, the converter at its end."""

    last: float = 3000.0
    begins_again: ClassVar[bool] = False

    def codes(self, codes: Array, pose: int) -> Array:
        """The end of the scale in place of what lies beyond."""
        out = codes.copy()
        out[:, self.channel] = np.where(out[:, self.channel] > self.last, TOP, out[:, self.channel])
        return out

    def said(self, text: str) -> bool:
        """By its channel."""
        return text.startswith(f"{self.name} is at the end of its range")


@dataclass
class Exchanged(Trouble):
    """Two channels whose wires are exchanged, from the start; `pose` is not used."""

    other: int = 0

    def codes(self, codes: Array, pose: int) -> Array:
        """Exchanged."""
        out = codes.copy()
        out[:, [self.channel, self.other]] = codes[:, [self.other, self.channel]]
        return out

    def said(self, text: str) -> bool:
        """By both channels."""
        both = sorted([self.name, CHANNELS[self.other]])
        return text.startswith(f"{both[0]} and {both[1]} look exchanged")


@dataclass
class Reversed(Trouble):
    """A channel whose outer wires are exchanged, from the start."""

    def codes(self, codes: Array, pose: int) -> Array:
        """The other way round."""
        out = codes.copy()
        out[:, self.channel] = TOP - out[:, self.channel]
        return out

    def said(self, text: str) -> bool:
        """By its channel."""
        return text.startswith(f"{self.name} reads the wrong way round")


@dataclass
class Leant(Trouble):
    """An arm that is pushed by `size` [in] half-way through one pose, and springs back after it."""

    size: float = 0.1
    begins_again: ClassVar[bool] = False

    def effects(self, pose: int, late: bool) -> tuple[Effect, ...]:
        """The push in the second half of its pose."""
        arm = f"arm{self.name[1]}"
        return (BaseSlip(arm, self.size, at=-1.0),) if pose == self.pose and late else ()

    def said(self, text: str) -> bool:
        """By its pose."""
        return text.startswith(f"pose {self.pose} does not fit") and "once more" in text


@dataclass
class Lost(Trouble):
    """A wire that comes off: the channel reads on what it read last."""

    _last: float | None = None

    def codes(self, codes: Array, pose: int) -> Array:
        """The last reading before."""
        if pose < self.pose:
            self._last = float(codes[-1, self.channel])
            return codes
        out = codes.copy()
        out[:, self.channel] = self._last
        return out

    def said(self, text: str) -> bool:
        """By its channel."""
        return text.startswith(f"{self.name} does not change")


def slipped(rng: np.random.Generator, device: Device) -> Trouble:
    """By 10 to 40 mrad, before pose 4 to 9."""
    size = float(rng.uniform(0.01, 0.04) * rng.choice([-1.0, 1.0]))
    return Slipped(int(rng.integers(9)), int(rng.integers(4, 10)), size)


def dead_zone(rng: np.random.Generator, device: Device) -> Trouble:
    """A track that lacks the last fifth of what the channel goes through."""
    channel = int(rng.integers(9))
    poses = wide_poses(rng, device, 400)
    angles = oracle.rsi_inverse(poses).reshape(-1, 9)
    counts = (angles - device.offsets) / device.gains
    return DeadZone(channel, 1, float(np.quantile(counts[:, channel], 0.8)))


def exchanged(rng: np.random.Generator, device: Device) -> Trouble:
    """Any two."""
    first, second = rng.choice(9, 2, replace=False)
    return Exchanged(int(first), 1, int(second))


def reversed_(rng: np.random.Generator, device: Device) -> Trouble:
    """Any."""
    return Reversed(int(rng.integers(9)), 1)


def leant(rng: np.random.Generator, device: Device) -> Trouble:
    """By 0.05 to 0.2 in, at a pose that is fitted."""
    size = float(rng.uniform(0.05, 0.2))
    return Leant(int(rng.integers(9)), int(rng.choice([2, 3, 5, 6, 7, 9])), size)


def lost(rng: np.random.Generator, device: Device) -> Trouble:
    """At pose 3 to 9."""
    return Lost(int(rng.integers(9)), int(rng.integers(3, 10)))


KINDS: dict[str, Callable[[np.random.Generator, Device], Trouble]] = {
    "slipped": slipped,
    "dead_zone": dead_zone,
    "exchanged": exchanged,
    "reversed": reversed_,
    "leant": leant,
    "lost": lost,
}


@dataclass(frozen=True)
class Told:
    """What a session with a trouble came to."""

    trouble: Trouble
    right: int | None
    """Poses taken when the right thing was said."""
    wrong: tuple[str, ...]
    """What else was said."""
    poses: int
    verdict: str | None


def drawn(kind: str, seed: Sequence[int]) -> person.Operator:
    """A person at a device with a trouble of this kind."""
    rng = np.random.default_rng(seed)
    device = Device.random(rng)
    return person.Operator(device, (), rng, trouble=KINDS[kind](rng, device))


def session(
    operator: person.Operator, target: float = 0.003, most: int = 24, to_the_end: bool = True
) -> Told:
    """A guided session in which the operator's trouble happens.

    It goes on after what can be repeated was said, unless nobody asks what came `to_the_end`.
    """
    trouble = operator.trouble
    assert trouble is not None

    def enough(state: person.State) -> bool:
        return (trouble.begins_again or not to_the_end) and any(
            trouble.said(told["text"]) for told in state["troubles"]
        )

    with tempfile.TemporaryDirectory() as folder:
        taken, _ = person.guided(operator, Path(folder) / "o", target, enough, most=most)
    said = operator.said
    right = [poses for text, poses in said.items() if trouble.said(text)]
    wrong = tuple(f"{poses}: {text}" for text, poses in said.items() if not trouble.said(text))
    state = taken.state()
    return Told(trouble, min(right, default=None), wrong, state["taken"], state["verdict"])


def main() -> int:
    """Guide sessions in which something goes wrong, and print what was said."""
    parser = argparse.ArgumentParser(description="guided sessions in which something goes wrong")
    parser.add_argument("--sessions", type=int, default=20)
    parser.add_argument("--kinds", nargs="+", default=list(KINDS), choices=list(KINDS))
    parser.add_argument("--seed", type=int)
    args = parser.parse_args()
    seed = secrets.randbits(32) if args.seed is None else args.seed
    print(f"seed {seed}", flush=True)
    for kind in args.kinds:
        own: list[Told] = []
        for k in range(args.sessions):
            own.append(session(drawn(kind, (seed, list(KINDS).index(kind), k))))
            print(k, own[-1], flush=True)
        late = [f.right for f in own if f.right is not None]
        print(
            f"{kind}: said right {rate([f.right is not None for f in own])}, "
            f"after {np.median(late) if late else np.nan:.0f} poses; "
            f"done in {np.median([f.poses for f in own]):.0f}; "
            f"something else said {rate([bool(f.wrong) for f in own])}; "
            f"done and nothing said {rate([f.right is None and not f.wrong for f in own])}"
        )
    return 0


if __name__ == "__main__":
    sys.exit(main())
