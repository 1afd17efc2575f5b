"""The parser: verbs, arguments and options."""

from __future__ import annotations

import argparse
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any, NoReturn

from rsicalib import _core
from rsicalib.cli import verbs as of
from rsicalib.cli.completion import SHELLS
from rsicalib.errors import InputError
from rsicalib.exports.kinds import EXPORTS
from rsicalib.imports.asked import HOLD
from rsicalib.imports.kinds import KINDS
from rsicalib.options import NUMBERS, parsed
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
                if not any(option.startswith(word) for option in known):
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
        hint = meant(word, self._options(verb))
        message = f"found {quoted(word)}{hint}, expected an option of {verb}"
        raise InputError(f"{message}. See `{self.prog} {verb} --help`.")

    def _print_message(self, message: str, file: Any = None) -> None:
        """Print help; argparse's own would hide that standard output is full."""
        (file or sys.stderr).write(message)


def _names(text: str) -> list[str]:
    found = [name.strip() for name in text.split(",") if name.strip()]
    if not found:
        raise argparse.ArgumentTypeError(f"found {text!r}, expected names with commas between them")
    return found


def _pairs(text: str) -> dict[str, str]:
    pairs = [item.split("=", 1) for item in _names(text)]
    wrong = next((pair[0] for pair in pairs if len(pair) < 2 or not all(pair)), None)
    if wrong is not None:
        raise argparse.ArgumentTypeError(f"found {wrong!r}, expected name=name,…")
    found = {a.strip(): b.strip() for a, b in pairs}
    if len(found) < len(pairs):
        raise argparse.ArgumentTypeError(f"found a name twice in {text!r}, expected each once")
    return found


def _channels(text: str) -> dict[str, str]:
    """Names in a log by channels; a name alone is both."""
    return _pairs(",".join(n if "=" in n else f"{n}={n}" for n in _names(text)))


def _numbers(text: str) -> list[int]:
    try:
        return [int(name) for name in _names(text)]
    except ValueError:
        expected = "whole numbers with commas between them"
        raise argparse.ArgumentTypeError(f"found {text!r}, expected {expected}") from None


def _noise(text: str) -> float | dict[str, float]:
    one: Callable[[str], float] = parsed("noise")
    try:
        if "=" not in text:
            return one(text)
        pairs = (item.split("=", 1) for item in _names(text))
        return {name.strip(): one(value.strip()) for name, value in pairs}
    except (ValueError, argparse.ArgumentTypeError):
        expected = f"{NUMBERS['noise'].expected}, or a11=1.2,a12=1.1,…"
        raise argparse.ArgumentTypeError(f"found {quoted(text)}, expected {expected}") from None


_seed = parsed("seed")


def _folder(text: str) -> Path:
    if not text:
        raise argparse.ArgumentTypeError("found no name, expected a path")
    return Path(text)


