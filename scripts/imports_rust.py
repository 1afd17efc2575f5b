"""Imports within a crate: `use` and paths that begin with `crate`, `super` or `self`.

A method is imported too, from the file whose `impl` it stands in: a type whose `impl`s are split
over files hides circles else. In an `impl` of the type itself, `self.method(` and `Self::method(`
say which it is; elsewhere a file that names the type and calls a method of a name that no other
function has.

Comments, texts and items under `#[cfg(test)]` are removed first. What is left is searched by
regular expressions, which is enough for formatted source.
"""

from __future__ import annotations

import re
from collections import Counter
from collections.abc import Iterator
from functools import cache
from pathlib import Path

from scripts.imports import Import

Module = tuple[str, ...]

NOT_CODE = re.compile(
    r"""//[^\n]*
      | b?r(?P<hashes>\#*)".*?"(?P=hashes)
      | b?"(?:\\.|[^"\\])*"
      | b?'(?:\\[^\n]*?|[^\\'\n])'""",
    re.S | re.X,
)
TEST = re.compile(r"#\[cfg\(\s*(?:all\(\s*)?test\b[^\]]*\]")
USE = re.compile(r"\b(?:pub(?:\([^)]*\))?\s+)?\buse\s+([^;]+);")
PUBLIC = re.compile(r"\bpub(?:\([^)]*\))?\s+use\b")
PATH = re.compile(r"\b(?:crate|super|self)(?:\s*::\s*[A-Za-z_]\w*)+")
CHILD = re.compile(r"\bmod\s+([A-Za-z_]\w*)\s*;")
IMPL = re.compile(
    r"^impl\b(?:<[^{}]*?>)? *(\w+)(?:<[^{}]*?>)? *(?:where\b[^{]*)?\{\n(.*?)^\}", re.M | re.S
)
METHOD = re.compile(r"^    (?:pub(?:\([^)]*\))? +)?(?:const +|unsafe +)*fn +(\w+)", re.M)
OWN_CALL = re.compile(r"\b(?:self\s*\.|Self::)\s*(\w+)\s*\(")
CALL = re.compile(r"(?:\.|::)\s*(\w+)\s*\(")
FUNCTION = re.compile(r"\bfn +(\w+)")
WORD = re.compile(r"\w+")
DEFINED = re.compile(
    r"\b(?:fn|struct|enum|trait|type|const|static|union|mod|macro_rules!)\s+(?=(\w+))"
)


def read(folder: Path) -> tuple[tuple[str, ...], tuple[Import, ...]]:
    """Find the files of a crate, and what they import from each other.

    Parameters
    ----------
    folder : path
        `src` of the crate.

    Returns
    -------
    files : tuple of str
        Paths within the folder, files of tests left out.
    imports : tuple of Import
        In the order of the files.
    """
    crate = _Crate(folder)
    found = dict.fromkeys(one for module in crate.files for one in crate.imports(module))
    return tuple(crate.files.values()), tuple(found)


@cache  # several checks and counts read the same files
def code_of(source: str) -> str:
    """Remove comments from the source of a file; of its texts only the quotes of each line stay."""

    def short(match: re.Match[str]) -> str:
        return "" if match[0].startswith("//") else "\n".join(['""'] * len(match[0].split("\n")))

    code = NOT_CODE.sub(short, _unblocked(source))
    return re.sub(r"\bpub\(in [^)]*\)", "pub", code.replace("$crate", "crate"))


def without_tests(code: str) -> str:
    """Remove the items under `#[cfg(test)]` from code."""
    while match := TEST.search(code):
        code = code[: match.start()] + code[_item_end(code, match.end()) :]
    return code


def used(tree: str) -> list[tuple[str, str]]:
    """Paths of a `use`, nested braces written out, each with the name that it gets here.

    Examples
    --------
    >>> used("crate::{a::{self, B as C}, d::*}")
    [('crate::a', 'a'), ('crate::a::B', 'C'), ('crate::d::*', '*')]
    """
    head, brace, rest = tree.strip().partition("{")
    if not brace:
        path, _, name = " ".join(head.split()).partition(" as ")
        path = path.replace(" ", "").removesuffix("::self")
        return [(path, name.strip() or path.rsplit("::", 1)[-1])]
    inner = rest.rsplit("}", 1)[0]
    return [
        pair for part in _parts(inner) if part.strip() for pair in used(head.strip() + part.strip())
    ]


def _parts(inner: str) -> Iterator[str]:
    """Split at the commas that stand outside of braces."""
    depth, begin = 0, 0
    for i, letter in enumerate(inner):
        depth += (letter == "{") - (letter == "}")
        if letter == "," and depth == 0:
            yield inner[begin:i]
            begin = i + 1
    yield inner[begin:]


def _unblocked(source: str) -> str:
    """Source without block comments, which may be nested."""
    out, depth, at = [], 0, 0
    tokens = re.compile(r"//[^\n]*|/\*|\*/|\"(?:\\.|[^\"\\])*\"", re.S)
    for match in tokens.finditer(source):
        if match[0] == "/*":
            if depth == 0:
                out.append(source[at : match.start()])
            depth += 1
        elif match[0] == "*/" and depth:
            depth -= 1
            at = match.end()
    return "".join(out) + (source[at:] if depth == 0 else "")


def _item_end(code: str, begin: int) -> int:
    """End of the item that begins here: its semicolon, or the brace that closes it."""
    depth = 0
    for i in range(begin, len(code)):
        if code[i] in "{([":
            depth += 1
        elif code[i] in "})]":
            depth -= 1
            if depth == 0 and code[i] == "}":
                return i + 1
        elif code[i] == ";" and depth == 0:
            return i + 1
    return len(code)


