"""One trial: a machine, what is wrong with it, a session, and what the library says."""

from __future__ import annotations

from copy import deepcopy
from dataclasses import dataclass, replace
from time import perf_counter
from typing import Any

import numpy as np

import rsicalib
from rsicalib import Mechanism, Readings, calibrate, forward, trace
from rsicalib.errors import InputError
from tests.families import effects as catalogue
from tests.families import linkage
from tests.families.device import (
    SAMPLE_S,
    SESSION_S,
    Device,
    Effect,
    Scene,
    Session,
    observe,
    stage,
)
from tests.families.draw import FAMILIES, Rng
from tests.families.grade import Errors, Grade, Truth, grade, speaks_of_noise
from tests.families.power import Linear
from tests.oracle import Array

FAINT = {"faint_15": 15.0, "faint_30": 30.0, "faint_60": 60.0}
"""Suites of single effects that hardly show, and their noncentrality."""
SUITES = ("clean", "single", "pair", "wrong_readings", "wrong_noise", "outside", "garbage", *FAINT)
STRENGTH = (60.0, 200.0)
"""Noncentrality of effects, drawn between."""
SURE = 1.96
"""Standard deviations of an interval of 95 %."""
CHECKS = 30
"""Check poses, of other samples and free of noise."""
GARBAGE = ("random", "another mechanism", "shuffled columns", "degrees")
FACTORS = (0.3, 0.5, 2.0, 3.0)


@dataclass(frozen=True)
class Case:
    """A device with a truth, ready to be examined."""

    family: str
    suite: str
    number: int
    device: Device
    effects: tuple[Effect, ...]
    truths: tuple[Truth, ...]
    session: Session
    check: Scene
    text: str
    what: str = ""


@dataclass(frozen=True)
class Row:
    """What came out of one case."""

    family: str
    suite: str
    number: int
    truth: tuple[str, ...]
    strength: tuple[float, ...]
    grade: Grade | None
    errors: Errors
    seconds: float
    error: str | None = None
    """The message of a refusal, or of a defect."""
    crashed: bool = False
    noise_said: bool = False
    calibrated: int | None = None
    """The exit code of `calibrate`, where it is looked at."""
    covered: tuple[bool, ...] = ()
    """Of offsets, gains and unknown points that are known: whether the interval holds the truth."""
    behind: float | None = None
    """χ² of what is said less that of the truth, parameters charged."""


def generator(family: str, suite: str, number: int, seed: int) -> Rng:
    """The same for the same seed, whoever runs it and in what order."""
    place = [seed, list(FAMILIES).index(family), SUITES.index(suite), number]
    return np.random.default_rng(np.random.SeedSequence(place))


