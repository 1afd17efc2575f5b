"""Mistakes that people make with the command, and what ought to come of each.

Each mistake begins from a folder with good files: `readings.csv`, `rest.csv` and `check.csv` of the
demo, `result.json` calibrated from them and `rsi.toml`. It damages a copy, runs one command there
as a user would, and expects an exit code and a part of the message. `scripts/make_mistakes.py`
writes the page, `tests/test_mistakes.py` runs them as tests.
"""

from __future__ import annotations

import json
import os
import re
import shutil
import signal
import subprocess
import sys
import tempfile
import threading
import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field
from pathlib import Path
from typing import IO

import rsicalib
from rsicalib import DEMO

LIMIT = 120.0
"""Seconds after which a command is ended."""

Damage = Callable[[Path], object]

CALIBRATE = "calibrate readings.csv --rest rest.csv"
FORWARD = "forward readings.csv --calibration result.json"


@dataclass(frozen=True)
class Mistake:
    """A command in a folder with damaged files, the exit code and words that are expected."""

    what: str
    words: str
    code: int
    says: str
    damage: Damage = lambda folder: None
    shell: str = ""
    """What a shell puts behind the command."""
    environment: dict[str, str | None] = field(default_factory=dict)
    """Variables that differ; None for one that is not there."""
    large: bool = False
    """Takes seconds, or much memory."""


@dataclass(frozen=True)
class Came:
    """What came of it."""

    code: int
    line: str
    text: str
    seconds: float
    megabytes: float


def edit(name: str, *changes: tuple[str, str], count: int = 0) -> Damage:
    """Replace patterns in a file; all of them, or as many as `count`."""

    def damage(folder: Path) -> None:
        text = (folder / name).read_text(encoding="utf-8")
        for pattern, new in changes:
            text, found = re.subn(pattern, new, text, count=count, flags=re.M)
            assert found, pattern
        (folder / name).write_text(text, encoding="utf-8")

    return damage


def line(number: int, new: Callable[[str], str], name: str = "readings.csv") -> Damage:
    """Change one line of a file, from 1."""

    def damage(folder: Path) -> None:
        lines = (folder / name).read_text(encoding="utf-8").splitlines()
        lines[number - 1] = new(lines[number - 1])
        (folder / name).write_text("\n".join(lines) + "\n", encoding="utf-8")

    return damage


def cell(number: int, column: int, value: str, name: str = "readings.csv") -> Damage:
    """Change one cell of a file."""

    def changed(text: str) -> str:
        cells = text.split(",")
        cells[column] = value
        return ",".join(cells)

    return line(number, changed, name)


def result(change: Callable[[dict[str, object]], object]) -> Damage:
    """Change the document of the result."""

    def damage(folder: Path) -> None:
        document = json.loads((folder / "result.json").read_text(encoding="utf-8"))
        change(document)
        (folder / "result.json").write_text(json.dumps(document), encoding="utf-8")

    return damage


def recoded(encoding: str, name: str = "readings.csv", words: str = "") -> Damage:
    """Write a file in another encoding, with a comment of these words above."""

    def damage(folder: Path) -> None:
        text = (folder / name).read_text(encoding="utf-8")
        (folder / name).write_bytes((f"# {words}\n" * bool(words) + text).encode(encoding))

    return damage


def decimal_commas(folder: Path) -> None:
    """Readings as a spreadsheet of another country saves them."""
    text = (folder / "readings.csv").read_text(encoding="utf-8")
    text = text.replace(",", ";").replace(";21;", ";21.5;").replace(".", ",")
    (folder / "readings.csv").write_text(text, encoding="utf-8")


def comma_twice(folder: Path) -> None:
    """Decimal commas between commas."""
    cell(2, 4, "2137,5")(folder)


def reversed_sensor(folder: Path) -> None:
    """A sensor that counts the other way."""
    path = folder / "readings.csv"
    head, *rows = [text.split(",") for text in path.read_text(encoding="utf-8").splitlines()]
    for row in rows:
        row[head.index("a21")] = str(4095 - int(row[head.index("a21")]))
    path.write_text("\n".join(map(",".join, [head, *rows])) + "\n", encoding="utf-8")


