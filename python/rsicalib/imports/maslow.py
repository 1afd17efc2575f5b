"""Maslow4: belt lengths of a calibration, from the serial log or copied from it.

Each position is an object `{bl:749.78, br:2512.68, tr:2851.43, tl:1601.13}` [mm], all of them in
one list after `CLBM:` or an object a line, with messages of the firmware around. What the firmware
or its page found, `(tlx, tly), (trx, try)` or `Maslow_tlX: 0.6`, is where the search begins.
"""

from __future__ import annotations

import hashlib
import re
from dataclasses import dataclass, field

import numpy as np

from rsicalib._core import LARGEST
from rsicalib.errors import InputError
from rsicalib.imports.asked import Asked, chosen
from rsicalib.imports.log import Log, Session
from rsicalib.io.sources import decoded, read_bytes

BELTS = ("tl", "tr", "bl", "br")

REPEATS = 2.5
"""Lengths that differ by less [mm] are of one position: the firmware takes four readings there and
refuses them otherwise."""

NUMBER = r"[+-]?(?:\d+\.?\d*|\.\d+)(?:[eE][+-]?\d+)?"
OBJECT = re.compile(r"\{([^{}]*)(\}?)")
KEY = re.compile(r"""\s*["']?\w+["']?\s*:""")
BEGINS = re.compile(r"\s*run\b", re.I)
PAIR = re.compile(rf"""\s*["']?(\w+)["']?\s*:\s*({NUMBER})\s*""")
POINT = rf"\(\s*({NUMBER})\s*,\s*({NUMBER})\s*\)"
RESULT = re.compile(rf"^\s*{POINT}\s*,\s*{POINT}\s*$")
NAMED = re.compile(rf"(?:Maslow_|MaslowKinematics/)(t[lr]|b[lr])([XYZ])\s*[:=]\s*({NUMBER})")
HEIGHTS = {"tl": 100.0, "tr": 56.0, "bl": 34.0, "br": 78.0}
"""Heights of the belts above their anchors [mm], as the firmware has them unless it is told."""


@dataclass
class _Run:
    """Positions of one run, as they stand in the log, and what was made of them."""

    rows: list[list[float]] = field(default_factory=list)
    lines: list[int] = field(default_factory=list)
    found: dict[str, float] = field(default_factory=dict)
    results: int = 0
    """Lines with results so far: the anchors at the top, then those at the bottom."""


def read(source: str, asked: Asked) -> Log:
    """Read a log; a session for each run.

    Raises
    ------
    InputError
        A position lacks a belt, or something in it cannot be read.
    """
    data = read_bytes(source, "a log of a Maslow4")
    runs, replaced = _runs(decoded(data, source), source)
    if not runs:
        expected = "belt lengths such as {bl:749.78, br:2512.68, tr:2851.43, tl:1601.13}"
        raise InputError.at(source, "none", expected)
    places = chosen(asked.channels, BELTS, source, "belt")
    sessions = tuple(
        _session(run, places, asked, f"run {k}" if len(runs) > 1 else "")
        for k, run in enumerate(runs, 1)
    )
    findings = [f"{replaced} lists that a longer one repeats are not used"] if replaced else []
    frames = np.concatenate([run.rows for run in runs])
    start = {k: v for run in runs for k, v in run.found.items()}
    digest = hashlib.sha256(data).hexdigest()
    text = mechanism(frames, start) if tuple(places) == BELTS else None
    return Log(source, "log of a Maslow4", sessions, text, tuple(findings), sha256=digest)


def _runs(text: str, source: str) -> tuple[list[_Run], int]:
    """Runs in their order, and how many lists were said again in a longer one."""
    runs = [_Run()]
    for number, line in _lines(text):
        again = "CLBM:" in line or BEGINS.match(line) or (runs[-1].results and "{" in line)
        if again and runs[-1].rows:
            runs.append(_Run())
        runs[-1].found |= {m[1] + m[2].lower(): float(m[3]) for m in NAMED.finditer(line)}
        result = RESULT.match(line)
        if result:
            left, right = ("bl", "br") if runs[-1].results else ("tl", "tr")
            names = (f"{left}x", f"{left}y", f"{right}x", f"{right}y")
            runs[-1].found |= dict(zip(names, map(float, result.groups()), strict=True))
            runs[-1].results += bool(runs[-1].rows)
        for body in filter(_is_position, OBJECT.finditer(line)):
            lengths = _lengths(body[1], body[2], len(runs[-1].rows) + 1, number, source)
            runs[-1].rows.append(lengths)
            runs[-1].lines.append(number)
    kept: list[_Run] = []
    for run in filter(lambda run: run.rows, runs):
        if kept and run.rows[: len(kept[-1].rows)] == kept[-1].rows:
            kept.pop()  # the firmware prints what it has so far, again and again
        kept.append(run)
    replaced = sum(bool(run.rows) for run in runs) - len(kept)
    if all(len(run.rows) == 1 and not run.results for run in kept):
        kept = [_joined(kept)] if kept else []  # a list for each position is one list
    return kept, replaced


def _joined(runs: list[_Run]) -> _Run:
    """One run of the positions of several."""
    rows, lines = [run.rows[0] for run in runs], [run.lines[0] for run in runs]
    found = {name: at for run in runs for name, at in run.found.items()}
    return _Run(rows, lines, found)


def _lines(text: str) -> list[tuple[int, str]]:
    """Lines with their numbers; an object with a line for each belt is one line."""
    out: list[tuple[int, str]] = []
    for number, line in enumerate(text.splitlines(), 1):
        begun = out[-1][1].rpartition("{") if out else ("", "", "")
        is_open = begun[1] and "}" not in begun[2]
        between = begun[2].rstrip().endswith((",", ":")) or not begun[2].strip()
        if is_open and (line.lstrip().startswith("}") or (between and KEY.match(line))):
            out[-1] = (out[-1][0], f"{out[-1][1]} {line.strip()}")
        else:
            out.append((number, line))
    return out


