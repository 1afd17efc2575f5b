"""Logs of other programs become readings, or are refused with the place; nothing is repaired."""

from __future__ import annotations

import re
import tomllib
from pathlib import Path

import numpy as np
import pytest

import rsicalib
from rsicalib import InputError
from rsicalib._core import still_stretches
from rsicalib.imports.kinds import format_of
from rsicalib.io.extras import EXTRAS
from tests import cone
from tests.commands import run_text

# ------------------------------------------------------------------ Maslow4


def sled(width: float = 3000.0, height: float = 2100.0) -> np.ndarray:
    """Belt lengths tl, tr, bl, br at 25 positions, in plain distances."""
    x, y = np.meshgrid(np.linspace(0.3, 0.7, 5) * width, np.linspace(0.3, 0.7, 5) * height)
    anchors = [(0.0, height), (width, height), (0.0, 0.0), (width, 0.0)]
    return np.column_stack([np.hypot(x - u, y - v).ravel() for u, v in anchors])


def clbm(lengths: np.ndarray) -> str:
    """A list as the firmware prints it."""
    objects = "".join(
        f"{{bl:{bl:.2f},   br:{br:.2f},   tr:{tr:.2f},   tl:{tl:.2f}}},"
        for tl, tr, bl, br in lengths
    )
    return f"CLBM:[{objects}]"


TALK = "[MSG:INFO: Measured waypoint 0]\n<Idle|MPos:0.000,0.000,0.000>\n"


def test_a_serial_log_of_a_maslow_becomes_poses_and_a_mechanism(tmp_path: Path) -> None:
    path = tmp_path / "Maslow-serial.log"
    path.write_text(f"{TALK}{clbm(sled())}\n[MSG:INFO: Requesting state change]\n")
    log = rsicalib.import_log(path)
    (session,) = log.sessions
    assert list(session.columns) == ["pose", "sample", "tl", "tr", "bl", "br"]
    belts = np.column_stack([session.columns[name] for name in ("tl", "tr", "bl", "br")])
    assert np.abs(belts - sled()).max() < 0.006  # the log has two decimals
    assert log.mechanism is not None
    mechanism = tomllib.loads(log.mechanism)
    assert [c["channel"] for c in mechanism["closure"]] == ["tl", "tr", "bl", "br"]
    corner = next(p for p in mechanism["point"] if p["name"] == "top right")
    # the grid on which the rectangle is looked for has steps of a hundredth of the longest belt
    assert np.abs(np.array(corner["at"][:2]) - [3000.0, 2100.0]).max() < 0.01 * belts.max()


def test_an_object_a_line_in_any_order_with_repeats_and_results_is_read(tmp_path: Path) -> None:
    rng = np.random.default_rng(0)
    text = "10X Calibration Test\n\n"
    for run in (1, 2):
        text += f"Run {run}:\n\n"
        for tl, tr, bl, br in sled():
            for _ in range(4):
                a, b, c, d = np.array([tl, tr, bl, br]) + rng.normal(0.0, 0.2, 4)
                text += f" {{tr:{b:.3f}, tl:{a:.3f},bl:{c:.3f},  br:{d:.3f}, }},\n"
        text += "\n(0.43, 2142.99), (3023.24, 2145.31)\n (0, 0), (3030.48, 0)\n\n"
    path = tmp_path / "test.txt"
    path.write_text(text)
    log = rsicalib.import_log(path)
    assert [(len(s), s.n_poses, s.name) for s in log.sessions] == [
        (100, 25, "run 1"),
        (100, 25, "run 2"),
    ]
    points = {p["name"]: p["at"] for p in tomllib.loads(log.mechanism or "")["point"]}
    assert points["top right"] == [3023.24, 2145.31, 56.0]
    assert points["bottom right"] == [3030.48, 0.0, 78.0]


def test_a_list_that_the_firmware_prints_again_when_it_has_more_counts_once(tmp_path: Path) -> None:
    path = tmp_path / "serial.log"
    path.write_text(f"{clbm(sled()[:9])}\n{TALK}{clbm(sled())}\n")
    log = rsicalib.import_log(path)
    assert [len(s) for s in log.sessions] == [25]
    assert any("a longer one repeats" in finding for finding in log.findings)


