"""The verbs: each takes the parsed arguments, and returns the exit code.

A verb imports what it alone needs: a command that calibrates does not wait for the others.
"""

from __future__ import annotations

import argparse
import contextlib
import json
import os
import sys
from collections.abc import Callable, Iterable
from pathlib import Path
from typing import Any, TypeAlias, TypeVar

from rsicalib import _core
from rsicalib.cli.completion import script
from rsicalib.cli.interruption import interruptible
from rsicalib.cli.output import prepare, show, warn
from rsicalib.cli.progress import progress_of
from rsicalib.cli.streams import columns_of, emit, folded, say
from rsicalib.errors import InputError, UndeterminedError
from rsicalib.facts.records import plain, to_json
from rsicalib.io.folders import EXPORT, IMPORT, MARK, write_folder
from rsicalib.plain_text import meant, printable

Args: TypeAlias = argparse.Namespace

T = TypeVar("T")

ALARMED = 4
"""Exit code of a watch that raised an alarm."""


def calibrate(args: Args) -> int:
    """Parameters from joint readings alone: estimates, uncertainty, adequacy."""
    from rsicalib import api

    prepare(args)
    _with_logs(args)
    options = {**_session(args), "method": args.method, "seed": args.seed}
    return show(args, _heard(args, lambda line: api.calibrate(args.readings, **options, **line)))


def trace(args: Args) -> int:
    """Close the loop: residual, missing term, error before and after."""
    from rsicalib import api

    prepare(args)
    _with_logs(args)
    options = {**_session(args), "without": args.without, "seed": args.seed}
    options["apply_all"] = args.apply_all
    return show(args, _heard(args, lambda line: api.trace(args.readings, **options, **line)))


def import_(args: Args) -> int:
    """Logs of other programs as readings: Maslow4, Klipper, LeRobot, ROS, ALOHA, CSV, Parquet."""
    from rsicalib.imports.opening import import_log
    from rsicalib.report.recording import recording_figure

    names = "format mechanism channels topic when hold rate episodes ranges labels"
    names += " skip_bad_rows"
    options = {name: getattr(args, name) for name in names.split()}
    log = import_log(args.source, **options)
    files = log.files()
    figure = recording_figure(log)
    if figure is not None:
        files["recording.svg"] = f"{figure.svg()}<!-- {MARK} -->\n"
    written = write_folder(args.out, files, seal=IMPORT, force=args.force)
    if args.json:
        emit(to_json(log.to_dict()))
    elif not args.quiet:
        say("\n".join([log.text(), "", *sorted(map(str, written))]))
    return 0


def export(args: Args) -> int:
    """A result for others: URDF, MJCF, Maslow4, Klipper, LeRobot, ROS 2, C, corrected readings."""
    from rsicalib.exports.opening import export_result, sealed

    options = {name: getattr(args, name) for name in ("readings", "base")}
    files = export_result(args.result, args.to, args.mechanism, **options)
    if args.out is not None:
        made = sealed(files, args.to)
        written = write_folder(args.out, made, seal=EXPORT, force=args.force)
        if args.json:
            emit(str(made[EXPORT]))
        elif not args.quiet:
            say("\n".join(map(str, written)))
        return 0
    texts = [content for content in files.values() if isinstance(content, str)]
    if args.json or len(texts) < len(files):
        raise InputError(f"out: found none, expected a folder for {', '.join(files)} (--out)")
    emit("\n".join(texts))
    return 0


def fixture(args: Args) -> int:
    """Open loop, from known poses in the readings."""
    from rsicalib import api

    prepare(args)
    names = "mechanism check align skip_bad_rows device note date"
    options = {name: getattr(args, name) for name in names.split()}
    return show(args, _heard(args, lambda _: api.fixture(args.readings, **options)))


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

    mechanism = api.load_mechanism(args.mechanism)
    readings = readings_for(args.readings, mechanism, args.skip_bad_rows)
    warn(args, readings.warnings)
    result = None
    if args.calibration is not None:
        result, mechanism = earlier_result(args.calibration, mechanism)
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

    names = "mechanism poses samples noise seed force"
    options = {name: getattr(args, name) for name in names.split()}
    options["check"] = args.check_poses
    made = _heard(args, lambda _: simulate_device(args.out, **options), "simulate")
    if args.json:
        emit(to_json(made.truth))
    elif not args.quiet:
        say("\n".join(sorted(str(path) for path in args.out.iterdir())))
    return 0


