"""The verbs in Python: what goes in, what comes out, and what is refused."""

from __future__ import annotations

import ast
import builtins
import dataclasses
import datetime
import importlib
import inspect
import json
import pickle
import re
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import rsicalib
from rsicalib import DEMO, Calibration, InputError, Trace
from rsicalib.errors import ResultError
from rsicalib.work.outcome import about
from tests import oracle
from tests.test_families import clean

READINGS, REST, CHECK = (DEMO / f"{name}.csv" for name in ("readings", "rest", "check"))


@pytest.fixture(scope="module")
def calibration() -> Calibration:
    return rsicalib.calibrate(READINGS, rest=REST, check=CHECK, align=True)


@pytest.fixture(scope="module")
def traced() -> Trace:
    return rsicalib.trace(READINGS, rest=REST, check=CHECK)


def test_a_calibration_has_every_parameter_of_the_paper_with_its_uncertainty(
    calibration: Calibration,
) -> None:
    assert len(calibration.parameters) == 18
    assert all(p.sd is not None and p.sd > 0 for p in calibration.parameters)
    assert calibration.covariance.shape == (18, 18)
    sd = np.sqrt(np.diag(calibration.covariance))
    np.testing.assert_allclose(sd, [p.sd for p in calibration.parameters], rtol=1e-12)


def test_a_parameter_is_found_by_term_and_target(calibration: Calibration) -> None:
    gain = calibration["gain", "a11"]
    assert gain.unit == "rad/count"
    low, high = gain.interval or (0.0, 0.0)
    assert low < gain.value < high
    with pytest.raises(KeyError, match="offset@a11"):
        calibration["slope", "a11"]


def test_an_undeclared_effect_is_significant_in_a_calibration(calibration: Calibration) -> None:
    assert calibration.verdict == "unexplained"
    assert calibration.exit_code == 4
    assert calibration.fit.p_value is not None and calibration.fit.p_value < 0.01


def test_the_error_of_the_platform_is_given_before_and_after(calibration: Calibration) -> None:
    nominal, fit = calibration.nominal, calibration.fit
    assert nominal is not None and nominal.check is not None and fit.check is not None
    assert nominal.check.poses == fit.check.poses == 20
    assert fit.check.position_rms < 0.1 * nominal.check.position_rms
    assert fit.aligned is not None and fit.aligned.position_rms <= fit.check.position_rms


def test_tracing_names_the_channel_and_lowers_the_error(traced: Trace) -> None:
    assert traced.verdict == "explained"
    assert traced.exit_code == 0
    assert [(step.klass, step.target) for step in traced.steps] == [("sensor", "a22")]
    assert traced.before.check is not None and traced.after.check is not None
    assert traced.after.check.position_rms < traced.before.check.position_rms


def test_a_result_is_what_it_was_after_saving_and_loading(
    calibration: Calibration, traced: Trace, tmp_path: Path
) -> None:
    for result in (calibration, traced):
        result.save(tmp_path / "result.json")
        again = rsicalib.load_calibration(tmp_path / "result.json")
        assert type(again) is type(result)
        assert again.to_json() == result.to_json()


def test_json_has_the_promised_keys_and_no_nan(calibration: Calibration, traced: Trace) -> None:
    def refuse(token: str) -> None:
        raise AssertionError(token)

    common = {"format", "version", "mechanism", "length_unit", "readings", "noise", "warnings"}
    common |= {"excluded", "verdict", "parameters", "covariance", "unobservable", "condition"}
    common |= {"starts", "termination"}
    one = json.loads(calibration.to_json(), parse_constant=refuse)
    assert common | {"fit"} <= set(one)
    assert not {"steps", "after", "before", "could_hide"} & set(one)
    assert one["format"] == "rsicalib.calibration/1"
    two = json.loads(traced.to_json(), parse_constant=refuse)
    assert common | {"before", "steps", "after", "unexplained", "could_hide"} <= set(two)
    assert two["format"] == "rsicalib.trace/1"
    assert set(two["starts"][0]) >= {"from", "cost"}
    assert set(two["steps"][0]) >= {"term", "class", "target", "p_value", "parameters", "curve"}


