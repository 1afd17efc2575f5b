"""Laws that no catalogue has, on machines of several families: what is said of them.

`python -m tests.outside --devices 20 --seed 7` draws so many devices with such a law, as many with
one effect of the catalogue and as many clean ones, and prints one table. Laws are products of few
factors, each a function of one variable: a joint, a torque, a path travelled, time. The
search under test knows nothing of this grammar, and the arithmetic is the simulator's own.
"""

from __future__ import annotations

import argparse
import warnings
from collections import Counter
from collections.abc import Callable, Sequence
from copy import deepcopy
from dataclasses import dataclass, replace
from functools import lru_cache, partial
from multiprocessing import get_context
from time import perf_counter
from typing import Any

import numpy as np

from rsicalib import Mechanism, calibrate, trace
from rsicalib.errors import InputError, OpenLoopsWarning
from rsicalib.io.files import write_text
from tests.families import linkage, trials, varying
from tests.families.device import Device, Effect, Scene, observe, stage
from tests.families.draw import FAMILIES, Rng
from tests.families.effects import middle, unit
from tests.families.grade import targets as blamed
from tests.families.power import Linear
from tests.families.tables import cell
from tests.laws.trials import built, taken
from tests.oracle import Array

PLACES = ("rsi", *FAMILIES)
"""Families, the hand controller first."""
STRENGTH = (30.0, 300.0)
"""Noncentrality, drawn evenly in its logarithm."""
GREW = 1.1
"""An error that is larger by this factor has grown."""
NEARLY = 1.25
"""The same of an error that has hardly grown."""
STRONG = 100.0
"""Noncentrality from which on a law should be told."""
AS_WELL = 6.0
"""χ² within which two laws fit as well."""
LAW = "unknown_law"
"""What a law that no term has is called in `also_fits`."""
SAME = {"drift": "time", "hysteresis": "direction"}
"""Terms of the catalogue, and what they depend on."""
KINDS = ("outside", "built", "single", "clean", "left_out")
"""Of a law of a sensor outside the catalogue; of such a law of a link or a distance; of one effect
of the catalogue; of none; of one whose term is taken out."""
LAWS = ("outside", "built")

HEAD = """# Laws that no term has

Written by `{command} --report docs/unknown.md`: {devices} machines
of {families} families. The error of one channel is a product of one or two factors: powers, waves
and thresholds of joints, torques, paths travelled, play that remembers its last turns;
noncentrality 30 to 300. The search does not know that grammar, and the arithmetic is the
simulator's own. [The search](search.md) says how such a law is weighed beside what was found.

- *place right*: the channel is named, or blamed, or what is left is said to be there, or a law that
  no term has is said to fit there as well.
- *variables*: `unexplained.depends_on` names one of the law's variables, or says that it cannot be
  told from one that it names. There are none where the verdict is *explained* and no tie is told.
- *a formula predicts check poses as the truth does*: its lines are pasted into the mechanism file,
  the session is traced again, and points at check poses are at most {grew} times as far off as with
  a calibration that knows the law, and not how large it is.
- *error after above that before*: points at check poses are {grew} times worse than those of a
  calibration without what was found. Numbers that are estimated err, also those of the right
  effect: so do those of a calibration that knows it, and not how large it is.
- *links and distances*: the same of machines of which a link, or a distance, is longer by such a
  law of one or two joints.
- *left out*: the catalogue's own effects, the term that describes them taken out of the search.
  Another class or place is wrong; the same sensor by another name is not.
- A rate has its binomial standard error.
"""

Law = Callable[[Array, Scene | None], Array]


@dataclass(frozen=True)
class Factor:
    """A function of one variable of the session."""

    variables: frozenset[str]
    law: Law


def of_joint(device: Device, rng: Rng, name: str, *, bent: bool = False) -> Factor:
    """A power, a wave or a threshold of one joint; a line as well, unless it must be `bent`."""
    i = device.names.index(name)
    mid, half = middle(device)
    kind, at = int(rng.integers(1 if bent else 0, 4)), rng.uniform(-0.4, 0.4)
    pace, phase = rng.uniform(1.5, 4.0), rng.uniform(0, 2 * np.pi)
    shapes: list[Callable[[Array], Array]] = [
        lambda u: u,
        lambda u: np.asarray(u**2),
        lambda u: np.asarray(np.sin(pace * u + phase)),
        lambda u: np.maximum(u - at, 0.0),
    ]
    return Factor(
        frozenset({f"theta[{name}]"}), lambda q, _: shapes[kind]((q[:, i] - mid[i]) / half[i])
    )


