"""Poses that decide, measured: `python -m tests.blind.planning --ties 100 --devices 50`.

Sessions of simulated devices with one effect of a sensor curve or of time, in which `trace` lists
several explanations. Further poses are planned in several ways, read from the same device, and
traced anew together with the session. An explanation is right where it leaves less than 5 % of what
the effect does to the platform, in fits of noise-free readings of the same poses: a cosine that
imitates a square is right. A tie is decided where the explanations that are left, less than 12
behind the best in penalised χ², are all right or all wrong.

Seeds are drawn at random and printed; `--seed` repeats a run.
"""

from __future__ import annotations

import argparse
import json
import secrets
import sys
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from functools import cache
from typing import Any

import numpy as np

import rsicalib
from rsicalib.facts.records import plain
from rsicalib.planning.further import explanations, words
from rsicalib.planning.plan import plan
from rsicalib.planning.plans import Plan
from rsicalib.report.words import NO_TERM
from tests import oracle
from tests.blind import effects as catalogue
from tests.blind import simulator
from tests.blind.effects import Effect
from tests.blind.scene import SAMPLE_S, SESSION_S, Scene, held, room
from tests.blind.simulator import Device
from tests.oracle import Array

KINDS: tuple[type[Effect], ...] = (
    catalogue.Curvature,
    catalogue.Cubic,
    catalogue.OncePerTurn,
    catalogue.TwicePerTurn,
    catalogue.Drift,
    catalogue.TemperatureOffset,
    catalogue.TemperatureGain,
)
"""Sensor curves and effects of time and warmth."""

WAYS = ("decide", "volume", "random")
SIZES = ((24, 4), (48, 8))
"""Poses and samples of a session, by turns."""
RIGHT = 0.05
WIDE = np.array([[-3.0, 3.0], [-3.0, 3.0], [-5.7, -0.3]] + 3 * [[-np.pi / 6, np.pi / 6]])
EXACT = np.zeros(2)
"""A hand that takes poses as they are planned."""
MARGIN = 20
"""Counts that a wide pose keeps from the ends of the range."""


@dataclass(frozen=True)
class Tie:
    """A session that leaves several explanations, with all that it takes to go on measuring."""

    number: int
    device: Device
    effect: Effect
    scene: Scene
    samples: int
    values: Array
    rest: Any
    room: Callable[[Array], Array]
    result: Any

    @property
    def targets(self) -> set[str]:
        """Targets of the explanations."""
        return {t.target for r in self.result.rivals for t in r.terms}


@dataclass(frozen=True)
class Outcome:
    """What further poses brought."""

    number: int
    way: str
    poses: int
    truth: str
    named: str
    decided: bool
    """What is left, less than 12 behind, is all right or all wrong."""
    alone: bool
    """One explanation is left: all others are 12 behind."""
    settled: bool
    """Of the explanations that the plan could tell apart one alone is left, and is the best."""
    right: bool
    """The best explanation is right."""
    across: bool
    """The explanations had different targets."""
    placed: bool
    """All that is left has the right target."""
    forecast: float | None = None
    least_lambda: float | None = None


def settling(rng: np.random.Generator) -> Callable[[Array], Array]:
    """A room that warms during a session, and levels off in a quarter of a session after it."""
    during = room(rng)

    def temperature(turn: Array) -> Array:
        beyond = np.maximum(np.asarray(turn) - 1.0, 0.0)
        trend: Array = 6.0 * (0.25 * (1.0 - np.exp(-4.0 * beyond)) - beyond)
        return during(turn) + trend

    return temperature


def wide_poses(rng: np.random.Generator, device: Device, count: int) -> Array:
    """Random poses of the workspace: shape (count, 6)."""
    drawn = rng.uniform(WIDE[:, 0], WIDE[:, 1], (8 * count + 40, 6))
    kept = drawn[device.allows(drawn)]
    return kept[:count] if len(kept) >= count else wide_poses(rng, device, count)


