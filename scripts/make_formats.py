"""Write `docs/formats.md` and schemas of files and documents: `python -m scripts.make_formats`.

Keys, types and meanings are those of the core (mechanisms and results), of the columns that
readings may have, and of the classes of the other documents; a test compares.
"""

from __future__ import annotations

import html
import json
import re
from collections.abc import Iterable, Iterator, Mapping
from functools import cache
from pathlib import Path
from typing import Any

from rsicalib import _core
from rsicalib.errors import InputError
from rsicalib.io.cells import COLUMNS
from rsicalib.io.files import write_text
from rsicalib.io.mechanisms import URDF_KEYS
from scripts import declared

ROOT = Path(__file__).parents[1]
PAGE = ROOT / "docs" / "formats.md"
SCHEMAS = ROOT / "python" / "rsicalib" / "schema"

SAID_ONCE = {
    "format": (
        "Kind of the document and version of its shape.",
        "Kind of the line and version of its shape.",
        "Kind of the summary and version of its shape.",
    ),
    "version": ("Version of the program.",),
    "mechanism": ("Name of the mechanism.",),
    "length_unit": ("Unit of every length.",),
    "term": ("Id of the term.",),
    "target": ("What the term belongs to.",),
    "place": ("Where a searched term acts.",),
    "label": ("What people call the target.",),
    "name": ("Name of the parameter.", "Its name."),
    "unit": (
        "Unit of the numbers beside it.",
        "Unit of both.",
        "Unit of all three.",
        "Unit of all of them.",
        "Unit of the size.",
        "Unit of the value.",
        "Unit of the values.",
        "Its unit.",
    ),
}
"""Keys of many types: what the page says of each once, then what the types say of the same."""


def _once(*names: str) -> dict[str, str]:
    """What the page says of keys that many documents have."""
    return {name: SAID_ONCE[name][0] for name in names}


