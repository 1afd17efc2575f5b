"""A person at the handle, simulated: `python -m tests.person --devices 50` guides so many.

Reads the page's state as a person reads the page, moves the handle of a device of `tests.blind` to
the pose that is asked for, misses it, holds it with a shaking hand, and goes on when it is taken.
"""

from __future__ import annotations

import argparse
import json
import re
import secrets
import sys
import tempfile
import time
import urllib.request
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

import rsicalib
from rsicalib import Trace, _core
from rsicalib.guide.advice import Adviser
from rsicalib.guide.log import FITTED, Columns, Log, Sample
from rsicalib.guide.session import Session, Settings
from tests import oracle
from tests.blind import effects as catalogue
from tests.blind import simulator
from tests.blind.effects import Effect
from tests.blind.planning import built, rate, wide_poses
from tests.blind.scene import Scene, held
from tests.blind.simulator import CHANNELS, Device
from tests.oracle import Array

if TYPE_CHECKING:
    from tests.trouble import Trouble

State = dict[str, Any]
MISSES = (0.15, 0.05)
"""Standard deviation of where the pose ends up, (in, rad)."""
SHAKES = (0.004, 0.002)
"""Of the hand between samples, (in, rad)."""
NOT_HERE = re.compile("adds nothing|end of its range")
"""Of a message that no pose is taken here."""
GIVES_UP = 25
"""Times that a person goes to one pose before the session has stalled."""
OTHER = 4
"""Times that a person who is told of a shaking hand goes there before asking for another pose."""
TREMORS = (0.25, 4.0)
"""Between these a hand shakes more than `SHAKES`, log-uniform: steady, and old or cold."""
POSE_S = 20.0
"""From pose to pose, by the clock of the samples."""


@dataclass
class Operator:
    """A device with its effects, and the person at its handle.

    `order` may exchange two columns; `lost` is a channel that reads the same for ever; `trouble`
    is what goes wrong in the session. `said` is what the page said is wrong, with the poses taken
    by then.
    """

    device: Device
    effects: tuple[Effect, ...]
    rng: np.random.Generator
    misses: tuple[float, float] = MISSES
    shakes: tuple[float, float] = SHAKES
    order: tuple[int, ...] = tuple(range(9))
    lost: int | None = None
    trouble: Trouble | None = None
    pose: int = 0
    said: dict[str, int] = field(default_factory=dict)
    at: Array = field(default_factory=lambda: np.array(oracle.REST, dtype=float))
    clock_s: float = 0.0
    before: Array | None = None
    stalled: bool = False

    def read(
        self, poses: Array, step_s: float = 0.02, late: bool = False
    ) -> list[tuple[float, Array]]:
        """Samples of a way, and their times: the last pose before them counts for hysteresis."""
        trouble = self.trouble
        effects = (
            self.effects if trouble is None else (*self.effects, *trouble.effects(self.pose, late))
        )
        count = len(poses)
        times = self.clock_s + step_s * np.arange(1, count + 1)
        whole = np.vstack([self.at[None] if self.before is None else self.before[None], poses])
        label = np.concatenate([[1], np.full(count, 2)])
        scene = Scene(
            pose=whole,
            label=label,
            sample=np.concatenate([[1], np.arange(1, count + 1)]),
            before=np.where(label == 1, -1, 0),
            time_s=np.concatenate([[self.clock_s], times]),
            temperature_c=np.full(count + 1, 21.0),
        )
        try:
            ideal = self.device.ideal(scene, effects)[1:]
        except ValueError:  # an arm that is stretched cannot be pushed
            ideal = self.device.ideal(scene, self.effects)[1:]
        codes = simulator.digitise(ideal, self.rng, 1.0, effects)[:, list(self.order)]
        if self.lost is not None:
            codes[:, self.lost] = 2048
        if trouble is not None:
            codes = trouble.codes(codes, self.pose)
        self.clock_s = float(times[-1])
        return list(zip(times.tolist(), codes, strict=True))

    def go(self, pose: Array) -> list[tuple[float, Array]]:
        """Samples on the way to a pose, which is missed, and while it is held."""
        missed = self.rng.standard_normal(6) * np.repeat(self.misses, 3)
        goal = self._reachable(pose, missed)
        way = self.at + np.linspace(0.1, 1.0, 10)[:, None] * (goal - self.at)
        inside = self.device.allows(way)
        self.clock_s += POSE_S
        moving = self.read(way[inside]) if inside.any() else []
        held = goal + self.rng.standard_normal((40, 6)) * np.repeat(self.shakes, 3)
        self.before, self.at = self.at, goal
        held = np.where(self.device.allows(held)[:, None], held, goal)
        return moving + self.read(held[:15]) + self.read(held[15:], late=True)

    def _reachable(self, pose: Array, missed: Array) -> Array:
        """Where the hand ends up: as far towards the pose as the stops of the device let it."""
        for share in (1.0, 0.5, 0.25, 0.0):
            if self.device.allows((pose + share * missed)[None])[0]:
                return np.asarray(pose + share * missed)
        way = self.at + np.linspace(0.0, 1.0, 51)[:, None] * (pose - self.at)
        return np.asarray(way[self.device.allows(way)][-1])


