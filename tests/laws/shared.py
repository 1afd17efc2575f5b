"""Chains of one drawing that share a mistake, or that each have their own.

`python -m tests.laws.shared --devices 40 --seed 0` prints how often one constant is named where
there is one, and where the chains differ.
"""

from __future__ import annotations

import argparse
from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import partial
from multiprocessing import get_context

import numpy as np

from rsicalib import Mechanism, trace
from tests.families import effects as catalogue
from tests.families.device import Device, Effect, Scene, observe, stage
from tests.families.draw import Rng
from tests.families.grade import TIE
from tests.families.linkage import Build
from tests.families.power import TWIN, Linear
from tests.families.trials import STRENGTH, readings_of, toml
from tests.laws.trials import built, taken
from tests.oracle import Array

Place = tuple[str, str]
"""A term and its target."""


def together(effects: Sequence[Effect], shares: Sequence[float], target: str) -> Effect:
    """One effect of all chains, `share` times as large in each."""

    def builds(size: float, build: Build) -> Build:
        for effect, share in zip(effects, shares, strict=True):
            if effect.builds is not None:
                build = effect.builds(size * share, build)
        return build

    def bends(size: float, q: Array, scene: Scene) -> Array:
        laws = [(e.bends, share) for e, share in zip(effects, shares, strict=True)]
        return np.asarray(sum(law(size * share, q, scene) for law, share in laws if law))

    first = effects[0]
    return replace(
        first,
        target=target,
        builds=None if first.builds is None else builds,
        bends=None if first.bends is None else bends,
    )


def places(device: Device) -> list[Place]:
    """What can be shared by the chains of a device, of those in the catalogue of the simulator."""
    chains = device.drawing.mechanism["chain"]
    rows = chains[0]["dh"]
    sensed = [k for k, row in enumerate(rows) if "channel" in row]
    out: list[Place] = []
    for term in ("link_length", "link_offset"):
        out += [(term, f"each/{k + 1}") for k in range(len(rows))]
    out += [("joint_tilt", f"each/{k + 1}") for k in sensed[:-1]]
    joints = range(1, len(sensed) + 1)
    for term in ("curvature", "cubic", "once_per_turn", "hysteresis"):
        out += [(term, f"each.{j}") for j in joints]
    out += [("point_position", "each"), ("base_tilt", "each")]
    if "gravity" in device.drawing.mechanism:
        out += [("sag", "all"), *(("joint_sag", f"each.{j}") for j in joints)]
    return [place for place in out if single(device, place, 0)]


def single(device: Device, place: Place, seed: int) -> list[Effect]:
    """The same effect of every chain; none where the simulator does not have it there."""
    term, target = place
    chains = device.drawing.mechanism["chain"]
    out = []
    for chain in chains:
        own = [row["channel"] for row in chain["dh"] if "channel" in row]
        at = chain["name"]
        if "/" in target:
            at = f"{chain['name']}/{target.split('/')[1]}"
        elif "." in target:
            at = own[int(target.split(".")[1]) - 1]
        # Every chain alike: directions and phases from the same draws.
        rng = np.random.default_rng(seed)
        if term == "joint_sag":
            out.append(joint_sag(device, at))
            continue
        if at not in catalogue.targets(device, term):
            return []
        out.append(catalogue.CATALOGUE[term](device, rng, at))
    return out


def joint_sag(device: Device, target: str) -> Effect:
    """A joint that gives under a weight at the end of its chain."""
    from tests.laws.draw import hanging

    i = device.names.index(target)

    def bends(size: float, q: Array, scene: Scene) -> Array:
        out = np.zeros(q.shape)
        out[:, i] = abs(size) * hanging(device, q, i)
        return out

    return Effect("joint_sag", "load", target, 4e-3 / device.length, bends=bends)


def twins(linear: Linear, effect: Effect, own: Place) -> set[Place]:
    """Everything shared that these readings cannot tell from it."""
    left = linear.left(linear.mean(effect))
    out = {own}
    draw_all = {
        place: [together(single(linear.device, place, k), [1.0] * 3, place[1]) for k in range(3)]
        for place in places(linear.device)
    }
    # By the symmetry of a machine one chain may do to the loop what all do.
    for term in ("base_tilt", "joint_tilt", "point_position"):
        for target in catalogue.targets(linear.device, term):
            make = catalogue.CATALOGUE[term]
            draw_all[term, target] = [
                make(linear.device, np.random.default_rng(k), target) for k in range(3)
            ]
    for place, draws in draw_all.items():
        columns = np.column_stack([linear.left(linear.column(e)) for e in draws])
        long = np.linalg.norm(columns, axis=0)
        if np.all(long > 1e-6):
            fit = np.linalg.lstsq(columns / long, left, rcond=1e-9)[0]
            rest = left - columns / long @ fit
            if float(rest @ rest) < TWIN:
                out.add(place)
    return out


