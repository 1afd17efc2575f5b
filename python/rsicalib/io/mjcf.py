"""A MuJoCo model (MJCF) as a mechanism: its sensed joints, and the loops that `<equality>` closes.

`connect` is a touch, `weld` three touches, `joint` an `equal` of two channels, or a ratio where
the second joint has no sensor. A joint reads its value (rad, m). Joints without a sensor are
bridged where they end a rod (ball joint at one end, `connect` at the other: a distance) or carry a
free body (the distances between what is connected to it); others are refused by name.
"""

from __future__ import annotations

import itertools
import os
from typing import Any

import numpy as np

from rsicalib.io.mjcf_tree import BALL, FREE, HINGE, SLIDE, Body, MjJoint, Model
from rsicalib.io.rigid import Matrix, align_z, inverse, rigid, xyz_rpy
from rsicalib.io.urdf_tree import Element

KINDS = {HINGE: "revolute", SLIDE: "prismatic"}
"""What the rows call the types of MuJoCo."""


def is_mjcf(text: str) -> bool:
    """Whether a document is a MuJoCo model."""
    return "<mujoco" in text[:10_000]


def mechanism_of_mjcf(text_or_path: str | os.PathLike[str]) -> tuple[dict[str, Any], list[str]]:
    """Read a model as a mechanism.

    Parameters
    ----------
    text_or_path : str or path
        The document (it has a `<`), or the path of its file.

    Returns
    -------
    dict, list of str
        The values of a mechanism file, and what they could not take in.

    Raises
    ------
    InputError
        Nothing closes a loop, or a joint on the way has no sensor.
    """
    return _Reading(Model(text_or_path)).mechanism()


