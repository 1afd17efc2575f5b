"""The path between two links of a robot, and the bodies that move along it."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from rsicalib.io.rigid import Matrix, align_z, inverse, rigid
from rsicalib.io.urdf_tree import (
    ORIGIN,
    Element,
    Joint,
    Robot,
    Step,
    listed,
    read_numbers,
    read_vector,
    refuse,
)

Mass = tuple[float, Sequence[float]]
"""Mass of a link, and its centre in the link's frame [m]."""

MOTIONS = {"revolute": "revolute", "continuous": "revolute", "prismatic": "prismatic"}
"""What the rows call the types of URDF."""


def stretch(steps: Sequence[Step]) -> Matrix:
    """Multiply the origins of joints, those walked upwards inverted.

    Parameters
    ----------
    steps : sequence of Step
        Neighbours on a path.

    Returns
    -------
    ndarray, shape (4, 4)
        Where the last one leads, with every joint at zero.
    """
    out = np.eye(4)
    for step in steps:
        origin = _origin(step.joint)
        out = out @ (inverse(origin) if step.up else origin)
    return out


@dataclass(frozen=True)
class Move:
    """A moving joint of the path, its channel, and `R` of eq. (1).

    The channel senses the joint, or the one that it mimics: it then moves by `ratio * q + offset`.
    """

    step: Step
    channel: str
    kind: str
    axis_frame: Matrix
    ratio: float | None = None
    offset: float = 0.0


@dataclass(frozen=True)
class JointPath:
    """Moving joints, and the stretches `A` before, between and after them."""

    moves: list[Move]
    stretches: list[list[Step]]

    @classmethod
    def between(cls, robot: Robot, base: str, tip: str, channels: Mapping[str, str]) -> JointPath:
        """Find the path between two links.

        Parameters
        ----------
        robot : Robot
            The document.
        base, tip : str
            Names of links.
        channels : mapping of str to str
            The channel of each moving joint, by joint.

        Returns
        -------
        JointPath
            One stretch more than moving joints.

        Raises
        ------
        InputError
            A name that is not there, or a joint that cannot be a row.
        """
        moves: list[Move] = []
        stretches: list[list[Step]] = [[]]
        steps = robot.path(base, tip)
        _check_channels(robot, steps, channels)
        for step in steps:
            if step.joint.kind == "fixed":
                stretches[-1].append(step)
                continue
            moves.append(_move(robot, step, channels))
            if step.up:
                stretches.append([step])
            else:
                stretches[-1].append(step)
                stretches.append([])
        return cls(moves, stretches)

    def before(self, i: int) -> Matrix:
        """Give `R⁻¹` of the joint before stretch `i`.

        Parameters
        ----------
        i : int
            Index of a stretch.

        Returns
        -------
        ndarray, shape (4, 4)
            The identity before the first joint.
        """
        return inverse(self.moves[i - 1].axis_frame) if i else np.eye(4)

    def after(self, i: int) -> Matrix:
        """Give `R` of the joint after stretch `i`.

        Parameters
        ----------
        i : int
            Index of a stretch.

        Returns
        -------
        ndarray, shape (4, 4)
            The identity after the last joint.
        """
        return self.moves[i].axis_frame if i < len(self.moves) else np.eye(4)


def _check_channels(robot: Robot, steps: list[Step], channels: Mapping[str, str]) -> None:
    moving = [step.joint.name for step in steps if step.joint.kind != "fixed"]
    sensed: dict[str, str] = {}
    for name, channel in channels.items():
        if name not in moving:
            which = "is not one" if name in robot.joints else "the document does not have"
            found, expected = f'joint "{name}", which {which}', "one of the moving joints"
            expected += f" between base and tip, {listed(moving)}"
            refuse(robot.file, "channels", found=found, expected=expected)
        if channel in sensed:
            found = f'channel "{channel}" for "{sensed[channel]}" and for "{name}"'
            refuse(robot.file, "channels", found=found, expected="each channel at one joint")
        sensed[channel] = name


def _move(robot: Robot, step: Step, channels: Mapping[str, str]) -> Move:
    joint = step.joint
    if joint.kind not in MOTIONS:
        known = listed(["fixed", *MOTIONS])
        robot.refuse(joint, found=f'type "{joint.kind}"', expected=f"on the path one of {known}")
    sensed, ratio, offset = joint.name, None, 0.0
    # A joint that mimics another and has a sensor of its own is where that says.
    if joint.name not in channels and (mimic := joint.mimic()) is not None:
        sensed, ratio, offset = mimic
        if sensed not in channels or ratio == 0.0:
            found = f'<mimic> of "{sensed}" with multiplier {ratio:g}'
            expected = f"on the path a multiple of a joint with a channel, {listed(channels)}"
            robot.refuse(joint, found=found, expected=expected)
    if sensed not in channels:
        hint = f'Add it to channels: {joint.name} = "..."'
        found = f"a {joint.kind} joint without a channel"
        robot.refuse(joint, found=found, expected="the channel that senses it", hint=hint)
    x, y, z = joint.vector("axis", "xyz", (1.0, 0.0, 0.0))
    if x == y == z == 0.0:
        robot.refuse(joint, found="axis 0 0 0", expected="a direction")
    frame = align_z((-x, -y, -z) if step.up else (x, y, z))
    return Move(step, channels[sensed], MOTIONS[joint.kind], frame, ratio, offset)


