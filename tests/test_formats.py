"""Documents are what their schemas say."""

from __future__ import annotations

import json
import re
import tomllib
from pathlib import Path
from typing import Any

import jsonschema
import pytest

import rsicalib
from rsicalib import DEMO
from rsicalib.facts.records import plain
from scripts import declared, make_formats

SCHEMAS = Path(rsicalib.__file__).parent / "schema"
ROOT = Path(__file__).parents[1]


def mechanism_files() -> dict[str, str]:
    """Every whole mechanism file of the package, of the examples and of the pages."""
    paths = [*(ROOT / "examples").glob("*.toml"), *(SCHEMAS.parent / "mechanisms").glob("*.toml")]
    found = {path.name: path.read_text(encoding="utf-8") for path in paths}
    for page in [ROOT / "README.md", *(ROOT / "docs").rglob("*.md")]:
        blocks = re.findall(
            r"^```toml[^\n]*\n(.*?)^```", page.read_text(encoding="utf-8"), re.M | re.S
        )
        for number, text in enumerate(blocks, 1):
            if re.search(r"^length_unit", text, re.M) and re.search(r"^name", text, re.M):
                found[f"{page.name}, block {number}"] = text
    return found | {"rsi": rsicalib.load_mechanism("rsi").to_toml()}


def test_every_mechanism_file_is_what_the_schema_says() -> None:
    schema = json.loads((SCHEMAS / "mechanism.json").read_text(encoding="utf-8"))
    jsonschema.Draft202012Validator.check_schema(schema)
    files = mechanism_files()
    assert sum("urdf" in text for text in files.values()) >= 2
    assert len(files) > 10
    for name, text in files.items():
        errors = jsonschema.Draft202012Validator(schema).iter_errors(tomllib.loads(text))
        assert [error.message for error in errors] == [], name


def test_the_schema_of_a_mechanism_refuses_what_is_refused() -> None:
    schema = json.loads((SCHEMAS / "mechanism.json").read_text(encoding="utf-8"))
    rows = tomllib.loads((ROOT / "examples" / "two_arms.toml").read_text(encoding="utf-8"))
    urdf = tomllib.loads((ROOT / "examples" / "mukca_panda.toml").read_text(encoding="utf-8"))
    # Beside a description the channels may be declared in part; beside rows they are whole.
    part = [{"name": "q1", "noise": 1e-5}]
    jsonschema.validate({**urdf, "channel": part}, schema)
    (chain,) = urdf["chain"]
    without = [{key: value for key, value in chain.items() if key != "tip"}]
    wrong = [
        {**rows, "channel": [{"name": c["name"]} for c in rows["channel"]]},
        {key: value for key, value in rows.items() if key != "channel"},
        {**urdf, "chain": [{**chain, "dh": []}]},
        {**urdf, "chain": without},
        {**urdf, "chain": [{**chain, "top": "hand"}]},
    ]
    for document in wrong:
        with pytest.raises(jsonschema.ValidationError):
            jsonschema.validate(document, schema)


@pytest.fixture(scope="module")
def documents(tmp_path_factory: pytest.TempPathFactory) -> dict[str, list[dict[str, Any]]]:
    """Some of each format, as the commands print them: read as JSON again."""
    folder = tmp_path_factory.mktemp("results")
    head = {"version": rsicalib.__version__}
    for date in ("2025-01-02", "2025-07-02"):
        found = rsicalib.calibrate(DEMO / "readings.csv", rest=DEMO / "rest.csv", date=date)
        found.save(folder / f"{date}.json")
    known = rsicalib.load_readings(DEMO / "check.csv").values.copy()
    known[5:, 4] += 40.0  # a22 has turned by 40 counts
    monitor = rsicalib.Monitor(found)
    alarms = monitor.update(known)
    assert alarms
    supposed = rsicalib.suppose(DEMO / "readings.csv", ["curvature@a22.c2=0.02"])
    traced = rsicalib.trace(DEMO / "readings.csv", rest=DEMO / "rest.csv")
    certificates = [rsicalib.certify(one, limit=0.01) for one in (traced, found)]
    made = {
        "rsicalib.certificate/1": certificates,
        "rsicalib.plan/1": [rsicalib.plan(poses=12)],
        "rsicalib.supposition/1": [supposed],
        "rsicalib.alarm/1": alarms,
        "rsicalib.watch/1": [monitor.summary()],
        "rsicalib.history/1": [rsicalib.history(folder, target=0.01)],
    }
    out = {}
    for name, several in made.items():
        added = {} if name.split(".")[1].split("/")[0] in ("alarm", "watch", "history") else head
        texts = (json.dumps({"format": name, **added, **plain(one)}) for one in several)
        out[name] = [json.loads(text) for text in texts]
    return out


@pytest.mark.parametrize("name", sorted(set(declared.DOCUMENTS) - {"rsicalib.paper/1"}))
def test_documents_are_what_their_schemas_say(
    name: str, documents: dict[str, list[dict[str, Any]]]
) -> None:
    path = SCHEMAS / f"{name.removeprefix('rsicalib.').replace('/', '-')}.json"
    schema = json.loads(path.read_text(encoding="utf-8"))
    jsonschema.Draft202012Validator.check_schema(schema)
    for document in documents[name]:
        jsonschema.validate(document, schema)
        assert set(document) <= set(schema["properties"])


def test_a_schema_refuses_what_no_command_writes(
    documents: dict[str, list[dict[str, Any]]],
) -> None:
    alarm = documents["rsicalib.alarm/1"][0]
    for wrong in ({"row": "five"}, {"parameters": [{"name": "offset"}]}, {"format": "other"}):
        with pytest.raises(jsonschema.ValidationError):
            jsonschema.validate({**alarm, **wrong}, declared.schema("rsicalib.alarm/1"))


def test_every_key_has_its_meaning() -> None:
    for name in declared.DOCUMENTS:
        schema = declared.schema(name)
        for kind in (schema, *schema["$defs"].values()):
            assert kind["description"]
            assert all(len(value["description"]) > 3 for value in kind["properties"].values())


def test_a_law_has_the_classes_that_are_listed() -> None:
    """One was listed that the core refuses."""
    law = make_formats.mechanism_file()["$defs"]["OwnTerm"]["properties"]["class"]
    assert law["enum"] == ["sensor", "electronics", "geometry", "closure", "load"]
