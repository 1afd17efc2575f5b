"""Whether a hand stands still: the last samples, and how much they spread.

Where the loops of a mechanism are closed whatever the hand does, its tremor does no harm. Where
they are closed by what it touches, samples count from where it came to rest: until then they are of
the way there.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Sequence

import numpy as np

from rsicalib._core import still_stretches
from rsicalib.arrays import FloatArray
from rsicalib.guide.log import Sample

LONGER = 3.0
"""A pose that is not the one asked for is taken when it is held so many times as long; so is one in
which a hand trembles that touches something."""

STILL = 0.004
"""Spread of a hand that holds, as a share of what a channel can read: 16 counts of 4096."""
SHAKY = 0.02
"""The same of a hand that cannot be still where it is, at the most: near a stretched arm a small
tremor of the handle is a large one of its elbow."""
LATEST = 20
"""Samples of which the tremor of a hand is told."""
TREMOR = 2.0
"""A tremor is allowed so many times its standard deviation: it varies."""


LAST = 1000
"""So many samples are looked at."""


class Hold:
    """The last samples of a hand that moves, holds and moves on."""

    def __init__(
        self,
        spans: FloatArray,
        samples: int,
        seconds: float,
        *,
        closed: bool = True,
        trembling: bool = False,
    ) -> None:
        self.spans = spans
        self.closed = closed
        """Whether loops are closed in motion, too."""
        self.trembling = trembling
        """Whether a tremor is stillness at once: for places where a hand has been."""
        self.loose = STILL * spans
        self.samples = samples
        self.seconds = seconds
        self._last: deque[Sample] = deque(maxlen=LAST)
        self._all: deque[Sample] = deque(maxlen=LAST)
        """Those before a motion, too: they tell what the noise of a channel is."""
        self._held: list[Sample] = []

    def feed(self, sample: Sample) -> None:
        """Take one more sample; those before a motion are forgotten."""
        if self._last and sample.time_s < self._last[-1].time_s:
            self._last.clear()
            self._all.clear()
        self._last.append(sample)
        self._all.append(sample)
        if self.trembling:
            self._tremble()
        if len(self._last) >= 4 and self._moves():
            while len(self._last) > 2 and self._moves():
                self._last.popleft()
        self._held = list(self._last) if self.closed else self._at_rest()

    def clear(self) -> None:
        """Forget all: a pose was taken."""
        self._last.clear()
        self._held = []
        self.loose = STILL * self.spans

    def allow(self, spread: FloatArray) -> None:
        """Take a tremor of this spread of each channel for stillness, up to a limit."""
        self.loose = np.clip(spread, self.loose, SHAKY * self.spans)

    @property
    def now(self) -> FloatArray | None:
        """Mean of the last few samples: shape (C,)."""
        if not self._last:
            return None
        now: FloatArray = np.mean([s.values for s in list(self._last)[-4:]], axis=0)
        return now

    @property
    def held_s(self) -> float:
        """For how long the hand has stood still [s]."""
        return self._last[-1].time_s - self._last[0].time_s if self._last else 0.0

    @property
    def progress(self) -> float:
        """From 0 to 1, where a pose can be taken."""
        held = self._held
        if len(held) < 2:
            return 0.0
        count = len(held) / self.samples
        long = (held[-1].time_s - held[0].time_s) / self.seconds if self.seconds else 1.0
        return float(min(1.0, count, long))

    def taken(self) -> list[Sample]:
        """Samples of the pose that is held, evenly from the time that it was held."""
        every = self._held
        picked = np.linspace(0, len(every) - 1, self.samples).round().astype(int)
        return [every[k] for k in np.unique(picked)]

    def _at_rest(self) -> list[Sample]:
        """Samples since the channels are still in their own noise; of a hand that goes on
        trembling, those of the second half.
        """
        every, count = list(self._all), len(self._last)
        if count < self.samples:
            return []
        values, times = np.array([s.values for s in every]), np.array([s.time_s for s in every])
        least = (self.samples - 1) * float(np.median(np.diff(times)))  # where they come slowly
        hold = max(self.seconds, least)
        first, found = len(every) - count, still_stretches(values, times, hold)
        if found and found[-1][1] > first:  # else it is on its way from there
            return every[max(found[-1][0], first) :] if found[-1][1] == len(every) else []
        return every[-count // 2 :] if self.held_s >= LONGER * self.seconds else []

    def _tremble(self) -> None:
        """Let the tremor be what neighbouring samples differ by: a motion changes them alike."""
        latest = np.array([s.values for s in list(self._all)[-LATEST:]])
        if len(latest) == LATEST:
            self.loose = STILL * self.spans
            self.allow(TREMOR * np.diff(latest, axis=0).std(axis=0) / np.sqrt(2.0))

    def _moves(self) -> bool:
        values = np.array([s.values for s in self._last])
        half = len(values) // 2
        creep = np.abs(values[half:].mean(axis=0) - values[:half].mean(axis=0))
        return bool(np.any(values.std(axis=0) > self.loose) or np.any(creep > self.loose))


def apart(
    a: Sequence[float] | FloatArray, b: Sequence[float] | FloatArray, spans: FloatArray
) -> float:
    """Distance of two rows of readings: root mean square of shares of what channels can read."""
    return float(np.sqrt(np.mean(((np.asarray(a) - np.asarray(b)) / spans) ** 2)))