def _origin(joint: Joint) -> Matrix:
    return rigid(joint.vector("origin", "xyz", ORIGIN), joint.vector("origin", "rpy", ORIGIN))


class Masses:
    """Masses of links, and of the bodies that fixed joints make of them.

    Parameters
    ----------
    robot : Robot
        The document.
    masses : mapping of str to (float, sequence of 3 floats), optional
        By link; without it, those of the `<inertial>` elements.

    Attributes
    ----------
    notes : list of str
        Masses that could not be counted, as far as bodies were asked for.

    Raises
    ------
    InputError
        A mass for a link that is not there, or that is not a mass.
    """

    def __init__(self, robot: Robot, masses: Mapping[str, Mass] | None) -> None:
        self.robot = robot
        self.notes: list[str] = []
        if masses is None:
            masses = {name: _inertial(name, link, robot) for name, link in robot.links.items()}
        for name in masses:
            if name not in robot.links:
                expected = f"one of the links {listed(robot.links)}"
                refuse(robot.file, "masses", found=f'link "{name}"', expected=expected)
        self.masses = masses
        self.joints_at: dict[str, list[Joint]] = {name: [] for name in robot.links}
        for joint in robot.joints.values():
            self.joints_at[joint.parent].append(joint)
            self.joints_at[joint.child].append(joint)

    def carried(self, path: JointPath, i: int) -> tuple[float, list[float]]:
        """Sum the links that are rigidly joined to the one that a joint leads to.

        Parameters
        ----------
        path : JointPath
            The path.
        i : int
            Index of a moving joint.

        Returns
        -------
        mass : float
            Zero if nothing there has a mass.
        com : list of 3 floats
            Its centre, in the frame of the row: after the joint, z along its axis.
        """
        move = path.moves[i]
        after_joint = inverse(move.axis_frame)
        if move.step.up:
            after_joint = after_joint @ inverse(_origin(move.step.joint))
        links = self._body(move.step.reached, after_joint)
        self._note_branches(links, {m.step.joint.name for m in path.moves})
        mass, moment = 0.0, np.zeros(4)
        for link, row_from_link in links.items():
            weight, com = self.masses.get(link, (0.0, ORIGIN))
            mass += weight
            moment += weight * (row_from_link @ np.array([*com, 1.0]))
        return mass, [float(x) + 0.0 for x in moment[:3] / mass] if mass > 0.0 else [0.0] * 3

    def _body(self, start: str, row_from_start: Matrix) -> dict[str, Matrix]:
        """All links that fixed joints join to one, `row_from_link`."""
        links, queue = {start: row_from_start}, [start]
        for link in queue:
            for joint in self.joints_at[link]:
                step = Step(joint, up=joint.child == link)
                if joint.kind == "fixed" and step.reached not in links:
                    links[step.reached] = links[link] @ stretch([step])
                    queue.append(step.reached)
        return links

    def _note_branches(self, links: Mapping[str, Matrix], on_path: set[str]) -> None:
        """Notes masses that move on a body, beside the path."""
        for joint in (j for link in links for j in self.joints_at[link] if j.parent == link):
            if joint.kind == "fixed" or joint.name in on_path:
                continue
            below = [joint.child]
            for link in below:
                below += [j.child for j in self.joints_at[link] if j.parent == link]
            heavy = [name for name in below if self.masses.get(name, (0.0, ORIGIN))[0] > 0.0]
            if heavy:
                words = f"the mass of {listed(heavy)} is left out"
                self.notes.append(f'joint "{joint.name}" moves beside the path: {words}')


def _inertial(name: str, link: Element, robot: Robot) -> Mass:
    inertial = link.child("inertial")
    mass = None if inertial is None else inertial.child("mass")
    if inertial is None or mass is None:
        return 0.0, ORIGIN
    place = f'link "{name}", inertial'
    weight = read_numbers(mass.attributes.get("value", ""), 1, robot.file, place, mass.line)[0]
    if weight < 0.0:
        found, expected = f"mass {weight}", "a mass of 0 or more"
        refuse(robot.file, place, line=mass.line, found=found, expected=expected)
    return weight, read_vector(inertial.child("origin"), "xyz", ORIGIN, robot.file, place)
