"""URDF chains: rows and exports agree with the document's own kinematics, computed separately."""

from __future__ import annotations

import csv
import math
import re
import xml.etree.ElementTree as ET
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from rsicalib.errors import InputError
from rsicalib.io.urdf import UrdfExport, chain_from_urdf, masses_from_toml, write_urdf
from rsicalib.io.urdf_tree import Robot
from tests.full import sized

MUKCA = Path(__file__).parents[2] / "shared" / "data" / "mukca"
needs_mukca = pytest.mark.skipif(
    not MUKCA.is_dir(), reason="the robot descriptions of Mukca are not beside the repository"
)
# Rounding of a dozen products of matrices with entries of some metres: 1e-15 each, and room.
EXACT = 1e-12
SEEDS = range(sized(10, 40))
ENDS = ("parent", "child")


# ------------------------------------------------------------------ a witness: plain matrices


def turn(axis: Sequence[float], angle: float) -> np.ndarray:
    """Rodrigues' rotation about any axis."""
    x, y, z = np.asarray(axis, dtype=float) / np.linalg.norm(axis)
    cross = np.array([[0, -z, y], [z, 0, -x], [-y, x, 0]])
    out = np.eye(4)
    out[:3, :3] += math.sin(angle) * cross + (1 - math.cos(angle)) * cross @ cross
    return out


def shift(xyz: Sequence[float]) -> np.ndarray:
    out = np.eye(4)
    out[:3, 3] = xyz
    return out


def placed(xyz: Sequence[float], rpy: Sequence[float]) -> np.ndarray:
    x, y, z = np.eye(3)
    return shift(xyz) @ turn(z, rpy[2]) @ turn(y, rpy[1]) @ turn(x, rpy[0])


def numbers(element: ET.Element | None, key: str, default: str) -> list[float]:
    return [float(w) for w in (default if element is None else element.get(key, default)).split()]


def base_from_link(text: str, base: str, values: Mapping[str, float]) -> dict[str, np.ndarray]:
    """`base_from_link` of every link of a document that forms one tree."""
    joints = ET.fromstring(text).findall("joint")
    edges = []
    for joint in joints:
        origin, axis = joint.find("origin"), numbers(joint.find("axis"), "xyz", "1 0 0")
        here = placed(numbers(origin, "xyz", "0 0 0"), numbers(origin, "rpy", "0 0 0"))
        value = values.get(joint.get("name", ""), 0.0)
        mimic = joint.find("mimic")
        if mimic is not None:
            other = values.get(mimic.get("joint", ""), 0.0)
            value = float(mimic.get("multiplier", "1")) * other + float(mimic.get("offset", "0"))
        if joint.get("type") in ("revolute", "continuous"):
            here = here @ turn(axis, value)
        elif joint.get("type") == "prismatic":
            here = here @ shift(np.asarray(axis) / np.linalg.norm(axis) * value)
        parent, child = (joint.find(tag).get("link") for tag in ("parent", "child"))
        edges += [(parent, child, here), (child, parent, np.linalg.inv(here))]
    out = {base: np.eye(4)}
    while new := [e for e in edges if e[0] in out and e[1] not in out]:
        for parent, child, here in new:
            out[child] = out[parent] @ here
    return out


def frames_of_rows(rows: Sequence[Mapping[str, Any]], values: Mapping[str, float]) -> list[Any]:
    """The frame after each joint, where masses are, and last the one at the end."""
    zero = [0.0, 0.0, 0.0]
    here, out = np.eye(4), []
    for row in rows:
        here = here @ turn([0, 0, 1], row.get("theta", 0.0))
        if "channel" in row:
            value = row.get("ratio", 1.0) * values[row["channel"]]
            slides = row["joint"] == "prismatic"
            here = here @ (shift([0, 0, value]) if slides else turn([0, 0, 1], value))
        out.append(here)
        here = here @ shift([row.get("a", 0.0), 0, row.get("d", 0.0)])
        here = here @ turn([1, 0, 0], row.get("alpha", 0.0))
        here = here @ placed(row.get("xyz", zero), row.get("rpy", zero))
    return [*out, here]


# ------------------------------------------------------------------ random robots


def words(values: Sequence[float]) -> str:
    return " ".join(repr(float(v)) for v in values)


