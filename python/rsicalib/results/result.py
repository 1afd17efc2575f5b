"""Results of the verbs: their data, with what one does with them."""

from __future__ import annotations

import os
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from dataclasses import field, replace
from functools import cached_property
from typing import Any, ClassVar, Self

import numpy as np

from rsicalib import _core
from rsicalib._core import Mechanism
from rsicalib.arrays import FloatArray
from rsicalib.errors import InputError, InputTypeError, ResultError, UndeterminedError
from rsicalib.facts.digest import digest_of_numbers
from rsicalib.facts.records import NOT_WRITTEN, to_json
from rsicalib.facts.shapes import CalibrationShape, Evidence, FitQuality, TraceShape
from rsicalib.facts.verdicts import EXIT_CODES
from rsicalib.io.files import write_text
from rsicalib.io.sources import read_text
from rsicalib.options import checked
from rsicalib.plain_text import counted, p_equals, quoted
from rsicalib.report.words import Kept, quality
from rsicalib.results.interactive import Interactive


class Result(Interactive, eq=False, repr=False, kw_only=True):
    """What a calibration and a traced calibration have in common."""

    FORMAT: ClassVar[str]

    made_from: Mechanism | None = field(default=None, metadata=NOT_WRITTEN)
    """The mechanism that it was made from; None where the result was read from a file."""

    @property
    def values(self) -> FloatArray:
        """Estimates, in the order of `parameters`; NaN where unknown."""
        return np.array([p.value for p in self.parameters], dtype=np.float64)

    @property
    def quality(self) -> FitQuality:
        """How well the final model fits."""
        return quality(self)

    @property
    def exit_code(self) -> int:
        """What the command returns: 0 usable, 3 undetermined, 4 a residual is left or absurd."""
        return EXIT_CODES[self.verdict]

    @cached_property
    def evidence(self) -> Evidence | None:
        """What the report is drawn from, gathered once; None where nothing can be gathered.

        A result that was read from a file has none, nor has one of too few readings.
        """
        if self.source is None:
            return None
        try:
            return Evidence.from_dict(self.source.gather())
        except UndeterminedError:
            return None

    @cached_property
    def edited(self) -> bool | None:
        """Whether numbers that poses come from were edited after it was made.

        None where that cannot be told: of a result without a `digest`, as earlier versions wrote.
        """
        return None if self.digest is None else self.digest != digest_of_numbers(self)

    @property
    def called(self) -> str:
        """The file that it was read from; `this result` of one that was made or changed here."""
        return str(vars(self).get("_file", "this result"))

    @property
    def _kept(self) -> Kept:
        """The file that it was read from, for what to do next."""
        return Kept(vars(self).get("_file"))

    def to_dict(self) -> dict[str, Any]:
        """Write the result as plain values, with the digest of its numbers."""
        out = super().to_dict()
        out["digest"] = out.pop("digest", None) or digest_of_numbers(self)
        return out

    def to_json(self) -> str:
        """The result as JSON text, as `--json` prints it."""
        return to_json(self.to_dict())

    def save(self, path: str | os.PathLike[str]) -> None:
        """Write the JSON to a file, whole or not at all.

        Parameters
        ----------
        path : path
            Where to; `load_calibration` and `--calibration` read it.
        """
        write_text(path, self.to_json())

    def summary(self, *, width: int | None = None, whole: bool = False) -> str:
        """Summary for a terminal of so many columns: unless it is to be whole, what 25 lines of 100
        columns hold.
        """
        from rsicalib.report.terminal import summary

        return summary(self, width=width, whole=whole, kept=self._kept)

    @checked
    def report(self, *, target: float | None = None) -> str:
        """Report as one HTML file that needs no network.

        Parameters
        ----------
        target : float, optional
            Standard deviation of what is carried that is aimed at [length unit]: the maps of the
            workspace show where it is reached.
        """
        from rsicalib.report.page import html

        return html(self, self.evidence, target, self._kept)

    @checked
    def figures(self, *, target: float | None = None) -> dict[str, str]:
        """Figures of the report as SVG files: name without an ending, and text."""
        from rsicalib.report.page import figures

        return figures(self, self.evidence, target)

    def __eq__(self, other: object) -> bool:
        """Whether they are written alike; residuals, which are not written, do not count."""
        if type(other) is not type(self):
            return NotImplemented
        return self is other or self.to_dict() == other.to_dict()

    def __hash__(self) -> int:
        return hash((self.FORMAT, self.mechanism, self.readings.sha256))

    def __repr__(self) -> str:
        fit = self.quality
        judged = "not judged" if fit.p_value is None else p_equals(fit.p_value)
        return (
            f"<{type(self).__name__} of {self.mechanism!r}: {self.verdict or 'not judged'}, "
            f"{counted(len(self.parameters), 'parameter')} from "
            f"{counted(self.readings.poses, 'pose')}, {judged}>"
        )

    @classmethod
    def made(cls, found: Mapping[str, Any]) -> Self:
        """A result of what was found just now, with the digest of its numbers."""
        result = cls._of({"format": cls.FORMAT, **found, "digest": None})
        return replace(result, digest=digest_of_numbers(result))

    @classmethod
    def from_dict(cls, data: Mapping[str, Any]) -> Self:
        """Read a result back from its dictionary, checked as its file is.

        Parameters
        ----------
        data : mapping
            As `to_dict` writes it.

        Raises
        ------
        InputError
            It is no such result: the place, what was found and what was expected.
        """
        if not isinstance(data, Mapping):
            expected = "a dictionary of its values"
            raise InputTypeError(f"result: found {quoted(data)}, expected {expected}")
        given = data.get("format", cls.FORMAT)
        if given != cls.FORMAT:
            raise InputError(f"format: found {given!r}, expected {cls.FORMAT!r}: of {cls.__name__}")
        try:
            text = to_json({**data, "format": given})
        except (TypeError, ValueError) as error:
            found, expected = f"what is no value of JSON ({error})", "numbers, texts, lists of them"
            raise InputError.at("result", found, expected) from None
        with _refused_as("result"):
            return cls._of(_core.read_result(text))

    @classmethod
    def _of(cls, data: Mapping[str, Any]) -> Self:
        """A result of values that are checked."""
        return super().from_dict(data)