def plan(args: Args) -> int:
    """Which poses to visit."""
    from rsicalib import api
    from rsicalib.planning.plan import plan as plan_poses
    from rsicalib.report.poses import poses_html

    mechanism = api.load_mechanism(args.mechanism)
    warn(args, mechanism.doubts)
    found = _heard(
        args,
        lambda _: plan_poses(
            mechanism,
            args.poses,
            target=args.target,
            result=args.result,
            beside=args.beside,
            noise=args.noise,
            criterion=args.criterion,
            calibration=args.calibration,
            off=args.off,
            seed=args.seed,
        ),
        "choose poses",
    )
    if args.out is not None:
        brings = [("", list(found.advice)), *found.brings()]
        shown = found.mechanism, found.length_unit, found.csv(), brings, found.poses
        page = f"{poses_html(*shown)}<!-- {MARK} -->\n"
        files = {args.out.name: found.csv(), args.out.with_suffix(".html").name: page}
        write_folder(args.out.parent, files, force=args.force)
    if args.json:
        head = {"format": "rsicalib.plan/1", "version": _core.__version__}
        emit(to_json({**head, **found.to_dict()}))
    elif not args.quiet:
        say(found.text().removesuffix("\n"))
    return 0


def guide(args: Args) -> int:
    """Take a session: which pose next, how good already, when done (page and terminal)."""
    from rsicalib.guide.run import guide as take_session
    from rsicalib.guide.server import LOCAL
    from rsicalib.guide.square import square

    def told(url: str) -> None:
        if not args.quiet:
            print(f"the page of this session: {url}", file=sys.stderr, flush=True)
            if args.host not in LOCAL:
                print(square(url), file=sys.stderr, flush=True)

    found = take_session(
        args.out,
        args.mechanism,
        rest=args.rest,
        target=args.target,
        source=args.source,
        drive=args.drive,
        labels=args.labels,
        resume=args.resume,
        port=args.port,
        host=args.host,
        browser=not args.no_browser,
        samples=args.samples,
        seconds=args.seconds,
        seed=args.seed,
        quiet=args.quiet,
        told=told,
    )
    if found is None:
        raise UndeterminedError("the poses so far do not determine the calibration")
    if args.json:
        emit(found.to_json())
    elif not args.quiet:
        say(found.summary(width=columns_of(sys.stdout)))
    return found.exit_code


def fleet(args: Args) -> int:
    """Many devices: a row of results each, and a page with those that stand out."""
    from rsicalib.fleets.run import fleet as calibrate_fleet

    names = "mechanism out by levels terms closures noise trace held_out workers dask resume "
    names += "population time_limit"
    options = {name: getattr(args, name) for name in names.split()}
    options |= {} if args.reports is None else {"reports": args.reports}
    with progress_of(args) or contextlib.nullcontext() as line:
        told = None if line is None else line.counted
        found = calibrate_fleet(args.dataset, **options, progress=told)
    if args.json:
        emit(to_json(found.to_dict()))
    elif not args.quiet:
        say(found.text().removesuffix("\n"))
    return found.exit_code


def suppose(args: Args) -> int:
    """What an effect would do in these poses, and whether they would show it."""
    from rsicalib.planning.supposing import suppose as suppose_effect

    names = "mechanism rest closures noise calibration skip_bad_rows"
    options = {"model": args.terms, **{name: getattr(args, name) for name in names.split()}}
    found = _heard(args, lambda _: suppose_effect(args.readings, args.term, **options))
    if args.out is not None:
        page = {args.out.name: f"{found.report()}<!-- {MARK} -->\n"}
        write_folder(args.out.parent, page, force=args.force)
    if args.json:
        head = {"format": "rsicalib.supposition/1", "version": _core.__version__}
        emit(to_json({**head, **found.to_dict()}))
    elif not args.quiet:
        say(found.text().removesuffix("\n"))
    return 0


