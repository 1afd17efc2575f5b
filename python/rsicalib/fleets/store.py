"""The folder of a fleet: parts while it runs, one file of rows in the end."""

from __future__ import annotations

import json
import os
import secrets
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any, BinaryIO

import numpy as np

from rsicalib.arrays import FloatArray
from rsicalib.errors import InputError
from rsicalib.facts.records import to_json
from rsicalib.fleets.frames import TEXT, Rows
from rsicalib.io.extras import parquet_modules
from rsicalib.io.files import whole_file, write_text
from rsicalib.io.sources import read_json

GROUP = 10_000
"""Rows of a row group of `fleet.parquet`."""


class OnDisk(Mapping[str, list[Any]]):
    """Columns of a Parquet file, each read when it is asked for and kept by whoever asked.

    Parameters
    ----------
    path : path
        The file; without it there are no columns.
    parquet : module
        `pyarrow.parquet`.
    """

    def __init__(self, path: Path, parquet: Any) -> None:
        self._path, self._parquet = path, parquet
        self._names: list[str] = parquet.read_schema(path).names if path.exists() else []

    def __getitem__(self, name: str) -> list[Any]:
        if name not in self._names:
            raise KeyError(name)
        if name not in TEXT:
            found: list[Any] = self._read(name).to_pylist()
            return found
        # Many rows have the same text, which is one object then.
        texts: list[Any] = []
        for part in self._read(name).dictionary_encode().chunks:
            words = [*part.dictionary.to_pylist(), None]
            texts += [words[-1 if k is None else k] for k in part.indices.to_pylist()]
        return texts

    def numbers(self, name: str) -> FloatArray:
        """A column of numbers, NaN where there is none."""
        found: FloatArray = self._read(name).to_numpy().astype(np.float64)
        return found

    def _read(self, name: str) -> Any:
        return self._parquet.ParquetFile(self._path).read(columns=[name]).column(0)

    def __iter__(self) -> Iterator[str]:
        return iter(self._names)

    def __len__(self) -> int:
        return len(self._names)

    def __contains__(self, name: object) -> bool:
        return name in self._names


@dataclass(frozen=True)
class Parts:
    """The folder in which rows wait for the end of a run; travels to the workers."""

    folder: Path
    by: str
    mark: str
    """A file of this run in it: whoever sees the file sees the folder of the client."""
    texts: tuple[str, ...] = TEXT
    """Columns that hold text."""

    def keep(self, place: str, rows: Rows) -> Rows:
        """Write rows of a partition, by its place in the dataset; what is left to be written.

        That is all of them where this is not the client's disk, else the labels, to be counted.
        """
        if not rows or not (self.folder / self.mark).exists():
            return rows
        write_rows(self.folder / f"{place}.parquet", rows, self.by, self.texts)
        return {self.by: rows[self.by]}

    def lacks(self, rows: Rows) -> bool:
        """Whether rows that came back are still to be written."""
        return bool(rows.keys() - {self.by})


def write_rows(path: Path, rows: Rows, by: str, texts: Sequence[str] = TEXT) -> None:
    """Write results as a Parquet file that takes its place when it is whole."""
    arrow, parquet = parquet_modules(str(path))
    kinds = {name: arrow.string() if name in texts else arrow.float64() for name in rows}
    kinds[by] = None
    columns = {n: arrow.array(cells, kinds[n], from_pandas=True) for n, cells in rows.items()}
    with _opened(path) as file:
        parquet.write_table(arrow.table(columns), file)


