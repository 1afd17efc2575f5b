"""Damage to good files, as people do it."""

from __future__ import annotations

import csv
import json
import re
import shutil
from collections.abc import Callable
from pathlib import Path
from typing import Any

Damage = Callable[[Path], object]
"""Changes files in a folder."""


def edit(name: str, *changes: tuple[str, str], count: int = 0) -> Damage:
    """Replace patterns in a file; all of them, or as many as `count`."""

    def damage(folder: Path) -> None:
        text = (folder / name).read_text(encoding="utf-8")
        for pattern, new in changes:
            text, found = re.subn(pattern, new, text, count=count, flags=re.M)
            assert found, pattern
        (folder / name).write_text(text, encoding="utf-8")

    return damage


def chained(*changes: Damage) -> Damage:
    """One change after the other."""

    def damage(folder: Path) -> None:
        for change in changes:
            change(folder)

    return damage


def line(number: int, new: Callable[[str], str], name: str = "readings.csv") -> Damage:
    """Change one line of a file, from 1."""

    def damage(folder: Path) -> None:
        lines = (folder / name).read_text(encoding="utf-8").splitlines()
        lines[number - 1] = new(lines[number - 1])
        (folder / name).write_text("\n".join(lines) + "\n", encoding="utf-8")

    return damage


def cell(number: int, column: int, value: str, name: str = "readings.csv") -> Damage:
    """Change one cell of a file."""

    def changed(text: str) -> str:
        cells = text.split(",")
        cells[column] = value
        return ",".join(cells)

    return line(number, changed, name)


def column(prefix: str, change: Callable[[float, int], str], name: str = "readings.csv") -> Damage:
    """Change the cells of all columns whose name begins so, by value and row, from 0."""

    def damage(folder: Path) -> None:
        with (folder / name).open(encoding="utf-8", newline="") as file:
            head, *rows = csv.reader(file)
        at = [k for k, title in enumerate(head) if title.startswith(prefix)]
        for number, row in enumerate(rows):
            for k in at:
                row[k] = change(float(row[k]), number)
        with (folder / name).open("w", encoding="utf-8", newline="") as file:
            csv.writer(file, lineterminator="\n").writerows([head, *rows])

    return damage


def rolled(folder: Path) -> None:
    """Known poses, each in the rows of the pose before."""
    path = folder / "check.csv"
    with path.open(encoding="utf-8", newline="") as file:
        head, *rows = csv.reader(file)
    at = head.index("x")
    assert head[at : at + 6] == ["x", "y", "z", "rx", "ry", "rz"]
    poses = [row[at : at + 6] for row in rows]
    samples = sum(row[0] == rows[0][0] for row in rows)
    for row, pose in zip(rows, poses[samples:] + poses[:samples], strict=True):
        row[at : at + 6] = pose
    with path.open("w", encoding="utf-8", newline="") as file:
        csv.writer(file, lineterminator="\n").writerows([head, *rows])


def result(change: Callable[[dict[str, object]], object]) -> Damage:
    """Change the document of the result."""

    def damage(folder: Path) -> None:
        document = json.loads((folder / "result.json").read_text(encoding="utf-8"))
        change(document)
        (folder / "result.json").write_text(json.dumps(document), encoding="utf-8")

    return damage


def recoded(encoding: str, name: str = "readings.csv", words: str = "") -> Damage:
    """Write a file in another encoding, with a comment of these words above."""

    def damage(folder: Path) -> None:
        text = (folder / name).read_text(encoding="utf-8")
        (folder / name).write_bytes((f"# {words}\n" * bool(words) + text).encode(encoding))

    return damage


def decimal_commas(folder: Path) -> None:
    """Readings as a spreadsheet of another country saves them."""
    text = (folder / "readings.csv").read_text(encoding="utf-8")
    text = text.replace(",", ";").replace(";21;", ";21.5;").replace(".", ",")
    (folder / "readings.csv").write_text(text, encoding="utf-8")


def comma_twice(folder: Path) -> None:
    """Decimal commas between commas."""
    cell(2, 4, "2137,5")(folder)


def reversed_sensor(folder: Path) -> None:
    """A sensor that counts the other way."""
    path = folder / "readings.csv"
    head, *rows = [text.split(",") for text in path.read_text(encoding="utf-8").splitlines()]
    for row in rows:
        row[head.index("a21")] = str(4095 - int(row[head.index("a21")]))
    path.write_text("\n".join(map(",".join, [head, *rows])) + "\n", encoding="utf-8")