def make_parser() -> argparse.ArgumentParser:
    """Make the parser; a parsed verb stands in `run`."""
    parser = _Parser(
        prog="rsicalib",
        description="Calibration of closed kinematic chains from their own joint readings. "
        "Begin with: rsicalib demo",
        epilog="exit codes: 0 usable, 1 a defect of ours, 2 unusable input or options, "
        "3 not determined by the data, 4 the residual is significant or an alarm, 130 interrupted",
    )
    parser.add_argument("--version", action="version", version=f"rsicalib {_core.__version__}")
    verbs = parser.add_subparsers(dest="verb", metavar="VERB", required=True)

    def verb(run: Callable[[of.Args], int], **more: Any) -> argparse.ArgumentParser:
        words = (run.__doc__ or "").strip().splitlines()[0]
        name = run.__name__.rstrip("_")  # `import` is a word of Python
        sub = verbs.add_parser(name, help=words, description=words, **more)
        sub.set_defaults(run=run)
        sub.add_argument(
            "--json",
            action="store_true",
            help="the result on standard output, and nothing else there",
        )
        sub.add_argument("--quiet", action="store_true", help="no summary, progress or warnings")
        return sub

    sub = verb(of.demo)
    _add_out(sub)

    for run in (of.calibrate, of.trace):
        sub = verb(run)
        sub.add_argument(
            "readings",
            metavar="READINGS",
            nargs="+",
            help="CSV, Parquet, or a log that `import` knows; several are sessions",
        )
        _add_mechanism(sub)
        sub.add_argument("--rest", metavar="READINGS", help="a reading of the rest pose")
        _add_check(sub)
        words = "standard deviation of a coordinate of known places; exact where not given"
        sub.add_argument("--check-noise", metavar="LENGTH", type=parsed("check_noise"), help=words)
        words = "standard deviation of known angles; exact where not given"
        sub.add_argument(
            "--check-noise-angle", metavar="RAD", type=parsed("check_noise_angle"), help=words
        )
        sub.add_argument("--calibration", metavar="FILE", help="start from an earlier result")
        words = "population.json of `fleet --population`: a prior of the parameters"
        sub.add_argument("--population", metavar="FILE", help=words)
        sub.add_argument(
            "--terms",
            metavar="TERM,…",
            type=_names,
            help="terms to identify: offset, curvature@a22",
        )
        if run is of.trace:
            sub.add_argument(
                "--without", metavar="TERM,…", type=_names, help="terms that are no candidates"
            )
            words = "apply effects, too, that do not help where nothing was recorded"
            sub.add_argument("--apply-all", action="store_true", help=words)
        sub.add_argument(
            "--noise",
            metavar="COUNTS|a11=1.2,…",
            type=_noise,
            help="standard deviation of one sample, quantisation included",
        )
        if run is of.calibrate:
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
        sub.add_argument("--seed", type=_seed, help="of every random draw")
        words = "standard deviation that is aimed at: the report shows where it is reached"
        sub.add_argument("--target", metavar="LENGTH", type=parsed("target"), help=words)
        _add_skip(sub)
        _add_about(sub)
        _add_out(sub)

    sub = verb(of.fixture)
    sub.add_argument("readings", metavar="READINGS", help="with the columns x y z rx ry rz")
    _add_mechanism(sub)
    _add_check(sub)
    _add_skip(sub)
    _add_about(sub)
    _add_out(sub)

    sub = verb(of.forward)
    sub.add_argument("readings", metavar="READINGS", help="CSV or Parquet")
    _add_mechanism(sub)
    sub.add_argument("--calibration", metavar="FILE", help="an earlier result; else as declared")
    _add_skip(sub)

    sub = verb(of.simulate)
    sub.add_argument("out", metavar="OUT", type=_folder, help="folder for the files")
    _add_mechanism(sub)
    sub.add_argument("--poses", type=parsed("poses"), default=48, help="held poses (48)")
    sub.add_argument("--samples", type=parsed("samples"), default=8, help="of each pose (8)")
    sub.add_argument(
        "--noise",
        type=parsed("simulate.noise"),
        default=1.0,
        help="of one sample, in readings (1)",
    )
    sub.add_argument(
        "--check-poses", type=parsed("check"), default=20, help="other poses, known (20)"
    )
    sub.add_argument("--seed", type=_seed, default=0, help="same seed, same files (0)")
    _add_force(sub)

    sub = verb(of.plan)
    _add_mechanism(sub)
    words = "how many to visit (12; with --target at most 64)"
    sub.add_argument("--poses", type=parsed("plan.poses"), default=None, help=words)
    words = "as few poses as bring the platform to this standard deviation, beside a result"
    sub.add_argument("--target", metavar="LENGTH", type=parsed("target"), help=words)
    sub.add_argument(
        "--result", metavar="FILE", help="what the poses complement: result.json of a trace"
    )
    words = "poses that are visited already; with --result its readings"
    sub.add_argument("--beside", metavar="READINGS", nargs="+", help=words)
    sub.add_argument(
        "--noise",
        type=parsed("noise"),
        default=1.0,
        help="of one reading, for the bound (1)",
    )
    words = "what is made small; decide where the result leaves something open, else platform"
    sub.add_argument("--criterion", choices=_core.CRITERIA, help=words)
    words = "readings of poses that are struck off: rows of a plan will do"
    sub.add_argument("--off", metavar="READINGS", help=words)
    sub.add_argument("--calibration", metavar="FILE", help="whose offsets and gains hold")
    sub.add_argument("--seed", type=_seed, default=0, help="same seed, same plan (0)")
    sub.add_argument(
        "--out", metavar="FILE", type=_folder, help="write the poses as CSV, and a page beside it"
    )
    _add_force(sub)

    sub = verb(of.fleet)
    sub.add_argument("dataset", metavar="DATASET", help="Parquet or CSV, a file or a folder")
    sub.add_argument("--by", metavar="COLUMN", default="device", help="names the device (device)")
    words = "groups that each of these is in, such as batch,tool: columns, or those of levels.csv"
    sub.add_argument("--levels", metavar="COLUMN,…", type=_names, help=words)
    _add_mechanism(sub)
    sub.add_argument("--terms", metavar="TERM,…", type=_names, help="terms to identify")
    sub.add_argument("--noise", metavar="COUNTS|a11=1.2,…", type=_noise, help="of one sample")
    sub.add_argument("--closures", metavar="NAME,…", type=_names, help="only these closures")
    words = "do not trace the residual where it is significant"
    sub.add_argument("--no-trace", dest="trace", action="store_false", help=words)
    words = "add the error on poses that are left out in turn"
    sub.add_argument("--held-out", action="store_true", help=words)
    sub.add_argument("--workers", type=parsed("workers"), help="threads; all cores where not given")
    sub.add_argument("--dask", metavar="ADDRESS", help="the workers of this scheduler compute")
    words = "keep the rows of devices whose readings are the same"
    sub.add_argument("--resume", action="store_true", help=words)
    words = "for one device, whose row says so where that was too short; no limit where not given"
    sub.add_argument("--time-limit", metavar="SECONDS", type=parsed("time_limit"), help=words)
    words = "what the devices share: errors of the drawing, a prior for the next device"
    sub.add_argument("--population", action="store_true", help=words)
    words = "devices with a report of their own: those that stand out most (10)"
    sub.add_argument("--reports", metavar="N", type=parsed("reports"), help=words)
    words = "folder for fleet.parquet and fleet.html"
    sub.add_argument("--out", metavar="FOLDER", type=_folder, required=True, help=words)

    sub = verb(of.guide)
    _add_mechanism(sub)
    sub.add_argument("--rest", metavar="READINGS", help="a reading of the rest pose")
    words = "readings, held-out poses, places passed and result.json grow there"
    sub.add_argument("--out", metavar="FOLDER", type=_folder, required=True, help=words)
    words = "standard deviation of the platform to reach; a hundredth of the travel where not given"
    sub.add_argument("--target", metavar="LENGTH", type=parsed("target"), help=words)
    words = "where samples come from, as CSV: standard input (-), a file that grows, a command"
    sub.add_argument("--source", metavar="-|FILE|COMMAND", default="-", help=words)
    words = "moves a robot: is told each pose as a line of JSON, answers with its readings"
    sub.add_argument("--drive", metavar="COMMAND", help=words)
    words = "columns with one text in every sample, where the source has none: at=cone"
    sub.add_argument("--labels", metavar="COLUMN=TEXT,…", type=_pairs, help=words)
    sub.add_argument("--resume", action="store_true", help="go on with the session in --out")
    words = "of the page; a free one where not given"
    sub.add_argument("--port", type=parsed("port"), default=0, help=words)
    words = "address of the page; others than this machine need the token in it (127.0.0.1)"
    sub.add_argument("--host", default="127.0.0.1", help=words)
    sub.add_argument("--no-browser", action="store_true", help="do not open the page")
    sub.add_argument("--samples", type=parsed("guide.samples"), default=8, help="of each pose (8)")
    words = "for which a pose is held (0.6)"
    sub.add_argument("--seconds", type=parsed("seconds"), default=0.6, help=words)
    sub.add_argument("--seed", type=_seed, default=0, help="of the candidates (0)")

    sub = verb(of.watch)
    sub.add_argument("readings", metavar="READINGS|-", help="CSV or Parquet; -: standard input")
    _add_mechanism(sub)
    words = "the result under which the device works; a folder of them for a column `device`"
    sub.add_argument("--calibration", metavar="FILE|DIR", required=True, help=words)
    words = f"false alarms to expect: per sample ({_core.FALSE_ALARMS:g}), or per hour as 0.1/h"
    sub.add_argument("--false-alarms", metavar="RATE", help=words)
    words = "keeps what the watch knows: where it is there, the watch goes on from it"
    sub.add_argument("--state", metavar="FILE|DIR", help=words)
    words = "wait for more at the end of the file, until Ctrl-C"
    sub.add_argument("--follow", action="store_true", help=words)

    sub = verb(of.history)
    sub.add_argument("folder", metavar="DIR", help="folder of results, with their dates")
    _add_mechanism(sub)
    sub.add_argument("--device", metavar="NAME", help="whose results; else of the most frequent")
    words = "error of the platform's position that is too much, in units of length"
    sub.add_argument("--target", metavar="LENGTH", type=parsed("target"), help=words)
    words = "write history.json, history.txt and history.html there"
    sub.add_argument("--out", metavar="DIR", type=_folder, help=words)
    _add_force(sub)

    sub = verb(of.certify)
    words = "a trace: result.json, or what `trace --json` wrote"
    sub.add_argument("result", metavar="RESULT", help=words)
    _add_mechanism(sub)
    words = "of the largest error: a length in the mechanism's unit, '0.5 mm', '2 mrad'"
    sub.add_argument("--limit", metavar="LENGTH|ANGLE", required=True, help=words)
    words = "probability that the error is not beyond U (0.95)"
    sub.add_argument("--confidence", type=parsed("confidence"), default=0.95, help=words)
    words = "places that count: readings, or x y z rx ry rz; of the workspace where not given"
    sub.add_argument("--at", metavar="POSES", help=words)
    words = "write certificate.json, certificate.txt and certificate.html there"
    sub.add_argument("--out", metavar="DIR", type=_folder, help=words)
    _add_force(sub)

    sub = verb(of.suppose)
    words = "a session, or a plan with a column for each channel"
    sub.add_argument("readings", metavar="READINGS", nargs="+", help=words)
    words = "what is supposed: curvature@a22.c2=0.02; again for more of them at once"
    sub.add_argument("--term", metavar="SPEC=VALUE", action="append", required=True, help=words)
    _add_mechanism(sub)
    sub.add_argument("--rest", metavar="READINGS", help="a reading of the rest pose")
    sub.add_argument("--calibration", metavar="FILE", help="whose offsets and gains hold")
    sub.add_argument("--terms", metavar="TERM,…", type=_names, help="terms that are fitted beside")
    words = "standard deviation of one sample, quantisation included"
    sub.add_argument("--noise", metavar="COUNTS|a11=1.2,…", type=_noise, help=words)
    sub.add_argument("--closures", metavar="NAME,…", type=_names, help="only these closures")
    _add_skip(sub)
    sub.add_argument(
        "--out", metavar="FILE", type=_folder, help="write the residual picture as HTML"
    )
    _add_force(sub)

    sub = verb(of.paper)
    words = "of every simulated cell (1000)"
    sub.add_argument("--trials", type=parsed("trials"), default=1000, help=words)
    sub.add_argument("--seed", type=_seed, default=1995, help="same seed, same figures (1995)")
    sub.add_argument("--workers", type=parsed("workers"), help="threads; all cores where not given")
    sub.add_argument(
        "--out", metavar="DIR", type=_folder, help="write paper.json, paper.txt and paper.html"
    )
    _add_force(sub)

    sub = verb(of.terms)
    sub.add_argument("id", metavar="ID", nargs="?", help="one term in full")
    _add_mechanism(sub)

    sub = verb(of.mechanism)
    sub.add_argument(
        "name", metavar="NAME|FILE", nargs="?", default="rsi", help="rsi where not given"
    )

    sub = verb(of.export)
    sub.add_argument("result", metavar="RESULT", help="result.json of calibrate or trace")
    words = "; ".join(f"{kind}: {what}" for kind, (what, _) in EXPORTS.items())
    sub.add_argument("--to", choices=list(EXPORTS), required=True, help=words)
    _add_mechanism(sub)
    sub.add_argument("--readings", metavar="READINGS", help="to be corrected (csv, mcap)")
    sub.add_argument("--base", metavar="FILE", help="the receiver's file (lerobot)")
    words = "write the files there; on standard output where not given"
    sub.add_argument("--out", metavar="FOLDER", type=_folder, help=words)
    _add_force(sub)

    sub = verb(of.import_)
    words = "a serial log, printer.cfg, a data set, a bag, HDF5, CSV or Parquet"
    sub.add_argument("source", metavar="SOURCE", help=words)
    words = "readings.csv, and mechanism.toml where the log has one, are written there"
    sub.add_argument("--out", metavar="FOLDER", type=_folder, required=True, help=words)
    sub.add_argument("--format", choices=sorted(KINDS), help="told from SOURCE where not given")
    words = "whose channels are taken; where its chains are URDF, by the names of their joints"
    sub.add_argument("--mechanism", metavar="NAME|FILE", help=words)
    words = "name in the log of each channel, of a table of other columns, too: q1=panda_joint1,…"
    sub.add_argument("--channels", metavar="CHANNEL=NAME,…", type=_channels, help=words)
    sub.add_argument("--topic", metavar="TOPIC", help="of ROS: where the joint states are")
    words = "of ROS: only rows under a condition, '/wrench.force.z>2'"
    sub.add_argument("--when", metavar="CONDITION", help=words)
    words = f"for how long a held pose is still ({HOLD:g}); 0: a recording as it is"
    sub.add_argument("--hold", metavar="SECONDS", type=parsed("hold"), help=words)
    sub.add_argument(
        "--rate",
        metavar="HZ",
        type=parsed("rate"),
        help="of a log without times, or in place of its times",
    )
    words = "of a data set: only these, 0,3,…; all where not given"
    sub.add_argument("--episodes", metavar="N,…", type=_numbers, help=words)
    words = "of LeRobot: calibration of the leader and of the follower, or of the follower"
    sub.add_argument("--ranges", metavar="FILE,…", type=_names, default=[], help=words)
    words = "columns with one text in every row: surface=table"
    sub.add_argument("--labels", metavar="COLUMN=TEXT,…", type=_pairs, help=words)
    words = "leave out rows with some channels and not others"
    sub.add_argument("--skip-bad-rows", action="store_true", help=words)
    _add_force(sub)

    sub = verb(of.completion)
    sub.add_argument("shell", choices=SHELLS, help="for whom the script is")
    sub.set_defaults(parser=parser)
    return parser