def of_first() -> Callable[[float], float]:
    """A scale that the first session has, and others of the device keep: a law knows no session."""
    kept: list[float] = []

    def scale(value: float) -> float:
        if not kept:
            kept.append(max(value, 1e-12))
        return kept[0]

    return scale


def of_path(device: Device, rng: Rng, name: str) -> Factor:
    """Creep with the path that a joint has travelled: to a limit, or without."""
    i, pace, scale = device.names.index(name), rng.uniform(0.0, 4.0), of_first()

    def law(q: Array, scene: Scene) -> Array:
        first = np.flatnonzero(np.diff(scene.label, prepend=0))
        steps = np.abs(np.diff(q[first, i], prepend=q[first[0], i]))
        way = np.cumsum(steps)[scene.label - 1] / scale(float(steps.sum()))
        return way if pace < 1 else np.asarray(-np.expm1(-pace * way))

    return Factor(frozenset({f"travelled[{name}]", "time"}), law)


def of_torque(device: Device, rng: Rng, name: str) -> Factor:
    """The torque of the weights about a joint, its square, or beyond a threshold."""
    i, kind, scale = device.names.index(name), int(rng.integers(3)), of_first()

    def law(q: Array, scene: Scene) -> Array:
        torque = linkage.torques(device.build, q, of_tips="mass" not in str(device.drawing))[:, i]
        u = torque / scale(float(np.abs(torque).max()))
        return [u, u * np.abs(u), np.maximum(np.abs(u) - 0.5, 0.0)][kind]

    return Factor(frozenset({f"torque[{name}]"}), law)


def of_turn(device: Device, rng: Rng, name: str) -> Factor:
    """Play of a joint that remembers its last turn: of two widths, one in the other."""
    i, share = device.names.index(name), rng.uniform(0.05, 0.3)
    _, half = middle(device)

    def law(q: Array, scene: Scene) -> Array:
        first = np.flatnonzero(np.diff(scene.label, prepend=0))
        out = np.zeros(len(first))
        for width in (share * half[i], 3 * share * half[i]):
            at = q[first[0], i]
            for pose, row in enumerate(first):
                at = min(max(at, q[row, i] - width), q[row, i] + width)
                out[pose] += (q[row, i] - at) / width
        return np.asarray(out[scene.label - 1])

    ways = ("direction", "theta", "play", "since_turn")
    return Factor(frozenset(f"{way}[{name}]" for way in ways), law)


@dataclass(frozen=True)
class Told:
    """What was said of one device."""

    family: str
    kind: str
    truth: str
    strength: float
    verdict: str
    said: tuple[str, ...]
    ties: tuple[str, ...]
    blamed: bool
    variables: bool
    named: bool
    place: bool
    before: float
    after: float
    seconds: float
    told: float
    """Error with the law that was found over that of the truth's own fit; zero without a law."""
    by_formula: float
    """The same over that before."""
    known: float
    """Error of a calibration that knows the effect, and not how large it is; zero without one."""
    more: float
    """By how much more χ² is left with the law that was found than by the truth's own fit."""
    by_law: bool
    """Whether a law that no term has is all that speaks against it."""

    @property
    def wrong(self) -> bool:
        """Whether it is explained by what the catalogue has, and no tie told."""
        said = self.verdict == "explained" and LAW not in self.ties
        return said and (self.kind in LAWS or (self.kind == "left_out" and not self.place))

    @property
    def over_the_same(self) -> bool:
        """Whether a drift stands for a path travelled, or a hysteresis for play with a memory."""
        terms = {one.partition("@")[0] for one in self.said}
        over = {SAME[term] for term in terms & set(SAME)}
        return any(one.startswith(tuple(over)) for one in self.truth.split("*")) if over else False

    @property
    def worse(self) -> bool:
        """Whether the error grew."""
        return self.after > GREW * self.before

    @property
    def known_worse(self) -> bool:
        """Whether the error grew with a calibration that knows the effect."""
        return self.known > GREW * self.before