class _Crate:
    """Modules of a crate that are files of their own."""

    def __init__(self, folder: Path) -> None:
        self.files: dict[Module, str] = {}
        self.code: dict[Module, str] = {}
        tests: set[Module] = set()
        for path in sorted(folder.rglob("*.rs")):
            file = path.relative_to(folder).as_posix()
            parts = file.removesuffix(".rs").split("/")
            module = tuple(parts[:-1] if parts[-1] in ("mod", "lib") else parts)
            code = code_of(path.read_text(encoding="utf-8"))
            self.files[module] = file
            self.code[module] = without_tests(code)
            declared = set(CHILD.findall(code)) - set(CHILD.findall(self.code[module]))
            tests |= {(*module, child) for child in declared}
        for module in list(self.files):
            if any(module[: len(test)] == test for test in tests):
                del self.files[module], self.code[module]
        self.children = {module: set(CHILD.findall(code)) for module, code in self.code.items()}
        self.defined = {module: set(DEFINED.findall(code)) for module, code in self.code.items()}
        self.passed_on = {module: dict(self._uses(module)) for module in self.code}
        self.functions = Counter(name for c in self.code.values() for name in FUNCTION.findall(c))
        self.methods = self._methods()

    def imports(self, module: Module) -> Iterator[Import]:
        """What a file imports from the others, declarations of its own children left out."""
        file = self.files[module]
        for path in self._paths(module):
            source, name = self._split(path)
            own_folder = (
                bool(source)
                and source != module
                and module[: len(source)] == source
                and name in self.passed_on[source]
            )
            target = source if own_folder else self._defining(path)
            if self.files[target] != file:
                yield Import(file, self.files[target], "::".join(path), own_folder)
        for kind, name, target in self._calls(module):
            yield Import(file, self.files[target], f"{kind}::{name}")

    def _methods(self) -> dict[str, dict[str, Module]]:
        """Methods with the file that they stand in, by types whose `impl`s are split over files.

        A name that a type has in two files says nothing.
        """
        found: dict[str, dict[str, set[Module]]] = {}
        for module, code in self.code.items():
            for kind, block in IMPL.findall(code):
                for name in METHOD.findall(block):
                    found.setdefault(kind, {}).setdefault(name, set()).add(module)
        once = {
            kind: {name: min(modules) for name, modules in names.items() if len(modules) == 1}
            for kind, names in found.items()
        }
        return {kind: names for kind, names in once.items() if len(set(names.values())) > 1}

    def _calls(self, module: Module) -> Iterator[tuple[str, str, Module]]:
        """Methods that a file has from another: type, name and file."""
        code = self.code[module]
        own = [
            (kind, name) for kind, block in IMPL.findall(code) for name in OWN_CALL.findall(block)
        ]
        called, named = set(CALL.findall(code)), set(WORD.findall(code))
        other = [
            (kind, name)
            for kind, names in self.methods.items()
            if kind in named
            for name in names
            if name in called and self.functions[name] == 1
        ]
        for kind, name in dict.fromkeys(own + other):
            target = self.methods.get(kind, {}).get(name, module)
            if target != module:
                yield kind, name, target

    def _paths(self, module: Module) -> Iterator[Module]:
        """Every path into the crate that a file names, from the root of the crate."""
        code = self.code[module]
        for match in USE.finditer(code):
            declares = PUBLIC.match(match[0])
            for text, _ in used(match[1]):
                path = self._absolute(text, module)
                own = path is not None and len(path) > len(module) and path[: len(module)] == module
                if path is not None and not (declares and own):
                    yield path
        for match in PATH.finditer(USE.sub("", code)):
            path = self._absolute(re.sub(r"\s", "", match[0]), module)
            if path is not None:
                yield path

    def _uses(self, module: Module) -> Iterator[tuple[str, Module]]:
        """Names that a file has from elsewhere, and which it may pass on."""
        for match in USE.finditer(self.code[module]):
            for text, name in used(match[1]):
                path = self._absolute(text, module)
                if path is not None:
                    yield (f"*{'::'.join(path)}" if name == "*" else name), path

    def _absolute(self, text: str, module: Module) -> Module | None:
        """A path from the root of the crate; None for one that leads out of it."""
        first, *rest = text.split("::")
        if first == "crate":
            return tuple(rest)
        if first in ("self", "super"):
            above = module if first == "self" else module[:-1]
            while rest and rest[0] == "super":
                rest, above = rest[1:], above[:-1]
            return (*above, *rest)
        return (*module, first, *rest) if first in self.children[module] else None

    def _split(self, path: Module) -> tuple[Module, str]:
        """The module of a path that is a file, and the name that follows it."""
        length = next(n for n in range(len(path), -1, -1) if path[:n] in self.files)
        return path[:length], path[length] if length < len(path) else ""

    def _defining(self, path: Module, depth: int = 8) -> Module:
        """The module that defines a name, wherever it is passed on."""
        source, name = self._split(path)
        if not name or name == "*" or not depth or self._defines(source, name):
            return source
        known = self.passed_on[source]
        if name in known:
            return self._defining(known[name], depth - 1)
        for globbed in (path for key, path in known.items() if key.startswith("*")):
            behind = self._defining((*globbed[:-1], name), depth - 1)
            if self._defines(behind, name):
                return behind
        if not source:  # an exported macro stands at the root, wherever it is defined
            macro = re.compile(rf"\bmacro_rules!\s+{name}\b")
            return next((m for m, code in self.code.items() if macro.search(code)), source)
        return source

    def _defines(self, module: Module, name: str) -> bool:
        return name in self.defined[module]
