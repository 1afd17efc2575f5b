"""A URDF document as a tree of links and joints; no kinematics.

Elements know their line, for messages, and their place in the text, so that an
export can change single elements and leave every other byte as it was.
"""

from __future__ import annotations

import math
import os
from collections.abc import Iterable
from dataclasses import dataclass, field
from typing import NoReturn
from xml.parsers import expat

from rsicalib.errors import InputError, Where
from rsicalib.io.sources import read_text

ORIGIN = (0.0, 0.0, 0.0)
"""What URDF says where no origin stands."""


def refuse(
    file: str, place: str, *, found: str, expected: str, line: int | None = None, hint: str = ""
) -> NoReturn:
    """Raise `InputError` for a place that has a name rather than a column.

    Parameters
    ----------
    file : str
        Path as it was given.
    place : str
        For instance `joint "elbow"`.
    found, expected : str
        Both are quoted in the message and kept in `where`.
    line : int, optional
        Line of the file, from 1.
    hint : str, optional
        A sentence on what to do.

    Raises
    ------
    InputError
        Always.
    """
    at = ", ".join([file, *([f"line {line}"] if line is not None else []), place])
    message = f"{at}: found {found}, expected {expected}"
    where = Where(file=file, line=line, column=None, found=found, expected=expected)
    raise InputError(f"{message}. {hint}" if hint else message, where)


def how_to_expand(file: str) -> str:
    """What to do with a xacro."""
    plain = file.removesuffix(".xacro").removesuffix(".urdf") + ".urdf"
    plain = plain if plain != file else file.removesuffix(".urdf") + "_plain.urdf"
    return f"Expand the xacro first: xacro {file} -o {plain}"


def listed(names: Iterable[str]) -> str:
    """Write names one after the other, for a message.

    Parameters
    ----------
    names : iterable of str
        In the order to be shown.

    Returns
    -------
    str
        `a, b, c`, or `none at all`.
    """
    return ", ".join(names) or "none at all"


@dataclass(eq=False)
class Element:
    """An XML element, and where its start tag stands."""

    tag: str
    attributes: dict[str, str]
    line: int
    start: int
    """Offset of `<` in the text's UTF-8 bytes."""
    end: int = -1
    """Offset of the end tag."""
    children: list[Element] = field(default_factory=list)

    def child(self, tag: str) -> Element | None:
        """Return the first child with a tag.

        Parameters
        ----------
        tag : str
            Name of the element.

        Returns
        -------
        Element or None
            None if there is no such child.
        """
        return next((c for c in self.children if c.tag == tag), None)


@dataclass(eq=False)
class Joint:
    """A joint: which links it joins, and the elements to read numbers from."""

    name: str
    kind: str
    parent: str
    child: str
    element: Element
    file: str

    def vector(
        self, tag: str, attribute: str, default: tuple[float, float, float]
    ) -> tuple[float, float, float]:
        """Read three numbers of a child element.

        Parameters
        ----------
        tag, attribute : str
            For instance `origin`, `xyz`.
        default : tuple of 3 floats
            What URDF says where nothing stands.

        Returns
        -------
        tuple of 3 floats
            As written.

        Raises
        ------
        InputError
            Not three finite numbers.
        """
        return read_vector(
            self.element.child(tag), attribute, default, self.file, f'joint "{self.name}"'
        )

    def limits(self) -> list[float] | None:
        """Read the limits of the joint's coordinate.

        Returns
        -------
        list of 2 floats, or None
            `[lower, upper]` [rad or m]; None for a joint that declares none.

        Raises
        ------
        InputError
            A limit that is not a number.
        """
        limit = self.element.child("limit")
        if limit is None or self.kind == "continuous":
            return None
        lower, upper = self._numbers(limit, lower="0", upper="0")
        return [lower, upper] if lower < upper else None

    def mimic(self) -> tuple[str, float, float] | None:
        """Read which joint this one mimics.

        Returns
        -------
        tuple of str and 2 floats, or None
            The other joint, and ratio and offset: it moves by `ratio * q + offset` [rad or m].
            None for a joint that moves on its own.

        Raises
        ------
        InputError
            A ratio or an offset that is not a number.
        """
        mimic = self.element.child("mimic")
        if mimic is None:
            return None
        ratio, offset = self._numbers(mimic, multiplier="1", offset="0")
        return mimic.attributes.get("joint", ""), ratio, offset

    def _numbers(self, element: Element, **defaults: str) -> list[float]:
        """Numbers of an element by attribute, as they are where they are not given."""
        place, line = f'joint "{self.name}", {element.tag}', element.line
        texts = [element.attributes.get(key, default) for key, default in defaults.items()]
        return [read_numbers(text, 1, self.file, place, line)[0] for text in texts]