def joints(count: int) -> Damage:
    """A mechanism with a chain of many joints."""

    def damage(folder: Path) -> None:
        rows = ", ".join(f'{{channel = "q{k}", a = 1.0}}' for k in range(count))
        channels = "".join(
            f'[[channel]]\nname = "q{k}"\nunit = "rad"\ngain = 1.0\noffset = 0.0\n'
            for k in range(count)
        )
        text = (
            f'name = "snake"\nlength_unit = "m"\n{channels}[[chain]]\nname = "snake"\n'
            f'dh = [{rows}]\n[[point]]\nname = "tip"\nchain = "snake"\nat = [1.0, 0.0, 0.0]\n'
            '[[point]]\nname = "base"\nat = [0.5, 0.0, 0.0]\n[[closure]]\nname = "rope"\n'
            'kind = "distance"\nbetween = ["tip", "base"]\nvalue = 1.0\n'
        )
        (folder / "rsi.toml").write_text(text, encoding="utf-8")

    return damage


def fixed_rows(count: int) -> Damage:
    """A mechanism whose first chain has many fixed rows."""
    return edit(
        "rsi.toml",
        (r"(name = \"arm1\"\n)", r"\1\n" + "[[chain.dh]]\na = 0.0\n" * count),
        count=1,
    )


def repeated(times: int) -> Damage:
    """The session, many times over as poses of their own."""

    def damage(folder: Path) -> None:
        path = folder / "readings.csv"
        head, *rows = path.read_text(encoding="utf-8").splitlines()
        with path.open("w", encoding="utf-8") as out:
            out.write(head + "\n")
            for turn in range(times):
                for row in rows:
                    pose, sample, time_s, rest = row.split(",", 3)
                    later = float(time_s) + 1e4 * turn
                    out.write(f"{int(pose) + 48 * turn},{sample},{later:g},{rest}\n")

    return damage


def read_only(folder: Path) -> None:
    """A folder into which nothing can be written: a file stands where it ought to be."""
    (folder / "out").write_text("notes of mine\n", encoding="utf-8")


def foreign(folder: Path) -> None:
    """A folder with measured readings."""
    (folder / "out").mkdir()
    shutil.copy(folder / "readings.csv", folder / "out" / "readings.csv")


def write(name: str, text: str | bytes) -> Damage:
    """Write a file."""

    def damage(folder: Path) -> None:
        (folder / name).write_bytes(text if isinstance(text, bytes) else text.encode())

    return damage


def no_covariance(document: dict[str, object]) -> None:
    document["covariance"] = [[1.0]]


def first(document: dict[str, object], **values: object) -> None:
    """Change the first parameter of a result."""
    parameters = document["parameters"]
    assert isinstance(parameters, list)
    parameters[0].update(values)


def drop(document: dict[str, object]) -> None:
    parameters = document["parameters"]
    assert isinstance(parameters, list)
    del parameters[3:10]


