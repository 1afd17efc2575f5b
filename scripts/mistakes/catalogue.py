"""The mistakes."""

from __future__ import annotations

import math
from dataclasses import dataclass, field

from scripts.mistakes.damage import (
    Damage,
    askew,
    cell,
    chained,
    column,
    comma_twice,
    decimal_commas,
    drop,
    edit,
    exchanged,
    first,
    fixed_rows,
    foreign,
    gains,
    joints,
    line,
    no_covariance,
    no_noise,
    read_only,
    recoded,
    repeated,
    result,
    reversed_sensor,
    rolled,
    short_curve,
    undigested_gains,
    write,
)

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
        "no column pose",
        CALIBRATE,
        4,
        "there is no column pose, and sample begins again",
        edit("readings.csv", (r"^[^,]*,", "")),
    ),
    Mistake("names in capitals", CALIBRATE, 2, "A11", edit("readings.csv", ("a11", "A11"))),
    Mistake(
        "a header without its line",
        CALIBRATE,
        2,
        "put a header line above it",
        edit("readings.csv", (r"\Apose.*\n", "")),
    ),
    Mistake(
        "two logs pasted into one",
        CALIBRATE,
        2,
        "found 'pose'",
        line(9, lambda text: "pose,sample" + text[3:]),
    ),
    Mistake(
        "strokes between columns",
        CALIBRATE,
        2,
        "separate columns by commas",
        edit("readings.csv", (",", "|")),
    ),
    Mistake(
        "hexadecimal counts", CALIBRATE, 2, "0x", column("a", lambda value, _: hex(int(value)))
    ),
    Mistake(
        "volts for counts",
        CALIBRATE,
        3,
        "are they in volts",
        column("a", lambda value, _: f"{value * 5 / 4095:.4f}"),
    ),
    Mistake(
        "ten bits for twelve",
        CALIBRATE,
        0,
        "another converter",
        column("a", lambda value, _: f"{value // 4:.0f}"),
    ),
    Mistake(
        "dates for seconds",
        CALIBRATE,
        2,
        "(seconds)",
        column("time_s", lambda value, _: f"2026-01-05T12:{value // 60:02.0f}:00"),
    ),
    Mistake(
        "one number for all poses",
        CALIBRATE,
        3,
        "all rows are of pose 1",
        column("pose", lambda *_: "1"),
    ),
    Mistake(
        "a pose for every sample",
        CALIBRATE,
        0,
        "every row has a pose of its own",
        column("pose", lambda _, row: str(row + 1)),
    ),
    Mistake(
        "known poses in millimetres",
        f"{CALIBRATE} --check check.csv",
        4,
        "25.4 times",
        chained(
            *(column(axis, lambda value, _: f"{value * 25.4:.6f}", "check.csv") for axis in "xyz")
        ),
    ),
    Mistake(
        "known angles in degrees",
        f"{CALIBRATE} --check check.csv",
        4,
        "known angles are in radians",
        column("r", lambda value, _: f"{math.degrees(value):.6f}", "check.csv"),
    ),
    Mistake(
        "known poses in another order",
        f"{CALIBRATE} --check check.csv",
        4,
        "in another order",
        rolled,
    ),
    Mistake(
        "another mechanism", f"{CALIBRATE} --mechanism maslow", 2, "'tl' (a channel of 'maslow')"
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
    Mistake("gains times 1000", FORWARD, 4, "were edited", result(gains)),
    Mistake("two values exchanged", FORWARD, 4, "were edited", result(exchanged)),
    Mistake(
        "gains times 1000, and no digest",
        "watch readings.csv --calibration result.json",
        4,
        "expects a misclosure",
        result(undigested_gains),
    ),
    Mistake(
        "no digest and no misclosure",
        "export result.json --to toml",
        4,
        "neither",
        result(lambda d: (d.pop("digest"), d.pop("misclosure"))),
    ),
    Mistake("degrees in a result", FORWARD, 2, "'rad'", result(lambda d: first(d, unit="deg"))),
    Mistake("a covariance that is not symmetric", FORWARD, 2, "covariance[1][0]", result(askew)),
    Mistake(
        "noise without a channel",
        FORWARD,
        2,
        "noise.sigma",
        result(no_noise),
    ),
    Mistake(
        "a row of a curve of one number",
        FORWARD,
        2,
        "steps[0].curve[0]",
        result(short_curve),
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
    Mistake(
        "a distance below zero",
        "mechanism rsi.toml",
        2,
        "found a value of -2.5",
        edit("rsi.toml", (r"value = 2\.5", "value = -2.5"), count=1),
    ),
    # Options.
    Mistake(
        "a twist in degrees",
        "mechanism rsi.toml",
        2,
        "90 degrees are 1.5708",
        edit("rsi.toml", (r"alpha = 1\.57\d*", "alpha = 90.0"), count=1),
    ),
    Mistake(
        "limits in degrees",
        "mechanism rsi.toml",
        0,
        "limits are in radians, unless a channel has unit",
        edit("rsi.toml", (r"^limits = .*", "limits = [-180.0, 180.0]"), count=1),
    ),
    Mistake(
        "a workspace in degrees",
        "mechanism rsi.toml",
        2,
        "radians within two turns",
        edit("rsi.toml", (r"^rx = .*", "rx = [-30, 30]")),
    ),
    Mistake(
        "a misspelt option, and no file", "calibrate --rset rest.csv", 2, "did you mean '--rest'"
    ),
    Mistake("a misspelt verb", "calibarte readings.csv", 2, "did you mean 'calibrate'"),
    Mistake("a misspelt option", "calibrate readings.csv --rset rest.csv", 2, "'--rest'"),
    Mistake("a plan of 10^20 poses", "plan --poses 99999999999999999999", 2, "1 to 10000"),
    Mistake("digits of another script", "plan --poses ١٢", 2, "an integer from 1"),
    Mistake("a port beyond the last", "guide --out out --port 99999", 2, "0 to 65535"),
    Mistake("a noise of 1e308", "simulate sim --noise 1e308", 2, "at most 1e+60"),
    Mistake("a noise beyond the range", "simulate sim --noise 9999", 2, "all over its range"),
    Mistake("an unknown option", "calibrate readings.csv --nosie 1", 2, "--nosie"),
    Mistake("an unknown term", "calibrate readings.csv --terms ofset", 2, "offset"),
    Mistake("no terms", "calibrate readings.csv --terms ,", 2, "term"),
    Mistake(
        "a searched term without its place", "calibrate readings.csv --terms slip@a22", 2, "place"
    ),
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
    Mistake("a name of Latin-1 bytes", f"{CALIBRATE} --out $(printf 'r\\351sultat')", 4, ""),
    # Deep and large.
    Mistake("a file without an end", "calibrate /dev/zero", 2, "RSICALIB_LARGEST_FILE", large=True),
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
