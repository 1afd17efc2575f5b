"""Write `facts/shapes.py` and `schema/*.json` of the package from the types of the core.

Run as `python -m scripts.make_shapes`; a test compares. Names, types, defaults and docstrings are
those of `crates/rsicalib/src/report/document.rs`.
"""

from __future__ import annotations

import json
import textwrap
from collections.abc import Mapping
from importlib.machinery import ExtensionFileLoader
from importlib.util import module_from_spec, spec_from_loader
from pathlib import Path
from typing import Any

PACKAGE = Path(__file__).parents[1] / "python" / "rsicalib"


def _compiled() -> Any:
    """The compiled core by itself: the package may not import what is about to be written."""
    loader = ExtensionFileLoader("_core", str(next(PACKAGE.glob("_core*.so"))))
    spec = spec_from_loader("_core", loader)
    assert spec is not None
    module = module_from_spec(spec)
    loader.exec_module(module)
    return module


_core = _compiled()

RENAMED = {"class": "klass", "from": "origin"}
"""Keys that are words of Python, or say little as the name of an attribute."""

OWN = {"Parameter": {"interval": "profile"}}
"""The same of one class: `Estimate.interval` has bounds whether they are in the JSON or follow."""

MIXINS = {
    "Parameter": "Estimate",
    "Step": "Effect",
    "Hidden": "Absent",
    "Rival": "Together",
    "FitQuality": "Fitness",
}
"""Behaviour of a class that has some, its `repr` included: see `rsicalib.estimates`."""

BELOW = ("Warned",)
"""Records that readers of files make, in modules of their own; `tests/test_shapes.py` compares."""

ROOTS = ("Calibration", "Trace")

HEAD = '''"""The data of a result, in the shape of the JSON that the commands print.

Nothing here computes or writes: `rsicalib.results` adds what a result can do. Written by
`python -m scripts.make_shapes` from the types of the core; a test compares.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import field

from rsicalib._core import EvidenceSource
from rsicalib.arrays import FloatArray
from rsicalib.facts.estimates import Absent, Effect, Estimate, Fitness, Together
from rsicalib.facts.records import IF_KNOWN, NOT_WRITTEN, OMIT, Record
from rsicalib.facts.warned import Warned
from rsicalib.labels import Labelled
'''

RESIDUALS = '''    before_residuals: FloatArray | None = field(default=None, metadata=NOT_WRITTEN)
    """Residuals in units of noise, shape (poses, equations), before; not in the JSON."""
    after_residuals: FloatArray | None = field(default=None, metadata=NOT_WRITTEN)
    """The same of the final model."""
    source: EvidenceSource | None = field(default=None, metadata=NOT_WRITTEN)
    """What gathers the evidence for a report; None where the result was read from a file."""
'''


def schemas() -> dict[str, dict[str, Any]]:
    """JSON Schema of each format."""
    return {name: json.loads(text) for name, text in _core.schemas()}


def files() -> dict[Path, str]:
    """Everything that is generated, by path."""
    out = {PACKAGE / "facts" / "shapes.py": shapes()}
    for name, schema in schemas().items():
        stem = name.removeprefix("rsicalib.").replace("/", "-")
        text = json.dumps(schema, indent=1, ensure_ascii=False) + "\n"
        out[PACKAGE / "schema" / f"{stem}.json"] = text
    return out


def shapes() -> str:
    """The module of the data classes."""
    roots = {s["title"]: s for s in schemas().values()}
    evidence = json.loads(_core.evidence_schema())
    types = {k: v for root in (*roots.values(), evidence) for k, v in root["$defs"].items()}
    types[evidence["title"]] = evidence
    written = dict(_core.written_keys())
    records = {k: v for k, v in types.items() if "properties" in v and k not in BELOW}
    parts = []
    for name in _ordered(records):
        bases = f"{MIXINS[name]}, Record, repr=False" if name in MIXINS else "Record"
        renamed = RENAMED | OWN.get(name, {})
        fields = _fields(records[name], set(written[name]), records, renamed=renamed)
        parts.append(_class(name, bases, records[name], fields))
    options = "eq=False, repr=False, kw_only=True"
    first, second = (roots[name] for name in ROOTS)
    shared = [k for k in first["properties"] if k in second["properties"]]
    doc = {"description": "What a calibration and a traced calibration have in common."}
    common = _fields(first, set(written[ROOTS[0]]), records, shared) + RESIDUALS
    parts.append(_class("ResultShape", f"Record, {options}", doc, common))
    for name in ROOTS:
        own = [k for k in roots[name]["properties"] if k not in shared]
        fields = _fields(roots[name], set(written[name]), records, own)
        parts.append(_class(f"{name}Shape", f"ResultShape, {options}", roots[name], fields))
    return HEAD + "".join(f"\n\n{part}" for part in parts)