def random_robot(rng: np.random.Generator, joints: int = 9) -> tuple[str, dict[str, str]]:
    """A robot with a trunk `t0` … `tn` and twigs; and the kind of each joint."""
    axes = np.vstack([np.eye(3), -np.eye(3)])
    right = [0.0, np.pi / 2, -np.pi / 2, np.pi, 1.5708]
    parts, kinds = ['<link name="t0"/>'], {}
    edges = [(f"t{i}", f"t{i + 1}") for i in range(joints)]
    edges += [(f"t{rng.integers(joints + 1)}", f"twig{i}") for i in range(5)]
    edges += [("twig0", "leaf0"), ("twig1", "leaf1")]
    for parent, child in edges:
        name = f"{parent}_{child}"
        kind = str(rng.choice(["fixed", "revolute", "continuous", "prismatic"]))
        if child.startswith("leaf"):
            kind = "fixed"
        kinds[name] = kind
        rpy = rng.uniform(-3, 3, 3) if rng.random() < 0.5 else rng.choice(right, 3)
        axis = rng.normal(size=3) if rng.random() < 0.5 else axes[rng.integers(6)]
        xyz, com = rng.normal(size=(2, 3))
        origin = f'<origin rpy="{words(rpy)}" xyz="{words(xyz)}" />' if rng.random() < 0.8 else ""
        inertial = f'<inertial><origin xyz="{words(com)}" rpy="0 0 1"/>'
        inertial += f'<mass value="{rng.uniform(0.1, 2)!r}"/></inertial>'
        parts += [
            f'<link name="{child}">{inertial if rng.random() < 0.7 else ""}</link>',
            f'<joint name="{name}" type="{kind}">{origin} <!-- größer > kleiner -->',
            f'  <parent link="{parent}"/><child link="{child}"/>',
            f'  <axis xyz="{words(axis)}"/>' if rng.random() < 0.9 else "",
            '  <limit lower="-1.5" upper="2" effort="1" velocity="1"/>',
            "</joint>",
        ]
    lines = "\n".join(parts)
    return f'<?xml version="1.0"?>\n<robot name="r">\n{lines}\n</robot>\n<!-- end -->\n', kinds


def between(text: str, base: str, tip: str) -> list[str]:
    """Names of the joints between two links of a tree."""
    above = {
        j.find("child").get("link"): (j.get("name"), j.find("parent").get("link"))
        for j in ET.fromstring(text).findall("joint")
    }

    def up(link: str) -> list[str]:
        return [above[link][0], *up(above[link][1])] if link in above else []

    return sorted(set(up(base)) ^ set(up(tip)))


def scene(seed: int) -> tuple[str, str, str, dict[str, str], np.random.Generator]:
    """A random robot with a path, every second one leading up before it leads down."""
    rng = np.random.default_rng(seed)
    text, kinds = random_robot(rng)
    base, tip = ("t0", "t9") if seed % 2 else (f"t{rng.integers(4, 9)}", "leaf0")
    moving = [name for name in between(text, base, tip) if kinds[name] != "fixed"]
    return text, base, tip, {name: f"q_{name}" for name in moving}, rng


@pytest.mark.parametrize("seed", SEEDS)
def test_rows_end_where_the_tip_of_a_random_robot_is(seed: int) -> None:
    text, base, tip, channels, rng = scene(seed)
    chain = chain_from_urdf(text, base, tip, channels)
    assert "channel" not in chain.rows[0]
    assert sorted(chain.joints.values()) == sorted(channels)
    for _ in range(5):
        values = {name: rng.uniform(-3, 3) for name in channels}
        expected = base_from_link(text, base, values)[tip]
        found = frames_of_rows(chain.rows, {channels[n]: v for n, v in values.items()})[-1]
        np.testing.assert_allclose(found, expected, rtol=0, atol=EXACT)


