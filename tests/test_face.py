"""Results at work in Python: by name, as data frames, drawn, shown, logged, listened to."""

from __future__ import annotations

import copy
import dataclasses
import logging
import pickle
import re
import signal
import tomllib
from collections.abc import Callable
from html.parser import HTMLParser
from pathlib import Path

import matplotlib
import numpy as np
import pandas
import pytest

import rsicalib
from rsicalib import DEMO, Calibration, InputError, Mechanism, Readings, Trace
from rsicalib.labels import Labelled
from rsicalib.plots import dots
from rsicalib.tabular import html_table

matplotlib.use("Agg")
from matplotlib import pyplot

READINGS, REST, CHECK = (DEMO / f"{name}.csv" for name in ("readings", "rest", "check"))


@pytest.fixture(scope="module")
def calibration() -> Calibration:
    return rsicalib.calibrate(READINGS, rest=REST)


@pytest.fixture(scope="module")
def traced() -> Trace:
    return rsicalib.demo()


@pytest.fixture(autouse=True)
def no_figure_is_left():
    yield
    pyplot.close("all")


# ------------------------------------------------------------------ by name


def test_a_parameter_is_found_by_its_name_its_parts_and_its_number(traced: Trace) -> None:
    by_name = traced["curvature@a22.c2"]
    assert by_name is traced["curvature@a22"] is traced["curvature", "a22"]
    assert by_name is traced["curvature", "a22", "c2"]
    assert by_name is traced[traced.keys().index("curvature@a22.c2")]
    assert [p.key for p in traced] == traced.keys()
    assert len(traced) == len(traced.parameters) == len(set(traced.keys()))
    assert dict(traced)["gain@a11"] is traced["gain@a11"]


def test_what_is_not_there_is_refused_with_what_is(traced: Trace) -> None:
    assert "gain@a11" in traced and traced[0] in traced
    assert "gain@b11" not in traced and 99 not in traced and None not in traced
    with pytest.raises(KeyError, match="offset@a11"):
        traced["gain@b11"]
    with pytest.raises(IndexError):
        traced[99]


def test_a_term_of_several_parameters_asks_which() -> None:
    found = rsicalib.calibrate(READINGS, rest=REST, terms=["offset", "gain", "once_per_turn@a22"])
    with pytest.raises(KeyError, match=r"once_per_turn@a22\.\w+, once_per_turn@a22\.\w+"):
        found["once_per_turn@a22"]
    assert "once_per_turn@a22" not in found
    assert len({found[key].value for key in found.keys() if key.startswith("once")}) == 2


def test_a_result_without_parameters_is_still_a_result() -> None:
    whole = rsicalib.load_readings(READINGS)
    few = rsicalib.calibrate(whole.select((whole.pose <= 4) & (whole.sample == 1)))
    assert len(few) == 0 and few and list(few) == []
    assert few.covariance.size == 0
    assert "Undetermined" in few._repr_html_()


# ------------------------------------------------------------------ covariance


def test_the_covariance_is_asked_by_names(calibration: Calibration) -> None:
    c = calibration.covariance
    assert c.names == tuple(calibration.keys())
    plain = np.asarray(c)
    i, j = c.names.index("gain@a11"), c.names.index("offset@a11")
    assert c["gain@a11", "offset@a11"] == plain[i, j]
    np.testing.assert_array_equal(c["gain@a11"], plain[i])
    np.testing.assert_array_equal(c[["gain@a11", "offset@a11"]], plain[np.ix_([i, j], [i, j])])
    sd = calibration["gain@a11"].sd
    assert sd is not None and c["gain@a11", "gain@a11"] == pytest.approx(sd**2)
    with pytest.raises(KeyError, match="no row 'gain@b11'"):
        c["gain@b11"]


