"""What each verb takes, in the order of the help."""

from __future__ import annotations

import argparse
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from rsicalib import _core
from rsicalib.cli import verbs
from rsicalib.cli.completion import SHELLS
from rsicalib.exports.kinds import EXPORTS
from rsicalib.imports.asked import HOLD
from rsicalib.imports.kinds import KINDS
from rsicalib.options import NUMBERS, parsed
from rsicalib.plain_text import quoted


def _names(text: str) -> list[str]:
    found = [name.strip() for name in text.split(",") if name.strip()]
    if not found:
        raise argparse.ArgumentTypeError(f"found {text!r}, expected names with commas between them")
    return found


def _pairs(text: str) -> dict[str, str]:
    pairs = [item.split("=", 1) for item in _names(text)]
    wrong = next((pair[0] for pair in pairs if len(pair) < 2 or not all(pair)), None)
    if wrong is not None:
        raise argparse.ArgumentTypeError(f"found {wrong!r}, expected name=value,…")
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
    pairs = _pairs(text) if "=" in text else None
    try:
        return one(text) if pairs is None else {name: one(value) for name, value in pairs.items()}
    except argparse.ArgumentTypeError:
        expected = f"{NUMBERS['noise'].expected}, or a11=1.2,a12=1.1,…"
        raise argparse.ArgumentTypeError(f"found {quoted(text)}, expected {expected}") from None


def _folder(text: str) -> Path:
    if not text:
        raise argparse.ArgumentTypeError("found no name, expected a path")
    return Path(text)


def _file(text: str) -> Path:
    if not _folder(text).name:
        raise argparse.ArgumentTypeError(f"found {quoted(text)}, expected the name of a file")
    return Path(text)


READ: dict[str, Callable[[str], Any]] = {
    **dict.fromkeys(("COLUMN,…", "FILE,…", "NAME,…", "TERM,…"), _names),
    "CHANNEL=NAME,…": _channels,
    "COLUMN=TEXT,…": _pairs,
    "COUNTS|a11=1.2,…": _noise,
    "N,…": _numbers,
}
"""How values are read, by what they are called; others are text, or numbers of `options`."""

SHARED = {
    "--mechanism NAME|FILE": "default: rsi",
    "--rest READINGS": "a reading of the rest pose",
    "--check READINGS": "known poses, never used in a fit",
    "--check-point NAME": "the point whose places they are, where chains carry several",
    "--align": "error on the check poses also after a rigid motion of the instrument",
    "--noise COUNTS|a11=1.2,…": "standard deviation of one sample, quantisation included",
    "--closures NAME,…": "only these closures",
    "--skip-bad-rows": "drop rows that cannot be used or are at an end of a range, and list them "
    "in the result",
    "--device NAME": "the device, for the result and the report",
    "--note TEXT": "what is to be remembered of the session",
    "--date DATE": "from when the parameters hold: 2025-03-01, or with a time",
    "--out DIR": "write result.json, the calibrated mechanism and the reports there",
    "--force": "replace files that rsicalib did not write",
}
"""Options that several verbs have, as the usage tells them, and their help."""

BY_NAME = {told.split()[0].removeprefix("--"): told for told in SHARED}


@dataclass(frozen=True)
class Verb:
    """A verb, to which arguments are added in the order of its help."""

    parser: argparse.ArgumentParser

    def takes(
        self, told: str, words: str, read: Callable[[str], Any] | None = None, **more: Any
    ) -> None:
        """Add an argument as the usage tells it: `--rest READINGS`, `--force`, `out OUT`.

        Defaults are those of the verb in Python: what is not given is not handed on.
        """
        name, _, value = told.partition(" ")
        if value:
            if name in ("out", "--out"):
                read = _file if value == "FILE" else _folder
            read = read or READ.get(value)
            more |= {"metavar": value, "type": read}
        elif name.startswith("--") and "choices" not in more:
            more.setdefault("action", "store_true")
        self.parser.add_argument(name, help=words, **more)

    def shares(self, names: str) -> None:
        """Add options that several verbs have, by their names."""
        for name in names.split():
            more: dict[str, Any] = {"default": "rsi"} if name == "mechanism" else {}
            self.takes(BY_NAME[name], SHARED[BY_NAME[name]], **more)


ARGUMENTS: dict[Callable[[verbs.Args], int], Callable[[Verb], None]] = {}
"""What adds the arguments of each verb."""