BY_HAND = {
    "rsicalib.poses/1": {
        **_once("format", "version", "mechanism", "length_unit"),
        "columns": "`pose`, and `sample` and `time_s` where the readings have them; `beyond`, 1 "
        "where a free curve is held, beyond the readings at which it was seen, else 0; `x y z` "
        "[length unit] and `rx ry rz` [rad], or `ball.x ball.y ball.z` for each point that a chain "
        "carries; under a calibration their standard deviations `sd_…`. One list each.",
    },
    "rsicalib.terms/1": {
        **_once("format", "version"),
        "terms": "A list: `id`, `class`, `doc`, `needs`, `parameters` (`name`, `unit`, `typical`) "
        "and `targets`.",
    },
    "rsicalib.import/1": {
        **_once("format", "version"),
        "source": "The log, as it was given.",
        "kind": "What it is, in words.",
        "sha256": "Digest of what was read.",
        "sessions": "A list: `name` (null where there is one), `samples`, `poses` (null of a "
        "recording), `in_motion` (rows between held poses, null where there are none), `columns`.",
        "findings": "What its user should know, a sentence each; nothing was repaired.",
        "files": "SHA-256 of each file beside it, in `import.json`; not on standard output.",
    },
    "rsicalib.export/1": {
        **_once("format", "version"),
        "to": "For whom: `maslow`, `klipper`, …",
        "files": "SHA-256 of each file beside it, in `export.json`.",
    },
    "rsicalib.fleet/1": {
        **_once("format", "version"),
        "devices": "Number of devices.",
        "verdicts": "Number of devices by verdict; `refused` where there is none.",
        "summed": "The tests of fit of all devices together, null where they cannot be summed: "
        "`devices`, `chi2`, `dof`, `p_value`.",
        "shifts": "A list, how far each parameter is from the drawing on the average, in its unit: "
        "`parameter` as `fleet.parquet` names it, `devices`, `value`, `half` (half width of the "
        "interval of 95 %), `between` (standard deviation from device to device) and "
        "`between_interval`, of 95 % (null where devices differ by less than their own errors make "
        "them), `p_value` (null of unknown things, of which the drawing says nothing), "
        "`common` (yes where it is no chance). With `--levels`, `half` and `p_value` are null "
        "where fewer than three groups are independent, and `levels` has for each level, what "
        "`--by` names first: `level`, `groups` (how many), `sd` between them (null where it cannot "
        "be told), `interval` of 95 % (null where less than what is below "
        "makes; an end is null where nothing bounds it), `same_as` (the level with the same "
        "groups, or null).",
        "population": "With `--population`: what `population.json` holds.",
        "files": "Files that were written.",
    },
    "rsicalib.population/1": {
        **_once("format", "version", "mechanism", "length_unit"),
        "terms": "Terms with a tolerance, which were estimated.",
        "centre": "Reading of each channel at which offsets are told apart from gains.",
        "devices": "Number of devices that take part.",
        "design": "A list, errors of the drawing that all devices share, the most significant "
        "first: `term`, `target`, `name`, `value` (to be added to the drawing), `sd`, `unit`, "
        "`p_value`, `also_fits`.",
        "parameters": "A list: `term`, `target`, `name`, `unit`, `tolerance` (standard deviation "
        "by the drawing), `shift` (common to all devices), `sd` of the shift, `between` (standard "
        "deviation from device to device, null where no device tells it) and `between_interval`, "
        "of 95 % (null where devices differ by less than their errors make them; an end is null "
        "where nothing bounds it), `spread` (standard deviation that is expected from one "
        "calibration to another: of all levels together, and at least a hundredth of the "
        "tolerance); with `--levels` also `levels`, as in `rsicalib.fleet/1`; `between` is then "
        "that of the level of devices, and null where it cannot be told.",
        "outliers": "Devices unlike the others, which tell nothing of them.",
    },
    "rsicalib.truth/1": {
        **_once("format", "version"),
        "files": "SHA-256 of each table beside it.",
        "simulator": "The program that made the device.",
        "mechanism": SAID_ONCE["mechanism"][0],
        "seed": "Of all that was drawn.",
        "noise": "Standard deviation of a sample, in units of the channel, before it is rounded: "
        "one number, or one for each channel where they differ.",
        "effect": "What is wrong beside offsets and gains: null where nothing is.",
        "off": "Offset by channel, in rad or `length_unit`.",
        "gain": "Gain by channel, in rad or `length_unit` per unit of the reading.",
    },
    "rsicalib.error/1": {
        "format": SAID_ONCE["format"][0],
        "message": "What was found, what was expected, and what to do.",
        "where": "`file`, `line`, `column`, `found`, `expected`, each null where it does not "
        "apply; null where the fault has no place.",
    },
}
"""Documents that a command writes as they come; a test compares the keys with the command's."""

ABOUT = {
    "rsicalib.poses/1": "Poses of the platform.",
    "rsicalib.terms/1": "What can be identified.",
    "rsicalib.import/1": "What a log was made into.",
    "rsicalib.export/1": "Files for a controller.",
    "rsicalib.fleet/1": "Many devices together.",
    "rsicalib.population/1": "What the devices of a fleet have in common.",
    "rsicalib.truth/1": "What is wrong with a simulated device.",
    "rsicalib.error/1": "Why there is no answer.",
}
"""What documents without a type are."""

WRITTEN_BY = {
    "rsicalib.calibration/1": "`calibrate`, `fixture`",
    "rsicalib.trace/1": "`trace`",
    "rsicalib.poses/1": "`forward`",
    "rsicalib.terms/1": "`terms`",
    "rsicalib.import/1": "`import`",
    "rsicalib.export/1": "`export`",
    "rsicalib.fleet/1": "`fleet`",
    "rsicalib.population/1": "`fleet --population`",
    "rsicalib.truth/1": "`simulate`",
    "rsicalib.error/1": "each with `--json`",
    "rsicalib.plan/1": "`plan`",
    "rsicalib.supposition/1": "`suppose`",
    "rsicalib.certificate/1": "`certify`",
    "rsicalib.alarm/1": "`watch`",
    "rsicalib.watch/1": "`watch`",
    "rsicalib.history/1": "`history`",
    "rsicalib.paper/1": "`paper`",
}
"""The commands that write each document."""

