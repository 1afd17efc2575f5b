"""Programs decide by facts: no code looks into a sentence."""

from __future__ import annotations

import dataclasses
import json
from pathlib import Path

import pytest

import rsicalib
from rsicalib import DEMO, _core
from rsicalib.facts.warned import KINDS, WIRING, Warned
from rsicalib.verbs.export import calibrated
from tests.sentences import IN_SCRIPTS, IN_THE_CORE, by_line, looked_into

TERMS = ["offset", "gain", "curvature@a22"]
PACKAGE = Path(rsicalib.__file__).parent

CORE = Path(__file__).parents[1] / "crates"

EVASIONS = {
    "compared": 'x.text == "a"',
    "contained": '"a" in w.text',
    "what a law is over": 'law.over == f"reading of {a}"',
    "begins": 'step["reason"].startswith("a")',
    "a rule": "RULE.search(w.text)",
    "a regular expression": "re.match(r, e.message)",
    "search": "re.search(r, w.text)",
    "an alias of search": 'text = w.text\nre.search("a", text)',
    "replaced": 'e.message.replace("pose 0", "pose 1")',
    "of the noise": '"seatings" in result.noise.source',
    "an alias": 'text = w.text\ntext == "a"',
    "an alias of an alias": 'text = w.text\nwords = text\n"a" in words',
    "a walrus": '(text := w.text) and text.startswith("a")',
    "unpacked": 'kind, text = w.kind, w.text\ntext.find("a")',
    "a loop": 'for text in result.implausible:\n    "a" in text',
    "a comprehension": '[t for t in result.implausible if "a" in t]',
    "of a list": 'any(w.startswith("a") for w in state["troubles"])',
    "match": 'match w.text:\n    case "a":\n        pass',
    "match of one of two": 'match w.text:\n    case "a" | "b":\n        pass',
    "counted": 'w.text.count("a")',
    "removed": 'w.text.removeprefix("a")',
    "parted": 'w.text.partition(":")',
    "split": 'w.text.split(":")',
    "lowered": 'w.text.lower() == "a"',
    "cut": 'w.text[:3] == "abc"',
    "the first": 'result.implausible[0].startswith("a")',
    "the first of several": 'next(iter(result.unobservable)) == "a"',
    "a key": 'state["note"] == "a"',
    "got": 'state.get("note") == "a"',
    "by name": 'getattr(w, "text") == "a"',
    "a note": 'calibrated.notes[0].endswith("a")',
    "of the class": 'str.startswith(w.text, "a")',
    "an operator": 'operator.contains(w.text, "a")',
    "a table": "TABLE[w.text]",
    "a table that is asked": "TABLE.get(w.text)",
    "in another sentence": '"a" in f"{w.text}."',
    "or another": '(w.text or "").startswith("a")',
    "of two": '(a.text if a else b.text) == "a"',
    "in a function": 'def f(w):\n    text = w.text\n    return text == "a"',
    "by a function": 'def f(words):\n    return "a" in words\nf(w.text)',
    "by its name": 'def f(note: str) -> bool:\n    return note.startswith("a")',
    "by a function that returns text": (
        'def f(words: str) -> str:\n    return "b" if words.startswith("a") else words\nf(w.text)'
    ),
    "numbered": 'for k, t in enumerate(result.notes):\n    t.startswith("a")',
    "beside others": '[n for n, t in zip(names, result.notes) if "a" in t]',
    "filtered": 'list(filter(lambda t: "a" in t, result.implausible))',
    "sorted": 'sorted(result.notes, key=lambda t: t.startswith("a"))',
    "an ending": "def f(troubles):\n    [t for t in troubles if t.endswith(x)]",
}
"""Ways to look into a sentence."""

