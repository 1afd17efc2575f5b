"""Programs decide by facts: no code of the package looks into a sentence."""

from __future__ import annotations

import ast
import json
from pathlib import Path

import pytest

import rsicalib
from rsicalib import DEMO, _core
from rsicalib.facts.warned import KINDS, WIRING, Warned

PACKAGE = Path(rsicalib.__file__).parent

SENTENCES = {"text", "reason", "message", "termination", "summary", "said"}
"""Attributes and keys of results that hold sentences."""

LOOKS = {
    "startswith",
    "endswith",
    "partition",
    "find",
    "index",
    "split",
    "replace",
}
"""Methods that look into text."""

SEARCHES = {"search", "match", "fullmatch", "findall"}
"""Functions of `re` that do."""


def is_sentence(node: ast.AST) -> bool:
    """Whether an expression is a sentence of a result, by its name."""
    if isinstance(node, ast.Attribute):
        of_noise = node.attr == "source" and ast.unparse(node.value).endswith("noise")
        return node.attr in SENTENCES or of_noise
    if isinstance(node, ast.Subscript):
        return isinstance(node.slice, ast.Constant) and node.slice.value in SENTENCES
    return False


def looks_into_sentences(source: str) -> list[int]:
    """Lines of a module in which a sentence is compared or searched."""
    found = []
    for node in ast.walk(ast.parse(source)):
        looked_at: list[ast.AST] = []
        if isinstance(node, ast.Compare):
            looked_at = [node.left, *node.comparators]
            if any(isinstance(n, ast.Constant) and n.value is None for n in looked_at):
                continue
        elif isinstance(node, ast.Call) and isinstance(node.func, ast.Attribute):
            if node.func.attr in LOOKS:
                looked_at = [node.func.value]
            elif node.func.attr in SEARCHES:
                looked_at = list(node.args)
        if any(map(is_sentence, looked_at)):
            found.append(node.lineno)  # type: ignore[attr-defined]
    return found


@pytest.mark.parametrize(
    "line",
    [
        'x.text == "a"',
        '"a" in w.text',
        'step["reason"].startswith("a")',
        "RULE.search(w.text)",
        "re.match(r, e.message)",
        'e.message.replace("pose 0", "pose 1")',
        '"seatings" in result.noise.source',
    ],
)
def test_the_check_sees_text_that_is_looked_into(line: str) -> None:
    assert looks_into_sentences(line) == [1]


@pytest.mark.parametrize("line", ["x.text is None", "w.kind in KINDS", "print(w.text)"])
def test_the_check_lets_facts_and_printing_pass(line: str) -> None:
    assert looks_into_sentences(line) == []


def test_no_module_looks_into_a_sentence() -> None:
    for path in sorted(PACKAGE.rglob("*.py")):
        lines = looks_into_sentences(path.read_text(encoding="utf-8"))
        assert not lines, f"{path.relative_to(PACKAGE)}, lines {lines}: decide by a field"


def test_the_kinds_of_warnings_are_those_of_the_schema() -> None:
    for _, text in _core.schemas():
        types = json.loads(text)["$defs"]
        of_core = [kind["const"] for kind in types["WarnedKind"]["oneOf"]]
        assert list(KINDS) == of_core and set(KINDS) >= WIRING
        assert list(types["Warned"]["properties"]) == list(Warned.__dataclass_fields__)


def test_warnings_of_earlier_versions_are_their_text(tmp_path: Path) -> None:
    result = rsicalib.calibrate(DEMO / "readings.csv", rest=DEMO / "rest.csv").to_dict()
    path = tmp_path / "result.json"
    result["warnings"] = ["a22 looks odd", {"kind": "gap", "target": "a22", "text": "a gap"}]
    path.write_text(json.dumps(result))
    read = rsicalib.load_calibration(path)
    assert read.warnings == (Warned("other", None, "a22 looks odd"), Warned("gap", "a22", "a gap"))
    result["warnings"] = [{"kind": "gap", "target": 3, "text": "a gap"}]
    path.write_text(json.dumps(result))
    with pytest.raises(rsicalib.InputError, match=r"warnings\[0\]\.target .*found 3, expected"):
        rsicalib.load_calibration(path)


def test_what_somebody_at_the_device_can_mend_reaches_the_guide() -> None:
    assert {"reversed", "exchanged", "gap", "no_start"} <= WIRING
