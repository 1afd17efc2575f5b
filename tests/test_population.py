"""What devices of one design share."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from scipy import optimize, stats

import rsicalib
from rsicalib import InputError, _core
from rsicalib.fleets.dataset import Partition
from rsicalib.fleets.page import page
from rsicalib.fleets.population import ShareJob, first_line, joint
from scripts import make_formats
from tests.full import sized
from tests.oracle import Array
from tests.population.__main__ import mechanism
from tests.population.production import MIDDLE, TOLERANCES, Production, frame, readings

pa = pytest.importorskip("pyarrow")
parquet = pytest.importorskip("pyarrow.parquet")

TOLERANCE = np.array([0.5, 0.5, 2.0, 2.0])
"""Of four parameters of two terms."""
PARAMETERS = [("p", "a", "p", "rad"), ("p", "b", "p", "rad"), ("q", "a", "q", "in")]
PARAMETERS += [("q", "b", "q", "in")]
CANDIDATES = [(t, target, name, [k]) for k, (t, target, name, _) in enumerate(PARAMETERS)]
CANDIDATES += [("p", None, "p", [0, 1]), ("q", None, "q", [2, 3])]


def share(information: Array, told: Array) -> dict[str, Any]:
    """What a device tells, as the core takes it."""
    own = {"parameters": PARAMETERS, "candidates": CANDIDATES}
    return {"information": information, "told": told, **own}


def linear_fleet(
    rng: np.random.Generator, devices: int, shift: Array, between: Array
) -> tuple[list[Array], list[Array]]:
    """`X` and `y` of devices with linear readings of unit noise, ten each."""
    columns, values = [], []
    for _ in range(devices):
        x = rng.standard_normal((10, 4)) @ np.diag([3.0, 3.0, 1.0, 1.0])
        x[:, 1] += 0.8 * x[:, 0]
        beta = shift + between * rng.standard_normal(4)
        columns.append(x)
        values.append(x @ beta + rng.standard_normal(10))
    return columns, values


def solved(columns: list[Array], values: list[Array]) -> tuple[dict[str, Any], list[Any]]:
    """The core's answer."""
    shares = [share(x.T @ x, x.T @ y) for x, y in zip(columns, values, strict=True)]
    found, with_others, _, _ = _core.population(shares, TOLERANCE.tolist())
    return found, with_others


def test_the_joint_estimate_is_that_of_one_large_regression() -> None:
    rng = np.random.default_rng(1)
    columns, values = linear_fleet(rng, 12, np.array([0.3, 0.0, -1.0, 0.0]), np.full(4, 0.3))
    found, with_others = solved(columns, values)
    shift = np.array([p["shift"] for p in found["parameters"]])
    sd = np.array([p["sd"] for p in found["parameters"]])
    between = np.array([p["between"] for p in found["parameters"]])

    # Witness: all parameters of all devices and the shift in one least-squares problem, with a row
    # for each reading, each deviation from the shift, and each tolerance.
    n = 4 * len(columns) + 4
    rows, right = [], []
    for d, (x, y) in enumerate(zip(columns, values, strict=True)):
        block = np.zeros((10, n))
        block[:, 4 + 4 * d : 8 + 4 * d] = x
        rows.append(block)
        right.append(y)
        apart = np.zeros((4, n))
        apart[:, 4 + 4 * d : 8 + 4 * d] = np.diag(1.0 / between)
        apart[:, :4] = -np.diag(1.0 / between)
        rows.append(apart)
        right.append(np.zeros(4))
    drawn = np.zeros((4, n))
    drawn[:, :4] = np.diag(1.0 / TOLERANCE)
    a, b = np.vstack([*rows, drawn]), np.concatenate([*right, np.zeros(4)])
    covariance = np.linalg.inv(a.T @ a)
    x = covariance @ (a.T @ b)
    deviation = np.sqrt(np.diag(covariance))
    np.testing.assert_allclose(shift, x[:4], rtol=1e-8)
    np.testing.assert_allclose(sd, deviation[:4], rtol=1e-8)
    own = np.array(with_others)
    np.testing.assert_allclose(own[:, :, 0].ravel(), x[4:], rtol=1e-7, atol=1e-9)
    np.testing.assert_allclose(own[:, :, 1].ravel(), deviation[4:], rtol=1e-7)


