"""Number of parameters that a mechanism can determine, counted before any reading is taken.

The parameters of a model are counted three times:

```text
given     columns of X, redundant ones and all
minimal   rank of what they do to the points that the chains carry, loops open
known     rank of X where the loops are closed, unknown points eliminated
```

Loops hide what moves everything alike: the place of the whole in the base, and its size unless a
length is known. Configurations are drawn at random within the joint limits and closed by Newton's
method with the shortest step.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import product
from typing import Any

import numpy as np

from rsicalib import _core
from rsicalib._core import Mechanism
from rsicalib.arrays import FloatArray
from rsicalib.errors import InputError
from rsicalib.records import Record
from rsicalib.work.arguments import MechanismArg, open_mechanism

__all__ = ["COMPLETE", "Counted", "Identifiable", "identifiable"]

COMPLETE = ("offset", "gain", "link_frame", "base_position", "base_tilt", "base_bearing")
"""Complete geometry of any chain, with its sensors; and where there are such, `point_position` and
`distance`."""

RANK = 1e-9
"""Singular values below this fraction of the largest are zero; rounding leaves 1e-13."""

PLACEMENTS = 6
"""Values of a column that tells unknown points apart, where the mechanism names none."""

ITERATIONS = 60
TRIES = 40


@dataclass(frozen=True)
class Counted(Record):
    """One term: how many parameters it has, and how many could be told apart from all others."""

    term: str
    parameters: int
    alone: int
    """Rank with every other parameter known."""
    beside: int
    """Rank with every other parameter unknown."""


@dataclass(frozen=True)
class Identifiable(Record):
    """What readings of a mechanism could tell.

    Attributes
    ----------
    model : str
        `declared` or `complete`.
    terms : tuple of Counted
        Term by term.
    parameters, minimal, known : int
        As in the header of this module.
    hidden : tuple of str
        What hides the difference between the last two, as far as it has a name.
    configurations : int
        That were closed, and on which the counts rest.
    """

    model: str
    terms: tuple[Counted, ...]
    parameters: int
    minimal: int
    known: int
    hidden: tuple[str, ...]
    configurations: int

    def text(self) -> str:
        """A few lines for the terminal."""
        unknown = self.minimal - self.known
        lines = [
            f"{self.model} model: {self.parameters} parameters, {self.minimal} of them minimal, "
            f"of which {self.known} can be known"
        ]
        for count in self.terms:
            lines.append(
                f"  {count.term:18} {count.parameters:3}   {count.alone:3} by themselves, "
                f"{count.beside:3} beside all others"
            )
        if unknown:
            named = f": {'; '.join(self.hidden)}" if self.hidden else ""
            lines.append(f"  {unknown} cannot be known from closed loops{named}")
        return "\n".join(lines)


def identifiable(
    mechanism: MechanismArg = "rsi", terms: Sequence[str] | None = None, *, seed: int = 0
) -> Identifiable:
    """Count what readings of a mechanism can and cannot tell.

    Parameters
    ----------
    mechanism : str, path or Mechanism
        Joint limits say where its joints may be.
    terms : sequence of str, optional
        A model; as the mechanism declares it where not given. `COMPLETE` stands for
        complete geometry.
    seed : int
        Seed of the configurations. The counts do not depend on it.

    Returns
    -------
    Identifiable
        The counts.

    Raises
    ------
    InputError
        The loops cannot be closed anywhere near random configurations.

    Examples
    --------
    >>> found = identifiable("rsi", COMPLETE)
    >>> found.minimal, found.known
    (57, 50)
    """
    loaded = open_mechanism(mechanism)
    declared = loaded.to_dict()
    complete = terms is not None and tuple(terms) == COMPLETE
    if complete:
        specs = _complete(loaded, declared)
    else:
        specs = list(declared["model"]["terms"] if terms is None else terms)
    closed = _Closed(loaded, declared, specs, np.random.default_rng(seed))
    return closed.counted("complete" if complete else "declared" if terms is None else "given")


def _complete(mechanism: Mechanism, declared: dict[str, Any]) -> list[str]:
    """Terms of complete geometry that this mechanism has targets for."""
    targets = {term["id"]: term["targets"] for term in _core.terms(mechanism)}
    wanted = [*COMPLETE, "point_position", "distance"]
    carrying = {p["chain"] for p in declared["point"] if p.get("chain")}
    fixed = {p["name"] for p in declared["point"] if p.get("at") is not None}
    specs = []
    for term in wanted:
        for target in targets.get(term, []):
            if term == "point_position" and target not in carrying:
                continue
            if term == "distance" and not _between_places(declared, target, fixed):
                continue
            specs.append(_core.spec(term, target))
    return specs


def _between_places(declared: dict[str, Any], name: str, fixed: set[str]) -> bool:
    """True for a distance that samples take part in: one between unknown points is declared."""
    closure = next(c for c in declared["closure"] if c["name"] == name)
    return any(end in fixed for end in closure["between"])


class _Closed:
    """Random configurations in which the loops are closed."""

    def __init__(
        self,
        mechanism: Mechanism,
        declared: dict[str, Any],
        specs: list[str],
        rng: np.random.Generator,
    ) -> None:
        self.declared = declared
        self.specs = specs
        self.rng = rng
        self.gains = np.array([c["gain"] for c in declared["channel"]])
        self.offsets = np.array([c["offset"] for c in declared["channel"]])
        self.limits = np.array([_limits(c, declared) for c in declared["channel"]])
        # Ranges are for readings; what joints can do is in the limits.
        free = {**declared, "channel": [_unbounded(c) for c in declared["channel"]]}
        self.mechanism = Mechanism.from_dict(free)
        self.open = Mechanism.from_dict(_opened(free))
        self.columns = mechanism.value_columns
        self.keys = self._keys(mechanism.key_columns)
        size = self._size()
        self._close(size)

    # -------------------------------------------------------------- configurations

    def _keys(self, columns: list[str]) -> list[tuple[str, ...]]:
        """Combinations of the columns that tell unknown points apart."""
        if not columns:
            return [()]
        named: dict[str, list[str]] = {c: [] for c in columns}
        for closure in self.declared["closure"]:
            for end in closure["between"]:
                for column in columns:
                    value = _named_value(end, column, columns)
                    if value is not None and value not in named[column]:
                        named[column].append(value)
        free = [str(i) for i in range(PLACEMENTS)]
        return list(product(*(named[c] or free for c in columns)))

    def _size(self) -> int:
        """Configurations for each combination of keys: equations for three times the unknowns."""
        one = self._linear(self.mechanism, self._draw(len(self.keys)), self.keys, self.specs)
        equations = len(one["f"][0])
        return 3 + 3 * len(one["parameters"]) // (equations * len(self.keys))

    def _draw(self, n: int) -> FloatArray:
        low, high = self.limits.T
        out: FloatArray = self.rng.uniform(low, high, (n, len(low)))
        return out

    def _linear(
        self,
        mechanism: Mechanism,
        angles: FloatArray,
        keys: list[tuple[str, ...]],
        specs: list[str],
        unknown: FloatArray | None = None,
        columns: FloatArray | None = None,
    ) -> dict[str, Any]:
        n = len(angles)
        own = mechanism.value_columns
        given = np.ones((n, len(own))) if columns is None else columns
        table = {
            "values": (angles - self.offsets) / self.gains,
            "pose": None,
            "time": None,
            "temperature": None,
            "session": None,
            "keys": [list(k) for k in zip(*keys, strict=True)] if mechanism.key_columns else [],
            "columns": [given[:, k].tolist() for k in range(len(own))],
        }
        return _core.linearize(mechanism, table, specs, unknown)

    def _close(self, size: int) -> None:
        """Newton's method on as many configurations as are needed."""
        self.unknown = self._unknown_places()
        kept: list[FloatArray] = []
        keys: list[tuple[str, ...]] = []
        missing = {key: size for key in self.keys}
        scale = self._scale()
        for _ in range(TRIES):
            wanted = [key for key, count in missing.items() for _ in range(2 * count)]
            if not wanted:
                break
            angles, far = self._newton(self._draw(len(wanted)), wanted)
            low, high = self.limits.T
            good = (far < 1e-10 * scale) & np.all((angles >= low) & (angles <= high), axis=1)
            for key, at, ok in zip(wanted, angles, good, strict=True):
                if ok and missing[key]:
                    kept.append(at)
                    keys.append(key)
                    missing[key] -= 1
        if len(kept) < max(2, size * len(self.keys) // 4):
            name = self.declared["name"]
            found = f"{len(kept)} of {size * len(self.keys)} configurations of {name!r} that close"
            expected = "joint limits within which its loops can be closed"
            raise InputError(f"found {found}, expected {expected}")
        order = sorted(range(len(keys)), key=lambda i: self.keys.index(keys[i]))
        self.angles = np.array([kept[i] for i in order])
        self.row_keys = [keys[i] for i in order]
        self.values = self._measured(self.angles, self.row_keys)

    def _scale(self) -> float:
        """The longest length of the drawing."""
        lengths = [abs(v) for c in self.declared["chain"] for row in c["dh"] for v in _lengths(row)]
        return max([1e-12, *lengths])

    def _unknown_places(self) -> FloatArray | None:
        """Places of the unknown points that chains can reach, known distances apart."""
        if self.keys == [()]:
            return None
        places = None
        for _ in range(TRIES):
            one = self._linear(self.mechanism, self._draw(len(self.keys)), self.keys, [], places)
            places = one["unknown"] if places is None else places
            if not one["links"]:
                break
            # The shortest step that puts linked points at their distances.
            step = np.linalg.lstsq(one["apart"], np.array(one["links"]), rcond=None)[0]
            places = places - step.reshape(-1, 3)
            if np.abs(one["links"]).max() < 1e-12:
                break
        return places

    def _newton(
        self, angles: FloatArray, keys: list[tuple[str, ...]]
    ) -> tuple[FloatArray, FloatArray]:
        """The closed configurations near those drawn, and how far from closed they are."""
        n, channels = angles.shape
        known = self._known_equations()
        order = list(dict.fromkeys(keys))
        unknown = None if self.unknown is None else self._for_keys(order)
        far = np.full(n, np.inf)
        for _ in range(ITERATIONS):
            one = self._linear(self.mechanism, angles, keys, [], unknown)
            f = one["f"].reshape(n, -1)[:, known]
            slope = one["a"].reshape(n, -1, channels)[:, known] / self.gains
            far = np.abs(f).max(axis=1) if f.size else np.zeros(n)
            if not f.size or far.max() < 1e-13 * self._scale():
                break
            step = (np.linalg.pinv(slope, rcond=1e-9) @ f[..., None])[..., 0]
            longest = np.abs(step).max(axis=1, keepdims=True)
            angles = angles - step * 0.3 / np.maximum(longest, 0.3)
        return angles, far

    def _for_keys(self, keys: list[tuple[str, ...]]) -> FloatArray:
        """Unknown points in the order in which the core numbers them for these keys."""
        everything = self._linear(self.mechanism, self._draw(len(self.keys)), self.keys, [])
        some = self._linear(self.mechanism, self._draw(len(keys)), keys, [])
        names = [p[1] for p in everything["parameters"] if p[0] == "unknown_point"][::3]
        wanted = [p[1] for p in some["parameters"] if p[0] == "unknown_point"][::3]
        assert self.unknown is not None
        return np.ascontiguousarray(self.unknown[[names.index(w) for w in wanted]])

    def _known_equations(self) -> list[int]:
        """Equations whose distance is not measured: those that readings have to satisfy."""
        out: list[int] = []
        equation = 0
        for closure in self.declared["closure"]:
            if _is_link(closure, self.declared):
                continue
            width = 3 if closure["kind"] == "touch" else 1
            if not isinstance(closure.get("value"), str):
                out += range(equation, equation + width)
            equation += width
        return out

    def _measured(self, angles: FloatArray, keys: list[tuple[str, ...]]) -> FloatArray | None:
        """Distances that the readings would bring along."""
        if not self.columns:
            return None
        order = list(dict.fromkeys(keys))
        unknown = None if self.unknown is None else self._for_keys(order)
        f = self._linear(self.mechanism, angles, keys, [], unknown)["f"]
        f = f.reshape(len(angles), -1)
        out = np.ones((len(angles), len(self.columns)))
        equation = 0
        for closure in self.declared["closure"]:
            if _is_link(closure, self.declared):
                continue
            if isinstance(closure.get("value"), str):  # f = |a - b|² - 1
                column = self.columns.index(closure["value"])
                out[:, column] = np.sqrt(f[:, equation] + 1.0)
            equation += 3 if closure["kind"] == "touch" else 1
        return out

    # -------------------------------------------------------------- counts

    def counted(self, model: str) -> Identifiable:
        order = list(dict.fromkeys(self.row_keys))
        unknown = None if self.unknown is None else self._for_keys(order)
        one = self._linear(
            self.mechanism, self.angles, self.row_keys, self.specs, unknown, self.values
        )
        names = one["parameters"]
        x = np.vstack([one["x"], one["apart"]])
        device = np.array([p[0] != "unknown_point" for p in names])
        x = _eliminated(x[:, device], x[:, ~device])
        names = [p for p, own in zip(names, device, strict=True) if own]
        unit = _unit(x)
        term_of = np.array([p[0] for p in names])
        counts = []
        for term in dict.fromkeys(term_of):
            own = unit[:, term_of == term]
            beside = _rank(_eliminated(own, unit[:, term_of != term]), relative_to=1.0)
            counts.append(Counted(str(term), own.shape[1], _rank(own), beside))
        minimal = self._minimal(names)
        known = _rank(unit)
        return Identifiable(
            model=model,
            terms=tuple(counts),
            parameters=len(names),
            minimal=minimal,
            known=known,
            hidden=tuple(self._hidden(names, x)) if known < minimal else (),
            configurations=len(self.angles),
        )

    def _minimal(self, names: list[tuple[str, str, str]]) -> int:
        """Rank of what the parameters do to carried points, and to distances."""
        closure = [p[0] == "distance" for p in names]
        specs = [s for s in self.specs if not s.startswith("distance")]
        n = 10 + len(names)
        one = self._linear(self.open, self._draw(n), [()] * n, specs)
        return _rank(_unit(one["x"])) + sum(closure)

    def _hidden(self, names: list[tuple[str, str, str]], x: FloatArray) -> list[str]:
        """Motions and growth of the whole that no loop sees, if the model can make them."""
        n = 10 + len(names)
        specs = [s for s in self.specs if not s.startswith("distance")]
        one = self._linear(self.open, self._draw(n), [()] * n, specs)
        points, effect = one["f"].reshape(n, -1, 3), one["x"]
        moves = [np.broadcast_to(e, points.shape) for e in np.eye(3)]
        moves += [np.cross(e, points) for e in np.eye(3)]
        rigid = self._unseen(effect, [m.reshape(-1) for m in moves], 0, names, x)
        size = self._unseen(effect, [m.reshape(-1) for m in [*moves, points]], 1, names, x) - rigid
        words = [f"where the whole stands in its base ({rigid})"] if rigid else []
        return words + (["its size: declare one length that is known (1)"] if size else [])

    def _unseen(
        self,
        effect: FloatArray,
        moves: list[FloatArray],
        growing: int,
        names: list[tuple[str, str, str]],
        x: FloatArray,
    ) -> int:
        """How many combinations of these moves of the carried points no closure sees."""
        scale = _scales(effect)
        target = np.column_stack(moves)
        found = np.linalg.lstsq(effect * scale, target, rcond=RANK)[0]
        made = np.abs(effect * scale @ found - target).max(axis=0)
        possible = made < 1e-6 * np.abs(target).max(axis=0)
        directions = np.zeros((len(names), len(moves)))
        directions[[p[0] != "distance" for p in names]] = found * scale[:, None]
        for i, (term, target_name, _) in enumerate(names):
            if term == "distance" and growing:
                closures = self.declared["closure"]
                value = next(c for c in closures if c["name"] == target_name).get("value")
                directions[i, -1] = value if isinstance(value, float | int) else 0.0
        seen = x @ directions[:, possible]
        return int(possible.sum()) - _rank(seen, relative_to=float(np.abs(x).max()) * 1e2)


def _limits(channel: dict[str, Any], declared: dict[str, Any]) -> tuple[float, float]:
    """Joint coordinates of a channel."""
    if channel.get("limits"):
        low, high = channel["limits"]
        return float(low), float(high)
    row = next(r for c in declared["chain"] for r in c["dh"] if r.get("channel") == channel["name"])
    if channel.get("range"):
        ends = sorted(channel["gain"] * v + channel["offset"] for v in channel["range"])
        return ends[0], ends[1]
    if row.get("joint") == "prismatic":
        lengths = [abs(v) for c in declared["chain"] for r in c["dh"] for v in _lengths(r)]
        return -max([*lengths, 1e-3]), max([*lengths, 1e-3])
    return -np.pi, np.pi


def _lengths(row: dict[str, Any]) -> list[float]:
    return [row.get("a", 0.0), row.get("d", 0.0), *row.get("xyz", [])]


def _unbounded(channel: dict[str, Any]) -> dict[str, Any]:
    return {k: v for k, v in channel.items() if k not in ("range", "limits")}


def _is_link(closure: dict[str, Any], declared: dict[str, Any]) -> bool:
    names = {p["name"] for p in declared["point"]}
    return all(end not in names for end in closure["between"])


def _named_value(end: str, column: str, columns: list[str]) -> str | None:
    """The value that an end of a closure gives to a column: `socket[at=socket0]`."""
    if not end.endswith("]") or "[" not in end:
        return None
    inside = end[end.index("[") + 1 : -1]
    for start in (f"{column}=", f",{column}="):
        at = 0 if inside.startswith(start) and start[0] != "," else inside.find(start)
        if (start[0] == "," and at >= 0) or (start[0] != "," and inside.startswith(start)):
            rest = inside[at + len(start) :]
            ends = [rest.find(f",{c}=") for c in columns]
            return rest[: min([e for e in ends if e >= 0], default=len(rest))].strip()
    return None


def _opened(declared: dict[str, Any]) -> dict[str, Any]:
    """The same chains, each carried point closed on the origin: `f` is where it is."""
    points = [p for p in declared["point"] if p.get("chain")]
    if not points:
        raise InputError(f"{declared['name']}: found no point on a chain, expected one")
    origin = "origin"
    while any(p["name"] == origin for p in points):
        origin += "_"
    closures = [
        {"name": p["name"], "kind": "touch", "between": [p["name"], origin]} for p in points
    ]
    kept = {k: v for k, v in declared.items() if k not in ("platform", "rest", "model")}
    at = {"name": origin, "at": [0.0, 0.0, 0.0]}
    return {**kept, "point": [*points, at], "closure": closures}


def _scales(x: FloatArray) -> FloatArray:
    norms = np.linalg.norm(x, axis=0)
    real = norms > 1e-12 * norms.max(initial=0.0)  # what rounding leaves is no column
    out: FloatArray = np.divide(1.0, norms, out=np.zeros_like(norms), where=real)
    return out


def _unit(x: FloatArray) -> FloatArray:
    """Columns of length one: they are in rad, lengths and rad per count."""
    return x * _scales(x)


def _rank(x: FloatArray, relative_to: float | None = None) -> int:
    if not x.size:
        return 0
    singular = np.linalg.svd(x, compute_uv=False)
    return int(np.sum(singular > RANK * (relative_to or max(singular[0], 1e-300))))


def _eliminated(x: FloatArray, others: FloatArray) -> FloatArray:
    """What is left of columns when others are free."""
    if not others.shape[1]:
        return x
    u, singular, _ = np.linalg.svd(_unit(others), full_matrices=False)
    u = u[:, singular > RANK * max(singular[0], 1e-300)]
    out: FloatArray = x - u @ (u.T @ x)
    return out
