"""One trial: a hand controller with a law of its own, traced with and without its line.

`python -m tests.laws.trials --devices 100 --seed 0` prints how often each law is named.
"""

from __future__ import annotations

import argparse
from collections.abc import Sequence
from dataclasses import dataclass
from functools import partial
from multiprocessing import get_context
from time import perf_counter
from typing import Any

import numpy as np

from rsicalib import Mechanism, Term, calibrate, trace
from rsicalib.errors import InputError
from tests.families.device import Device, Scene, observe, stage
from tests.families.draw import Rng
from tests.families.grade import TIE
from tests.families.power import Linear
from tests.families.trials import CHECKS, STRENGTH, Case, readings_of, scored, toml
from tests.laws.draw import LAWS, controller


@dataclass(frozen=True)
class Told:
    """What was said of one device."""

    truth: str
    strength: float
    said: tuple[str, ...]
    also: tuple[tuple[str, ...], ...]
    verdict: str
    before: float
    after: float
    seconds: float

    @property
    def named(self) -> bool:
        """Whether the truth, and nothing else, was named, or tied with few others."""
        if len(self.said) != 1:
            return False
        ties = set(self.also[0]) - {self.said[0]}
        return self.truth == self.said[0] or (self.truth in ties and len(ties) <= TIE)

    @property
    def worse(self) -> bool:
        """Whether the error grew beyond noise."""
        return self.after > 1.1 * self.before


def built(rng: Rng) -> Device:
    """A hand controller."""
    drawing = controller(rng)
    n = len(drawing.mechanism["channel"])
    gain = np.array([c["gain"] for c in drawing.mechanism["channel"]])
    offset = np.array([c["offset"] for c in drawing.mechanism["channel"]])
    middle = 2047.5
    gains = gain * (1 + drawing.gains * np.clip(rng.standard_normal(n), -2, 2))
    shifts = drawing.scatter * np.clip(rng.standard_normal(n), -2, 2)
    return Device(drawing, offset + gain * middle + shifts - gains * middle, gains)


def in_range(device: Device, scene: Scene) -> bool:
    """Whether every pose can be read."""
    readings = (scene.q - device.offsets) / device.gains
    return bool(np.all((readings > 20) & (readings < 4075)))


def taken(device: Device, rng: Rng, poses: int, samples: int) -> Scene:
    """A session within range."""
    for _ in range(20):
        scene = stage(device, rng, poses, samples)
        if in_range(device, scene):
            return scene
    raise ValueError("readings out of range")


def make(law: str, number: int, seed: int) -> Case:
    """Case `number` of a law, of a strength that is drawn."""
    kind = list(LAWS).index(law)
    for attempt in range(12):
        rng = np.random.default_rng(np.random.SeedSequence([seed, kind, number, attempt]))
        try:
            device = built(rng)
            scene = taken(device, rng, 48, 8)
            check = taken(device, rng, CHECKS, 1)
            target = str(rng.choice(LAWS[law].targets(device)))
            effect = LAWS[law].make(device, target)
            effect = Linear(device, scene).scaled(effect, float(rng.uniform(*STRENGTH)))
            session = observe(device, scene, rng, (effect,))
        except ValueError:
            continue
        return Case("rsi", law, number, device, (effect,), (), session, check, toml(device))
    raise RuntimeError(f"{law} {number}: no such device in twelve drawings")


def answer(case: Case, laws: Sequence[dict[str, Any]]) -> Told:
    """What a trace says with these laws in the mechanism."""
    mechanism = Mechanism.from_toml(case.text).with_terms([Term.from_dict(law) for law in laws])
    readings = readings_of(mechanism, case.session)
    effect = case.effects[0]
    begin = perf_counter()
    result = trace(readings, mechanism)
    seconds = perf_counter() - begin
    errors = []
    for fit in (calibrate(readings, mechanism), result):
        try:
            errors.append(scored(case, mechanism, fit) or 0.0)
        except InputError:
            errors.append(0.0)
    steps = result.to_dict()["steps"]
    name = "{term}@{target}".format_map
    return Told(
        truth=f"{effect.term}@{effect.target}",
        strength=Linear(case.device, case.session.scene).noncentrality(effect),
        said=tuple(name(step) for step in steps),
        also=tuple(tuple(name(other) for other in step["also_fits"]) for step in steps),
        verdict=str(result.verdict),
        before=errors[0],
        after=errors[1],
        seconds=seconds,
    )


def run(asked: tuple[str, int], seed: int) -> tuple[Told, Told, Told]:
    """One device: with its own line, with all of them, and with none."""
    law, number = asked
    case = make(law, number, seed)
    every = [own.entry for own in LAWS.values()]
    return answer(case, [LAWS[law].entry]), answer(case, every), answer(case, [])


def main(arguments: Sequence[str] | None = None) -> None:
    """The command."""
    parser = argparse.ArgumentParser(prog="python -m tests.laws.trials", description=__doc__)
    parser.add_argument("--devices", type=int, default=20, help="of each law")
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--jobs", type=int, default=1)
    options = parser.parse_args(arguments)
    asked = [(law, k) for law in LAWS for k in range(options.devices)]
    with get_context("spawn").Pool(options.jobs) as pool:
        every = pool.map(partial(run, seed=options.seed), asked, chunksize=1)
    for law in LAWS:
        rows = [row for (name, _), row in zip(asked, every, strict=True) if name == law]
        alone, among, without = (list(told) for told in zip(*rows, strict=True))
        verdicts = [told.verdict for told in without]
        print(
            f"{law:14s} named {sum(t.named for t in alone)}, among all "
            f"{sum(t.named for t in among)}; without it explained {verdicts.count('explained')}, "
            f"adequate {verdicts.count('adequate')}, error grew {sum(t.worse for t in without)} "
            f"of {len(rows)}, told of it {sum(t.worse for t in alone)}; "
            f"seconds {np.mean([t.seconds for t in without]):.2f} "
            f"to {np.mean([t.seconds for t in among]):.2f}"
        )
        for told in alone:
            if not told.named:
                print(
                    f"    {told.truth} {told.strength:.0f}: {told.verdict} {told.said} {told.also}"
                )
        for told in without:
            if told.verdict == "explained" or told.worse:
                print(
                    f"    without {told.truth} {told.strength:.0f}: {told.verdict} {told.said} "
                    f"{told.before:.4f} {told.after:.4f}"
                )


if __name__ == "__main__":
    main()
