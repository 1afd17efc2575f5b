"""Coefficients whose sign no physics allows: reported, and not called by the name of their term."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

__all__ = ["mark_unphysical"]

CERTAIN = 2.0
"""Standard deviations below zero from which a sign counts."""


def mark_unphysical(result: Mapping[str, Any], terms: Mapping[str, Mapping[str, Any]]) -> list[str]:
    """Note on coefficients of load that are negative: no joint gives against its load.

    Such a term has absorbed something else, whatever it did to the residual.

    Parameters
    ----------
    result : mapping
        With `parameters`, and `steps` of a trace; plain dictionaries get a `note` of their own.
    terms : mapping
        What each term is, by its id.

    Returns
    -------
    list of str
        A sentence for each.
    """
    load = {name for name, info in terms.items() if info["class"] == "load"}
    words = []
    for step in result.get("steps", []):
        if step["term"] in load:
            for parameter in step["parameters"]:
                _mark(parameter)
    for parameter in result.get("parameters", []):
        if isinstance(parameter, dict) and parameter["term"] in load and _mark(parameter):
            value, sd, unit = (parameter[key] for key in ("value", "sd", "unit"))
            words.append(
                f"{parameter['term']} {parameter['target']}: the coefficient is negative, "
                f"{value:.2g} ± {sd:.1g} {unit}; a joint cannot give against its load, so it "
                "stands for something else here and is no stiffness"
            )
    return words


def _mark(parameter: dict[str, Any]) -> bool:
    value, sd = parameter["value"], parameter["sd"]
    wrong = value is not None and bool(sd) and value < -CERTAIN * sd
    if wrong:
        parameter["note"] = "unphysical sign: stands for something else, not for a compliance"
    return wrong
