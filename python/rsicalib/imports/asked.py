"""What is asked of an import, the same for every format, and how columns become channels."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

from rsicalib.errors import InputError

HOLD = 0.5
"""A pose is held for so long [s], unless it is asked otherwise: less is a turning point."""


@dataclass(frozen=True)
class Needs:
    """What a mechanism needs of a log beside its channels, and the units of those.

    `own` are the columns of each closure, without which it does not hold in a row.
    """

    columns: tuple[str, ...] = ()
    texts: tuple[str, ...] = ()
    units: Mapping[str, str] = field(default_factory=dict)
    own: tuple[tuple[str, ...], ...] = ()


@dataclass(frozen=True)
class Asked:
    """Options of an import; a format uses those that mean something for it.

    Attributes
    ----------
    channels : mapping of str to str, or None
        Name in the log of each channel; None takes all that the log has.
    topic, when : str, optional
        Of ROS: where the joint states are, and the condition under which there is contact.
    hold : float, optional
        For how long a stretch must be still to be a held pose [s]; 0 for a recording.
    rate : float, optional
        Samples per second of a log without times, or in place of its times.
    episodes : tuple of int, optional
        Of a data set: only these.
    ranges : tuple of str
        Of LeRobot: calibration files, of the leader and of the follower.
    skip_bad_rows : bool
        Leave out rows that cannot be used, and count them.
    labels : mapping of str to str
        Text columns with the same entry in each row: `group`, `at`, `surface`.
    beside : mapping of str to str
        Of a table: name in the log of columns that are no channels: `at`, `temperature_c`.
    needs : Needs
        What the mechanism needs.
    joints : tuple of str
        Channels that are looked for by the names of their joints: a table may have their own.
    """

    channels: Mapping[str, str] | None = None
    topic: str | None = None
    when: str | None = None
    hold: float | None = None
    rate: float | None = None
    episodes: tuple[int, ...] | None = None
    ranges: tuple[str, ...] = ()
    skip_bad_rows: bool = False
    labels: Mapping[str, str] = field(default_factory=dict)
    beside: Mapping[str, str] = field(default_factory=dict)
    needs: Needs = field(default_factory=Needs)
    joints: tuple[str, ...] = ()


def chosen(
    channels: Mapping[str, str] | None, known: Sequence[str], source: str, what: str = "column"
) -> dict[str, int]:
    """Place of each channel among the names of a log.

    A name is one of the log's, or its part between slashes, without `position`: a plot of
    `/joint_states/elbow/position` is found as `elbow`.

    Raises
    ------
    InputError
        A name is not there, or is that of several.
    """
    if channels is None:
        return {name: place for place, name in enumerate(known)}
    places = {}
    for channel, name in channels.items():
        fits = [k for k, one in enumerate(known) if one == name]
        fits = fits or [k for k, one in enumerate(known) if short(one) == name]
        if len(fits) != 1:
            found = f"no {what} {name!r}" if not fits else f"{len(fits)} of this name"
            hint = f"Those of the log: {', '.join(known)[:300]}."
            if what == "column" and len(known) == 1:
                hint += " Commas, semicolons or tabs stand between cells: other marks part nothing."
            else:
                hint += " Say which is which by rsicalib import --channels CHANNEL=NAME,…"
            expected = f"one {what} for {channel!r}"
            raise InputError.at(source, found, expected, column=name, hint=hint, column_word=what)
        places[channel] = fits[0]
    return places


def short(name: str) -> str:
    """The joint in the path of a plotted series."""
    parts = [p for p in name.replace(".", "/").split("/") if p]
    while len(parts) > 1 and parts[-1] in ("position", "pos", "value"):
        parts.pop()
    return parts[-1] if parts else name