class _Reading:
    """One model on its way to a mechanism."""

    def __init__(self, model: Model) -> None:
        self.model = model
        self.notes: list[str] = []
        sensors = model.sections.get("sensor", [])
        told = [e.attributes.get("joint", "") for e in sensors if e.tag == "jointpos"]
        moving = [n for n, (_, j) in model.joints.items() if j.kind in KINDS]
        self.sensed = [name for name in moving if name in told] if told else moving
        if not told:
            self.notes.append("no <jointpos> sensor: every hinge and slide is taken as sensed")
        self.ratios: dict[str, tuple[str, float, float]] = {}
        self.chains: dict[str, list[dict[str, Any]]] = {}
        self.points: list[dict[str, Any]] = []
        self.closures: list[dict[str, Any]] = []
        self.used: dict[str, MjJoint] = {}

    def mechanism(self) -> tuple[dict[str, Any], list[str]]:
        """The mechanism, and what it could not take in."""
        model = self.model
        equalities = model.sections.get("equality", [])
        active = [e for e in equalities if model.value(e, "active") != "false"]
        if len(active) < len(equalities):
            self.notes.append(
                f"{len(equalities) - len(active)} equalities are not active: left out"
            )
        for element in active:
            if element.tag == "joint":
                self._joint(element)
        free: dict[str, list[tuple[str, np.ndarray]]] = {}
        for element in active:
            if element.tag in ("connect", "weld"):
                self._ends(element, free)
            elif element.tag != "joint":
                expected = "connect, weld or joint"
                model.refuse(element, found=f"<{element.tag}>", expected=expected)
        for body, ends in free.items():
            for (a, p), (b, q) in itertools.combinations(ends, 2):
                self._distance(f"{body}: {a} to {b}", a, b, float(np.linalg.norm(p - q)))
        if not self.closures:
            found, expected = "no active <connect>, <weld> or <joint>", "what closes a loop"
            if self.ratios:
                found += f" beside {', '.join(self.ratios)}, which only follows another joint"
            model.refuse(model.bodies["world"].element, found=found, expected=expected)
        channels = [
            {"name": n, "unit": "rad" if j.kind == HINGE else "m", "gain": 1.0, "offset": 0.0}
            | ({} if j.limits is None else {"limits": j.limits})
            for n, j in self.used.items()
        ]
        name = model.bodies["world"].element.attributes.get("model", "MuJoCo model")
        chains = [{"name": n, "dh": rows} for n, rows in self.chains.items()]
        values = {"name": name, "length_unit": "m", "channel": channels, "chain": chains}
        values |= {"point": self.points, "closure": self.closures}
        return values, self.notes

    def _joint(self, element: Element) -> None:
        """Two joints that go together: equal, or one is a multiple of the other."""
        names = [element.attributes.get(k, "") for k in ("joint1", "joint2")]
        text = self.model.value(element, "polycoef") or "0 1 0 0 0"
        factors = self.model.numbers(element, "polycoef", text, len(text.split()))
        factors += [0.0] * (5 - len(factors))
        unknown = [n for n in names if n not in self.model.joints]
        if unknown or any(factors[2:]):
            found = f"polycoef {text}" if not unknown else f"joint {unknown[0]!r}"
            expected = "two joints, one a multiple of the other"
            self.model.refuse(element, found=found, expected=expected)
        (_, one), (_, two) = (self.model.joints[n] for n in names)
        # y - ref_y = p0 + p1 (x - ref_x)
        start = one.ref + factors[0] - factors[1] * two.ref
        both = all(name in self.sensed for name in names)
        if both and factors[1] == 1.0 and start == 0.0:
            self.used |= dict(zip(names, (one, two), strict=True))
            label = element.attributes.get("name", f"{names[0]} = {names[1]}")
            self.closures.append({"name": label, "kind": "equal", "between": names})
        elif names[1] in self.sensed:
            if names[0] in self.sensed:
                self.sensed.remove(names[0])
                self.notes.append(f"the sensor of {names[0]} is not used: it follows {names[1]}")
            self.ratios[names[0]] = (names[1], factors[1], start)
        else:
            self.model.refuse(
                element, found=f"no sensor of {names[1]!r}", expected="one that the other follows"
            )

    def _ends(self, element: Element, free: dict[str, list[tuple[str, np.ndarray]]]) -> None:
        """The points that a `connect` or a `weld` brings together."""
        sites = [element.attributes.get(k) for k in ("site1", "site2")]
        if sites[0] is not None:
            found = [self._site(element, name or "") for name in sites]
            bodies = [body for body, _ in found]
            places = [place[:3, 3] for _, place in found]
        else:
            names = [element.attributes.get("body1", ""), element.attributes.get("body2", "world")]
            bodies = [self._named(element, name) for name in names]
            at = self._anchor(element, bodies)
            places = [at, self._seen_from(bodies[1], bodies[0], at)]
        label = element.attributes.get("name") or f"{bodies[0].name} on {bodies[1].name}"
        loose = [self._is_free(body) for body in bodies]
        if any(loose):
            if all(loose) or element.tag == "weld":
                self.model.refuse(element, found="a body that is free", expected="a connect to it")
            k = loose.index(False)
            ends = free.setdefault(bodies[1 - k].name, [])
            ends.append((self._point(label, bodies[k], places[k]), places[1 - k]))
            return
        rods = [self._rod(body) for body in bodies]
        if element.tag == "connect" and any(r is not None for r in rods):
            k = 0 if rods[0] is not None else 1
            rod = rods[k]
            parent = bodies[k].parent
            assert rod is not None and parent is not None
            length = float(np.linalg.norm(places[k] - rod.pos))
            hung = bodies[k].frame @ np.array([*rod.pos, 1.0])
            a = self._point(f"{bodies[k].name} at its joint", parent, hung[:3])
            b = self._point(f"{bodies[k].name} at its end", bodies[1 - k], places[1 - k])
            self._distance(label, a, b, length)
            return
        if element.tag == "connect":
            self._touch(label, bodies, places)
            return
        text = self.model.value(element, "torquescale") or "1"
        (scale,) = self.model.numbers(element, "torquescale", text, 1)
        turn = inverse(bodies[1].drawn()) @ bodies[0].drawn()
        for k, way in enumerate((np.zeros(3), *np.eye(3)[:2] * scale)):
            other = places[1] + turn[:3, :3] @ way
            self._touch(f"{label} {k + 1}", bodies, [places[0] + way, other])

    def _named(self, element: Element, name: str) -> Body:
        if name not in self.model.bodies:
            expected = f"one of {', '.join(self.model.bodies)}"[:200]
            self.model.refuse(element, found=f"body {name!r}", expected=expected)
        return self.model.bodies[name]

    def _site(self, element: Element, name: str) -> tuple[Body, Matrix]:
        for body in self.model.bodies.values():
            if name in body.sites:
                return body, body.sites[name]
        self.model.refuse(element, found=f"site {name!r}", expected="a site of a body")

    def _anchor(self, element: Element, bodies: list[Body]) -> np.ndarray:
        """The anchor in the frame of the first body; of a weld it is the second's."""
        text = self.model.value(element, "anchor")
        anchor = (
            np.zeros(3)
            if text is None
            else np.array(self.model.numbers(element, "anchor", text, 3))
        )
        if element.tag == "connect":
            return anchor
        pose = self.model.value(element, "relpose")
        if pose is not None and any(self.model.numbers(element, "relpose", pose, 7)[3:]):
            found, expected = "a relpose", "bodies that are drawn as they are welded"
            self.model.refuse(element, found=found, expected=expected)
        return self._seen_from(bodies[0], bodies[1], anchor)

    def _seen_from(self, body: Body, other: Body, at: np.ndarray) -> np.ndarray:
        """A point of another body in the frame of a body, as drawn."""
        seen: np.ndarray = inverse(body.drawn()) @ other.drawn() @ np.array([*at, 1.0])
        return seen[:3]

    def _is_free(self, body: Body) -> bool:
        return any(joint.kind == FREE for one in body.path() for joint in one.joints)

    def _rod(self, body: Body) -> MjJoint | None:
        """The joint about which a rod turns freely: a ball, or unsensed hinges at one place."""
        loose = [j for j in body.joints if j.name not in self.sensed and j.name not in self.ratios]
        if not body.joints or len(loose) < len(body.joints):
            return None
        together = all(np.allclose(j.pos, body.joints[0].pos) for j in body.joints)
        turning = [j.kind for j in body.joints]
        if turning == [BALL] or (set(turning) == {HINGE} and len(turning) > 1 and together):
            return body.joints[0]
        return None

    def _touch(self, label: str, bodies: list[Body], places: list[np.ndarray]) -> None:
        names = [
            self._point(f"{label}, {body.name}", body, place)
            for body, place in zip(bodies, places, strict=True)
        ]
        self.closures.append({"name": label, "kind": "touch", "between": names})

    def _distance(self, label: str, a: str, b: str, value: float) -> None:
        self.closures.append({"name": label, "kind": "distance", "between": [a, b], "value": value})

    def _point(self, name: str, body: Body, at: np.ndarray) -> str:
        """A point on a body, with the chain that leads there."""
        rows = self._rows(body)
        place = at
        point: dict[str, Any] = {"name": name}
        if any("channel" in row for row in rows):
            self.chains.setdefault(body.name, rows)
            point["chain"] = body.name
        else:
            place = (body.drawn() @ np.array([*at, 1.0]))[:3]
        taken = {p["name"] for p in self.points}
        point["name"] = next(n for n in _numbered(name) if n not in taken)
        self.points.append({**point, "at": place.tolist()})
        return str(point["name"])

    def _rows(self, body: Body) -> list[dict[str, Any]]:
        """Rows from the world to a body; each turns about (slides along) its own z."""
        rows: list[dict[str, Any]] = [{}]
        carried = np.eye(4)
        for one in body.path():
            carried = carried @ one.frame
            for joint in one.joints:
                turn = rigid(joint.pos.tolist()) @ align_z(joint.axis.tolist())
                rows[-1] |= _fixed(carried @ turn)
                rows.append(self._row(joint))
                carried = inverse(turn)
        rows[-1] |= _fixed(carried)
        return rows

    def _row(self, joint: MjJoint) -> dict[str, Any]:
        """The moving part of a row: the joint, less what it is where the model is drawn."""
        name, ratio, start = joint.name, None, 0.0
        if name in self.ratios:
            name, ratio, start = self.ratios[name]
        if joint.kind not in KINDS or name not in self.sensed:
            hint = 'Give it a <jointpos> sensor, or leave the loop out (active="false").'
            self.model.refuse(
                joint.element, found="a joint without a sensor", expected="one", hint=hint
            )
        self.used[name] = self.model.joints[name][1]
        row: dict[str, Any] = {"channel": name, "joint": KINDS[joint.kind]}
        if ratio is not None:
            row["ratio"] = ratio
        if start != joint.ref:
            row["theta" if joint.kind == HINGE else "d"] = start - joint.ref
        return row


def _numbered(name: str) -> Any:
    yield name
    for number in itertools.count(2):
        yield f"{name} {number}"


def _fixed(matrix: Matrix) -> dict[str, Any]:
    xyz, rpy = xyz_rpy(matrix)
    return {"xyz": xyz, "rpy": rpy}