@pytest.mark.parametrize("seed", SEEDS)
def test_rows_carry_the_masses_that_move_with_their_joint(seed: int) -> None:
    text, base, tip, channels, rng = scene(seed)
    rows = chain_from_urdf(text, base, tip, channels).rows
    values = {name: rng.uniform(-3, 3) for name in channels}
    frames = frames_of_rows(rows, {channels[n]: v for n, v in values.items()})
    # Links whose place in the base depends on the path's joints and on no other.
    joints = ET.fromstring(text).findall("joint")
    moved = {**values, **{j.get("name", ""): 0.7 for j in joints if j.get("name") not in values}}
    here, other = base_from_link(text, base, values), base_from_link(text, base, moved)
    still = base_from_link(text, base, {n: v + rng.uniform(0.1, 1) for n, v in values.items()})
    mass, moment = 0.0, np.zeros(3)
    for link in ET.fromstring(text).findall("link"):
        name, inertial = link.get("name", ""), link.find("inertial")
        carried = np.allclose(here[name], other[name]) and not np.allclose(here[name], still[name])
        if inertial is not None and carried:
            weight = float(inertial.find("mass").get("value"))
            com = numbers(inertial.find("origin"), "xyz", "")
            mass += weight
            moment += weight * (here[name] @ [*com, 1.0])[:3]
    heavy = [(r, f) for r, f in zip(rows, frames, strict=False) if "mass" in r]
    assert sum(r["mass"] for r, _ in heavy) == pytest.approx(mass, abs=EXACT)
    total = sum((r["mass"] * (f @ [*r["com"], 1.0])[:3] for r, f in heavy), np.zeros(3))
    np.testing.assert_allclose(total, moment, rtol=0, atol=1e2 * EXACT)  # some 20 kg m


@needs_mukca
@pytest.mark.parametrize(
    ("file", "base", "pattern", "joints"),
    [("panda", "panda_link0", "panda_joint{}", 7), ("gen3lite", "kinova_base_link", "joint_{}", 6)],
)
def test_measured_arms(file: str, base: str, pattern: str, joints: int) -> None:
    path = MUKCA / f"{file}.urdf"
    channels = {pattern.format(i + 1): f"q{i + 1}" for i in range(joints)}
    chain = chain_from_urdf(path, base, "ball_link", channels)
    rng = np.random.default_rng(0)
    for _ in range(10):
        values = {name: rng.uniform(-3, 3) for name in channels}
        expected = base_from_link(path.read_text(), base, values)["ball_link"]
        found = frames_of_rows(chain.rows, {channels[n]: v for n, v in values.items()})[-1]
        np.testing.assert_allclose(found, expected, rtol=0, atol=EXACT)
    assert list(chain.joints) == [f"q{i + 1}" for i in range(joints)]
    assert list(chain.limits) == list(chain.joints)


@needs_mukca
@pytest.mark.parametrize(
    ("robot", "fitted", "nominal"),
    [
        ("panda_1", {"front", "right"}, (9.16, 7.46)),
        ("panda_2", {"front_center"}, (8.28, 7.79)),
        ("panda_3", {"frontcenter"}, (3.32, 3.26)),
    ],
)
def test_uncalibrated_pandas_scatter_as_published(
    robot: str, fitted: set[str], nominal: tuple[float, float]
) -> None:
    channels = {f"panda_joint{i}": f"q{i}" for i in range(1, 8)}
    rows = chain_from_urdf(MUKCA / "panda.urdf", "panda_link0", "ball_link", channels).rows
    touches: dict[str, dict[str, list[np.ndarray]]] = {}
    with (MUKCA / f"{robot}.csv").open() as file:
        for line in csv.DictReader(file):
            angles = {name: float(line[name]) for name in channels.values()}
            ball = frames_of_rows(rows, angles)[-1][:3, 3]
            touches.setdefault(line["group"], {}).setdefault(line["at"], []).append(ball)
    sides: dict[bool, list[float]] = {True: [], False: []}
    for group, at in touches.items():
        distances = [np.linalg.norm(b - np.mean(b, axis=0), axis=1) for b in at.values()]
        if (robot, group) != ("panda_2", "high"):  # broken
            sides[group in fitted].append(1e3 * float(np.concatenate(distances).mean()))
    found = [np.mean(sides[True]), np.mean(sides[False])]
    np.testing.assert_allclose(found, nominal, rtol=0, atol=0.005)  # mm, printed to 0.01


