"""Public names of the core crate that are documented: `python -m scripts.public_names`.

Names that only the bindings and the tests of the crate need are marked `#[doc(hidden)]`: they are
not counted. The list stands in `docs/stability.md`; this command writes it, and a test compares.
"""

from __future__ import annotations

import re
import sys
from collections.abc import Iterator
from pathlib import Path

from rsicalib.io.files import write_text

ROOT = Path(__file__).parents[1]
SOURCE = ROOT / "crates" / "rsicalib" / "src"
PAGE = ROOT / "docs" / "stability.md"

HEAD, END = "<!-- public names -->\n", "<!-- end of the public names -->\n"

ITEM = re.compile(
    r"^pub (?:(?:const |unsafe |async )*fn|struct|enum|trait|type|const|static|union) +(\w+)"
)
MODULE = re.compile(r"^pub mod (\w+);")
USE = re.compile(r"^pub use ([^;]+);", re.S)


def names(source: Path = SOURCE) -> list[str]:
    """Every documented name, `module::Name`, the root first; what is there too counts there."""
    found = list(dict.fromkeys(_of_module(source / "lib.rs", source, "")))
    root = {name for name in found if "::" not in name}
    inner = [name for name in found if "::" in name and name.rpartition("::")[2] not in root]
    return [*sorted(root, key=lambda name: (name.lower(), name)), *inner]


def _of_module(file: Path, folder: Path, path: str) -> Iterator[str]:
    hidden = False
    text = file.read_text(encoding="utf-8")
    for match in re.finditer(r"^\S.*\n", text, re.M):
        line = match[0]
        if line.startswith("#["):
            hidden |= "doc(hidden)" in line or "cfg(test)" in line
            continue
        if line.startswith("//"):
            continue
        if not hidden and line.startswith("pub "):
            yield from _of_item(text[match.start() :], folder, path)
        hidden = False


def _of_item(text: str, folder: Path, path: str) -> Iterator[str]:
    if item := ITEM.match(text):
        yield path + item[1]
    elif module := MODULE.match(text):
        name = module[1]
        inner = folder / name
        file = inner / "mod.rs" if inner.is_dir() else folder / f"{name}.rs"
        yield from _of_module(file, inner, f"{path}{name}::")
    elif use := USE.match(text):
        listed = use[1].partition("{")[2].rpartition("}")[0] or use[1]
        for one in filter(None, (part.strip() for part in listed.split(","))):
            yield path + re.split(r"::| as ", one)[-1]


def listed() -> str:
    """The list as Markdown: a line for the root, a line for each module."""
    modules: dict[str, list[str]] = {}
    for name in names():
        module, _, last = name.rpartition("::")
        modules.setdefault(module, []).append(f"`{last}`")
    lines = [
        f"- {f'`{module}`' if module else 'at the root'} ({len(own)}): {', '.join(own)}\n"
        for module, own in modules.items()
    ]
    return HEAD + "\n" + "".join(lines) + "\n" + END


def page() -> str:
    """The page with the list in its place."""
    text = PAGE.read_text(encoding="utf-8")
    before, after = text.partition(HEAD)[0], text.partition(END)[2]
    return before + listed() + after


if __name__ == "__main__":
    if sys.argv[1:] == ["--count"]:
        print(len(names()))
    else:
        write_text(PAGE, page())
