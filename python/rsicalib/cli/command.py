"""Running the command: parse, run the verb, turn errors into exit codes."""

from __future__ import annotations

import contextlib
import os
import sys
import traceback
from collections.abc import Callable, Sequence
from typing import Any, NoReturn

from rsicalib.cli.interruption import deaf_to_signals, ends_by_signals, exit_code
from rsicalib.cli.output import heard
from rsicalib.cli.parser import make_parser
from rsicalib.cli.streams import emit, is_of_streams, open_streams, say, silence
from rsicalib.cli.verbs import Args
from rsicalib.errors import InputError, UndeterminedError
from rsicalib.facts.records import to_json
from rsicalib.io.files import without_parts

NOT_TO_BE_RELIED_ON = 4
"""Exit code of a verb that has gone on with a result that was edited, or whose loops are open."""


def main(argv: Sequence[str] | None = None) -> NoReturn:
    """Run the command and leave.

    Parameters
    ----------
    argv : sequence of str, optional
        Arguments; those of the process where not given.
    """
    words = sys.argv[1:] if argv is None else list(argv)
    open_streams()
    code = 0
    try:
        with ends_by_signals():
            code = _run(words)
            sys.stdout.flush()
    except BrokenPipeError:
        silence(sys.stdout)  # whoever read has seen enough
    except OSError as error:
        silence(sys.stdout)
        code = 2
        with contextlib.suppress(OSError):
            print(f"error: standard output: {error.strerror}", file=sys.stderr, flush=True)
    except KeyboardInterrupt as error:
        deaf_to_signals()
        with without_parts():
            with contextlib.suppress(OSError):
                print("interrupted", file=sys.stderr, flush=True)
            os._exit(exit_code(error))  # a job may still be computing: nobody waits for it
    sys.exit(code)


def _run(words: list[str]) -> int:
    as_json = "--json" in words
    try:
        args = make_parser().parse_args(words)
        run: Callable[[Args], int] = args.run
        with heard(args) as told:
            code = run(args)
        return NOT_TO_BE_RELIED_ON if told and code == 0 else code
    except InputError as error:
        return _fail(2, "rsicalib.error/1", error.message, as_json, where=error.where)
    except UndeterminedError as error:
        return _fail(3, "rsicalib.error/1", error.message, as_json, where=None)
    except SystemExit as leave:  # after --help and --version
        return leave.code if isinstance(leave.code, int) else 0
    except (KeyboardInterrupt, BrokenPipeError):
        raise
    except BaseException as error:  # a panic of the core is no Exception
        if isinstance(error, OSError) and is_of_streams(error):
            raise
        traceback.print_exc()
        print(
            "This is a defect of rsicalib; please report it with the lines above.", file=sys.stderr
        )
        return 1


def _fail(code: int, form: str, message: str, as_json: bool, **more: Any) -> int:
    if as_json:
        emit(to_json({"format": form, "message": message, **more}))
    else:
        say(f"error: {message}", sys.stderr)
    return code