def _of(run: Callable[[verbs.Args], int]) -> Callable[[Callable[[Verb], None]], None]:
    def keep(add: Callable[[Verb], None]) -> None:
        ARGUMENTS[run] = add

    return keep


@_of(verbs.demo)
def _demo(sub: Verb) -> None:
    sub.shares("out force")


def _checked(sub: Verb) -> None:
    """Known poses, and what is told of them."""
    sub.shares("check check-point align")
    words = "standard deviation of a coordinate of known places; exact where not given"
    sub.takes("--check-noise LENGTH", words, parsed("check_noise"))
    words = "standard deviation of known angles; exact where not given"
    sub.takes("--check-noise-angle RAD", words, parsed("check_noise_angle"))


def _fitted(sub: Verb, *, is_trace: bool) -> None:
    words = "CSV, Parquet, or a log that `import` knows; several are sessions"
    sub.takes("readings READINGS", words, nargs="+")
    sub.shares("mechanism rest")
    _checked(sub)
    sub.takes("--calibration FILE", "start from an earlier result")
    words = "population.json of `fleet --population`: a prior of the parameters"
    sub.takes("--population FILE", words)
    sub.takes("--terms TERM,…", "terms to identify: offset, curvature@a22")
    if is_trace:
        sub.takes("--without TERM,…", "terms that are no candidates")
        words = "apply all effects that are found, also those that would only be named"
        sub.takes("--apply-all", words)
    sub.shares("noise")
    if not is_trace:
        words = "noise in the readings, or the paper's least squares"
        sub.takes("--method", words, choices=("implicit_loop", "algebraic"))
    sub.shares("closures")
    sub.takes("--fit-groups NAME,…", "only these groups")
    sub.takes("--hold-out-groups NAME,…", "not these groups")
    sub.takes(
        "--seed SEED", "nothing is drawn at random: taken for scripts that give one", parsed("seed")
    )
    words = "standard deviation that is aimed at: the report shows where it is reached"
    sub.takes("--target LENGTH", words, parsed("target"))
    sub.shares("skip-bad-rows device note date out force")


@_of(verbs.calibrate)
def _calibrate(sub: Verb) -> None:
    _fitted(sub, is_trace=False)


@_of(verbs.trace)
def _trace(sub: Verb) -> None:
    _fitted(sub, is_trace=True)


@_of(verbs.fixture)
def _fixture(sub: Verb) -> None:
    sub.takes("readings READINGS", "with the columns x y z rx ry rz")
    sub.shares("mechanism")
    _checked(sub)
    sub.shares("skip-bad-rows device note date out force")


@_of(verbs.forward)
def _forward(sub: Verb) -> None:
    sub.takes("readings READINGS", "CSV or Parquet")
    sub.shares("mechanism")
    sub.takes("--calibration FILE", "an earlier result; else as declared")
    sub.shares("skip-bad-rows")


@_of(verbs.simulate)
def _simulate(sub: Verb) -> None:
    sub.takes("out OUT", "folder for the files")
    sub.shares("mechanism")
    sub.takes("--poses POSES", "held poses (48)", parsed("poses"))
    sub.takes("--samples SAMPLES", "samples of each pose (8)", parsed("samples"))
    noise = "standard deviation of one sample, in readings (as declared; 1 of counts)"
    sub.takes("--noise NOISE", noise, parsed("simulate.noise"))
    sub.takes("--check-poses CHECK_POSES", "other poses, known (20)", parsed("check"), dest="check")
    sub.takes("--seed SEED", "same seed, same files (0)", parsed("seed"))
    sub.shares("force")


@_of(verbs.plan)
def _plan(sub: Verb) -> None:
    sub.shares("mechanism")
    words = "how many to visit (12; with --target at most 64)"
    sub.takes("--poses POSES", words, parsed("plan.poses"))
    words = "as few poses as bring the platform to this standard deviation, beside a result"
    sub.takes("--target LENGTH", words, parsed("target"))
    sub.takes("--result FILE", "what the poses complement: result.json of a trace")
    words = "poses that are visited already; with --result its readings"
    sub.takes("--beside READINGS", words, nargs="+")
    sub.takes("--noise NOISE", "noise of one reading, for the bound (1)", parsed("noise"))
    words = "what is made small; decide where the result leaves something open, else platform"
    sub.takes("--criterion", words, choices=_core.CRITERIA)
    sub.takes("--off READINGS", "readings of poses to leave out: rows of a plan will do")
    sub.takes("--calibration FILE", "an earlier result, whose offsets and gains hold")
    sub.takes("--seed SEED", "same seed, same plan (0)", parsed("seed"))
    sub.takes("--out FILE", "write the poses as CSV, and a page beside it")
    sub.shares("force")