def test_the_spread_between_devices_has_the_largest_restricted_likelihood() -> None:
    rng = np.random.default_rng(2)
    columns, values = linear_fleet(rng, 8, np.zeros(4), np.array([0.3, 0.3, 1.0, 1.0]))
    found, _ = solved(columns, values)
    between = [found["parameters"][k]["between"] for k in (0, 2)]

    def cost(ln: Array) -> float:
        # Witness: the density of the readings, shift integrated with its tolerance.
        t = np.exp(2 * np.repeat(ln, 2))
        y = np.concatenate(values)
        x = np.vstack(columns)
        v = np.eye(len(y)) + x @ np.diag(TOLERANCE**2) @ x.T
        for d, own in enumerate(columns):
            at = slice(10 * d, 10 * d + 10)
            v[at, at] += own @ np.diag(t) @ own.T
        return float(np.linalg.slogdet(v)[1] + y @ np.linalg.solve(v, y))

    best = optimize.minimize(cost, np.log([0.3, 1.0]), method="Nelder-Mead", tol=1e-8)
    # Steps end where `ln τ²` moves by 1e-6, those of the witness by 1e-8.
    np.testing.assert_allclose(between, np.exp(best.x), rtol=1e-3)


FINE = 256
"""Of a converter of 20 bits: so many counts where that of the hand controller has one."""


def fine_fleet(devices: int) -> tuple[rsicalib.Mechanism, Partition, Array]:
    """Hand controllers with fine converters, whose lengths are those of the drawing; their offsets.

    Offsets are meant at the middle of the range, from the drawing: (devices, 9).
    """
    own = rsicalib.load_mechanism("rsi").to_dict()
    for channel in own["channel"]:
        channel["range"] = [0.0, 4096.0 * FINE - 1]
        channel["gain"] /= FINE
    sd = {"offset": 0.05, "gain": 3e-5 / FINE, "link_length": 0.02}
    own["model"] = {"terms": ["offset", "gain"], "sd": sd}
    mechanism = rsicalib.Mechanism.from_dict(own)
    made = [
        rsicalib.simulate(mechanism=mechanism, poses=16, samples=4, noise=1.0, seed=100 + k)
        for k in range(devices)
    ]
    channels = mechanism.channels
    middle = (4096.0 * FINE - 1) / 2
    drawn = np.array([c.offset + c.gain * middle for c in channels])
    offsets = np.array([s.device.offsets + s.device.gains * middle - drawn for s in made])
    rows: dict[str, Any] = {c.name: [] for c in channels}
    for session in made:
        for k, c in enumerate(channels):
            rows[c.name].append(session.readings.values[:, k])
    columns = {name: np.ascontiguousarray(np.concatenate(own)) for name, own in rows.items()}
    columns["device"] = np.repeat(np.arange(devices), 64)
    columns["pose"] = np.concatenate([session.readings.pose for session in made])
    return mechanism, Partition(columns, None), offsets


def test_devices_that_differ_by_less_than_their_tolerances_are_said_to() -> None:
    mechanism, partition, offsets = fine_fleet(24)
    sd = {"offset": 0.05, "gain": 3e-5 / FINE, "link_length": 0.02}
    found, _ = joint(mechanism, "device", sd, {}, lambda job: [(partition, job(partition))])
    assert found["devices"] == 24
    by_term = {p["term"]: p for p in found["parameters"]}
    # The witness is what was drawn: its deviation is a quarter of a hundredth of the tolerance.
    drawn = float(np.sqrt(offsets.var(axis=0, ddof=1).mean()))
    assert drawn < sd["offset"] / 300
    offset = by_term["offset"]
    assert offset["between"] == pytest.approx(drawn, rel=0.1)
    low, high = offset["between_interval"]
    assert low < drawn < high < sd["offset"] / 100
    # Lengths are those of the drawing in every device.
    length = by_term["link_length"]
    low, high = length["between_interval"]
    assert low == 0.0 and length["between"] < high < sd["link_length"] / 100
    # What is expected of the next device is no less than a hundredth of the tolerance.
    assert (offset["spread"], length["spread"]) == pytest.approx((0.0005, 0.0002))


def test_one_batch_of_all_devices_changes_nothing() -> None:
    rng = np.random.default_rng(8)
    shares = []
    for _ in range(12):
        x = 1e4 * rng.standard_normal((10, 4))
        beta = np.array([1e-3, 1e-3, 0.0, 0.0]) * rng.standard_normal(4)
        shares.append(share(x.T @ x, x.T @ (x @ beta + rng.standard_normal(10))))
    alone, _, _, none = _core.population(shares, TOLERANCE.tolist())
    batch, _, of, level = _core.population(shares, TOLERANCE.tolist(), [[0] * 12])
    assert (none, level) == (None, None) and of == list(range(12))
    for one, other in zip(alone["parameters"], batch["parameters"], strict=True):
        assert "levels" not in one and len(other.pop("levels")) == 2
        assert one == other
    p, q = alone["parameters"][0], alone["parameters"][2]
    low, high = p["between_interval"]
    assert low < 1e-3 < high < TOLERANCE[0] / 100 and q["between_interval"][0] == 0.0
    assert (p["spread"], q["spread"]) == pytest.approx((0.005, 0.02))


