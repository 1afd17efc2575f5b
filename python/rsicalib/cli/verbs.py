"""The verbs: each takes the parsed arguments, and returns the exit code.

A verb imports what it alone needs: a command that calibrates does not wait for the others.
"""

from __future__ import annotations

import argparse
import contextlib
import inspect
import json
import os
import sys
from collections.abc import Callable, Iterable
from pathlib import Path
from typing import Any, TypeAlias, TypeVar

from rsicalib import _core
from rsicalib.cli.completion import script
from rsicalib.cli.interruption import interruptible
from rsicalib.cli.output import prepare, prepare_file, show, summary_of, warn
from rsicalib.cli.progress import progress_of
from rsicalib.cli.streams import columns_of, emit, folded, say
from rsicalib.errors import InputError, UndeterminedError
from rsicalib.facts.records import Record, plain, to_json
from rsicalib.io.folders import EXPORT, IMPORT, MARK, TRUTH, write_folder
from rsicalib.plain_text import meant, printable

Args: TypeAlias = argparse.Namespace

T = TypeVar("T")

ALARMED = 4
"""Exit code of a watch that raised an alarm."""

UNUSABLE = 2
"""Exit code of input of which nothing can be used."""


def calibrate(args: Args) -> int:
    """Parameters from joint readings alone: estimates, uncertainty, adequacy."""
    from rsicalib.verbs import calibration

    return _identified(args, calibration.calibrate)


def trace(args: Args) -> int:
    """Close the loop: residual, missing term, error before and after."""
    from rsicalib.verbs import tracing

    return _identified(args, tracing.trace)


def import_(args: Args) -> int:
    """Logs of other programs as readings: Maslow4, Klipper, LeRobot, ROS, ALOHA, CSV, Parquet."""
    from rsicalib.imports.opening import import_log
    from rsicalib.report.recording import recording_figure

    log = _heard(args, lambda _: import_log(**_given(args, import_log)), "read the log")
    files = log.files()
    figure = recording_figure(log)
    if figure is not None:
        files["recording.svg"] = f"{figure.svg()}<!-- {MARK} -->\n"
    written = write_folder(args.out, files, seal=IMPORT, force=args.force)
    text = "\n".join([log.text(), "", *sorted(map(str, written))])
    return _told(args, to_json(log.to_dict()), text)


def export(args: Args) -> int:
    """A result for others: URDF, MJCF, Maslow4, Klipper, LeRobot, ROS 2, C, corrected readings."""
    from rsicalib.exports.opening import export_result, sealed

    given = _given(args, export_result)
    files = _heard(args, lambda _: export_result(args.result, **given), "export the result")
    if args.out is not None:
        made = sealed(files, args.to)
        written = write_folder(args.out, made, seal=EXPORT, force=args.force)
        return _told(args, str(made[EXPORT]), "\n".join(map(str, written)))
    texts = [content for content in files.values() if isinstance(content, str)]
    # Several files in one stream are none of them.
    if args.json or len(texts) != 1 or len(files) > 1:
        raise InputError(f"out: found none, expected a folder for {', '.join(files)} (--out)")
    emit(texts[0])
    return 0


def fixture(args: Args) -> int:
    """Open loop, from known poses in the readings."""
    from rsicalib.verbs.open_loop import fixture as by_fixture

    prepare(args)
    return show(args, _heard(args, lambda _: by_fixture(**_given(args, by_fixture))))


def demo(args: Args) -> int:
    """The main job on data that come with the package; writes a report, prints its path."""
    from rsicalib import api

    if args.out is None:
        args.out = Path("rsicalib-demo")
    prepare(args)
    return show(args, _heard(args, lambda line: api.demo(**line)))