def operate(
    person: Operator,
    state: Callable[[], State],
    write: Callable[[str], None],
    strike_off: Callable[[], None],
    pause_s: float = 0.0,
    patience_s: float = 60.0,
) -> None:
    """Do what the page says until it is done."""
    write("time_s," + ",".join(oracle.channel_names(oracle.rsi())))
    taken, since, tries = -1, time.monotonic(), 0
    remembered: dict[int, Array] = {}
    while time.monotonic() - since < patience_s:
        now = state()
        for told in now["troubles"]:
            person.said.setdefault(told["text"], now["taken"])
        if now["done"]:
            return
        if now["phase"] == "think" or (now["taken"] == taken and now["hold"] > 0.3):
            if now["phase"] != "think" and NOT_HERE.search(now["message"]):
                strike_off()  # the stops do not let the hand leave the last pose, or the track ends
                taken = -1
            elif now["phase"] != "think":
                _hold(person, write)  # a person holds until the pose is taken
            time.sleep(0.01 + pause_s)
            continue
        if now["taken"] != taken or now["hold"] <= 0.3:
            if now["taken"] > 0:
                remembered.setdefault(now["next"] - 1, person.at)
            tries = 1 if now["taken"] != taken else tries + 1
            taken, since = now["taken"], time.monotonic()
            if tries >= GIVES_UP:
                person.stalled = True
                return
            if tries % OTHER == 0 and "take another pose" in now["order"]["text"]:
                strike_off()
                continue
            wanted = remembered.get(now["repeat"], now["pose"])
            person.clock_s += now["wait_s"]
            person.pose = now["next"]
            pose = person.at * 0.97 if wanted is None else np.array(wanted)
            for moment, codes in person.go(pose):
                write(_line(moment, codes))
                if pause_s:
                    time.sleep(pause_s)
        time.sleep(0.01)
    person.stalled = True


def _hold(person: Operator, write: Callable[[str], None]) -> None:
    poses = person.at + person.rng.standard_normal((5, 6)) * np.repeat(person.shakes, 3)
    inside = person.device.allows(poses)[:, None]
    for moment, codes in person.read(np.where(inside, poses, person.at), late=True):
        write(_line(moment, codes))


def _line(moment: float, codes: Array) -> str:
    return f"{moment:.3f}," + ",".join(str(int(c)) for c in codes)


def guided(
    person: Operator,
    folder: Path,
    target: float,
    until: Callable[[State], bool] = lambda state: False,
    take_over: list[int] | None = None,
    **settings: Any,
) -> tuple[Session, Trace | None]:
    """A session in this process: the operator reads the state, without page or terminal.

    It ends early where the operator has seen enough. Where `take_over` is given, exchanged wires
    are taken over, and the number of poses that were taken by then is put there.
    """
    mechanism = built()
    codes = simulator.rest(person.device, person.rng, effects=person.effects)["values"]
    codes = codes[:, list(person.order)]
    if person.trouble is not None:
        codes = person.trouble.codes(codes, 0)
    rest = rsicalib.Readings.from_arrays(mechanism, codes)
    names = oracle.channel_names(oracle.rsi())
    log = Log(folder, names, False, fitted=_core.needed_poses(mechanism) or FITTED)
    session = Session(mechanism, Adviser(mechanism, rest), log, Settings(target, **settings))
    columns = Columns(names)

    waiting: list[Sample] = []

    def feed() -> None:
        session.feed(waiting)
        waiting.clear()

    def write(line: str) -> None:
        found = columns.sample(line, 0.0)
        if not isinstance(found, str) and found is not None:
            waiting.append(found)
        if len(waiting) >= 10:
            feed()

    def state() -> State:
        feed()
        session.poll()
        found = session.state()
        if take_over is not None and found["exchanged"]:
            take_over.append(found["taken"])
            session.take_over()
            found = session.state()
        return found | {"done": found["done"] or until(found)}

    operate(person, state, write, session.strike_off)
    return session, session.finish()


