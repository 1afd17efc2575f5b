"""Which program wrote a file or a folder, told from its head; what reads it is imported then."""

from __future__ import annotations

import csv
import importlib
import os
import re
import zlib
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from rsicalib.imports.asked import Asked
from rsicalib.imports.log import Log
from rsicalib.io.tables import PARQUET

HEAD = 1 << 20
"""Bytes at the head of a file that tell what it is: a log has much talk before its readings."""


@dataclass(frozen=True)
class Kind:
    """One kind of log, which the module of its name reads."""

    words: str
    looks_like: Callable[[Path, bytes], bool]
    module: str
    takes: str
    """Options that mean something for it, beside `labels` and `channels`."""

    def read(self, source: str, asked: Asked) -> Log:
        """Read a log of this kind."""
        module: Any = importlib.import_module(f"rsicalib.imports.{self.module}")
        log: Log = module.read(source, asked)
        return log


GZIP = zlib.MAX_WBITS | 16
"""What zlib calls the format of a gzip file."""

MASLOW = re.compile(rb"CLBM:|\{\s*[\"']?(?:tl|tr|bl|br)[\"']?\s*:")
KLIPPER = re.compile(rb"^(?:#\*# )?\[(?:stepper_[a-z]|delta_calibrate|printer)\]", re.M)
ECHOED = re.compile(
    rb"^header:\s*$(?:\r?\n.*)*?\r?\n^position:|^\{(?=.*\"name\"\s*:\s*\[).*\"position\"\s*:\s*\[",
    re.M,
)
PLOTTED = re.compile(
    rb'\A(?:\xef\xbb\xbf)?(?:"?__time"?,|[^\n]*/position'
    rb"|[\w ]+,receive time,header\.stamp,topic,value\s)"
)
DEPTH = 4
"""Folders between a data set and a file of it, at most: `meta/episodes/chunk-000` of LeRobot."""


def _columns(path: Path, head: bytes) -> bool:
    """Whether a plotting program wrote a table, or a folder is one of Parquet files."""
    if os.path.isdir(path):
        return _holds(path, DEPTH)
    return bool(PLOTTED.match(head))


def _holds(folder: Path, depth: int) -> bool:
    """Whether a folder, or one below it, holds a Parquet file; hidden ones are not looked at."""
    with os.scandir(folder) as entries:
        seen = [entry for entry in entries if not entry.name.startswith(".")]
    if any(os.path.splitext(entry.name)[1].lower() in PARQUET for entry in seen):
        return True
    below = [Path(entry.path) for entry in seen if entry.is_dir(follow_symlinks=False)]
    return depth > 0 and any(_holds(one, depth - 1) for one in below)


def _lerobot(path: Path, _: bytes) -> bool:
    return (path / "meta" / "info.json").is_file()


def _hdf5(path: Path, head: bytes) -> bool:
    return head.startswith(b"\x89HDF") or (path.is_dir() and any(path.glob("*.hdf5")))


def _ros(path: Path, head: bytes) -> bool:
    if path.is_dir():
        return (path / "metadata.yaml").is_file() or any(map(_is_part, path.iterdir()))
    return head.startswith((b"\x89MCAP0", b"SQLite format 3\0", b"#ROSBAG V2.0"))


def _is_part(file: Path) -> bool:
    """Whether a file is a part of a bag, packed or not."""
    return file.name.removesuffix(".zstd").endswith((".mcap", ".db3"))


KINDS = {
    "ros": Kind(
        "bag of ROS: folder, .mcap, .db3 or .bag", _ros, "ros", "topic when hold rate skip_bad_rows"
    ),
    "echo": Kind(
        "joint states as text: ros2 topic echo, or JSON a line",
        lambda _, head: bool(ECHOED.search(head)),
        "echo",
        "hold rate skip_bad_rows",
    ),
    "lerobot": Kind("LeRobot data set", _lerobot, "lerobot", "hold episodes ranges"),
    "aloha": Kind("HDF5 of the shape of ALOHA", _hdf5, "aloha", "hold rate"),
    "maslow": Kind("log of a Maslow4", lambda _, head: bool(MASLOW.search(head)), "maslow", ""),
    "klipper": Kind("printer.cfg", lambda _, head: bool(KLIPPER.search(head)), "klipper", ""),
    "columns": Kind(
        "CSV or Parquet of other programs", _columns, "columns", "hold rate skip_bad_rows"
    ),
}
"""By name, in the order in which they are tried."""


def format_of(source: str | os.PathLike[str]) -> str | None:
    """Name of the kind of a file or folder; None for a file of readings as it is.

    Parameters
    ----------
    source : path
        A file or a folder.

    Returns
    -------
    str or None
        A key of `KINDS`.
    """
    path = Path(source)
    if whole_of(path) is not None:
        return None
    head = b""
    if os.path.isfile(path):
        try:
            head = _head(path)
        except OSError:
            return None  # who reads it says why it cannot be read
    elif not os.path.isdir(path):
        return None
    return next((name for name, kind in KINDS.items() if kind.looks_like(path, head)), None)


def _head(path: Path) -> bytes:
    """What a file begins with, text as UTF-8: who reads it says how to save it."""
    with path.open("rb") as file:
        head = file.read(HEAD)
    if head[:2] in (b"\xff\xfe", b"\xfe\xff"):
        head = head.decode("utf-16", "ignore").encode()
    return head


def is_table(source: str | os.PathLike[str]) -> bool:
    """Whether a file is a table: Parquet by its name, or text with cells in its first two lines.

    Readings are such tables, too: only who imports a file takes it for one of another program.
    """
    path = Path(source)
    if not os.path.isfile(path):
        return False
    if path.suffix.lower() in PARQUET:
        return True
    try:
        head = _head(path)
        if head.startswith(b"\x1f\x8b"):  # one that is cut has a head, too
            head = zlib.decompressobj(GZIP).decompress(head, HEAD)
    except (OSError, zlib.error):
        return False
    lines = head.decode("utf-8-sig", "replace").splitlines()
    lines = [line for line in lines if line.strip() and not line.startswith("#")][:2]
    if len(lines) < 2 or "\0" in lines[0] + lines[1] or lines[0].startswith(("{", "[")):
        return False
    mark = next((mark for mark in ",;\t" if mark in lines[0]), ",")
    try:
        rows = list(csv.reader(lines, delimiter=mark))
    except csv.Error:
        return False
    return len(rows) == 2 and len(rows[0]) == len(rows[1]) > 1


def whole_of(source: str | os.PathLike[str]) -> Path | None:
    """The data set of LeRobot that a file or a folder is a part of; None where it is none."""
    path = Path(os.path.abspath(source))
    if not os.path.exists(path):  # of a name that is too long, too
        return None
    return next((p for p in [*path.parents][:DEPTH] if _lerobot(p, b"")), None)
