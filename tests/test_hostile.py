"""Names, files and words that no one expects: refused in a sentence, nothing left behind."""

from __future__ import annotations

import gzip
import json
import os
import re
import signal
import subprocess
import sys
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import rsicalib
from rsicalib import DEMO, InputError
from rsicalib.cli.parser import make_parser
from rsicalib.io.files import write_text
from rsicalib.io.sources import LIMIT, LONGEST_LINE, read_json
from rsicalib.io.stream import rows_of
from rsicalib.work.prior import read_population
from rsicalib.work.state import read_state
from tests.channels import Named
from tests.commands import run, run_text

READINGS = (DEMO / "readings.csv").read_text(encoding="utf-8")
POSIX = pytest.mark.skipif(os.name != "posix", reason="names of files are bytes on POSIX alone")


@POSIX
def test_a_name_that_is_no_text_is_written_out(tmp_path: Path) -> None:
    name = os.fsencode(tmp_path) + b"/caf\xe9.csv"
    with open(name, "wb") as file:
        file.write(READINGS.encode())
    out = os.fsencode(tmp_path) + b"/r\xe9sultat"
    done = run("calibrate", name, "--out", out, "--device", b"L\xe9on", "--quiet")
    assert done.returncode in (0, 4) and done.stderr == b"", done.stderr
    written = json.loads(Path(os.fsdecode(out), "result.json").read_bytes())
    assert written["readings"]["files"] == [os.fsdecode(tmp_path) + "/caf\\xe9.csv"]
    assert written["device"] == "L\\xe9on"
    again = run("forward", name, "--calibration", out + b"/result.json", "--quiet")
    assert again.returncode == 0 and again.stdout.startswith(b"pose,"), again.stderr
    refused = run("calibrate", name + b"x", "--json")
    assert refused.returncode == 2 and b"no such file" in refused.stdout


@POSIX
def test_what_a_killed_writer_left_is_removed_by_the_next(tmp_path: Path) -> None:
    program = f"""
import sys, time
from rsicalib.io.files import whole_file
with whole_file({str(tmp_path / "result.json")!r}) as file:
    file.write("half")
    file.flush()
    print("written", flush=True)
    time.sleep(60)
"""
    writer = subprocess.Popen([sys.executable, "-c", program], stdout=subprocess.PIPE)
    assert writer.stdout is not None and writer.stdout.readline() == b"written\n"
    (part,) = tmp_path.glob(".*.part")
    write_text(tmp_path / "other.txt", "whole")
    assert part.exists()  # its writer lives
    writer.send_signal(signal.SIGKILL)
    writer.communicate()
    write_text(tmp_path / "other.txt", "whole")
    assert sorted(os.listdir(tmp_path)) == ["other.txt"]