@dataclass(frozen=True)
class Said:
    """What was said of one device."""

    family: str
    truth: Place
    agree: bool
    strength: float
    names: frozenset[Place]
    steps: tuple[Place, ...]
    ties: tuple[tuple[Place, ...], ...]
    verdict: str

    @property
    def shared(self) -> bool:
        """Whether anything is said to be shared."""
        return any(target.startswith(("each", "all")) for _, target in self.steps)

    @property
    def one(self) -> bool:
        """Whether one constant is named, where there is one."""
        return len(self.steps) == 1 and (self.shared or self.steps[0] in self.names)

    @property
    def right(self) -> bool:
        """Whether that is of the right term, or tied with few others."""
        if len(self.steps) != 1:
            return False
        ties = set(self.ties[0])
        named = {self.steps[0]} | (ties if len(ties) <= TIE else set())
        return bool(self.names & named)


def device_of(family: str, rng: Rng) -> tuple[Device, Scene]:
    """A device with a session."""
    if family == "rsi":
        device = built(rng)
        return device, taken(device, rng, 48, 8)
    device = Device.random(family, rng)
    return device, stage(device, rng)


def run(asked: tuple[str, bool, int], seed: int) -> Said:
    """One device; `agree`: one constant, else each chain its own."""
    family, agree, number = asked
    for attempt in range(20):
        words = [seed, ("rsi", "rps").index(family), int(agree), number, attempt]
        rng = np.random.default_rng(np.random.SeedSequence(words))
        try:
            device, scene = device_of(family, rng)
            linear = Linear(device, scene)
            there = places(device)
            place = there[(number + 7 * attempt) % len(there)]
            parts = single(device, place, int(rng.integers(1 << 30)))
            shares = [1.0] * 3 if agree else list(rng.uniform(-1.0, 1.0, 3))
            effect = linear.scaled(together(parts, shares, place[1]), rng.uniform(*STRENGTH))
            if not agree:
                alike = together(parts, [1.0] * 3, place[1])
                column, left = linear.left(linear.column(alike)), linear.left(linear.mean(effect))
                rest = left - column * (column @ left) / (column @ column)
                if rest @ rest < STRENGTH[0] or place[0] in ("sag", "joint_sag"):
                    continue
            names = twins(linear, effect, place) if agree else {place}
            session = observe(device, scene, rng, (effect,))
        except ValueError:
            continue
        break
    else:
        raise RuntimeError(f"{asked}: no such device in twenty drawings")
    mechanism = Mechanism.from_toml(toml(device))
    result = trace(readings_of(mechanism, session), mechanism)
    steps = [s for s in result.to_dict()["steps"]]
    return Said(
        family,
        place,
        agree,
        linear.noncentrality(effect),
        frozenset(names),
        tuple((s["term"], s["target"]) for s in steps),
        tuple(tuple((n["term"], n["target"]) for n in s["also_fits"]) for s in steps),
        str(result.verdict),
    )


def main(arguments: Sequence[str] | None = None) -> None:
    """The command."""
    parser = argparse.ArgumentParser(prog="python -m tests.laws.shared", description=__doc__)
    parser.add_argument("--devices", type=int, default=20, help="of each kind")
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--jobs", type=int, default=1)
    options = parser.parse_args(arguments)
    numbers = range(options.devices)
    asked = [(f, agree, k) for f in ("rsi", "rps") for agree in (True, False) for k in numbers]
    with get_context("spawn").Pool(options.jobs) as pool:
        every = pool.map(partial(run, seed=options.seed), asked, chunksize=1)
    for family in ("rsi", "rps"):
        for agree in (True, False):
            rows = [row for row in every if (row.family, row.agree) == (family, agree)]
            good = sum(row.one for row in rows) if agree else sum(row.shared for row in rows)
            words = "one constant named" if agree else "chains differ, yet one constant named"
            words += f" (term right: {sum(row.right for row in rows)})" if agree else ""
            verdicts = dict(Counter(row.verdict for row in rows))
            print(f"{family}: {words}: {good} of {len(rows)}; {verdicts}")
            for row in rows:
                if not row.one if agree else row.shared:
                    print(
                        f"    {row.truth} {row.strength:.0f}: {row.verdict} {row.steps} "
                        f"{row.ties} for {sorted(row.names)}"
                    )


if __name__ == "__main__":
    main()