@needs_mukca
def test_panda_rows_keep_the_numbers_of_the_document() -> None:
    channels = {f"panda_joint{i}": f"q{i}" for i in range(1, 8)}
    masses = masses_from_toml(MUKCA / "panda_masses.toml")
    chain = chain_from_urdf(MUKCA / "panda.urdf", "panda_link0", "ball_link", channels, masses)
    xyz, rpy = [-0.0825, 0.384, 0.0], [-1.5707963267948966, 0.0, 0.0]
    row = {"channel": "q4", "joint": "revolute", "xyz": xyz, "rpy": rpy}
    row["name"] = "panda_joint4 to panda_joint5"
    com = [-0.05317, 0.104419, 0.027454]
    assert chain.rows[4] == {**row, "mass": 3.587895, "com": com}
    assert chain.limits["q4"] == [-3.0718, -0.0698]
    # The hand, 0.107 m on, rides on link 7: their common centre by hand.
    z = (0.735522 * 0.061597 + 0.73 * (0.107 + 0.1)) / (0.735522 + 0.73)
    assert chain.rows[7]["mass"] == pytest.approx(0.735522 + 0.73)
    assert chain.rows[7]["com"][2] == pytest.approx(z)
    assert chain.notes == ()


def test_a_mass_that_moves_beside_the_path_is_noted() -> None:
    finger = '<inertial><mass value="0.1"/></inertial>'
    text = robot(
        joint("q", "base", "arm"), joint("grip", "arm", "finger", kind="prismatic"), finger=finger
    )
    chain = chain_from_urdf(text, "base", "arm", {"q": "q1"})
    note = 'joint "grip" moves beside the path: the mass of finger is left out'
    assert chain.notes == (note,)
    assert "mass" not in chain.rows[1]


# ------------------------------------------------------------------ joints that mimic others


def mimicking(seed: int) -> tuple[str, str, str, dict[str, str], str, np.random.Generator]:
    """A random robot, one joint of whose path mimics another one that moves alike."""
    for own in range(seed, seed + 1000, 40):
        text, base, tip, channels, rng = scene(own)
        kinds = {j.get("name"): j.get("type") for j in ET.fromstring(text).findall("joint")}
        pairs = [
            (one, other)
            for one in channels
            for other in channels
            if one != other and (kinds[one] == "prismatic") == (kinds[other] == "prismatic")
        ]
        if pairs:
            break
    one, other = pairs[rng.integers(len(pairs))]
    element = f"<mimic joint='{other}' multiplier='{rng.normal()!r}' offset='{rng.normal()!r}'/>"
    text = re.sub(rf'(<joint name="{one}" [^>]*>)', rf"\1{element}", text)
    return text, base, tip, {n: c for n, c in channels.items() if n != one}, one, rng


@pytest.mark.parametrize("seed", range(sized(5, 20)))
def test_a_mimic_moves_by_a_ratio_of_the_channel_of_the_other(seed: int) -> None:
    text, base, tip, channels, mimic, rng = mimicking(seed)
    chain = chain_from_urdf(text, base, tip, channels)
    assert mimic not in chain.joints.values()
    assert sum("ratio" in row for row in chain.rows) == 1
    for _ in range(5):
        values = {name: rng.uniform(-3, 3) for name in channels}
        expected = base_from_link(text, base, values)[tip]
        found = frames_of_rows(chain.rows, {channels[n]: v for n, v in values.items()})[-1]
        np.testing.assert_allclose(found, expected, rtol=0, atol=EXACT)
    # One that has a sensor of its own is where that says.
    sensed = chain_from_urdf(text, base, tip, {**channels, mimic: "own"})
    assert "own" in sensed.joints
    assert not any("ratio" in row for row in sensed.rows)


@pytest.mark.parametrize("seed", range(sized(5, 20)))
def test_an_export_says_how_a_mimic_moves_now(seed: int) -> None:
    text, base, tip, channels, _mimic, rng = mimicking(seed)
    drawn = chain_from_urdf(text, base, tip, channels).rows
    assert write_urdf(text, base, tip, channels, drawn).text == text
    rows = shaken(drawn, rng)
    for row in rows:
        if "ratio" in row:
            row["ratio"] += 0.01
    offsets = {channel: rng.normal() * 0.1 for channel in channels.values()}
    export = write_urdf(text, base, tip, channels, rows, offsets=offsets)
    ends_where_rows_end(export, rows, channels, offsets, rng)


