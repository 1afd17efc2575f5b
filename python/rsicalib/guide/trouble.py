"""What is wrong in a guided session while it can still be repeated."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal, Self, TypeAlias

from rsicalib.facts.shapes import Step
from rsicalib.facts.warned import Warned, WarnedKind

TroubleKind: TypeAlias = (
    WarnedKind
    | Literal["repeat", "repeated", "slip", "wander", "bad_lines", "too_few", "not_noise", "ended"]
)
"""What a trouble is: a warning of the core, or what only a session can show."""

LONGEST = 160
"""Letters of a trouble that are shown."""


@dataclass(frozen=True)
class Trouble:
    """Something wrong: programs decide by `kind`, `target` and `pose`, people read `text`."""

    kind: TroubleKind
    """What it is."""
    text: str
    """The same in words, with what to do."""
    target: str | None = None
    """The channels, joined by `+`; None where it is about none."""
    pose: str | None = None
    """Label of the pose; None where it is about none."""

    @property
    def id(self) -> str:
        """The same for the same trouble, however it is said: `slip@a22:17`."""
        at = "" if self.target is None else f"@{self.target}"
        return f"{self.kind}{at}" + ("" if self.pose is None else f":{self.pose}")

    def state(self) -> dict[str, str | None]:
        """Plain values for a page."""
        text = self.text
        shown = text if len(text) < LONGEST else text[: LONGEST - 3] + "…"
        facts = {"id": self.id, "kind": self.kind, "target": self.target, "pose": self.pose}
        return {**facts, "text": shown}

    @classmethod
    def of_warning(cls, warned: Warned) -> Self:
        """A warning of the core."""
        return cls(warned.kind, warned.text, warned.target)

    @classmethod
    def of_step(cls, step: Step) -> Self:
        """An effect that says that something moved: of `slip` or `wander`."""
        if step.term == "wander":
            text = f"{step.target} changes in the course of the session: look whether it slipped"
            return cls("wander", text, step.target)
        at = f" before pose {step.place}" if step.place else ""
        text = f"{step.target} slipped{at}: fasten it, and begin again with --out of another folder"
        return cls("slip", text, step.target, step.place)

    @classmethod
    def at_end(cls, channel: str) -> Self:
        """A channel at an end of its range."""
        text = f"{channel} is at the end of its range: a dead zone, or a wire is off"
        return cls("end_of_range", text, channel)

    @classmethod
    def lost(cls, channel: str) -> Self:
        """A channel that stands while others move."""
        text = f"{channel} does not change while others do: is it connected?"
        return cls("constant", text, channel)

    @classmethod
    def dead(cls, channel: str) -> Self:
        """A channel that has stood in all poses."""
        text = f"{channel} has read the same in all poses: connect it, and begin again"
        return cls("constant", text, channel)

    @classmethod
    def repeated(cls, label: int) -> Self:
        """A pose that does not fit after it was measured again."""
        text = (
            f"pose {label}, measured again, does not fit the others either: look whether a sensor "
            "slipped or an arm was moved before it"
        )
        return cls("repeated", text, pose=str(label))
