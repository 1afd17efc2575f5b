"""The parser of the command."""

from __future__ import annotations

import argparse
import sys
from typing import Any, NoReturn

from rsicalib import _core
from rsicalib.cli.arguments import ARGUMENTS, Verb
from rsicalib.cli.exits import EXITS
from rsicalib.errors import InputError
from rsicalib.plain_text import meant, quoted


class _Parser(argparse.ArgumentParser):
    def error(self, message: str) -> NoReturn:
        raise InputError(f"{message}. See `{self.prog} --help`.")

    def _check_value(self, action: argparse.Action, value: Any) -> None:
        """Refuse what is no choice, with the one that may have been meant."""
        if action.choices is not None and value not in action.choices:
            known = [str(choice) for choice in action.choices]
            found = f"found {quoted(value)}{meant(str(value), known)}"
            raise argparse.ArgumentError(action, f"{found}, expected one of {', '.join(known)}")

    def parse_args(self, args: Any = None, namespace: Any = None) -> Any:
        """Parse all words; one that is no option is refused with the one that may be meant."""
        words = [str(word) for word in (sys.argv[1:] if args is None else args)]
        try:
            found, rest = self.parse_known_args(words, namespace)
        except InputError:
            # What is missing may stand behind a misspelt option.
            verb = words[0] if words else ""
            options = (word.split("=", 1)[0] for word in words[1:] if word.startswith("--"))
            known = self._options(verb)
            for word in options if known else ():
                if word not in known:
                    self._refuse(verb, word)
            raise
        if rest:
            self._refuse(found.verb, rest[0].split("=", 1)[0])
        return found

    def _verbs(self) -> dict[str, argparse.ArgumentParser]:
        actions = (a for a in self._actions if isinstance(a, argparse._SubParsersAction))
        return dict(next(actions).choices)

    def _options(self, verb: str) -> list[str]:
        """Return the options of a verb; none of what is no verb."""
        of = self._verbs().get(verb)
        return [] if of is None else [o for action in of._actions for o in action.option_strings]

    def _refuse(self, verb: str, word: str) -> NoReturn:
        """Refuse a word that is no option of a verb, with the one that may be meant."""
        known = self._options(verb)
        if word in known:  # of this parser it is none
            found = f"found {quoted(word)} before {verb}, expected it behind"
            raise InputError(f"{found}: {self.prog} {verb} … {word}")
        hint = meant(word, known)
        message = f"found {quoted(word)}{hint}, expected an option of {verb}"
        raise InputError(f"{message}. See `{self.prog} {verb} --help`.")

    def _print_message(self, message: str, file: Any = None) -> None:
        """Print help; argparse's own would hide that standard output is full."""
        (file or sys.stderr).write(message)


def make_parser() -> argparse.ArgumentParser:
    """Make the parser; a parsed verb stands in `run`."""
    parser = _Parser(
        prog="rsicalib",
        allow_abbrev=False,  # an abbreviation would break with the next option
        description="Calibration of closed kinematic chains from their own joint readings. "
        "Begin with: rsicalib demo",
        epilog=f"exit codes: {'. '.join(f'{code} {words}' for code, words in EXITS.items())}",
    )
    parser.add_argument("--version", action="version", version=f"rsicalib {_core.__version__}")
    subparsers = parser.add_subparsers(dest="verb", metavar="VERB", required=True)
    for run, add in ARGUMENTS.items():
        words = (run.__doc__ or "").strip().splitlines()[0]
        name = run.__name__.rstrip("_")  # `import` is a word of Python
        sub = subparsers.add_parser(name, help=words, description=words, allow_abbrev=False)
        sub.set_defaults(run=run)
        verb = Verb(sub)
        verb.takes("--json", "the result on standard output, and nothing else there")
        verb.takes("--quiet", "no summary, progress or warnings")
        add(verb)
    subparsers.choices["completion"].set_defaults(parser=parser)
    return parser
