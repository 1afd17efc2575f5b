"""Results whose values were edited: refused, told, or as good as before.

    python -m tests.edited --cases 100000

changes values inside the results of simulated sessions, of the hand controller and of an arm whose
ball sits in cones, one to three at a time, in every second one without the digest, applies each to
readings of the same device, and counts what became of it. A place that is off by more than ten of
its standard deviations without a word is a fault, and so is any exception that is not ours.
"""

from __future__ import annotations

import argparse
import copy
import json
import random
import tempfile
import traceback
import warnings
from collections import Counter
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

import rsicalib
from rsicalib.errors import OpenLoopsWarning
from tests import cone

FAR = 10.0
"""Standard deviations by which no pose is off without a word."""

PLAY = 0.02
"""How far the ball sits from the middle of its cone [mm]."""

TEXTS = ("", "x", "a11", "null", "١٢", "rad", "offset", "gain", "\u202e")
NUMBERS = (0.0, 1.0, -1.0, 1e-300, 1e15, 1e300, 0.5, 3, 10**30, -7)

Path_ = tuple[str | int, ...]


@dataclass
class Case:
    """A result that is edited, the readings that it is applied to, and what is right there."""

    result: dict[str, Any]
    readings: Any
    mechanism: Any
    poses: Any
    sd: Any
    file: Path

    @classmethod
    def of(cls, verb: str, seed: int, folder: Path) -> Case:
        made = rsicalib.simulate(poses=24, samples=4, check=8, seed=seed)
        readings = made.readings
        if verb == "trace":
            readings = bent(readings)
        found = getattr(rsicalib, verb)(readings, rest=made.rest)
        return cls.applied(found, readings, "rsi", folder / f"{verb}-{seed}.json")

    @classmethod
    def of_arm(cls, seed: int, folder: Path) -> Case:
        """An arm at two cones, whose places are unknown: its readings say which they touch."""
        path = folder / "arm.toml"
        path.write_text(cone.mechanism(None, PLAY), encoding="utf-8")
        mechanism = rsicalib.load_mechanism(path)
        places = {"A": cone.CONE, "B": cone.CONE + [250.0, 60.0, 80.0]}
        one, other = (
            cone.session(seed + k, samples=4, at=at, cone=place).table
            for k, (at, place) in enumerate(places.items())
        )
        table: dict[str, Any] = {name: [*one[name], *other[name]] for name in one}
        table["pose"] = [*one["pose"], *(pose + len(one["pose"]) for pose in other["pose"])]
        found = rsicalib.calibrate(table, mechanism)
        return cls.applied(found, table, mechanism, folder / f"arm-{seed}.json")

    @classmethod
    def applied(cls, found: Any, readings: Any, mechanism: Any, file: Path) -> Case:
        poses = rsicalib.forward(readings, mechanism, calibration=found)
        sd = rsicalib.forward_sd(readings, mechanism, found)
        return cls(found.to_dict(), readings, mechanism, poses, sd, file)

    def forward(self, edited: dict[str, Any]) -> Any:
        """The poses of the readings under an edited result."""
        self.file.write_text(json.dumps(edited), encoding="utf-8")
        return rsicalib.forward(self.readings, self.mechanism, calibration=self.file)


def bent(readings: rsicalib.Readings) -> rsicalib.Readings:
    """The readings of a sensor with a curve, so that a trace finds it."""
    values = readings.values.copy()
    u = (values[:, 4] - 2047.5) / 2047.5
    values[:, 4] = np.clip(np.round(values[:, 4] + 60.0 * u**2), 0, 4095)
    mechanism = rsicalib.load_mechanism("rsi")
    return rsicalib.Readings.from_arrays(mechanism, values, pose=readings.pose)


def leaves(value: Any, path: Path_ = ()) -> Iterator[Path_]:
    """Paths of all entries, lists and objects included."""
    if path:
        yield path
    items = (
        value.items()
        if isinstance(value, dict)
        else enumerate(value)
        if isinstance(value, list)
        else ()
    )
    for key, inner in items:
        yield from leaves(inner, (*path, key))


def at(value: Any, path: Path_) -> Any:
    for key in path:
        value = value[key]
    return value


