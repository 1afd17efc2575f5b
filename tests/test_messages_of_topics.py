"""Topics as text: joint states that `ros2 topic echo` prints, as they arrive."""

from __future__ import annotations

import json
import subprocess
import sys
import threading
import time
from pathlib import Path

import numpy as np
import pytest

import rsicalib
from rsicalib import InputError
from rsicalib.guide.log import Columns, Sample
from rsicalib.guide.run import guide
from rsicalib.guide.source import open_source
from rsicalib.io.messages import as_json, documents, message_of
from rsicalib.io.stream import rows_of
from tests.channels import Named

NAMES = ("q1", "q2")
OTHER = "header:\n  stamp:\n    sec: 5\n    nanosec: 0\nname:\n- finger\nposition:\n- 0.2\n---\n"


def echo(values: np.ndarray, first: int = 0) -> str:
    """What the command prints of rows (n, 2), names in turn in both orders, at 50 Hz."""
    out = ""
    for k, row in enumerate(values.tolist(), first):
        order = (0, 1) if k % 2 else (1, 0)
        out += f"header:\n  stamp:\n    sec: {k // 50}\n    nanosec: {k % 50 * 20_000_000}\n"
        out += "  frame_id: ''\nname:\n" + "".join(f"- {NAMES[i]}\n" for i in order)
        out += "position:\n" + "".join(f"- {row[i]!r}\n" for i in order)
        out += "velocity: []\neffort: []\n---\n"
    return out


VALUES = np.random.default_rng(0).normal(size=(7, 2))


def test_messages_are_rows_as_they_stand_there(tmp_path: Path) -> None:
    path = tmp_path / "echo.txt"
    lost = "A message was lost!!!\n\ttotal count change:1\n\ttotal count: 1---\n"
    path.write_text(echo(VALUES[:3]) + OTHER + lost + echo(VALUES[3:], 3))
    rows = list(rows_of(path, Named(*NAMES)))
    assert np.array_equal(np.vstack([r.values for r in rows]), VALUES)
    times = np.concatenate([r.time_s for r in rows if r.time_s is not None])
    assert times == pytest.approx(np.arange(7) / 50)


def test_a_message_that_is_not_whole_is_a_row_that_cannot_be_used(tmp_path: Path) -> None:
    path = tmp_path / "echo.txt"
    path.write_text(echo(VALUES[:2]) + echo(VALUES[2:3]).rsplit("- ", 1)[0])
    values = np.vstack([r.values for r in rows_of(path, Named(*NAMES))])
    assert np.array_equal(values[:2], VALUES[:2]) and np.isnan(values[2]).any()


def test_json_a_line_is_rows_too(tmp_path: Path) -> None:
    path = tmp_path / "states.jsonl"
    made = [{"name": ["q2", "q1"], "position": row[::-1]} for row in VALUES.tolist()]
    path.write_text("\n".join(map(json.dumps, made)))
    assert np.array_equal(np.vstack([r.values for r in rows_of(path, Named(*NAMES))]), VALUES)
    path.write_text("\n".join(json.dumps(dict(zip(NAMES, row, strict=True))) for row in VALUES))
    assert np.array_equal(np.vstack([r.values for r in rows_of(path, Named(*NAMES))]), VALUES)


def test_the_guide_takes_what_the_command_prints(tmp_path: Path) -> None:
    path = tmp_path / "live.txt"
    path.write_text(echo(VALUES[:2]) + echo(VALUES[2:3])[:60])
    lines, columns = open_source(str(path)), Columns(NAMES)
    found: list[object] = []
    for more in (echo(VALUES[2:3])[60:], ""):
        with path.open("a") as file:
            file.write(more)
        for _ in range(50):
            found += [columns.sample(line, 0.0) for line in lines.take(0.05)]
            if len(found) == 3:
                break
    lines.close()
    assert [getattr(one, "values", one) for one in found] == [
        tuple(row) for row in VALUES[:3].tolist()
    ]


