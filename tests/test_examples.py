"""The mechanisms of `examples/` on simulated readings: what was put in comes out.

Simulated by the oracle's matrix products, fitted by the core. Offsets are 4 sd or less from the
truth, all of them together as far as chi-square allows: by chance that fails once in 10⁴.
"""

from __future__ import annotations

import shutil
import tomllib
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

import rsicalib
from rsicalib import Calibration
from rsicalib.io.mechanisms import read_mechanism
from tests import oracle, simulated

EXAMPLES = Path(__file__).parents[1] / "examples"
Array = NDArray[Any]


def recovered(found: Calibration, term: str, truth: dict[str, float]) -> None:
    """Every parameter of a term is the truth within 4 sd, and known better than 10 mrad."""
    own = {p.target: p for p in found.parameters if p.term == term}
    assert own.keys() == truth.keys()
    for target, true in truth.items():
        p = own[target]
        assert p.value is not None and p.sd is not None
        assert p.sd < 1e-2, target
        assert abs(p.value - true) < 4 * p.sd, (target, p.value - true, p.sd)


def offsets_of(mechanism: dict[str, Any], rng: np.random.Generator) -> Array:
    out: Array = rng.normal(0.0, 0.01, len(mechanism["channel"]))
    return out


@pytest.mark.parametrize("name", [path.stem for path in sorted(EXAMPLES.glob("*.toml"))])
def test_an_example_is_short(name: str) -> None:
    assert len((EXAMPLES / f"{name}.toml").read_text().splitlines()) < 40


def test_a_ball_bar_gives_offsets_and_lengths() -> None:
    mechanism = read_mechanism(EXAMPLES / "ball_bar.toml")
    rng = np.random.default_rng(0)
    offsets = offsets_of(mechanism, rng)
    true = read_mechanism(EXAMPLES / "ball_bar.toml")
    lengths = rng.normal(0.0, 0.5, 6)
    for row, more in zip(true["chain"][0]["dh"], lengths, strict=True):
        row["a"] = row.get("a", 0.0) + more
    play = rng.normal(0.0, 0.002, 200)  # of the bar itself

    def off(angles: Array) -> Array:
        ends = [oracle.point(true, name, angles) for name in ("ball", "table")]
        apart: Array = np.sum((ends[0] - ends[1]) ** 2, axis=1, keepdims=True)
        return apart

    angles = simulated.closed(true, lambda a: (off(a) - 600.0**2) / 1200.0, 200, rng)
    # The play moves the joints by as little as they must.
    slope = oracle.row_derivative(off, angles)[:, 0] / 1200.0
    angles = angles + play[:, None] * slope / np.sum(slope**2, axis=1, keepdims=True)
    loaded = rsicalib.load_mechanism(EXAMPLES / "ball_bar.toml")
    values = simulated.read(mechanism, angles, offsets, rng)
    found = rsicalib.calibrate(rsicalib.Readings.from_arrays(loaded, values), loaded)
    assert found.verdict == "adequate"
    names = oracle.channel_names(mechanism)
    recovered(found, "offset", dict(zip(names, offsets, strict=True)))
    for k, more in enumerate(lengths, start=1):
        length = found["link_length", f"arm/{k}"]
        assert length.value is not None and length.sd is not None
        assert abs(length.value - more) < 4 * length.sd


def test_a_draw_wire_gives_offsets() -> None:
    mechanism = read_mechanism(EXAMPLES / "draw_wire.toml")
    rng = np.random.default_rng(1)
    offsets = offsets_of(mechanism, rng)
    low, high = simulated.joint_limits(mechanism)
    angles = rng.uniform(low, high, (200, 6))
    ends = [oracle.point(mechanism, name, angles) for name in ("eyelet", "anchor")]
    wire = np.linalg.norm(ends[0] - ends[1], axis=1) + rng.normal(0.0, 0.05, 200)
    loaded = rsicalib.load_mechanism(EXAMPLES / "draw_wire.toml")
    values = simulated.read(mechanism, angles, offsets, rng)
    readings = rsicalib.Readings.from_arrays(loaded, values, columns={"wire": wire})
    found = rsicalib.calibrate(readings, loaded)
    assert found.verdict == "adequate"
    recovered(found, "offset", dict(zip(oracle.channel_names(mechanism), offsets, strict=True)))


