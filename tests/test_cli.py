"""The command, run as a newcomer runs it."""

from __future__ import annotations

import inspect
import json
import os
import re
import signal
import subprocess
import sys
import time
from argparse import ArgumentParser
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import rsicalib
from rsicalib import DEMO
from rsicalib.cli import output, progress, verbs
from rsicalib.cli.arguments import ARGUMENTS, Verb
from rsicalib.guide.run import guide
from tests.commands import run_text as run

OTHERWISE = {
    "import_": rsicalib.import_log,
    "export": rsicalib.export_result,
    "guide": guide,
}
"""Functions of verbs whose names Python has for something else."""
READINGS, REST, CHECK = (str(DEMO / f"{name}.csv") for name in ("readings", "rest", "check"))
VERBS = ("demo", "calibrate", "trace", "fixture", "forward", "terms", "mechanism")
VERBS += ("simulate", "plan", "guide", "paper", "fleet", "watch", "history")


def strict(text: str) -> dict[str, Any]:
    """JSON without NaN, and nothing else."""

    def refuse(token: str) -> None:
        raise AssertionError(token)

    found: dict[str, Any] = json.loads(text, parse_constant=refuse)
    return found


def test_every_option_of_a_verb_is_taken() -> None:
    """One of `fixture` was read, and handed on to nobody."""
    source = "".join(map(inspect.getsource, (verbs, output, progress)))
    for run_verb, add in ARGUMENTS.items():
        parser = ArgumentParser()
        add(Verb(parser))
        name = run_verb.__name__
        function = OTHERWISE.get(name) or getattr(rsicalib, name, None)
        of_python = set() if function is None else {*inspect.signature(function).parameters}
        for dest in {action.dest for action in parser._actions} - of_python - {"help"}:
            assert re.search(rf"args\.{dest}\b|args, \"{dest}\"", source), (run_verb, dest)


@pytest.mark.parametrize("verb", VERBS)
def test_every_verb_says_what_it_is_for(verb: str) -> None:
    done = run(verb, "--help")
    assert done.returncode == 0
    assert done.stdout.startswith(f"usage: rsicalib {verb}")
    assert len(done.stdout.splitlines()) > 5
    assert done.stderr == ""


def test_the_command_says_what_verbs_there_are() -> None:
    done = run("--help")
    assert done.returncode == 0
    for verb in VERBS:
        assert f"    {verb}" in done.stdout


def test_the_demo_explains_a_device_and_prints_the_path_of_its_report(tmp_path: Path) -> None:
    done = run("demo", cwd=tmp_path)
    assert done.returncode == 0, done.stderr
    assert done.stdout.startswith("Explained: ")
    path = tmp_path / done.stdout.splitlines()[-1]
    assert path.name == "report.html"
    written = {f.name for f in path.parent.iterdir()}
    assert written == {"report.html", "report.txt", "result.json", "calibrated.toml", "figures"}
    figures = {f.name for f in (path.parent / "figures").iterdir()}
    assert {"residuals.svg", "mechanism.svg", "effect1-law.svg"} <= figures
    assert strict((path.parent / "result.json").read_text())["verdict"] == "explained"
    text = (path.parent / "report.txt").read_text()
    assert all(f"a{arm}{joint} " in text for arm in (1, 2, 3) for joint in (1, 2, 3))
    assert "held-out" in text and "check poses" in text and "more" not in text.split("→")[0]
    assert len(text.splitlines()) < 80
    use = "→ Use it: rsicalib forward READINGS --calibration rsicalib-demo/result.json"
    assert use in text.splitlines() and use in done.stdout.splitlines()  # it is copied as it stands
    assert "--calibration rsicalib-demo/result.json<" in path.read_text().replace("</span>", "")


def test_calibrate_and_trace_print_only_the_result_with_json() -> None:
    done = run("calibrate", READINGS, "--rest", REST, "--check", CHECK, "--json")
    assert done.returncode == 4  # the device has an undeclared effect
    assert strict(done.stdout)["format"] == "rsicalib.calibration/1"
    done = run("trace", READINGS, "--rest", REST, "--check", CHECK, "--json")
    assert done.returncode == 0
    assert strict(done.stdout)["format"] == "rsicalib.trace/1"


def test_device_note_and_date_reach_the_result() -> None:
    words = ("--device", "number 7", "--note", "new pot", "--date", "2025-03-01")
    for verb in ("calibrate", "fixture"):
        found = json.loads(run(verb, CHECK, *words, "--json").stdout)
        given = [found[key] for key in ("device", "note", "valid_from")]
        assert given == ["number 7", "new pot", "2025-03-01"]


def test_a_result_is_the_same_from_run_to_run() -> None:
    first, again = (run("trace", READINGS, "--rest", REST, "--json") for _ in range(2))
    assert first.stdout == again.stdout