@contextmanager
def _opened(path: Path) -> Iterator[BinaryIO]:
    """A file that takes its place when it is whole, whoever else writes the same."""
    try:
        with whole_file(path, shared=True) as file:
            yield file.buffer
    except InputError as error:
        raise InputError(f"--out: {error.message}") from None


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
        inside = Path(os.path.abspath(folder)) / "parts"
        texts = (*TEXT, *self.run.get("levels", ()))
        self.parts = Parts(inside, by, f"{secrets.token_hex(8)}.run", texts)
        self.table = folder / "fleet.parquet"
        self.arrow, self.parquet = parquet_modules(str(self.table))
        self.number = 0
        self.resumed = False

    def begin(self, resume: bool) -> dict[Any, str]:
        """Open the folder; the digest of each device whose row is kept."""
        earlier = self._earlier()
        try:
            old = sorted(self.parts.folder.glob("*.parquet"))
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
            self.parts.folder.mkdir(parents=True, exist_ok=True)
            (self.parts.folder / self.parts.mark).touch()
        except (OSError, ValueError) as error:
            raise self._no_folder(error) from None
        if not resume:
            self.table.unlink(missing_ok=True)
            old = []
        elif self.table.exists():
            old.append(self.table)
        self.resumed = bool(old)
        write_text(self.folder / "run.json", to_json(self.run))
        # New parts come after those that are there.
        heads = [p.stem.split(".")[0] for p in old]
        self.number = 1 + max((int(head) for head in heads if head.isdigit()), default=0)
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

    def keep(self, place: str, rows: Rows) -> None:
        """Write the rows of a partition, by its place in the dataset, where no worker has."""
        if self.parts.lacks(rows):
            write_rows(self.parts.folder / f"{place}.parquet", rows, self.by, self.parts.texts)

    def finish(self, order: Mapping[Any, int]) -> OnDisk:
        """All rows of devices that are in the dataset, in its order, as the one file.

        Parts of one run stand in the order of the dataset, and are copied one after the other;
        those of a resumed one are put into the `order` of its devices.
        """
        parts = sorted(self.parts.folder.glob("*.parquet"))
        if self.resumed:
            merged = self._merged([self.table, *parts], order)
            write_rows(self.table, merged, self.by, self.parts.texts)
        elif parts:
            with _opened(self.table) as file:
                self._copied(parts, file)
        for path in self.parts.folder.glob("*"):
            path.unlink()
        self.parts.folder.rmdir()
        return OnDisk(self.table, self.parquet)

    def _merged(self, files: Sequence[Path], order: Mapping[Any, int]) -> Rows:
        """The last row of each device of some files."""
        tables = [self.parquet.read_table(path) for path in files if path.exists()]
        if not tables:
            return {}
        rows: Rows = self.arrow.concat_tables(tables, promote_options="permissive").to_pydict()
        last = {label: i for i, label in enumerate(rows[self.by]) if label in order}
        picked = [last[label] for label in sorted(last, key=lambda label: order[label])]
        return {name: [cells[i] for i in picked] for name, cells in rows.items()}

    def _copied(self, files: Sequence[Path], to: BinaryIO) -> None:
        """Rows of files one after the other, a row group at a time."""
        schemas = [self.parquet.read_schema(file) for file in files]
        schema = self.arrow.unify_schemas(schemas, promote_options="permissive")
        schema = schema.remove_metadata()
        with self.parquet.ParquetWriter(to, schema) as out:
            waiting: list[Any] = []
            for k, file in enumerate(files):
                waiting.append(self.parquet.read_table(file))
                rows = sum(table.num_rows for table in waiting)
                if rows >= GROUP or k + 1 == len(files):
                    table = self.arrow.concat_tables(waiting, promote_options="permissive")
                    for name in schema.names:
                        if name not in table.column_names:
                            empty = self.arrow.nulls(table.num_rows, schema.field(name).type)
                            table = table.append_column(name, empty)
                    out.write_table(table.select(schema.names).cast(schema))
                    waiting = []

    def write_population(self, found: Mapping[str, Any], devices: Rows) -> tuple[Path, ...]:
        """Write what the devices share, and a row for each with it."""
        place = self.folder / "population.parquet"
        write_rows(place, devices, next(iter(devices)))
        return (write_text(self.folder / "population.json", to_json(found)), place)

    def write_page(self, html: str) -> tuple[Path, ...]:
        """Write the page; all files of the run."""
        return (self.table, write_text(self.folder / "fleet.html", html))
