"""A leader and the follower that copies it: what a recording of both says, and its mechanism.

Positions in percent of a calibrated range hide how far the joint turns; the step of the values
tells how many steps of the encoder the range has. A value at the end of its range is a clamp.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from rsicalib.arrays import FloatArray
from rsicalib.imports.asked import Asked, chosen
from rsicalib.imports.log import Session
from rsicalib.imports.stretches import Recording, session_of

LEADER, FOLLOWER = "leader_", "follower_"

POSITION = ".pos"
"""What the name of a position ends with, where names say what they are: a base has `x.vel`."""

FULL = 100.0
"""Percent at the end of a range."""

MOST_TICKS = 1 << 14
"""Encoders of such arms have 12 to 14 bits a turn."""

TURN = 2 * np.pi / 4096
"""What a tick turns where an encoder has 12 bits [rad]."""

DEGREES = 4095.0
"""Steps of a turn where an arm writes degrees: 360° are so many."""

CLOSE = 0.05
"""Of a step: so near to whole steps is no chance for ten values and all numbers of ticks."""

ENOUGH = 10
"""Values of which the step can be told."""

FARTHEST = 30
"""Rows by which a follower may lag."""


@dataclass(frozen=True)
class Teleop:
    """Recordings of a leader and its follower.

    Attributes
    ----------
    source : str
        What messages call it.
    joints : tuple of str
        Joints that both have.
    recordings : sequence of Recording
        One for each episode: channels `leader_JOINT` and `follower_JOINT`, in any order.
    rate : float or None
        Rows in a second.
    ranges : mapping of str to int
        Ticks of the range of a channel, where a calibration file says them.
    """

    source: str
    joints: tuple[str, ...]
    recordings: Sequence[Recording]
    rate: float | None
    ranges: Mapping[str, int]

    def sessions(self, asked: Asked) -> tuple[tuple[Session, ...], str | None, list[str]]:
        """Sessions, mechanism and what was found.

        Parameters
        ----------
        asked : Asked
            A recording stays one unless it is asked otherwise: motion shows lag and sag.

        Returns
        -------
        tuple of Session, str or None, list of str
            Rows with a clamped joint are left out.
        """
        names = self.recordings[0].names
        places = chosen(asked.channels, names, self.source, "joint")
        parts = [
            Recording(
                tuple(places), r.values[:, list(places.values())], r.time_s, r.lines, None, r.name
            )
            for r in self.recordings
        ]
        for part in parts:
            part.refuse_beyond(f"{self.source}, {part.name}" if part.name else self.source)
        values = np.concatenate([part.values for part in parts])
        arms = [k for k, name in enumerate(places.values()) if not _is_gripper(names[name])]
        unit, steps, findings = self._unit(values, [names[k] for k in places.values()], arms)
        if unit == "percent":
            clamped = [np.greater_equal(abs(part.values[:, arms]), FULL) for part in parts]
            counts = np.concatenate(clamped).sum(axis=0)
            for count, k in zip(counts.tolist(), arms, strict=True):
                if count:
                    findings.append(
                        f"{names[list(places.values())[k]]} is clamped at the end of its range in "
                        f"{count} of {len(values)} rows: they say nothing, and are left out"
                    )
            parts = [_kept(p, ~np.any(c, axis=1)) for p, c in zip(parts, clamped, strict=True)]
        parts = [part for part in parts if len(part.lines)]
        made = [session_of(part, asked, self.source, hold=0.0) for part in parts]
        findings += [f"{s.name}: {n}" if s.name else n for s, notes in made for n in notes]
        text = None
        if asked.channels is None and self.joints:
            findings += self._lag()
            text = self._mechanism(unit, steps)
        return tuple(session for session, _ in made), text, list(dict.fromkeys(findings))

    def _unit(
        self, values: FloatArray, names: list[str], arms: list[int]
    ) -> tuple[str, dict[str, int], list[str]]:
        """Unit of the positions, ticks of each range, and how both were told."""
        found = {names[k]: ticks(values[:, k]) for k in arms}
        known = {name: count for name, count in found.items() if count is not None}
        degrees = round(2 * FULL * DEGREES / 360.0)  # what degrees look like, taken as percent,
        turned = {degrees, 2 * degrees}  # from the middle of a range, which may be half a step
        inside = bool((np.abs(values) <= FULL).all())
        if inside and known and not turned.issuperset(known.values()):
            said = ", ".join(f"{name} {count}" for name, count in known.items())
            findings = [
                f"percent of a range; ticks of the ranges by the step of the values: {said}"
            ]
            for name, count in self.ranges.items():
                if known.get(name, count) != count:
                    findings.append(
                        f"{name}: the calibration file says {count} ticks, the values "
                        f"{known[name]}: they were recorded under another calibration"
                    )
            return "percent", {**known, **self.ranges}, findings
        if inside and self.ranges:
            return "percent", dict(self.ranges), ["percent of the ranges that the file says"]
        if np.abs(values[:, arms]).max(initial=0.0) <= 2 * np.pi:
            return "rad", {}, ["positions are taken as rad: none is beyond a turn"]
        return "deg", {}, ["positions are taken as degrees"]

    def _lag(self) -> list[str]:
        """By how many rows the follower is behind, by its least distance from the leader."""
        names = list(self.recordings[0].names)
        a = [names.index(LEADER + joint) for joint in self.joints]
        b = [names.index(FOLLOWER + joint) for joint in self.joints]
        spread = []
        for shift in range(FARTHEST):
            parts = [
                r.values[shift:, b] - r.values[: len(r.values) - shift, a]
                for r in self.recordings
                if len(r.values) > FARTHEST
            ]
            if not parts:
                return []
            spread.append(float(np.concatenate(parts).std(axis=0).sum()))
        rows = int(np.argmin(spread))
        if not rows:
            return []
        time = "" if self.rate is None else f" ({rows / self.rate:.2g} s)"
        return [
            f"the follower is {rows} rows{time} behind the leader: trace names the delay where "
            "rows have times; rsicalib import --hold 0.5 takes stretches in which both are still"
        ]

    def _mechanism(self, unit: str, steps: Mapping[str, int]) -> str:
        """Mechanism file: joint by joint the follower is where the leader is."""
        arms = [joint for joint in self.joints if not _is_gripper(joint)]
        limits = f", range = [{-FULL:g}, {FULL:g}]" if unit == "percent" else ""
        out = [
            "# A follower that copies its leader, joint by joint. The leader is the reference.\n",
            *(
                f"# {name}: {count} ticks in its range, {count * TURN / 200:.6g} rad a percent\n"
                for name, count in steps.items()
            ),
            'name = "leader and follower"\nlength_unit = "m"\nchannel = [\n',
        ]
        for joint in arms:
            for side in (LEADER, FOLLOWER):
                out.append(
                    f'  {{name = "{side}{joint}", unit = "{unit}", gain = 1.0, '
                    f"offset = 0.0{limits}}},\n"
                )
        out.append("]\nclosure = [\n")
        for joint in arms:
            between = f'"{LEADER}{joint}", "{FOLLOWER}{joint}"'
            out.append(f'  {{name = "{joint}", kind = "equal", between = [{between}]}},\n')
        out.append("]\n\n[model]\nterms = [\n")
        out += [f'  "offset@{FOLLOWER}{j}", "gain@{FOLLOWER}{j}",\n' for j in arms]
        return "".join([*out, "]\n"])


def _kept(recording: Recording, keep: np.ndarray) -> Recording:
    time = None if recording.time_s is None else recording.time_s[keep]
    names, name = recording.names, recording.name
    return Recording(names, recording.values[keep], time, recording.lines[keep], None, name)


def _is_gripper(name: str) -> bool:
    """A gripper closes on what it holds: it is not where its leader is."""
    return "gripper" in name


def short_names(names: Sequence[str]) -> list[str]:
    """Joints by the names that recent and earlier data sets share: `main_elbow.pos` is `elbow`."""
    return [name.removesuffix(POSITION).removeprefix("main_") for name in names]


def ticks(percent: FloatArray) -> int | None:
    """Steps of an encoder in the range of which values are the percent; None where it is open.

    The least number of steps for which all values lie on whole steps.

    Examples
    --------
    >>> import numpy as np
    >>> ticks(np.arange(0, 2612, 7) / 2612 * 200 - 100)
    2612
    """
    inside = np.unique(percent[np.abs(percent) < FULL]) + FULL
    if len(inside) < ENOUGH:
        return None
    least = (1.0 - 2.0 * CLOSE) * 2 * FULL / np.diff(inside).min()  # no two values share a step
    count = np.arange(int(np.ceil(least)), MOST_TICKS)
    for value in inside.tolist():
        at = value * count / (2 * FULL)
        count = count[np.abs(at - np.rint(at)) < CLOSE]
    return int(count[0]) if count.size else None