@_of(verbs.fleet)
def _fleet(sub: Verb) -> None:
    sub.takes("dataset DATASET", "Parquet or CSV, a file or a folder")
    sub.takes("--by COLUMN", "column that names the device (device)")
    words = "groups that each of these is in, such as batch,tool: columns, or those of levels.csv"
    sub.takes("--levels COLUMN,…", words)
    sub.shares("mechanism")
    sub.takes("--terms TERM,…", "terms to identify")
    sub.takes("--noise COUNTS|a11=1.2,…", "standard deviation of one sample")
    sub.shares("closures")
    words = "do not trace the residual where it is significant"
    sub.takes("--no-trace", words, dest="trace", action="store_false")
    sub.takes("--held-out", "add the error on poses that are left out in turn")
    sub.takes("--workers WORKERS", "threads; all cores where not given", parsed("workers"))
    sub.takes("--dask ADDRESS", "the workers of this scheduler compute")
    sub.takes("--resume", "keep the rows of devices whose readings are the same")
    words = "longest time for one device, whose row says if it was too short; none where not given"
    sub.takes("--time-limit SECONDS", words, parsed("time_limit"))
    words = "what the devices share: errors of the drawing, a prior for the next device"
    sub.takes("--population", words)
    words = "devices with a report of their own: those that stand out most (10)"
    sub.takes("--reports N", words, parsed("reports"))
    sub.takes("--out FOLDER", "folder for fleet.parquet and fleet.html", required=True)


@_of(verbs.guide)
def _guide(sub: Verb) -> None:
    sub.shares("mechanism rest")
    words = "readings, held-out poses, places passed and result.json grow there"
    sub.takes("--out FOLDER", words, required=True)
    words = "standard deviation of the platform to reach; a hundredth of the travel where not given"
    sub.takes("--target LENGTH", words, parsed("target"))
    words = "where samples come from, as CSV: standard input (-), a file that grows, a command"
    sub.takes("--source -|FILE|COMMAND", words)
    words = "moves a robot: is told each pose as a line of JSON, answers with its readings"
    sub.takes("--drive COMMAND", words)
    words = "columns with one text in every sample, where the source has none: at=cone"
    sub.takes("--labels COLUMN=TEXT,…", words)
    sub.takes("--resume", "go on with the session in --out")
    sub.takes("--port PORT", "port of the page; a free one where not given", parsed("port"))
    words = "address of the page; others than this machine need the token in it (127.0.0.1)"
    sub.takes("--host HOST", words)
    sub.takes("--no-browser", "do not open the page", dest="browser", action="store_false")
    sub.takes("--samples SAMPLES", "samples of each pose (8)", parsed("guide.samples"))
    sub.takes("--seconds SECONDS", "time for which a pose is held (0.6)", parsed("seconds"))
    sub.takes("--seed SEED", "seed of the candidates (0)", parsed("seed"))


@_of(verbs.watch)
def _watch(sub: Verb) -> None:
    sub.takes("readings READINGS|-", "CSV or Parquet; -: standard input")
    sub.shares("mechanism")
    words = "the result under which the device works; a folder of them for a column `device`"
    sub.takes("--calibration FILE|DIR", words, required=True)
    words = f"false alarms to expect: per sample ({_core.FALSE_ALARMS:g}), or per hour as 0.1/h"
    sub.takes("--false-alarms RATE", words)
    words = "keeps what the watch knows: where it is there, the watch goes on from it"
    sub.takes("--state FILE|DIR", words)
    sub.takes("--follow", "wait for more at the end of the file, until Ctrl-C")


@_of(verbs.history)
def _history(sub: Verb) -> None:
    sub.takes("folder DIR", "folder of results, with their dates")
    sub.shares("mechanism")
    sub.takes("--device NAME", "device whose results are taken; else the most frequent one")
    words = "error of the platform's position that is too much, in units of length"
    sub.takes("--target LENGTH", words, parsed("target"))
    sub.takes("--out DIR", "write history.json, history.txt and history.html there")
    sub.shares("force")


