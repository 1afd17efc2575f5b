"""Terms of links that a URDF draws: along and across the link, and named by its joints.

The witness is the forward kinematics below, by products of matrices, of an arm whose links are not
along any axis of their frames.
"""

from __future__ import annotations

from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt
import pytest

import rsicalib
from rsicalib.io.rigid import rigid
from rsicalib.verbs.export import calibrated
from tests.full import sized

Array = npt.NDArray[np.float64]

LINKS = np.array(
    [
        [0.01, 0.02, 0.30],
        [0.05, 0.03, 0.12],
        [0.02, -0.25, 0.18],
        [0.14, 0.02, 0.22],
        [0.06, 0.16, 0.05],
        [0.03, 0.02, 0.10],
        [0.02, 0.05, 0.12],
    ]
)
"""From each joint to the next in the frame of the one before, the base and the tip included [m]."""
AXES = np.array([[0, 0, 1], [0, 1, 0], [0.6, 0.8, 0], [0, 0, 1], [0, 1, 0], [1, 0, 0]], float)
NAMES = [f"j{k}" for k in range(1, 7)]
NOISE = 2e-5
LONGER = 1.5e-3


def turned(axis: Array, angle: Array) -> Array:
    """Rotations about a unit axis by angles (n,), by Rodrigues: (n, 3, 3)."""
    x, y, z = axis
    k = np.array([[0, -z, y], [z, 0, -x], [-y, x, 0]])
    sine, cosine = np.sin(angle)[:, None, None], np.cos(angle)[:, None, None]
    return np.asarray(np.eye(3) + sine * k + (1 - cosine) * k @ k)


def tip(q: Array, links: Array) -> Array:
    """Places (n, 3) of the tip at joint angles (n, 6)."""
    place, frame = np.zeros((len(q), 3)), np.broadcast_to(np.eye(3), (len(q), 3, 3))
    for link, axis, angle in zip(links, AXES, q.T, strict=False):
        place, frame = place + frame @ link, frame @ turned(axis, angle)
    return np.asarray(place + frame @ links[-1])


def touching(cone: Array, count: int, links: Array, rng: np.random.Generator) -> Array:
    """Joint angles (count, 6) near random ones that bring the tip to a cone."""
    q = rng.uniform(-1.1, 1.1, (8 * count, 6))
    for _ in range(16):
        step = 1e-6 * np.eye(6)
        slope = np.stack([(tip(q + s, links) - tip(q - s, links)) / 2e-6 for s in step], axis=2)
        q = q + (np.linalg.pinv(slope) @ (cone - tip(q, links))[..., None])[..., 0]
    reached = (np.abs(tip(q, links) - cone).max(1) < 1e-12) & (np.abs(q).max(1) < 2.4)
    assert reached.sum() >= count
    return np.asarray(q[reached][:count])


def urdf() -> str:
    """The arm as it is drawn."""
    parts = ['<robot name="skew"> <link name="base"/>']
    for k, (link, axis) in enumerate(zip(LINKS, AXES, strict=False), start=1):
        parent = "base" if k == 1 else f"l{k - 1}"
        xyz, along = (" ".join(f"{v}" for v in vector) for vector in (link, axis))
        parts.append(
            f'<link name="l{k}"/> <joint name="j{k}" type="continuous"> <origin xyz="{xyz}"/>'
            f'<parent link="{parent}"/> <child link="l{k}"/> <axis xyz="{along}"/> </joint>'
        )
    xyz = " ".join(f"{v}" for v in LINKS[-1])
    parts.append(
        f'<link name="ball"/> <joint name="flange" type="fixed"> <origin xyz="{xyz}"/>'
        '<parent link="l6"/> <child link="ball"/> </joint> </robot>'
    )
    return " ".join(parts)


@cache
def mechanism(folder: Path) -> Any:
    (folder / "skew.urdf").write_text(urdf(), encoding="utf-8")
    channels = ", ".join(f'j{k} = "q{k}"' for k in range(1, 7))
    terms = ", ".join(f'"offset@q{k}"' for k in range(2, 7))
    sensors = "\n".join(
        f'[[channel]]\nname = "q{k}"\nnoise = {NOISE}\n'
        + ('label = "the elbow"\n' if k == 3 else "")
        for k in range(1, 7)
    )
    text = f"""name = "skew"
length_unit = "m"
{sensors}
[[chain]]
name = "arm"
urdf = "skew.urdf"
base = "base"
tip = "ball"
channels = {{{channels}}}
[[point]]
name = "ball"
chain = "arm"
at = [0, 0, 0]
[[point]]
name = "cone"
unknown = ["at"]
[[closure]]
name = "seat"
kind = "touch"
between = ["ball", "cone"]
noise = 2e-5
[model]
terms = [{terms}]
"""
    (folder / "skew.toml").write_text(text, encoding="utf-8")
    return rsicalib.load_mechanism(folder / "skew.toml")


