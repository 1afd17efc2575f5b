"""What the devices of a fleet share: errors of their drawing, and a prior for the next device."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from rsicalib import _core
from rsicalib._core import Mechanism
from rsicalib.arrays import FloatArray
from rsicalib.errors import InputError
from rsicalib.fleets.dataset import Partition
from rsicalib.fleets.devices import devices_of
from rsicalib.fleets.engines import Part
from rsicalib.fleets.frames import Rows, devices_in, numbers_of
from rsicalib.fleets.levels import Levels
from rsicalib.fleets.store import Parts
from rsicalib.plain_text import p_equals
from rsicalib.units import HALF_95
from rsicalib.work.arguments import names_in, noise_of_channels
from rsicalib.work.prior import FORMAT

ROUNDS = 3
"""Linearisations: what the fleet has in common is where the next one is made."""

Run = Callable[["ShareJob"], Iterable[tuple[Part, Rows]]]
"""Hands the partitions of the dataset to a job, and its rows back."""

CELLS = 1_000_000
"""Estimates that are compared at once: 16 MB, whatever the number of devices."""


def tolerances_of(mechanism: Mechanism, terms: Sequence[str] | None) -> dict[str, float]:
    """Tolerances by term: those that are identified, and all others with an `sd`.

    Raises
    ------
    InputError
        A term has no tolerance: without one, what devices tell weakly is named as a design error.
    """
    model = mechanism.to_dict().get("model", {})
    sd = dict(model.get("sd", {}))
    asked = list(terms if terms is not None else model.get("terms", ("offset", "gain")))
    found = {
        term: sd.get(term.split("@")[0]) for term in [*asked, *(t for t in sd if t not in asked)]
    }
    without = [term for term, value in found.items() if value is None]
    if without:
        listed = ", ".join(f"{term} = …" for term in without)
        raise InputError(
            f"--population: found no tolerance of {', '.join(without)} in the mechanism, expected "
            f"the sd of the drawing: [model] sd = {{{listed}}}"
        )
    return {term: value for term, value in found.items() if value is not None}


@dataclass(frozen=True)
class ShareJob:
    """What each device of a partition tells of the population; travels to the workers."""

    mechanism: Mechanism
    by: str
    expected: Mapping[str, Any]
    """`centre` and `parameters`, as the core takes them."""
    terms: Sequence[str]
    options: Mapping[str, Any] = field(default_factory=dict)
    """`closures` and `noise` of `calibrate_devices`."""
    parts: Parts | None = None

    def __call__(self, partition: Partition) -> Rows:
        """Shares of the devices of a partition; a text where one tells nothing."""
        if not len(partition.frame[self.by]):
            return self.refuse(dict(partition.refused))
        try:
            devices = devices_of(partition.frame, partition.rest, self.mechanism, self.by)
        except InputError as error:
            if not partition.apart:
                raise
            refused = dict.fromkeys(devices_in(partition.frame[self.by]), error.message)
            return self.refuse(refused | dict(partition.refused))
        usable = [one for one in devices if one.refused is None]
        found = _core.shares(
            self.mechanism,
            [one.table for one in usable],
            [one.rest for one in usable],
            list(self.terms),
            self.expected,
            closures=names_in("closures", self.options.get("closures"), self.mechanism),
            noise=noise_of_channels(self.options.get("noise"), self.mechanism),
        )
        refused = {one.label: one.refused for one in devices if one.refused is not None}
        rows = self.refuse(refused | dict(partition.refused))
        labels = [one.label for one in usable]
        return {self.by: [*labels, *rows[self.by]], "share": [*found, *rows["share"]]}

    def refuse(self, refused: Mapping[Any, str]) -> Rows:
        """Rows of devices that tell nothing."""
        return {self.by: list(refused), "share": list(refused.values())}


def joint(
    mechanism: Mechanism,
    by: str,
    tolerances: Mapping[str, float],
    options: Mapping[str, Any],
    run: Run,
    levels: Levels | None = None,
) -> tuple[dict[str, Any], Rows]:
    """What the devices share, as `population.json` has it, and a row for each of them.

    With levels, what `by` names is a part of a device, such as a session: the largest groups are
    the devices.
    """
    centre = _core.centre_of_population(mechanism)
    expected = {"centre": centre, "parameters": list(_drawn(tolerances))}
    found: dict[str, Any] = {}
    devices: list[tuple[Any, Any]] = []
    with_others: list[Any] = []
    told: Mapping[str, Any] = {}
    for _ in range(ROUNDS):
        job = ShareJob(mechanism, by, expected, list(tolerances), options)
        # A piece in whose rows no device begins has none.
        parts = [part for _, part in run(job) if part]
        rows = [pair for part in parts for pair in zip(part[by], part["share"], strict=True)]
        devices = sorted(
            (d for d in rows if not isinstance(d[1], str) and (levels is None or levels.has(d[0]))),
            key=lambda d: (isinstance(d[0], str), d[0]),
        )
        if len(devices) < 2:
            why = next((share for _, share in rows if isinstance(share, str)), "no device")
            raise InputError(
                f"--population: found {len(devices)} devices ({why}), expected several"
            )
        told = devices[0][1]
        own = [tolerances[_term(p, tolerances)] for p in told["parameters"]]
        shares, labels = [share for _, share in devices], [label for label, _ in devices]
        above = Levels() if levels is None else levels.of(labels)
        found, with_others, device, level = _core.population(shares, own, above.numbers or None)
        expected = {"centre": centre, "parameters": list(_common(found))}
    if level is not None:
        by, own_group = above.names[level], dict(zip(device, above.labels(level), strict=True))
        labels = [own_group[k] for k in range(len(own_group))]
    found["outliers"] = [labels[k] for k in found["outliers"]]
    for parameter in found["parameters"]:
        if "levels" in parameter:
            parameter["levels"] = above.named(parameter["levels"])
    head: dict[str, Any] = {
        "format": FORMAT,
        "version": _core.__version__,
        "mechanism": mechanism.name,
    }
    head |= {"length_unit": mechanism.length_unit, "terms": list(tolerances), "centre": centre}
    return head | found, _rows(by, told, labels, with_others)


def _drawn(tolerances: Mapping[str, float]) -> Iterator[tuple[str, str | None, None, float, float]]:
    """What the drawing says: nothing is off, within the tolerances."""
    for spec, sd in tolerances.items():
        term, _, target = spec.partition("@")
        yield term, target or None, None, 0.0, sd


def _common(found: Mapping[str, Any]) -> Iterator[tuple[str, str, str, float, float]]:
    """What the fleet says of what was calibrated by itself."""
    for p in found["parameters"]:
        yield p["term"], p["target"], p["name"], p["shift"], p["spread"]


def _term(parameter: Sequence[str], tolerances: Mapping[str, float]) -> str:
    term, target = parameter[:2]
    own = f"{term}@{target}"
    return own if own in tolerances else term


def _rows(by: str, told: Mapping[str, Any], labels: list[Any], with_others: list[Any]) -> Rows:
    """Corrections of the drawing of each device with what the others tell; None for outliers."""
    rows: Rows = {by: labels}
    for k, (term, target, name, _) in enumerate(told["parameters"]):
        key = f"{term}@{target}" if name == term else f"{term}@{target}.{name}"
        rows[key] = [one[k][0] if one else None for one in with_others]
        rows[f"{key}_sd"] = [one[k][1] if one else None for one in with_others]
    return rows


def first_line(
    rows: Mapping[str, Sequence[Any]], mechanism: Mechanism, levels: Levels | None = None
) -> dict[str, Any]:
    """What the rows of a fleet tell of it as a whole, without a joint estimate.

    Parameters
    ----------
    rows : mapping of str to list
        Columns of `fleet.parquet`.
    mechanism : Mechanism
        The drawing that parameters are compared with.
    levels : Levels, optional
        Groups of the rows.

    Returns
    -------
    dict
        `summed`: the tests of fit of all devices together, or None; `shifts`: distance of each
        parameter from the drawing, in its unit, with the half width of an interval of 95 %, and the
        standard deviation between devices with its interval, None where they differ by less than
        their own errors would make them. Of unknown things the drawing says nothing: their mean is
        no shift, and has no `p_value`. With levels each shift has `levels`, what was calibrated by
        itself first; its mean is then that of the largest groups, and has no bound where levels
        cross or fewer than three groups are left.
    """
    parameters = [n for n in rows if f"{n}_sd" in rows]
    at_once = max(1, CELLS // max(1, len(rows["chi2"])))
    numbers = None if levels is None else levels.numbers
    shifts = []
    for start in range(0, len(parameters), at_once):
        some = parameters[start : start + at_once]
        found = _core.common_shifts(np.stack([_off(rows, n, mechanism) for n in some]), numbers)
        for name, one in zip(some, found, strict=True):
            if one is None:
                continue
            if levels is not None:
                one["levels"] = levels.named(one["levels"])
            drawn = name.partition("@")[0] not in _core.UNKNOWN_THINGS
            shifts.append({"parameter": name, **one} | ({} if drawn else {"p_value": None}))
    common = _core.beyond_chance([one["p_value"] for one in shifts])
    for one, own in zip(shifts, common, strict=True):
        one["common"] = own
    return {"summed": summed(rows), "shifts": shifts}


def summed(rows: Mapping[str, Sequence[Any]]) -> dict[str, Any] | None:
    """The tests of fit of all devices together; None of too few."""
    names = ("chi2", "dof", "p_value")
    return _core.summed(np.column_stack([numbers_of(rows, name) for name in names]))


def _off(rows: Mapping[str, Sequence[Any]], name: str, mechanism: Mechanism) -> FloatArray:
    """Distance of a parameter from the drawing and its standard deviation, by devices."""
    off = numbers_of(rows, name) - _value_drawn(name, mechanism)
    return np.column_stack([off, numbers_of(rows, f"{name}_sd")])


def _value_drawn(name: str, mechanism: Mechanism) -> float:
    """What the drawing says of a parameter: absolute for offsets and gains, else nothing."""
    term, _, target = name.partition("@")
    for channel in mechanism.channels:
        if channel.name == target and term in ("offset", "gain"):
            return float(getattr(channel, term))
    return 0.0


def is_misfit(first: Mapping[str, Any], found: Mapping[str, Any] | None) -> bool:
    """Whether the devices together do not fit, or not the drawing."""
    wrong = any(s["common"] for s in first["shifts"]) if found is None else found["design"]
    return lacks_together(first["summed"]) or bool(wrong)


def lacks_together(whole: Mapping[str, Any] | None) -> bool:
    """Whether the fits of all devices together leave more than noise."""
    return _core.beyond_chance([None if whole is None else whole["p_value"]])[0]


def sentences(first: Mapping[str, Any], found: Mapping[str, Any] | None) -> list[str]:
    """The first line in words: what the fleet has in common."""
    lines = []
    whole = first["summed"]
    if whole is not None:
        ratio = whole["chi2"] / whole["dof"]
        what = f"χ² is {ratio:.3f} times its degrees of freedom over {whole['devices']} devices"
        if lacks_together(whole):
            lines.append(
                f"Together the devices do not fit: {what} ({p_equals(whole['p_value'], '.1g')}). "
                "They lack the same effect, even if none of them alone shows it."
            )
        else:
            lines.append(f"Together the devices fit: {what} ({p_equals(whole['p_value'])}).")
    if found is None:
        shifted = sorted((s for s in first["shifts"] if s["common"]), key=lambda s: s["p_value"])
        for s in shifted[:3]:
            value, half = f"{s['value']:+.4g}", f"{s['half']:.2g}"
            lines.append(f"{s['parameter']} is {value} ± {half} from the drawing in all devices.")
        return lines
    for one in found["design"]:
        value, half = f"{one['value']:+.4g}", f"{HALF_95 * one['sd']:.2g}"
        other = f" (or {', '.join(one['also_fits'][:3])})" if one["also_fits"] else ""
        lines.append(
            f"The drawing is wrong: {one['term']} of {one['target']} by {value} ± {half} "
            f"{one['unit']}{other}."
        )
    if not found["design"]:
        lines.append("No error of the drawing stands out.")
    if found["outliers"]:
        listed = ", ".join(map(str, found["outliers"][:5]))
        lines.append(f"{len(found['outliers'])} devices are unlike the others: {listed}.")
    return lines
