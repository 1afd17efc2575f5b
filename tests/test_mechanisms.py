"""Mechanism files: what is expanded, what is filled in, and that the text says the same."""

from __future__ import annotations

import math
import shutil
import tomllib
from datetime import date
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.optimize import least_squares

import rsicalib
from rsicalib.errors import InputError
from rsicalib.io.mechanisms import load_mechanism_text, mechanism_toml, read_mechanism
from tests import oracle

EXAMPLES = Path(__file__).parents[1] / "examples"
MUKCA = Path(__file__).parents[2] / "shared" / "data" / "mukca"

ROBOT = """<robot name="r">
<link name="base"/> <link name="arm"/>
<link name="rod"><inertial><origin xyz="0 0 0.1"/><mass value="2"/></inertial></link>
<link name="finger"><inertial><mass value="1"/></inertial></link>
<joint name="hinge" type="revolute"> <parent link="base"/><child link="arm"/>
  <origin xyz="0 0 0.5"/><axis xyz="0 0 1"/><limit lower="-1" upper="2"/></joint>
<joint name="slide" type="prismatic"> <parent link="arm"/><child link="rod"/>
  <axis xyz="0 0 1"/></joint>
<joint name="grip" type="prismatic"> <parent link="rod"/><child link="finger"/></joint>
</robot>"""
CHAIN = """
[[chain]]
name = "arm"
urdf = "robots/r.urdf"
base = "base"
tip = "rod"
channels = {hinge = "q1", slide = "q2"}
"""
REST = """
[[point]]
name = "tip"
chain = "arm"
at = [0.5, 0, 0]
[[point]]
name = "peg"
at = [1, 0, 0]
[[closure]]
name = "tip-peg"
kind = "distance"
between = ["tip", "peg"]
value = 0.7
"""
HEAD = 'name = "m"\nlength_unit = "m"\n'


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    (tmp_path / "robots").mkdir()
    (tmp_path / "robots" / "r.urdf").write_text(ROBOT)
    return tmp_path


def written(folder: Path, text: str) -> Path:
    path = folder / "m.toml"
    path.write_text(text)
    return path


def core_takes(text: str) -> None:
    """The core reads the text, where it is built and knows how."""
    core = pytest.importorskip(
        "rsicalib._core", reason="the core is not built", exc_type=ImportError
    )
    core.Mechanism.from_toml(text)


# ------------------------------------------------------------------ expansion


def test_a_urdf_chain_becomes_rows_and_channels(folder: Path) -> None:
    mechanism = read_mechanism(written(folder, HEAD + CHAIN + REST))
    scale = {"gain": 1.0, "offset": 0.0}
    assert mechanism["channel"] == [
        {"name": "q1", "unit": "rad", **scale, "limits": [-1.0, 2.0]},
        {"name": "q2", "unit": "m", **scale},
    ]
    (chain,) = mechanism["chain"]
    assert chain.keys() == {"name", "dh"}
    assert [row.get("channel") for row in chain["dh"]] == [None, "q1", "q2"]
    assert chain["dh"][2]["joint"] == "prismatic"
    assert chain["dh"][2]["mass"] == 2.0


def test_masses_from_a_file_replace_those_of_the_urdf(folder: Path) -> None:
    (folder / "masses.toml").write_text("arm = {mass = 3.0, com = [0.1, 0, 0]}")
    text = HEAD + CHAIN + 'masses = "masses.toml"\n' + REST
    rows = read_mechanism(written(folder, text))["chain"][0]["dh"]
    assert [row.get("mass") for row in rows] == [None, 3.0, None]


def test_declared_channels_win_and_are_completed(folder: Path) -> None:
    count = {"name": "q1", "unit": "count", "gain": 1e-3, "offset": 0.2, "range": [0, 4095]}
    noisy = {"name": "q2", "noise": 1e-5, "limits": [0, 1]}
    text = mechanism_toml({"name": "m", "length_unit": "m", "channel": [noisy, count]})
    channels = read_mechanism(written(folder, text + CHAIN + REST))["channel"]
    scale = {"unit": "m", "gain": 1.0, "offset": 0.0}
    assert channels == [{**noisy, **scale}, {**count, "limits": [-1.0, 2.0]}]


