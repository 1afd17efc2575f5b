"""A calibration as a mechanism: the TOML and the URDF that have its parameters in them.

The core puts the parameters in, `crates/rsicalib/src/apply/export.rs`; here they are written: as
TOML, and into the robot descriptions that the chains came from. What a mechanism file has no words
for (a curvature, a compliance) is named, and not put in.
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any, Literal, TypeAlias

from rsicalib import _core
from rsicalib._core import Mechanism
from rsicalib.errors import InputError
from rsicalib.facts.records import Record
from rsicalib.io.folders import MARK
from rsicalib.io.mechanisms import mechanism_document
from rsicalib.io.sources import read_text
from rsicalib.io.urdf import write_urdf
from rsicalib.results.result import Result
from rsicalib.work.applying import as_applied
from rsicalib.work.arguments import (
    CalibrationArg,
    MechanismArg,
    earlier_result,
    open_mechanism,
)

NotedKind: TypeAlias = Literal["new_row", "column", "no_place", "of_its_session"]
"""What a note is about; `apply/export.rs` of the core says what each of them means."""


class Noted(Record):
    """What a mechanism with the parameters in it does not tell by itself."""

    kind: NotedKind
    """What it is."""
    term: str | None
    """Id of the term that it is about; None where it is about none."""
    target: str | None
    """The chain, the closure, or what the term belongs to."""
    text: str
    """The same in words."""


@dataclass(frozen=True)
class Calibrated:
    """A mechanism with the parameters of a calibration in it.

    Attributes
    ----------
    mechanism : Mechanism
        The points of a chain moved in the frame at its end.
    tips : dict of str to dict
        The same motion of that frame instead, as a last row of the chain: for a URDF.
    notes : tuple of Noted
        What could not be put in.
    """

    mechanism: Mechanism
    tips: dict[str, dict[str, Any]]
    notes: tuple[Noted, ...]

    @property
    def said(self) -> tuple[str, ...]:
        """What could not be put in, in words."""
        return tuple(note.text for note in self.notes)


def calibrated(mechanism: MechanismArg, calibration: CalibrationArg) -> Calibrated:
    """Put the parameters of a calibration into its mechanism.

    Parameters
    ----------
    mechanism : str, path or Mechanism
        That was calibrated.
    calibration : path, Calibration or Trace
        The result.

    Returns
    -------
    Calibrated
        Under which readings give the same points.

    Raises
    ------
    InputError
        The result is of another mechanism.
    """
    result, loaded = earlier_result(calibration, open_mechanism(mechanism, calibration))
    found, tips, notes = _core.exported(loaded, as_applied(result, loaded))
    return Calibrated(found, tips, tuple(map(Noted.from_dict, notes)))


def export_toml(mechanism: MechanismArg, calibration: CalibrationArg) -> str:
    """Write the calibrated mechanism as TOML text.

    Parameters
    ----------
    mechanism, calibration
        As for `calibrated`.

    Returns
    -------
    str
        A mechanism file; comments at its head say what could not be put in.
    """
    found = calibrated(mechanism, calibration)
    head = [f"{found.mechanism.name}, calibrated: offsets, gains and geometry are in here."]
    comments = [f"# {' '.join(line.split())}\n" for line in [*head, *found.said]]
    return "".join(comments) + found.mechanism.to_toml()


def export_urdf(mechanism: MechanismArg, calibration: CalibrationArg) -> dict[str, str]:
    """Write the robot descriptions that the chains came from, calibrated.

    Offsets are in the origins: readings are joint values, and a mechanism file that
    refers to such a document declares none. A comment at its foot says what it lacks.

    Parameters
    ----------
    mechanism, calibration
        As for `calibrated`.

    Returns
    -------
    dict of str to str
        Name of a file and its text; none for a mechanism that is not from a URDF file.

    Raises
    ------
    InputError
        As for `calibrated`.
    """
    sources = _sources(mechanism)
    if not sources:
        return {}
    found = calibrated(mechanism, calibration)
    chains = {chain["name"]: chain for chain in found.mechanism.to_dict()["chain"]}
    sensors = {channel.name: channel for channel in found.mechanism.channels}
    declared = {channel.name: channel.offset for channel in open_mechanism(mechanism).channels}
    texts: dict[Path, str] = {}
    notes: dict[Path, list[str]] = {}
    for path, source in sources:
        rows = list(chains[source["name"]]["dh"])
        rows.append(found.tips.get(source["name"], {}))
        text = texts.get(path) or read_text(path, "a robot description", "URDF")
        own = source["channels"].values()
        export = write_urdf(
            text,
            source["base"],
            source["tip"],
            source["channels"],
            rows,
            offsets={name: sensors[name].offset for name in own},
            gains={name: sensors[name].gain for name in own},
            zeros={name: declared[name] for name in own},
        )
        texts[path] = export.text
        notes.setdefault(path, []).extend(export.notes)
        if (export.base, export.tip) != (source["base"], source["tip"]):
            notes[path].append(f'chain "{source["name"]}" is {export.base} to {export.tip}')
    stems = [path.stem for path in texts]
    out = {}
    for path, text in texts.items():
        name = "calibrated.urdf" if len(stems) == 1 else f"calibrated_{path.stem}.urdf"
        lines = [" ".join(n.split()).replace("--", "- -") for n in [*notes[path], *found.said]]
        foot = "".join(f"<!-- rsicalib: {line} -->\n" for line in lines)
        out[name] = text + ("" if text.endswith("\n") or not foot else "\n") + foot
    return out


def _sources(mechanism: MechanismArg) -> list[tuple[Path, dict[str, Any]]]:
    """Chains that a mechanism file takes from URDF, with the path of the document."""
    if isinstance(mechanism, Mechanism):
        return []
    folder, document = mechanism_document(mechanism)
    return [(folder / c["urdf"], c) for c in document.get("chain", []) if "urdf" in c]


def calibrated_files(mechanism: MechanismArg, result: Result) -> dict[str, str]:
    """Say what stands in `calibrated.toml` and, where the chain came from one, in the URDF.

    Parameters
    ----------
    mechanism, result
        As for `calibrated`.

    Returns
    -------
    dict of str to str
        Text of each file by its name; none where nothing was determined.
    """
    if not any(p.value is not None for p in result.parameters):
        return {}
    toml = f"# {MARK} {result.version}\n{export_toml(mechanism, result)}"
    try:
        urdfs = export_urdf(mechanism, result)
    except InputError as error:  # a description that cannot take the correction
        return {"calibrated.toml": f"# no URDF: {error.message}\n{toml}"}
    foot = f"<!-- {MARK} {result.version} -->\n"
    return {"calibrated.toml": toml, **{name: text + foot for name, text in urdfs.items()}}
