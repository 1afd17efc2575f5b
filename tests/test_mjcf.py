"""MuJoCo models become mechanisms: every point where MuJoCo has it, every loop as it closes it."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest

import rsicalib
from rsicalib import InputError
from rsicalib.io.mjcf import mechanism_of_mjcf

FOUR_BAR = """\
<mujoco model="two arms">
  <compiler angle="degree" eulerseq="zyx"/>
  <default>
    <geom type="sphere" size="0.02" mass="0.1"/>
    <default class="arm">
      <joint axis="0 1 0" range="-170 170" damping="1"/>
      <default class="slider"><joint type="slide" axis="1 1 0"/></default>
    </default>
  </default>
  <asset><mesh name="shell" vertex="0 0 0 1 0 0 0 1 0 0 0 1"/></asset>
  <worldbody>
    <light pos="0 0 3"/>
    <frame pos="0.1 0 0.2" euler="10 20 30">
      <body name="left upper" childclass="arm" pos="0 0.3 0" quat="2 0.2 -0.4 0.1">
        <joint name="l1" pos="0.01 0.02 0.03" ref="15"/>
        <geom/>
        <body name="left lower" pos="0.3 0 0" axisangle="0 0 2 40">
          <joint name="l2" axis="0.3 0 1"/>
          <joint name="l3" class="slider" pos="0 0 0.1" range="-0.5 0.5"/>
          <geom/>
          <site name="left tip" pos="0.2 0 0.1"/>
        </body>
      </body>
    </frame>
    <body name="right upper" pos="0.5 -0.3 0" xyaxes="1 0.1 0 0 1 0.2">
      <joint name="r1" axis="0 0 1"/>
      <geom/>
      <body name="right lower" pos="0.25 0 0" zaxis="0.1 0.2 1">
        <joint name="r2" axis="0 1 0"/>
        <geom/>
        <site name="right tip" pos="0.1 0.2 0"/>
      </body>
    </body>
  </worldbody>
  <equality>
    EQUALITY
  </equality>
  SENSORS
</mujoco>
"""
SENSED = "".join(f'<jointpos joint="{name}"/>' for name in ("l1", "l2", "l3", "r1", "r2"))


def model(equality: str, sensors: str = f"<sensor>{SENSED}</sensor>") -> str:
    return FOUR_BAR.replace("EQUALITY", equality).replace("SENSORS", sensors)


CLOSED = {
    "connect of bodies": '<connect body1="left lower" body2="right lower" anchor="0.1 0.2 0.3"/>',
    "connect of sites": '<connect site1="left tip" site2="right tip"/>',
    "connect to the world": '<connect body1="left lower" anchor="0 0 0.1"/>',
    "weld": '<weld body1="left lower" body2="right lower" anchor="0.1 0 0" torquescale="0.4"/>',
}


def misclosure(document: dict[str, Any], values: np.ndarray) -> np.ndarray:
    """Difference of the two points of each closure, in readings' own order, by `forward`."""
    mechanism = rsicalib.load_mechanism(document)
    names = [c.name for c in mechanism.channels]
    places = rsicalib.forward(dict(zip(names, values[None].T, strict=True)), mechanism)
    points = {p["name"]: p for p in document["point"]}
    carried = [p["name"] for p in document["point"] if "chain" in p]
    at = {name: places[0, 3 * k : 3 * k + 3] for k, name in enumerate(carried)}
    at |= {name: np.array(p["at"]) for name, p in points.items() if "chain" not in p}
    return np.array([at[c["between"][0]] - at[c["between"][1]] for c in document["closure"]])


@pytest.mark.parametrize("kind", CLOSED)
def test_points_are_where_mujoco_has_them_and_loops_close_as_there(kind: str) -> None:
    mujoco = pytest.importorskip("mujoco", reason="MuJoCo, the witness, is not installed")
    text = model(CLOSED[kind])
    document, notes = mechanism_of_mjcf(text)
    assert not notes
    there = mujoco.MjModel.from_xml_string(text)
    data = mujoco.MjData(there)
    names = [c["name"] for c in document["channel"]]
    order = [there.joint(name).qposadr[0] for name in names]
    rng = np.random.default_rng(0)
    for _ in range(5):
        data.qpos[:] = there.qpos0 + rng.uniform(-0.4, 0.4, there.nq)
        mujoco.mj_forward(there, data)
        found = misclosure(document, data.qpos[order])
        wanted = data.efc_pos[data.efc_type == mujoco.mjtConstraint.mjCNSTR_EQUALITY]
        if kind == "weld":
            # MuJoCo's weld is an offset and a rotation; three points close where both do
            found = found[:1]
            wanted = wanted[:3]
        # MuJoCo's numbers are doubles, its orientations unit quaternions: rounding
        assert np.abs(np.abs(found.ravel()) - np.abs(wanted)).max() < 1e-9
    data.qpos[:] = there.qpos0
    if "sites" not in kind:  # a connect of bodies closes as the model is drawn
        assert np.abs(misclosure(document, data.qpos[order])).max() < 1e-9