def _add_mechanism(sub: argparse.ArgumentParser) -> None:
    sub.add_argument("--mechanism", metavar="NAME|FILE", default="rsi", help="default: rsi")


def _add_check(sub: argparse.ArgumentParser) -> None:
    sub.add_argument("--check", metavar="READINGS", help="known poses, never used in a fit")
    words = "the point whose places they are, where chains carry several"
    sub.add_argument("--check-point", metavar="NAME", help=words)
    words = "error on the check poses also after a rigid motion of the instrument"
    sub.add_argument("--align", action="store_true", help=words)


def _add_skip(sub: argparse.ArgumentParser) -> None:
    words = "drop rows that cannot be used or are at an end of a range, and list them in the result"
    sub.add_argument("--skip-bad-rows", action="store_true", help=words)


def _add_about(sub: argparse.ArgumentParser) -> None:
    sub.add_argument("--device", metavar="NAME", help="the device, for the result and the report")
    sub.add_argument("--note", metavar="TEXT", help="what is to be remembered of the session")
    words = "from when the parameters hold: 2025-03-01, or with a time"
    sub.add_argument("--date", metavar="DATE", help=words)


def _add_out(sub: argparse.ArgumentParser) -> None:
    words = "write result.json, the calibrated mechanism and the reports there"
    sub.add_argument("--out", metavar="DIR", type=_folder, help=words)
    _add_force(sub)


def _add_force(sub: argparse.ArgumentParser) -> None:
    words = "replace files that rsicalib did not write"
    sub.add_argument("--force", action="store_true", help=words)
