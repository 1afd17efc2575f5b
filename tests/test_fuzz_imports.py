"""Damaged logs of other programs: a refusal that names the log, or numbers that the log held."""

from __future__ import annotations

import re
import tomllib
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

import rsicalib
from rsicalib import InputError
from rsicalib.imports.kinds import KINDS
from rsicalib.io.mjcf import mechanism_of_mjcf
from tests.test_fuzz import CASES, damaged, many
from tests.test_imports import PRINTER, clbm, probes, sled
from tests.test_imports_robots import FORMS, dataset
from tests.test_messages_of_topics import echo
from tests.test_mjcf import CLOSED, model

FEW = settings(many, max_examples=max(CASES // 20, 50))
NUMBER = re.compile(r"[+-]?(?:\d+\.?\d*|\.\d+)(?:[eE][+-]?\d+)?")

TEXTS = {
    "maslow": f"[MSG:INFO: Measured]\n{clbm(sled()[:6])}\n(0.1, 2100), (3000.2, 2100)\n",
    "klipper": PRINTER + probes(4),
    "columns": "__time,/a/q1/position,/a/q2/position\n"
    + "".join(f"{1.7e9 + k / 8},{k}.5,{-k}.25\n" for k in range(9)),
    "columns of Foxglove": "elapsed time,receive time,header.stamp,topic,value\n"
    + "".join(f"{k / 8},{1.7e9 + k / 8},,/a.{j},{k}.5\n" for j in range(2) for k in range(9)),
    "echo": echo(np.arange(8.0).reshape(4, 2) / 4),
}


@pytest.fixture(scope="module")
def scratch(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return tmp_path_factory.mktemp("fuzz")


@pytest.mark.parametrize("kind", TEXTS)
@FEW
@given(data=st.data())
def test_a_damaged_text_is_refused_with_its_name_or_held_what_is_read(
    scratch: Path, kind: str, data: st.DataObject
) -> None:
    text = data.draw(damaged(TEXTS[kind]))
    path = scratch / f"{kind}.txt"
    path.write_bytes(text.encode("utf-8", "surrogatepass"))
    try:
        log = rsicalib.import_log(path, format=kind.split()[0])
    except InputError as error:
        assert str(path) in str(error)
        return
    held = {float(number) for number in NUMBER.findall(text)}
    for session in log.sessions:
        for name, cells in session.columns.items():
            if name not in ("pose", "sample", "time_s"):
                assert {abs(v) for v in np.asarray(cells).tolist()} <= {abs(v) for v in held}
    if log.mechanism is not None:
        tomllib.loads(log.mechanism)


@FEW
@given(text=damaged(model(CLOSED["connect of bodies"])))
def test_a_damaged_model_is_refused_with_its_name_or_makes_a_mechanism(
    scratch: Path, text: str
) -> None:
    path = scratch / "model.xml"
    path.write_bytes(text.encode("utf-8", "surrogatepass"))
    try:
        document, _ = mechanism_of_mjcf(path)
    except InputError as error:
        assert str(path) in str(error)
        return
    assert document["closure"]


@FEW
@given(data=st.data())
def test_a_damaged_description_of_a_data_set_is_refused_with_its_name_or_read(
    scratch: Path, data: st.DataObject
) -> None:
    root = scratch / "set"
    if not root.exists():
        dataset(root, "v2.1", FORMS["v2.1"], episodes=1, rows=20)
    info = root / "meta" / "info.json"
    whole = (root / "info.whole").read_text() if (root / "info.whole").exists() else None
    if whole is None:
        whole = info.read_text()
        (root / "info.whole").write_text(whole)
    info.write_bytes(data.draw(damaged(whole)).encode("utf-8", "surrogatepass"))
    try:
        log = rsicalib.import_log(root)
    except InputError as error:
        assert str(root) in str(error) or "episode 0" in str(error)
        return
    assert len(log.sessions[0])


@pytest.fixture(scope="module")
def bytes_of(tmp_path_factory: pytest.TempPathFactory) -> dict[str, tuple[str, bytes]]:
    """Files of each binary kind that a library is there for."""
    from tests import test_imports_robots as robots
    from tests import test_imports_ros as ros
    from tests.strangers import bags

    folder = tmp_path_factory.mktemp("whole")
    out = {}
    path = folder / "episode_0.hdf5"
    robots.episode(path)
    out["episode_0.hdf5"] = ("aloha", path.read_bytes())
    other = bags.FILES["MCAP with JSON"][0](folder)
    out["json.mcap"] = ("ros", other.read_bytes())
    out["run.mcap"] = ("ros", ros.mcap(folder / "run.mcap", ros.states(ros.moves(1))).read_bytes())
    bag = ros.rosbag2(folder / "run", ros.states(ros.moves(1)))
    out["run.db3"] = ("ros", next(bag.glob("*.db3")).read_bytes())
    parquet = pytest.importorskip("pyarrow.parquet")
    pyarrow = pytest.importorskip("pyarrow")
    table = pyarrow.table({"time_s": np.arange(9) / 8, "q1": np.arange(9.0)})
    parquet.write_table(table, folder / "rows.parquet")
    out["rows.parquet"] = ("columns", (folder / "rows.parquet").read_bytes())
    return out


@pytest.mark.parametrize(
    "name", ["episode_0.hdf5", "run.mcap", "json.mcap", "run.db3", "rows.parquet"]
)
def test_a_damaged_file_of_bytes_is_refused_with_its_name_or_read(
    scratch: Path, bytes_of: dict[str, tuple[str, bytes]], name: str
) -> None:
    kind, whole = bytes_of[name]
    rng = np.random.default_rng(0)
    path = scratch / name
    refused = 0
    for case in range(max(CASES // 20, 50)):
        data = np.frombuffer(whole, dtype=np.uint8).copy()
        if case % 3 == 0:
            data = data[: rng.integers(0, len(data))]
        else:
            at = rng.integers(0, len(data), rng.integers(1, 30))
            data[at] = rng.integers(0, 256, len(at))
        path.write_bytes(data.tobytes())
        try:
            rsicalib.import_log(path, format=kind, hold=0)
        except InputError as error:
            assert str(path) in str(error)
            refused += 1
    assert refused > 10
    assert set(KINDS) >= {kind}
