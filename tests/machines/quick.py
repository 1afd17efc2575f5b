"""What quick fits give on readings of real machines: plain least squares, no truth.

`python -m tests.machines.quick FOLDER` prints them, where FOLDER has `maslow`, `delta`,
`dvrk_plane`, `motoman_planes` and `so101`. Geometry is read from the mechanism files of the
folder; the mathematics is here. Distances from a plane, and of points: mm. Belts: the mean of the
samples of a position is one draw.
"""

from __future__ import annotations

import csv
import sys
import tomllib
from pathlib import Path
from typing import Any

import numpy as np

from tests.machines import plain
from tests.machines.plain import Quick
from tests.oracle import Array

BELTS = ("tl", "tr", "bl", "br")
ARM_JOINTS = ("q1", "q2", "q3", "q4", "q5", "q6")
MOTOMAN = ("rS", "rL", "rU", "rR", "rB", "rT")
PAIRS = ("shoulder_pan", "shoulder_lift", "elbow_flex", "wrist_flex", "wrist_roll")
MM = 1e3


def columns(file: Path, names: tuple[str, ...]) -> Array:
    """Columns of a file, (n, names); what is empty is NaN."""
    with file.open(encoding="utf-8") as text:
        rows = [[float(row[name] or "nan") for name in names] for row in csv.DictReader(text)]
    return np.array(rows)


def mechanism(file: Path) -> dict[str, Any]:
    """A mechanism file as values."""
    return tomllib.loads(file.read_text(encoding="utf-8"))


def rows_of(file: Path) -> list[plain.Row]:
    """The rows of the one chain of a file."""
    out: list[plain.Row] = mechanism(file)["chain"][0]["dh"]
    return out


# ------------------------------------------------------------------------------- belts


def belts(file: Path, lower_gain: bool = False, common: bool = False, width: float = 3e3) -> Quick:
    """Anchors and places of the sled, then per mil of the lower belts, then mm of all belts.

    The sled starts where the two lower circles meet, anchors at the corners of a frame as wide as
    `width` and 2/3 as high.
    """
    pose = columns(file, ("pose",))[:, 0]
    read = columns(file, BELTS)
    read = np.array([read[pose == k].mean(axis=0) for k in np.unique(pose)])
    height = {p["name"]: p["at"][2] for p in mechanism(file.parent / "maslow.toml")["point"]}
    z = np.array([height[n] for n in ("top left", "top right", "bottom left", "bottom right")])
    n, low = len(read), np.array([0.0, 0.0, 1.0, 1.0])

    def gap(p: Array) -> Array:
        x, y = np.array([p[0], p[2], 0.0, p[4]]), np.array([p[1], p[3], 0.0, 0.0])
        sled = p[5 : 5 + 2 * n].reshape(n, 2)
        length = np.sqrt((sled[:, :1] - x) ** 2 + (sled[:, 1:] - y) ** 2 + z**2)
        told = read * (1 + 1e-3 * low * p[5 + 2 * n]) if lower_gain else read
        return np.asarray((length - told - (p[-1] if common else 0.0)).ravel())

    across = (read[:, 2] ** 2 - read[:, 3] ** 2 + width**2) / (2 * width)
    up = np.sqrt(np.maximum(read[:, 2] ** 2 - across**2, 1.0))
    start = [0.0, width * 2 / 3, width, width * 2 / 3, width]
    effects = [0.0] * (lower_gain + common)
    found = plain.quick(gap, [*start, *np.column_stack([across, up]).ravel(), *effects])
    keep = [*range(5), *range(5 + 2 * n, found.value.size)]
    dof = found.left.size - found.value.size  # the sleds' places count
    left = found.left * np.sqrt((found.left.size - len(keep)) / dof)
    return Quick(found.value[keep], found.sd[keep], left)


# ------------------------------------------------------------------------------- delta

Free = tuple[tuple[int, ...], ...]
"""One entry for each parameter: the values that it moves."""