def test_the_covariance_is_an_array_in_all_else() -> None:
    m = Labelled.of([[4.0, 1.0], [1.0, 9.0]], ["p", "q"])
    np.testing.assert_allclose(m @ [1.0, 1.0], [5.0, 10.0])
    assert m.sum() == 15.0 and m[1, 1] == 9.0 and m.shape == (2, 2)
    assert type(m * 2) is np.ndarray and type(m[:1]) is np.ndarray
    assert m.correlation["p", "q"] == pytest.approx(1 / 6)  # 1 / (2 · 3)
    with pytest.raises(ValueError, match="read-only"):
        m[0, 0] = 1.0
    with pytest.raises(ValueError, match="expected 1 rows"):
        Labelled.of(m, ["p"])
    for again in (pickle.loads(pickle.dumps(m)), copy.deepcopy(m), copy.copy(m)):
        assert again["p", "q"] == 1.0


def test_a_result_keeps_its_names_when_it_is_pickled_and_saved(
    calibration: Calibration, tmp_path: Path
) -> None:
    calibration.save(tmp_path / "c.json")
    copies = (
        pickle.loads(pickle.dumps(calibration)),
        rsicalib.load_calibration(tmp_path / "c.json"),
    )
    for again in copies:
        assert again.covariance.names == calibration.covariance.names
        assert again.to_json() == calibration.to_json()


# ------------------------------------------------------------------ data frames


def test_results_are_data_frames(calibration: Calibration, traced: Trace) -> None:
    frame = calibration.to_dataframe()
    assert frame.index.name == "name"
    assert frame.loc["gain@a11", "value"] == calibration["gain@a11"].value
    assert (frame["low"] < frame["value"]).all() and (frame["value"] < frame["high"]).all()
    assert len(traced.to_dataframe()) == len(traced)
    covariance = calibration.covariance.to_dataframe()
    assert (
        covariance.loc["gain@a11", "offset@a11"] == calibration.covariance["gain@a11", "offset@a11"]
    )
    seen = rsicalib.observability(READINGS).to_dataframe()
    assert list(seen.index) == list(rsicalib.load_readings(READINGS).channels)
    assert list(rsicalib.identifiable("rsi").to_dataframe()["term"]) == ["offset", "gain"]


def test_readings_come_from_a_data_frame_as_from_the_file(calibration: Calibration) -> None:
    frame = pandas.read_csv(READINGS)
    frame["note"] = pandas.Timestamp("1994-05-08")  # no column of ours: ignored
    loaded = rsicalib.load_readings(frame)
    assert any("note" in warning.text for warning in loaded.warnings)
    again = rsicalib.load_readings(READINGS).to_dataframe()
    pandas.testing.assert_frame_equal(
        loaded.to_dataframe(), again, check_exact=True, check_dtype=False
    )
    found = rsicalib.calibrate(frame, rest=pandas.read_csv(REST))
    np.testing.assert_array_equal(found.values, calibration.values)
    columns = {name: frame[name].to_numpy() for name in frame.columns if name != "note"}
    np.testing.assert_array_equal(rsicalib.load_readings(columns).values, loaded.values)


def test_a_cell_of_a_data_frame_that_cannot_be_used_is_named(tmp_path: Path) -> None:
    frame = pandas.read_csv(READINGS)
    frame["a22"] = frame["a22"].astype("Int64")
    frame.loc[3, "a22"] = pandas.NA
    with pytest.raises(InputError, match="data in memory, row 4, column a22: found NaN"):
        rsicalib.load_readings(frame)
    with pytest.raises(InputError, match="column a33"):
        rsicalib.load_readings(frame.drop(columns="a33"))
    assert len(rsicalib.load_readings(frame, skip_bad_rows=True)) == len(frame) - 1
    # Poses of fewer rows would stand beside other readings than their own.
    with pytest.raises(InputError, match="1 bad row,"):
        rsicalib.forward(frame, skip_bad_rows=True)


