"""The guide: an operator whose hand shakes and who misses poses, a crash, and a real browser."""

from __future__ import annotations

import contextlib
import dataclasses
import json
import os
import re
import signal
import socket
import struct
import subprocess
import sys
import threading
import time
import urllib.error
import urllib.request
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import rsicalib
from rsicalib import InputError
from rsicalib.facts.warned import Warned
from rsicalib.guide.advice import Adviser, Repeat
from rsicalib.guide.hold import Hold, apart
from rsicalib.guide.log import Columns, Log, Sample, Taken
from rsicalib.guide.server import Page
from rsicalib.guide.session import RESTLESS_S, SAME
from rsicalib.guide.source import open_source
from rsicalib.guide.terminal import Screen, screen
from tests import oracle, person, trouble
from tests.blind import simulator
from tests.blind.simulator import Device
from tests.browser import CHROMIUM, needs_chromium
from tests.full import sized

CHANNELS = oracle.channel_names(oracle.rsi())
TARGET = 0.004


@pytest.fixture(scope="module")
def session(tmp_path_factory: pytest.TempPathFactory) -> tuple[person.Session, Any, Path]:
    """A whole session of a device with the curve of a sensor that nobody declared."""
    folder = tmp_path_factory.mktemp("guide") / "session"
    operator = person.drawn(sized(21, 3), "curvature", "a22")  # 10 poses, or 14
    taken, result = person.guided(operator, folder, TARGET)
    return taken, result, folder


def test_a_shaking_hand_that_misses_poses_reaches_the_target(
    session: tuple[person.Session, Any, Path],
) -> None:
    taken, result, folder = session
    state = taken.state()
    assert state["done"] and state["sd"] <= TARGET
    assert result.exit_code == 0
    named = [(s.target, [s.term, *(a.term for a in s.also_fits)]) for s in result.steps]
    assert [(target, "curvature" in terms) for target, terms in named] == [("a22", True)]
    assert json.loads((folder / "result.json").read_text())["format"] == "rsicalib.trace/1"


def test_poses_beyond_what_a_trace_needs_are_kept_out_and_check_the_closure(
    session: tuple[person.Session, Any, Path],
) -> None:
    taken, result, folder = session
    kept = rsicalib.load_readings(folder / "held_out.csv")
    fitted = rsicalib.load_readings(folder / "readings.csv")
    # 18 unknowns and 6 equations to spare need 8 poses of three closures; then one of four.
    assert set(kept.pose) == {k for k in taken.log.poses if k in (9, 13, 17, 21)} != set()
    assert not set(kept.pose) & set(fitted.pose)
    assert result.readings.poses == len(set(fitted.pose))
    state = taken.state()
    # By plain products of matrices, with the curve of a22: `(d² - l²) / 2l` is `d - l` to 0.2 %.
    off = np.array([result["offset", n].value for n in CHANNELS])
    gain = np.array([result["gain", n].value for n in CHANNELS])
    for name, readings in (("closure", kept), ("closure_fitted", fitted)):
        values = np.array(readings.values, dtype=np.float64)
        along = (values[:, 4] - 2047.5) / 2047.5
        values[:, 4] += result["curvature", "a22"].value * along**2 / gain[4]
        errors = oracle.misclosure(oracle.rsi(), off, gain, values) / (2 * 2.598)
        assert state[name] == pytest.approx(np.sqrt(np.mean(errors**2)), rel=5e-3)
    assert 0.3 < state["closure"] / state["closure_fitted"] < 3.0


def test_the_session_is_that_of_the_trace_of_its_files(
    session: tuple[person.Session, Any, Path],
) -> None:
    _, result, folder = session
    again = rsicalib.load_calibration(folder / "result.json")
    assert [p.value for p in again.parameters] == [p.value for p in result.parameters]
    samples = (folder / "samples.csv").read_text().splitlines()
    rows = {line.split(",", 1)[1] for line in samples[1:]}
    for name in ("readings", "held_out"):
        for line in (folder / f"{name}.csv").read_text().splitlines()[1:]:
            assert line.split(",", 3)[3] in rows


def test_the_result_is_made_again_from_the_session_alone(tmp_path: Path) -> None:
    """Of a device whose sensor knows from where it comes, and a hand that comes twice."""
    operator = person.drawn(5, "hysteresis", "a22")
    operator.shakes = (0.012, 0.006)
    session, result = person.guided(operator, tmp_path / "s", TARGET)
    assert result is not None
    assert session.log.passed  # places that no file of poses has, and from which others were taken
    rest = session.adviser.rest
    again = rsicalib.trace(tmp_path / "s" / "session.csv", session.mechanism, rest=rest)
    assert [s.spec for s in again.steps] == [s.spec for s in result.steps]
    assert [p.value for p in again.parameters] == [p.value for p in result.parameters]
    assert again.after.chi2 == result.after.chi2
    saved = rsicalib.load_calibration(tmp_path / "s" / "result.json")
    assert [p.value for p in saved.parameters] == [p.value for p in again.parameters]