ENDSTOPS: Free = ((0,), (1,), (2,))
RADIUS: Free = ((3, 4, 5),)
TOWERS: Free = ((6,), (7,))
RODS: Free = ((9,), (10,))


def delta(folder: Path, free: Free) -> Quick:
    """Height of the nozzle over the bed [mm].

    Free are offsets of carriages (0-2), radii (3-5), bearings of towers (6-8) [rad] and lengths of
    rods (9-11), each entry one parameter for all that it lists.
    """
    file = mechanism(folder / "delta.toml")
    steps = columns(folder / "probes.csv", ("a", "b", "c"))
    base = [chain["dh"][0] for chain in file["chain"]]
    rods = [c["value"] for c in file["closure"] if c["kind"] == "distance"]
    drawn = np.array([0.0] * 3 + [row["a"] for row in base] + [row["theta"] for row in base] + rods)
    moves = np.zeros((12, len(free)))
    for k, one in enumerate(free):
        moves[list(one), k] = 1.0
    up = np.array([c["offset"] for c in file["channel"]]) + steps * file["channel"][0]["gain"]

    def height(p: Array) -> Array:
        at = drawn + moves @ p
        x, y = at[3:6] * np.cos(at[6:9]), at[3:6] * np.sin(at[6:9])
        centres = np.stack([x + 0 * up, y + 0 * up, up + at[:3]], axis=2)
        return np.asarray(plain.three_spheres(centres, at[9:12])[:, 2])

    if not free:
        return Quick(np.zeros(0), np.zeros(0), height(np.zeros(0)))
    return plain.quick(height, np.zeros(len(free)))


# ------------------------------------------------------------------------------- arms


class Arm:
    """Readings of an arm, and its tool for small changes of coordinates and of the tool."""

    def __init__(self, file: Path, rows: list[plain.Row], names: tuple[str, ...], tool: Any = None):
        self.q, self.rows, self.names = columns(file, names), rows, names
        self.at = np.array(tool or [0.0, 0.0, 0.0])

    def tool(self, offsets: Array | float = 0.0, at: Array | float = 0.0) -> Array:
        """Places of the tool, (n, 3) [mm]."""
        q = self.q + offsets
        read = dict(zip(self.names, q.T, strict=True))
        return MM * plain.place(plain.frames(self.rows, read, len(q)), self.at + at)

    def height(self, free: list[int], tool: int = 0, bent: bool = False) -> Quick:
        """Distance from a plane with free zeros of joints, then tool coordinates, then bends.

        The plane is z = a + b x + c y in axes that the nominal points lie along.
        """
        middle, axes = plain.axes_of(self.tool())

        def off(p: Array) -> Array:
            zeros = np.zeros(len(self.names))
            zeros[free] = p[3 : 3 + len(free)]
            at = np.zeros(3)
            at[:tool] = p[3 + len(free) : 3 + len(free) + tool]
            x, y, z = ((self.tool(zeros, at) - middle) @ axes.T).T
            curve = p[-3] * x * x + p[-2] * x * y + p[-1] * y * y if bent else 0.0
            tilt = p[0] + p[1] * x + p[2] * y
            return np.asarray((z - tilt - MM * curve / MM**2) / np.sqrt(1 + p[1] ** 2 + p[2] ** 2))

        return plain.quick(off, np.zeros(3 + len(free) + tool + 3 * bent))


def da_vinci(folder: Path, name: str, free: bool = True) -> Quick:
    """Tip over its surface [mm]; the fourth value is the zero of joint 3 [m]."""
    psm = "psm3" if "PSM3" in name else "psm"
    tip = mechanism(folder / f"{psm}.toml")["point"][0]["at"]
    arm = Arm(folder / f"{name}.csv", rows_of(folder / f"{psm}.toml"), ARM_JOINTS, tip)
    return arm.height([2] if free else [])


