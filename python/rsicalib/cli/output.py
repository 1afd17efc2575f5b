"""Output of the command: results on standard output, the rest on standard error, files."""

from __future__ import annotations

import argparse
import contextlib
import sys
import warnings
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

from rsicalib.cli.colours import painted, wants_colour
from rsicalib.cli.interruption import interruptible
from rsicalib.cli.progress import progress_of
from rsicalib.cli.streams import columns_of, emit, say
from rsicalib.errors import OpenLoopsWarning
from rsicalib.facts.warned import Warned
from rsicalib.io.folders import MARK, OF_LOG, refuse_foreign, write_folder
from rsicalib.plain_text import printable

if TYPE_CHECKING:
    from rsicalib.report.words import Kept
    from rsicalib.results.result import Calibration, Result, Trace


def show(args: argparse.Namespace, result: Calibration | Trace) -> int:
    """Write what was asked for; the exit code."""
    warn(args, result.warnings)
    if args.out is not None:
        with progress_of(args, "write the report") or contextlib.nullcontext() as line:
            files = interruptible(lambda: _files(args, result), line.tick if line else None)
            write_folder(args.out, files, seal=RESULT, force=args.force)
    if args.json:
        emit(result.to_json())
    elif not args.quiet:
        columns = columns_of(sys.stdout)
        # Whoever reads a pipe or a file has no report beside it: nothing is left out there.
        summary = printable(summary_of(result, args.out, columns, whole=columns is None))
        if wants_colour(sys.stdout):
            summary = painted(summary, result.exit_code == 0)
        print(summary)
        if args.out is not None:
            say(f"\n{args.out / 'report.html'}")
    return result.exit_code


def summary_of(
    result: Result, folder: Path | None, width: int | None = None, *, whole: bool = False
) -> str:
    """The summary, with how the result is used by the file that it is written to."""
    from rsicalib.report.terminal import summary

    return summary(result, width=width, whole=whole, kept=_kept(folder))


def _kept(folder: Path | None) -> Kept:
    """Where a result stands; without a folder it is lost with the command."""
    from rsicalib.report.words import Kept

    if folder is None:
        return Kept(f"DIR/{RESULT}", "add --out DIR, then ")
    return Kept(str(folder / RESULT))


RESULT = "result.json"
FILES = (RESULT, "report.txt", "report.html", "calibrated.toml")
"""What stands in the folder of every result."""


def prepare(args: argparse.Namespace, names: Sequence[str] = FILES) -> None:
    """Refuse a folder whose files are not ours, before anything is computed."""
    if args.out is not None:
        refuse_foreign(args.out, names, force=args.force)


def prepare_file(args: argparse.Namespace, *beside: str) -> None:
    """Refuse a file that is not ours, and the names `beside` it, before anything is computed."""
    if args.out is not None:
        refuse_foreign(args.out.parent, [args.out.name, *beside], force=args.force)


def _files(args: argparse.Namespace, result: Result) -> dict[str, str]:
    """What a folder of a result holds, by name."""
    from rsicalib.report.page import html
    from rsicalib.verbs.export import calibrated_files

    target = getattr(args, "target", None)
    page = html(result, result.evidence, target, _kept(args.out))
    files = {
        RESULT: result.to_json(),
        "report.txt": f"{summary_of(result, args.out, whole=True)}\n\n{MARK} {result.version}\n",
        "report.html": f"{page}<!-- {MARK} {result.version} -->\n",
        **calibrated_files(getattr(args, "mechanism", "rsi"), result),
    }
    brought = getattr(args, "brought", None)
    if brought is not None:
        files[OF_LOG] = f"# {MARK} {result.version}\n{brought}"
    drawn = result.figures(target=target).items()
    return files | {f"figures/{name}.svg": f"{text}<!-- {MARK} -->\n" for name, text in drawn}


def warn(args: argparse.Namespace, found: Sequence[Warned | str]) -> None:
    """Print warnings on standard error, unless --quiet; none of them twice."""
    said: set[str] = vars(args).setdefault("said", set())
    for text in map(str, found):
        if not getattr(args, "quiet", False) and text not in said:
            say(f"warning: {text}", sys.stderr)
        said.add(text)


@contextlib.contextmanager
def heard(args: argparse.Namespace) -> Iterator[list[str]]:
    """Print what is warned of results while a verb runs; all of it, in order."""
    told: list[str] = []

    def show_warning(
        message: Warning | str, category: type[Warning], *where: Any, **more: Any
    ) -> None:
        if not issubclass(category, OpenLoopsWarning):
            return usual(message, category, *where, **more)
        told.append(str(message))
        warn(args, told[-1:])

    with warnings.catch_warnings():
        warnings.simplefilter("always", OpenLoopsWarning)
        usual = warnings.showwarning
        warnings.showwarning = show_warning
        yield told