def joints(count: int) -> Damage:
    """A mechanism with a chain of many joints."""

    def damage(folder: Path) -> None:
        rows = ", ".join(f'{{channel = "q{k}", a = 1.0}}' for k in range(count))
        channels = "".join(
            f'[[channel]]\nname = "q{k}"\nunit = "rad"\ngain = 1.0\noffset = 0.0\n'
            for k in range(count)
        )
        text = (
            f'name = "snake"\nlength_unit = "m"\n{channels}[[chain]]\nname = "snake"\n'
            f'dh = [{rows}]\n[[point]]\nname = "tip"\nchain = "snake"\nat = [1.0, 0.0, 0.0]\n'
            '[[point]]\nname = "base"\nat = [0.5, 0.0, 0.0]\n[[closure]]\nname = "rope"\n'
            'kind = "distance"\nbetween = ["tip", "base"]\nvalue = 1.0\n'
        )
        (folder / "rsi.toml").write_text(text, encoding="utf-8")

    return damage


def fixed_rows(count: int) -> Damage:
    """A mechanism whose first chain has many fixed rows."""
    return edit(
        "rsi.toml",
        (r"(name = \"arm1\"\n)", r"\1\n" + "[[chain.dh]]\na = 0.0\n" * count),
        count=1,
    )


def repeated(times: int) -> Damage:
    """The session, many times over as poses of their own."""

    def damage(folder: Path) -> None:
        path = folder / "readings.csv"
        head, *rows = path.read_text(encoding="utf-8").splitlines()
        with path.open("w", encoding="utf-8") as out:
            out.write(head + "\n")
            for turn in range(times):
                for row in rows:
                    pose, sample, time_s, rest = row.split(",", 3)
                    later = float(time_s) + 1e4 * turn
                    out.write(f"{int(pose) + 48 * turn},{sample},{later:g},{rest}\n")

    return damage


def read_only(folder: Path) -> None:
    """A folder into which nothing can be written: a file stands where it ought to be."""
    (folder / "out").write_text("notes of mine\n", encoding="utf-8")


def foreign(folder: Path) -> None:
    """A folder with measured readings."""
    (folder / "out").mkdir()
    shutil.copy(folder / "readings.csv", folder / "out" / "readings.csv")


def write(name: str, text: str | bytes) -> Damage:
    """Write a file."""

    def damage(folder: Path) -> None:
        (folder / name).write_bytes(text if isinstance(text, bytes) else text.encode())

    return damage


def no_covariance(document: dict[str, object]) -> None:
    document["covariance"] = [[1.0]]


def first(document: dict[str, object], **values: object) -> None:
    """Change the first parameter of a result."""
    parameters = document["parameters"]
    assert isinstance(parameters, list)
    parameters[0].update(values)


def drop(document: dict[str, object]) -> None:
    parameters = document["parameters"]
    assert isinstance(parameters, list)
    del parameters[3:10]


def gains(document: dict[str, object]) -> None:
    """All gains times 1000."""
    for parameter in _parameters(document):
        if parameter["term"] == "gain":
            parameter["value"] *= 1000.0


def undigested_gains(document: dict[str, object]) -> None:
    """The same in a result without a digest."""
    gains(document)
    del document["digest"]


def exchanged(document: dict[str, object]) -> None:
    """The values of two offsets exchanged."""
    one, other = _parameters(document)[:3:2]
    one["value"], other["value"] = other["value"], one["value"]


def askew(document: dict[str, object]) -> None:
    """A covariance that says of two parameters one thing here and another there."""
    covariance = document["covariance"]
    assert isinstance(covariance, list)
    covariance[1][0] *= 1.5


def short_curve(document: dict[str, object]) -> None:
    """A curve whose first row has lost its correction."""
    steps = document["steps"]
    assert isinstance(steps, list)
    del steps[0]["curve"][0][1]


def _parameters(document: dict[str, object]) -> list[dict[str, Any]]:
    parameters = document["parameters"]
    assert isinstance(parameters, list)
    return parameters


def no_noise(document: dict[str, object]) -> None:
    """Noise of all channels but one."""
    noise = document["noise"]
    assert isinstance(noise, dict)
    del noise["sigma"]["a11"]
