"""A condition under which rows of a bag are taken: `/wrench.force.z>2`."""

from __future__ import annotations

import operator
import re
from collections.abc import Callable, Iterable
from dataclasses import dataclass
from typing import Any

import numpy as np

from rsicalib.errors import InputError
from rsicalib.imports.bags import Bag

COMPARE: dict[str, Callable[[Any, Any], Any]] = {
    ">=": operator.ge,
    "<=": operator.le,
    "==": operator.eq,
    "!=": operator.ne,
    ">": operator.gt,
    "<": operator.lt,
}
FORM = re.compile(r"\s*(/[^<>=!\s]+?)\s*(>=|<=|==|!=|>|<)\s*([+-]?[\d.eE+-]+)\s*")
EXPECTED = "a topic, its field, a comparison and a number, such as /wrench.force.z>2"


@dataclass(frozen=True)
class Condition:
    """A field of a topic, compared with a number.

    Attributes
    ----------
    text : str
        As it was given.
    topic : str
        Topic of the bag.
    path : tuple of str
        Fields on the way; a number picks from a list.
    compare : str
        A key of `COMPARE`.
    value : float
        What is compared with.
    """

    text: str
    topic: str
    path: tuple[str, ...]
    compare: str
    value: float

    @classmethod
    def of(cls, text: str, topics: Iterable[str], source: str) -> Condition:
        """Read a condition; the topic is the longest name that the text begins with."""
        match = FORM.fullmatch(text)
        try:
            value = float(match[3]) if match else 0.0
        except ValueError:
            match = None
        if match is None:
            raise InputError(f"when: found {text!r}, expected {EXPECTED}")
        place = match[1]
        fits = [t for t in topics if place == t or place.startswith((f"{t}.", f"{t}["))]
        if not fits:
            hint = f"Its topics: {', '.join(topics)[:300]}."
            raise InputError.at(source, "no such topic", EXPECTED, hint=hint, place=place)
        topic = max(fits, key=len)
        path = tuple(re.findall(r"[^.\[\]]+", place[len(topic) :]))
        return cls(text, topic, path, match[2], value)

    def holds(self, bag: Bag, messages: list[Any], source: str) -> np.ndarray:
        """Whether it holds at each message, by what was received last before it."""
        times: list[int] = []
        values: list[bool] = []
        for time, message in bag.messages(self.topic):
            value = self._value(message, len(times) + 1, source)
            times.append(time)
            values.append(bool(COMPARE[self.compare](value, self.value)))
        last = np.searchsorted(times, [time for time, _ in messages], side="right")
        return np.concatenate([[False], np.array(values, dtype=bool)])[last]

    def _value(self, message: Any, number: int, source: str) -> float:
        """The field of a message; of a stamped one that of what is stamped."""
        here = message
        for name in self.path:
            here = _field(here, name)
        try:
            return float(here)
        except (TypeError, ValueError):
            fields = ", ".join(_fields(message))
            raise InputError.at(
                source,
                f"no number there; {self.topic} has the fields {fields}",
                EXPECTED,
                line=number,
                line_word="message",
                place=self.text,
            ) from None


def _fields(message: Any) -> list[str]:
    """Names of the fields of a message, of ROS or of JSON."""
    return list(getattr(message, "__dataclass_fields__", getattr(message, "__dict__", {})))


def _field(here: Any, name: str) -> Any:
    if name.isdigit():
        try:
            return here[int(name)]
        except (TypeError, IndexError):
            return None
    if not hasattr(here, name):
        inner = [f for f in _fields(here) if f not in NOT_DATA]
        here = getattr(here, inner[0]) if len(inner) == 1 else None
    return getattr(here, name, None)


NOT_DATA = ("header", "__msgtype__")