@cache
def built(known: bool = False) -> Any:
    """The mechanism as it is built: the drawing lets an elbow go straight, its stops do not.

    With what is `known` of its sensors as well, weakly: six poses alone do not determine them.
    """
    drawing = rsicalib.load_mechanism("rsi").to_dict()
    for channel, limits in zip(drawing["channel"], 3 * simulator.LIMITS.tolist(), strict=True):
        channel["limits"] = limits
    if known:
        drawing["model"]["sd"] = {"offset": 0.1, "gain": 0.05 * abs(oracle.GAIN)}
    return rsicalib._core.Mechanism.from_dict(plain(drawing))


def readings_of(scene: Scene, values: Array) -> Any:
    """Readings of a scene as the library holds them."""
    return rsicalib.Readings.from_arrays(
        rsicalib.load_mechanism("rsi"),
        values,
        pose=scene.label,
        time_s=scene.time_s,
        temperature_c=scene.temperature_c,
    )


def continued(
    old: Scene, poses: Array, samples: int, warmth: Callable[[Array], Array], waits: Array
) -> Scene:
    """The scene with more poses after it, at the same pace, after pauses in shares of a session."""
    count = int(old.label.max())
    pace = SESSION_S / max(count - 1, 1)
    begin = SESSION_S + pace * np.arange(1, len(poses) + 1) + SESSION_S * np.cumsum(waits)
    number = np.repeat(np.arange(len(poses)), samples)
    sample = np.tile(np.arange(1, samples + 1), len(poses))
    last = len(old.label) - 1
    before = np.where(number == 0, last, last + 1 + (number - 1) * samples)
    return replace(
        old,
        pose=np.concatenate([old.pose, poses[number]]),
        label=np.concatenate([old.label, count + 1 + number]),
        sample=np.concatenate([old.sample, sample]),
        before=np.concatenate([old.before, before]),
        time_s=np.concatenate([old.time_s, begin[number] + SAMPLE_S * (sample - 1)]),
        temperature_c=np.concatenate(
            [old.temperature_c, np.round(warmth(begin[number] / SESSION_S), 3)]
        ),
    )


def tie(number: int, seed: int) -> Tie | None:
    """A session with one effect; None where `trace` finds no tie with the truth in it."""
    rng = np.random.default_rng([seed, number])
    device = Device.random(rng)
    poses, samples = SIZES[number % len(SIZES)]
    warmth = settling(rng)
    scene = held(
        rng, simulator.hand_poses(rng, poses, device), samples, (0.0, 0.0), 0.0, SESSION_S, warmth
    )
    effect = KINDS[int(rng.integers(len(KINDS)))].draw(rng)
    values = simulator.digitise(device.ideal(scene, (effect,)), rng, 1.0, (effect,))
    rest_session = simulator.rest(device, rng, effects=(effect,))
    rest = rsicalib.Readings.from_arrays(rsicalib.load_mechanism("rsi"), rest_session["values"])
    result = rsicalib.trace(readings_of(scene, values), rest=rest)
    truth = (effect.term, effect.target)
    rivals = [[(t.term, t.target) for t in r.terms] for r in result.rivals]
    if len(result.steps) != 1 or not result.steps[0].also_fits or [truth] not in rivals:
        return None
    return Tie(number, device, effect, scene, samples, values, rest, warmth, result)


def further_poses(it: Tie, way: str, count: int, seed: int) -> tuple[Array, Array, Plan | None]:
    """Poses (n, 6), pauses (n,) and the plan."""
    if way == "random":
        rng = np.random.default_rng([seed, it.number, 7])
        return wide_poses(rng, it.device, count), np.zeros(count), None
    criterion = None if way == "decide" else way
    readings = readings_of(it.scene, it.values)
    return reached(it.device, count, it.result, readings, criterion, it.number)