def test_a_hand_that_trembles_at_a_place_has_been_there(tmp_path: Path) -> None:
    mechanism = rsicalib.load_mechanism("rsi")
    log = Log(tmp_path / "s", CHANNELS, False)
    session = person.Session(mechanism, Adviser(mechanism, None), log, person.Settings(TARGET))
    rng, clock = np.random.default_rng(1), 0.0

    def stand(level: float, tremor: float) -> None:
        nonlocal clock
        for _ in range(60):
            clock += 0.02
            values = np.round(level + tremor * rng.standard_normal(9))
            session.feed([Sample(clock, None, tuple(values))])

    stand(1500.0, 20.0)  # 16 counts are still
    stand(1560.0, 20.0)
    stand(2500.0, 1.0)
    session.finish()
    means = [np.mean([s.values for s in log.passed[k]]) for k in sorted(log.passed, reverse=True)]
    np.testing.assert_allclose(means, [1500.0, 1560.0], atol=15.0)


def test_two_kept_out_poses_check_an_effect_of_the_direction_of_approach() -> None:
    readings = rsicalib.load_readings(rsicalib.DEMO / "readings.csv")
    terms = ["offset", "gain", "hysteresis@a22"]
    result = rsicalib.calibrate(readings, rest=rsicalib.DEMO / "rest.csv", terms=terms)
    poses = {
        int(k): [Sample(float(k), None, tuple(row)) for row in readings.values[readings.pose == k]]
        for k in np.unique(readings.pose)
    }
    kept_out = {k: poses.pop(k) for k in (4, 8)}
    adviser = person.Adviser(rsicalib.load_mechanism("rsi"), None)
    fitted, kept = adviser._closures(result, Taken(poses, kept_out))
    assert fitted is not None and kept is not None
    # By plain products of matrices without the hysteresis, which is small: closures alike.
    off = np.array([result["offset", n].value for n in CHANNELS])
    gain = np.array([result["gain", n].value for n in CHANNELS])
    held = np.isin(readings.pose, (4, 8))
    plain = oracle.misclosure(oracle.rsi(), off, gain, readings.values[held]) / (2 * 2.598)
    assert kept == pytest.approx(np.sqrt(np.mean(plain**2)), rel=0.3)


def test_a_pose_that_was_taken_adds_nothing_again(tmp_path: Path) -> None:
    operator = person.drawn(5)
    mechanism = rsicalib.load_mechanism("rsi")
    log = Log(tmp_path / "o", CHANNELS, False)
    state = person.Session(mechanism, person.Adviser(mechanism, None), log, person.Settings(0.01))
    for moment, codes in operator.read(np.repeat(operator.at[None], 200, axis=0)):
        state.feed([Sample(moment, None, tuple(float(c) for c in codes))])
        while state.busy:
            state.poll()
            time.sleep(0.01)
    assert sorted(log.poses) == [1]
    assert "adds nothing" in state.state()["message"]
    # One order, and it is to go on: a hand that rests here is not asked to hold still.
    assert state.state()["phase"] == "move"
    assert state.state()["order"] == {"word": "go", "text": "to pose 2", "trouble": None}
    assert state.state()["troubles"] == []
    before = state.state()["pose"]
    wanted = np.array([bar["want"] for bar in state.state()["channels"]])
    taken = np.mean([s.values for s in log.poses[1]], axis=0)
    assert apart(wanted, taken, state.spans) > SAME  # what is asked for can be taken
    state.strike_off()
    while state.busy:
        state.poll()
        time.sleep(0.01)
    assert not np.allclose(state.state()["pose"], before, atol=1e-3)
    state.finish()


def troubles(state: person.Session) -> set[tuple[str, str | None]]:
    """What is wrong, and with which channel."""
    return {(trouble["kind"], trouble["target"]) for trouble in state.state()["troubles"]}


def test_a_lost_channel_and_the_end_of_a_range_are_said(tmp_path: Path) -> None:
    operator = person.drawn(6)
    operator.lost = 4
    mechanism = rsicalib.load_mechanism("rsi")
    log = Log(tmp_path / "o", CHANNELS, False)
    state = person.Session(mechanism, person.Adviser(mechanism, None), log, person.Settings(0.01))
    assert state.state()["phase"] in ("think", "wait") and not state.state()["troubles"]
    way = np.array(oracle.REST) + np.linspace(0, 1, 80)[:, None] * [1.5, 0.5, -0.8, 0.2, 0.3, 0.2]
    for moment, codes in operator.read(way):
        state.feed([Sample(moment, None, tuple(float(c) for c in codes))])
    assert ("constant", "a22") in troubles(state)
    end = tuple(4095.0 if k == 2 else 2000.0 + k for k in range(9))
    for k in range(60):
        state.feed([Sample(100.0 + 0.1 * k, None, end)])
    assert ("end_of_range", "a13") in troubles(state)
    assert not log.poses  # a dead zone is no reading
    state.finish()


