"""Write the stubs of the package, `_core.pyi` and `__init__.pyi`: `python -m scripts.make_stub`.

Names, signatures, defaults and docstrings are those of the compiled module; types, which
it does not know, are looked up here by the name of a parameter and of what
returns. What is not found is Any. Public names of the package are those of `rsicalib._HOMES`.
"""

from __future__ import annotations

import inspect
import subprocess
import sys
from collections.abc import Iterator, Mapping
from pathlib import Path

import rsicalib
import rsicalib._core as core
from rsicalib.io.files import write_text

STUB = Path(__file__).parents[1] / "python" / "rsicalib" / "_core.pyi"

NAMES = STUB.with_name("__init__.pyi")


def _by_name(kinds: Mapping[str, str]) -> dict[str, str]:
    """The type of each name, from the names of each type."""
    return {name: kind for kind, names in kinds.items() for name in names.split()}


PARAMETERS = _by_name(
    {
        "Array": """
            angles counts devices estimates exact gains gains0 offsets offsets0 poses sigma
            standing_out.fits values
        """,
        "Array | None": "covariance from_ off plan.beside rest",
        "Callable[[str, float], object] | None": "progress",
        "Iterable[Array]": "standing_out.devices",
        "Mapping[str, Any]": """
            Mechanism.from_dict.values Term.from_dict.values applied shares.expected table
        """,
        "Mapping[str, Any] | None": "beside expected judged_open_loop.check",
        "Mapping[str, float]": "parameters",
        "Mapping[str, object]": "guided_done.progress",
        "Mapping[str, tuple[float, float]]": "sensors",
        "Mechanism": "mechanism",
        "Sequence[Any]": "channels",
        "Sequence[Array | None]": "rests",
        "Sequence[Estimate]": "earlier now",
        "Sequence[Mapping[str, Any]]": "population.shares tables",
        "Sequence[Sequence[float]] | None": "within",
        "Sequence[Spec]": "specs",
        "Sequence[Term]": "Mechanism.with_terms.terms",
        "Sequence[bool]": "counted",
        "Sequence[float | None]": "beyond_chance.p_values",
        "Sequence[float]": "population.tolerances pose",
        "Sequence[float] | None": "noise",
        "Sequence[int]": "start",
        "Sequence[int] | None": "left_out",
        "Sequence[str]": "shares.terms supposed",
        "Sequence[str] | None": "Session.trace.off closures groups terms without",
        "Sequence[tuple[Sequence[str], float, float]]": "rivals",
        "Sequence[tuple[Spec, str]]": "named",
        "Sequence[tuple[float, Sequence[Estimate], Array | None, Sequence[Spec]]]": (
            "history.results"
        ),
        "Sequence[tuple[float, float, float, int]]": "standing_out.usual",
        "Session": "session",
        "bool": "align held orientation",
        "bytes": "data state",
        "float": """
            bound_at.noise confidence limit margin means_of_samples.sigma plan.noise
            still_stretches.hold
        """,
        "float | None": "alpha further.target time_limit way xtol",
        "int": """
            candidates columns first further.poses judged_open_loop.poses plan.poses plan.starts
            samples seed traceable.poses traceable.touched
        """,
        "int | None": "further.candidates max_iterations starts",
        "npt.NDArray[np.bool_] | None": "still_stretches.inside",
        "npt.NDArray[np.int64]": "verdicts",
        "npt.NDArray[np.int64] | None": "suspects.pose unlabelled.pose unlabelled.sample",
        "str": "certify.result criterion id klass per scaling term text unit_of_key.key",
        "str | None": "amount correction doc further.criterion method moves place target",
        "str | os.PathLike[str] | Mapping[str, Any]": "source",
        "tuple[Mapping[str, Any], Mapping[str, Any], float] | None": "history.last",
        "tuple[Mapping[str, Any], Array, tuple[float, float], str | None, bool]": "known_poses",
        "tuple[Mapping[str, Any], Array] | None": "check",
        "tuple[float, float, float, int]": "distances.usual",
    }
)