HEAD = """\
# File formats

Every key, column and unit. Written by `python -m scripts.make_formats` from the types that read
the files; a test compares. Lengths are in the mechanism's `length_unit`, angles in radians,
readings in the unit of their channel; [conventions](conventions.md) has frames and signs. Lists
of keys open with a click. A **bold** key is needed in a mechanism, and always there in a result.

"""

MECHANISM = """\
## Mechanism: TOML

A key that is not listed here is refused. `rsicalib mechanism FILE` checks a file; editors check
and complete it by its JSON Schema, `rsicalib/schema/mechanism.json` in the package.

"""

URDF = """\
### `[[chain]]` from a URDF

In place of `dh`, a chain may name a robot description. Channels that its joints name and the file
does not declare are filled in: readings in rad (m for a slide), gain 1, offset 0, limits of the
description.

"""

READINGS = """\
## Readings: CSV or Parquet

CSV in UTF-8 with a header line; or Parquet, if the name ends in `.parquet` or `.pq`; or a data
frame. Between the cells of CSV stand commas, semicolons or tabs, as the header says; beside
semicolons and tabs decimals may have a comma. The file may be packed by gzip, may have comment
lines (`#`) above the header and a row of units below it, which is held against the mechanism's. One
row is one sample of all channels. Columns are found by
name, in any order; other columns are ignored with a warning. A cell that cannot be used makes the
file refused, with line and column.

Needed are one column for each channel of the mechanism, in the channel's unit and within its
`range`; one text column for each name in `unknown` of a point; and one column of distances for
each closure whose `value` is a name [length unit]. These are optional:

"""

UNITS = {
    "rad": "Angle.",
    "length": "The mechanism's `length_unit`.",
    "reading": "Unit of the channel.",
    "rad/reading": "Joint angle per reading; results name the channel's unit: `rad/count`.",
    "1": "A ratio.",
    "s": "Time.",
    "s^2": "Square of a time constant.",
    "1/K": "Fraction per kelvin from the mean temperature of the readings.",
    "1/turn": "Waves in one turn of the joint.",
    "rad/K": "Angle per kelvin from the mean temperature of the readings.",
    "length/K": "Length per kelvin from the mean temperature of the readings.",
    "1/session": "Fraction from the beginning of a session to its end.",
    "rad/session": "Angle from the beginning of a session to its end.",
    "rad/torque": "Angle per torque about the joint. A torque is **mass × length**, in the unit of "
    "the links' `mass` and in `length_unit`, without g: a kilogram at a metre is 1. To have it per "
    "newton metre, divide by 9.81 m/s².",
    "rad/length": "Angle per torque of a **unit weight** at the points that the chain carries: the "
    "torque of a weight of 1 is the length of its lever.",
}
"""Units of the parameters of terms, which the core names; a test compares."""

EVERYWHERE = " ([of many types](#keys-of-many-types))"

RESULTS = """\
## Results: JSON

`--json` prints one document on standard output; `--out` writes it as `result.json`. What is not
known is null. Readers skip keys that they do not know ([what stays](stability.md)). The package
has JSON Schemas in `rsicalib/schema/`, but for {without}, which are described here alone.

### Keys of many types

"""


def text() -> str:
    """The whole page."""
    parts = [HEAD, listed(), MECHANISM, *mechanism(), URDF, folded("Keys", said_keys(URDF_KEYS))]
    parts += [READINGS, said_keys(COLUMNS), "\n"]
    parts += ["## Units of parameters\n\n", said_keys(UNITS), "\n"]
    parts += ["The parameters of each term, with their units: [terms](terms.md).\n\n"]
    without = ", ".join(f"`{name}`" for name in BY_HAND)
    parts += [
        RESULTS.format(without=without),
        said_keys({key: words[0] for key, words in SAID_ONCE.items()}),
        "\n",
    ]
    parts += results()
    for name, keys in BY_HAND.items():
        parts += [f"### `{name}`\n\n{ABOUT[name]}\n\n", folded("Keys", said_keys(keys))]
    parts += documents(_schemas())
    return "".join(parts).rstrip() + "\n"


