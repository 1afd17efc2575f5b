"""Levels above what a fleet calibrates: devices of sessions, batches, tools."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from rsicalib.errors import InputError
from rsicalib.fleets.frames import devices_in, runs_of
from rsicalib.io.frames import Columns
from rsicalib.io.tables import is_blank, quoted, read_table, text


@dataclass(frozen=True)
class Levels:
    """In which group of each level each unit is; a unit is what `by` names.

    Attributes
    ----------
    by : str
        What a unit is.
    names : tuple of str
        The levels, as they were given.
    groups : mapping
        Of each unit the label of its group in each level; no unit that is in none.
    units : sequence
        The units in a certain order.
    """

    by: str = "device"
    names: tuple[str, ...] = ()
    groups: Mapping[str, tuple[str, ...]] = field(default_factory=dict)
    units: Sequence[Any] = ()

    def of(self, units: Sequence[Any]) -> Levels:
        """The same of units in an order."""
        return Levels(self.by, self.names, self.groups, units)

    def has(self, unit: Any) -> bool:
        """Whether it is said in which groups a unit is."""
        return str(unit) in self.groups

    def check(self, units: Iterable[Any]) -> None:
        """Refuse units of which it is not said in which groups they are.

        Raises
        ------
        InputError
            There is one.
        """
        lost = next((unit for unit in units if not self.has(unit)), None)
        if lost is not None:
            found = f"no {self.names[0]} of {self.by} {str(lost)!r}"
            raise InputError(f"levels: found {found}, expected one of each")

    def labels(self, level: int) -> list[str]:
        """The group of each unit; a blank one where it is in none, and then tells nothing."""
        none = ("",) * len(self.names)
        return [self.groups.get(str(unit), none)[level] for unit in self.units]

    @property
    def numbers(self) -> list[list[int]]:
        """The groups of each level as numbers, as the core takes them."""
        out = []
        for level in range(len(self.names)):
            labels = self.labels(level)
            number = {label: k for k, label in enumerate(dict.fromkeys(labels))}
            out.append([number[label] for label in labels])
        return out

    def named(self, spreads: Iterable[Mapping[str, Any]]) -> list[dict[str, Any]]:
        """What the core says of each level, units first, with its name."""
        names = [self.by, *self.names]
        out = []
        for name, one in zip(names, spreads, strict=True):
            same = one["same_as"]
            out.append({"level": name, **one, "same_as": None if same is None else names[same]})
        return out


def beside(path: Path, by: str, names: tuple[str, ...]) -> Levels:
    """What `levels.csv` says of each unit: a row for each, with the column `by` and the levels.

    Raises
    ------
    InputError
        A column is missing, a cell is blank, or a unit has two rows that differ.
    """
    table = read_table(path)
    columns = dict(zip(table.names, table.columns, strict=True))
    for name in (by, *names):
        if name not in columns:
            found = f"no column {name!r} ({', '.join(table.names)})"
            raise InputError.at(str(path), found, f"columns {by} and the levels")
    cells = {name: list(columns[name]) for name in (by, *names)}
    out: dict[str, tuple[str, ...]] = {}
    for row in range(len(table.lines)):
        ragged = table.ragged.get(row)
        if ragged is not None:
            raise table.fault(row, ragged.column, ragged.found, ragged.expected)
        for name, column in cells.items():
            if is_blank(column[row]):
                raise table.fault(row, name, quoted(column[row]), "a name")
        unit, *own = (text(column[row]) for column in cells.values())
        if out.setdefault(unit, tuple(own)) != tuple(own):
            raise table.fault(row, by, f"{unit!r} again, in other groups", "one row of each")
    return Levels(by, names, out)


def groups_of(
    frame: Columns, by: str, names: Sequence[str]
) -> tuple[dict[Any, tuple[str, ...]], dict[Any, str]]:
    """Of each unit of a table its groups; why not, of a unit that has rows of several or of none.

    Raises
    ------
    InputError
        A column is missing.
    """
    for name in names:
        if name not in frame:
            found = f"no column {name!r} ({', '.join(frame)[:200]})"
            raise InputError(f"levels: found {found}, expected one, or levels.csv beside the data")
    out: dict[Any, tuple[str, ...]] = {}
    mixed: dict[Any, str] = {}
    for label, runs in runs_of(devices_in(frame[by])).items():
        own = []
        for name in names:
            cells = list(dict.fromkeys(text(c) for run in runs for c in list(frame[name][run])))
            own.append(cells[0])
            if any(is_blank(cell) for cell in cells):
                mixed[label] = f"column {name}: found blank, expected a name"
            elif len(cells) > 1:
                several = " and ".join(cells[:2])
                mixed[label] = (
                    f"found rows of {name} {several}, expected names of {by} for one each"
                )
        if label not in mixed:
            out[label] = tuple(own)
    return out, mixed
