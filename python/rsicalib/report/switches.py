"""The switchboard: suspects that a reader can take out of the model, and what then changes."""

from __future__ import annotations

import json
from html import escape
from typing import Any

import numpy as np

from rsicalib.arrays import FloatArray
from rsicalib.report.figure import Figure
from rsicalib.report.residuals import Dots, draw_residuals
from rsicalib.report.words import name_of, number, plus_minus, probability, subject
from rsicalib.shapes import Switch, Switchboard, SwitchFit

__all__ = ["data_of", "script_data", "switchboard_html", "words_of"]


MOST = 10.0
"""The panel has room for residuals of this size at most; what is beyond lies at its edge."""


def words_of(switch: Switch) -> str:
    """What a switch does, in words."""
    if switch.effect is not None:
        return f"{subject(switch.effect)} is in the model"
    at = f", {switch.channel}," if switch.channel else ""
    return f"the reading of pose {switch.pose}{at} is left out"


def residuals_of(fit: SwitchFit, equations: int) -> FloatArray:
    """Residuals of a fit: (poses, equations)."""
    rows: FloatArray = np.array(fit.residuals, dtype=np.float64).reshape(-1, equations)
    return rows


def data_of(board: Switchboard, dots: Dots) -> dict[str, Any]:
    """What the script of a page needs: every number as it is to be written."""

    def estimate(value: float | None, sd: float | None) -> list[str]:
        return list(plus_minus(value, None if sd is None else 1.96 * sd))

    fits = [
        {
            "error": [
                f"{number(fit.chi2)} / {number(fit.dof)}",
                probability(fit.p_value),
                number(fit.rms_misclosure),
            ],
            "parameters": [estimate(v, s) for v, s in zip(fit.values, fit.sd, strict=True)],
            "residuals": [
                round(float(v), 2)
                for v in dots.blocks(residuals_of(fit, len(dots.equations))).ravel()
            ],
        }
        for fit in board.fits
    ]
    # A dot of the mechanism is a pose; blocks of a recording have no dot there.
    return {"fits": fits, "poses": dots.size == 1, "equations": len(dots.equations)}


def script_data(data: dict[str, Any]) -> str:
    """Data in a page: no text in it can end the element."""
    text = json.dumps(data, ensure_ascii=False, separators=(",", ":"), allow_nan=False)
    for sign in "<>&":
        text = text.replace(sign, f"\\u{ord(sign):04x}")
    return f'<script type="application/json" id="switchboard-data">{text}</script>'


def switchboard_html(board: Switchboard, dots: Dots, unit: str) -> str:
    """The switches, what the fit with them says, and the data of all fits."""
    data = data_of(board, dots)
    full = data["fits"][-1]
    boxes = "".join(
        f'<label><input type="checkbox" checked data-bit="{k}"> {escape(words_of(switch))}</label>'
        for k, switch in enumerate(board.switches)
    )
    names = ("χ² / degrees of freedom", "p-value", f"misclosure, rms [{unit}]")
    errors = "".join(
        f'<tr><td>{escape(name)}</td><td class="n">{escape(now)}</td>'
        f'<td class="n" data-error="{k}">{escape(now)}</td></tr>'
        for k, (name, now) in enumerate(zip(names, full["error"], strict=True))
    )
    rows = "".join(
        f"<tr><td>{escape(p.target)}</td><td>{escape(_name(p.term, p.name))}</td>"
        f'<td class="n">{escape(value)}</td><td class="n" data-value="{k}">{escape(value)}</td>'
        f'<td class="n" data-half="{k}">{escape(half)}</td><td>{escape(p.unit)}</td></tr>'
        for k, (p, (value, half)) in enumerate(
            zip(board.parameters, full["parameters"], strict=True)
        )
    )
    panel = residuals_of(board.fits[-1], len(dots.equations))
    largest = max(float(np.abs(residuals_of(f, len(dots.equations))).max()) for f in board.fits)
    picture = Figure(
        "switched",
        lambda width: draw_residuals(
            [("as switched", dots.blocks(panel))],
            dots,
            width,
            numbered=True,
            at_least=min(1.1 * largest, MOST),
        ),
        "The residual of the fit as switched: take out an effect or take back a reading, and see "
        f"where the residual grows (the largest of all these fits is {number(largest)} σ).",
    )
    return (
        "<p>Fits with and without each suspect. They are fits to the mean of the samples of each "
        "pose, whose misclosure is smaller than that of single samples.</p>"
        f'<fieldset id="switches"><legend>Suspects</legend>{boxes}</fieldset>'
        '<p id="switched-words" role="status" aria-live="polite">All switches are on.</p>'
        f'<div class="scroll" role="region" aria-label="error as switched" tabindex="0"><table>'
        '<thead><tr><th></th><th class="n">all on</th><th class="n">as switched</th></tr></thead>'
        f"<tbody>{errors}</tbody></table></div>{picture.html()}"
        f"<details><summary>Parameters as switched</summary>"
        '<div class="scroll" role="region" aria-label="parameters as switched" tabindex="0">'
        '<table><thead><tr><th>target</th><th>parameter</th><th class="n">all on</th>'
        '<th class="n">as switched</th><th class="n">± 95 %</th><th>unit</th></tr></thead>'
        f"<tbody>{rows}</tbody></table></div></details>{script_data(data)}"
    )


def _name(term: str, name: str) -> str:
    return name_of(term) if term == name else f"{name_of(term)} {name}"