def test_the_summary_says_what_to_do_next() -> None:
    """Whole in a pipe, which has no report beside it; `test_report` counts a terminal's lines."""
    for words in (
        ("calibrate", READINGS),
        ("calibrate", READINGS, "--rest", REST, "--check", CHECK, "--align"),
        ("trace", READINGS, "--rest", REST),
        ("fixture", CHECK),
    ):
        lines = run(*words).stdout.splitlines()
        assert not any(" more" in line and line.startswith("  …") for line in lines)
        assert max(map(len, lines)) <= 100
        assert any(line.startswith("→ ") for line in lines)


def test_closure_is_not_accuracy_is_said_where_no_pose_is_known() -> None:
    assert "Closure is not accuracy" in run("calibrate", READINGS).stdout
    assert "Closure is not accuracy" not in run("calibrate", READINGS, "--check", CHECK).stdout


def test_forward_writes_a_table_of_poses(tmp_path: Path) -> None:
    path = tmp_path / "result.json"
    path.write_text(run("trace", READINGS, "--rest", REST, "--json").stdout)
    done = run("forward", CHECK, "--calibration", str(path))
    assert done.returncode == 0
    lines = done.stdout.splitlines()
    assert lines[0].startswith("pose,sample,time_s,x,y,z,rx,ry,rz,")
    found = np.array([line.split(",")[3:9] for line in lines[1:]], dtype=float)
    known = np.genfromtxt(CHECK, delimiter=",", names=True)
    # A sample has 1 count of noise on each of nine channels: a few hundredths of an inch.
    assert np.abs(found[:, 0] - known["x"]).max() < 0.05
    document = strict(run("forward", CHECK, "--json").stdout)
    assert len(document["columns"]["rz"]) == 160


@pytest.mark.parametrize("verb", ["forward", "calibrate", "trace", "fixture"])
def test_a_mechanism_that_was_forgotten_is_asked_for(verb: str, tmp_path: Path) -> None:
    own = tmp_path / "own.csv"
    own.write_text("pose,crank,rocker\n1,0.1,0.2\n2,0.3,0.4\n")
    done = run(verb, own)
    assert done.returncode == 2
    assert done.stderr.count("give yours as mechanism (--mechanism FILE)") == 1
    one = tmp_path / "one.csv"  # of this mechanism, without one of its columns
    one.write_text(Path(READINGS).read_text().replace("a11", "b11", 1))
    done = run(verb, one)
    assert done.returncode == 2 and "--mechanism" not in done.stderr


@pytest.mark.parametrize("verb", ["forward", "calibrate", "trace"])
def test_the_mechanism_of_a_result_is_asked_for_before_its_readings(
    verb: str, tmp_path: Path
) -> None:
    result = tmp_path / "result.json"
    text = run("calibrate", READINGS, "--json").stdout
    result.write_text(text.replace('"mechanism": "rsi"', '"mechanism": "mine"', 1))
    own = tmp_path / "own.csv"
    own.write_text("pose,crank,rocker\n1,0.1,0.2\n2,0.3,0.4\n")
    done = run(verb, own, "--calibration", result)
    assert (
        done.returncode == 2
        and "found a calibration of 'mine', expected one of 'rsi'" in done.stderr
    )
    assert "Give its own as mechanism" in done.stderr and "no such column" not in done.stderr


def test_a_result_can_be_the_start_of_the_next_one(tmp_path: Path) -> None:
    path = tmp_path / "result.json"
    path.write_text(run("trace", READINGS, "--rest", REST, "--json").stdout)
    done = run("calibrate", READINGS, "--calibration", str(path), "--json")
    assert done.returncode == 0
    assert strict(done.stdout)["moved"] == []


@pytest.mark.parametrize(
    ("words", "message"),
    [
        (("calibrate", "nowhere.csv"), "no such file"),
        (("calibrate",), "required: READINGS"),
        (("calibrate", READINGS, "--noise", "a11"), "found 'a11'"),
        (("calibrate", READINGS, "--terms", "slope"), "slope"),
        (("calibrate", READINGS, "--mechanism", "nowhere.toml"), "no such file"),
        (("calibrate", READINGS, "--fit-groups", "one"), "group"),
        (("trace", READINGS, "--check", READINGS), "no columns x y z"),
        (("forward", READINGS, "--calibration", READINGS), "not JSON"),
        (("terms", "slope"), "found no term 'slope'"),
        (("mechanism", "nowhere"), "no such file"),
        (("rehearse",), "rehearse"),
    ],
)
def test_what_cannot_be_used_exits_with_2_and_says_why(
    words: tuple[str, ...], message: str
) -> None:
    done = run(*words)
    assert done.returncode == 2
    assert done.stdout == ""
    assert done.stderr.startswith("error: ")
    assert message in done.stderr
    assert "Traceback" not in done.stderr
    done = run(*words, "--json")
    assert done.returncode == 2
    error = strict(done.stdout)
    assert error["format"] == "rsicalib.error/1"
    assert message in error["message"]
    assert set(error) == {"format", "message", "where"}