@pytest.mark.parametrize("precision", [1e3, 1e9, 1e13])
def test_what_a_fleet_tells_well_does_not_drown_what_it_does_not_tell(precision: float) -> None:
    # Devices tell the sum of two parameters, and nothing of their difference.
    sums = np.array([0.31, -0.12, 0.54, 0.08, -0.27, 0.33])
    tolerance = 0.5
    shares = [
        {
            "information": np.full((2, 2), precision),
            "told": np.full(2, precision * x),
            "parameters": PARAMETERS[:2],
            "candidates": CANDIDATES[:2],
        }
        for x in sums
    ]
    found, with_others, _, _ = _core.population(shares, [tolerance] * 2)
    one, other = found["parameters"]
    between = one["between"]
    # Witness: of the sum and the difference each by itself, where nothing cancels. A sum differs by
    # 2 τ², is known to 1/H, and is drawn within 2 tol².
    error = 2 * between**2 + 1 / precision
    variance = 1 / (len(sums) / error + 1 / (2 * tolerance**2))
    mean = variance * sums.sum() / error
    sd = np.sqrt((variance + 2 * tolerance**2) / 4)
    # Beside the 1 of the difference, what is told of the sum is rounded by some 1e-16 of itself.
    rtol = 1e-9 + 1e-15 * precision
    np.testing.assert_allclose([one["shift"], other["shift"]], mean / 2, rtol=rtol)
    np.testing.assert_allclose([one["sd"], other["sd"]], sd, rtol=rtol)
    # A device beside the others: its sum, and of the difference what the drawing says.
    part = 2 * between**2 / error
    own = mean + part * (sums - mean)
    own_variance = part / precision + (1 - part) ** 2 * variance
    own_sd = np.sqrt((own_variance + 2 * between**2 + 2 * tolerance**2) / 4)
    told = np.array(with_others)
    np.testing.assert_allclose(told[:, :, 0], np.stack([own, own], axis=1) / 2, rtol=rtol)
    np.testing.assert_allclose(told[:, :, 1], own_sd, rtol=rtol)


def test_fleets_without_an_error_of_the_drawing_name_none_and_bounds_hold() -> None:
    rng = np.random.default_rng(3)
    false, inside, z2 = 0, 0, 0.0
    fleets = 150
    for _ in range(fleets):
        columns, values = linear_fleet(rng, 25, np.zeros(4), np.array([0.3, 0.3, 0.5, 0.5]))
        found, _ = solved(columns, values)
        false += bool(found["design"])
        for p in found["parameters"]:
            inside += abs(p["shift"]) < 1.96 * p["sd"]
            z2 += (p["shift"] / p["sd"]) ** 2
    # 1.5 are expected, more than 6 come in one run of 700; 95 % of 600 ± 5.3.
    assert false <= 6
    assert abs(inside - 570) < 4 * 5.3
    assert z2 / (4 * fleets) == pytest.approx(1.0, abs=4 * np.sqrt(2 / (4 * fleets)))


def test_an_error_of_the_drawing_is_named_with_its_size() -> None:
    rng = np.random.default_rng(4)
    columns, values = linear_fleet(rng, 40, np.array([0.0, 0.0, 0.6, 0.6]), np.full(4, 0.2))
    found, _ = solved(columns, values)
    (one,) = found["design"]
    assert (one["term"], one["target"]) == ("q", "all")
    assert abs(one["value"] - 0.6) < 3 * one["sd"] < 0.3


def test_a_device_unlike_the_others_is_left_out_and_keeps_its_own() -> None:
    rng = np.random.default_rng(5)
    columns, values = linear_fleet(rng, 20, np.zeros(4), np.full(4, 0.1))
    values[7] += columns[7] @ np.array([4.0, 0.0, 0.0, 0.0])
    found, with_others = solved(columns, values)
    assert found["outliers"] == [7] and found["devices"] == 19
    assert with_others[7] == [] and all(len(one) == 4 for one in with_others[:7])