def listed() -> str:
    """Links to all formats, by what writes them."""
    rows = {
        "by hand": "[mechanism](#mechanism-toml)",
        "by hand, `import`": "[readings](#readings-csv-or-parquet)",
    }
    for name in [*_schemas(), *BY_HAND, *declared.DOCUMENTS]:
        by, before = WRITTEN_BY[name], rows.get(WRITTEN_BY[name])
        rows[by] = f"{before}, {_link(name)}" if before else _link(name)
    return "".join(f"- {by}: {links}\n" for by, links in rows.items()) + "\n"


def folded(summary: str, inner: str) -> str:
    """What a click on its summary opens."""
    said = re.sub(r"`([^`]*)`", r"<code>\1</code>", html.escape(summary, quote=False))
    return (
        f'<details markdown="1">\n<summary>{said}</summary>\n\n{inner.rstrip()}\n\n</details>\n\n'
    )


def _of_core() -> dict[str, Any]:
    """Schema of a mechanism by the core."""
    return _with_classes(json.loads(_core.mechanism_schema()))


def _with_classes(schema: dict[str, Any]) -> dict[str, Any]:
    """A schema in which a law of one's own has the classes that the core takes of one."""
    kinds = schema["$defs"]
    if "OwnTerm" in kinds:
        words = kinds["OwnTerm"]["properties"]["class"]["description"]
        classes = [one["const"] for one in kinds["Class"]["oneOf"] if _is_of_laws(one["const"])]
        own = {"type": "string", "enum": classes, "description": words}
        kinds["OwnTerm"]["properties"]["class"] = own
    return schema


def _is_of_laws(klass: str) -> bool:
    """Whether a law of one's own may be of a class."""
    law = {"id": "law", "per": "all", "correction": "a", "parameters": {"a": 1.0}}
    try:
        _core.Term.from_dict({**law, "class": klass})
    except InputError as error:
        return f'found "{klass}"' not in error.message
    return True


def mechanism_file() -> dict[str, Any]:
    """Schema of a mechanism file: of a mechanism, and of what a robot description stands for in it.

    Beside a chain from a URDF channels need not be declared, nor what the description tells of
    them.
    """
    schema = _of_core()
    kinds = schema["$defs"]
    text = {"type": "string"}
    types = {"channels": {"type": "object", "additionalProperties": text}}
    kinds["ChainFromUrdf"] = {
        "type": "object",
        "additionalProperties": False,
        "properties": {k: {**types.get(k, text), "description": v} for k, v in URDF_KEYS.items()},
        "required": [key for key in URDF_KEYS if key != "masses"],
        "description": "A serial chain from a robot description, in place of rows.",
    }
    rows = schema["properties"]["chain"]["items"]
    described = {"$ref": "#/$defs/ChainFromUrdf"}
    either = {"if": {"required": ["urdf"]}, "then": described, "else": rows}
    schema["properties"]["chain"]["items"] = either
    whole = {"required": [k for k in kinds["Channel"]["required"] if k != "name"]}
    kinds["Channel"]["required"] = ["name"]
    schema["required"] = [key for key in schema["required"] if key != "channel"]
    some = {"chain": {"contains": {"required": ["urdf"]}}}
    schema["if"] = {"properties": some, "required": ["chain"]}
    schema["else"] = {"required": ["channel"], "properties": {"channel": {"items": whole}}}
    return schema


def mechanism() -> Iterator[str]:
    """Keys of a mechanism file: the whole, then each type below its key."""
    schema = _of_core()
    yield from _sections("The whole file", schema, schema["$defs"])


def _sections(title: str, kind: Mapping[str, Any], types: Mapping[str, Any]) -> Iterator[str]:
    """The keys of one type, and those of the types of its keys."""
    yield f"### {title}\n\n{_prose(kind['description'])}\n\n"
    yield folded("Keys", schema_keys(kind, types))
    whole = kind.get("$defs") is types
    for key, value in kind["properties"].items():
        rows = value.get("type") == "array"
        for one in [value.get("items", {}) if rows else value, *value.get("anyOf", ())]:
            below = types.get(str(one.get("$ref")).rpartition("/")[2], {})
            if "properties" in below:
                head = f"[[{key}]]" if rows else f"[{key}]"
                yield from _sections(f"`{head if whole else f'{key} = […]'}`", below, types)