LOST = {
    "tr4.37,   ": "'tr4.37'",  # characters lost on the line, as logs of owners have them
    "": "no tr",
    "tr:527.87, tr:1.00,": "tr twice",
    "tr:5x7.87,": "'tr:5x7.87'",
    "zz:527.87,": "'zz:527.87'",
}


@pytest.mark.parametrize("lost", LOST)
def test_a_position_that_lacks_something_is_refused_with_its_place(
    lost: str, tmp_path: Path
) -> None:
    path = tmp_path / "serial.log"
    path.write_text(
        f"{TALK}CLBM:[{{bl:530.40,   br:526.06,   tr:525.72,   tl:522.50}},"
        f"{{bl:641.75,   br:631.03,   {lost}tl:432.05}},]\n"
    )
    with pytest.raises(InputError) as caught:
        rsicalib.import_log(path)
    assert LOST[lost] in caught.value.message
    assert "line 3, position 2" in caught.value.message


def test_a_list_that_a_terminal_has_wrapped_is_refused(tmp_path: Path) -> None:
    path = tmp_path / "serial.log"
    path.write_text("CLBM:[{bl:567.80,   br:71\n9.96,   tr:561.68,   tl:314.90}]\n")
    with pytest.raises(InputError, match=r"line 1, position 1: found '\{bl:567\.80"):
        rsicalib.import_log(path)


# ------------------------------------------------------------------ Klipper

PRINTER = """\
[printer]
kinematics: delta   # the rest of a line is a comment
delta_radius: 172.0
[stepper_a]
step_pin: PF0
microsteps: 32
rotation_distance: 60
position_endstop: 332.99
arm_length: 340.0
[stepper_b]
microsteps: 32
rotation_distance: 60
[stepper_c]
microsteps: 16
rotation_distance: 60
gear_ratio: 2:1
[delta_calibrate]
radius: 50

#*# <---------------------- SAVE_CONFIG ---------------------->
#*# DO NOT EDIT THIS BLOCK OR BELOW. The contents are auto-generated.
#*#
#*# [printer]
#*# delta_radius = 999.0
#*#
#*# [stepper_a]
#*# angle = 211.5
#*#
#*# [delta_calibrate]
"""


def probes(number: int, height: float = 0.0) -> str:
    lines = ""
    for k in range(number):
        lines += f"#*# height{k} = {height}\n"
        lines += (
            f"#*# height{k}_pos = {35249.01 + k:.3f},{35451.81 - k:.3f},{35413.01 + 2 * k:.3f}\n"
        )
    return lines


def test_the_probes_of_a_printer_become_readings_and_its_geometry_a_mechanism(
    tmp_path: Path,
) -> None:
    path = tmp_path / "printer.cfg"
    path.write_text(PRINTER + probes(12, height=1.25))
    log = rsicalib.import_log(path)
    (session,) = log.sessions
    assert list(session.columns) == ["pose", "a", "b", "c"]
    assert session.columns["b"][2] == 35449.81
    mechanism = tomllib.loads(log.mechanism or "")
    gains = [c["gain"] for c in mechanism["channel"]]
    assert gains == pytest.approx([-60 / 6400] * 3)  # 200 · 32, and 200 · 16 through gears of 2
    offset = 332.99 + np.sqrt(340.0**2 - 172.0**2)
    assert [c["offset"] for c in mechanism["channel"]] == pytest.approx([offset] * 3)
    towers = [chain["dh"][0] for chain in mechanism["chain"]]
    assert [np.degrees(t["theta"]) for t in towers] == pytest.approx([211.5, 330.0, 90.0])
    assert {t["a"] for t in towers} == {172.0}, "the body wins over the saved block"
    assert mechanism["plane"][0]["offset"] == 1.25
    assert any("1.25 mm above the bed" in finding for finding in log.findings)


