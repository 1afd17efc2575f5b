"""Channels in degrees, and degrees where radians are meant.

The witness is the machine itself, drawn and simulated in radians by `tests/families`.
"""

from __future__ import annotations

import re
import tomllib
from collections.abc import Callable
from dataclasses import replace
from functools import cache
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import numpy as np
import pytest

import rsicalib
from rsicalib import Mechanism
from rsicalib.exports.coordinates import unit_of
from tests import cone
from tests.commands import run_text
from tests.families.device import Device, Session, observe, stage
from tests.families.trials import readings_of, toml
from tests.full import sized
from tests.machines import files
from tests.machines.trials import make

DEGREES = ("noise", "offset", "limits", "range")
Values = dict[str, Any]


@cache
def machine(family: str = "fourbar") -> tuple[Device, Session]:
    """A clean device with encoders, and a session, in radians."""
    rng = np.random.default_rng([3, 0])
    device = Device.random(family, rng)
    return device, observe(device, stage(device, rng), rng)


def changed(change: Callable[[Values], None]) -> Values:
    """The mechanism with every channel changed."""
    values = tomllib.loads(toml(machine()[0]))
    for channel in values["channel"]:
        channel.setdefault("limits", [-np.pi, np.pi])
        change(channel)
    return values


def in_degrees(channel: Values, but: str = "") -> None:
    """All of a channel in degrees, but for one key."""
    channel["unit"] = "deg"
    for key in set(DEGREES) & channel.keys() - {but}:
        channel[key] = np.degrees(channel[key]).tolist()


def read(values: Values, factor: float = 1.0) -> tuple[Any, Mechanism]:
    """The session as readings of a mechanism, times a factor."""
    mechanism = Mechanism(values)
    session = machine()[1]
    return readings_of(mechanism, session.changed(session.values * factor)), mechanism


def warned(values: Values, factor: float = 1.0) -> str:
    """All warnings of a calibration, one after the other."""
    return " | ".join(map(str, rsicalib.calibrate(*read(values, factor)).warnings))


def test_a_mechanism_in_degrees_is_the_one_in_radians() -> None:
    plain = rsicalib.calibrate(*read(changed(lambda _: None)))
    degrees = rsicalib.calibrate(*read(changed(in_degrees), 180 / np.pi))
    assert degrees.fit.chi2 == pytest.approx(plain.fit.chi2, rel=1e-6)
    assert "degrees" not in {w.kind for w in degrees.warnings}
    for one, other in zip(plain.parameters, degrees.parameters, strict=True):
        if one.term == "offset":  # of the joint, in radians in every result
            assert other.value == pytest.approx(one.value, abs=1e-9) and other.unit == "rad"


def test_what_is_exported_of_channels_in_degrees_is_in_radians() -> None:
    plain = read(changed(lambda _: None))[1].to_dict()["channel"]
    readings, mechanism = read(changed(in_degrees), 180 / np.pi)
    found = rsicalib.calibrate(readings, mechanism)
    assert found.noise is not None
    files = rsicalib.export_result(found, "csv", mechanism, readings=readings)
    corrected = tomllib.loads(str(files["corrected.toml"]))["channel"]
    model = str(rsicalib.export_result(found, "mjcf", mechanism)["calibrated.xml"])
    ranges = [[float(end) for end in text.split()] for text in re.findall('range="(.*?)"', model)]
    for channel, drawn in zip(corrected, plain, strict=True):
        assert channel["unit"] == "rad"
        assert channel["limits"] == pytest.approx(drawn["limits"], rel=1e-12)
        noise = np.radians(found.noise.sigma[channel["name"]])
        assert channel["noise"] == pytest.approx(noise, rel=1e-9)
        assert any(span == pytest.approx(drawn["limits"], rel=1e-12) for span in ranges)


