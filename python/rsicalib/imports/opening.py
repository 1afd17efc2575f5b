"""The one way in for logs of other programs: `import_log`."""

from __future__ import annotations

import os
from collections.abc import Mapping, Sequence
from typing import Any

from rsicalib._core import Mechanism
from rsicalib.errors import InputError
from rsicalib.imports.asked import Asked, Needs
from rsicalib.imports.kinds import KINDS, format_of, is_table, whole_of
from rsicalib.imports.log import Log
from rsicalib.io.cells import COLUMNS
from rsicalib.io.extras import wrapped
from rsicalib.options import checked
from rsicalib.plain_text import meant


@checked
def import_log(
    source: str | os.PathLike[str],
    *,
    format: str | None = None,
    mechanism: str | os.PathLike[str] | Mapping[str, Any] | Mechanism | None = None,
    channels: Mapping[str, str] | None = None,
    topic: str | None = None,
    when: str | None = None,
    hold: float | None = None,
    rate: float | None = None,
    episodes: Sequence[int] | None = None,
    ranges: Sequence[str | os.PathLike[str]] = (),
    labels: Mapping[str, str] | None = None,
    skip_bad_rows: bool = False,
) -> Log:
    """Read the log of another program: a serial log, a configuration, a bag, a data set.

    Parameters
    ----------
    source : path
        A file or a folder.
    format : str, optional
        A key of `rsicalib.imports.kinds.KINDS`; told from the source where not given.
    mechanism : str, path or mapping, optional
        Whose channels are taken; where its chains are given as URDF, by the names of their joints.
    channels : mapping of str to str, optional
        Name in the log of each channel, `{"q1": "panda_joint1"}`; all that the log has where
        neither this nor a mechanism is given. Of a table also that of any other column of readings,
        `{"at": "socket"}`; those that bear their own name are taken as they are.
    topic : str, optional
        Of ROS: where the joint states are.
    when : str, optional
        Of ROS: only rows under a condition, `/wrench.force.z>2`.
    hold : float, optional
        For how long a stretch must be still to be a held pose [s]; 0 takes the recording as it is.
    rate : float, optional
        Samples per second of a log without times, or in place of its times.
    episodes : sequence of int, optional
        Of a data set: only these; all where not given.
    ranges : sequence of path, optional
        Of LeRobot: calibration files of the leader and of the follower, or of the follower alone.
    labels : mapping of str to str, optional
        Columns with one text in every row: `{"surface": "table"}`.
    skip_bad_rows : bool, optional
        Leave out rows with some channels and not others, and count them.

    Returns
    -------
    Log
        Its `sessions`, the text of a `mechanism` where the log has one, and `findings`.

    Raises
    ------
    InputError
        The log cannot be used; the message says file, line or message, what was found and what
        was expected. Nothing is repaired.
    """
    name = os.fsdecode(source)
    if format is None:
        format = format_of(name)
        if format is None and whole_of(name) is None and is_table(name):
            format = "columns"
        if format is None:
            found, expected, hint = _unknown(name)
            raise InputError.at(name, found, expected, hint=hint)
    elif format not in KINDS:
        found = f"no format {format!r}{meant(format, KINDS)}"
        expected = f"one of {', '.join(KINDS)}"
        raise InputError.at(name, found, expected)
    given = {"topic": topic, "when": when, "rate": rate, "episodes": episodes, "ranges": ranges}
    useless = [k for k, v in given.items() if v and k not in KINDS[format].takes.split()]
    if useless:
        expected = f"one of: {KINDS[format].takes or 'none'}"
        raise InputError(f"{useless[0]}: found it for a {KINDS[format].words}, expected {expected}")
    joints = None if mechanism is None else joints_of(mechanism)
    needs = Needs() if mechanism is None else _needs_of(mechanism)
    beside: dict[str, str] = {}
    if format == "columns" and channels is not None:
        others = {*COLUMNS, *needs.columns} - {*(joints or ())}
        beside = {name: other for name, other in channels.items() if name in others}
        channels = {n: o for n, o in channels.items() if n not in beside} or None
    asked = Asked(
        channels=_wanted(joints, channels),
        topic=topic,
        when=when,
        hold=hold,
        rate=rate,
        episodes=None if episodes is None else tuple(episodes),
        ranges=tuple(map(os.fsdecode, ranges)),
        skip_bad_rows=skip_bad_rows,
        labels=dict(labels or {}),
        beside=beside,
        needs=needs,
        joints=tuple(name for name in joints or () if name not in (channels or {})),
    )
    return KINDS[format].read(name, asked)


def _unknown(name: str) -> tuple[str, str, str]:
    """What is wrong with a source of no known kind: found, expected, and what to do."""
    if not os.path.exists(name):
        return "no such file", "the log of another program", ""
    hint = wrapped(name)
    if hint:
        return "no log of a known kind", "the log of another program", hint
    expected = f"one of: {', '.join(f'{k} ({f.words})' for k, f in KINDS.items())}"
    whole = whole_of(name)
    if whole is not None:
        return "a part of a LeRobot data set", f"its folder, {whole}", ""
    if os.path.isfile(name) and not os.path.getsize(name):
        return "an empty file", expected, ""
    hint = "A table needs a header line, and commas, semicolons or tabs between its cells."
    return "no log of a known kind", expected, hint


def joints_of(mechanism: str | os.PathLike[str] | Mapping[str, Any] | Mechanism) -> dict[str, str]:
    """Name in a log of each channel: that of its joint where its chain is given as URDF.

    Parameters
    ----------
    mechanism : str, path, mapping or Mechanism
        As it was given: a Mechanism no longer knows the names of joints.

    Returns
    -------
    dict of str to str
        By channel, in their order.
    """
    from rsicalib.io.mechanisms import load_mechanism, mechanism_document  # few need it

    if isinstance(mechanism, Mechanism):
        return {channel.name: channel.name for channel in mechanism.channels}
    loaded = load_mechanism(mechanism)
    chains = mechanism_document(mechanism)[1].get("chain", [])
    tables = [c["channels"] for c in chains if isinstance(c, dict) and "urdf" in c]
    joints = {channel: joint for table in tables for joint, channel in table.items()}
    return {channel.name: joints.get(channel.name, channel.name) for channel in loaded.channels}


def _needs_of(mechanism: str | os.PathLike[str] | Mapping[str, Any] | Mechanism) -> Needs:
    from rsicalib.io.mechanisms import load_mechanism  # few need it

    loaded = mechanism if isinstance(mechanism, Mechanism) else load_mechanism(mechanism)
    texts = tuple(loaded.key_columns)
    units = {channel.name: channel.unit for channel in loaded.channels}
    own = tuple(map(tuple, loaded.own_columns))
    return Needs((*texts, *loaded.value_columns), texts, units, own)


def _wanted(
    joints: Mapping[str, str] | None, channels: Mapping[str, str] | None
) -> Mapping[str, str] | None:
    """Name in the log of each channel that is asked for."""
    if joints is None:
        return channels
    given = dict(channels or {})
    unknown = [name for name in given if name not in joints]
    if unknown:
        expected = f"one of {', '.join(joints)}"
        found = f"no channel {unknown[0]!r}{meant(unknown[0], joints)}"
        raise InputError(f"channels: found {found}, expected {expected}")
    return {**joints, **given}