def test_seven_probes_for_nine_unknowns_are_said(tmp_path: Path) -> None:
    path = tmp_path / "printer.cfg"
    path.write_text(PRINTER + probes(7))
    assert any("7 probes for 9 unknowns" in f for f in rsicalib.import_log(path).findings)


def test_a_configuration_that_includes_another_is_read_with_it(tmp_path: Path) -> None:
    head, tail = PRINTER.split("[stepper_b]", 1)
    (tmp_path / "towers.cfg").write_text(head)
    path = tmp_path / "printer.cfg"
    path.write_text(f"[include towers.cfg]\n[stepper_b]{tail}{probes(9)}")
    assert len(rsicalib.import_log(path).sessions[0]) == 9


BROKEN = {
    "no probes": (PRINTER, r"\[delta_calibrate\]: found none.*DELTA_CALIBRATE"),
    "two towers": (PRINTER + "#*# height0 = 0.0\n#*# height0_pos = 1.0,2.0\n", "line 31.*three"),
    "cartesian": (PRINTER.replace(": delta ", ": cartesian "), "kinematics: found 'cartesian'"),
    "no arm": (PRINTER.replace("arm_length", "arm") + probes(9), "arm_length: found no such"),
    "no steps": (
        PRINTER.replace("microsteps: 16", "microsteps: 0") + probes(9),
        "number above zero",
    ),
    "no teeth": (PRINTER.replace("2:1", "0:1") + probes(9), "teeth such as 80:20"),
    "a short arm": (PRINTER.replace("340.0", "100") + probes(9), "more than the radius, 172"),
}


@pytest.mark.parametrize("name", BROKEN)
def test_a_configuration_that_cannot_be_used_is_refused(name: str, tmp_path: Path) -> None:
    path = tmp_path / "printer.cfg"
    text, message = BROKEN[name]
    path.write_text(text)
    with pytest.raises(InputError, match=message):
        rsicalib.import_log(path)


# ------------------------------------------------------------------ columns


def plotted(path: Path, rows: list[tuple[object, ...]], header: str) -> Path:
    path.write_text(header + "\n" + "\n".join(",".join(map(str, row)) for row in rows) + "\n")
    return path


def test_a_csv_of_a_plotting_program_takes_its_joints_by_their_names(tmp_path: Path) -> None:
    start = 1_700_000_000_000_000_000
    rows: list[tuple[object, ...]] = [(start + k * 5_000_000, k * 0.25, -k, k) for k in range(8)]
    header = "__time,/joint_states/elbow/position,/joint_states/wrist/position,/cpu"
    path = plotted(tmp_path / "plot.csv", rows, header)
    assert format_of(path) == "columns"
    log = rsicalib.import_log(path, channels={"q2": "wrist", "q1": "elbow"}, hold=0)
    columns = log.sessions[0].columns
    assert list(columns) == ["time_s", "q2", "q1"]
    # a double holds nanoseconds since 1970 to 256 ns: these are exact
    assert np.array_equal(columns["time_s"], np.arange(8) * 5_000_000 / 1e9)
    assert np.array_equal(columns["q1"], np.arange(8) * 0.25)
    assert any("nanoseconds since 1970" in finding for finding in log.findings)


def test_times_may_be_text(tmp_path: Path) -> None:
    rows: list[tuple[object, ...]] = [
        ("2025-03-01T10:00:00.500Z", 1.0),
        ("2025-03-01T10:00:01Z", 2.0),
    ]
    path = plotted(tmp_path / "foxglove.csv", rows, "timestamp,q1")
    log = rsicalib.import_log(path, format="columns", hold=0)
    assert np.array_equal(log.sessions[0].columns["time_s"], [0.0, 0.5])
    plotted(path, [*rows, ("yesterday", 3.0)], "timestamp,q1")
    with pytest.raises(InputError, match="line 4, column timestamp: found 'yesterday'"):
        rsicalib.import_log(path, format="columns", hold=0)
    path.write_text("time;q1\n01.03.2026 09:00:30,100;1,5\n")  # as it stands in the file
    with pytest.raises(InputError, match=r"found '01\.03\.2026 09:00:30,100'"):
        rsicalib.import_log(path, format="columns", hold=0)


