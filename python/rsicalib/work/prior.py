"""A population as a prior of one more of its devices."""

from __future__ import annotations

import math
import os
from collections.abc import Mapping
from typing import Any, TypeAlias

from rsicalib._core import Mechanism
from rsicalib.errors import InputError
from rsicalib.io.sources import read_json

FORMAT = "rsicalib.population/1"

PopulationArg: TypeAlias = str | os.PathLike[str] | Mapping[str, Any]
"""A `population.json`, or what stands in it."""


def read_population(population: PopulationArg, mechanism: Mechanism) -> dict[str, Any]:
    """What `fleet --population` has found of a mechanism.

    Raises
    ------
    InputError
        It is no such file, or of another mechanism.
    """
    where = "population" if isinstance(population, Mapping) else str(population)
    if isinstance(population, Mapping):
        found = dict(population)
    else:
        found = read_json(population, "population.json")
    if found.get("format") != FORMAT:
        raise InputError.at(where, "another format", FORMAT)
    if found.get("mechanism") != mechanism.name:
        own = f"devices of {found.get('mechanism')!r}"
        raise InputError.at(where, own, f"of {mechanism.name!r}")
    return found


def expected_of(population: Mapping[str, Any]) -> dict[str, Any]:
    """What it expects of a device: the common shift, what is not known of it, and the spread."""
    try:
        parameters = [
            (p["term"], p["target"], p["name"], p["shift"], math.hypot(p["spread"], p["sd"]))
            for p in population["parameters"]
        ]
        return {"centre": list(population["centre"]), "parameters": parameters}
    except (KeyError, TypeError) as error:
        found = f"no {error}" if isinstance(error, KeyError) else str(error)
        raise InputError(f"population: found {found}, expected {FORMAT}") from None
