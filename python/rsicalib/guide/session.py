"""The state of a guided session: what was measured, what to do next, what is shown."""

from __future__ import annotations

import json
import threading
import time
from collections import deque
from collections.abc import Sequence
from concurrent.futures import Future, ThreadPoolExecutor
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from rsicalib import _core
from rsicalib._core import Mechanism
from rsicalib.arrays import FloatArray
from rsicalib.errors import InputError
from rsicalib.guide.advice import Advice, Adviser, explained_id, usable
from rsicalib.guide.handle import Handle
from rsicalib.guide.hold import LATEST, LONGER, TREMOR, Hold, apart
from rsicalib.guide.log import Log, Sample
from rsicalib.guide.trouble import Trouble
from rsicalib.io.files import write_text
from rsicalib.io.sources import read_json
from rsicalib.plain_text import counted
from rsicalib.report.words import subject
from rsicalib.results.result import Trace

KEPT = "what a guide has kept: 'struck_off' and 'repeated'"

NEAR = 0.06
"""A pose this near its target is taken at once, as a share of what channels can read."""
SAME = 0.01
"""A pose this near one that was taken is that one."""
LITTLE = 0.02
"""A pose that makes the standard deviation smaller by less than this share adds little."""
MOVED = 0.02
"""A channel has moved where it has by this share of what it can read."""
WATCHED = 60
"""Samples over which a channel must change where others do."""
SILENT_S = 3.0
"""Without a sample for so long, the page says so [s]."""
RESTLESS_S = 8.0
"""A hand that is near the pose and not still for so long is told which channel shakes, and from
then on its tremor counts as stillness [s]."""


@dataclass(frozen=True)
class Settings:
    """How a session is taken."""

    target: float
    """Standard deviation of the platform to reach [length unit]."""
    samples: int = 8
    """Of each pose."""
    seconds: float = 0.6
    """For which a pose is held."""
    most: int = 60
    """Poses, at the most."""
    alone: bool = False
    """Whether a robot takes the poses: it goes on where the answer is of no use yet, to `most`."""


