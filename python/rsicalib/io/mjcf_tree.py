"""A MuJoCo model (MJCF) as bodies, joints and sites with their frames; no closures.

Defaults, classes, included files and the angles of the compiler are taken in; what is only looked
at or hit (meshes, geoms, lights) is not read.
"""

from __future__ import annotations

import math
import os
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import NoReturn

import numpy as np

from rsicalib.io.rigid import Matrix, rigid, rotation
from rsicalib.io.sources import read_text
from rsicalib.io.urdf_tree import Element, parse_xml, read_numbers, refuse

HINGE, SLIDE, BALL, FREE = "hinge", "slide", "ball", "free"

NONE = 1e-9
"""What is shorter is no direction: of two axes that are parallel rounding leaves less."""


@dataclass(eq=False)
class MjJoint:
    """A joint of a body.

    Attributes
    ----------
    name : str
        Empty where the model gives none.
    kind : {"hinge", "slide", "ball", "free"}
        How it moves.
    pos, axis : ndarray, shape (3,)
        In the frame of its body.
    ref : float
        Its value in the configuration that is drawn [rad or m].
    limits : list of float or None
        `[lower, upper]`.
    element : Element
        Where it stands.
    """

    name: str
    kind: str
    pos: np.ndarray
    axis: np.ndarray
    ref: float
    limits: list[float] | None
    element: Element


@dataclass(eq=False)
class Body:
    """A body, its place in its parent as drawn, and what it carries."""

    name: str
    parent: Body | None
    frame: Matrix
    element: Element
    joints: list[MjJoint] = field(default_factory=list)
    sites: dict[str, Matrix] = field(default_factory=dict)

    def path(self) -> list[Body]:
        """Bodies from below the world to this one."""
        above = [] if self.parent is None else self.parent.path()
        return above if self.parent is None else [*above, self]

    def drawn(self) -> Matrix:
        """Place in the world, as drawn."""
        out = np.eye(4)
        for body in self.path():
            out = out @ body.frame
        return out


