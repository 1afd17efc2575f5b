"""What a release rests on: one version, true metadata, workflows that may do little."""

from __future__ import annotations

import re
import subprocess
import sys
import tomllib
from pathlib import Path
from typing import Any

import pytest
from ruamel.yaml import YAML  # check-jsonschema needs it

import rsicalib

ROOT = Path(__file__).parents[1]
WORKFLOWS = sorted((ROOT / ".github" / "workflows").glob("*.yml"))


def load(path: str | Path) -> Any:
    """A TOML or a YAML file of the repository."""
    text = (ROOT / path).read_text(encoding="utf-8")
    toml = Path(path).suffix in {".toml", ".lock"}
    return tomllib.loads(text) if toml else YAML(typ="safe").load(text)


CARGO = load("Cargo.toml")
PYPROJECT = load("pyproject.toml")


def conforms(schema: str, *paths: Path) -> None:
    """Checks files against a schema that comes with check-jsonschema: no network."""
    command = [sys.executable, "-m", "check_jsonschema", "--builtin-schema", schema, *paths]
    done = subprocess.run(command, capture_output=True, text=True)
    assert done.returncode == 0, done.stdout + done.stderr


def test_one_version_stands_in_the_workspace() -> None:
    version = CARGO["workspace"]["package"]["version"]
    assert rsicalib.__version__ == version
    newest = re.search(r"^## (\S+)", (ROOT / "CHANGELOG.md").read_text(encoding="utf-8"), re.M)
    assert newest is not None and newest[1] == version
    assert load("CITATION.cff")["version"] == version
    for crate in ("crates/rsicalib", "crates/rsicalib-py", "benches"):
        assert load(f"{crate}/Cargo.toml")["package"]["version"] == {"workspace": True}
    assert PYPROJECT["project"]["dynamic"] == ["version"]


def test_the_oldest_python_is_the_same_wherever_it_is_told() -> None:
    oldest = PYPROJECT["project"]["requires-python"].removeprefix(">=")
    (abi3,) = CARGO["workspace"]["dependencies"]["pyo3"]["features"]
    assert abi3 == "abi3-py" + oldest.replace(".", "")
    check = load(".github/workflows/ci.yml")["jobs"]["check"]
    tested = check["strategy"]["matrix"]["python"]
    prefix = "Programming Language :: Python :: 3."
    named = [c.split(" :: ")[-1] for c in PYPROJECT["project"]["classifiers"] if prefix in c]
    assert tested == named
    assert tested[0] == oldest


def test_one_address_of_the_repository_or_none_yet() -> None:
    addresses = {
        CARGO["workspace"]["package"].get("repository"),
        PYPROJECT["project"].get("urls", {}).get("Repository"),
        load("CITATION.cff").get("repository-code"),
    }
    assert len(addresses) == 1, addresses


def test_nothing_is_locked_for_a_feature_that_is_off() -> None:
    names = [package["name"] for package in load("Cargo.lock")["package"]]
    assert "glam" not in names, "nalgebra or statrs was given its feature `std`; see Cargo.toml"
    assert names.count("nalgebra") == 1


def test_the_citation_is_of_the_format_that_it_names() -> None:
    conforms("vendor.citation-file-format", ROOT / "CITATION.cff")


def test_the_workflows_are_workflows() -> None:
    assert len(WORKFLOWS) == 5
    conforms("vendor.github-workflows", *WORKFLOWS)


@pytest.mark.parametrize("path", WORKFLOWS, ids=lambda p: p.stem)
def test_a_workflow_may_do_no_more_than_each_job_says(path: Path) -> None:
    text = path.read_text(encoding="utf-8")
    assert "secrets." not in text
    assert "pull_request_target" not in text
    workflow = load(path)
    assert workflow["permissions"] == {}
    assert "group" in workflow["concurrency"]
    for name, job in workflow["jobs"].items():
        allowed = {("contents", "read")}
        if "environment" in job:
            allowed |= {("id-token", "write")}
            allowed |= {("pages", "write")} if path.stem == "docs" else set()
        assert set(job["permissions"].items()) <= allowed, name
        if "uses" in job:  # another workflow, with limits of its own
            assert (ROOT / job["uses"]).exists(), name
            continue
        assert job["timeout-minutes"] <= 90, name
        for step in job["steps"]:
            if "uses" in step:
                assert re.fullmatch(r"[\w.-]+/[\w.-]+@v\d+(\.\d+)*", step["uses"]), step["uses"]
            if step.get("uses", "").startswith("actions/checkout@"):
                assert step["with"]["persist-credentials"] is False, name
            # What somebody else can name (a branch, a title) never becomes part of a script.
            assert "${{" not in step.get("run", ""), step


def test_continuous_integration_runs_the_one_list_of_checks() -> None:
    (job,) = load(".github/workflows/ci.yml")["jobs"].values()
    assert [step["run"] for step in job["steps"] if "run" in step] == [".ci/run"]
    assert (ROOT / ".ci" / "run").read_text(encoding="utf-8").rstrip().endswith('/../check"')


def test_what_is_promised_is_what_there_is() -> None:
    page = (ROOT / "docs" / "stability.md").read_text(encoding="utf-8")
    sources = [p.read_text(encoding="utf-8") for p in ROOT.glob("python/rsicalib/**/*.py")]
    written = {form for text in sources for form in re.findall(r'"(rsicalib\.\w+/\d+)"', text)}
    assert written == set(re.findall(r"`(rsicalib\.\w+/\d+)`", page))


def test_the_licence_of_the_crate_is_that_of_the_repository() -> None:
    assert (ROOT / "crates/rsicalib/LICENSE").read_bytes() == (ROOT / "LICENSE").read_bytes()