# Wires that come off before pose 4, and in full before pose 8, where the handle stands still.
# The exchanged wires are those of the whole session below, which demands an earlier word; those
# that are reversed are named by the same comparison of fits, in few poses below.
WRONG = [
    ("dead_zone", 1),
    ("lost", 4),
    *sized([], [("reversed", 1), ("exchanged", 1), ("lost", 1)]),
]


@pytest.mark.parametrize(("kind", "number"), WRONG)
def test_what_is_wrong_with_a_channel_is_said_while_it_can_be_repeated(
    kind: str, number: int
) -> None:
    """`python -m tests.trouble` counts more of them; its figures are in docs/verbs-measured.md."""
    told = trouble.session(trouble.drawn(kind, (20261122, number)), to_the_end=False)
    assert told.right is not None and told.right <= 16


def test_exchanged_wires_are_taken_over_and_the_poses_so_far_are_of_use(tmp_path: Path) -> None:
    operator = trouble.drawn("exchanged", (20261122, 1))
    wrong = operator.trouble
    assert isinstance(wrong, trouble.Exchanged)
    both = tuple(sorted((wrong.name, CHANNELS[wrong.other])))
    pressed: list[int] = []
    taken, result = person.guided(operator, tmp_path / "o", TARGET, most=24, take_over=pressed)
    assert len(pressed) == 1 and pressed[0] <= 12
    shown = taken.state()
    assert shown["done"] and shown["order"]["word"] == "done" and shown["exchanged"] is None
    assert taken.log.exchanged == [both]
    assert result is not None and result.exit_code == 0
    # Poses from before and after are one session, in the right columns.
    assert min(taken.log.poses) < pressed[0] < max(taken.log.poses)
    again = rsicalib.load_readings(tmp_path / "o" / "readings.csv")
    assert rsicalib.trace(again).verdict == result.verdict
    assert person.truth_error(operator, result) < 3 * TARGET


def test_an_exchange_is_not_lost_when_the_program_is_killed_in_the_middle_of_it(
    tmp_path: Path,
) -> None:
    log = Log(tmp_path, CHANNELS, False)
    first = Sample(0.0, None, tuple(map(float, range(9))))
    log.take([first])
    log.pose(1, [first, first])
    before = (tmp_path / "readings.csv").read_text()
    log.exchange("a11", "a23")
    log.exchange("a11", "a12")
    arrived = log.named(Sample(1.0, None, first.values))
    log.take([arrived])
    log.close()
    # What arrives first is a23's, what arrives second a11's, what arrives sixth a12's.
    assert log.samples[0].values == arrived.values == (1.0, 5.0, 2.0, 3.0, 4.0, 0.0, 6.0, 7.0, 8.0)
    (tmp_path / "readings.csv").write_text(before)  # not reached yet
    back = Log(tmp_path, CHANNELS, True)
    assert back.samples == log.samples and back.poses == log.poses
    assert back.named(first).values == arrived.values
    back.close()
    found = rsicalib.load_readings(tmp_path / "readings.csv").values[0]
    assert tuple(found) == arrived.values


def test_a_slip_is_said_with_its_channel() -> None:
    operator = trouble.drawn("slipped", (20261122, sized(1, 2)))
    # 40 mrad are 26 counts of noise 1: it cannot hide once three poses on either side see it.
    operator.trouble = trouble.Slipped(4, 6, 0.04)
    told = trouble.session(operator)
    assert told.right is not None and told.right >= 6


def test_a_pose_in_which_an_arm_was_pushed_is_measured_again(tmp_path: Path) -> None:
    operator = trouble.drawn("leant", (20261122, 3))
    operator.trouble = trouble.Leant(4, 5, 0.15)
    taken, result = person.guided(operator, tmp_path / "o", TARGET, most=24)
    assert any(map(operator.trouble.said, operator.said))
    assert taken.state()["done"] and 5 not in taken.log.poses
    assert result is not None and result.exit_code == 0 and not result.excluded
    assert taken.state()["order"]["word"] == "done"