def test_a_pair_of_arms_in_degrees_is_the_one_in_radians() -> None:
    """Channels of no joint: what is found is in radians, and says so."""

    def pair(unit: str, factor: float) -> rsicalib.Calibration:
        rng = np.random.default_rng(5)
        leader = rng.uniform(-1.5, 1.5, 200)
        follower = (leader - 0.03) / 1.02 + rng.normal(0, 2e-3, 200)
        names = ("leader", "follower")
        scale = {"unit": unit, "gain": 1.0, "offset": 0.0}
        values: Values = {"name": "pair", "length_unit": "m"}
        values["channel"] = [{"name": name, **scale} for name in names]
        joint = {"name": "joint", "kind": "equal", "between": [*names], "noise": 2e-3 * factor}
        values["closure"] = [joint]
        values["model"] = {"terms": ["offset@follower", "gain@follower"]}
        rows = {"leader": factor * leader, "follower": factor * follower}
        return rsicalib.calibrate(rows, Mechanism(values))

    plain, degrees = pair("rad", 1.0), pair("deg", 180 / np.pi)
    assert [p.unit for p in degrees.parameters] == ["rad", "rad/deg"]
    assert degrees.fit.misclosure_unit == "rad"
    (offset, gain), (same, own) = plain.parameters, degrees.parameters
    # the same to the rounding of factors, where a fit ends at a part in 1e9 of its uncertainty
    assert same.value == pytest.approx(offset.value, abs=1e-6 * offset.sd)
    assert own.value == pytest.approx(np.deg2rad(gain.value), rel=1e-9)
    assert abs(same.value - 0.03) < 5 * same.sd
    assert degrees.fit.rms_misclosure == pytest.approx(plain.fit.rms_misclosure, rel=1e-6)
    # Noise of the closure is written in degrees, too: 198 degrees of freedom.
    assert degrees.fit.chi2 == pytest.approx(plain.fit.chi2, rel=1e-6)
    assert plain.fit.chi2 == pytest.approx(198.0, abs=100.0)


def test_counts_that_are_equal_to_an_angle_give_an_angle() -> None:
    """A follower in counts and its leader in degrees: what is found of the counts is in radians."""
    rng = np.random.default_rng(6)
    leader, per_count = rng.uniform(-80.0, 80.0, 200), 2 * np.pi / 4096
    counts = np.rint((np.radians(leader) - 0.03) / (1.02 * per_count) + 2048.0)
    scales = ({"unit": "deg", "gain": 1.0, "noise": 0.01}, {"unit": "count", "gain": per_count})
    values: Values = {"name": "pair", "length_unit": "m"}
    names = ("leader", "follower")
    values["channel"] = [
        {"name": name, "offset": 0.0, **scale} for name, scale in zip(names, scales, strict=True)
    ]
    values["closure"] = [{"name": "joint", "kind": "equal", "between": [*names], "noise": 2e-3}]
    values["model"] = {"terms": ["offset@follower", "gain@follower"]}
    mechanism = Mechanism(values)
    found = rsicalib.calibrate({"leader": leader, "follower": counts}, mechanism)
    assert [p.unit for p in found.parameters] == ["rad", "rad/count"]
    assert found.fit.misclosure_unit == "rad"
    offset, gain = found.parameters
    assert abs(gain.value - 1.02 * per_count) < 5 * gain.sd
    # Numpy alone: the coordinate of the counts is the angle of the leader, in radians.
    left = offset.value + gain.value * counts - np.radians(leader)
    assert np.sqrt(np.mean(left**2)) < 1e-3
    assert unit_of(mechanism) == {"leader": "rad", "follower": "rad"}


def test_one_number_is_not_the_noise_of_channels_in_several_units() -> None:
    values = changed(lambda _: None)
    in_degrees(values["channel"][0])
    mechanism = Mechanism(values)
    rows = {channel.name: np.zeros(4) for channel in mechanism.channels}
    units = {channel.name: channel.unit for channel in mechanism.channels}
    with pytest.raises(rsicalib.InputError, match=r"one number, 1\.5, for channels in") as found:
        rsicalib.calibrate(rows, mechanism, noise=1.5)
    assert all(f"{name} [{unit}]" in found.value.message for name, unit in units.items())
    with pytest.raises(rsicalib.InputError, match="found one number"):
        rsicalib.trace(rows, mechanism, noise=1.5)


def test_what_is_printed_is_what_was_written() -> None:
    rng = np.random.default_rng(5)
    for _ in range(200):
        low, high, offset = np.round(np.sort(rng.uniform(-400, 400, 3))[[0, 2, 1]], 6).tolist()
        values = changed(in_degrees)
        values["channel"][0] |= {"limits": [low, high], "offset": offset, "gain": 1.25}
        again = tomllib.loads(Mechanism(values).to_toml())["channel"][0]
        assert (again["limits"], again["offset"], again["gain"]) == ([low, high], offset, 1.25)


