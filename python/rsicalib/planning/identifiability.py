"""Number of parameters that a mechanism can determine, counted before any reading is taken.

The parameters of a model are counted three times:

```text
given     columns of X, redundant ones and all
minimal   rank of what they do to the points that the chains carry, loops open
known     rank of X where the loops are closed, unknown points eliminated
```

Loops hide what moves everything alike: the place of the whole in the base, and its size unless a
length is known. The core counts; see `rsicalib::design::identifiability`.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from rsicalib import _core, options
from rsicalib.facts.records import Record
from rsicalib.tabular import Tabular
from rsicalib.work.arguments import MechanismArg, names_in, open_mechanism

COMPLETE = _core.COMPLETE
"""Complete geometry of any chain, with its sensors; and where there are such, `point_position` and
`distance`."""


class Counted(Record):
    """One term: how many parameters it has, and how many could be told apart from all others."""

    term: str
    parameters: int
    alone: int
    """Rank with every other parameter known."""
    beside: int
    """Rank with every other parameter unknown."""


class Identifiable(Tabular, Record, repr=False):
    """What readings of a mechanism could tell.

    Attributes
    ----------
    model : str
        `declared`, `complete` or `given`.
    terms : tuple of Counted
        Term by term.
    parameters, minimal, known : int
        As in the header of this module.
    hidden : tuple of str
        What hides the difference between the last two, as far as it has a name.
    configurations : int
        That were closed, and on which the counts rest.
    """

    model: str
    terms: tuple[Counted, ...]
    parameters: int
    minimal: int
    known: int
    hidden: tuple[str, ...]
    configurations: int

    def _table(self) -> dict[str, Any]:
        names = ("term", "parameters", "alone", "beside")
        return {name: [getattr(count, name) for count in self.terms] for name in names}

    def __repr__(self) -> str:
        return (
            f"<Identifiable: {self.model} model, {self.known} of {self.minimal} minimal "
            "parameters can be known>"
        )

    def text(self) -> str:
        """A few lines for the terminal."""
        unknown = self.minimal - self.known
        lines = [
            f"{self.model} model: {self.parameters} parameters, {self.minimal} of them minimal, "
            f"of which {self.known} can be known"
        ]
        for count in self.terms:
            lines.append(
                f"  {count.term:18} {count.parameters:3}   {count.alone:3} by themselves, "
                f"{count.beside:3} beside all others"
            )
        if unknown:
            named = f": {'; '.join(self.hidden)}" if self.hidden else ""
            lines.append(f"  {unknown} cannot be known from closed loops{named}")
        return "\n".join(lines)


@options.checked
def identifiable(
    mechanism: MechanismArg = "rsi", terms: Sequence[str] | None = None, *, seed: int = 0
) -> Identifiable:
    """Count what readings of a mechanism can and cannot tell.

    Parameters
    ----------
    mechanism : str, path or Mechanism
        Joint limits say where its joints may be.
    terms : sequence of str, optional
        A model; as the mechanism declares it where not given. `COMPLETE` stands for
        complete geometry.
    seed : int
        Seed of the configurations. The counts do not depend on it.

    Returns
    -------
    Identifiable
        The counts.

    Raises
    ------
    InputError
        The loops cannot be closed anywhere near random configurations.

    Examples
    --------
    >>> found = identifiable("rsi", COMPLETE)
    >>> found.minimal, found.known
    (57, 50)
    """
    opened = open_mechanism(mechanism)
    wanted = names_in("terms", terms, opened, none=True)
    found = _core.identifiable(opened, wanted, seed=seed)
    counts = tuple(Counted(*count) for count in found["terms"])
    return Identifiable(**{**found, "terms": counts, "hidden": tuple(found["hidden"])})
