"""Warnings: what a program decides by, and the same in words."""

from __future__ import annotations

from typing import Literal, TypeAlias, get_args

from rsicalib.facts.records import Record

WarnedKind: TypeAlias = Literal[
    "reversed",
    "either_reversed",
    "zeros",
    "exchanged",
    "gap",
    "stuck",
    "no_start",
    "same_readings",
    "follow",
    "unused",
    "knowledge",
    "mirrored",
    "degrees",
    "units",
    "left_handed",
    "shifted",
    "coarse",
    "noise",
    "unphysical_sign",
    "constant",
    "stuck_bit",
    "clipped",
    "end_of_range",
    "moved_pose",
    "stale_rows",
    "copied_pose",
    "unlabelled_repeats",
    "labels",
    "ignored_columns",
    "unused_poses",
    "time_goes_back",
    "moved_rest",
    "imported",
    "open_loops",
    "edited",
    "redrawn",
    "as_drawn",
    "beyond_the_end",
    "known_poses",
    "absurd_noise",
    "absurd_misclosure",
    "absurd_offset",
    "absurd_effect",
    "other",
]
"""What a warning is about; the schema of the results says what each of them means."""

KINDS: tuple[WarnedKind, ...] = get_args(WarnedKind)

WIRING: frozenset[WarnedKind] = frozenset(
    (
        *("reversed", "either_reversed", "exchanged", "gap", "stuck", "no_start"),
        *("constant", "stuck_bit", "clipped", "end_of_range"),
    )
)
"""What somebody at the device can mend: a wire, a converter, the place of a sensor on its shaft."""


MISTAKES: dict[WarnedKind, tuple[str, str]] = {
    "exchanged": ("looks exchanged", "look exchanged"),
    "reversed": ("reads the wrong way round", "read the wrong way round"),
    "either_reversed": ("reads the wrong way round", "read the wrong way round, one of them"),
    "left_handed": ("is left-handed", "are left-handed"),
    "degrees": ("looks like the other unit of angles", "look like the other unit of angles"),
    "units": ("looks like another unit", "look like another unit"),
    "shifted": ("looks shifted by a pose", "look shifted by a pose"),
}
"""What is wired or written otherwise than declared, as it is said of one and of several."""


class Warned(Record):
    """Something suspicious about the readings, or about what is declared of them.

    Programs decide by `kind` and `target`; `text` is for people, and may be worded otherwise in a
    later version.
    """

    kind: WarnedKind
    """What it is."""
    target: str | None
    """The channels or closures, joined by `+`; None where it is about all of them."""
    text: str
    """The same in words, with what to do."""

    def __str__(self) -> str:
        return self.text

    @property
    def targets(self) -> tuple[str, ...]:
        """The channels or closures one by one."""
        return () if self.target is None else tuple(self.target.split("+"))