@pytest.mark.parametrize("seed", range(sized(5, 20)))
def test_masses_beyond_a_mimic_are_where_its_link_is(seed: int) -> None:
    text, base, tip, channels, _mimic, rng = mimicking(seed)
    rows = chain_from_urdf(text, base, tip, channels).rows
    values = {name: rng.uniform(-3, 3) for name in channels}
    frames = frames_of_rows(rows, {channels[n]: v for n, v in values.items()})
    links = base_from_link(text, base, values)
    joints = ET.fromstring(text).findall("joint")
    moving = [step for step in Robot(text).path(base, tip) if step.joint.kind != "fixed"]
    # A row is named by the joints at its ends, and has what the first of them leads to.
    assert [row["name"].split(" to ")[0] for row in rows[1:]] == [s.joint.name for s in moving]
    reached = [base, *(step.reached for step in moving)]
    mine = dict(zip(reached, zip(rows, frames, strict=False), strict=True))
    fixed = {j.find(t).get("link") for j in joints if j.get("type") == "fixed" for t in ENDS}
    compared = 0
    for link in ET.fromstring(text).findall("link"):
        name, inertial = link.get("name", ""), link.find("inertial")
        # Of a link that no fixed joint adds to another, the centre is that of the document.
        if name in mine and "mass" in mine[name][0] and name not in fixed and inertial is not None:
            row, frame = mine[name]
            com = numbers(inertial.find("origin"), "xyz", "")
            expected = (links[name] @ [*com, 1.0])[:3]
            found = (frame @ [*row["com"], 1.0])[:3]
            np.testing.assert_allclose(found, expected, rtol=0, atol=EXACT)
            compared += 1
    assert compared or len(rows) < 5


# ------------------------------------------------------------------ export


@pytest.mark.parametrize("seed", SEEDS)
def test_an_export_without_changes_is_the_document(seed: int) -> None:
    text, base, tip, channels, _ = scene(seed)
    rows = chain_from_urdf(text, base, tip, channels).rows
    export = write_urdf(text, base, tip, channels, rows)
    assert export.text == text
    assert (export.base, export.tip, export.notes) == (base, tip, ())


def ends_where_rows_end(
    export: UrdfExport,
    rows: Sequence[Mapping[str, Any]],
    channels: Mapping[str, str],
    offsets: Mapping[str, float],
    rng: np.random.Generator,
) -> None:
    """The exported tip is where the rows put it, with readings as joint values."""
    for _ in range(5):
        readings = {name: rng.uniform(-3, 3) for name in channels}
        angles = {channels[n]: r + offsets[channels[n]] for n, r in readings.items()}
        found = base_from_link(export.text, export.base, readings)[export.tip]
        np.testing.assert_allclose(found, frames_of_rows(rows, angles)[-1], rtol=0, atol=EXACT)


def shaken(rows: Sequence[Mapping[str, Any]], rng: np.random.Generator) -> list[dict[str, Any]]:
    """Rows with every number changed, in both ways that a row can say it."""
    out = []
    for row in rows:
        dh = dict(zip(("theta", "d", "a", "alpha"), rng.normal(size=4) * 0.1, strict=True))
        moved = {k: [x + 0.1 * rng.normal() for x in row[k]] for k in ("xyz", "rpy")}
        out.append({**row, **(dh if rng.random() < 0.5 else {}), **moved})
    return out


@pytest.mark.parametrize("seed", SEEDS)
def test_an_export_puts_the_tip_where_the_rows_put_it(seed: int) -> None:
    text, base, tip, channels, rng = scene(seed)
    rows = shaken(chain_from_urdf(text, base, tip, channels).rows, rng)
    offsets = {channel: rng.normal() * 0.1 for channel in channels.values()}
    export = write_urdf(text, base, tip, channels, rows, offsets=offsets)
    ends_where_rows_end(export, rows, channels, offsets, rng)
    # Read back, it is the same chain again, now with nothing to add.
    again = chain_from_urdf(export.text, export.base, export.tip, channels).rows
    angles = {c: 0.4 for c in channels.values()}
    plain = {c: a + offsets[c] for c, a in angles.items()}
    ends = [frames_of_rows(again, angles)[-1], frames_of_rows(rows, plain)[-1]]
    np.testing.assert_allclose(*ends, rtol=0, atol=EXACT)
    # Nothing but origins changed, and what was added is at the end.
    bare = [re.sub(r"<origin [^>]*/>|\s", "", t) for t in (text, export.text)]
    assert bare[1].startswith(bare[0].split("</robot>")[0])
    assert export.text.endswith("</robot>\n<!-- end -->\n")