def test_a_slide_that_reads_degrees_keeps_its_lengths() -> None:
    """A rack on an encoder: gain is a length per radian, offset and limits are lengths."""
    rows = [{"channel": "s", "joint": "prismatic"}]
    values = {
        "name": "rack",
        "length_unit": "mm",
        "channel": [
            {"name": "s", "unit": "deg", "gain": 20.0, "offset": 7.0, "limits": [0.0, 400.0]}
        ],
        "chain": [{"name": "rail", "dh": rows}],
        "point": [
            {"name": "end", "chain": "rail", "at": [0, 0, 0]},
            {"name": "post", "at": [9, 0, 0]},
        ],
        "closure": [
            {"name": "bar", "kind": "distance", "between": ["end", "post"], "value": 500.0}
        ],
    }  # fmt: skip
    (channel,) = Mechanism(values).channels
    assert channel.gain == pytest.approx(20.0 * np.pi / 180)
    assert (channel.offset, channel.limits) == (7.0, (0.0, 400.0))
    assert Mechanism(values).to_dict()["channel"][0]["limits"] == (0.0, 400.0)


def test_limits_of_a_description_are_in_the_unit_of_the_channel(tmp_path: Any) -> None:
    (tmp_path / "arm.urdf").write_text(
        """<robot name="r"> <link name="base"/> <link name="arm"/>
        <joint name="hinge" type="revolute"> <parent link="base"/> <child link="arm"/>
        <axis xyz="0 0 1"/> <limit lower="-1.5" upper="2.5" effort="1" velocity="1"/> </joint>
        </robot>"""
    )
    (tmp_path / "arm.toml").write_text(
        """name = "arm"
        length_unit = "m"
        channel = [{name = "q", unit = "deg", gain = 1.0, offset = 0.0}]
        point = [{name = "tip", chain = "arm", at = [0.3, 0, 0]}, {name = "post", at = [1, 0, 0]}]
        closure = [{name = "bar", kind = "distance", between = ["tip", "post"], value = 0.8}]
        [[chain]]
        name = "arm"
        urdf = "arm.urdf"
        base = "base"
        tip = "arm"
        channels = {hinge = "q"}
        """
    )
    mechanism = rsicalib.load_mechanism(tmp_path / "arm.toml")
    assert mechanism.channels[0].limits == pytest.approx((-1.5, 2.5))
    printed = mechanism.to_dict()["channel"][0]["limits"]
    assert printed == pytest.approx(np.degrees([-1.5, 2.5]))


def test_limits_in_radians_of_a_channel_in_degrees_are_named() -> None:
    text = warned(changed(lambda c: in_degrees(c, "limits")), 180 / np.pi)
    assert "limits" in text and "in degrees" in text


def test_limits_in_degrees_of_a_channel_in_radians_are_named() -> None:
    text = warned(changed(lambda c: c.update(limits=[-180.0, 180.0])))
    assert "limits of" in text and "degrees" in text


def test_limits_in_degrees_are_told_before_there_are_readings(tmp_path: Any) -> None:
    """`mechanism` and `plan` say so as well; half a turn in radians, or a fraction, is none."""
    wide, true = (
        Mechanism(changed(lambda c, ends=ends: c.update(limits=ends)))
        for ends in ([-180.0, 180.0], [-np.pi, np.pi])
    )
    (text,) = wide.doubts
    assert all(channel.name in text for channel in wide.channels) and "degrees" in text
    assert true.doubts == []
    path = tmp_path / "wide.toml"
    path.write_text(wide.to_toml(), encoding="utf-8")
    for verb in (["mechanism", str(path)], ["plan", "--mechanism", str(path), "--poses", "4"]):
        assert f"warning: {text}\n" in run_text(*verb).stderr


def test_noise_in_radians_of_a_channel_in_degrees_is_named() -> None:
    device, _ = machine()
    own = dict(zip(device.names, device.noise, strict=True))
    values = changed(lambda c: (c.update(noise=float(own[c["name"]])), in_degrees(c, "noise")))
    text = warned(values, 180 / np.pi)
    assert "noise" in text and "in degrees" in text


def test_an_offset_in_radians_of_a_channel_in_degrees_is_named() -> None:
    device, _ = machine()
    own = dict(zip(device.names, device.offsets, strict=True))
    values = changed(lambda c: (c.update(offset=float(own[c["name"]])), in_degrees(c, "offset")))
    assert "offsets of" in warned(values, 180 / np.pi)


@pytest.mark.parametrize(("unit", "factor"), [("rad", 180 / np.pi), ("deg", 1.0)])
def test_readings_in_the_other_unit_are_named(unit: str, factor: float) -> None:
    values = changed(in_degrees if unit == "deg" else lambda _: None)
    text = warned(values, factor)
    assert "degrees" in text or "radians" in text, text