def results() -> Iterator[str]:
    """Keys of results."""
    mechanism = _of_core()
    done = {"mechanism-toml": mechanism}
    for name, schema in _schemas().items():
        yield from _document(name, schema, done)
        done[name] = schema


def documents(before: Mapping[str, Any]) -> Iterator[str]:
    """Keys of the documents that classes hold."""
    done = dict(before)
    for name in declared.DOCUMENTS:
        schema = declared.schema(name)
        yield from _document(name, schema, done)
        done[name] = schema


def _document(name: str, schema: Mapping[str, Any], done: Mapping[str, Any]) -> Iterator[str]:
    """The keys of a document, and of each type in it, but for those that others have."""
    types = schema["$defs"]
    yield f"### `{name}`\n\n{_prose(schema['description'])}\n\n"
    yield _keys_beside(schema, types, done)
    said: dict[str, list[str]] = {}
    for kind, definition in types.items():
        if "properties" not in definition:
            continue
        first, _, rest = _prose(definition["description"]).partition("\n\n")
        keys = schema_keys(definition, types)
        owners = [n for n, other in done.items() if _plain(keys) == _plain(_listed(kind, other))]
        if owners:
            said.setdefault(owners[0], []).append(f"`{kind}`")
            continue
        inner = f"{rest}\n\n" if rest else ""
        yield folded(f"`{kind}`: {first}", inner + keys)
    if not any(_based(schema, other) for other in done.values()):
        for owner, kinds in said.items():
            yield f"{' and '.join(kinds)}: see {_link(owner)}.\n\n"


def _keys_beside(
    schema: Mapping[str, Any], types: Mapping[str, Any], done: Mapping[str, Any]
) -> str:
    """The keys of a document beside those of an earlier one that it continues."""
    base = next((name for name, other in done.items() if _based(schema, other)), None)
    if base is None:
        return folded("Keys", schema_keys(schema, types))
    earlier, own = done[base]["properties"], schema["properties"]
    without = " and ".join(f"`{key}`" for key in earlier if key not in own)
    new = {key: value for key, value in own.items() if earlier.get(key) != value}
    head = f"All keys of {_link(base)} but {without}, with the same types, and these.\n\n"
    return head + folded("Keys", schema_keys({**schema, "properties": new}, types))


def _based(schema: Mapping[str, Any], other: Mapping[str, Any]) -> bool:
    """Whether a document has most keys of another one."""
    earlier, own = other.get("properties", {}), schema["properties"]
    return 2 * sum(bool(own.get(key) == value) for key, value in earlier.items()) > len(earlier)


def _listed(kind: str, schema: Mapping[str, Any]) -> str:
    """The keys of a type of a document; none where it has no such type."""
    found = schema["$defs"].get(kind, {})
    return schema_keys(found, schema["$defs"]) if "properties" in found else ""


def _plain(keys: str) -> str:
    """A list without what is needed: a key that is null elsewhere has the same meaning."""
    return keys.replace("**", "")


def _link(name: str) -> str:
    if name == "mechanism-toml":
        return "[the mechanism](#mechanism-toml)"
    return f"[`{name}`](#{_anchor(name)})"


def _anchor(name: str) -> str:
    return re.sub(r"[^\w-]", "", name)


def _schemas() -> dict[str, dict[str, Any]]:
    """Schemas of the core's results by format."""
    return {name: _with_classes(json.loads(schema)) for name, schema in _core.schemas()}


def schema_keys(schema: Mapping[str, Any], types: Mapping[str, Any]) -> str:
    """A list of the keys of one type."""
    needed = set(schema.get("required", ()))
    rows: dict[str, list[str]] = {}
    for key, value in schema["properties"].items():
        words = _prose(value.get("description", "")).replace("\n\n", " ")
        if words in SAID_ONCE.get(key, ()):
            row = EVERYWHERE
        else:
            named = "" if words.rstrip(".").lower() == key else f": {words}"
            row = f" ({_kind(value, types)}){named}{_default(value)}"
        rows.setdefault(row, []).append(f"**`{key}`**" if key in needed else f"`{key}`")
    return "".join(f"- {', '.join(keys)}{row}\n" for row, keys in rows.items())