def test_messages_call_channels_by_their_joints_and_labels_fill_columns(tmp_path: Path) -> None:
    joints = {"q2": "elbow", "q1": "shoulder"}
    text = echo(VALUES).replace("- q1", "- shoulder").replace("- q2", "- elbow")
    path = tmp_path / "echo.txt"
    path.write_text(text)
    values = np.vstack([r.values for r in rows_of(path, Named(*joints), joints)])
    assert np.array_equal(values, VALUES[:, ::-1])
    columns = Columns(joints, ("at",), {"at": "cone"})
    first = columns.sample(next(as_json(text.splitlines())), 0.0)
    assert getattr(first, "values", first) == tuple(VALUES[0, ::-1])
    assert getattr(first, "keys", first) == ("cone",)
    rows = Columns(("q1", "q2"), ("at",), {"at": "cone"})
    assert rows.sample("q2,q1", 0.0) is None
    assert rows.sample("2,1", 0.0) == Sample(0.0, None, (1.0, 2.0), ("cone",))
    (tmp_path / "arms.toml").write_text(ARMS)
    with pytest.raises(InputError, match="labels: found 'at', expected none"):
        guide(tmp_path / "s", tmp_path / "arms.toml", target=1.0, labels={"at": "x"}, port=None)


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("name:\n- q1\nposition:\n- x\n", "'- x'"),
        ("name:\n- q1\nname:\n- q1\n", "name twice"),
        ("name: [q1, q2\n", "'name: [q1, q2'"),
        ("header:\n  stamp:\n    sec: soon\n", "'sec: soon'"),
        ("hello\n", "'hello'"),
        ('{"name": [', "no JSON"),
        ("[1, 2]", "'[1, 2]'"),
    ],
)
def test_what_is_no_message_is_said_in_words(text: str, words: str) -> None:
    assert words in str(message_of(text))
    ((_, whole),) = documents(text.splitlines())
    assert next(as_json(["---\n", *text.splitlines(keepends=True)])) == whole


def test_other_lines_stay_as_they_are() -> None:
    lines = ["\n", "a,b\n", "1,2\n", "---\n"]
    assert list(as_json(lines)) == lines[1:]


def follow(path: Path, result: Path, mechanism: Path) -> subprocess.Popen[str]:
    words = [sys.executable, "-m", "rsicalib", "watch", str(path), "--follow", "--quiet"]
    words += ["--calibration", str(result), "--mechanism", str(mechanism)]
    return subprocess.Popen(words, stdout=subprocess.PIPE, text=True)


ARMS = """\
name = "two arms"
length_unit = "m"
channel = [
  {name = "q1", unit = "rad", gain = 1.0, offset = 0.0, noise = 1e-3},
  {name = "q2", unit = "rad", gain = 1.0, offset = 0.0, noise = 1e-3},
]
closure = [{name = "together", kind = "equal", between = ["q1", "q2"]}]

[model]
terms = ["offset@q2"]
"""


def test_a_watch_follows_a_topic_that_is_written_to_a_file(tmp_path: Path) -> None:
    rng = np.random.default_rng(3)
    led = rng.uniform(-1, 1, 900)
    values = np.column_stack([led, led]) + 1e-3 * rng.normal(size=(900, 2))
    mechanism, result, live = (tmp_path / n for n in ("arms.toml", "result.json", "live.txt"))
    mechanism.write_text(ARMS)
    session = tmp_path / "readings.csv"
    np.savetxt(session, values[:200], delimiter=",", header="q1,q2", comments="")
    rsicalib.calibrate(session, mechanism, noise=1e-3).save(result)
    slipped = values[200:] + np.where(np.arange(700)[:, None] >= 350, [0.0, 0.05], 0.0)
    live.write_text(echo(slipped[:300]))
    with follow(live, result, mechanism) as process:
        assert process.stdout is not None
        rest = echo(slipped[300:], 300)
        with live.open("a") as file:  # it grows, at first to the middle of a message
            for part in (rest[: len(rest) // 7], rest[len(rest) // 7 :]):
                time.sleep(0.1)
                file.write(part)
                file.flush()
        ended = threading.Timer(60.0, process.kill)
        ended.start()
        alarm = json.loads(process.stdout.readline())  # while the file may grow still
        ended.cancel()
        process.kill()
    assert alarm["term"] == "offset" and alarm["since"] == pytest.approx(7.0, abs=0.1)
    assert abs(alarm["size"]) == pytest.approx(0.05, abs=4 * alarm["sd"])


def test_what_does_not_grow_is_not_followed(tmp_path: Path) -> None:
    from tests.test_imports import clbm, sled

    serial = tmp_path / "serial.log"
    serial.write_text(clbm(sled()))
    (tmp_path / "arms.toml").write_text(ARMS)
    np.savetxt(tmp_path / "r.csv", VALUES.repeat(5, 0), delimiter=",", header="q1,q2", comments="")
    found = rsicalib.calibrate(tmp_path / "r.csv", tmp_path / "arms.toml", noise=1.0)
    with pytest.raises(
        InputError, match="found a log of a Maslow4, which is read when it is whole"
    ):
        rsicalib.watch(serial, found, tmp_path / "arms.toml", follow=True)
    with pytest.raises(InputError, match="a Parquet file, which does not grow"):
        rsicalib.watch(tmp_path / "r.parquet", found, tmp_path / "arms.toml", follow=True)