def certify(args: Args) -> int:
    """Whether the largest error is within a limit: decision, budget, what would decide it."""
    from rsicalib.verbs.certifying import certify as certify_result

    options = {name: getattr(args, name) for name in ("limit", "confidence", "at")}
    what = "draw the largest error"
    found = _heard(args, lambda _: certify_result(args.result, args.mechanism, **options), what)
    head = {"format": "rsicalib.certificate/1", "version": _core.__version__}
    document = to_json({**head, **found.to_dict()})
    if args.out is not None:
        text = f"{found.text()}\n{MARK} {_core.__version__}\n"
        page = f"{found.report()}<!-- {MARK} -->\n"
        files = {"certificate.json": document, "certificate.txt": text, "certificate.html": page}
        write_folder(args.out, files, force=args.force)
    if args.json:
        emit(document)
    elif not args.quiet:
        say(found.text().removesuffix("\n"))
    return found.exit_code


def paper(args: Args) -> int:
    """Every table of the paper computed again, beside the printed one."""
    from rsicalib.reproduction.page import html
    from rsicalib.reproduction.paper import paper as compute_paper

    with progress_of(args) or contextlib.nullcontext() as line:
        told = None if line is None else line.counted
        found = compute_paper(args.trials, seed=args.seed, progress=told, workers=args.workers)
    if args.out is not None:
        text = f"{found.text()}\n{MARK} {_core.__version__}\n"
        page = f"{html(found)}<!-- {MARK} -->\n"
        files = {"paper.json": to_json(found.to_dict()), "paper.txt": text, "paper.html": page}
        write_folder(args.out, files, force=args.force)
    if args.json:
        emit(to_json(found.to_dict()))
    elif not args.quiet:
        say(found.text().removesuffix("\n"))
    return 0


def history(args: Args) -> int:
    """Parameters of one device against date."""
    from rsicalib.verbs.lifetime import history as history_of

    options = {"device": args.device, "target": args.target}
    what = "read the results"
    found = _heard(args, lambda _: history_of(args.folder, args.mechanism, **options), what)
    if args.out is not None:
        text = f"{found.text()}\n{MARK} {_core.__version__}\n"
        page = f"{found.page()}<!-- {MARK} -->\n"
        files = {"history.json": found.to_json(), "history.txt": text, "history.html": page}
        write_folder(args.out, files, force=args.force)
    if args.json:
        emit(found.to_json())
    elif not args.quiet:
        say(found.text())
        if args.out is not None:
            say(f"\n{args.out / 'history.html'}")
    return 0


def watch(args: Args) -> int:
    """A calibration at work: alarms with what, since when, how large; JSON lines."""
    from rsicalib.verbs.devices import WatchingDevices, watch_devices
    from rsicalib.verbs.monitor import Watching
    from rsicalib.verbs.monitor import watch as watch_device

    chosen = {name: getattr(args, name) for name in ("false_alarms", "state", "follow")}
    given = (args.readings, args.calibration, args.mechanism)
    many = os.path.isdir(args.calibration)
    watching: Watching | WatchingDevices
    watching = watch_devices(*given, **chosen) if many else watch_device(*given, **chosen)
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
    """Completion of verbs and options in your shell: source <(rsicalib completion bash)."""
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


def _with_logs(args: Args) -> None:
    """Read what is a log of another program, and take the mechanism that it brings along."""
    from rsicalib.work.arguments import with_logs

    given = args.mechanism
    args.readings, args.mechanism = with_logs(args.readings, given, args.skip_bad_rows)
    args.brought = None if args.mechanism is given else args.mechanism


def _session(args: Args) -> dict[str, Any]:
    """Options that `calibrate` and `trace` share, by the names they have in Python."""
    names = """mechanism rest check check_point check_noise check_noise_angle terms closures noise
        calibration population align fit_groups hold_out_groups skip_bad_rows device note date"""
    return {name: getattr(args, name) for name in names.split()}
