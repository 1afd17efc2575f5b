"""A serial chain of a URDF robot as rows of a mechanism, and back.

URDF joint `j` of the path, with its origin `A` and axis `a`, is written

```text
A · Rot(a, q) = A · R · Rz(q) · R⁻¹,    R z = a                          (1)
```

so that a row turns about (slides along) its own z: row 0 is fixed and carries
`A_1 R_1`, row `j` is the joint `j` and carries `R_j⁻¹ A_{j+1} R_{j+1}`, the last
one `R_n⁻¹ A_tip`. `A` takes in the fixed joints before it. Where the axis is z,
`R` is the identity and the numbers are those of the document. A joint walked
from child to parent is its inverse: axis `-a`, then `A⁻¹`.
"""

from __future__ import annotations

import math
import os
import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from itertools import pairwise
from typing import Any, TypedDict

import numpy as np

from rsicalib.io.rigid import Matrix, inverse, joint_motion, rigid, rotation, xyz_rpy
from rsicalib.io.sources import read_text
from rsicalib.io.toml_text import parse_toml
from rsicalib.io.urdf_path import JointPath, Mass, Masses, stretch
from rsicalib.io.urdf_tree import ORIGIN, Element, Joint, Robot, Step, listed, refuse

UNCHANGED = 1e-14
"""Elements of a transformation (rad, m) that differ by less do so by rounding."""


class Row(TypedDict, total=False):
    """A row of a chain, as in a mechanism file."""

    name: str
    channel: str
    joint: str
    ratio: float
    theta: float
    d: float
    a: float
    alpha: float
    xyz: list[float]
    rpy: list[float]
    mass: float
    com: list[float]


@dataclass(frozen=True)
class UrdfChain:
    """The chain between two links of a robot.

    Attributes
    ----------
    rows : list of Row
        A fixed row, then one for each moving joint, base first; they end in the
        frame of the tip. Lengths in metres, angles in radians. Each bears the
        names of the joints at its ends, and mass and com if there is any.
    limits : dict of str to list of float
        `[lower, upper]` of the joint of a channel [rad or m], where declared.
    joints : dict of str to str
        The joint that each channel senses, base first.
    notes : tuple of str
        What the rows could not take in.
    """

    rows: list[Row]
    limits: dict[str, list[float]]
    joints: dict[str, str]
    notes: tuple[str, ...] = ()


@dataclass(frozen=True)
class UrdfExport:
    """A robot description with calibrated origins.

    Attributes
    ----------
    text : str
        The document; what was not calibrated is as it was, byte for byte.
    base, tip : str
        The links between which it agrees with the rows: those asked for, or
        `…_calibrated` where a fixed joint had to be added for the correction.
    notes : tuple of str
        What a URDF cannot express, and what was added.
    """

    text: str
    base: str
    tip: str
    notes: tuple[str, ...]


