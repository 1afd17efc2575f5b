"""Write `python/rsicalib/_core.pyi` from the compiled module: `python -m scripts.make_stub`.

Names, signatures, defaults and docstrings are those of the module; types, which
it does not know, are looked up here by the name of a parameter and of what
returns. What is not found is Any.
"""

from __future__ import annotations

import inspect
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path

import rsicalib._core as core
from rsicalib.io.files import write_text

STUB = Path(__file__).parents[1] / "python" / "rsicalib" / "_core.pyi"

PARAMETERS = {
    "unit_of_key.key": "str",
    "align": "bool",
    "certify.result": "str",
    "confidence": "float",
    "counted": "Sequence[bool]",
    "known_poses": "tuple[Mapping[str, Any], Array, tuple[float, float], str | None, bool]",
    "limit": "float",
    "orientation": "bool",
    "alpha": "float | None",
    "angles": "Array",
    "beside": "Mapping[str, Any] | None",
    "plan.beside": "Array | None",
    "judged_open_loop.check": "Mapping[str, Any] | None",
    "judged_open_loop.poses": "int",
    "bound_at.noise": "float",
    "candidates": "int",
    "applied": "Mapping[str, Any]",
    "earlier": "Sequence[Estimate]",
    "check": "tuple[Mapping[str, Any], Array] | None",
    "closures": "Sequence[str] | None",
    "counts": "Array",
    "covariance": "Array | None",
    "columns": "int",
    "criterion": "str",
    "further.candidates": "int | None",
    "further.criterion": "str | None",
    "further.poses": "int",
    "further.target": "float | None",
    "beyond_chance.p_values": "Sequence[float | None]",
    "from_": "Array | None",
    "left_out": "Sequence[int] | None",
    "off": "Array | None",
    "Session.trace.off": "Sequence[str] | None",
    "rivals": "Sequence[tuple[Sequence[str], float, float]]",
    "session": "Session",
    "way": "float | None",
    "data": "bytes",
    "exact": "Array",
    "first": "int",
    "Mechanism.from_dict.values": "Mapping[str, Any]",
    "Mechanism.with_terms.terms": "Sequence[Term]",
    "Term.from_dict.values": "Mapping[str, Any]",
    "amount": "str | None",
    "correction": "str | None",
    "doc": "str | None",
    "id": "str",
    "klass": "str",
    "moves": "str | None",
    "parameters": "Mapping[str, float]",
    "per": "str",
    "gains": "Array",
    "gains0": "Array",
    "groups": "Sequence[str] | None",
    "margin": "float",
    "max_iterations": "int | None",
    "means_of_samples.sigma": "float",
    "mechanism": "Mechanism",
    "method": "str | None",
    "noise": "Sequence[float] | None",
    "now": "Sequence[Estimate]",
    "named": "Sequence[tuple[Spec, str]]",
    "offsets": "Array",
    "offsets0": "Array",
    "plan.noise": "float",
    "plan.poses": "int",
    "plan.starts": "int",
    "pose": "Sequence[float]",
    "channels": "Sequence[Any]",
    "suspects.pose": "npt.NDArray[np.int64] | None",
    "unlabelled.pose": "npt.NDArray[np.int64] | None",
    "unlabelled.sample": "npt.NDArray[np.int64] | None",
    "still_stretches.hold": "float",
    "still_stretches.inside": "npt.NDArray[np.bool_] | None",
    "verdicts": "npt.NDArray[np.int64]",
    "distances.usual": "tuple[float, float, float]",
    "standing_out.devices": "Iterable[Array]",
    "standing_out.fits": "Array",
    "standing_out.usual": "Sequence[tuple[float, float, float]]",
    "poses": "Array",
    "traceable.poses": "int",
    "traceable.touched": "int",
    "guided_done.progress": "Mapping[str, object]",
    "progress": "Callable[[str, float], object] | None",
    "rest": "Array | None",
    "samples": "int",
    "scaling": "str",
    "held": "bool",
    "seed": "int",
    "sensors": "Mapping[str, tuple[float, float]]",
    "sigma": "Array",
    "place": "str | None",
    "source": "str | os.PathLike[str] | Mapping[str, Any]",
    "specs": "Sequence[Spec]",
    "supposed": "Sequence[str]",
    "start": "Sequence[int]",
    "starts": "int | None",
    "table": "Mapping[str, Any]",
    "target": "str | None",
    "term": "str",
    "terms": "Sequence[str] | None",
    "text": "str",
    "values": "Array",
    "within": "Sequence[Sequence[float]] | None",
    "without": "Sequence[str] | None",
    "xtol": "float | None",
    "expected": "Mapping[str, Any] | None",
    "shares.expected": "Mapping[str, Any]",
    "shares.terms": "Sequence[str]",
    "rests": "Sequence[Array | None]",
    "tables": "Sequence[Mapping[str, Any]]",
    "population.shares": "Sequence[Mapping[str, Any]]",
    "population.tolerances": "Sequence[float]",
    "devices": "Array",
    "estimates": "Array",
    "time_limit": "float | None",
    "state": "bytes",
    "history.last": "tuple[Mapping[str, Any], Array, Mapping[str, Any], float] | None",
    "history.results": "Sequence[tuple[float, Sequence[Estimate], Sequence[Spec]]]",
}

