"""Mechanism files: what is expanded, what is filled in, and that values say the same."""

from __future__ import annotations

import copy
import pickle
import shutil
import tomllib
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from scipy.optimize import least_squares

import rsicalib
from rsicalib import DEMO
from rsicalib.errors import InputError
from rsicalib.io.cells import COLUMNS
from rsicalib.io.mechanisms import expansion_notes, load_mechanism, read_mechanism
from tests import oracle
from tests.machines import files

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
    declared = """
[[channel]]
name = "q2"
noise = 1e-5
limits = [0, 1]
[[channel]]
name = "q1"
unit = "count"
gain = 1e-3
offset = 0.2
range = [0, 4095]
"""
    channels = read_mechanism(written(folder, HEAD + declared + CHAIN + REST))["channel"]
    scale = {"unit": "m", "gain": 1.0, "offset": 0.0}
    assert channels == [{**noisy, **scale}, {**count, "limits": [-1.0, 2.0]}]


def test_channels_not_declared_take_their_place_in_the_chain(folder: Path) -> None:
    text = HEAD + '[[channel]]\nname = "q2"\nnoise = 1e-5\n' + CHAIN + REST
    channels = read_mechanism(written(folder, text))["channel"]
    assert [c["name"] for c in channels] == ["q1", "q2"]
    assert [c.get("noise") for c in channels] == [None, 1e-5]


def test_the_core_takes_the_expanded_mechanism_and_notes_say_what_is_left_out(folder: Path) -> None:
    path = written(folder, HEAD + CHAIN + REST)
    loaded = load_mechanism(path)
    assert loaded == rsicalib.Mechanism.from_dict(read_mechanism(path))
    note = 'robots/r.urdf: joint "grip" moves beside the path: the mass of finger is left out'
    assert expansion_notes(path) == [note]


def test_a_file_without_urdf_is_refused_by_line_and_column(folder: Path) -> None:
    path = written(folder, "# mine\n" + HEAD + "nonsense = 1\n")
    with pytest.raises(InputError, match=r"m\.toml: mechanism: .*line 4, column 1(.|\n)*nonsense"):
        load_mechanism(path)


def test_an_expanded_file_is_refused_by_its_entry(folder: Path) -> None:
    path = written(folder, HEAD + CHAIN + REST.replace("at = [1, 0, 0]", "at = [1, 0]"))
    with pytest.raises(InputError, match=r"m\.toml: mechanism, point\[1\]\.at: ") as caught:
        load_mechanism(path)
    assert caught.value.where is not None and str(caught.value.where["file"]).endswith("m.toml")


def test_the_builtin_mechanism_has_no_file() -> None:
    assert load_mechanism("rsi") == rsicalib.Mechanism.rsi()
    assert expansion_notes("rsi") == []


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
        "chain 'arm', channels: found none, .*hinge = .q1.",
    ),
    "a channel missing": (
        HEAD + CHAIN.replace(', slide = "q2"', ""),
        r'r.urdf, line 7, joint "slide": found a prismatic joint without a channel',
    ),
    "masses in place": (
        HEAD + CHAIN + "masses = 3",
        "chain 'arm', masses: found 3, expected the path",
    ),
    "no masses": (HEAD + CHAIN + 'masses = "m"', "m: found no such file"),
    "no urdf": (HEAD + CHAIN.replace("r.urdf", "s.urdf"), "s.urdf, URDF: found no such file"),
    "a channel twice": (
        HEAD + '[[channel]]\nname = "q1"\n' * 2 + CHAIN,
        "channel 2, name: found 'q1', expected a name of its own",
    ),
    "not TOML": ("name = ", "m.toml, line 1: found the end of the file, expected a number"),
}


@pytest.mark.parametrize("case", REFUSED)
def test_refuses(case: str, folder: Path) -> None:
    text, message = REFUSED[case]
    with pytest.raises(InputError, match=message) as caught:
        load_mechanism(written(folder, text))
    assert caught.value.where is not None
    assert caught.value.where["file"]


def test_a_name_that_is_nothing_names_the_builtin_ones() -> None:
    with pytest.raises(
        InputError,
        match=r"rsx, mechanism: found no such file.*built-in.*: rsi, delta, maslow, so101$",
    ):
        load_mechanism("rsx")


# ------------------------------------------------------------------ as values


def test_a_mechanism_is_its_dictionary() -> None:
    mechanism = rsicalib.Mechanism.rsi()
    values = mechanism.to_dict()
    assert rsicalib.Mechanism.from_dict(values) == mechanism
    assert rsicalib.Mechanism.from_toml(mechanism.to_toml()) == mechanism
    assert rsicalib.Mechanism.from_dict({**values, "name": "other"}) != mechanism
    assert mechanism != "rsi"


def test_numbers_of_numpy_are_numbers() -> None:
    values = rsicalib.Mechanism.rsi().to_dict()
    values["chain"][0]["dh"][1]["a"] = np.float64(3.25)
    values["closure"][0]["value"] = np.float64(2.5)
    made = rsicalib.Mechanism.from_dict(values).to_dict()
    assert (made["chain"][0]["dh"][1]["a"], made["closure"][0]["value"]) == (3.25, 2.5)


def test_it_is_pickled_and_copied() -> None:
    mechanism = rsicalib.Mechanism.rsi()
    assert pickle.loads(pickle.dumps(mechanism)) == mechanism
    assert copy.deepcopy(mechanism) == mechanism


