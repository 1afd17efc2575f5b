"""The document of a reproduction: tables with their cells, misprints, and their text."""

from __future__ import annotations

from rsicalib.facts.records import Record
from rsicalib.tabular import Told


class Cell(Record):
    """One figure of a table."""

    computed: float | None = None
    """Our figure; None where the paper gives nothing to compute it from."""
    printed: float | None = None
    """Figure of the paper, misprints corrected; None where it has no such figure."""
    sd: float | None = None
    """Standard error of `computed`, where it is a mean over trials."""

    def text(self) -> str:
        """Our figure ± its standard error, the printed one in parentheses."""
        out = "-" if self.computed is None else f"{self.computed:.4g}"
        if self.sd is not None:
            out += f" ± {self.sd:.1g}"
        return out if self.printed is None else f"{out} ({self.printed:.4g})"


class Row(Record):
    """A line of a table."""

    label: str
    """What the line is of."""
    cells: tuple[Cell, ...]
    """Its figures, one for each column."""


class Table(Record):
    """A table of the paper, or a set of figures from its text."""

    id: str
    """`I` to `IX`, `convergence`, `calibrations`, `bound`."""
    title: str
    """What it shows."""
    columns: tuple[str, ...]
    """Heads of the cells, with units."""
    rows: tuple[Row, ...]
    """The figures."""
    verdict: str
    """`reproduced`, `partly reproduced`, `order only`, `simulated`, `as printed` or `ours`."""
    notes: tuple[str, ...] = ()
    """What differs, and why."""

    def __getitem__(self, label: str) -> Row:
        """The row of a label."""
        for row in self.rows:
            if row.label == label:
                return row
        raise KeyError(f"no row {label!r} in Table {self.id}; there are {self._labels()}")

    def _labels(self) -> str:
        return ", ".join(row.label for row in self.rows)

    def text(self) -> str:
        """The table for people: computed figures, printed ones in parentheses."""
        head = ["", *self.columns]
        body = [[row.label, *(cell.text() for cell in row.cells)] for row in self.rows]
        body = [line + [""] * (len(head) - len(line)) for line in body]
        widths = [max(len(line[k]) for line in [head, *body]) for k in range(len(head))]
        name = f"Table {self.id}" if self.id.isupper() else self.id.capitalize()
        out = [f"{name}: {self.title} [{self.verdict}]"]
        for line in [head, *body]:
            first = line[0].ljust(widths[0])
            rest = (cell.rjust(width) for cell, width in zip(line[1:], widths[1:], strict=True))
            out.append("  ".join([first, *rest]).rstrip())
        out += [f"- {note}" for note in self.notes]
        return "\n".join(out) + "\n"


class Misprint(Record):
    """A place where the paper cannot mean what it prints."""

    where: str
    """The place."""
    printed: str
    """What stands there."""
    right: str
    """What should stand there."""
    why: str
    """The calculation, with its numbers."""
    evidence: dict[str, float]
    """The numbers alone."""


class Paper(Told, Record, repr=False):
    """Everything that the paper prints, computed again."""

    format: str
    """Kind of the document and version of its shape."""
    version: str
    """Version of the program."""
    trials: int
    """Number of trials of the simulations."""
    seed: int
    """Their seed."""
    tables: tuple[Table, ...]
    """In the paper's order, then convergence, calibrations and the bound."""
    misprints: tuple[Misprint, ...]
    """Each settled by a calculation."""

    def __getitem__(self, table: str) -> Table:
        """A table by its id."""
        for one in self.tables:
            if one.id == table:
                return one
        raise KeyError(f"no table {table!r}; there are {', '.join(t.id for t in self.tables)}")

    def __repr__(self) -> str:
        return (
            f"<Paper: {len(self.tables)} tables, {len(self.misprints)} misprints, "
            f"{self.trials} trials, seed {self.seed}>"
        )

    def text(self) -> str:
        """Every table and every misprint for people."""
        out = [
            "The tables of Hollerbach and Lokhorst, computed again.",
            "Computed figures ± standard error (printed figures); inches and radians.",
            f"{self.trials} trials in a simulated cell, seed {self.seed}.",
            "",
        ]
        out += [table.text() for table in self.tables]
        out.append("Misprints and gaps, each settled by a calculation:")
        for m in self.misprints:
            out += ["", f"{m.where}: {m.printed}  ->  {m.right}", f"  {m.why}"]
        return "\n".join(out) + "\n"
