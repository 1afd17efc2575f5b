"""One encoder that is coarser than the others of a machine: what is said of clean sessions.

`python -m tests.families.steps --devices 12 --seed 100` prints, for steps of so many times the
noise of that encoder, how often a calibration is called otherwise than adequate.
"""

from __future__ import annotations

import argparse
from collections.abc import Sequence

import numpy as np

from rsicalib import Mechanism, calibrate
from tests.families.device import Device, observe, stage
from tests.families.trials import readings_of, toml

FAMILIES = ("fivebar", "ballbar", "sockets")
"""Machines with encoders in radians."""
STEPS = (0, 2, 3, 4, 8)
"""Steps, in noises of the encoder; none at all is the control."""
CHANNEL = 1


def verdict(family: str, number: int, seed: int, steps: int) -> str:
    """What is said of one device whose second encoder reads in such steps."""
    rng = np.random.default_rng(np.random.SeedSequence([seed, FAMILIES.index(family), number]))
    device = Device.random(family, rng)
    session = observe(device, stage(device, rng), rng)
    values = session.values.copy()
    if steps:
        step = steps * device.noise[CHANNEL]
        values[:, CHANNEL] = step * np.rint(values[:, CHANNEL] / step)
    mechanism = Mechanism.from_toml(toml(device))
    return str(calibrate(readings_of(mechanism, session.changed(values)), mechanism).verdict)


def main(arguments: Sequence[str] | None = None) -> None:
    """Print a line for each size of steps."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--devices", type=int, default=12, help="of each family")
    parser.add_argument("--seed", type=int, default=100)
    options = parser.parse_args(arguments)
    for steps in STEPS:
        said = {
            family: [verdict(family, k, options.seed, steps) for k in range(options.devices)]
            for family in FAMILIES
        }
        wrong = {family: sum(v != "adequate" for v in of) for family, of in said.items()}
        total = len(FAMILIES) * options.devices
        print(f"steps of {steps} noises: {sum(wrong.values())} of {total} {wrong}", flush=True)


if __name__ == "__main__":
    main()