@dataclass(frozen=True)
class Step:
    """A joint on a path, walked from parent to child or, `up`, from child to parent."""

    joint: Joint
    up: bool

    @property
    def reached(self) -> str:
        """Name of the link that the step leads to."""
        return self.joint.parent if self.up else self.joint.child


def read_numbers(text: str, count: int, file: str, place: str, line: int) -> list[float]:
    """Read finite numbers between blanks.

    Parameters
    ----------
    text : str
        The attribute.
    count : int
        How many numbers there must be.
    file, place, line
        For the message.

    Returns
    -------
    list of float
        As many as `count`.

    Raises
    ------
    InputError
        Another number of words, or a word that is not a finite number.
    """
    try:
        numbers = [float(word) for word in text.split()]
    except ValueError:
        numbers = []
    if len(numbers) != count or not all(map(math.isfinite, numbers)):
        expected = "a finite number" if count == 1 else f"{count} finite numbers"
        hint = how_to_expand(file) if "${" in text else ""
        refuse(file, place, line=line, found=repr(text), expected=expected, hint=hint)
    return numbers


def read_vector(
    element: Element | None,
    attribute: str,
    default: tuple[float, float, float],
    file: str,
    place: str,
) -> tuple[float, float, float]:
    """Read an attribute of three numbers; `default` where it does not stand.

    Parameters
    ----------
    element : Element or None
        Where to look.
    attribute : str
        For instance `xyz`.
    default : tuple of 3 floats
        What URDF says where nothing stands.
    file, place : str
        For the message.

    Returns
    -------
    tuple of 3 floats
        As written.

    Raises
    ------
    InputError
        Not three finite numbers.
    """
    if element is None or attribute not in element.attributes:
        return default
    where = f"{place}, {element.tag} {attribute}"
    text = element.attributes[attribute]
    x, y, z = read_numbers(text, 3, file, where, element.line)
    return x, y, z


