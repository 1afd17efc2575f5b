"""Reports of single devices of a fleet, for the page to lead to."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any

from rsicalib._core import Mechanism
from rsicalib.errors import RsicalibError
from rsicalib.fleets.dataset import Partition
from rsicalib.fleets.devices import one_device
from rsicalib.io.files import write_text
from rsicalib.verbs.tracing import trace

FOLDER = "devices"
"""Folder of the reports, beside the page."""


def write_reports(
    partitions: Iterator[Partition],
    devices: Sequence[Any],
    folder: Path,
    mechanism: Mechanism,
    options: Mapping[str, Any],
    told: Callable[[int], None],
) -> dict[str, str]:
    """Trace some devices alone and write their reports.

    Parameters
    ----------
    partitions : iterator of Partition
        The dataset; it is read until all devices were found.
    devices : sequence
        Their labels; the first has the first file.
    folder : Path
        Of the fleet.
    mechanism : Mechanism
        What all devices are.
    options : mapping
        `terms`, `closures` and `noise`, as of the fleet.
    told : callable
        Called with the number of reports that are done.

    Returns
    -------
    dict of str to str
        Of each device its report, from the folder; none of one that cannot be used.
    """
    for old in (folder / FOLDER).glob("*.html"):
        old.unlink()  # of an earlier run, whose devices had other numbers
    numbers = {label: number for number, label in enumerate(devices, start=1)}
    found: dict[str, str] = {}
    for part in partitions if devices else ():
        for label in part.labels:
            number = numbers.pop(label, None)
            if number is None:
                continue
            link = f"{FOLDER}/{number}.html"
            try:
                readings, rest = one_device(part.frame, part.rest, part.by, label)
                result = trace(readings, mechanism, rest=rest, device=str(label), **options)
            except RsicalibError:
                continue  # its row says why
            (folder / FOLDER).mkdir(exist_ok=True)
            write_text(folder / link, result.report())
            found[str(label)] = link
            told(len(found))
        if not numbers:
            break
    return found