def test_nothing_is_done_while_something_is_wrong(
    session: tuple[person.Session, Any, Path],
) -> None:
    taken = session[0]
    assert taken.state()["order"]["word"] == "done"
    assert taken.advice is not None and taken.advice.result is not None
    advice = taken.advice
    try:
        bad = dataclasses.replace(advice.result, verdict="unexplained")
        taken.advice = dataclasses.replace(advice, result=bad)
        assert taken.state()["order"]["word"] == "stop"
        taken.advice = dataclasses.replace(advice, result=None)
        assert taken.state()["order"]["word"] == "stop"
        taken.advice, taken.done, taken.ended = advice, False, "the samples have ended"
        stop = {"word": "stop", "text": "the samples have ended", "trouble": "ended"}
        assert taken.state()["order"] == stop
        taken.ended, taken._heard = None, taken._heard - 100.0
        assert taken.state()["order"]["word"] == "wait"
        # 100 s, and what it took from the session to here.
        assert re.match(r"no sample for \d{3,} s", taken.state()["order"]["text"])
    finally:
        taken.advice, taken.done, taken.ended = advice, True, None


@pytest.mark.parametrize("line", ["?", "again", "range", ""])
def test_a_line_that_cannot_be_read_hides_no_trouble(
    session: tuple[person.Session, Any, Path], line: str
) -> None:
    """Whatever stands in it: what was wrong was once told from it by the end of its sentence."""
    taken = session[0]
    advice = taken.advice
    assert advice is not None
    try:
        taken.bad_lines, taken.bad_line = 1, line
        assert taken.state()["order"]["word"] == "done"  # it has changed nothing
        gap = Warned("gap", "a22", f"the gap of a22 lies within its {line}")
        taken.advice = dataclasses.replace(advice, troubles=(gap,))
        order = taken.state()["order"]
        assert (order["word"], order["trouble"]) == ("stop", "gap@a22")
        assert {t["id"] for t in taken.state()["troubles"]} == {"gap@a22", "bad_lines"}
    finally:
        taken.advice, taken.bad_lines, taken.bad_line = advice, 0, ""


def test_a_pose_that_is_asked_for_once_more_is_shown(
    session: tuple[person.Session, Any, Path],
) -> None:
    taken = session[0]
    advice = taken.advice
    assert advice is not None
    try:
        taken.advice = dataclasses.replace(advice, repeat=(Repeat(6, "does not fit"),))
        taken.done = False
        shown = taken.state()
        assert shown["repeat"] == 6
        expected = rsicalib.forward(taken._means[6][None], calibration=advice.result)[0]
        np.testing.assert_allclose(shown["pose"], expected, atol=1e-9)
        assert shown["handle"]["moves"] is not None
        assert [bar["want"] for bar in shown["channels"]] == taken._means[6].tolist()
    finally:
        taken.advice, taken.done = advice, True


def few_poses(seed: int, poses: int, kind: str | None = None) -> tuple[Warned | None, Any]:
    """What is said of the wires of a random device in few poses, and what is wrong with them."""
    rng = np.random.default_rng([seed, poses])
    device = Device.random(rng)
    wrong = trouble.KINDS[kind](rng, device) if kind else None
    at = simulator.hand_poses(rng, poses, device)
    session = simulator.session(device, rng, at, 8, tremor=(0.004, 0.002))
    values, rest = session["values"], simulator.rest(device, rng)["values"]
    if wrong is not None:
        values, rest = wrong.codes(values, 1), wrong.codes(rest, 0)
    fitted: dict[int, list[Sample]] = {}
    for label, time_s, row in zip(session["pose"], session["time_s"], values, strict=True):
        fitted.setdefault(int(label), []).append(
            Sample(float(time_s), None, tuple(map(float, row)))
        )
    mechanism = rsicalib.load_mechanism("rsi")
    adviser = Adviser(mechanism, rsicalib.Readings.from_arrays(mechanism, rest))
    return adviser._mistake(adviser.readings(Taken(fitted))), wrong


@pytest.mark.parametrize("poses", sized([2, 3, 7], [2, 3, 6, 7, 9, 12]))
def test_wires_that_are_right_are_never_blamed(poses: int) -> None:
    """45 sessions in all, or 240: with nothing to blame them by, with little, and with enough."""
    sessions = sized(15, 40)
    assert [few_poses(seed, poses)[0] for seed in range(sessions)] == [None] * sessions


@pytest.mark.parametrize("kind", ["exchanged", "reversed"])
@pytest.mark.parametrize("poses", [6, 8])
def test_wires_that_are_wrong_are_named_from_six_poses(kind: str, poses: int) -> None:
    for seed in range(sized(1, 3)):
        said, wrong = few_poses(seed, poses, kind)
        assert said is not None and wrong.said(said.text)


