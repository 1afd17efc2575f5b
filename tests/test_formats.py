"""Documents are what their schemas say."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import jsonschema
import pytest

import rsicalib
from rsicalib import DEMO
from rsicalib.facts.records import plain
from scripts import declared

SCHEMAS = Path(rsicalib.__file__).parent / "schema"


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
    alarms = [alarm for row in known for alarm in monitor.update(row)]
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