class Robot:
    """Links and joints of a URDF document.

    Parameters
    ----------
    text_or_path : str or path
        The document itself (it has a `<`), or the path of its file.

    Attributes
    ----------
    file : str
        The path as given, or `urdf` for text.
    text : str
        The document.
    links : dict of str to Element
        In the order of the document.
    joints : dict of str to Joint
        In the order of the document.

    Raises
    ------
    InputError
        There is no such file, it is not XML, or not a robot whose links form trees.
    """

    def __init__(self, text_or_path: str | os.PathLike[str]) -> None:
        self.file, self.text = _source(text_or_path)
        self.root = parse_xml(self.text, self.file)
        if self.root.tag != "robot":
            refuse(
                self.file, "root", found=f"<{self.root.tag}>", expected="<robot>, a URDF document"
            )
        for element in self.root.children:
            if element.tag.startswith("xacro:"):
                found, hint = f"<{element.tag}>", how_to_expand(self.file)
                expected = "plain URDF"
                refuse(
                    self.file, "robot", line=element.line, found=found, expected=expected, hint=hint
                )
        self.links: dict[str, Element] = {}
        for element in self.root.children:
            if element.tag == "link":
                self._once(self.links, "link", element)
                self.links[element.attributes["name"]] = element
        self.joints: dict[str, Joint] = {}
        for element in self.root.children:
            if element.tag == "joint":
                self._once(self.joints, "joint", element)
                self.joints[element.attributes["name"]] = self._joint(element)
        self._above: dict[str, Joint] = {}
        for joint in self.joints.values():
            other = self._above.setdefault(joint.child, joint)
            if other is not joint:
                found = f'link "{joint.child}" below this joint and below "{other.name}"'
                self.refuse(joint, found=found, expected="each link below one joint")

    def refuse(self, joint: Joint, *, found: str, expected: str, hint: str = "") -> NoReturn:
        """Raise `InputError` for a joint.

        Parameters
        ----------
        joint : Joint
            The place.
        found, expected, hint : str
            As in `refuse`.

        Raises
        ------
        InputError
            Always.
        """
        place, line = f'joint "{joint.name}"', joint.element.line
        refuse(self.file, place, line=line, found=found, expected=expected, hint=hint)

    def _once(self, known: Iterable[str], kind: str, element: Element) -> None:
        name = element.attributes.get("name", "")
        if not name or name in known:
            found = f'"{name}" again' if name else "no name"
            refuse(self.file, kind, line=element.line, found=found, expected="a name of its own")

    def _joint(self, element: Element) -> Joint:
        name, kind = element.attributes["name"], element.attributes.get("type", "")
        ends = []
        for tag in ("parent", "child"):
            end = element.child(tag)
            link = "" if end is None else end.attributes.get("link", "")
            if link not in self.links:
                place = f'joint "{name}", {tag}'
                found = f'link "{link}"' if link else "no link"
                expected = f"one of the links {listed(self.links)}"
                refuse(self.file, place, line=element.line, found=found, expected=expected)
            ends.append(link)
        parent, child = ends
        return Joint(name, kind, parent, child, element, self.file)

    def path(self, base: str, tip: str) -> list[Step]:
        """Walk from one link to another: up to where their branches meet, then down.

        Parameters
        ----------
        base, tip : str
            Names of links.

        Returns
        -------
        list of Step
            From base to tip.

        Raises
        ------
        InputError
            No such link, the same link twice, or links of separate trees.
        """
        for place, link in (("base", base), ("tip", tip)):
            if link not in self.links:
                expected = f"one of the links {listed(self.links)}"
                refuse(self.file, place, found=f'link "{link}"', expected=expected)
        if base == tip:
            found, expected = f'link "{tip}", the base', "a link other than the base"
            refuse(self.file, "tip", found=found, expected=expected)
        up, down = self._ancestry(base), self._ancestry(tip)
        while up and down and up[-1] is down[-1]:
            del up[-1], down[-1]
        steps = [
            *(Step(joint, True) for joint in up),
            *(Step(joint, False) for joint in down[::-1]),
        ]
        link = base
        for step in steps:
            if (step.joint.child if step.up else step.joint.parent) != link:
                found = f'links "{base}" and "{tip}" in separate trees'
                refuse(self.file, "tip", found=found, expected="joints that lead from base to tip")
            link = step.reached
        return steps

    def _ancestry(self, link: str) -> list[Joint]:
        """Joints above a link, nearest first."""
        joints: list[Joint] = []
        while link in self._above:
            joint = self._above[link]
            if joint in joints:
                self.refuse(joint, found="a loop of joints", expected="a tree")
            joints.append(joint)
            link = joint.parent
        return joints


def _source(text_or_path: str | os.PathLike[str]) -> tuple[str, str]:
    if isinstance(text_or_path, str) and "<" in text_or_path:
        return "urdf", text_or_path
    file = os.fspath(text_or_path)
    return file, read_text(file, "a robot description", "URDF")


def parse_xml(text: str, file: str) -> Element:
    """Read a document of XML as its root element; one that is none is refused with its line."""
    parser = expat.ParserCreate("utf-8")
    holder = Element("", {}, 0, 0)
    stack = [holder]

    def start(tag: str, attributes: dict[str, str]) -> None:
        element = Element(tag, attributes, parser.CurrentLineNumber, parser.CurrentByteIndex)
        stack[-1].children.append(element)
        stack.append(element)

    def end(_tag: str) -> None:
        stack.pop().end = parser.CurrentByteIndex

    def entity(name: str, *_: object) -> None:
        # An entity's text stands elsewhere than its use, and may grow without bounds.
        line, found = parser.CurrentLineNumber, f'entity "{name}"'
        refuse(file, "URDF", line=line, found=found, expected="no entity declarations")

    parser.StartElementHandler = start
    parser.EndElementHandler = end
    parser.EntityDeclHandler = entity
    try:
        parser.Parse(text.encode(), True)
    except expat.ExpatError as error:
        found = expat.ErrorString(error.code)
        refuse(file, "URDF", line=error.lineno, found=found, expected="well-formed XML")
    return holder.children[0]
