"""Write `docs/commands.md` from the parser: `python -m scripts.make_commands`; a test compares."""

from __future__ import annotations

import argparse
from collections import Counter
from collections.abc import Iterable
from pathlib import Path

from rsicalib import _core
from rsicalib.cli.completion import verbs_of
from rsicalib.cli.exits import EXITS
from rsicalib.cli.parser import make_parser
from rsicalib.io.files import write_text
from rsicalib.results.certificate import EXIT_CODES

PAGE = Path(__file__).parents[1] / "docs" / "commands.md"

HEAD = """\
# Commands

Written by `python -m scripts.make_commands` from the parser; a test compares. Results go to
standard output, progress and warnings to standard error. Progress and colours are for terminals:
none in a pipe, with `--quiet` or with `NO_COLOR` set. Completion for bash (zsh alike) and for fish:

```console
$ source <(rsicalib completion bash)
$ rsicalib completion fish | source
```

## Exit codes

| exit | meaning |
|---|---|
"""


def text() -> str:
    """The whole page."""
    known = {code for _, code in _core.VERDICTS} | {*EXIT_CODES.values()}
    assert known <= set(EXITS), known
    parts = [HEAD, *(f"| {code} | {words} |\n" for code, words in EXITS.items()), "\n"]
    parts.append(
        "Which verdict has which: [the verdicts](report.md#the-verdict); of a certificate: "
        "[the decisions](certificate.md). With `--json`, 2 prints a document "
        "`rsicalib.error/1`.\n\n"
    )
    verbs = verbs_of(make_parser())
    said = Counter(row for parser, _ in verbs.values() for row in map(_row, _options(parser)))
    # Of two meanings of an option the one of more commands; `most_common` keeps their order.
    often = {name: words for (name, words), count in reversed(said.most_common()) if count > 1}
    shared = [row for row in said if often.get(row[0]) == row[1]]
    parts += ["## Options of several commands\n\n", _table(shared)]
    for name, (parser, words) in verbs.items():
        parts.append(f"## {name}\n\n{words}\n\n")
        parts.append(f"```text\n{_usage(parser)}```\n\n")
        rows = [_row(a) for a in _options(parser)]
        parts.append(_table([*map(_row, _places(parser)), *(r for r in rows if r not in shared)]))
        names = [
            f"`{option.split(',')[0].split()[0]}`" for option, _ in (r for r in rows if r in shared)
        ]
        if names:
            parts.append(f"[Shared](#options-of-several-commands): {', '.join(names)}.\n\n")
    return "".join(parts).replace("<(", "<(").rstrip() + "\n"


def _options(parser: argparse.ArgumentParser) -> list[argparse.Action]:
    actions = [a for a in parser._actions if not isinstance(a, argparse._HelpAction)]
    return [action for action in actions if action.option_strings]


def _places(parser: argparse.ArgumentParser) -> list[argparse.Action]:
    """Arguments that are told by their place."""
    return [action for action in parser._actions if not action.option_strings]


def _row(action: argparse.Action) -> tuple[str, str]:
    return _named(action), action.help or ""


def _table(rows: Iterable[tuple[str, str]]) -> str:
    lines = [f"| `{name}` | {words} |\n" for name, words in rows]
    return "".join(["| argument | |\n|---|---|\n", *lines, "\n"]) if lines else ""


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