def test_rows_that_touch_nothing_are_left_out_and_said(tmp_path: Path) -> None:
    """An arm is still on its way between cones, too, and no verb takes a row without a closure."""
    arm = rsicalib.load_mechanism(cone.mechanism(2e-5, 0.02))
    rng = np.random.default_rng(194)
    at = ["", *"a" * 8, "", "", *"b" * 8, *[""] * 8]
    stands = np.array([0, *[1] * 8, 2, 3, *[4] * 8, *[5] * 8])
    q = rng.uniform(-1.0, 1.0, (6, 6))[stands] + 1e-5 * rng.standard_normal((len(at), 6))
    rows = [(0.1 * k, at[k], *q[k]) for k in range(len(at))]
    names = ",".join(f"q{k}" for k in range(1, 7))
    path = plotted(tmp_path / "log.csv", rows, f"time_s,at,{names}")
    log = rsicalib.import_log(path, mechanism=arm)
    assert list(log.sessions[0].columns["at"]) == [*"a" * 8, *"b" * 8]
    assert list(log.sessions[0].columns["pose"]) == [*[1] * 8, *[2] * 8]
    assert "11 rows without at: nothing closes there, left out" in log.findings
    each = rsicalib.import_log(path, mechanism=arm, hold=0)
    assert len(each.sessions[0].columns["at"]) == 16
    # One text for all rows, and a mechanism that asks for no column, have no such row.
    labelled = rsicalib.import_log(path, mechanism=arm, labels={"at": "cone"}, hold=0)
    assert len(labelled.sessions[0].columns["at"]) == len(rows)


def test_rows_of_other_series_are_left_out_and_half_rows_refused(tmp_path: Path) -> None:
    rows: list[tuple[object, ...]] = [(0.0, 1.0, 2.0, ""), (0.1, "", "", 5.0), (0.2, 3.0, 4.0, "")]
    path = plotted(tmp_path / "plot.csv", rows, "__time,q1,q2,temperature")
    chosen = {"q1": "q1", "q2": "q2"}
    log = rsicalib.import_log(path, channels=chosen, hold=0)
    assert np.array_equal(log.sessions[0].lines, [2, 4])
    assert any("1 rows are of other series" in finding for finding in log.findings)
    plotted(path, [*rows, (0.3, 7.0, "", "")], "__time,q1,q2,temperature")
    with pytest.raises(InputError, match="line 5, q2: found no reading of q2"):
        rsicalib.import_log(path, channels=chosen, hold=0)
    kept = rsicalib.import_log(path, channels=chosen, hold=0, skip_bad_rows=True)
    assert len(kept.sessions[0]) == 2


def test_a_folder_of_parquet_files_is_a_session_for_each(tmp_path: Path) -> None:
    pyarrow = pytest.importorskip("pyarrow")
    parquet = pytest.importorskip("pyarrow.parquet")
    for part in range(2):
        table = pyarrow.table({"timestamp_ms": [0, 10, 20], "q1": [0.0, 1.0, 2.0 + part]})
        parquet.write_table(table, tmp_path / f"part-{part}.parquet")
    log = rsicalib.import_log(tmp_path, hold=0)
    assert [s.columns["q1"][-1] for s in log.sessions] == [2.0, 3.0]
    assert log.sessions[0].columns["time_s"][-1] == 0.02


def test_a_channel_without_a_column_is_refused_with_those_there_are(tmp_path: Path) -> None:
    path = plotted(tmp_path / "plot.csv", [(0.0, 1.0)], "__time,elbow")
    with pytest.raises(InputError, match=r"no column 'wrist'.*Those of the log: __time, elbow"):
        rsicalib.import_log(path, channels={"q1": "wrist"})


TOUCHES = """
name = "arm"
length_unit = "m"
channel = [{name = "q1", unit = "rad", gain = 1.0, offset = 0.0}]
chain = [{name = "arm", dh = [{channel = "q1", a = 0.4}]}]
point = [{name = "tip", chain = "arm", at = [0.0, 0.0, 0.0]}, {name = "cone", unknown = ["at"]}]
closure = [{name = "touch", kind = "touch", between = ["tip", "cone"]}]
"""


