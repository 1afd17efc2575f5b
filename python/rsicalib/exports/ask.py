"""What an export is given, the same for every kind."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

from rsicalib._core import Mechanism
from rsicalib.errors import InputError
from rsicalib.io.readings import Readings
from rsicalib.results.result import Result
from rsicalib.verbs.export import Calibrated, calibrated
from rsicalib.work.arguments import MechanismArg, open_mechanism


@dataclass(frozen=True)
class Ask:
    """A result that is to be written for others.

    Attributes
    ----------
    result : Result
        The calibration.
    given : str, path, mapping or Mechanism
        Its mechanism, as it was given.
    readings : Readings or None
        That are to be corrected.
    base : str or None
        A file of the receiver that the result is written into.
    """

    result: Result
    given: MechanismArg
    readings: Readings | None
    base: str | None

    @cached_property
    def mechanism(self) -> Mechanism:
        """The mechanism as declared."""
        return open_mechanism(self.given)

    @cached_property
    def calibrated(self) -> Calibrated:
        """The mechanism with the parameters in it."""
        return calibrated(self.given, self.result)

    def needed(self, what: str) -> Readings:
        """The readings; refused where there are none."""
        if self.readings is None:
            raise InputError(f"readings: found none, expected those that {what} (--readings)")
        return self.readings

    def file(self, words: str) -> str:
        """The base; refused where there is none."""
        if self.base is None:
            raise InputError(f"base: found none, expected {words} (--base)")
        return self.base

    def unless(self, names: Sequence[str], kind: str) -> None:
        """Refuse a mechanism that lacks points of such a machine."""
        known = [point["name"] for point in self.mechanism.to_dict().get("point", [])]
        missing = [name for name in names if name not in known]
        if missing:
            found = f"no point {missing[0]!r} in {self.mechanism.name!r}"
            raise InputError(f"mechanism: found {found}, expected {kind}")