def chain_from_urdf(
    text_or_path: str | os.PathLike[str],
    base: str,
    tip: str,
    channels: Mapping[str, str],
    masses: Mapping[str, Mass] | None = None,
) -> UrdfChain:
    """Read the chain between two links of a URDF robot.

    Fixed joints are folded into the rows, and the masses of links that they
    join, on the path or beside it, are added up. What moves beside the path (a
    finger) has no constant place: its mass is left out, and a note says so.

    Parameters
    ----------
    text_or_path : str or path
        The document itself (it has a `<`), or the path of its file.
    base, tip : str
        Links. The base need not be above the tip: the path then leads up first.
    channels : mapping of str to str
        The channel that senses each moving joint of the path, by joint.
    masses : mapping of str to (float, sequence of 3 floats), optional
        Mass of links and its centre in the link's frame [m]. Without it,
        those of the `<inertial>` elements.

    Returns
    -------
    UrdfChain
        Rows and limits.

    Raises
    ------
    InputError
        The document cannot be used, a name is not in it, a moving joint has no
        channel, or a joint moves otherwise than about or along one axis.

    See Also
    --------
    write_urdf : the way back.

    Examples
    --------
    >>> robot = '''<robot name="r"> <link name="base"/> <link name="arm"/>
    ... <joint name="hinge" type="continuous"> <origin xyz="0 0 0.3"/>
    ...   <parent link="base"/> <child link="arm"/> <axis xyz="0 0 1"/> </joint> </robot>'''
    >>> rows = chain_from_urdf(robot, "base", "arm", {"hinge": "q1"}).rows
    >>> rows[0]
    {'name': 'base to hinge', 'xyz': [0.0, 0.0, 0.3], 'rpy': [0.0, 0.0, 0.0]}
    >>> rows[1]["name"], rows[1]["channel"], rows[1]["joint"]
    ('hinge to arm', 'q1', 'revolute')
    """
    robot = Robot(text_or_path)
    path = JointPath.between(robot, base, tip, channels)
    weights = Masses(robot, masses)
    xyz, rpy = _numbers(path, 0)
    ends = [base, *(move.step.joint.name for move in path.moves), tip]
    names = [f"{one} to {other}" for one, other in pairwise(ends)]
    rows: list[Row] = [{"name": names[0], "xyz": xyz, "rpy": rpy}]
    for i, move in enumerate(path.moves):
        xyz, rpy = _numbers(path, i + 1)
        row: Row = {"name": names[i + 1], "channel": move.channel, "joint": move.kind}
        if move.ratio is not None:
            row["ratio"] = move.ratio
            row |= {"theta": move.offset} if move.kind == "revolute" else {"d": move.offset}
        row |= {"xyz": xyz, "rpy": rpy}
        mass, com = weights.carried(path, i)
        if mass > 0.0:
            # `theta` stands before the joint, `d` after it.
            com[2] += row.get("d", 0.0)
            row |= {"mass": mass, "com": com}
        rows.append(row)
    sensed = [move for move in path.moves if move.ratio is None]
    limits = {m.channel: m.step.joint.limits() for m in sensed}
    return UrdfChain(
        rows=rows,
        limits={channel: limit for channel, limit in limits.items() if limit is not None},
        joints={m.channel: m.step.joint.name for m in sensed},
        notes=tuple(weights.notes),
    )


def masses_from_toml(path: str | os.PathLike[str]) -> dict[str, Mass]:
    """Read masses of links: `panda_link1 = { mass = 4.97, com = [0.004, 0.002, -0.048] }`.

    Parameters
    ----------
    path : str or path
        A TOML file, one entry for each link.

    Returns
    -------
    dict of str to (float, tuple of 3 floats)
        Mass, and its centre in the link's frame [m].

    Raises
    ------
    InputError
        The file cannot be read, or an entry is not a mass and its centre.
    """
    file = os.fspath(path)
    out: dict[str, Mass] = {}
    expected = "{ mass = a number of 0 or more, com = [x, y, z] }"
    for link, entry in read_toml(file).items():
        fits = isinstance(entry, dict) and entry.keys() == {"mass", "com"}
        numbers = [entry["mass"], *_as_list(entry["com"])] if fits else []
        if len(numbers) != 4 or not all(map(_is_number, numbers)) or numbers[0] < 0:
            refuse(file, f'link "{link}"', found=repr(entry), expected=expected)
        mass, x, y, z = map(float, numbers)
        out[link] = (mass, (x, y, z))
    return out


def read_toml(file: str) -> dict[str, Any]:
    """Read a TOML file.

    Parameters
    ----------
    file : str
        Its path.

    Returns
    -------
    dict
        What `tomllib` makes of it.

    Raises
    ------
    InputError
        The file cannot be read, or is not TOML.
    """
    return parse_toml(read_text(file, "a TOML file"), file)