@_of(verbs.certify)
def _certify(sub: Verb) -> None:
    sub.takes("result RESULT", "a trace: result.json, or what `trace --json` wrote")
    sub.shares("mechanism")
    words = "limit of the largest error: a length in the mechanism's unit, '0.5 mm', '2 mrad'"
    sub.takes("--limit LENGTH|ANGLE", words, required=True)
    words = "probability that the error is not beyond U (0.95)"
    sub.takes("--confidence CONFIDENCE", words, parsed("confidence"))
    words = "places that count: readings, or x y z rx ry rz; of the workspace where not given"
    sub.takes("--at POSES", words)
    sub.takes("--out DIR", "write certificate.json, certificate.txt and certificate.html there")
    sub.shares("force")


@_of(verbs.suppose)
def _suppose(sub: Verb) -> None:
    words = "a session, or a plan with a column for each channel"
    sub.takes("readings READINGS", words, nargs="+")
    words = "what is supposed: curvature@a22.c2=0.02; again for more of them at once"
    sub.takes("--term SPEC=VALUE", words, action="append", required=True)
    sub.shares("mechanism rest")
    sub.takes("--calibration FILE", "an earlier result, whose offsets and gains hold")
    sub.takes("--terms TERM,…", "terms that are fitted beside")
    sub.shares("noise closures skip-bad-rows")
    sub.takes("--out FILE", "write the residual picture as HTML")
    sub.shares("force")


@_of(verbs.paper)
def _paper(sub: Verb) -> None:
    sub.takes("--trials TRIALS", "trials of every simulated cell (1000)", parsed("trials"))
    sub.takes("--seed SEED", "same seed, same figures (1995)", parsed("seed"))
    sub.takes("--workers WORKERS", "threads; all cores where not given", parsed("workers"))
    sub.takes("--out DIR", "write paper.json, paper.txt and paper.html")
    sub.shares("force")


@_of(verbs.terms)
def _terms(sub: Verb) -> None:
    sub.takes("id ID", "one term in full", nargs="?")
    sub.shares("mechanism")


@_of(verbs.mechanism)
def _mechanism(sub: Verb) -> None:
    sub.takes("name NAME|FILE", "rsi where not given", nargs="?", default="rsi")


@_of(verbs.export)
def _export(sub: Verb) -> None:
    sub.takes("result RESULT", "result.json of calibrate or trace")
    words = "; ".join(f"{kind}: {what}" for kind, (what, _) in EXPORTS.items())
    sub.takes("--to", words, choices=list(EXPORTS), required=True)
    sub.shares("mechanism")
    sub.takes("--readings READINGS", "to be corrected (csv, mcap)")
    sub.takes("--base FILE", "the receiver's file (lerobot)")
    sub.takes("--out FOLDER", "write the files there; on standard output where not given")
    sub.shares("force")


@_of(verbs.import_)
def _import(sub: Verb) -> None:
    words = "a serial log, printer.cfg, a data set, a bag, HDF5, CSV or Parquet"
    sub.takes("source SOURCE", words)
    words = "readings.csv, and mechanism.toml where the log has one, are written there"
    sub.takes("--out FOLDER", words, required=True)
    sub.takes("--format", "told from SOURCE where not given", choices=sorted(KINDS))
    words = "gives the channels; where its chains are URDF, by the names of their joints"
    sub.takes("--mechanism NAME|FILE", words)
    words = "name in the log of each channel, of a table of other columns, too: q1=panda_joint1,…"
    sub.takes("--channels CHANNEL=NAME,…", words)
    sub.takes("--topic TOPIC", "topic of ROS with the joint states")
    sub.takes("--when CONDITION", "rows of ROS under this condition alone: '/wrench.force.z>2'")
    words = f"time for which a held pose is still ({HOLD:g}); 0: a recording as it is"
    sub.takes("--hold SECONDS", words, parsed("hold"))
    words = "samples per second, of a log without times or in place of its times"
    sub.takes("--rate HZ", words, parsed("rate"))
    sub.takes("--episodes N,…", "episodes of a data set that are taken: 0,3,…; all where not given")
    words = "LeRobot's calibration of the leader and of the follower, or of the follower"
    sub.takes("--ranges FILE,…", words)
    sub.takes("--labels COLUMN=TEXT,…", "columns with one text in every row: surface=table")
    sub.takes("--skip-bad-rows", "leave out rows with some channels and not others")
    sub.shares("force")


@_of(verbs.completion)
def _completion(sub: Verb) -> None:
    sub.takes("shell", "shell that runs the script", choices=SHELLS)