def reached(
    device: Device,
    count: int,
    result: Any,
    readings: Any,
    criterion: str | None,
    seed: int,
    known: bool = False,
) -> tuple[Array, Array, Plan]:
    """A plan whose poses the device can take: others are struck off, and planned again."""
    off = np.empty((0, 9))
    found = None
    for _ in range(4):
        found = plan(
            built(known),
            count,
            result=result,
            beside=readings,
            criterion=criterion,
            off=off if len(off) else None,
            seed=seed,
        )
        can = device.allows(found.poses)
        if can.all():
            break
        off = np.vstack([off, found.readings[~can]])
    assert found is not None
    waits = np.array(found.waits) if found.waits else np.zeros(len(found.poses))
    return found.poses, waits, found


def missed(rng: np.random.Generator, device: Device, poses: Array, misses: Array) -> Array:
    """Where a hand ends up that misses poses by these standard deviations [in, rad].

    The stops of the device let it go as far as half or a quarter of a miss where not all of it.
    """
    errors = rng.standard_normal(poses.shape) * np.repeat(misses, 3)
    ends = np.array(poses)
    for share in (0.25, 0.5, 1.0):
        there = poses + share * errors
        ends = np.where(device.allows(there)[:, None], there, ends)
    return ends


def measured(
    it: Tie, poses: Array, waits: Array, seed: int, misses: Array = EXACT
) -> tuple[Scene, Array]:
    """The session with these poses as the device reads them, those it can take."""
    can = it.device.allows(poses)
    rng = np.random.default_rng([seed, it.number, 11])
    ends = missed(rng, it.device, poses[can], misses)
    scene = continued(it.scene, ends, it.samples, it.room, waits[can])
    ideal = it.device.ideal(scene, (it.effect,))[len(it.values) :]
    more = simulator.digitise(ideal, rng, 1.0, (it.effect,))
    return scene, np.concatenate([it.values, more])


def left(it: Tie, scene: Scene, terms: Sequence[str]) -> float:
    """Platform error [in] over the workspace of a fit of noise-free readings with these terms."""
    rng = np.random.default_rng([it.number, 13])
    poses = wide_poses(rng, it.device, 40)
    judged = held(rng, poses, 1, (0.0, 0.0), 0.0, SESSION_S, it.room)
    mechanism = rsicalib.load_mechanism("rsi")
    check = rsicalib.Readings.from_arrays(
        mechanism,
        np.clip(it.device.ideal(judged, (it.effect,)), 0, 4095),
        pose=judged.label,
        time_s=judged.time_s,
        temperature_c=judged.temperature_c,
        poses=judged.pose,
    )
    exact = readings_of(scene, np.clip(it.device.ideal(scene, (it.effect,)), 0, 4095))
    fit = rsicalib.calibrate(
        exact, rest=it.rest, check=check, terms=["offset", "gain", *terms], noise=1.0
    )
    assert fit.fit.check is not None
    return float(fit.fit.check.position_rms)


def leaves_little(it: Tie, scene: Scene, terms: Sequence[Any]) -> bool:
    """Whether an explanation leaves less than 5 % of what the effect does."""
    specs = [t.term if t.target is None else f"{t.term}@{t.target}" for t in terms]
    if specs == [f"{it.effect.term}@{it.effect.target}"]:
        return True
    if any(t.place or t.term in NO_TERM for t in terms):
        return False
    return left(it, scene, specs) < RIGHT * left(it, scene, [])


def settled(it: Tie, found: Plan | None, rivals: Sequence[Any]) -> bool:
    """Whether one alone is left, and the best, of the explanations that the plan could tell apart.

    Explanations that it did not know of do not count: a free curve comes up wherever a curve is
    named, some 10 behind, and no pose tells a curve from all smooth ones.
    """
    of = [(_name(terms), words(terms)) for terms, _, _ in explanations(it.result)]
    merged = {} if found is None else _merged([told for _, told in of], found)
    group = {name: merged.get(told, told) for name, told in reversed(of)}
    known = [group.get(_name(r.terms)) for r in rivals]
    return len(set(known) - {None}) == 1 and known[0] is not None