RETURNS = _by_name(
    {
        "Array": """
            Fit.forward Fit.residuals Placer.place angles_at distances forward jacobian
            joint_coordinates means_of_samples misclosure readings_at rsi_angles rsi_poses
            within_limits
        """,
        "Fit": "Session.fit",
        "Mechanism": """
            Mechanism.from_dict Mechanism.from_toml Mechanism.rsi Mechanism.with_sensors
            Mechanism.with_terms calibrated_sensors
        """,
        "None": "Monitor.restore",
        "Sequence[tuple[str, Sequence[str]]]": "written_keys",
        "Sequence[tuple[str, str]]": "schemas",
        "Term": "Term.from_dict",
        "bool": "guided_done traceable",
        "bytes": "Monitor.state",
        "dict[str, Any]": """
            EvidenceSource.changes EvidenceSource.gather Fit.check Fit.to_dict Mechanism.to_dict
            Session.reference Session.suppose Session.trace Term.to_dict bound bound_at certify
            check declared further identifiable linearize observability plan read_result
        """,
        "dict[str, Any] | None": "Fit.wires summed unlabelled",
        "dict[str, list[Any]]": "calibrate_devices",
        "dict[str, str]": "Mechanism.column_units Session.lacking",
        "float": "Channel.gain Channel.offset",
        "float | None": "Channel.noise expects_more rms_misclosure",
        "int": "Mechanism.equations",
        "int | None": "needed_poses",
        "list[Array] | None": "plain_numbers",
        "list[Channel]": "Mechanism.channels",
        "list[Term]": "Mechanism.terms",
        "list[bool]": "beyond_chance",
        "list[dict[str, Any] | None]": "common_shifts",
        "list[dict[str, Any] | str]": "shares",
        "list[dict[str, Any]]": "Fit.warnings suspects terms",
        "list[float]": "Mechanism.inverse centre_of_population",
        "list[list[float]]": "workspace",
        "list[list[list[float]]]": "points",
        "list[list[str]]": "units_of",
        "list[str]": """
            Mechanism.distance_columns Mechanism.doubts Mechanism.instrument_columns
            Mechanism.key_columns Mechanism.law_columns Mechanism.optional_columns
            Mechanism.value_columns lasting rules
        """,
        "list[tuple[int, float, float, float, bool]]": "compared",
        "list[tuple[int, float, tuple[int, float | None] | None]]": "standing_out",
        "list[tuple[int, int]]": "still_stretches",
        "list[tuple[str, float]]": "spread",
        "str": """
            Channel.name Channel.unit Mechanism.length_unit Mechanism.name Mechanism.to_toml
            Term.id evidence_schema mechanism_schema spec
        """,
        "str | None": "unit_of_key",
        "tuple[Array, Array, float, int, str]": "minimize",
        "tuple[Mechanism, dict[str, dict[str, Any]], list[dict[str, Any]]]": "exported",
        "tuple[dict[str, Any], Fit, Fit | None]": "Session.calibrate",
        "tuple[dict[str, Any], list[list[tuple[float, float]]], list[int], int | None]": (
            "population"
        ),
        "tuple[float, float] | None": "Channel.limits Channel.range",
        "tuple[list[dict[str, Any]], int]": "fixture",
        "tuple[list[dict[str, Any]], list[str], dict[str, Any] | None]": "history",
        "tuple[list[int], float]": "exchange",
        "tuple[list[str], Array, Array | None, list[bool]]": "places",
        "tuple[tuple[float, float, float, int], tuple[int, float]] | None": "usual",
    }
)

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


def names() -> str:
    """The public names of the package as type checkers read them, before formatting."""
    homes: Mapping[str, str] = vars(rsicalib)["_HOMES"]
    lines = ["# Written by `python -m scripts.make_stub`; a test compares."]
    lines += [
        f"from {home} import {', '.join(sorted(homes[home].split()))}" for home in sorted(homes)
    ]
    every = sorted(rsicalib.__all__, key=lambda name: (not name.isupper(), name))
    return "\n".join([*lines, "", f"__all__ = {every!r}"]) + "\n"


def formatted(text: str) -> str:
    """The text as `ruff format` leaves it."""
    ruff = [sys.executable, "-m", "ruff", "format", "--stdin-filename", str(STUB), "-"]
    done = subprocess.run(ruff, input=text, capture_output=True, text=True, check=True)
    return done.stdout


if __name__ == "__main__":
    write_text(STUB, formatted(stub()))
    write_text(NAMES, formatted(names()))
