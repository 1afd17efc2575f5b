"""A draw wire: a length that is read with every sample, in a column or by a channel.

The witness is the arm of `tests/cone.py`, whose tip goes anywhere, in products of plain matrices;
the wire has noise of its own, and the encoders hardly any.
"""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

import rsicalib
from rsicalib import Mechanism
from tests.cone import LIMITS, OFFSETS, mechanism, tip
from tests.full import sized
from tests.oracle import Array

ANCHOR = np.array([350.0, -200.0, 30.0])
SIGMA, WIRE = 2e-5, 0.5
POSES, SAMPLES = 50, 8


def wire(kind: str, noise: float | None, own: float | None) -> Mechanism:
    """The arm with a wire to an anchor, and what is declared of the noise of either."""
    text = mechanism(noise, None)
    declared = {} if own is None else {"noise": own}
    values = Mechanism(text).to_dict()
    values["point"][1] = {"name": "anchor", "at": ANCHOR.tolist()}
    closure: dict[str, Any] = {
        "name": "wire",
        "kind": "distance",
        "between": ["ball", "anchor"],
    }
    if kind == "column":
        values["closure"] = [{**closure, "value": "wire", **declared}]
    else:
        channel = {"name": "wire", "unit": "mm", "gain": 1.0, "offset": 0.0, **declared}
        values["channel"].append(channel)
        values["closure"] = [{**closure, "channel": "wire"}]
    return Mechanism(values)


def session(seed: int) -> tuple[dict[str, Any], Array]:
    """Held poses anywhere, and the true lengths of the wire; numbers end where a file ends them."""
    rng = np.random.default_rng(seed)
    q = LIMITS[:, 0] + (LIMITS[:, 1] - LIMITS[:, 0]) * rng.uniform(0.05, 0.95, (POSES, 6))
    lengths = np.array([np.linalg.norm(tip(one) - ANCHOR) for one in q])
    q, true = np.repeat(q, SAMPLES, axis=0), np.repeat(lengths, SAMPLES)
    read = (q - OFFSETS + SIGMA * rng.standard_normal(q.shape)).round(7)
    columns = {f"q{k + 1}": read[:, k] for k in range(6)}
    pose = np.repeat(np.arange(1, POSES + 1), SAMPLES)
    table = {
        "pose": pose,
        **columns,
        "wire": (true + WIRE * rng.standard_normal(len(true))).round(4),
    }
    return table, true


CASES = [
    ("column", SIGMA, WIRE),
    ("column", SIGMA, None),
    ("column", None, WIRE),
    ("column", None, None),
    ("channel", SIGMA, WIRE),
    ("channel", None, WIRE),
    # Declared too small, or too large: what repeats show is of the wire, and of no joint.
    ("column", SIGMA, WIRE / 5),
    ("column", None, WIRE / 5),
    ("column", SIGMA, WIRE * 5),
    ("column", None, WIRE * 5),
]


@pytest.mark.parametrize(("kind", "noise", "own"), CASES)
def test_the_noise_of_a_wire_is_the_wires(
    kind: str, noise: float | None, own: float | None
) -> None:
    """Clean sessions lose no reading, and no encoder has noise that is as large at the tip.

    A pose at two metres has the weight of one at a tenth: lengths err alike, areas do not.
    """
    drawn = wire(kind, noise, own)
    off, shares = [], []
    for seed in range(sized(3, 6)):
        table, _ = session(seed)
        found = rsicalib.calibrate(table, drawn)
        assert (found.verdict, found.excluded) == ("adequate", ()), seed
        sigma = found.noise.sigma
        known = sigma["wire"] if kind == "channel" else found.noise.closures["wire"]
        # Of 350 differences a standard deviation is known to 3.8 %: four of these.
        assert known == pytest.approx(WIRE, rel=0.16)
        shares.append(max(sigma[f"q{k}"] for k in range(1, 7)) * 400.0 / WIRE)
        for k in range(1, 7):
            one = found[f"offset@q{k}"]
            assert one.value is not None and one.sd is not None
            off.append((one.value - OFFSETS[k - 1]) / one.sd)
    # 400 mm is a usual arm. Where nobody declares the encoders' noise, repeats tell it as a part of
    # the wire's to about (2 / 350)^¼ of that.
    assert max(shares) < (0.05 if noise else 0.6), shares
    # 36 intervals: the root mean square is 1 with a standard error of 0.12, of 18 of 0.17.
    assert sized(0.45, 0.6) < np.sqrt(np.mean(np.square(off))) < sized(1.65, 1.45)


def test_weights_do_not_depend_on_how_long_the_wire_is() -> None:
    """χ² of the true parameters over poses near and far, by the noise that is declared."""
    table, true = session(7)
    drawn = wire("column", SIGMA, WIRE)
    rms = rsicalib.calibrate(table, drawn).misclosure
    assert rms is not None
    off = np.asarray(table["wire"]) - true
    # The fit absorbs six of four hundred; encoders add 2e-5 rad at some 600 mm.
    assert rms.rms["wire"] == pytest.approx(float(np.sqrt(np.mean(off**2))), rel=0.05)
