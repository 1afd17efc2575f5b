"""The check of the layers: what it finds, and that the Python package passes it."""

from __future__ import annotations

from pathlib import Path

import pytest

import rsicalib
from scripts import imports_rust, layers
from scripts.layers import ROOT, Tree, problems, python_tree, rust_tree

LAYERS = ("error", "numerics", "model", "report")


@pytest.fixture
def tree(tmp_path: Path):
    """A function that writes files, and reads them as a tree of Python or Rust."""

    def write(files: dict[str, str]):
        folder = tmp_path / "thing"
        for name, text in files.items():
            path = folder / name
            path.parent.mkdir(parents=True, exist_ok=True)
            path.write_text(text, encoding="utf-8")
        return (rust_tree if any(name.endswith(".rs") for name in files) else python_tree)(folder)

    return write


def arrows(tree) -> list[str]:
    return [str(one) for one in tree.imports]


def package() -> Tree:
    """Files and imports of the package."""
    return python_tree(ROOT / "python" / "rsicalib")


def test_all_trees_keep_their_layers(capsys: pytest.CaptureFixture[str]) -> None:
    assert layers.main() == 0, capsys.readouterr().out


def test_the_imports_of_the_package_are_read() -> None:
    assert len(package().imports) > 100


def test_no_function_of_the_package_hides_a_module() -> None:
    modules = {file.split("/")[0].split(".")[0] for file in package().files}
    assert not modules & set(rsicalib.__all__)


# ------------------------------------------------------------------ Python

PACKAGE = {
    "__init__.py": "from thing.report import show\n",
    "error.py": "import json\n",
    "numerics.py": "from thing.error import Error\n",
    "model/__init__.py": "from thing.model.parts import Part\n",
    "model/parts.py": "from thing import numerics\nfrom thing.model import shape\n",
    "model/shape.py": "from ..error import Error\n",
    "report.py": "from thing.model import Part\n",
}


def test_python_names_come_from_the_file_that_defines_them(tree) -> None:
    found = tree(PACKAGE)
    assert "report.py -> model/parts.py: Part" in arrows(found)
    assert "model/parts.py -> model/shape.py: shape" in arrows(found)
    assert "model/shape.py -> error.py: Error" in arrows(found)
    assert problems(found, LAYERS) == []


@pytest.mark.parametrize(
    ("file", "text", "line"),
    [
        ("error.py", "import thing.report", "error.py -> report.py: thing.report (a later layer)"),
        (
            "error.py",
            "def f():\n    from thing.model import Part",
            "error.py -> model/parts.py: Part (a later layer)",
        ),
        (
            "error.py",
            "from typing import TYPE_CHECKING\nif TYPE_CHECKING:\n    from thing import report",
            "error.py -> report.py: report (a later layer)",
        ),
        (
            "model/shape.py",
            "from thing.model import Part",
            "model/shape.py -> model/__init__.py: Part "
            "(from its own folder: import it from the file that defines it)",
        ),
        (
            "model/shape.py",
            "from thing.model.parts import Part",
            "model/shape.py -> model/parts.py: Part (a circle of 2 files)",
        ),
        ("report.py", "import thing", "report.py -> __init__.py: thing (the top of the tree)"),
        ("extra.py", "", "extra: not in the list of layers"),
    ],
)
def test_wrong_imports_of_python_are_named(tree, file: str, text: str, line: str) -> None:
    assert line in problems(tree({**PACKAGE, file: text}), LAYERS)


# ------------------------------------------------------------------ Rust

CRATE = {
    "lib.rs": "pub mod error; pub mod numerics; pub mod model; pub mod report;\n"
    "pub use error::Error;\npub use crate::report::Report;\n",
    "error.rs": "pub enum Error {}\n",
    "numerics/mod.rs": "mod lanes;\npub mod solve;\npub use lanes::{Lanes, WIDTH as WIDE};\n"
    "pub(crate) use self::solve::*;\n",
    "numerics/lanes.rs": "use crate::Error;\npub struct Lanes;\npub const WIDTH: usize = 8;\n",
    "numerics/solve.rs": "use super::lanes::Lanes;\npub fn solve() {}\n",
    "model/mod.rs": "mod part;\nmod own;\npub use part::Part;\npub trait Shape {}\n",
    "model/part.rs": "use crate::{error::Error, numerics::{self, solve as find, Lanes}};\n"
    "use super::Shape;\npub struct Part;\n",
    "model/own.rs": "pub fn wide() -> usize { crate::numerics::WIDE }\n",
    "report.rs": "pub struct Report;\n",
}