def test_limits_and_references_are_in_radians() -> None:
    document, _ = mechanism_of_mjcf(model(CLOSED["connect of sites"]))
    channels = {c["name"]: c for c in document["channel"]}
    assert channels["l1"]["limits"] == pytest.approx(np.radians([-170.0, 170.0]))
    assert channels["l3"]["limits"] == [-0.5, 0.5] and channels["l3"]["unit"] == "m"
    assert "limits" not in channels["r1"]


def test_a_joint_that_follows_another_is_a_ratio_of_its_channel() -> None:
    mujoco = pytest.importorskip("mujoco", reason="MuJoCo, the witness, is not installed")
    follows = '<joint joint1="r2" joint2="r1" polycoef="0.1 -0.5 0 0 0"/>'
    text = model(f"{CLOSED['connect of sites']}{follows}", f"<sensor>{SENSED}</sensor>")
    document, notes = mechanism_of_mjcf(text)
    assert notes == ["the sensor of r2 is not used: it follows r1"]
    there = mujoco.MjModel.from_xml_string(text)
    data = mujoco.MjData(there)
    data.qpos[:] = there.qpos0 + 0.2
    data.joint("r2").qpos[0] = 0.1 - 0.5 * data.joint("r1").qpos[0]
    mujoco.mj_forward(there, data)
    values = np.array([data.joint(c["name"]).qpos[0] for c in document["channel"]])
    apart = data.site("left tip").xpos - data.site("right tip").xpos
    assert np.abs(misclosure(document, values)[0] - apart).max() < 1e-9


def test_a_passive_joint_on_the_way_is_refused_by_name() -> None:
    sensors = f"<sensor>{SENSED.replace(jointpos('l2'), '')}</sensor>"
    with pytest.raises(InputError, match='line 18, joint "l2": found a joint without a sensor'):
        mechanism_of_mjcf(model(CLOSED["connect of sites"], sensors))


def jointpos(name: str) -> str:
    return f'<jointpos joint="{name}"/>'


RODS = """\
<mujoco model="rods">
  <compiler angle="radian"/>
  <worldbody>
    <body name="slider" pos="0 0 1">
      <joint name="s1" type="slide" axis="0 0 1"/><geom size="0.01"/>
      <body name="rod" pos="0.1 0 0">
        <joint type="ball" pos="0 0 0.05"/><geom size="0.01"/>
      </body>
    </body>
    <body name="crank" pos="0.5 0 0.5"><joint name="c1" axis="0 1 0"/><geom size="0.01"/></body>
  </worldbody>
  <equality><connect name="rod end" body1="rod" body2="crank" anchor="0.3 0 -0.45"/></equality>
  <sensor><jointpos joint="s1"/><jointpos joint="c1"/></sensor>
</mujoco>
"""


def test_a_rod_with_a_ball_joint_is_a_distance() -> None:
    document, _ = mechanism_of_mjcf(RODS)
    (closure,) = document["closure"]
    assert closure["kind"] == "distance"
    assert closure["value"] == pytest.approx(np.hypot(0.3, 0.5))  # from 0, 0, 0.05
    near, far = (next(p for p in document["point"] if p["name"] == n) for n in closure["between"])
    assert near["chain"] == "slider" and near["at"] == pytest.approx([0.1, 0.0, 0.05])
    # the anchor as drawn, 0.1 + 0.3, 0, 1 - 0.45, seen from the crank at 0.5, 0, 0.5
    assert far["chain"] == "crank" and far["at"] == pytest.approx([-0.1, 0.0, 0.05])


PLATFORM = """\
<mujoco model="platform">
  <worldbody>
    <body name="platform" pos="0 0 1"><freejoint/><geom size="0.1"/></body>
    ARMS
  </worldbody>
  <equality>CONNECTS</equality>
</mujoco>
"""


def test_a_free_body_is_bridged_by_the_distances_of_what_is_connected_to_it() -> None:
    arms, connects = "", ""
    for k in range(3):
        x, y = np.cos(2.0 * k), np.sin(2.0 * k)
        arms += f'<body name="arm{k}" pos="{x} {y} 0"><joint name="q{k}" axis="1 {k} 0"/></body>'
        connects += f'<connect body1="arm{k}" body2="platform" anchor="{-x / 2} {-y / 2} 1"/>'
    text = PLATFORM.replace("ARMS", arms).replace("CONNECTS", connects)
    document, notes = mechanism_of_mjcf(text)
    assert notes == ["no <jointpos> sensor: every hinge and slide is taken as sensed"]
    assert [c["kind"] for c in document["closure"]] == ["distance"] * 3
    sides = [2 * 0.5 * np.sin(angle / 2) for angle in (2.0, 4.0, 2.0)]
    assert [c["value"] for c in document["closure"]] == pytest.approx(sides)
    assert rsicalib.load_mechanism(document).name == "platform"