def law_of(device: Device, rng: Rng) -> tuple[Effect, frozenset[str]]:
    """A product of one or two factors at one channel, and the variables that it has.

    One factor alone is no function of the joint's own reading: that the catalogue has, as a curve.
    """
    names = device.names
    name = str(rng.choice(names))
    chain = linkage.chain_of(device.drawing.mechanism, name)
    near = [n for n in names if linkage.chain_of(device.drawing.mechanism, n) == chain]
    others = [n for n in (near if len(near) > 1 and rng.random() < 0.7 else names) if n != name]
    other = str(rng.choice(others or names))
    makers = [of_joint, of_joint, of_path, of_turn]
    if "gravity" in device.drawing.mechanism:
        makers.append(of_torque)
    first = makers[int(rng.integers(len(makers)))]
    both = first is of_joint and (rng.random() < 0.7 or other == name)
    if first is of_joint:
        # A line of another joint alone is crosstalk, which the catalogue has.
        factors = [of_joint(device, rng, other, bent=not both)]
    else:
        factors = [first(device, rng, name if first is of_turn else other)]
    if both or (first in (of_path, of_torque) and rng.random() < 0.4):
        factors.append(of_joint(device, rng, name))
    i = names.index(name)

    def bends(size: float, q: Array, scene: Scene) -> Array:
        out = np.zeros(q.shape)
        out[:, i] = size * np.prod([f.law(q, scene) for f in factors], axis=0)
        return out

    variables = frozenset().union(*(f.variables for f in factors))
    what = "*".join(sorted(variables))
    typical = 0.01 * unit(device, name)
    effect = Effect(what, "sensor", name, typical, bends=bends, outside=True)
    return effect, variables


def built_law(device: Device, rng: Rng) -> tuple[Effect, frozenset[str]]:
    """A law by which a link or a distance is longer: a function of one joint, or a product of two.

    A line of one joint is among them: no term has it.
    """
    places = varying.places(device)
    place = places[int(rng.integers(len(places)))]
    near = [n for n in device.names if linkage.chain_of(device.drawing.mechanism, n) == place.chain]
    names = [str(n) for n in rng.permutation(near or device.names)][: 1 + int(rng.random() < 0.4)]
    factors = [of_joint(device, rng, name) for name in names]

    def law(q: Array) -> Array:
        flat = q.reshape(-1, q.shape[-1])
        each = [f.law(flat, None) for f in factors]
        return np.asarray(np.prod(each, axis=0).reshape(q.shape[:-1]))

    def builds(size: float, build: linkage.Build) -> linkage.Build:
        return varying.Varying.of(build, place, law, size)

    variables = frozenset().union(*(f.variables for f in factors))
    klass = "closure" if place.closure else "geometry"
    what = "*".join(sorted(variables))
    typical = 1e-3 * device.length
    return Effect(what, klass, place.target, typical, builds=builds, outside=True), variables


def outside(
    family: str, number: int, seed: int, kind: str = "outside"
) -> tuple[trials.Case, frozenset[str], Rng]:
    """A device with a law of its own, its variables, and the draws of its session once more."""
    for attempt in range(40):
        place = [seed, PLACES.index(family), number, attempt, *([1] if kind == "built" else [])]
        rng = np.random.default_rng(np.random.SeedSequence(place))
        try:
            hand = family == "rsi"
            device = built(rng) if hand else Device.random(family, rng)
            scene = taken(device, rng, 48, 8) if hand else stage(device, rng)
            check = stage(device, rng, trials.CHECKS if not device.drawing.sockets else 5, 1)
            drawn = built_law if kind == "built" else law_of
            effect, variables = drawn(device, rng)
            linear = Linear(device, scene)
            strength = float(np.exp(rng.uniform(*np.log(STRENGTH))))
            effect = linear.scaled(effect, strength)
            if linear.is_of_few_poses(effect) or linear.twins(effect):
                continue
            again = deepcopy(rng)
            session = observe(device, scene, rng, (effect,))
        except ValueError:
            continue
        text = trials.toml(device)
        case = trials.Case(family, kind, number, device, (effect,), (), session, check, text)
        return case, variables, again
    raise RuntimeError(f"{family} {number}: no such device in forty drawings")


