"""Write `docs/terms.md` and its pictures from the registry: `python -m scripts.make_terms`."""

from __future__ import annotations

import textwrap
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import rsicalib
from rsicalib.io.files import write_text
from scripts.term_pictures import picture

PAGE = Path(__file__).parents[1] / "docs" / "terms.md"

HEAD = """\
# Terms: what can be identified

Written by `python -m scripts.make_terms` from the registry; a test compares. A term is asked for
by its name, `--terms offset,gain,curvature@a22`, with a place, where it has one, after a colon:
`slip@a22:17`; `rsicalib terms curvature` prints one. `length` is the mechanism's unit, `reading`
the channel's ([units](formats.md#units-of-parameters)); sizes are typical ones, with which the
pictures are drawn, those of arms many times enlarged.

"""

HEAD_OF_TARGETS = "Targets are those of the hand controller: "

CAUSES = """\

## Causes that have another name here

| cause | what it is found as |
|---|---|
| a belt or wire that stretches under its own tension | `gain`; with `curvature` if a spring pulls |
| a belt, a wire or a gear that gives under the load | `joint_compliance`, `sag` |
| teeth of a gear, poles of a motor, turns of a winding | `n_per_turn`, with its order |
| the pitch of a screw, a drum that is not round | `n_per_turn`, with the length of a wave |
| bars or wheels that the mechanism does not declare | `crosstalk` of neighbouring channels |
| a bent shaft, an encoder's disc off its centre | `once_per_turn` |
| a chain that was knocked in the middle of a session | `base_slip` |
| a ball of a bar that was seated again, a clamp of a bar that gave way | `distance_slip` |
| lower belts that are read short | `gain` at `bl+br` |
| belts that all begin elsewhere | `offset` at `each` |
| rods of a delta printer whose length was entered wrongly | `distance` at `each` |
| an instant of sampling that jitters | noise, which neighbouring rows of a recording show |
| codes of a converter that are missing, stuck or repeated | a warning, before anything is fitted |

"""


def section(term: dict[str, Any]) -> str:
    """One term in full."""
    name = term["id"]
    words = f"What {name.replace('_', ' ')} does"
    lines = [f"## {name}", "", term["doc"].strip(), "", f"![{words}](terms/{name}.svg)", ""]
    sizes: dict[str, list[str]] = {}
    for p in term["parameters"]:
        size = f"{p['typical']:g}" + ("" if p["unit"] == "1" else f" {p['unit']}")
        sizes.setdefault(size, []).append(f"`{p['name']}`")
    said = "; ".join(f"{', '.join(names)} {size}" for size, names in sizes.items())
    lines.append(f"Parameters: {said}.")
    if term["needs"] != "readings":
        lines[-1] += f" Needs: {term['needs']}."
    lines[-1] += f" Targets: {_targets(term['targets'])}."
    if term["place"]:
        lines[-1] += f" Place: {term['place']}."
    return "\n".join(lines) + "\n"


def _kinds() -> dict[str, tuple[str, ...]]:
    """Targets that many terms have, by what they are."""
    drawn = rsicalib.load_mechanism().to_dict()
    channels, chains, closures = (
        tuple(one["name"] for one in drawn[kind]) for kind in ("channel", "chain", "closure")
    )
    rows = range(1, len(drawn["chain"][0]["dh"]) + 1)
    return {
        "channels": channels,
        "channels alike": tuple(f"each.{n + 1}" for n in range(len(channels) // len(chains))),
        "chains": chains,
        "links": tuple(f"{chain}/{n}" for chain in chains for n in rows),
        "links alike": tuple(f"each/{n}" for n in rows),
        "closures": closures,
    }


def _targets(targets: Sequence[str]) -> str:
    """Targets, those of a kind by its name."""
    left, names = list(targets), []
    for kind, those in _kinds().items():
        if set(those) <= set(left):
            left = [target for target in left if target not in those]
            names.append(kind)
    return ", ".join([*names, *left]) or "none"


def _ends(names: Sequence[str]) -> str:
    return ", ".join(names) if len(names) < 4 else f"{names[0]} to {names[-1]}"


def text() -> str:
    """The whole page."""
    terms = rsicalib.terms()
    listed: dict[str, list[str]] = {}
    for term in terms:
        first = " ".join(term["doc"].strip().split("\n\n")[0].split())
        row = f"- [{term['id']}](#{term['id']}): {first}\n"
        listed.setdefault(term["class"], []).append(row)
    kinds = "; ".join(f"*{kind}* {_ends(names)}" for kind, names in _kinds().items())
    head = textwrap.fill(HEAD_OF_TARGETS + kinds + ".", 95)
    classes = "".join(f"\n*{name}*\n\n{''.join(rows)}" for name, rows in listed.items())
    return HEAD + head + "\n" + classes + CAUSES + "\n".join(section(term) for term in terms)


def files() -> dict[Path, str]:
    """The page and its pictures, by path."""
    pictures = {PAGE.parent / "terms" / f"{t['id']}.svg": picture(t) for t in rsicalib.terms()}
    return {PAGE: text(), **pictures}


if __name__ == "__main__":
    PAGE.with_suffix("").mkdir(exist_ok=True)
    for path, content in files().items():
        write_text(path, content)