def edit(result: dict[str, Any], draw: random.Random) -> str:
    """Change one value of a result; in words what was done."""
    # As many edits where poses come from as everywhere else: most numbers are covariances.
    paths = list(leaves(result))
    near = [p for p in paths if p[-1] == "value" or p[0] in ("reference", "noise")]
    path = draw.choice(draw.choice([paths, near]))
    holder, key, old = at(result, path[:-1]), path[-1], at(result, path)
    number = isinstance(old, int | float) and not isinstance(old, bool)
    kind = draw.choice(
        ["scale", "scale", "shift", "sign", "other", "drop", "swap", "double", "cut"]
    )
    if kind == "scale" and number:
        holder[key] = old * draw.choice(
            [1000.0, 0.001, 2.0, 0.5, 1.0 + 10.0 ** draw.uniform(-6, 0)]
        )
    elif kind == "shift" and number:
        holder[key] = old + draw.gauss(0.0, 1.0) * 10.0 ** draw.uniform(-6, 3)
    elif kind == "sign" and number:
        holder[key] = -old
    elif kind == "drop" and isinstance(holder, dict):
        del holder[key]
    elif kind == "drop":
        holder.pop(key)
    elif kind == "swap":
        same = [p for p in paths if len(p) == len(path) and p[:1] == path[:1] and p[-1] == path[-1]]
        same = [p for p in (same if isinstance(key, str) else paths) if p[:-2] == path[:-2]] or [
            path
        ]
        other = draw.choice(same)
        try:
            holder[key], at(result, other[:-1])[other[-1]] = at(result, other), old
        except (KeyError, IndexError, TypeError):
            return "nothing"
    elif kind == "double" and isinstance(old, list):
        holder[key] = old + old[:1]
    elif kind == "cut" and isinstance(old, list | str):
        holder[key] = old[: len(old) // 2]
    else:
        holder[key] = draw.choice([*TEXTS, *NUMBERS, None, True, [], {}, [1.0], {"a": 1}, [[1.0]]])
    new = holder.get(key) if isinstance(holder, dict) else holder[key : int(key) + 1]
    return f"{kind} {'.'.join(map(str, path))}: {old!r:.60} -> {new!r:.60}"


def outcome(case: Case, draw: random.Random) -> tuple[str, str]:
    """What becomes of an edited result, and the edits."""
    edited = copy.deepcopy(case.result)
    if draw.random() < 0.5:
        del edited["digest"]  # then only the loops can tell
    done = [edit(edited, draw) for _ in range(draw.choice([1, 1, 1, 2, 3]))]
    case.file.write_text(json.dumps(edited), encoding="utf-8")
    words = "; ".join(done)
    try:
        with warnings.catch_warnings(record=True) as said:
            warnings.simplefilter("always")
            read = rsicalib.load_calibration(case.file)
            read.summary()
            if draw.random() < 0.1:
                read.report()
                read.to_json()
            poses = rsicalib.forward(case.readings, case.mechanism, calibration=read)
    except rsicalib.RsicalibError as error:
        return ("refused" if len(str(error)) < 2000 else "endless"), words
    except Exception:
        return "raw", f"{words}\n{traceback.format_exc(limit=-4)}"
    if any(issubclass(one.category, OpenLoopsWarning) for one in said):
        return "told", words
    off = np.abs(poses - case.poses)
    if case.mechanism == "rsi":
        off[:, 3:] = np.minimum(off[:, 3:], 2 * np.pi - off[:, 3:])
    far = bool((~(off <= FAR * case.sd)).any())
    return ("wrong", f"{words}: {np.nanmax(off / case.sd):.3g} sd") if far else ("as good", words)


def run(cases: int, seed: int, folder: Path) -> tuple[Counter[str], list[str]]:
    """Outcomes of so many edits, and those that are faults."""
    draw = random.Random(seed)
    results = [Case.of(verb, k, folder) for k, verb in enumerate(["calibrate", "trace"])]
    results.append(Case.of_arm(7, folder))
    counts: Counter[str] = Counter()
    faults = []
    for _ in range(cases):
        kind, words = outcome(draw.choice(results), draw)
        counts[kind] += 1
        if kind in ("raw", "wrong", "endless"):
            faults.append(f"{kind}: {words}")
    return counts, faults


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--cases", type=int, default=100_000)
    parser.add_argument("--seed", type=int, default=0)
    args = parser.parse_args()
    with tempfile.TemporaryDirectory() as folder:
        counts, faults = run(args.cases, args.seed, Path(folder))
    print(dict(counts))
    print("\n".join(faults[:50]))


if __name__ == "__main__":
    main()