def names_of(entry: dict[str, Any]) -> set[str]:
    """The variables that an entry of `depends_on` names, with those that it cannot tell apart."""
    return {entry["variable"]} | set(entry.get("also") or ())


@dataclass(frozen=True)
class Traced:
    """A device, what is known of its law, and what is said of it."""

    case: trials.Case
    variables: frozenset[str]
    draws: Rng | None
    mechanism: Mechanism
    readings: Any
    found: Any
    seconds: float


@lru_cache(maxsize=16)
def traced(kind: str, family: str, number: int, seed: int) -> Traced:
    """The trace of one device."""
    variables: frozenset[str] = frozenset()
    draws: Rng | None = None
    if kind in LAWS:
        case, variables, draws = outside(family, number, seed, kind)
    else:
        case = trials.make(family, "single" if kind == "left_out" else kind, number, seed)
    without = [e.term for e in case.effects] if kind == "left_out" else None
    mechanism = Mechanism.from_toml(case.text)
    readings = trials.readings_of(mechanism, case.session)
    begin = perf_counter()
    found = trace(readings, mechanism, without=without)
    return Traced(case, variables, draws, mechanism, readings, found, perf_counter() - begin)


def run(asked: tuple[str, str, int], seed: int, pastes: bool = True) -> Told:
    """One device; a formula that is told is tried, unless nobody asks for what it brings."""
    kind, family, number = asked
    it = traced(kind, family, number, seed)
    case, variables, draws, found = it.case, it.variables, deepcopy(it.draws), it.found
    mechanism, readings = it.mechanism, it.readings
    result = found.to_dict()
    fits = (calibrate(readings, mechanism), found)
    errors = [error_of(case, mechanism, fit) for fit in fits]
    told = by_formula = more = known = 0.0
    if pastes and draws is not None:
        known, left = of_truth(case, mechanism, draws)
    elif pastes and (fit := trials.truly(case, mechanism, readings)) is not None:
        known = error_of(case, mechanism, fit)
    if pastes and draws is not None and (law := pasted(case, found)):
        error = error_of(case, *law)
        told = error / max(known, 1e-12)
        more = law[1].to_dict()["after"]["chi2"] - left
        by_formula = error / max(errors[0], 1e-12)
    steps = result["steps"]
    ties = tuple(n["term"] for s in steps for n in s["also_fits"])
    right = {name for truth in case.truths for name in truth.names}
    own = [right & {(s["class"], s["target"])} for s in steps]
    depends = [names_of(e) for e in result["unexplained"].get("depends_on") or []]
    return Told(
        family=family,
        kind=kind,
        truth="; ".join(f"{e.term}@{e.target}" for e in case.effects),
        strength=sum(
            Linear(case.device, case.session.scene).noncentrality(e) for e in case.effects
        ),
        verdict=str(result["verdict"]),
        said=tuple(f"{s['term']}@{s['target']}" for s in steps),
        ties=ties,
        blamed=any(e.target in blamed(result) | also_of(result) for e in case.effects),
        variables=bool(depends) and any(variables & one for one in depends),
        named=bool(own) and all(own) and result["verdict"] == "explained",
        place=bool(own) and all(own),
        before=errors[0],
        after=errors[1],
        seconds=it.seconds,
        told=told,
        by_formula=by_formula,
        known=known,
        more=more,
        by_law="unknown_law" in {reason["kind"] for reason in result.get("reasons") or ()},
    )


def also_of(result: dict[str, Any]) -> set[str]:
    """Targets of which a law that no term has is said to fit, beside the one that is blamed."""
    ties = {n["target"] for s in result["steps"] for n in s["also_fits"] if n["term"] == LAW}
    return ties | set(result["unexplained"].get("also_of") or ())


def error_of(case: trials.Case, mechanism: Mechanism, fit: Any) -> float:
    """Error at the check poses, zero where there is none."""
    try:
        with warnings.catch_warnings():
            # Under what is wrong, the loops of the check poses do not close.
            warnings.simplefilter("ignore", OpenLoopsWarning)
            return trials.scored(case, mechanism, fit) or 0.0
    except (InputError, ValueError):
        return 0.0


