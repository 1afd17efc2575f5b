"""Running a guided session: the verb `guide`."""

from __future__ import annotations

import os
import time
import webbrowser
from collections.abc import Callable, Mapping
from pathlib import Path

from rsicalib import _core
from rsicalib.errors import InputError
from rsicalib.guide.advice import Adviser
from rsicalib.guide.drive import Robot
from rsicalib.guide.drive import drive as take_by
from rsicalib.guide.log import FITTED, Columns, Log, Sample
from rsicalib.guide.server import HOST, Page
from rsicalib.guide.session import Session, Settings
from rsicalib.guide.source import Lines, open_source
from rsicalib.guide.terminal import Screen
from rsicalib.imports.opening import joints_of
from rsicalib.options import checked
from rsicalib.plain_text import counted, meant
from rsicalib.poses.devices import workspace
from rsicalib.results.result import Trace
from rsicalib.work.arguments import Bare, MechanismArg, PathLike, ReadingsArg, load, open_mechanism

TRAVEL = 0.01
"""Share of the travel that is the target where none is given, as the paper specifies."""
HEARD_S = 0.6
"""In which a page asks for the state at least once."""
SHOW_S = 0.15
"""Between two pictures on a terminal."""


@checked
def guide(
    out: PathLike,
    mechanism: MechanismArg = "rsi",
    *,
    rest: ReadingsArg | None = None,
    target: float | None = None,
    source: str = "-",
    drive: str | None = None,
    labels: Mapping[str, str] | None = None,
    resume: bool = False,
    port: int | None = 0,
    host: str = HOST,
    browser: bool = False,
    samples: int = 8,
    seconds: float = 0.6,
    seed: int = 0,
    quiet: bool = False,
    told: Callable[[str], None] | None = None,
) -> Trace | None:
    """Guide a person at the handle, or a robot: which pose next, how good already, when done.

    Parameters
    ----------
    out : path
        Folder of the session: `samples.csv` has every sample, `readings.csv` the poses that are
        fitted, `held_out.csv` those that are kept out, `result.json` the trace so far, and
        `session.csv` what it is a trace of.
    mechanism : str, path or Mechanism
        With a platform, or with a target.
    rest : path or Readings, optional
        A reading of the rest pose: what the sensors are known by at first.
    target : float, optional
        Standard deviation of the platform to reach [length unit]; 1 % of the travel by default.
    source : str
        Where samples come from, as lines of CSV with a header: `-` for standard input, a file that
        grows, or a command; or as lines of JSON, or messages that `ros2 topic echo` prints.
    drive : str, optional
        A command that moves the robot. It is told each pose as a line of JSON, and answers with a
        line of JSON that has its readings; see `docs/guide.md`.
    labels : mapping of str to str, optional
        Columns with one text in every sample, where the source has none: `{"at": "cone"}`.
    resume : bool
        Go on with the session in `out`.
    port : int or None
        Of the page; 0 for a free one, None for no page.
    host : str
        Address of the page: of this machine alone, where not given. Another one, as 0.0.0.0 for a
        tablet in the same network, is reached with a token that is part of the page's address.
    browser : bool
        Open the page in a browser.
    samples : int
        Samples of each pose.
    seconds : float
        For which a pose is held [s].
    seed : int
        Of the candidates.
    quiet : bool
        Nothing on the terminal.
    told : callable, optional
        Is called with the address of the page.

    Returns
    -------
    Trace or None
        The last result; None where the poses did not determine one.

    Raises
    ------
    InputError
        The folder, the source, the port or a number cannot be used.
    """
    opened = open_mechanism(mechanism)
    drawing = opened.to_dict()
    if target is None:
        if not drawing.get("platform"):
            found = f"mechanism {opened.name!r} without a platform, and no target"
            raise InputError(f"guide: found {found}, expected the standard deviation to reach")
        bounds = workspace(opened, None)[:3]
        target = TRAVEL * float((bounds[:, 1] - bounds[:, 0]).max())
    at_rest = None if rest is None else load(rest, Bare(opened), False, "rest")
    names = [c.name for c in opened.channels]
    keys = opened.key_columns
    unknown = [name for name in labels or {} if name not in keys]
    if unknown:
        expected = f"one of {', '.join(keys)}" if keys else "none: the mechanism needs no texts"
        raise InputError(
            f"labels: found {unknown[0]!r}{meant(unknown[0], keys)}, expected {expected}"
        )
    if drive is not None and source != "-":
        raise InputError(f"--drive: found --source {source} beside it, expected one of the two")
    log = Log(Path(os.fspath(out)), names, resume, keys, _core.needed_poses(opened) or FITTED)
    lines = open_source(source) if drive is None else None
    robot = None if drive is None else Robot(drive, opened, samples)
    session = Session(
        opened,
        Adviser(opened, at_rest, seed),
        log,
        Settings(target, samples, seconds, alone=drive is not None),
    )
    acts = {"strike-off": session.strike_off, "take-over": session.take_over}
    page = None if port is None else Page(session.state, acts, port, host)
    try:
        if page is not None:
            if told is not None:
                told(page.url)
            if browser:
                webbrowser.open(page.url)
        screen = Screen(quiet=quiet)
        if robot is not None:
            take_by(session, robot, screen.show)
        elif lines is not None:
            skip = len(log.samples) if resume and os.path.exists(source) else 0
            _measure(session, lines, Columns(joints_of(mechanism), keys, labels), screen, skip)
        result = session.finish()
        if page is not None:
            time.sleep(HEARD_S)  # the page hears of the end
        return result
    finally:
        for one in (lines, robot):
            if one is not None:
                one.close()
        if page is not None:
            page.close()


def _measure(session: Session, lines: Lines, columns: Columns, screen: Screen, skip: int) -> None:
    """Take samples until the session is done, or the source ends."""
    began = time.time()
    shown = 0.0
    while not session.done:
        arrived: list[Sample] = []
        for line in lines.take(0.02 if session.busy else 0.1):
            found = columns.sample(line, time.time() - began)
            if isinstance(found, str):
                session.bad_lines += 1
                session.bad_line = found
            elif found is not None and skip > 0:
                skip -= 1  # read before
            elif found is not None:
                arrived.append(found)
        # A long backlog is taken in parts, so that poses are advised on in their turn.
        for first in range(0, len(arrived), 50):
            session.feed(arrived[first : first + 50])
            session.poll()
        advised = session.poll()
        if screen.live and time.time() - shown < SHOW_S and not advised:
            continue
        shown = time.time()
        screen.show(session.state())
        if lines.ended and not session.busy:
            _refuse_without_samples(session)
            session.ended = "the samples have ended"
            break
    screen.show(session.state())


def _refuse_without_samples(session: Session) -> None:
    """Refuse a source that has ended, and of whose lines none was a sample."""
    if session.bad_lines and not session.log.samples:
        found = f"{counted(session.bad_lines, 'line')} and no sample ({session.bad_line})"
        raise InputError(f"--source: found {found}, expected a header and a sample on each line")