RETURNS = {
    "Channel.gain": "float",
    "Channel.limits": "tuple[float, float] | None",
    "Channel.name": "str",
    "Channel.noise": "float | None",
    "Channel.offset": "float",
    "Channel.range": "tuple[float, float] | None",
    "Channel.unit": "str",
    "EvidenceSource.gather": "dict[str, Any]",
    "Fit.check": "dict[str, Any]",
    "Fit.forward": "Array",
    "Fit.residuals": "Array",
    "Fit.to_dict": "dict[str, Any]",
    "Fit.warnings": "list[dict[str, Any]]",
    "Fit.wires": "dict[str, Any] | None",
    "Mechanism.channels": "list[Channel]",
    "Mechanism.from_dict": "Mechanism",
    "Mechanism.from_toml": "Mechanism",
    "Mechanism.inverse": "list[float]",
    "Mechanism.equations": "int",
    "Mechanism.key_columns": "list[str]",
    "Mechanism.length_unit": "str",
    "Mechanism.name": "str",
    "Mechanism.rsi": "Mechanism",
    "Mechanism.to_dict": "dict[str, Any]",
    "Mechanism.to_toml": "str",
    "Mechanism.distance_columns": "list[str]",
    "Mechanism.doubts": "list[str]",
    "Mechanism.value_columns": "list[str]",
    "Mechanism.terms": "list[Term]",
    "Mechanism.with_sensors": "Mechanism",
    "Mechanism.with_terms": "Mechanism",
    "Term.from_dict": "Term",
    "Term.id": "str",
    "Term.to_dict": "dict[str, Any]",
    "Session.calibrate": "tuple[dict[str, Any], Fit, Fit | None]",
    "Session.fit": "Fit",
    "mechanism_schema": "str",
    "read_result": "dict[str, Any]",
    "evidence_schema": "str",
    "schemas": "Sequence[tuple[str, str]]",
    "written_keys": "Sequence[tuple[str, Sequence[str]]]",
    "Session.lacking": "dict[str, str]",
    "Session.reference": "dict[str, Any]",
    "Session.suppose": "dict[str, Any]",
    "Session.trace": "dict[str, Any]",
    "bound": "dict[str, Any]",
    "certify": "dict[str, Any]",
    "calibrate_devices": "dict[str, list[Any]]",
    "calibrated_sensors": "Mechanism",
    "check": "dict[str, Any]",
    "exchange": "tuple[list[int], float]",
    "exported": "tuple[Mechanism, dict[str, dict[str, Any]], list[dict[str, Any]]]",
    "suspects": "list[dict[str, Any]]",
    "unlabelled": "dict[str, Any] | None",
    "still_stretches": "list[tuple[int, int]]",
    "usual": "tuple[tuple[float, float, float], tuple[int, float]] | None",
    "distances": "Array",
    "standing_out": "list[tuple[int, float, tuple[int, float | None] | None]]",
    "declared": "dict[str, Any]",
    "fixture": "tuple[list[dict[str, Any]], int]",
    "jacobian": "Array",
    "lasting": "list[str]",
    "linearize": "dict[str, Any]",
    "bound_at": "dict[str, Any]",
    "forward": "Array",
    "further": "dict[str, Any]",
    "identifiable": "dict[str, Any]",
    "guided_done": "bool",
    "needed_poses": "int | None",
    "traceable": "bool",
    "plan": "dict[str, Any]",
    "points": "list[list[list[float]]]",
    "minimize": "tuple[Array, Array, float, int, str]",
    "means_of_samples": "Array",
    "misclosure": "Array",
    "units_of": "list[list[str]]",
    "unit_of_key": "str | None",
    "compared": "list[tuple[int, float, float, float, bool]]",
    "observability": "dict[str, Any]",
    "places": "tuple[list[str], Array, Array | None, list[bool]]",
    "plain_numbers": "list[Array] | None",
    "angles_at": "Array",
    "readings_at": "Array",
    "rsi_angles": "Array",
    "rsi_poses": "Array",
    "rms_misclosure": "float | None",
    "rules": "list[str]",
    "spec": "str",
    "spread": "list[tuple[str, float]]",
    "terms": "list[dict[str, Any]]",
    "within_limits": "Array",
    "workspace": "list[list[float]]",
    "centre_of_population": "list[float]",
    "shares": "list[dict[str, Any] | str]",
    "population": "tuple[dict[str, Any], list[list[tuple[float, float]]], list[int], int | None]",
    "beyond_chance": "list[bool]",
    "summed": "dict[str, Any] | None",
    "common_shifts": "list[dict[str, Any] | None]",
    "Monitor.restore": "None",
    "Monitor.state": "bytes",
    "history": "tuple[list[dict[str, Any]], list[str], dict[str, Any] | None]",
}

