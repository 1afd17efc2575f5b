"""One blind trial: a device, its undeclared effects, a session, and what the library says."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from tests.blind import effects as catalogue
from tests.blind import power, simulator
from tests.blind.effects import Effect
from tests.blind.grade import Grade, grade
from tests.blind.scene import Scene, held, waved
from tests.blind.simulator import Device, Session

SUITES = ("clean", "single", "pairs", "outside", "left_out", "faults")
POSES, SAMPLES, SIGMA = 48, 8, 1.0
FLOOR = 40.0
"""Fainter effects are enlarged to this noncentrality."""


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


def stage(device: Device, rng: np.random.Generator, moving: bool) -> Scene:
    """A recording for what shows in motion only, 48 held poses otherwise."""
    if moving:
        return waved(rng, device.allows)
    return held(rng, simulator.hand_poses(rng, POSES, device), SAMPLES, (0.0, 0.0))


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
    device: Device, session: Session, drawn: tuple[Effect, ...], floor: float
) -> tuple[tuple[Effect, ...], tuple[float, ...]]:
    """Every effect at `floor` or more beside the others; `ValueError` if that takes too much."""
    out = list(drawn)
    for _ in range(2):
        for i, effect in enumerate(out):
            others = [e for e in out if e is not effect]
            if power.noncentrality(device, session, effect, others) < floor:
                out[i] = power.scaled_to(device, session, effect, floor, others)
                if abs(out[i].size) > 5 * effect.sizes[1]:
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
    by_suite = {
        "clean": (),
        "single": catalogue.CATALOGUE,
        "pairs": tuple(k for k in catalogue.CATALOGUE if not k.moving and not k.mishap),
        "outside": catalogue.OUTSIDE,
        "left_out": catalogue.SENSOR,
        "faults": catalogue.FAULTS,
    }
    return by_suite[suite]


def make(suite: str, number: int, seed: int, floor: float = FLOOR) -> Case:
    """Case `number` of a suite: the same for the same seed, whoever runs it and in what order."""
    rng = np.random.default_rng([seed, SUITES.index(suite), number])
    device = Device.random(rng)
    kinds = kinds_of(suite)
    scene = stage(device, rng, bool(kinds) and kinds[number % len(kinds)].moving)
    drawn: tuple[Effect, ...] = ()
    strength: tuple[float, ...] = ()
    while kinds:
        drawn = draw(rng, kinds, number, 2 if suite == "pairs" else 1)
        if suite == "faults":
            if spoils(device, scene, drawn[0]):
                break
            continue
        try:
            drawn, strength = enlarged(device, {"scene": scene, "sigma": SIGMA}, drawn, floor)
            break
        except ValueError:
            continue
    readings = simulator.observe(device, scene, rng, SIGMA, drawn)
    return Case(
        suite=suite,
        number=number,
        device=device,
        effects=drawn,
        strength=strength,
        readings=readings,
        rest=simulator.rest(device, rng, effects=drawn),
        check=simulator.check(device, rng, effects=drawn, like=readings["scene"]),
        without=tuple(e.term for e in drawn) if suite == "left_out" else (),
    )


def examine(case: Case) -> dict[str, Any]:
    """What the library says, as the dictionary of `rsicalib trace --json`."""
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

    options: dict[str, Any] = {"without": list(case.without)} if case.without else {}
    result: dict[str, Any] = rsicalib.trace(
        readings(case.readings),
        mechanism,
        check=readings(case.check),
        rest=readings(case.rest),
        **options,
    ).to_dict()
    return result


def run(suite: str, number: int, seed: int, floor: float = FLOOR) -> Row:
    """Makes, examines and grades one case."""
    case = make(suite, number, seed, floor)
    return Row(
        suite=suite,
        number=number,
        truth=tuple(f"{effect.term} {effect.target}" for effect in case.effects),
        strength=case.strength,
        grade=grade(examine(case), case.effects, left_out=suite == "left_out"),
    )