def page_state(url: str) -> State:
    """What the page shows."""
    with urllib.request.urlopen(url + "state", timeout=10) as answer:
        found: State = json.loads(answer.read())
    return found


def strike_off(url: str) -> None:
    """Press the page's button."""
    ours = urllib.request.Request(url + "strike-off", method="POST", headers={"X-Guide": "1"})
    with urllib.request.urlopen(ours, timeout=10):
        pass


def drawn(
    seed: int, effect: str | None = None, target: str = "a22", *, tremor: bool = False
) -> Operator:
    """A device drawn with a seed, with an effect of the catalogue or without.

    With `tremor` hands differ from person to person.
    """
    rng = np.random.default_rng(seed)
    device = Device.random(rng)
    kinds = {kind.term: kind for kind in catalogue.CATALOGUE}
    present = () if effect is None else (kinds[effect].draw(rng, target),)
    factor = float(np.exp(rng.uniform(*np.log(TREMORS)))) if tremor else 1.0
    return Operator(device, present, rng, shakes=(factor * SHAKES[0], factor * SHAKES[1]))


def rest_lines(person: Operator) -> Iterator[str]:
    """A file of readings of the rest pose."""
    session = simulator.rest(person.device, person.rng, effects=person.effects)
    yield ",".join(oracle.channel_names(oracle.rsi()))
    for row in session["values"][:, list(person.order)]:
        yield ",".join(str(int(c)) for c in row)


PLACES = 200
"""Of which the largest error is claimed, as in a certificate."""
NOISE = 1.0408
"""Of a simulated reading [counts], with its rounding: √(1 + 1/12)."""
VISIBLE = 35.0
"""An effect is visible where χ² falls by more: 6 standard deviations, of which the search needs 4.3
for one of 300 places at a level of 1 %, and 1.6 are for seeing it in 95 %."""
EFFECTS = ("curvature", "cubic", "once_per_turn", "drift", "slip", "hysteresis", "crosstalk")
"""Effects of sensors that guided devices have by turns, after one without."""


def truth_error(person: Operator, result: Trace) -> float:
    """Error of the platform [in], root mean square of components over random poses at rest."""
    rng = np.random.default_rng(99)
    poses = wide_poses(rng, person.device, 60)
    standing = tuple(e for e in person.effects if e.term not in ("drift", "slip"))
    scene = held(rng, poses, 1, (0.0, 0.0))
    counts = np.clip(person.device.ideal(scene, standing), 0, 4095)
    mechanism = rsicalib.load_mechanism("rsi")
    read = rsicalib.Readings.from_arrays(mechanism, counts, pose=scene.label)
    found = np.asarray(rsicalib.forward(read, mechanism, calibration=result))
    return float(np.sqrt(np.mean((found[:, :3] - poses[:, :3]) ** 2)))


def largest_error(person: Operator, result: Trace) -> float:
    """The largest error of position [in] over random poses, each read once: what is claimed.

    Every device has poses and noise of its own: a count over devices is one over noises as well.
    """
    rng = person.rng
    poses = wide_poses(rng, person.device, PLACES)
    standing = tuple(e for e in person.effects if e.term not in ("drift", "slip"))
    read = simulator.observe(person.device, held(rng, poses, 1, (0.0, 0.0)), rng, 1.0, standing)
    mechanism = rsicalib.load_mechanism("rsi")
    table = rsicalib.Readings.from_arrays(mechanism, read["values"], pose=read["pose"])
    found = np.asarray(rsicalib.forward(table, mechanism, calibration=result))
    return float(np.linalg.norm(found[:, :3] - poses[:, :3], axis=1).max())