def test_two_arms_that_hold_one_part_calibrate_each_other() -> None:
    mechanism = read_mechanism(EXAMPLES / "two_arms.toml")
    rng = np.random.default_rng(2)
    offsets = offsets_of(mechanism, rng)
    for channel in mechanism["channel"]:
        channel["limits"] = [-2.5, 2.5]
    # Six lengths can be assembled in several ways; the part is one of them.
    held = oracle.translation(x=80.0, z=150.0) @ oracle.rotation("y", 0.8)
    held = held @ oracle.rotation("x", np.pi)

    def off(a: Array) -> Array:
        left, right = (oracle.chain_end(mechanism, name, a) for name in ("left", "right"))
        apart = (right - left @ held)[:, :3]
        apart[:, :, 3] /= 100.0
        out: Array = apart.reshape(len(a), 12)
        return out

    angles = simulated.closed(mechanism, off, 60, rng)
    assert np.abs(oracle.misclosure_of_angles(mechanism, angles)).max() < 1e-2  # of (200 mm)²
    loaded = rsicalib.load_mechanism(EXAMPLES / "two_arms.toml")
    values = simulated.read(mechanism, angles, offsets, rng)
    found = rsicalib.calibrate(rsicalib.Readings.from_arrays(loaded, values), loaded)
    recovered(found, "offset", dict(zip(oracle.channel_names(mechanism), offsets, strict=True)))


# ------------------------------------------------------------------ an arm on sockets

SOCKETS = """
name = "arm on sockets"
length_unit = "mm"
[[point]]
name = "ball"
chain = "arm"
at = [40.0, 0.0, 120.0]
[[point]]
name = "socket"
unknown = ["group", "at"]
[[closure]]
name = "ball-socket"
kind = "touch"
between = ["ball", "socket"]
noise = 0.02
[[closure]]
name = "pair"
kind = "distance"
between = ["socket[at=A]", "socket[at=B]"]
value = 150.0
sd = 0.01
[model]
terms = ["offset@q2", "offset@q3", "offset@q4", "offset@q5", "offset@q6"]
"""


def sockets(
    renamed: dict[str, str] | None = None,
) -> tuple[rsicalib.Mechanism, rsicalib.Readings, dict[str, float]]:
    """A six-joint arm whose ball rests in two sockets of a plate, which was placed three times.

    `renamed` has other words for groups, sockets, channels, chain, points and closures.
    """
    words = renamed or {}
    arm = read_mechanism(EXAMPLES / "ball_bar.toml")
    rng = np.random.default_rng(3)
    offsets = offsets_of(arm, rng)
    offsets[0] = 0.0  # turns the arm with the plates: nobody can know it
    groups = [(g, a) for g in ("front", "left", "high") for a in "AB"]
    places = {}
    for g, centre in (
        ("front", (450, 0, 150)),
        ("left", (150, 420, 200)),
        ("high", (300, 250, 500)),
    ):
        along = rng.normal(size=3)
        along *= 75.0 / np.linalg.norm(along)
        places[g, "A"], places[g, "B"] = np.array(centre) - along, np.array(centre) + along
    angles = []
    for key in groups:
        held = rng.normal(0.0, 0.02, (25, 3))

        def off(a: Array, at: Array = places[key]) -> Array:
            return oracle.point(arm, "ball", a) - at

        exact = simulated.closed(arm, lambda a: off(a) / 100.0, 25, rng)
        slope = oracle.row_derivative(off, exact)
        angles.append(exact + (np.linalg.pinv(slope) @ held[..., None])[..., 0])
    values = simulated.read(arm, np.concatenate(angles), offsets, rng)
    channels = [{**c, "name": words.get(c["name"], c["name"])} for c in arm["channel"]]
    rows = [{**r, "channel": words.get(r["channel"], r["channel"])} for r in arm["chain"][0]["dh"]]
    text = SOCKETS
    for old in ("ball-socket", "ball", "socket", "pair", "A", "B", "q2", "q3", "q4", "q5", "q6"):
        if old in words:
            if old in "AB":
                text = text.replace(f"[at={old}]", f"[at={words[old]}]")
            elif old.startswith("q"):
                text = text.replace(f'"offset@{old}"', f'"offset@{words[old]}"')
            elif old == "socket":
                text = text.replace('"socket"', f'"{words[old]}"')
                text = text.replace('"socket[', f'"{words[old]}[')
            else:
                text = text.replace(f'"{old}"', f'"{words[old]}"')
    if "arm" in words:
        text = text.replace('"arm"', f'"{words["arm"]}"')
    own = {"channel": channels, "chain": [{"name": words.get("arm", "arm"), "dh": rows}]}
    loaded = rsicalib.Mechanism.from_dict({**tomllib.loads(text), **own})
    keys = {
        "group": [words.get(g, g) for g, _ in groups for _ in range(25)],
        "at": [words.get(a, a) for _, a in groups for _ in range(25)],
    }
    readings = rsicalib.Readings.from_arrays(loaded, values, keys=keys)
    names = [words.get(n, n) for n in oracle.channel_names(arm)[1:]]
    return loaded, readings, dict(zip(names, offsets[1:], strict=True))