def test_a_hand_that_shakes_is_still_and_a_hand_that_moves_is_not() -> None:
    rng = np.random.default_rng(2)
    hold = Hold(np.full(9, 4095.0), 8, 0.5)
    for k in range(40):
        hold.feed(Sample(0.02 * k, None, tuple(2000 + 6 * rng.standard_normal(9))))
    assert hold.progress == 1.0 and len(hold.taken()) == 8
    for k in range(40, 80):
        hold.feed(Sample(0.02 * k, None, tuple(2000 + 12.0 * (k - 40) * np.ones(9))))
    assert hold.progress < 0.5


def test_of_an_arm_that_touches_the_way_there_and_back_is_no_part_of_the_pose() -> None:
    rng = np.random.default_rng(2)
    hold = Hold(np.full(6, 6.2), 8, 0.5, closed=False)
    seen = []
    for k in range(600):  # 1.2 s on the way, which ends and begins slowly, 1.2 s at rest
        at, turn = divmod(k, 120)
        ease = 0.5 - 0.5 * np.cos(np.pi * min(turn / 60, 1))
        values = at + ease + rng.normal(0, 2e-5, 6)
        hold.feed(Sample(0.02 * k, None, tuple(values)))
        if hold.progress == 1.0 and at > 0:
            seen.append(np.ptp([sample.values for sample in hold.taken()], axis=0).max())
    # 0.7 s of four rests of 1.2 s; the way from one to the next is 1 rad
    assert 120 <= len(seen) <= 144 and max(seen) < 8 * 2e-5


def test_samples_that_come_once_a_second_are_held_too() -> None:
    rng = np.random.default_rng(3)
    hold = Hold(np.full(6, 6.2), 8, 0.6, closed=False)
    for k in range(30):
        hold.feed(Sample(1.0 * k, None, tuple(max(0, 10 - k) + rng.normal(0, 1e-3, 6))))
    assert hold.progress == 1.0
    assert np.ptp([sample.values for sample in hold.taken()], axis=0).max() < 0.01


def test_an_arm_that_trembles_at_what_it_touches_is_taken_when_held_longer() -> None:
    hold = Hold(np.full(6, 6.2), 8, 0.5, closed=False)
    for k in range(100):
        hold.feed(Sample(0.02 * k, None, tuple(5e-3 * np.sin(0.3 * k + np.arange(6)))))
        assert k < 75 or hold.progress == 1.0
        assert k > 74 or hold.progress < 1.0


@pytest.mark.parametrize("seed", sized([4], [4, 12]))
def test_who_shakes_and_sees_the_page_alone_is_done_in_few_poses(seed: int, tmp_path: Path) -> None:
    """Small form of `python -m tests.person --tremor`; figures in docs/verbs-measured.md."""
    operator = person.drawn(seed)
    operator.shakes = (0.016, 0.008)  # near a stretched arm some 60 counts
    taken, result = person.guided(operator, tmp_path / "o", 0.003)
    assert taken.state()["done"] and not operator.stalled
    # Nine are enough for a hand that is steady; one pose in three may have to be chosen anew.
    assert len(taken.log.poses) <= 16
    assert result is not None and result.exit_code == 0
    claimed = taken.state()["largest"]
    # The bound holds in 95 of 100; twice as much is not met with the seeds of a test.
    assert claimed is not None and person.largest_error(operator, result) < 2.0 * claimed


def test_a_channel_that_reads_the_same_in_all_poses_stops_the_session(tmp_path: Path) -> None:
    operator = person.drawn(6)
    mechanism = rsicalib.load_mechanism("rsi")
    rng = np.random.default_rng(1)
    poses = [np.repeat(p[None], 8, axis=0) for p in person.wide_poses(rng, operator.device, 3)]
    for lost, word in ((None, "go"), (4, "stop")):
        operator.lost = lost
        log = Log(tmp_path / word, CHANNELS, False)
        adviser = person.Adviser(mechanism, None)
        state = person.Session(mechanism, adviser, log, person.Settings(0.01))
        for held in poses:
            rows = operator.read(held)
            state.arrive([Sample(t, None, tuple(float(c) for c in codes)) for t, codes in rows])
        while state.busy:
            state.poll()
            time.sleep(0.01)
        order = state.state()["order"]
        assert order["word"] == word, order
        assert ("a22 has read the same" in order["text"]) == (lost is not None)
        assert screen(state.state())[0].startswith("STOP") == (lost is not None)
        state.finish()


