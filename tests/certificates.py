"""Whether certificates are true: `python -m tests.certificates --devices 200`.

Hand controllers by the simulator of `tests/blind`, each with an effect of the catalogue, one
outside it, two, or none, at sizes that such effects have. Each is traced, and read once at 200
other places of the workspace: the largest error there is the truth. Limits are log-uniform from 1/5
of the truth to 5 times of it. The decision by a limit follows from the figures of one certificate,
so that each device counts with the share of the limits that it is wrong for, or undecided: a mean
over limits in place of a draw. Half of the devices have ten check poses. `docs/verbs-measured.md`
has the figures.
"""

from __future__ import annotations

import argparse
import json
import sys
import warnings
from collections.abc import Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from time import perf_counter
from typing import Any

import numpy as np
import numpy.typing as npt

import rsicalib
from tests.blind import effects as catalogue
from tests.blind import simulator
from tests.blind.effects.base import Effect
from tests.blind.planning import continued, reached, readings_of, settling, wide_poses
from tests.blind.scene import SESSION_S, Scene, held
from tests.blind.simulator import Device
from tests.oracle import Array

PLACES = 200
CHECKS = 10
MORE = 6
SPREAD = 5.0
"""The truth over the limit is between 1/5 and 5."""
FINE = np.exp(np.linspace(-np.log(SPREAD), np.log(SPREAD), 641))
"""The truth over the limit, log-uniform."""


@dataclass(frozen=True)
class Said:
    """What a certificate says, and what is true."""

    truth: float
    expanded: float | None
    """None where nothing is certified within any limit."""
    seen: tuple[float, float, float] | None
    """The largest error at check poses, its expanded uncertainty, and the least by noise alone."""
    counted: float
    """Known error of effects that are named and not applied."""
    verdict: str


@dataclass(frozen=True)
class Row:
    """One device, before and after the poses that are proposed."""

    number: int
    effects: tuple[str, ...]
    outside: bool
    checked: bool
    before: Said
    after: Said | None
    seconds: float


def drawn(rng: np.random.Generator, outside: bool = False) -> tuple[Effect, ...]:
    """None, one of the catalogue, two of it, or one outside it; none of motion."""
    kinds = [k for k in catalogue.CATALOGUE if not k.moving and not k.mishap]
    strange = [k for k in catalogue.OUTSIDE if not k.moving and not k.mishap]
    which = 3 if outside else rng.choice(4, p=[0.2, 0.4, 0.2, 0.2])
    chosen = [None, [kinds], [kinds, kinds], [strange]][which] or []
    return tuple(of[int(rng.integers(len(of)))].draw(rng) for of in chosen)


def looked_at(
    device: Device,
    rng: np.random.Generator,
    effects: Sequence[Effect],
    warmth: Any,
    places: int,
    samples: int,
) -> tuple[Scene, Array]:
    """Other poses right after the session, all over the workspace, and their readings.

    The room is as warm as on average in the session, to half a kelvin.
    """
    poses = wide_poses(rng, device, places)
    mean = float(np.mean(warmth(np.linspace(0.0, 1.0, 101))))

    def steady(turn: Array) -> Array:
        return mean + 0.5 * np.sin(100.0 * np.asarray(turn))

    scene = held(rng, poses, samples, (0.0, 0.0), SESSION_S, 1.05 * SESSION_S, steady)
    ideal = device.ideal(scene, effects)
    return scene, simulator.digitise(ideal, rng, 1.0, tuple(effects))


def said(result: Any, truth: tuple[Scene, Array]) -> Said:
    """The figures of a certificate, beside the largest true error."""
    scene, values = truth
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", rsicalib.OpenLoopsWarning)
        found = rsicalib.forward(readings_of(scene, values), calibration=result)
    error = float(np.linalg.norm(found[:, :3] - scene.pose[:, :3], axis=1).max())
    one = rsicalib.certify(result, limit=1e3)
    expanded = one.uncertainty.expanded if one.decision == "within" and one.uncertainty else None
    least = one.uncertainty.least if one.uncertainty else 0.0
    seen = [(k.error, k.expanded, least) for k in one.known if k.expanded is not None]
    counted = sum(k.error for k in one.known if k.expanded is None)
    return Said(error, expanded, seen[0] if seen else None, counted, one.verdict)


def device(number: int, seed: int, more: bool, outside: bool = False) -> Row:
    """One device; another is drawn in place of one that cannot take its poses."""
    for attempt in range(20):
        try:
            return certified(number, np.random.default_rng([seed, number, attempt]), more, outside)
        except ValueError as error:
            if isinstance(error, rsicalib.InputError):
                raise
    raise RuntimeError(f"device {number}: none in twenty can take its poses")