def test_device_note_and_date_stand_in_the_result_and_are_null_where_not_given(
    calibration: Calibration,
) -> None:
    keys = ("device", "note", "valid_from")
    assert [calibration.to_dict()[key] for key in keys] == [None, None, None]
    day = datetime.date(2025, 3, 1)
    for date, text in ((day, "2025-03-01"), ("2025-03-01 14:30", "2025-03-01T14:30:00")):
        found = rsicalib.fixture(CHECK, device="number 7", note="new pot", date=date)
        assert [found.to_dict()[key] for key in keys] == ["number 7", "new pot", text]
    with pytest.raises(InputError, match="found '1 March', expected an ISO 8601 date"):
        rsicalib.fixture(CHECK, date="1 March")


def test_applying_a_result_gives_the_error_that_its_fit_reported(
    calibration: Calibration, traced: Trace
) -> None:
    known = rsicalib.load_readings(CHECK)
    assert known.poses is not None
    first = np.flatnonzero(np.r_[True, np.diff(known.pose) != 0])
    for result in (calibration, traced):
        check = result.quality.check
        assert check is not None
        poses = rsicalib.forward(known, calibration=result)
        mean = np.add.reduceat(poses, first, axis=0) / 8
        off = np.sqrt(np.mean((mean - known.poses[first])[:, :3] ** 2))
        # Mean of poses against pose of the mean reading: they differ by curvature times noise.
        assert off == pytest.approx(check.position_rms, rel=1e-3)


def test_without_a_calibration_poses_are_those_of_the_mechanism_as_declared() -> None:
    rest = rsicalib.load_readings(REST)
    offsets, gains = oracle.nominal(oracle.rsi())
    angles = (rest.values * gains + offsets).reshape(-1, 3, 3)
    # The oracle takes the wrists as they come; here readings are moved onto the closures first.
    handle = rsicalib.forward(rest)
    assert handle.shape == (8, 6)
    assert np.isfinite(handle).all()
    assert np.abs(handle[:, :3] - [0.0, 0.0, -2.666]).max() < 0.5
    assert angles.shape == (8, 3, 3)


def test_the_inverse_agrees_with_the_oracle_and_forward_with_the_inverse() -> None:
    rng = np.random.default_rng(3)
    poses = np.array([0, 0, -2.7, 0, 0, 0]) + rng.uniform(-0.3, 0.3, (20, 6))
    angles = rsicalib.inverse(poses)
    np.testing.assert_allclose(angles, oracle.rsi_inverse(poses).reshape(20, 9), atol=1e-10)
    mechanism = rsicalib.load_mechanism("rsi")
    np.testing.assert_allclose(rsicalib.inverse(poses, mechanism), angles, atol=1e-8)
    pairs = zip(angles.T, mechanism.channels, strict=True)
    counts = [(row - channel.offset) / channel.gain for row, channel in pairs]
    readings = rsicalib.Readings.from_arrays(mechanism, np.transpose(counts))
    np.testing.assert_allclose(rsicalib.forward(readings), poses, atol=1e-7)


def test_a_pose_out_of_reach_is_refused_by_its_row() -> None:
    with pytest.raises(
        InputError, match=r"^poses, row 2: found a pose out of reach.* arm. is"
    ) as told:
        rsicalib.inverse([[0, 0, -2.666, 0, 0, 0], [9, 0, -2.666, 0, 0, 0]])
    assert told.value.where is not None and told.value.where["line"] == 2


def test_a_fixture_names_the_pose_out_of_reach_as_its_file_does(tmp_path: Path) -> None:
    lines = CHECK.read_text(encoding="utf-8").splitlines()
    column = lines[0].split(",").index("x")
    label = lines[0].split(",").index("pose")
    rows = [line.split(",") for line in lines]
    for row in rows:
        if row[label] == "3":
            row[column] = "100"
    path = tmp_path / "far.csv"
    path.write_text("\n".join(map(",".join, rows)) + "\n", encoding="utf-8")
    first = next(k for k, row in enumerate(rows, 1) if row[label] == "3")
    with pytest.raises(InputError, match=r"pose 3 out of reach, .* arm1 is") as told:
        rsicalib.fixture(path)
    where = told.value.where
    assert where is not None and (where["file"], where["line"]) == (str(path), first)