FACTS = [
    "x.text is None",
    "w.kind in KINDS",
    "print(w.text)",
    "not w.text",
    '"\\n".join(result.implausible)',
    'f"{w.text}: {w.kind}"',
    "len(w.text) < 160",
    '" ".join(w.text.split())',
    'target = w.target\ntarget == "a22"',
    'text = "a"\ntext == "a"',
    'def f(text: str) -> str:\n    return text.replace("*/", "* /")\nf(w.text)',
    "match w.text:\n    case None:\n        pass",
]
"""What decides nothing: layout and facts."""

IN_OTHER_LANGUAGES = [
    ('s.text.startsWith("a")', IN_SCRIPTS),
    ("named.includes(words)", IN_SCRIPTS),
    ("/a/.test(w.text)", IN_SCRIPTS),
    ("text !== s.order.text", IN_SCRIPTS),
    ('s.note === "a"', IN_SCRIPTS),
    ("switch (s.note) {", IN_SCRIPTS),
    ('warned.text.starts_with("a")', IN_THE_CORE),
    ('found.warnings[0].text.as_str() == "a"', IN_THE_CORE),
    ('warning.to_string().contains("a")', IN_THE_CORE),
    ('words::cause(mechanism, &cause, 1).contains("a")', IN_THE_CORE),
    ("match warned.text.as_str() {", IN_THE_CORE),
    ('left.implausible[0].contains("a")', IN_THE_CORE),
]
"""Lines of pages and of the core that look into a sentence."""


@pytest.mark.parametrize("lines", EVASIONS.values(), ids=EVASIONS.keys())
def test_the_check_sees_text_that_is_looked_into(lines: str) -> None:
    assert looked_into(lines)


@pytest.mark.parametrize("lines", FACTS)
def test_the_check_lets_facts_and_printing_pass(lines: str) -> None:
    assert looked_into(lines) == []


@pytest.mark.parametrize(("line", "rules"), IN_OTHER_LANGUAGES)
def test_the_check_sees_it_in_pages_and_in_the_core(line: str, rules: tuple[str, ...]) -> None:
    assert by_line(line, rules) == [1]


@pytest.mark.parametrize(
    ("line", "rules"),
    [
        ("write(s.note); s.note === null", IN_SCRIPTS),
        ("open.filter((one) => !named.has(one.id))", IN_SCRIPTS),
        ("warned.kind == Kind::Gap", IN_THE_CORE),
        ("text.split_once('@')", IN_THE_CORE),
    ],
)
def test_the_check_lets_facts_of_pages_and_of_the_core_pass(
    line: str, rules: tuple[str, ...]
) -> None:
    assert by_line(line, rules) == []


def test_no_module_looks_into_a_sentence() -> None:
    for path in sorted(PACKAGE.rglob("*.py")):
        lines = looked_into(path.read_text(encoding="utf-8"))
        assert not lines, f"{path.relative_to(PACKAGE)}, lines {lines}: decide by a field"


def test_no_page_looks_into_a_sentence() -> None:
    for path in sorted([*PACKAGE.rglob("*.js"), *PACKAGE.rglob("*.html")]):
        lines = by_line(path.read_text(encoding="utf-8"), IN_SCRIPTS)
        assert not lines, f"{path.relative_to(PACKAGE)}, lines {lines}: send a kind or an id"


def test_nothing_of_the_core_looks_into_a_sentence() -> None:
    paths = sorted(CORE.glob("*/src/**/*.rs"))
    assert paths
    for path in paths:
        source, _, _ = path.read_text(encoding="utf-8").partition("#[cfg(test)]\nmod tests")
        lines = by_line(source, IN_THE_CORE)
        assert not lines, f"{path.relative_to(CORE)}, lines {lines}: decide by a value"


def test_the_kinds_of_warnings_are_those_of_the_schema() -> None:
    for _, text in _core.schemas():
        types = json.loads(text)["$defs"]
        of_core = [kind["const"] for kind in types["WarnedKind"]["oneOf"]]
        assert list(KINDS) == of_core and set(KINDS) >= WIRING
        assert list(types["Warned"]["properties"]) == list(Warned.__dataclass_fields__)


