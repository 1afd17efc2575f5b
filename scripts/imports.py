"""An import from one source file of a tree into another."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True)
class Import:
    """One file imports a name from another; paths are relative to the tree."""

    importer: str
    imported: str
    name: str
    own_folder: bool = False
    """Whether it is a name that the importer's own folder passes on from another file."""

    def __str__(self) -> str:
        return f"{self.importer} -> {self.imported}: {self.name}"
