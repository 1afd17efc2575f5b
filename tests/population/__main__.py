"""What fleets say of their design, by the hundred: `python -m tests.population`.

`--part` chooses a table: `table` is handle error alone and with the others, for tight and loose
production; `sound` counts errors of the drawing that are named in fleets that have none; `first`
the same of what is said of every fleet, without a joint estimate; `forearm` counts fleets of 60
devices whose forearm, .6 % too long in all of them, is named; `linear` counts what is named in many
fleets without an error, drawn with the information of real devices; `sum` is the summed χ² of sound
devices; `speed` is the processor time of a device.
"""

from __future__ import annotations

import argparse
import time
from collections import Counter
from collections.abc import Sequence
from typing import Any

import numpy as np

import rsicalib
from rsicalib import _core
from rsicalib.fleets.devices import calibrate_devices
from rsicalib.fleets.population import ShareJob, first_line, joint
from tests import oracle
from tests.blind.geometry import Geometry, forward_arm, inverse
from tests.oracle import Array
from tests.population.production import MIDDLE, TOLERANCES, Production, clear, frame

LOOSE = {"offset": 0.04, "gain": 0.02, "length": 0.002}
FOREARM = 0.006 * oracle.L3
DESIGN = {"gain": 0.01, "offset@2": 0.02, "length@4": 0.03}
"""What every device of the table has wrong: a part, rad, in."""


def mechanism() -> rsicalib.Mechanism:
    """The hand controller with the tolerances of its drawing."""
    drawn = rsicalib.load_mechanism("rsi").to_dict()
    drawn["model"] = {"terms": ["offset", "gain"], "sd": TOLERANCES}
    return rsicalib.Mechanism.from_dict(drawn)


def shared(
    production: Production, devices: int, seed: int, poses: int
) -> tuple[dict[str, Any], dict[str, Any], list[Any], Any]:
    """What a fleet says of its design; its rows; what was built; its readings."""
    partition, made = frame(production, devices, seed, poses=poses)
    own = mechanism()
    found, rows = joint(own, "device", TOLERANCES, {}, lambda job: [(partition, job(partition))])
    return found, rows, made, partition


def handle_error(rows: dict[str, Any], made: list[Any], rng: np.random.Generator) -> float:
    """Error of the handle's position in poses of a hand, rms over devices and components [in]."""
    offsets, gains = oracle.nominal(oracle.rsi())
    names = [f"a{i}{j}" for i in (1, 2, 3) for j in (1, 2, 3)]
    low, high = np.array([[-2.0, 2.0]] * 2 + [[-4.5, -1.5]] + [[-0.35, 0.35]] * 3).T
    squares = []
    for k, (middle, gain, geometry) in enumerate(made):
        pose = rng.uniform(low, high, (60, 6))
        pose = pose[clear(oracle.rsi_inverse(pose))]
        true = inverse(geometry, pose).reshape(-1, 9)
        counts = (true - middle) / gain
        if rows[f"offset@{names[0]}"][k] is None:
            continue
        shift = np.array([rows[f"offset@{n}"][k] for n in names])
        more = np.array([rows[f"gain@{n}"][k] for n in names])
        angles = (offsets + gains * MIDDLE + shift + (gains + more) * counts).reshape(-1, 3, 3)
        own = Geometry()
        for arm in range(3):
            for row in range(4):
                own = own.with_row(arm, row, 2, rows[f"link_length@arm{arm + 1}/{row + 1}.a"][k])
        wrists = np.stack([forward_arm(own, i, angles[:, i])[0] for i in range(3)], axis=1)
        squares.append((wrists.mean(axis=1) - pose[:, :3]).ravel())
    return float(np.sqrt(np.mean(np.concatenate(squares) ** 2)))


def alone(partition: Any, count: int) -> dict[str, Any]:
    """Corrections of the drawing by each device alone, as `population.parquet` has them."""
    rows = calibrate_devices(partition.frame, "rsi", trace=False)
    offsets, gains = oracle.nominal(oracle.rsi())
    out: dict[str, Any] = {}
    for k in range(9):
        name = f"a{k // 3 + 1}{k % 3 + 1}"
        gain = np.asarray(rows[f"gain@{name}"])
        out[f"gain@{name}"] = gain - gains[k]
        at = np.asarray(rows[f"offset@{name}"]) + gain * MIDDLE
        out[f"offset@{name}"] = at - (offsets[k] + gains[k] * MIDDLE)
    for arm in range(3):
        for row in range(4):
            out[f"link_length@arm{arm + 1}/{row + 1}.a"] = np.zeros(count)
    return out


def table(options: argparse.Namespace) -> None:
    """Handle error alone and with the others."""
    for words, spread in (("tight", {}), ("loose", LOOSE)):
        for poses in (12, 24, 48):
            production = Production(**spread, design=DESIGN)
            found, rows, made, partition = shared(production, options.fleets, options.seed, poses)
            before = handle_error(alone(partition, len(made)), made, np.random.default_rng(0))
            after = handle_error(rows, made, np.random.default_rng(0))
            print(f"{words}, {poses} poses: alone {1e3 * before:.1f}, with the others", end=" ")
            print(f"{1e3 * after:.1f} thousandths of an inch ({len(made)} devices)")
            for one in found["design"]:
                said = f"{one['term']}@{one['target']}"
                print(f"  {said} {one['value']:+.5g} ± {one['sd']:.2g} {one['unit']}", flush=True)


