"""Clean sessions with ten places for an effect, and with ten thousand: `python -m tests.places`.

*Few*: four-bars of `tests/families`, of whose encoders five terms each may be wrong, and nothing
else. *Many*: five-bars in 2,500 poses, each read once, of known noise; beside all terms, each of
four encoders may have slipped before each pose but the first. It is counted what is called
otherwise than adequate, and what is named or left out. `docs/search-measured.md` has the figures.
"""

from __future__ import annotations

import argparse
import secrets
from collections.abc import Sequence
from copy import deepcopy
from time import process_time
from typing import Any

import numpy as np

import rsicalib
from tests.clean import rate
from tests.families.device import Device, observe, stage
from tests.families.trials import readings_of, toml

FEW = ("curvature", "cubic", "once_per_turn", "twice_per_turn", "hysteresis")
"""At two encoders: ten places."""
MANY = 2500
"""Poses: 9,996 places for a slip of four encoders."""


def of_few(seed: int) -> Any:
    """What is said of a four-bar."""
    rng = np.random.default_rng([seed, 0])
    device = Device.random("fourbar", rng)
    mechanism = rsicalib.Mechanism.from_toml(toml(device))
    readings = readings_of(mechanism, observe(device, stage(device, rng), rng))
    without = [term["id"] for term in rsicalib.terms() if term["id"] not in (*FEW, "offset")]
    return rsicalib.trace(readings, mechanism, without=without)


def of_many(seed: int, poses: int = MANY) -> Any:
    """What is said of a five-bar."""
    rng = np.random.default_rng([seed, 1])
    device = Device.random("fivebar", rng)
    drawing = deepcopy(device.drawing.mechanism)
    for channel, sigma in zip(drawing["channel"], device.noise, strict=True):
        channel["noise"] = float(sigma)
    mechanism = rsicalib.Mechanism.from_dict(drawing)
    session = observe(device, stage(device, rng, poses, 1), rng)
    return rsicalib.trace(readings_of(mechanism, session), mechanism)


def main(arguments: Sequence[str] | None = None) -> None:
    """Count, and print a line for each."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--few", type=int, default=1000, help="devices with ten places")
    parser.add_argument("--many", type=int, default=1000, help="devices with ten thousand")
    parser.add_argument("--seed", type=int, default=None, help="drawn where it is not given")
    options = parser.parse_args(arguments)
    seed = secrets.randbelow(2**31) if options.seed is None else options.seed
    print(f"seed {seed}")
    for name, one, devices in (
        ("ten places", of_few, options.few),
        ("ten thousand places", of_many, options.many),
    ):
        if not devices:
            continue
        begun = process_time()
        found = [one(seed + k) for k in range(devices)]
        spent = (process_time() - begun) / len(found)
        print(f"{name}: otherwise than adequate {rate(r.verdict != 'adequate' for r in found)};")
        print(f"  named or left out {rate(bool(r.steps or r.excluded) for r in found)};")
        print(f"  {spent:.2f} s of processor time each", flush=True)


if __name__ == "__main__":
    main()