def _is_position(body: re.Match[str]) -> bool:
    """Whether an object is one; another holds a list of them."""
    return bool(body[2]) or not body[1].rstrip().endswith("[")


def _lengths(body: str, end: str, position: int, line: int, source: str) -> list[float]:
    """Lengths of one position, in the order of `BELTS`; refused if they are not whole."""

    def refuse(found: str, expected: str) -> InputError:
        hint = "Characters get lost on the line: take the log again, or delete the position."
        place = f"position {position}"
        return InputError.at(source, found, expected, line=line, hint=hint, place=place)

    if end != "}":
        raise refuse(f"'{{{body[:40].strip()}', which does not end", "'}' before the next")
    lengths: dict[str, float] = {}
    for part in filter(str.strip, body.split(",")):
        match = PAIR.fullmatch(part)
        if match is None or match[1].lower() not in BELTS:
            raise refuse(repr(part.strip()), "a belt and its length, such as tr:2851.43")
        if match[1].lower() in lengths:
            raise refuse(f"{match[1]} twice", "each belt once")
        if not 0.0 < float(match[2]) <= LARGEST:
            raise refuse(f"{match[1]} of {match[2]}", "a length above zero")
        lengths[match[1].lower()] = float(match[2])
    missing = [belt for belt in BELTS if belt not in lengths]
    if missing:
        raise refuse(f"no {missing[0]}", f"each of {', '.join(BELTS)}")
    return [lengths[belt] for belt in BELTS]


def _session(run: _Run, places: dict[str, int], asked: Asked, name: str) -> Session:
    """Poses of a run: neighbours within the firmware's own limit are repeats."""
    values = np.array(run.rows)
    moved = np.abs(np.diff(values, axis=0)).max(axis=1, initial=0.0) > REPEATS
    pose = np.concatenate([[1], 1 + np.cumsum(moved)]).astype(np.int64)
    first = np.searchsorted(pose, pose)
    columns = {"pose": pose, "sample": np.arange(len(pose)) - first + 1}
    labels = {name: [text] * len(pose) for name, text in asked.labels.items()}
    belts = {channel: values[:, k] for channel, k in places.items()}
    return Session({**columns, **labels, **belts}, np.array(run.lines), name)


def mechanism(lengths: np.ndarray, found: dict[str, float]) -> str:
    """Mechanism file of a sled on four belts, whose anchors are looked for.

    The search begins at what the firmware found, else at the rectangle that suits the lengths.
    """
    width, height = _rectangle(lengths)
    drawn = {"tl": (0.0, height), "tr": (width, height), "bl": (0.0, 0.0), "br": (width, 0.0)}
    at = {
        belt: [
            found.get(f"{belt}x", x),
            found.get(f"{belt}y", y),
            found.get(f"{belt}z", HEIGHTS[belt]),
        ]
        for belt, (x, y) in drawn.items()
    }
    words = {"tl": "top left", "tr": "top right", "bl": "bottom left", "br": "bottom right"}
    free = {"tl": '["x", "y"]', "tr": '["x", "y"]', "br": '["x"]'}
    out = [
        "# A sled on four belts. Where the anchors are is not known, nor where the sled is.\n"
        "# Firmware differs in what it adds to a belt: 30 mm of its end and 123.4 mm of the arm.\n"
        "# Where that lacks, `trace` names an offset that all belts share.\n",
        'name = "Maslow4"\nlength_unit = "mm"\nchannel = [\n',
        *(
            f'  {{name = "{b}", unit = "mm", gain = 1.0, offset = 0.0, noise = 0.2}},\n'
            for b in BELTS
        ),
        "]\nclosure = [\n",
        *(
            f'  {{name = "belt {b}", kind = "distance", between = ["sled", "{words[b]}"], '
            f'channel = "{b}", noise = 0.8}},\n'
            for b in BELTS
        ),
        "]\n\n[[point]]                        # one for each pose, in the plane z = 0\n",
        f'name = "sled"\nunknown = ["pose"]\nat = [{width / 2:.1f}, {height / 2:.1f}, 0.0]\n',
        'free = ["x", "y"]\n',
    ]
    for belt in BELTS:
        place = ", ".join(repr(round(float(value), 6)) for value in at[belt])  # a nanometre
        out.append(f'\n[[point]]\nname = "{words[belt]}"\nat = [{place}]\n')
        if belt in free:
            out.append(f"unknown = []\nfree = {free[belt]}\n")
    return "".join([*out, "\n[model]\nterms = []\n"])


def _rectangle(lengths: np.ndarray) -> tuple[float, float]:
    """Width and height of the rectangle of anchors that suits the lengths best, to a step.

    From a rectangle with bottom left in the origin follow x = (bl² - br² + w²) / 2w and
    y = (bl² - tl² + h²) / 2h; what is left of x² + y² - bl² is made small.
    """
    tl, _, bl, br = lengths.T
    longest = float(lengths.max())
    sizes = np.linspace(0.2, 2.0, 181) * longest
    w, h = sizes[:, None, None], sizes[None, :, None]
    x, y = (bl**2 - br**2 + w**2) / (2 * w), (bl**2 - tl**2 + h**2) / (2 * h)
    left = np.abs(x**2 + y**2 - bl**2).mean(axis=-1)
    row, column = np.unravel_index(int(left.argmin()), left.shape)
    return float(sizes[row]), float(sizes[column])
