"""Check the layers of the source trees: `python -m scripts.layers`.

A file may import from its own folder and from earlier layers, and no files may import each other
in a circle. An import counts wherever it stands: in a function or under `TYPE_CHECKING` as well.
A folder's `__init__.py` or `mod.rs` that names its own children declares them and imports nothing.
A name that it passes on counts as imported from the file that defines the name; a file inside the
folder takes it from that file directly. Tests within Rust files do not count.

Wrong imports are printed as `file -> file: name`, and the command then exits with 1.
"""

from __future__ import annotations

import sys
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from functools import cache
from pathlib import Path

from scripts import imports_python, imports_rust
from scripts.imports import Import

ROOT = Path(__file__).parents[1]

PYTHON = (
    "_core",
    "plain_text",
    "errors",
    "options",
    "arrays",
    "tabular",
    "labels",
    "units",
    "plots",
    "cores",
    "facts",
    "io",
    "imports",
    "report",
    "results",
    "work",
    "poses",
    "planning",
    "verbs",
    "exports",
    "guide",
    "fleets",
    "reproduction",
    "api",
    "cli",
    "__main__",
)
"""Modules and folders of `python/rsicalib`, lowest first."""

RUST = (
    "stated",
    "text",
    "error",
    "numerics",
    "closures",
    "mechanism",
    "readings",
    "kinematics",
    "terms",
    "model",
    "estimate",
    "apply",
    "monitor",
    "screening",
    "diagnosis",
    "history",
    "population",
    "design",
    "report",
)
"""Modules and folders of `crates/rsicalib/src`, lowest first."""

BINDINGS = (
    "error",
    "values",
    "threads",
    "numbers",
    "mechanism",
    "tables",
    "options",
    "apply",
    "documents",
    "experiments",
    "history",
    "monitor",
    "population",
    "raw",
    "devices",
    "observations",
    "design",
)
"""Modules of `crates/rsicalib-py/src`, lowest first."""

TOPS = ("__init__.py", "__init__.pyi", "lib.rs")
"""Files that stand above all layers: they list what is public."""


@dataclass(frozen=True)
class Tree:
    """The source files of one folder, by their paths within it, and what they import."""

    files: tuple[str, ...]
    imports: tuple[Import, ...]


@cache
def python_tree(folder: Path) -> Tree:
    """Read a Python package, compiled modules by their stubs."""
    return Tree(*imports_python.read(folder))


@cache
def rust_tree(folder: Path) -> Tree:
    """Read the `src` folder of a crate."""
    return Tree(*imports_rust.read(folder))


def problems(tree: Tree, layers: Sequence[str]) -> list[str]:
    """List what is wrong with a tree.

    Parameters
    ----------
    tree : Tree
        From `python_tree` or `rust_tree`.
    layers : sequence of str
        Names of modules and folders at the top, lowest first.

    Returns
    -------
    list of str
        One line for each module that is not in `layers` and for each wrong import.
    """
    rank = {name: k for k, name in enumerate(layers)}
    tops = dict.fromkeys(layer_of(file) for file in tree.files if file not in TOPS)
    lines = [f"{name}: not in the list of layers" for name in tops if name not in rank]
    inside = [one for one in tree.imports if one.importer not in TOPS]
    for one in inside:
        if one.imported in TOPS:
            lines.append(f"{one} (the top of the tree)")
        elif one.own_folder:
            lines.append(f"{one} (from its own folder: import it from the file that defines it)")
        elif rank.get(layer_of(one.importer), -1) < rank.get(layer_of(one.imported), -1):
            lines.append(f"{one} (a later layer)")
    for circle in circles(inside):
        lines += [f"{one} (a circle of {len(circle)} files)" for one in circle]
    return lines


def layer_of(file: str) -> str:
    """Name of the module or folder at the top that a file belongs to."""
    return file.split("/")[0].split(".")[0]


def circles(imports: Iterable[Import]) -> list[list[Import]]:
    """Find circles of imports: a shortest one through each file that is in none found before."""
    by_file: dict[str, dict[str, Import]] = {}
    for one in imports:
        if one.importer != one.imported:
            by_file.setdefault(one.importer, {}).setdefault(one.imported, one)
    found = []
    seen: set[str] = set()
    for start in sorted(by_file):
        if start in seen:
            continue
        circle = _shortest(start, by_file)
        if circle:
            found.append(circle)
            seen |= {one.importer for one in circle}
    return found


def _shortest(start: str, by_file: dict[str, dict[str, Import]]) -> list[Import]:
    """The shortest way from a file back to itself; empty if there is none."""
    ways: dict[str, list[Import]] = {start: []}
    queue = [start]
    for file in queue:
        for imported, one in by_file.get(file, {}).items():
            if imported == start:
                return [*ways[file], one]
            if imported not in ways:
                ways[imported] = [*ways[file], one]
                queue.append(imported)
    return []


def main() -> int:
    """Check all trees; 1 if anything is wrong."""
    trees = [
        ("python/rsicalib", python_tree, PYTHON),
        ("crates/rsicalib/src", rust_tree, RUST),
        ("crates/rsicalib-py/src", rust_tree, BINDINGS),
    ]
    wrong = 0
    for folder, read, layers in trees:
        for line in problems(read(ROOT / folder), layers):
            print(f"{folder}: {line}")
            wrong = 1
    return wrong


if __name__ == "__main__":
    sys.exit(main())
