"""The folder of a fleet: parts while it runs, one file of rows in the end."""

from __future__ import annotations

import json
import os
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from rsicalib.errors import InputError
from rsicalib.facts.records import to_json
from rsicalib.fleets.dataset import pyarrow_modules
from rsicalib.fleets.engines import Rows
from rsicalib.fleets.frames import TEXT
from rsicalib.io.files import write_text
from rsicalib.io.sources import read_json

__all__ = ["Store"]


class Store:
    """A folder with `run.json`, `parts/` while a run lasts, then `fleet.parquet` and `fleet.html`.

    Every file takes its place when it is whole, so that an interrupted run leaves rows that
    can be kept, and nothing else.

    Parameters
    ----------
    folder : path
        Made if it is not there.
    by : str
        The column that names the device.
    run : mapping
        What the rows depend on beside the readings; a run is resumed with the same only.
    """

    def __init__(self, folder: Path, by: str, run: Mapping[str, Any]) -> None:
        self.folder, self.by, self.run = folder, by, dict(run)
        self.parts = folder / "parts"
        self.table = folder / "fleet.parquet"
        self.arrow, self.parquet = pyarrow_modules(str(self.table))
        self.number = 0

    def begin(self, resume: bool) -> dict[Any, str]:
        """Open the folder; the digest of each device whose row is kept."""
        earlier = self._earlier()
        try:
            old = sorted(self.parts.glob("*.parquet"))
        except (OSError, ValueError) as error:
            raise self._no_folder(error) from None
        if not resume and earlier is None and os.path.exists(self.table):
            found = f"'{self.table}', which no run of this command has made"
            raise InputError(f"--out: found {found}, expected a folder of its own")
        if not resume and old:
            found = f"an interrupted run in '{self.folder}'"
            raise InputError(f"--out: found {found}, expected --resume, or another folder")
        if resume and earlier is not None:
            for key in self.run.keys() | earlier.keys():
                if self.run.get(key) != earlier.get(key):
                    found = f"a run with {key} = {json.dumps(earlier.get(key))}"
                    expected = f"the same as now, {json.dumps(self.run.get(key))}"
                    raise InputError(f"--resume: found {found}, expected {expected}")
        try:
            self.parts.mkdir(parents=True, exist_ok=True)
        except (OSError, ValueError) as error:
            raise self._no_folder(error) from None
        if not resume:
            self.table.unlink(missing_ok=True)
            old = []
        elif self.table.exists():
            old.append(self.table)
        write_text(self.folder / "run.json", to_json(self.run))
        numbers = [int(p.stem) for p in old if p.stem.isdigit()]
        self.number = max(numbers, default=0)
        known: dict[Any, str] = {}
        for path in old:
            rows = self.parquet.read_table(path, columns=[self.by, "sha256"]).to_pydict()
            pairs = zip(rows[self.by], rows["sha256"], strict=True)
            known |= {label: sha for label, sha in pairs if sha is not None}
        return known

    def _no_folder(self, error: Exception) -> InputError:
        reason = getattr(error, "strerror", None) or error
        found = f"'{self.folder}', which cannot be a folder ({reason})"
        return InputError(f"--out: found {found}, expected a folder")

    def _earlier(self) -> dict[str, Any] | None:
        try:
            return read_json(self.folder / "run.json", "the run of a fleet")
        except InputError:
            return None

    def keep(self, rows: Rows) -> None:
        """Write the rows of a partition."""
        self.number += 1
        self._write(rows, self.parts / f"{self.number:06}.parquet")

    def _write(self, rows: Rows, path: Path) -> None:
        names = list(rows)
        types = [self._type(name) for name in names]
        arrays = [
            self.arrow.array(rows[name], kind, from_pandas=True)
            for name, kind in zip(names, types, strict=True)
        ]
        part = path.with_suffix(".part")
        try:
            self.parquet.write_table(self.arrow.table(arrays, names=names), part)
            part.replace(path)
        except OSError as error:
            found = f"'{path}', where one cannot write ({error.strerror})"
            raise InputError(f"--out: found {found}, expected a place for a file") from None
        finally:
            part.unlink(missing_ok=True)

    def _type(self, name: str) -> Any:
        if name == self.by:
            return None
        return self.arrow.string() if name in TEXT else self.arrow.float64()

    def finish(self, order: Mapping[Any, int]) -> Rows:
        """All rows of devices that are in the dataset, in its order, as the one file."""
        files = [self.table] if self.table.exists() else []
        files += sorted(self.parts.glob("*.parquet"))
        if not files:
            return {}
        tables = [self.parquet.read_table(path) for path in files]
        rows: Rows = self.arrow.concat_tables(tables, promote_options="permissive").to_pydict()
        last = {label: i for i, label in enumerate(rows[self.by]) if label in order}
        picked = [last[label] for label in sorted(last, key=lambda label: order[label])]
        rows = {name: [cells[i] for i in picked] for name, cells in rows.items()}
        self._write(rows, self.table)
        for path in self.parts.glob("*"):
            path.unlink()
        self.parts.rmdir()
        return rows

    def write_population(self, found: Mapping[str, Any], devices: Rows) -> tuple[Path, ...]:
        """Write what the devices share, and a row for each with it."""
        place = self.folder / "population.parquet"
        self._write(devices, place)
        return (write_text(self.folder / "population.json", to_json(found)), place)

    def write_page(self, html: str) -> tuple[Path, ...]:
        """Write the page; all files of the run."""
        return (self.table, write_text(self.folder / "fleet.html", html))
