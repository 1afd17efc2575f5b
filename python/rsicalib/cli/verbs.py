"""The command `rsicalib`: one verb per job.

Results go to standard output, progress and warnings to standard error. What a
verb returns is what it exits with:

    0    a usable calibration: adequate, or explained after tracing
    1    a defect of ours
    2    the input or the options cannot be used
    3    the data cannot determine what was asked
    4    a calibration was found, but the residual is significant
    130  interrupted
"""

from __future__ import annotations

import argparse
import contextlib
import os
import sys
import threading
import traceback
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any, NoReturn, TypeVar

import numpy as np

from rsicalib import _core, api
from rsicalib.errors import InputError, UndeterminedError
from rsicalib.export import calibrated_files
from rsicalib.identifiability import COMPLETE, identifiable
from rsicalib.io.files import forget_parts, write_text
from rsicalib.places import places, readings_for
from rsicalib.planning import CRITERIA
from rsicalib.planning import plan as plan_poses
from rsicalib.records import to_json
from rsicalib.reproduction.paper import paper as compute_paper
from rsicalib.results import Calibration, Result, Trace
from rsicalib.simulation import simulate as simulate_device
from rsicalib.work.arguments import earlier_result

__all__ = ["main"]

Args = argparse.Namespace
T = TypeVar("T")


# ------------------------------------------------------------------ verbs


def calibrate(args: Args) -> int:
    """Parameters from joint readings alone: estimates, uncertainty, adequacy."""
    options = {**_session(args), "method": args.method}
    return _show(args, _interruptible(lambda: api.calibrate(args.readings, **options)))


def trace(args: Args) -> int:
    """Close the loop: residual, missing term, error before and after."""
    options = {**_session(args), "without": args.without, "seed": args.seed}
    return _show(args, _interruptible(lambda: api.trace(args.readings, **options)))


def fixture(args: Args) -> int:
    """Open loop, from known poses in the readings."""
    found = api.fixture(
        args.readings,
        args.mechanism,
        check=args.check,
        align=args.align,
        skip_bad_rows=args.skip_bad_rows,
    )
    return _show(args, found)


def demo(args: Args) -> int:
    """The main job on data that come with the package; writes a report, prints its path."""
    if args.out is None:
        args.out = Path("rsicalib-demo")
    return _show(args, _interruptible(api.demo))


def forward(args: Args) -> int:
    """Readings to platform poses under a calibration, CSV on standard output."""
    mechanism = api.load_mechanism(args.mechanism)
    readings = readings_for(args.readings, mechanism, args.skip_bad_rows)
    _warn(args, readings.warnings)
    result = None
    if args.calibration is not None:
        result = earlier_result(args.calibration, mechanism)
    found = places(readings, mechanism, result)
    labels: dict[str, Any] = {"pose": readings.pose.tolist()}
    if readings.sample is not None:
        labels["sample"] = readings.sample.tolist()
    if readings.time_s is not None:
        labels["time_s"] = readings.time_s.tolist()
    names, values = list(found.names), found.values
    if found.sd is not None:
        names += [f"sd_{name}" for name in found.names]
        values = np.hstack([values, found.sd])
    if args.json:
        columns = {**labels, **dict(zip(names, values.T, strict=True))}
        document = {"format": "rsicalib.poses/1", "version": _core.__version__}
        document |= {"mechanism": mechanism.name, "length_unit": mechanism.length_unit}
        sys.stdout.write(to_json({**document, "columns": columns}))
        return 0
    digits = [12] * len(found.names) + [3] * (len(names) - len(found.names))
    lines = [",".join([*labels, *names])]
    for head, row in zip(zip(*labels.values(), strict=True), values.tolist(), strict=True):
        cells = (f"{v:.{d}g}" for v, d in zip(row, digits, strict=True))
        lines.append(",".join([*map(str, head), *cells]))
    sys.stdout.write("\n".join(lines) + "\n")
    return 0


def simulate(args: Args) -> int:
    """A device with a known truth: readings, rest and check poses, truth."""
    made = simulate_device(
        args.out,
        args.mechanism,
        poses=args.poses,
        samples=args.samples,
        noise=args.noise,
        check=args.check_poses,
        seed=args.seed,
    )
    if args.json:
        sys.stdout.write(to_json(made.truth))
    elif not args.quiet:
        print("\n".join(sorted(str(path) for path in args.out.iterdir())))
    return 0


