"""Readings of real machines: what the library finds is what quick fits in plain numpy find.

Both weigh nearly alike: they agree to a part of their standard deviations.
"""

from __future__ import annotations

from pathlib import Path

import pytest

import rsicalib
from tests.machines import quick
from tests.machines.real import mechanism_of

DATA = Path(__file__).parents[2] / "shared" / "data"

pytestmark = pytest.mark.skipif(
    not (DATA / "maslow").is_dir(), reason="readings of real machines are not beside this one"
)


def found(file: Path, terms: list[str], term: str, target: str) -> tuple[float, float]:
    """A parameter of a calibration that is told its terms, and its standard deviation."""
    result = rsicalib.calibrate(file, mechanism_of(file), terms=terms)
    one = result[term, target]
    assert one.value is not None and one.sd is not None
    return one.value, one.sd


@pytest.mark.parametrize("name", ["unknown_m", "frame_b"])
def test_what_all_belts_lack_is_one_constant_with_its_interval(name: str) -> None:
    """155 ± 2 mm (one standard deviation) where makers found it, 3 ± 2 mm where nothing was."""
    file = DATA / "maslow" / f"{name}.csv"
    plain = quick.belts(file, lower_gain=True, common=True)
    value, sd = found(file, ["offset@each", "gain@bl+br"], "offset", "each")
    assert value == pytest.approx(plain.value[6], abs=1.0 * sd)
    assert 0.7 < sd / plain.sd[6] < 1.4
    assert (value > 70 * sd) == (name == "unknown_m")


def test_the_towers_of_a_delta_printer_stand_further_out() -> None:
    file = DATA / "delta" / "probes.csv"
    plain = quick.delta(DATA / "delta", quick.ENDSTOPS + quick.RADIUS)
    value, sd = found(file, ["offset", "link_length@each/1"], "link_length", "each/1")
    assert value == pytest.approx(plain.value[3], abs=0.5 * sd)
    assert 0.7 < sd / plain.sd[3] < 1.4


def test_the_zero_of_joint_3_of_a_da_vinci_arm() -> None:
    name = "PSM1_2019-07-26_11-48-56"
    plain = quick.da_vinci(DATA / "dvrk_plane", name)
    file = DATA / "dvrk_plane" / f"{name}.csv"
    value, sd = found(file, ["offset@q3"], "offset", "q3")
    assert value == pytest.approx(plain.value[3], abs=0.5 * sd)
    assert 0.7 < sd / plain.sd[3] < 1.4
