"""Names that nobody has: the one that may have been meant is said, wherever a name is read."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest

import rsicalib
from rsicalib import DEMO, InputError, Mechanism, Term
from tests.test_examples import EXAMPLES

DRAWING = (EXAMPLES / "draw_wire.toml").read_text(encoding="utf-8")

WRONG = [
    ('"link_length"', '"link_lenght"', "link_length"),
    ('{channel = "q3"', '{channel = "qq3"', "q3"),
    ('between = ["eyelet"', 'between = ["eylet"', "eyelet"),
    ('chain = "arm"', 'chain = "amr"', "arm"),
    ('kind = "distance"', 'kind = "distanse"', "distance"),
    ("\nnoise = ", "\nnois = ", "noise"),
]


@pytest.mark.parametrize(("right", "wrong", "meant"), WRONG)
def test_in_a_mechanism_file(right: str, wrong: str, meant: str, tmp_path: Path) -> None:
    path = tmp_path / "arm.toml"
    assert right in DRAWING
    path.write_text(DRAWING.replace(right, wrong), encoding="utf-8")
    with pytest.raises(InputError, match=f'did you mean "{meant}"'):
        rsicalib.load_mechanism(path)


def with_law(**law: Any) -> Mechanism:
    """The built-in mechanism with a law of one parameter, `a`."""
    return Mechanism("rsi").with_terms([Term("mine", parameters={"a": 0.01}, **law)])


@pytest.mark.parametrize(
    ("correction", "meant"),
    [("a*sinn(phi)", "sin"), ("a*sin(3*ph)", "phi"), ("a*veloctiy", "velocity")],
)
def test_in_a_law(correction: str, meant: str) -> None:
    with pytest.raises(InputError, match=f'did you mean "{meant}"'):
        with_law(klass="sensor", per="channel", correction=correction)


@pytest.mark.parametrize(
    ("klass", "per", "meant"), [("sensors", "channel", "sensor"), ("sensor", "chanel", "channel")]
)
def test_of_a_law(klass: str, per: str, meant: str) -> None:
    with pytest.raises(InputError, match=f'did you mean "{meant}"'):
        with_law(klass=klass, per=per, correction="a*phi")


def test_a_parameter_that_a_law_does_not_declare_is_named() -> None:
    with pytest.raises(InputError, match='"b": no parameter, so a column of the readings'):
        with_law(klass="sensor", per="channel", correction="b*phi")


@pytest.mark.parametrize(
    ("term", "meant"), [("ofset", "offset"), ("offset@a1l", "a11"), ("curvatre@a22", "curvature")]
)
def test_in_terms(term: str, meant: str) -> None:
    with pytest.raises(InputError, match=f'did you mean "{meant}"'):
        rsicalib.calibrate(DEMO / "readings.csv", rest=DEMO / "rest.csv", terms=[term])


def test_of_an_argument() -> None:
    with pytest.raises(TypeError, match=r"calibrate\(\) .* 'rset' \(did you mean 'rest'\?\)"):
        rsicalib.calibrate(DEMO / "readings.csv", rset=DEMO / "rest.csv")  # type: ignore[call-arg]