def test_a_file_of_more_bytes_than_a_limit_is_refused(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    plain, packed = tmp_path / "r.csv", tmp_path / "r.csv.gz"
    plain.write_text(READINGS, encoding="utf-8")
    packed.write_bytes(gzip.compress(READINGS.encode()))
    monkeypatch.setenv(LIMIT, "1e4")
    for path in (plain, packed):
        with pytest.raises(InputError, match=rf"more than 10000 bytes.* set {LIMIT} to"):
            rsicalib.load_readings(path)
    monkeypatch.setenv(LIMIT, "1e6")
    assert len(rsicalib.load_readings(packed)) == len(rsicalib.load_readings(plain))
    monkeypatch.setenv(LIMIT, "plenty")
    with pytest.raises(InputError, match="found 'plenty', expected bytes"):
        rsicalib.load_readings(plain)


def test_a_file_without_an_end_is_refused(monkeypatch: pytest.MonkeyPatch) -> None:
    if not Path("/dev/zero").exists():
        pytest.skip("no /dev/zero")
    monkeypatch.setenv(LIMIT, "1e6")
    with pytest.raises(InputError, match="more than 1e\\+06 bytes"):
        rsicalib.load_readings("/dev/zero")
    with pytest.raises(InputError, match=f"a line of more than {LONGEST_LINE:,} bytes"):
        next(rows_of("/dev/zero", Named("a11")))


@pytest.mark.parametrize("read", [read_state, read_population, read_json])
def test_every_file_is_read_up_to_the_limit(
    read: Callable[..., object], monkeypatch: pytest.MonkeyPatch
) -> None:
    """The state of a watch, a population and what a guide keeps were read to the end of memory."""
    if not Path("/dev/zero").exists():
        pytest.skip("no /dev/zero")
    monkeypatch.setenv(LIMIT, "1e6")
    more = {read_population: [rsicalib.load_mechanism("rsi")], read_json: ["JSON"]}.get(read, [])
    with pytest.raises(InputError, match=r"/dev/zero: found more than 1e\+06 bytes"):
        read("/dev/zero", *more)


@pytest.mark.parametrize("text", ["[" * 100_000, "{", "[]", '{"a": ' + "9" * 5000 + "}", ""])
def test_json_that_is_no_object_is_refused(tmp_path: Path, text: str) -> None:
    path = tmp_path / "population.json"
    path.write_text(text, encoding="utf-8")
    with pytest.raises(InputError, match=r"population.json(, line 1)?: found .* expected"):
        read_population(path, rsicalib.load_mechanism("rsi"))


def test_cells_that_repeat_do_not_grow_beyond_the_limit(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    pa = pytest.importorskip("pyarrow", reason="Parquet needs pyarrow")
    parquet = pytest.importorskip("pyarrow.parquet", reason="Parquet needs pyarrow")
    path = tmp_path / "r.parquet"
    columns = {c.name: np.zeros(200_000) for c in rsicalib.load_mechanism().channels}
    parquet.write_table(pa.table(columns), path)
    monkeypatch.setenv(LIMIT, "1e6")
    assert path.stat().st_size < 1e6
    with pytest.raises(InputError, match="more than 1e\\+06 bytes in cells"):
        rsicalib.load_readings(path)


@pytest.mark.parametrize(
    ("words", "name"),
    [
        (("calibarte", "r.csv"), "'calibrate'"),
        (("calibrate", "r.csv", "--rset", "x"), "'--rest'"),
        (("plan", "--criterion", "platfrom"), "'platform'"),
        (("completion", "bsh"), "'bash'"),
    ],
)
def test_the_command_asks_what_was_meant(words: tuple[str, ...], name: str) -> None:
    with pytest.raises(InputError, match=f"did you mean {name}"):
        make_parser().parse_args(words)


MEANT = {
    "a term": (lambda: rsicalib.calibrate(DEMO / "readings.csv", terms=["ofset"]), "offset"),
    "a target": (
        lambda: rsicalib.calibrate(DEMO / "readings.csv", terms=["curvature@a222"]),
        "a22",
    ),
    "a closure": (
        lambda: rsicalib.calibrate(DEMO / "readings.csv", closures=["wrist1-wrst2"]),
        "wrist1-wrist2",
    ),
    "a candidate": (
        lambda: rsicalib.trace(DEMO / "readings.csv", without=["curvatre"]),
        "curvature",
    ),
    "an effect": (
        lambda: rsicalib.suppose(DEMO / "readings.csv", ["curvatre@a22.c2=0.01"]),
        "curvature",
    ),
    "a criterion": (lambda: rsicalib.plan(criterion="platfrom"), "platform"),
    "a mechanism": (lambda: rsicalib.load_mechanism("rsii"), "rsi"),
    "a channel": (
        lambda: rsicalib.calibrate(DEMO / "readings.csv", noise={"a111": 1.0, "a1": 2.0}),
        "a11",
    ),
}


@pytest.mark.parametrize("kind", MEANT)
def test_a_name_with_a_slip_is_answered_with_the_one_that_is_near(kind: str) -> None:
    job, name = MEANT[kind]
    with pytest.raises(InputError) as caught:
        job()
    assert "did you mean" in str(caught.value) and name in str(caught.value)


def test_no_message_repeats_a_long_text() -> None:
    long = "sin(phi) + " * 20_000
    law = {"id": "x", "class": "sensor", "per": "channel", "correction": long}
    values = {**rsicalib.load_mechanism().to_dict(), "term": [law | {"parameters": {"a": 1.0}}]}
    jobs = [
        lambda: rsicalib.load_mechanism(values),
        lambda: rsicalib.calibrate(DEMO / "readings.csv", terms=["x" * 100_000]),
        lambda: rsicalib.calibrate("y" * 100_000),
        lambda: rsicalib.plan(criterion="z" * 100_000),
        lambda: rsicalib.plan(poses="1" * 100_000),  # type: ignore[arg-type]
        lambda: rsicalib.inverse("w" * 100_000),
    ]
    for job in jobs:
        with pytest.raises(InputError) as caught:
            job()
        assert len(str(caught.value)) < 1500


def test_a_value_is_never_shown_as_rust_debugs_it() -> None:
    values = rsicalib.load_mechanism().to_dict()
    values["closure"][0]["value"] = -1.0
    with pytest.raises(InputError, match="found a value of -1;") as caught:
        rsicalib.load_mechanism(values)
    assert "Some" not in str(caught.value)


def test_digits_are_those_from_0_to_9(tmp_path: Path) -> None:
    head, body = READINGS.split("\n", 1)
    arabic = str.maketrans("0123456789", "٠١٢٣٤٥٦٧٨٩")
    path = tmp_path / "r.csv"
    path.write_text(f"{head}\n{body.translate(arabic)}", encoding="utf-8")
    with pytest.raises(InputError, match="in digits other than 0 to 9"):
        rsicalib.load_readings(path)


def test_numbers_of_16_bits_are_refused() -> None:
    values = rsicalib.load_readings(DEMO / "readings.csv").values
    with pytest.raises(InputError, match="float16, which has no number between 2048 and 2050"):
        rsicalib.load_readings(values.astype(np.float16))
    assert len(rsicalib.load_readings(values.astype(np.float32))) == len(values)


def test_the_samples_of_one_pose_take_time_in_proportion() -> None:
    """Sixteen times the samples: 16 times the time if it is linear, 256 times if quadratic."""
    made = rsicalib.simulate(poses=20, samples=4, seed=3)
    rng = np.random.default_rng(0)

    def seconds(count: int) -> float:
        more = np.clip(np.round(made.readings.values[:1] + rng.normal(0, 1, (count, 9))), 0, 4095)
        values = np.concatenate([more, made.readings.values[4:]])
        pose = np.concatenate([np.full(count, 1), made.readings.pose[4:]])
        columns = dict(zip(made.readings.channels, values.T, strict=True))
        readings = rsicalib.load_readings({**columns, "pose": pose})
        began = time.process_time()
        rsicalib.calibrate(readings, rest=made.rest)
        return time.process_time() - began

    seconds(1000)
    assert seconds(32_000) < 48.0 * max(seconds(2000), 0.02)


@pytest.mark.parametrize("verb", [rsicalib.calibrate, rsicalib.trace])
@pytest.mark.parametrize("option", ["terms", "closures"])
def test_a_name_that_is_no_text_is_refused(verb: Callable[..., object], option: str) -> None:
    r"""Bytes of a command line that are no UTF-8 come as lone surrogates."""
    for name in ("\udcff", "a11\udce9"):
        with pytest.raises(InputError, match=r"found .*\\udc"):
            verb(DEMO / "readings.csv", rest=DEMO / "rest.csv", **{option: [name]})
        with pytest.raises(InputError, match=r"found .*\\udc"):
            rsicalib.suppose(DEMO / "readings.csv", ["curvature@a22.c2=0.02"], model=[name])


def test_a_name_of_a_file_that_cannot_be_is_refused(tmp_path: Path) -> None:
    """The part beside a file has a longer name: taking it away failed as well."""
    with pytest.raises(InputError, match="where one cannot write"):
        write_text(tmp_path / ("a" * 250), "text")
    with pytest.raises(InputError, match="null byte"):
        next(rows_of("a\0b", Named("a11")))


REACHES = re.compile(
    r"^\s*(?:import|from) "
    r"(subprocess|webbrowser|socket|socketserver|http|urllib\.request|ftplib|ssl)\b"
    r"|import_module\(\"(distributed)\"\)",
    re.M,
)
"""Modules that run programs or open connections."""


def test_what_runs_programs_or_opens_connections_is_on_the_page_of_security() -> None:
    package = Path(rsicalib.__file__).parent
    found = {
        path.relative_to(package).as_posix()
        for path in package.rglob("*.py")
        if REACHES.search(path.read_text(encoding="utf-8"))
    }
    options = {
        "guide/server.py": "guide --host",
        "guide/run.py": "--no-browser",
        "guide/source.py": "guide --source COMMAND",
        "guide/drive.py": "guide --drive COMMAND",
        "fleets/engines.py": "fleet --dask",
    }
    assert found == set(options)
    page = (Path(__file__).parents[1] / "SECURITY.md").read_text(encoding="utf-8")
    assert [option for option in options.values() if option not in page] == []


@pytest.mark.parametrize(
    ("words", "told"),
    [
        (
            ("--json", "calibrate", DEMO / "readings.csv"),
            "found '--json' before calibrate, expected it behind",
        ),
        (
            ("calibrate", DEMO / "readings.csv", "--js"),
            "found '--js' (did you mean '--json'?), expected an opt",
        ),
        (
            ("calibrate", DEMO / "readings.csv", "--noise", "a11=1,a12=1,a11=3"),
            "found a name twice",
        ),
        (("mechanism", "."), ".: found a directory, expected a mechanism file"),
        (("mechanism", ""), "found no such file, expected a mechanism file"),
        (("plan", "--out", "folder"), "folder: found a directory, expected the name of a file"),
    ],
)
def test_what_is_at_fault_in_a_command_is_named(
    words: tuple[Any, ...], told: str, tmp_path: Path
) -> None:
    (tmp_path / "folder").mkdir()
    done = run_text(*words, cwd=tmp_path)
    said = json.loads(done.stdout)["message"] if "--json" in words else done.stderr
    assert done.returncode == 2 and told in said


@pytest.mark.parametrize("verb", ["paper", "certify", "history"])
def test_a_file_of_another_is_refused_before_anything_is_computed(
    verb: str, tmp_path: Path
) -> None:
    stem = {"certify": "certificate"}.get(verb, verb)
    (tmp_path / f"{stem}.html").write_text("mine", encoding="utf-8")
    given = {"certify": ("none.json", "--limit", "1"), "history": ("none",)}.get(verb, ())
    done = run_text(verb, *given, "--out", tmp_path)
    assert done.returncode == 2 and "found a file that rsicalib did not write" in done.stderr


def test_a_list_that_is_advised_keeps_parameter_and_value() -> None:
    with pytest.raises(InputError, match=r"\['curvature@a22\.c2=0\.02'\]"):
        rsicalib.suppose(DEMO / "readings.csv", "curvature@a22.c2=0.02")  # type: ignore[arg-type]


def test_an_array_is_no_table_of_devices_whatever_is_installed() -> None:
    with pytest.raises(InputError, match="found ndarray, expected a data frame"):
        rsicalib.calibrate_devices(np.zeros((3, 9)))