def named(options: argparse.Namespace, production: Production, poses: int) -> None:
    """What is named in fleets."""
    counts: Counter[str] = Counter()
    for seed in range(options.seed, options.seed + options.fleets):
        found, _, _, _ = shared(production, options.devices, seed, poses)
        counts["fleets"] += 1
        counts["outliers"] += len(found["outliers"])
        counts["anything named"] += bool(found["design"])
        said = [f"{one['term']}@{one['target']}" for one in found["design"]]
        counts[f"named {' and '.join(said) or 'nothing'}"] += 1
    print(dict(counts), flush=True)


def first(options: argparse.Namespace, production: Production) -> None:
    """What is said of fleets without a joint estimate."""
    counts: Counter[str] = Counter()
    shifts = within = 0
    for seed in range(options.seed, options.seed + options.fleets):
        partition, _ = frame(production, options.devices, seed)
        rows = calibrate_devices(partition.frame, "rsi", trace=False)
        found = first_line(rows, rsicalib.load_mechanism("rsi"))
        counts["fleets"] += 1
        counts["sum significant"] += found["summed"]["p_value"] < 0.01
        counts["any shift common"] += any(one["common"] for one in found["shifts"])
        shifts += len(found["shifts"])
        within += sum(abs(one["value"]) < one["half"] for one in found["shifts"])
    print(dict(counts), f"{within} of {shifts} intervals hold", flush=True)


def linear(options: argparse.Namespace) -> None:
    """What is named where devices are linear, with the information of real ones and no error."""
    partition, _ = frame(Production(), options.devices, options.seed)
    own = mechanism()
    parameters = [(term, None, None, 0.0, sd) for term, sd in TOLERANCES.items()]
    expected = {"centre": [MIDDLE] * 9, "parameters": parameters}
    told = ShareJob(own, "device", expected, list(TOLERANCES))(partition)["share"]
    spread = {"offset": 0.005, "gain": 0.003 * 1.45e-3, "link_length": 0.004}
    between = np.array([spread[p[0]] for p in told[0]["parameters"]])
    tolerances = [TOLERANCES[p[0]] for p in told[0]["parameters"]]
    rng = np.random.default_rng(options.seed)
    roots = []
    for share in told:
        values, vectors = np.linalg.eigh(share["information"])
        roots.append(vectors * np.sqrt(values.clip(0.0)))
    counts: Counter[str] = Counter()
    inside = total = 0
    for _ in range(options.fleets):
        drawn = []
        for share, root in zip(told, roots, strict=True):
            off = between * rng.standard_normal(len(between))
            h = root @ (root.T @ off + rng.standard_normal(len(between)))
            drawn.append({**share, "information": root @ root.T, "told": h})
        found, *_ = _core.population(drawn, tolerances)
        counts["fleets"] += 1
        counts["anything named"] += bool(found["design"])
        counts["outliers"] += len(found["outliers"])
        inside += sum(abs(p["shift"]) < 1.96 * p["sd"] for p in found["parameters"])
        total += len(found["parameters"])
    print(dict(counts), f"intervals of the shift hold {100 * inside / total:.1f} %", flush=True)


def summed(options: argparse.Namespace) -> None:
    """The summed χ² of sound devices."""
    chi2 = dof = 0.0
    for seed in range(options.seed, options.seed + options.fleets):
        partition, _ = frame(Production(length=0.0), options.devices, seed)
        rows = calibrate_devices(partition.frame, "rsi", trace=False)
        chi2, dof = chi2 + sum(rows["chi2"]), dof + sum(rows["dof"])
    first: Array = np.sqrt(2.0 / dof)
    print(f"chi2/dof {chi2 / dof:.4f} ± {float(first):.4f} of {options.fleets * options.devices}")


def speed() -> None:
    """Processor time of `calibrate_devices` for each of 100 devices, fastest of three."""
    for poses, samples in ((24, 4), (48, 8)):
        partition, _ = frame(Production(length=0.0), 100, 3, poses=poses, samples=samples)
        taken = []
        for _ in range(3):
            begun = time.process_time()
            calibrate_devices(partition.frame, "rsi", trace=False)
            taken.append(time.process_time() - begun)
        print(f"{poses} poses of {samples} samples: {10 * min(taken):.1f} ms a device", flush=True)


def main(arguments: Sequence[str] | None = None) -> None:
    """Print what is asked for."""
    parser = argparse.ArgumentParser(description=__doc__)
    parts = ("table", "sound", "first", "forearm", "linear", "sum", "speed")
    parser.add_argument("--part", choices=parts, default="table")
    parser.add_argument("--fleets", type=int, default=100, help="of table: devices of the fleet")
    parser.add_argument("--devices", type=int, default=60)
    parser.add_argument("--seed", type=int, default=5000)
    options = parser.parse_args(arguments)
    if options.part == "table":
        table(options)
    elif options.part == "sound":
        named(options, Production(), 24)
    elif options.part == "first":
        first(options, Production(length=0.0))
    elif options.part == "forearm":
        named(options, Production(length=0.0005, design={"length@4": FOREARM}), 24)
    elif options.part == "linear":
        linear(options)
    elif options.part == "speed":
        speed()
    else:
        summed(options)


if __name__ == "__main__":
    main()