def test_warnings_of_earlier_versions_are_their_text(tmp_path: Path) -> None:
    result = rsicalib.calibrate(DEMO / "readings.csv", rest=DEMO / "rest.csv").to_dict()
    path = tmp_path / "result.json"
    mixed = ["a22 looks odd", {"kind": "gap", "target": "a22", "text": "a gap"}]
    result["warnings"] = result["implausible"] = mixed
    path.write_text(json.dumps(result))
    read = rsicalib.load_calibration(path)
    told = (Warned("other", None, "a22 looks odd"), Warned("gap", "a22", "a gap"))
    assert (read.warnings, read.implausible) == (told, told)
    result["warnings"] = [{"kind": "gap", "target": 3, "text": "a gap"}]
    path.write_text(json.dumps(result))
    with pytest.raises(rsicalib.InputError, match=r"warnings\[0\]\.target .*found 3, expected"):
        rsicalib.load_calibration(path)


def test_why_a_solver_stopped_and_where_it_began_are_kinds(tmp_path: Path) -> None:
    found = rsicalib.calibrate(DEMO / "readings.csv", rest=DEMO / "rest.csv")
    assert found.termination_kind in {"gradient", "step", "cost", "stalled"} and found.converged
    assert found.starts[0].anchor == "rest"
    assert {start.gains for start in found.starts} <= {"declared", "scaled", "scattered"}
    # Results of earlier versions have the words alone.
    result = found.to_dict()
    for one in (result, *result["starts"]):
        for key in ("termination_kind", "converged", "anchor", "gains"):
            one.pop(key, None)
    path = tmp_path / "result.json"
    path.write_text(json.dumps(result))
    read = rsicalib.load_calibration(path)
    assert (read.termination, read.termination_kind) == (found.termination, None)
    assert read.converged is None and read.starts[0].anchor is None


def test_why_a_reading_is_left_out_is_a_kind(tmp_path: Path) -> None:
    readings = rsicalib.load_readings(DEMO / "readings.csv")
    values = readings.values.copy()
    values[readings.pose == readings.pose[0], 4] += 150.0
    bad = dataclasses.replace(readings, values=values)
    found = rsicalib.calibrate(bad, rest=DEMO / "rest.csv", terms=TERMS)
    (left,) = found.excluded
    assert (left.kind, left.channel) == ("reading", "a22")
    result = found.to_dict()
    del result["excluded"][0]["kind"]
    path = tmp_path / "result.json"
    path.write_text(json.dumps(result))
    (left,) = rsicalib.load_calibration(path).excluded
    assert left.kind == "other"


@pytest.mark.parametrize(
    ("source", "kind"),
    [
        ("declared", "declared"),
        ("misclosure of repeats, by channel", "repeats"),
        ("misclosure of neighbouring rows", "neighbours"),
        ("quantisation", "quantisation"),
        ("the fit itself; seatings 2.00e-2, of the fit itself", "fit"),
        ("another", None),
    ],
)
def test_where_the_noise_of_an_earlier_version_is_from(
    source: str, kind: str | None, tmp_path: Path
) -> None:
    """These results have words alone: how they began is written down, whatever is said now."""
    result = rsicalib.calibrate(DEMO / "readings.csv", rest=DEMO / "rest.csv").to_dict()
    result["noise"] = {k: v for k, v in result["noise"].items() if k != "kind"} | {"source": source}
    path = tmp_path / "result.json"
    path.write_text(json.dumps(result))
    noise = rsicalib.load_calibration(path).noise
    assert noise is not None and noise.kind == kind


def test_what_an_export_cannot_hold_is_a_kind() -> None:
    found = calibrated("rsi", rsicalib.calibrate(DEMO / "readings.csv", terms=TERMS))
    assert [(n.kind, n.term, n.target) for n in found.notes] == [("no_place", "curvature", "a22")]
    (said,) = found.said
    assert said == found.notes[0].text


def test_what_somebody_at_the_device_can_mend_reaches_the_guide() -> None:
    assert {"reversed", "exchanged", "gap", "no_start"} <= WIRING