def test_a_fixture_calibration_is_the_least_squares_line_of_each_channel() -> None:
    known = rsicalib.load_readings(CHECK)
    assert known.poses is not None
    found = rsicalib.fixture(known)
    counts = known.values.reshape(20, 8, 9).mean(axis=1)
    angles = oracle.rsi_inverse(known.poses[::8]).reshape(20, 9)
    for c, name in enumerate(known.channels):
        gain, offset = np.polyfit(counts[:, c], angles[:, c], 1)
        assert found["gain", name].value == pytest.approx(gain, rel=1e-9)
        assert found["offset", name].value == pytest.approx(offset, rel=1e-9)
    assert found.method == "fixture"
    assert found.exit_code == 0
    assert found.noise is not None and found.noise.kind == "fit"
    assert "count per sample (repeats, and scatter" in found.summary(width=200)


def test_the_noise_of_a_fixture_calibration_is_that_of_one_reading() -> None:
    """Numpy alone: how far samples are from a line through the means of their poses."""
    known = rsicalib.load_readings(CHECK)
    assert known.poses is not None
    found = rsicalib.fixture(known)
    assert found.noise is not None and found.noise.dof is not None
    angles = oracle.rsi_inverse(known.poses).reshape(-1, 9)
    for c, name in enumerate(known.channels):
        counts = known.values[:, c]
        means = (a.reshape(20, 8).mean(axis=1) for a in (counts, angles[:, c]))
        gain, offset = np.polyfit(*means, 1)
        off = counts - (angles[:, c] - offset) / gain
        # 160 samples know a standard deviation to 6 %; the scatter of the means is a third of it.
        assert found.noise.sigma[name] == pytest.approx(off.std(), rel=0.1)
    # As the calibration without known poses has it, of the same device on the same day.
    other = rsicalib.calibrate(READINGS).noise
    assert other is not None
    ratio = [found.noise.sigma[n] / other.sigma[n] for n in known.channels]
    assert np.median(ratio) == pytest.approx(1.0, abs=0.15)
    # a22 bends: what all samples of a pose share is of its readings, too.
    assert max(ratio) == ratio[known.channels.index("a22")] > 2.0
    assert found.noise.dof > 18


def test_a_fixture_calibration_says_which_poses_it_could_not_use() -> None:
    known = rsicalib.load_readings(CHECK)
    assert known.poses is not None
    assert "unused_poses" not in {w.kind for w in rsicalib.fixture(known).warnings}
    places = known.poses.copy()
    places[known.pose <= 3] = np.nan
    found = rsicalib.fixture(dataclasses.replace(known, poses=places))
    (warned,) = (w for w in found.warnings if w.kind == "unused_poses")
    assert "24 rows of 3 poses" in warned.text and "17 poses are" in warned.text


def test_a_fixture_calibration_with_too_few_poses_is_undetermined() -> None:
    known = rsicalib.load_readings(CHECK)
    found = rsicalib.fixture(known.select(known.pose == 1))
    assert found.verdict == "undetermined"
    assert found.exit_code == 3


def test_too_few_poses_are_an_outcome_and_not_an_exception() -> None:
    whole = rsicalib.load_readings(READINGS)
    few = whole.select((whole.pose <= 4) & (whole.sample == 1))
    for result in (rsicalib.calibrate(few, rest=REST), rsicalib.trace(few, rest=REST)):
        assert result.verdict == "undetermined"
        assert result.exit_code == 3
        assert "poses" in result.unobservable[0]
        json.loads(result.to_json())
        assert "Undetermined" in result.summary()


@pytest.mark.parametrize("poses", [4, 6])
def test_poses_that_leave_nothing_to_check_the_parameters_with_determine_nothing(
    poses: int,
) -> None:
    # 6 poses give 18 equations for 18 parameters: met exactly, and by other parameters too.
    whole = rsicalib.load_readings(READINGS)
    found = rsicalib.calibrate(whole.select(whole.pose <= poses), rest=REST)
    assert found.verdict == "undetermined"
    assert "record other poses" in found.unobservable[0]