def test_information_is_of_the_readings_however_tightly_something_is_expected() -> None:
    partition, _ = frame(Production(), sized(2, 6), 17)
    for part in (1.0, 0.1, 0.01):
        parameters = [(term, None, None, 0.0, part * sd) for term, sd in TOLERANCES.items()]
        expected = {"centre": [MIDDLE] * 9, "parameters": parameters}
        job = ShareJob(mechanism(), "device", expected, list(TOLERANCES))
        for share in job(partition)["share"]:
            size = np.array([TOLERANCES[p[0]] for p in share["parameters"]])
            values = np.linalg.eigvalsh(share["information"] * np.outer(size, size))
            assert values[0] > -1e-9 * values[-1]


def shifts(off: Array, sd: Array) -> list[dict[str, Any]]:
    """Common shift of each parameter, of which `off` and `sd` have a row."""
    found = _core.common_shifts(np.stack([off, sd], axis=-1))
    assert len(found) == len(off)
    return [one for one in found if one is not None]


def test_common_shifts_have_bounds_that_hold() -> None:
    rng = np.random.default_rng(6)
    sd = rng.uniform(0.5, 2.0, (2000, 12))
    # Stated deviations are half of the true ones: what a spread of devices shows.
    off = 0.7 + np.hypot(2 * sd, 1.0) * rng.standard_normal(sd.shape)
    inside = sum(abs(one["value"] - 0.7) < one["half"] for one in shifts(off, sd))
    assert abs(inside / 2000 - 0.95) < 4 * 0.005
    sd = rng.uniform(0.5, 2.0, (2000, 12))
    false = sum(one["p_value"] < 0.05 for one in shifts(sd * rng.standard_normal(sd.shape), sd))
    # Without a spread between devices the bound is as wide or wider.
    assert false / 2000 < 0.05 + 4 * 0.005
    assert _core.common_shifts(np.array([[(1.0, 1.0), (2.0, 1.0)]])) == [None]


@pytest.mark.parametrize("between", [0.0, 0.3, 3.0])
def test_the_spread_between_devices_has_an_interval_that_holds(between: float) -> None:
    rng = np.random.default_rng(9)
    inside = 0
    sd = rng.uniform(0.5, 2.0, (2000, 10))
    for one in shifts(np.hypot(sd, between) * rng.standard_normal(sd.shape), sd):
        # None where they differ by less than their errors make them.
        low, high = one["between_interval"] or (0.0, 0.0)
        assert low <= one["between"] <= high
        inside += low <= between <= high
    # Where nothing is between the lower end is zero: only the upper end may be wrong.
    expected = 0.975 if between == 0.0 else 0.95
    assert abs(inside / 2000 - expected) < 4 * 0.005


def test_devices_known_far_better_than_they_differ_have_the_usual_interval() -> None:
    off = np.random.default_rng(4).standard_normal(10)
    (one,) = shifts(off[None], np.full((1, 10), 1e-9))
    squares = float(np.var(off, ddof=1)) * 9
    ends = [np.sqrt(squares / stats.chi2.isf(p, 9)) for p in (0.025, 0.975)]
    assert one["between_interval"] == pytest.approx(ends, rel=1e-9)
    assert one["between"] == pytest.approx(np.std(off, ddof=1), rel=1e-9)


def test_unknown_things_have_a_spread_and_no_shift() -> None:
    rng = np.random.default_rng(2)
    own = rsicalib.load_mechanism("rsi")
    rows = {"chi2": [50.0] * 12, "dof": [50.0] * 12, "p_value": [0.5] * 12}
    at = {"offset@a11": own.channels[0].offset, "unknown_point@anchor.x": 3000.0, "bend@arm1": 0.0}
    for name, drawn in at.items():
        spread = 0.0 if name == "bend@arm1" else 3.0
        rows[name] = (drawn + 5.0 + spread * rng.standard_normal(12)).tolist()
        rows[f"{name}_sd"] = [0.1] * 12
    found = {one["parameter"]: one for one in first_line(rows, own)["shifts"]}
    assert found["offset@a11"]["common"] and found["offset@a11"]["value"] == pytest.approx(5, abs=3)
    anchor = found["unknown_point@anchor.x"]
    assert anchor["p_value"] is None and not anchor["common"]
    squares = 11 * float(np.var(rows["unknown_point@anchor.x"], ddof=1))
    ends = [np.sqrt(squares / stats.chi2.isf(p, 11)) for p in (0.025, 0.975)]
    assert anchor["between_interval"] == pytest.approx(ends, rel=0.01)  # errors are a thirtieth
    # These are alike to the bit, which their errors of 0.1 do not allow.
    assert found["bend@arm1"]["between_interval"] is None
    rows |= {"device": list(range(12)), "verdict": ["adequate"] * 12, "steps": ["[]"] * 12}
    rows["message"] = [""] * 12
    html = page(rows, "device", own, [], [], shifts=list(found.values()))
    assert "How much devices differ" in html and "less than their errors" in html


