"""Write `docs/terms.md` and its pictures from the registry: `python -m scripts.make_terms`."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import rsicalib
from rsicalib.io.files import write_text
from scripts.term_pictures import picture

PAGE = Path(__file__).parents[1] / "docs" / "terms.md"

HEAD = """\
# Terms: what can be identified

Written by `python -m scripts.make_terms` from the registry; a test compares. The targets are
those of the hand controller. `length` is the mechanism's unit, `reading` the channel's. A term is
asked for by its name, `--terms offset,gain,curvature@a22`, and printed by `rsicalib terms
curvature`. [Units](formats.md#units-of-parameters) are those of the formats. The pictures are
drawn with parameters of the typical size, with signs in turn; those of arms are many times
enlarged.

| term | class | parameters | |
|---|---|---|---|
"""


CAUSES = """\

## Causes that have another name here

| cause | what it is found as |
|---|---|
| a belt or wire that stretches under its own tension | `gain`; with `curvature` if a spring pulls |
| a belt, a wire or a gear that gives under the load | `joint_compliance`, `sag` |
| teeth of a gear, poles of a motor, turns of a winding | `n_per_turn`, with its order |
| bars or wheels that the mechanism does not declare | `crosstalk` of neighbouring channels |
| a bent shaft, an encoder's disc off its centre | `once_per_turn` |
| a chain that was knocked in the middle of a session | `base_slip` |
| a ball of a bar that was seated again, a clamp of a bar that gave way | `distance_slip` |
| lower belts that are read short | `gain` at `bl+br` |
| belts that all begin elsewhere | `offset` at `each` |
| an instant of sampling that jitters | noise, which neighbouring rows of a recording show |
| codes of a converter that are missing, stuck or repeated | a warning, before anything is fitted |

"""


def section(term: dict[str, Any]) -> str:
    """One term in full."""
    name = term["id"]
    words = f"What {name.replace('_', ' ')} does"
    lines = [f"## {name}", "", term["doc"].strip(), "", f"![{words}](terms/{name}.svg)", ""]
    lines += ["| parameter | unit | typical size |", "|---|---|---|"]
    lines += [f"| `{p['name']}` | {p['unit']} | {p['typical']:g} |" for p in term["parameters"]]
    lines += ["", f"Needs: {term['needs']}. Targets: {', '.join(term['targets']) or 'none'}."]
    if term["place"]:
        lines[-1] += (
            f" Place: {term['place']}, as in `{name}@{(term['targets'] or ['TARGET'])[0]}:PLACE`."
        )
    return "\n".join(lines) + "\n"


def text() -> str:
    """The whole page."""
    terms = rsicalib.terms()
    rows = []
    for term in terms:
        first = " ".join(term["doc"].strip().split("\n\n")[0].split())
        names = ", ".join(f"`{p['name']}`" for p in term["parameters"])
        rows.append(f"| [{term['id']}](#{term['id']}) | {term['class']} | {names} | {first} |")
    return HEAD + "\n".join(rows) + "\n" + CAUSES + "\n".join(section(term) for term in terms)


def files() -> dict[Path, str]:
    """The page and its pictures, by path."""
    pictures = {PAGE.parent / "terms" / f"{t['id']}.svg": picture(t) for t in rsicalib.terms()}
    return {PAGE: text(), **pictures}


if __name__ == "__main__":
    PAGE.with_suffix("").mkdir(exist_ok=True)
    for path, content in files().items():
        write_text(path, content)
