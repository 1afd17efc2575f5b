"""What an effect is: where it touches the device, how large it is, and what it is called.

Every hook does nothing unless an effect overrides it; an effect of size 0 does nothing at all.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any, ClassVar

import numpy as np

from tests.blind.geometry import Geometry
from tests.blind.scene import Scene
from tests.oracle import Array

CHANNELS = tuple(f"a{i}{j}" for i in (1, 2, 3) for j in (1, 2, 3))
ARMS = ("arm1", "arm2", "arm3")
SIDES = ("wrist1-wrist2", "wrist2-wrist3", "wrist1-wrist3")


def unit_counts(counts: Array) -> Array:
    """`u = (a - 2048)/1000`, the reading in thousands of counts from the middle."""
    out: Array = (counts - 2048.0) / 1000.0
    return out


@dataclass(frozen=True)
class Effect:
    """One physical effect on one target.

    `term`, `kind` and `target` are the words of the result (`kind` is its `class`); `sizes` the
    realistic range of `size`, in `unit`; `signed` whether it comes with both signs.
    """

    target: str
    size: float

    term: ClassVar[str] = ""
    kind: ClassVar[str] = ""
    unit: ClassVar[str] = ""
    sizes: ClassVar[tuple[float, float]] = (0.0, 0.0)
    targets: ClassVar[tuple[str, ...]] = CHANNELS
    signed: ClassVar[bool] = True
    mishap: ClassVar[bool] = False
    """Belongs to one session, not to the device: absent from rest and check readings."""
    bends: ClassVar[bool] = False
    """Overrides `law`."""
    loose: ClassVar[bool] = False
    """Overrides `play`."""
    moving: ClassVar[bool] = False
    """Shows in recordings only."""
    recorded: ClassVar[bool] = True
    """Shows in recordings as well."""
    outside: ClassVar[bool] = False
    """Not in any reasonable catalogue: only the target can be graded."""

    @classmethod
    def draw(cls, rng: np.random.Generator, target: str | None = None) -> Effect:
        """A random target and size, log-uniform in the realistic range."""
        target = str(rng.choice(cls.targets)) if target is None else target
        size = float(np.exp(rng.uniform(*np.log(cls.sizes))))
        if cls.signed:
            size *= float(rng.choice([-1.0, 1.0]))
        return cls(target, size, **cls.details(rng))

    @classmethod
    def details(cls, rng: np.random.Generator) -> dict[str, Any]:
        """Further fields: phases, times, directions."""
        return {}

    def told(self) -> str | None:
        """How the library is told of it; None for what its terms cannot say beforehand."""
        return None if self.outside or self.mishap else f"{self.term}@{self.target}"

    def resized(self, size: float) -> Effect:
        """The same effect, larger or smaller."""
        return replace(self, size=float(size))

    @property
    def kinds(self) -> frozenset[str]:
        """Classes under which it may be named."""
        return frozenset({self.kind})

    @property
    def channel(self) -> int:
        """Column of the target channel."""
        return CHANNELS.index(self.target)

    @property
    def arm(self) -> int:
        """Index of the target arm, of a target such as `arm2` or `arm2/3`."""
        return ARMS.index(self.target.split("/")[0])

    @property
    def row(self) -> int:
        """Index of the target row, of a target such as `arm2/3` (which is row 2)."""
        return int(self.target.split("/")[1]) - 1

    @property
    def equivalents(self) -> frozenset[str]:
        """Targets under which the very same thing may be named, by another parametrisation."""
        return frozenset({self.target})

    def only(self, column: Array, like: Array) -> Array:
        """Zeros of the shape of `like`, (n, 9), but for the target channel."""
        out = np.zeros_like(like)
        out[:, self.channel] = column
        return out

    def geometry(self, geometry: Geometry) -> Geometry:
        """What was built."""
        return geometry

    def play(self, scene: Scene) -> Array:
        """Displacement of the wrists from where a rigid handle has them, (n, 3, 3) [in]."""
        return np.zeros((len(scene.label), 3, 3))

    def shafts(self, angles: Array, scene: Scene, rest: Array) -> Array:
        """Angles of the sensors' shafts, (n, 9), given those of the joints; `rest` is (9,)."""
        return angles

    def law(self, counts: Array, scene: Scene) -> Array:
        """What is missing in `θ = k a + off` at true readings `counts`, (n, 9) [rad]."""
        return np.zeros_like(counts)

    def electronics(self, counts: Array, scene: Scene, change: Array) -> Array:
        """Readings after the electronics; `change`, (n, 9), since the pose before."""
        return counts

    def codes(self, codes: Array) -> Array:
        """Integer codes as the converter gives them."""
        return codes
