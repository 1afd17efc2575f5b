"""What the library says of readings of real machines, beside the quick fits.

`python -m tests.machines.real FOLDER [NAME …]` traces every session of the folder, or those whose
names begin so, with the mechanism file beside it: what is named, with its 95 % interval; χ² and
misclosure before and after; and every parameter of the result that the quick fits have. Where a
tracker saw the machine, how far it is from the tracker's points, which no fit sees, after a rigid
motion: as drawn, with the offsets that the file asks for, and as traced.
"""

from __future__ import annotations

import sys
from pathlib import Path
from time import perf_counter
from typing import Any

import rsicalib
from tests.machines.trials import WITHIN

SESSIONS = {
    "maslow": ("*.csv", "maslow.toml"),
    "delta": ("*.csv", "delta.toml"),
    "dvrk_plane": ("*.csv", ""),
    "motoman_planes": ("*.csv", "motoman_right.toml"),
    "so101": ("*.csv", "teleop.toml"),
}
SEEN = {"motoman_planes": "leica_lower_table1_5x5.csv"}
"""Session of a folder in which a tracker's points are beside the readings."""


def mechanism_of(file: Path) -> Path:
    """The mechanism file of a session."""
    name = SESSIONS[file.parent.name][1]
    if not name:
        arm = file.stem.partition("_")[0]
        name = {"tracker": "psm_tracker.toml", "PSM3": "psm3.toml"}.get(arm, "psm.toml")
    return file.parent / name


def sessions(data: Path, begins: tuple[str, ...] = ("",)) -> list[Path]:
    """All sessions that are there."""
    found = [f for name, (p, _) in SESSIONS.items() for f in sorted((data / name).glob(p))]
    return [f for f in found if f.stem.startswith(begins)]


def interval(parameter: dict[str, Any]) -> str:
    """A value with its 95 % interval."""
    value, sd = parameter["value"], parameter["sd"]
    shown = "unknown" if sd is None else f"{WITHIN * sd:.3g}"
    return f"{parameter['name']} {value:.4g} ± {shown} {parameter['unit']}"


def described(answer: dict[str, Any]) -> list[str]:
    """Lines on one result."""
    before, after = answer["before"], answer["after"]
    lines = [
        f"{answer['verdict']}: χ²/dof {before['chi2']:.1f}/{before['dof']:.0f} -> "
        f"{after['chi2']:.1f}/{after['dof']:.0f}, misclosure {before['rms_misclosure']:.4g} -> "
        f"{after['rms_misclosure']:.4g} {answer['length_unit']}"
    ]
    for step in answer["steps"]:
        values = ", ".join(interval(p) for p in step["parameters"])
        ties = [f"{t['term']}@{t['target']}" for t in step["also_fits"] or []]
        also = f" (also fits: {', '.join(ties)})" if ties else ""
        lines.append(f"  {step['term']}@{step['target']}: {values}{also}")
    for entry in answer["excluded"]:
        lines.append(f"  left out: pose {entry['pose']}: {entry['reason']}")
    lines.append(f"  left over: {(answer.get('unexplained') or {}).get('text')}")
    return lines


def off(file: Path, seen: Path) -> str:
    """Root mean square distance from a tracker's points of each fit of a session."""
    fits = {"as drawn": "nominal", "with the offsets asked for": "before", "as traced": "after"}
    traced = rsicalib.trace(file, mechanism_of(file), check=seen, align=True).to_dict()
    # Told is the root mean square of one coordinate.
    off = {words: 3**0.5 * traced[fit]["aligned"]["position_rms"] for words, fit in fits.items()}
    told = ", ".join(f"{words} {value:.3g}" for words, value in off.items())
    return f"  off the tracker's points [{traced['length_unit']}]: {told}"


def main(data: Path, *begins: str) -> None:
    """Prints every session."""
    for file in sessions(data, begins or ("",)):
        start = perf_counter()
        try:
            result = rsicalib.trace(file, mechanism_of(file))
        except BaseException as error:  # a defect is a line of the table
            if isinstance(error, KeyboardInterrupt):
                raise
            print(f"{file.parent.name}/{file.stem}: {type(error).__name__}: {error}", flush=True)
            continue
        lines = described(result.to_dict())
        print(f"{file.parent.name}/{file.stem} ({perf_counter() - start:.1f} s)")
        if file.parent.name in SEEN:
            lines.append(off(file, file.with_name(SEEN[file.parent.name])))
        print("  " + "\n  ".join(lines), flush=True)


if __name__ == "__main__":
    main(Path(sys.argv[1]), *sys.argv[2:])
