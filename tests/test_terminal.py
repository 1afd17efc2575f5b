"""What people see in a terminal: the story, progress, colours, completion."""

from __future__ import annotations

import contextlib
import dataclasses
import io
import os
import re
import shutil
import subprocess
import sys
from argparse import Namespace
from functools import cache
from pathlib import Path

import numpy as np
import pytest

import rsicalib
from rsicalib import DEMO
from rsicalib.cli import colours, completion, progress
from rsicalib.cli.output import summary_of
from rsicalib.cli.parser import make_parser
from rsicalib.cli.progress import ProgressLine, progress_of
from rsicalib.cli.streams import folded
from rsicalib.report.terminal import LABELS
from tests.commands import run_text
from tests.full import sized

READINGS, REST, CHECK = (str(DEMO / f"{name}.csv") for name in ("readings", "rest", "check"))


@cache
def demo() -> rsicalib.Trace:
    """The demo, traced once."""
    return rsicalib.demo()


class Terminal(io.StringIO):
    def isatty(self) -> bool:
        return True


# ------------------------------------------------------------------ the story


def test_the_story_is_told_in_25_lines_with_the_misclosure_in_it() -> None:
    whole = rsicalib.load_readings(READINGS)
    found = [
        demo(),
        rsicalib.calibrate(READINGS, rest=REST, check=CHECK, align=True),
        rsicalib.calibrate(READINGS),
        rsicalib.trace(whole.select(whole.sample == 1)),
        rsicalib.trace(whole.select((whole.pose < 25) & (whole.sample < 4)), rest=REST),
    ]
    for result in found:
        lines = result.summary().splitlines()
        assert len(lines) <= 25 and max(map(len, lines)) <= 100
        (line,) = (text for text in lines if "misclosure, rms [in]" in text)
        assert lines[-1][-1] in ".:)"  # what to do next is no half of a sentence
        rms = result.quality.rms_misclosure
        assert rms is not None
        assert float(line.split()[-1]) == pytest.approx(rms, rel=0.005)  # three digits


def test_what_to_do_next_says_where_the_result_stands(tmp_path: Path) -> None:
    def use(summary: str) -> str:
        return next(line for line in summary.splitlines() if line.startswith("→ Use it"))

    found = demo()
    assert use(found.summary()) == "→ Use it: rsicalib.forward(readings, calibration=found)"
    command = "rsicalib forward READINGS --calibration"
    assert (
        use(summary_of(found, None)) == f"→ Use it: add --out DIR, then {command} DIR/result.json"
    )
    assert use(summary_of(found, Path("re port"))) == f'→ Use it: {command} "re port/result.json"'
    path = tmp_path / "r.json"
    found.save(path)
    assert f"{command} {path}" in rsicalib.load_calibration(path).summary(width=1000)


@pytest.mark.parametrize("width", [60, 80, 97, 140])
def test_text_follows_the_width_of_the_terminal_without_a_broken_word(width: int) -> None:
    found = demo()
    wide = set(re.split(r"\s+", found.summary(whole=True)))
    for text in (found.summary(width=width), found.summary(width=width, whole=True)):
        # As wide as it can be, less the longest word.
        room = max(map(len, found.summary(width=1000).splitlines()))
        assert min(room, width - 16) <= max(map(len, text.splitlines())) <= width
        words = {word for word in text.split() if not word.isdigit()}
        assert words <= wide | set("… and more lines in the report".split())


@pytest.mark.parametrize("width", [60, 80])
def test_a_narrow_terminal_is_told_what_a_wide_one_is(width: int) -> None:
    """Rows of check poses were "5 more lines in the report", sentences ended within."""
    whole = rsicalib.load_readings(READINGS)
    some = whole.select((whole.pose < 25) & (whole.sample < 4))
    for found in (demo(), rsicalib.trace(some, rest=REST)):
        told = found.summary(width=width)
        assert {*found.summary(width=100).split()} <= {*told.split()}
        assert not re.search(r"\bp [=<]?$|χ²$|±$", told, flags=re.M)