@contextmanager
def _refused_as(source: str) -> Iterator[None]:
    """Refuse what is no result, by what the message calls it."""
    try:
        yield
    except ResultError as error:
        raise InputError.at(source, error.found, error.expected, place=error.place) from None


class Calibration(Result, CalibrationShape, eq=False, repr=False, kw_only=True):
    """Parameters from joint readings alone: estimates, uncertainty, adequacy.

    Examples
    --------
    >>> import rsicalib
    >>> from rsicalib import DEMO
    >>> calibration = rsicalib.calibrate(DEMO / "readings.csv", rest=DEMO / "rest.csv")
    >>> calibration["gain@a11"].unit
    'rad/count'
    >>> [p.key for p in calibration if p.target == "a11"]
    ['offset@a11', 'gain@a11']
    """

    FORMAT: ClassVar[str] = "rsicalib.calibration/1"


class Trace(Result, TraceShape, eq=False, repr=False, kw_only=True):
    """A calibration, what was missing from it, and the error before and after."""

    FORMAT: ClassVar[str] = "rsicalib.trace/1"


def load_calibration(path: str | os.PathLike[str]) -> Calibration | Trace:
    """Read a result that `save` or `--json` wrote.

    Parameters
    ----------
    path : path
        A file of format `rsicalib.calibration/1` or `rsicalib.trace/1`.

    Returns
    -------
    Calibration or Trace
        Whichever it is.

    Raises
    ------
    InputError
        The file is not such a result.
    """
    if not isinstance(path, str | os.PathLike):
        raise InputTypeError(f"calibration: found {quoted(path)}, expected the path of a result")
    name = os.fspath(path)
    if isinstance(path, str) and path.lstrip().startswith("{"):
        raise InputError("calibration: found the text of a file, expected its path, or a result")
    text = read_text(path, "a result of `rsicalib calibrate --json` or `rsicalib trace --json`")
    kinds: dict[str, type[Calibration | Trace]] = {k.FORMAT: k for k in (Calibration, Trace)}
    with _refused_as(name):
        data = _core.read_result(text)
        result = kinds[data["format"]]._of(data)
    vars(result)["_file"] = name
    return result