MISTAKES = [
    # The table of readings.
    Mistake("no such file", "calibrate reading.csv", 2, "reading.csv"),
    Mistake("a folder for a file", "calibrate .", 2, "directory"),
    Mistake("an empty file", CALIBRATE, 2, "readings.csv", write("readings.csv", "")),
    Mistake(
        "a header without rows",
        CALIBRATE,
        2,
        "no readings",
        edit("readings.csv", (r"\n(.|\n)*", "\n")),
    ),
    Mistake("a wrong column name", CALIBRATE, 2, "a22", edit("readings.csv", ("a22", "b22"))),
    Mistake("a column twice", CALIBRATE, 2, "twice", edit("readings.csv", ("a22", "a21"))),
    Mistake(
        "two columns exchanged", CALIBRATE, 4, "a21", edit("readings.csv", ("a21,a22", "a22,a21"))
    ),
    Mistake(
        "a sign reversed",
        CALIBRATE,
        4,
        "a21",
        reversed_sensor,
    ),
    Mistake("text in a number", CALIBRATE, 2, "line 5", cell(5, 6, "12x4")),
    Mistake("a blank cell", CALIBRATE, 2, "line 9", cell(9, 4, "")),
    Mistake("a NaN", CALIBRATE, 2, "line 9", cell(9, 4, "nan")),
    Mistake("bad rows left out", f"{CALIBRATE} --skip-bad-rows", 4, "", cell(9, 4, "nan")),
    Mistake("a reading beyond the converter's range", CALIBRATE, 2, "4095", cell(9, 4, "40950")),
    Mistake(
        "a row with a cell too few", CALIBRATE, 2, "line 7", line(7, lambda t: t[: t.rindex(",")])
    ),
    Mistake("decimal commas between semicolons", CALIBRATE, 4, "", decimal_commas),
    Mistake("decimal commas between commas", CALIBRATE, 2, "line 2", comma_twice),
    Mistake(
        "radians for counts",
        CALIBRATE,
        3,
        "check the wiring",
        edit("readings.csv", (r"(?<=,)([12]\d\d\d)(?=,|$)", r"1.\1")),
    ),
    Mistake("UTF-16 of a spreadsheet", CALIBRATE, 2, "UTF-16", recoded("utf-16")),
    Mistake("Latin-1", CALIBRATE, 2, "UTF-8", recoded("latin-1", words="Gerät")),
    Mistake("a comment above the header", CALIBRATE, 4, "", recoded("utf-8-sig", words="Gerät 7")),
    Mistake(
        "a picture for a table",
        CALIBRATE,
        2,
        "readings.csv",
        write("readings.csv", b"\x89PNG\r\n\x1a\n\0\0"),
    ),
    Mistake("three poses", CALIBRATE, 3, "", edit("readings.csv", (r"^([4-9]|\d\d),.*\n", ""))),
    Mistake(
        "one pose again and again",
        CALIBRATE,
        3,
        "",
        edit("readings.csv", (r"^([2-9]|\d\d),.*\n", "")),
    ),
    Mistake(
        "a session for the rest pose",
        "calibrate readings.csv --rest readings.csv",
        4,
        "is it the right file?",
    ),
    Mistake(
        "check poses without poses",
        f"{CALIBRATE} --check readings.csv",
        2,
        "x y z rx ry rz",
    ),
    # A result.
    Mistake(
        "a wrong file for a result", "forward readings.csv --calibration rest.csv", 2, "rest.csv"
    ),
    Mistake(
        "a result cut off",
        FORWARD,
        2,
        "result.json",
        edit("result.json", (r"(?s)(.{3000}).*", r"\1"), count=1),
    ),
    Mistake("parameters missing in a result", FORWARD, 2, "19 rows", result(drop)),
    Mistake("a value of null", FORWARD, 2, "value", result(lambda d: first(d, value=None))),
    Mistake(
        "text for a value",
        FORWARD,
        2,
        'found text "2,5", expected a number',
        result(lambda d: first(d, value="2,5")),
    ),
    Mistake("another length unit", FORWARD, 2, "mm", result(lambda d: d.update(length_unit="mm"))),
    Mistake(
        "a later version of the format",
        FORWARD,
        2,
        "calibration/9",
        result(lambda d: d.update(format="rsicalib.calibration/9")),
    ),
    Mistake(
        "a covariance of another size",
        "watch check.csv --calibration result.json",
        2,
        "covariance",
        result(no_covariance),
    ),
    Mistake("nesting of 100,000", FORWARD, 2, "result.json", write("result.json", "[" * 100_000)),
    # A mechanism.
    Mistake("a mechanism that is not built in", "calibrate readings.csv --mechanism rsj", 2, "rsj"),
    Mistake(
        "a misspelt key",
        "mechanism rsi.toml",
        2,
        "legnth_unit",
        edit("rsi.toml", ("length_unit", "legnth_unit")),
    ),
    Mistake(
        "a point on no chain",
        "mechanism rsi.toml",
        2,
        "arm9",
        edit("rsi.toml", ('chain = "arm1"', 'chain = "arm9"')),
    ),
    Mistake(
        "a length of 1e308",
        "calibrate readings.csv --mechanism rsi.toml",
        2,
        "1e308",
        edit("rsi.toml", (r"a = 3\.2", "a = 1e308")),
    ),
    Mistake(
        "TOML that does not end",
        "mechanism rsi.toml",
        2,
        "rsi.toml",
        edit("rsi.toml", (r"\]\s*\Z", "")),
    ),
    # Options.
    Mistake("an unknown option", "calibrate readings.csv --nosie 1", 2, "--nosie"),
    Mistake("an unknown term", "calibrate readings.csv --terms ofset", 2, "offset"),
    Mistake("no terms", "calibrate readings.csv --terms ,", 2, "term"),
    Mistake("a channel that is not there", "calibrate readings.csv --noise a99=1", 2, "a99"),
    Mistake("a negative noise", "calibrate readings.csv --noise -1", 2, "noise"),
    Mistake("a noise of NaN", f"{CALIBRATE} --noise nan", 2, "noise"),
    Mistake("a negative seed", "simulate sim --seed -1", 2, "seed"),
    Mistake("a billion poses", "simulate sim --poses 1000000000", 2, "poses"),
    Mistake(
        "false alarms too many",
        "watch check.csv --calibration result.json --false-alarms 0.5",
        2,
        "0.01",
    ),
    Mistake("a date that is none", f"{CALIBRATE} --date 2025-02-30", 2, "2025-02-30"),
    # Files and terminals.
    Mistake("an output folder that is a file", f"{CALIBRATE} --out out", 2, "out", read_only),
    Mistake("measured readings in the way", "simulate out", 2, "readings.csv", foreign),
    Mistake("a folder that cannot be made", f"{CALIBRATE} --out /proc/out", 2, "/proc/out"),
    Mistake("a full disk", f"{CALIBRATE} --json", 2, "No space left", shell="> /dev/full"),
    Mistake("a closed standard output", f"{CALIBRATE} --out out", 4, "", shell=">&-"),
    Mistake("a reader that has gone", "terms", 0, "", shell="| true"),
    Mistake("no HOME", CALIBRATE, 4, "", environment={"HOME": None}),
    Mistake("a terminal of ASCII", CALIBRATE, 4, "", environment={"PYTHONIOENCODING": "ascii"}),
    # Deep and large.
    Mistake(
        "50 MB in one line",
        CALIBRATE,
        2,
        "readings.csv",
        write("readings.csv", "1" * 50_000_000),
        large=True,
    ),
    Mistake(
        "50 MB in one line of a mechanism",
        "mechanism rsi.toml",
        2,
        "rsi.toml",
        write("rsi.toml", "a = '" + "1" * 50_000_000),
        large=True,
    ),
    Mistake("3,000 joints", "mechanism rsi.toml", 0, "at most 2000", joints(3_000), large=True),
    Mistake(
        "200,000 rows of DH",
        "mechanism rsi.toml",
        0,
        "at most 2000",
        fixed_rows(200_000),
        large=True,
    ),
    Mistake("a session of 192,000 rows", CALIBRATE, 4, "", repeated(500), large=True),
    Mistake(
        "a million rows at work",
        "watch readings.csv --calibration result.json --quiet",
        4,
        "",
        repeated(2_600),
        large=True,
    ),
]