def write_urdf(
    text_or_path: str | os.PathLike[str],
    base: str,
    tip: str,
    channels: Mapping[str, str],
    rows: Sequence[Mapping[str, Any]],
    *,
    offsets: Mapping[str, float] | None = None,
    gains: Mapping[str, float] | None = None,
    zeros: Mapping[str, float] | None = None,
) -> UrdfExport:
    """Write calibrated rows back into the robot description that they came from.

    The origins of joints on the path are rewritten so that, with readings as
    joint values, the tip is where the rows put it, to rounding. Each stretch
    between two moving joints is corrected in the origin of the joint that ends
    it, the last in the fixed joint at the tip; other joints, axes and
    inertials stay as they are, and origins that did not change do too. Limits
    move with `zeros` alone: where readings are counted from another place than
    the document's joint values.

    Parameters
    ----------
    text_or_path, base, tip, channels
        As for `chain_from_urdf`.
    rows : sequence of mapping
        The calibrated chain: the same joints in the same order, all else free.
    offsets : mapping of str to float, optional
        Joint coordinate at reading zero, by channel [rad or m]; 0 if not named.
    zeros : mapping of str to float, optional
        The same as it was declared, before a calibration; 0 if not named.
    gains : mapping of str to float, optional
        Joint coordinate per reading, by channel; 1 if not named. A URDF has no
        place for another: a note says by what to multiply the reading.

    Returns
    -------
    UrdfExport
        The document, the links to use, and notes on what it does not express.

    Raises
    ------
    InputError
        As for `chain_from_urdf`; or rows, offsets or gains of another chain.

    Examples
    --------
    >>> robot = '''<robot name="r"> <link name="base"/> <link name="arm"/>
    ... <joint name="hinge" type="continuous"> <origin xyz="0 0 0.3"/>
    ...   <parent link="base"/> <child link="arm"/> <axis xyz="0 0 1"/> </joint> </robot>'''
    >>> rows = chain_from_urdf(robot, "base", "arm", {"hinge": "q1"}).rows
    >>> export = write_urdf(robot, "base", "arm", {"hinge": "q1"}, rows, offsets={"q1": 0.01})
    >>> print(export.text.splitlines()[1])
    <joint name="hinge" type="continuous"> <origin xyz="0.0 0.0 0.3" rpy="0.0 0.0 0.01"/>
    """
    robot = Robot(text_or_path)
    path = JointPath.between(robot, base, tip, channels)
    known = [move.channel for move in path.moves]
    offsets, gains = dict(offsets or {}), dict(gains or {})
    for what, given in (("offsets", offsets), ("gains", gains)):
        for channel, value in given.items():
            if channel not in known or not _is_number(value):
                found, expected = f'{value!r} for "{channel}"', f"numbers for {listed(known)}"
                refuse(robot.file, what, found=found, expected=expected)
    edits = _Edits(robot)
    calibrated, mimics = _calibrated(rows, path, offsets, robot.file)
    for joint, ratio, offset in mimics:
        edits.mimic(joint, ratio, offset)
    for i, (steps, here) in enumerate(zip(path.stretches, calibrated, strict=True)):
        wanted = inverse(path.before(i)) @ here @ inverse(path.after(i))
        if steps:
            edits.correct(steps, wanted)
        elif not _same(wanted, np.eye(4)):  # a moving joint is at the very end
            if i == 0:
                base = edits.add_link(base, inverse(wanted))
            else:
                tip = edits.add_link(tip, wanted)
    for move in path.moves:
        if move.ratio is None:
            edits.limits(move.step.joint, -float((zeros or {}).get(move.channel, 0.0)))
        gain = float(gains.get(move.channel, 1.0))
        if gain != 1.0:
            edits.notes.append(
                f'channel "{move.channel}": a URDF has no place for the gain {gain!r}; '
                f'give joint "{move.step.joint.name}" the reading times {gain!r}'
            )
    return UrdfExport(edits.text(), base, tip, tuple(edits.notes))


