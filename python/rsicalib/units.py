"""Units as people read them."""

from __future__ import annotations

NONE = "1"
"""The unit of a pure number, in a result."""


HALF_95 = 1.96
"""Half of an interval of 95 %, in standard deviations."""


def is_count(unit: str) -> bool:
    """Whether readings are whole codes of a converter; every other unit is a physical one."""
    return unit == "count"


def with_unit(size: str, unit: str | None) -> str:
    """A size and its unit: `0.0529 rad`; a pure number stands alone."""
    return size if unit in (None, "", NONE) else f"{size} {unit}"


def axis_words(what: str, unit: str | None) -> str:
    """What an axis shows, with its unit in brackets: `correction [mrad]`."""
    return what if unit in (None, "", NONE) else f"{what} [{unit}]"


def in_thousandths(unit: str | None) -> tuple[float, str]:
    """Factor and unit in which a correction is shown: angles in mrad, fractions in ‰."""
    match unit:
        case "rad":
            return 1e3, "mrad"
        case "1":
            return 1e3, "‰"
    return 1.0, unit or ""