def _ordered(records: dict[str, Any]) -> list[str]:
    """Classes after those that their annotations name."""
    out: list[str] = []

    def add(name: str) -> None:
        for other in records:
            if f'"#/$defs/{other}"' in json.dumps(records[name]) and other != name:
                add(other)
        if name not in out:
            out.append(name)

    for name in records:
        add(name)
    return out


def _class(name: str, bases: str, schema: dict[str, Any], fields: str) -> str:
    doc = _doc(schema["description"], 4)
    return f"class {name}({bases}):\n{doc}\n{fields}"


def _doc(text: str, indent: int) -> str:
    """A docstring of a class: the first sentence, then paragraphs."""
    first, *rest = text.strip().split("\n\n")
    room = 100 - indent
    lines = textwrap.wrap(f'"""{" ".join(first.split())}', room)
    for paragraph in rest:
        lines += ["", *textwrap.wrap(" ".join(paragraph.split()), room)]
    end = '"""' if len(lines) == 1 and len(lines[0]) + 3 <= room else None
    lines = [lines[0] + end] if end else [*lines, '"""']
    return "\n".join(" " * indent + line if line else "" for line in lines) + "\n"


def _fields(
    schema: dict[str, Any],
    written: set[str],
    records: dict[str, Any],
    only: list[str] | None = None,
    renamed: Mapping[str, str] | None = None,
) -> str:
    out = []
    renamed = RENAMED if renamed is None else renamed
    for key, value in schema["properties"].items():
        if only is not None and key not in only:
            continue
        kind, empty = _kind(key, value, records)
        metadata = []
        if key in renamed:
            metadata.append(f'"key": "{key}"')
        arguments = []
        if "default" in value or key not in written:
            default = value.get("default")
            plain = json.dumps(default) if isinstance(default, str) else repr(default)
            own = isinstance(default, str | bool)
            arguments.append(f"default={plain}" if own else empty)
        omit = "OMIT" if empty != "default=None" else "IF_KNOWN"
        if metadata and key not in written:
            metadata.append(f"**{omit}")
        if metadata:
            arguments.append(f"metadata={{{', '.join(metadata)}}}")
        elif key not in written:
            arguments.append(f"metadata={omit}")
        name = renamed.get(key, key)
        if not arguments:
            line = f"    {name}: {kind}"
        elif len(arguments) == 1 and arguments[0].startswith("default="):
            line = f"    {name}: {kind} = {arguments[0].removeprefix('default=')}"
        else:
            line = f"    {name}: {kind} = field({', '.join(arguments)})"
        if len(line) > 100:
            line = f"    {name}: {kind} = field(\n        {', '.join(arguments)}\n    )"
        out.append(line + "\n" + _field_doc(value.get("description", "")))
    return "".join(out)


def _field_doc(text: str) -> str:
    if not text:
        return ""
    lines = textwrap.wrap(f'"""{" ".join(text.split())}"""', 96)
    return "".join(f"    {line}\n" for line in lines)


def _kind(key: str, value: dict[str, Any], records: dict[str, Any]) -> tuple[str, str]:
    """An annotation, and the default of a key that may be missing."""
    if "anyOf" in value:
        kinds = [_kind(key, v, records)[0] for v in value["anyOf"] if v.get("type") != "null"]
        return f"{kinds[0]} | None", "default=None"
    if "$ref" in value:
        name = value["$ref"].rpartition("/")[2]
        return (name if name in records or name in BELOW else "str"), "default=None"
    types = value["type"] if isinstance(value["type"], list) else [value["type"]]
    optional = " | None" if "null" in types else ""
    (kind,) = [t for t in types if t != "null"]
    if kind == "array":
        if key == "covariance":
            return "Labelled", "default=()"
        inner = _kind("", value["items"], records)[0]
        return f"tuple[{inner}, ...]{optional}", "default=None" if optional else "default=()"
    if kind == "object":
        inner = _kind("", value["additionalProperties"], records)[0]
        return f"Mapping[str, {inner}]", "default_factory=dict"
    plain = {"string": "str", "integer": "int", "number": "float", "boolean": "bool"}
    return plain[kind] + optional, "default=None"


def main() -> None:
    """Write the files."""
    for path, text in files().items():
        path.parent.mkdir(exist_ok=True)
        path.write_text(text, encoding="utf-8")


if __name__ == "__main__":
    main()