@needs_mukca
def test_an_export_of_the_panda_changes_origins_only() -> None:
    text = (MUKCA / "panda.urdf").read_text()
    channels = {f"panda_joint{i}": f"q{i}" for i in range(1, 8)}
    rng = np.random.default_rng(0)
    rows = shaken(chain_from_urdf(text, "panda_link0", "ball_link", channels).rows, rng)
    export = write_urdf(text, "panda_link0", "ball_link", channels, rows, offsets={"q3": 0.01})
    assert (export.tip, export.notes) == ("ball_link", ())
    changed = [
        (old, new)
        for old, new in zip(text.splitlines(), export.text.splitlines(), strict=True)
        if old != new
    ]
    assert len(changed) == 8  # seven joints and the ball
    assert all("<origin" in old and "<origin" in new for old, new in changed)


def test_a_moving_tip_gets_a_calibrated_link() -> None:
    text = robot(joint("q", "base", "arm"))
    rows: list[Any] = list(chain_from_urdf(text, "base", "arm", {"q": "q1"}).rows)
    rows[1] = {**rows[1], "xyz": [0.1, 0.0, 0.0], "rpy": [0.0, 0.0, 0.0]}
    export = write_urdf(text, "base", "arm", {"q": "q1"}, rows)
    assert export.tip == "arm_calibrated"
    assert export.notes == ('link "arm_calibrated" is new: the corrected frame of "arm"',)
    assert '<origin xyz="0.1 0.0 0.0" rpy="0.0 0.0 0.0"/>' in export.text
    with pytest.raises(InputError, match="a free name"):
        write_urdf(export.text, "base", "arm", {"q": "q1"}, rows)


def test_a_gain_is_noted() -> None:
    text = robot(joint("q", "base", "arm"))
    rows = chain_from_urdf(text, "base", "arm", {"q": "q1"}).rows
    export = write_urdf(text, "base", "arm", {"q": "q1"}, rows, gains={"q1": 1.001})
    note = 'channel "q1": a URDF has no place for the gain 1.001; '
    assert export.notes == (note + 'give joint "q" the reading times 1.001',)
    assert export.text == text


@pytest.mark.parametrize(
    "origin",
    ["", "<origin/>", "<origin rpy='0 0 0'/>", '<origin\n xyz = "0 0 0"\n></origin>'],
    ids=["none", "empty", "half", "over lines"],
)
def test_an_origin_is_put_in_however_it_was_written(origin: str) -> None:
    text = robot(joint("q", "base", "arm", extra=origin))
    rows = chain_from_urdf(text, "base", "arm", {"q": "q1"}).rows
    export = write_urdf(text, "base", "arm", {"q": "q1"}, rows, offsets={"q1": 0.25})
    here = base_from_link(export.text, "base", {"q": 0.5})["arm"]
    np.testing.assert_allclose(here, turn([0, 0, 1], 0.75), rtol=0, atol=EXACT)


def test_an_export_refuses_what_belongs_to_another_chain() -> None:
    text = robot(joint("q", "base", "arm"))
    rows: list[Any] = list(chain_from_urdf(text, "base", "arm", {"q": "q1"}).rows)
    with pytest.raises(InputError, match="rows: found none at all, expected revolute q1"):
        write_urdf(text, "base", "arm", {"q": "q1"}, rows[:1])
    with pytest.raises(InputError, match=r'offsets: found 0.1 for "q2", expected numbers for q1'):
        write_urdf(text, "base", "arm", {"q": "q1"}, rows, offsets={"q2": 0.1})
    with pytest.raises(InputError, match=r"row 2: found .*nan.*expected finite numbers"):
        write_urdf(text, "base", "arm", {"q": "q1"}, [rows[0], {**rows[1], "a": math.nan}])


# ------------------------------------------------------------------ refusals


def joint(name: str, parent: str, child: str, kind: str = "revolute", extra: str = "") -> str:
    ends = f'<parent link="{parent}"/><child link="{child}"/>'
    axis = "" if "<axis" in extra else '<axis xyz="0 0 1"/>'
    return f'<joint name="{name}" type="{kind}">{extra}{ends}{axis}</joint>'


def robot(*joints: str, **inside: str) -> str:
    ends = re.findall(r'(?:parent|child) link="(\w+)"', "".join(joints))
    links = "".join(
        f'<link name="{n}">{inside.get(n, "")}</link>' for n in dict.fromkeys(["base", *ends])
    )
    return f'<robot name="r">{links}{"".join(joints)}</robot>'