def test_text_columns_of_a_data_frame_tell_placements_apart() -> None:
    mechanism = {
        "name": "arm",
        "length_unit": "m",
        "channel": [{"name": "q1", "unit": "rad", "gain": 1.0, "offset": 0.0}],
        "chain": [{"name": "arm", "dh": [{"channel": "q1", "a": 0.3}]}],
        "point": [
            {"name": "ball", "chain": "arm", "at": [0, 0, 0]},
            {"name": "socket", "unknown": ["group", "at"]},
        ],
        "closure": [{"name": "touch", "kind": "touch", "between": ["ball", "socket"]}],
    }
    frame = pandas.DataFrame({"q1": [0.1, 0.2], "group": ["a", "b"], "at": ["s0", None]})
    with pytest.raises(InputError, match="row 2, column at: found blank"):
        rsicalib.load_readings(frame, mechanism)
    loaded = rsicalib.load_readings(frame.fillna("s1"), mechanism)
    assert loaded.keys == {"group": ("a", "b"), "at": ("s0", "s1")}


# ------------------------------------------------------------------ mechanisms


def test_a_mechanism_comes_from_a_name_a_file_a_text_and_plain_values(tmp_path: Path) -> None:
    rsi = Mechanism("rsi")
    text = rsi.to_toml()
    (tmp_path / "rsi.toml").write_text(text)
    assert Mechanism(tmp_path / "rsi.toml") == Mechanism(str(tmp_path / "rsi.toml")) == rsi
    assert Mechanism(text) == Mechanism(tomllib.loads(text)) == Mechanism(rsi.to_dict()) == rsi
    assert rsicalib.load_mechanism(tomllib.loads(text)) == rsi
    assert pickle.loads(pickle.dumps(rsi)) == copy.deepcopy(rsi) == rsi
    with pytest.raises(InputError, match="no such file"):
        Mechanism("nowhere")
    with pytest.raises(InputError, match="nam"):
        Mechanism({"nam": "rsi"})
    with pytest.raises(InputError, match="line 1"):
        Mechanism("name = \n")


def test_a_gain_in_degrees_means_the_same_in_a_file_and_in_plain_values(tmp_path: Path) -> None:
    values = Mechanism("rsi").to_dict()
    written = {"offset": 12.3, "range": (-170.0, 170.0), "limits": (-180.0, 33.3), "noise": 0.01}
    values["channel"][0] |= {"unit": "deg", "gain": 1.0, **written}
    plain = Mechanism(values)
    assert plain.channels[0].gain == pytest.approx(np.pi / 180)  # what a degree is
    assert plain.channels[0].offset == pytest.approx(12.3 * np.pi / 180)
    assert plain.channels[0].limits == pytest.approx((-np.pi, 33.3 * np.pi / 180))
    assert plain.channels[0].range == (-170.0, 170.0) and plain.channels[0].noise == 0.01
    # What is printed is what was written, digit by digit.
    assert {key: plain.to_dict()["channel"][0][key] for key in written} == written
    assert plain.to_dict()["channel"][0]["gain"] == 1.0
    assert plain == Mechanism(plain.to_toml())
    assert pickle.loads(pickle.dumps(plain)) == plain
    assert plain.to_dict()["channel"][0]["gain"] == pytest.approx(1.0)


# ------------------------------------------------------------------ plots


def test_plots_are_drawn_on_the_axes_that_are_given(
    calibration: Calibration, traced: Trace, tmp_path: Path
) -> None:
    seen, space = rsicalib.observability(READINGS), rsicalib.workspace(traced, poses=20)
    plan = rsicalib.plan(poses=10, candidates=300, starts=1)
    drawn = [
        calibration.plot, traced.plot, traced.steps[0].plot, seen.plot, space.plot, plan.plot,
        lambda ax: traced.plot("effects", ax=ax), lambda ax: traced.plot("parameters", ax=ax),
        rsicalib.suppose(READINGS, ["drift@a22=0.01"]).plot,
    ]  # fmt: skip
    for draw in drawn:
        _, ax = pyplot.subplots()
        assert draw(ax=ax) is ax
        assert ax.has_data() and ax.get_xlabel()
    figure = traced.plot().figure  # a figure of its own
    figure.savefig(tmp_path / "x.png")
    assert (tmp_path / "x.png").stat().st_size > 5000


def test_the_residuals_that_are_drawn_are_those_of_the_result(traced: Trace) -> None:
    clouds = traced.plot().collections
    assert [c.get_label() for c in clouds if len(c.get_offsets()) > 4] == ["before", "after"]
    after = np.asarray(clouds[-1].get_offsets())
    assert traced.after_residuals is not None
    np.testing.assert_allclose(after[:, 1], traced.after_residuals.ravel())
    assert after[:, 0].max() == traced.readings.poses