def forward(args: Args) -> int:
    """Readings to platform poses under a calibration, CSV on standard output."""
    import numpy as np

    from rsicalib import api
    from rsicalib.poses.places import places, readings_for
    from rsicalib.work.arguments import earlier_result
    from rsicalib.work.closing import warn_of_open_loops

    drawn = mechanism = api.load_mechanism(args.mechanism)
    result = None
    if args.calibration is not None:  # first: of another mechanism the readings are, too
        result, mechanism = earlier_result(args.calibration, drawn)
    given = (args.readings, drawn, args.skip_bad_rows)
    readings = _heard(args, lambda _: readings_for(*given), "read the readings")
    warn(args, readings.warnings)
    found = _heard(args, lambda _: places(readings, mechanism, result), "place the readings")
    if result is not None:
        warn_of_open_loops(readings, mechanism, result)
    labels: dict[str, Any] = {"pose": readings.pose.tolist()}
    if readings.sample is not None:
        labels["sample"] = readings.sample.tolist()
    if readings.time_s is not None:
        labels["time_s"] = readings.time_s.tolist()
    names, values = list(found.names), found.values
    if any(found.beyond):
        labels["beyond"] = [int(beyond) for beyond in found.beyond]
        rows = f"{sum(found.beyond)} of {len(found.beyond)} rows"
        warn(args, [f"{rows}: beyond the readings at which a curve was seen; it stays at its edge"])
    if found.sd is not None:
        names += [f"sd_{name}" for name in found.names]
        values = np.hstack([values, found.sd])
    if args.json:
        columns = {**labels, **dict(zip(names, values.T, strict=True))}
        document = {"format": "rsicalib.poses/1", "version": _core.__version__}
        document |= {"mechanism": mechanism.name, "length_unit": mechanism.length_unit}
        emit(to_json({**document, "columns": columns}))
        return 0
    digits = [12] * len(found.names) + [3] * (len(names) - len(found.names))
    lines = [",".join([*labels, *names])]
    for head, row in zip(zip(*labels.values(), strict=True), values.tolist(), strict=True):
        cells = (f"{v:.{d}g}" for v, d in zip(row, digits, strict=True))
        lines.append(",".join([*map(str, head), *cells]))
    emit("\n".join(lines) + "\n")
    return 0


def simulate(args: Args) -> int:
    """A device with a known truth: readings, rest and check poses, truth."""
    from rsicalib.poses.simulation import simulate as simulate_device

    made = _heard(args, lambda _: simulate_device(**_given(args, simulate_device)), "simulate")
    text = "\n".join(sorted(str(path) for path in args.out.iterdir()))
    return _told(args, made.files()[TRUTH], text)


def plan(args: Args) -> int:
    """Which poses to visit."""
    from rsicalib import api
    from rsicalib.planning.plan import plan as plan_poses
    from rsicalib.report.poses import poses_html

    sheet = None if args.out is None else args.out.with_suffix(".html")
    if sheet is not None and sheet == args.out:
        expected = "the name of a CSV file: the page is written beside it"
        raise InputError(f"--out: found '{args.out}', expected {expected}")
    if sheet is not None:
        prepare_file(args, sheet.name)
    args.mechanism = api.load_mechanism(args.mechanism)
    warn(args, args.mechanism.doubts)
    found = _heard(args, lambda _: plan_poses(**_given(args, plan_poses)), "choose poses")
    if sheet is not None:
        brings = [("", list(found.advice)), *found.brings()]
        shown = found.mechanism, found.length_unit, found.csv(), brings, found.poses
        page = f"{poses_html(*shown)}<!-- {MARK} -->\n"
        files = {args.out.name: found.csv(), sheet.name: page}
        write_folder(args.out.parent, files, force=args.force)
    return _told(args, _document("rsicalib.plan/1", found), found.text())


def guide(args: Args) -> int:
    """Take a session: which pose next, how good already, when done (page and terminal)."""
    from rsicalib.guide.run import guide as take_session
    from rsicalib.guide.server import LOCAL
    from rsicalib.guide.square import square

    def told(url: str) -> None:
        if not args.quiet:
            print(f"the page of this session: {url}", file=sys.stderr, flush=True)
            if args.host not in (None, *LOCAL):
                print(square(url), file=sys.stderr, flush=True)

    found = take_session(**_given(args, take_session), told=told)
    if found is None:
        raise UndeterminedError("the poses so far do not determine the calibration")
    summary = summary_of(found, args.out, columns_of(sys.stdout))
    return _told(args, found.to_json(), summary, found.exit_code)


def fleet(args: Args) -> int:
    """Many devices: a row of results each, and a page with those that stand out."""
    from rsicalib.fleets.run import fleet as calibrate_fleet

    given = _given(args, calibrate_fleet)
    found = _counted(args, lambda told: calibrate_fleet(**given, progress=told))
    return _told(args, to_json(found.to_dict()), found.text(), found.exit_code)


