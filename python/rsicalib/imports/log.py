"""A log of another program after it was read: its sessions as readings, and what was found."""

from __future__ import annotations

import hashlib
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any, ClassVar, TypeAlias

import numpy.typing as npt

from rsicalib import _core
from rsicalib.arrays import Alike, IntArray
from rsicalib.facts.records import to_json
from rsicalib.facts.warned import Warned
from rsicalib.io.cells import MechanismLike
from rsicalib.io.csv_text import csv_of
from rsicalib.io.folders import IMPORT, MARK, OF_LOG, Sealed
from rsicalib.io.readings import Readings, readings_of_table
from rsicalib.io.tables import Table
from rsicalib.plain_text import counted
from rsicalib.tabular import Told

Column: TypeAlias = npt.NDArray[Any] | Sequence[str]


@dataclass(frozen=True, eq=False)
class Session(Alike):
    """Rows that were taken in one go, with the columns of a file of readings.

    Attributes
    ----------
    columns : mapping of str to sequence
        By name: numbers or text, `n` each.
    lines : ndarray of int, shape (n,)
        Where in the log each row stands, counted as the log's `line_word` says.
    name : str
        What the log calls it: `episode 3`.
    motion : Session or None
        Rows between held poses.
    """

    columns: Mapping[str, Column]
    lines: IntArray
    name: str = ""
    motion: Session | None = None

    def __len__(self) -> int:
        return len(self.lines)

    @property
    def n_poses(self) -> int:
        """Number of held poses; of rows where none is held."""
        return len(set(self.columns["pose"])) if "pose" in self.columns else len(self)

    def csv(self) -> str:
        """The text of a file of readings."""
        return csv_of(self.columns)


@dataclass(frozen=True, eq=False, repr=False)
class Log(Alike, Told, Sealed):
    """What `import_log` makes of the log of another program.

    Attributes
    ----------
    source : str
        Path as it was given.
    format : str
        What it is, in words.
    sessions : tuple
        One for each run, episode or file.
    mechanism : str or None
        Text of a mechanism file, where the log has one in it.
    findings : tuple of str
        What its user should know; nothing was repaired.
    line_word : str
        What `Session.lines` counts: lines, rows or messages.
    sha256 : str
        Digest of the bytes that were read.
    """

    SEAL: ClassVar[str] = IMPORT

    source: str
    format: str
    sessions: tuple[Session, ...]
    mechanism: str | None = None
    findings: tuple[str, ...] = ()
    line_word: str = "line"
    sha256: str = field(default="", kw_only=True)

    def readings(self, mechanism: MechanismLike, *, skip_bad_rows: bool = False) -> list[Readings]:
        """The sessions as `load_readings` would load their files.

        Parameters
        ----------
        mechanism : Mechanism
            Whose channels are taken.
        skip_bad_rows : bool
            Drop rows that cannot be used.

        Returns
        -------
        list of Readings
            One for each session; what was found is a warning of the first.

        Raises
        ------
        InputError
            A row cannot be used; the message says where it stands in the log.
        """
        found = []
        for session in self.sessions:
            source = f"{self.source} ({session.name})" if session.name else self.source
            columns = list(session.columns.values())
            table = Table(
                list(session.columns), columns, session.lines, self.line_word, source, self.sha256
            )
            found.append(readings_of_table(table, mechanism, skip_bad_rows))
        said = tuple(
            Warned("imported", None, f"{self.source}: {finding}") for finding in self.findings
        )
        return [replace(found[0], warnings=(*said, *found[0].warnings)), *found[1:]]

    def files(self) -> dict[str, str]:
        """Text of each file that `save` writes, by its name."""
        files = {}
        for number, session in enumerate(self.sessions):
            tail = f"_{number:03d}" if len(self.sessions) > 1 else ""
            files[f"readings{tail}.csv"] = session.csv()
            if session.motion is not None:
                files[f"motion{tail}.csv"] = session.motion.csv()
        if self.mechanism is not None:
            head = f"# {MARK} {_core.__version__} from {Path(self.source).name}\n"
            files[OF_LOG] = head + self.mechanism
        digests = {n: hashlib.sha256(t.encode()).hexdigest() for n, t in files.items()}
        return {**files, IMPORT: to_json({**self.to_dict(), "files": digests})}

    def to_dict(self) -> dict[str, Any]:
        """What is in the log, without its rows."""
        sessions = [
            {
                "name": s.name or None,
                "samples": len(s),
                "poses": s.n_poses if "pose" in s.columns else None,
                "in_motion": None if s.motion is None else len(s.motion),
                "columns": list(s.columns),
            }
            for s in self.sessions
        ]
        return {
            "format": "rsicalib.import/1",
            "version": _core.__version__,
            "source": self.source,
            "kind": self.format,
            "sha256": self.sha256,
            "sessions": sessions,
            "findings": list(self.findings),
        }

    def text(self) -> str:
        """The log in a few lines."""
        lines = [f"{self.source}: {self.format}"]
        for session in self.sessions:
            held = "pose" in session.columns
            poses = f"{counted(session.n_poses, 'held pose')}, " if held else ""
            moving = 0 if session.motion is None else len(session.motion)
            motion = f", {counted(moving, 'row')} in motion" if moving else ""
            name = f"{session.name}: " if session.name else ""
            kind = "" if held else ", a recording"
            lines.append(f"  {name}{poses}{counted(len(session), 'sample')}{motion}{kind}")
        lines += [f"  columns: {', '.join(self.sessions[0].columns)}"] if self.sessions else []
        return "\n".join([*lines, *(f"  note: {finding}" for finding in self.findings)])

    def __repr__(self) -> str:
        return f"<Log {self.source!r}: {self.format}, {counted(len(self.sessions), 'session')}>"