@pytest.mark.parametrize(
    ("change", "place"),
    [
        (lambda m: m["chain"][1]["dh"][2].update(alpha="x"), r"chain\[1\]\.dh\[2\]\.alpha: "),
        (lambda m: m["chain"][1]["dh"][2].update(aplha=0.0), r"chain\[1\]\.dh\[2\].*`aplha`"),
        (lambda m: m.update(channel=3), "channel: "),
        (lambda m: m.pop("name"), "`name`"),
        (lambda m: m["channel"][0].update(gain=0.0), 'channel "a11": found gain 0'),
    ],
)
def test_an_entry_that_cannot_be_used_is_named(change: Any, place: str) -> None:
    values = rsicalib.Mechanism.rsi().to_dict()
    change(values)
    with pytest.raises(InputError, match=rf"^mechanism, .*{place}"):
        rsicalib.Mechanism.from_dict(values)


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
    assert load_mechanism(path).channels


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


@pytest.mark.parametrize("model", ['terms = ["offset", "gian@a11"]', "sd = {gian = 1.0}"])
def test_a_term_that_there_is_not_is_refused_with_the_file(tmp_path: Path, model: str) -> None:
    text = rsicalib.load_mechanism("rsi").to_toml().split("[model]")[0] + f"[model]\n{model}\n"
    (tmp_path / "mine.toml").write_text(text)
    with pytest.raises(InputError, match=r"mine\.toml: .*gian.*offset") as error:
        rsicalib.load_mechanism(tmp_path / "mine.toml")
    assert error.value.where is not None and str(error.value.where["file"]).endswith("mine.toml")


@pytest.mark.parametrize(
    ("text", "found"),
    [
        ("", "nothing to read"),
        (" ", "nothing to read"),
        ("elbow\nleft", "with a line break"),
        ("x" * 81, "81 characters"),
    ],
)
@pytest.mark.parametrize("key", ["label", "name"])
def test_what_people_read_of_a_channel_fits_on_a_line(key: str, text: str, found: str) -> None:
    values = rsicalib.Mechanism("rsi").to_dict()
    values["column"] = [{"name": "force", "unit": "N"}]
    holder = values["channel"][0] if key == "label" else values["column"][0]
    holder[key] = text
    if (key, text) == ("name", ""):
        found = "the name again, or none"
    with pytest.raises(InputError, match=found) as refused:
        rsicalib.Mechanism(values)
    assert len(str(refused.value)) < 300
    holder[key] = "x" * 80
    assert rsicalib.Mechanism(values)


def test_a_term_of_absurd_length_is_refused_and_not_echoed() -> None:
    law = {"id": "z" * 200_000, "class": "sensor", "per": "channel", "correction": "a*phi"}
    values = rsicalib.Mechanism("rsi").to_dict()
    values["term"] = [law | {"parameters": {"a": 0.01}, "doc": "A slope."}]
    with pytest.raises(InputError) as refused:
        rsicalib.Mechanism(values)
    assert len(str(refused.value)) < 300
    with pytest.raises(InputError) as unknown:
        rsicalib.calibrate(DEMO / "readings.csv", terms=["z" * 100_000])
    assert "did you mean" not in str(unknown.value) and len(str(unknown.value)) < 3000


# ------------------------------------------------------------------ arrays and names

ARRAYS = [
    ("point", "at", 3),
    ("closure", "between", 2),
    ("channel", "range", 2),
    (None, "gravity", 3),
]


@pytest.mark.parametrize(("table", "key", "length"), ARRAYS)
def test_an_array_with_more_entries_than_it_has_is_refused(
    table: str | None, key: str, length: int
) -> None:
    document = rsicalib.Mechanism.rsi().to_dict() | {"gravity": [0.0, 0.0, -1.0]}
    owner = document if table is None else document[table][0]
    rsicalib.Mechanism(document)
    owner[key] = [*owner[key], owner[key][0]]
    text = files.toml(document)
    for source in (document, text):
        with pytest.raises(
            InputError, match=f"{length + 1}, expected a list of {length}"
        ) as refused:
            rsicalib.Mechanism(source)
        assert key in str(refused.value) or "line" in str(refused.value)


@pytest.mark.parametrize("name", COLUMNS)
def test_a_channel_has_no_name_of_a_column_with_a_meaning(name: str, tmp_path: Path) -> None:
    text = rsicalib.Mechanism.rsi().to_toml().replace('"a22"', f'"{name}"')
    for source in (text, str(written(tmp_path, text)), tomllib.loads(text)):
        with pytest.raises(InputError) as refused:
            rsicalib.Mechanism(source)
        assert f"channel '{name}'" in str(refused.value)


def test_a_stage_may_have_an_axis_x() -> None:
    text = """
name = "stage"
length_unit = "mm"
channel = [
  {name = "x", unit = "mm", gain = 1.0, offset = 0.0},
  {name = "ruler", unit = "mm", gain = 1.0, offset = 0.0},
]
closure = [{name = "both", kind = "equal", between = ["x", "ruler"]}]
"""
    assert rsicalib.Mechanism(text).channels[0].name == "x"


def test_text_may_begin_with_the_mark_of_unicode() -> None:
    text = rsicalib.Mechanism.rsi().to_toml()
    assert rsicalib.Mechanism("\ufeff" + text) == rsicalib.Mechanism(text)


def test_the_line_of_text_that_is_no_toml_is_that_of_the_error(tmp_path: Path) -> None:
    (tmp_path / "bad.toml").write_text("# drawn\n" * 90 + "b = = 2\n")
    with pytest.raises(InputError) as refused:
        load_mechanism(tmp_path / "bad.toml")
    assert refused.value.where is not None and refused.value.where["line"] == 91