def test_columns_that_readings_know_or_a_mechanism_needs_are_kept_and_others_are_named(
    tmp_path: Path,
) -> None:
    (tmp_path / "arm.toml").write_text(TOUCHES)
    header = "pose,sample,at,J1 [°],x,temperature_c,load"
    rows: list[tuple[object, ...]] = [(7, 1, "A", 0.5, 1.0, 21.5, 3), (9, 1, "B", 0.9, 1.0, 22, 3)]
    path = plotted(tmp_path / "touches.csv", rows, header)
    log = rsicalib.import_log(path, mechanism=tmp_path / "arm.toml", channels={"q1": "J1 [°]"})
    columns = log.sessions[0].columns
    assert {name: [*cells] for name, cells in columns.items()} == {
        "pose": [7, 9],
        "sample": [1, 1],
        "temperature_c": [21.5, 22.0],
        "at": ["A", "B"],
        "q1": [0.5, 0.9],
    }
    assert any("2 columns not taken: x, load" in finding for finding in log.findings)
    assert any("q1 is in ° and declared in rad" in finding for finding in log.findings)

    plotted(path, rows, header.replace("at,", "socket,"))
    plotted(tmp_path / "own.csv", rows, header.replace("J1 [°]", "q1"))
    urdf = '<robot name="r"><link name="b"/><link name="t"/>'
    urdf += (
        '<joint name="hinge" type="continuous"><parent link="b"/><child link="t"/></joint></robot>'
    )
    (tmp_path / "r.urdf").write_text(urdf)
    chain = 'urdf = "r.urdf", base = "b", tip = "t", channels = {hinge = "q1"}'
    (tmp_path / "joints.toml").write_text(
        TOUCHES.replace('dh = [{channel = "q1", a = 0.4}]', chain)
    )
    log = rsicalib.import_log(tmp_path / "own.csv", mechanism=tmp_path / "joints.toml")
    assert [*log.sessions[0].columns["q1"]] == [0.5, 0.9]

    named = {"q1": "J1 [°]", "at": "socket"}
    log = rsicalib.import_log(path, mechanism=tmp_path / "arm.toml", channels=named)
    assert [*log.sessions[0].columns["at"]] == ["A", "B"]


def test_rows_that_are_a_posture_each_are_poses_and_none_that_is_still(tmp_path: Path) -> None:
    postures = np.random.default_rng(0).uniform(-2.0, 2.0, (60, 6))
    header = ",".join(f"q{k}" for k in range(1, 7))
    path = plotted(tmp_path / "touches.csv", [*map(tuple, postures)], header)
    with pytest.raises(InputError, match=r"pose of its own: rsicalib import --hold 0\b"):
        rsicalib.import_log(path)
    columns = rsicalib.import_log(path, rate=10.0).sessions[0].columns
    assert [*columns["pose"]] == [*range(1, 61)] and "time_s" not in columns
    noise = 1e-3 * np.random.default_rng(1).standard_normal((60, 6))
    plotted(path, [*map(tuple, postures[0] + noise)], header)
    assert len({*rsicalib.import_log(path, rate=10.0).sessions[0].columns["pose"]}) < 10


# ------------------------------------------------------------------ still stretches


def waved(noise: float, step: float, rng: np.random.Generator) -> tuple[np.ndarray, ...]:
    """Ten poses held for one second between moves of one second, at 100 Hz."""
    poses = rng.uniform(-1.0, 1.0, (11, 3))
    ease = 0.5 - 0.5 * np.cos(np.pi * np.linspace(0.0, 1.0, 100))[:, None]
    parts = []
    for k in range(10):
        parts += [np.tile(poses[k], (100, 1)), poses[k] + ease * (poses[k + 1] - poses[k])]
    values = np.vstack(parts)
    values += noise * rng.standard_normal(values.shape)
    values = np.round(values / step) * step
    return values, np.arange(len(values)) / 100.0, np.arange(10) * 200


