"""The exceptions: what went wrong, where, and what would have been right."""

from __future__ import annotations

import sys
import warnings
from typing import TypedDict

from rsicalib.plain_text import printable, shortened


class Where(TypedDict):
    """Place of a fault in the input; what does not apply is None."""

    file: str | None
    """Path as it was given, or what stands for one (`arrays`)."""
    line: int | None
    """Line in a CSV file (the header is line 1), row elsewhere; both from 1."""
    column: str | None
    """Name of the column."""
    found: str | None
    """What stands there."""
    expected: str | None
    """What should stand there."""


class RsicalibError(Exception):
    """Anything that `rsicalib` raises on purpose."""


class InputError(RsicalibError, ValueError):
    """The data or the options cannot be used as they are.

    Parameters
    ----------
    message : str
        What was found, what was expected, and what to do about it.
    where : Where, optional
        The place, if the fault has one.

    Attributes
    ----------
    message : str
        As given; also what `str()` returns.
    where : Where or None
        Keys `file`, `line`, `column`, `found`, `expected`.
    said : str
        The message without the file, for those who show it beside the file's name.

    Examples
    --------
    >>> error = InputError.at("run.csv", "blank", "a number", line=7, column="a11")
    >>> str(error)
    'run.csv, line 7, column a11: found blank, expected a number'
    >>> error.where["line"]
    7
    """

    def __init__(
        self, message: str, where: Where | None = None, *, said: str | None = None
    ) -> None:
        message = printable(shortened(message))
        super().__init__(message)
        self.message = message
        self.where = where
        self.said = message if said is None else printable(shortened(said))

    @classmethod
    def at(
        cls,
        file: str,
        found: str,
        expected: str,
        *,
        line: int | None = None,
        column: str | None = None,
        place: str | None = None,
        hint: str = "",
        line_word: str = "line",
        column_word: str = "column",
    ) -> InputError:
        """Write the message from the place, what was found and what was expected.

        Parameters
        ----------
        file : str
            Path as it was given.
        found, expected : str
            Both are quoted in the message and kept in `where`.
        line : int, optional
            Line or row, from 1.
        column : str, optional
            Name of the column.
        place : str, optional
            Path of an entry, in the place of a column.
        hint : str, optional
            A sentence on what to do.
        line_word : {"line", "row"}
            How the message calls `line`.
        column_word : str
            How the message calls `column`.

        Returns
        -------
        InputError
            Ready to be raised.
        """
        words = [file or "''"]
        if line is not None:
            words.append(f"{line_word} {line}")
        if column is not None:
            words.append(f"{column_word} {column}")
        if place is not None:
            words.append(place)
        what = f"found {found}, expected {expected}" + (f". {hint}" if hint else "")
        entry = column if place is None else place
        where = Where(file=file, line=line, column=entry, found=found, expected=expected)
        said = ": ".join([*filter(None, [", ".join(words[1:])]), what])
        return cls(f"{', '.join(words)}: {what}", where, said=said)


class InputTypeError(InputError, TypeError):
    """An argument has the wrong type."""


class ResultError(RsicalibError, ValueError):
    """A text is not a result: where, what was found, what was expected."""

    def __init__(self, place: str, found: str, expected: str) -> None:
        super().__init__(f"{place}: found {found}, expected {expected}")
        self.place = place
        self.found = found
        self.expected = expected

    def __reduce__(self) -> tuple[type, tuple[str, str, str]]:
        return type(self), (self.place, self.found, self.expected)


class OpenLoopsWarning(UserWarning):
    """A result not to be relied on: its numbers were edited, or loops do not close under it."""


def tell(text: str) -> None:
    """Warn of a result, at the line outside the package that asked for what it is applied to."""
    level, frame = 2, sys._getframe(1)
    while frame.f_back is not None and _is_own(frame.f_globals):
        level, frame = level + 1, frame.f_back
    warnings.warn(text, OpenLoopsWarning, stacklevel=level)


def _is_own(names: dict[str, object]) -> bool:
    return str(names.get("__name__")).partition(".")[0] == __name__.partition(".")[0]


class UndeterminedError(RsicalibError):
    """The data cannot determine what was asked, not even in part.

    Where an answer exists that only lacks some parameters, it is returned with
    the verdict `undetermined` instead.
    """

    def __init__(self, message: str) -> None:
        super().__init__(message)
        self.message = message