def drawn(
    device: Device,
    scene: Scene,
    rng: Rng,
    kinds: dict[str, catalogue.Make],
    turn: int,
    count: int,
    strength: tuple[float, float] = STRENGTH,
) -> tuple[tuple[Effect, ...], tuple[Truth, ...]]:
    """Effects of different kinds at different targets, each as strong as was drawn for it.

    The first goes through `kinds` by turns; one that these readings cannot show is drawn anew.
    """
    linear = Linear(device, scene)
    present: list[Effect] = []
    wanted = rng.uniform(*strength, count)
    there = [term for term in kinds if catalogue.targets(device, term)]
    for attempt in range(60):
        first = not present
        term = there[(turn + attempt // 6) % len(there)] if first else str(rng.choice(there))
        target = str(rng.choice(catalogue.targets(device, term)))
        if any(target == e.target or term == e.term for e in present):
            continue
        try:
            effect = kinds[term](device, rng, target)
            effect = linear.scaled(effect, wanted[len(present)], present)
        except ValueError:
            continue
        if linear.is_of_few_poses(effect, present):
            continue
        # The first must be seen beside the second as well.
        if present and linear.noncentrality(present[0], [effect]) < strength[0] / 2:
            continue
        present.append(effect)
        if len(present) == count:
            break
    else:
        raise ValueError("no effect of a reasonable size shows in these readings")
    truths = []
    for effect in present:
        own = (effect.klass, effect.target)
        others = [e for e in present if e is not effect]
        twins = set() if effect.outside else linear.twins(effect, others)
        size = linear.noncentrality(effect, others)
        names = frozenset({own, *twins, *aliases(device, effect)})
        truths.append(Truth(effect.term, names, own, outside=effect.outside, strength=size))
    return tuple(present), tuple(truths)


def aliases(device: Device, effect: Effect) -> set[tuple[str, str]]:
    """Other words for the same: all chains, where there is one."""
    if effect.term == "sag" and len(device.drawing.mechanism["chain"]) == 1:
        return {("load", "all")}
    return set()


def toml(device: Device, factor: float = 1.0, play: float = 1.0) -> str:
    """The mechanism as a file; declared noise and play off by factors, where there is any."""
    mechanism = deepcopy(device.drawing.mechanism)
    for channel in mechanism["channel"]:
        if "noise" in channel:
            channel["noise"] *= factor
    for closure in mechanism["closure"]:
        if "noise" in closure:
            closure["noise"] *= play
    return rsicalib.Mechanism.from_dict(mechanism).to_toml()


def make(family: str, suite: str, number: int, seed: int) -> Case:
    """Case `number` of a suite."""
    rng = generator(family, suite, number, seed)
    for _ in range(8):
        try:
            return attempt(family, suite, number, rng)
        except ValueError:
            continue
    raise RuntimeError(f"{family} {suite} {number}: no such device in eight drawings")


def attempt(family: str, suite: str, number: int, rng: Rng) -> Case:
    """A case of one drawing; `ValueError` where the drawing cannot have it."""
    device = Device.random(family, rng)
    scene = stage(device, rng)
    check = replace(stage(device, rng, CHECKS if not device.drawing.sockets else 5, 1))
    effects: tuple[Effect, ...] = ()
    truths: tuple[Truth, ...] = ()
    what, text = "", toml(device)
    if suite in ("single", "pair"):
        count = 1 if suite == "single" else 2
        effects, truths = drawn(device, scene, rng, catalogue.CATALOGUE, number, count)
    elif suite in FAINT:
        faint = (FAINT[suite], FAINT[suite])
        effects, truths = drawn(device, scene, rng, catalogue.CATALOGUE, number, 1, faint)
    elif suite == "outside":
        effects, truths = drawn(device, scene, rng, catalogue.OUTSIDE, number, 1)
    elif suite == "wrong_readings":
        what = catalogue.MISHAPS[number % len(catalogue.MISHAPS)]
        effects, truths = mishap(device, scene, rng, what)
    elif suite == "wrong_noise":
        what, text = wrong_noise(device, scene, number)
    session = observe(device, scene, rng, effects)
    if suite == "garbage":
        kind = GARBAGE[number % len(GARBAGE)]
        if kind == "degrees" and all(c["unit"] == "count" for c in channels(device)):
            kind = "random"
        what = kind
        session = garbage(family, device, session, rng, kind)
    return Case(family, suite, number, device, effects, truths, session, check, text, what)


def channels(device: Device) -> list[dict[str, Any]]:
    """As the mechanism declares them."""
    out: list[dict[str, Any]] = device.drawing.mechanism["channel"]
    return out


def mishap(
    device: Device, scene: Scene, rng: Rng, kind: str
) -> tuple[tuple[Effect, ...], tuple[Truth, ...]]:
    """Bad readings whose noncentrality is drawn, each pose its share, of which it shows half."""
    linear = Linear(device, scene)
    for _ in range(60):
        effect = catalogue.bad(device, rng, scene, kind)
        try:
            many = 2.0 if kind == "two poses" else 1.0
            effect = linear.scaled(effect, many * float(rng.uniform(*STRENGTH)))
        except ValueError:
            continue
        poses = frozenset(int(scene.label[row]) for row in effect.rows)
        seen = linear.by_pose(effect)
        if min(seen[pose - 1] for pose in poses) < STRENGTH[0] / 2:
            continue
        names = frozenset({("data", effect.target)})
        strength = linear.noncentrality(effect)
        return (effect,), (Truth(kind, names, poses=poses, strength=strength),)
    raise ValueError("no bad reading shows")


def wrong_noise(device: Device, scene: Scene, number: int) -> tuple[str, str]:
    """A declared noise, and a declared play, that are not the true ones.

    Play alone is wrong only where it is most of what there is: elsewhere no data would show it.
    """
    factor = FACTORS[number % len(FACTORS)]
    declared = any("noise" in c for c in channels(device))
    if not declared:
        mechanism = deepcopy(device.drawing.mechanism)
        for channel, sigma in zip(mechanism["channel"], device.noise, strict=True):
            channel["noise"] = float(sigma * factor)
        return f"noise x {factor}", rsicalib.Mechanism.from_dict(mechanism).to_toml()
    plays = number % 2 == 1 and Linear(device, scene).play_share > 0.5
    if plays:
        return f"play x {factor}", toml(device, 1.0, factor)
    return f"noise and play x {factor}", toml(device, factor, factor)


def garbage(family: str, device: Device, session: Session, rng: Rng, kind: str) -> Session:
    """Readings that have nothing to do with this machine."""
    values = session.values
    low, high = linkage.limits(device.drawing.mechanism)
    if kind == "random":
        q = rng.uniform(low, high, values.shape)
        return session.changed(within(device, (q - device.offsets) / device.gains))
    if kind == "another mechanism":
        q = low + (high - low) * another(family, rng, session.scene.label, values.shape[1])
        return session.changed(within(device, (q - device.offsets) / device.gains))
    if kind == "degrees":
        turning = [c["unit"] == "rad" for c in channels(device)]
        return session.changed(np.where(turning, np.degrees(values), values))
    order = np.roll(np.arange(values.shape[1]), 1)
    return session.changed(within(device, values[:, order]))


def another(family: str, rng: Rng, label: Array, channels: int) -> Array:
    """Joint coordinates of machines of other families, pose by pose, in parts of their ways.

    Their loops close, and move smoothly within their limits; only the machine is another one. A
    machine of the same family would differ in its dimensions alone, which offsets and gains may
    make up for: such readings are no garbage.
    """
    columns: list[Array] = []
    while len(columns) < channels:
        other = str(rng.choice([name for name in FAMILIES if name != family]))
        try:
            device = Device.random(other, rng)
            q = device.closed(stage(device, rng, samples=1))
        except ValueError:
            continue
        low, high = linkage.limits(device.drawing.mechanism)
        columns += list(((q - low) / (high - low))[(label - 1) % len(q)].T)
    return np.stack(columns[:channels], axis=1)


def within(device: Device, values: Array) -> Array:
    """Whole counts within range where a channel has counts."""
    out = values.copy()
    for k, channel in enumerate(channels(device)):
        if channel["unit"] == "count":
            out[:, k] = np.rint(np.clip(out[:, k], *channel["range"]))
    return out


# ------------------------------------------------------------------ the library


def readings_of(mechanism: Any, session: Session) -> Any:
    """A session as the library takes it."""
    scene = session.scene
    begin = scene.turn * SESSION_S
    again = np.arange(len(begin)) - np.flatnonzero(np.diff(scene.label, prepend=0))[scene.label - 1]
    keys = {"group": list(scene.group), "at": list(scene.at)} if scene.group else None
    return Readings.from_arrays(
        mechanism,
        session.values,
        pose=scene.label if session.held else None,
        time_s=begin + SAMPLE_S * again,
        temperature_c=22.0 + scene.warmth if session.warm else None,
        keys=keys,
        columns=session.columns or None,
    )


def scored(case: Case, mechanism: Any, result: Any) -> float | None:
    """Rms error of the carried points, or of the platform, at the check poses [length unit].

    Points are compared after the best rigid motion: a machine does not know where it stands. These
    poses are taken after the session: what slipped in it has slipped.
    """
    standing = [slipped(e) if e.term == "slip" else e for e in case.effects]
    standing = [e for e in standing if not e.bound]
    device, scene = case.device, case.check
    values, columns = device.ideal(scene, standing)
    session = Session(scene, values, columns, case.session.held, case.session.warm)
    found = forward(readings_of(mechanism, session), mechanism, result)
    true = device.points(scene, standing)
    platform = device.drawing.mechanism.get("platform")
    if platform:
        centre = np.mean([true[name] for name in platform], axis=0)
        return float(np.sqrt(np.mean((found[:, :3] - centre) ** 2)))
    there = np.stack(list(true.values()), axis=1).reshape(-1, 3)
    return rigid_rms(np.asarray(found).reshape(-1, 3), there)


def slipped(effect: Effect) -> Effect:
    """A slip after it happened."""
    law = effect.bends
    assert law is not None

    def bends(size: float, q: Array, scene: Scene) -> Array:
        return law(size, q, replace(scene, label=np.full_like(scene.label, LATE)))

    return replace(effect, bends=bends, bound=False)


LATE = 1000
"""A pose after every pose of a session."""


def rigid_rms(first: Array, second: Array) -> float:
    """Rms distance per component after the best rigid motion."""
    a, b = first - first.mean(axis=0), second - second.mean(axis=0)
    left, _, right = np.linalg.svd(a.T @ b)
    sign = np.diag([1.0, 1.0, np.linalg.det(left @ right)])
    return float(np.sqrt(np.mean((a @ left @ sign @ right - b) ** 2)))


def told(case: Case, mechanism: Any, readings: Any) -> Any:
    """The calibration that is told what is wrong; None where it cannot be."""
    if not case.effects or any(t.outside for t in case.truths):
        return None
    bad = sorted(row for effect in case.effects for row in effect.rows)
    if bad:
        keep = np.ones(len(readings), dtype=bool)
        keep[bad] = False
        return calibrate(readings.select(keep), mechanism)
    specs = []
    for effect in case.effects:
        if effect.term == "slip":
            law = effect.bends
            assert law is not None
            step = law(1.0, case.session.scene.q, case.session.scene).any(axis=1)
            pose = int(case.session.scene.label[np.flatnonzero(step)[0]])
            specs.append(f"{effect.told}:{pose}")
        elif effect.told is None:
            return None
        else:
            specs.append(effect.told)
    terms = [*case.device.drawing.mechanism["model"]["terms"], *specs]
    return calibrate(readings, mechanism, terms=terms)


CHARGE = 4.0
"""For each parameter, in units of χ²."""


def behind(said: Any, truth: Any) -> float | None:
    """By how much χ² of what is said is above that of the truth, parameters charged."""
    if truth is None:
        return None
    after, own = said.after, truth.fit
    return float(after.chi2 - own.chi2 - CHARGE * (after.dof - own.dof))


def truly(case: Case, mechanism: Any, readings: Any) -> Any:
    """The calibration that is told what is wrong; None where it cannot be, or is refused."""
    try:
        return told(case, mechanism, readings)
    except (InputError, ValueError, np.linalg.LinAlgError):
        return None


def compared(case: Case, mechanism: Any, readings: Any, result: Any, truth: Any) -> Errors:
    """Errors before, after and told the truth, each where it can be had."""
    found: list[float | None] = []
    for get in (lambda: calibrate(readings, mechanism), lambda: result, lambda: truth):
        try:
            with np.errstate(all="ignore"):
                fit = get()
                found.append(None if fit is None else scored(case, mechanism, fit))
        except (InputError, ValueError, np.linalg.LinAlgError):
            found.append(None)
    return Errors(*found)


def by_calibrate(readings: Any, mechanism: Any) -> int:
    """The exit code of the other verb; 2 where it refuses."""
    try:
        return calibrate(readings, mechanism).exit_code
    except InputError:
        return 2


def truth_of(device: Device, parameter: Any) -> float | None:
    """What was put in: an offset, a gain, a coordinate of an unknown point; None for an effect."""
    if parameter.term in ("offset", "gain"):
        own = {"offset": device.offsets, "gain": device.gains}[parameter.term]
        return float(own[device.names.index(parameter.target)])
    for (group, at), place in (device.drawing.sockets or {}).items():
        if parameter.target == f"socket[group={group},at={at}]":
            return float(place["xyz".index(parameter.name)])
    return None


def covered(device: Device, result: Any) -> tuple[bool, ...]:
    """Of every parameter whose truth and interval are known: whether one holds the other."""
    known = [(p, truth_of(device, p)) for p in result.parameters if p.sd is not None]
    return tuple(abs(p.value - t) <= SURE * p.sd for p, t in known if t is not None)


def run(family: str, suite: str, number: int, seed: int) -> Row:
    """Makes, examines and grades one case."""
    case = make(family, suite, number, seed)
    what = tuple(
        f"{e.term}@{e.target}" if not e.rows else f"{t.term} {sorted(t.poses)}"
        for e, t in zip(case.effects, case.truths, strict=True)
    )
    row = Row(
        family,
        suite,
        number,
        (*what, case.what) if case.what and not case.effects else what,
        tuple(t.strength or 0.0 for t in case.truths),
        None,
        Errors(),
        0.0,
    )
    start = perf_counter()
    try:
        mechanism = Mechanism.from_toml(case.text)
        readings = readings_of(mechanism, case.session)
        result = trace(readings, mechanism)
    except InputError as error:
        return replace(row, error=str(error), seconds=perf_counter() - start)
    except Exception as error:  # a defect is a figure, not the end of the run
        seconds = perf_counter() - start
        return replace(row, error=f"{type(error).__name__}: {error}", crashed=True, seconds=seconds)
    seconds = perf_counter() - start
    fitted = suite in ("single", "pair", "outside", *FAINT)
    code = None if fitted else by_calibrate(readings, mechanism)
    errors, truth = Errors(), None
    if suite in ("single", "pair", "wrong_readings", *FAINT):
        truth = truly(case, mechanism, readings)
    timed = any(e.bound and e.outside for e in case.effects)  # no check pose says when it is
    if suite in ("single", "pair", "outside", "wrong_readings", *FAINT) and not timed:
        errors = compared(case, mechanism, readings, result, truth)
    answer = result.to_dict()
    return replace(
        row,
        grade=grade(answer, result.exit_code, case.truths, errors),
        errors=errors,
        seconds=seconds,
        noise_said=speaks_of_noise(answer),
        calibrated=code,
        covered=covered(case.device, result) if suite in ("clean", "wrong_readings") else (),
        behind=behind(result, truth) if suite in ("single", "pair", *FAINT) else None,
    )
