"""One encoder that is coarser than the others of a machine: what is said of it.

`python -m tests.families.steps --devices 12 --seed 100` prints, for steps of so many times the
noise of that encoder, how often a calibration of a clean session is called otherwise than adequate
or leaves poses out, the mean of χ² over its degrees of freedom, how often a trace names
anything, and how often it names a single effect that is there.
"""

from __future__ import annotations

import argparse
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from rsicalib import Mechanism, calibrate, trace
from tests.families.device import Device, Session, observe, stage
from tests.families.grade import is_found
from tests.families.trials import make, readings_of, toml

FAMILIES = ("fivebar", "ballbar", "sockets", "fourbar", "gantry", "rps", "drawwire")
STEPS = (0, 2, 3, 4, 6, 8, 16)
"""Steps, in noises of the encoder; none at all is the control."""
CHANNEL = 1


def coarse(device: Device, session: Session, steps: int) -> Session:
    """The session with the second encoder in such steps."""
    values = session.values.copy()
    step = steps * device.noise[CHANNEL]
    if device.drawing.mechanism["channel"][CHANNEL]["unit"] == "count":
        step = float(np.rint(step))
    if step:
        values[:, CHANNEL] = step * np.rint(values[:, CHANNEL] / step)
    return session.changed(values)


@dataclass(frozen=True)
class Said:
    """What is said of one clean device."""

    adequate: bool
    left_out: bool
    ratio: float
    """χ² over its degrees of freedom."""
    named: bool


def clean(family: str, number: int, seed: int, steps: int) -> Said:
    """What is said of one device without effects."""
    rng = np.random.default_rng(np.random.SeedSequence([seed, FAMILIES.index(family), number]))
    device = Device.random(family, rng)
    session = coarse(device, observe(device, stage(device, rng), rng), steps)
    mechanism = Mechanism.from_toml(toml(device))
    readings = readings_of(mechanism, session)
    found, traced = calibrate(readings, mechanism), trace(readings, mechanism)
    chi2, dof = found.fit.chi2, found.fit.dof
    assert chi2 is not None and dof is not None
    return Said(
        found.verdict == "adequate",
        any(entry.pose is not None for entry in found.excluded),
        chi2 / dof,
        bool(traced.steps) or any(entry.pose is not None for entry in traced.excluded),
    )


def single(family: str, number: int, seed: int, steps: int) -> bool:
    """Whether the one effect of a device is named."""
    case = make(family, "single", number, seed)
    mechanism = Mechanism.from_toml(case.text)
    session = coarse(case.device, case.session, steps)
    answer: dict[str, Any] = trace(readings_of(mechanism, session), mechanism).to_dict()
    return is_found(case.truths[0], answer)


def main(arguments: Sequence[str] | None = None) -> None:
    """Print a line for each size of steps."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--devices", type=int, default=12, help="of each family")
    parser.add_argument("--seed", type=int, default=100)
    parser.add_argument("--family", choices=FAMILIES, nargs="+", default=FAMILIES)
    parser.add_argument("--steps", type=int, nargs="+", default=STEPS)
    parser.add_argument("--singles", action="store_true", help="effects as well")
    options = parser.parse_args(arguments)
    numbers, seed = range(options.devices), options.seed
    for steps in options.steps:
        said = {f: [clean(f, k, seed, steps) for k in numbers] for f in options.family}
        every = [one for of in said.values() for one in of]
        wrong = {f: sum(not one.adequate for one in of) for f, of in said.items()}
        ratios = {f: f"{np.mean([one.ratio for one in of]):.2f}" for f, of in said.items()}
        print(f"steps of {steps} noises: {sum(wrong.values())} of {len(every)} {wrong}")
        print(f"  left out {sum(one.left_out for one in every)}", end=", ")
        print(f"named {sum(one.named for one in every)}, chi2/dof {ratios}", flush=True)
        if options.singles:
            found = {f: sum(single(f, k, seed, steps) for k in numbers) for f in options.family}
            print(f"  single named {sum(found.values())} of {len(every)} {found}", flush=True)


if __name__ == "__main__":
    main()