HINGE = joint("q", "base", "arm")
NO_MIMIC = '<mimic joint="p" multiplier="0"/>'
REFUSED = {
    "no such base": (robot(HINGE), {"base": "bas"}, 'base: found link "bas".*links base, arm'),
    "no such tip": (robot(HINGE), {"tip": "hand"}, 'tip: found link "hand".*links base, arm'),
    "the base again": (robot(HINGE), {"tip": "base"}, "a link other than the base"),
    "no such joint": (robot(HINGE), {"channels": {"q": "q1", "j": "q2"}}, '"j", which.*have.*q$'),
    "a joint of another branch": (
        robot(HINGE, joint("side", "base", "twig")),
        {"channels": {"q": "q1", "side": "q2"}},
        'joint "side", which is not one, expected one of the moving joints',
    ),
    "one channel twice": (
        robot(HINGE, joint("p", "arm", "hand")),
        {"tip": "hand", "channels": {"q": "q1", "p": "q1"}},
        'channel "q1" for "q" and for "p"',
    ),
    "no channel": (robot(HINGE), {"channels": {}}, 'joint "q": found a revolute joint without'),
    "separate trees": (
        robot(HINGE, joint("p", "island", "hut")),
        {"tip": "hut"},
        'links "base" and "hut" in separate trees',
    ),
    "a mimic": (
        robot(joint("q", "base", "arm", extra='<mimic joint="x"/>')),
        {"channels": {}},
        'joint "q": found <mimic> of "x" with multiplier 1, expected on the path a multiple of',
    ),
    "a mimic that never moves": (
        robot(joint("p", "base", "arm"), joint("q", "arm", "hand", extra=NO_MIMIC)),
        {"tip": "hand", "channels": {"p": "q1"}},
        'joint "q": found <mimic> of "p" with multiplier 0',
    ),
    "a mimic by a text": (
        robot(
            joint("p", "base", "arm"), joint("q", "arm", "hand", extra=NO_MIMIC.replace("0", "x"))
        ),
        {"tip": "hand", "channels": {"p": "q1"}},
        'joint "q", mimic: found .x., expected a finite number',
    ),
    **{
        kind: (
            robot(joint("q", "base", "arm", kind=kind)),
            {},
            f'joint "q": found type "{kind}".*fixed, revolute, continuous, prismatic',
        )
        for kind in ("planar", "floating", "spherical", "")
    },
    "no axis": (
        robot(joint("q", "base", "arm", extra='<axis xyz="0 0 0"/>')),
        {},
        'joint "q": found axis 0 0 0, expected a direction',
    ),
    "text for a number": (
        robot(joint("q", "base", "arm", extra='<origin xyz="0 0 ${h}"/>')),
        {},
        r'joint "q", origin xyz: found .*\$.h.*3 finite numbers. Expand the xacro first',
    ),
    "two numbers": (
        robot(joint("q", "base", "arm", extra='<origin rpy="0 0"/>')),
        {},
        "origin rpy: found '0 0', expected 3 finite numbers",
    ),
    "not a number": (
        robot(joint("q", "base", "arm", extra='<limit lower="nan" upper="1"/>')),
        {},
        'joint "q", limit: found',
    ),
    "two parents": (
        robot(HINGE, joint("p", "other", "arm")),
        {},
        'link "arm" below this joint and below "q"',
    ),
    "a loop": (
        robot(joint("q", "base", "arm"), joint("p", "arm", "base")),
        {},
        "found a loop of joints, expected a tree",
    ),
    "a link that is not there": (
        robot(HINGE).replace('<link name="arm"></link>', ""),
        {},
        'joint "q", child: found link "arm", expected one of the links base',
    ),
    "a joint twice": (robot(HINGE, joint("q", "arm", "hand")), {}, 'joint: found "q" again'),
    "a link without a name": (robot(HINGE).replace('name="arm"', ""), {}, "link: found no name"),
    "xacro": (
        robot(HINGE)
        .replace("<robot", "<robot xmlns:xacro='x'")
        .replace("<link", "<xacro:m/><link"),
        {},
        "<xacro:m>.*Expand the xacro first",
    ),
    "another document": ("<html/>", {}, "found <html>, expected <robot>"),
    "broken": ("<robot>\n<link", {}, "urdf, line 2, URDF: found unclosed token"),
    "an entity": (
        '<!DOCTYPE r [<!ENTITY a "b">]>' + robot(HINGE),
        {},
        'found entity "a", expected no entity declarations',
    ),
    "no such file": ("no/such.urdf", {}, "^no/such.urdf, URDF: found no such file"),
    "a mass of no link": (robot(HINGE), {"masses": {"x": (1.0, [0, 0, 0])}}, 'link "x".*base, arm'),
    "a negative mass": (
        robot(HINGE, arm='<inertial><mass value="-1"/></inertial>'),
        {},
        'link "arm", inertial: found mass -1.0',
    ),
}


