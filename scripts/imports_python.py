"""Imports within a Python package, by `ast`."""

from __future__ import annotations

import ast
from collections.abc import Iterator
from pathlib import Path

from scripts.imports import Import

INITS = ("__init__.py", "__init__.pyi")


def read(folder: Path) -> tuple[tuple[str, ...], tuple[Import, ...]]:
    """Find the files of a package, and what they import from each other.

    Parameters
    ----------
    folder : path
        Of the package; its name is that of the package.

    Returns
    -------
    files : tuple of str
        Paths within the folder.
    imports : tuple of Import
        In the order of the files.
    """
    package = _Package(folder)
    found = dict.fromkeys(one for file in package.trees for one in package.imports(file))
    return tuple(package.trees), tuple(found)


class _Package:
    """Modules of a package by their dotted names."""

    def __init__(self, folder: Path) -> None:
        self.name = folder.name
        paths = [*folder.rglob("*.py"), *folder.rglob("*.pyi")]
        self.trees = {
            path.relative_to(folder).as_posix(): ast.parse(path.read_text(encoding="utf-8"))
            for path in sorted(paths)
        }
        self.files = {self._module(file): file for file in self.trees}

    def _module(self, file: str) -> str:
        parts = [self.name, *file.rsplit(".", 1)[0].split("/")]
        return ".".join(parts[:-1] if parts[-1] == "__init__" else parts)

    def imports(self, file: str) -> Iterator[Import]:
        """What a file imports from the others, declarations of its own children left out."""
        module = self._module(file)
        declares = file.endswith(INITS)
        for source, name in self._names(file):
            passed_on = name and f"{source}.{name}" not in self.files
            own_folder = bool(passed_on) and _within(module, source)
            own_folder = own_folder and self.files.get(source, "").endswith(INITS)
            target = self.files.get(source) if own_folder else self._defining(source, name)
            if target is None or target == file:
                continue
            if declares and _within(self._module(target), module):
                continue
            yield Import(file, target, name or source, own_folder)

    def _names(self, file: str) -> Iterator[tuple[str, str]]:
        """Modules of the package, and the names that a file imports from them."""
        here = self._module(file).split(".")
        folder = here if file.endswith(INITS) else here[:-1]
        for node in ast.walk(self.trees[file]):
            if isinstance(node, ast.Import):
                for alias in node.names:
                    if _within(alias.name, self.name):
                        yield alias.name, ""
            elif isinstance(node, ast.ImportFrom):
                source = node.module or ""
                if node.level:
                    above = folder[: len(folder) - node.level + 1]
                    source = ".".join([*above, *([source] if source else [])])
                if _within(source, self.name):
                    yield from ((source, alias.name) for alias in node.names)

    def _defining(self, source: str, name: str) -> str | None:
        """The file that defines a name: a module, or where an `__init__.py` has it from."""
        if name and f"{source}.{name}" in self.files:
            return self.files[f"{source}.{name}"]
        file = self.files.get(source)
        if file is None or not name or not file.endswith(INITS):
            return file
        for node in self.trees[file].body:
            if isinstance(node, ast.ImportFrom) and node.module and not node.level:
                for alias in node.names:
                    if (alias.asname or alias.name) == name and _within(node.module, self.name):
                        return self._defining(node.module, alias.name)
        return file


def _within(module: str, package: str) -> bool:
    return module == package or module.startswith(f"{package}.")
