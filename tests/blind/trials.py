"""One blind trial: a device, its undeclared effects, a session, and what the library says."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import product
from time import perf_counter
from typing import Any

import numpy as np

from tests.blind import effects as catalogue
from tests.blind import power, simulator
from tests.blind.effects import Effect
from tests.blind.grade import Grade, grade
from tests.blind.scene import Scene, held, waved
from tests.blind.simulator import Device, Session

SUITES = (
    *("clean", "single", "pairs", "triples", "outside", "left_out", "faults", "recordings"),
    "moved",
)
FLOOR = 40.0
"""Fainter effects are enlarged to this noncentrality."""
COUNT = {"pairs": 2, "triples": 3}
"""Effects of a session, where there is more than one."""


@dataclass(frozen=True)
class Conditions:
    """How a session is taken."""

    poses: int = 48
    samples: int = 8
    sigma: float = 1.0
    tremor: tuple[float, float] = (0.0, 0.0)


CLEAN = tuple(
    Conditions(poses, samples, sigma, tremor)
    for poses, samples, sigma, tremor in product(
        (24, 48), (2, 8), (0.5, 1.0, 3.0), ((0.0, 0.0), (0.01, 0.01))
    )
)
"""Clean sessions go through these by turns."""


@dataclass(frozen=True)
class Size:
    """How strong effects are made: at least `floor`, or just so where `exactly`."""

    floor: float = FLOOR
    exactly: bool = False


@dataclass(frozen=True)
class Case:
    """A device with a truth, ready to be examined. `without` names terms kept from the library."""

    suite: str
    number: int
    device: Device
    effects: tuple[Effect, ...]
    strength: tuple[float, ...]
    readings: Session
    rest: Session
    check: Session
    without: tuple[str, ...] = ()


@dataclass(frozen=True)
class Row:
    """What came out of one case."""

    suite: str
    number: int
    truth: tuple[str, ...]
    strength: tuple[float, ...]
    grade: Grade
    told: float | None = None
    """Handle position error of a fit that is told the effects [in]; None where none can be."""
    seconds: float | None = None
    """What the trace took, its check included."""


def stage(
    device: Device, rng: np.random.Generator, moving: bool, how: Conditions | None = None
) -> Scene:
    """A recording for what shows in motion only, held poses otherwise, all within range."""
    if moving:
        return waved(rng, device.allows)
    how = how or Conditions()
    while True:
        poses = simulator.hand_poses(rng, how.poses, device)
        scene = held(rng, poses, how.samples, how.tremor)
        # A hand that trembles at the end of a joint's range gives no reading.
        if device.allows(scene.pose).all():
            return scene


def draw(
    rng: np.random.Generator, kinds: Sequence[type[Effect]], turn: int, count: int = 1
) -> tuple[Effect, ...]:
    """Effects of different terms at different targets; the first goes through `kinds` by turns."""
    first = kinds[turn % len(kinds)].draw(rng)
    drawn = [first]
    others = [kind for kind in kinds if not kind.moving or first.moving]
    while len(drawn) < count:
        other = others[int(rng.integers(len(others)))].draw(rng)
        if all(other.term != e.term and not other.equivalents & e.equivalents for e in drawn):
            drawn.append(other)
    return tuple(drawn)


def enlarged(
    device: Device, session: Session, drawn: tuple[Effect, ...], size: Size
) -> tuple[tuple[Effect, ...], tuple[float, ...]]:
    """Effects as strong as `size` says, each beside the others; `ValueError` if too much."""
    out = list(drawn)
    most = 8 if size.exactly else 5
    for _ in range(2):
        for i, effect in enumerate(out):
            others = [e for e in out if e is not effect]
            if size.exactly or power.noncentrality(device, session, effect, others) < size.floor:
                out[i] = power.scaled_to(device, session, effect, size.floor, others)
                if abs(out[i].size) > most * effect.sizes[1]:
                    raise ValueError(f"{effect.term} at {effect.target} would be unreasonable")
    strength = [
        power.noncentrality(device, session, e, [o for o in out if o is not e]) for e in out
    ]
    return tuple(out), tuple(strength)


def spoils(device: Device, scene: Scene, fault: Effect) -> bool:
    """Whether a fault of the converter changes 1 code in 20 of its channel."""
    codes = np.rint(device.ideal(scene)).astype(np.int64)
    changed = fault.codes(codes)[:, fault.channel] != codes[:, fault.channel]
    return bool(changed.mean() > 0.05)


def kinds_of(suite: str) -> tuple[type[Effect], ...]:
    """What a suite draws from."""
    standing = tuple(k for k in catalogue.CATALOGUE if not k.moving and not k.mishap)
    by_suite = {
        "clean": (),
        "single": catalogue.CATALOGUE,
        "pairs": standing,
        "triples": standing,
        "recordings": tuple(k for k in catalogue.CATALOGUE if k.recorded and not k.mishap),
        "outside": catalogue.OUTSIDE,
        "left_out": standing,
        "faults": catalogue.FAULTS,
        "moved": catalogue.MOVED,
    }
    return by_suite[suite]


def make(suite: str, number: int, seed: int, size: Size | None = None) -> Case:
    """Case `number` of a suite: the same for the same seed, whoever runs it and in what order."""
    rng = np.random.default_rng([seed, SUITES.index(suite), number])
    device = Device.random(rng)
    kinds = kinds_of(suite)
    how = CLEAN[number % len(CLEAN)] if suite == "clean" else Conditions()
    moving = suite == "recordings" or (bool(kinds) and kinds[number % len(kinds)].moving)
    scene = stage(device, rng, moving, how)
    drawn: tuple[Effect, ...] = ()
    strength: tuple[float, ...] = ()
    while kinds:
        drawn = draw(rng, kinds, number, COUNT.get(suite, 1))
        if suite == "faults":
            if spoils(device, scene, drawn[0]):
                break
            continue
        try:
            session = {"scene": scene, "sigma": how.sigma}
            drawn, strength = enlarged(device, session, drawn, size or Size())
            break
        except ValueError:
            continue
    without = tuple(e.term for e in drawn) if suite == "left_out" else ()
    return recorded(suite, number, device, scene, rng, drawn, strength, without, how.sigma)


def recorded(
    suite: str,
    number: int,
    device: Device,
    scene: Scene,
    rng: np.random.Generator,
    drawn: tuple[Effect, ...],
    strength: tuple[float, ...] = (),
    without: tuple[str, ...] = (),
    sigma: float = 1.0,
) -> Case:
    """What a device with these effects reads: in the scene, at rest, and where it is checked."""
    readings = simulator.observe(device, scene, rng, sigma, drawn)
    return Case(
        suite=suite,
        number=number,
        device=device,
        effects=drawn,
        strength=strength,
        readings=readings,
        rest=simulator.rest(device, rng, effects=drawn),
        check=simulator.check(device, rng, effects=drawn, like=readings["scene"]),
        without=without,
    )


def staged(
    seed: Sequence[int],
    *present: Effect,
    exactly: float | None = None,
    without: tuple[str, ...] = (),
    moving: bool = False,
) -> Case:
    """A session with chosen effects, of this noncentrality where one is given."""
    rng = np.random.default_rng(seed)
    device = Device.random(rng)
    scene = stage(device, rng, moving)
    strength: tuple[float, ...] = ()
    if exactly is not None:
        session = {"scene": scene, "sigma": 1.0}
        present, strength = enlarged(device, session, present, Size(exactly, exactly=True))
    return recorded("chosen", seed[-1], device, scene, rng, present, strength, without)


@dataclass(frozen=True)
class Given:
    """A case as the library is given it."""

    mechanism: Any
    readings: Any
    rest: Any
    check: Any


def given(case: Case) -> Given:
    """The three files of a case, as objects of the library."""
    import rsicalib

    mechanism = rsicalib.load_mechanism("rsi")

    def readings(session: Session) -> Any:
        return rsicalib.Readings.from_arrays(
            mechanism,
            session["values"],
            pose=session["pose"],
            time_s=session["time_s"],
            temperature_c=session["temperature_c"],
            poses=session.get("poses"),
        )

    return Given(mechanism, readings(case.readings), readings(case.rest), readings(case.check))


def traced(it: Given, without: Sequence[str] = ()) -> dict[str, Any]:
    """What the library says, as the dictionary of `rsicalib trace --json`."""
    import rsicalib

    options: dict[str, Any] = {"without": list(without)} if without else {}
    result: dict[str, Any] = rsicalib.trace(
        it.readings, it.mechanism, check=it.check, rest=it.rest, **options
    ).to_dict()
    return result


def examine(case: Case) -> dict[str, Any]:
    """What the library says of a case."""
    return traced(given(case), case.without)


def told(case: Case) -> float | None:
    """Handle position error [in] of the fit that is told what is there; None if none can be."""
    import rsicalib

    names = [effect.told() for effect in case.effects]
    if None in names or not names:
        return None
    it = given(case)
    terms = ["offset", "gain", *(name for name in names if name is not None)]
    fit = rsicalib.calibrate(it.readings, it.mechanism, check=it.check, rest=it.rest, terms=terms)
    error: float = fit.to_dict()["fit"]["check"]["position_rms"]
    return error


def run(suite: str, number: int, seed: int, size: Size | None = None) -> Row:
    """Makes, examines and grades one case."""
    case = make(suite, number, seed, size)
    it, start = given(case), perf_counter()
    result = traced(it, case.without)
    seconds = perf_counter() - start
    return Row(
        suite=suite,
        number=number,
        truth=tuple(f"{effect.term} {effect.target}" for effect in case.effects),
        strength=case.strength,
        grade=grade(result, case.effects, left_out=suite == "left_out"),
        told=told(case),
        seconds=seconds,
    )