def plan(args: Args) -> int:
    """Which poses to visit."""
    found = plan_poses(
        args.mechanism,
        args.poses,
        beside=args.beside,
        noise=args.noise,
        criterion=args.criterion,
        calibration=args.calibration,
        seed=args.seed,
    )
    if args.out is not None:
        found.save(args.out)
    if args.json:
        head = {"format": "rsicalib.plan/1", "version": _core.__version__}
        sys.stdout.write(to_json({**head, **found.to_dict()}))
    elif not args.quiet:
        sys.stdout.write(found.text())
    return 0


def paper(args: Args) -> int:
    """Every table of the paper computed again, beside the printed one."""
    shown = None if args.quiet or not sys.stderr.isatty() else _progress
    found = compute_paper(args.trials, seed=args.seed, progress=shown, workers=args.workers)
    if args.out is not None:
        _write_files(args.out, {"paper.json": to_json(found.to_dict()), "paper.txt": found.text()})
    if args.json:
        sys.stdout.write(to_json(found.to_dict()))
    elif not args.quiet:
        sys.stdout.write(found.text())
    return 0


def _progress(what: str, done: int, total: int) -> None:
    end = "\n" if done >= total else ""
    print(f"\r\x1b[K{what}: {done} of {total}", end=end, file=sys.stderr, flush=True)


def terms(args: Args) -> int:
    """What can be identified."""
    known = {term["id"]: term for term in api.terms(args.mechanism)}
    if args.id is not None and args.id not in known:
        raise InputError(f"found no term {args.id!r}, expected one of {', '.join(known)}")
    if args.json:
        chosen = list(known.values()) if args.id is None else [known[args.id]]
        document = {"format": "rsicalib.terms/1", "version": _core.__version__, "terms": chosen}
        sys.stdout.write(to_json(document))
    elif args.id is None:
        for term in known.values():
            first = term["doc"].split("\n\n")[0].replace("\n", " ")
            print(f"{term['id']:24} {term['class']:12} {first}")
    else:
        term = known[args.id]
        print(f"{term['id']} ({term['class']})\n\n{term['doc'].strip()}\n")
        for parameter in term["parameters"]:
            line = (
                f"  {parameter['name']:8} {parameter['unit']:12} typically {parameter['typical']:g}"
            )
            print(line)
        print(
            f"\n  needs    {term['needs']}\n  targets  {', '.join(term['targets']) or 'none here'}"
        )
    return 0


def mechanism(args: Args) -> int:
    """Show a built-in mechanism, or check a file: what it says, and what can be identified."""
    loaded = api.load_mechanism(args.name)
    counts = []
    try:
        for terms in () if args.quiet else (None, COMPLETE):
            counts.append(identifiable(loaded, terms))
    except InputError as error:
        _warn(args, [f"what can be identified is not counted: {error.message}"])
    if args.json:
        counted = {"identifiable": [c.to_dict() for c in counts]} if counts else {}
        sys.stdout.write(to_json({**loaded.to_dict(), **counted}))
        return 0
    sys.stdout.write(loaded.to_toml())
    for count in counts:
        sys.stdout.write("\n" + "".join(f"# {line}\n" for line in count.text().splitlines()))
    return 0


# ------------------------------------------------------------------ the parser


class _Parser(argparse.ArgumentParser):
    def error(self, message: str) -> NoReturn:
        raise InputError(f"{message}. See `{self.prog} --help`.")


def _names(text: str) -> list[str]:
    return [name.strip() for name in text.split(",") if name.strip()]


def _noise(text: str) -> float | dict[str, float]:
    try:
        if "=" not in text:
            return float(text)
        pairs = (item.split("=", 1) for item in _names(text))
        return {name.strip(): float(value) for name, value in pairs}
    except ValueError:
        expected = "a number, or a11=1.2,a12=1.1,…"
        raise argparse.ArgumentTypeError(f"found {text!r}, expected {expected}") from None