def motoman(folder: Path, name: str) -> Arm:
    """One of the two sessions of the arm."""
    return Arm(folder / f"{name}.csv", rows_of(folder / "motoman_right.toml"), MOTOMAN)


def seen(folder: Path, name: str) -> Array:
    """What the tracker saw [mm], NaN where it did not."""
    return MM * columns(folder / f"{name}.csv", ("x", "y", "z"))


# ------------------------------------------------------------------------------- leader


def follow(file: Path, joint: str) -> tuple[int, float, float, int]:
    """Best lag [rows], scatter about a line [percent], slope, and rows that were not clamped."""
    both = columns(file, (f"leader_{joint}", f"follower_{joint}"))
    best = (0, np.inf, 0.0, 0)
    for lag in range(12):
        a, b = both[: len(both) - lag, 0], both[lag:, 1]
        free = (np.abs(a) < 99.9) & (np.abs(b) < 99.9)
        basis = np.column_stack([np.ones(free.sum()), a[free]])
        line = np.linalg.lstsq(basis, b[free], rcond=None)[0]
        scatter = float(np.std(b[free] - basis @ line))
        if scatter < best[1]:
            best = (lag, scatter, float(line[1]), int(free.sum()))
    return best


# ------------------------------------------------------------------------------- the table


def main(data: Path) -> None:
    """Prints every row."""
    files = sorted((data / "maslow").glob("*.csv"))
    print("belts: s plain, s lower gain, gain [per mil], s common offset too, offset [mm]")
    for file in files:
        width = 1450.0 if file.stem == "show" else 3000.0
        one = belts(file, width=width)
        two = belts(file, lower_gain=True, width=width)
        three = belts(file, lower_gain=True, common=True, width=width)
        gain, offset = pair(two, 5), pair(three, 6)
        print(f"  {file.stem:10s} {one.s:.2f}  {two.s:.2f}  {gain}  {three.s:.2f}  {offset}")
    print("delta: rms of height [mm], values")
    for moved in ((), ENDSTOPS, ENDSTOPS + RADIUS, ENDSTOPS + RADIUS + TOWERS):
        print("  ", line(delta(data / "delta", moved)))
    print("  ", line(delta(data / "delta", ENDSTOPS + RADIUS + TOWERS + RODS)))
    print("da Vinci: rms nominal, with a zero of joint 3 [mm], the zero [mm]")
    for file in sorted((data / "dvrk_plane").glob("PSM*.csv")):
        drawn, free = (da_vinci(data / "dvrk_plane", file.stem, f) for f in (False, True))
        print(f"  {file.stem}: {drawn.rms:.3f}  {free.rms:.3f}  {pair(free, 3, MM)}")
    print("Motoman: s of the plane with: nothing, a bend, the tool off its axis, both")
    for file in sorted((data / "motoman_planes").glob("*.csv")):
        arm = motoman(data / "motoman_planes", file.stem)
        cases = ((0, False), (0, True), (2, False), (2, True), (3, False), (3, True))
        print(f"  {file.stem}:", *(f"{arm.height([], t, b).s:.3f}" for t, b in cases))
    print("leader and follower: lag [rows], scatter [percent], slope, rows")
    for file in sorted((data / "so101").glob("*.csv")):
        for joint in PAIRS:
            lag, scatter, slope, rows = follow(file, joint)
            print(f"  {file.stem} {joint:14s} {lag} {scatter:.2f} {slope:.3f} {rows}")


def pair(found: Quick, k: int, scale: float = 1.0) -> str:
    """A value with its standard deviation."""
    return f"{scale * found.value[k]:.2f} ± {scale * found.sd[k]:.2f}"


def line(found: Quick) -> str:
    """What is left, and every value."""
    values = ", ".join(pair(found, k) for k in range(found.value.size))
    about = np.std(found.left) if not found.value.size else found.rms
    return f"{about:.3f} (s {found.s:.3f}): {values}"


if __name__ == "__main__":
    main(Path(sys.argv[1]))
