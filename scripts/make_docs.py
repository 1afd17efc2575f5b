"""Run the code of the documentation, and put into the pages what it prints.

Run as `python -m scripts.make_docs`, with the paths of pages or for all.

The blocks of a page run in their order, in one empty folder and in one Python session:

    python   is executed
    sh       is run by a shell
    text     directly below one of these is what it printed, and is written again; below the
             words "In short, of what it prints" its lines are some of those
    toml     with a title is written to that file; if it is a mechanism, it must load
    csv      with a title is written to that file
    json     must be JSON

Blocks of other languages are for reading. A picture of a page, `sessions/NAME.svg`, is the file
NAME.svg that its code has written. A test runs this and compares.
"""

from __future__ import annotations

import ast
import contextlib
import io
import json
import os
import re
import subprocess
import sys
import tempfile
import tomllib
from collections.abc import Iterator
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import rsicalib
from rsicalib.io.files import write_text

ROOT = Path(__file__).parents[1]
DOCS = ROOT / "docs"

BIN = Path(sys.executable).parent

READ_ONLY = {"console", "rust", "math", "bibtex", "yaml"}
"""Languages of blocks that are not run: commands that change the reader's machine, and excerpts."""

ELSEWHERE = "# not run here"
"""First line of a block of Python that needs what a test does not have: it must be Python."""

NOT_RUN = ("CONTRIBUTING.md", "docs/releasing.md")
"""Pages for those who work on rsicalib itself: what they run is `check` and the workflows."""

PICTURE = re.compile(r"!\[[^\]]*\]\((sessions/([\w-]+\.svg))\)")
"""A picture that the code of the page draws into its folder."""

BLOCK = re.compile(r"^( *)```(\w*)([^\n`]*)\n(.*?)^\1```$", re.M | re.S)

NEXT = re.compile(r"\s*\Z")

IN_SHORT = "In short, of what it prints"


@dataclass
class Page:
    """A page whose blocks are run."""

    path: Path
    folder: Path
    bin: Path = BIN
    """Where shells look for the command first."""
    names: dict[str, Any] = field(default_factory=lambda: {"__name__": "__main__"})

    def text(self) -> str:
        """The page with what its code prints."""
        source = self.path.read_text(encoding="utf-8")
        out, end, printed = [], 0, None
        for match in BLOCK.finditer(source):
            between = source[end : match.start()]
            indent, language, title, code = match.groups()
            out.append(between)
            if language == "text" and printed is not None and NEXT.fullmatch(between):
                out.append(f"{indent}```text{title}\n{_indented(printed, indent)}{indent}```")
                printed = None
            elif language == "text" and printed is not None and IN_SHORT in between:
                self.excerpt(_dedented(code, indent), printed)
                out.append(match[0])
            else:
                printed = self.run(language, title, _dedented(code, indent))
                out.append(match[0])
            end = match.end()
        return "".join([*out, source[end:]])

    def excerpt(self, code: str, printed: str) -> None:
        """Refuse lines that a command has not printed, but for spaces."""
        lines = {" ".join(line.split()) for line in printed.splitlines()}
        others = [line for line in code.splitlines() if " ".join(line.split()) not in lines | {""}]
        if others:
            raise ValueError(f"{self.path.name}: not among what is printed: {others}")

    def pictures(self) -> dict[Path, str]:
        """Pictures that the page shows of what its code has drawn, by their files."""
        found = PICTURE.findall(self.path.read_text(encoding="utf-8"))
        return {
            self.path.parent / place: (self.folder / name).read_text(encoding="utf-8")
            for place, name in found
        }

    def run(self, language: str, title: str, code: str) -> str | None:
        """Run one block; what it prints, or None where it is none that prints."""
        named = re.search(r'title="([^"]+)"', title)
        if language == "python" and code.startswith(ELSEWHERE):
            ast.parse(code, self.path.name)
        elif language == "python":
            return self.python(code)
        if language == "sh":
            return self.shell(code)
        if language in ("toml", "csv") and named:
            write_text(self.folder / named[1], code)
        if language == "toml":
            document = tomllib.loads(code)
            if "closure" in document and "length_unit" in document:
                rsicalib.load_mechanism(self.folder / named[1] if named else code)
        if language == "json":
            json.loads(code)
        if language not in ("python", "sh", "toml", "csv", "json", "text") and (
            language not in READ_ONLY
        ):
            raise ValueError(f"{self.path.name}: found a block of {language!r}")
        return None

    def python(self, code: str) -> str:
        """Execute code; the value of a last expression is printed, as a notebook does."""
        body = ast.parse(code, self.path.name)
        last = body.body.pop() if body.body and isinstance(body.body[-1], ast.Expr) else None
        assert last is None or isinstance(last, ast.Expr)
        out = io.StringIO()
        with contextlib.redirect_stdout(out), contextlib.chdir(self.folder):
            exec(compile(body, self.path.name, "exec"), self.names)
            if last is not None:
                value = eval(
                    compile(ast.Expression(last.value), self.path.name, "eval"), self.names
                )
                if value is not None:
                    print(value if isinstance(value, str) else repr(value))
        return out.getvalue()

    def shell(self, code: str) -> str:
        """Run commands; what cannot be used, or is a defect, stops everything."""
        path = os.pathsep.join([str(self.bin), str(BIN), os.environ.get("PATH", "")])
        done = subprocess.run(
            ["sh", "-c", code],
            cwd=self.folder,
            env={**os.environ, "PATH": path, "NO_COLOR": "1", "COLUMNS": "100"},
            capture_output=True,
            text=True,
        )
        if done.returncode not in (0, 3, 4):
            raise RuntimeError(f"{self.path.name}:\n{code}\n{done.stdout}{done.stderr}")
        return done.stdout


def _dedented(code: str, indent: str) -> str:
    return "".join(line.removeprefix(indent) for line in code.splitlines(keepends=True))


def _indented(text: str, indent: str) -> str:
    text = re.sub(r"[ \t]+$", "", text, flags=re.M)
    return "".join(
        f"{indent}{line}" if line.strip() else line for line in text.splitlines(keepends=True)
    )


@contextlib.contextmanager
def page(path: Path, bin: Path = BIN) -> Iterator[Page]:
    """A page with a folder of its own."""
    with tempfile.TemporaryDirectory() as folder:
        yield Page(path, Path(folder), bin)


def pages() -> list[Path]:
    """Every page that has code in it."""
    found = [ROOT / "README.md", *sorted(DOCS.glob("*.md"))]
    return [path for path in found if str(path.relative_to(ROOT)) not in NOT_RUN]


def main(names: list[str]) -> None:
    """Write the pages that are named, or all."""
    for path in [Path(name).resolve() for name in names] or pages():
        with page(path) as one:
            write_text(path, one.text())
            for place, picture in one.pictures().items():
                write_text(place, picture)


if __name__ == "__main__":
    main(sys.argv[1:])