def _parser() -> argparse.ArgumentParser:
    parser = _Parser(
        prog="rsicalib",
        description="Calibration of closed kinematic chains from their own joint readings.",
        epilog="exit codes: 0 usable, 1 a defect of ours, 2 unusable input or options, "
        "3 not determined by the data, 4 the residual is significant, 130 interrupted",
    )
    parser.add_argument("--version", action="version", version=f"rsicalib {_core.__version__}")
    verbs = parser.add_subparsers(dest="verb", metavar="VERB", required=True)

    def verb(run: Callable[[Args], int], **more: Any) -> argparse.ArgumentParser:
        words = (run.__doc__ or "").strip().splitlines()[0]
        name = run.__name__
        sub = verbs.add_parser(name, help=words, description=words, **more)
        sub.set_defaults(run=run)
        sub.add_argument(
            "--json",
            action="store_true",
            help="the result on standard output, and nothing else there",
        )
        sub.add_argument("--quiet", action="store_true", help="no summary, progress or warnings")
        return sub

    sub = verb(demo)
    _add_out(sub)

    for run in (calibrate, trace):
        sub = verb(run)
        sub.add_argument(
            "readings", metavar="READINGS", nargs="+", help="CSV or Parquet; several are sessions"
        )
        _add_mechanism(sub)
        sub.add_argument("--rest", metavar="READINGS", help="a reading of the rest pose")
        _add_check(sub)
        sub.add_argument("--calibration", metavar="FILE", help="start from an earlier result")
        sub.add_argument(
            "--terms",
            metavar="TERM,…",
            type=_names,
            help="terms to identify: offset, curvature@a22",
        )
        if run is trace:
            sub.add_argument(
                "--without", metavar="TERM,…", type=_names, help="terms that are no candidates"
            )
        sub.add_argument(
            "--noise",
            metavar="COUNTS|a11=1.2,…",
            type=_noise,
            help="standard deviation of one sample, quantisation included",
        )
        if run is calibrate:
            sub.add_argument(
                "--method",
                choices=("implicit_loop", "algebraic"),
                help="noise in the readings, or the paper's least squares",
            )
        sub.add_argument("--closures", metavar="NAME,…", type=_names, help="only these closures")
        sub.add_argument("--fit-groups", metavar="NAME,…", type=_names, help="only these groups")
        sub.add_argument(
            "--hold-out-groups", metavar="NAME,…", type=_names, help="not these groups"
        )
        sub.add_argument("--seed", type=int, help="of every random draw")
        _add_skip(sub)
        _add_out(sub)

    sub = verb(fixture)
    sub.add_argument("readings", metavar="READINGS", help="with the columns x y z rx ry rz")
    _add_mechanism(sub)
    _add_check(sub)
    _add_skip(sub)
    _add_out(sub)

    sub = verb(forward)
    sub.add_argument("readings", metavar="READINGS", help="CSV or Parquet")
    _add_mechanism(sub)
    sub.add_argument("--calibration", metavar="FILE", help="an earlier result; else as declared")
    _add_skip(sub)

    sub = verb(simulate)
    sub.add_argument("out", metavar="OUT", type=Path, help="folder for the files")
    _add_mechanism(sub)
    sub.add_argument("--poses", type=int, default=48, help="held poses (48)")
    sub.add_argument("--samples", type=int, default=8, help="of each pose (8)")
    sub.add_argument("--noise", type=float, default=1.0, help="of one sample, in readings (1)")
    sub.add_argument("--check-poses", type=int, default=20, help="other poses, known (20)")
    sub.add_argument("--seed", type=int, default=0, help="same seed, same files (0)")

    sub = verb(plan)
    _add_mechanism(sub)
    sub.add_argument("--poses", type=int, default=12, help="how many to visit (12)")
    sub.add_argument("--beside", metavar="READINGS", help="poses that are visited already")
    sub.add_argument("--noise", type=float, default=1.0, help="of one reading, for the bound (1)")
    sub.add_argument(
        "--criterion", choices=CRITERIA, default=CRITERIA[0], help="what is made small"
    )
    sub.add_argument("--calibration", metavar="FILE", help="whose offsets and gains hold")
    sub.add_argument("--seed", type=int, default=0, help="same seed, same plan (0)")
    sub.add_argument("--out", metavar="FILE", type=Path, help="write the poses as CSV")

    sub = verb(paper)
    words = "of every simulated cell (1000)"
    sub.add_argument("--trials", type=int, default=1000, help=words)
    sub.add_argument("--seed", type=int, default=1995, help="same seed, same figures (1995)")
    sub.add_argument("--workers", type=int, help="threads; all cores where not given")
    sub.add_argument("--out", metavar="DIR", type=Path, help="write paper.json and paper.txt there")

    sub = verb(terms)
    sub.add_argument("id", metavar="ID", nargs="?", help="one term in full")
    _add_mechanism(sub)

    sub = verb(mechanism)
    sub.add_argument(
        "name", metavar="NAME|FILE", nargs="?", default="rsi", help="rsi where not given"
    )
    return parser