@pytest.mark.parametrize("case", REFUSED)
def test_refuses(case: str) -> None:
    text, changes, message = REFUSED[case]
    options: dict[str, Any] = {"base": "base", "tip": "arm", "channels": {"q": "q1"}, **changes}
    with pytest.raises(InputError, match=message) as caught:
        chain_from_urdf(text, **options)
    assert caught.value.where is not None
    assert caught.value.where["found"] and caught.value.where["expected"]


def test_limits_move_with_where_readings_are_counted_from() -> None:
    robot = """<robot name="r"> <link name="base"/> <link name="arm"/>
      <joint name="hinge" type="revolute"> <origin xyz="0 0 0.3"/>
        <parent link="base"/> <child link="arm"/> <axis xyz="0 0 1"/>
        <limit effort="10" velocity="10" lower="-1.7" upper='1.7'/> </joint> </robot>"""
    given = ("base", "arm", {"hinge": "q1"})
    rows = chain_from_urdf(robot, *given).rows
    # an encoder of 4096 steps whose middle is the zero of the drawing, off by 10 mrad
    off, zero = {"q1": 0.01 - np.pi}, {"q1": -np.pi}
    text = write_urdf(robot, *given, rows, offsets=off, zeros=zero).text
    assert chain_from_urdf(text, *given).limits["q1"] == [-1.7 + np.pi, 1.7 + np.pi]
    assert 'effort="10" velocity="10"' in text
    text = write_urdf(robot, *given, rows, offsets={"q1": 0.01}).text
    assert chain_from_urdf(text, *given).limits["q1"] == [-1.7, 1.7]


def test_limits_are_those_declared() -> None:
    limit = '<limit lower="-1.5" upper="2" effort="1" velocity="1"/>'
    joints = [
        joint("a", "base", "l1", extra=limit),
        joint("b", "l1", "l2", kind="continuous", extra=limit),
        joint("c", "l2", "l3", kind="prismatic", extra='<limit upper="0.4"/>'),
        joint("d", "l3", "l4"),
    ]
    chain = chain_from_urdf(robot(*joints), "base", "l4", {k: f"q{k}" for k in "abcd"})
    assert chain.limits == {"qa": [-1.5, 2.0], "qc": [0.0, 0.4]}


@pytest.mark.parametrize(
    "entry",
    [
        "a = 1.0",
        "a = {mass = 1.0}",
        "a = {mass = -1.0, com = [0, 0, 0]}",
        "a = {mass = nan, com = [0, 0, 0]}",
        "a = {mass = 1.0, com = [0, 0]}",
        "a = {mass = 1.0, com = 'x'}",
        "a = {mass = true, com = [0, 0, 0]}",
    ],
)
def test_masses_that_are_none_are_refused_by_link(entry: str, tmp_path: Path) -> None:
    file = tmp_path / "masses.toml"
    file.write_text(entry)
    with pytest.raises(InputError, match=r'masses.toml, link "a": found .*expected { mass = '):
        masses_from_toml(file)


def test_masses_are_read(tmp_path: Path) -> None:
    file = tmp_path / "masses.toml"
    file.write_text("a = {mass = 2, com = [0, 0.5, 1]}")
    assert masses_from_toml(file) == {"a": (2.0, (0.0, 0.5, 1.0))}
    file.write_text("a = ")
    with pytest.raises(
        InputError, match=r"masses.toml, line 1: found the end of the file, expected a number"
    ):
        masses_from_toml(file)
    with pytest.raises(InputError, match=r"none.toml: found no such file, expected a TOML file"):
        masses_from_toml(tmp_path / "none.toml")