def session(drawn: Any, links: Array, seed: int, bend: float = 0.0) -> Any:
    """Readings of an arm with other links, at four cones."""
    rng = np.random.default_rng(seed)
    cones = np.array([[0.45, 0.1, 0.5], [0.3, -0.35, 0.6], [0.1, 0.45, 0.45], [0.4, 0.25, 0.85]])
    exact = np.concatenate([touching(cone, 18, links, rng) for cone in cones])
    exact = exact + rng.normal(0, 0.02, 6) * (np.arange(6) > 0)
    exact[:, 2] -= bend * exact[:, 2] ** 2
    values = exact + rng.normal(0, NOISE, exact.shape)
    keys = {"at": [f"cone{k // 18}" for k in range(72)]}
    return rsicalib.Readings.from_arrays(drawn, values, pose=np.arange(1, 73), keys=keys)


@pytest.fixture(scope="module")
def drawn(tmp_path_factory: pytest.TempPathFactory) -> Any:
    return mechanism(tmp_path_factory.mktemp("skew"))


@pytest.mark.parametrize("link", sized([2], [2, 3, 4, 5]))
def test_a_longer_link_is_named_as_the_length_of_that_link(drawn: Any, link: int) -> None:
    """Link `k` leads from joint k to the next: row k + 1 of the chain, the first is the base."""
    links = LINKS.copy()
    links[link] *= 1 + LONGER / np.linalg.norm(links[link])
    found = rsicalib.trace(session(drawn, links, link), drawn)
    (step,) = found.steps
    assert (step.term, step.target) == ("link_length", f"arm/{link + 1}"), found.summary()
    (a,) = step.parameters
    assert a.value is not None and a.sd is not None
    assert abs(a.value - LONGER) < 4 * a.sd < 0.5 * LONGER
    assert step.label == f"j{link} to j{link + 1}"
    assert f"arm/{link + 1} (j{link} to j{link + 1})" in found.summary()


def test_two_longer_links_are_explained(drawn: Any) -> None:
    """Each link has been made by itself: that two of a chain are longer has no other cause."""
    links = LINKS.copy()
    for link in (2, 3):
        links[link] *= 1 + LONGER / np.linalg.norm(links[link])
    found = rsicalib.trace(session(drawn, links, 7), drawn)
    assert {(s.term, s.target) for s in found.steps} == {
        ("link_length", "arm/3"),
        ("link_length", "arm/4"),
    }
    assert (found.verdict, found.exit_code) == ("explained", 0), found.summary()


def test_a_link_grows_along_itself_and_moves_across(drawn: Any) -> None:
    """What an export writes: the vector of the row with its length, and what is across it."""
    rows = drawn.to_dict()["chain"][0]["dh"]
    readings = session(drawn, LINKS, 0)
    terms = [f"{term}@arm/4" for term in ("link_length", "link_offset")]
    found = rsicalib.calibrate(readings, drawn, terms=[*drawn.to_dict()["model"]["terms"], *terms])
    length, offset = (found[t.split("@")[0], "arm/4"].value for t in terms)
    exported = calibrated(drawn, found).mechanism
    made = exported.to_dict()["chain"][0]["dh"]
    old, new = (np.array(of[3]["xyz"]) for of in (rows, made))
    along = old / np.linalg.norm(old)
    across = np.array([0, 0, 1.0]) - along * along[2]
    expected = old + length * along + offset * across / np.linalg.norm(across)
    np.testing.assert_allclose(new, expected, rtol=0, atol=1e-12)
    assert made[3].get("a", 0.0) == 0.0 and made[3].get("d", 0.0) == 0.0
    turns = [rigid((0, 0, 0), of[3]["rpy"]) for of in (rows, made)]
    np.testing.assert_allclose(turns[1], turns[0], rtol=0, atol=1e-12)


def test_words_for_people_stand_beside_names(drawn: Any) -> None:
    readings = session(drawn, LINKS, 7, bend=1.5e-3)
    found = rsicalib.trace(readings, drawn)
    (step,) = found.steps
    assert (step.target, step.label) == ("q3", "the elbow")
    assert "q3 (the elbow)" in found.summary()
    assert "q3 (the elbow)" in found.report()
    assert found.to_dict()["labels"]["q3"] == "the elbow"
    assert drawn.channels[2].label == "the elbow" and drawn.channels[0].label is None
    again = rsicalib.Mechanism(drawn.to_toml())
    assert again.channels[2].label == "the elbow"