def test_two_sensed_joints_that_are_equal_close_a_loop_of_their_own() -> None:
    document, _ = mechanism_of_mjcf(
        model(
            '<joint joint1="l1" joint2="r1" polycoef="-0.2618 1 0 0 0"/>'
            + CLOSED["connect of sites"]
        )
    )
    assert document["closure"][0]["kind"] == "touch", "with an offset one follows the other"
    document, _ = mechanism_of_mjcf(model('<joint joint1="l2" joint2="r1"/>'))
    (closure,) = document["closure"]
    assert closure["kind"] == "equal" and closure["between"] == ["l2", "r1"]


def test_a_model_of_several_files_is_read_by_the_command(tmp_path: Path) -> None:
    text = model(CLOSED["connect of sites"])
    head, tail = text.split("  <worldbody>")
    world, rest = tail.split("</worldbody>")
    (tmp_path / "world.xml").write_text(
        f"<mujocoinclude><worldbody>{world}</worldbody></mujocoinclude>"
    )
    path = tmp_path / "arms.xml"
    path.write_text(f'{head}<include file="world.xml"/>{rest}')
    assert (
        rsicalib.load_mechanism(path).to_dict()
        == rsicalib.load_mechanism(mechanism_of_mjcf(text)[0]).to_dict()
    )


BROKEN = {
    "no loop": ("", "found no active <connect>, <weld> or <joint>"),
    "a ratio alone": (
        '<joint joint1="l1" joint2="r1" polycoef="0 -0.5 0 0 0"/>',
        "beside l1, which only follows another joint",
    ),
    "a loop that is off": (
        '<connect site1="left tip" site2="right tip" active="false"/>',
        "found no active <connect>",
    ),
    "a tendon": ('<tendon tendon1="t"/>', "found <tendon>, expected connect, weld or joint"),
    "a lost body": ('<connect body1="left" anchor="0 0 0"/>', "found body 'left', expected one of"),
    "a lost site": ('<connect site1="left tip" site2="x"/>', "found site 'x', expected a site"),
    "a curve": (
        '<joint joint1="l1" joint2="r1" polycoef="0 1 2 0 0"/>',
        "line 36, joint: found polycoef 0 1 2 0 0, expected two joints, one a multiple",
    ),
    "a word": (
        '<connect body1="left lower" body2="right lower" anchor="0 0 x"/>',
        "connect, anchor: found",
    ),
}


@pytest.mark.parametrize("name", BROKEN)
def test_a_model_that_cannot_be_used_is_refused(name: str) -> None:
    equality, message = BROKEN[name]
    with pytest.raises(InputError, match=message):
        mechanism_of_mjcf(model(equality))


def test_a_xacro_is_refused_with_the_command_that_expands_it(tmp_path: Path) -> None:
    from rsicalib.io.urdf import chain_from_urdf

    path = tmp_path / "arm.urdf.xacro"
    path.write_text('<robot name="r" xmlns:xacro="x"><xacro:property name="h" value="1"/></robot>')
    with pytest.raises(
        InputError, match=r"Expand the xacro first: xacro \S+arm\.urdf\.xacro -o \S+arm\.urdf$"
    ):
        chain_from_urdf(path, "a", "b", {})


@pytest.mark.parametrize(
    ("drawn", "zero"),
    [
        ('axisangle="0 0 2 40"', 'axisangle="0 0 0 40"'),
        ('quat="2 0.2 -0.4 0.1"', 'quat="0 0 0 0"'),
        ('xyaxes="1 0.1 0 0 1 0.2"', 'xyaxes="1 0.1 0 2 0.2 0"'),
        ('zaxis="0.1 0.2 1"', 'zaxis="0 0 0"'),
    ],
)
def test_a_direction_without_length_is_refused_by_name(drawn: str, zero: str) -> None:
    text = model(CLOSED["connect of sites"]).replace(drawn, zero)
    with pytest.raises(InputError, match=f"found {zero.split('=')[0]} without a direction"):
        mechanism_of_mjcf(text)


def test_a_number_that_is_none_is_refused_by_name() -> None:
    follows = '<joint joint1="r2" joint2="r1" polycoef="0 one"/>'
    with pytest.raises(InputError, match="polycoef"):
        mechanism_of_mjcf(model(CLOSED["connect of sites"] + follows))
    with pytest.raises(InputError, match="torquescale"):
        mechanism_of_mjcf(model(CLOSED["weld"].replace('"0.4"', '"x"')))
