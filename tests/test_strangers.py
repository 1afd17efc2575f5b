"""Ten files of strangers' shape: read without a word of ours, or refused with what to do."""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

import rsicalib
from rsicalib import InputError
from tests.test_imports import PRINTER, clbm, probes, sled


def a_console_of_a_browser(folder: Path) -> Path:
    """Lines copied from the page of a Maslow, with a time before each, and Windows line ends."""
    path = folder / "calibration-log-ui.txt"
    lines = [f"Tue Oct 14 22:{k:02} {line}" for k, line in enumerate(clbm(sled()).split("},"))]
    path.write_text(
        "start\r\n" + "},\r\n".join(lines) + "\r\nFitness: 2.356\r\nMaslow_tlX: 0.6\r\n"
    )
    return path


def json_of_a_script(folder: Path) -> Path:
    """Belts as JSON of somebody's script, with other keys in other orders."""
    path = folder / "belts.json"
    names = ("tl", "tr", "bl", "br")
    rows = [dict(zip(names, map(float, row), strict=True)) for row in sled()]
    path.write_text(json.dumps([dict(sorted(row.items())) for row in rows], indent=None))
    return path


def an_old_printer(folder: Path) -> Path:
    """Steps as `step_distance`, all in the body, options with `=` and tabs, no saved block."""
    path = folder / "delta.cfg"
    text = PRINTER.split("#*# <")[0].replace("[delta_calibrate]\nradius: 50\n", "")
    for old in ("microsteps: 32\n", "microsteps: 16\n", "gear_ratio: 2:1\n"):
        text = text.replace(old, "")
    text = text.replace("rotation_distance: 60", "step_distance\t=\t.009375 ; measured")
    path.write_text(text + "[delta_calibrate]\nradius = 50\n" + probes(9).replace("#*# ", ""))
    return path


def a_topic_echoed_as_csv(folder: Path) -> Path:
    """What `rostopic echo -p` writes: times in nanoseconds, joints by their numbers."""
    path = folder / "joints.csv"
    lines = [
        "%time,field.header.seq,field.header.stamp,field.name0,field.position0,field.position1"
    ]
    for k in range(20):
        time = 1_600_000_000_000_000_000 + 20_000_000 * k
        lines.append(f"{time},{k},{time},elbow,{0.01 * k},{-0.02 * k}")
    path.write_text("\n".join(lines) + "\n")
    return path


def a_table_with_semicolons(folder: Path) -> Path:
    """A spreadsheet of a country that writes 0,5."""
    path = folder / "messung.csv"
    rows = "\n".join(f"{k},5;{k},25" for k in range(1, 9))
    path.write_text(f"time;elbow\n{rows}\n", encoding="utf-8-sig")
    return path


def a_data_set_without_names(folder: Path) -> Path:
    """Version 2.0, joints without names, no leader."""
    pyarrow = pytest.importorskip("pyarrow")
    parquet = pytest.importorskip("pyarrow.parquet")
    root = folder / "set"
    (root / "meta").mkdir(parents=True)
    (root / "data" / "chunk-000").mkdir(parents=True)
    info = {"codebase_version": "v2.0", "fps": 50, "total_episodes": 1}
    info |= {"data_path": "data/chunk-{episode_chunk:03d}/episode_{episode_index:06d}.parquet"}
    info |= {"features": {"observation.state": {"dtype": "float32", "shape": [3], "names": None}}}
    (root / "meta" / "info.json").write_text(json.dumps(info))
    state = np.random.default_rng(0).uniform(-1, 1, (30, 3)).astype(np.float32)
    cells = pyarrow.FixedSizeListArray.from_arrays(pyarrow.array(state.ravel()), 3)
    table = pyarrow.table({"observation.state": cells, "episode_index": np.zeros(30, dtype=int)})
    parquet.write_table(table, root / "data" / "chunk-000" / "episode_000000.parquet")
    return root


READ: dict[str, tuple[Callable[[Path], Path], dict[str, object], tuple[int, str]]] = {
    "a console of a browser": (a_console_of_a_browser, {}, (25, "tl")),
    "JSON of a script": (json_of_a_script, {}, (25, "br")),
    "an old printer": (an_old_printer, {}, (9, "c")),
    "a topic echoed as CSV": (
        a_topic_echoed_as_csv,
        {"format": "columns", "channels": {"q1": "field.position0"}, "hold": 0},
        (20, "q1"),
    ),
    "a table with semicolons": (
        a_table_with_semicolons,
        {"format": "columns", "hold": 0},
        (8, "elbow"),
    ),
    "a data set without names": (a_data_set_without_names, {}, (30, "follower_joint_2")),
}


@pytest.mark.parametrize("name", READ)
def test_a_file_of_a_stranger_is_read(name: str, tmp_path: Path) -> None:
    made, options, (rows, column) = READ[name]
    (session,) = rsicalib.import_log(made(tmp_path), **options).sessions  # type: ignore[arg-type]
    assert len(session) == rows and column in session.columns


REFUSED: dict[str, tuple[str, bytes, str]] = {
    "a log saved as UTF-16": ("serial.log", clbm(sled()).encode("utf-16"), "UTF-16"),
    "a printer that is no delta": (
        "printer.cfg",
        b"[printer]\nkinematics: corexy\n[stepper_a]\nx: 1\n",
        "line 2, .printer. kinematics: found 'corexy', expected delta",
    ),
    "a half of a data set": ("info.json", b'{"codebase_version": "v2.1"}', "total_episodes: found"),
    "a zip of a bag": ("bag.zip", b"PK\x03\x04" + bytes(100), "no log of a known kind"),
}


@pytest.mark.parametrize("name", REFUSED)
def test_a_file_that_cannot_be_used_is_refused_with_what_to_do(name: str, tmp_path: Path) -> None:
    file, data, message = REFUSED[name]
    path = tmp_path / file
    if file == "info.json":
        path = tmp_path / "set"
        (path / "meta").mkdir(parents=True)
        (path / "meta" / file).write_bytes(data)
    else:
        path.write_bytes(data)
    with pytest.raises(InputError, match=message):
        rsicalib.import_log(path)
