"""Options of the verbs, checked once: a name, what was found, what was expected.

Every number that a verb or its command takes has its bounds in `NUMBERS`, with the reason for them.
A value of the wrong type raises `InputTypeError`, which is a `TypeError` as well; other values that
cannot be used raise `InputError`, a `ValueError`.
"""

from __future__ import annotations

import argparse
import inspect
import math
import numbers
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from functools import wraps
from typing import Any, ParamSpec, TypeVar

import numpy as np

from rsicalib import _core
from rsicalib.errors import InputError, InputTypeError
from rsicalib.plain_text import counted, meant, nearest, quoted

P = ParamSpec("P")
T = TypeVar("T")

MOST_ROWS = 10_000_000
"""A simulated session has at most so many samples: a GB of readings."""

LARGEST_SEED = 2**63 - 1


@dataclass(frozen=True)
class Bounds:
    """Which numbers an option takes.

    Attributes
    ----------
    least, most : float
        The ends; both are among the numbers unless `above` or `below` says otherwise.
    words : str
        What the number is.
    whole : bool
        No fractions.
    above, below : bool
        The lower or the upper end is no such number itself.
    """

    least: float
    most: float
    words: str = "a number"
    whole: bool = True
    above: bool = False
    below: bool = False

    @property
    def expected(self) -> str:
        """The numbers in words."""
        if self.whole:
            return f"{self.least} to {self.most}"
        low = f"above {self.least:g}" if self.above else f"{self.least:g} or more"
        high = f"{'below' if self.below else 'at most'} {self.most:g}"
        return f"{self.words} {low} and {high}"

    def of(self, name: str, value: Any) -> Any:
        """The value as a plain number, if it is one of them."""
        kind = numbers.Integral if self.whole else numbers.Real
        if isinstance(value, bool | np.bool_) or not isinstance(value, kind):
            expected = "an integer" if self.whole else self.expected
            raise InputTypeError(f"{name}: found {quoted(value)}, expected {expected}")
        # A narrow float of NumPy would take the ends as its own kind, where they are infinite.
        plain: Any = value.item() if isinstance(value, np.generic) else value
        low = plain > self.least if self.above else plain >= self.least
        high = plain < self.most if self.below else plain <= self.most
        if not (low and high):
            raise InputError(f"{name}: found {quoted(value)}, expected {self.expected}")
        return int(plain) if self.whole else float(plain)


NUMBERS: dict[str, Bounds] = {
    # A session of more samples is no longer held in memory.
    "poses": Bounds(1, MOST_ROWS),
    "samples": Bounds(1, MOST_ROWS),
    "check": Bounds(1, MOST_ROWS),
    # A day has 86,400 seconds, and a pose takes some; each is weighed against every candidate.
    "plan.poses": Bounds(1, 10_000),
    "candidates": Bounds(1, 1_000_000),
    "starts": Bounds(1, 100_000),
    "max_iterations": Bounds(1, 1_000_000),
    "xtol": Bounds(0, 1, whole=False, above=True, below=True),
    "alpha": Bounds(0, 1, "a probability", whole=False, above=True, below=True),
    # Below one half the largest error would be likelier beyond U than within.
    "confidence": Bounds(0.5, 1, "a probability", whole=False, above=True, below=True),
    "seed": Bounds(0, LARGEST_SEED),
    # The tables have a scatter of their own: two trials at least. Ten million take days.
    "trials": Bounds(2, 10_000_000),
    # Threads of one process: no machine has more processors.
    "workers": Bounds(1, 1024),
    # Reports of single devices of a fleet: a page lists so many.
    "reports": Bounds(0, 200),
    # For one device: nobody waits for longer than a day.
    "time_limit": Bounds(0, 86_400, "a number of seconds", whole=False, above=True),
    # A monitor takes two MB.
    "awake": Bounds(1, 1_000_000),
    "noise": Bounds(0, _core.LARGEST, "a number", whole=False, above=True),
    "check_noise": Bounds(0, _core.LARGEST, "a length", whole=False),
    "check_noise_angle": Bounds(0, math.pi, "an angle [rad]", whole=False),
    "simulate.noise": Bounds(0, _core.LARGEST, "a number of readings,", whole=False),
    "target": Bounds(0, _core.LARGEST, "a length", whole=False, above=True),
    # Ports of TCP; 0 asks for a free one.
    "port": Bounds(0, 65535),
    # One sample cannot say how much a pose is held.
    "guide.samples": Bounds(2, 100_000),
    # Nobody holds a handle for longer than an hour.
    "seconds": Bounds(0, 3600, "a number of seconds,", whole=False),
    # A log of another program: nobody holds a pose for longer, no converter is faster.
    "hold": Bounds(0, 3600, "a number of seconds,", whole=False),
    "rate": Bounds(0, 1e9, "samples per second", whole=False, above=True),
    # More than one row in a hundred is no rare event; the thresholds are computed for those.
    "false_alarms": Bounds(0, 0.01, "a rate per sample", whole=False, above=True),
}
"""Bounds of each number, by its name, or by verb and name where the verb has its own."""


def bounds_of(verb: str, name: str) -> Bounds:
    """Bounds of a number of a verb."""
    return NUMBERS.get(f"{verb}.{name}") or NUMBERS[name]