def _name(terms: Sequence[Any]) -> frozenset[tuple[str, str]]:
    """Terms and targets: where a slip is placed may move by a pose."""
    return frozenset((t.term, t.target) for t in terms)


def _merged(names: Sequence[str], found: Plan) -> dict[str, str]:
    """Explanations with those that no pose within reach tells them from."""
    same = {f"no pose within reach tells {a} from {b}": (a, b) for a in names for b in names}
    return dict(same[line] for line in found.merged)


def outcome(it: Tie, way: str, count: int, seed: int, misses: Array = EXACT) -> Outcome:
    """Plans, measures and traces anew."""
    poses, waits, found = further_poses(it, way, count, seed)
    scene, values = measured(it, poses, waits, seed, misses)
    forecast = None if found is None else found.forecast
    result = rsicalib.trace(readings_of(scene, values), rest=it.rest)
    rivals = result.rivals
    best = rivals[0].terms if rivals else ()
    rights = [leaves_little(it, scene, r.terms) for r in rivals]
    return Outcome(
        number=it.number,
        way=way,
        poses=count,
        truth=f"{it.effect.term} {it.effect.target}",
        named=" + ".join(f"{t.term} {t.target}" for t in best) or "nothing",
        decided=bool(rights) and len(set(rights)) == 1,
        alone=len(rights) == 1,
        settled=settled(it, found, rivals),
        right=bool(rights) and rights[0],
        across=len(it.targets) > 1,
        placed=bool(rivals) and {t.target for r in rivals for t in r.terms} == {it.effect.target},
        forecast=None if forecast is None else forecast.decides,
        least_lambda=None if forecast is None else forecast.least_lambda,
    )


def ties(count: int, seed: int) -> Iterator[Tie]:
    """So many ties, in the order of their numbers."""
    number = found = 0
    while found < count:
        it = tie(number, seed)
        number += 1
        if it is not None:
            found += 1
            yield it


def rate(values: Sequence[bool]) -> str:
    """A share with its standard error, and of how many."""
    n = len(values)
    if n == 0:
        return "-"
    share = sum(values) / n
    padded = (sum(values) + 1) / (n + 2)
    return f"{100 * share:5.1f} ± {100 * np.sqrt(padded * (1 - padded) / n):.1f} % of {n}"


def table(rows: Sequence[Outcome]) -> list[str]:
    """The rows of the table, way by way."""
    lines = []
    for count in sorted({row.poses for row in rows}):
        for way in WAYS:
            own = [r for r in rows if r.way == way and r.poses == count]
            if not own:
                continue
            across = [r for r in own if r.across]
            lines += [
                f"{way}, {count} poses",
                f"  decided and right     {rate([r.decided and r.right for r in own])}",
                f"    and alone           {rate([r.alone and r.right for r in own])}",
                f"  decided and wrong     {rate([r.decided and not r.right for r in own])}",
                f"  undecided             {rate([not r.decided for r in own])}",
                f"  names the right one   {rate([r.right for r in own])}",
                f"  across targets        {rate([r.placed for r in across])}",
            ]
            safe = [r for r in own if r.least_lambda is not None and r.least_lambda >= 25.0]
            if safe:
                lines.append(
                    f"  λ ≥ 25, right         {rate([r.decided and r.right for r in safe])}"
                )
            lines += calibration([r for r in own if r.forecast is not None])
    return lines


def calibration(rows: Sequence[Outcome]) -> list[str]:
    """Forecasts by fifths of the range, beside what came: settled, and right."""
    lines = []
    for name, low, high in (
        *((f"{k / 5:.1f}", k / 5, (k + 1) / 5) for k in range(5)),
        ("all", 0, 1),
    ):
        own = [r for r in rows if low <= float(r.forecast or 0.0) < high + (high == 1)]
        if own:
            foreseen = 100 * float(np.mean([r.forecast for r in own]))
            came = rate([r.settled and r.right for r in own])
            lines.append(f"  forecast {name:>4}: said {foreseen:5.1f} %, came {came}")
    return lines


