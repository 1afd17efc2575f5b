"""JSON Schemas of the documents that the package makes, from the classes that hold them.

A class is the one declaration of a document: its fields are the keys, their annotations the types,
the strings below them the meanings. `scripts.make_formats` writes the schemas and the page.
"""

from __future__ import annotations

import ast
import dataclasses
import inspect
import re
import textwrap
import types
from collections.abc import Mapping
from functools import cache
from typing import Any, Literal, Union, cast, get_args, get_origin, get_type_hints

import numpy as np

from rsicalib.facts.records import Record
from rsicalib.planning.plans import Plan
from rsicalib.planning.supposing import Supposition
from rsicalib.report.past import History
from rsicalib.reproduction.document import Paper
from rsicalib.results.certificate import Certificate
from rsicalib.verbs.monitor import Alarm, Watch

DOCUMENTS: dict[str, type[Record]] = {
    "rsicalib.plan/1": Plan,
    "rsicalib.supposition/1": Supposition,
    "rsicalib.certificate/1": Certificate,
    "rsicalib.alarm/1": Alarm,
    "rsicalib.watch/1": Watch,
    "rsicalib.history/1": History,
    "rsicalib.paper/1": Paper,
}
"""Documents that are made of records of Python, by their formats."""

PLAIN: dict[Any, dict[str, Any]] = {
    str: {"type": "string"},
    int: {"type": "integer"},
    float: {"type": ["number", "null"]},  # what is not known is null
    bool: {"type": "boolean"},
    Any: {},
}

ARRAY = {
    "title": "array of numbers",
    "type": "array",
    "items": {"type": ["number", "array", "null"]},
}

HEAD = {
    "format": {"type": "string", "description": "Kind of the document and version of its shape."},
    "version": {"type": "string", "description": "Version of the program."},
}


def schema(name: str) -> dict[str, Any]:
    """JSON Schema of a document, with those of the records in it under `$defs`."""
    kind = DOCUMENTS[name]
    inner: dict[str, type[Record]] = {}
    whole = _record(kind, inner)
    if "format" not in whole["properties"]:  # written by the command
        whole["properties"] = HEAD | whole["properties"]
        whole["required"] = [*HEAD, *whole["required"]]
    whole["properties"]["format"] = whole["properties"]["format"] | {"const": name}
    defined: dict[str, Any] = {}
    while set(inner) - set(defined):
        key = next(key for key in inner if key not in defined)
        defined[key] = _record(inner[key], inner)
    head = {"$schema": "https://json-schema.org/draft/2020-12/schema", "title": kind.__name__}
    return head | whole | {"$defs": defined}


def _record(kind: type[Record], inner: dict[str, type[Record]]) -> dict[str, Any]:
    hints, words = get_type_hints(kind), _words(cast(Any, kind))
    properties, required = {}, []
    for field in dataclasses.fields(kind):
        if not field.metadata.get("written", True):
            continue
        key = field.metadata.get("key", field.name)
        properties[key] = _type(hints[field.name], inner) | {"description": words[field.name]}
        if "omit" not in field.metadata:
            required.append(key)
    about = inspect.getdoc(kind) or ""
    return {
        "description": about.partition("\n\n")[0].replace("\n", " "),
        "type": "object",
        "properties": properties,
        "required": required,
    }


def _type(kind: Any, inner: dict[str, type[Record]]) -> dict[str, Any]:
    """Schema of an annotation."""
    if kind in PLAIN:
        return dict(PLAIN[kind])
    origin, arguments = get_origin(kind), get_args(kind)
    if origin in (Union, types.UnionType):
        several = [_type(k, inner) for k in arguments if k is not type(None)]
        return {"anyOf": [*several, {"type": "null"}]}
    if origin is Literal:
        return {"enum": list(arguments)}
    if origin is tuple:
        return {"type": "array", "items": _type(arguments[0], inner)}
    if origin is np.ndarray:
        return dict(ARRAY)
    if isinstance(origin, type) and issubclass(origin, Mapping):
        return {"type": "object", "additionalProperties": _type(arguments[1], inner)}
    if isinstance(kind, type) and issubclass(kind, Record):
        inner[kind.__name__] = kind
        return {"$ref": f"#/$defs/{kind.__name__}"}
    raise TypeError(f"found {kind!r}, expected what a document can hold")


@cache
def _words(kind: Any) -> Mapping[str, str]:
    """What stands below each field, those of the classes before it included."""
    found: dict[str, str] = {}
    for cls in reversed(kind.__mro__):
        if not dataclasses.is_dataclass(cls):
            continue
        (tree,) = ast.parse(textwrap.dedent(inspect.getsource(cast(type, cls)))).body
        assert isinstance(tree, ast.ClassDef)
        for field, below in zip(tree.body, tree.body[1:], strict=False):
            if isinstance(field, ast.AnnAssign) and isinstance(below, ast.Expr):
                assert isinstance(field.target, ast.Name) and isinstance(below.value, ast.Constant)
                text = inspect.cleandoc(str(below.value.value)).replace("\n", " ")
                found[field.target.id] = re.sub(r"\b(None|NaN)\b", "null", text)
    return found
