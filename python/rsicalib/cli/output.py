"""Output of the command: results on standard output, the rest on standard error, files."""

from __future__ import annotations

import argparse
import sys
from collections.abc import Mapping, Sequence
from pathlib import Path

from rsicalib.cli.colours import painted, wants_colour
from rsicalib.errors import InputError
from rsicalib.io.files import write_text
from rsicalib.results import Calibration, Result, Trace

__all__ = ["show", "warn", "write_files"]


def show(args: argparse.Namespace, result: Calibration | Trace) -> int:
    """Write what was asked for; the exit code."""
    warn(args, result.warnings)
    if args.out is not None:
        _write(args.out, result, getattr(args, "mechanism", "rsi"))
    if args.json:
        sys.stdout.write(result.to_json())
    elif not args.quiet:
        summary = result.summary()
        if wants_colour(sys.stdout):
            summary = painted(summary, result.exit_code == 0)
        print(summary)
        if args.out is not None:
            print(f"\n{args.out / 'report.html'}")
    return result.exit_code


def _write(folder: Path, result: Result, mechanism: str) -> None:
    from rsicalib.export import calibrated_files

    files = {
        "result.json": result.to_json(),
        "report.txt": result.summary() + "\n",
        "report.html": result.report(),
    }
    write_files(folder, files)
    write_files(folder / "figures", {f"{k}.svg": text for k, text in result.figures().items()})
    for path, text in calibrated_files(folder, mechanism, result):
        write_text(path, text)


def write_files(folder: Path, files: Mapping[str, str]) -> None:
    """Write files into a folder, which is made if it is not there."""
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        found = f"'{folder}', which cannot be made ({error.strerror})"
        raise InputError(f"--out: found {found}, expected a folder") from None
    for name, text in files.items():
        write_text(folder / name, text)


def warn(args: argparse.Namespace, warnings: Sequence[str]) -> None:
    """Print warnings on standard error, unless --quiet."""
    if not args.quiet:
        for warning in warnings:
            print(f"warning: {warning}", file=sys.stderr)