@pytest.mark.parametrize("width", [50, 60, 80])
def test_every_row_of_a_narrow_table_has_its_numbers_beside_its_name(width: int) -> None:
    found = rsicalib.calibrate(READINGS, rest=REST, check=CHECK)
    lines = found.summary(width=width, whole=True).splitlines()
    for words in ("χ² / degrees", "misclosure", "position, 20", "orientation, 20", "held-out"):
        (row,) = (line for line in lines if line.startswith(f"  {words}"))
        assert re.search(r"\d$", row), row
    assert max(map(len, lines)) <= width


def test_what_is_written_whole_has_every_parameter_and_every_row() -> None:
    found = rsicalib.calibrate(READINGS, rest=REST, check=CHECK, align=True)
    text = found.summary(whole=True)
    for name in ("a11", "a33", "held-out χ²", "20 check poses, aligned"):
        assert name in text
    assert not re.search(r"\d+ more", text)


def test_the_command_prints_no_more_with_the_path_of_its_report(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    from rsicalib.cli import main

    monkeypatch.setattr("sys.stdout.isatty", lambda: True)
    monkeypatch.setenv("NO_COLOR", "1")
    with pytest.raises(SystemExit) as done:
        main(["demo", "--out", str(tmp_path / "demo")])
    said, warned = capsys.readouterr()
    assert (done.value.code, warned) == (0, "")
    lines = said.splitlines()
    # A terminal that does not tell has 80 columns; the story is 25 lines of 100.
    assert len(lines) <= 25 * 100 / 80 and lines[-1] == str(tmp_path / "demo" / "report.html")


def test_a_pipe_is_never_cut(capsys: pytest.CaptureFixture[str]) -> None:
    from rsicalib.cli import main

    with pytest.raises(SystemExit):
        main(["demo"])
    said = capsys.readouterr().out
    assert not re.search(r"\d+ more|…", said)
    result = demo()
    for p in result.parameters:
        assert p.target in said and p.name in said
    assert "check poses [in]" in said and "held-out" in said


def on_a_terminal(columns: int, *words: str) -> str:
    """What a command shows on a terminal of so many columns."""
    pty = pytest.importorskip("pty", reason="no terminals here")
    import fcntl
    import struct
    import termios

    ours, theirs = pty.openpty()
    fcntl.ioctl(theirs, termios.TIOCSWINSZ, struct.pack("HHHH", 40, columns, 0, 0))
    command = [sys.executable, "-m", "rsicalib", *words]
    with subprocess.Popen(
        command, stdin=theirs, stdout=theirs, stderr=theirs, env={**os.environ, "NO_COLOR": "1"}
    ):
        os.close(theirs)
        shown = b""
        with contextlib.suppress(OSError):  # the end of a terminal is an error of Linux
            while part := os.read(ours, 65536):
                shown += part
    os.close(ours)
    return shown.decode()


@pytest.mark.parametrize(
    "words",
    [
        ("terms", "curvature"),
        ("calibrate", "nowhere.csv", "--terms", "x" * 9),
        *sized([], [("terms",)]),
    ],
)
def test_no_verb_is_wider_than_its_terminal_or_breaks_a_word(words: tuple[str, ...]) -> None:
    wide = on_a_terminal(500, *words)
    shown = on_a_terminal(60, *words)
    lines = [line.rsplit("\r", 1)[-1] for line in shown.replace("\r\n", "\n").split("\n")]
    assert max(map(len, lines)) <= 60 < max(map(len, wide.splitlines()))
    assert shown.split() == wide.split()


def test_comments_of_a_mechanism_follow_the_terminal_and_its_values_do_not() -> None:
    wide = on_a_terminal(500, "mechanism").splitlines()
    shown = on_a_terminal(60, "mechanism").splitlines()
    values = [line for line in shown if not line.startswith("#")]
    assert values == [line for line in wide if not line.startswith("#")]
    comments = [line for line in shown if line.startswith("#")]
    assert max(map(len, comments)) <= 60 < max(map(len, wide))


def test_words_that_are_folded_go_on_below_where_they_began() -> None:
    assert folded("  may hide  link length of each/4 up to 2 in", 30) == (
        "  may hide  link length of\n            each/4 up to 2 in"
    )
    assert folded("- one of a list that is long", 20) == "- one of a list that\n  is long"
    assert folded("# 7 cannot be known at all", 18) == "# 7 cannot be\n# known at all"
    assert folded("a-path/that-no-line-holds", 8) == "a-path/that-no-line-holds"


# ------------------------------------------------------------------ progress


def told(pace: list[tuple[float, float]]) -> list[str]:
    """Lines that a terminal shows, from seconds and shares."""
    stream = Terminal()
    clock = iter([0.0, *(seconds for seconds, _ in pace)])
    with ProgressLine(stream, clock=lambda: next(clock)) as line:
        for _, share in pace:
            line("search", share)
    return [text.rstrip() for text in stream.getvalue().split("\r")]


def test_the_time_that_is_left_is_that_of_the_pace_so_far() -> None:
    assert told([(20.0, 0.25)])[1] == "search: 25 %, 20 s, about 1:00 min left"
    assert told([(30.0, 0.75)])[1] == "search: 75 %, 30 s, about 10 s left"
    assert told([(30.0, 0.0)])[1] == "search: 30 s"  # nobody knows yet


def test_time_passes_on_the_screen_where_a_stage_tells_nothing() -> None:
    stream = Terminal()
    clock = iter([0.0, 4.0, 4.5, 8.0])
    line = ProgressLine(stream, "choose poses", lambda: next(clock))
    for _ in range(3):
        line.tick()
    assert re.findall(r"[^\r]+", stream.getvalue()) == ["choose poses: 4 s", "choose poses: 8 s"]


def test_what_is_quick_needs_no_progress_and_no_line_is_left_behind() -> None:
    assert told([(0.2, 0.1), (0.9, 0.9)]) == [""]
    shown = told([(2.0, 0.5), (2.05, 0.6), (3.0, 0.7)])
    assert len([text for text in shown if text]) == 2  # the second came too soon after the first
    assert shown[-2:] == ["", ""]  # spaces over it, then the start of the line


def test_progress_is_for_a_terminal_that_somebody_looks_at(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("TERM", "xterm")
    monkeypatch.setattr(sys, "stderr", Terminal())
    assert progress_of(Namespace(quiet=False)) is not None
    assert progress_of(Namespace(quiet=True)) is None
    monkeypatch.setenv("TERM", "dumb")
    assert progress_of(Namespace(quiet=False)) is None
    monkeypatch.setattr(sys, "stderr", io.StringIO())
    monkeypatch.setenv("TERM", "xterm")
    assert progress_of(Namespace(quiet=False)) is None


def test_a_long_trace_shows_its_progress_on_a_terminal(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    from rsicalib.cli import main

    stream = Terminal()
    monkeypatch.setenv("TERM", "xterm")
    monkeypatch.setattr(progress, "PATIENCE", 0.0)
    monkeypatch.setattr(progress, "PAUSE", 0.0)
    monkeypatch.setattr(sys, "stderr", stream)
    with pytest.raises(SystemExit) as done:
        main(["trace", READINGS, "--rest", REST])
    assert done.value.code == 0
    assert re.search(r"search for missing effects: \d+ %, ", stream.getvalue())
    assert stream.getvalue().endswith("\r")
    assert "\r" not in capsys.readouterr().out


def test_a_watch_of_a_file_says_how_many_rows_it_has_read_and_leaves_no_line(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str], tmp_path: Path
) -> None:
    from rsicalib.cli import main

    demo().save(tmp_path / "result.json")
    stream = Terminal()
    monkeypatch.setenv("TERM", "xterm")
    monkeypatch.setattr(progress, "PATIENCE", 0.0)
    monkeypatch.setattr(progress, "PAUSE", 0.0)
    monkeypatch.setattr(sys, "stderr", stream)
    with pytest.raises(SystemExit) as done:
        main(["watch", CHECK, "--calibration", str(tmp_path / "result.json")])
    assert done.value.code == 0
    shown, _, summary = stream.getvalue().rpartition("\r")
    assert "160 rows: " in shown
    assert summary.startswith("160 of 160 rows tested")
    assert capsys.readouterr().out == ""


# ------------------------------------------------------------------ colours


def test_colours_are_for_terminals_and_for_those_who_want_them(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    for name in ("NO_COLOR", "FORCE_COLOR"):
        monkeypatch.delenv(name, raising=False)
    monkeypatch.setenv("TERM", "xterm")
    assert not colours.wants_colour(io.StringIO())
    if os.name != "nt":
        assert colours.wants_colour(Terminal())
    monkeypatch.setenv("FORCE_COLOR", "1")
    assert colours.wants_colour(io.StringIO())
    monkeypatch.setenv("NO_COLOR", "1")
    assert not colours.wants_colour(Terminal())


def test_a_coloured_summary_is_the_same_text() -> None:
    text = demo().summary()
    painted = colours.painted(text, True)
    assert painted != text
    assert re.sub(r"\x1b\[\d+m", "", painted) == text
    assert painted.startswith("\x1b[1m\x1b[32mExplained\x1b[0m:")
    assert colours.painted(text, False).startswith("\x1b[1m\x1b[31m")


def test_a_pipe_has_no_colours() -> None:
    command = [sys.executable, "-m", "rsicalib", "calibrate", READINGS, "--rest", REST]
    done = subprocess.run(command, capture_output=True, timeout=300)
    assert b"\x1b" not in done.stdout + done.stderr
    assert b"\r" not in done.stderr.replace(b"\r\n", b"\n")


# ------------------------------------------------------------------ completion


def completed(words: str) -> list[str]:
    """What bash offers at the end of a line."""
    text = completion.script(make_parser(), "bash")
    line = [*words.split(), *([""] if words.endswith(" ") else [])]
    quoted = " ".join(f"'{word}'" for word in line)
    ask = f"COMP_WORDS=({quoted}); COMP_CWORD={len(line) - 1}; _rsicalib; printf '%s\\n' "
    shell = ["bash", "--norc", "-c", f'{text}\n{ask}"${{COMPREPLY[@]}}"']
    done = subprocess.run(shell, capture_output=True, text=True, check=True, timeout=60)
    assert done.stderr == ""
    return done.stdout.split()


@pytest.mark.skipif(shutil.which("bash") is None, reason="no bash")
def test_bash_completes_verbs_options_and_values() -> None:
    assert completed("rsicalib tr") == ["trace"]
    assert {"calibrate", "forward", "paper"} <= set(completed("rsicalib "))
    assert set(completed("rsicalib trace --w")) == {"--without"}
    assert completed("rsicalib calibrate r.csv --method ") == ["implicit_loop", "algebraic"]
    assert completed("rsicalib completion ") == ["bash", "zsh", "fish"]
    assert completed("rsicalib calibrate ") == []  # files, by the shell itself


@pytest.mark.parametrize("shell", ["bash", "zsh", "fish"])
def test_a_shell_reads_its_script(shell: str, tmp_path: Path) -> None:
    file = tmp_path / f"rsicalib.{shell}"
    file.write_text(completion.script(make_parser(), shell), encoding="utf-8")
    if shutil.which(shell) is None:
        pytest.skip(f"no {shell} to read it")
    done = subprocess.run([shell, "-n", str(file)], capture_output=True, timeout=60)
    assert (done.returncode, done.stderr) == (0, b"")


@pytest.mark.skipif(shutil.which("fish") is None, reason="no fish")
def test_fish_completes_verbs_options_values_and_files(tmp_path: Path) -> None:
    (tmp_path / "c.fish").write_text(completion.script(make_parser(), "fish"), encoding="utf-8")
    (tmp_path / "readings.csv").touch()
    expected = {
        "rsicalib tr": "trace",
        "rsicalib trace --wi": "--without",
        "rsicalib calibrate r.csv --method ": "algebraic implicit_loop",
        "rsicalib completion ": "bash fish zsh",
        "rsicalib calibrate re": "readings.csv",
        "rsicalib trace --rest re": "readings.csv",
    }
    ask = "source c.fish; " + "; echo; ".join(f"complete -C '{line}'" for line in expected)
    fish = ["fish", "--no-config", "-c", ask]
    done = subprocess.run(fish, cwd=tmp_path, capture_output=True, text=True, timeout=60)
    found = [" ".join(re.findall(r"^(\S+)", part, re.M)) for part in done.stdout.split("\n\n")]
    assert (found, done.stderr) == (list(expected.values()), "")


@pytest.mark.skipif(shutil.which("zsh") is None, reason="no zsh")
def test_zsh_offers_what_bash_does_also_where_nothing_has_set_completion_up(tmp_path: Path) -> None:
    (tmp_path / "c.zsh").write_text(completion.script(make_parser(), "zsh"), encoding="utf-8")
    for line, expected in {"tr": "trace", "trace r.csv --wi": "--without"}.items():
        words = f"COMP_WORDS=(rsicalib {line}); COMP_CWORD={len(line.split())}"
        ask = f"source c.zsh; {words}; emulate sh -c _rsicalib; print -rl -- $COMPREPLY"
        zsh = ["zsh", "-f", "-c", ask]
        home = {**os.environ, "HOME": str(tmp_path), "ZDOTDIR": str(tmp_path)}
        done = subprocess.run(
            zsh, cwd=tmp_path, env=home, capture_output=True, text=True, timeout=60
        )
        # The editor of zsh keeps those that begin with what is there.
        assert expected in done.stdout.split() and done.stderr == ""


def test_a_table_that_is_too_wide_is_narrowed_and_not_torn() -> None:
    rows = [
        "parameter                          last     ± 95 %     per year     ± 95 %",
        "offset@a11                       3.6058     0.0036          1.2        4.1",
        "gain@a13                     -0.0014604  0.0000019     -0.00001    0.00067",
    ]
    text = "\n".join(["arm 7: 3 results", "", *rows, "", "drifts beyond chance: none"])
    assert folded(text, 80) == text
    narrow = folded(text, 60).split("\n")
    assert len(narrow) == len(text.split("\n")) and max(map(len, narrow)) <= 60
    for row, told in zip(rows, narrow[2:5], strict=True):
        assert re.split(r" {2,}", told) == re.split(r" {2,}", row)
    # Ends of columns stay one below the other.
    assert len({len(row) for row in narrow[2:5]}) == 1


def test_no_line_ends_beside_a_plus_minus() -> None:
    text = "a12 has changed since 0 s: offset by 0.0324 ± 0.002 rad, the platform by 0.029"
    for width in range(30, 80):
        assert not any(
            line.endswith("±") or line.strip().startswith("±")
            for line in folded(text, width).split("\n")
        )


# ------------------------------------------------------------------ commands that it prints

BAR = """
name = "bar"
length_unit = "m"
channel = [{name = "q", unit = "rad", gain = 1.0, offset = 0.0, noise = 1e-4}]
chain = [{name = "bar", dh = [{channel = "q", a = 1.0}]}]
point = [
  {name = "tip", chain = "bar", at = [0.0, 0.0, 0.0]},
  {name = "post", at = [-0.5, 0.0, 0.0]},
]
closure = [{name = "rule", kind = "distance", between = ["tip", "post"], value = "ruled"}]

[model]
terms = ["offset"]
"""


def test_the_command_that_a_result_advises_works_as_it_is_printed(tmp_path: Path) -> None:
    (tmp_path / "FILE").write_text(BAR)
    angles = np.linspace(0.2, 1.8, 20)
    ruled = np.hypot(np.cos(angles) + 0.5, np.sin(angles))
    noise = 1e-4 * np.random.default_rng(0).standard_normal(20)
    rows = [f"{q + e - 0.01:.6f},{r:.6f}" for q, e, r in zip(angles, noise, ruled, strict=True)]
    (tmp_path / "READINGS").write_text("\n".join(["q,ruled", *rows, ""]))
    said = run_text("calibrate", "READINGS", "--mechanism", "FILE", "--out", ".", cwd=tmp_path)
    assert said.returncode == 0, said.stderr
    printed = re.search(r"rsicalib (forward(?:.|\n)*?result\.json)", said.stdout)
    assert printed is not None
    assert run_text(*printed[1].split(), cwd=tmp_path).returncode == 0


def test_all_labels_of_a_summary_are_faint() -> None:
    for label in LABELS:
        shown = colours.painted(f"Explained: it was.\n\n  {label:10}words", good=True)
        assert f"  {colours.FAINT}{label}{colours.PLAIN} " in shown


def test_one_of_something_is_one() -> None:
    whole = rsicalib.load_readings(READINGS)
    one = whole.select((whole.pose == 1) & (whole.sample == 1))
    assert repr(one) == f"<Readings {READINGS!r}: 1 sample of 1 pose, 9 channels>"


def test_a_p_value_is_never_zero() -> None:
    found = demo()
    fit = dataclasses.replace(found.after, p_value=0.0)
    assert repr(dataclasses.replace(found, after=fit)).endswith("48 poses, p < 1e-99>")
    assert "p < 1e-99" in repr(dataclasses.replace(found.steps[0], p_value=0.0))