def number(name: str, value: Any) -> Any:
    """A number within its bounds; `name` may begin with the verb, as in `plan.poses`."""
    return NUMBERS[name].of(name.rpartition(".")[2], value)


PLAIN = {"str": (str, "text"), "bool": (bool | np.bool_, "True or False")}
"""Arguments that are no numbers, by their annotation: what they are, and the same in words."""


def _check_plain(name: str, value: Any, annotation: str) -> None:
    """Refuse a text that is none, or a switch that is neither on nor off."""
    kind, expected = PLAIN[annotation.removesuffix(" | None")]
    if not isinstance(value, kind) and not (value is None and annotation.endswith("None")):
        raise InputTypeError(f"{name}: found {quoted(value)}, expected {expected}")


def checked(verb: Callable[P, T]) -> Callable[P, T]:
    """Check numbers, texts and switches that a verb is given before it begins.

    Which of its arguments are which is read from their annotations; a number without bounds in
    `NUMBERS` is a KeyError where the verb is defined.
    """
    signature = inspect.signature(verb)
    own = verb.__qualname__.split(".")[0]
    kinds = {name: str(p.annotation) for name, p in signature.parameters.items()}
    bounds = {
        name: (bounds_of(own, name), "None" in kind)
        for name, kind in kinds.items()
        if kind.removesuffix(" | None") in ("int", "float")
    }
    plain = {name: kind for name, kind in kinds.items() if kind.removesuffix(" | None") in PLAIN}

    @wraps(verb)
    def run(*args: P.args, **kwargs: P.kwargs) -> T:
        try:
            given = signature.bind(*args, **kwargs)
        except TypeError as error:
            known = list(signature.parameters)
            hint = next((meant(name, known) for name in kwargs if name not in known), "")
            raise TypeError(f"{verb.__name__}() {error}{hint}") from None
        for name, (bound, optional) in bounds.items():
            if name in given.arguments and not (optional and given.arguments[name] is None):
                given.arguments[name] = bound.of(name, given.arguments[name])
        for name in given.arguments.keys() & plain.keys():
            _check_plain(name, given.arguments[name], plain[name])
        try:
            return verb(*given.args, **given.kwargs)
        except UnicodeEncodeError as error:  # a byte of a command line that is no UTF-8
            found = f"{quoted(error.object)}, which is no text of UTF-8"
            raise InputError(f"found {found}, expected names as the mechanism has them") from None

    return run


def _known_name(given: str, known: Sequence[str]) -> str:
    """The known name that is nearest, with the parameter and the value that stand behind it; else
    as given.
    """
    name, equals, value = given.partition("=")
    stem, dot, parameter = name.rpartition(".")
    near = nearest(stem, known) if dot and name not in known else None
    near = nearest(name, known) if near is None else f"{near}.{parameter}"
    return (near or name) + equals + value


def parsed(name: str) -> Callable[[str], Any]:
    """What reads a number of `NUMBERS` on a command line: in digits 0 to 9, nothing else."""
    bounds = NUMBERS[name]

    def read(text: str) -> Any:
        try:
            if not text.isascii() or "_" in text:
                raise ValueError
            return bounds.of(name, int(text) if bounds.whole else float(text))
        except ValueError:  # an InputError is one
            kind = "an integer from " if bounds.whole else ""
            expected = f"{kind}{bounds.expected}"
            raise argparse.ArgumentTypeError(f"found {quoted(text)}, expected {expected}") from None

    return read


def noise_of(value: Any, channels: Sequence[_core.Channel], name: str = "noise") -> float:
    """Standard deviation of a reading that each of some channels can have.

    Readings that are spread evenly over a whole range scatter by 1/√12 of it; more than that is
    no noise of a sensor.
    """
    found: float = NUMBERS[name].of("noise", value)
    for channel in channels:
        if channel.range is not None:
            most = (channel.range[1] - channel.range[0]) / math.sqrt(12.0)
            if found > most:
                expected = f"at most {most:.6g}, the scatter of readings all over its range"
                raise InputError(f"noise of {channel.name}: found {found:g}, expected {expected}")
    return found


def rows(poses: int, samples: int) -> None:
    """Refuse more samples than fit into memory."""
    if poses * samples > MOST_ROWS:
        found = f"{counted(poses, 'pose')} of {counted(samples, 'sample')}"
        raise InputError(f"found {found}, expected at most {MOST_ROWS:,} samples")


def names(
    name: str,
    given: Sequence[str] | None,
    known: Callable[[], Iterable[str]] = tuple,
    *,
    none: bool = False,
) -> list[str] | None:
    """Names as a list, None where none were asked for.

    A single text is refused, as its letters would pass for names: the message has the list that it
    should have been, of names that are `known`. So is an empty list, which would ask for nothing,
    but where that has a meaning (`none`).
    """
    if given is None:
        return None
    if isinstance(given, str):
        listed = [_known_name(one.strip(), [*known()]) for one in given.split(",")]
        raise InputTypeError(f"{name}: found {quoted(given)}, expected a list of names: {listed}")
    try:
        found = list(given)
    except TypeError:
        raise InputTypeError(f"{name}: found {given!r}, expected a list of names") from None
    for one in found:
        if not isinstance(one, str):
            raise InputTypeError(f"{name}: found {one!r}, expected a name")
    if not found and not none:
        raise InputError(f"{name}: found none, expected at least one name, or no such option")
    return found
