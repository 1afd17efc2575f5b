"""What counts as a line of code."""

from __future__ import annotations

from pathlib import Path

from scripts import count_lines

TREE = {
    "crates/rsicalib/src/lib.rs": """\
//! A crate.

mod inner; mod diagnosis;
#[cfg(test)]
mod laws;

/* a { block
*/
const TEXT: &str = "two } // lines
    of text";
""",
    "crates/rsicalib/src/inner.rs": """\
/// Documented.
pub fn one() -> char {
    '{' // a brace
}

#[cfg(test)]
mod tests {
    fn two() {}
}
""",
    "crates/rsicalib/src/diagnosis/mod.rs": "fn found() {}\n",
    "crates/rsicalib/src/laws.rs": "fn of_tests_alone() {}\n",
    "crates/rsicalib/tests/public.rs": "fn elsewhere() {}\n",
    "crates/rsicalib-py/src/lib.rs": "fn bound() {}\n",
    "python/rsicalib/__init__.py": '''\
"""A package.

In two paragraphs.
"""

import os  # a module

LONG = """two

lines"""
"""What it is."""


class Thing:
    """Documented."""
''',
    "python/rsicalib/page.html": "<!-- a\ncomment -->\n<p>text</p>\n",
    "python/rsicalib/style.css": "/* a comment */\na { color: red }\n\n",
    "python/rsicalib/script.js": "// a comment\nfetch('http://x') // beside code\n",
    "docs/index.md": "# Four words of text\n",
    "README.md": "two words\n",
}


def test_blank_lines_comments_docstrings_and_tests_are_no_code(tmp_path: Path) -> None:
    for name, text in TREE.items():
        path = tmp_path / name
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text(text, encoding="utf-8")
    assert count_lines.counts(tmp_path) == {
        "core crate": 3 + 3 + 1,
        "of these, diagnosis": 1,
        "bindings": 1,
        "Python package": 4,
        "JavaScript, HTML, CSS": 3,
        "words of the pages": 7,
    }


def test_everything_that_is_counted_is_there() -> None:
    assert all(number > 500 for number in count_lines.counts().values())