def test_sessions_of_one_device_are_fitted_together() -> None:
    whole = rsicalib.load_readings(READINGS)
    halves = [whole.select(whole.pose <= 24), whole.select(whole.pose > 24)]
    together = rsicalib.calibrate(halves, rest=REST)
    one = rsicalib.calibrate(whole, rest=REST)
    assert together.readings.poses == 48
    assert len(together.readings.files) == 2
    np.testing.assert_allclose(together.values, one.values, rtol=1e-6)


def test_noise_is_declared_for_all_channels_or_by_name() -> None:
    one = rsicalib.calibrate(READINGS, rest=REST, noise=1.0)
    assert one.noise is not None
    assert one.noise.source == "declared"
    assert set(one.noise.sigma.values()) == {1.0}
    assert one.noise.dof is None
    names = [c.name for c in rsicalib.load_mechanism().channels]
    two = rsicalib.calibrate(READINGS, rest=REST, noise=dict.fromkeys(names, 1.0))
    np.testing.assert_array_equal(one.values, two.values)


@pytest.mark.parametrize(
    ("noise", "words"),
    [({"a11": 1.0}, "none for 'a12'"), ({"b1": 1.0}, "no channel 'b1'"), (0.0, "above 0")],
)
def test_noise_that_cannot_be_used_is_refused(noise: float | dict[str, float], words: str) -> None:
    with pytest.raises(InputError, match=words):
        rsicalib.calibrate(READINGS, noise=noise)


def test_an_earlier_result_says_what_has_moved(calibration: Calibration) -> None:
    same = rsicalib.calibrate(READINGS, rest=REST, calibration=calibration)
    assert same.moved == ()
    np.testing.assert_allclose(same.values, calibration.values, rtol=1e-7)
    whole = rsicalib.load_readings(READINGS)
    shifted = whole.values.copy()
    shifted[:, 0] += 40
    other = rsicalib.Readings.from_arrays(
        rsicalib.load_mechanism(), shifted, pose=whole.pose, time_s=whole.time_s
    )
    moved = rsicalib.calibrate(other, rest=REST, calibration=calibration).moved
    assert moved is not None
    assert [(m.term, m.target) for m in moved] == [("offset", "a11")]
    gain = calibration["gain", "a11"].value
    assert gain is not None
    assert moved[0].after - moved[0].before == pytest.approx(-40 * gain, abs=3 * moved[0].sd)


def test_an_earlier_trace_gives_its_terms_to_the_next_calibration(traced: Trace) -> None:
    found = rsicalib.calibrate(READINGS, rest=REST, calibration=traced)
    assert found.verdict == "adequate"
    assert {p.spec for p in found.parameters} == {p.spec for p in traced.parameters}


def test_a_calibration_of_another_mechanism_is_refused(calibration: Calibration) -> None:
    text = rsicalib.load_mechanism("rsi").to_toml().replace('name = "rsi"', 'name = "other"', 1)
    other = rsicalib.Mechanism.from_toml(text)
    with pytest.raises(InputError, match="expected one of 'other'"):
        rsicalib.forward(READINGS, other, calibration)


def test_a_file_that_is_no_result_is_refused(tmp_path: Path) -> None:
    path = tmp_path / "x.json"
    for text in ("[1]", "{", '{"format": "rsicalib.trace/1"}', '{"format": "else/1"}'):
        path.write_text(text)
        with pytest.raises(InputError, match=r"x\.json, .*: found"):
            rsicalib.load_calibration(path)


def test_known_poses_without_their_columns_are_refused() -> None:
    with pytest.raises(InputError, match="no columns x y z"):
        rsicalib.calibrate(READINGS, check=READINGS)


def test_known_poses_among_the_readings_are_ignored_and_said_to_be() -> None:
    found = rsicalib.calibrate(CHECK, rest=REST)
    assert "unused_poses" in {w.kind for w in found.warnings}