def test_a_hand_that_cannot_be_still_near_its_pose_is_borne_with(tmp_path: Path) -> None:
    """The limit is loosened for this pose, by the tremor that is there; elsewhere it is as ever."""
    mechanism = rsicalib.load_mechanism("rsi")
    log = Log(tmp_path / "o", CHANNELS, False)
    state = person.Session(mechanism, person.Adviser(mechanism, None), log, person.Settings(0.01))
    while state.busy:
        state.poll()
        time.sleep(0.01)
    goal = state.goal()
    assert goal is not None
    rng, usual = np.random.default_rng(5), state.hold.loose.copy()
    said = set()
    for k in range(1000):
        row = goal + 5.0 * rng.standard_normal(9)
        row[1] += 35.0 * rng.standard_normal()  # the elbow, beyond 16 counts
        state.feed([Sample(0.02 * k, None, tuple(row))])
        said.add(state.state()["order"]["text"])
        if log.poses:
            break
    assert sorted(log.poses) == [1]
    assert log.poses[1][-1].time_s > RESTLESS_S  # until then it could have been a motion
    assert any("a12 shakes" in text for text in said)
    np.testing.assert_array_equal(state.hold.loose, usual)
    state.finish()


def test_lines_that_cannot_be_read_are_told_from_samples() -> None:
    columns = Columns(CHANNELS)
    assert "no header" in str(columns.sample("1,2,3", 0.0))
    assert columns.sample("time_s," + ",".join(CHANNELS), 0.0) is None
    good = columns.sample("1.5," + ",".join(["7"] * 9), 0.0)
    assert good == Sample(1.5, None, (7.0,) * 9)
    assert "no number" in str(columns.sample("1.5," + ",".join(["x"] * 9), 0.0))
    assert "columns" in str(columns.sample("1,2", 0.0))
    assert "not a number" in str(columns.sample("1.5," + ",".join(["nan"] * 9), 0.0))


def test_messages_are_samples_in_any_order_of_names() -> None:
    columns = Columns(CHANNELS)
    values = [float(k) for k in range(9)]
    good = Sample(12.5, None, tuple(values))
    flat = {"time_s": 12.5, **dict(zip(CHANNELS, values, strict=True)), "state": {"ok": True}}
    assert columns.sample(json.dumps(flat), 0.0) == good
    state = {
        "header": {"stamp": {"sec": 12, "nanosec": 500_000_000}, "frame_id": ""},
        "name": [*reversed(CHANNELS), "finger"],
        "position": [*reversed(values), 0.4],
    }
    assert columns.sample(json.dumps(state), 0.0) == good
    for change, words in (
        ({"position": values}, "10 names and 9 positions"),
        ({"name": [*CHANNELS, "a11"]}, "expected one of each"),
        ({"name": [*CHANNELS[1:], "b", "c"]}, f"no {CHANNELS[0]}"),
        ({"position": [True, *values]}, "no a33"),
        ({"header": {"stamp": {"sec": "soon"}}}, "no time"),
        ({"position": [float("nan"), *values]}, "not a number"),
    ):
        assert words in str(columns.sample(json.dumps({**state, **change}), 0.0))
    assert "no JSON" in str(columns.sample('{"a11": 1.0', 0.0))
    bare = {**state, "header": "none"}
    assert columns.sample(json.dumps(bare), 3.0) == Sample(3.0, None, tuple(values))


def test_half_a_line_is_dropped_and_half_a_pose_is_taken_again(tmp_path: Path) -> None:
    log = Log(tmp_path, CHANNELS, False)
    rows = [Sample(float(k), 21.0, tuple(float(k + c) for c in range(9))) for k in range(12)]
    log.take(rows)
    log.pose(1, rows[:4])
    log.pose(2, rows[4:8])
    log.pose(3, rows[8:])
    log.close()
    for name in ("samples", "readings"):
        text = (tmp_path / f"{name}.csv").read_text()
        (tmp_path / f"{name}.csv").write_text(text[:-5])
    with pytest.raises(InputError, match="--resume"):
        Log(tmp_path, CHANNELS, False)
    again = Log(tmp_path, CHANNELS, True)
    assert again.samples == rows[:11]
    assert again.poses == {1: rows[:4], 2: rows[4:8]}
    again.pose(3, rows[7:11])
    again.close()
    assert len((tmp_path / "readings.csv").read_text().splitlines()) == 13


def test_a_file_that_grows_is_read_line_by_line(tmp_path: Path) -> None:
    path = tmp_path / "growing.csv"
    path.write_text("a,b\n1,")
    lines = open_source(str(path))
    assert lines.take(2.0) == ["a,b\n"]
    with path.open("a") as file:
        file.write("2\n3,4\n")
    found: list[str] = []
    for _ in range(50):
        found += lines.take(0.1)
        if len(found) == 2:
            break
    assert found == ["1,2\n", "3,4\n"]
    lines.close()
    with pytest.raises(InputError, match="a file or a command"):
        open_source("no-such-command-anywhere --x")


def test_a_command_that_writes_nothing_more_is_ended_with_the_session() -> None:
    waiting = "import time; print(1, flush=True); time.sleep(100)"
    lines = open_source(f'"{sys.executable}" -c "{waiting}"')
    assert lines.take(30.0) == ["1\n"] and not lines.ended
    lines.close()
    assert lines.take(10.0) == [] and lines.ended  # its end of the pipe is closed