def test_a_bad_cell_is_named_by_line_and_column(tmp_path: Path) -> None:
    lines = Path(READINGS).read_text().splitlines()
    lines[6] = lines[6].rsplit(",", 1)[0] + ",lots"
    path = tmp_path / "bad.csv"
    path.write_text("\n".join(lines))
    done = run("calibrate", str(path), "--json")
    assert done.returncode == 2
    where = strict(done.stdout)["where"]
    assert (where["line"], where["column"], where["found"]) == (7, "a33", "'lots'")
    done = run("calibrate", str(path), "--skip-bad-rows", "--json")
    assert done.returncode == 4
    (skipped,) = strict(done.stdout)["readings"]["skipped"]
    assert (skipped["line"], skipped["column"]) == (7, "a33")


def test_data_that_determine_nothing_exit_with_3_and_still_print_a_result(tmp_path: Path) -> None:
    path = tmp_path / "few.csv"
    path.write_text("\n".join(Path(READINGS).read_text().splitlines()[:33]))  # 4 poses
    for verb in ("calibrate", "trace"):
        done = run(verb, str(path), "--json")
        assert done.returncode == 3
        assert strict(done.stdout)["verdict"] == "undetermined"


def test_warnings_go_to_standard_error_unless_quiet() -> None:
    done = run("calibrate", CHECK, "--rest", REST, "--json")
    assert "warning: " in done.stderr
    strict(done.stdout)
    done = run("calibrate", CHECK, "--rest", REST, "--quiet")
    assert done.stdout == done.stderr == ""


def test_out_that_cannot_be_made_is_refused(tmp_path: Path) -> None:
    (tmp_path / "file").write_text("")
    done = run("calibrate", READINGS, "--out", str(tmp_path / "file"))
    assert done.returncode == 2
    assert "file', which cannot be a folder" in done.stderr


def test_terms_and_mechanisms_are_shown(tmp_path: Path) -> None:
    assert "curvature" in run("terms").stdout
    assert "c2" in run("terms", "curvature").stdout
    assert strict(run("terms", "curvature", "--json").stdout)["terms"][0]["id"] == "curvature"
    text = run("mechanism", "rsi").stdout
    path = tmp_path / "mine.toml"
    path.write_text(text)
    assert run("mechanism", str(path)).stdout == text
    assert strict(run("mechanism", "--json").stdout)["name"] == "rsi"


def test_a_mechanism_that_contradicts_itself_is_refused(tmp_path: Path) -> None:
    path = tmp_path / "mine.toml"
    path.write_text(run("mechanism", "rsi").stdout.replace("wrist1-wrist2", "wrist1-wrist3", 1))
    done = run("mechanism", str(path))
    assert done.returncode == 2
    assert "wrist1-wrist3" in done.stderr


def working(process: subprocess.Popen[str]) -> None:
    """Wait until the core computes, which it does in a thread of its own."""
    threads = Path(f"/proc/{process.pid}/task")
    until = time.monotonic() + 60
    while time.monotonic() < until and process.poll() is None:
        time.sleep(0.1)
        if not threads.exists() or len(list(threads.iterdir())) > 1:
            break
    time.sleep(0.5)


@pytest.mark.skipif(os.name == "nt", reason="signals")
def test_ctrl_c_exits_with_130_and_leaves_no_half_written_file(tmp_path: Path) -> None:
    # A long recording keeps the core busy well beyond the signal.
    rows = Path(READINGS).read_text().splitlines()
    head, body = rows[0].split(",", 1)[1], [row.split(",", 1)[1] for row in rows[1:]]
    path = tmp_path / "long.csv"
    path.write_text("\n".join([head, *(body * 260)]))
    command = [sys.executable, "-m", "rsicalib", "trace", str(path), "--out", "out"]

    def heed() -> None:
        # What runs in the background of a shell ignores the signal, and its children do.
        signal.signal(signal.SIGINT, signal.SIG_DFL)

    with subprocess.Popen(
        command,
        cwd=tmp_path,
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
        preexec_fn=heed,
    ) as process:
        time.sleep(1.5)
        process.send_signal(signal.SIGINT)
        try:
            out, _ = process.communicate(timeout=60)
        finally:
            process.kill()
    assert process.returncode == 130
    assert out == ""
    assert {p.name for p in tmp_path.iterdir()} <= {"long.csv"}


@pytest.mark.skipif(os.name == "nt", reason="pipes")
def test_a_reader_that_has_seen_enough_is_no_error() -> None:
    command = f"{sys.executable} -m rsicalib forward {READINGS} | head -1"
    done = subprocess.run(command, shell=True, capture_output=True, text=True, timeout=300)
    assert done.stdout.startswith("pose,sample,time_s,x,y,z,rx,ry,rz")
    assert done.stderr == ""
