"""Make the session that comes with the package: `python -m scripts.make_demo`.

One hand controller from the independent simulator of the tests, with an effect
that its mechanism does not declare. Everything follows from the seed.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np

import rsicalib
from rsicalib.io.files import write_text
from tests.blind import power, simulator
from tests.blind.effects.sensor import Curvature
from tests.blind.scene import held
from tests.blind.simulator import Device, Session

SEED = 1994
POSES, SAMPLES, SIGMA = 48, 8, 1.0
TARGET = "a22"
NONCENTRALITY = 150.0
FOLDER = Path(rsicalib.__file__).with_name("demo")

README = """\
# The session that comes with the package

A simulated RSI hand controller: {poses} held poses × {samples} samples, {sigma:g} count of noise
and a 12-bit converter (`readings.csv`), a reading of the rest pose (`rest.csv`), and 20 other poses
that are known (`check.csv`). One sensor is not what its mechanism declares:
{truth}.

Made by `python -m scripts.make_demo` with seed {seed}; a test makes it again and compares.
"""


def make(seed: int = SEED) -> tuple[dict[str, Session], str]:
    """The three files, and what is wrong with the device."""
    rng = np.random.default_rng(seed)
    device = Device.random(rng)
    scene = held(rng, simulator.hand_poses(rng, POSES, device), SAMPLES, (0.0, 0.0))
    at = {"scene": scene, "sigma": SIGMA}
    effect = power.scaled_to(device, at, Curvature(TARGET, 0.02), NONCENTRALITY)
    files = {
        "readings": simulator.observe(device, scene, rng, SIGMA, (effect,)),
        "rest": simulator.rest(device, rng, effects=(effect,)),
        "check": simulator.check(device, rng, effects=(effect,), like=scene),
    }
    size = f"{effect.size:+.4f} rad at 1000 counts from the middle"
    words = f"`{effect.term}` at `{effect.target}`, {size}"
    return files, words


def readings(session: Session) -> rsicalib.Readings:
    """A session as the package holds it."""
    poses = session.get("poses")
    return rsicalib.Readings.from_arrays(
        rsicalib.load_mechanism("rsi"),
        session["values"],
        pose=session["pose"],
        sample=session["sample"],
        time_s=np.round(session["time_s"], 3),
        temperature_c=np.round(session["temperature_c"], 2),
        poses=None if poses is None else np.round(poses, 6),
    )


def main() -> None:
    """Write the folder."""
    files, truth = make()
    FOLDER.mkdir(exist_ok=True)
    for name, session in files.items():
        readings(session).to_csv(FOLDER / f"{name}.csv")
    text = README.format(poses=POSES, samples=SAMPLES, sigma=SIGMA, truth=truth, seed=SEED)
    write_text(FOLDER / "README.md", text)


if __name__ == "__main__":
    main()
