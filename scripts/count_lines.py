"""Count lines of code and words of the documentation: `python -m scripts.count_lines`.

Blank lines, comments, docstrings and tests are no code. Of Rust, the files that the crate has
without `#[cfg(test)]` count; of Python, all of the package, what is generated included.
"""

from __future__ import annotations

import ast
import io
import re
import tokenize
from collections.abc import Callable, Iterable
from pathlib import Path

from scripts import imports_rust

ROOT = Path(__file__).parents[1]

NO_CODE = {
    tokenize.COMMENT,
    tokenize.NL,
    tokenize.NEWLINE,
    tokenize.INDENT,
    tokenize.DEDENT,
    tokenize.ENDMARKER,
}
WEB_COMMENT = re.compile(r"/\*.*?\*/|<!--.*?-->|^\s*//[^\n]*", re.M | re.S)


def counts(root: Path = ROOT) -> dict[str, int]:
    """Lines, and words of the pages, of everything that is counted.

    Parameters
    ----------
    root : path
        The repository.

    Returns
    -------
    dict of str to int
        By name, in the order in which they are printed.
    """
    package = root / "python" / "rsicalib"
    web = [path for suffix in ("js", "html", "css") for path in package.rglob(f"*.{suffix}")]
    pages = [root / "README.md", *(root / "docs").rglob("*.md")]
    core = _crate(root / "crates" / "rsicalib" / "src")
    return {
        "core crate": sum(core.values()),
        "of these, diagnosis": sum(n for name, n in core.items() if name.startswith("diagnosis/")),
        "bindings": sum(_crate(root / "crates" / "rsicalib-py" / "src").values()),
        "Python package": _sum(package.rglob("*.py"), python_lines),
        "JavaScript, HTML, CSS": _sum(web, web_lines),
        "words of the pages": _sum(pages, lambda text: len(text.split())),
    }


def rust_lines(source: str) -> int:
    """Lines of code of a Rust file.

    Examples
    --------
    >>> rust_lines("/// Doc.\\nfn f() {} // more\\n\\n#[cfg(test)]\\nmod tests {}\\n")
    1
    """
    return _filled(imports_rust.without_tests(imports_rust.code_of(source)))


def python_lines(source: str) -> int:
    """Lines of code of a Python file.

    Examples
    --------
    >>> python_lines('x = 1  # one\\n"What x is."\\n\\ndef f():\\n    return x\\n')
    3
    """
    lines: set[int] = set()
    for token in tokenize.generate_tokens(io.StringIO(source).readline):
        if token.type not in NO_CODE:
            lines |= set(range(token.start[0], token.end[0] + 1))
    for node in ast.walk(ast.parse(source)):
        if isinstance(node, ast.Expr) and isinstance(node.value, ast.Constant):
            if isinstance(node.value.value, str):
                lines -= set(range(node.lineno, (node.end_lineno or node.lineno) + 1))
    rows = source.splitlines()
    return sum(bool(rows[line - 1].strip()) for line in lines)


def web_lines(source: str) -> int:
    """Lines of code of a script, a page or a style.

    Examples
    --------
    >>> web_lines("/* style\\n*/\\na { }\\n// no code\\nb('//x')\\n")
    2
    """
    return _filled(WEB_COMMENT.sub("", source))


def _crate(folder: Path) -> dict[str, int]:
    """Lines of each file that the crate has."""
    names = imports_rust.read(folder)[0]
    return {str(name): rust_lines((folder / name).read_text(encoding="utf-8")) for name in names}


def _filled(text: str) -> int:
    return sum(bool(line.strip()) for line in text.splitlines())


def _sum(paths: Iterable[Path], of: Callable[[str], int]) -> int:
    return sum(of(path.read_text(encoding="utf-8")) for path in paths)


if __name__ == "__main__":
    for name, number in counts().items():
        print(f"{number:9,d}  {name}")