def prepared(folder: Path) -> None:
    """Good files."""
    for name in ("readings.csv", "rest.csv", "check.csv"):
        shutil.copy(DEMO / name, folder / name)
    found = rsicalib.trace(folder / "readings.csv", rest=folder / "rest.csv")
    found.save(folder / "result.json")
    (folder / "rsi.toml").write_text(rsicalib.load_mechanism("rsi").to_toml(), encoding="utf-8")


def run(mistake: Mistake, good: Path, folder: Path) -> Came:
    """Make one mistake in an empty folder."""
    for path in good.iterdir():
        shutil.copy(path, folder / path.name)
    mistake.damage(folder)
    variables = {**os.environ, "COLUMNS": "100", "NO_COLOR": "1", **mistake.environment}
    kept = {key: value for key, value in variables.items() if value is not None}
    command = f'"{sys.executable}" -m rsicalib {mistake.words} {mistake.shell}'
    begin = time.monotonic()
    with tempfile.TemporaryFile() as out, tempfile.TemporaryFile() as err:
        process = subprocess.Popen(
            ["sh", "-c", command],
            cwd=folder,
            env=kept,
            stdin=subprocess.DEVNULL,
            stdout=out,
            stderr=err,
            start_new_session=True,
        )
        alarm = threading.Timer(LIMIT, os.killpg, [process.pid, signal.SIGKILL])
        alarm.start()
        _, status, usage = os.wait4(process.pid, 0)
        alarm.cancel()
        process.returncode = os.waitstatus_to_exitcode(status)
        seconds = time.monotonic() - begin
        said, printed = (_whole(file) for file in (err, out))
    text = said.decode("utf-8", "replace") + printed.decode("utf-8", "replace")
    megabytes = usage.ru_maxrss / 1024
    return Came(process.returncode, _telling(said, printed), text, seconds, megabytes)


def _whole(file: IO[bytes]) -> bytes:
    file.seek(0)
    return file.read()


def _telling(err: bytes, out: bytes) -> str:
    """The first line that says what is wrong, or what was found."""

    def lines(text: bytes) -> Iterator[str]:
        return (part.strip() for part in text.decode("utf-8", "replace").splitlines())

    said = [part for part in lines(err) if re.match(r"(error|warning|rsicalib.*error):", part)]
    return next(iter([*said, *filter(None, lines(out))]), "")
