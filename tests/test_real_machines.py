"""Readings of real machines: what the library finds is what quick fits in plain numpy find.

Both weigh nearly alike: they agree to a part of their standard deviations.
"""

from __future__ import annotations

from pathlib import Path

import pytest

import rsicalib
from tests.full import sized
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


TRACED = {
    # constant of all belts by plain least squares [mm], or none; gain of the lower belts [per mil]
    "unknown_m": (154.6, 3.8),
    "frame_a": (None, 3.4),
    "frame_b": (None, 3.8),
    "show": (None, 6.4),
    "ten_02": (None, 5.1),
}


@pytest.mark.parametrize("name", sized(["unknown_m", "show"], TRACED))
def test_a_blind_trace_names_short_belts_and_a_constant_only_where_makers_found_it(
    name: str,
) -> None:
    constant, short = TRACED[name]
    file = DATA / "maslow" / f"{name}.csv"
    answer = rsicalib.trace(file, mechanism_of(file)).to_dict()
    assert answer["verdict"] == "explained"
    steps = {f"{s['term']}@{s['target']}": s["parameters"][0] for s in answer["steps"]}
    # Upper belts that read too long are lower ones too short: lengths alone tell no scale.
    pair = steps.pop("gain@tl+tr", None) or steps.pop("gain@bl+br")
    assert 1e3 * abs(pair["value"]) == pytest.approx(short, abs=2e3 * pair["sd"])
    assert list(steps) == ([] if constant is None else ["offset@each"])
    if constant is not None:
        common = steps["offset@each"]
        assert common["value"] == pytest.approx(constant, abs=common["sd"])


@pytest.mark.parametrize("name", ["leica", "no_leica"])
def test_the_bend_of_a_table_stands_in_the_tie_of_a_curve_and_nothing_is_made_worse(
    name: str,
) -> None:
    """A tracker saw the table bent; at its points the arm as drawn is off by .47 mm."""
    folder = DATA / "motoman_planes"
    seen, file = (folder / f"{n}_lower_table1_5x5.csv" for n in ("leica", name))
    answer = rsicalib.trace(file, mechanism_of(file), check=seen, align=True).to_dict()
    said = {s["term"] for s in answer["steps"]}
    said |= {t["term"] for s in answer["steps"] for t in s["also_fits"]}
    assert "plane_bend" in said
    errors = [answer[fit]["aligned"]["position_rms"] for fit in ("nominal", "after")]
    assert errors[0] == pytest.approx(4.73e-4, abs=1e-5) and errors[1] < 1.1 * errors[0]