HEAD = '''\
"""{doc}"""

# Written by `python -m scripts.make_stub`; a test compares.

import os
from collections.abc import Callable, Iterable, Mapping, Sequence
from typing import Any, final

import numpy as np
import numpy.typing as npt

Array = npt.NDArray[np.float64]
Spec = tuple[str, str | None, str | None]
Estimate = tuple[Spec, str, float | None, float | None]

__version__: str
VERDICTS: Sequence[tuple[str, int]]
"""Every verdict, and what the command exits with."""
COMPLETE: tuple[str, ...]
"""Terms of complete geometry of any chain, with its sensors."""
CRITERIA: tuple[str, ...]
"""Names of what a plan can make small; the default first."""
UNKNOWN_THINGS: tuple[str, ...]
"""What results call unknown things, in the place of a term."""
LARGEST: float
"""The largest number that is taken as an input, in size."""
FALSE_ALARMS: float
"""False alarms per sample that a watch promises at most where nothing is said."""
MARGIN: float
"""Readings that a planned pose keeps from the ends of the range."""
SCALINGS: tuple[str, ...]
"""Names of the scalings of a Jacobian's columns."""
'''


def signature(name: str, function: object) -> str:
    """The parameters of a function, with types."""
    try:
        found = inspect.signature(function)  # type: ignore[arg-type]
    except ValueError:
        return "self, *args: Any, **kwargs: Any"
    words = []
    keyword_only = False
    for parameter in found.parameters.values():
        if parameter.name == "self":
            words.append("self")
            continue
        if parameter.kind is parameter.KEYWORD_ONLY and not keyword_only:
            words.append("*")
            keyword_only = True
        kind = PARAMETERS.get(f"{name}.{parameter.name}", PARAMETERS.get(parameter.name, "Any"))
        default = "" if parameter.default is parameter.empty else f" = {parameter.default!r}"
        words.append(f"{parameter.name}: {kind}{default}")
    return ", ".join(words)


def definition(name: str, function: object, indent: str = "") -> Iterator[str]:
    """A function or method."""
    short = name.rsplit(".", 1)[-1]
    returned = RETURNS.get(name, "Any")
    yield f"{indent}def {short}({signature(name, function)}) -> {returned}:"
    yield from docstring(function, indent + "    ")


def docstring(thing: object, indent: str) -> Iterator[str]:
    """What it says of itself."""
    lines = (inspect.getdoc(thing) or "").replace("\\", "\\\\").splitlines()
    if len(lines) == 1:
        yield f'{indent}"""{lines[0]}"""'
    elif lines:
        yield f'{indent}"""{lines[0]}'
        yield from (f"{indent}{line}".rstrip() for line in lines[1:])
        yield f'{indent}"""'
    else:
        yield f"{indent}..."


def klass(name: str, cls: type) -> Iterator[str]:
    """A class: constructor, properties, methods."""
    yield ""
    yield "@final"
    yield f"class {name}:"
    yield from docstring(cls, "    ")
    members = [(k, v) for k, v in vars(cls).items() if not k.startswith("_")]
    if "__new__" in vars(cls):
        members.insert(0, ("__new__", cls))
    for short, member in sorted(members, key=lambda m: m[0]):
        yield ""
        full = f"{name}.{short}"
        if short == "__new__":
            words = signature(name, cls)
            yield f"    def __new__(cls, {words}) -> {name}: ..."
        elif inspect.isgetsetdescriptor(member):
            yield "    @property"
            yield f"    def {short}(self) -> {RETURNS.get(full, 'Any')}:"
            yield from docstring(member, "        ")
        elif isinstance(member, staticmethod):
            yield "    @staticmethod"
            yield from definition(full, getattr(cls, short), "    ")
        else:
            yield from definition(full, member, "    ")


def stub() -> str:
    """The text of the stub, before formatting."""
    lines = [HEAD.format(doc=inspect.getdoc(core))]
    names = sorted(n for n, it in vars(core).items() if callable(it) and not n.startswith("_"))
    for name in names:
        if inspect.isclass(getattr(core, name)):
            lines += klass(name, getattr(core, name))
    for name in names:
        if not inspect.isclass(getattr(core, name)):
            lines += ["", *definition(name, getattr(core, name))]
    return "\n".join(lines) + "\n"


def formatted(text: str) -> str:
    """The text as `ruff format` leaves it."""
    ruff = [sys.executable, "-m", "ruff", "format", "--stdin-filename", str(STUB), "-"]
    done = subprocess.run(ruff, input=text, capture_output=True, text=True, check=True)
    return done.stdout


if __name__ == "__main__":
    write_text(STUB, formatted(stub()))