def shown(person: Operator, session: Session) -> float:
    """By how much χ² of the poses that were fitted falls with the term of the effect."""
    readings = session.adviser.readings(session.log.taken())
    base = ["offset", "gain"]

    def chi2(terms: list[str]) -> float:
        rest = session.adviser.rest
        fit = rsicalib.calibrate(readings, rest=rest, terms=terms, noise=NOISE).fit
        assert fit.chi2 is not None
        return fit.chi2

    told = [name for name in (e.told() for e in person.effects) if name is not None]
    return chi2(base) - chi2([*base, *told])


def main() -> int:
    """Guide simulated operators, and print what it took."""
    parser = argparse.ArgumentParser(description="guided sessions of simulated operators")
    parser.add_argument("--devices", type=int, default=50)
    parser.add_argument("--target", type=float, default=0.003)
    parser.add_argument("--effects", nargs="*", default=["none"], choices=["none", *EFFECTS])
    parser.add_argument("--seed", type=int)
    parser.add_argument("--tremor", action="store_true", help="hands differ from person to person")
    args = parser.parse_args()
    seed = secrets.randbits(32) if args.seed is None else args.seed
    print(f"seed {seed}", flush=True)
    rows = []
    for k in range(args.devices):
        effect = args.effects[k % len(args.effects)]
        target = CHANNELS[int(np.random.default_rng([seed, k]).integers(9))]
        named_effect = None if effect == "none" else effect
        person = drawn(seed + k, named_effect, target, tremor=args.tremor)
        with tempfile.TemporaryDirectory() as folder:
            session, result = guided(person, Path(folder) / "o", args.target)
            falls = shown(person, session) if effect != "none" and result is not None else 0.0
        state = session.state()
        steps = () if result is None else result.steps
        named = any(
            step.target == target and effect in (step.term, *(a.term for a in step.also_fits))
            for step in steps
        )
        error = np.nan if result is None else truth_error(person, result)
        reached = session.reached if session.reached is not None else state["taken"]
        claim = state["largest"]
        worst = np.nan if result is None or claim is None else largest_error(person, result) / claim
        rows.append(
            (state["done"], reached, state["taken"], named, len(steps), error, falls, worst,
             person.stalled)
        )  # fmt: skip
        print(
            f"{k} {effect} {target}: done {state['done']}, {reached} poses to the target, "
            f"{state['taken']} in all, {state['verdict']}, named {state['named']}, "
            f"open {len(state['open'])}, error {1e3 * error:.2f}e-3 in, χ² falls by {falls:.0f}, "
            f"largest error {worst:.2f} of what is claimed{', STALLED' * person.stalled}",
            flush=True,
        )
    done, reach, taken, right, count, errors, visible, worst, stalled = (
        np.array(c, dtype=float) for c in zip(*rows, strict=True)
    )
    print(
        f"poses to the target: median {np.median(reach):.1f}, 90 % {np.percentile(reach, 90):.0f}; "
        f"in all: median {np.median(taken):.1f}; done {np.mean(done):.0%}; "
        f"error median {1e3 * np.nanmedian(errors):.2f}e-3 in"
    )
    claimed = worst[np.isfinite(worst)]
    print(f"stalled: {int(stalled.sum())} of {len(stalled)}")
    print(f"largest error within the bound of 95 %: {rate([bool(w <= 1.0) for w in claimed])}")
    own = np.array([args.effects[k % len(args.effects)] != "none" for k in range(args.devices)])
    if own.any():
        print(f"effect named: {np.mean(right[own]):.0%} of {own.sum()}")
        seen = own & (visible > VISIBLE)
        share = rate([bool(r) for r in right[seen]])
        print(f"effect named where χ² falls by more than {VISIBLE:.0f}: {share}")
    if (~own).any():
        print(f"something named where nothing is: {np.mean(count[~own] > 0):.0%} of {(~own).sum()}")
    return 0


if __name__ == "__main__":
    sys.exit(main())