def test_one_wild_residual_does_not_shrink_the_rest() -> None:
    rng = np.random.default_rng(0)
    rows = rng.normal(0, 1, (40, 3))
    rows[7, 1] = 900.0
    ax = dots(pyplot.subplots()[1], {"after": rows}, "pose")
    assert ax.get_ylim()[1] < 15
    (mark,) = ax.texts
    assert mark.get_text() == "900" and mark.xy[0] == 8 and mark.xy[1] < ax.get_ylim()[1]
    clean = dots(pyplot.subplots()[1], {"after": rng.normal(0, 1, (40, 3))}, "pose")
    assert not clean.texts


def test_a_pose_that_was_left_out_does_not_shrink_the_plot() -> None:
    """Of a session with a reading that is 900 standard deviations off, from files to axes."""
    whole = rsicalib.load_readings(READINGS)
    values = whole.values.copy()
    values[whole.pose == 17, 2] -= 900.0
    found = rsicalib.trace(dataclasses.replace(whole, values=values), rest=REST)
    assert [e.pose for e in found.excluded] == [17]
    ax = found.plot()
    assert ax.get_ylim()[1] < 20.0
    wild = [mark for mark in ax.texts if mark.xy[0] == 17]
    assert wild and all(abs(mark.xy[1]) < ax.get_ylim()[1] for mark in ax.texts)
    drawn = np.concatenate([c.get_offsets()[:, 1] for c in ax.collections])
    assert np.abs(drawn).max() < ax.get_ylim()[1]  # nothing is cut off


def test_data_frames_of_polars_come_back_as_such(calibration: Calibration) -> None:
    polars = pytest.importorskip("polars")
    frame = polars.read_csv(READINGS)
    again = rsicalib.load_readings(frame).to_polars()
    assert again.select("a11", "a33").equals(frame.select("a11", "a33").cast(polars.Float64))
    rows = calibration.to_polars()
    assert isinstance(rows, polars.DataFrame) and rows["name"].to_list() == calibration.keys()
    assert rows["value"].to_list() == [p.value for p in calibration]
    matrix = calibration.covariance.to_polars()
    assert matrix.columns == ["name", *calibration.keys()]
    devices = [frame.with_columns(polars.lit(name).alias("device")) for name in ("a", "b")]
    found = rsicalib.calibrate_devices(polars.concat(devices))
    assert isinstance(found, polars.DataFrame) and found["device"].to_list() == ["a", "b"]


@pytest.mark.parametrize("library", ["pandas", "polars", "pyarrow"])
def test_a_data_frame_in_is_a_data_frame_out(library: str, calibration: Calibration) -> None:
    """Row by row what a file gives; an index stays, and poses go back by name, not by place."""
    module = pytest.importorskip(library)
    rows = pandas.read_csv(READINGS)
    if library == "pandas":
        given = rows.set_index("pose")
    else:
        given = module.Table.from_pandas(rows) if library == "pyarrow" else module.DataFrame(rows)
    of_file = {
        rsicalib.forward: rsicalib.forward(READINGS, "rsi", calibration),
        rsicalib.forward_sd: rsicalib.forward_sd(READINGS, "rsi", calibration),
    }
    for verb, expected in of_file.items():
        found = verb(given, "rsi", calibration)
        assert type(found) is type(given)
        own = found if library == "pandas" else found.to_pandas()
        assert list(own.columns) == ["x", "y", "z", "rx", "ry", "rz"]
        np.testing.assert_array_equal(own.to_numpy(), expected)
        if library == "pandas":
            assert own.index.equals(given.index)
    if library == "pandas":
        poses = rsicalib.forward(given, "rsi", calibration).reset_index()
        back = rsicalib.inverse(poses[["rz", "pose", "y", "x", "rx", "ry", "z"]])
        assert list(back.columns) == [channel.name for channel in Mechanism.rsi().channels]
        expected = rsicalib.inverse(of_file[rsicalib.forward])
        np.testing.assert_array_equal(back.to_numpy(), expected)
        with pytest.raises(InputError, match="no column y rz"):
            rsicalib.inverse(poses[["x", "z", "rx", "ry", "pose"]])