def test_the_page_answers_to_this_machine_alone() -> None:
    struck: list[int] = []
    page = Page(
        lambda: {"done": False, "note": "</script>"}, {"strike-off": lambda: struck.append(1)}
    )
    try:
        assert page.url.startswith("http://127.0.0.1:")
        with urllib.request.urlopen(page.url) as answer:
            body = answer.read()
        assert b'fetch("state"' in body and body.count(b"</script>") == 1
        foreign = urllib.request.Request(page.url + "state", headers={"Host": "evil.example"})
        with pytest.raises(urllib.error.HTTPError, match="403"):
            urllib.request.urlopen(foreign)
        plain = urllib.request.Request(page.url + "strike-off", method="POST")
        with pytest.raises(urllib.error.HTTPError, match="404"):
            urllib.request.urlopen(plain)
        ours = urllib.request.Request(
            page.url + "strike-off", method="POST", headers={"X-Guide": "1"}
        )
        urllib.request.urlopen(ours)
        assert struck == [1]
        with urllib.request.urlopen(page.url + "state") as answer:
            assert json.load(answer)["done"] is False
    finally:
        page.close()


def test_another_address_answers_to_who_has_the_token() -> None:
    """127.0.0.2 is no other machine, and is treated as one."""
    page = Page(lambda: {"done": False}, {}, host="127.0.0.2")
    try:
        bare, token = page.url[:-1].rsplit("/", 1)
        assert len(token) >= 16
        with urllib.request.urlopen(page.url + "state") as answer:
            assert json.load(answer) == {"done": False}
        for path in ("", "/", "/state", f"/{token[:-1]}/state", "/%C3%A9", f"/{token}"):
            with pytest.raises(urllib.error.HTTPError, match=r"40[34]"):
                urllib.request.urlopen(bare + path)
    finally:
        page.close()


def test_a_page_that_is_closed_prints_nothing(capfd: pytest.CaptureFixture[str]) -> None:
    page = Page(lambda: {"long": "x" * 10_000_000}, {})
    try:
        host, port = page.url.split("/")[2].split(":")
        for _ in range(8):  # as many tabs, none of which reads its answer
            with socket.create_connection((host, int(port))) as tab:
                tab.sendall(b"GET /state HTTP/1.1\r\nHost: 127.0.0.1\r\n\r\n")
                tab.setsockopt(socket.SOL_SOCKET, socket.SO_LINGER, struct.pack("ii", 1, 0))
        with urllib.request.urlopen(page.url, timeout=5.0) as answer:
            assert answer.status == 200
        time.sleep(0.2)
    finally:
        page.close()
    assert capfd.readouterr() == ("", "")


def test_the_terminal_shows_the_same(
    session: tuple[person.Session, Any, Path], capsys: pytest.CaptureFixture[str]
) -> None:
    state = session[0].state()
    assert any("#####" in line for line in screen(state))
    state = state | {"done": False, "phase": "move"}
    lines = screen(state)
    assert lines[0].startswith("Go to pose")
    assert sum(line.startswith(tuple(CHANNELS)) for line in lines) == 9
    Screen(sys.stdout).show(state | {"done": True})
    assert "DONE" in capsys.readouterr().out


class Served:
    """The command with its page, and an operator who reads the page and writes to its input."""

    def __init__(self, folder: Path, operator: person.Operator, *more: str) -> None:
        self.folder = folder
        self.operator = operator
        rest = folder.parent / "rest.csv"
        if not rest.exists():
            rest.write_text("\n".join(person.rest_lines(operator)) + "\n")
        command = [sys.executable, "-m", "rsicalib", "guide", "--rest", str(rest), "--json"]
        command += ["--out", str(folder), "--target", str(TARGET), "--no-browser", *more]
        self.process = subprocess.Popen(
            command,
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            stderr=subprocess.PIPE,
            text=True,
            env={**os.environ, "RAYON_NUM_THREADS": "1"},
        )
        assert self.process.stderr is not None
        self.url = self.process.stderr.readline().split()[-1]
        self.said: list[str] = []
        self._listener = threading.Thread(target=self._listen, daemon=True)
        self._listener.start()

    def _listen(self) -> None:
        assert self.process.stderr is not None
        self.said += self.process.stderr

    def kill(self) -> None:
        """As a power cut would end it."""
        self.process.send_signal(signal.SIGKILL)
        self.close()

    def close(self) -> str:
        """What was printed, once it has ended."""
        assert self.process.stdout is not None and self.process.stdin is not None
        out = self.process.stdout.read()
        self.process.wait(timeout=60)
        self._listener.join()
        for pipe in (self.process.stdin, self.process.stdout, self.process.stderr):
            assert pipe is not None
            with contextlib.suppress(BrokenPipeError):
                pipe.close()
        return out

    def write(self, line: str) -> None:
        assert self.process.stdin is not None
        self.process.stdin.write(line + "\n")
        self.process.stdin.flush()

    def state(self) -> dict[str, Any]:
        try:
            return person.page_state(self.url)
        except OSError:
            return {"done": True}

    def operate(self, until: Callable[[dict[str, Any]], bool] = lambda state: False) -> None:
        def state() -> dict[str, Any]:
            found = self.state()
            return found | {"done": found["done"] or until(found)}

        person.operate(
            self.operator, state, self.write, lambda: person.strike_off(self.url), patience_s=30.0
        )