def test_a_term_that_does_not_exist_names_those_that_do() -> None:
    with pytest.raises(InputError, match="curvature"):
        rsicalib.calibrate(READINGS, terms=["offset", "curve"])


def test_the_paper_s_method_and_single_loops_can_be_asked_for(calibration: Calibration) -> None:
    paper = rsicalib.calibrate(READINGS, rest=REST, method="algebraic")
    assert paper.method == "algebraic"
    np.testing.assert_allclose(paper.values, calibration.values, rtol=0.05)
    two = rsicalib.calibrate(READINGS, rest=REST, closures=["wrist1-wrist2", "wrist2-wrist3"])
    assert two.after_residuals is not None and two.after_residuals.shape == (48, 2)


def test_every_name_of_the_package_is_there_and_listed_in_order() -> None:
    for name in rsicalib.__all__:
        assert hasattr(rsicalib, name)
    assert dir(rsicalib) == sorted(rsicalib.__all__)


def test_results_print_in_one_line(calibration: Calibration, traced: Trace) -> None:
    assert repr(calibration).count("\n") == 0
    assert "unexplained" in repr(calibration)
    assert "explained" in repr(traced)


def test_every_public_name_has_one_home_and_is_there() -> None:
    tree = ast.parse(Path(rsicalib.__file__).with_suffix(".pyi").read_text(encoding="utf-8"))
    typed = {
        alias.name: node.module
        for node in ast.walk(tree)
        if isinstance(node, ast.ImportFrom) and (node.module or "").startswith("rsicalib")
        for alias in node.names
    }
    homes = {name: module for module, names in rsicalib._HOMES.items() for name in names.split()}
    assert homes == typed
    assert sorted(homes) == sorted(rsicalib.__all__)
    for name, module in homes.items():
        assert getattr(rsicalib, name) is getattr(importlib.import_module(module), name)


def test_importing_the_package_imports_nothing_that_it_does_not_need_yet() -> None:
    code = "import sys, rsicalib; print(sorted({'numpy', 'rsicalib._core'} & set(sys.modules)))"
    out = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert out.stdout == "[]\n"
    with pytest.raises(AttributeError, match="no attribute 'calibrat'"):
        rsicalib.calibrat  # noqa: B018


def test_a_placer_gives_what_forward_gives_for_each_reading_alone(traced: Trace) -> None:
    readings = rsicalib.load_readings(READINGS).values[:20]
    placer = rsicalib.Placer(calibration=traced)
    assert placer.names == ("x", "y", "z", "rx", "ry", "rz")
    for row in readings:
        expected = rsicalib.forward(row[None], calibration=traced)[0]
        # Gains are about another reading: a few roundings.
        np.testing.assert_allclose(placer(row), expected, rtol=1e-11, atol=1e-13)
    with pytest.raises(rsicalib.InputError):
        placer(readings[0][:5])
    with pytest.raises(rsicalib.InputError):
        placer(np.full(9, 5000.0))  # beyond the range
    # A reading that was refused has left nothing behind.
    expected = rsicalib.forward(readings[:1], calibration=traced)[0]
    np.testing.assert_allclose(placer(readings[0]), expected, rtol=1e-11, atol=1e-13)


def test_a_placer_of_an_arm_gives_its_points() -> None:
    _, _, mechanism, readings = clean("sockets")
    placer = rsicalib.Placer(mechanism)
    expected = rsicalib.forward(readings, mechanism)
    assert all(name.endswith((".x", ".y", ".z")) for name in placer.names)
    found = np.array([placer(row) for row in readings.values])
    np.testing.assert_allclose(found, expected, rtol=1e-12)


def test_a_named_index_of_pandas_is_a_column() -> None:
    pandas = pytest.importorskip("pandas")
    frame = pandas.read_csv(READINGS)
    whole = rsicalib.load_readings(frame)
    indexed = rsicalib.load_readings(frame.set_index("pose"))
    np.testing.assert_array_equal(indexed.pose, whole.pose)
    assert indexed.held and whole.held
    twice = frame.set_index("pose", drop=False)
    with pytest.raises(rsicalib.InputError, match="pose"):
        rsicalib.load_readings(twice)


