"""Channels that are exchanged or reversed, seen in the first poses of a session.

With the rest reading and nominal gains, six poses fit a mechanism in one way of its wires. A trace
needs more poses, and takes some of them for wrong readings before it names the wires.
"""

from __future__ import annotations

import itertools
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass

from rsicalib._core import Channel
from rsicalib.arrays import FloatArray

__all__ = ["Mistake", "mistaken"]

DECISIVE = 20.0
"""Without the mistake χ² is smaller by this factor than as it is wired, or without another one."""
NOISE = 6.0
"""Of χ² where the poses fit: six of them have some three equations to spare."""


@dataclass(frozen=True)
class Mistake:
    """What may have happened to the wires."""

    words: str
    undone: Callable[[FloatArray], FloatArray]
    """Rows of readings without the mistake."""


def mistaken(
    channels: Sequence[Channel], chi2: Callable[[Callable[[FloatArray], FloatArray]], float]
) -> str | None:
    """The mistake of wiring that explains why poses do not fit, in words; None where none does.

    `chi2` is that of the poses, with their rows of readings changed by a function.
    """
    if chi2(lambda rows: rows) < DECISIVE * NOISE:
        return None
    found = sorted((chi2(mistake.undone), mistake.words) for mistake in _mistakes(channels))
    (best, words), (second, _) = found[:2]
    return words if second > DECISIVE * max(best, NOISE) else None


def _mistakes(channels: Sequence[Channel]) -> Iterator[Mistake]:
    for pair in itertools.combinations(range(len(channels)), 2):
        first, second = (channels[k].name for k in pair)
        yield Mistake(
            f"{first} and {second} look exchanged: with their readings swapped the loop closes; "
            "check the wires, or the names of the columns, and begin again",
            _Exchanged(pair),
        )
    for k, channel in enumerate(channels):
        if channel.range is not None:
            yield Mistake(
                f"{channel.name} reads the wrong way round: reversed it closes the loop; exchange "
                "its outer wires, or reverse its gain in the mechanism, and begin again",
                _Reversed(k, sum(channel.range)),
            )


@dataclass(frozen=True)
class _Exchanged:
    pair: tuple[int, int]

    def __call__(self, rows: FloatArray) -> FloatArray:
        out = rows.copy()
        out[:, self.pair] = rows[:, self.pair[::-1]]
        return out


@dataclass(frozen=True)
class _Reversed:
    channel: int
    ends: float

    def __call__(self, rows: FloatArray) -> FloatArray:
        out = rows.copy()
        out[:, self.channel] = self.ends - rows[:, self.channel]
        return out