def test_kill_9_and_resume_lose_nothing(tmp_path: Path) -> None:
    operator = person.drawn(8)
    first = Served(tmp_path / "o", operator)
    first.operate(until=lambda s: s["taken"] >= 4)
    seen = first.state()
    first.kill()
    lines = (tmp_path / "o" / "samples.csv").read_text().splitlines()
    assert len(lines) - 1 >= seen["samples"]
    second = Served(tmp_path / "o", operator, "--resume")
    assert second.state()["taken"] >= seen["taken"]
    assert second.state()["samples"] >= seen["samples"]
    second.operate()
    told = json.loads(second.close())
    assert second.process.returncode == 0
    assert told["verdict"] in ("adequate", "explained")
    labels = [
        int(line.split(",")[0])
        for name in ("readings", "held_out")
        for line in (tmp_path / "o" / f"{name}.csv").read_text().splitlines()[1:]
    ]
    counts = {k: labels.count(k) for k in labels}
    assert sorted(counts) == list(range(1, max(counts) + 1))
    assert set(counts.values()) == {8}


@needs_chromium
def test_a_browser_shows_the_session(tmp_path: Path) -> None:
    assert CHROMIUM is not None
    served = Served(tmp_path / "o", person.drawn(3, "curvature", "a22"))
    served.operate(until=lambda s: s["taken"] >= 2 and s["pose"] is not None)
    shown = served.state()
    dom = _in_browser(CHROMIUM, served.url, tmp_path)
    assert f'<strong id="taken">{shown["taken"]}</strong>' in dom
    body = dom.split("<script>")[0]
    assert body.count('class="track"') == 9
    assert "Waiting for samples" not in body
    served.kill()


def _in_browser(chromium: str, url: str, folder: Path) -> str:
    """What a real browser makes of the page: a busy machine may need more than three seconds."""
    for seconds in (3, 10, 30):
        command = [chromium, "--headless", "--no-sandbox", "--disable-gpu"]
        command += [f"--timeout={1000 * seconds}", f"--user-data-dir={folder / 'profile'}"]
        command += ["--dump-dom", url]
        run = subprocess.run(command, capture_output=True, text=True, timeout=60 + seconds)
        if run.stdout:
            break
    return run.stdout


def test_a_mechanism_without_a_platform_and_targets_that_mean_nothing_are_refused(
    tmp_path: Path,
) -> None:
    from rsicalib.guide.run import guide

    with pytest.raises(InputError, match="target: found 0"):
        guide(tmp_path / "a", target=0.0, source="true")
    drawing = oracle.rsi()
    drawing.pop("platform", None)
    bare = rsicalib._core.Mechanism.from_dict(rsicalib.facts.records.plain(drawing))
    with pytest.raises(InputError, match="without a platform"):
        guide(tmp_path / "b", bare, source="true")


def test_a_source_without_a_sample_is_refused(tmp_path: Path) -> None:
    """Its lines were counted, and the poses blamed."""
    from rsicalib.guide.run import guide

    (tmp_path / "bare.csv").write_text("1,2,3,4,5,6,7,8,9\n" * 5, encoding="utf-8")
    with pytest.raises(InputError, match=r"found 5 lines and no sample \(found no header with the"):
        guide(tmp_path / "o", source=f"cat {tmp_path / 'bare.csv'}", port=None, browser=False)


def test_a_source_that_ends_early_determines_nothing(tmp_path: Path) -> None:
    run = subprocess.run(
        [sys.executable, "-m", "rsicalib", "guide", "--out", str(tmp_path / "o"), "--no-browser"],
        input="time_s," + ",".join(CHANNELS) + "\n",
        capture_output=True,
        text=True,
        timeout=60,
    )
    assert run.returncode == 3 and "do not determine" in run.stderr


def test_an_address_of_another_machine_is_named_by_its_option() -> None:
    with pytest.raises(InputError, match=r"^--host: found 192\.0\.2\.1 .* address of this machine"):
        Page(lambda: {}, {}, host="192.0.2.1")