def _add_mechanism(sub: argparse.ArgumentParser) -> None:
    sub.add_argument("--mechanism", metavar="NAME|FILE", default="rsi", help="default: rsi")


def _add_check(sub: argparse.ArgumentParser) -> None:
    sub.add_argument("--check", metavar="READINGS", help="known poses, never used in a fit")
    words = "error on the check poses also after a rigid motion of the instrument"
    sub.add_argument("--align", action="store_true", help=words)


def _add_skip(sub: argparse.ArgumentParser) -> None:
    words = "drop rows that cannot be used, and list them in the result"
    sub.add_argument("--skip-bad-rows", action="store_true", help=words)


def _add_out(sub: argparse.ArgumentParser) -> None:
    words = "write result.json, the calibrated mechanism and the reports there"
    sub.add_argument("--out", metavar="DIR", type=Path, help=words)


# ------------------------------------------------------------------ behind the verbs


def _session(args: Args) -> dict[str, Any]:
    """Options that `calibrate` and `trace` share, by the names they have in Python."""
    names = """mechanism rest check terms closures noise calibration align fit_groups
        hold_out_groups skip_bad_rows"""
    return {name: getattr(args, name) for name in names.split()}


def _show(args: Args, result: Calibration | Trace) -> int:
    """Write what was asked for; the exit code."""
    _warn(args, result.warnings)
    if args.out is not None:
        _write(args.out, result, getattr(args, "mechanism", "rsi"))
    if args.json:
        sys.stdout.write(result.to_json())
    elif not args.quiet:
        print(result.summary())
        if args.out is not None:
            print(f"\n{args.out / 'report.html'}")
    return result.exit_code


def _write(folder: Path, result: Result, mechanism: str) -> None:
    files = {
        "result.json": result.to_json(),
        "report.txt": result.summary() + "\n",
        "report.html": result.report(),
    }
    _write_files(folder, files)
    for path, text in calibrated_files(folder, mechanism, result):
        write_text(path, text)


def _write_files(folder: Path, files: Mapping[str, str]) -> None:
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        found = f"'{folder}', which cannot be made ({error.strerror})"
        raise InputError(f"--out: found {found}, expected a folder") from None
    for name, text in files.items():
        write_text(folder / name, text)


def _warn(args: Args, warnings: Sequence[str]) -> None:
    if not args.quiet:
        for warning in warnings:
            print(f"warning: {warning}", file=sys.stderr)


def _interruptible(job: Callable[[], T]) -> T:
    """Run a job of the core so that Ctrl-C is heard while it computes."""
    out: list[T] = []
    errors: list[BaseException] = []

    def run() -> None:
        try:
            out.append(job())
        except BaseException as error:
            errors.append(error)

    thread = threading.Thread(target=run, daemon=True)
    thread.start()
    while thread.is_alive():
        thread.join(0.2)
    if errors:
        raise errors[0]
    return out[0]


def main(argv: Sequence[str] | None = None) -> NoReturn:
    """Run the command and leave.

    Parameters
    ----------
    argv : sequence of str, optional
        Arguments; those of the process where not given.
    """
    words = sys.argv[1:] if argv is None else list(argv)
    code = 0
    try:
        code = _run(words)
        sys.stdout.flush()
    except BrokenPipeError:
        # Whoever read has seen enough; the interpreter must not complain on the way out.
        with contextlib.suppress(OSError):
            os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
    except KeyboardInterrupt:
        forget_parts()
        with contextlib.suppress(OSError):
            print("interrupted", file=sys.stderr, flush=True)
        os._exit(130)  # a job of the core may still be computing: nobody waits for it
    sys.exit(code)


def _run(words: list[str]) -> int:
    as_json = "--json" in words
    try:
        args = _parser().parse_args(words)
        run: Callable[[Args], int] = args.run
        return run(args)
    except InputError as error:
        return _fail(2, "rsicalib.error/1", error.message, as_json, where=error.where)
    except UndeterminedError as error:
        return _fail(3, "rsicalib.error/1", error.message, as_json, where=None)
    except (KeyboardInterrupt, SystemExit, BrokenPipeError):
        raise
    except BaseException:  # a panic of the core is no Exception
        traceback.print_exc()
        print(
            "This is a defect of rsicalib; please report it with the lines above.", file=sys.stderr
        )
        return 1


def _fail(code: int, form: str, message: str, as_json: bool, **more: Any) -> int:
    if as_json:
        sys.stdout.write(to_json({"format": form, "message": message, **more}))
    else:
        print(f"error: {message}", file=sys.stderr)
    return code
