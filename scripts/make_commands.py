"""Write `docs/commands.md` from the parser: `python -m scripts.make_commands`; a test compares."""

from __future__ import annotations

import argparse
from pathlib import Path

from rsicalib import _core
from rsicalib.cli.completion import verbs_of
from rsicalib.cli.parser import make_parser
from rsicalib.io.files import write_text

PAGE = Path(__file__).parents[1] / "docs" / "commands.md"

HEAD = """\
# Commands

Written by `python -m scripts.make_commands` from the parser; a test compares. Results go to
standard output, progress and warnings to standard error. On a terminal, what takes more than a
second shows its progress with the time that is left, and the verdict has a colour; neither is
there in a pipe, with `--quiet` or with `NO_COLOR` set.

Completion in your shell, for bash (zsh and fish alike):

```console
$ source <(rsicalib completion bash)
```

## Exit codes

| exit | meaning |
|---|---|
"""

CODES = {
    0: "a usable calibration: adequate, or explained after tracing; or unjudged",
    1: "a defect of rsicalib",
    2: "the input or the options cannot be used; with `--json`, a document `rsicalib.error/1`",
    3: "the data cannot determine what was asked",
    4: "a calibration was found, but the residual is significant, or it is implausible",
    130: "interrupted; no half-written file is left",
}


def text() -> str:
    """The whole page."""
    known = {code for _, code in _core.VERDICTS}
    assert known <= set(CODES), known
    parts = [HEAD, *(f"| {code} | {words} |\n" for code, words in CODES.items()), "\n"]
    for name, (parser, words) in verbs_of(make_parser()).items():
        parts.append(f"## {name}\n\n{words}\n\n")
        arguments = [a for a in parser._actions if not isinstance(a, argparse._HelpAction)]
        parts.append(f"```text\n{_usage(parser)}```\n\n")
        parts.append("| argument | |\n|---|---|\n")
        parts += [f"| `{_named(a)}` | {a.help or ''} |\n" for a in arguments]
        parts.append("\n")
    return "".join(parts).replace("<(", "<(").rstrip() + "\n"


def _usage(parser: argparse.ArgumentParser) -> str:
    """How the verb is called, optional arguments together."""
    words = [parser.prog, "[OPTIONS]"]
    for action in parser._actions:
        if not action.option_strings:
            name = str(action.metavar or "|".join(map(str, action.choices or [action.dest])))
            optional = f"[{name}]" if action.nargs == "?" else name
            words.append(f"{optional} …" if action.nargs == "+" else optional)
    return " ".join(words) + "\n"


def _named(action: argparse.Action) -> str:
    """An option with what it takes, or an argument."""
    takes = action.metavar or ("|".join(map(str, action.choices)) if action.choices else None)
    if takes is None and action.nargs != 0 and action.option_strings:
        takes = action.dest.upper()
    names = ", ".join(action.option_strings)
    if not names:
        return str(action.metavar or action.dest).replace("|", "\\|")
    return (names if action.nargs == 0 else f"{names} {takes}").replace("|", "\\|")


if __name__ == "__main__":
    write_text(PAGE, text())