# ------------------------------------------------------------------ rows


def _numbers(path: JointPath, i: int) -> tuple[list[float], list[float]]:
    """`xyz` and `rpy` of the body of row `i`; as the document has them if nothing is folded in."""
    steps = path.stretches[i]
    body = path.before(i) @ stretch(steps) @ path.after(i)
    for step in steps:
        xyz, rpy = (step.joint.vector("origin", key, ORIGIN) for key in ("xyz", "rpy"))
        if np.array_equal(rigid(xyz, rpy), body):
            return list(xyz), list(rpy)
    return xyz_rpy(body)


# ------------------------------------------------------------------ the way back


def _same(a: Matrix, b: Matrix) -> bool:
    return bool(np.abs(a - b).max() <= UNCHANGED)


def _calibrated(
    rows: Sequence[Mapping[str, Any]], path: JointPath, offsets: Mapping[str, float], file: str
) -> tuple[list[Matrix], list[tuple[Joint, float, float]]]:
    """What lies before, between and after the joints of calibrated rows, offsets included.

    Joints that mimic others have their offsets in the document: their ratios and offsets.
    """
    joints = [f"{r.get('joint', 'revolute')} {r['channel']}" for r in rows if r.get("channel")]
    own = [f"{move.kind} {move.channel}" for move in path.moves]
    if joints != own:
        refuse(file, "rows", found=listed(joints), expected=listed(own))
    out, mimics = [np.eye(4)], []
    for i, row in enumerate(rows):
        numbers = [row.get(key, 0.0) for key in ("theta", "d", "a", "alpha", "ratio")]
        xyz, rpy = row.get("xyz", ORIGIN), row.get("rpy", ORIGIN)
        if not len(xyz) == len(rpy) == 3 or not all(map(_is_number, [*numbers, *xyz, *rpy])):
            found, expected = repr(dict(row)), "finite numbers, three for xyz and for rpy"
            refuse(file, f"rows, row {i + 1}", found=found, expected=expected)
        theta, d, a, alpha, ratio = numbers
        out[-1] = out[-1] @ rotation(2, theta)
        if row.get("channel"):
            move, offset = path.moves[len(out) - 1], offsets.get(row["channel"], 0.0)
            before, after = joint_motion(move.kind, offset), np.eye(4)
            if move.ratio is not None:
                mimics.append((move.step.joint, ratio, move.offset + ratio * offset))
                # The document's own offset stands in `theta` before the joint, or in `d` after it.
                before, after = np.eye(4), joint_motion(move.kind, -move.offset)
                if move.kind == "revolute":
                    before, after = after, before
            out[-1] = out[-1] @ before
            out.append(after)
        out[-1] = out[-1] @ rigid((a, 0.0, d), (alpha, 0.0, 0.0)) @ rigid(xyz, rpy)
    return out, mimics