def suppose(args: Args) -> int:
    """What an effect would do in these poses, and whether they would show it."""
    from rsicalib.planning.supposing import suppose as suppose_effect

    prepare_file(args)
    given = {**_given(args, suppose_effect), "terms": args.term, "model": args.terms}
    found = _heard(args, lambda _: suppose_effect(**given))
    if args.out is not None:
        page = {args.out.name: f"{found.report()}<!-- {MARK} -->\n"}
        write_folder(args.out.parent, page, force=args.force)
    return _told(args, _document("rsicalib.supposition/1", found), found.text())


def certify(args: Args) -> int:
    """Whether the largest error is within a limit: decision, budget, what would decide it."""
    from rsicalib.verbs.certifying import certify as certify_result

    prepare(args, _sheet_names("certificate"))
    given, what = _given(args, certify_result), "draw the largest error"
    found = _heard(args, lambda _: certify_result(**given), what)
    document = _document("rsicalib.certificate/1", found)
    _sheets(args, "certificate", document, found.text(), found.report)
    return _told(args, document, found.text(), found.exit_code)


def paper(args: Args) -> int:
    """Every table of the paper computed again, beside the printed one."""
    from rsicalib.reproduction.page import html
    from rsicalib.reproduction.paper import paper as compute_paper

    prepare(args, _sheet_names("paper"))
    given = _given(args, compute_paper)
    found = _counted(args, lambda told: compute_paper(**given, progress=told))
    document = to_json(found.to_dict())
    _sheets(args, "paper", document, found.text(), lambda: html(found))
    return _told(args, document, found.text())


def history(args: Args) -> int:
    """Parameters of one device against date."""
    from rsicalib.verbs.lifetime import history as history_of

    prepare(args, _sheet_names("history"))
    found = _heard(args, lambda _: history_of(**_given(args, history_of)), "read the results")
    _sheets(args, "history", found.to_json(), found.text(), found.page)
    where = "" if args.out is None else f"\n\n{args.out / 'history.html'}"
    return _told(args, found.to_json(), found.text() + where)


def watch(args: Args) -> int:
    """A calibration at work: alarms with what, since when, how large; JSON lines."""
    from rsicalib.verbs.devices import WatchingDevices, watch_devices
    from rsicalib.verbs.monitor import Watching
    from rsicalib.verbs.monitor import watch as watch_device

    watching: Watching | WatchingDevices
    if os.path.isdir(args.calibration):
        watching = watch_devices(calibrations=args.calibration, **_given(args, watch_devices))
    else:
        watching = watch_device(**_given(args, watch_device))
    # What arrives as it happens takes its time anyway.
    line = None if args.readings == "-" or args.follow else progress_of(args)
    if line is not None:
        watching.heard = line.rows
    in_words = not (args.json or args.quiet)
    # A person who sees both has the words.
    as_data = not (in_words and sys.stdout.isatty() and sys.stderr.isatty())
    with line or contextlib.nullcontext(), contextlib.suppress(KeyboardInterrupt):
        for alarm in watching:
            if line is not None:
                line.clear()
            if as_data:
                emit(json.dumps(plain(alarm), ensure_ascii=False) + "\n")
                sys.stdout.flush()
            if in_words:
                say(alarm.text(), sys.stderr)
    found = watching.summary()
    if args.json:
        emit(json.dumps(plain(found), ensure_ascii=False) + "\n")
    elif not args.quiet:
        say(found.text(), sys.stderr)
    if found.rows and not found.used and not found.alarms:
        return UNUSABLE
    return ALARMED if found.alarms else 0


def terms(args: Args) -> int:
    """What can be identified."""
    from rsicalib import api

    known = {term["id"]: term for term in api.terms(args.mechanism)}
    if args.id is not None and args.id not in known:
        found = f"no term {args.id!r}{meant(args.id, known)}"
        raise InputError(f"found {found}, expected one of {', '.join(known)}")
    if args.json:
        chosen = list(known.values()) if args.id is None else [known[args.id]]
        document = {"format": "rsicalib.terms/1", "version": _core.__version__, "terms": chosen}
        emit(to_json(document))
    elif args.id is None:
        for term in known.values():
            first = term["doc"].split("\n\n")[0].replace("\n", " ")
            say(f"{term['id']:24} {term['class']:12} {first}")
    else:
        term = known[args.id]
        say(f"{term['id']} ({term['class']})\n\n{term['doc'].strip()}\n")
        for parameter in term["parameters"]:
            line = (
                f"  {parameter['name']:8} {parameter['unit']:12} typically {parameter['typical']:g}"
            )
            say(line)
        facts = {
            "needs": term["needs"],
            "place": term["place"],
            "targets": ", ".join(term["targets"]),
        }
        facts["targets"] = facts["targets"] or "none here"
        say("\n" + "\n".join(f"  {name:8} {fact}" for name, fact in facts.items() if fact))
    return 0