def platform_error(number: int, seed: int, way: str, more: int = 12) -> float:
    """Platform error [in] over the workspace after 6 random poses and more, 8 samples each."""
    rng = np.random.default_rng([seed, number, 17])
    device = Device.random(rng)
    first = wide_poses(rng, device, 6)
    warmth = settling(rng)
    scene = held(rng, first, 8, (0.0, 0.0), 0.0, SESSION_S, warmth)
    values = simulator.digitise(device.ideal(scene), rng, 1.0)
    mechanism = rsicalib.load_mechanism("rsi")
    rest = rsicalib.Readings.from_arrays(mechanism, simulator.rest(device, rng)["values"])
    if way == "random":
        poses = wide_poses(rng, device, more)
    else:
        result = rsicalib.calibrate(readings_of(scene, values), built(known=True), rest=rest)
        old = readings_of(scene, values)
        poses = reached(device, more, result, old, way, number, known=True)[0]
        poses = poses[device.allows(poses)]
    whole = continued(scene, poses, 8, warmth, np.zeros(len(poses)))
    ideal = device.ideal(whole)[len(values) :]
    values = np.concatenate([values, simulator.digitise(ideal, rng, 1.0)])
    judged = held(rng, wide_poses(rng, device, 60), 1, (0.0, 0.0), 0.0, SESSION_S, warmth)
    check = rsicalib.Readings.from_arrays(
        mechanism, np.clip(device.ideal(judged), 0, 4095), pose=judged.label, poses=judged.pose
    )
    fit = rsicalib.calibrate(readings_of(whole, values), built(known=True), rest=rest, check=check)
    assert fit.fit.check is not None
    return float(fit.fit.check.position_rms)


def main() -> int:
    """Runs the ties and the devices, and prints the table."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--ties", type=int, default=100)
    parser.add_argument("--devices", type=int, default=50)
    parser.add_argument("--poses", type=int, nargs="+", default=[6, 12])
    parser.add_argument("--ways", nargs="+", default=list(WAYS), choices=WAYS)
    parser.add_argument(
        "--misses",
        type=float,
        nargs=2,
        default=EXACT.tolist(),
        metavar=("LENGTH", "ANGLE"),
        help="standard deviations by which poses are missed [in, rad]",
    )
    parser.add_argument("--seed", type=int)
    parser.add_argument("--out", help="a file for the rows, one JSON object a line")
    args = parser.parse_args()
    seed = secrets.randbits(32) if args.seed is None else args.seed
    print(f"seed {seed}", flush=True)
    rows: list[Outcome] = []
    out = None if args.out is None else open(args.out, "w", encoding="utf-8")
    for k, it in enumerate(ties(args.ties, seed)):
        for way in args.ways:
            for count in args.poses:
                rows.append(outcome(it, way, count, seed, np.array(args.misses)))
                if out is not None:
                    out.write(json.dumps(vars(rows[-1])) + "\n")
                    out.flush()
        if k % 10 == 9:
            print(f"{k + 1} ties", file=sys.stderr, flush=True)
    print("\n".join(table(rows)), flush=True)
    for way in ("platform", "offsets", "volume", "random") if args.devices else ():
        errors = [platform_error(k, seed, way) for k in range(args.devices)]
        print(
            f"platform error after 6 random and 12 {way} poses [1e-3 in]: "
            f"mean {1e3 * np.mean(errors):.2f} ± {1e3 * np.std(errors) / len(errors) ** 0.5:.2f}, "
            f"median {1e3 * np.median(errors):.2f}, of {len(errors)}",
            flush=True,
        )
    return 0


if __name__ == "__main__":
    sys.exit(main())
