"""A planar platform on three cranks: one of its joints, or all, sit elsewhere than drawn.

The witness is plane geometry that shares nothing with the core.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest

import rsicalib

BASE = np.array([[0.0, 0.0], [520.0, 0.0], [260.0, 450.0]])
PLATFORM = np.array([[0.0, 0.0], [80.0, 0.0], [40.0, 70.0]])
CRANK, COUPLER = 190.0, 210.0
NAMES = ["m1", "e1", "w1", "m2", "m3"]
NOISE = 1e-4
POSES, SAMPLES, KNOWN = 48, 6, 20

MECHANISM = f"""
name = "plane"
length_unit = "mm"
channel = [
  {{name = "m1", unit = "rad", gain = 1.0, offset = 0.0, limits = [-3.2, 4.5]}},
  {{name = "e1", unit = "rad", gain = 1.0, offset = 0.0, limits = [-3.2, 4.5], passive = true}},
  {{name = "w1", unit = "rad", gain = 1.0, offset = 0.0, limits = [-3.2, 4.5], passive = true}},
  {{name = "m2", unit = "rad", gain = 1.0, offset = 0.0, limits = [-3.2, 4.5]}},
  {{name = "m3", unit = "rad", gain = 1.0, offset = 0.0, limits = [-3.2, 4.5]}},
]
chain = [
  {{name = "leg1", dh = [
    {{channel = "m1", a = {CRANK}}}, {{channel = "e1", a = {COUPLER}}}, {{channel = "w1"}},
  ]}},
  {{name = "leg2", dh = [{{a = {BASE[1, 0]}}}, {{channel = "m2", a = {CRANK}}}]}},
  {{name = "leg3", dh = [
    {{xyz = [{BASE[2, 0]}, {BASE[2, 1]}, 0]}}, {{channel = "m3", a = {CRANK}}},
  ]}},
]
point = [
  {{name = "p2", chain = "leg1", at = [80, 0, 0]}},
  {{name = "p3", chain = "leg1", at = [40, 70, 0]}},
  {{name = "k2", chain = "leg2", at = [0, 0, 0]}},
  {{name = "k3", chain = "leg3", at = [0, 0, 0]}},
]
closure = [
  {{name = "coupler2", kind = "distance", between = ["p2", "k2"], value = {COUPLER}}},
  {{name = "coupler3", kind = "distance", between = ["p3", "k3"], value = {COUPLER}}},
]
[model]
terms = ["offset"]
"""


def joints(centre: np.ndarray, turned: float, platform: np.ndarray) -> np.ndarray | None:
    """Joint angles of a pose in the plane; none out of reach."""
    c, s = np.cos(turned), np.sin(turned)
    cranks, couplers = [], []
    for base, own in zip(BASE, platform, strict=True):
        wrist = centre + np.array([[c, -s], [s, c]]) @ own
        along = wrist - base
        far = float(np.hypot(*along))
        cosine = (CRANK**2 + far**2 - COUPLER**2) / (2 * CRANK * far)
        if abs(cosine) > 0.97:
            return None
        crank = np.arctan2(along[1], along[0]) + np.arccos(cosine)
        elbow = base + CRANK * np.array([np.cos(crank), np.sin(crank)])
        cranks.append(crank)
        couplers.append(np.arctan2(*(wrist - elbow)[::-1]))
    q = np.array([cranks[0], couplers[0] - cranks[0], turned - couplers[0], cranks[1], cranks[2]])
    low = np.array([-np.pi, -np.pi, -np.pi, 0.0, -np.pi])
    return low + (q - low) % (2 * np.pi)


def session(seed: int, moved: list[float]) -> tuple[dict[str, Any], dict[str, Any]]:
    """A session and known places of `p2`: each joint is that far from where it is drawn."""
    random = np.random.default_rng(seed)
    platform = PLATFORM + np.outer(moved, [0.6, 0.8])
    off = 0.02 * random.standard_normal(5)
    rows: list[dict[str, float]] = []
    known: list[dict[str, float]] = []
    pose = 0
    while pose < POSES + KNOWN:
        centre = np.array([random.uniform(80, 360), random.uniform(40, 300)])
        turned = random.uniform(-0.6, 0.6)
        q = joints(centre, turned, platform)
        if q is None:
            continue
        fitted = pose < POSES
        c, s = np.cos(turned), np.sin(turned)
        place = centre + np.array([[c, -s], [s, c]]) @ platform[1]
        for sample in range(SAMPLES):
            read = q - off + NOISE * random.standard_normal(5)
            row = {"pose": pose + 1, "sample": sample + 1, "time_s": 10.0 * pose + 0.02 * sample}
            row |= dict(zip(NAMES, read, strict=True))
            if fitted:
                rows.append(row)
            else:
                known.append(row | {"x": place[0], "y": place[1], "z": 0.0})
        pose += 1
    columns = [{key: [row[key] for row in some] for key in some[0]} for some in (rows, known)]
    return columns[0], columns[1]


@pytest.fixture
def plane(tmp_path: Path) -> Path:
    """The mechanism in a file."""
    path = tmp_path / "plane.toml"
    path.write_text(MECHANISM)
    return path


def test_what_no_reading_tells_of_a_tool_is_in_no_prediction(plane: Path) -> None:
    """Readings in a plane tell nothing of where a tool is out of it."""
    readings, known = session(5, [0.0, 0.3, 0.3])
    found = rsicalib.trace(readings, mechanism=plane, check=known, check_point="p2")
    assert [step.spec for step in found.steps] == ["point_position@leg1"]
    out = next(p for p in found.parameters if p.term == "point_position" and p.name == "z")
    assert out.value == 0.0 and out.sd is None
    assert any("point_position" in text for text in found.unobservable)
    assert found.predicted is not None and found.after.check is not None
    assert found.predicted.position_sd < 5 * found.after.check.position_rms
    assert "predicted to err" not in found.summary()


def test_one_joint_that_is_elsewhere_than_drawn_is_named(plane: Path) -> None:
    """Along the axes of the platform: 0.3 mm in two directions of which readings tell."""
    readings, known = session(6, [0.0, 0.3, 0.0])
    found = rsicalib.trace(readings, mechanism=plane, check=known, check_point="p2")
    assert [step.spec for step in found.steps] == ["attachment_position@coupler2"], found.summary()
    assert found.verdict == "explained"
    own = [p for p in found.parameters if p.term == "attachment_position"]
    for p, truth in zip(own[:2], [0.18, 0.24], strict=True):
        assert p.sd is not None and abs(p.value - truth) < 4 * p.sd
    # What is applied moves the point: its error is of the offsets and readings alone.
    before, after = found.before.check, found.after.check
    assert before is not None and after is not None
    assert after.position_rms < 0.3 * before.position_rms