@pytest.mark.parametrize("number", sized([0], [0, 1, 3]))
def test_an_arm_that_does_not_fit_its_plane_is_not_called_in_degrees(number: int) -> None:
    """Readings times .017 stand nearly still: there is a plane through any such points."""
    case = make("plane", "effect", number, 31)
    rng = np.random.default_rng(number)
    read = case.machine.observe(rng, case.effect, 12.0 * case.size)
    with TemporaryDirectory() as folder:
        csv, mechanism = files.write(case.machine, read, Path(folder))
        found = rsicalib.calibrate(csv, mechanism)
        assert found.quality.chi2 > 20 * found.quality.dof
        assert "degrees" not in {w.kind for w in found.warnings}


@pytest.mark.parametrize(
    ("found", "meant"), [("degrees", "deg"), ("°", "deg"), ("Rad", "rad"), ("counts", "count")]
)
def test_a_unit_that_is_written_otherwise_is_asked_for(found: str, meant: str) -> None:
    """Any text is a unit of one's own, and its gain then says what it is in radians."""
    values = changed(lambda c: c.update(unit=found))
    with pytest.raises(rsicalib.InputError, match=f"unit '?\"?{found}.*{meant}"):
        Mechanism(values)


LARGE = np.radians([90.0, -90.0, 45.0, 30.0, 180.0, -135.0])


def arm(offsets: Any, unit: str = "rad", tell: bool = True) -> Mechanism:
    """The arm at a cone with encoders of which these offsets are written."""
    values = tomllib.loads(cone.mechanism(2e-5 if tell else None, 0.02))
    for channel, offset in zip(values["channel"], offsets, strict=True):
        channel |= {"unit": unit, "offset": float(offset)}
        del channel["limits"]
    return Mechanism(values)


def seated(factor: float = 1.0) -> dict[str, Any]:
    """A session whose encoders read zero far from the zero of the drawing."""
    table = cone.session(7).table
    own = {name: np.array(table[name]) - off for name, off in zip(JOINTS, LARGE, strict=True)}
    return {**table, **{name: values * factor for name, values in own.items()}}


JOINTS = [f"q{k}" for k in range(1, 7)]


def test_large_offsets_in_degrees_are_named() -> None:
    """Angles return after a turn: 90 rad is 1.04 rad as well, and 90 is far from neither."""
    found = rsicalib.calibrate(seated(), arm(np.degrees(LARGE)))
    (warning,) = (w for w in found.warnings if w.kind == "degrees")
    assert "offsets of" in warning.text
    right = rsicalib.calibrate(seated(), arm(LARGE))
    assert "degrees" not in {w.kind for w in right.warnings}


def test_offsets_in_radians_of_channels_in_degrees_are_named_and_the_readings_are_not() -> None:
    """A loop also closes with readings that hardly move, and these were accused."""
    table = seated(180.0 / np.pi)
    found = rsicalib.calibrate(table, arm(LARGE, "deg", tell=False))
    texts = [w.text for w in found.warnings if w.kind == "degrees"]
    assert texts and all("offsets" in text for text in texts), texts
    assert found.exit_code == 4
    right = rsicalib.calibrate(table, arm(np.degrees(LARGE), "deg", tell=False))
    assert right.exit_code == 0 and "degrees" not in {w.kind for w in right.warnings}


@pytest.mark.parametrize("seed", range(sized(1, 2)))
def test_random_poses_are_not_called_in_degrees(seed: int) -> None:
    """Offsets of nine channels from anywhere were all within 5 % of 57.3 times what is declared."""
    codes = np.random.default_rng(seed).integers(300, 3800, (40, 9)).astype(float)
    own = rsicalib.load_mechanism("rsi")
    readings = rsicalib.Readings.from_arrays(own, codes, pose=np.arange(40))
    found = rsicalib.calibrate(readings, own)
    assert "degrees" not in {w.kind for w in found.warnings}


@pytest.mark.parametrize(("seed", "bend"), [(3, 0.02), (3, 0.05), (2, 0.05)])
def test_an_arm_with_an_error_is_not_called_in_another_unit(seed: int, bend: float) -> None:
    """Readings in another unit have a noise in that unit: judged by the noise of those that were
    read, angles times 57.3 or .017 closed the loop of any arm at a cone."""
    made = cone.session(seed, bend=bend, samples=2)
    drawn = Mechanism.from_toml(cone.mechanism(None, 0.02))
    found = rsicalib.calibrate(made.table, drawn)
    assert found.verdict == "unexplained"
    assert "degrees" not in {w.kind for w in found.warnings}