def said_keys(keys: Mapping[str, str]) -> str:
    """A list of keys and what they mean."""
    rows: dict[str, list[str]] = {}
    for key, words in keys.items():
        said = " ".join(words.split())
        known = said in SAID_ONCE.get(key, ()) and len(keys) != len(SAID_ONCE)
        rows.setdefault(EVERYWHERE if known else f": {said}", []).append(f"`{key}`")
    return "".join(f"- {', '.join(names)}{words}\n" for words, names in rows.items())


def _kind(value: Mapping[str, Any], types: Mapping[str, Any]) -> str:
    """A type in words."""
    if "title" in value:
        return str(value["title"])
    if "$ref" in value:
        name = value["$ref"].rpartition("/")[2]
        found = types.get(name, {})
        choices = _choices(found)
        if choices:
            return choices
        if "anyOf" in found:
            return " or ".join(_kind(v, types) for v in found["anyOf"])
        return str(name)
    if "enum" in value:
        return _choices(value)
    if "anyOf" in value:
        kinds = [_kind(v, types) for v in value["anyOf"] if v.get("type") != "null"]
        return " or ".join(kinds)
    if "allOf" in value:
        return _kind(value["allOf"][0], types)
    plain = {
        "string": "text",
        "integer": "whole number",
        "number": "number",
        "boolean": "yes or no",
    }
    kinds = value.get("type", "object")
    names = [k for k in ([kinds] if isinstance(kinds, str) else kinds) if k != "null"]
    if names == ["array"]:
        count = value.get("minItems")
        inner = _kind(value.get("items", {}), types)
        return (
            f"{count} × {inner}" if count and count == value.get("maxItems") else f"list of {inner}"
        )
    if names == ["object"] and isinstance(value.get("additionalProperties"), dict):
        return f"table of {_kind(value['additionalProperties'], types)}"
    return " or ".join(plain.get(name, name) for name in names)


def _choices(schema: Mapping[str, Any]) -> str:
    """The values of an enumeration."""
    values = list(schema.get("enum", ()))
    values += [v["const"] for v in schema.get("oneOf", ()) if "const" in v]
    values += [e for v in schema.get("oneOf", ()) for e in v.get("enum", ())]
    return ", ".join(f'`"{value}"`' for value in values)


def _default(value: Mapping[str, Any]) -> str:
    default = value.get("default")
    if default in (None, "", [], {}) or isinstance(default, dict):
        return ""
    return f" Default: `{json.dumps(default)}`."


def _prose(doc: str) -> str:
    """A doc comment as Markdown: paragraphs joined, links of Rust as plain code."""
    doc = re.sub(r"\[`([^`\]]*)`\](?:\([^)]*\))?", r"`\1`", doc)
    doc = re.sub(r"[^.\n]*`\w+::[^.]*\.", "", doc)  # what concerns Rust alone
    doc = doc.replace("`None` for", "left out for").replace("`None`:", "left out:")
    fenced = re.split(r"(```.*?```)", doc, flags=re.S)
    parts = [p if p.startswith("```") else re.sub(r"(?<!\n)\n(?!\n)", " ", p) for p in fenced]
    return "".join(parts).strip()


def documented(name: str) -> Iterable[str]:
    """Keys of a document that is no result."""
    return BY_HAND[name] if name in BY_HAND else declared.schema(name)["properties"]


@cache
def files() -> dict[Path, str]:
    """Everything that is written, by path."""
    schemas = {"mechanism": mechanism_file()}
    for name in declared.DOCUMENTS:
        schemas[name.removeprefix("rsicalib.").replace("/", "-")] = declared.schema(name)
    written = {
        SCHEMAS / f"{stem}.json": json.dumps(schema, indent=1, ensure_ascii=False) + "\n"
        for stem, schema in schemas.items()
    }
    return {PAGE: text(), **written}


def main(paths: Iterable[tuple[Path, str]]) -> None:
    """Write the files."""
    for path, content in paths:
        write_text(path, content)


if __name__ == "__main__":
    main(files().items())