def test_an_arm_on_sockets_gives_offsets() -> None:
    mechanism, readings, truth = sockets()
    found = rsicalib.calibrate(readings, mechanism)
    recovered(found, "offset", truth)
    assert found.groups is not None and found.groups.others is None
    # Each axis has 0.02 mm of play: the mean distance in three axes is 1.6 times that.
    assert found.groups.fitted == pytest.approx(0.02 * np.sqrt(8 / np.pi), rel=0.1)


AWKWARD = {
    "front": "front, right",
    "left": "a=b]",
    "high": "x,at=A",
    "A": "[1]",
    "B": "two, =2]",
    "q2": "shoulder",
    "q3": "elbow",
    "arm": "left arm",
    "ball": "tool",
    "socket": "cup",
    "ball-socket": "in cup",
    "pair": "plate",
}


def test_renaming_groups_links_and_channels_changes_no_result() -> None:
    """Also names with commas, equal signs and brackets."""
    plain = rsicalib.calibrate(*sockets()[1::-1], fit_groups=["front", "left"])
    mechanism, readings, _ = sockets(AWKWARD)
    other = rsicalib.calibrate(readings, mechanism, fit_groups=[AWKWARD["front"], AWKWARD["left"]])
    np.testing.assert_array_equal(other.values, plain.values)
    np.testing.assert_array_equal(other.covariance, plain.covariance)
    assert other.fit == plain.fit
    assert plain.groups is not None and other.groups is not None
    assert list(other.groups.by_group.values()) == list(plain.groups.by_group.values())
    assert (other.groups.fitted, other.groups.others) == (plain.groups.fitted, plain.groups.others)


def test_a_traced_result_does_not_depend_on_names_either() -> None:
    plain = rsicalib.trace(*sockets()[1::-1])
    mechanism, readings, _ = sockets(AWKWARD)
    other = rsicalib.trace(readings, mechanism)
    np.testing.assert_array_equal(other.values, plain.values)
    assert other.verdict == plain.verdict
    assert [s.term for s in other.steps] == [s.term for s in plain.steps]


def test_the_name_of_the_file_does_not_matter(tmp_path: Path) -> None:
    mechanism, readings, _ = sockets()
    readings.to_csv(tmp_path / "one.csv")
    shutil.copy(tmp_path / "one.csv", tmp_path / "panda_3.csv")
    files = [str(tmp_path / name) for name in ("one.csv", "panda_3.csv")]
    one, two = (rsicalib.calibrate(file, mechanism).to_dict() for file in files)
    # It is said, and changes nothing else.
    assert [found["readings"].pop("files") for found in (one, two)] == [[file] for file in files]
    assert one == two