@pytest.mark.parametrize("seed", range(sized(1, 2)))
def test_an_arm_in_another_unit_is_called_so(seed: int) -> None:
    made = cone.session(seed, samples=2)
    drawn = Mechanism.from_toml(cone.mechanism(None, 0.02))
    names = [f"q{k}" for k in range(1, 7)]
    degrees = {name: np.degrees(np.array(made.table[name], float)) for name in names}
    found = rsicalib.calibrate({**made.table, **degrees}, drawn)
    assert "degrees" in {w.kind for w in found.warnings}


@pytest.mark.parametrize("gain", [180.0 / np.pi, np.pi / 180.0])
def test_a_gain_in_degrees_a_radian_is_named(gain: float) -> None:
    unit = "rad" if gain > 1.0 else "deg"
    values = arm(np.zeros(6), unit, tell=False).to_dict()
    for channel in values["channel"]:
        channel["gain"] = gain
    table = cone.session(7).table
    for name in JOINTS:
        table[name] = np.array(table[name]) * (1.0 if unit == "rad" else 180.0 / np.pi)
    found = rsicalib.calibrate(table, Mechanism(values))
    texts = [w.text for w in found.warnings if w.kind == "degrees"]
    assert texts and all("gains of" in text and "gain = 1.0" in text for text in texts), texts


@pytest.mark.parametrize("place", ["twist", "rotation", "workspace", "rest"])
def test_an_angle_of_a_drawing_of_more_than_a_turn_is_refused(place: str) -> None:
    values = rsicalib.load_mechanism("rsi").to_dict()
    row = values["chain"][0]["dh"][1]
    match place:
        case "twist":
            row["alpha"] = 90.0
        case "rotation":
            row["rpy"] = [0.0, -90.0, 0.0]
        case "workspace":
            values["workspace"]["rx"] = [-30.0, 30.0]
        case _:
            values["rest"]["pose"] = [*values["rest"]["pose"][:5], 30.0]
    with pytest.raises(rsicalib.InputError, match=r"radians within two turns: -?[39]0 degrees are"):
        Mechanism(values)


def test_gains_that_are_all_off_by_one_number_are_named() -> None:
    """Ten bits of a converter of twelve: the calibration is right, and the file is not."""
    made = rsicalib.simulate(poses=40, samples=4, seed=5)
    rest = made.rest
    quarter = [replace(one, values=np.floor(one.values / 4.0)) for one in (made.readings, rest)]
    found = rsicalib.calibrate(quarter[0], rest=quarter[1])
    (warning,) = (w for w in found.warnings if w.kind == "units")
    assert "another converter" in warning.text
    right = rsicalib.calibrate(made.readings, rest=rest)
    assert "units" not in {w.kind for w in right.warnings}


@pytest.mark.parametrize(
    ("drawn", "given", "target", "times"),
    [
        ("a = -392.2", "a = -15.440945", "arm/3", "25.4 times"),
        ("d = 99.7", "d = 9.97", "arm/5", "10 times"),
        ("[40.0, 0.0, 120.0]", "[40.0, 0.0, 0.12]", "ball", "1000 times"),
        *sized(
            [],
            [
                ("a = -425.0", "a = -0.425", "arm/2", "1000 times"),
                ("d = 133.3", "d = 0.1333", "arm/4", "1000 times"),
            ],
        ),
    ],
)
def test_one_length_in_another_unit_is_named(
    drawn: str, given: str, target: str, times: str
) -> None:
    """The arm and its seatings are those of `tests/cone.py`, in mm."""
    taken = cone.session(1)
    text = cone.mechanism(2e-5, 0.02)
    assert text.count(drawn) == 1
    found = rsicalib.calibrate(taken.table, Mechanism.from_toml(text.replace(drawn, given)))
    assert found.exit_code in (3, 4)
    (warning,) = (w for w in found.warnings if w.kind == "units")
    assert warning.target == target
    assert f"with {times} that" in warning.text


def test_a_length_that_is_a_little_wrong_is_in_no_other_unit() -> None:
    """A link that is twice as long as it is drawn, and one that is as it is."""
    taken = cone.session(1)
    text = cone.mechanism(2e-5, 0.02)
    for given in ("a = -425.0", "a = -212.5"):
        mechanism = Mechanism.from_toml(text.replace("a = -425.0", given))
        found = rsicalib.calibrate(taken.table, mechanism)
        assert "units" not in {w.kind for w in found.warnings}