def of_truth(case: trials.Case, mechanism: Mechanism, draws: Rng) -> tuple[float, float]:
    """Error at check poses of a calibration that knows the law, and not how large it is; its χ².

    The law is taken off the readings in three sizes, a standard deviation apart: χ² is a parabola.
    """
    (effect,) = case.effects
    strength = Linear(case.device, case.session.scene).noncentrality(effect)
    step = strength**-0.5

    def less(part: float) -> tuple[trials.Case, Any]:
        rest = (replace(effect, size=effect.size * (1.0 - part)),)
        session = observe(case.device, case.session.scene, deepcopy(draws), rest)
        fit = calibrate(trials.readings_of(mechanism, session), mechanism)
        return replace(case, effects=rest, session=session), fit

    low, middle_, high = (less(1.0 + k * step)[1].to_dict()["fit"]["chi2"] for k in (-1, 0, 1))
    bend = low - 2.0 * middle_ + high
    part = 1.0 + step * 0.5 * (low - high) / bend if bend > 0 else 1.0
    rest, fit = less(part)
    return error_of(rest, mechanism, fit), fit.to_dict()["fit"]["chi2"]


def pasted(case: trials.Case, found: Any) -> tuple[Mechanism, Any] | None:
    """The mechanism with the law that was found, and its trace; none where no law was."""
    law = found.to_dict()["unexplained"].get("law")
    if not law:
        return None
    mechanism = Mechanism.from_toml(case.text + "\n" + law["term"])
    return mechanism, trace(trials.readings_of(mechanism, case.session), mechanism)


def table(rows: Sequence[Told]) -> list[tuple[str, str]]:
    """What is counted, and how often."""
    own = {kind: [r for r in rows if r.kind == kind] for kind in KINDS}
    law, built_, out_of = own["outside"], own["built"], own["left_out"]

    def grew(kind: str) -> list[tuple[str, str]]:
        """How often errors grew, beside what a calibration does that knows the effect."""
        all_ = own[kind]
        return [
            (f"{CALLED[kind]}error after above that before", cell([r.worse for r in all_])),
            (
                f"{CALLED[kind]}the same of a calibration that knows the effect",
                cell([r.known_worse for r in all_ if r.known > 0.0]),
            ),
        ]

    out = [
        ("place right", cell([r.blamed for r in law])),
        (
            "the same, of those that are not adequate",
            cell([r.blamed for r in law if r.verdict != "adequate"]),
        ),
        ("variables right, or a tie that holds the right one", cell([r.variables for r in law])),
        ("a formula is told", cell([r.told > 0 for r in law])),
        (
            f"the same, noncentrality {STRONG:g} or more",
            cell([r.told > 0 for r in law if r.strength >= STRONG]),
        ),
        (
            "the formula predicts check poses as the truth does, of all of that noncentrality",
            cell([0 < r.told <= GREW for r in law if r.strength >= STRONG]),
        ),
        (
            f"the same, but within {NEARLY:g} of it",
            cell([0 < r.told <= NEARLY for r in law if r.strength >= STRONG]),
        ),
        (
            f"of these formulas, χ² is at most {AS_WELL:g} above that of the truth's own fit",
            cell([r.more <= AS_WELL for r in law if r.told > 0 and r.strength >= STRONG]),
        ),
        (
            "error with the formula over that before, median",
            f"{np.median([r.by_formula for r in law if r.told > 0] or [np.nan]):.2f}",
        ),
        ("explained by what the catalogue has, no tie told", cell([r.wrong for r in law])),
        (
            "the same, and no drift for a path travelled, nor hysteresis for play",
            cell([r.wrong and not r.over_the_same for r in law]),
        ),
        *grew("outside"),
        ("links and distances: place right", cell([r.blamed for r in built_])),
        ("links and distances: variables right, or a tie", cell([r.variables for r in built_])),
        ("links and distances: explained, no tie told", cell([r.wrong for r in built_])),
        *grew("built"),
        ("catalogue singles named and explained", cell([r.named for r in own["single"]])),
        ("catalogue singles: the unknown law ties", cell([LAW in r.ties for r in own["single"]])),
        *grew("single"),
        (
            "left out: explained by another class or place, no tie told",
            cell([r.wrong for r in out_of]),
        ),
        ("left out: error after above that before", cell([r.worse for r in out_of])),
        (
            "clean devices given an effect of the catalogue",
            cell([bool(r.said) for r in own["clean"]]),
        ),
        ("clean devices given a law that no term has", cell([r.by_law for r in own["clean"]])),
        (
            "clean devices that are not adequate",
            cell([r.verdict != "adequate" for r in own["clean"]]),
        ),
    ]
    verdicts = Counter(r.verdict for r in law)
    return [*out, ("verdicts", ", ".join(f"{v} {n}" for v, n in verdicts.most_common()))]