def test_rust_names_come_from_the_file_that_defines_them(tree) -> None:
    found = tree(CRATE)
    assert problems(found, LAYERS) == []
    assert set(arrows(found)) >= {
        "numerics/lanes.rs -> error.rs: Error",
        "numerics/solve.rs -> numerics/lanes.rs: numerics::lanes::Lanes",
        "model/part.rs -> error.rs: error::Error",
        "model/part.rs -> numerics/mod.rs: numerics",
        "model/part.rs -> numerics/solve.rs: numerics::solve",
        "model/part.rs -> numerics/lanes.rs: numerics::Lanes",
        "model/part.rs -> model/mod.rs: model::Shape",
        "model/own.rs -> numerics/lanes.rs: numerics::WIDE",
    }


@pytest.mark.parametrize(
    ("file", "text", "line"),
    [
        (
            "numerics/lanes.rs",
            "use crate::{error::Error,\n    model::{Shape, Part}};",
            "numerics/lanes.rs -> model/part.rs: model::Part (a later layer)",
        ),
        (
            "numerics/lanes.rs",
            "fn f(report: &super::super::report::Report) {}",
            "numerics/lanes.rs -> report.rs: report::Report (a later layer)",
        ),
        (
            "numerics/lanes.rs",
            "macro_rules! m { () => { $crate::report::Report } }",
            "numerics/lanes.rs -> report.rs: report::Report (a later layer)",
        ),
        (
            "numerics/lanes.rs",
            "use crate::Report;",
            "numerics/lanes.rs -> report.rs: Report (a later layer)",
        ),
        (
            "numerics/lanes.rs",
            "use super::solve::solve;\npub struct Lanes;",
            "numerics/lanes.rs -> numerics/solve.rs: numerics::solve::solve (a circle of 2 files)",
        ),
        (
            "model/mod.rs",
            "mod part;\nmod own;\nuse part::Part;\npub trait Shape {}",
            "model/mod.rs -> model/part.rs: model::part::Part (a circle of 2 files)",
        ),
        (
            "model/own.rs",
            "use super::Part;",
            "model/own.rs -> model/mod.rs: model::Part "
            "(from its own folder: import it from the file that defines it)",
        ),
        ("extra/mod.rs", "", "extra: not in the list of layers"),
    ],
)
def test_wrong_imports_of_rust_are_named(tree, file: str, text: str, line: str) -> None:
    assert line in problems(tree({**CRATE, file: text}), LAYERS)


def test_methods_of_a_type_are_imports_of_the_files_that_its_impls_are_split_over(tree) -> None:
    files = {
        **CRATE,
        "model/part.rs": "pub struct Part { kept: u8 }\n\nimpl Part {\n"
        "    pub fn new() -> Self {\n        Self::drawn().kept()\n    }\n"
        "    fn own(self) -> Self {\n        self\n    }\n}\n",
        "model/own.rs": "use crate::model::part::Part;\n\nimpl Part {\n"
        "    pub(super) fn drawn() -> Self {\n        Self { kept: 1 }\n    }\n"
        "    fn two(self) -> usize {\n        self.own().len()\n    }\n}\n",
    }
    found = tree(files)
    assert "model/part.rs -> model/own.rs: Part::drawn" in arrows(found)
    assert "model/own.rs -> model/part.rs: Part::own" in arrows(found)
    circle = [line for line in problems(found, LAYERS) if "circle" in line]
    assert len(circle) == 2 and all("a circle of 2 files" in line for line in circle)


def test_tests_comments_and_texts_of_rust_do_not_count(tree) -> None:
    text = """
//! See [`crate::report::Report`].
/* use crate::report::Report; /* nested */ */
fn f<'a>(x: &'a str) -> char { let _ = "use crate::report::A; \\" //"; '"' }
#[cfg(test)]
mod tests {
    use crate::report::Report;
    fn g() { if true { crate::report::Report; } }
}
#[cfg(test)]
mod more;
const RAW: &str = r#"crate::report::Report "quoted" "#;
use crate::error::Error;
"""
    found = tree(
        {**CRATE, "numerics/lanes.rs": text, "numerics/lanes/more.rs": "use crate::report::A;"}
    )
    assert [a for a in arrows(found) if a.startswith("numerics/lanes")] == [
        "numerics/lanes.rs -> error.rs: error::Error"
    ]


def test_nested_braces_are_written_out() -> None:
    assert imports_rust.used("crate::{a::{b::{self}, C as D},\n  e::*}") == [
        ("crate::a::b", "b"),
        ("crate::a::C", "D"),
        ("crate::e::*", "*"),
    ]