def test_channels_not_declared_take_their_place_in_the_chain(folder: Path) -> None:
    text = HEAD + '[[channel]]\nname = "q2"\nnoise = 1e-5\n' + CHAIN + REST
    channels = read_mechanism(written(folder, text))["channel"]
    assert [c["name"] for c in channels] == ["q1", "q2"]
    assert [c.get("noise") for c in channels] == [None, 1e-5]


def test_the_text_is_the_expanded_mechanism_with_notes(folder: Path) -> None:
    path = written(folder, HEAD + CHAIN + REST)
    text = load_mechanism_text(path)
    assert text is not None
    assert tomllib.loads(text) == read_mechanism(path)
    note = '# robots/r.urdf: joint "grip" moves beside the path: the mass of finger is left out\n'
    assert text.startswith(note)
    core_takes(text)


def test_a_file_without_urdf_is_passed_on_as_it_is(folder: Path) -> None:
    text = "# mine\n" + HEAD + "nonsense = 1\n"
    assert load_mechanism_text(written(folder, text)) == text


def test_the_builtin_mechanism_has_no_text() -> None:
    assert load_mechanism_text("rsi") is None


REFUSED = {
    "another unit": (
        HEAD.replace('"m"\n', '"mm"\n') + CHAIN,
        "length_unit: found 'mm', expected 'm'",
    ),
    "no base": (
        HEAD + CHAIN.replace("base =", "bse ="),
        "chain 'arm': found `bse`.* only name, urdf",
    ),
    "no tip": (
        HEAD + CHAIN.replace('tip = "rod"', ""),
        "chain 'arm', tip: found None, expected text",
    ),
    "rows too": (HEAD + CHAIN + "dh = []", "chain 'arm': found `dh`, expected beside `urdf` only"),
    "no channels": (
        HEAD + CHAIN.replace("channels", "#"),
        "chain 'arm', channels: found None, expected the channel of each joint",
    ),
    "a channel missing": (
        HEAD + CHAIN.replace(', slide = "q2"', ""),
        r'r.urdf, line 7, joint "slide": found a prismatic joint without a channel',
    ),
    "masses in place": (
        HEAD + CHAIN + "masses = 3",
        "chain 'arm', masses: found 3, expected the path",
    ),
    "no masses": (HEAD + CHAIN + 'masses = "m"', "m, file: found No such file"),
    "no urdf": (HEAD + CHAIN.replace("r.urdf", "s.urdf"), "s.urdf, URDF: found No such file"),
    "a channel twice": (
        HEAD + '[[channel]]\nname = "q1"\n' * 2 + CHAIN,
        "channel 2, name: found 'q1', expected a name of its own",
    ),
    "not TOML": ("name = ", "m.toml, file: found .*expected TOML"),
}


@pytest.mark.parametrize("case", REFUSED)
def test_refuses(case: str, folder: Path) -> None:
    text, message = REFUSED[case]
    with pytest.raises(InputError, match=message) as caught:
        load_mechanism_text(written(folder, text))
    assert caught.value.where is not None
    assert caught.value.where["file"]


def test_a_name_that_is_nothing_names_the_builtin_ones() -> None:
    with pytest.raises(InputError, match=r"rsx, mechanism: found no such file.*built-in.*: rsi$"):
        load_mechanism_text("rsx")


# ------------------------------------------------------------------ TOML


SCALARS = st.one_of(
    st.text(st.characters(exclude_categories=["Cs"])),
    st.booleans(),
    st.integers(-(2**63), 2**63 - 1),
    st.floats(allow_nan=False),
    st.dates(),
)
KEYS = st.text(st.characters(exclude_categories=["Cs"]))
INLINE = st.recursive(
    SCALARS, lambda v: st.lists(v, max_size=3) | st.dictionaries(KEYS, v, max_size=3), max_leaves=8
)
TABLE = st.dictionaries(KEYS, INLINE, max_size=4)