def certified(number: int, rng: np.random.Generator, more: bool, outside: bool) -> Row:
    """One device: its session, its certificate, the poses that are proposed, its certificate."""
    start = perf_counter()
    warmth = settling(rng)
    count, samples = ((24, 4), (48, 8))[int(rng.integers(2))]
    it = Device.random(rng)
    effects = drawn(rng, outside)
    poses = simulator.hand_poses(rng, count, it)
    scene = held(rng, poses, samples, (0.0, 0.0), 0.0, SESSION_S, warmth)
    values = simulator.digitise(it.ideal(scene, effects), rng, 1.0, effects)
    rest = rsicalib.Readings.from_arrays(
        rsicalib.load_mechanism("rsi"), simulator.rest(it, rng, effects=effects)["values"]
    )
    truth = looked_at(it, rng, effects, warmth, PLACES, 1)
    check = None
    if outside or number % 2 == 0:
        known, read = looked_at(it, rng, effects, warmth, CHECKS, 8)
        check = rsicalib.Readings.from_arrays(
            rsicalib.load_mechanism("rsi"), read, pose=known.label, time_s=known.time_s,
            temperature_c=known.temperature_c, poses=known.pose,
        )  # fmt: skip
    readings = readings_of(scene, values)
    result = rsicalib.trace(readings, rest=rest, check=check)
    before, after = said(result, truth), None
    if more and result.verdict not in ("implausible", "undetermined"):
        try:
            new, waits, _ = reached(it, MORE, result, readings, "platform", number)
            longer = continued(scene, new, samples, warmth, waits)
            ideal = it.ideal(longer, effects)[len(values) :]
            again = np.vstack([values, simulator.digitise(ideal, rng, 1.0, effects)])
            result = rsicalib.trace(readings_of(longer, again), rest=rest, check=check)
            after = said(result, truth)
        except ValueError:  # no plan, or what was built does not reach it
            after = None
    names = tuple(f"{e.term} {e.target}" for e in effects)
    strange = any(e.outside for e in effects)
    return Row(number, names, strange, check is not None, before, after, perf_counter() - start)


def decisions(one: Said, limits: Array) -> npt.NDArray[np.str_]:
    """What a certificate of these figures says by each limit, (145)."""
    largest, own, noise = one.seen or (0.0, 0.0, 0.0)
    beyond = (max(largest - own, noise) > limits) | (one.counted - alone(one) > limits)
    kept = np.where(claimed(one) <= limits, "within", "undecided")
    return np.where(beyond, "not within", kept)


def share(one: Said, truth: float, low: float, high: float, decision: str) -> float:
    """Share of the limits, truth over limit between two ends, by which this is said."""
    over = FINE[(FINE >= low) & (FINE <= high)]
    return float(np.mean(decisions(one, truth / over) == decision))


def alone(one: Said) -> float:
    """The expanded uncertainty."""
    return one.expanded or np.nan


def claimed(one: Said) -> float:
    """The largest error that a certificate claims: by (145), known errors and U together."""
    left = 0.0
    if one.seen is not None and one.seen[0] > np.hypot(alone(one), one.seen[1]):
        left = one.seen[0]
    return one.counted + left + alone(one)


def upper(shares: Sequence[float], seed: int = 0) -> str:
    """A mean in per cent with its upper 95 % bound: over devices, by the bootstrap."""
    x = np.asarray(shares, dtype=float)
    if not len(x):
        return "none"
    rng = np.random.default_rng(seed)
    means = [x[rng.integers(len(x), size=len(x))].mean() for _ in range(2000)]
    # Where nothing at all was seen, three in so many might be: the rule of three.
    bound = max(float(np.quantile(means, 0.95)), 3.0 / len(x) if not x.any() else 0.0)
    return f"{100 * x.mean():.1f} % (< {100 * bound:.1f} %) of {len(x)}"


