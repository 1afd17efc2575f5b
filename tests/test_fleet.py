"""Many devices: the numbers of one device alone, errors as rows, resumed runs, and engines."""

from __future__ import annotations

import json
import logging
import os
import re
import signal
import subprocess
import sys
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import rsicalib
from rsicalib import InputError, calibrate_devices
from rsicalib.fleets import run as running
from rsicalib.fleets.dataset import Dataset
from rsicalib.fleets.page import page
from rsicalib.fleets.standing_out import remarks, spreads
from rsicalib.fleets.store import Parts
from rsicalib.io.frames import columns_of
from rsicalib.io.tables import chunks, read_table
from tests.full import sized

pa = pytest.importorskip("pyarrow")
parquet = pytest.importorskip("pyarrow.parquet")

MECHANISM = rsicalib.load_mechanism("rsi")
CHANNELS = [channel.name for channel in MECHANISM.channels]
COUNT = 6


@pytest.fixture(scope="module")
def sessions() -> list[Any]:
    return [rsicalib.simulate(poses=16, samples=3, check=1, seed=s) for s in range(COUNT)]


def rows_of(label: str, made: Any, *, rest: bool = True) -> dict[str, list[Any]]:
    """Rows of one device as users have them: the pose as text, rest readings among them."""
    parts = [(made.readings.values, [str(p) for p in made.readings.pose])]
    if rest:
        parts.append((made.rest.values, ["rest"] * len(made.rest)))
    values = np.concatenate([v for v, _ in parts])
    pose = [p for _, of in parts for p in of]
    columns: dict[str, list[Any]] = {"device": [label] * len(pose), "pose": pose}
    return columns | {name: values[:, k].tolist() for k, name in enumerate(CHANNELS)}


def stacked(*devices: dict[str, list[Any]]) -> dict[str, list[Any]]:
    return {name: [cell for one in devices for cell in one[name]] for name in devices[0]}


@pytest.fixture(scope="module")
def frame(sessions: list[Any]) -> dict[str, list[Any]]:
    return stacked(*(rows_of(f"d{k}", made) for k, made in enumerate(sessions)))


@pytest.fixture
def dataset(frame: dict[str, list[Any]], tmp_path: Path) -> Path:
    path = tmp_path / "readings.parquet"
    parquet.write_table(pa.table(frame), path, row_group_size=70)  # devices across row groups
    return path


def read(folder: Path) -> dict[str, list[Any]]:
    found: dict[str, list[Any]] = parquet.read_table(folder / "fleet.parquet").to_pydict()
    return found


def test_a_device_of_many_has_the_numbers_that_it_has_alone(
    sessions: list[Any], frame: dict[str, list[Any]]
) -> None:
    found = calibrate_devices(frame)
    for k, made in enumerate(sessions):
        alone = rsicalib.calibrate(made.readings, rest=made.rest)
        assert found["verdict"][k] == alone.verdict
        assert found["chi2"][k] == alone.fit.chi2
        assert found["p_value"][k] == alone.fit.p_value
        for p in alone.parameters:
            assert found[p.spec][k] == p.value
            assert found[f"{p.spec}_sd"][k] == p.sd
    assert found["poses"].tolist() == [16] * COUNT
    assert found["samples"].tolist() == [48] * COUNT


def test_held_out_figures_come_on_demand(sessions: list[Any], frame: dict[str, list[Any]]) -> None:
    found = calibrate_devices(frame, held_out=True)
    alone = rsicalib.calibrate(sessions[0].readings, rest=sessions[0].rest)
    assert alone.fit.held_out is not None
    assert found["held_out_chi2_per_dof"][0] == alone.fit.held_out.chi2_per_dof
    assert "held_out_chi2_per_dof" not in calibrate_devices(frame)