def test_the_sum_of_the_fits_needs_more_than_one_per_cent_of_noise() -> None:
    rng = np.random.default_rng(7)

    def fleet(factor: float) -> dict[str, Any]:
        # F of 60 and 300 degrees of freedom: noise that each device estimates itself.
        f = factor * rng.f(60, 300, 2000)
        fits = [60 * f, np.full(len(f), 60.0), stats.f.sf(f, 60, 300)]
        found = _core.summed(np.column_stack(fits))
        assert found is not None
        return found

    sound = [fleet(1.0) for _ in range(20)]
    assert all(one["p_value"] > 0.01 for one in sound)
    assert all(fleet(1.02)["p_value"] > 1e-3 for _ in range(20))
    assert fleet(1.08)["p_value"] < 1e-6
    assert sound[0]["devices"] == 2000 and sound[0]["dof"] == 120_000
    assert _core.summed(np.array([(1.0, 1.0, 0.5)])) is None


def drawn() -> rsicalib.Mechanism:
    """The hand controller with a tolerance of its lengths that the forearms below keep."""
    own = mechanism().to_dict()
    own["model"]["sd"]["link_length"] = 0.05
    return rsicalib.Mechanism.from_dict(own)


@pytest.fixture(scope="module")
def fleet(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, rsicalib.Fleet]:
    """A fleet whose forearms are all too long."""
    place = tmp_path_factory.mktemp("fleet")
    partition, _ = frame(Production(length=0.0005, design={"length@4": 0.04}), 12, 1, poses=16)
    parquet.write_table(pa.table(dict(partition.frame)), place / "readings.parquet")
    (place / "rsi.toml").write_text(drawn().to_toml(), encoding="utf-8")
    out = place / "out"
    found = rsicalib.fleet(
        place / "readings.parquet", place / "rsi.toml", out=out, trace=False, population=True
    )
    return out, found


def test_the_forearm_of_a_fleet_is_named_on_page_and_in_json(
    fleet: tuple[Path, rsicalib.Fleet],
) -> None:
    out, found = fleet
    saved = json.loads((out / "population.json").read_text())
    assert saved["format"] == "rsicalib.population/1" and saved["devices"] == 12
    (one,) = saved["design"]
    assert one["term"] == "link_length" and one["target"] == "each/4"
    assert abs(one["value"] - 0.04) < 4 * one["sd"] < 0.04
    page = (out / "fleet.html").read_text()
    assert "The drawing is wrong: link_length of each/4" in page
    assert found.to_dict()["summed"]["devices"] == 12
    assert found.to_dict()["population"]["design"] == saved["design"]
    assert set(saved) == set(make_formats.documented("rsicalib.population/1"))
    assert set(found.to_dict()) == set(make_formats.documented("rsicalib.fleet/1"))
    rows = parquet.read_table(out / "population.parquet").to_pydict()
    assert len(rows["device"]) == 12 and len(rows) == 1 + 2 * 30


def test_a_population_is_a_prior_of_the_next_device(
    fleet: tuple[Path, rsicalib.Fleet],
) -> None:
    out, _ = fleet
    rng = np.random.default_rng(9)
    production = Production(length=0.0005, design={"length@4": 0.04})
    few = readings(production.device(rng), rng, 6, 4).reshape(-1, 9)
    session = rsicalib.Readings.from_arrays(drawn(), few, pose=np.repeat(np.arange(6), 4))
    own = rsicalib.calibrate(session, drawn())
    prior = rsicalib.calibrate(session, drawn(), population=out / "population.json")
    sd = {p.spec: p.sd for p in own.parameters}
    with_prior = {p.spec: p for p in prior.parameters}
    assert with_prior["link_length@arm1/4"].value == pytest.approx(0.04, abs=0.02)
    for name in ("gain@a11", "gain@a22", "gain@a33"):
        narrow, wide = with_prior[name].sd, sd[name]
        assert narrow is not None and wide is not None and narrow < wide
    with pytest.raises(InputError, match=r"rsicalib\.population/1"):
        rsicalib.calibrate(session, drawn(), population={"format": "rsicalib.fleet/1"})


def test_tolerances_of_the_drawing_are_required(tmp_path: Path) -> None:
    with pytest.raises(InputError, match=r"tolerance of offset, gain.*\[model\] sd"):
        rsicalib.fleet(tmp_path, "rsi", out=tmp_path / "out", population=True)