def public() -> Iterator[tuple[str, object]]:
    """Every public name, and the public names of classes."""
    for name in rsicalib.__all__:
        one = getattr(rsicalib, name)
        yield name, one
        for inner, value in inspect.getmembers(one) if inspect.isclass(one) else ():
            if not inner.startswith("_"):
                yield f"{name}.{inner}", value


def test_types_that_docstrings_name_can_be_imported() -> None:
    """Of what goes in, comes out and is held; `Where` and six others could not."""
    elsewhere = {"Axes", "DataFrame", "Generator", "None", "Path", "Self", "Table"}
    typed = re.compile(r"^(?:[a-z_, ]+ : (.*)|(?:Returns|Yields|Raises)\n-+\n(.*))$", re.M)
    for name, one in public():
        for words in typed.findall(inspect.getdoc(one) or ""):
            types = set(re.findall(r"\b[A-Z]\w+", "".join(words))) - elsewhere
            lost = {t for t in types if not hasattr(rsicalib, t) and not hasattr(builtins, t)}
            assert not lost, (name, words)


@pytest.mark.parametrize("true", [True, np.True_])
@pytest.mark.parametrize("kind", [list, lambda cells: np.array(cells, dtype=object)])
def test_a_truth_value_among_numbers_is_refused_where_it_stands(kind: Any, true: Any) -> None:
    mechanism = rsicalib.load_mechanism("rsi")
    columns: dict[str, Any] = {c.name: [100.0, 200.0, 300.0] for c in mechanism.channels}
    columns["a12"] = kind([100.0, true, 300.0])
    with pytest.raises(InputError) as refused:
        rsicalib.load_readings(columns, mechanism)
    assert refused.value.where is not None
    assert (refused.value.where["line"], refused.value.where["column"]) == (2, "a12")


def test_a_result_of_another_kind_is_refused_by_its_format() -> None:
    found = rsicalib.demo().to_dict()
    with pytest.raises(InputError, match=r"rsicalib\.trace/1.*rsicalib\.calibration/1"):
        rsicalib.Calibration.from_dict(found)


@pytest.mark.parametrize(
    ("change", "words"),
    [
        ({"covariance": [[1, 2], [3]]}, r"result, covariance: found 2 rows"),
        ({"parameters": "abc"}, r"result, parameters .*: found text"),
        ({"verdict": "foo"}, r"result, verdict .*: found unknown variant `foo`"),
        ({"note": object()}, r"found what is no value of JSON"),
    ],
)
def test_values_of_a_result_are_checked_as_its_file_is(
    traced: Trace, change: dict[str, Any], words: str
) -> None:
    with pytest.raises(InputError, match=words):
        Trace.from_dict({**traced.to_dict(), **change})


@pytest.mark.parametrize("given", [{}, None, 3])
def test_what_is_no_result_is_refused(given: Any) -> None:
    with pytest.raises(InputError, match=r"^result"):
        Trace.from_dict(given)


def test_errors_come_back_from_other_processes() -> None:
    for error in (ResultError("a", "b", "c"), InputError.at("f", "x", "y", line=3)):
        again = pickle.loads(pickle.dumps(error))
        assert str(again) == str(error) and vars(again) == vars(error)


def test_modules_that_are_documented_are_there_at_once() -> None:
    assert rsicalib.__getattr__("errors") is importlib.import_module("rsicalib.errors")
    with pytest.raises(AttributeError, match="no attribute 'erors'"):
        rsicalib.__getattr__("erors")
    assert rsicalib.InputTypeError is rsicalib.errors.InputTypeError


def test_a_date_may_be_one_of_numpy() -> None:
    given = {"2025-03-01": "D", "2025-03-01T10:30:00": "ns"}
    for text, unit in given.items():
        assert about(None, None, np.datetime64(text, unit))["valid_from"] == text
    with pytest.raises(InputError, match="date: found"):
        about(None, None, np.datetime64("NaT"))


def test_what_is_no_path_of_a_result_is_refused() -> None:
    with pytest.raises(rsicalib.InputTypeError, match="calibration: found None, expected the path"):
        rsicalib.load_calibration(None)  # type: ignore[arg-type]
