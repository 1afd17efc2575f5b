"""Damaged files through the Python API: a refusal with a place, or a value that the file held.

Readings as CSV have a test of their own in `test_data.py`. `RSICALIB_FUZZ_CASES` sets how many
files each test tries; where it is not given 300, and 1000 in full:

    RSICALIB_FUZZ_CASES=100000 pytest tests/test_fuzz.py
"""

from __future__ import annotations

import json
import os
from pathlib import Path
from typing import Any

import pytest
from hypothesis import HealthCheck, example, given, settings
from hypothesis import strategies as st

import rsicalib
from rsicalib import InputError, Mechanism
from rsicalib.io.urdf import chain_from_urdf
from tests.full import sized

CASES = int(os.environ.get("RSICALIB_FUZZ_CASES", sized(200, 1000)))
EXAMPLES = Path(__file__).parents[1] / "examples"

many = settings(
    max_examples=CASES,
    deadline=None,
    suppress_health_check=list(HealthCheck),
    derandomize="RSICALIB_FUZZ_CASES" not in os.environ,
    database=None,
)

PIECES = [
    "",
    "0",
    "-1",
    "1e308",
    "1e999",
    "nan",
    "inf",
    "null",
    "true",
    '""',
    "[]",
    "{}",
    "[" * 2000,
] + ["\n", "\0", "é", "\u202e", "9223372036854775808", "<a>", "</robot>", "&x;", "=", '"']


@st.composite
def damaged(draw: st.DrawFn, text: str) -> str:
    """A text with up to four stretches replaced, removed or doubled."""
    for _ in range(draw(st.integers(1, 4))):
        start = draw(st.integers(0, len(text)))
        end = min(len(text), start + draw(st.integers(0, 40)))
        piece = draw(st.sampled_from([*PIECES, text[start:end] * 2]))
        text = text[:start] + piece + text[end:]
    return text


RSI = rsicalib.load_mechanism("rsi").to_toml()
ARMS = (EXAMPLES / "two_arms.toml").read_text(encoding="utf-8")


@pytest.fixture(scope="module")
def scratch(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return tmp_path_factory.mktemp("fuzz")


@many
@given(text=st.one_of(damaged(RSI), damaged(ARMS)))
@example(text="a = " + "[" * 100_000)
@example(text="a = " + "{a = " * 5000)
def test_a_mechanism_is_refused_with_its_file_or_written_as_it_is_read(
    scratch: Path, text: str
) -> None:
    path = scratch / "mechanism.toml"
    path.write_bytes(text.encode("utf-8", "surrogatepass"))
    try:
        mechanism = rsicalib.load_mechanism(path)
    except InputError as error:
        assert str(path) in str(error)
        return
    assert Mechanism.from_toml(mechanism.to_toml()).to_dict() == mechanism.to_dict()


URDF = """<?xml version="1.0"?>
<robot name="arm">
  <link name="base"/><link name="upper"/><link name="tip"/>
  <joint name="shoulder" type="revolute">
    <parent link="base"/><child link="upper"/>
    <origin xyz="0 0 0.3" rpy="0 0.1 0"/><axis xyz="0 0 1"/>
    <limit lower="-1" upper="1" effort="1" velocity="1"/>
  </joint>
  <joint name="wrist" type="continuous">
    <parent link="upper"/><child link="tip"/>
    <origin xyz="0.4 0 0" rpy="1.5707963 0 0"/><axis xyz="0 1 0"/>
  </joint>
</robot>
"""


@many
@given(text=damaged(URDF))
def test_a_robot_description_is_refused_with_its_file_or_has_finite_rows(
    scratch: Path, text: str
) -> None:
    path = scratch / "arm.urdf"
    path.write_bytes(text.encode("utf-8", "surrogatepass"))
    try:
        chain = chain_from_urdf(path, "base", "tip", {"shoulder": "q1", "wrist": "q2"})
    except InputError as error:
        assert str(path) in str(error)
        return
    assert len(chain.rows) >= 2
    json.dumps(chain.rows, allow_nan=False)


@pytest.fixture(scope="module")
def result() -> str:
    made = rsicalib.simulate(poses=12, samples=2, seed=3)
    return rsicalib.calibrate(made.readings, rest=made.rest).to_json()


def numbers(value: Any) -> set[float]:
    if isinstance(value, dict):
        return set().union(*map(numbers, value.values()))
    if isinstance(value, list):
        return set().union(*map(numbers, value))
    return {float(value)} if isinstance(value, int | float) else set()


@many
@given(data=st.data())
def test_a_result_is_refused_with_its_place_or_holds_what_its_file_held(
    scratch: Path, result: str, data: st.DataObject
) -> None:
    text = data.draw(damaged(result))
    path = scratch / "result.json"
    path.write_bytes(text.encode("utf-8", "surrogatepass"))
    try:
        read = rsicalib.load_calibration(path)
    except InputError as error:
        assert str(path) in str(error)
        return
    again = json.loads(read.to_json())
    assert numbers(again) <= numbers(json.loads(text)) | {0.0, 1.0}
    assert read.summary()
