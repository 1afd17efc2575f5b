"""What follows from the estimate of one parameter."""

from __future__ import annotations

from rsicalib import _core

__all__ = ["Estimate"]


class Estimate:
    """Interval and full name of a parameter that has the fields of `shapes.Parameter`."""

    term: str
    target: str
    value: float | None
    sd: float | None
    place: str | None

    @property
    def interval(self) -> tuple[float, float] | None:
        """Bounds of 95 %, in `unit`."""
        if self.value is None or self.sd is None:
            return None
        return self.value - 1.96 * self.sd, self.value + 1.96 * self.sd

    @property
    def at(self) -> tuple[str, str, str | None]:
        """The term, its target and its place, as the core takes them."""
        return self.term, self.target, self.place

    @property
    def spec(self) -> str:
        """The term at its place, as `terms=[…]` takes it: `curvature@a22`."""
        return _core.spec(*self.at)
