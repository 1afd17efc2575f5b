"""A robot that takes a session by itself: it is told each pose, and answers with its readings.

One line of JSON asks, one line of JSON answers. The first asks for the poses that the robot was
taught, one for each thing that it touches; every other one for a pose to go to.
"""

from __future__ import annotations

import json
import math
import subprocess
import time
from collections.abc import Mapping, Sequence
from typing import Any

from rsicalib._core import Mechanism
from rsicalib.arrays import FloatArray
from rsicalib.errors import InputError
from rsicalib.guide.log import Sample
from rsicalib.guide.session import Session
from rsicalib.guide.source import started
from rsicalib.io.sources import LONGEST_LINE

MOST_REFUSED = 30
"""Poses that a robot cannot take one after the other; the session then ends with what it has."""

EXPECTED = 'one line of JSON: {"readings": [{channel: number, …}, …]} or {"cannot": "why"}'


class Robot:
    """The command that moves the robot, and what it has answered."""

    def __init__(self, command: str, mechanism: Mechanism, samples: int) -> None:
        self.mechanism = mechanism
        self.samples = samples
        self.keys = tuple(mechanism.key_columns)
        self.lines = 0
        self._began = time.time()
        try:
            self._process = started(command, subprocess.PIPE)
        except (OSError, ValueError) as error:
            found = f"{command!r}, which cannot be run ({error})"
            raise InputError(f"--drive: found {found}, expected a command") from None

    def taught(self) -> dict[int, list[Sample]]:
        """Poses that the robot was taught, by their labels."""
        answer = self._ask({"pose": 1, "samples": self.samples, "go": None})
        if "readings" not in answer:
            raise self._refused(json.dumps(answer)[:200], "the poses that it was taught")
        out: dict[int, list[Sample]] = {}
        for row in answer["readings"]:
            label = row.get("pose", 1)
            if not isinstance(label, int) or isinstance(label, bool) or label < 1:
                raise self._refused(f"pose {label!r}", "a number of a pose from 1")
            out.setdefault(label, []).append(self._sample(row, ()))
        return out

    def go(self, label: int, goal: FloatArray, keys: Sequence[str], why: str) -> list[Sample] | str:
        """Readings of a pose, or why it cannot be taken."""
        joints = {
            c.name: (float(reading), float(c.offset + c.gain * reading))
            for c, reading in zip(self.mechanism.channels, goal, strict=True)
            if not getattr(c, "passive", False)
        }
        asked = {
            "pose": label,
            "samples": self.samples,
            "go": {name: reading for name, (reading, _) in joints.items()},
            "joints": {name: joint for name, (_, joint) in joints.items()},
            "touch": dict(zip(self.keys, keys, strict=True)),
            "why": why,
        }
        answer = self._ask(asked)
        if "cannot" in answer:
            return str(answer["cannot"])
        return [self._sample(row, keys) for row in answer["readings"]]

    def close(self) -> None:
        """Nothing more is asked: the command ends by itself, or is ended."""
        if self._process.stdin is not None:
            try:
                self._process.stdin.close()
            except OSError:
                pass  # it has gone
        try:
            self._process.wait(timeout=5.0)
        except subprocess.TimeoutExpired:
            self._process.kill()
            self._process.wait()
        if self._process.stdout is not None:
            self._process.stdout.close()

    def _ask(self, message: Mapping[str, Any]) -> dict[str, Any]:
        assert self._process.stdin is not None and self._process.stdout is not None
        try:
            self._process.stdin.write(json.dumps(message, allow_nan=False) + "\n")
            self._process.stdin.flush()
            line = self._process.stdout.readline(LONGEST_LINE)
        except OSError:
            line = ""
        self.lines += 1
        if not line:
            raise self._refused("the end of its output", EXPECTED)
        try:
            answer = json.loads(line)
        except (ValueError, RecursionError):
            raise self._refused(repr(line.strip()[:80]), EXPECTED) from None
        rows = answer.get("readings") if isinstance(answer, dict) else None
        if not isinstance(answer, dict) or not ("cannot" in answer or _is_rows(rows)):
            raise self._refused(repr(line.strip()[:80]), EXPECTED)
        return answer

    def _sample(self, row: Mapping[str, Any], keys: Sequence[str]) -> Sample:
        """A row of an answer; what it touches is what was asked for, unless it says so."""
        given = dict(zip(self.keys, keys, strict=True)) if keys else {}
        told = {name: row.get(name, given.get(name)) for name in self.keys}
        for name, text in told.items():
            if not isinstance(text, str) or not text:
                raise self._refused(f"no {name!r}", "what the pose touches, as a text")
        values = [self._number(row, c.name) for c in self.mechanism.channels]
        moment = self._number(row, "time_s") if "time_s" in row else time.time() - self._began
        warm = self._number(row, "temperature_c") if "temperature_c" in row else None
        return Sample(moment, warm, tuple(values), tuple(str(t) for t in told.values()))

    def _number(self, row: Mapping[str, Any], name: str) -> float:
        value = row.get(name)
        if isinstance(value, bool) or not isinstance(value, int | float):
            raise self._refused(f"{name} {value!r}", "a number for each channel")
        if not math.isfinite(value):
            raise self._refused(f"{name} {value!r}", "a finite number")
        return float(value)

    def _refused(self, found: str, expected: str) -> InputError:
        return InputError.at("--drive", found, expected, line=max(self.lines, 1))