@dataclass
class Session:
    """Measures pose after pose; `feed` takes samples, `state` says what to show."""

    mechanism: Mechanism
    adviser: Adviser
    log: Log
    settings: Settings
    advice: Advice | None = None
    done: bool = False
    message: str = ""
    elsewhere: bool = False
    """Whether the hand holds still where nothing is to be measured."""
    note: str = ""
    bad_lines: int = 0
    bad_line: str = ""
    off: list[list[float]] = field(default_factory=list)
    repeated: list[int] = field(default_factory=list)

    def __post_init__(self) -> None:
        self.channels = self.mechanism.channels
        self.spans = np.array([_span(c) for c in self.channels])
        closed = _closed_by_itself(self.mechanism)
        held = self.settings.samples, self.settings.seconds
        self.hold = Hold(self.spans, *held, closed=closed)
        self._dwell = Hold(self.spans, *held, closed=closed, trembling=closed)
        self._recent: deque[tuple[float, ...]] = deque(maxlen=WATCHED)
        self._lock = threading.RLock()
        self._worker = ThreadPoolExecutor(max_workers=1)
        self._pending: Future[Advice] | None = None
        self.reached: int | None = None
        """Poses after which the target was reached."""
        self.ended: str | None = None
        """Why no more samples come, once none do."""
        self.course: list[tuple[int, float]] = []
        """Standard deviation of the platform after each number of poses [length unit]."""
        for pair in self.log.exchanged:
            self.adviser.exchange(*pair)
        self.handle = Handle(self.mechanism, self.adviser.prior)
        self._heard = time.monotonic()
        self._near_since: float | None = None
        self.shaking: str | None = None
        """The channel that keeps a hand near its pose from being still."""
        self._stood: list[Sample] = []
        self._last: FloatArray | None = None  # the pose that was taken last
        """Where the hand is still now and no pose is taken."""
        self._means = {k: _mean(samples) for k, samples in self.log.poses.items()}
        self._restore()
        self._ask()

    # ------------------------------------------------------------------ what comes in

    def feed(self, samples: Sequence[Sample]) -> None:
        """Take samples: to the disk first, then into the session."""
        with self._lock:
            samples = [self.log.named(sample) for sample in samples]
            self.log.take(samples)
            if samples:
                self._heard = time.monotonic()
            for sample in samples:
                self._recent.append(sample.values)
                self.hold.feed(sample)
                self._dwell.feed(sample)
                self._bear_with(sample.time_s)
                self._look()

    def arrive(self, *poses: Sequence[Sample]) -> None:
        """Take poses that a robot holds, each as a whole."""
        with self._lock:
            self._heard = time.monotonic()
            for arrived in poses:
                samples = [self.log.named(sample) for sample in arrived]
                self.log.take(samples)
                self._recent.extend(sample.values for sample in samples)
                self._take(samples)
            self._ask()

    def strike_off(self) -> None:
        """The operator cannot reach the pose that is asked for: ask for another one."""
        with self._lock:
            if self.advice is None or self.advice.readings is None or self._pending is not None:
                return
            self.off.append([float(v) for v in self.advice.readings])
            self.note = "struck off: another pose is chosen"
            self._save()
            self._ask()

    def take_over(self) -> None:
        """Take the two channels whose wires are exchanged for one another, and go on."""
        with self._lock:
            pair = self._exchange()
            if pair is None:
                return
            self.log.exchange(*pair)
            self.adviser.exchange(*pair)
            # What was shown and struck off until now was by the wrong channels.
            self.advice, self.course, self.off = None, [], []
            self.handle = Handle(self.mechanism, self.adviser.prior)
            self._means = {k: _mean(samples) for k, samples in self.log.poses.items()}
            self._recent.clear()
            self._begin_anew()
            self.note = f"{pair[0]} and {pair[1]} are taken for one another: leave wires and names"
            self.note += " as they are until this session is done, and exchange them afterwards"
            self._save()
            self._ask()

    def _exchange(self) -> tuple[str, str] | None:
        """Two channels that can be taken for one another now."""
        return None if self._pending is not None or self.done else self.adviser.exchanged

    def poll(self) -> bool:
        """Take advice that has arrived; True where it has."""
        with self._lock:
            if self._pending is None or not self._pending.done():
                return False
            before, self.advice = self.advice, self._pending.result()
            self._pending = None
            self._advised(before)
            return True

    def finish(self) -> Trace | None:
        """Wait for the last advice, and write its result."""
        if self._pending is not None:
            self._pending.result()
            self.poll()
        self._worker.shutdown(wait=True)
        self.log.close()
        told = None if self.advice is None else self.advice.result
        return told or self.adviser.at_the_end(self.log.taken())

    @property
    def next_label(self) -> int:
        """Label of the pose that is taken next."""
        return max(self.log.poses, default=0) + 1

    @property
    def why(self) -> str:
        """What the next pose is for."""
        if self._repeat() is not None:
            return "once more"
        return "" if self.advice is None else self.advice.why

    @property
    def busy(self) -> bool:
        """Whether advice is being worked out."""
        return self._pending is not None

    # ------------------------------------------------------------------ what to do with it

    def _look(self) -> None:
        """Whether the pose that is held can be taken."""
        if self.done or self.adviser.mistake is not None:
            return
        self._follow()
        now = self.hold.now
        if now is None or self.hold.progress < 1.0:
            self._say("hold still" if self.hold.progress > 0.3 else "")
            return
        ends = self._at_ends(now)
        if ends:
            self._say(f"{ends[0]} is at the end of its range: move away from there")
            return
        if self._pending is not None:
            return
        at = [float(v) for v in now]
        taken = min(self._means.items(), key=lambda m: apart(at, m[1], self.spans), default=None)
        wanted = self.goal()
        near = wanted is not None and apart(at, wanted, self.spans) < NEAR
        repeat = self._repeat()
        again = repeat is not None and taken is not None and taken[0] == repeat
        if taken is not None and not again and apart(at, taken[1], self.spans) < SAME:
            again_here = f"this is pose {taken[0]}, which adds nothing again: go on to the next"
            self._say(again_here, elsewhere=True)
            return
        if not near and self.hold.held_s < LONGER * self.settings.seconds:
            self._say("go on to the pose, or hold to have this one taken")
            return
        self._take(self.hold.taken())
        self._ask()

    def _follow(self) -> None:
        """Keep where the hand dwelt, once it has gone from there: the next pose is approached from
        it, however near. A hand that trembles too much to be measured has been there, too.
        """
        if self._dwell.progress >= 1.0:
            held = self._dwell.taken()
            self._stood = held[: (len(held) + 1) // 2]  # the others may be of the way from there
            return
        stood, self._stood = self._stood, []
        if stood and (self._last is None or apart(_mean(stood), self._last, self.spans) > SAME):
            self.log.passes(stood)

    def _set_out(self, samples: Sequence[Sample]) -> None:
        """Keep where the hand was first, if it was still nowhere before its first pose."""
        first = self.log.samples[:1]
        nowhere = not (self.log.poses or self.log.passed)
        # What an arm touches on its way is not known.
        if self.hold.closed and nowhere and apart(_mean(first), _mean(samples), self.spans) > SAME:
            self.log.passes(first)

    def _begin_anew(self) -> None:
        """Forget where the hand is: a pose was taken, or channels have other names."""
        self.hold.clear()
        self._dwell.clear()
        self._stood = []

    def _say(self, message: str, *, elsewhere: bool = False) -> None:
        self.message, self.elsewhere = message, elsewhere

    def _take(self, samples: Sequence[Sample]) -> None:
        label = self.next_label
        repeat = self._repeat()
        self._set_out(samples)
        if repeat is not None:
            self.log.withdraw(repeat)
            self._means.pop(repeat, None)
            self.repeated += [repeat, label]
            if self.log.held_out(label):
                label += 1  # what is measured again belongs to the fit
                self.repeated.append(label)
            self._save()
        self.log.pose(label, samples)
        self._means[label] = self._last = _mean(samples)
        self._begin_anew()
        kept = ": it checks the closure and is not fitted" if self.log.held_out(label) else ""
        self.note = f"pose {label} is taken{kept}"
        self._say("")

    def _ask(self) -> None:
        """Have advice worked out on what there is."""
        here = self._recent[-1] if self._recent else None
        # A pose that was taken is not asked for again: it would be refused as adding nothing.
        off = [*self.off, *(mean.tolist() for mean in self._means.values())]
        self._pending = self._worker.submit(
            self.adviser.advise, self.log.taken(), here, off, self.settings.target
        )

    def _advised(self, before: Advice | None) -> None:
        now = self.advice
        assert now is not None
        self.handle.know(now.result)
        if now.sd is not None and (not self.course or self.course[-1][0] < len(self.log.poses)):
            self.course.append((len(self.log.poses), now.sd))
        if now.result is not None and now.measured is not None:
            now.measured.to_csv(self.log.folder / "session.csv", whole=True)
            write_text(self.log.folder / "result.json", now.result.to_json())
        last = max(self.log.poses, default=0)
        if before is not None and before.sd and now.sd and not self.log.held_out(last):
            near = self._nearest_other(last)
            if now.sd > (1.0 - LITTLE) * before.sd and now.sd > self.settings.target and near:
                self.note = f"pose {last} added little: it is near pose {near}"
        self._judge_end(now)

    def _judge_end(self, now: Advice) -> None:
        """Whether the session is done."""
        count = len(self.log.poses)
        there = now.result is not None and now.sd is not None and now.sd <= self.settings.target
        if there and self.reached is None:
            self.reached = count
        self.done = _core.guided_done(
            {
                "poses": count,
                "most": self.settings.most,
                "beyond": count - self.reached if there and self.reached is not None else None,
                "repeat": self._repeat() is not None,
                "open": bool(now.open),
                "deciding": now.criterion == "decide",
                "gain": now.gain,
                "usable": usable(now.result),
                "p_value": None if now.result is None else now.result.after.p_value,
                "unmended": bool(self._unmended()),
                "checked": self._checked(),
                "alone": self.settings.alone,
            }
        )

    def _checked(self) -> bool:
        """Whether a pose is there that was kept out of the fit."""
        return any(map(self.log.held_out, self.log.poses))

    def _repeat(self) -> int | None:
        """A pose that is to be measured again."""
        repeats = self.advice.repeat if self.advice is not None else ()
        known = (r.label for r in repeats if r.label in self._means)
        return next((k for k in known if k not in self.repeated), None)

    def _unmended(self) -> list[int]:
        """Poses that do not fit after they were measured again: the others may be wrong, too."""
        repeats = self.advice.repeat if self.advice is not None else ()
        return [r.label for r in repeats if r.label in self._means and r.label in self.repeated]

    def goal(self) -> FloatArray | None:
        """Readings of where to go."""
        repeat = self._repeat()
        if repeat is not None:
            return self._means[repeat]
        return None if self.advice is None else self.advice.readings

    def goal_keys(self) -> tuple[str, ...]:
        """What is touched there: a text for each text column."""
        repeat = self._repeat()
        if repeat is not None:
            return self.log.poses[repeat][0].keys
        return () if self.advice is None else self.advice.keys

    def _nearest_other(self, label: int) -> int | None:
        own = self._means.get(label)
        others = {k: m for k, m in self._means.items() if k != label}
        if own is None or not others:
            return None
        return min(others, key=lambda k: apart(own, others[k], self.spans))

    def _at_ends(self, now: Sequence[float] | FloatArray) -> list[str]:
        """Channels at an end of their range: a dead zone, or a wire that is off."""
        out = []
        for channel, value, span in zip(self.channels, now, self.spans, strict=True):
            if channel.range is not None:
                low, high = channel.range
                if value <= low + 2e-4 * span or value >= high - 2e-4 * span:
                    out.append(channel.name)
        return out

    def _lost(self) -> list[str]:
        """Channels that do not change while others do."""
        if len(self._recent) < WATCHED:
            return []
        return self._constant(np.array(self._recent))

    def _dead(self) -> list[str]:
        """Channels that have read one and the same number in poses in which others differ."""
        if len(self.log.poses) < 2:
            return []
        every = np.array([s.values for samples in self.log.poses.values() for s in samples])
        return self._constant(every)

    def _constant(self, values: FloatArray) -> list[str]:
        """Channels that have one number where half of the channels have moved."""
        spread = np.ptp(values, axis=0) / self.spans
        if np.sort(spread)[len(spread) // 2] < MOVED:
            return []
        return [c.name for c, s in zip(self.channels, spread, strict=True) if s == 0.0]

    # ------------------------------------------------------------------ what is kept

    def _save(self) -> None:
        kept = {"struck_off": self.off, "repeated": self.repeated}
        write_text(self.log.folder / "guide.json", json.dumps(kept) + "\n")

    def _restore(self) -> None:
        path = self.log.folder / "guide.json"
        if path.exists():
            kept = read_json(path, KEPT)
            try:
                off = np.asarray(kept["struck_off"], dtype=np.float64)
                self.off = off.reshape(-1, len(self.channels)).tolist()
                self.repeated = [int(label) for label in kept["repeated"]]
            except (KeyError, TypeError, ValueError) as error:
                raise InputError.at(str(path), str(error), KEPT) from None
        last = max((s[-1].time_s for s in self.log.poses.values()), default=-np.inf)
        for sample in self.log.samples[-200:]:
            self._recent.append(sample.values)
            if sample.time_s > last:
                self.hold.feed(sample)
                self._dwell.feed(sample)

    # ------------------------------------------------------------------ what is shown

    def troubles(self) -> list[Trouble]:
        """What is wrong while it can still be repeated."""
        now = self.hold.now
        ends = self._at_ends(now) if now is not None else []
        out = [Trouble.at_end(name) for name in ends]
        lost = [name for name in self._lost() if name not in ends]
        out += [Trouble.lost(name) for name in lost]
        advice = self.advice
        if advice is not None:
            # Where the order is to stop, nothing else is to be done.
            repeat = None if self._broken() else self._repeat()
            out += [
                Trouble("repeat", f"{r.why}; hold it once more", pose=str(r.label))
                for r in advice.repeat
                if r.label == repeat
            ]
            out += [Trouble.repeated(label) for label in self._unmended()]
            others = [w for w in advice.troubles if not set(w.targets) & set(lost)]
            out += [Trouble.of_warning(w) for w in others]
            if advice.result is not None:
                moved = [s for s in advice.result.steps if s.term in ("slip", "wander")]
                out += [Trouble.of_step(s) for s in moved]
        if self.bad_lines:
            text = f"{counted(self.bad_lines, 'line')} could not be read; the last: {self.bad_line}"
            out.append(Trouble("bad_lines", text))
        return out

    def state(self) -> dict[str, Any]:
        """All that is shown, in plain values."""
        with self._lock:
            return self._state()

    def _state(self) -> dict[str, Any]:
        advice = self.advice
        # What was asked for is done with while the next pose is chosen.
        asks = self._pending is None and advice is not None
        goal = self.goal() if asks else None
        now = self.hold.now
        if now is None and self._recent:
            now = np.array(self._recent[-1])
        bars = []
        for k, channel in enumerate(self.channels):
            low, high = channel.range or (None, None)
            bars.append(
                {
                    "name": channel.name,
                    "label": channel.label,
                    "now": None if now is None else float(now[k]),
                    "want": None if goal is None else float(goal[k]),
                    "low": low,
                    "high": high,
                    "loose": NEAR * float(self.spans[k]),
                }
            )
        repeat = self._repeat()
        steps = () if advice is None or advice.result is None else advice.result.steps
        # Where it is and where it should be are by one calibration: their difference is sure.
        want = self.handle.pose(goal)
        pose = want if want is not None or not asks or advice is None else advice.pose
        troubles = self.troubles()
        phase = self._phase()
        return {
            "mechanism": self.mechanism.name,
            "unit": self.mechanism.length_unit,
            "phase": phase,
            "order": self._order(phase, troubles),
            "handle": self.handle.state(self.handle.pose(now), want, NEAR),
            "course": [list(step) for step in self.course],
            "silent": self._silent_s() >= SILENT_S,
            "ended": self.ended,
            "channels": bars,
            "hold": self.hold.progress if asks else 0.0,
            "next": self.next_label,
            "repeat": repeat,
            "pose": None if pose is None else [float(v) for v in pose],
            "touch": " ".join(self.goal_keys()) if asks else "",
            "why": "" if advice is None or not asks or repeat is not None else advice.why,
            "wait_s": 0.0 if advice is None else advice.wait_s,
            "taken": len(self.log.poses),
            "held_out": sum(self.log.held_out(k) for k in self.log.poses),
            "samples": len(self.log.samples),
            "sd": None if advice is None else advice.sd,
            "sd_next": None if advice is None else advice.sd_next,
            "target": self.settings.target,
            "largest": None if advice is None else advice.largest,
            "named": [subject(s) for s in steps],
            "open": [] if advice is None else [one.state() for one in advice.open],
            "found": explained_id(steps),
            "closure": None if advice is None else advice.closure,
            "closure_fitted": None if advice is None else advice.closure_fitted,
            "verdict": None if advice is None or advice.result is None else advice.result.verdict,
            "troubles": [trouble.state() for trouble in troubles],
            "message": self.message if asks else "",
            "exchanged": self._exchange(),
            "note": self.note,
            "done": self.done,
        }

    def _phase(self) -> str:
        if self.done:
            return "done"
        if self._pending is not None:
            return "think"
        if not self._recent:
            return "wait"
        # A hand that rests where nothing is to be measured is not asked to hold still.
        here = self.hold.progress > 0.3 and not self.elsewhere
        return "hold" if here else "move"

    def _order(self, phase: str, troubles: list[Trouble]) -> dict[str, str | None]:
        """The one thing to do now: a word, what of, and the trouble that it is for, if any.

        The words are `go`, `hold`, `wait`, `stop` and `done`; nothing is done while something is
        wrong.
        """
        broken = self._broken()
        if broken is not None and (phase != "wait" or self.ended):
            return _stop(broken)
        if phase == "done":
            grave = self._grave(troubles)
            if grave is not None:
                return _stop(grave)
        return {**self._to_do(phase), "trouble": None}

    def _grave(self, troubles: list[Trouble]) -> Trouble | None:
        """Why a session whose poses are taken is not done; None where it is.

        Lines that could not be read have changed nothing.
        """
        grave = [trouble for trouble in troubles if trouble.kind != "bad_lines"]
        result = None if self.advice is None else self.advice.result
        if result is None:
            grave.append(Trouble("too_few", "the poses do not determine the calibration"))
        elif result.exit_code != 0:
            verdict = result.verdict.replace("_", " ")
            grave.append(Trouble("not_noise", f"what is left is not noise: {verdict}"))
        return grave[0] if grave else None

    def _to_do(self, phase: str) -> dict[str, str | None]:
        """The one thing to do where nothing is wrong."""
        if phase == "done":
            return {"word": "done", "text": counted(len(self.log.poses), "pose")}
        silent = self._silent_s()
        if phase == "wait" or silent >= SILENT_S:
            text = f"no sample for {int(silent)} s" if silent >= SILENT_S else "for samples"
            return {"word": "wait", "text": text}
        if phase == "think":
            return {"word": "wait", "text": "the next pose is chosen"}
        label = self._repeat() or self.next_label
        again = ", once more" if self._repeat() else ""
        if phase == "hold":
            return {"word": "hold", "text": f"still: pose {label}{again}"}
        wait_s = 0.0 if self.advice is None else self.advice.wait_s
        if wait_s > 0.0:
            return {"word": "wait", "text": f"{-(-wait_s // 60):.0f} min, then pose {label}"}
        if self.shaking is not None:
            text = f"pose {label}: {self.shaking} shakes; go on, or take another pose"
            return {"word": "hold", "text": text}
        return {"word": "go", "text": f"to pose {label}{again}"}

    def _silent_s(self) -> float:
        """For how long no sample has come [s]."""
        return time.monotonic() - self._heard

    def _broken(self) -> Trouble | None:
        """Why going on is of no use; None where it is."""
        if self.adviser.mistake is not None:
            return Trouble.of_warning(self.adviser.mistake)
        result = None if self.advice is None else self.advice.result
        slips = [s for s in result.steps if s.term == "slip"] if result else []
        if slips:
            return Trouble.of_step(slips[0])
        dead = self._dead()
        if dead:
            return Trouble.dead(dead[0])
        return None if self.done or self.ended is None else Trouble("ended", self.ended)

    def _bear_with(self, time_s: float) -> None:
        """Let a hand shake that stays near its pose and cannot be still: shaking keeps loops
        closed.
        """
        goal, now = self.goal(), self.hold.now
        near = goal is not None and now is not None and apart(now, goal, self.spans) < NEAR
        if not near or self.hold.progress >= 1.0 or self._pending is not None:
            self._near_since = self.shaking = None
            return
        if self._near_since is None:
            self._near_since = time_s
        if time_s - self._near_since < RESTLESS_S or len(self._recent) < LATEST:
            return
        spread = np.std(np.array(self._recent)[-LATEST:], axis=0)
        worst = int(np.argmax(spread / self.hold.loose))
        if spread[worst] > self.hold.loose[worst] / TREMOR:
            self.shaking = self.channels[worst].name
            self.hold.allow(TREMOR * spread)


def _closed_by_itself(mechanism: Mechanism) -> bool:
    """Whether chains carry all that closures join, so that they hold whatever a hand does."""
    document: dict[str, Any] = mechanism.to_dict()
    carried = {point["name"] for point in document.get("point", ()) if point.get("chain")}
    return carried.issuperset(name for c in document.get("closure", ()) for name in c["between"])


def _span(channel: Any) -> float:
    """What a channel can read: its range, else its limits."""
    if channel.range is not None:
        return float(channel.range[1] - channel.range[0])
    if channel.limits is not None:
        return float(abs((channel.limits[1] - channel.limits[0]) / channel.gain))
    return float(abs(2.0 * np.pi / channel.gain))


def _mean(samples: Sequence[Sample]) -> FloatArray:
    out: FloatArray = np.mean([s.values for s in samples], axis=0)
    return out


def _stop(trouble: Trouble) -> dict[str, str | None]:
    return {"word": "stop", "text": trouble.text, "trouble": trouble.id}
