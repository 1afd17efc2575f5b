"""Write `docs/gallery.md` and its pictures: `python -m scripts.make_gallery`.

What every term of the catalogue leaves in the residual of one session of the hand controller, as
`rsicalib suppose` draws it. A test compares the page, and that there is a picture of every term.
"""

from __future__ import annotations

import re
from pathlib import Path
from typing import Any

import numpy as np

import rsicalib
from rsicalib.io.files import write_text
from rsicalib.io.readings import Readings
from rsicalib.planning.supposing import Supposition, suppose
from rsicalib.poses.devices import draw_poses, nominal_device

ROOT = Path(__file__).parents[1]
PAGE = ROOT / "docs" / "gallery.md"
PICTURES = ROOT / "docs" / "gallery"

POSES, SAMPLES, NOISE, SEED = 48, 8, 1.04, 7
CHANNEL, CHAIN = "a22", "arm2"
PLACES = {
    "label of a pose": f":{POSES // 2}",
    "name of a channel": ":a21",
    "waves per turn": ":15",
}
"""Where an effect that is searched for stands, by the kind of its place."""
STRENGTH = 150.0
"""Noncentrality of every effect: three of four poses are within noise, and yet it is found."""

OMITTED = ("offset", "gain", "bad_reading", "ratio")
"""What every model has, what is wrong in one pose only, and what this mechanism does not have."""

HEAD = f"""\
# What each effect leaves in the residual

Written by `python -m scripts.make_gallery`; a test compares. One session of the hand
controller, {POSES} poses of {SAMPLES} samples in half an hour of a warming room, offsets
and gains fitted; every effect is as strong as a noncentrality of {STRENGTH:g} makes it.
Each dot is one closure of one pose, in the order of time above, in the order of the
readings of {CHANNEL} below. What only time sorts is a drift or a slip; what the reading
sorts is the sensor of that channel; dots that stay quiet are of closures that do not touch
the chain. A picture of your own poses: `rsicalib suppose READINGS --term
curvature@{CHANNEL}.c2=0.02 --out picture.html`.

"""


def mechanism() -> rsicalib.Mechanism:
    """The hand controller under gravity, with masses of links."""
    values: dict[str, Any] = rsicalib.Mechanism.rsi().to_dict()
    values["gravity"] = [0.0, 0.0, -1.0]
    for chain in values["chain"]:
        for row in chain["dh"][1:]:
            row["mass"], row["com"] = 0.3, [0.5 * row.get("a", 2.0), 0.0, 0.0]
    return rsicalib.Mechanism.from_dict(values)


def session(device: rsicalib.Mechanism, held: bool) -> Readings:
    """Exact readings: held poses in a warming room, or a wave of the handle at 8 per second."""
    rng = np.random.default_rng(SEED)
    nominal = nominal_device(device)
    if held:
        _, exact = draw_poses(nominal, POSES, rng)
        values = np.repeat(exact, SAMPLES, axis=0)
        pose = np.repeat(np.arange(1, POSES + 1), SAMPLES)
        begin = 1800.0 * (pose - 1) / (POSES - 1)
        time = begin + 0.02 * np.tile(np.arange(SAMPLES), POSES)
        warm = 21.0 + 4.0 * begin / 1800.0 + np.sin(begin / 300.0)
        return Readings.from_arrays(device, values, pose=pose, time_s=time, temperature_c=warm)
    time = np.arange(160) / 8.0
    pace = 2 * np.pi * rng.uniform(0.1, 0.4, 6)
    half = np.array([1.5, 1.5, 1.2, 0.4, 0.4, 0.4])
    poses = np.array([0.0, 0.0, -2.9, 0.0, 0.0, 0.0]) + half * np.sin(
        pace * time[:, None] + rng.uniform(0, 6, 6)
    )
    exact = nominal.readings(poses)
    keep = np.isfinite(exact).all(axis=1)
    return Readings.from_arrays(device, exact[keep], time_s=time[keep])


def target(term: dict[str, Any]) -> str:
    """Where the effect is drawn: at the second arm where it can be."""
    for wanted in (CHANNEL, f"{CHAIN}/3", CHAIN, "wrist1-wrist2", "all"):
        if wanted in term["targets"]:
            return wanted
    return str(term["targets"][0])


def supposed(term: dict[str, Any], device: rsicalib.Mechanism) -> tuple[Supposition, Readings]:
    """The effect, as strong as all others."""
    readings = session(device, "motion" not in term["needs"])
    place = PLACES.get(term["place"], "")
    sizes = [p["typical"] * (1.0 if k % 2 == 0 else 0.7) for k, p in enumerate(term["parameters"])]

    def at(factor: float) -> Supposition:
        specs = [
            f"{term['id']}@{target(term)}{place}.{p['name']}={factor * size!r}"
            for p, size in zip(term["parameters"], sizes, strict=True)
        ]
        return suppose(readings, specs, device, noise=NOISE)

    return at(float(np.sqrt(STRENGTH / at(1.0).noncentrality))), readings


def picture(found: Supposition, readings: Readings) -> str:
    """Both orders, one below the other."""
    column = list(readings.channels).index(CHANNEL)
    pose = np.arange(len(readings)) if readings.pose is None else readings.pose
    first = np.unique(pose, return_index=True)[1]
    order = np.argsort(np.asarray(readings.values)[first, column])
    drawn = found.figure(order, f"in the order of the readings of {CHANNEL}").svg()
    # What a pointer would be told: nobody rests one on a picture of a page.
    return re.sub(r"><title>[^<]*</title></circle>", "/>", drawn)


def drawn() -> dict[str, dict[str, Any]]:
    """The terms that are drawn, by their ids."""
    terms = {term["id"]: term for term in rsicalib.terms(mechanism())}
    return {name: term for name, term in terms.items() if term["targets"] and name not in OMITTED}


def text() -> str:
    """The page."""
    sections = []
    for name, term in drawn().items():
        first = " ".join(term["doc"].strip().split("\n\n")[0].split())
        sections.append(
            f"## {name}\n\n{first} [More](terms.md#{name}).\n\n"
            f"![Residual of {name}](gallery/{name}.svg)\n"
        )
    return HEAD + "\n".join(sections)


def picture_of(name: str) -> str:
    """The picture of one term."""
    return picture(*supposed(drawn()[name], mechanism()))


if __name__ == "__main__":
    write_text(PAGE, text())
    PICTURES.mkdir(exist_ok=True)
    for name in drawn():
        write_text(PICTURES / f"{name}.svg", picture_of(name))