@given(st.dictionaries(KEYS, INLINE | TABLE | st.lists(TABLE, min_size=1, max_size=3), max_size=5))
def test_toml_reads_back_the_same(mechanism: dict[str, Any]) -> None:
    assert tomllib.loads(mechanism_toml(mechanism)) == mechanism


def test_toml_keeps_every_digit() -> None:
    values = {
        "a": 0.1 + 0.2,
        "b": 5e-324,
        "c": 1e23,
        "d": -0.0,
        "e": math.inf,
        "f": date(1995, 5, 1),
    }
    assert tomllib.loads(mechanism_toml(values)) == values
    with pytest.raises(TypeError, match="TOML has no NoneType"):
        mechanism_toml({"a": None})


# ------------------------------------------------------------------ examples


@pytest.mark.parametrize("path", sorted(EXAMPLES.glob("*.toml")), ids=lambda p: p.stem)
def test_an_example_is_short_and_taken_by_the_core(path: Path, tmp_path: Path) -> None:
    assert len(path.read_text().splitlines()) < 40
    if path.stem.startswith("mukca"):
        if not MUKCA.is_dir():
            pytest.skip("the robot descriptions of Mukca are not beside the repository")
        for file in ("panda.urdf", "gen3lite.urdf", "panda_masses.toml"):
            shutil.copy(MUKCA / file, tmp_path)
        path = Path(shutil.copy(path, tmp_path))
        (chain,) = read_mechanism(path)["chain"]
        assert all("mass" in row for row in chain["dh"] if "channel" in row)
    text = load_mechanism_text(path)
    assert text is not None
    core_takes(text)


@pytest.mark.parametrize("name", ["ball_bar", "draw_wire", "two_arms"])
def test_an_example_can_be_assembled(name: str) -> None:
    mechanism = read_mechanism(EXAMPLES / f"{name}.toml")
    for closure in mechanism["closure"]:
        if closure["value"] == "wire":
            closure["value"] = 500.0
    rng = np.random.default_rng(1)
    joints, equations = len(mechanism["channel"]), len(mechanism["closure"])

    def misclosure(angles: np.ndarray) -> np.ndarray:  # [m²]
        return oracle.misclosure_of_angles(mechanism, angles[None])[0] / 1e6

    def jacobian(angles: np.ndarray) -> np.ndarray:
        return oracle.complex_step(misclosure, angles)

    def regular() -> bool:
        """From a random start the loop closes to some nm, and each closure takes one freedom."""
        tight: dict[str, Any] = {"xtol": 1e-15, "ftol": None, "gtol": None, "max_nfev": 200}
        fit = least_squares(misclosure, rng.uniform(-2, 2, joints), jacobian, **tight)
        rank = np.linalg.matrix_rank(fit.jac, tol=1e-4)
        return bool(np.abs(fit.fun).max() < 1e-9 and rank == equations)

    # Not from every start: arms that grip from the same side are singular.
    assert any(regular() for _ in range(10))


def test_numbers_of_numpy_are_numbers_in_toml() -> None:
    text = mechanism_toml({"a": np.float64(0.1), "b": np.int64(3), "c": [np.float64(1e-9)]})
    assert tomllib.loads(text) == {"a": 0.1, "b": 3, "c": [1e-9]}


@pytest.mark.parametrize("model", ['terms = ["offset", "gian@a11"]', "sd = {gian = 1.0}"])
def test_a_term_that_there_is_not_is_refused_with_the_file(tmp_path: Path, model: str) -> None:
    text = rsicalib.load_mechanism("rsi").to_toml().split("[model]")[0] + f"[model]\n{model}\n"
    (tmp_path / "mine.toml").write_text(text)
    with pytest.raises(InputError, match=r"mine\.toml: .*gian.*offset") as error:
        rsicalib.load_mechanism(tmp_path / "mine.toml")
    assert error.value.where is not None and str(error.value.where["file"]).endswith("mine.toml")