def figures(rows: Sequence[Row]) -> str:
    """The table of a campaign."""
    ones = [(r, r.before) for r in rows]
    # The proposed poses are taken where they are asked for; the limits stay as they were.
    later = [(r, r.after or r.before, r.before.truth) for r in rows]
    certain = [s for _, s in ones if s.expanded]
    lines = [
        f"{len(rows)} devices, {sum(r.checked for r in rows)} with check poses",
        f"beyond the limit, accepted              "
        f"{upper([share(s, s.truth, 1.0, SPREAD, 'within') for _, s in ones])}",
        f"  of effects outside the catalogue      "
        f"{upper([share(s, s.truth, 1.0, SPREAD, 'within') for r, s in ones if r.outside])}",
        f"below half the limit, undecided         "
        f"{upper([share(s, s.truth, 1 / SPREAD, 0.5, 'undecided') for _, s in ones])}",
        f"  of results that predict their error   "
        f"{upper([share(s, s.truth, 1 / SPREAD, 0.5, 'undecided') for s in certain])}",
        f"  after {MORE} poses, where undecided      "
        f"{upper([after_more(r, 1 / SPREAD, 0.5) for r, *_ in later])}",
        f"below the limit, rejected               "
        f"{upper([share(s, s.truth, 1 / SPREAD, 1.0, 'not within') for _, s in ones])}",
        f"beyond twice the limit, checked, undecided "
        f"{upper([share(s, s.truth, 2.0, SPREAD, 'undecided') for r, s in ones if r.checked])}",
    ]
    after = [r for r in rows if r.after is not None]
    wrong = [share(r.after, r.after.truth, 1.0, SPREAD, "within") for r in after if r.after]
    lines.append(f"beyond the limit, accepted after {MORE} poses {upper(wrong)}")
    for words, of in (("U", alone), ("known errors and U", claimed)):
        ratio = [s.truth / of(s) for _, s in ones if s.expanded]
        if ratio:
            within = 100 * np.mean(np.array(ratio) <= 1)
            marks = ", ".join(f"{v:.2f}" for v in np.quantile(ratio, [0.05, 0.5, 0.95]))
            lines.append(
                f"truth over {words}: {marks} (5, 50, 95 %); within: {within:.1f} % of {len(ratio)}"
            )
    left = [s for _, s in ones if s.verdict in ("partly_explained", "unexplained")]
    for words, low, high, decision in (
        ("beyond the limit, accepted", 1.0, SPREAD, "within"),
        ("below half the limit, undecided", 1 / SPREAD, 0.5, "undecided"),
    ):
        shares = [share(s, s.truth, low, high, decision) for s in left]
        lines.append(f"of results that leave something, {words} {upper(shares)}")
    kinds = {v: sum(r.before.verdict == v for r in rows) for v in {r.before.verdict for r in rows}}
    lines.append("verdicts: " + ", ".join(f"{v} {n}" for v, n in sorted(kinds.items())))
    return "\n".join(lines)


def after_more(row: Row, low: float, high: float) -> float:
    """Share of the limits that stay undecided after the proposed poses; limits as before."""
    over = FINE[(FINE >= low) & (FINE <= high)]
    limits = row.before.truth / over
    first = decisions(row.before, limits)
    then = decisions(row.after or row.before, limits)
    pairs = zip(first, then, strict=True)
    return float(np.mean([a == "undecided" and b == "undecided" for a, b in pairs]))


def read(path: Path) -> list[Row]:
    """Rows of a campaign."""

    def of(data: Any) -> Said | None:
        if data is None:
            return None
        return Said(**{**data, "seen": data["seen"] and tuple(data["seen"])})

    rows = []
    for line in path.read_text(encoding="utf-8").splitlines():
        data = json.loads(line)
        before = of(data["before"])
        assert before is not None
        rows.append(Row(**{**data, "before": before, "after": of(data["after"])}))
    return rows


def main(arguments: Sequence[str] | None = None) -> int:
    """The command."""
    parser = argparse.ArgumentParser(prog="python -m tests.certificates", description=__doc__)
    parser.add_argument("--devices", type=int, default=200)
    parser.add_argument("--first", type=int, default=0)
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--minutes", type=float, help="begin no other device after so long")
    parser.add_argument("--no-more", action="store_true", help="do not take the proposed poses")
    parser.add_argument("--outside", action="store_true", help="laws of no catalogue, all checked")
    parser.add_argument("--out", type=Path, help="a line of JSON for each device, added to it")
    options = parser.parse_args(arguments)
    rows, start = [], perf_counter()
    for number in range(options.first, options.first + options.devices):
        if options.minutes is not None and perf_counter() - start > 60 * options.minutes:
            break
        rows.append(device(number, options.seed, not options.no_more, options.outside))
        if options.out:
            with options.out.open("a", encoding="utf-8") as file:
                file.write(json.dumps(asdict(rows[-1])) + "\n")
    print(figures(rows if options.out is None else read(options.out)))
    return 0


if __name__ == "__main__":
    sys.exit(main())