def test_two_calibrations_of_the_same_readings_are_equal(calibration: Calibration) -> None:
    again = rsicalib.calibrate(READINGS, rest=REST)
    assert again == calibration == pickle.loads(pickle.dumps(calibration))
    assert hash(again) == hash(calibration) and len({again, calibration}) == 1
    assert dataclasses.replace(calibration, note="another") != calibration
    assert calibration != 1


def test_what_is_made_twice_is_equal_and_equal_to_its_pickle(traced: Trace) -> None:
    """Also where it holds arrays, of which `==` would be one for each entry."""
    session = DEMO / "readings.csv"
    makes: list[Callable[[int], object]] = [
        lambda seed: rsicalib.simulate(seed=seed),
        lambda seed: rsicalib.simulate(seed=seed).readings,
        lambda seed: rsicalib.plan(poses=12 + seed, candidates=50, starts=1),
        lambda seed: rsicalib.observability(rsicalib.simulate(seed=seed).readings),
        lambda seed: rsicalib.suppose(session, [f"curvature@a22.c2=0.0{seed}"]),
        lambda seed: rsicalib.certify(traced, limit=0.01 * seed),
        lambda seed: rsicalib.Placer(calibration=traced if seed == 1 else None),
        lambda seed: rsicalib.workspace(traced, poses=9 + seed),
    ]
    for make in makes:
        one, again, other = make(1), make(1), make(2)
        assert one == again == pickle.loads(pickle.dumps(one)) and one != other
        assert hash(one) == hash(again)
    readings = rsicalib.load_readings(session)
    warm = dataclasses.replace(readings, temperature_c=np.full(len(readings.values), 21.0))
    assert warm != readings and readings != warm


def test_the_curve_that_is_drawn_is_that_of_the_step(traced: Trace) -> None:
    (step,) = traced.steps
    line = step.plot().lines[-1]
    np.testing.assert_allclose(line.get_xdata(), [row[0] for row in step.curve])
    np.testing.assert_allclose(line.get_ydata(), [1e3 * row[1] for row in step.curve])


def test_what_cannot_be_drawn_is_refused(calibration: Calibration, tmp_path: Path) -> None:
    calibration.save(tmp_path / "c.json")
    saved = rsicalib.load_calibration(tmp_path / "c.json")
    with pytest.raises(ValueError, match="no residuals"):
        saved.plot("residuals")
    assert len(saved.plot().patches) == len(saved.parameters)  # what a file has
    with pytest.raises(ValueError, match="no effect"):
        calibration.plot("effects")
    with pytest.raises(ValueError, match="expected 'residuals'"):
        calibration.plot("everything")  # type: ignore[arg-type]
    with pytest.raises(ValueError, match="expected 'xy'"):
        rsicalib.workspace(calibration, poses=3).plot("zz")  # type: ignore[arg-type]