@pytest.mark.parametrize("noise", [0.0, 1e-4, 5e-3])
def test_still_stretches_are_those_that_were_held(noise: float) -> None:
    values, time, starts = waved(noise, 1e-3, np.random.default_rng(1))
    found = still_stretches(values, time, 0.5)
    assert len(found) == 10
    # a move begins so slowly that its first rows are still: ±5 sigma are passed after some 0.2 s
    for (start, end), truth in zip(found, starts, strict=True):
        assert truth - 25 <= start <= truth + 5 and truth + 98 <= end <= truth + 125


def test_a_recording_that_never_stands_still_stays_one() -> None:
    time = np.arange(2000) / 100.0
    values = np.column_stack([np.sin(time), np.cos(0.7 * time)])
    values += 1e-3 * np.random.default_rng(2).standard_normal(values.shape)
    assert still_stretches(values, time, 0.5) == []


def test_times_that_stand_still_or_go_back_end_no_program() -> None:
    values = np.zeros((100, 2))
    assert still_stretches(values, np.zeros(100), 0.5) == []
    back = np.concatenate([np.arange(50), np.arange(50)]) / 50.0
    assert still_stretches(values, back, 0.5) == [(0, 50), (50, 100)]


def test_held_poses_leave_their_motion_in_a_file_of_its_own(tmp_path: Path) -> None:
    values, time, _ = waved(1e-4, 1e-5, np.random.default_rng(3))
    rows: list[tuple[object, ...]] = [(t, *row) for t, row in zip(time, values, strict=True)]
    path = plotted(tmp_path / "plot.csv", rows, "__time,q1,q2,q3")
    done = run_text("import", path, "--out", tmp_path / "in", "--labels", "surface=table")
    assert done.returncode == 0, done.stderr
    assert "10 held poses" in done.stdout and "still for 0.5 s or more" in done.stdout
    held = (tmp_path / "in" / "readings.csv").read_text().splitlines()
    motion = (tmp_path / "in" / "motion.csv").read_text().splitlines()
    picture = (tmp_path / "in" / "recording.svg").read_text()
    assert picture.count('<rect class="noise"') == 10 and picture.count("<polyline") == 3
    assert held[0] == "pose,sample,time_s,surface,q1,q2,q3"
    assert motion[0] == "time_s,surface,q1,q2,q3"
    assert len(held) + len(motion) == len(values) + 2
    again = rsicalib.import_log(path, labels={"surface": "table"})
    again.save(tmp_path / "in")  # what was written may be written again
    assert (tmp_path / "in" / "readings.csv").read_text().splitlines() == held


# ------------------------------------------------------------------ the verbs take logs


def test_verbs_take_a_log_as_they_take_its_readings(tmp_path: Path) -> None:
    demo = rsicalib.load_readings(rsicalib.DEMO / "readings.csv")
    names = [f"/arm/{name}/position" for name in demo.channels]
    rows = [(k, *row) for k, row in enumerate(demo.values[:64].tolist())]
    path = plotted(tmp_path / "plot.csv", rows, ",".join(["__time", *names]))
    log = rsicalib.import_log(path, mechanism="rsi", hold=0)
    (readings,) = log.readings(rsicalib.load_mechanism("rsi"))
    assert np.array_equal(readings.values, demo.values[:64])
    places = rsicalib.forward(path)
    assert np.array_equal(places, rsicalib.forward(readings))
    assert rsicalib.calibrate(path).readings.samples == 64
    assert rsicalib.calibrate(log).readings.samples == 64


def test_a_watch_takes_a_log_row_by_row(tmp_path: Path) -> None:
    result = rsicalib.calibrate(rsicalib.DEMO / "readings.csv", rest=rsicalib.DEMO / "rest.csv")
    readings = rsicalib.load_readings(rsicalib.DEMO / "readings.csv")
    rows = [(k / 8, *row) for k, row in enumerate(readings.values[:80].tolist())]
    path = plotted(tmp_path / "plot.csv", rows, ",".join(["__time", *readings.channels]))
    watching = rsicalib.watch(path, result)
    assert [alarm.row for alarm in watching] == []
    assert watching.summary().rows == 80


