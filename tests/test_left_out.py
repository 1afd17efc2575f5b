"""Poses that are left out: what the others have from them stays as the session was taken."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pandas as pd
import pytest

import rsicalib
from rsicalib import InputError
from rsicalib.guide.advice import Adviser
from rsicalib.guide.log import Log, Sample
from tests import oracle
from tests.blind import effects as catalogue
from tests.blind import simulator
from tests.blind.simulator import Device

KINDS = {kind.term: kind for kind in catalogue.CATALOGUE}


def test_directions_of_the_other_poses_stay_where_poses_are_left_out() -> None:
    # The witness is the hand of the simulator, which went through all poses.
    rng = np.random.default_rng(38)
    device = Device.random(rng)
    effect = KINDS["hysteresis"].draw(rng, "a22")
    effect = type(effect)(**{**vars(effect), "size": 4.0})
    poses = simulator.hand_poses(rng, 48, device)
    made = simulator.session(device, rng, poses, 8, effects=(effect,))
    mechanism = rsicalib.load_mechanism("rsi")
    whole = rsicalib.Readings.from_arrays(mechanism, made["values"], pose=made["pose"])
    kept = whole.select(whole.pose % 4 != 1)
    found = rsicalib.calibrate(kept, mechanism, terms=["offset", "gain", "hysteresis@a22"])
    size = found["hysteresis", "a22"]
    wanted = 4.0 * abs(oracle.GAIN)
    assert size.sd is not None and abs(size.value - wanted) < 4.0 * size.sd < 0.5 * wanted
    # As if the others had never been taken, a quarter of the directions is that of another way.
    alone = rsicalib.Readings.from_arrays(mechanism, kept.values, pose=kept.pose)
    assert np.array_equal(alone.values, kept.values) and len(kept.taken) == len(whole)
    wrong = rsicalib.calibrate(alone, mechanism, terms=["offset", "gain", "hysteresis@a22"])
    assert found.fit.chi2 is not None and wrong.fit.chi2 is not None
    assert found.fit.chi2 < wrong.fit.chi2 - 50.0


def test_a_pose_that_is_left_out_shows_how_far_it_is_off() -> None:
    """Calibrated or traced: it looked perfect in the picture of a calibration."""
    whole = rsicalib.load_readings(rsicalib.DEMO / "readings.csv")
    bad = int(whole.pose[len(whole.pose) // 2])
    values = whole.values.copy()
    values[np.ix_(whole.pose == bad, [1, 4, 7])] += [200.0, 150.0, -180.0]
    readings = replace(whole, values=values)
    for found in (rsicalib.calibrate(readings), rsicalib.trace(readings)):
        assert bad in [entry.pose for entry in found.excluded]
        own = found.after_residuals
        assert own is not None
        at = list(dict.fromkeys(whole.pose.tolist())).index(bad)
        others = np.delete(own, at, axis=0)
        assert np.abs(own[at]).max() > 3 * np.abs(others).max()
    # Where a pose is used, its residual is that of all its samples.
    found = rsicalib.calibrate(whole)
    assert found.after_residuals is not None and found.fit.chi2 is not None
    assert np.sum(found.after_residuals**2) == pytest.approx(found.fit.chi2, rel=1e-6)


def test_rows_of_rows_are_rows_of_the_session() -> None:
    whole = rsicalib.load_readings(rsicalib.DEMO / "readings.csv", rsicalib.load_mechanism("rsi"))
    some = whole.select(whole.pose > 3)
    fewer = some.select(some.pose % 2 == 0)
    assert fewer.taken is whole
    np.testing.assert_array_equal(whole.values[fewer.own], fewer.values)


@pytest.mark.parametrize("kind", ["csv", "parquet"])
def test_a_file_says_which_of_its_rows_are_used(kind: str, tmp_path: Path) -> None:
    mechanism = rsicalib.load_mechanism("rsi")
    whole = rsicalib.load_readings(rsicalib.DEMO / "readings.csv", mechanism)
    kept = whole.select(whole.pose % 4 != 1)
    kept.to_csv(tmp_path / "session.csv", whole=True)
    path = tmp_path / f"session.{kind}"
    if kind == "parquet":
        pd.read_csv(tmp_path / "session.csv").to_parquet(path)
    again = rsicalib.load_readings(path, mechanism)
    np.testing.assert_array_equal(again.values, kept.values)
    np.testing.assert_array_equal(again.own, kept.own)
    np.testing.assert_array_equal(again.taken.values, whole.values)
    terms = ["offset", "gain", "hysteresis@a22"]
    found, wanted = (rsicalib.calibrate(one, mechanism, terms=terms) for one in (again, kept))
    assert [p.value for p in found.parameters] == [p.value for p in wanted.parameters]


def test_a_fleet_uses_the_same_rows_as_one_device() -> None:
    whole = rsicalib.load_readings(rsicalib.DEMO / "readings.csv", rsicalib.load_mechanism("rsi"))
    kept = whole.select(whole.pose % 4 != 1)
    frame = pd.read_csv(rsicalib.DEMO / "readings.csv").assign(device="one")
    frame["used"] = (frame["pose"] % 4 != 1).astype(int)
    alone = rsicalib.calibrate(kept)
    row = rsicalib.calibrate_devices(frame, trace=False).iloc[0]
    assert row["poses"] == 36 and row["samples"] == len(kept)
    assert row["gain@a22"] == alone["gain", "a22"].value
    assert row["chi2"] == alone.fit.chi2
    none = rsicalib.calibrate_devices(frame.assign(used=0), trace=False).iloc[0]
    assert none["verdict"] is None and "used" in none["message"]


@pytest.mark.parametrize(("cell", "expected"), [("2", "0 or 1"), ("", "0 or 1"), ("0", "a 1")])
def test_a_row_is_used_or_not(cell: str, expected: str, tmp_path: Path) -> None:
    lines = (rsicalib.DEMO / "readings.csv").read_text(encoding="utf-8").splitlines()
    path = tmp_path / "readings.csv"
    rows = [f"{line},{cell}" for line in lines[1:]]
    path.write_text("\n".join([f"{lines[0]},used", *rows]), encoding="utf-8")
    with pytest.raises(InputError) as refused:
        rsicalib.load_readings(path, rsicalib.load_mechanism("rsi"))
    assert refused.value.where is not None and refused.value.where["column"] == "used"
    assert refused.value.where["expected"] == expected


def test_a_guided_session_has_every_place_where_the_hand_was(tmp_path: Path) -> None:
    def still(moment: float, reading: float) -> list[Sample]:
        return [Sample(moment + 0.1 * k, None, (reading,) * 9) for k in range(4)]

    names = oracle.channel_names(oracle.rsi())
    log = Log(tmp_path / "session", names, resume=False, fitted=2)
    log.take(still(0.0, 1000.0))
    log.pose(1, still(0.0, 1000.0))
    log.pose(2, still(10.0, 2000.0))
    log.pose(3, still(20.0, 1500.0))
    log.passes(still(30.0, 900.0))
    log.pose(4, still(40.0, 1200.0))
    log.withdraw(2)
    log.close()
    resumed = Log(tmp_path / "session", names, resume=True, fitted=2)
    for one in (log, resumed):
        taken = one.taken()
        assert sorted(taken.fitted) == [1, 4] and sorted(taken.kept_out) == [3]
        went = [sample.values[0] for _, sample in taken.rows()][::4]
        assert went == [1000.0, 2000.0, 1500.0, 900.0, 1200.0]
    resumed.close()
    readings = Adviser(rsicalib.load_mechanism("rsi"), None).readings(log.taken())
    assert sorted(set(readings.pose.tolist())) == [1, 4]
    assert len(readings.taken) == 20