def completion(args: Args) -> int:
    """A script for your shell that completes verbs and options."""
    emit(script(args.parser, args.shell))
    return 0


def mechanism(args: Args) -> int:
    """Show a built-in mechanism, or check a file: what it says, and what can be identified."""
    from rsicalib import api
    from rsicalib.io.mechanisms import expansion_notes
    from rsicalib.planning.identifiability import COMPLETE, identifiable

    loaded = api.load_mechanism(args.name)
    warn(args, loaded.doubts)
    models = () if args.quiet else (None, COMPLETE)
    counts = []
    try:
        what = "count what can be known"
        counts = _heard(args, lambda _: [identifiable(loaded, terms) for terms in models], what)
    except InputError as error:
        warn(args, [f"what can be identified is not counted: {error.message}"])
    if args.json:
        counted = {"identifiable": [c.to_dict() for c in counts]} if counts else {}
        emit(to_json({**loaded.to_dict(), **counted}))
        return 0
    emit(_comments(expansion_notes(args.name)))
    emit(loaded.to_toml())
    for count in counts:
        emit("\n" + _comments(count.text().splitlines()))
    return 0


def _comments(lines: Iterable[str]) -> str:
    """Lines as comments of TOML: on a terminal as wide as it is."""
    text = "".join(f"# {printable(line)}\n" for line in lines)
    columns = columns_of(sys.stdout)
    return text if columns is None else folded(text, columns)


def _heard(args: Args, job: Callable[[dict[str, Any]], T], what: str = "fit") -> T:
    """Run a job that Ctrl-C interrupts, with its progress shown to whoever waits."""
    with progress_of(args, what) or contextlib.nullcontext() as line:
        if line is None:
            return interruptible(lambda: job({}))
        return interruptible(lambda: job({"progress": line}), line.tick)


def _counted(args: Args, job: Callable[[Callable[[str, int, int], None] | None], T]) -> T:
    """Run a job that Ctrl-C interrupts, with its counted progress shown to whoever waits."""

    def run(told: dict[str, Any]) -> T:
        line = told.get("progress")
        return job(None if line is None else line.counted)

    return _heard(args, run, "begin")


def _identified(args: Args, verb: Callable[..., Any]) -> int:
    """Calibrate or trace; what is a log of another program is read, with the mechanism it has."""
    from rsicalib.work.arguments import with_logs

    prepare(args)
    own = args.mechanism
    read = lambda _: with_logs(args.readings, own, args.skip_bad_rows)  # noqa: E731
    args.readings, args.mechanism = _heard(args, read, "read the log")
    args.brought = None if args.mechanism is own else args.mechanism
    return show(args, _heard(args, lambda line: verb(**_given(args, verb), **line)))


def _given(args: Args, function: Callable[..., object]) -> dict[str, Any]:
    """The options of a command that a function of Python takes, by the names they have there."""
    given = {name: getattr(args, name, None) for name in inspect.signature(function).parameters}
    return {name: value for name, value in given.items() if value is not None}


def _document(form: str, found: Record) -> str:
    """A record as a document of this format."""
    head = {"format": form, "version": _core.__version__}
    return to_json({**head, **found.to_dict()})


def _sheet_names(stem: str) -> list[str]:
    """The files of `_sheets`: document, text and page."""
    return [f"{stem}.{kind}" for kind in ("json", "txt", "html")]


def _sheets(args: Args, stem: str, document: str, text: str, page: Callable[[], str]) -> None:
    """Write the document, its text and its page, where a folder is asked for."""
    if args.out is not None:
        sheets = document, f"{text}\n{MARK} {_core.__version__}\n", f"{page()}<!-- {MARK} -->\n"
        files = dict(zip(_sheet_names(stem), sheets, strict=True))
        write_folder(args.out, files, force=args.force)


def _told(args: Args, document: str, text: str, code: int = 0) -> int:
    """Print the document with --json, the text unless --quiet; the exit code."""
    if args.json:
        emit(document)
    elif not args.quiet:
        say(text.removesuffix("\n"))
    return code