def test_a_reading_out_of_range_is_refused_with_its_line_in_the_log(tmp_path: Path) -> None:
    demo = rsicalib.load_readings(rsicalib.DEMO / "readings.csv")
    rows = [(k, *row) for k, row in enumerate(demo.values[:3].tolist())]
    rows[2] = (2, 9999.0, *rows[2][2:])
    path = plotted(tmp_path / "plot.csv", rows, ",".join(["__time", *demo.channels]))
    with pytest.raises(InputError, match="line 4, column a11: found 9999"):
        rsicalib.calibrate(path)


def test_an_option_that_means_nothing_for_a_log_is_refused(tmp_path: Path) -> None:
    path = tmp_path / "serial.log"
    path.write_text(clbm(sled()))
    with pytest.raises(InputError, match="topic: found it for a log of a Maslow4, expected one"):
        rsicalib.import_log(path, topic="/joint_states")
    renamed = rsicalib.import_log(path, channels={"left": "tl", "right": "tr"})
    assert list(renamed.sessions[0].columns)[2:] == ["left", "right"]


def test_a_channel_that_has_the_name_of_its_column_is_said_once(tmp_path: Path) -> None:
    path = tmp_path / "plot.csv"
    path.write_text("__time,elbow,wrist,force\n0,1,2,\n0.01,,,5\n0.02,1,3,\n")
    with pytest.raises(InputError, match=r"elbow,wrist \(2 rows\); force \(1 row\)"):
        rsicalib.import_log(path)
    said = run_text("import", path, "--channels", "q1=elbow,wrist", "--out", tmp_path / "out")
    assert "columns: time_s, q1, wrist" in said.stdout + said.stderr


def test_a_joint_that_is_swept_by_whole_steps_is_no_counter(tmp_path: Path) -> None:
    rows = [(0.5 * k, float(k), 0.5 * k + 0.1) for k in range(40)]
    path = plotted(tmp_path / "swept.csv", rows, "__time,q1,q2")
    assert {"q1", "q2"} <= set(rsicalib.import_log(path, hold=0.0).sessions[0].columns)
    counted = plotted(tmp_path / "counted.csv", rows, "__time,index,q2")
    assert "index" not in rsicalib.import_log(counted, hold=0.0).sessions[0].columns


def test_a_log_of_another_machine_than_the_default_says_so(tmp_path: Path) -> None:
    path = plotted(tmp_path / "plot.csv", [(0.0, 1.0), (0.02, 2.0)], "__time,elbow")
    with pytest.raises(InputError, match="the mechanism 'rsi': give yours as mechanism"):
        rsicalib.trace(path)


def test_what_is_no_log_is_refused_with_those_that_are_known(tmp_path: Path) -> None:
    path = tmp_path / "poem.txt"
    path.write_text("Roses are red\n")
    with pytest.raises(InputError, match=r"expected one of: .*maslow"):
        rsicalib.import_log(path)
    with pytest.raises(InputError, match="found no such file"):
        rsicalib.import_log(tmp_path / "nowhere.log")


def test_every_extra_that_a_message_names_brings_its_library() -> None:
    root = Path(__file__).parents[1]
    project = tomllib.loads((root / "pyproject.toml").read_text(encoding="utf-8"))["project"]
    for library, extra in EXTRAS.items():
        brought = project["optional-dependencies"][extra]
        assert any(one.startswith(library) for one in brought), library
    for file in (root / "python" / "rsicalib").rglob("*.py"):
        asked = re.findall(r'(?<!ask\.)needed\("(\w+)', file.read_text(encoding="utf-8"))
        assert set(asked) <= set(EXTRAS), file.name


@pytest.mark.parametrize("what", ["time", "inside"])
def test_arrays_of_other_lengths_than_the_readings_are_refused(what: str) -> None:
    given = {"time": np.arange(4.0), "inside": np.ones(4, dtype=bool)}
    given[what] = given[what][1:]
    with pytest.raises(InputError, match=f"{what} has 3 entries; expected 4"):
        still_stretches(np.zeros((4, 2)), hold=1.0, **given)