def drive(session: Session, robot: Robot, show: Any) -> None:
    """Let a robot take a session: told poses first, then those that it was asked for."""
    if session.log.samples:
        here: Sequence[float] | None = session.log.samples[-1].values
    else:
        here = None
        _settled(session, show)
        taught = robot.taught()
        for label, samples in taught.items():
            here = samples[-1].values
            _check(session.mechanism, here, f"the taught pose {label}")
        session.arrive(*taught.values())
    refused = 0
    while not session.done and refused < MOST_REFUSED:
        _settled(session, show)
        goal = session.goal()
        if session.done or goal is None:
            return
        # Limits are intervals: a straight way between two poses that keep them keeps them.
        if passed(session.mechanism, goal) or (here and passed(session.mechanism, here)):
            refused += 1
            session.strike_off()
            continue
        found = robot.go(session.next_label, goal, session.goal_keys(), session.why)
        if isinstance(found, str):
            refused += 1
            session.note = f"the robot cannot: {found}"
            session.strike_off()
            continue
        refused = 0
        here = found[-1].values
        _check(session.mechanism, here, f"pose {session.next_label}")
        session.arrive(found)
        _settled(session, show)
        if session.adviser.mistake is not None:
            return  # wires that are exchanged, or turned: more poses tell nothing else
    _settled(session, show)


def passed(mechanism: Mechanism, readings: Sequence[float] | FloatArray) -> str | None:
    """The first channel that is beyond its limits or its range, in words; None where none is."""
    for c, reading in zip(mechanism.channels, readings, strict=True):
        joint = c.offset + c.gain * float(reading)
        for word, value, ends in (("limits", joint, c.limits), ("range", reading, c.range)):
            if ends is not None and not min(ends) <= value <= max(ends):
                return f"{c.name} at {value:.6g}, beyond its {word} {min(ends):g} to {max(ends):g}"
    return None


def _check(mechanism: Mechanism, readings: Sequence[float], what: str) -> None:
    beyond = passed(mechanism, readings)
    if beyond is not None:
        raise InputError(f"--drive: found {what} with {beyond}, expected it within")


def _settled(session: Session, show: Any) -> None:
    """Wait for advice, and show it."""
    while session.busy:
        session.poll()
        time.sleep(0.005)
    show(session.state())


def _is_rows(rows: Any) -> bool:
    return isinstance(rows, list) and bool(rows) and all(isinstance(row, dict) for row in rows)
