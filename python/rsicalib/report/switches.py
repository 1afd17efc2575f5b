"""What a reader can choose to believe, or take out of the model, and what then changes."""

from __future__ import annotations

from collections.abc import Sequence
from html import escape
from typing import Any

import numpy as np

from rsicalib.facts.shapes import Evidence, ParameterName, ResultShape, Switch, TraceShape
from rsicalib.report.figure import Figure, data_element
from rsicalib.report.hypotheses import (
    choices_html,
    fader_html,
    fit_data,
    hypothesis_data,
    key_of,
    named_of,
    residuals_of,
)
from rsicalib.report.residuals import Dots, draw_residuals
from rsicalib.report.scene import Scene
from rsicalib.report.words import (
    either_words,
    misclosure_unit,
    number,
    parameter_name,
    subject,
)
from rsicalib.report.workspace import Shades

WIDEST_SIGMA = 10.0
"""The panel has room for residuals of this size at most; what is beyond lies at its edge."""


def words_of(switch: Switch) -> str:
    """What a switch does, in words."""
    if switch.effect is not None:
        return f"{subject(switch.effect)} is in the model"
    at = f", {switch.channel}," if switch.channel else ""
    return f"the reading of pose {switch.pose}{at} is left out"


def _taken(switches: Sequence[Switch]) -> str:
    """What the switches do, in words."""
    effects = {switch.effect is not None for switch in switches}
    ways = ["take out an effect"] * (True in effects) + ["take back a reading"] * (False in effects)
    return either_words(ways)


def data_of(evidence: Evidence, dots: Dots, scene: Scene | None) -> dict[str, Any]:
    """What the script of a page needs: every number as it is to be written."""
    board, known = evidence.switchboard, evidence.hypotheses
    fits = board.fits if board else ()
    parameters = board.parameters if board else ()
    named = named_of(known)
    # A dot of the mechanism is a pose; blocks of a recording have no dot there.
    return {
        "fits": [fit_data(fit, parameters, dots) for fit in fits],
        "hypotheses": [hypothesis_data(one, dots, scene, known[named]) for one in known],
        "named": named,
        "poses": dots.size == 1,
        "edges": Shades(evidence.workspace).edges if evidence.workspace else [],
        "equations": len(dots.equations),
    }


def _parameters(evidence: Evidence) -> list[ParameterName]:
    """The parameters of all fits, each once."""
    board = evidence.switchboard
    every = [*(board.parameters if board else ())]
    every += [p for one in evidence.hypotheses for p in one.parameters]
    return list({key_of(p): p for p in every}.values())


def switchboard_html(
    result: ResultShape, evidence: Evidence, dots: Dots, scene: Scene | None
) -> str:
    """What a reader can choose, what the fit says that was chosen, and the data of all fits."""
    data, unit = data_of(evidence, dots, scene), result.length_unit
    rivals = result.rivals if isinstance(result, TraceShape) else ()
    board, known = evidence.switchboard, evidence.hypotheses
    fits = [*(board.fits if board else ()), *(one.fit for one in known)]
    full = known[data["named"]].fit if not board else board.fits[-1]
    shown = data["fits"][-1] if data["fits"] else data["hypotheses"][data["named"]]
    boxes = "".join(
        f'<label><input type="checkbox" checked data-bit="{k}"> {escape(words_of(switch))}</label>'
        for k, switch in enumerate(board.switches if board else ())
    )
    switches = f'<fieldset id="switches"><legend>Suspects</legend>{boxes}</fieldset>'
    if not boxes:
        switches = ""
    elif known and board:
        words = f"{_taken(board.switches).capitalize()}, one at a time"
        switches = f"<details><summary>{words}</summary>{switches}</details>"
    names = ["χ² / degrees of freedom", "p-value", f"misclosure, rms [{misclosure_unit(result)}]"]
    if any(one.check is not None for one in known):
        names += [f"position, check poses [{unit}]", "orientation, check poses [rad]"]
    now = data["hypotheses"][data["named"]]["error"] if known else shown["error"]
    errors = "".join(
        f'<tr><td>{escape(name)}</td><td class="n">{escape(value)}</td>'
        f'<td class="n" data-error="{k}">{escape(value)}</td></tr>'
        for k, (name, value) in enumerate(zip(names, now, strict=True))
    )
    rows = ""
    for p in _parameters(evidence):
        key = escape(key_of(p))
        value, half = shown["parameters"].get(key_of(p), ("–", "–"))
        rows += (
            f"<tr{' hidden' * (value == '–')}><td>{escape(p.target)}</td>"
            f"<td>{escape(parameter_name(p.term, p.name))}</td>"
            f'<td class="n">{escape(value)}</td>'
            f'<td class="n" data-value="{key}">{escape(value)}</td>'
            f'<td class="n" data-half="{key}">{escape(half)}</td><td>{escape(p.unit)}</td></tr>'
        )
    ways = ["choose another hypothesis"] * bool(known)
    ways += [_taken(board.switches)] if board and boxes else []
    panel = residuals_of(full, len(dots.equations))
    largest = max(float(np.abs(residuals_of(f, len(dots.equations))).max()) for f in fits)
    picture = Figure(
        "switched",
        lambda width: draw_residuals(
            [("as chosen", dots.blocks(panel))],
            dots,
            width,
            numbered=True,
            at_least=min(1.1 * largest, WIDEST_SIGMA),
        ),
        f"The residual of what is chosen: {either_words(ways)}, and see where it grows (up "
        f"to {number(largest)} σ in all that can be chosen).",
    )
    means = (
        '<p class="faint">All are fits to the mean of the samples of each pose, whose misclosure '
        "is smaller than that of single samples.</p>"
    ) * (result.readings.samples > result.readings.poses)
    return (
        f'<div class="choose">{choices_html(evidence, rivals)}{fader_html(evidence)}{switches}'
        '<p id="switched-words" role="status" aria-live="polite"></p>\n'
        '<div class="scroll" role="region" aria-label="error as chosen" tabindex="0"><table>'
        '<thead><tr><td></td><th class="n">as found</th><th class="n">as chosen</th></tr></thead>'
        f"<tbody>{errors}</tbody></table></div>{picture.html()}</div>"
        '<details class="as-chosen"><summary>Parameters as chosen</summary>'
        '<div class="scroll" role="region" aria-label="parameters as chosen" tabindex="0">'
        '<table><thead><tr><th>target</th><th>parameter</th><th class="n">as found</th>'
        '<th class="n">as chosen</th><th class="n">± 95 %</th><th>unit</th></tr></thead>'
        f"<tbody>{rows}</tbody></table></div></details>"
        f"{means}{data_element('switchboard-data', data)}"
    )
