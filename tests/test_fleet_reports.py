"""Reports of single devices, to which the page of a fleet leads."""

from __future__ import annotations

import re
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import rsicalib
from rsicalib.fleets.devices import one_device
from rsicalib.fleets.standing_out import remarks, spreads

pytest.importorskip("pyarrow")


def rows(label: str, readings: Any, rest: Any) -> list[list[str]]:
    """Rows of a device as a table has them, those of its rest pose after the others."""
    poses = [(str(p), *v) for p, v in zip(readings.pose, readings.values, strict=True)]
    resting = [("rest", *v) for v in rest.values]
    return [[label, row[0], *(f"{cell:g}" for cell in row[1:])] for row in (*poses, *resting)]


@pytest.fixture(scope="module")
def dataset(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A sound device, one whose sensor is bent by much, and one that cannot be read."""
    sound = rsicalib.simulate(poses=24, samples=4, seed=1)
    whole = rsicalib.load_readings(rsicalib.DEMO / "readings.csv")
    resting = rsicalib.load_readings(rsicalib.DEMO / "rest.csv")
    channels = sound.readings.channels
    lines = [["device", "pose", *channels]]
    lines += rows("a & b", sound.readings, sound.rest)
    lines += rows("<bent>", whole, resting)
    broken = rows("broken", sound.readings, sound.rest)
    broken[3][4] = "x"
    path = tmp_path_factory.mktemp("fleet") / "devices.csv"
    path.write_text("\n".join(",".join(line) for line in [*lines, *broken]), encoding="utf-8")
    return path


def test_a_device_that_stands_out_has_a_report_and_a_link_to_it(
    dataset: Path, tmp_path: Path
) -> None:
    told: list[tuple[str, int, int]] = []
    found = rsicalib.fleet(dataset, out=tmp_path, progress=lambda *it: told.append(it))
    verdicts = dict(zip(found.rows["device"], found.rows["verdict"], strict=True))
    assert verdicts == {"a & b": "adequate", "<bent>": "explained", "broken": None}
    page = (tmp_path / "fleet.html").read_text(encoding="utf-8")
    links = re.findall(r'<a href="(devices/[^"]+)">([^<]+)</a>', page)
    assert [name for _, name in links] == ["&lt;bent&gt;"]  # what cannot be read has none
    report = (tmp_path / links[0][0]).read_text(encoding="utf-8")
    # What the page says of it is what a trace of the device alone says, its rest pose included.
    alone = rsicalib.trace(rsicalib.DEMO / "readings.csv", rest=rsicalib.DEMO / "rest.csv")
    (step,) = alone.steps
    assert "Calibration of rsi · &lt;bent&gt;" in report and f"{step.term} of sensor" in report
    row = dict(zip(found.rows["device"], found.rows["chi2"], strict=True))["<bent>"]
    assert row == alone.after.chi2
    assert "<td>χ² / degrees of freedom</td>" in report and f"{alone.after.chi2:.0f} /" in report
    assert told[-1] == ("reports", 1, 1)  # what cannot be read takes no place of another
    assert {path.name for path in (tmp_path / "devices").iterdir()} == {Path(links[0][0]).name}


def test_no_report_is_written_where_none_is_wanted(dataset: Path, tmp_path: Path) -> None:
    found = rsicalib.fleet(dataset, out=tmp_path, reports=1)
    (report,) = (tmp_path / "devices").iterdir()
    assert report in found.files
    rsicalib.fleet(dataset, out=tmp_path, reports=0)
    assert not report.exists()  # that of the run before is of other numbers
    assert "devices/" not in (tmp_path / "fleet.html").read_text(encoding="utf-8")
    with pytest.raises(rsicalib.InputError, match="reports"):
        rsicalib.fleet(dataset, out=tmp_path, reports=-1)


def test_the_rows_of_a_device_are_taken_wherever_they_stand() -> None:
    frame: dict[str, Any] = {
        "device": ["a", "b", "a", "b", "a"],
        "pose": ["1", "1", "2", "rest", "rest"],
        "x": np.arange(5.0),
    }
    readings, rest = one_device(frame, None, "device", "a")
    assert list(readings["x"]) == [0.0, 2.0] and list(readings["pose"]) == ["1", "2"]
    assert rest is not None and list(rest["x"]) == [4.0] and set(rest) == {"x"}
    apart = {"device": ["b"], "x": np.array([7.0])}
    _, rest = one_device({k: v[:3] for k, v in frame.items()}, apart, "device", "b")
    assert rest is not None and rest["x"].tolist() == [7.0]
    assert one_device({k: v[:3] for k, v in frame.items()}, apart, "device", "a")[1] is None


def test_what_no_device_tells_makes_none_stand_out() -> None:
    """An offset that stays as drawn is zero but for rounding."""
    rng = np.random.default_rng(221)
    rows = {
        "device": [*range(20)],
        "verdict": ["adequate"] * 20,
        "message": [""] * 20,
        "chi2": [100.0] * 20,
        "dof": [100.0] * 20,
        "offset@q1": [*(1e-17 * rng.standard_normal(19)), 1e-15],
        "offset@q1_sd": [None] * 20,
        "offset@q2": [*(1e-3 * rng.standard_normal(19)), 0.1],
        "offset@q2_sd": [1e-3] * 20,
    }
    spread = spreads(rows)
    assert [one.name for one in spread] == ["offset@q2"]
    assert [(one.device, one.parameter) for one in remarks(rows, "device", spread)] == [
        (19, "offset@q2")
    ]
