"""A sensor whose law no term has: is the closed form behind the free curve named?

`python -m tests.laws.curves --devices 40 --seed 0` prints, for each form, how often the sensor is
named with a free curve, how often the form is right, and how far the order of a periodic error is.
"""

from __future__ import annotations

import argparse
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import partial
from multiprocessing import get_context
from typing import Any

import numpy as np

from rsicalib import Mechanism, trace
from tests.families.device import Device, Effect, Scene, observe
from tests.families.draw import Rng
from tests.families.power import Linear
from tests.families.trials import STRENGTH, readings_of, toml
from tests.laws.trials import built, taken
from tests.oracle import Array

Law = Callable[[Array], Array]


def n_per_turn(rng: Rng, low: float, high: float) -> tuple[Law, float]:
    """A periodic error of an order that is no whole number."""
    n = float(rng.uniform(1.5, 4.0)) * 2 * np.pi / (high - low)
    phase = rng.uniform(0, 2 * np.pi)
    return lambda q: np.sin(n * q + phase), n


def kink(rng: Rng, low: float, high: float) -> tuple[Law, float]:
    """A gain that changes at one angle."""
    at = float(low + (high - low) * rng.uniform(0.3, 0.7))
    return lambda q: np.maximum(q - at, 0.0), at


def step(rng: Rng, low: float, high: float) -> tuple[Law, float]:
    """A jump at one angle: a slipped tooth, a missing code."""
    at = float(low + (high - low) * rng.uniform(0.3, 0.7))
    return lambda q: (q > at).astype(float), at


def dead_band(rng: Rng, low: float, high: float) -> tuple[Law, float]:
    """A sensor that stands still between two angles."""
    width = (high - low) * rng.uniform(0.1, 0.3)
    at = float(low + (high - low) * rng.uniform(0.2, 0.5))
    return lambda q: -np.clip(q - at, 0.0, width), at


def ripple(rng: Rng, low: float, high: float) -> tuple[Law, float]:
    """Two waves that are no multiples of each other: no closed form that is looked for."""
    n, m = rng.uniform(1.2, 1.8), rng.uniform(2.6, 3.4)
    a, b = rng.uniform(0, 2 * np.pi, 2)
    turn = 2 * np.pi / (high - low)
    return lambda q: np.sin(n * turn * q + a) + np.sin(m * turn * q + b), n * turn


FORMS: dict[str, Callable[[Rng, float, float], tuple[Law, float]]] = {
    "n_per_turn": n_per_turn,
    "kink": kink,
    "step": step,
    "dead_band": dead_band,
    "none": ripple,
}


@dataclass(frozen=True)
class Heard:
    """What was said of one device; `place` is the angle, or the order, that its law hides."""

    form: str
    target: str
    place: float
    strength: float
    verdict: str
    steps: tuple[str, ...]
    law: dict[str, Any] | None
    order: tuple[float, float] | None
    """The order of a periodic error with its standard deviation, where one is named."""

    @property
    def curve(self) -> bool:
        """Whether the sensor is named with a free curve, and nothing else."""
        return self.steps == (f"free_curve@{self.target}",)

    @property
    def periodic(self) -> bool:
        """Whether the sensor is named with a periodic error, and nothing else."""
        return self.steps == (f"n_per_turn@{self.target}",)

    @property
    def right(self) -> bool:
        """Whether the form is named, or tied."""
        if self.law is None:
            return self.periodic and self.form == "n_per_turn"
        return self.form in (self.law["form"] or "none", *self.law["also_fits"])

    @property
    def off(self) -> float | None:
        """Relative error of the order that is named."""
        if self.form != "n_per_turn" or self.order is None:
            return None
        return self.order[0] / self.place - 1.0


def order_of(step: dict[str, Any]) -> tuple[float, float] | None:
    """The order that a step names, with its standard deviation."""
    if step["term"] == "n_per_turn":
        (detune,) = (p for p in step["parameters"] if p["name"] == "detune")
        return float(step["place"]) + detune["value"], detune["sd"]
    law = step.get("curve_law")
    if law is None or law["form"] != "n_per_turn":
        return None
    n = law["parameters"][0]
    return n["value"], (n["interval"][1] - n["interval"][0]) / 4.0


def effect_of(device: Device, scene: Scene, rng: Rng, form: str, target: str) -> Any:
    """The effect at a sensor, and the number that the form hides."""
    i = device.names.index(target)
    q = scene.q[:, i]
    law, place = FORMS[form](rng, float(q.min()), float(q.max()))

    def bends(size: float, q: Array, scene: Scene) -> Array:
        out = np.zeros(q.shape)
        out[:, i] = size * law(q[:, i])
        return out

    return Effect(form, "sensor", target, 0.01, bends=bends), place


def run(asked: tuple[str, int], seed: int) -> Heard:
    """One device."""
    form, number = asked
    for attempt in range(12):
        words = [seed, list(FORMS).index(form), number, attempt]
        rng = np.random.default_rng(np.random.SeedSequence(words))
        try:
            device = built(rng)
            scene = taken(device, rng, 48, 8)
            target = str(rng.choice(device.names))
            effect, place = effect_of(device, scene, rng, form, target)
            linear = Linear(device, scene)
            effect = linear.scaled(effect, float(rng.uniform(*STRENGTH)))
            session = observe(device, scene, rng, (effect,))
        except ValueError:
            continue
        break
    else:
        raise RuntimeError(f"{asked}: no such device in twelve drawings")
    mechanism = Mechanism.from_toml(toml(device))
    steps = trace(readings_of(mechanism, session), mechanism).to_dict()
    return Heard(
        form,
        target,
        place,
        linear.noncentrality(effect),
        steps["verdict"],
        tuple(f"{s['term']}@{s['target']}" for s in steps["steps"]),
        next((s["curve_law"] for s in steps["steps"] if "curve_law" in s), None),
        next((order for s in steps["steps"] if (order := order_of(s)) is not None), None),
    )


def main(arguments: Sequence[str] | None = None) -> None:
    """The command."""
    parser = argparse.ArgumentParser(prog="python -m tests.laws.curves", description=__doc__)
    parser.add_argument("--devices", type=int, default=20, help="of each form")
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--jobs", type=int, default=1)
    parser.add_argument("--misses", action="store_true", help="list what was said")
    options = parser.parse_args(arguments)
    asked = [(form, k) for form in FORMS for k in range(options.devices)]
    with get_context("spawn").Pool(options.jobs) as pool:
        every = pool.map(partial(run, seed=options.seed), asked, chunksize=1)
    for form in FORMS:
        rows = [row for row in every if row.form == form]
        curves = [row for row in rows if row.curve]
        orders = [row for row in rows if row.periodic]
        off = [abs(row.off) for row in curves + orders if row.off is not None]
        named = sum(row.law["form"] == (None if form == "none" else form) for row in curves)
        print(
            f"{form:12s} of {len(rows)}: n per turn alone {len(orders)}, "
            f"free curve alone {len(curves)}; "
            f"form right or tied {sum(row.right for row in curves)}, first {named}"
            + (f"; order off by {100 * max(off):.1f} % at most" if off else "")
        )
        for row in rows:
            if options.misses and not ((row.curve or row.periodic) and row.right):
                said = None if row.law is None else (row.law["form"], row.law["also_fits"])
                print(f"    {row.target} {row.strength:.0f}: {row.verdict} {row.steps} {said}")


if __name__ == "__main__":
    main()
