"""Readings and mechanisms as their files: CSV and TOML, as a user writes them."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

from tests.machines.kit import Machine
from tests.oracle import Array

PAUSE_S = 20.0
"""From one pose to the next."""


def toml(document: Mapping[str, Any]) -> str:
    """Values as TOML text: one key a line, tables inline. `TypeError` for what is no value."""
    return "".join(f"{key} = {value(one)}\n" for key, one in document.items())


def value(one: Any) -> str:
    """One value of TOML on one line."""
    if isinstance(one, bool):
        return "true" if one else "false"
    if isinstance(one, str):
        return '"' + one.replace("\\", "\\\\").replace('"', '\\"') + '"'
    if isinstance(one, int | float):
        return repr(one)
    if isinstance(one, Mapping):
        return "{" + ", ".join(f"{key} = {value(v)}" for key, v in one.items()) + "}"
    if isinstance(one, list | tuple):
        return "[" + ", ".join(value(v) for v in one) + "]"
    raise TypeError(f"no value of TOML: {one!r}")


def readings(machine: Machine, read: Array) -> str:
    """A session as CSV: a row for each pose; what was not seen is left empty."""
    lines = [",".join(["pose", "time_s", *machine.columns, *machine.text])]
    for n, row in enumerate(read):
        cells = [f"{x:.7f}" for x in row]
        if machine.empty is not None:
            cells = ["" if gone else c for c, gone in zip(cells, machine.empty[n], strict=True)]
        place = [str(n + 1), f"{PAUSE_S * n:.1f}"]
        lines.append(",".join([*place, *cells, *(c[n] for c in machine.text.values())]))
    return "\n".join(lines) + "\n"


def write(machine: Machine, read: Array, folder: Path) -> tuple[Path, Path]:
    """Writes both files; their paths, the readings' first."""
    folder.mkdir(parents=True, exist_ok=True)
    csv, mechanism = folder / "readings.csv", folder / "mechanism.toml"
    csv.write_text(readings(machine, read), encoding="utf-8")
    mechanism.write_text(toml(machine.mechanism), encoding="utf-8")
    return csv, mechanism