def test_without_the_extras_a_plot_and_a_frame_say_what_to_install(
    calibration: Calibration, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setitem(__import__("sys").modules, "matplotlib", None)
    monkeypatch.setitem(__import__("sys").modules, "pandas", None)
    with pytest.raises(ImportError, match=r"pip install 'rsicalib\[plot\]'"):
        calibration.plot()
    with pytest.raises(ImportError, match=r"pip install 'rsicalib\[pandas\]'"):
        calibration.to_dataframe()


# ------------------------------------------------------------------ the workspace


def test_the_workspace_has_the_deviations_that_forward_sd_gives(traced: Trace) -> None:
    space = rsicalib.workspace(traced, poses=30, seed=4)
    assert space.poses.shape == space.sd.shape == (30, 6)
    assert (space.poses == rsicalib.workspace(traced, poses=30, seed=4).poses).all()
    # The same poses read by nobody's device but the calibrated one: offsets, gains and the curve.
    rsi = rsicalib.load_mechanism()
    angles = rsicalib.inverse(space.poses, rsi)
    gains = np.array([traced["gain", c.name].value for c in rsi.channels])
    offsets = np.array([traced["offset", c.name].value for c in rsi.channels])
    readings = Readings.from_arrays(rsi, (angles - offsets) / gains)
    np.testing.assert_allclose(space.sd, rsicalib.forward_sd(readings, rsi, traced), rtol=1e-6)
    assert space.position_sd == pytest.approx(np.sqrt((space.sd[:, :3] ** 2).mean(axis=1)))


def test_points_of_chains_have_a_workspace_where_there_is_no_platform(
    calibration: Calibration,
) -> None:
    values = {**Mechanism("rsi").to_dict(), "platform": {}}
    values.pop("rest")
    mechanism = Mechanism(values)
    with pytest.warns(rsicalib.OpenLoopsWarning, match="drawn otherwise"):
        space = rsicalib.workspace(calibration, mechanism, poses=60, seed=1)
    assert space.names[:3] == ("wrist1.x", "wrist1.y", "wrist1.z")
    n = len(space.poses)
    assert 50 <= n <= 60 and space.poses.shape == space.sd.shape == (n, 9)
    wrists = space.poses.reshape(-1, 3, 3)
    for a, b in ((0, 1), (1, 2), (2, 0)):
        apart = np.linalg.norm(wrists[:, a] - wrists[:, b], axis=1)
        # Closed as drawn, l4 √3 of Table I, up to what the offsets and gains misclose.
        np.testing.assert_allclose(apart, 1.5 * 3**0.5, rtol=1e-6)
    assert np.isnan(space.orientation_sd).all() and (space.position_sd > 0).all()
    assert len(space.plot("xy").collections[0].get_offsets()) == 3 * n
    with pytest.raises(InputError, match="without a platform"):
        rsicalib.workspace(calibration, mechanism, within=[(0.0, 1.0)] * 6)


# ------------------------------------------------------------------ shown


class Balance(HTMLParser):
    """Every element is closed in its turn."""

    def __init__(self) -> None:
        super().__init__()
        self.open: list[str] = []

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        assert tag in "div p b ul li table caption thead tbody tr th td details summary pre".split()
        self.open.append(tag)

    def handle_endtag(self, tag: str) -> None:
        assert self.open.pop() == tag


def shown(calibration: Calibration, traced: Trace) -> list[object]:
    """One of everything that a cell of a notebook can end with."""
    return [
        calibration, traced, traced.steps[0], traced["gain@a11"], Mechanism("rsi"),
        rsicalib.load_readings(CHECK), rsicalib.observability(READINGS),
        rsicalib.identifiable("rsi"), rsicalib.plan(poses=10, candidates=300, starts=1),
        rsicalib.workspace(traced, poses=5), rsicalib.simulate(poses=3, check=1),
        rsicalib.simulate(poses=3, check=1).device, rsicalib.suppose(READINGS, ["drift@a22=0.01"]),
        *watched(traced), traced.could_hide[0], traced.rivals[0], traced.after,
    ]  # fmt: skip


def watched(traced: Trace) -> list[object]:
    """A monitor that has raised an alarm, the alarm and the summary."""
    monitor = rsicalib.Monitor(traced)
    rows = rsicalib.load_readings(READINGS).values
    monitor.update(rows)
    (alarm,) = monitor.update(rows + np.array([0, 0, 0, 0, 40, 0, 0, 0, 0]))
    return [monitor, alarm, monitor.summary()]


def test_everything_has_a_short_repr_and_most_a_table(
    calibration: Calibration, traced: Trace
) -> None:
    tables = 0
    for it in shown(calibration, traced):
        assert len(repr(it)) <= 130 and "\n" not in repr(it), repr(it)
        assert repr(it).startswith("<") and repr(it).endswith(">")
        if hasattr(it, "_repr_html_"):
            reader = Balance()
            reader.feed(it._repr_html_())
            assert reader.open == []
            tables += 1
    assert tables == 12


def test_a_notebook_shows_the_verdict_and_every_parameter(traced: Trace) -> None:
    html = traced._repr_html_()
    assert "Explained: curvature of sensor a22 was missing" in html
    for key in traced.keys():
        assert f">{key}<" in html


def test_a_covariance_is_shown_with_its_names(calibration: Calibration) -> None:
    html = calibration.covariance._repr_html_()
    assert html is not None and html.count(">gain@a11<") == 2  # a row and a column
    assert Labelled.of(np.zeros((0, 0)), [])._repr_html_() is None


def test_text_of_a_file_is_never_markup() -> None:
    html = html_table({"<i>": ["<script>", 'a"b', 1.5, None]}, "<b>")
    assert not re.search(r"<(i|b|script)>", html)
    assert "&lt;script&gt;" in html and "1.5" in html


# ------------------------------------------------------------------ heard


def test_progress_runs_from_stage_to_stage_and_never_back() -> None:
    heard: list[tuple[str, float]] = []
    with_it = rsicalib.trace(READINGS, rest=REST, progress=lambda *at: heard.append(at))
    shares = [share for _, share in heard]
    assert shares == sorted(shares) and 0.0 <= shares[0] and 0.9 < shares[-1] <= 1.0
    stages = list(dict.fromkeys(stage for stage, _ in heard))
    assert stages[0] == "fit" and "search for missing effects" in stages and len(stages) >= 5
    without = rsicalib.trace(READINGS, rest=REST)
    assert with_it.to_json() == without.to_json()
    heard.clear()
    rsicalib.calibrate(READINGS, rest=REST, progress=lambda *at: heard.append(at))
    assert heard and heard[-1][1] <= 1.0


def test_an_exception_of_the_callback_is_the_caller_s() -> None:
    calls = []

    def stop(stage: str, share: float) -> None:
        calls.append(stage)
        raise RuntimeError("enough")

    for verb in (rsicalib.calibrate, rsicalib.trace):
        calls.clear()
        with pytest.raises(RuntimeError, match="enough"):
            verb(READINGS, rest=REST, progress=stop)
        assert len(calls) < 5  # it is not called again


@pytest.mark.skipif(not hasattr(signal, "raise_signal"), reason="signals")
def test_ctrl_c_ends_a_job_in_the_main_thread(monkeypatch: pytest.MonkeyPatch) -> None:
    from rsicalib.work import listening

    def interrupt(stage: str, share: float) -> None:
        signal.raise_signal(signal.SIGINT)

    monkeypatch.setattr(listening, "_heard", interrupt)  # as if somebody pressed it just now
    # What runs in the background of a shell ignores the signal.
    before = signal.signal(signal.SIGINT, signal.default_int_handler)
    try:
        with pytest.raises(KeyboardInterrupt):
            rsicalib.trace(READINGS, rest=REST)
    finally:
        signal.signal(signal.SIGINT, before)


def test_a_verb_logs_warnings_stages_and_its_verdict(caplog: pytest.LogCaptureFixture) -> None:
    with caplog.at_level(logging.DEBUG, logger="rsicalib"):
        found = rsicalib.calibrate(CHECK, rest=REST)
    levels = [(r.levelno, r.getMessage()) for r in caplog.records if r.name == "rsicalib"]
    assert [m for n, m in levels if n == logging.WARNING] == [w.text for w in found.warnings] != []
    assert any("fit" in m for n, m in levels if n == logging.DEBUG)
    (said,) = (m for n, m in levels if n == logging.INFO)
    assert said.startswith("rsi, 20 poses: ")


def test_nothing_is_printed_by_a_verb(capfd: pytest.CaptureFixture[str]) -> None:
    rsicalib.calibrate(CHECK, rest=REST)
    assert capfd.readouterr() == ("", "")


def test_a_misspelt_parameter_is_answered_with_the_one_that_was_meant() -> None:
    found = rsicalib.calibrate(DEMO / "readings.csv", rest=DEMO / "rest.csv")
    with pytest.raises(KeyError, match="did you mean 'offset@a11'"):
        found["ofset@a11"]
    with pytest.raises(KeyError) as long:
        found["x" * 100_000]
    assert len(str(long.value)) < 2000
