"""Levels above what a fleet calibrates: variance components beside SciPy, and coverage."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from scipy import optimize, stats

import rsicalib
from rsicalib import InputError, _core
from rsicalib.work.prior import expected_of
from tests.full import sized
from tests.levels import drawn as drawn_levels
from tests.levels import holds
from tests.oracle import Array
from tests.test_population import TOLERANCE, drawn, share

pa = pytest.importorskip("pyarrow")
parquet = pytest.importorskip("pyarrow.parquet")

Groups = list[Array]
DATA = Path(__file__).parents[2] / "shared" / "data"


def indicator(groups: Array) -> Array:
    """`Z` of a level."""
    out = np.zeros((len(groups), int(groups.max()) + 1))
    out[np.arange(len(groups)), groups] = 1.0
    return out


def reml(x: Array, sd: Array, levels: Groups) -> Array:
    """Witness: deviations with the largest restricted likelihood, by matrices of all units."""

    def cost(ln: Array) -> float:
        v = np.diag(sd**2 + np.exp(2 * ln[0]))
        for one, groups in zip(ln[1:], levels, strict=True):
            v += np.exp(2 * one) * indicator(groups) @ indicator(groups).T
        inverse = np.linalg.inv(v)
        ones = inverse.sum()
        mean = inverse.sum(axis=0) @ x / ones
        left = x - mean
        return float(np.linalg.slogdet(v)[1] + np.log(ones) + left @ inverse @ left)

    best = optimize.minimize(cost, np.zeros(1 + len(levels)), method="Nelder-Mead", tol=1e-9)
    found: Array = np.exp(best.x)
    return found


def told(x: Array, sd: Array, levels: Groups) -> tuple[dict[str, Any], list[dict[str, Any]]]:
    """What the core says of the mean and of each level."""
    (shift,) = _core.common_shifts(np.stack([x, sd], axis=-1)[None], [g.tolist() for g in levels])
    assert shift is not None
    return shift, shift["levels"]


DEVICES = np.repeat(np.arange(8), 5)
BATCHES = np.repeat(np.arange(4), 10)
TOOLS = np.tile(np.arange(5), 8)


@pytest.mark.parametrize(
    "levels", [[DEVICES], [DEVICES, BATCHES], [BATCHES, DEVICES], [DEVICES, TOOLS]]
)
def test_components_have_the_largest_restricted_likelihood(levels: Groups) -> None:
    rng = np.random.default_rng(11)
    x, sd = drawn_levels(rng, levels, (1.0, *[2.0] * len(levels)), 1)[0].T
    _, spreads = told(x, sd, levels)
    # Steps end where `ln τ²` moves by 1e-6, those of the witness by 1e-9; none of these is none.
    found = [one["sd"] for one in spreads]
    np.testing.assert_allclose(found, reml(x, sd, levels), rtol=1e-3, atol=1e-3)
    assert [one["groups"] for one in spreads] == [40, *(int(g.max()) + 1 for g in levels)]


def test_without_errors_of_estimates_the_interval_within_groups_is_the_exact_one() -> None:
    rng = np.random.default_rng(12)
    x = rng.standard_normal(8)[DEVICES] + 0.5 * rng.standard_normal(40)
    _, spreads = told(x, np.full(40, 1e-6), [DEVICES])
    within = x.reshape(8, 5)
    squares = float(((within - within.mean(axis=1, keepdims=True)) ** 2).sum())
    ends = [np.sqrt(squares / stats.chi2.isf(p, 32)) for p in (0.025, 0.975)]
    # The means of the groups tell a little of it, too, as they scatter by a fifth of it.
    np.testing.assert_allclose(spreads[0]["interval"], ends, rtol=0.02)
    assert spreads[0]["sd"] == pytest.approx(np.sqrt(squares / 32), rel=0.01)


@pytest.mark.parametrize("deviations", [(0.0, 1.0), (1.0, 0.0), (1.0, 1.0), (0.5, 2.0)])
def test_intervals_of_levels_hold(deviations: tuple[float, float]) -> None:
    rng = np.random.default_rng(13)
    groups = np.repeat(np.arange(5), 4)
    lives = sized(400, 2000)
    found = _core.common_shifts(drawn_levels(rng, [groups], deviations, lives), [groups.tolist()])
    inside, mean = holds(found, deviations)
    # They may hold too often, where one ends at zero.
    least = 0.95 - 3 * np.sqrt(0.95 * 0.05 / lives)
    assert (inside > least).all() and mean > least


def test_what_cannot_be_told_apart_is_said() -> None:
    rng = np.random.default_rng(14)
    one, each = np.zeros(40, dtype=int), np.arange(40)
    x, sd = drawn_levels(rng, [DEVICES], (1.0, 1.0), 1)[0].T
    shift, spreads = told(x, sd, [DEVICES, one, each, DEVICES + 7])
    assert [s["same_as"] for s in spreads] == [None, None, None, 0, 1]
    assert [s["sd"] is None for s in spreads] == [False, False, True, True, True]
    alone, beside = told(x, sd, [DEVICES])
    assert shift["value"] == pytest.approx(alone["value"]) and beside[1] == spreads[1]
    # Nothing is independent where levels cross.
    crossed, _ = told(x, sd, [DEVICES, TOOLS])
    assert crossed["half"] is None and crossed["p_value"] is None
    many = np.arange(4000)
    with pytest.raises(InputError, match="levels that cross"):
        told(rng.standard_normal(4000), np.ones(4000), [many // 2, (many + 1) // 2])


def test_a_level_of_shares_is_one_large_regression() -> None:
    rng = np.random.default_rng(15)
    groups = np.repeat(np.arange(10), 3)
    columns, values = [], []
    device = 0.4 * rng.standard_normal((10, 4))
    for unit in groups:
        x = rng.standard_normal((10, 4)) @ np.diag([3.0, 3.0, 1.0, 1.0])
        beta = device[unit] + 0.2 * rng.standard_normal(4)
        columns.append(x)
        values.append(x @ beta + rng.standard_normal(10))
    shares = [share(x.T @ x, x.T @ y) for x, y in zip(columns, values, strict=True)]
    found, others, of, level = _core.population(shares, TOLERANCE.tolist(), [groups.tolist()])
    assert of == groups.tolist() and level == 0 and len(others) == 10 and found["devices"] == 10

    def cost(ln: Array) -> float:
        # Witness: the density of all readings, with a variance for each term and level.
        unit, larger = np.exp(2 * np.repeat(ln[:2], 2)), np.exp(2 * np.repeat(ln[2:], 2))
        x, y = np.vstack(columns), np.concatenate(values)
        v = np.eye(len(y)) + x @ np.diag(TOLERANCE**2) @ x.T
        for k, own in enumerate(columns):
            at = slice(10 * k, 10 * k + 10)
            v[at, at] += own @ np.diag(unit) @ own.T
        for k in range(10):
            at = slice(30 * k, 30 * k + 30)
            v[at, at] += x[at] @ np.diag(larger) @ x[at].T
        return float(np.linalg.slogdet(v)[1] + y @ np.linalg.solve(v, y))

    start = np.log([0.2, 0.2, 0.4, 0.4])
    best = np.exp(optimize.minimize(cost, start, method="Nelder-Mead", tol=1e-7).x)
    spreads = [found["parameters"][k]["levels"] for k in (0, 2)]
    sd = [own[level]["sd"] for level in (0, 1) for own in spreads]
    np.testing.assert_allclose(sd, best, rtol=2e-3)
    one = found["parameters"][0]
    assert one["between"] == one["levels"][1]["sd"]
    assert one["between_interval"] == one["levels"][1]["interval"]
    # A session of another device is off by the errors of both.
    assert one["spread"] == pytest.approx(np.hypot(best[0], best[2]), rel=3e-3)
    *_, expected = expected_of({"centre": [], "parameters": [one]})["parameters"][0]
    assert expected == pytest.approx(np.hypot(one["spread"], one["sd"]))


def sessions(place: Path) -> Path:
    """Two sessions of each of three devices, as one Parquet file with a column for each."""
    mechanism = rsicalib.load_mechanism("rsi")
    parts = []
    for device in range(3):
        for session in range(2):
            seed = 10 * device + session
            made = rsicalib.simulate(poses=16, samples=2, seed=seed).readings
            own: dict[str, Any] = {
                c.name: made.values[:, k] for k, c in enumerate(mechanism.channels)
            }
            own |= {"pose": made.pose, "device": [f"d{device}"] * len(made.pose)}
            parts.append(pa.table(own | {"session": [f"d{device}s{session}"] * len(made.pose)}))
    parquet.write_table(pa.concat_tables(parts), place / "readings.parquet")
    return place / "readings.parquet"


def test_levels_are_columns_of_the_data_or_of_a_file_beside(tmp_path: Path) -> None:
    data = sessions(tmp_path)
    found = rsicalib.fleet(
        data, "rsi", out=tmp_path / "a", by="session", levels=["device"], trace=False
    )
    assert list(found.rows["device"]) == ["d0", "d0", "d1", "d1", "d2", "d2"]
    (shift,) = [s for s in found.first["shifts"] if s["parameter"] == "gain@a11"]
    assert [(s["level"], s["groups"]) for s in shift["levels"]] == [("session", 6), ("device", 3)]
    page = (tmp_path / "a" / "fleet.html").read_text()
    assert "between (groups)" in page and "device (3)" in page
    json.dumps(found.to_dict(), allow_nan=False)

    lines = [f"d{k // 2}s{k % 2},d{k // 2},{'ab'[k % 2]}" for k in range(6)]
    (tmp_path / "levels.csv").write_text("\n".join(["session,device,day", *lines]))
    beside = rsicalib.fleet(
        data, "rsi", out=tmp_path / "b", by="session", levels=["device"], trace=False
    )
    assert beside.first == found.first
    crossed = rsicalib.fleet(
        data, "rsi", out=tmp_path / "c", by="session", levels=["device", "day"], trace=False
    )
    assert [s["level"] for s in crossed.first["shifts"][0]["levels"]] == [
        "session",
        "device",
        "day",
    ]


@pytest.mark.parametrize(
    ("lines", "where", "words"),
    [
        (["session,day", "d0s0,a"], {}, "no column 'device'"),
        (["session,device", "d0s0,d0", ",d1"], {"line": 3, "column": "session"}, "found blank"),
        (
            ["session,device", "d0s0,d0", "d0s1,", "x,"],
            {"line": 3, "column": "device"},
            "found blank",
        ),
        (["session,device", "d0s0,d0", "d0s1"], {"line": 3}, "line 3"),
        (
            ["session,device", "d0s0,d0", "d0s0,d1"],
            {"line": 3, "column": "session"},
            "'d0s0' again",
        ),
        (["session,device", "d0s0,d0", "d0s1,d0"], None, "no device of session 'd1s0'"),
    ],
)
def test_levels_beside_are_checked_before_anything_is_computed(
    lines: list[str],
    where: dict[str, Any] | None,
    words: str,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    data = sessions(tmp_path)
    (tmp_path / "levels.csv").write_text("\n".join(lines) + "\n")

    def computed(*_: Any, **__: Any) -> None:
        raise AssertionError("a device was calibrated")

    monkeypatch.setattr(_core, "calibrate_devices", computed)
    with pytest.raises(InputError, match=words) as refused:
        rsicalib.fleet(data, "rsi", out=tmp_path / "a", by="session", levels=["device"])
    if where is None:
        assert refused.value.where is None
    else:
        found = refused.value.where
        assert found is not None and str(found["file"]).endswith("levels.csv")
        assert where.items() <= found.items()


@pytest.mark.parametrize("name", ["a11", "session", "verdict", "chi2", "gain@a11"])
def test_levels_have_names_of_their_own(name: str, tmp_path: Path) -> None:
    data = sessions(tmp_path)
    with pytest.raises(InputError, match=f"levels: found '{name}'"):
        rsicalib.fleet(data, "rsi", out=tmp_path / "a", by="session", levels=["device", name])
    with pytest.raises(InputError, match="levels: found 'device'"):
        rsicalib.fleet(data, "rsi", out=tmp_path / "a", by="session", levels=["device"] * 2)
    if name != "session":
        with pytest.raises(InputError, match=f"by: found '{name}'"):
            rsicalib.fleet(data, "rsi", out=tmp_path / "a", by=name)


def test_a_session_of_two_devices_is_refused_by_its_row(tmp_path: Path) -> None:
    data = sessions(tmp_path)
    read = parquet.read_table(data).to_pydict()
    read["session"] = [name[-2:] if name in ("d0s0", "d1s0") else name for name in read["session"]]
    parquet.write_table(pa.table(read), data)
    found = rsicalib.fleet(
        data, "rsi", out=tmp_path / "a", by="session", levels=["device"], trace=False
    )
    rows = dict(zip(found.rows["session"], found.rows["message"], strict=True))
    assert "rows of device d0 and d1" in rows["s0"]
    assert found.verdicts.get("refused") == 1 and len(rows) == 5
    # One of the rows of another session says of no device that it is of it.
    read["device"][read["session"].index("d1s1")] = " "
    parquet.write_table(pa.table(read), data)
    found = rsicalib.fleet(
        data,
        drawn(),
        out=tmp_path / "b",
        by="session",
        levels=["device"],
        trace=False,
        population=True,
    )
    rows = dict(zip(found.rows["session"], found.rows["message"], strict=True))
    assert "column device: found blank" in rows["d1s1"]
    assert found.verdicts.get("refused") == 2 and len(rows) == 5
    # Neither of them is one of a device, so of the second there is none.
    assert found.population is not None and found.population["devices"] == 2
    (shift,) = [s for s in found.first["shifts"] if s["parameter"] == "gain@a11"]
    assert [level["groups"] for level in shift["levels"]] == [3, 2]
    one = found.population["parameters"][0]["levels"]
    assert [level["groups"] for level in one] == [3, 2]


def test_a_population_of_sessions_is_one_of_devices(tmp_path: Path) -> None:
    data = sessions(tmp_path)
    mechanism = drawn()
    found = rsicalib.fleet(
        data,
        mechanism,
        out=tmp_path / "a",
        by="session",
        levels=["device"],
        trace=False,
        population=True,
    )
    assert found.population is not None and found.population["devices"] == 3
    rows = parquet.read_table(tmp_path / "a" / "population.parquet").to_pydict()
    assert rows["device"] == ["d0", "d1", "d2"]
    assert {len(p["levels"]) for p in found.population["parameters"]} == {2}
    for p in found.population["parameters"]:
        session, device = p["levels"]
        assert (p["between"], p["between_interval"]) == (device["sd"], device["interval"])
        for own in (session, device):
            assert own["interval"] is None or own["interval"][0] <= own["sd"] <= own["interval"][1]
        all_levels = np.hypot(session["sd"], device["sd"])
        assert p["spread"] == pytest.approx(max(all_levels, 0.01 * p["tolerance"]))
    few = rsicalib.simulate(poses=6, samples=2, seed=99).readings
    own = rsicalib.calibrate(few, mechanism, population=tmp_path / "a" / "population.json")
    assert own.parameters


@pytest.mark.skipif(not (DATA / "dvrk_plane").is_dir(), reason="no shared data")
def test_the_zero_of_a_da_vinci_arm_differs_by_session(tmp_path: Path) -> None:
    data = tmp_path / "sessions"
    data.mkdir()
    lines = ["session,arm"]
    for path in sorted((DATA / "dvrk_plane").glob("PSM*.csv")):
        (data / path.name).write_bytes(path.read_bytes())
        lines.append(f"{path.stem},{path.stem[:4]}")
    (data / "levels.csv").write_text("\n".join(lines))
    found = rsicalib.fleet(
        data,
        DATA / "dvrk_plane" / "psm.toml",
        out=tmp_path / "out",
        by="session",
        levels=["arm"],
        terms=["offset@q3"],
        trace=False,
    )
    (zero,) = [s for s in found.first["shifts"] if s["parameter"] == "offset@q3"]
    session, arm = zero["levels"]
    # MACHINES.md: by 8 mm between two sessions of one arm, each known to a fraction of that.
    assert session["interval"][0] < 8e-3 / np.sqrt(2) < session["interval"][1]
    # Two arms tell no more than an upper bound.
    assert arm["groups"] == 2 and arm["interval"][0] == 0.0