def test_rows_of_a_device_need_not_be_neighbours(frame: dict[str, list[Any]]) -> None:
    order = np.argsort(np.tile(np.arange(len(frame["pose"]) // COUNT), COUNT), kind="stable")
    mixed = {name: [cells[i] for i in order] for name, cells in frame.items()}
    found, expected = calibrate_devices(mixed), calibrate_devices(frame)
    assert found["chi2"].tolist() == expected["chi2"].tolist()
    assert found["sha256"].tolist() == expected["sha256"].tolist()


def test_rest_readings_may_stand_in_a_table_of_their_own(
    sessions: list[Any], frame: dict[str, list[Any]]
) -> None:
    poses = stacked(*(rows_of(f"d{k}", m, rest=False) for k, m in enumerate(sessions)))
    rest = {"device": np.repeat([f"d{k}" for k in range(COUNT)], len(sessions[0].rest))}
    for k, name in enumerate(CHANNELS):
        rest[name] = np.concatenate([made.rest.values[:, k] for made in sessions])
    found, expected = calibrate_devices(poses, rest=rest), calibrate_devices(frame)
    assert found["chi2"].tolist() == expected["chi2"].tolist()
    assert found["sha256"].tolist() == expected["sha256"].tolist()


@pytest.mark.parametrize(
    ("fault", "words"),
    [
        (("a11", 5000.0), "column a11: found 5000.0, expected a number from 0 to 4095"),
        (("a22", float("nan")), "column a22: found NaN"),
        (("pose", "1"), "column pose: found a pose that begins again"),
        (("pose", "here"), "column pose: found 'here', expected an integer"),
    ],
)
def test_what_is_wrong_with_a_device_is_a_row_and_the_others_stay(
    sessions: list[Any], fault: tuple[str, Any], words: str
) -> None:
    devices = [rows_of(f"d{k}", made) for k, made in enumerate(sessions[:3])]
    devices[1][fault[0]][20] = fault[1]
    found = calibrate_devices(stacked(*devices))
    assert found["verdict"].tolist() == ["adequate", None, "adequate"]
    assert words in found["message"][1]
    assert np.isnan(found["chi2"][1]) and np.isnan(found["gain@a11_sd"][1])


@pytest.mark.parametrize("missing", [None, float("nan"), " "])
def test_rows_without_a_device_are_no_device(sessions: list[Any], missing: Any) -> None:
    """Each NaN was a device of its own, and blanks were one that may be adequate."""
    devices = [rows_of(label, sessions[k]) for k, label in enumerate([missing, "d"])]
    found = calibrate_devices(stacked(*devices))
    assert found["device"].tolist() == [None, "d"]
    assert found["verdict"].tolist() == [None, "adequate"]
    assert found["message"][0] == "found 48 rows without a device, expected none"


def test_a_fleet_has_a_row_for_rows_without_a_device(sessions: list[Any], tmp_path: Path) -> None:
    frame = stacked(*(rows_of(d, sessions[k]) for k, d in enumerate(["", "d", ""])))
    for name, group in (("whole", 1000), ("cut", 30)):
        folder = tmp_path / name
        parquet.write_table(pa.table(frame), tmp_path / f"{name}.parquet", row_group_size=group)
        rsicalib.fleet(tmp_path / f"{name}.parquet", out=folder, trace=False)
        found = dict(zip(read(folder)["device"], read(folder)["verdict"], strict=True))
        assert found == {None: None, "d": "adequate"}


def test_readings_of_rest_poses_name_their_devices(sessions: list[Any], tmp_path: Path) -> None:
    parquet.write_table(pa.table(rows_of("d", sessions[0])), tmp_path / "fleet.parquet")
    sessions[0].rest.to_csv(tmp_path / "rest.csv")
    with pytest.raises(InputError, match=r"rest\.csv: found no column 'device', expected one that"):
        Dataset(tmp_path / "fleet.parquet", "device")


def test_too_few_poses_are_undetermined(sessions: list[Any]) -> None:
    few = {name: cells[:9] for name, cells in rows_of("few", sessions[0]).items()}
    found = calibrate_devices(stacked(few, rows_of("d", sessions[1])))
    assert found["verdict"].tolist() == ["undetermined", "adequate"]
    assert "record other poses" in found["message"][0]


def test_a_table_without_a_needed_column_is_refused_as_a_whole(frame: dict[str, Any]) -> None:
    with pytest.raises(InputError, match="no column 'robot'"):
        calibrate_devices(frame, by="robot")
    with pytest.raises(InputError, match="a column 'a13'"):
        calibrate_devices({name: cells for name, cells in frame.items() if name != "a13"})


def test_a_table_of_arrow_gives_a_table_of_arrow(frame: dict[str, list[Any]]) -> None:
    found = calibrate_devices(pa.table(frame))
    assert isinstance(found, pa.Table)
    expected = calibrate_devices(frame)
    assert found.column("gain@a11").to_pylist() == expected["gain@a11"].tolist()


def test_a_frame_of_another_library_needs_columns_and_a_constructor_only(
    frame: dict[str, list[Any]],
) -> None:
    class Column:
        def __init__(self, cells: Any) -> None:
            self.cells = np.asarray(cells)

        def to_numpy(self) -> Any:
            return self.cells

    class DataFrame:
        """As pandas and Polars have it."""

        def __init__(self, columns: Any) -> None:
            self.made = dict(columns)
            self.columns = list(self.made)

        def __getitem__(self, name: str) -> Column:
            return Column(self.made[name])

    found = calibrate_devices(DataFrame(frame))
    assert isinstance(found, DataFrame)
    assert found.made["verdict"].tolist() == ["adequate"] * COUNT


def test_a_missing_effect_is_traced_and_named(sessions: list[Any]) -> None:
    device = rows_of("bent", sessions[0])
    count = np.array(device["a22"])
    device["a22"] = np.clip(count + 25.0 * np.sin(count / 400.0), 0, 4095).round().tolist()
    both = stacked(device, rows_of("good", sessions[1]))
    found = calibrate_devices(both)
    steps = json.loads(found["steps"][0])
    assert "a22" in {step["target"] for step in steps}
    assert found["steps"][1] == "[]"
    screened = calibrate_devices(both, trace=False)
    assert screened["verdict"].tolist() == ["unexplained", "adequate"]
    assert screened["steps"].tolist() == ["[]", "[]"]


# ------------------------------------------------------------------ files


def test_a_run_writes_a_row_for_each_device_and_a_page(
    frame: dict[str, list[Any]], dataset: Path, tmp_path: Path
) -> None:
    made = rsicalib.fleet(dataset, out=tmp_path / "out")
    assert list(made.to_dataframe()["device"]) == made.rows["device"]
    assert repr(made).startswith(f"<Fleet of {len(made)} devices: ")
    rows = read(tmp_path / "out")
    expected = calibrate_devices(frame)
    assert rows["device"] == [f"d{k}" for k in range(COUNT)]
    assert rows["offset@a31"] == expected["offset@a31"].tolist()
    assert made.verdicts == {"adequate": COUNT}
    assert sorted(p.name for p in (tmp_path / "out").iterdir()) == [
        "fleet.html",
        "fleet.parquet",
        "run.json",
    ]


def test_the_number_of_threads_changes_no_number(
    dataset: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    rsicalib.fleet(dataset, out=tmp_path / "whole", workers=1)
    monkeypatch.setattr(running, "PARTITION", 1)
    rsicalib.fleet(dataset, out=tmp_path / "cut", workers=3)
    assert read(tmp_path / "whole") == read(tmp_path / "cut")


def test_a_device_is_in_one_partition_only(frame: dict[str, list[Any]], dataset: Path) -> None:
    parts = list(Dataset(dataset, "device").partitions(2))
    labels = [set(part.frame["device"]) for part in parts]
    assert [sorted(of) for of in labels] == [["d0", "d1"], ["d2", "d3"], ["d4", "d5"]]
    assert sum(len(part.frame["device"]) for part in parts) == len(frame["device"])


def test_pieces_hold_each_device_once_and_give_the_rows_that_partitions_give(
    frame: dict[str, list[Any]], dataset: Path
) -> None:
    labels = [f"d{k}" for k in range(COUNT)]
    found = pieced(dataset, 2)
    assert found == (labels, [float(cell) for cell in frame["a11"]])
    # Rows of all devices everywhere: each piece would read the whole file.
    order = np.argsort(np.tile(np.arange(len(frame["device"]) // COUNT), COUNT), kind="stable")
    scattered = {name: [cells[k] for k in order] for name, cells in frame.items()}
    parquet.write_table(pa.table(scattered), dataset, row_group_size=12)
    assert Dataset(dataset, "device").pieces(2) is None


def pieced(dataset: Path, size: int) -> tuple[list[Any], list[float]] | None:
    """Labels and readings of all pieces of a dataset, in their order."""
    pieces = Dataset(dataset, "device").pieces(size)
    if pieces is None:
        return None
    parts = [list(piece.read()) for piece in pieces]
    for piece, own in zip(pieces, parts, strict=True):
        assert piece.labels == [label for part in own for label in part.labels]
        assert all(len(part.labels) <= size for part in own)
    return (
        [label for own in parts for part in own for label in part.labels],
        [cell for own in parts for part in own for cell in part.frame["a11"]],
    )


@pytest.mark.parametrize("order", ["sorted", "turned", "names", "mixed within"])
def test_any_row_groups_give_each_device_once_with_all_its_rows(order: str, tmp_path: Path) -> None:
    rng = np.random.default_rng(7)
    path = tmp_path / "readings.parquet"
    count = 0
    for _ in range(sized(20, 60)):
        sizes = rng.integers(1, 9, rng.integers(1, 40))
        labels: list[Any] = [k for k, size in enumerate(sizes) for _ in range(size)]
        if order == "names":  # in the order of texts
            labels = sorted(map(str, labels))
        elif order == "turned":  # no statistics say where devices end
            labels = labels[::-1]
        group = int(rng.integers(1, 60))
        if order == "mixed within":
            for start in range(0, len(labels), group):
                labels[start : start + group] = rng.permutation(labels[start : start + group])
        rows = np.arange(len(labels), dtype=np.float64)
        parquet.write_table(pa.table({"device": labels, "a11": rows}), path, row_group_size=group)
        found = pieced(path, int(rng.integers(1, 12)))
        if found is None:  # small row groups without an order: they would be read too often
            assert order == "turned"
            continue
        count += 1
        devices, told = found
        assert sorted(devices) == sorted(set(labels))
        of_device = {
            label: [r for own, r in zip(labels, rows, strict=True) if own == label]
            for label in devices
        }
        assert told == [row for label in devices for row in of_device[label]]
    assert count > sized(6, 20)


def test_a_row_group_of_many_devices_is_several_pieces(tmp_path: Path) -> None:
    path = tmp_path / "readings.parquet"
    labels = np.repeat(np.arange(300), 4)
    parquet.write_table(pa.table({"device": labels, "a11": labels * 1.0}), path)
    pieces = Dataset(path, "device").pieces(100)
    assert pieces is not None and len(pieces) == 16
    assert max(len(piece.labels) for piece in pieces) <= 20
    assert sum(piece.devices for piece in pieces) == pytest.approx(300, abs=16)


def test_rows_are_written_where_they_are_made_if_that_sees_the_folder(
    frame: dict[str, list[Any]], tmp_path: Path
) -> None:
    rows = {"device": ["a", "b"], "verdict": ["adequate", None], "chi2": [1.0, None]}
    (tmp_path / "this.run").touch()
    seen = Parts(tmp_path, "device", "this.run")
    assert seen.keep("000000001", rows) == {"device": ["a", "b"]}
    assert parquet.read_table(tmp_path / "000000001.parquet").to_pydict() == rows
    elsewhere = Parts(tmp_path, "device", "other.run")
    assert elsewhere.keep("000000002", rows) == rows
    assert not (tmp_path / "000000002.parquet").exists()


def test_a_device_that_takes_too_long_is_a_row_and_is_calibrated_again(
    dataset: Path, tmp_path: Path
) -> None:
    short = rsicalib.fleet(dataset, out=tmp_path / "out", time_limit=1e-9)
    assert short.verdicts == {"refused": COUNT} and short.exit_code == 3
    assert set(short.rows["message"]) == {"took longer than the limit of 1e-09 s"}
    assert set(short.rows["sha256"]) == {None}
    rsicalib.fleet(dataset, out=tmp_path / "out", resume=True, time_limit=600.0)
    rsicalib.fleet(dataset, out=tmp_path / "whole")
    assert read(tmp_path / "out") == read(tmp_path / "whole")
    with pytest.raises(InputError, match="time_limit: found 0"):
        rsicalib.fleet(dataset, out=tmp_path / "out", time_limit=0)


def test_a_large_csv_file_is_read_some_rows_at_a_time(
    frame: dict[str, list[Any]], tmp_path: Path
) -> None:
    path = tmp_path / "all.csv"
    rows = zip(*frame.values(), strict=True)
    path.write_text("\n".join([",".join(frame), *(",".join(map(str, r)) for r in rows)]) + "\n")
    whole, parts = read_table(path), list(chunks(path, 2_000))
    assert len(parts) > 3
    assert np.concatenate([p.lines for p in parts]).tolist() == whole.lines.tolist()
    for k, cells in enumerate(whole.columns):
        assert [cell for part in parts for cell in part.columns[k]] == list(cells)
    path.write_text(path.read_text().replace("d0", '"d0"', 1))
    assert len(list(chunks(path, 2_000))) == 1  # a quoted cell may hold the end of a line


def test_a_folder_without_readings_is_a_row_and_a_row_names_its_file(
    sessions: list[Any], tmp_path: Path
) -> None:
    for k in (0, 2):
        sessions[k].save(tmp_path / "devices" / f"d{k}")
    (tmp_path / "devices" / "d1").mkdir()
    rsicalib.fleet(tmp_path / "devices", out=tmp_path / "out")
    rows = read(tmp_path / "out")
    assert rows["device"] == ["d0", "d1", "d2"]
    assert rows["verdict"][1] is None and "no such file" in rows["message"][1]
    assert rows["file"] == [str(tmp_path / "devices" / d / "readings.csv") for d in rows["device"]]
    assert rows["file"][1] in (tmp_path / "out" / "fleet.html").read_text(encoding="utf-8")


def test_folders_of_devices_are_read_as_simulate_writes_them(
    sessions: list[Any], frame: dict[str, list[Any]], tmp_path: Path
) -> None:
    for k, made in enumerate(sessions):
        made.save(tmp_path / "devices" / f"d{k}")
    (tmp_path / "devices" / "d2" / "readings.csv").write_text("a11,a12\n1,2\n", encoding="utf-8")
    (tmp_path / "devices" / "d3" / "readings.csv").write_bytes(b"\xff\xfe")
    rsicalib.fleet(tmp_path / "devices", out=tmp_path / "out")
    rows = read(tmp_path / "out")
    expected = calibrate_devices(frame)
    assert rows["device"] == [f"d{k}" for k in range(COUNT)]
    for k in (0, 1, 4, 5):
        assert rows["chi2"][k] == expected["chi2"][k]
    assert "a13" in rows["message"][2] and rows["verdict"][2] is None
    assert "UTF-8" in rows["message"][3] and rows["verdict"][3] is None


def test_csv_files_name_the_device_by_a_column_or_by_the_file(
    sessions: list[Any], frame: dict[str, list[Any]], tmp_path: Path
) -> None:
    text = ",".join(frame) + "\n"
    text += "\n".join(",".join(map(str, row)) for row in zip(*frame.values(), strict=True))
    (tmp_path / "all.csv").write_text(text, encoding="utf-8")
    (tmp_path / "files").mkdir()
    rest = [",".join(["device", *CHANNELS])]
    for k, made in enumerate(sessions):
        made.readings.to_csv(tmp_path / "files" / f"d{k}.csv")
        rest += [",".join([f"d{k}", *map(str, row)]) for row in made.rest.values.tolist()]
    (tmp_path / "files" / "rest.csv").write_text("\n".join(rest), encoding="utf-8")
    expected = calibrate_devices(frame)["chi2"].tolist()
    for source in ("all.csv", "files"):
        rsicalib.fleet(tmp_path / source, out=tmp_path / f"out-{source}")
        rows = read(tmp_path / f"out-{source}")
        assert rows["device"] == [f"d{k}" for k in range(COUNT)]
        assert rows["chi2"] == expected


def test_an_interrupted_run_is_resumed_with_the_rows_that_it_has(
    dataset: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(running, "PARTITION", 1)
    out, calls = tmp_path / "out", []

    def stop(_: str, done: int, total: int) -> None:
        calls.append(done)
        if done >= 3:  # a piece is a row group at least, of two or three devices
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        rsicalib.fleet(dataset, out=out, workers=1, progress=stop)
    parts = [parquet.read_table(path) for path in (out / "parts").glob("*.parquet")]
    kept = sum(part.num_rows for part in parts)
    assert kept == calls[-1] < COUNT
    with pytest.raises(InputError, match="expected --resume"):
        rsicalib.fleet(dataset, out=out)
    calls.clear()
    rsicalib.fleet(dataset, out=out, resume=True, progress=lambda *n: calls.append(n[1]))
    assert calls[-1] == COUNT - kept
    rsicalib.fleet(dataset, out=tmp_path / "whole")
    assert read(out) == read(tmp_path / "whole")
    assert not (out / "parts").exists()


def test_a_resumed_run_computes_what_is_new_or_has_changed(
    sessions: list[Any], frame: dict[str, list[Any]], dataset: Path, tmp_path: Path
) -> None:
    out = tmp_path / "out"
    rsicalib.fleet(dataset, out=out)
    before = read(out)
    changed = rows_of("d1", sessions[2])
    devices = [rows_of(f"d{k}", m) for k, m in enumerate(sessions[:5])]
    more = stacked(devices[0], changed, *devices[2:], rows_of("new", sessions[5]))
    parquet.write_table(pa.table(more), dataset)
    calls: list[int] = []
    rsicalib.fleet(dataset, out=out, resume=True, progress=lambda *n: calls.append(n[1]))
    assert calls == [2]
    after = read(out)
    assert after["device"] == ["d0", "d1", "d2", "d3", "d4", "new"]
    assert after["chi2"][1] == before["chi2"][2]
    assert after["chi2"][2:5] == before["chi2"][2:5]
    with pytest.raises(InputError, match=r"--resume: found a run with noise = null"):
        rsicalib.fleet(dataset, out=out, resume=True, noise=1.0)


def test_a_table_that_the_command_has_not_made_is_not_overwritten(
    dataset: Path, tmp_path: Path
) -> None:
    (tmp_path / "out").mkdir()
    (tmp_path / "out" / "fleet.parquet").write_text("mine", encoding="utf-8")
    with pytest.raises(InputError, match="which no run of this command has made"):
        rsicalib.fleet(dataset, out=tmp_path / "out")


@pytest.mark.parametrize("make", ["none", "empty", "both"])
def test_a_dataset_that_is_none_is_refused(make: str, tmp_path: Path, dataset: Path) -> None:
    path = tmp_path / "there"
    if make != "none":
        path.mkdir()
    if make == "both":
        (path / "a.csv").write_text("device\n", encoding="utf-8")
        (path / "b.parquet").write_bytes(dataset.read_bytes())
    with pytest.raises(InputError, match="found"):
        rsicalib.fleet(path, out=tmp_path / "out")


def test_the_command_prints_how_many_devices_are_what(dataset: Path, tmp_path: Path) -> None:
    command = [
        sys.executable,
        "-m",
        "rsicalib",
        "fleet",
        str(dataset),
        "--out",
        str(tmp_path / "o"),
    ]
    done = subprocess.run([*command, "--json"], capture_output=True, text=True, timeout=300)
    assert done.returncode == 0, done.stderr
    found = json.loads(done.stdout)
    assert found["format"] == "rsicalib.fleet/1"
    assert found["verdicts"] == {"adequate": COUNT}


def test_a_fleet_of_which_no_device_can_be_used_exits_with_3(
    frame: dict[str, list[Any]], tmp_path: Path
) -> None:
    parquet.write_table(pa.table({**frame, "a11": [9999.0] * len(frame["a11"])}), tmp_path / "f.pq")
    found = rsicalib.fleet(tmp_path / "f.pq", out=tmp_path / "out")
    assert found.exit_code == 3
    assert found.verdicts == {"refused": COUNT}


# ------------------------------------------------------------------ what stands out


def drawn(count: int, seed: int) -> dict[str, list[Any]]:
    """Rows of normal devices, without a calibration."""
    rng = np.random.default_rng(seed)
    rows: dict[str, list[Any]] = {"device": list(range(count)), "verdict": ["adequate"] * count}
    rows |= {"message": [""] * count, "steps": ["[]"] * count}
    rows |= {"chi2": [50.0] * count, "dof": [50.0] * count}
    rows["p_value"] = rng.uniform(0, 1, count).tolist()
    for k in range(18):
        rows[f"p{k}"] = rng.normal(k, 0.1, count).tolist()
        rows[f"p{k}_sd"] = [0.01] * count
    return rows


def test_normal_devices_seldom_stand_out() -> None:
    named = 0
    for seed in range(60):
        rows = drawn(400, seed)
        named += bool(remarks(rows, "device", spreads(rows)))
    # One fleet in 100, and a few more as the spread is estimated: 60 fleets give 5 or more less
    # than once in 100 where one in 40 is named.
    assert named <= 4


def paged(rows: dict[str, list[Any]]) -> str:
    """The page of a fleet's rows."""
    spread = spreads(rows)
    return page(rows, "device", MECHANISM, spread, remarks(rows, "device", spread))


def test_a_device_far_from_the_others_is_named_with_the_parameter() -> None:
    rows = drawn(400, 0)
    rows["p7"][33] = 7.0 + 0.1 * 8
    rows["p2_sd"][44] = 0.2
    rows["verdict"][55], rows["message"][55] = None, "row 3, column a11: found <NaN>"
    found = {r.device: r for r in remarks(rows, "device", spreads(rows))}
    assert set(found) == {33, 44, 55}
    assert "p7" in found[33].why and found[33].size == pytest.approx(8, rel=0.2)
    assert found[44].why == "p2 is known 20.0 times worse than usual"
    html = paged(rows)
    assert "3 of 400 devices stand out." in html
    assert "&lt;NaN&gt;" in html and "<NaN>" not in html


def test_a_lack_that_all_devices_share_shows_in_the_p_values() -> None:
    rows = drawn(400, 1)
    assert "lack an effect" not in paged(rows)
    rows["p_value"] = [p**2 for p in rows["p_value"]]  # a tenth of them below 1 %
    assert "lack an effect" in paged(rows)


# ------------------------------------------------------------------ Dask


@pytest.fixture(scope="module")
def cluster() -> Any:
    distributed = pytest.importorskip(
        "distributed", reason="no package distributed: pip install rsicalib[dask]"
    )
    with distributed.LocalCluster(
        n_workers=2, threads_per_worker=1, dashboard_address=None, silence_logs=50
    ) as made:
        yield made


@pytest.mark.filterwarnings("ignore")
def test_dask_gives_the_same_numbers_to_the_bit(
    cluster: Any, dataset: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(running, "PARTITION", 2)
    rsicalib.fleet(dataset, out=tmp_path / "threads", workers=2)
    rsicalib.fleet(dataset, out=tmp_path / "dask", dask=cluster.scheduler_address)
    assert read(tmp_path / "threads") == read(tmp_path / "dask")


@pytest.mark.filterwarnings("ignore")
def test_a_killed_worker_costs_its_partition_and_no_device(
    cluster: Any, dataset: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(running, "PARTITION", 1)
    worker = next(iter(cluster.workers.values()))
    killed = []

    def kill(_: str, done: int, total: int) -> None:
        if not killed:
            killed.append(worker.process.pid)
            os.kill(worker.process.pid, signal.SIGKILL)

    made = rsicalib.fleet(
        dataset, out=tmp_path / "out", dask=cluster.scheduler_address, progress=kill
    )
    assert killed
    assert made.verdicts == {"adequate": COUNT}


@pytest.mark.filterwarnings("ignore")
def test_a_scheduler_that_goes_is_told_and_the_rows_are_kept(
    dataset: Path,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    caplog: pytest.LogCaptureFixture,
) -> None:
    pytest.importorskip("distributed", reason="no package distributed: pip install rsicalib[dask]")
    monkeypatch.setattr(running, "PARTITION", 1)
    command = [sys.executable, "-m", "distributed.cli.dask_scheduler"]
    command += ["--port", "0", "--host", "127.0.0.1", "--no-dashboard"]
    scheduler = subprocess.Popen(command, stderr=subprocess.PIPE, text=True)
    assert scheduler.stderr is not None
    found = (re.search(r"Scheduler at:\s+(\S+)", line) for line in scheduler.stderr)
    address = next(match[1] for match in found if match)
    worker = [sys.executable, "-m", "distributed.cli.dask_worker", address]
    worker += ["--nworkers", "1", "--nthreads", "1", "--no-dashboard", "--death-timeout", "60"]
    working = subprocess.Popen(worker, stderr=subprocess.DEVNULL)

    # The client's logger passes nothing on: it is listened to by itself.
    logging.getLogger("distributed.client").addHandler(caplog.handler)

    def kill(_: str, done: int, total: int) -> None:
        scheduler.kill()

    try:
        with pytest.raises(InputError, match=r"the scheduler at .* gone .* --resume"):
            rsicalib.fleet(dataset, out=tmp_path / "out", dask=address, progress=kill)
        # What is told is told once, and not as a traceback.
        assert [record for record in caplog.records if record.levelno > logging.INFO] == []
    finally:
        logging.getLogger("distributed.client").removeHandler(caplog.handler)
        for process in (scheduler, working):
            process.kill()
            process.communicate()
    assert rsicalib.fleet(dataset, out=tmp_path / "out", resume=True).verdicts == {
        "adequate": COUNT
    }


def test_an_address_where_no_scheduler_answers_is_refused(dataset: Path, tmp_path: Path) -> None:
    pytest.importorskip("distributed", reason="no package distributed: pip install rsicalib[dask]")
    with pytest.raises(InputError, match="--dask: found"):
        rsicalib.fleet(dataset, out=tmp_path / "out", dask="nonsense://nowhere:1")


def test_columns_of_different_lengths_are_refused() -> None:
    with pytest.raises(InputError, match="different lengths"):
        columns_of({"a": [1, 2], "b": [1]})
    with pytest.raises(InputError, match="by: found 'steps'"):
        calibrate_devices({"steps": [1]}, by="steps")
    with pytest.raises(InputError, match="found int"):
        columns_of(3)