def page(rows: Sequence[Told], command: str) -> str:
    """The page of the docs."""
    lines = [
        HEAD.format(command=command, families=len(PLACES), grew=GREW, devices=len(rows)),
        "| | |",
        "|---|---|",
    ]
    lines += [f"| {name} | {value} |" for name, value in table(rows)]
    lines += ["", "By family, of the laws outside the catalogue:", ""]
    lines += [
        "| family | place | variables | explained, no tie | error grew |",
        "|---|---|---|---|---|",
    ]
    for family in PLACES:
        law = [r for r in rows if r.kind == "outside" and r.family == family]
        counts = [sum(getattr(r, what) for r in law) for what in COLUMNS]
        lines.append(f"| {family} | {' | '.join(f'{n} of {len(law)}' for n in counts)} |")
    return "\n".join([*lines, ""])


CALLED = {"outside": "", "built": "links and distances: ", "single": "catalogue singles: "}
"""What rows of a kind begin with."""
COLUMNS = ("blamed", "variables", "wrong", "worse")
"""What is counted of each family."""


def main(arguments: Sequence[str] | None = None) -> None:
    """The command."""
    parser = argparse.ArgumentParser(prog="python -m tests.outside", description=__doc__)
    parser.add_argument("--devices", type=int, default=5, help="of each kind and family")
    parser.add_argument("--first", type=int, default=0, help="number of the first")
    parser.add_argument("--kind", choices=[*KINDS, "all"], default="all")
    parser.add_argument("--family", choices=[*PLACES, "all"], default="all")
    parser.add_argument("--seed", type=int, help="drawn where it is not given")
    parser.add_argument("--minutes", type=float, help="begin no other device after so long")
    parser.add_argument("--jobs", type=int, default=1)
    parser.add_argument("--report", help="write the page of the docs there")
    options = parser.parse_args(arguments)
    drawn = int(np.random.default_rng().integers(10**6))
    seed = drawn if options.seed is None else options.seed
    kinds = KINDS if options.kind == "all" else (options.kind,)
    families = PLACES if options.family == "all" else (options.family,)
    numbers = range(options.first, options.first + options.devices)
    asked = [
        (kind, family, number)
        for number in numbers
        for family in families
        for kind in kinds
        if kind in LAWS or family != "rsi"
    ]
    print(f"seed {seed}", flush=True)
    rows: list[Told] = []
    start = perf_counter()
    with get_context("spawn").Pool(options.jobs) as pool:
        for told in pool.imap(partial(run, seed=seed), asked):
            rows.append(told)
            print(
                f"  {told.kind} {told.family} {told.truth} {told.strength:.0f}: {told.verdict} "
                f"{', '.join(told.said)} | {' '.join(dict.fromkeys(told.ties))} "
                f"{'wrong' if told.wrong else ''} error {told.before:.3g} {told.after:.3g} "
                f"{told.seconds:.2f} s",
                flush=True,
            )
            if options.minutes is not None and perf_counter() - start > 60 * options.minutes:
                pool.terminate()
                break
    for name, value in table(rows):
        print(f"| {name} | {value} |")
    if options.report:
        command = f"python -m tests.outside --devices {options.devices} --seed {seed}"
        command += "" if options.minutes is None else f" --minutes {options.minutes:g}"
        write_text(options.report, page(rows, command))


if __name__ == "__main__":
    main()