class _Edits:
    """Changes to the bytes of a document: from, to, and what to put there."""

    def __init__(self, robot: Robot) -> None:
        self.robot = robot
        self.data = robot.text.encode()
        self.edits: list[tuple[int, int, bytes]] = []
        self.notes: list[str] = []

    def text(self) -> str:
        """The document with the changes made."""
        data = self.data
        for start, end, new in sorted(self.edits, reverse=True):
            data = data[:start] + new + data[end:]
        return data.decode()

    def correct(self, steps: list[Step], wanted: Matrix) -> None:
        """Makes a stretch `wanted` by its last joint."""
        *others, last = steps
        now = inverse(stretch(others)) @ wanted
        if not _same(now, stretch([last])):
            self._origin(last.joint, inverse(now) if last.up else now)

    def add_link(self, link: str, link_from_new: Matrix) -> str:
        """Adds a fixed joint and a link; returns the link's name."""
        name, joint = f"{link}_calibrated", f"{link}_calibrated_joint"
        if name in self.robot.links or joint in self.robot.joints:
            hint = f'Is "{name}" the link that is meant?'
            found, expected = f'"{name}" or "{joint}" already', "a free name"
            refuse(self.robot.file, f'link "{link}"', found=found, expected=expected, hint=hint)
        numbers = _attributes(link_from_new)
        origin = " ".join(f'{key}="{value}"' for key, value in numbers.items())
        new = (
            f'  <link name={_quoted(name)}/>\n  <joint name={_quoted(joint)} type="fixed">\n'
            f"    <origin {origin}/>\n    <parent link={_quoted(link)}/>\n"
            f"    <child link={_quoted(name)}/>\n  </joint>\n"
        )
        end = self.robot.root.end
        self.edits.append((end, end, new.encode()))
        self.notes.append(f'link "{name}" is new: the corrected frame of "{link}"')
        return name

    def _origin(self, joint: Joint, matrix: Matrix) -> None:
        """Rewrites the numbers of a joint's origin, or puts one in."""
        values = _attributes(matrix)
        element = joint.element.child("origin")
        if element is None:
            start = self._tag_end(joint.element.start)
            blank = self.data[start : self.data.index(b"<", start)]
            tag = (blank if blank.isspace() else b"") + b"<origin/>"
            end = start
        else:
            start, end = element.start, self._tag_end(element.start)
            tag = self.data[start:end]
        self.edits.append((start, end, _with_attributes(tag, values)))

    def mimic(self, joint: Joint, ratio: float, offset: float) -> None:
        """Makes a joint mimic another by this ratio, from this offset on."""
        found, element = joint.mimic(), joint.element.child("mimic")
        if element is None or found is None or found[1:] == (ratio, offset):
            return
        self._rewrite(element, multiplier=float(ratio), offset=float(offset))

    def limits(self, joint: Joint, by: float) -> None:
        """Moves the limits of a joint."""
        found, element = joint.limits(), joint.element.child("limit")
        if element is None or found is None or by == 0.0:
            return
        self._rewrite(element, lower=found[0] + by, upper=found[1] + by)

    def _rewrite(self, element: Element, **numbers: float) -> None:
        """Changes numbers of an element."""
        start, end = element.start, self._tag_end(element.start)
        values = {key: repr(value) for key, value in numbers.items()}
        self.edits.append((start, end, _with_attributes(self.data[start:end], values)))

    def _tag_end(self, start: int) -> int:
        """Offset just after the start tag that begins at `start`."""
        tag = re.compile(rb"""<(?:[^"'>]|"[^"]*"|'[^']*')*>""").match(self.data, start)
        return tag.end() if tag else start


def _with_attributes(tag: bytes, values: Mapping[str, str]) -> bytes:
    """A start tag with these attributes, in place of its own or beside them."""
    for key, value in values.items():
        new = f'{key}="{value}"'.encode()
        pattern = rb"(?<=\s)" + key.encode() + rb"""\s*=\s*("[^"]*"|'[^']*')"""
        tag, count = re.subn(pattern, new, tag, count=1)
        if not count:
            tag = re.sub(rb"\s*(/?>)$", rb" " + new + rb"\1", tag)
    return tag


def _attributes(matrix: Matrix) -> dict[str, str]:
    xyz, rpy = xyz_rpy(matrix)
    return {"xyz": " ".join(map(repr, xyz)), "rpy": " ".join(map(repr, rpy))}


def _quoted(name: str) -> str:
    for character, entity in (("&", "&amp;"), ("<", "&lt;"), ('"', "&quot;")):
        name = name.replace(character, entity)
    return f'"{name}"'


def _as_list(value: object) -> list[Any]:
    return value if isinstance(value, list) else []


def _is_number(value: object) -> bool:
    if isinstance(value, bool) or not isinstance(value, (int, float, np.integer, np.floating)):
        return False
    return math.isfinite(value)