class Model:
    """A MuJoCo model.

    Parameters
    ----------
    text_or_path : str or path
        The document (it has a `<`), or the path of its file.

    Attributes
    ----------
    file : str
        Path as given, or `mjcf`.
    bodies : dict of str to Body
        By name, in the order of the document; `world` is the first.
    joints : dict of str to (Body, MjJoint)
        Those with a name.
    sections : dict of str to list of Element
        Elements below `equality`, `sensor` and so on.

    Raises
    ------
    InputError
        It is no such model, or a number in it cannot be read.
    """

    def __init__(self, text_or_path: str | os.PathLike[str]) -> None:
        text = isinstance(text_or_path, str) and "<" in text_or_path
        self.file = "mjcf" if text else os.fspath(text_or_path)
        source = str(text_or_path) if text else read_text(self.file, "a MuJoCo model", "MJCF")
        root = parse_xml(source, self.file)
        if root.tag != "mujoco":
            found, expected = f"<{root.tag}>", "<mujoco>, a MuJoCo model"
            refuse(self.file, "root", line=root.line, found=found, expected=expected)
        self.sections: dict[str, list[Element]] = {}
        top = list(self._included(root, ()))
        for element in top:
            self.sections.setdefault(element.tag, []).extend(element.children)
        compiler: dict[str, str] = {}
        for element in top:
            compiler |= element.attributes if element.tag == "compiler" else {}
        self.degrees = compiler.get("angle", "degree") == "degree"
        self.sequence = compiler.get("eulerseq", "xyz")
        self._defaults: dict[str, dict[str, dict[str, str]]] = {}
        for element in top:
            if element.tag == "default":
                self._default(element, "main", {})
        world = Body("world", None, np.eye(4), root)
        self.bodies: dict[str, Body] = {"world": world}
        self.joints: dict[str, tuple[Body, MjJoint]] = {}
        for element in top:
            if element.tag == "worldbody":
                self._body(element, world, "main", np.eye(4))

    def refuse(self, element: Element, *, found: str, expected: str, hint: str = "") -> NoReturn:
        """Raise `InputError` for an element."""
        name = element.attributes.get("name", "")
        place = f'{element.tag} "{name}"' if name else element.tag
        refuse(self.file, place, line=element.line, found=found, expected=expected, hint=hint)

    def value(self, element: Element, name: str, childclass: str = "main") -> str | None:
        """An attribute, or what its class says."""
        if name in element.attributes:
            return element.attributes[name]
        kind = element.attributes.get("class", childclass)
        if kind not in self._defaults and kind != "main":
            self.refuse(element, found=f"class {kind!r}", expected="a class of <default>")
        return self._defaults.get(kind, {}).get(element.tag, {}).get(name)

    def numbers(self, element: Element, name: str, text: str, count: int) -> list[float]:
        """Numbers of an attribute."""
        place = f"{element.tag}, {name}"
        return read_numbers(text, count, self.file, place, element.line)

    def _included(self, root: Element, above: tuple[str, ...]) -> Iterator[Element]:
        """Elements below the root, those of included files in their place."""
        for element in root.children:
            if element.tag != "include":
                yield element
                continue
            path = str(Path(self.file).parent / element.attributes.get("file", ""))
            if path in above:
                self.refuse(element, found="a file that includes itself", expected="another")
            text = read_text(path, "a part of a MuJoCo model", "MJCF")
            yield from self._included(parse_xml(text, path), (*above, path))

    def _default(self, element: Element, name: str, above: Mapping[str, dict[str, str]]) -> None:
        name = element.attributes.get("class", name)
        own = {tag: dict(values) for tag, values in above.items()}
        for child in element.children:
            if child.tag != "default":
                own[child.tag] = {**own.get(child.tag, {}), **child.attributes}
        self._defaults[name] = {**self._defaults.get(name, {}), **own}
        for child in element.children:
            if child.tag == "default":
                self._default(child, "", own)

    def _body(self, element: Element, body: Body, childclass: str, before: Matrix) -> None:
        """What stands below a body, or below a frame of it."""
        childclass = element.attributes.get("childclass", childclass)
        for child in element.children:
            if child.tag == "frame":
                self._body(child, body, childclass, before @ self._place(child, childclass))
            elif child.tag == "body":
                name = child.attributes.get("name", f"body {len(self.bodies)}")
                if name in self.bodies:
                    self.refuse(child, found="this name again", expected="a name of its own")
                place = before @ self._place(child, childclass)
                below = self.bodies[name] = Body(name, body, place, child)
                self._body(child, below, childclass, np.eye(4))
            elif child.tag in ("joint", "freejoint"):
                joint = self._joint(child, childclass, before)
                body.joints.append(joint)
                if joint.name:
                    self.joints[joint.name] = (body, joint)
            elif child.tag == "site" and "name" in child.attributes:
                body.sites[child.attributes["name"]] = before @ self._place(child, childclass)

    def _joint(self, element: Element, childclass: str, before: Matrix) -> MjJoint:
        free = element.tag == "freejoint"
        kind = FREE if free else self.value(element, "type", childclass) or HINGE
        axis = self._vector(element, "axis", childclass, (0.0, 0.0, 1.0))
        if not np.linalg.norm(axis) > 0.0:
            self.refuse(element, found="an axis of no length", expected="a direction")
        unit = math.pi / 180.0 if self.degrees and kind == HINGE else 1.0
        ref = float(self._vector(element, "ref", childclass, (0.0,))[0]) * unit
        limits = None
        if (text := self.value(element, "range", childclass)) is not None and kind in (
            HINGE,
            SLIDE,
        ):
            limits = [v * unit for v in self.numbers(element, "range", text, 2)]
            limited = self.value(element, "limited", childclass) or "auto"
            limits = limits if limited != "false" and limits[0] < limits[1] else None
        pos = before @ np.array([*self._vector(element, "pos", childclass, (0.0, 0.0, 0.0)), 1.0])
        turned = before[:3, :3] @ axis / np.linalg.norm(axis)
        name = element.attributes.get("name", "")
        return MjJoint(name, kind, pos[:3], turned, ref, limits, element)

    def _vector(
        self, element: Element, name: str, childclass: str, default: tuple[float, ...]
    ) -> np.ndarray:
        text = self.value(element, name, childclass)
        if text is None:
            return np.array(default)
        return np.array(self.numbers(element, name, text, len(default)))

    def _place(self, element: Element, childclass: str) -> Matrix:
        """Position and orientation of a body, a frame or a site."""
        out = rigid(self._vector(element, "pos", childclass, (0.0, 0.0, 0.0)).tolist())
        out[:3, :3] = self._orientation(element, childclass)
        return out

    def _orientation(self, element: Element, childclass: str) -> np.ndarray:
        unit = math.pi / 180.0 if self.degrees else 1.0

        def given(name: str, count: int) -> np.ndarray | None:
            text = self.value(element, name, childclass)
            return None if text is None else np.array(self.numbers(element, name, text, count))

        if (quat := given("quat", 4)) is not None:
            return _of_quaternion(self._unit(element, "quat", quat))
        if (both := given("axisangle", 4)) is not None:
            half = both[3] * unit / 2
            axis = self._unit(element, "axisangle", both[:3])
            return _of_quaternion(np.array([math.cos(half), *(math.sin(half) * axis)]))
        if (euler := given("euler", 3)) is not None:
            out = np.eye(3)
            for letter, angle in zip(self.sequence, euler * unit, strict=True):
                turn = rotation("xyz".index(letter.lower()), float(angle))[:3, :3]
                out = out @ turn if letter.islower() else turn @ out
            return out
        if (axes := given("xyaxes", 6)) is not None:
            x = self._unit(element, "xyaxes", axes[:3])
            y = self._unit(element, "xyaxes", axes[3:])
            y = self._unit(element, "xyaxes", y - x * (x @ y))
            return np.column_stack([x, y, np.cross(x, y)])
        if (z := given("zaxis", 3)) is not None:
            return _shortest(self._unit(element, "zaxis", z))
        return np.eye(3)

    def _unit(self, element: Element, name: str, of: np.ndarray) -> np.ndarray:
        """A direction of length one."""
        length = float(np.linalg.norm(of))
        if not length > NONE:
            self.refuse(element, found=f"{name} without a direction", expected="one")
        return of / length


def _of_quaternion(quat: np.ndarray) -> np.ndarray:
    """Rotation of a quaternion `w x y z`, of any length but zero."""
    w, x, y, z = quat / np.linalg.norm(quat)
    cross = np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]])
    out: np.ndarray = np.eye(3) + 2.0 * (w * cross + cross @ cross)
    return out


def _shortest(z: np.ndarray) -> np.ndarray:
    """The least rotation that takes z to a direction."""
    axis, cos = np.cross([0.0, 0.0, 1.0], z), float(z[2])
    if np.linalg.norm(axis) < 1e-12:
        return np.eye(3) if cos > 0.0 else np.diag([1.0, -1.0, -1.0])
    return _of_quaternion(np.array([1.0 + cos, *axis]))
